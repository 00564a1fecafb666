//! Idempotent requests: a repeated request with the same `Idempotency-Key` has no effect and gets the stored response
//! (draft-ietf-httpapi-idempotency-key-header).

use serde::Serialize;

use crate::error::{Error, Result};
use crate::serve::problem::{HandlerResult, Problem};
use crate::serve::request_context::RequestContext;
use crate::store::StoredResponse;

/// Builds the response that is stored in the same transaction as the effect; `None` without a key.
pub type RecordResponse<'a, T> = &'a dyn Fn(&T) -> Option<StoredResponse>;

/// An idempotency key and the fingerprint of its request.
pub struct IdempotencyKey {
    pub key: String,
    pub fingerprint: String,
}

impl IdempotencyKey {
    /// A key, with the parts of the request that identify it.
    pub fn new(key: String, request: &[&[u8]]) -> Result<IdempotencyKey> {
        if key.is_empty() || key.len() > 255 || !key.bytes().all(|b| b.is_ascii_graphic()) {
            let allowed = "1 to 255 printable ASCII characters without spaces";
            return Err(Error::input("Idempotency-Key", format!("{key:?}"), allowed));
        }
        Ok(IdempotencyKey { key, fingerprint: fingerprint(request) })
    }
}

/// Runs `work`, unless a request with the same key was answered before; returns the response and whether it is a replay. `work`
/// receives the function that builds the response to be stored with its effect.
pub fn idempotent<T: Serialize>(
    app: &RequestContext,
    key: Option<IdempotencyKey>,
    status: u16,
    location: Option<fn(&T) -> String>,
    work: impl FnOnce(&RequestContext, RecordResponse<T>) -> Result<T>,
) -> HandlerResult<(StoredResponse, bool)> {
    // Keys are separate for each token.
    let key_and_request = key.map(|o| (app.scoped_key(&o.key), o));
    let as_answered = |made: &T| -> HandlerResult<StoredResponse> {
        let (key, fingerprint) = key_and_request
            .as_ref()
            .map(|(scoped_key, o)| (scoped_key.clone(), o.fingerprint.clone()))
            .unwrap_or_default();
        let body = serde_json::to_vec(made).map_err(Problem::serialization)?;
        Ok(StoredResponse { key, fingerprint, status, location: location.map(|of| of(made)), body })
    };
    let Some((scoped_key, request)) = &key_and_request else {
        return as_answered(&work(app, &|_| None)?).map(|a| (a, false));
    };
    let Some(_held) = app.claim_key(scoped_key) else {
        return Err(Problem::request_in_progress(&request.key));
    };
    if let Some(stored) = app.store().stored_response(scoped_key)? {
        if stored.fingerprint != request.fingerprint {
            let allowed = "a different key for each request: this key was used for another request";
            return Err(Error::input("Idempotency-Key", format!("{:?}", request.key), allowed).into());
        }
        return Ok((stored, true));
    }
    as_answered(&work(app, &|made| as_answered(made).ok())?).map(|a| (a, false))
}

/// FNV-1a, 128 bit: distinguishes requests of one client; not cryptographic.
fn fingerprint(parts: &[&[u8]]) -> String {
    let bytes = parts.iter().flat_map(|p| p.iter());
    let hash = bytes.fold(0x6c62_272e_07bb_0142_62b8_2175_6295_c58d_u128, |hash, b| {
        (hash ^ u128::from(*b)).wrapping_mul(0x0000_0000_0100_0000_0000_0000_0000_013b)
    });
    format!("{hash:032x}")
}

#[cfg(test)]
mod tests {
    use super::fingerprint;

    #[test]
    fn fingerprint_matches_fnv_reference() {
        // Values of the FNV reference: the empty string and "a".
        assert_eq!(fingerprint(&[]), "6c62272e07bb014262b821756295c58d");
        assert_eq!(fingerprint(&[b"a"]), "d228cb696f1a8caf78912b704e4a8964");
        assert_eq!(fingerprint(&[b"ab", b"c"]), fingerprint(&[b"abc"]));
    }
}
