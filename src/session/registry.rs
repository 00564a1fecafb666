//! Worlds by id: default worlds, worlds created by clients, and expiry of idle ones. All are in the store and survive a
//! restart.
//!
//! Time is an argument from any monotonic clock, so that tests need not wait.

use std::cmp::Reverse;
use std::collections::{BTreeMap, HashMap};
use std::ops::Bound;
use std::sync::{Arc, Mutex};
use std::time::Duration;

use super::catalogue::Catalogue;
use super::config::{WorldConfig, WorldKind};
use super::limits::RequestLimits;
use super::saved::SavedWorld;
use super::world::World;

use crate::budget::Budget;
use crate::error::{Error, Result};
use crate::json;
use crate::store::{Store, StoredResponse, WorldRow};
use crate::sync::lock;
use crate::task::families;

/// Limits of a registry.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RegistryConfig {
    /// Maximum number of worlds.
    pub limit: usize,
    /// Maximum number of worlds of one owner.
    pub owner_limit: usize,
    /// A client's world expires after this idle time.
    pub idle: Duration,
    /// Limits of one request to any world.
    pub request: RequestLimits,
}

/// Maximum size of the worlds that one request makes, bytes: they are written in one transaction, which does not ask the budget.
const MAX_CREATED_BYTES: u64 = 32 << 20;

/// All worlds of a server.
pub struct Registry {
    config: Mutex<RegistryConfig>,
    store: Arc<Store>,
    worlds: Mutex<BTreeMap<String, RegistryEntry>>,
}

/// A world with its id.
pub struct ListedWorld {
    pub id: String,
    pub world: Arc<World>,
    /// Name of the token that created it.
    pub owner: Option<String>,
    /// When it was last used.
    pub used: Duration,
}

/// Order of a list of worlds, and the world to start after.
#[derive(Clone, Debug)]
pub enum WorldList {
    ById {
        after: String,
    },
    /// Most recently used first; `after` holds a world's last use and id.
    ByUse {
        after: Option<(Duration, String)>,
    },
}

struct RegistryEntry {
    world: Arc<World>,
    /// Name of the token that created it.
    owner: Option<String>,
    /// A default world, which never expires.
    is_default: bool,
    /// When it was last used.
    used: Duration,
}

impl Registry {
    /// Loads the store's worlds and adds the default ones, a simulated and a real world per family: `bowling-sim`,
    /// `bowling-real`, ...
    pub fn new(config: RegistryConfig, catalogue: &Catalogue, store: Arc<Store>) -> Result<Registry> {
        let registry = Registry { config: Mutex::new(config), store, worlds: Mutex::default() };
        let (defaults, clients): (Vec<WorldRow>, Vec<WorldRow>) =
            registry.store.worlds()?.into_iter().partition(|row| is_default_id(&row.id));
        defaults.iter().for_each(|row| registry.insert_stored(row, catalogue));
        registry.add_missing_defaults(catalogue)?;
        // After the default worlds, which some of them copy.
        clients.iter().for_each(|row| registry.insert_stored(row, catalogue));
        Ok(registry)
    }

    /// Restores a stored world.
    fn insert_stored(&self, row: &WorldRow, catalogue: &Catalogue) {
        match restore(row, catalogue, self.config().request) {
            Ok(world) => drop(self.insert(&row.id, world, row.owner.as_deref(), Duration::ZERO)),
            // It stays in the store, for a version that can restore it.
            Err(e) => tracing::warn!("cannot restore the stored world {}: {e}", row.id),
        }
    }

    /// Makes the default worlds that are not stored.
    fn add_missing_defaults(&self, catalogue: &Catalogue) -> Result<()> {
        for family in families() {
            for kind in [WorldKind::Sim, WorldKind::Real] {
                let id = default_world_id(family.name, kind);
                if lock(&self.worlds).contains_key(&id) {
                    continue;
                }
                let config = WorldConfig::new(catalogue.family(family.name)?, kind);
                self.store.remove_worlds(std::slice::from_ref(&id))?;
                self.store.add_world(&id, &to_json(&SavedWorld::of(&config))?, None, None)?;
                self.insert(&id, World::with_limits(self.config().request, config)?, None, Duration::ZERO);
            }
        }
        Ok(())
    }

