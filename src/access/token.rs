//! Tokens: 256 random bits, of which only the SHA-256 is stored.
//!
//! A token is random, not a chosen password, so a slow hash would add no protection. Digests are compared in constant time.

use base64::Engine as _;
use base64::engine::general_purpose::URL_SAFE_NO_PAD;
use ring::rand::{SecureRandom, SystemRandom};

use super::scope::Scope;
use crate::error::{Error, Result};
use crate::store::LOCAL_AGENT;

/// SHA-256 of a token.
#[derive(Clone, Copy, Debug)]
pub struct Digest([u8; 32]);

/// A token as stored.
#[derive(Clone, Debug)]
pub struct HashedToken {
    /// Name of the token; it owns the resources that the bearer creates.
    pub name: String,
    pub scope: Scope,
    pub digest: Digest,
    /// Creation time, s since 1970.
    pub made: u64,
    /// Expiry time, s since 1970; never, if absent.
    pub expires: Option<u64>,
}

/// Prefix of every token, by which secret scanners recognise it.
const PREFIX: &str = "iplw_";
/// Maximum length of a name, bytes.
const MAX_NAME_BYTES: usize = 64;

/// Generates a new token.
pub fn generate() -> Result<String> {
    let mut random = [0; 32];
    SystemRandom::new()
        .fill(&mut random)
        .map_err(|_| Error::Failed("the operating system provides no random numbers".into()))?;
    Ok(format!("{PREFIX}{}", URL_SAFE_NO_PAD.encode(random)))
}

/// The digest of a presented token.
pub fn digest(token: &[u8]) -> Digest {
    let found = ring::digest::digest(&ring::digest::SHA256, token);
    let mut bytes = [0; 32];
    bytes.copy_from_slice(found.as_ref());
    Digest(bytes)
}

impl Digest {
    /// Hexadecimal, as in a token file.
    pub fn hex(&self) -> String {
        self.0.iter().map(|b| format!("{b:02x}")).collect()
    }

    /// Parses the hexadecimal digest of a token file.
    pub fn from_hex(field: &str, text: &str) -> Result<Digest> {
        let refuse = || {
            Error::input(field, format!("{text:?}"), "64 hexadecimal digits: `iplw token new` prints them")
        };
        if text.len() != 64 || !text.is_ascii() {
            return Err(refuse());
        }
        let mut bytes = [0; 32];
        for (i, byte) in bytes.iter_mut().enumerate() {
            *byte = u8::from_str_radix(&text[2 * i..2 * i + 2], 16).map_err(|_| refuse())?;
        }
        Ok(Digest(bytes))
    }

    /// Constant-time comparison.
    pub fn constant_time_eq(&self, other: &Digest) -> bool {
        let differ = self
            .0
            .iter()
            .zip(&other.0)
            .fold(0, |difference, (a, b)| std::hint::black_box(difference | (a ^ b)));
        differ == 0
    }
}

impl HashedToken {
    /// Errors unless the name is valid.
    pub fn check_name(field: &str, name: &str) -> Result<()> {
        let first = name.chars().next().is_some_and(|c| c.is_ascii_alphanumeric());
        if first
            && name != LOCAL_AGENT
            && name.len() <= MAX_NAME_BYTES
            && name.chars().all(|c| c.is_ascii_alphanumeric() || "._-".contains(c))
        {
            return Ok(());
        }
        let allowed = format!(
            "1 to {MAX_NAME_BYTES} letters, digits, `.`, `_` or `-`, the first a letter or digit; not {LOCAL_AGENT}, which is the local \
             agent without a token"
        );
        Err(Error::input(field, format!("{name:?}"), allowed))
    }

    /// Whether it has expired at a moment, s since 1970.
    pub fn is_expired(&self, now: u64) -> bool {
        self.expires.is_some_and(|at| at <= now)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn digests_match_sha_256_and_round_trip() {
        // FIPS 180-2, appendix B.1.
        let expected = "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad";
        assert_eq!(digest(b"abc").hex(), expected);
        assert!(digest(b"abc").constant_time_eq(&Digest::from_hex("sha256", expected).unwrap()));
        assert!(!digest(b"abd").constant_time_eq(&digest(b"abc")));
        for bad in ["", "ba78", &expected.replace('b', "g"), &"é".repeat(32)] {
            assert!(Digest::from_hex("sha256", bad).is_err(), "{bad}");
        }
    }

    #[test]
    fn tokens_are_unique() {
        let (one, other) = (generate().unwrap(), generate().unwrap());
        assert_ne!(one, other);
        assert!(one.starts_with("iplw_") && one.len() == 5 + 43, "{one}");
    }

    #[test]
    fn validates_names() {
        for good in ["ann", "ci-2", "a.b_c", "0"] {
            HashedToken::check_name("name", good).unwrap();
        }
        for bad in ["", "-a", "a b", "a/b", "é", &"a".repeat(65)] {
            assert!(HashedToken::check_name("name", bad).is_err(), "{bad}");
        }
    }
}
