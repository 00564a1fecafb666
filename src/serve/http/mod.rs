//! The service over HTTP: a route for every operation, `/docs`, and what holds for all answers.
//!
//! | file | what it does |
//! |---|---|
//! | `guard` | who asks, and whether they may |
//! | `browser` | what pages may do, and what answers tell browsers |
//! | `listen` `timed` `tls` | connections: taken, timed, encrypted |
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
mod route;
mod stream;
mod timed;
mod tls;

use std::any::Any;
use std::sync::Arc;

use axum::Router;
use axum::body::Body;
use axum::extract::{MatchedPath, Request, State};
use axum::http::{HeaderValue, StatusCode, header};
use axum::middleware::{self, Next};
use axum::response::{IntoResponse, Response};
use tower_http::catch_panic::CatchPanicLayer;
use utoipa_swagger_ui::{Config, SwaggerUi};

use super::operation::Operation;
use super::problem::{PROBLEM, PROBLEM_MSGPACK, Problem};
use super::shared::Shared;
use super::wire::{Form, pack};
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
        .fallback(no_route)
        .method_not_allowed_fallback(no_method)
        .layer(CatchPanicLayer::custom(panicked))
        .layer(middleware::from_fn_with_state(guard, guard::admitted))
        .layer(middleware::from_fn_with_state((shared.clone(), callers), count))
        .with_state(shared)
}

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

/// Counts the request, tells browsers what they may do with the answer, and sees that every error is a problem, also one
/// that a library answered.
async fn count(
    State((shared, callers)): State<(Arc<Shared>, Arc<Callers>)>,
    request: Request,
    next: Next,
) -> Response {
    let method = request.method().as_str().to_string();
    let route = request.extensions().get::<MatchedPath>().map_or("none", |p| p.as_str()).to_string();
    let path = request.uri().path().to_string();
    let form = accept::accepted(request.headers());
    let origin = request.headers().get(header::ORIGIN).and_then(|o| o.to_str().ok()).map(String::from);
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
    if let Some(problem) = response.extensions_mut().remove::<Problem>()
        && form != Form::Json
    {
        let body = pack::packed(&problem).unwrap_or_default();
        let (mut parts, _) = response.into_parts();
        parts.headers.remove(header::CONTENT_LENGTH);
        parts.headers.insert(header::CONTENT_TYPE, HeaderValue::from_static(PROBLEM_MSGPACK));
        response = Response::from_parts(parts, Body::from(body));
    }
    shared.base.metrics.answered(&method, &route, response.status().as_u16());
    callers.cover(origin.as_deref(), path.starts_with("/docs"), &mut response);
    response
}
