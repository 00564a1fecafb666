//! The desk at which an agent's wishes become operations: what it may do, its real worlds with their budgets, and its jobs.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::{Mutex, MutexGuard, PoisonError};

use rmcp::schemars::JsonSchema;
use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};
use serde_json::{Map, Value, json};

use super::here::{Given, Here};
use crate::access::Scope;
use crate::error::Error;
use crate::serve::operations::operation;
use crate::serve::problem::{Answer, Problem};

/// One agent's.
pub struct Desk {
    way: Here,
    may: Scope,
    /// Most real interactions in the real world of each family.
    most: u64,
    /// The real world of each family; held while one is looked for or made, so that there is one.
    real: tokio::sync::Mutex<BTreeMap<String, RealWorld>>,
    /// Explorations under way: what is explored, and the job that proposes.
    explored: Mutex<BTreeMap<String, String>>,
    /// Jobs that somebody here waits for.
    begun: Mutex<BTreeSet<String>>,
}

/// A family's real world, and what was spent of its budget.
#[derive(Clone, Default)]
struct RealWorld {
    /// None before it is made.
    id: Option<String>,
    /// Made in worlds of the family before this one.
    before: u64,
    /// Made in all, as last seen.
    spent: u64,
}

/// What is read of a world.
#[derive(Deserialize)]
struct World {
    id: String,
    owner: Option<String>,
    task: String,
    kind: String,
    interactions: u64,
    budget: Option<u64>,
}

#[derive(Deserialize)]
struct Worlds {
    worlds: Vec<World>,
    next: Option<String>,
}

impl Desk {
    /// With what an agent may do at most, and what it may spend in the real world of each family.
    pub fn new(way: Here, may: Scope, most: u64) -> Desk {
        Desk {
            way,
            may,
            most,
            real: Default::default(),
            explored: Default::default(),
            begun: Default::default(),
        }
    }

    /// Asks for an operation by name; fields that are null are as good as absent.
    pub async fn ask(&self, name: &str, fields: Value) -> Answer<Given> {
        let operation = operation(name)?;
        let Value::Object(fields) = fields else { return Err(Problem::defect()) };
        let fields: Map<String, Value> = fields.into_iter().filter(|(_, v)| !v.is_null()).collect();
        if let Some(needs) = operation.needs.filter(|needs| *needs > self.may) {
            let (may, needs) = (self.may.name(), needs.name());
            let reason = format!("this agent may {may}; that takes one that may {needs}");
            return Err(Error::Denied { reason }.into());
        }
        self.way.ask(operation, fields).await
    }

    /// The same, as what is known of the answer.
    pub async fn read<T: DeserializeOwned>(&self, name: &str, fields: Value) -> Answer<T> {
        let value = self.ask(name, fields).await?.value()?;
        serde_json::from_value(value).map_err(Problem::unwritable)
    }

    /// The id of a family's real world, and what may still be spent there. It is made when it is first needed.
    pub async fn real_world(&self, family: &str) -> Answer<(String, Budget)> {
        let mut real = self.real.lock().await;
        let mut world = self.known(&mut real, family).await?;
        if let Some(id) = world.id.take() {
            match self.read::<World>("get_world", json!({"id": id})).await {
                Ok(seen) => {
                    world.spent = world.before + seen.interactions;
                    let budget = self.budget(world.spent);
                    real.insert(family.into(), RealWorld { id: Some(id.clone()), ..world });
                    return Ok((id, budget));
                }
                // Gone with its counter, which is remembered here.
                Err(problem) if problem.status == 404 => world.before = world.spent,
                Err(problem) => return Err(problem),
            }
        }
        let budget = self.budget(world.before);
        let wish = json!({"task": family, "kind": "real", "budget": budget.remaining});
        let made: World = self.read("create_world", wish).await?;
        real.insert(family.into(), RealWorld { id: Some(made.id.clone()), ..world });
        Ok((made.id, budget))
    }

    /// What was spent of a family's budget; no world is made.
    pub async fn spent(&self, family: &str) -> Answer<Budget> {
        let mut real = self.real.lock().await;
        let world = self.known(&mut real, family).await?;
        Ok(self.budget(world.spent))
    }

