//! In-process client of the operations, with the same limits, queues, deadlines and log as the server's transports.

use std::sync::Arc;
use std::time::Instant;

use serde_json::{Map, Value};

use crate::access::{Digest, Principal, Scope, digest, now};
use crate::error::{Error, Result};
use crate::serve::client::Client;
use crate::serve::log::{RequestLine, slug};
use crate::serve::operation::{Operation, OperationRequest, OperationResponse, Payload};
use crate::serve::problem::{HandlerResult, Problem};
use crate::serve::request_context::RequestContext;
use crate::serve::state::AppState;

/// In-process client with a fixed identity.
pub struct LocalClient {
    shared: Arc<AppState>,
    /// Presented if authentication is enabled.
    token: Option<Digest>,
    scope: Scope,
    peer: Client,
}

/// Response of an operation.
pub enum LocalResponse {
    Nothing,
    Value(Value),
    MediaBody(Vec<u8>),
}

impl LocalResponse {
    /// The JSON value; an error for media.
    pub fn value(self) -> HandlerResult<Value> {
        match self {
            LocalResponse::Value(value) => Ok(value),
            LocalResponse::Nothing => Ok(Value::Null),
            LocalResponse::MediaBody(_) => Err(Problem::internal()),
        }
    }

    /// The bytes of a media response; an error otherwise.
    pub fn media(self) -> HandlerResult<Vec<u8>> {
        match self {
            LocalResponse::MediaBody(bytes) => Ok(bytes),
            _ => Err(Problem::internal()),
        }
    }
}

/// Owner of an agent's resources without authentication.
const AGENT: &str = "agent";

impl LocalClient {
    /// Fails if authentication is enabled and the token is invalid.
    pub fn new(shared: Arc<AppState>, token: Option<&str>, scope: Scope) -> Result<LocalClient> {
        let token = token.map(|t| digest(t.as_bytes()));
        let client = LocalClient { shared, token, scope, peer: Client::local() };
        client.principal().map_err(|problem| {
            let allowed = "a token of this data directory (`iplw token new NAME --scope act --data-dir DIR`)";
            Error::input("IPLW_TOKEN", problem.title.to_lowercase(), allowed)
        })?;
        Ok(client)
    }

    /// The current principal; checked per call, since the token can expire.
    fn principal(&self) -> HandlerResult<Principal> {
        if !self.shared.keyring.requires_token() {
            return Ok(Principal { name: Some(AGENT.into()), scope: self.scope });
        }
        let principal =
            self.shared.keyring.authenticate(self.token.as_ref(), now()).map_err(Problem::unauthorized)?;
        Ok(Principal { scope: principal.scope.min(self.scope), ..principal })
    }

    /// Whether worlds persist in the data directory, so that earlier ones can be found.
    pub fn is_persistent(&self) -> bool {
        true
    }

    /// Calls an operation and logs the request.
    pub async fn ask(
        &self,
        operation: &'static Operation,
        fields: Map<String, Value>,
    ) -> HandlerResult<LocalResponse> {
        let since = Instant::now();
        let principal = self.principal()?;
        let owner = principal.owner().map(String::from);
        let answer = self.answer(operation, fields, principal).await;
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
        principal: Principal,
    ) -> HandlerResult<LocalResponse> {
        let span = self.shared.request_timeout("deadline", None)?;
        let app = Arc::new(RequestContext::new(&self.shared, principal, &self.peer, span));
        let request = OperationRequest::from_fields(fields, None, None, false);
        let call = operation.authorize(&app)?.prepare(&app, request)?;
        let work = call.work;
        app.run(call.class, move |app| work(app).and_then(to_response)).await
    }
}

fn to_response(reply: OperationResponse) -> HandlerResult<LocalResponse> {
    let value =
        |json: &[u8]| serde_json::from_slice(json).map(LocalResponse::Value).map_err(Problem::serialization);
    match reply.content {
        Payload::Nothing => Ok(LocalResponse::Nothing),
        Payload::Value(whole) => value(&whole.to_json().map_err(Problem::serialization)?),
        Payload::Json(json) => value(&json),
        Payload::MediaBody(media) => Ok(LocalResponse::MediaBody(media.bytes)),
        Payload::EventStream(_) => Err(Problem::internal()),
    }
}
