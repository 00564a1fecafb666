//! A checksum for every row, kept by triggers that no writer can forget and looked at by whoever reads.
//!
//! The column `seal` holds the first 8 bytes of the SHA-256 of the table's name and all other columns, each with its type and
//! length. It tells what the disk changed, not what somebody did who may write to the file. Triggers and views live in the
//! connection, not in the file: `whole_job` is `job` with a column `whole`; a row that is damaged is not changed, which would
//! seal the damage in.

use ring::digest::{Context, SHA256, digest};
use rusqlite::functions::FunctionFlags;
use rusqlite::types::{Type, ValueRef};
use rusqlite::{Connection, Row};

use crate::error::Error;

/// A table whose rows are sealed.
pub struct Table {
    pub name: &'static str,
    /// Every column but the seal.
    pub columns: &'static [&'static str],
    /// What a row is called, in SQL; columns have `{}` in front of them.
    pub record: &'static str,
    /// First version of the tables that has it sealed.
    pub since: i64,
}

/// Those that are sealed in a version of the tables.
pub fn tables(version: i64) -> impl Iterator<Item = &'static Table> {
    TABLES.iter().filter(move |t| t.since <= version)
}

/// Every table.
pub static TABLES: [Table; 9] = [
    Table {
        name: "job",
        columns: &[
            "number", "kind", "state", "config", "result", "error", "seed", "version", "stage", "done",
            "total", "events", "plan", "starts", "owner", "ended",
        ],
        record: "'job job-' || {}number",
        since: 5,
    },
    Table {
        name: "policy",
        columns: &[
            "number", "id", "task", "training", "about", "config", "job", "version", "blob", "bytes",
            "owner", "digest",
        ],
        record: "'policy ' || {}id",
        since: 5,
    },
    Table {
        name: "round",
        columns: &["job", "number", "asked", "done"],
        record: "'round ' || {}number || ' of job-' || {}job",
        since: 5,
    },
    Table {
        name: "measured",
        columns: &["job", "number", "outcome"],
        record: "'measurement ' || {}number || ' of job-' || {}job",
        since: 5,
    },
    Table {
        name: "artifact",
        columns: &["job", "name", "body"],
        record: "'artifact ' || {}name || ' of job-' || {}job",
        since: 5,
    },
    Table {
        name: "world",
        columns: &["number", "id", "config", "latents", "interactions", "owner"],
        record: "'world ' || {}id",
        since: 5,
    },
    Table {
        name: "request",
        columns: &["number", "key", "fingerprint", "status", "location", "body"],
        record: "'answer to the request with key ' || {}key",
        since: 5,
    },
    Table {
        name: "surface",
        columns: &["number", "task", "config", "body", "job", "version"],
        record: "'surface surface-' || {}number",
        since: 5,
    },
    Table {
        name: "log",
        columns: &["job", "number", "at", "level", "text"],
        record: "'line ' || {}number || ' of the log of job-' || {}job",
        since: 6,
    },
];

impl Table {
    /// A row's checksum in SQL; `of` is `""`, `"NEW."` or `"OLD."`.
    pub fn seal(&self, of: &str) -> String {
        let columns: Vec<String> = self.columns.iter().map(|c| format!("{of}{c}")).collect();
        format!("seal_of('{}', {})", self.name, columns.join(", "))
    }

    /// What a row is called in SQL; `of` as for [`Table::seal`].
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

/// Teaches a connection what a seal is.
pub fn teach(c: &Connection) -> rusqlite::Result<()> {
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

/// Has the connection's writers seal every row, and its readers see whether it is whole. The tables are there.
pub fn guard(c: &Connection) -> rusqlite::Result<()> {
    c.execute_batch(&TABLES.iter().map(Table::guards).collect::<String>())
}

/// Errors, by the record's name, unless the row is whole: it has the columns `whole` and `record`.
pub fn whole(row: &Row) -> rusqlite::Result<()> {
    if row.get_ref("whole")? == ValueRef::Integer(1) { Ok(()) } else { Err(unreadable(row, OTHER)) }
}

/// How a row that is not whole is damaged.
pub const OTHER: &str = "its checksum is another";

/// The error of a row's reader: it has the column `record`.
pub fn unreadable(row: &Row, how: &str) -> rusqlite::Error {
    let error = Error::Damaged { what: record(row), how: how.into() };
    rusqlite::Error::FromSqlConversionFailure(0, Type::Null, Box::new(error))
}

/// What the row calls itself, which may be damaged too.
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

    /// A column that a later version adds cannot be left out of the checksum.
    #[test]
    fn every_column_is_sealed() {
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
    fn a_changed_row_is_named_when_it_is_read_and_not_written_to() {
        let store = Store::in_memory().unwrap();
        store.add_world("w1", "{}", None, None).unwrap();
        store.add_world("w2", "{}", None, None).unwrap();
        store.count_world("w1", 3).unwrap();
        assert_eq!(store.worlds().unwrap()[0].interactions, 3);
        {
            // As the disk would: without triggers.
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
    fn types_and_borders_count() {
        let c = Connection::open_in_memory().unwrap();
        teach(&c).unwrap();
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
        // The first 8 bytes, the least first: what is written here is read by every later version.
        let expected = u64::from_str_radix(&sha256(&[3, 1, 0, 0, 0, 0, 0, 0, 0, b'a'])[..16], 16).unwrap();
        assert_eq!(seal("'a'"), expected.swap_bytes() as i64);
    }
}
