//! Token files: JSON, `iplw.tokens/1`, a row for each token. An environment variable may hold the same rows. A row has the token's
//! SHA-256, never the token. Files written by this program have a checksum over the rows; files written by hand need none.

use std::fs::File;
use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};

use super::expiry::{format_time, parse_time};
use super::scope::Scope;
use super::token::{Digest, HashedToken};
use crate::error::{Error, Result, check_format};
use crate::json;
use crate::store::{
    make_private_directory, open_lock_file, read_error, refuse_foreign_files, sha256, write_private,
};

/// A token file.
pub struct TokenFile {
    path: PathBuf,
    /// The data directory that it belongs to, if any.
    data_directory: Option<PathBuf>,
}

const FORMAT: &str = "iplw.tokens/1";

#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct TokenFileDocument {
    format: String,
    tokens: Vec<TokenRow>,
    /// Checksum of the rows.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    seal: Option<String>,
}

#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct TokenRow {
    name: String,
    #[serde(alias = "may")]
    scope: Scope,
    sha256: String,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    made: Option<String>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    expires: Option<String>,
}

/// Parses token rows from JSON, `[{"name": .., "scope": .., "sha256": ..}]`; errors name `place`.
pub fn parse_token_rows(text: &str, place: &str) -> Result<Vec<HashedToken>> {
    let rows: Vec<TokenRow> = json::parse(text).map_err(|e| e.in_file(place))?;
    hashed_tokens(rows, "").map_err(|e| e.in_file(place))
}

/// Parses a token file; errors name `place`.
pub fn parse_token_file(text: &str, place: &str) -> Result<Vec<HashedToken>> {
    let document: TokenFileDocument = json::parse(text).map_err(|e| e.in_file(place))?;
    check_format(&document.format, FORMAT).map_err(|e| e.in_file(place))?;
    if document.seal.is_some_and(|checksum| {
        checksum != seal(&document.tokens) && checksum != previous_seal(&document.tokens)
    }) {
        let how = "its checksum does not match; if you edited the file, remove the line `seal`";
        return Err(Error::Damaged { what: place.into(), how: how.into() });
    }
    hashed_tokens(document.tokens, "tokens").map_err(|e| e.in_file(place))
}

impl TokenFile {
    /// The file at a path, which need not exist.
    pub fn at(path: &Path) -> TokenFile {
        TokenFile { path: path.to_path_buf(), data_directory: None }
    }

    /// The token file of a data directory.
    pub fn of_directory(directory: &Path) -> TokenFile {
        TokenFile { path: directory.join("tokens.json"), data_directory: Some(directory.to_path_buf()) }
    }

    /// Path of the file.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Its tokens; `None` if the file does not exist.
    pub fn read(&self) -> Result<Option<Vec<HashedToken>>> {
        let text = match std::fs::read_to_string(&self.path) {
            Ok(text) => text,
            Err(e) if e.kind() == std::io::ErrorKind::NotFound => return Ok(None),
            Err(e) => return Err(read_error(&self.path, e)),
        };
        parse_token_file(&text, &self.path.display().to_string()).map(Some)
    }

    /// Changes the tokens atomically; concurrent changes are serialised by a lock file.
    pub fn change<T>(&self, how: impl FnOnce(&mut Vec<HashedToken>) -> Result<T>) -> Result<T> {
        let _turn = self.locked()?;
        let mut tokens = self.read()?.unwrap_or_default();
        let done = how(&mut tokens)?;
        let tokens: Vec<TokenRow> = tokens.iter().map(TokenRow::of).collect();
        let document = TokenFileDocument { format: FORMAT.into(), seal: Some(seal(&tokens)), tokens };
        let text = serde_json::to_string_pretty(&document)
            .map_err(|e| Error::Failed(format!("tokens cannot be written as JSON: {e}")))?;
        write_private(&self.path, (text + "\n").as_bytes())?;
        Ok(done)
    }

    /// Adds a token; errors if its name exists.
    pub fn add(&self, token: &HashedToken) -> Result<()> {
        self.change(|all| {
            if all.iter().any(|k| k.name == token.name) {
                let allowed = "a name without a token: revoke that one first";
                return Err(Error::input("name", format!("{:?}", token.name), allowed));
            }
            all.push(token.clone());
            Ok(())
        })
    }

