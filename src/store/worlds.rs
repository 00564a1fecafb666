//! Worlds as rows: their configuration and interaction counters.
//!
//! Counters of real worlds are durable before a result is returned ([`Store::count_world`]); concurrent writers share a
//! transaction. Counters of simulated worlds are buffered until the next flush.

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

    /// Buffers a world's counter and latents for the next flush; returns the update's number.
    pub fn note_world(&self, id: &str, interactions: u64, latents: Option<String>) -> u64 {
        let mut pending = lock(&self.pending);
        note(&mut pending.worlds, id, interactions, latents);
        pending.noted += 1;
        pending.noted
    }

    /// Writes a world's counter; durable when it returns.
    pub fn count_world(&self, id: &str, interactions: u64) -> Result<()> {
        let mine = self.note_world(id, interactions, None);
        self.flush_up_to(mine)
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
        let written = self.atomically(|t| {
            for (id, (interactions, latents)) in &worlds {
                change(t, id, *interactions, latents.as_deref())?;
            }
            Ok(())
        });
        let mut pending = lock(&self.pending);
        match written {
            Ok(()) => pending.written = noted,
            Err(_) => {
                for (id, (interactions, latents)) in worlds {
                    let newer = pending.worlds.remove(&id);
                    note(&mut pending.worlds, &id, interactions, latents);
                    if let Some((interactions, latents)) = newer {
                        note(&mut pending.worlds, &id, interactions, latents);
                    }
                }
            }
        }
        written
    }
}

fn note(
    worlds: &mut BTreeMap<String, (u64, Option<String>)>,
    id: &str,
    interactions: u64,
    latents: Option<String>,
) {
    match worlds.get_mut(id) {
        Some(noted) => {
            noted.0 = noted.0.max(interactions);
            noted.1 = latents.or(noted.1.take());
        }
        None => drop(worlds.insert(id.into(), (interactions, latents))),
    }
}

/// Raises a world's counter; it never decreases, since writers may come out of order.
pub(super) fn raise(t: &Transaction, id: &str, interactions: u64) -> rusqlite::Result<()> {
    change(t, id, interactions, None)
}

/// Raises a world's counter and sets its latents, if given.
fn change(t: &Transaction, id: &str, interactions: u64, latents: Option<&str>) -> rusqlite::Result<()> {
    // Cached: parsing the statement takes longer than running it, and a flush runs it for every world.
    let update = "UPDATE world SET interactions = max(interactions, ?2), latents = coalesce(?3, latents) WHERE id = ?1";
    t.prepare_cached(update)?.execute(params![id, interactions as i64, latents]).map(drop)
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
        store.note_world("sim", 5, Some("l1".into()));
        assert_eq!(counts(), [0, 0]);
        store.count_world("real", 3).unwrap();
        assert_eq!(counts(), [3, 5], "what was noted goes along");
        store.note_world("sim", 9, None);
        store.note_world("sim", 8, Some("l2".into()));
        store.note_world("gone", 1, None);
        store.flush_worlds().unwrap();
        assert_eq!(counts(), [3, 9]);
        assert_eq!(store.worlds().unwrap()[1].latents.as_deref(), Some("l2"));
        store.remove_worlds(&["real".into()]).unwrap();
        assert_eq!(counts(), [9]);
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