    /// A real world with the hidden physics of a default one counts its attempts there, too, so that a copy saves none.
    pub fn count_copies(&self, world: World) -> World {
        let id = world.copied_family().map(|family| default_world_id(family.name, WorldKind::Real));
        let original = id.and_then(|id| lock(&self.worlds).get(&id).map(|entry| entry.world.clone()));
        world.with_original(original)
    }

    /// Creates a client's world. The response built by `answered` is stored in the same transaction.
    pub fn make(
        &self,
        id: &str,
        config: WorldConfig,
        owner: Option<&str>,
        now: Duration,
        answered: &dyn Fn(&World) -> Option<StoredResponse>,
    ) -> Result<Arc<World>> {
        self.sweep(now)?;
        let saved = to_json(&SavedWorld::of(&config))?;
        let world = World::with_limits(self.config().request, config)?;
        self.check_capacity(owner, 1)?;
        self.store.add_world(id, &saved, owner, answered(&world).as_ref())?;
        Ok(self.insert(id, world, owner, now))
    }

    /// Creates worlds that differ only in their seeds, all or none; otherwise as [`Registry::make`].
    pub fn make_many(
        &self,
        ids_and_seeds: &[(String, u64)],
        config: &WorldConfig,
        owner: Option<&str>,
        now: Duration,
        answered: &dyn Fn(&[ListedWorld]) -> Option<StoredResponse>,
        budget: &dyn Budget,
    ) -> Result<Vec<ListedWorld>> {
        self.sweep(now)?;
        self.check_capacity(owner, ids_and_seeds.len())?;
        let (mut rows, mut made, mut bytes) = (Vec::new(), Vec::new(), 0);
        for (id, seed) in ids_and_seeds {
            budget.check()?;
            let config = WorldConfig { seed: *seed, ..config.clone() };
            let saved = to_json(&SavedWorld::of(&config))?;
            bytes += saved.len() as u64;
            if bytes > MAX_CREATED_BYTES {
                let (what, limit, advice) =
                    ("bytes of worlds", MAX_CREATED_BYTES, "make fewer worlds at a time");
                return Err(Error::TooLarge { what, asked: bytes, limit, advice });
            }
            rows.push((id.as_str(), saved));
            let world = self.count_copies(World::with_limits(self.config().request, config)?);
            let world = Arc::new(world.with_account(self.store.clone(), id));
            made.push(ListedWorld { id: id.clone(), world, owner: owner.map(String::from), used: now });
        }
        self.store.add_worlds(&rows, owner, answered(&made).as_ref())?;
        let mut worlds = lock(&self.worlds);
        for l in &made {
            let owner = owner.map(String::from);
            worlds.insert(
                l.id.clone(),
                RegistryEntry { world: l.world.clone(), owner, is_default: false, used: now },
            );
        }
        Ok(made)
    }

    /// The world `id` of any owner; counts as use.
    pub fn get(&self, id: &str, now: Duration) -> Result<Arc<World>> {
        Ok(self.of(id, None, now)?.world)
    }

    /// The world `id` if it is visible to `owner`; counts as use.
    pub fn of(&self, id: &str, owner: Option<&str>, now: Duration) -> Result<ListedWorld> {
        self.used(&mut lock(&self.worlds), id, owner, now)
    }

    /// Whether `id` is a default world, shared by all clients.
    pub fn is_resident(&self, id: &str) -> bool {
        lock(&self.worlds).get(id).is_some_and(|entry| entry.is_default)
    }

