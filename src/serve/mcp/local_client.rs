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
use crate::store::LOCAL_AGENT;

/// In-process client with a fixed identity.
pub struct LocalClient {
    shared: Arc<AppState>,
    /// Presented if authentication is enabled.
    token: Option<Digest>,
    scope: Scope,
    peer: Client,
}

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
            return Ok(Principal { name: Some(LOCAL_AGENT.into()), scope: self.scope });
        }
        let principal =
            self.shared.keyring.authenticate(self.token.as_ref(), now()).map_err(Problem::unauthorized)?;
        Ok(Principal { scope: principal.scope.min(self.scope), ..principal })
    }

    /// Calls an operation, logs the request, and returns the body of the response: JSON or media.
    pub async fn ask(
        &self,
        operation: &'static Operation,
        fields: Map<String, Value>,
    ) -> HandlerResult<Vec<u8>> {
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
    ) -> HandlerResult<Vec<u8>> {
        let span = self.shared.request_timeout("deadline", None)?;
        let app = Arc::new(RequestContext::new(&self.shared, principal, &self.peer, span));
        let request = OperationRequest::from_fields(fields, None, None, false);
        let call = operation.authorize(&app)?.prepare(&app, request)?;
        let work = call.work;
        app.run(call.class, move |app| work(app).and_then(to_body)).await
    }
}

fn to_body(response: OperationResponse) -> HandlerResult<Vec<u8>> {
    match response.content {
        Payload::Nothing => Ok(Vec::new()),
        Payload::Value(value) => value.to_json().map_err(Problem::serialization),
        Payload::Json(json) => Ok(json),
        Payload::MediaBody(media) => Ok(media.bytes),
        Payload::EventStream(_) => Err(Problem::internal()),
    }
}
