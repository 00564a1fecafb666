//! Reads request bodies up to a limit.

use axum::body::Body;
use tokio_stream::StreamExt;

use crate::error::Error;
use crate::serve::client_limiter::LimiterPermit;
use crate::serve::limits::Limits;
use crate::serve::problem::Problem;

/// Maximum size of a body, bytes.
const MAX_BODY_BYTES: usize = 16 * 1024 * 1024;
/// Amount of an oversized body that is read and discarded before the connection is closed, bytes.
const MAX_DRAINED_BYTES: usize = 8 * MAX_BODY_BYTES;

/// Reads the whole body within a timeout, counted by a permit. An oversized body is drained: a client that is still sending may never read the response.
pub async fn read(body: Body, seconds: f64, permit: &mut LimiterPermit) -> Result<Vec<u8>, Problem> {
    let read = tokio::time::timeout(Limits::duration(seconds), read_all(body, permit)).await;
    read.unwrap_or_else(|_| Err(Problem::body_timeout(seconds)))
}

async fn read_all(body: Body, permit: &mut LimiterPermit) -> Result<Vec<u8>, Problem> {
    let mut parts = body.into_data_stream();
    let (mut bytes, mut length) = (Vec::new(), 0);
    while let Some(part) = parts.next().await {
        let part =
            part.map_err(|e| Problem::malformed(Error::input("body", e, "a body that arrives whole")))?;
        length += part.len();
        if length <= MAX_BODY_BYTES {
            permit.grow(part.len()).map_err(|_| Problem::too_many_body_bytes())?;
            bytes.extend_from_slice(&part);
        } else if length > MAX_DRAINED_BYTES {
            break;
        }
    }
    if length > MAX_BODY_BYTES { Err(Problem::body_too_large(MAX_BODY_BYTES)) } else { Ok(bytes) }
}