    /// The worlds with these distinct ids; counts as use. Errors name `worlds[i]`.
    pub fn get_many(&self, ids: &[String], owner: Option<&str>, now: Duration) -> Result<Vec<Arc<World>>> {
        check_unique(ids)?;
        let mut worlds = lock(&self.worlds);
        let one = |(i, id): (usize, &String)| {
            let listed = self.used(&mut worlds, id, owner, now);
            listed.map(|l| l.world).map_err(|e| e.for_entry(&format!("worlds[{i}]")))
        };
        ids.iter().enumerate().map(one).collect()
    }

    fn used(
        &self,
        worlds: &mut BTreeMap<String, RegistryEntry>,
        id: &str,
        owner: Option<&str>,
        now: Duration,
    ) -> Result<ListedWorld> {
        let entry = worlds.get_mut(id).filter(|e| e.is_visible_to(owner)).ok_or_else(|| not_found(id))?;
        if self.is_idle(entry, now) {
            // Expired; the next sweep removes it.
            return Err(not_found(id));
        }
        entry.used = now;
        Ok(entry.listed(id))
    }

    /// At most `limit` worlds visible to `owner`.
    pub fn list(
        &self,
        list: &WorldList,
        limit: usize,
        owner: Option<&str>,
        now: Duration,
    ) -> Result<Vec<ListedWorld>> {
        self.sweep(now)?;
        let worlds = lock(&self.worlds);
        let listed = |(id, e): (&String, &RegistryEntry)| e.listed(id);
        let seen = |(_, e): &(&String, &RegistryEntry)| e.is_visible_to(owner);
        match list {
            WorldList::ById { after } => {
                let from = (Bound::Excluded(after.clone()), Bound::Unbounded);
                Ok(worlds.range(from).filter(seen).take(limit).map(listed).collect())
            }
            WorldList::ByUse { after } => {
                let rank = |(id, e): &(&String, &RegistryEntry)| (Reverse(e.used), (*id).clone());
                let after = after.clone().map(|(used, id)| (Reverse(used), id));
                let mut all: Vec<_> = worlds
                    .iter()
                    .filter(seen)
                    .filter(|w| after.as_ref().is_none_or(|a| rank(w) > *a))
                    .collect();
                all.sort_by_cached_key(rank);
                Ok(all.into_iter().take(limit).map(listed).collect())
            }
        }
    }

    /// The world `id` as listed; does not count as use.
    pub fn listed_world(&self, id: &str, owner: Option<&str>, now: Duration) -> Result<ListedWorld> {
        let worlds = lock(&self.worlds);
        let entry = worlds.get(id).filter(|e| e.is_visible_to(owner) && !self.is_idle(e, now));
        Ok(entry.ok_or_else(|| not_found(id))?.listed(id))
    }

    /// Deletes a world; running work on it finishes normally.
    pub fn remove(&self, id: &str, owner: Option<&str>) -> Result<()> {
        if !lock(&self.worlds).get(id).is_some_and(|e| e.is_visible_to(owner)) {
            return Err(not_found(id));
        }
        self.store.remove_worlds(&[id.to_string()])?;
        lock(&self.worlds).remove(id).map(drop).ok_or_else(|| not_found(id))
    }

    /// Deletes worlds, all or none.
    pub fn remove_many(&self, ids: &[String], owner: Option<&str>) -> Result<()> {
        check_unique(ids)?;
        {
            let worlds = lock(&self.worlds);
            if let Some(i) = ids.iter().position(|id| !worlds.get(id).is_some_and(|e| e.is_visible_to(owner)))
            {
                return Err(not_found(&ids[i]).for_entry(&format!("worlds[{i}]")));
            }
        }
        self.store.remove_worlds(ids)?;
        let mut worlds = lock(&self.worlds);
        let gone: Vec<RegistryEntry> = ids.iter().filter_map(|id| worlds.remove(id)).collect();
        drop(worlds);
        drop(gone);
        Ok(())
    }

    /// Deletes expired worlds and returns how many.
    pub fn sweep(&self, now: Duration) -> Result<usize> {
        let mut gone = Vec::new();
        lock(&self.worlds).retain(|id, entry| {
            if Arc::strong_count(&entry.world) > 1 {
                entry.used = now;
            }
            entry.world.events().sweep(now);
            let gone_out = self.is_idle(entry, now);
            if gone_out {
                gone.push(id.clone());
            }
            !gone_out
        });
        self.store.remove_worlds(&gone)?;
        Ok(gone.len())
    }

