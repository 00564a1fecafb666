//! One route: a request to what is asked of an operation, and what it answers to a response.

use std::sync::Arc;

use axum::Extension;
use axum::extract::{FromRequestParts, Path, Query, Request, State};
use axum::http::request::Parts;
use axum::http::{HeaderMap, HeaderName, HeaderValue, StatusCode, header};
use axum::response::{IntoResponse, Response};
use axum::routing::{MethodFilter, MethodRouter, on};
use utoipa::openapi::path::HttpMethod;

use super::browser::FromPage;
use super::seat::Seat;
use super::{accept, body, stream};
use crate::access::Who;
use crate::error::Error;
use crate::serve::app::App;
use crate::serve::operation::{Asked, Content, Events, Once, Operation, Reply, Sent};
use crate::serve::problem::{Answer, Problem};
use crate::serve::shared::Shared;
use crate::serve::weight::Weight;
use crate::serve::wire::{Form, MSGPACK, pack};

/// The route of an operation.
pub fn of(operation: &'static Operation) -> MethodRouter<Arc<Shared>> {
    let method = match operation.method {
        HttpMethod::Post => MethodFilter::POST,
        HttpMethod::Put => MethodFilter::PUT,
        HttpMethod::Delete => MethodFilter::DELETE,
        _ => MethodFilter::GET,
    };
    let asked = move |State(shared): State<Arc<Shared>>,
                      Extension(who): Extension<Who>,
                      Extension(seat): Extension<Arc<Seat>>,
                      request: Request| {
        let from_page = request.extensions().get::<FromPage>().is_some_and(|page| page.0);
        async move {
            let asked = request.headers().get("x-deadline").map(|v| v.to_str().unwrap_or_default());
            let app = App::new(&shared, who, seat.from(), shared.span("X-Deadline", asked)?);
            answer(operation, Arc::new(app), request, from_page).await
        }
    };
    on(method, asked)
}

async fn answer(
    operation: &'static Operation,
    app: Arc<App>,
    request: Request,
    from_page: bool,
) -> Answer<Response> {
    operation.admits(&app)?;
    let (mut parts, body) = request.into_parts();
    let form = accept::accepted(&parts.headers);
    let mut sent = sent(&mut parts).await?;
    if operation.takes_body {
        if from_page {
            declared(operation, &parts.headers, &sent.kind)?;
        }
        sent.body = body::read(body, app.shared().limits.body_seconds).await?;
    }
    let key = parts.headers.get("idempotency-key").filter(|_| operation.keyed);
    let once = key.map(|key| {
        let asked = format!("{} {}\n", parts.method, parts.uri);
        Once::new(String::from_utf8_lossy(key.as_bytes()).into_owned(), &[asked.as_bytes(), &sent.body])
    });
    let asked = Asked::sent(sent, once.transpose()?, form.raw());
    let call = operation.ready(&app, asked)?;
    if call.weight == Weight::Large && form == Form::Json {
        let value = move |app: &App| match (call.work)(app)?.content {
            Content::Value(value) => Ok(value),
            _ => Err(Problem::defect()),
        };
        return stream::answered(&app, value).await;
    }
    let written = move |app: &App| written((call.work)(app)?, form);
    let written = match call.weight {
        Weight::Light => app.run_light(written).await?,
        weight => app.run(weight, written).await?,
    };
    Ok(response(&app, written))
}

/// Errors where a page sends a body of a type that the operation does not declare: forms and plain text go without
/// the browser's asking.
fn declared(operation: &Operation, headers: &HeaderMap, kind: &str) -> Answer<()> {
    let empty = headers.get(header::CONTENT_LENGTH).is_none_or(|length| length == "0")
        && !headers.contains_key(header::TRANSFER_ENCODING);
    let declared = operation.described.body_types();
    if (empty && kind.is_empty()) || declared.iter().any(|d| d == kind) {
        return Ok(());
    }
    Err(Problem::media_type(kind, &declared))
}

/// All that is sent but the body.
async fn sent(parts: &mut Parts) -> Answer<Sent> {
    let Path(path) = Path::<Vec<(String, String)>>::from_request_parts(parts, &())
        .await
        .map_err(|e| Problem::malformed(Error::input("path", e.body_text(), "a path in UTF-8")))?;
    let query = Query::<Vec<(String, String)>>::try_from_uri(&parts.uri);
    let last_event = parts.headers.get("last-event-id");
    Ok(Sent {
        path,
        query: query.map(|Query(pairs)| pairs).map_err(|e| e.body_text()),
        last_event: last_event.map(|v| String::from_utf8_lossy(v.as_bytes()).into_owned()),
        body: Vec::new(),
        kind: media_type(&parts.headers),
    })
}

/// Lower case and without parameters; empty if not said.
fn media_type(headers: &HeaderMap) -> String {
    let kind = headers.get("content-type").map_or(&b""[..], |v| v.as_bytes());
    String::from_utf8_lossy(kind).split(';').next().unwrap_or_default().trim().to_ascii_lowercase()
}

/// An answer with its body written.
struct Written {
    status: u16,
    location: Option<String>,
    again: bool,
    body: WrittenBody,
}

enum WrittenBody {
    Nothing,
    Bytes { kind: &'static str, bytes: Vec<u8> },
    Events(Box<dyn Events>),
}

/// Writes an answer; off the async threads, unless it is light.
fn written(reply: Reply, form: Form) -> Answer<Written> {
    let Reply { status, location, again, content } = reply;
    let body = match content {
        Content::Nothing => WrittenBody::Nothing,
        Content::Media(media) => WrittenBody::Bytes { kind: media.kind, bytes: media.bytes },
        Content::Events(watcher) => WrittenBody::Events(watcher),
        Content::Json(json) => match form {
            Form::Json => of_json(json),
            Form::Msgpack { .. } => of_msgpack(pack::from_json(&json))?,
        },
        Content::Value(mut value) => match form {
            Form::Json => of_json(value.json().map_err(Problem::unwritable)?),
            Form::Msgpack { .. } => {
                let arrays = if form.raw() { value.bulk() } else { Vec::new() };
                of_msgpack(value.packed().and_then(|plain| pack::with_arrays(plain, arrays)))?
            }
        },
    };
    Ok(Written { status, location, again, body })
}

fn of_json(bytes: Vec<u8>) -> WrittenBody {
    WrittenBody::Bytes { kind: "application/json", bytes }
}

fn of_msgpack(bytes: Result<Vec<u8>, pack::Unwritable>) -> Answer<WrittenBody> {
    Ok(WrittenBody::Bytes { kind: MSGPACK, bytes: bytes.map_err(Problem::unwritable)? })
}

fn response(app: &App, written: Written) -> Response {
    let status = StatusCode::from_u16(written.status).unwrap_or(StatusCode::INTERNAL_SERVER_ERROR);
    let mut response = match written.body {
        WrittenBody::Nothing => status.into_response(),
        WrittenBody::Events(watcher) => return stream::events(app.shared(), watcher),
        WrittenBody::Bytes { kind, bytes } => {
            (status, [(header::CONTENT_TYPE, HeaderValue::from_static(kind))], bytes).into_response()
        }
    };
    let headers = response.headers_mut();
    if let Some(place) = written.location.and_then(|p| HeaderValue::from_str(&p).ok()) {
        headers.insert(header::LOCATION, place);
    }
    if written.again {
        headers.insert(HeaderName::from_static("idempotent-replayed"), HeaderValue::from_static("true"));
    }
    response
}
