//! Worlds by id: those there from the start, those clients make, and those nobody has used for a while. The
//! store has all of them, so that they are there again after a restart.
//!
//! Time is an argument: any clock that counts up from anywhere, so that tests need not wait.

use std::cmp::Reverse;
use std::collections::{BTreeMap, HashMap};
use std::ops::Bound;
use std::sync::{Arc, Mutex};
use std::time::Duration;

use super::catalogue::Catalogue;
use super::config::{Kind, WorldConfig};
use super::limits::RequestLimits;
use super::saved::SavedWorld;
use super::state::lock;
use super::world::World;

use crate::error::{Error, Result};
use crate::json;
use crate::store::{Answered, Store, WorldRow};
use crate::task::families;
use crate::world::{Engine, Latents};

/// Limits of a registry.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RegistryConfig {
    /// Most worlds at a time.
    pub limit: usize,
    /// A world made by a client goes after not being used for so long.
    pub idle: Duration,
    /// What one request may cost in any of them.
    pub request: RequestLimits,
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
    /// Name of the token it was made with.
    pub owner: Option<String>,
    /// When it was last used.
    pub used: Duration,
}

/// In which order worlds are listed, and after which one.
#[derive(Clone, Debug)]
pub enum WorldList {
    ById {
        after: String,
    },
    /// Those used last first; `after`: when one was used, and its id.
    ByUse {
        after: Option<(Duration, String)>,
    },
}

struct Entry {
    world: Arc<World>,
    /// Name of the token it was made with.
    owner: Option<String>,
    /// There from the start; never idles out.
    resident: bool,
    /// When it was last used.
    used: Duration,
}

