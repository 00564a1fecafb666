//! A checksum for every row, maintained by triggers and verified by readers.
//!
//! The column `seal` holds the first 8 bytes of the SHA-256 of the table's name and all other columns, each with its type and
//! length. It detects damage by the disk, not tampering by a writer of the file. Triggers and views belong to the connection, not
//! to the file: `whole_job` is `job` with a column `whole`. Damaged rows cannot be updated, which would give them a valid
//! checksum.

use ring::digest::{Context, SHA256, digest};
use rusqlite::functions::FunctionFlags;
use rusqlite::types::{Type, ValueRef};
use rusqlite::{Connection, Row};

use crate::error::Error;

/// A table whose rows have checksums.
pub struct ChecksummedTable {
    pub name: &'static str,
    /// Every column except the checksum.
    pub columns: &'static [&'static str],
    /// SQL expression for a row's name; `{}` is the prefix of columns.
    pub record: &'static str,
    /// First schema version in which it has checksums.
    pub since: i64,
}

/// Tables with checksums in a schema version.
pub fn tables(version: i64) -> impl Iterator<Item = &'static ChecksummedTable> {
    TABLES.iter().filter(move |t| t.since <= version)
}

/// All tables.
pub static TABLES: [ChecksummedTable; 10] = [
    ChecksummedTable {
        name: "job",
        columns: &[
            "number", "kind", "state", "config", "result", "error", "seed", "version", "stage", "done",
            "total", "events", "plan", "starts", "owner", "ended",
        ],
        record: "'job job-' || {}number",
        since: 5,
    },
    ChecksummedTable {
        name: "policy",
        columns: &[
            "number", "id", "task", "training", "about", "config", "job", "version", "blob", "bytes",
            "owner", "digest",
        ],
        record: "'policy ' || {}id",
        since: 5,
    },
    ChecksummedTable {
        name: "round",
        columns: &["job", "number", "asked", "done"],
        record: "'round ' || {}number || ' of job-' || {}job",
        since: 5,
    },
    ChecksummedTable {
        name: "measured",
        columns: &["job", "number", "outcome"],
        record: "'measurement ' || {}number || ' of job-' || {}job",
        since: 5,
    },
    ChecksummedTable {
        name: "artifact",
        columns: &["job", "name", "body"],
        record: "'artifact ' || {}name || ' of job-' || {}job",
        since: 5,
    },
    ChecksummedTable {
        name: "world",
        columns: &["number", "id", "config", "latents", "interactions", "owner"],
        record: "'world ' || {}id",
        since: 5,
    },
    ChecksummedTable {
        name: "request",
        columns: &["number", "key", "fingerprint", "status", "location", "body"],
        record: "'answer to the request with key ' || {}key",
        since: 5,
    },
    ChecksummedTable {
        name: "surface",
        columns: &["number", "task", "config", "body", "job", "version"],
        record: "'surface surface-' || {}number",
        since: 5,
    },
    ChecksummedTable {
        name: "log",
        columns: &["job", "number", "at", "level", "text"],
        record: "'line ' || {}number || ' of the log of job-' || {}job",
        since: 6,
    },
    ChecksummedTable {
        name: "metadata",
        columns: &["job", "name", "note", "created", "started", "ended", "summary"],
        record: "'metadata of job-' || {}job",
        since: 8,
    },
];

impl ChecksummedTable {
    /// SQL expression for a row's checksum; `of` is `""`, `"NEW."` or `"OLD."`.
    pub fn seal(&self, of: &str) -> String {
        let columns: Vec<String> = self.columns.iter().map(|c| format!("{of}{c}")).collect();
        format!("seal_of('{}', {})", self.name, columns.join(", "))
    }

    /// SQL expression for a row's name; `of` as for [`ChecksummedTable::seal`].
    pub fn record(&self, of: &str) -> String {
        self.record.replace("{}", of)
    }

    /// The table's view and triggers.
    fn guards(&self) -> String {
        let (name, columns) = (self.name, self.columns.join(", "));
        let (seal, new, old) = (self.seal(""), self.seal("NEW."), self.seal("OLD."));
        let (record, changed) = (self.record(""), self.record("OLD."));
        format!(
            "CREATE TEMP VIEW whole_{name} AS SELECT *, seal IS {seal} AS whole, {record} AS record FROM main.{name};
            CREATE TEMP TRIGGER {name}_made AFTER INSERT ON main.{name} BEGIN
                UPDATE {name} SET seal = {new} WHERE rowid = NEW.rowid;
            END;
            CREATE TEMP TRIGGER {name}_looked_at BEFORE UPDATE OF {columns} ON main.{name}
            WHEN OLD.seal IS NOT {old} BEGIN
                SELECT RAISE(ABORT, {changed});
            END;
            CREATE TEMP TRIGGER {name}_changed AFTER UPDATE OF {columns} ON main.{name} BEGIN
                UPDATE {name} SET seal = {new} WHERE rowid = NEW.rowid;
            END;"
        )
    }
}

/// Registers the SQL function `seal_of` on a connection.
pub fn register_function(c: &Connection) -> rusqlite::Result<()> {
    let flags = FunctionFlags::SQLITE_UTF8 | FunctionFlags::SQLITE_DETERMINISTIC;
    c.create_scalar_function("seal_of", -1, flags, |call| {
        let mut all = Context::new(&SHA256);
        for i in 0..call.len() {
            let value = call.get_raw(i);
            let number = match value {
                ValueRef::Integer(n) => n.to_le_bytes(),
                ValueRef::Real(x) => x.to_le_bytes(),
                _ => [0; 8],
            };
            let (kind, bytes): (u8, &[u8]) = match value {
                ValueRef::Null => (0, &[]),
                ValueRef::Integer(_) => (1, &number),
                ValueRef::Real(_) => (2, &number),
                ValueRef::Text(text) => (3, text),
                ValueRef::Blob(bytes) => (4, bytes),
            };
            all.update(&[kind]);
            all.update(&(bytes.len() as u64).to_le_bytes());
            all.update(bytes);
        }
        let mut first = [0; 8];
        first.copy_from_slice(&all.finish().as_ref()[..8]);
        Ok(i64::from_le_bytes(first))
    })
}

