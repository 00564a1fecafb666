//! The tokens of a running server: who bears one. A file that is changed meanwhile counts from the next look on.

use std::fs::Metadata;
use std::sync::{PoisonError, RwLock};
use std::time::SystemTime;

use super::file::TokenFile;
use super::scope::Who;
use super::token::{Digest, Kept};
use crate::error::{Error, Result};

/// Every token that is good for a server, or the word that none is asked for.
pub struct Keyring {
    /// Looked at from time to time.
    file: Option<TokenFile>,
    /// Those that do not come from a file.
    fixed: Option<Vec<Kept>>,
    known: RwLock<Known>,
}

struct Known {
    /// `None`: nobody is asked who they are.
    tokens: Option<Vec<Kept>>,
    /// Of the file, as it was read.
    stamp: Option<Stamp>,
}

/// Tells a file from what it was.
type Stamp = (Option<SystemTime>, u64);

/// Why nobody is known by what was presented.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Unknown {
    /// There was no token.
    Missing,
    /// No such token is good, or no longer.
    Wrong,
    /// It has ended.
    Expired,
}

impl Keyring {
    /// Tokens of a file (there or to come) and others. Where there are neither, nobody is asked for one.
    pub fn new(file: Option<TokenFile>, fixed: Option<Vec<Kept>>) -> Result<Keyring> {
        let known = RwLock::new(Known { tokens: None, stamp: None });
        let keyring = Keyring { file, fixed, known };
        keyring.read()?;
        Ok(keyring)
    }

    /// Whether tokens are asked for.
    pub fn asks(&self) -> bool {
        self.known.read().unwrap_or_else(PoisonError::into_inner).tokens.is_some()
    }

    /// Who bears the token with this digest, at a moment, s since 1970. Every token is compared, whichever it is.
    pub fn who(&self, presented: Option<&Digest>, now: u64) -> std::result::Result<Who, Unknown> {
        let known = self.known.read().unwrap_or_else(PoisonError::into_inner);
        let Some(tokens) = &known.tokens else { return Ok(Who::anybody()) };
        let presented = presented.ok_or(Unknown::Missing)?;
        let found = tokens
            .iter()
            .fold(None, |found, kept| if kept.digest.is(presented) { Some(kept) } else { found });
        match found {
            None => Err(Unknown::Wrong),
            Some(kept) if kept.ended(now) => Err(Unknown::Expired),
            Some(kept) => Ok(Who { name: Some(kept.name.clone()), scope: kept.scope }),
        }
    }

    /// Reads the file again if it has changed. One that cannot be read changes nothing; one that is gone leaves nobody in.
    pub fn refresh(&self) -> Result<()> {
        let Some(file) = &self.file else { return Ok(()) };
        let stamp = std::fs::metadata(file.path()).ok().map(|m| stamp(&m));
        let before = self.known.read().unwrap_or_else(PoisonError::into_inner).stamp;
        if stamp == before { Ok(()) } else { self.read() }
    }

    /// Every token, and whether it cannot be revoked; none where nobody is asked for one.
    pub fn all(&self) -> Vec<(Kept, bool)> {
        let known = self.known.read().unwrap_or_else(PoisonError::into_inner);
        let all = known.tokens.iter().flatten();
        all.map(|kept| (kept.clone(), self.is_fixed(&kept.name))).collect()
    }

    /// Adds a token to the file: it is good from now on.
    pub fn add(&self, kept: &Kept) -> Result<()> {
        let refuse = |reason: &str| Err(Error::Refused { reason: reason.into() });
        if !self.asks() {
            return refuse(
                "the server asks nobody for a token, so that whoever made the first would shut out the others:                  make it beside the server, by `iplw token new NAME --may admin --data-dir DIR`",
            );
        }
        let Some(file) = &self.file else {
            return refuse(
                "the server has no file to keep tokens in: start it with --data-dir DIR or --token-file FILE",
            );
        };
        if self.is_fixed(&kept.name) {
            let allowed = "a name without a token: this one has one that the server was started with";
            return Err(Error::input("name", format!("{:?}", kept.name), allowed));
        }
        file.add(kept)?;
        self.read()
    }

    /// Takes a token out of the file: it is good no longer.
    pub fn revoke(&self, name: &str) -> Result<()> {
        if self.is_fixed(name) {
            let reason =
                format!("the token {name} was given to the server when it was started; start it without");
            return Err(Error::Refused { reason });
        }
        match &self.file {
            Some(file) if self.asks() => file.revoke(name)?,
            _ => return Err(Error::NotFound { kind: "token", id: name.into(), known: Vec::new() }),
        }
        self.read()
    }

    fn is_fixed(&self, name: &str) -> bool {
        self.fixed.iter().flatten().any(|kept| kept.name == name)
    }

