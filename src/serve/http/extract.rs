//! Who asks and how it is to be answered; bodies, path parameters and queries. What cannot be read becomes a problem
//! that says where.

use std::ops::Deref;
use std::sync::Arc;

use axum::extract::{FromRequest, FromRequestParts, Path, Query, Request};
use axum::http::HeaderMap;
use axum::http::request::Parts;
use serde::de::DeserializeOwned;
use serde_json::Value;
use tokio_stream::StreamExt;

use super::BODY_LIMIT;
use crate::error::Error;
use crate::json;
use crate::serve::app::App;
use crate::serve::operations::once::Once;
use crate::serve::problem::Problem;
use crate::serve::wire::{Object, pack};

/// The server's state, and how this request wants to be answered.
pub struct Caller {
    pub app: Arc<App>,
    pub form: Form,
}

/// The form of an answer.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Form {
    Json,
    /// msgpack, with arrays as pieces of memory if `raw`.
    Msgpack {
        raw: bool,
    },
}

/// Media type of msgpack.
pub const MSGPACK: &str = "application/msgpack";

impl Form {
    /// What the Accept header asks for first; JSON if neither.
    pub fn accepted(headers: &HeaderMap) -> Form {
        for value in headers.get_all("accept") {
            for range in value.to_str().unwrap_or_default().split(',') {
                let mut parts = range.split(';').map(str::trim);
                match parts.next() {
                    Some(kind) if kind.eq_ignore_ascii_case(MSGPACK) => {
                        return Form::Msgpack { raw: parts.any(|p| p.eq_ignore_ascii_case("arrays=raw")) };
                    }
                    Some(kind) if kind.eq_ignore_ascii_case("application/json") => return Form::Json,
                    _ => {}
                }
            }
        }
        Form::Json
    }

    /// Whether arrays are wanted apart.
    pub fn raw(self) -> bool {
        self == Form::Msgpack { raw: true }
    }
}

impl Deref for Caller {
    type Target = Arc<App>;

    fn deref(&self) -> &Arc<App> {
        &self.app
    }
}

impl FromRequestParts<Arc<App>> for Caller {
    type Rejection = std::convert::Infallible;

    async fn from_request_parts(parts: &mut Parts, app: &Arc<App>) -> Result<Self, Self::Rejection> {
        Ok(Caller { app: app.clone(), form: Form::accepted(&parts.headers) })
    }
}

/// A JSON object, whatever the content type says unless that is msgpack; an empty body is `{}`.
pub struct JsonBody<T>(pub T);

/// A body with the key that makes the request one that may be repeated.
pub struct Sent {
    pub bytes: Vec<u8>,
    /// The media type, lower case and without parameters; empty if not said.
    pub kind: String,
    pub once: Option<Once>,
}

/// Any bytes.
pub struct RawBody(pub Vec<u8>);

/// Path parameters.
pub struct Params<T>(pub T);

/// Query parameters in order.
pub struct Pairs(pub Vec<(String, String)>);

impl<S: Send + Sync, T: DeserializeOwned> FromRequest<S> for JsonBody<T> {
    type Rejection = Problem;

    async fn from_request(request: Request, state: &S) -> Result<Self, Problem> {
        let kind = media_type(request.headers());
        let RawBody(bytes) = RawBody::from_request(request, state).await?;
        parse(&bytes, &kind).map(|Object(value)| JsonBody(value))
    }
}

impl<S: Send + Sync> FromRequest<S> for Sent {
    type Rejection = Problem;

    async fn from_request(request: Request, state: &S) -> Result<Self, Problem> {
        let kind = media_type(request.headers());
        let key = request.headers().get("idempotency-key");
        let key = key.map(|v| String::from_utf8_lossy(v.as_bytes()).into_owned());
        let asked = format!("{} {}\n", request.method(), request.uri());
        let RawBody(bytes) = RawBody::from_request(request, state).await?;
        let once = key.map(|key| Once::new(key, &[asked.as_bytes(), &bytes]));
        Ok(Sent { bytes, kind, once: once.transpose()? })
    }
}

impl Sent {
    /// The body as a JSON object (an empty one is `{}`), and what was sent, to be kept.
    pub fn json<T: DeserializeOwned>(&self) -> Result<(T, Value), Problem> {
        let Object(value) = parse(&self.bytes, &self.kind)?;
        Ok((value, parse(&self.bytes, &self.kind)?))
    }

    /// The body as text.
    pub fn text(&self) -> Result<&str, Problem> {
        text(&self.bytes)
    }
}

impl<S: Send + Sync> FromRequest<S> for RawBody {
    type Rejection = Problem;

    async fn from_request(request: Request, _: &S) -> Result<Self, Problem> {
        let mut parts = request.into_body().into_data_stream();
        let (mut bytes, mut length) = (Vec::new(), 0);
        while let Some(part) = parts.next().await {
            let part =
                part.map_err(|e| Problem::malformed(Error::input("body", e, "a body that arrives whole")))?;
            length += part.len();
            if length <= BODY_LIMIT {
                bytes.extend_from_slice(&part);
            } else if length > DRAINED {
                break;
            }
        }
        // A client still sending when the answer comes may never read it, hence the draining.
        if length > BODY_LIMIT { Err(Problem::body_too_large(BODY_LIMIT)) } else { Ok(RawBody(bytes)) }
    }
}

/// How much of a body above the limit is read and dropped before the connection is, bytes.
const DRAINED: usize = 8 * BODY_LIMIT;

impl<S: Send + Sync, T: DeserializeOwned + Send> FromRequestParts<S> for Params<T> {
    type Rejection = Problem;

    async fn from_request_parts(parts: &mut Parts, state: &S) -> Result<Self, Problem> {
        Path::<T>::from_request_parts(parts, state)
            .await
            .map(|Path(value)| Params(value))
            .map_err(|e| Problem::malformed(Error::input("path", e.body_text(), "a path in UTF-8")))
    }
}

impl<S: Send + Sync> FromRequestParts<S> for Pairs {
    type Rejection = Problem;

    async fn from_request_parts(parts: &mut Parts, state: &S) -> Result<Self, Problem> {
        Query::<Vec<(String, String)>>::from_request_parts(parts, state)
            .await
            .map(|Query(pairs)| Pairs(pairs))
            .map_err(|e| Problem::malformed(Error::input("query", e.body_text(), "name=value pairs")))
    }
}

/// Lower case and without parameters; empty if not said.
fn media_type(headers: &HeaderMap) -> String {
    let kind = headers.get("content-type").map_or(&b""[..], |v| v.as_bytes());
    String::from_utf8_lossy(kind).split(';').next().unwrap_or_default().trim().to_ascii_lowercase()
}

fn parse<T: DeserializeOwned>(bytes: &[u8], kind: &str) -> Result<T, Problem> {
    if kind == MSGPACK {
        let value =
            if bytes.is_empty() { Ok(Value::Object(Default::default())) } else { pack::unpack(bytes) };
        return value.and_then(json::from_value).map_err(Problem::malformed);
    }
    let text = text(bytes)?;
    let text = if text.trim().is_empty() { "{}" } else { text };
    json::parse(text).map_err(Problem::malformed)
}

fn text(bytes: &[u8]) -> Result<&str, Problem> {
    let text = std::str::from_utf8(bytes).map_err(|e| {
        let value = format!("not UTF-8 from byte {}", e.valid_up_to());
        Problem::malformed(Error::input("body", value, "text in UTF-8"))
    })?;
    Ok(text.strip_prefix('\u{feff}').unwrap_or(text))
}