/// Installs the triggers and views on a connection; the tables must exist.
pub fn install_guards(c: &Connection) -> rusqlite::Result<()> {
    c.execute_batch(&TABLES.iter().map(ChecksummedTable::guards).collect::<String>())
}

/// Errors with the record's name unless the row is intact; the row has the columns `whole` and `record`.
pub fn verify(row: &Row) -> rusqlite::Result<()> {
    if row.get_ref("whole")? == ValueRef::Integer(1) {
        Ok(())
    } else {
        Err(unreadable(row, CHECKSUM_MISMATCH))
    }
}

/// Damage of a row whose checksum does not match.
pub const CHECKSUM_MISMATCH: &str = "the checksum does not match";

/// Error of an unreadable row; the row has the column `record`.
pub fn unreadable(row: &Row, how: &str) -> rusqlite::Error {
    let error = Error::Damaged { what: record(row), how: how.into() };
    rusqlite::Error::FromSqlConversionFailure(0, Type::Null, Box::new(error))
}

/// The row's name, which may be damaged as well.
pub fn record(row: &Row) -> String {
    match row.get_ref("record") {
        Ok(ValueRef::Text(text)) => String::from_utf8_lossy(text).escape_debug().to_string(),
        _ => "a record without a name".into(),
    }
}

/// SHA-256, hexadecimal.
pub fn sha256(bytes: &[u8]) -> String {
    digest(&SHA256, bytes).as_ref().iter().map(|b| format!("{b:02x}")).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::store::Store;

    /// New columns must be included in the checksum.
    #[test]
    fn every_column_has_a_checksum() {
        let store = Store::in_memory().unwrap();
        let c = store.connection();
        let select = "SELECT m.name, group_concat(x.name) FROM sqlite_schema m JOIN pragma_table_info(m.name) x \
                      WHERE m.type = 'table' AND m.name NOT LIKE 'sqlite%' GROUP BY m.name ORDER BY m.name";
        let mut query = c.prepare(select).unwrap();
        let there = query.query_map([], |r| Ok((r.get(0)?, r.get(1)?))).unwrap();
        let there: Vec<(String, String)> = there.collect::<rusqlite::Result<_>>().unwrap();
        let mut here: Vec<(String, String)> =
            TABLES.iter().map(|t| (t.name.into(), format!("{},seal", t.columns.join(",")))).collect();
        here.sort();
        let sorted = |rows: Vec<(String, String)>| -> Vec<(String, Vec<String>)> {
            let columns = |text: &str| {
                let mut all: Vec<String> = text.split(',').map(String::from).collect();
                all.sort();
                all
            };
            rows.iter().map(|(name, text)| (name.clone(), columns(text))).collect()
        };
        assert_eq!(sorted(there), sorted(here));
    }

    #[test]
    fn damaged_row_is_reported_and_not_updated() {
        let store = Store::in_memory().unwrap();
        store.add_world("w1", "{}", None, None).unwrap();
        store.add_world("w2", "{}", None, None).unwrap();
        store.count_world("w1", 3).unwrap();
        assert_eq!(store.worlds().unwrap()[0].interactions, 3);
        {
            // Simulates damage by the disk: without triggers.
            let c = store.connection();
            let triggers = ["made", "looked_at", "changed"].map(|t| format!("DROP TRIGGER temp.world_{t};"));
            c.execute_batch(&triggers.concat()).unwrap();
            c.execute("UPDATE world SET interactions = 2 WHERE id = 'w1'", []).unwrap();
            c.execute_batch(&format!("DROP VIEW temp.whole_world; {}", TABLES[5].guards())).unwrap();
        }
        let damaged = |error: Error| matches!(&error, Error::Damaged { what, .. } if what == "world w1");
        assert!(damaged(store.worlds().unwrap_err()));
        assert!(damaged(store.count_world("w1", 9).unwrap_err()));
        store.remove_worlds(&["w1".into()]).unwrap();
        assert_eq!(store.worlds().unwrap().len(), 1);
    }

    #[test]
    fn checksum_depends_on_types_and_lengths() {
        let c = Connection::open_in_memory().unwrap();
        register_function(&c).unwrap();
        let seal =
            |of: &str| -> i64 { c.query_row(&format!("SELECT seal_of({of})"), [], |r| r.get(0)).unwrap() };
        let different =
            ["'a', 'bc'", "'ab', 'c'", "'abc'", "'abc', NULL", "'abc', ''", "'abc', 0", "'abc', x''"];
        for (i, one) in different.iter().enumerate() {
            assert_eq!(seal(one), seal(one));
            for other in &different[..i] {
                assert_ne!(seal(one), seal(other), "{one} {other}");
            }
        }
        // The first 8 bytes, little endian: later versions must read this format.
        let expected = u64::from_str_radix(&sha256(&[3, 1, 0, 0, 0, 0, 0, 0, 0, b'a'])[..16], 16).unwrap();
        assert_eq!(seal("'a'"), expected.swap_bytes() as i64);
    }
}
