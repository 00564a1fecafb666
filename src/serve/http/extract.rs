//! Bodies, path parameters and queries; what cannot be read becomes a problem that says where.

use axum::extract::{FromRequest, FromRequestParts, Path, Query, Request};
use axum::http::request::Parts;
use serde::de::DeserializeOwned;
use serde_json::Value;
use tokio_stream::StreamExt;

use super::BODY_LIMIT;
use crate::error::Error;
use crate::json;
use crate::serve::problem::Problem;
use crate::serve::wire::Object;

/// A JSON object, whatever the content type says; an empty body is `{}`.
pub struct JsonBody<T>(pub T);

/// [`JsonBody`] with what was sent, to be kept.
pub struct KeptBody<T>(pub T, pub Value);

/// Any bytes.
pub struct RawBody(pub Vec<u8>);

/// Path parameters.
pub struct Params<T>(pub T);

/// Query parameters in order.
pub struct Pairs(pub Vec<(String, String)>);

impl<S: Send + Sync, T: DeserializeOwned> FromRequest<S> for JsonBody<T> {
    type Rejection = Problem;

    async fn from_request(request: Request, state: &S) -> Result<Self, Problem> {
        let RawBody(bytes) = RawBody::from_request(request, state).await?;
        parse(&bytes).map(|Object(value)| JsonBody(value))
    }
}

impl<S: Send + Sync, T: DeserializeOwned> FromRequest<S> for KeptBody<T> {
    type Rejection = Problem;

    async fn from_request(request: Request, state: &S) -> Result<Self, Problem> {
        let RawBody(bytes) = RawBody::from_request(request, state).await?;
        let Object(value) = parse(&bytes)?;
        Ok(KeptBody(value, parse(&bytes)?))
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

fn parse<T: DeserializeOwned>(bytes: &[u8]) -> Result<T, Problem> {
    let text = std::str::from_utf8(bytes).map_err(|e| {
        let value = format!("not UTF-8 from byte {}", e.valid_up_to());
        Problem::malformed(Error::input("body", value, "JSON in UTF-8"))
    })?;
    let text = text.strip_prefix('\u{feff}').unwrap_or(text);
    let text = if text.trim().is_empty() { "{}" } else { text };
    json::parse(text).map_err(Problem::malformed)
}