impl Registry {
    /// A registry of the store's worlds, and of a simulated and a real world of every family: `bowling-sim`,
    /// `bowling-real`, ...
    pub fn new(config: RegistryConfig, catalogue: &Catalogue, store: Arc<Store>) -> Result<Registry> {
        let limits = config.request;
        let registry = Registry { config, store, worlds: Mutex::default() };
        for row in registry.store.worlds()? {
            match again(&row, catalogue, config.request) {
                Ok(world) => drop(registry.insert(&row.id, world, row.owner.as_deref(), Duration::ZERO)),
                // Kept for a version that can make it.
                Err(e) => tracing::warn!("the stored world {} cannot be made again: {e}", row.id),
            }
        }
        for family in families() {
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
                registry.store.add_world(&id, &text(&SavedWorld::of(&config))?, None, None)?;
                registry.insert(&id, World::within(limits, config)?, None, Duration::ZERO);
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
        owner: Option<&str>,
        now: Duration,
        answered: &dyn Fn(&World) -> Option<Answered>,
    ) -> Result<Arc<World>> {
        self.sweep(now)?;
        let saved = text(&SavedWorld::of(&config))?;
        let world = World::within(self.config.request, config)?;
        if lock(&self.worlds).len() >= self.config.limit {
            return Err(self.full());
        }
        self.store.add_world(id, &saved, owner, answered(&world).as_ref())?;
        Ok(self.insert(id, world, owner, now))
    }

    /// Makes and takes in many worlds alike, with the seeds given, all or none of them; as [`Registry::make`].
    pub fn make_many(
        &self,
        ids: &[String],
        config: &WorldConfig,
        seeds: &[u64],
        owner: Option<&str>,
        now: Duration,
        answered: &dyn Fn(&[Listed]) -> Option<Answered>,
    ) -> Result<Vec<Listed>> {
        self.sweep(now)?;
        if lock(&self.worlds).len() + ids.len() > self.config.limit {
            return Err(self.full());
        }
        let (mut rows, mut made) = (Vec::with_capacity(ids.len()), Vec::with_capacity(ids.len()));
        for (id, seed) in ids.iter().zip(seeds) {
            let config = WorldConfig { seed: *seed, ..config.clone() };
            rows.push((id.as_str(), text(&SavedWorld::of(&config))?));
            let world = Arc::new(World::within(self.config.request, config)?.kept_in(self.store.clone(), id));
            made.push(Listed { id: id.clone(), world, owner: owner.map(String::from), used: now });
        }
        self.store.add_worlds(&rows, owner, answered(&made).as_ref())?;
        let mut worlds = lock(&self.worlds);
        for l in &made {
            let owner = owner.map(String::from);
            worlds.insert(l.id.clone(), Entry { world: l.world.clone(), owner, resident: false, used: now });
        }
        Ok(made)
    }

    /// The world called `id`, whosever it is; counts as use.
    pub fn get(&self, id: &str, now: Duration) -> Result<Arc<World>> {
        self.of(id, None, now)
    }

    /// The same; one that is neither `owner`'s, if one is given, nor everybody's is as good as none.
    pub fn of(&self, id: &str, owner: Option<&str>, now: Duration) -> Result<Arc<World>> {
        self.used(&mut lock(&self.worlds), id, owner, now)
    }

    /// Whether the world called `id` is there from the start, for everybody.
    pub fn is_resident(&self, id: &str) -> bool {
        lock(&self.worlds).get(id).is_some_and(|entry| entry.resident)
    }

    /// The worlds with these ids, different ones; counts as use. Errors name `worlds[i]`.
    pub fn get_many(&self, ids: &[String], owner: Option<&str>, now: Duration) -> Result<Vec<Arc<World>>> {
        once_each(ids)?;
        let mut worlds = lock(&self.worlds);
        let one = |(i, id): (usize, &String)| {
            self.used(&mut worlds, id, owner, now).map_err(|e| e.of_entry(&format!("worlds[{i}]")))
        };
        ids.iter().enumerate().map(one).collect()
    }

    fn used(
        &self,
        worlds: &mut BTreeMap<String, Entry>,
        id: &str,
        owner: Option<&str>,
        now: Duration,
    ) -> Result<Arc<World>> {
        let entry = worlds.get_mut(id).filter(|e| e.seen_by(owner)).ok_or_else(|| unknown(id))?;
        if self.idled_out(entry, now) {
            // Gone for everybody; the next sweep clears it away.
            return Err(unknown(id));
        }
        entry.used = now;
        Ok(entry.world.clone())
    }

    /// At most `limit` worlds; one owner's and those that everybody shares, or all.
    pub fn list(
        &self,
        list: &WorldList,
        limit: usize,
        owner: Option<&str>,
        now: Duration,
    ) -> Result<Vec<Listed>> {
        self.sweep(now)?;
        let worlds = lock(&self.worlds);
        let listed = |(id, e): (&String, &Entry)| e.listed(id);
        let seen = |(_, e): &(&String, &Entry)| e.seen_by(owner);
        match list {
            WorldList::ById { after } => {
                let from = (Bound::Excluded(after.clone()), Bound::Unbounded);
                Ok(worlds.range(from).filter(seen).take(limit).map(listed).collect())
            }
            WorldList::ByUse { after } => {
                let rank = |(id, e): &(&String, &Entry)| (Reverse(e.used), (*id).clone());
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

    /// The world called `id` as it is listed; looking is no use.
    pub fn look(&self, id: &str, owner: Option<&str>, now: Duration) -> Result<Listed> {
        let worlds = lock(&self.worlds);
        let entry = worlds.get(id).filter(|e| e.seen_by(owner) && !self.idled_out(e, now));
        Ok(entry.ok_or_else(|| unknown(id))?.listed(id))
    }

    /// Forgets a world; work under way on it ends as it would have.
    pub fn remove(&self, id: &str, owner: Option<&str>) -> Result<()> {
        if !lock(&self.worlds).get(id).is_some_and(|e| e.seen_by(owner)) {
            return Err(unknown(id));
        }
        self.store.remove_worlds(&[id.to_string()])?;
        lock(&self.worlds).remove(id).map(drop).ok_or_else(|| unknown(id))
    }

    /// Forgets worlds, all of them or none.
    pub fn remove_many(&self, ids: &[String], owner: Option<&str>) -> Result<()> {
        once_each(ids)?;
        {
            let worlds = lock(&self.worlds);
            if let Some(i) = ids.iter().position(|id| !worlds.get(id).is_some_and(|e| e.seen_by(owner))) {
                return Err(unknown(&ids[i]).of_entry(&format!("worlds[{i}]")));
            }
        }
        self.store.remove_worlds(ids)?;
        let mut worlds = lock(&self.worlds);
        let gone: Vec<Entry> = ids.iter().filter_map(|id| worlds.remove(id)).collect();
        drop(worlds);
        drop(gone);
        Ok(())
    }

    /// Forgets the worlds that have idled out; returns how many.
    pub fn sweep(&self, now: Duration) -> Result<usize> {
        let mut gone = Vec::new();
        lock(&self.worlds).retain(|id, entry| {
            if Arc::strong_count(&entry.world) > 1 {
                entry.used = now;
            }
            entry.world.lookout.sweep(now);
            let gone_out = self.idled_out(entry, now);
            if gone_out {
                gone.push(id.clone());
            }
            !gone_out
        });
        self.store.remove_worlds(&gone)?;
        Ok(gone.len())
    }

    /// Whether nobody has used a world for too long; one that work is under way on is in use.
    fn idled_out(&self, entry: &Entry, now: Duration) -> bool {
        let in_use = entry.resident || Arc::strong_count(&entry.world) > 1;
        !in_use && now.saturating_sub(entry.used) > self.config.idle
    }

    fn full(&self) -> Error {
        let advice = "delete one you no longer need, or try again when idle ones are gone";
        Error::Capacity { what: "worlds", limit: self.config.limit, advice }
    }

    fn insert(&self, id: &str, world: World, owner: Option<&str>, now: Duration) -> Arc<World> {
        let world = Arc::new(world.kept_in(self.store.clone(), id));
        let resident =
            families().iter().any(|f| [Kind::Sim, Kind::Real].iter().any(|k| resident(f.name, *k) == id));
        let owner = owner.map(String::from);
        lock(&self.worlds).insert(id.into(), Entry { world: world.clone(), owner, resident, used: now });
        world
    }
}

impl Entry {
    fn listed(&self, id: &str) -> Listed {
        Listed { id: id.into(), world: self.world.clone(), owner: self.owner.clone(), used: self.used }
    }

    /// Whether `owner` sees it; `None` sees everything.
    fn seen_by(&self, owner: Option<&str>) -> bool {
        owner.is_none_or(|owner| self.resident || self.owner.as_deref() == Some(owner))
    }
}

/// Id of a world that is there from the start.
fn resident(family: &str, kind: Kind) -> String {
    format!("{family}-{}", kind.name())
}

/// A stored world, made again.
fn again(row: &WorldRow, catalogue: &Catalogue, limits: RequestLimits) -> Result<World> {
    let saved: SavedWorld = json::parse(&row.config)?;
    let latents = row.latents.as_deref().map(json::parse).transpose()?;
    Ok(World::within(limits, saved.config(catalogue)?)?.with_past(row.interactions, latents))
}

fn text(saved: &SavedWorld) -> Result<String> {
    serde_json::to_string(saved).map_err(|e| Error::Failed(format!("a world cannot be written: {e}")))
}

/// Errors where an id stands twice.
fn once_each(ids: &[String]) -> Result<()> {
    let mut seen = HashMap::with_capacity(ids.len());
    for (i, id) in ids.iter().enumerate() {
        if let Some(first) = seen.insert(id.as_str(), i) {
            let allowed = format!("each world once in a batch; it is `worlds[{first}]` too");
            return Err(Error::input(format!("worlds[{i}]"), format!("{id:?}"), allowed));
        }
    }
    Ok(())
}

fn unknown(id: &str) -> Error {
    Error::NotFound { kind: "world", id: id.to_string(), known: Vec::new() }
}
