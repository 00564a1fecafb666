//! The HTTP service: a route for every operation, the web page, `/docs`, and the middleware.
//!
//! | module | responsibility |
//! |---|---|
//! | `auth` | authentication middleware |
//! | `cors` | checks of `Host` and origin; CORS and security headers |
//! | `page` | the web page at `/` |
//! | `listen` `connections` `timeouts` `tls` | connections: accepted, registered, timed, encrypted |
//! | `route` | an HTTP request to an operation's request, and its response back |
//! | `body` | reads bodies up to a limit |
//! | `accept` | content negotiation |
//! | `stream` | streamed responses and server-sent events |
//! | `document` | the OpenAPI document |

mod accept;
mod auth;
mod body;
mod connections;
mod cors;
mod document;
mod head;
mod listen;
mod page;
mod route;
mod stream;
mod timeouts;
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

use super::log::{RequestLine, parse_traceparent, slug, valid_request_id};
use super::operation::Operation;
use super::problem::{PROBLEM_JSON, PROBLEM_MSGPACK, Problem};
use super::state::AppState;
use super::wire::{WireFormat, msgpack};
use crate::access::Principal;
use auth::AuthState;
pub use cors::OriginPolicy;
pub use document::document;
pub use listen::serve;
pub use tls::Tls;

/// The whole service.
pub fn service(shared: Arc<AppState>, operations: &'static [Operation], origins: OriginPolicy) -> Router {
    let origins = Arc::new(origins);
    let guard = AuthState { shared: shared.clone(), origins: origins.clone(), operations };
    let docs = SwaggerUi::new("/docs").config(Config::from("/openapi.json"));
    operations
        .iter()
        .fold(Router::new(), |router, operation| {
            router.route(operation.path, route::method_router(operation))
        })
        .merge(docs)
        .merge(page::routes())
        .fallback(no_route)
        .method_not_allowed_fallback(route::no_method)
        .layer(CatchPanicLayer::custom(panicked))
        .layer(middleware::from_fn_with_state(guard, auth::authenticate))
        .layer(middleware::from_fn_with_state((shared.clone(), origins, operations), observe))
        .with_state(shared)
}

/// State of the outermost middleware.
type LayerState = (Arc<AppState>, Arc<OriginPolicy>, &'static [Operation]);

async fn no_route(request: Request) -> Problem {
    Problem::no_route(request.uri().path())
}

fn panicked(_: Box<dyn Any + Send>) -> Response<Body> {
    tracing::error!("a handler panicked");
    Problem::internal().into_response()
}

fn as_msgpack(response: Response, problem: &Problem) -> Response {
    let (mut parts, _) = response.into_parts();
    parts.headers.remove(header::CONTENT_LENGTH);
    parts.headers.insert(header::CONTENT_TYPE, HeaderValue::from_static(PROBLEM_MSGPACK));
    Response::from_parts(parts, Body::from(msgpack::packed(problem).unwrap_or_default()))
}

fn text(headers: &HeaderMap, name: &str) -> Option<String> {
    headers.get(name).and_then(|v| v.to_str().ok()).map(String::from)
}

/// The method of an operation.
fn method_name(operation: &Operation) -> &'static str {
    match operation.method {
        HttpMethod::Post => "POST",
        HttpMethod::Put => "PUT",
        HttpMethod::Patch => "PATCH",
        HttpMethod::Delete => "DELETE",
        _ => "GET",
    }
}

/// Content-Security-Policy of a path.
fn content_security_policy(path: &str) -> &'static str {
    match path {
        _ if page::contains(path) => page::PAGE_CSP,
        _ if path.starts_with("/docs") => cors::DOCS_CSP,
        _ => cors::API_CSP,
    }
}

/// Outermost middleware: metrics, access log, security headers; converts errors of libraries to problems.
async fn observe(
    State((shared, origins, operations)): State<LayerState>,
    request: Request,
    next: Next,
) -> Response {
    let method = request.method().as_str().to_string();
    let route = request.extensions().get::<MatchedPath>().map_or("none", |p| p.as_str()).to_string();
    let path = request.uri().path().to_string();
    let form = accept::negotiate(request.headers());
    let origin = request.headers().get(header::ORIGIN).and_then(|o| o.to_str().ok()).map(String::from);
    let requested_id = text(request.headers(), "x-request-id");
    let id =
        requested_id.as_deref().and_then(valid_request_id).map_or_else(|| shared.request_id(), String::from);
    let parent = text(request.headers(), "traceparent");
    let begun = Instant::now();
    let mut response = next.run(request).await;
    let status = response.status();
    let is_problem = response.headers().get(header::CONTENT_TYPE).is_some_and(|t| t == PROBLEM_JSON);
    if !is_problem && status == StatusCode::NOT_FOUND {
        response = Problem::no_route(&path).into_response();
    } else if !is_problem && (status.is_client_error() || status.as_u16() == 500) {
        let title = status.canonical_reason().unwrap_or("Error");
        response = Problem::new(status, "http", title, format!("{path}: {status}")).into_response();
    }
    let refused = response.extensions_mut().remove::<Problem>();
    if let Some(problem) = &refused
        && form != WireFormat::Json
    {
        response = as_msgpack(response, problem);
    }
    let seconds = begun.elapsed().as_secs_f64();
    let status = response.status().as_u16();
    let operation = operations.iter().find(|o| o.path == route && method_name(o) == method);
    shared.log.request(&RequestLine {
        request: &id,
        transport: "http",
        operation: operation.map_or("none", |o| o.name),
        who: response.extensions().get::<Principal>().and_then(Principal::owner),
        status,
        problem: refused.as_ref().map(|p| slug(&p.kind)),
        seconds,
        trace: parent.as_deref().and_then(parse_traceparent),
    });
    if let Some(operation) = operation {
        shared.core.metrics.observe_duration("http", operation.name, status, seconds);
    }
    if let Ok(id) = HeaderValue::from_str(&id) {
        response.headers_mut().insert(HeaderName::from_static("x-request-id"), id);
    }
    shared.core.metrics.count_response(&method, &route, response.status().as_u16());
    origins.apply_headers(origin.as_deref(), content_security_policy(&path), &mut response);
    response
}
