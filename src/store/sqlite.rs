//! SQLite's errors as ours, and JSON in its rows.

use rusqlite::Row;

use super::seal;
use crate::error::Error;

/// What SQLite says of a file or a statement: that something is damaged, by name if a row is, or that it failed.
pub fn failed(place: &str, error: &rusqlite::Error) -> Error {
    use rusqlite::ErrorCode::{DatabaseCorrupt, NotADatabase};
    use rusqlite::ffi::SQLITE_CONSTRAINT_TRIGGER;
    match error {
        rusqlite::Error::FromSqlConversionFailure(_, _, found) if found.is::<Error>() => {
            found.downcast_ref::<Error>().cloned().unwrap_or_else(|| Error::Failed(error.to_string()))
        }
        // Our triggers alone raise, and what they say is the record.
        rusqlite::Error::SqliteFailure(e, Some(record)) if e.extended_code == SQLITE_CONSTRAINT_TRIGGER => {
            Error::Damaged { what: record.clone(), how: seal::OTHER.into() }
        }
        rusqlite::Error::SqliteFailure(e, _) if matches!(e.code, DatabaseCorrupt | NotADatabase) => {
            Error::Damaged { what: place.to_string(), how: error.to_string() }
        }
        _ => Error::Io { path: place.to_string(), message: error.to_string() },
    }
}

pub fn sql(error: rusqlite::Error) -> Error {
    failed("the store", &error)
}

/// JSON that this program wrote itself, of the record that `row` is.
pub fn json(row: &Row, column: usize) -> rusqlite::Result<serde_json::Value> {
    let text: String = row.get(column)?;
    serde_json::from_str(&text).map_err(|e| seal::unreadable(row, &format!("its JSON cannot be read: {e}")))
}
