//! The schema, its migrations, and its comparison with a file.

use rusqlite::Connection;

use super::blobs::Blobs;
use super::sqlite::{failed, query};
use super::{checksum, metadata_migration};
use crate::error::{Error, Result};

/// Migrations; a file with the first n applied has version n.
pub const MIGRATIONS: [&str; 8] = [
    "
    CREATE TABLE job (
        number INTEGER PRIMARY KEY AUTOINCREMENT,
        kind TEXT NOT NULL,
        state TEXT NOT NULL,
        config TEXT NOT NULL,
        result TEXT,
        error TEXT,
        seed TEXT NOT NULL,
        version TEXT NOT NULL,
        stage TEXT NOT NULL DEFAULT '',
        done INTEGER NOT NULL DEFAULT 0,
        total INTEGER NOT NULL DEFAULT 0,
        events INTEGER NOT NULL DEFAULT 0
    ) STRICT;
    CREATE TABLE policy (
        number INTEGER PRIMARY KEY AUTOINCREMENT,
        id TEXT NOT NULL UNIQUE,
        task TEXT NOT NULL,
        training TEXT NOT NULL,
        about TEXT NOT NULL,
        config TEXT NOT NULL,
        job TEXT,
        version TEXT NOT NULL,
        blob TEXT NOT NULL,
        bytes INTEGER NOT NULL
    ) STRICT;
",
    "
    ALTER TABLE job ADD COLUMN plan TEXT;
    ALTER TABLE job ADD COLUMN starts INTEGER NOT NULL DEFAULT 0;
    CREATE TABLE round (
        job INTEGER NOT NULL,
        number INTEGER NOT NULL,
        asked TEXT NOT NULL,
        done TEXT,
        PRIMARY KEY (job, number)
    ) STRICT;
    CREATE TABLE measured (
        job INTEGER NOT NULL,
        number INTEGER NOT NULL,
        outcome TEXT,
        PRIMARY KEY (job, number)
    ) STRICT;
    CREATE TABLE artifact (
        job INTEGER NOT NULL,
        name TEXT NOT NULL,
        body BLOB NOT NULL,
        PRIMARY KEY (job, name)
    ) STRICT;
    CREATE TABLE world (
        number INTEGER PRIMARY KEY AUTOINCREMENT,
        id TEXT NOT NULL UNIQUE,
        config TEXT NOT NULL,
        latents TEXT,
        interactions INTEGER NOT NULL DEFAULT 0
    ) STRICT;
    CREATE TABLE request (
        number INTEGER PRIMARY KEY AUTOINCREMENT,
        key TEXT NOT NULL UNIQUE,
        fingerprint TEXT NOT NULL,
        status INTEGER NOT NULL,
        location TEXT,
        body BLOB NOT NULL
    ) STRICT;
",
    "
    CREATE TABLE surface (
        number INTEGER PRIMARY KEY AUTOINCREMENT,
        task TEXT NOT NULL,
        config TEXT NOT NULL,
        body TEXT NOT NULL,
        job TEXT,
        version TEXT NOT NULL,
        UNIQUE (task, config)
    ) STRICT;
",
    "
    ALTER TABLE job ADD COLUMN owner TEXT;
    ALTER TABLE policy ADD COLUMN owner TEXT;
    ALTER TABLE world ADD COLUMN owner TEXT;
",
    "
    ALTER TABLE job ADD COLUMN ended INTEGER;
    UPDATE job SET ended = unixepoch() WHERE state IN ('succeeded', 'failed', 'cancelled');
    ALTER TABLE policy ADD COLUMN digest TEXT NOT NULL DEFAULT '';
    ALTER TABLE job ADD COLUMN seal INTEGER;
    ALTER TABLE policy ADD COLUMN seal INTEGER;
    ALTER TABLE round ADD COLUMN seal INTEGER;
    ALTER TABLE measured ADD COLUMN seal INTEGER;
    ALTER TABLE artifact ADD COLUMN seal INTEGER;
    ALTER TABLE world ADD COLUMN seal INTEGER;
    ALTER TABLE request ADD COLUMN seal INTEGER;
    ALTER TABLE surface ADD COLUMN seal INTEGER;
",
    "
    CREATE TABLE log (
        job INTEGER NOT NULL,
        number INTEGER NOT NULL,
        at INTEGER NOT NULL,
        level TEXT NOT NULL,
        text TEXT NOT NULL,
        seal INTEGER,
        PRIMARY KEY (job, number)
    ) STRICT;
",
    "
    CREATE INDEX job_of_owner ON job (owner);
    CREATE INDEX policy_of_owner ON policy (owner, bytes);
    CREATE INDEX world_of_owner ON world (owner);
    CREATE INDEX request_of_owner ON request (substr(key, 1, instr(key, ' ')), number, octet_length(body));
",
    // `job.ended` is not written any more.
    "
    CREATE TABLE metadata (
        job INTEGER PRIMARY KEY,
        name TEXT NOT NULL DEFAULT '',
        note TEXT NOT NULL DEFAULT '',
        created INTEGER,
        started INTEGER,
        ended INTEGER,
        summary TEXT,
        seal INTEGER
    ) STRICT;
",
];

