//! Tokens as a file: JSON, `iplw.tokens/1`, a row for each. The same rows may come from elsewhere (an environment
//! variable). Of a token its SHA-256 is written, never the token.

use std::fs::{File, OpenOptions};
use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};

use super::scope::Scope;
use super::token::{Digest, Kept};
use super::when::{moment, written};
use crate::error::{Error, Result};
use crate::json;
use crate::store::write_private;

/// A file of tokens.
pub struct TokenFile {
    path: PathBuf,
}

const FORMAT: &str = "iplw.tokens/1";

#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Document {
    format: String,
    tokens: Vec<Row>,
}

#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Row {
    name: String,
    may: Scope,
    sha256: String,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    made: Option<String>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    expires: Option<String>,
}

/// Tokens from the rows of such a file as JSON, `[{"name": .., "may": .., "sha256": ..}]`; errors name `place`.
pub fn rows(text: &str, place: &str) -> Result<Vec<Kept>> {
    let rows: Vec<Row> = json::parse(text).map_err(|e| e.at(place))?;
    kept(rows, "").map_err(|e| e.at(place))
}

/// Tokens from the text of such a file.
pub fn whole(text: &str) -> Result<Vec<Kept>> {
    let document: Document = json::parse(text)?;
    if document.format != FORMAT {
        return Err(Error::input("format", format!("{:?}", document.format), format!("{FORMAT:?}")));
    }
    kept(document.tokens, "tokens")
}

impl TokenFile {
    /// The file at a path, which need not be there.
    pub fn at(path: &Path) -> TokenFile {
        TokenFile { path: path.to_path_buf() }
    }

    /// The one of a data directory.
    pub fn of_directory(directory: &Path) -> TokenFile {
        TokenFile { path: directory.join("tokens.json") }
    }

    /// Where it is.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// What it holds; `None` if there is no such file.
    pub fn read(&self) -> Result<Option<Vec<Kept>>> {
        let text = match std::fs::read_to_string(&self.path) {
            Ok(text) => text,
            Err(e) if e.kind() == std::io::ErrorKind::NotFound => return Ok(None),
            Err(e) => return Err(Error::io(&self.path, e)),
        };
        whole(&text).map_err(|e| e.at(self.path.display())).map(Some)
    }

    /// Changes what it holds, all of it or nothing; those who change it at the same time take turns.
    pub fn change<T>(&self, how: impl FnOnce(&mut Vec<Kept>) -> Result<T>) -> Result<T> {
        let _turn = self.locked()?;
        let mut tokens = self.read()?.unwrap_or_default();
        let done = how(&mut tokens)?;
        let document = Document { format: FORMAT.into(), tokens: tokens.iter().map(Row::of).collect() };
        let text = serde_json::to_string_pretty(&document)
            .map_err(|e| Error::Failed(format!("tokens cannot be written as JSON: {e}")))?;
        write_private(&self.path, (text + "\n").as_bytes())?;
        Ok(done)
    }

    fn locked(&self) -> Result<File> {
        if let Some(directory) = self.path.parent().filter(|p| !p.as_os_str().is_empty()) {
            std::fs::create_dir_all(directory).map_err(|e| Error::io(directory, e))?;
        }
        let path = self.path.with_extension("lock");
        let file = OpenOptions::new().write(true).create(true).truncate(false).open(&path);
        let file = file.map_err(|e| Error::io(&path, e))?;
        file.lock().map_err(|e| Error::io(&path, e))?;
        Ok(file)
    }
}

impl Row {
    fn of(kept: &Kept) -> Row {
        Row {
            name: kept.name.clone(),
            may: kept.scope,
            sha256: kept.digest.hex(),
            made: Some(written(kept.made)),
            expires: kept.expires.map(written),
        }
    }
}