    /// Takes note of a counter that an operation told.
    pub async fn note(&self, family: &str, interactions: u64) -> Budget {
        let mut real = self.real.lock().await;
        let world = real.entry(family.into()).or_default();
        world.spent = world.spent.max(world.before + interactions);
        self.budget(world.spent)
    }

    fn budget(&self, spent: u64) -> Budget {
        Budget { limit: self.most, spent, remaining: self.most.saturating_sub(spent) }
    }

    /// What is known of a family's real world, by an agent before this one too: counters go on.
    async fn known(&self, real: &mut BTreeMap<String, RealWorld>, family: &str) -> Answer<RealWorld> {
        if let Some(known) = real.get(family) {
            return Ok(known.clone());
        }
        let found = if self.way.lasts() { self.find(family).await? } else { RealWorld::default() };
        real.insert(family.into(), found.clone());
        Ok(found)
    }

    /// Of the worlds that agents made on this data directory: all that was spent, and the world with what is left.
    async fn find(&self, family: &str) -> Answer<RealWorld> {
        let (mut own, mut cursor) = (Vec::new(), Value::Null);
        loop {
            let page: Worlds = self.read("list_worlds", json!({"limit": 1000, "cursor": cursor})).await?;
            let fits = |w: &World| w.kind == "real" && w.task == family && w.owner.is_some();
            own.extend(page.worlds.into_iter().filter(fits).filter_map(|w| Some((w.budget?, w))));
            match page.next {
                Some(next) => cursor = next.into(),
                None => break,
            }
        }
        let spent = own.iter().map(|(_, w)| w.interactions).sum();
        let left = self.budget(spent).remaining;
        let with_it = own.into_iter().find(|(budget, w)| budget.saturating_sub(w.interactions) == left);
        Ok(match with_it {
            Some((_, w)) => RealWorld { id: Some(w.id), before: spent - w.interactions, spent },
            None => RealWorld { id: None, before: spent, spent },
        })
    }

    /// The job that proposes what to measure in what is explored.
    pub fn exploration(&self, explored: &str) -> Option<String> {
        lock(&self.explored).get(explored).cloned()
    }

    /// Takes note of it; the job that proposed before, if there was one.
    pub fn explores(&self, explored: &str, job: Option<&str>) -> Option<String> {
        let mut all = lock(&self.explored);
        match job {
            Some(job) => all.insert(explored.into(), job.into()),
            None => all.remove(explored),
        }
    }

    /// Somebody waits for a job.
    pub fn begun(&self, job: &str) {
        lock(&self.begun).insert(job.into());
    }

    /// Nobody waits for it any more.
    pub fn over(&self, job: &str) {
        lock(&self.begun).remove(job);
    }

    /// Cancels a job that nobody waits for any more, or forgets one that has ended.
    pub async fn give_up(&self, job: &str) {
        if let Err(problem) = self.ask("delete_job", json!({"id": job})).await {
            tracing::warn!("{job} could not be cancelled: {}", problem.detail);
        }
    }

    /// The agent is gone: nobody waits for its jobs.
    pub async fn close(&self) {
        let mut jobs = std::mem::take(&mut *lock(&self.begun));
        jobs.extend(std::mem::take(&mut *lock(&self.explored)).into_values());
        for job in jobs {
            self.give_up(&job).await;
        }
    }
}

/// Real interactions in the real world of a family.
#[derive(Clone, Copy, Serialize, JsonSchema)]
#[schemars(crate = "rmcp::schemars")]
pub struct Budget {
    /// Most of them.
    pub limit: u64,
    /// Made so far, by `measure` and `estimate`.
    pub spent: u64,
    /// Still allowed.
    pub remaining: u64,
}

impl Budget {
    /// In words.
    pub fn words(self) -> String {
        format!("{} of {} real interactions are left.", self.remaining, self.limit)
    }
}

/// The family of a task: `bowling` of `bowling:017`.
pub fn family(task: &str) -> &str {
    task.split(':').next().unwrap_or(task)
}

fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}
