//! A token: 256 random bits, of which only the SHA-256 is kept.
//!
//! A token is no password: nobody chose it, so there is nothing to guess and a slow hash would protect nothing. Digests are
//! compared in a time that does not depend on where they differ.

use base64::Engine as _;
use base64::engine::general_purpose::URL_SAFE_NO_PAD;
use ring::rand::{SecureRandom, SystemRandom};

use super::scope::Scope;
use crate::error::{Error, Result};

/// SHA-256 of a token.
#[derive(Clone, Copy, Debug)]
pub struct Digest([u8; 32]);

/// What is kept of a token.
#[derive(Clone, Debug)]
pub struct Kept {
    /// Whose it is: what its bearer makes belongs to this name.
    pub name: String,
    pub scope: Scope,
    pub digest: Digest,
    /// When it was made, s since 1970.
    pub made: u64,
    /// When it ends, s since 1970; never, if absent.
    pub expires: Option<u64>,
}

/// What every token begins with, so that one is known for what it is wherever it turns up.
const PREFIX: &str = "iplw_";
/// Longest name.
const MOST_NAME: usize = 64;

/// A token that nobody has seen before.
pub fn fresh() -> Result<String> {
    let mut random = [0; 32];
    SystemRandom::new()
        .fill(&mut random)
        .map_err(|_| Error::Failed("the operating system gives no random numbers".into()))?;
    Ok(format!("{PREFIX}{}", URL_SAFE_NO_PAD.encode(random)))
}

/// The digest of a token as it was presented.
pub fn digest(token: &[u8]) -> Digest {
    let found = ring::digest::digest(&ring::digest::SHA256, token);
    let mut bytes = [0; 32];
    bytes.copy_from_slice(found.as_ref());
    Digest(bytes)
}

impl Digest {
    /// As a file has it.
    pub fn hex(&self) -> String {
        self.0.iter().map(|b| format!("{b:02x}")).collect()
    }

    /// From how a file has it.
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

    /// Whether they are the same, in a time that does not tell where they differ.
    pub fn is(&self, other: &Digest) -> bool {
        let differ = self.0.iter().zip(&other.0).fold(0, |seen, (a, b)| std::hint::black_box(seen | (a ^ b)));
        differ == 0
    }
}

impl Kept {
    /// Errors unless the name can be one.
    pub fn check_name(field: &str, name: &str) -> Result<()> {
        let first = name.chars().next().is_some_and(|c| c.is_ascii_alphanumeric());
        if first
            && name.len() <= MOST_NAME
            && name.chars().all(|c| c.is_ascii_alphanumeric() || "._-".contains(c))
        {
            return Ok(());
        }
        let allowed =
            format!("1 to {MOST_NAME} letters, digits, `.`, `_` or `-`, the first a letter or digit");
        Err(Error::input(field, format!("{name:?}"), allowed))
    }

    /// Whether it has ended at a moment, s since 1970.
    pub fn ended(&self, now: u64) -> bool {
        self.expires.is_some_and(|at| at <= now)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn digests_are_those_of_sha_256_and_read_back() {
        // FIPS 180-2, appendix B.1.
        let known = "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad";
        assert_eq!(digest(b"abc").hex(), known);
        assert!(digest(b"abc").is(&Digest::from_hex("sha256", known).unwrap()));
        assert!(!digest(b"abd").is(&digest(b"abc")));
        for bad in ["", "ba78", &known.replace('b', "g"), &"é".repeat(32)] {
            assert!(Digest::from_hex("sha256", bad).is_err(), "{bad}");
        }
    }

    #[test]
    fn tokens_are_long_and_no_two_alike() {
        let (one, other) = (fresh().unwrap(), fresh().unwrap());
        assert_ne!(one, other);
        assert!(one.starts_with("iplw_") && one.len() == 5 + 43, "{one}");
    }

    #[test]
    fn names_are_plain() {
        for good in ["ann", "ci-2", "a.b_c", "0"] {
            Kept::check_name("name", good).unwrap();
        }
        for bad in ["", "-a", "a b", "a/b", "é", &"a".repeat(65)] {
            assert!(Kept::check_name("name", bad).is_err(), "{bad}");
        }
    }
}