/// Errors name the row, of what is called `list`.
fn kept(rows: Vec<Row>, list: &str) -> Result<Vec<Kept>> {
    let mut all: Vec<Kept> = Vec::with_capacity(rows.len());
    for (i, row) in rows.into_iter().enumerate() {
        let one = || -> Result<Kept> {
            Kept::check_name("name", &row.name)?;
            if all.iter().any(|k| k.name == row.name) {
                return Err(Error::input("name", format!("{:?}", row.name), "each name once"));
            }
            Ok(Kept {
                scope: row.may,
                digest: Digest::from_hex("sha256", &row.sha256)?,
                made: row.made.as_deref().map_or(Ok(0), |t| moment("made", t))?,
                expires: row.expires.as_deref().map(|t| moment("expires", t)).transpose()?,
                name: row.name,
            })
        };
        all.push(one().map_err(|e| e.under(&format!("{list}[{i}]")))?);
    }
    Ok(all)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::access::{digest, fresh};

    fn token(name: &str, expires: Option<u64>) -> (String, Kept) {
        let token = fresh().unwrap();
        let digest = digest(token.as_bytes());
        (token, Kept { name: name.into(), scope: Scope::Act, digest, made: 5, expires })
    }

    #[test]
    fn tokens_are_kept_as_hashes_in_a_file_of_ones_own() {
        let place = tempfile::tempdir().unwrap();
        let file = TokenFile::of_directory(&place.path().join("data"));
        assert!(file.read().unwrap().is_none());
        let (secret, kept) = token("ann", Some(99));
        file.change(|all| {
            all.push(kept.clone());
            Ok(())
        })
        .unwrap();
        let text = std::fs::read_to_string(file.path()).unwrap();
        assert!(!text.contains(&secret) && text.contains(&kept.digest.hex()), "{text}");
        let again = &file.read().unwrap().unwrap()[0];
        assert!(again.digest.is(&digest(secret.as_bytes())));
        assert_eq!((again.made, again.expires, again.scope), (5, Some(99), Scope::Act));
        #[cfg(unix)]
        {
            use std::os::unix::fs::PermissionsExt;
            let mode = std::fs::metadata(file.path()).unwrap().permissions().mode();
            assert_eq!(mode & 0o777, 0o600);
        }
    }

    #[test]
    fn those_who_change_it_at_once_lose_nothing() {
        let place = tempfile::tempdir().unwrap();
        std::thread::scope(|scope| {
            for i in 0..8 {
                let path = place.path();
                scope.spawn(move || {
                    let file = TokenFile::of_directory(path);
                    file.change(|all| {
                        all.push(token(&format!("n{i}"), None).1);
                        Ok(())
                    })
                    .unwrap();
                });
            }
        });
        assert_eq!(TokenFile::of_directory(place.path()).read().unwrap().unwrap().len(), 8);
    }

    #[test]
    fn what_is_wrong_is_named() {
        let row = |fields: &str| rows(&format!("[{{{fields}}}]"), "IPLW_TOKENS").unwrap_err().to_string();
        let hash = digest(b"x").hex();
        assert!(row("\"name\": \"a\"").contains("IPLW_TOKENS"));
        assert!(
            row(&format!("\"name\": \"a b\", \"may\": \"act\", \"sha256\": \"{hash}\"")).contains("[0].name")
        );
        assert!(row("\"name\": \"a\", \"may\": \"act\", \"sha256\": \"1\"").contains("[0].sha256"));
        assert!(row(&format!("\"name\": \"a\", \"may\": \"god\", \"sha256\": \"{hash}\"")).contains("may"));
        let one = format!("{{\"name\": \"a\", \"may\": \"act\", \"sha256\": \"{hash}\"}}");
        assert_eq!(rows(&format!("[{one}]"), "IPLW_TOKENS").unwrap().len(), 1);
        let twice = rows(&format!("[{one}, {one}]"), "IPLW_TOKENS").unwrap_err().to_string();
        assert!(twice.contains("[1].name"), "{twice}");
    }
}
