//! The tokens of a running server. Changes of the token file take effect at the next refresh.

use std::fs::Metadata;
use std::sync::{PoisonError, RwLock};
use std::time::SystemTime;

use super::file::TokenFile;
use super::scope::Principal;
use super::token::{Digest, HashedToken};
use crate::error::{Error, Result};

/// The valid tokens of a server, or none if it needs no authentication.
pub struct Keyring {
    /// Re-read when it changes.
    file: Option<TokenFile>,
    /// Tokens that do not come from the file.
    fixed: Option<Vec<HashedToken>>,
    loaded: RwLock<LoadedTokens>,
}

struct LoadedTokens {
    /// `None`: no authentication.
    tokens: Option<Vec<HashedToken>>,
    /// State of the file when it was read.
    stamp: Option<FileStamp>,
}

/// Modification time and size: detects changes of the file.
type FileStamp = (Option<SystemTime>, u64);

/// Why authentication failed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum AuthError {
    /// No token was presented.
    Missing,
    /// The token is unknown or was revoked.
    Wrong,
    /// The token has expired.
    Expired,
}

impl Keyring {
    /// Tokens of a file (existing or future) and fixed ones. Without either there is no authentication.
    pub fn new(file: Option<TokenFile>, fixed: Option<Vec<HashedToken>>) -> Result<Keyring> {
        let loaded = RwLock::new(LoadedTokens { tokens: None, stamp: None });
        let keyring = Keyring { file, fixed, loaded };
        keyring.read()?;
        Ok(keyring)
    }

    /// Whether a token is required.
    pub fn requires_token(&self) -> bool {
        self.loaded.read().unwrap_or_else(PoisonError::into_inner).tokens.is_some()
    }

    /// The bearer of the token with this digest, at a moment, s since 1970. Every token is compared, so that the time does not depend on it.
    pub fn authenticate(
        &self,
        presented: Option<&Digest>,
        now: u64,
    ) -> std::result::Result<Principal, AuthError> {
        let loaded = self.loaded.read().unwrap_or_else(PoisonError::into_inner);
        let Some(tokens) = &loaded.tokens else { return Ok(Principal::anonymous()) };
        let presented = presented.ok_or(AuthError::Missing)?;
        let found = tokens.iter().fold(None, |found, token| {
            if token.digest.constant_time_eq(presented) { Some(token) } else { found }
        });
        match found {
            None => Err(AuthError::Wrong),
            Some(token) if token.is_expired(now) => Err(AuthError::Expired),
            Some(token) => Ok(Principal { name: Some(token.name.clone()), scope: token.scope }),
        }
    }

    /// Reloads the file if it has changed. On an error the previous tokens stay valid; if the file is gone, none are.
    pub fn refresh(&self) -> Result<()> {
        let Some(file) = &self.file else { return Ok(()) };
        let stamp = std::fs::metadata(file.path()).ok().map(|m| stamp(&m));
        let before = self.loaded.read().unwrap_or_else(PoisonError::into_inner).stamp;
        if stamp == before { Ok(()) } else { self.read() }
    }

    /// All tokens, and whether each is fixed (cannot be revoked); none without authentication.
    pub fn all(&self) -> Vec<(HashedToken, bool)> {
        let loaded = self.loaded.read().unwrap_or_else(PoisonError::into_inner);
        let all = loaded.tokens.iter().flatten();
        all.map(|token| (token.clone(), self.is_fixed(&token.name))).collect()
    }

    /// Adds a token to the file; it is valid at once.
    pub fn add(&self, token: &HashedToken) -> Result<()> {
        let refuse = |reason: &str| Err(Error::Refused { reason: reason.into() });
        if !self.requires_token() {
            return refuse(
                "the server needs no token, and creating the first one would lock out the other clients;                  create it with `iplw token new NAME --scope admin --data-dir DIR`",
            );
        }
        let Some(file) = &self.file else {
            return refuse("the server has no token file: start it with --data-dir DIR or --token-file FILE");
        };
        if self.is_fixed(&token.name) {
            let allowed = "an unused name: a token of this name was given when the server was started";
            return Err(Error::input("name", format!("{:?}", token.name), allowed));
        }
        file.add(token)?;
        self.read()
    }

    /// Removes a token from the file; it is invalid at once.
    pub fn revoke(&self, name: &str) -> Result<()> {
        if self.is_fixed(name) {
            let reason = format!(
                "the token {name} was given when the server was started; restart the server without it"
            );
            return Err(Error::Refused { reason });
        }
        match &self.file {
            Some(file) if self.requires_token() => file.revoke(name)?,
            _ => return Err(Error::NotFound { kind: "token", id: name.into(), known: Vec::new() }),
        }
        self.read()
    }

    fn is_fixed(&self, name: &str) -> bool {
        self.fixed.iter().flatten().any(|token| token.name == name)
    }