/// Current version of the schema.
pub const CURRENT_VERSION: i64 = MIGRATIONS.len() as i64;
/// First version with checksums of rows and digests of weights.
pub const FIRST_CHECKSUM_VERSION: i64 = 5;
/// First version in which records have owners.
pub const FIRST_OWNER_VERSION: i64 = 4;
/// First version in which jobs have metadata.
pub const FIRST_METADATA_VERSION: i64 = 8;
/// Tables whose rows belong to a job.
pub const TABLES_OF_JOB: [&str; 5] = ["round", "measured", "artifact", "log", "metadata"];

/// Version of a file's schema; errors for later versions of the program.
pub fn version(c: &Connection, place: &str) -> Result<i64> {
    let version: i64 =
        c.query_row("PRAGMA user_version", [], |row| row.get(0)).map_err(|e| failed(place, &e))?;
    if (0..=CURRENT_VERSION).contains(&version) {
        return Ok(version);
    }
    Err(Error::Refused {
        reason: format!(
            "{place} was written by a later version of this program (schema {version}, \
             this version has {CURRENT_VERSION}); use that version, or another data directory"
        ),
    })
}

/// Migrates a file to the current version, atomically. Existing data are assumed intact: rows get their checksums and weights
/// their digests now.
pub fn migrate(c: &mut Connection, from: i64, blobs: &Blobs) -> rusqlite::Result<()> {
    if from == CURRENT_VERSION {
        return Ok(());
    }
    let t = c.transaction_with_behavior(rusqlite::TransactionBehavior::Immediate)?;
    t.execute_batch(&MIGRATIONS[from as usize..].concat())?;
    if from < FIRST_METADATA_VERSION {
        metadata_migration::add_missing(&t)?;
    }
    if from < FIRST_CHECKSUM_VERSION {
        let policies: Vec<(i64, String)> =
            query(&t, "SELECT number, blob FROM policy", [], |r| Ok((r.get(0)?, r.get(1)?)))?;
        for (number, blob) in policies {
            // Missing weights have no digest; a check reports them.
            let digest = blobs.digest(&blob).ok().flatten().unwrap_or_default();
            t.execute("UPDATE policy SET digest = ?2 WHERE number = ?1", rusqlite::params![number, digest])?;
        }
        for table in &checksum::TABLES {
            t.execute(&format!("UPDATE {} SET seal = {}", table.name, table.seal("")), [])?;
        }
    }
    t.pragma_update(None, "user_version", CURRENT_VERSION)?;
    t.commit()
}

/// Text description of every table with its columns and indexes.
pub fn shape(c: &Connection) -> rusqlite::Result<String> {
    let select = "
        SELECT m.name || ' strict=' || t.strict || ' ' || x.name || ' ' || x.type || ' ' || x.\"notnull\" || ' '
            || coalesce(x.dflt_value, '-') || ' ' || x.pk
        FROM sqlite_schema m JOIN pragma_table_list(m.name) t ON t.schema = 'main' JOIN pragma_table_xinfo(m.name) x
        WHERE m.type = 'table'
        UNION ALL
        SELECT m.name || ' unique=' || l.\"unique\" || ' ' || coalesce(i.name, '-') || ' ' || i.seqno || ' ' || i.coll
        FROM sqlite_schema m JOIN pragma_index_list(m.name) l JOIN pragma_index_xinfo(l.name) i
        WHERE m.type = 'table'
        UNION ALL
        SELECT type || ' ' || name FROM sqlite_schema WHERE type <> 'table'
        ORDER BY 1";
    let lines: Vec<String> = query(c, select, [], |r| r.get(0))?;
    Ok(lines.join("\n"))
}

