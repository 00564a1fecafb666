//! Authentication middleware: checks `Host` and origin, then authenticates the caller, before a request is read.

use std::sync::Arc;

use axum::extract::{MatchedPath, Request, State};
use axum::http::{HeaderMap, header};
use axum::middleware::Next;
use axum::response::{IntoResponse, Response};

use super::connections::ConnectionHandle;
use super::cors::OriginPolicy;
use super::{head, page};
use crate::access::{Digest, Principal, Scope, digest, now};
use crate::serve::client::Client;
use crate::serve::operation::Operation;
use crate::serve::problem::Problem;
use crate::serve::state::AppState;

/// Digest of a request's token; none without authentication.
#[derive(Clone, Copy)]
pub struct PresentedToken(pub Option<Digest>);

/// State of the middleware.
#[derive(Clone)]
pub struct AuthState {
    pub shared: Arc<AppState>,
    pub origins: Arc<OriginPolicy>,
    pub operations: &'static [Operation],
}

/// Rejects unauthenticated requests, except to public operations; adds the caller and the browser flag to the request.
pub async fn authenticate(State(guard): State<AuthState>, mut request: Request, next: Next) -> Response {
    let page = match head::check(&request).and_then(|()| guard.origins.check(&request)) {
        Ok(page) => page,
        Err(problem) => return problem.into_response(),
    };
    if let Some(response) = guard.origins.preflight(&request) {
        return response;
    }
    let presented = presented_token(&guard.shared, request.headers());
    let who = match guard.shared.keyring.authenticate(presented.as_ref(), now()) {
        Ok(who) => who,
        Err(_) if guard.is_public(&request) => Principal { name: None, scope: Scope::Read },
        Err(unknown) => return Problem::unauthorized(unknown).into_response(),
    };
    // Anonymous origins keep the connection's peer address as their client.
    let connection = request.extensions().get::<Arc<ConnectionHandle>>();
    if let Some(connection) = connection.filter(|_| who.name.is_some())
        && !connection.assign_to(&Client::identify(&who, connection.peer()))
    {
        let limit = guard.shared.limits().client_connections;
        return ([(header::CONNECTION, "close")], Problem::too_many_connections(limit)).into_response();
    }
    request.extensions_mut().insert(PresentedToken(presented));
    request.extensions_mut().insert(who.clone());
    request.extensions_mut().insert(page);
    let mut response = next.run(request).await;
    // For the access log.
    response.extensions_mut().insert(who);
    response
}

impl AuthState {
    /// Whether the operation needs no token.
    fn is_public(&self, request: &Request) -> bool {
        let path = request.extensions().get::<MatchedPath>().map(MatchedPath::as_str);
        let of = |path| self.operations.iter().filter(move |o| o.path == path);
        path.is_some_and(|path| {
            page::contains(path) || (of(path).count() > 0 && of(path).all(|o| o.required_scope.is_none()))
        })
    }
}

/// Digest of the token in `Authorization: Bearer TOKEN`; the scheme is case-insensitive (RFC 9110, section 11.1).
fn presented_token(shared: &AppState, headers: &HeaderMap) -> Option<Digest> {
    let presented = headers.get(header::AUTHORIZATION).map(|value| {
        let (scheme, token) = value.as_bytes().split_at_checked(7).unwrap_or((value.as_bytes(), b""));
        if scheme.eq_ignore_ascii_case(b"bearer ") { token.trim_ascii() } else { b"" }
    });
    // Without tokens no digest is needed.
    presented.filter(|_| shared.keyring.requires_token()).map(digest)
}