    fn read(&self) -> Result<()> {
        let stamp = self.file.as_ref().and_then(|f| std::fs::metadata(f.path()).ok()).map(|m| stamp(&m));
        let read = self.file.as_ref().map(TokenFile::read).transpose()?.flatten();
        let mut loaded = self.loaded.write().unwrap_or_else(PoisonError::into_inner);
        let tokens = match (read, &self.fixed) {
            // Once authentication is required, it stays required until the server ends.
            (None, None) => loaded.tokens.is_some().then(Vec::new),
            (read, fixed) => {
                Some(read.into_iter().flatten().chain(fixed.iter().flatten().cloned()).collect())
            }
        };
        *loaded = LoadedTokens { tokens, stamp };
        Ok(())
    }
}

fn stamp(of: &Metadata) -> FileStamp {
    (of.modified().ok(), of.len())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::access::{Scope, digest};

    fn token(name: &str, token: &str, scope: Scope, expires: Option<u64>) -> HashedToken {
        HashedToken { name: name.into(), scope, digest: digest(token.as_bytes()), made: 0, expires }
    }

    #[test]
    fn authenticates_until_expiry() {
        let tokens = vec![token("ann", "one", Scope::Act, Some(100)), token("bob", "two", Scope::Read, None)];
        let ring = Keyring::new(None, Some(tokens)).unwrap();
        let who = |token: &str, now| ring.authenticate(Some(&digest(token.as_bytes())), now);
        assert_eq!(who("one", 99).unwrap(), Principal { name: Some("ann".into()), scope: Scope::Act });
        assert_eq!(who("one", 100), Err(AuthError::Expired));
        assert_eq!(who("two", 1 << 40).unwrap().scope, Scope::Read);
        assert_eq!(who("three", 0), Err(AuthError::Wrong));
        assert_eq!(ring.authenticate(None, 0), Err(AuthError::Missing));
    }

    #[test]
    fn adds_and_revokes_file_tokens_only() {
        let place = tempfile::tempdir().unwrap();
        let file = || Some(TokenFile::of_directory(place.path()));
        let open = Keyring::new(file(), None).unwrap();
        let ann = token("ann", "one", Scope::Act, None);
        assert!(matches!(open.add(&ann), Err(Error::Refused { .. })), "the owner keeps access");
        assert!(matches!(open.revoke("ann"), Err(Error::NotFound { .. })));
        let root = token("root", "zero", Scope::Admin, None);
        let without = Keyring::new(None, Some(vec![root.clone()])).unwrap();
        assert!(matches!(without.add(&ann), Err(Error::Refused { .. })));
        let ring = Keyring::new(file(), Some(vec![root.clone()])).unwrap();
        ring.add(&ann).unwrap();
        assert!(ring.authenticate(Some(&digest(b"one")), 0).is_ok());
        for taken in [&ann, &root] {
            assert!(matches!(ring.add(taken), Err(Error::Input(_))));
        }
        let all: Vec<(String, bool)> = ring.all().into_iter().map(|(k, fixed)| (k.name, fixed)).collect();
        assert_eq!(all, [("ann".to_string(), false), ("root".to_string(), true)]);
        assert!(matches!(ring.revoke("root"), Err(Error::Refused { .. })));
        ring.revoke("ann").unwrap();
        assert_eq!(ring.authenticate(Some(&digest(b"one")), 0), Err(AuthError::Wrong));
        assert!(matches!(ring.revoke("ann"), Err(Error::NotFound { .. })));
    }

    #[test]
    fn reloads_token_file_and_denies_after_removal() {
        let place = tempfile::tempdir().unwrap();
        let file = || TokenFile::of_directory(place.path());
        let ring = Keyring::new(Some(file()), None).unwrap();
        assert!(!ring.requires_token() && ring.authenticate(None, 0).unwrap() == Principal::anonymous());
        file().add(&token("ann", "one", Scope::Admin, None)).unwrap();
        ring.refresh().unwrap();
        assert_eq!(ring.authenticate(None, 0), Err(AuthError::Missing));
        assert!(ring.authenticate(Some(&digest(b"one")), 0).is_ok());
        file().add(&token("bob", "two", Scope::Read, None)).unwrap();
        ring.refresh().unwrap();
        assert!(ring.authenticate(Some(&digest(b"two")), 0).is_ok());
        std::fs::write(file().path(), "no JSON").unwrap();
        assert!(ring.refresh().is_err());
        assert!(ring.authenticate(Some(&digest(b"two")), 0).is_ok(), "what cannot be read changes nothing");
        std::fs::remove_file(file().path()).unwrap();
        ring.refresh().unwrap();
        assert_eq!(ring.authenticate(Some(&digest(b"one")), 0), Err(AuthError::Wrong));
        assert!(ring.requires_token());
    }
}
