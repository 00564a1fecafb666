//! Operations in this process, as a server's transports do them: with their limits, turns, deadlines and log.

use std::sync::Arc;
use std::time::Instant;

use serde_json::{Map, Value};

use crate::access::{Digest, Scope, Who, digest, now};
use crate::error::{Error, Result};
use crate::serve::app::App;
use crate::serve::client::Client;
use crate::serve::log::{RequestLine, slug};
use crate::serve::operation::{Asked, Content, Operation, Reply};
use crate::serve::problem::{Answer, Problem};
use crate::serve::shared::Shared;

/// The server in this process, as one who is known sees it.
pub struct Here {
    shared: Arc<Shared>,
    /// Where tokens are asked for.
    token: Option<Digest>,
    may: Scope,
    place: Client,
}

/// What an operation gave.
pub enum Given {
    Nothing,
    Value(Value),
    Media(Vec<u8>),
}

impl Given {
    /// A value, if it is one.
    pub fn value(self) -> Answer<Value> {
        match self {
            Given::Value(value) => Ok(value),
            Given::Nothing => Ok(Value::Null),
            Given::Media(_) => Err(Problem::defect()),
        }
    }

    /// Bytes, if they are.
    pub fn media(self) -> Answer<Vec<u8>> {
        match self {
            Given::Media(bytes) => Ok(bytes),
            _ => Err(Problem::defect()),
        }
    }
}

/// Whose the things are that an agent makes where nobody has a token.
const AGENT: &str = "agent";

impl Here {
    /// Errors if tokens are asked for and this one is none of them.
    pub fn new(shared: Arc<Shared>, token: Option<&str>, may: Scope) -> Result<Here> {
        let token = token.map(|t| digest(t.as_bytes()));
        let here = Here { shared, token, may, place: Client::local() };
        here.who().map_err(|problem| {
            let allowed = "a token of this data directory (`iplw token new NAME --may act --data-dir DIR`)";
            Error::input("IPLW_TOKEN", problem.title.to_lowercase(), allowed)
        })?;
        Ok(here)
    }

    /// Who asks, now: a token may end meanwhile.
    fn who(&self) -> Answer<Who> {
        if !self.shared.keyring.asks() {
            return Ok(Who { name: Some(AGENT.into()), scope: self.may });
        }
        let who = self.shared.keyring.who(self.token.as_ref(), now()).map_err(Problem::unauthorized)?;
        Ok(Who { scope: who.scope.min(self.may), ..who })
    }

    /// Whether worlds last as long as the data, so that one made before is found again.
    pub fn lasts(&self) -> bool {
        true
    }

    /// Asks for an operation.
    pub async fn ask(&self, operation: &'static Operation, fields: Map<String, Value>) -> Answer<Given> {
        let since = Instant::now();
        let who = self.who()?;
        let owner = who.owner().map(String::from);
        let answer = self.answer(operation, fields, who).await;
        let status = answer.as_ref().map_or_else(|problem| problem.status, |_| 200);
        let seconds = since.elapsed().as_secs_f64();
        self.shared.log.request(&RequestLine {
            request: &self.shared.request_id(),
            transport: "mcp",
            operation: operation.name,
            who: owner.as_deref(),
            status,
            problem: answer.as_ref().err().map(|problem| slug(&problem.kind)),
            seconds,
            trace: None,
        });
        answer
    }

    async fn answer(
        &self,
        operation: &'static Operation,
        fields: Map<String, Value>,
        who: Who,
    ) -> Answer<Given> {
        let span = self.shared.span("deadline", None)?;
        let app = Arc::new(App::new(&self.shared, who, &self.place, span));
        let call = operation.ready(&app, Asked::fields(fields, None, None, false))?;
        let work = call.work;
        app.run(call.weight, move |app| work(app).and_then(given)).await
    }
}

fn given(reply: Reply) -> Answer<Given> {
    let value = |json: &[u8]| serde_json::from_slice(json).map(Given::Value).map_err(Problem::unwritable);
    match reply.content {
        Content::Nothing => Ok(Given::Nothing),
        Content::Value(whole) => value(&whole.json().map_err(Problem::unwritable)?),
        Content::Json(json) => value(&json),
        Content::Media(media) => Ok(Given::Media(media.bytes)),
        Content::Events(_) => Err(Problem::defect()),
    }
}