/// That of a version's schema.
pub fn shape_of(version: i64) -> rusqlite::Result<String> {
    let c = Connection::open_in_memory()?;
    c.execute_batch(&MIGRATIONS[..version as usize].concat())?;
    shape(&c)
}

#[cfg(test)]
mod tests {
    use std::fs;
    use std::path::Path;

    use serde_json::json;

    use super::*;
    use crate::store::{JobState, RoundRow, Store, check};

    /// Rows added by each version of the program.
    const ROWS_BY_VERSION: [&str; 7] = [
        "INSERT INTO job (kind, state, config, result, seed, version, events)
             VALUES ('iplw', 'succeeded', '{\"a\":1}', '[1.5]', '18446744073709551615', '0', 3);
         INSERT INTO job (kind, state, config, seed, version) VALUES ('train', 'running', '{}', '1', '0');
         INSERT INTO policy (id, task, training, about, config, version, blob, bytes)
             VALUES ('p', 'bowling', 'fixed', 'old', '{}', '0', 'p.1.safetensors', 3);",
        "UPDATE job SET plan = '{\"b\":2}', starts = 2 WHERE number = 2;
         INSERT INTO round (job, number, asked, done) VALUES (2, 0, '[0, 1]', 'done'), (2, 1, '[2]', NULL);
         INSERT INTO measured (job, number, outcome) VALUES (2, 0, 'a'), (2, 1, NULL);
         INSERT INTO artifact (job, name, body) VALUES (1, 'surface', x'00ff');
         INSERT INTO world (id, config, latents, interactions) VALUES ('w', '{}', 'l', 7);
         INSERT INTO request (key, fingerprint, status, location, body) VALUES ('k', 'f', 201, '/here', x'7b7d');",
        "INSERT INTO surface (task, config, body, job, version) VALUES ('bowling', 'c', 's', 'job-1', '0');",
        "UPDATE job SET owner = 'ann'; UPDATE policy SET owner = 'ann'; UPDATE world SET owner = 'ann';",
        "UPDATE job SET ended = 5 WHERE number = 1;",
        "INSERT INTO log (job, number, at, level, text) VALUES (1, 0, 5, 'info', 'begun');",
        "INSERT INTO log (job, number, at, level, text) VALUES
             (1, 1, 3000, 'info', 'queued'), (1, 2, 4000, 'info', 'started'), (1, 3, 4500, 'info', 'started');",
    ];

    /// A data directory of an earlier version.
    fn of_version(directory: &Path, version: usize) {
        let c = Connection::open(directory.join("iplw.sqlite")).unwrap();
        checksum::register_function(&c).unwrap();
        for (steps, rows) in MIGRATIONS.iter().zip(ROWS_BY_VERSION).take(version) {
            c.execute_batch(steps).unwrap();
            c.execute_batch(rows).unwrap();
        }
        for table in checksum::tables(version as i64).filter(|_| version as i64 >= FIRST_CHECKSUM_VERSION) {
            let digest = checksum::sha256(&[1, 2, 3]);
            c.execute("UPDATE policy SET digest = ?1", [digest]).unwrap();
            c.execute(&format!("UPDATE {} SET seal = {}", table.name, table.seal("")), []).unwrap();
        }
        c.pragma_update(None, "user_version", version as i64).unwrap();
        fs::create_dir(directory.join("policies")).unwrap();
        fs::write(directory.join("policies/p.1.safetensors"), [1, 2, 3]).unwrap();
    }

