//! Requests that make something and may be repeated: asked again under the same key, they make nothing and are
//! answered the same.

use serde::Serialize;

use crate::error::{Error, Result};
use crate::serve::app::App;
use crate::serve::problem::{Answer, Problem};
use crate::store::Answered;

/// What is to be kept of an answer together with its effect; nothing, if nobody asked for that.
pub type Keep<'a, T> = &'a dyn Fn(&T) -> Option<Answered>;

/// The key of a request, and what was asked under it.
pub struct Once {
    pub key: String,
    pub fingerprint: String,
}

impl Once {
    /// A key, with the parts of what was asked.
    pub fn new(key: String, asked: &[&[u8]]) -> Result<Once> {
        if key.is_empty() || key.len() > 255 || !key.bytes().all(|b| b.is_ascii_graphic()) {
            let allowed = "1 to 255 letters, digits and signs of ASCII, without spaces";
            return Err(Error::input("Idempotency-Key", format!("{key:?}"), allowed));
        }
        Ok(Once { key, fingerprint: fingerprint(asked) })
    }
}

/// Does `work`, unless it was done under the same key; whether it was. `work` is given what makes the answer that is
/// to be kept with its effect.
pub fn once<T: Serialize>(
    app: &App,
    once: Option<Once>,
    status: u16,
    location: Option<fn(&T) -> String>,
    work: impl FnOnce(&App, Keep<T>) -> Result<T>,
) -> Answer<(Answered, bool)> {
    // Everybody has keys of their own.
    let once = once.map(|o| (app.own_key(&o.key), o));
    let as_answered = |made: &T| -> Answer<Answered> {
        let (key, fingerprint) =
            once.as_ref().map(|(own, o)| (own.clone(), o.fingerprint.clone())).unwrap_or_default();
        let body = serde_json::to_vec(made).map_err(Problem::unwritable)?;
        Ok(Answered { key, fingerprint, status, location: location.map(|of| of(made)), body })
    };
    let Some((own, asked)) = &once else { return as_answered(&work(app, &|_| None)?).map(|a| (a, false)) };
    let Some(_held) = app.hold(own) else { return Err(Problem::under_way(&asked.key)) };
    if let Some(before) = app.store().answered(own)? {
        if before.fingerprint != asked.fingerprint {
            let allowed = "a key of its own for every different request: this one was used for another";
            return Err(Error::input("Idempotency-Key", format!("{:?}", asked.key), allowed).into());
        }
        return Ok((before, true));
    }
    as_answered(&work(app, &|made| as_answered(made).ok())?).map(|a| (a, false))
}

/// FNV-1a, 128 bit: tells requests of one sender apart; not for secrets.
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
    fn fingerprints_are_those_of_fnv() {
        // Values of the FNV reference: the empty string and "a".
        assert_eq!(fingerprint(&[]), "6c62272e07bb014262b821756295c58d");
        assert_eq!(fingerprint(&[b"a"]), "d228cb696f1a8caf78912b704e4a8964");
        assert_eq!(fingerprint(&[b"ab", b"c"]), fingerprint(&[b"abc"]));
    }
}
