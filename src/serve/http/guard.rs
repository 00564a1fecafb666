//! What is looked at before a request is read: whom it is for, whether a page sends it, and who asks.

use std::sync::Arc;

use axum::extract::{MatchedPath, Request, State};
use axum::http::{HeaderMap, header};
use axum::middleware::Next;
use axum::response::{IntoResponse, Response};

use super::browser::Callers;
use super::page;
use super::seat::Seat;
use crate::access::{Scope, Unknown, Who, digest, now};
use crate::serve::client::Client;
use crate::serve::operation::Operation;
use crate::serve::problem::Problem;
use crate::serve::shared::Shared;

/// What is looked at before a request is read.
#[derive(Clone)]
pub struct Guard {
    pub shared: Arc<Shared>,
    pub callers: Arc<Callers>,
    pub operations: &'static [Operation],
}

/// Lets nobody in who may not ask, but to what needs no token; tells the rest who asks, and whether by a page.
pub async fn admitted(State(guard): State<Guard>, mut request: Request, next: Next) -> Response {
    let page = match guard.callers.admit(&request) {
        Ok(page) => page,
        Err(problem) => return problem.into_response(),
    };
    if let Some(told) = guard.callers.preflight(&request) {
        return told;
    }
    let who = match bearer(&guard.shared, request.headers()) {
        Ok(who) => who,
        Err(_) if guard.is_open(&request) => Who { name: None, scope: Scope::Read },
        Err(unknown) => return Problem::unauthorized(unknown).into_response(),
    };
    // Who is let in though not known stays where the connection is from.
    let seat = request.extensions().get::<Arc<Seat>>();
    if let Some(seat) = seat.filter(|_| who.name.is_some())
        && !seat.is_of(&Client::of(&who, seat.from()))
    {
        let limit = guard.shared.limits.client_connections;
        return ([(header::CONNECTION, "close")], Problem::crowded(limit)).into_response();
    }
    request.extensions_mut().insert(who.clone());
    request.extensions_mut().insert(page);
    let mut response = next.run(request).await;
    // For the log.
    response.extensions_mut().insert(who);
    response
}

impl Guard {
    /// Whether what is asked for needs no token.
    fn is_open(&self, request: &Request) -> bool {
        let path = request.extensions().get::<MatchedPath>().map(MatchedPath::as_str);
        let of = |path| self.operations.iter().filter(move |o| o.path == path);
        path.is_some_and(|path| {
            page::has(path) || (of(path).count() > 0 && of(path).all(|o| o.needs.is_none()))
        })
    }
}

/// `Authorization: Bearer TOKEN`; the scheme in any case (RFC 9110, section 11.1).
fn bearer(shared: &Shared, headers: &HeaderMap) -> Result<Who, Unknown> {
    let presented = headers.get(header::AUTHORIZATION).map(|value| {
        let (scheme, token) = value.as_bytes().split_at_checked(7).unwrap_or((value.as_bytes(), b""));
        if scheme.eq_ignore_ascii_case(b"bearer ") { token.trim_ascii() } else { b"" }
    });
    // Where nobody is asked, nothing is computed.
    let presented = presented.filter(|_| shared.keyring.asks()).map(digest);
    shared.keyring.who(presented.as_ref(), now())
}
