//! One route: an HTTP request to an operation's request, and its response to an HTTP response.

use std::sync::Arc;

use axum::Extension;
use axum::extract::{FromRequestParts, Path, Query, Request, State};
use axum::http::request::Parts;
use axum::http::{HeaderMap, HeaderName, HeaderValue, StatusCode, header};
use axum::response::{IntoResponse, Response};
use axum::routing::{MethodFilter, MethodRouter, on};
use utoipa::openapi::path::HttpMethod;

use super::auth::PresentedToken;
use super::connections::ConnectionHandle;
use super::cors::FromBrowser;
use super::{accept, body, stream};
use crate::access::{Digest, Principal};
use crate::error::Error;
use crate::serve::execution_class::{ExecutionClass, MAX_INLINE_BODY_BYTES};
use crate::serve::operation::{
    EventStream, HttpRequestParts, IdempotencyKey, Operation, OperationRequest, OperationResponse, Payload,
};
use crate::serve::problem::{HandlerResult, Problem};
use crate::serve::request_context::RequestContext;
use crate::serve::state::AppState;
use crate::serve::wire::{MSGPACK, WireFormat, msgpack};

/// The route of an operation.
pub fn method_router(operation: &'static Operation) -> MethodRouter<Arc<AppState>> {
    let method = match operation.method {
        HttpMethod::Post => MethodFilter::POST,
        HttpMethod::Put => MethodFilter::PUT,
        HttpMethod::Patch => MethodFilter::PATCH,
        HttpMethod::Delete => MethodFilter::DELETE,
        _ => MethodFilter::GET,
    };
    let handler = move |State(shared): State<Arc<AppState>>,
                        Extension(who): Extension<Principal>,
                        Extension(connection): Extension<Arc<ConnectionHandle>>,
                        request: Request| {
        let from_page = request.extensions().get::<FromBrowser>().is_some_and(|page| page.0);
        async move {
            let timeout = request.headers().get("x-deadline").map(|v| v.to_str().unwrap_or_default());
            let app = RequestContext::new(
                &shared,
                who,
                connection.peer(),
                shared.request_timeout("X-Deadline", timeout)?,
            );
            handle(operation, Arc::new(app), request, from_page).await
        }
    };
    let route = on(method, handler);
    // Otherwise axum would serve HEAD by GET, and HEAD on a picture of an action would spend an attempt without a log line.
    if method == MethodFilter::GET { route.on(MethodFilter::HEAD, no_method) } else { route }
}

/// The response to a method that is no operation.
pub async fn no_method(request: Request) -> Problem {
    Problem::no_method(request.method().as_str(), request.uri().path())
}

async fn handle(
    operation: &'static Operation,
    app: Arc<RequestContext>,
    request: Request,
    from_page: bool,
) -> HandlerResult<Response> {
    let authorized = operation.authorize(&app)?;
    let token = request.extensions().get::<PresentedToken>().and_then(|presented| presented.0);
    let (mut parts, body) = request.into_parts();
    let form = accept::negotiate(&parts.headers);
    let mut sent = request_parts(&mut parts).await?;
    // Until the response is ready.
    let mut byte_permit = app.byte_permit();
    if operation.has_body {
        if from_page {
            check_media_type(operation, &parts.headers, &sent.media_type)?;
        }
        sent.body = body::read(body, app.shared().limits().body_seconds, &mut byte_permit).await?;
    }
    let key = parts.headers.get("idempotency-key").filter(|_| operation.idempotent_method);
    let once = key.map(|key| {
        let request_line = format!("{} {}\n", parts.method, parts.uri);
        IdempotencyKey::new(
            String::from_utf8_lossy(key.as_bytes()).into_owned(),
            &[request_line.as_bytes(), &sent.body],
        )
    });
    let is_large = sent.body.len() > MAX_INLINE_BODY_BYTES;
    let operation_request = OperationRequest::from_http(sent, once.transpose()?, form.raw());
    let call = if is_large {
        app.run(ExecutionClass::Compute, move |app| authorized.prepare(app, operation_request)).await?
    } else {
        authorized.prepare(&app, operation_request)?
    };
    if call.class == ExecutionClass::Streaming && form == WireFormat::Json {
        let value = move |app: &RequestContext| match (call.work)(app)?.content {
            Payload::Value(value) => Ok(value),
            _ => Err(Problem::internal()),
        };
        return stream::stream_json(&app, value).await;
    }
    let written = move |app: &RequestContext| serialize((call.work)(app)?, form);
    let written = match call.class {
        ExecutionClass::Inline => app.run_inline(written).await?,
        weight => app.run(weight, written).await?,
    };
    Ok(response(&app, written, token))
}

