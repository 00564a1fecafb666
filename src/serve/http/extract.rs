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

/// A body with the key that makes the request one that may be repeated.
pub struct Sent {
    pub bytes: Vec<u8>,
    /// The media type, lower case and without parameters; empty if not said.
    pub kind: String,
    pub once: Option<Once>,
}

/// An `Idempotency-Key`, and what was asked under it.
pub struct Once {
    pub key: String,
    pub fingerprint: String,
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
        let RawBody(bytes) = RawBody::from_request(request, state).await?;
        parse(&bytes).map(|Object(value)| JsonBody(value))
    }
}

impl<S: Send + Sync> FromRequest<S> for Sent {
    type Rejection = Problem;

    async fn from_request(request: Request, state: &S) -> Result<Self, Problem> {
        let header = |request: &Request, name: &str| {
            request.headers().get(name).map(|v| String::from_utf8_lossy(v.as_bytes()).into_owned())
        };
        let kind = header(&request, "content-type").unwrap_or_default();
        let kind = kind.split(';').next().unwrap_or_default().trim().to_ascii_lowercase();
        let key = header(&request, "idempotency-key");
        let asked = format!("{} {}\n", request.method(), request.uri());
        let RawBody(bytes) = RawBody::from_request(request, state).await?;
        let once = key.map(|key| {
            if key.is_empty() || key.len() > 255 || !key.bytes().all(|b| b.is_ascii_graphic()) {
                let allowed = "1 to 255 letters, digits and signs of ASCII, without spaces";
                return Err(Error::input("Idempotency-Key", format!("{key:?}"), allowed));
            }
            Ok(Once { key, fingerprint: fingerprint(&[asked.as_bytes(), &bytes]) })
        });
        Ok(Sent { bytes, kind, once: once.transpose()? })
    }
}

impl Sent {
    /// The body as a JSON object (an empty one is `{}`), and what was sent, to be kept.
    pub fn json<T: DeserializeOwned>(&self) -> Result<(T, Value), Problem> {
        let Object(value) = parse(&self.bytes)?;
        Ok((value, parse(&self.bytes)?))
    }

    /// The body as text.
    pub fn text(&self) -> Result<&str, Problem> {
        text(&self.bytes)
    }
}

/// FNV-1a, 128 bit: tells requests of one sender apart; not for secrets.
fn fingerprint(parts: &[&[u8]]) -> String {
    let bytes = parts.iter().flat_map(|p| p.iter());
    let hash = bytes.fold(0x6c62_272e_07bb_0142_62b8_2175_6295_c58d_u128, |hash, b| {
        (hash ^ u128::from(*b)).wrapping_mul(0x0000_0000_0100_0000_0000_0000_0000_013b)
    });
    format!("{hash:032x}")
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

#[cfg(test)]
mod tests {
    use super::fingerprint;

    #[test]
    fn fingerprints_are_those_of_fnv() {
        // Values of the FNV reference: the empty string and "a".
        assert_eq!(fingerprint(&[]), "6c62272e07bb014262b821756295c58d");
        assert_eq!(fingerprint(&[b"a"]), "d228cb696f1a8caf78912b704e4a8964");
        assert_eq!(fingerprint(&[b"ab", b"c"]), fingerprint(&[b"abc"]));
    }
}
