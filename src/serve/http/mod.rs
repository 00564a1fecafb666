//! The service over HTTP: a route for every operation, the page, `/docs`, and what holds for all answers.
//!
//! | file | what it does |
//! |---|---|
//! | `guard` | who asks, and whether they may |
//! | `browser` | what pages may do, and what answers tell browsers |
//! | `page` | the page for people, at `/` |
//! | `listen` `seat` `timed` `tls` | connections: taken, whose, timed, encrypted |
//! | `route` | a request to what was asked, and what is answered to a response |
//! | `body` | bodies within their limit |
//! | `accept` | which form of an answer is wanted |
//! | `stream` | large answers and events, as they come |
//! | `document` | the OpenAPI document, from the operations' declarations |

mod accept;
mod body;
mod browser;
mod document;
mod guard;
mod listen;
mod page;
mod route;
mod seat;
mod stream;
mod timed;
mod tls;

use std::any::Any;
use std::sync::Arc;
use std::time::Instant;

use axum::Router;
use axum::body::Body;
use axum::extract::{MatchedPath, Request, State};
use axum::http::{HeaderMap, HeaderName, HeaderValue, StatusCode, header};
use axum::middleware::{self, Next};
use axum::response::{IntoResponse, Response};
use tower_http::catch_panic::CatchPanicLayer;
use utoipa::openapi::path::HttpMethod;
use utoipa_swagger_ui::{Config, SwaggerUi};

use super::log::{RequestLine, given_id, slug, trace};
use super::operation::Operation;
use super::problem::{PROBLEM, PROBLEM_MSGPACK, Problem};
use super::shared::Shared;
use super::wire::{Form, pack};
use crate::access::Who;
pub use browser::Callers;
pub use document::document;
use guard::Guard;
pub use listen::serve;
pub use tls::Tls;

/// The whole service.
pub fn service(shared: Arc<Shared>, operations: &'static [Operation], callers: Callers) -> Router {
    let callers = Arc::new(callers);
    let guard = Guard { shared: shared.clone(), callers: callers.clone(), operations };
    let docs = SwaggerUi::new("/docs").config(Config::from("/openapi.json"));
    operations
        .iter()
        .fold(Router::new(), |router, operation| router.route(operation.path, route::of(operation)))
        .merge(docs)
        .merge(page::routes())
        .fallback(no_route)
        .method_not_allowed_fallback(no_method)
        .layer(CatchPanicLayer::custom(panicked))
        .layer(middleware::from_fn_with_state(guard, guard::admitted))
        .layer(middleware::from_fn_with_state((shared.clone(), callers, operations), count))
        .with_state(shared)
}

/// What every answer is made with.
type Watched = (Arc<Shared>, Arc<Callers>, &'static [Operation]);

async fn no_route(request: Request) -> Problem {
    Problem::no_route(request.uri().path())
}

async fn no_method(request: Request) -> Problem {
    Problem::no_method(request.method().as_str(), request.uri().path())
}

fn panicked(_: Box<dyn Any + Send>) -> Response<Body> {
    tracing::error!("a handler panicked");
    Problem::defect().into_response()
}

fn as_msgpack(response: Response, problem: &Problem) -> Response {
    let (mut parts, _) = response.into_parts();
    parts.headers.remove(header::CONTENT_LENGTH);
    parts.headers.insert(header::CONTENT_TYPE, HeaderValue::from_static(PROBLEM_MSGPACK));
    Response::from_parts(parts, Body::from(pack::packed(problem).unwrap_or_default()))
}

fn text(headers: &HeaderMap, name: &str) -> Option<String> {
    headers.get(name).and_then(|v| v.to_str().ok()).map(String::from)
}

/// An operation's method as HTTP has it.
fn named(operation: &Operation) -> &'static str {
    match operation.method {
        HttpMethod::Post => "POST",
        HttpMethod::Put => "PUT",
        HttpMethod::Delete => "DELETE",
        _ => "GET",
    }
}

/// What a browser may do with what is answered at a path.
fn policy(path: &str) -> &'static str {
    match path {
        _ if page::has(path) => page::MAY,
        _ if path.starts_with("/docs") => browser::OF_DOCS,
        _ => browser::OF_ANSWERS,
    }
}

/// Counts the request, logs it, tells browsers what they may do with the answer, and sees that every error is a problem, also one
/// that a library answered.
async fn count(
    State((shared, callers, operations)): State<Watched>,
    request: Request,
    next: Next,
) -> Response {
    let method = request.method().as_str().to_string();
    let route = request.extensions().get::<MatchedPath>().map_or("none", |p| p.as_str()).to_string();
    let path = request.uri().path().to_string();
    let form = accept::accepted(request.headers());
    let origin = request.headers().get(header::ORIGIN).and_then(|o| o.to_str().ok()).map(String::from);
    let asked = text(request.headers(), "x-request-id");
    let id = asked.as_deref().and_then(given_id).map_or_else(|| shared.request_id(), String::from);
    let parent = text(request.headers(), "traceparent");
    let begun = Instant::now();
    let mut response = next.run(request).await;
    let status = response.status();
    let told = response.headers().get(header::CONTENT_TYPE).is_some_and(|t| t == PROBLEM);
    if !told && status == StatusCode::NOT_FOUND {
        response = Problem::no_route(&path).into_response();
    } else if !told && (status.is_client_error() || status.as_u16() == 500) {
        let title = status.canonical_reason().unwrap_or("Error");
        response =
            Problem::new(status, "http", title, format!("{path} was answered with {status}")).into_response();
    }
    let refused = response.extensions_mut().remove::<Problem>();
    if let Some(problem) = &refused
        && form != Form::Json
    {
        response = as_msgpack(response, problem);
    }
    let seconds = begun.elapsed().as_secs_f64();
    let status = response.status().as_u16();
    let operation = operations.iter().find(|o| o.path == route && named(o) == method);
    shared.log.request(&RequestLine {
        request: &id,
        transport: "http",
        operation: operation.map_or("none", |o| o.name),
        who: response.extensions().get::<Who>().and_then(Who::owner),
        status,
        problem: refused.as_ref().map(|p| slug(&p.kind)),
        seconds,
        trace: parent.as_deref().and_then(trace),
    });
    if let Some(operation) = operation {
        shared.base.metrics.took("http", operation.name, status, seconds);
    }
    if let Ok(id) = HeaderValue::from_str(&id) {
        response.headers_mut().insert(HeaderName::from_static("x-request-id"), id);
    }
    shared.base.metrics.answered(&method, &route, response.status().as_u16());
    callers.cover(origin.as_deref(), policy(&path), &mut response);
    response
}
