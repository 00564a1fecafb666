//! Worlds by id: those there from the start, those clients make, and those nobody has used for a while.
//!
//! Time is an argument: any clock that counts up from anywhere, so that tests need not wait.

use std::collections::BTreeMap;
use std::sync::{Arc, Mutex};
use std::time::Duration;

use super::{Catalogue, Kind, World, WorldConfig, lock};
use crate::error::{Error, Result};
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
    /// A registry holding a simulated and a real world of every family: `bowling-sim`, `bowling-real`, ...
    pub fn new(config: RegistryConfig, catalogue: &Catalogue) -> Result<Registry> {
        let mut worlds = BTreeMap::new();
        for family in FAMILIES {
            for kind in [Kind::Sim, Kind::Real] {
                let world = World::new(WorldConfig {
                    tasks: catalogue.family(family.name)?,
                    kind,
                    engine: Engine::Auto,
                    latents: Latents::default(),
                    effects: None,
                    noise: 0.0,
                    budget: None,
                    sealed: None,
                    seed: 0,
                })?;
                let entry = Entry { world: Arc::new(world), resident: true, used: Duration::ZERO };
                worlds.insert(format!("{}-{}", family.name, kind.name()), entry);
            }
        }
        Ok(Registry { config, worlds: Mutex::new(worlds) })
    }

    /// Takes in a client's world.
    pub fn add(&self, id: String, world: World, now: Duration) -> Result<Arc<World>> {
        self.sweep(now);
        let mut worlds = lock(&self.worlds);
        if worlds.len() >= self.config.limit {
            return Err(Error::Capacity {
                what: "worlds",
                limit: self.config.limit,
                advice: "delete one you no longer need, or try again when idle ones are gone",
            });
        }
        let world = Arc::new(world);
        worlds.insert(id, Entry { world: world.clone(), resident: false, used: now });
        Ok(world)
    }

    /// The world called `id`; counts as use.
    pub fn get(&self, id: &str, now: Duration) -> Result<Arc<World>> {
        self.sweep(now);
        let mut worlds = lock(&self.worlds);
        let entry = worlds.get_mut(id).ok_or_else(|| unknown(id))?;
        entry.used = now;
        Ok(entry.world.clone())
    }

    /// All worlds in order of id.
    pub fn list(&self, now: Duration) -> Vec<Listed> {
        self.sweep(now);
        let worlds = lock(&self.worlds);
        worlds.iter().map(|(id, e)| Listed { id: id.clone(), world: e.world.clone() }).collect()
    }

    /// Forgets a world; work under way on it ends as it would have.
    pub fn remove(&self, id: &str) -> Result<()> {
        lock(&self.worlds).remove(id).map(drop).ok_or_else(|| unknown(id))
    }

    /// Forgets the worlds that have idled out; returns how many.
    pub fn sweep(&self, now: Duration) -> usize {
        let mut worlds = lock(&self.worlds);
        let before = worlds.len();
        worlds.retain(|_, entry| {
            if Arc::strong_count(&entry.world) > 1 {
                entry.used = now;
            }
            entry.resident || now.saturating_sub(entry.used) <= self.config.idle
        });
        before - worlds.len()
    }
}

fn unknown(id: &str) -> Error {
    Error::NotFound { kind: "world", id: id.to_string(), known: Vec::new() }
}
