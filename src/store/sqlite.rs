//! Conversion of SQLite's errors, and JSON columns.

use rusqlite::{Connection, Params, Row};

use super::checksum;
use crate::error::Error;

/// Converts an error of SQLite: damaged data, with the record's name if it is a row, or a failure.
pub fn failed(place: &str, error: &rusqlite::Error) -> Error {
    use rusqlite::ErrorCode::{DatabaseCorrupt, NotADatabase};
    use rusqlite::ffi::SQLITE_CONSTRAINT_TRIGGER;
    match error {
        rusqlite::Error::FromSqlConversionFailure(_, _, found) if found.is::<Error>() => {
            found.downcast_ref::<Error>().cloned().unwrap_or_else(|| Error::Failed(error.to_string()))
        }
        // Only this program's triggers raise; their message is the record's name.
        rusqlite::Error::SqliteFailure(e, Some(record)) if e.extended_code == SQLITE_CONSTRAINT_TRIGGER => {
            Error::Damaged { what: record.clone(), how: checksum::CHECKSUM_MISMATCH.into() }
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

/// All rows of a query.
pub fn query<T>(
    c: &Connection,
    select: &str,
    with: impl Params,
    row: impl FnMut(&Row) -> rusqlite::Result<T>,
) -> rusqlite::Result<Vec<T>> {
    c.prepare(select)?.query_map(with, row)?.collect()
}

/// A JSON column of a row.
pub fn json(row: &Row, column: usize) -> rusqlite::Result<serde_json::Value> {
    let text: String = row.get(column)?;
    serde_json::from_str(&text)
        .map_err(|e| checksum::unreadable(row, &format!("its JSON cannot be read: {e}")))
}
