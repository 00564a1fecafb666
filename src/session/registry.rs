//! Worlds by id: those there from the start, those clients make, and those nobody has used for a while. The
//! store has all of them, so that they are there again after a restart.
//!
//! Time is an argument: any clock that counts up from anywhere, so that tests need not wait.

use std::collections::BTreeMap;
use std::ops::Bound;
use std::sync::{Arc, Mutex};
use std::time::Duration;

use super::{Catalogue, Kind, SavedWorld, World, WorldConfig, lock};
use crate::error::{Error, Result};
use crate::json;
use crate::store::{Answered, Store, WorldRow};
use crate::task::FAMILIES;
use crate::world::{Engine, Latents};

/// Limits of a registry.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RegistryConfig {
    /// Most worlds at a time.
    pub limit: usize,
    /// A world made by a client goes after not being used for so long.
    pub idle: Duration,
}

/// All worlds of a server.
pub struct Registry {
    config: RegistryConfig,
    store: Arc<Store>,
    worlds: Mutex<BTreeMap<String, Entry>>,
}

/// A world with its id.
pub struct Listed {
    pub id: String,
    pub world: Arc<World>,
}

struct Entry {
    world: Arc<World>,
    /// There from the start; never idles out.
    resident: bool,
    /// When it was last used.
    used: Duration,
}

impl Registry {
    /// A registry of the store's worlds, and of a simulated and a real world of every family: `bowling-sim`,
    /// `bowling-real`, ...
    pub fn new(config: RegistryConfig, catalogue: &Catalogue, store: Arc<Store>) -> Result<Registry> {
        let registry = Registry { config, store, worlds: Mutex::default() };
        for row in registry.store.worlds()? {
            match again(&row, catalogue) {
                Ok(world) => drop(registry.insert(&row.id, world, Duration::ZERO)),
                // Kept for a version that can make it.
                Err(e) => tracing::warn!("the stored world {} cannot be made again: {e}", row.id),
            }
        }
        for family in FAMILIES {
            for kind in [Kind::Sim, Kind::Real] {
                let id = resident(family.name, kind);
                if lock(&registry.worlds).contains_key(&id) {
                    continue;
                }
                let config = WorldConfig {
                    tasks: catalogue.family(family.name)?,
                    kind,
                    engine: Engine::Auto,
                    latents: Latents::default(),
                    effects: None,
                    noise: 0.0,
                    budget: None,
                    sealed: None,
                    seed: 0,
                };
                registry.store.remove_worlds(std::slice::from_ref(&id))?;
                registry.store.add_world(&id, &text(&SavedWorld::of(&config))?, None)?;
                registry.insert(&id, World::new(config)?, Duration::ZERO);
            }
        }
        Ok(registry)
    }

    /// Makes and takes in a client's world. What `answered` makes of it is kept in the same transaction: the
    /// answer to the request.
    pub fn make(
        &self,
        id: &str,
        config: WorldConfig,
        now: Duration,
        answered: &dyn Fn(&World) -> Option<Answered>,
    ) -> Result<Arc<World>> {
        self.sweep(now)?;
        let saved = text(&SavedWorld::of(&config))?;
        let world = World::new(config)?;
        if lock(&self.worlds).len() >= self.config.limit {
            return Err(Error::Capacity {
                what: "worlds",
                limit: self.config.limit,
                advice: "delete one you no longer need, or try again when idle ones are gone",
            });
        }
        self.store.add_world(id, &saved, answered(&world).as_ref())?;
        Ok(self.insert(id, world, now))
    }

    /// The world called `id`; counts as use.
    pub fn get(&self, id: &str, now: Duration) -> Result<Arc<World>> {
        self.sweep(now)?;
        let mut worlds = lock(&self.worlds);
        let entry = worlds.get_mut(id).ok_or_else(|| unknown(id))?;
        entry.used = now;
        Ok(entry.world.clone())
    }

    /// At most `limit` worlds in order of id, those after `after`.
    pub fn list(&self, after: &str, limit: usize, now: Duration) -> Result<Vec<Listed>> {
        self.sweep(now)?;
        let worlds = lock(&self.worlds);
        let from = (Bound::Excluded(after.to_string()), Bound::Unbounded);
        let listed = |(id, e): (&String, &Entry)| Listed { id: id.clone(), world: e.world.clone() };
        Ok(worlds.range(from).take(limit).map(listed).collect())
    }

    /// Forgets a world; work under way on it ends as it would have.
    pub fn remove(&self, id: &str) -> Result<()> {
        if !lock(&self.worlds).contains_key(id) {
            return Err(unknown(id));
        }
        self.store.remove_worlds(&[id.to_string()])?;
        lock(&self.worlds).remove(id).map(drop).ok_or_else(|| unknown(id))
    }

    /// Forgets the worlds that have idled out; returns how many.
    pub fn sweep(&self, now: Duration) -> Result<usize> {
        let mut gone = Vec::new();
        lock(&self.worlds).retain(|id, entry| {
            if Arc::strong_count(&entry.world) > 1 {
                entry.used = now;
            }
            let stays = entry.resident || now.saturating_sub(entry.used) <= self.config.idle;
            if !stays {
                gone.push(id.clone());
            }
            stays
        });
        self.store.remove_worlds(&gone)?;
        Ok(gone.len())
    }

    fn insert(&self, id: &str, world: World, now: Duration) -> Arc<World> {
        let world = Arc::new(world.kept_in(self.store.clone(), id));
        let resident =
            FAMILIES.iter().any(|f| [Kind::Sim, Kind::Real].iter().any(|k| resident(f.name, *k) == id));
        lock(&self.worlds).insert(id.into(), Entry { world: world.clone(), resident, used: now });
        world
    }
}

/// Id of a world that is there from the start.
fn resident(family: &str, kind: Kind) -> String {
    format!("{family}-{}", kind.name())
}

/// A stored world, made again.
fn again(row: &WorldRow, catalogue: &Catalogue) -> Result<World> {
    let saved: SavedWorld = json::parse(&row.config)?;
    let latents = row.latents.as_deref().map(json::parse).transpose()?;
    Ok(World::new(saved.config(catalogue)?)?.with_past(row.interactions, latents))
}

fn text(saved: &SavedWorld) -> Result<String> {
    serde_json::to_string(saved).map_err(|e| Error::Failed(format!("a world cannot be written: {e}")))
}

fn unknown(id: &str) -> Error {
    Error::NotFound { kind: "world", id: id.to_string(), known: Vec::new() }
}
