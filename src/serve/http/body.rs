//! Bodies within their limit.

use axum::body::Body;
use tokio_stream::StreamExt;

use crate::error::Error;
use crate::serve::limits::Limits;
use crate::serve::problem::Problem;

/// Largest body, bytes.
const LIMIT: usize = 16 * 1024 * 1024;
/// How much of a body above the limit is read and dropped before the connection is, bytes.
const DRAINED: usize = 8 * LIMIT;

/// The whole body, if it comes within so many seconds. A client still sending when the answer comes may never read it, hence the draining.
pub async fn read(body: Body, seconds: f64) -> Result<Vec<u8>, Problem> {
    let read = tokio::time::timeout(Limits::span(seconds), whole(body)).await;
    read.unwrap_or_else(|_| Err(Problem::slow(seconds)))
}

async fn whole(body: Body) -> Result<Vec<u8>, Problem> {
    let mut parts = body.into_data_stream();
    let (mut bytes, mut length) = (Vec::new(), 0);
    while let Some(part) = parts.next().await {
        let part =
            part.map_err(|e| Problem::malformed(Error::input("body", e, "a body that arrives whole")))?;
        length += part.len();
        if length <= LIMIT {
            bytes.extend_from_slice(&part);
        } else if length > DRAINED {
            break;
        }
    }
    if length > LIMIT { Err(Problem::body_too_large(LIMIT)) } else { Ok(bytes) }
}
