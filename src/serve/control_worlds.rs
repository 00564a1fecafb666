//! Control worlds by id. They are in memory: they expire when idle, and end with the server.
//!
//! Time is an argument from any monotonic clock, so that tests need not wait.

use std::collections::BTreeMap;
use std::sync::{Arc, Mutex};
use std::time::Duration;

use crate::control::ControlWorld;
use crate::error::{Error, Result};
use crate::session::RegistryConfig;
use crate::sync::lock;

/// Maximum number of environments of all control worlds.
const MAX_ENVIRONMENTS: usize = 65_536;

/// All control worlds of a server.
#[derive(Default)]
pub struct ControlWorlds(Mutex<BTreeMap<String, ControlEntry>>);

struct ControlEntry {
    world: Arc<Mutex<ControlWorld>>,
    environments: usize,
    /// Name of the token that created it.
    owner: Option<String>,
    /// When it was last used.
    used: Duration,
}

impl ControlWorlds {
    /// Adds a world within the limits of other worlds.
    pub fn add(
        &self,
        id: &str,
        world: ControlWorld,
        owner: Option<&str>,
        now: Duration,
        limits: &RegistryConfig,
    ) -> Result<()> {
        let mut worlds = lock(&self.0);
        worlds.retain(|_, entry| now.saturating_sub(entry.used) <= limits.idle);
        let own = worlds.values().filter(|entry| entry.owner.as_deref() == owner).count();
        let advice = "delete worlds you no longer need";
        if worlds.len() >= limits.limit || own >= limits.owner_limit {
            let limit = limits.limit.min(limits.owner_limit);
            return Err(Error::Capacity { what: "control worlds", limit, advice });
        }
        let environments = world.config.count;
        if worlds.values().map(|entry| entry.environments).sum::<usize>() + environments > MAX_ENVIRONMENTS {
            return Err(Error::Capacity {
                what: "environments of control worlds",
                limit: MAX_ENVIRONMENTS,
                advice,
            });
        }
        let owner = owner.map(String::from);
        let world = Arc::new(Mutex::new(world));
        worlds.insert(id.into(), ControlEntry { world, environments, owner, used: now });
        Ok(())
    }

    /// The world `id` if it is visible to `owner` (all worlds are to `None`); counts as use.
    pub fn get(&self, id: &str, owner: Option<&str>, now: Duration) -> Result<Arc<Mutex<ControlWorld>>> {
        let mut worlds = lock(&self.0);
        let entry = worlds.get_mut(id).filter(|entry| is_visible(entry, owner)).ok_or_else(|| unknown(id))?;
        entry.used = now;
        Ok(entry.world.clone())
    }

    /// Removes the world `id` if it is visible to `owner`.
    pub fn remove(&self, id: &str, owner: Option<&str>) -> Result<()> {
        let mut worlds = lock(&self.0);
        if !worlds.get(id).is_some_and(|entry| is_visible(entry, owner)) {
            return Err(unknown(id));
        }
        worlds.remove(id);
        Ok(())
    }
}

fn is_visible(entry: &ControlEntry, owner: Option<&str>) -> bool {
    owner.is_none() || entry.owner.as_deref() == owner
}

fn unknown(id: &str) -> Error {
    Error::not_found("control world", id, Vec::<String>::new())
}