    /// Whether a world has been idle for too long; running work counts as use.
    fn is_idle(&self, entry: &RegistryEntry, now: Duration) -> bool {
        let in_use = entry.is_default || Arc::strong_count(&entry.world) > 1;
        !in_use && now.saturating_sub(entry.used) > self.config().idle
    }

    /// Replaces the limits; those of one request apply to worlds made afterwards.
    pub fn set_config(&self, config: RegistryConfig) {
        *lock(&self.config) = config;
    }

    fn config(&self) -> RegistryConfig {
        *lock(&self.config)
    }

    /// Errors unless there is room for this many further worlds of an owner.
    fn check_capacity(&self, owner: Option<&str>, further: usize) -> Result<()> {
        let (config, worlds) = (self.config(), lock(&self.worlds));
        let own = || worlds.values().filter(|entry| entry.owner.as_deref() == owner).count();
        let advice = "delete worlds you no longer need, or try again when idle ones have expired";
        if worlds.len() + further > config.limit {
            return Err(Error::Capacity { what: "worlds", limit: config.limit, advice });
        }
        if owner.is_some() && own() + further > config.owner_limit {
            return Err(Error::Capacity { what: "worlds of one token", limit: config.owner_limit, advice });
        }
        Ok(())
    }

    fn insert(&self, id: &str, world: World, owner: Option<&str>, now: Duration) -> Arc<World> {
        let is_default = is_default_id(id);
        let world = if is_default { world } else { self.count_copies(world) };
        let world = Arc::new(world.with_account(self.store.clone(), id));
        let owner = owner.map(String::from);
        lock(&self.worlds)
            .insert(id.into(), RegistryEntry { world: world.clone(), owner, is_default, used: now });
        world
    }
}

impl RegistryEntry {
    fn listed(&self, id: &str) -> ListedWorld {
        ListedWorld { id: id.into(), world: self.world.clone(), owner: self.owner.clone(), used: self.used }
    }

    /// Whether it is visible to `owner`: their own and default worlds; `None` sees all.
    fn is_visible_to(&self, owner: Option<&str>) -> bool {
        owner.is_none_or(|owner| self.is_default || self.owner.as_deref() == Some(owner))
    }
}

/// Id of a default world.
fn default_world_id(family: &str, kind: WorldKind) -> String {
    format!("{family}-{}", kind.name())
}

fn is_default_id(id: &str) -> bool {
    let kinds = [WorldKind::Sim, WorldKind::Real];
    families().iter().any(|f| kinds.iter().any(|kind| default_world_id(f.name, *kind) == id))
}

/// Restores a stored world.
fn restore(row: &WorldRow, catalogue: &Catalogue, limits: RequestLimits) -> Result<World> {
    let saved: SavedWorld = json::parse(&row.config)?;
    let latents = row.latents.as_deref().map(json::parse).transpose()?;
    Ok(World::with_limits(limits, saved.config(catalogue)?)?.with_past(row.interactions, latents))
}

fn to_json(saved: &SavedWorld) -> Result<String> {
    serde_json::to_string(saved).map_err(|e| Error::Failed(format!("cannot serialise a world: {e}")))
}

/// Fails if an id is repeated.
fn check_unique(ids: &[String]) -> Result<()> {
    let mut seen = HashMap::with_capacity(ids.len());
    for (i, id) in ids.iter().enumerate() {
        if let Some(first) = seen.insert(id.as_str(), i) {
            let allowed = format!("each world once in a batch; it is also `worlds[{first}]`");
            return Err(Error::input(format!("worlds[{i}]"), format!("{id:?}"), allowed));
        }
    }
    Ok(())
}

fn not_found(id: &str) -> Error {
    Error::NotFound { kind: "world", id: id.to_string(), known: Vec::new() }
}