    #[test]
    fn migrates_every_earlier_version() {
        assert_eq!(
            ROWS_BY_VERSION.len() as i64,
            CURRENT_VERSION - 1,
            "a version more: say what the last one holds"
        );
        let now = shape_of(CURRENT_VERSION).unwrap();
        for version in 1..CURRENT_VERSION as usize {
            let place = tempfile::tempdir().unwrap();
            of_version(place.path(), version);
            assert!(check(place.path()).unwrap().damaged.is_empty(), "{version}, before");
            for _ in 0..2 {
                let store = Store::open(place.path()).unwrap();
                assert_eq!(shape(&store.connection()).unwrap(), now, "{version}");
                holds(&store, version);
            }
            let checked = check(place.path()).unwrap();
            assert_eq!((checked.version, checked.damaged), (CURRENT_VERSION, vec![]), "{version}, after");
        }
    }

    /// Asserts that all of [`ROWS_BY_VERSION`] is present.
    fn holds(store: &Store, version: usize) {
        let owner = (version >= 4).then_some("ann");
        let (done, open) = (store.job(1).unwrap().unwrap(), &store.unfinished().unwrap()[0]);
        assert_eq!(
            (done.state, &done.result, done.seed),
            (JobState::Succeeded, &Some(json!([1.5])), u64::MAX)
        );
        assert_eq!((done.config, done.events, done.owner.as_deref()), (json!({"a": 1}), 3, owner));
        assert_eq!(store.ended_before(u64::MAX >> 1).unwrap(), [1]);
        let times = done.metadata;
        let logged = |at| (version >= 7).then_some(at);
        assert_eq!((times.created, times.started), (logged(3000), logged(4000)));
        assert!(times.ended == Some(5000) || version < 5, "{times:?}");
        let policy = store.policy("p").unwrap().unwrap();
        assert_eq!((policy.about.as_str(), policy.owner.as_deref()), ("old", owner));
        assert_eq!(store.weights("p").unwrap().unwrap(), [1, 2, 3]);
        if version < 2 {
            assert_eq!((open.starts, &open.plan), (0, &json!(null)));
            return assert!(store.worlds().unwrap().is_empty());
        }
        assert_eq!((open.number, open.starts, &open.plan), (2, 2, &json!({"b": 2})));
        let round = |number, asked: &str, done: Option<&str>| RoundRow {
            number,
            asked: asked.into(),
            done: done.map(String::from),
        };
        assert_eq!(store.rounds(2).unwrap(), [round(0, "[0, 1]", Some("done")), round(1, "[2]", None)]);
        assert_eq!(store.measured(2, 0).unwrap(), [(0, Some("a".to_string())), (1, None)].into());
        assert_eq!(store.artifact(1, "surface").unwrap().unwrap(), [0, 255]);
        let world = &store.worlds().unwrap()[0];
        assert_eq!(
            (world.interactions, world.latents.as_deref(), world.owner.as_deref()),
            (7, Some("l"), owner)
        );
        let answered = store.stored_response("k").unwrap().unwrap();
        assert_eq!((answered.status, answered.body.as_slice()), (201, &b"{}"[..]));
        if version >= 3 {
            assert_eq!(store.surface(1).unwrap().unwrap().body, "s");
        }
    }

    #[test]
    fn rejects_unknown_versions_and_schemas() {
        for version in 1..=CURRENT_VERSION as usize {
            for claimed in 0..=CURRENT_VERSION + 2 {
                let place = tempfile::tempdir().unwrap();
                if version < CURRENT_VERSION as usize {
                    of_version(place.path(), version);
                } else {
                    drop(Store::open(place.path()).unwrap());
                }
                let database = place.path().join("iplw.sqlite");
                let c = Connection::open(&database).unwrap();
                c.pragma_update(None, "user_version", claimed).unwrap();
                drop(c);
                let before = fs::read(&database).unwrap();
                let opened = Store::open(place.path()).err().map(|e| e.to_string());
                if claimed == version as i64 {
                    assert_eq!(opened, None);
                    continue;
                }
                let opened = opened.expect("refused");
                let word = if claimed > CURRENT_VERSION { "later version" } else { "not those of version" };
                assert!(opened.contains(word), "{version} told to be {claimed}: {opened}");
                assert_eq!(fs::read(&database).unwrap(), before, "and left as it was");
            }
        }
    }
}