    /// Revokes a token; errors if there is none of that name.
    pub fn revoke(&self, name: &str) -> Result<()> {
        self.change(|all| {
            let known: Vec<String> = all.iter().map(|k| k.name.clone()).collect();
            all.retain(|k| k.name != name);
            if all.len() == known.len() {
                return Err(Error::NotFound { kind: "token", id: name.into(), known });
            }
            Ok(())
        })
    }

    fn locked(&self) -> Result<File> {
        if let Some(directory) = &self.data_directory {
            refuse_foreign_files(directory)?;
        }
        if let Some(directory) = self.path.parent().filter(|p| !p.as_os_str().is_empty()) {
            make_private_directory(directory)?;
        }
        let path = self.path.with_extension("lock");
        let file = open_lock_file(&path)?;
        file.lock().map_err(|e| Error::io(&path, e))?;
        Ok(file)
    }
}

impl TokenRow {
    fn of(token: &HashedToken) -> TokenRow {
        TokenRow {
            name: token.name.clone(),
            scope: token.scope,
            sha256: token.digest.hex(),
            made: Some(format_time(token.made)),
            expires: token.expires.map(format_time),
        }
    }
}

/// SHA-256 of the rows as JSON.
fn seal(rows: &[TokenRow]) -> String {
    sha256(&serde_json::to_vec(rows).unwrap_or_default())
}

/// Checksum in files written when the scope was called `may`.
fn previous_seal(rows: &[TokenRow]) -> String {
    sha256(serde_json::to_string(rows).unwrap_or_default().replace("\"scope\":", "\"may\":").as_bytes())
}

