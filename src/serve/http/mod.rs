//! HTTP: routes, bodies and headers around the operations.

mod asked;
mod batch;
mod document;
mod extract;
mod jobs;
mod policies;
mod stream;
mod surfaces;
mod system;
mod tasks;
mod worlds;

use std::any::Any;
use std::sync::Arc;

use axum::Router;
use axum::body::Body;
use axum::extract::{MatchedPath, Request, State};
use axum::http::{HeaderName, HeaderValue, StatusCode, header};
use axum::middleware::{self, Next};
use axum::response::{IntoResponse, Response};
use serde::Serialize;
use serde_json::Value;
use tower_http::catch_panic::CatchPanicLayer;
use utoipa::OpenApi;
use utoipa_axum::router::OpenApiRouter;
use utoipa_axum::routes;
use utoipa_swagger_ui::{Config, SwaggerUi};

use super::app::App;
use super::operations::once::{Once, once};
use super::operations::{Keep, Page};
use super::problem::{Answer, PROBLEM, PROBLEM_MSGPACK, Problem};
use super::wire::{Bulk, pack};
use crate::error::Result;
use extract::{Caller, Form, MSGPACK};

/// Largest body, bytes.
pub const BODY_LIMIT: usize = 16 * 1024 * 1024;

/// Everything but what the routes say of themselves.
#[derive(OpenApi)]
#[openapi(
    info(
        title = "iplw",
        description = "2D physics worlds to act in, latent factors to estimate, policies to transfer. \
            All quantities are SI. Every error is a problem (RFC 9457) that names the field, its value and what \
            is allowed. A POST that makes something takes an `Idempotency-Key`: repeated under the same key, it \
            makes nothing and is answered the same. Lists come in pages: `limit`, and `cursor` from the `next` of \
            the page before. Every route that takes JSON takes the same map as `application/msgpack`, and gives it \
            where that is accepted. In msgpack an array may be extension 78, `[dtype, shape, bytes]` with NumPy's \
            dtype, little endian, C order; answers have them so on `Accept: application/msgpack; arrays=raw`.",
    ),
    tags(
        (name = "worlds", description = "Worlds as resources: reset, step, set_latents, rollout, render."),
        (name = "batch", description = "Many worlds in one request: all of it is done, or nothing."),
        (name = "tasks", description = "Built-in families of tasks."),
        (name = "workflow", description = "Explore, measure, estimate: as a job."),
        (name = "policies", description = "Train, act, evaluate, download and upload weights."),
        (name = "jobs", description = "Long work: progress by server-sent events, cancel."),
        (name = "system", description = "Health, metrics, this document."),
    ),
    components(schemas(Problem))
)]
struct Document;

/// All routes, and the document they make.
pub fn routes() -> (Router<Arc<App>>, utoipa::openapi::OpenApi) {
    let (router, mut document) = OpenApiRouter::with_openapi(Document::openapi())
        .routes(routes!(worlds::list, worlds::create))
        .routes(routes!(worlds::get, worlds::delete))
        .routes(routes!(worlds::reset))
        .routes(routes!(worlds::step))
        .routes(routes!(worlds::set_latents))
        .routes(routes!(worlds::rollout))
        .routes(routes!(worlds::render))
        .routes(routes!(batch::create, batch::delete))
        .routes(routes!(batch::reset))
        .routes(routes!(batch::step))
        .routes(routes!(tasks::families))
        .routes(routes!(tasks::family))
        .routes(routes!(tasks::task))
        .routes(routes!(jobs::iplw))
        .routes(routes!(jobs::diagnose))
        .routes(routes!(asked::proposals))
        .routes(routes!(asked::tell))
        .routes(routes!(surfaces::find, surfaces::list))
        .routes(routes!(surfaces::get, surfaces::delete))
        .routes(routes!(surfaces::draw))
        .routes(routes!(policies::train, policies::list))
        .routes(routes!(policies::get, policies::delete))
        .routes(routes!(policies::weights, policies::put_weights))
        .routes(routes!(policies::act))
        .routes(routes!(policies::learn))
        .routes(routes!(policies::evaluate))
        .routes(routes!(jobs::list))
        .routes(routes!(jobs::get, jobs::delete))
        .routes(routes!(jobs::events))
        .routes(routes!(jobs::trials))
        .routes(routes!(system::healthz))
        .routes(routes!(system::readyz))
        .routes(routes!(system::metrics))
        .routes(routes!(system::openapi))
        .split_for_parts();
    document.info.version = env!("CARGO_PKG_VERSION").into();
    document::complete(&mut document);
    (router, document)
}

