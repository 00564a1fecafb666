//! Session of an agent: its scope, real worlds with budgets, and jobs.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::Mutex;

use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};
use serde_json::{Map, Value, json};
use utoipa::ToSchema;

use super::local_client::LocalClient;
use crate::access::Scope;
use crate::error::{Error, Result};
use crate::serve::operations::operation;
use crate::serve::problem::{HandlerResult, Problem};
use crate::sync::lock;

/// The session of one agent.
pub struct AgentSession {
    client: LocalClient,
    scope: Scope,
    /// Maximum number of real interactions per family.
    max_interactions: u64,
    /// The real world of each family; locked while one is searched or created, so that there is only one.
    real: tokio::sync::Mutex<BTreeMap<String, FamilyWorld>>,
    /// Running explorations: the explored task or family, and the job that proposes.
    explored: Mutex<BTreeMap<String, String>>,
    /// Jobs with a waiting call.
    awaited: Mutex<BTreeSet<String>>,
}

/// A family's real world with its interactions.
#[derive(Clone, Default)]
struct FamilyWorld {
    /// None before it is created.
    id: Option<String>,
    /// Interactions in earlier worlds of the family.
    before: u64,
    /// Total interactions, as last seen.
    spent: u64,
}

/// The fields of a world that are needed here.
#[derive(Deserialize)]
struct WorldInfo {
    id: String,
    owner: Option<String>,
    task: String,
    kind: String,
    interactions: u64,
    budget: Option<u64>,
}

#[derive(Deserialize)]
struct WorldInfoPage {
    worlds: Vec<WorldInfo>,
    next: Option<String>,
}

impl AgentSession {
    /// With the agent's maximum scope and its interaction limit per family.
    pub fn new(client: LocalClient, scope: Scope, max_interactions: u64) -> AgentSession {
        AgentSession {
            client,
            scope,
            max_interactions,
            real: Default::default(),
            explored: Default::default(),
            awaited: Default::default(),
        }
    }

    /// Calls an operation by name and returns the body of its response; null fields are omitted.
    pub async fn ask(&self, name: &str, fields: Value) -> HandlerResult<Vec<u8>> {
        let operation = operation(name)?;
        let Value::Object(fields) = fields else { return Err(Problem::internal()) };
        let fields: Map<String, Value> = fields.into_iter().filter(|(_, v)| !v.is_null()).collect();
        if let Some(needs) = operation.required_scope.filter(|needs| *needs > self.scope) {
            let (scope, needs) = (self.scope.name(), needs.name());
            let reason = format!("this agent has the scope {scope}; the operation requires {needs}");
            return Err(Error::Denied { reason }.into());
        }
        self.client.ask(operation, fields).await
    }

    /// Calls an operation and parses its response.
    pub async fn read<T: DeserializeOwned>(&self, name: &str, fields: Value) -> HandlerResult<T> {
        serde_json::from_slice(&self.ask(name, fields).await?).map_err(Problem::serialization)
    }

    /// The id and budget of a family's real world, which is created on first use.
    pub async fn real_world(&self, family: &str) -> HandlerResult<(String, InteractionBudget)> {
        let mut real = self.real.lock().await;
        let mut world = self.load_world(&mut real, family).await?;
        if let Some(id) = world.id.take() {
            match self.read::<WorldInfo>("get_world", json!({"id": id})).await {
                Ok(seen) => {
                    world.spent = world.before + seen.interactions;
                    let budget = self.budget(world.spent);
                    real.insert(family.into(), FamilyWorld { id: Some(id.clone()), ..world });
                    return Ok((id, budget));
                }
                // The world is gone with its counter; count its interactions as earlier ones.
                Err(problem) if problem.status == 404 => world.before = world.spent,
                Err(problem) => return Err(problem),
            }
        }
        let budget = self.budget(world.before);
        let request = json!({"task": family, "kind": "real", "budget": budget.remaining});
        let made: WorldInfo = self.read("create_world", request).await?;
        real.insert(family.into(), FamilyWorld { id: Some(made.id.clone()), ..world });
        Ok((made.id, budget))
    }