/// Errors if a browser sends a body of an undeclared media type: browsers send forms and plain text without a preflight.
fn check_media_type(operation: &Operation, headers: &HeaderMap, kind: &str) -> HandlerResult<()> {
    let empty = headers.get(header::CONTENT_LENGTH).is_none_or(|length| length == "0")
        && !headers.contains_key(header::TRANSFER_ENCODING);
    let declared = operation.doc.body_types();
    if (empty && kind.is_empty()) || declared.iter().any(|d| d == kind) {
        return Ok(());
    }
    Err(Problem::media_type(kind, &declared))
}

/// The request without its body.
async fn request_parts(parts: &mut Parts) -> HandlerResult<HttpRequestParts> {
    let Path(path) = Path::<Vec<(String, String)>>::from_request_parts(parts, &())
        .await
        .map_err(|e| Problem::malformed(Error::input("path", e.body_text(), "a path in UTF-8")))?;
    let query = Query::<Vec<(String, String)>>::try_from_uri(&parts.uri);
    let last_event = parts.headers.get("last-event-id");
    Ok(HttpRequestParts {
        path,
        query: query.map(|Query(pairs)| pairs).map_err(|e| e.body_text()),
        last_event: last_event.map(|v| String::from_utf8_lossy(v.as_bytes()).into_owned()),
        body: Vec::new(),
        media_type: media_type(&parts.headers),
    })
}

/// Lower case and without parameters; empty if absent.
fn media_type(headers: &HeaderMap) -> String {
    let kind = headers.get("content-type").map_or(&b""[..], |v| v.as_bytes());
    String::from_utf8_lossy(kind).split(';').next().unwrap_or_default().trim().to_ascii_lowercase()
}

/// A response with its body serialised.
struct SerializedResponse {
    status: u16,
    location: Option<String>,
    replayed: bool,
    body: SerializedBody,
}

enum SerializedBody {
    Nothing,
    Bytes { kind: &'static str, bytes: Vec<u8> },
    EventStream(Box<dyn EventStream>),
}

/// Serialises a response; on a blocking thread, except for inline operations.
fn serialize(reply: OperationResponse, form: WireFormat) -> HandlerResult<SerializedResponse> {
    let OperationResponse { status, location, replayed, content } = reply;
    let body = match content {
        Payload::Nothing => SerializedBody::Nothing,
        Payload::MediaBody(media) => SerializedBody::Bytes { kind: media.kind, bytes: media.bytes },
        Payload::EventStream(watcher) => SerializedBody::EventStream(watcher),
        Payload::Json(json) => match form {
            WireFormat::Json => json_body(json),
            WireFormat::Msgpack { .. } => msgpack_body(msgpack::from_json(&json))?,
        },
        Payload::Value(mut value) => match form {
            WireFormat::Json => json_body(value.to_json().map_err(Problem::serialization)?),
            WireFormat::Msgpack { .. } => {
                let arrays = if form.raw() { value.take_arrays() } else { Vec::new() };
                msgpack_body(value.to_msgpack().and_then(|plain| msgpack::with_arrays(plain, arrays)))?
            }
        },
    };
    Ok(SerializedResponse { status, location, replayed, body })
}

fn json_body(bytes: Vec<u8>) -> SerializedBody {
    SerializedBody::Bytes { kind: "application/json", bytes }
}

fn msgpack_body(bytes: Result<Vec<u8>, msgpack::EncodeError>) -> HandlerResult<SerializedBody> {
    Ok(SerializedBody::Bytes { kind: MSGPACK, bytes: bytes.map_err(Problem::serialization)? })
}

fn response(app: &RequestContext, written: SerializedResponse, token: Option<Digest>) -> Response {
    let status = StatusCode::from_u16(written.status).unwrap_or(StatusCode::INTERNAL_SERVER_ERROR);
    let mut response = match written.body {
        SerializedBody::Nothing => status.into_response(),
        SerializedBody::EventStream(watcher) => return stream::events(app, token, watcher),
        SerializedBody::Bytes { kind, bytes } => {
            (status, [(header::CONTENT_TYPE, HeaderValue::from_static(kind))], bytes).into_response()
        }
    };
    let headers = response.headers_mut();
    if let Some(place) = written.location.and_then(|p| HeaderValue::from_str(&p).ok()) {
        headers.insert(header::LOCATION, place);
    }
    if written.replayed {
        headers.insert(HeaderName::from_static("idempotent-replayed"), HeaderValue::from_static("true"));
    }
    response
}
