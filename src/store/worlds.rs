//! Worlds as rows: their configuration and interaction counters.
//!
//! Counters of real worlds are durable before a result is returned ([`Store::count_world`]); concurrent writers share a
//! transaction. So are latents ([`Store::set_world_latents`]). Counters of simulated worlds are buffered until the next flush.

use std::collections::BTreeMap;

use rusqlite::{Transaction, params};

use super::Store;
use super::requests::{StoredResponse, keep};
use crate::error::Result;
use crate::sync::lock;

/// A stored world; the texts are the caller's JSON.
#[derive(Clone, Debug, PartialEq)]
pub struct WorldRow {
    pub id: String,
    pub config: String,
    /// Latents, if they were set after creation.
    pub latents: Option<String>,
    pub interactions: u64,
    /// Name of the token that created it.
    pub owner: Option<String>,
}

impl Store {
    /// Adds a world.
    pub fn add_world(
        &self,
        id: &str,
        config: &str,
        owner: Option<&str>,
        answered: Option<&StoredResponse>,
    ) -> Result<()> {
        self.add_worlds(&[(id, config.to_string())], owner, answered)
    }

    /// Adds worlds, (id, config) each, atomically.
    pub fn add_worlds(
        &self,
        worlds: &[(&str, String)],
        owner: Option<&str>,
        answered: Option<&StoredResponse>,
    ) -> Result<()> {
        self.atomically(|t| {
            let mut insert = t.prepare_cached("INSERT INTO world (id, config, owner) VALUES (?1, ?2, ?3)")?;
            for (id, config) in worlds {
                insert.execute(params![id, config, owner])?;
            }
            keep(t, answered)
        })
    }

    /// All worlds in order of creation.
    pub fn worlds(&self) -> Result<Vec<WorldRow>> {
        let select =
            "SELECT id, config, latents, interactions, owner, whole, record FROM whole_world ORDER BY number";
        self.rows(select, [], |r| {
            Ok(WorldRow {
                id: r.get(0)?,
                config: r.get(1)?,
                latents: r.get(2)?,
                interactions: r.get::<_, i64>(3)? as u64,
                owner: r.get(4)?,
            })
        })
    }

    /// Removes worlds.
    pub fn remove_worlds(&self, ids: &[String]) -> Result<()> {
        if ids.is_empty() {
            return Ok(());
        }
        self.atomically(|t| {
            for id in ids {
                t.execute("DELETE FROM world WHERE id = ?1", [id])?;
            }
            Ok(())
        })
    }

    /// Buffers a world's counter for the next flush; returns the update's number.
    pub fn note_world(&self, id: &str, interactions: u64) -> u64 {
        let mut pending = lock(&self.pending);
        note(&mut pending.worlds, id, interactions);
        pending.noted += 1;
        pending.noted
    }

    /// Writes a world's counter; durable when it returns.
    pub fn count_world(&self, id: &str, interactions: u64) -> Result<()> {
        let mine = self.note_world(id, interactions);
        self.flush_up_to(mine)
    }

    /// Writes a world's latents and counter; durable when it returns. After an error the stored latents are the previous ones.
    pub fn set_world_latents(&self, id: &str, interactions: u64, latents: &str) -> Result<()> {
        self.atomically(|t| {
            raise(t, id, interactions)?;
            t.execute("UPDATE world SET latents = ?2 WHERE id = ?1", params![id, latents]).map(drop)
        })
    }

    /// Writes the buffered updates.
    pub fn flush_worlds(&self) -> Result<()> {
        let noted = lock(&self.pending).noted;
        self.flush_up_to(noted)
    }

    fn flush_up_to(&self, number: u64) -> Result<()> {
        let _turn = lock(&self.writing);
        let (worlds, noted) = {
            let mut pending = lock(&self.pending);
            if pending.written >= number {
                // Another writer has written it.
                return Ok(());
            }
            (std::mem::take(&mut pending.worlds), pending.noted)
        };
        let written =
            self.atomically(|t| worlds.iter().try_for_each(|(id, interactions)| raise(t, id, *interactions)));
        let mut pending = lock(&self.pending);
        match written {
            Ok(()) => pending.written = noted,
            Err(_) => worlds.iter().for_each(|(id, n)| note(&mut pending.worlds, id, *n)),
        }
        written
    }
}

fn note(worlds: &mut BTreeMap<String, u64>, id: &str, interactions: u64) {
    match worlds.get_mut(id) {
        Some(noted) => *noted = interactions.max(*noted),
        None => drop(worlds.insert(id.into(), interactions)),
    }
}

/// Raises a world's counter; it never decreases, since writers may come out of order.
pub(super) fn raise(t: &Transaction, id: &str, interactions: u64) -> rusqlite::Result<()> {
    // Cached: parsing the statement takes longer than running it, and a flush runs it for every world.
    let update = "UPDATE world SET interactions = max(interactions, ?2) WHERE id = ?1";
    t.prepare_cached(update)?.execute(params![id, interactions as i64]).map(drop)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn counters_are_durable_and_notes_after_flush() {
        let store = Store::in_memory().unwrap();
        store.add_world("real", "{}", None, None).unwrap();
        store.add_world("sim", "{}", None, None).unwrap();
        let counts = || store.worlds().unwrap().iter().map(|w| w.interactions).collect::<Vec<_>>();
        store.note_world("sim", 5);
        assert_eq!(counts(), [0, 0]);
        store.count_world("real", 3).unwrap();
        assert_eq!(counts(), [3, 5], "what was noted goes along");
        store.note_world("sim", 9);
        store.note_world("sim", 8);
        store.note_world("gone", 1);
        store.flush_worlds().unwrap();
        assert_eq!(counts(), [3, 9]);
        store.remove_worlds(&["real".into()]).unwrap();
        assert_eq!(counts(), [9]);
    }

    #[test]
    fn latents_are_stored_at_once_or_not_at_all() {
        let place = tempfile::tempdir().unwrap();
        let store = Store::open(place.path()).unwrap();
        store.add_world("w", "{}", None, None).unwrap();
        store.set_world_latents("w", 2, "first").unwrap();
        let read_only = |on: bool| store.connection().pragma_update(None, "query_only", on).unwrap();
        read_only(true);
        assert!(store.set_world_latents("w", 3, "second").is_err());
        read_only(false);
        store.flush_worlds().unwrap();
        // Another process sees the files only, as after a kill.
        let c = rusqlite::Connection::open(place.path().join("iplw.sqlite")).unwrap();
        let row = c.query_row("SELECT latents, interactions FROM world", [], |r| Ok((r.get(0)?, r.get(1)?)));
        assert_eq!(row, Ok(("first".to_string(), 2)));
    }

    #[test]
    fn concurrent_counters_are_not_lost() {
        let store = Store::in_memory().unwrap();
        for w in 0..4 {
            store.add_world(&format!("w{w}"), "{}", None, None).unwrap();
        }
        std::thread::scope(|scope| {
            for w in 0..4 {
                let store = &store;
                scope.spawn(move || (1..=50).for_each(|n| store.count_world(&format!("w{w}"), n).unwrap()));
            }
        });
        assert!(store.worlds().unwrap().iter().all(|w| w.interactions == 50));
    }
}