    fn read(&self) -> Result<()> {
        let stamp = self.file.as_ref().and_then(|f| std::fs::metadata(f.path()).ok()).map(|m| stamp(&m));
        let read = self.file.as_ref().map(TokenFile::read).transpose()?.flatten();
        let mut known = self.known.write().unwrap_or_else(PoisonError::into_inner);
        let tokens = match (read, &self.fixed) {
            // Who once was asked for a token is asked for one until the server ends.
            (None, None) => known.tokens.is_some().then(Vec::new),
            (read, fixed) => {
                Some(read.into_iter().flatten().chain(fixed.iter().flatten().cloned()).collect())
            }
        };
        *known = Known { tokens, stamp };
        Ok(())
    }
}

fn stamp(of: &Metadata) -> Stamp {
    (of.modified().ok(), of.len())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::access::{Scope, digest};

    fn kept(name: &str, token: &str, scope: Scope, expires: Option<u64>) -> Kept {
        Kept { name: name.into(), scope, digest: digest(token.as_bytes()), made: 0, expires }
    }

    #[test]
    fn a_bearer_is_known_until_the_token_ends() {
        let tokens = vec![kept("ann", "one", Scope::Act, Some(100)), kept("bob", "two", Scope::Read, None)];
        let ring = Keyring::new(None, Some(tokens)).unwrap();
        let who = |token: &str, now| ring.who(Some(&digest(token.as_bytes())), now);
        assert_eq!(who("one", 99).unwrap(), Who { name: Some("ann".into()), scope: Scope::Act });
        assert_eq!(who("one", 100), Err(Unknown::Expired));
        assert_eq!(who("two", 1 << 40).unwrap().scope, Scope::Read);
        assert_eq!(who("three", 0), Err(Unknown::Wrong));
        assert_eq!(ring.who(None, 0), Err(Unknown::Missing));
    }

    #[test]
    fn tokens_come_and_go_in_the_file_and_those_given_stay() {
        let place = tempfile::tempdir().unwrap();
        let file = || Some(TokenFile::of_directory(place.path()));
        let open = Keyring::new(file(), None).unwrap();
        let ann = kept("ann", "one", Scope::Act, None);
        assert!(matches!(open.add(&ann), Err(Error::Refused { .. })), "nobody is shut out");
        assert!(matches!(open.revoke("ann"), Err(Error::NotFound { .. })));
        let root = kept("root", "zero", Scope::Admin, None);
        let without = Keyring::new(None, Some(vec![root.clone()])).unwrap();
        assert!(matches!(without.add(&ann), Err(Error::Refused { .. })));
        let ring = Keyring::new(file(), Some(vec![root.clone()])).unwrap();
        ring.add(&ann).unwrap();
        assert!(ring.who(Some(&digest(b"one")), 0).is_ok());
        for taken in [&ann, &root] {
            assert!(matches!(ring.add(taken), Err(Error::Input(_))));
        }
        let all: Vec<(String, bool)> = ring.all().into_iter().map(|(k, fixed)| (k.name, fixed)).collect();
        assert_eq!(all, [("ann".to_string(), false), ("root".to_string(), true)]);
        assert!(matches!(ring.revoke("root"), Err(Error::Refused { .. })));
        ring.revoke("ann").unwrap();
        assert_eq!(ring.who(Some(&digest(b"one")), 0), Err(Unknown::Wrong));
        assert!(matches!(ring.revoke("ann"), Err(Error::NotFound { .. })));
    }

    #[test]
    fn a_file_counts_as_soon_as_it_is_there_and_when_it_is_gone_nobody_is_let_in() {
        let place = tempfile::tempdir().unwrap();
        let file = || TokenFile::of_directory(place.path());
        let ring = Keyring::new(Some(file()), None).unwrap();
        assert!(!ring.asks() && ring.who(None, 0).unwrap() == Who::anybody());
        file()
            .change(|all| {
                all.push(kept("ann", "one", Scope::Admin, None));
                Ok(())
            })
            .unwrap();
        ring.refresh().unwrap();
        assert_eq!(ring.who(None, 0), Err(Unknown::Missing));
        assert!(ring.who(Some(&digest(b"one")), 0).is_ok());
        file()
            .change(|all| {
                all.push(kept("bob", "two", Scope::Read, None));
                Ok(())
            })
            .unwrap();
        ring.refresh().unwrap();
        assert!(ring.who(Some(&digest(b"two")), 0).is_ok());
        std::fs::write(file().path(), "no JSON").unwrap();
        assert!(ring.refresh().is_err());
        assert!(ring.who(Some(&digest(b"two")), 0).is_ok(), "what cannot be read changes nothing");
        std::fs::remove_file(file().path()).unwrap();
        ring.refresh().unwrap();
        assert_eq!(ring.who(Some(&digest(b"one")), 0), Err(Unknown::Wrong));
        assert!(ring.asks());
    }
}