/// Validates rows; errors name the row in `list`.
fn hashed_tokens(rows: Vec<TokenRow>, list: &str) -> Result<Vec<HashedToken>> {
    let mut all: Vec<HashedToken> = Vec::with_capacity(rows.len());
    for (i, row) in rows.into_iter().enumerate() {
        let one = || -> Result<HashedToken> {
            HashedToken::check_name("name", &row.name)?;
            if all.iter().any(|k| k.name == row.name) {
                return Err(Error::input("name", format!("{:?}", row.name), "each name once"));
            }
            Ok(HashedToken {
                scope: row.scope,
                digest: Digest::from_hex("sha256", &row.sha256)?,
                made: row.made.as_deref().map_or(Ok(0), |t| parse_time("made", t))?,
                expires: row.expires.as_deref().map(|t| parse_time("expires", t)).transpose()?,
                name: row.name,
            })
        };
        all.push(one().map_err(|e| e.in_field(&format!("{list}[{i}]")))?);
    }
    Ok(all)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::access::{digest, generate};

    fn token(name: &str, expires: Option<u64>) -> (String, HashedToken) {
        let token = generate().unwrap();
        let digest = digest(token.as_bytes());
        (token, HashedToken { name: name.into(), scope: Scope::Act, digest, made: 5, expires })
    }

    #[test]
    fn token_file_is_private_and_holds_hashes() {
        let place = tempfile::tempdir().unwrap();
        let file = TokenFile::of_directory(&place.path().join("data"));
        assert!(file.read().unwrap().is_none());
        let (secret, token) = token("ann", Some(99));
        file.add(&token).unwrap();
        let text = std::fs::read_to_string(file.path()).unwrap();
        assert!(!text.contains(&secret) && text.contains(&token.digest.hex()), "{text}");
        let again = &file.read().unwrap().unwrap()[0];
        assert!(again.digest.constant_time_eq(&digest(secret.as_bytes())));
        assert_eq!((again.made, again.expires, again.scope), (5, Some(99), Scope::Act));
        #[cfg(unix)]
        {
            use std::os::unix::fs::PermissionsExt;
            let mode = std::fs::metadata(file.path()).unwrap().permissions().mode();
            assert_eq!(mode & 0o777, 0o600);
        }
    }

    #[test]
    fn opens_file_with_the_previous_name_of_scope() {
        let place = tempfile::tempdir().unwrap();
        let file = TokenFile::of_directory(place.path());
        file.add(&token("ann", Some(99)).1).unwrap();
        let text = std::fs::read_to_string(file.path()).unwrap();
        let rows: TokenFileDocument = json::parse(&text).unwrap();
        let previous =
            text.replace("\"scope\"", "\"may\"").replace(&seal(&rows.tokens), &previous_seal(&rows.tokens));
        assert!(previous.contains("\"may\": \"act\""), "{previous}");
        assert_eq!(parse_token_file(&previous, "tokens").unwrap()[0].scope, Scope::Act);
    }

    /// For every flipped bit and every truncation: the file cannot be read, or has the original tokens.
    #[test]
    fn damaged_token_file_adds_no_token() {
        let place = tempfile::tempdir().unwrap();
        let file = TokenFile::of_directory(place.path());
        for (name, expires) in [("ann", Some(1_900_000_000)), ("bob", None)] {
            file.add(&token(name, expires).1).unwrap();
        }
        let whole = std::fs::read(file.path()).unwrap();
        let summary = |rows: Vec<HashedToken>| -> Vec<String> {
            rows.iter()
                .map(|k| {
                    format!("{} {} {} {:?} {}", k.name, k.scope.name(), k.made, k.expires, k.digest.hex())
                })
                .collect()
        };
        let expected = summary(file.read().unwrap().unwrap());
        let mut refused = 0;
        let mut check_bytes = |bytes: &[u8], what: &str| {
            std::fs::write(file.path(), bytes).unwrap();
            match file.read() {
                Err(_) => refused += 1,
                Ok(rows) => assert_eq!(summary(rows.unwrap()), expected, "{what}"),
            }
        };
        for length in 0..whole.len() {
            check_bytes(&whole[..length], &format!("{length} bytes"));
        }
        for at in 0..8 * whole.len() {
            let mut bytes = whole.clone();
            bytes[at / 8] ^= 1 << (at % 8);
            check_bytes(&bytes, &format!("bit {at}"));
        }
        assert!(refused > 8 * whole.len(), "{refused} of {}", 9 * whole.len());
        // A file written by hand has no checksum.
        let text = String::from_utf8(whole).unwrap();
        let by_hand =
            text.lines().filter(|l| !l.contains("seal")).collect::<Vec<_>>().join("\n").replace("],", "]");
        std::fs::write(file.path(), by_hand.replace("ann", "eve")).unwrap();
        assert_eq!(file.read().unwrap().unwrap()[0].name, "eve");
    }

    #[test]
    fn concurrent_changes_are_not_lost() {
        let place = tempfile::tempdir().unwrap();
        std::thread::scope(|scope| {
            for i in 0..8 {
                let path = place.path();
                scope.spawn(move || {
                    TokenFile::of_directory(path).add(&token(&format!("n{i}"), None).1).unwrap();
                });
            }
        });
        assert_eq!(TokenFile::of_directory(place.path()).read().unwrap().unwrap().len(), 8);
    }

    #[test]
    fn errors_name_the_row() {
        let row = |fields: &str| {
            parse_token_rows(&format!("[{{{fields}}}]"), "IPLW_TOKENS").unwrap_err().to_string()
        };
        let hash = digest(b"x").hex();
        assert!(row("\"name\": \"a\"").contains("IPLW_TOKENS"));
        assert!(
            row(&format!("\"name\": \"a b\", \"scope\": \"act\", \"sha256\": \"{hash}\""))
                .contains("[0].name")
        );
        assert!(row("\"name\": \"a\", \"scope\": \"act\", \"sha256\": \"1\"").contains("[0].sha256"));
        assert!(
            row(&format!("\"name\": \"a\", \"scope\": \"god\", \"sha256\": \"{hash}\"")).contains("scope")
        );
        let one = format!("{{\"name\": \"a\", \"scope\": \"act\", \"sha256\": \"{hash}\"}}");
        assert_eq!(parse_token_rows(&format!("[{one}]"), "IPLW_TOKENS").unwrap().len(), 1);
        let twice = parse_token_rows(&format!("[{one}, {one}]"), "IPLW_TOKENS").unwrap_err().to_string();
        assert!(twice.contains("[1].name"), "{twice}");
    }
}