/// The whole service.
pub fn service(app: Arc<App>) -> Router {
    let (router, _) = routes();
    let docs = SwaggerUi::new("/docs").config(Config::from("/openapi.json"));
    router
        .merge(docs)
        .fallback(no_route)
        .method_not_allowed_fallback(no_method)
        .layer(CatchPanicLayer::custom(panicked))
        .layer(middleware::from_fn_with_state(app.clone(), count))
        .with_state(app)
}

/// An answer in the form the caller wants, made off the async threads.
async fn answer<T: Serialize + Bulk + 'static>(
    caller: &Caller,
    status: StatusCode,
    work: impl FnOnce(&App) -> Result<T> + Send + 'static,
) -> Answer<Response> {
    answer_light(caller, false, status, work).await
}

/// The same, made on the spot if the work is light.
async fn answer_light<T: Serialize + Bulk + 'static>(
    caller: &Caller,
    light: bool,
    status: StatusCode,
    work: impl FnOnce(&App) -> Result<T> + Send + 'static,
) -> Answer<Response> {
    let form = caller.form;
    let written = move |app: &App| body_of(work(app)?, form);
    let body = if light { written(caller)? } else { caller.run(written).await? };
    Ok(response(status, form, body))
}

/// Takes a request that makes something and may carry a key: asked again under the same key, it makes nothing and
/// is answered the same. `work` is given what makes the answer that is to be kept with its effect.
async fn answer_once<T: Serialize + 'static>(
    caller: &Caller,
    by: Option<Once>,
    status: StatusCode,
    location: fn(&T) -> Option<String>,
    work: impl FnOnce(&App, Keep<T>) -> Result<T> + Send + 'static,
) -> Answer<Response> {
    let made = caller.run(move |app| once(app, by, status.as_u16(), location, work));
    let (answered, again) = made.await?;
    let status = StatusCode::from_u16(answered.status).unwrap_or(status);
    let body = match caller.form {
        Form::Json => answered.body,
        Form::Msgpack { .. } => {
            let kept: Value = serde_json::from_slice(&answered.body).unwrap_or_default();
            pack::pack(&kept, Vec::new()).unwrap_or_default()
        }
    };
    let mut response = response(status, caller.form, body);
    let headers = response.headers_mut();
    if let Some(place) = answered.location.and_then(|p| HeaderValue::from_str(&p).ok()) {
        headers.insert(header::LOCATION, place);
    }
    if again {
        headers.insert(HeaderName::from_static("idempotent-replayed"), HeaderValue::from_static("true"));
    }
    Ok(response)
}

/// A part of a list.
async fn answer_page<T: Serialize + Bulk + 'static>(
    caller: &Caller,
    pairs: Vec<(String, String)>,
    work: impl FnOnce(&App, &Page) -> Result<T> + Send + 'static,
) -> Answer<Response> {
    answer(caller, StatusCode::OK, move |app| work(app, &Page::from_query(&pairs)?)).await
}

fn body_of<T: Serialize + Bulk>(mut value: T, form: Form) -> Answer<Vec<u8>> {
    let unwritable = |e: serde_json::Error| {
        tracing::error!("an answer cannot be written: {e}");
        Problem::defect()
    };
    match form {
        Form::Json => serde_json::to_vec(&value).map_err(unwritable),
        Form::Msgpack { raw } => {
            let arrays = if raw { value.bulk() } else { Vec::new() };
            pack::pack(&value, arrays).map_err(unwritable)
        }
    }
}

fn response(status: StatusCode, form: Form, body: Vec<u8>) -> Response {
    let kind = match form {
        Form::Json => "application/json",
        Form::Msgpack { .. } => MSGPACK,
    };
    (status, [(header::CONTENT_TYPE, HeaderValue::from_static(kind))], body).into_response()
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

/// Counts the request, keeps browsers from guessing types, and sees that every error is a problem, also one
/// that a library answered.
async fn count(State(app): State<Arc<App>>, request: Request, next: Next) -> Response {
    let method = request.method().as_str().to_string();
    let route = request.extensions().get::<MatchedPath>().map_or("none", |p| p.as_str()).to_string();
    let path = request.uri().path().to_string();
    let form = Form::accepted(request.headers());
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
        let body = pack::pack(&problem, Vec::new()).unwrap_or_default();
        let (mut parts, _) = response.into_parts();
        parts.headers.remove(header::CONTENT_LENGTH);
        parts.headers.insert(header::CONTENT_TYPE, HeaderValue::from_static(PROBLEM_MSGPACK));
        response = Response::from_parts(parts, Body::from(body));
    }
    app.metrics.answered(&method, &route, response.status().as_u16());
    let nosniff = HeaderValue::from_static("nosniff");
    response.headers_mut().insert(HeaderName::from_static("x-content-type-options"), nosniff);
    response
}