    /// A family's budget, without creating a world.
    pub async fn spent(&self, family: &str) -> HandlerResult<InteractionBudget> {
        let mut real = self.real.lock().await;
        let world = self.load_world(&mut real, family).await?;
        Ok(self.budget(world.spent))
    }

    /// Records the interaction counter returned by an operation.
    pub async fn record_interactions(&self, family: &str, interactions: u64) -> InteractionBudget {
        let mut real = self.real.lock().await;
        let world = real.entry(family.into()).or_default();
        world.spent = world.spent.max(world.before + interactions);
        self.budget(world.spent)
    }

    fn budget(&self, spent: u64) -> InteractionBudget {
        InteractionBudget {
            limit: self.max_interactions,
            spent,
            remaining: self.max_interactions.saturating_sub(spent),
        }
    }

    /// Loads a family's real world, including one of an earlier agent, so that counters continue.
    async fn load_world(
        &self,
        real: &mut BTreeMap<String, FamilyWorld>,
        family: &str,
    ) -> HandlerResult<FamilyWorld> {
        if let Some(known) = real.get(family) {
            return Ok(known.clone());
        }
        let found = self.find_world(family).await?;
        real.insert(family.into(), found.clone());
        Ok(found)
    }

    /// Searches the agents' worlds in this data directory: total interactions, and the world with the remaining budget.
    async fn find_world(&self, family: &str) -> HandlerResult<FamilyWorld> {
        let (mut own, mut cursor) = (Vec::new(), Value::Null);
        loop {
            let page: WorldInfoPage =
                self.read("list_worlds", json!({"limit": 1000, "cursor": cursor})).await?;
            let fits = |w: &WorldInfo| w.kind == "real" && w.task == family && w.owner.is_some();
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
            Some((_, w)) => FamilyWorld { id: Some(w.id), before: spent - w.interactions, spent },
            None => FamilyWorld { id: None, before: spent, spent },
        })
    }

    /// The job that proposes actions for an exploration.
    pub fn exploration(&self, explored: &str) -> Option<String> {
        lock(&self.explored).get(explored).cloned()
    }

    /// The job that proposes actions for an exploration; if there is none, the error names `field`.
    pub fn require_exploration(&self, field: &str, explored: &str) -> Result<String> {
        self.exploration(explored).ok_or_else(|| {
            let allowed =
                "a task or family with an exploration, as returned by propose_actions in `explored`";
            Error::input(field, format!("{explored:?}"), allowed)
        })
    }

    /// Sets or removes the job of an exploration and returns the previous one.
    pub fn set_exploration(&self, explored: &str, job: Option<&str>) -> Option<String> {
        let mut all = lock(&self.explored);
        match job {
            Some(job) => all.insert(explored.into(), job.into()),
            None => all.remove(explored),
        }
    }

    /// Registers a job with a waiting call.
    pub fn track_job(&self, job: &str) {
        lock(&self.awaited).insert(job.into());
    }

    /// Unregisters a job.
    pub fn untrack_job(&self, job: &str) {
        lock(&self.awaited).remove(job);
    }

    /// Cancels a job, or deletes one that has ended.
    pub async fn cancel_job(&self, job: &str) {
        if let Err(problem) = self.ask("delete_job", json!({"id": job})).await {
            tracing::warn!("{job} could not be cancelled: {}", problem.detail);
        }
    }

    /// Cancels all jobs when the agent disconnects.
    pub async fn close(&self) {
        let mut jobs = std::mem::take(&mut *lock(&self.awaited));
        jobs.extend(std::mem::take(&mut *lock(&self.explored)).into_values());
        for job in jobs {
            self.cancel_job(&job).await;
        }
    }
}

/// Budget of real interactions of a family.
#[derive(Clone, Copy, Serialize, ToSchema)]
pub struct InteractionBudget {
    /// Maximum number of real interactions.
    pub limit: u64,
    /// Used so far, by `measure` and `estimate`.
    pub spent: u64,
    /// Remaining number.
    pub remaining: u64,
}

impl InteractionBudget {
    /// As a sentence.
    pub fn summary(self) -> String {
        format!("{} of {} real interactions remain.", self.remaining, self.limit)
    }
}

/// The family of a task: `bowling` of `bowling:017`.
pub fn family(task: &str) -> &str {
    task.split(':').next().unwrap_or(task)
}
