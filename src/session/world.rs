//! A world: tasks, physics and the state of the current episode.
//!
//! Its fields are private; methods that need them are in submodules.

mod attempt;
mod branch;
mod episode;
mod interventions;
mod recording;
mod vector;

pub use attempt::{AttemptResult, PersistResults, RolloutRequest, RolloutResults};
pub use branch::{BranchResult, SNAPSHOT_FORMAT, Snapshot, SnapshotRequest};
pub use episode::{EpisodeStart, Reset, StepResult};
pub use vector::{Autoreset, BatchStepResult, reset_many, step_many};

use std::sync::{Arc, Mutex, TryLockError};

use super::catalogue::TaskSet;
use super::config::{WorldConfig, WorldKind};
use super::limits::{MAX_INLINE_BODY_STEPS, RequestLimits, rollout_work};
use super::state::{Phase, WorldState, conflict};
use super::watch::{EventBus, WorldEventKind, WorldWatcher};
use crate::error::{Error, Result, check_count, check_range};
use crate::reality::{HiddenConfig, HiddenWorld, real_world};
use crate::rng;
use crate::store::Store;
use crate::sync::lock;
use crate::task::scene::EffectTerm;
use crate::task::{ActionSpace, Family, Task};
use crate::world::{Engine, Latents, Rollout, effect, select_engine};

/// Largest maximum number of attempts in an episode.
const MAX_ATTEMPTS: u64 = 10_000;

/// A world in which tasks can be attempted.
pub struct World {
    tasks: TaskSet,
    kind: WorldKind,
    engine: Engine,
    sealed: bool,
    seed: u64,
    budget: Option<u64>,
    /// Maximum number of valid attempts in an episode.
    max_attempts: u32,
    /// Of a simulation or an unsealed real world; empty if sealed.
    effects: Vec<EffectTerm>,
    /// Length of an observation.
    features: usize,
    /// Work of the longest rollout, body-time-steps.
    max_body_steps: u64,
    hidden: Option<Mutex<HiddenWorld>>,
    /// Limits of one request.
    limits: RequestLimits,
    /// Where the counter is persisted, if anywhere.
    account: Option<PersistedCounter>,
    /// Family whose default real world has the same hidden physics.
    copied_family: Option<&'static Family>,
    /// The default world of that family: attempts in a copy count there, too.
    original: Option<Arc<World>>,
    /// Publishes events to watchers.
    events: EventBus,
    /// Held during a whole reset, step or change of latents, so that each action belongs to exactly one episode.
    turn: Mutex<()>,
    /// Held only briefly; always the last lock acquired.
    state: Mutex<WorldState>,
}

/// Where a world's counter is persisted.
pub(super) struct PersistedCounter {
    pub store: Arc<Store>,
    pub id: String,
}

/// A world's public properties.
pub struct WorldDescription {
    pub task: String,
    pub kind: WorldKind,
    pub engine: Engine,
    pub sealed: bool,
    /// `None` if sealed.
    pub latents: Option<Latents>,
    /// `None` if sealed.
    pub effects: Option<Vec<EffectTerm>>,
    /// Valid attempts so far, by steps, rollouts, renders and jobs.
    pub interactions: u64,
    pub budget: Option<u64>,
    /// Maximum number of valid attempts in an episode.
    pub max_attempts: u32,
    pub seed: u64,
    /// Common to all tasks of the world.
    pub actions: ActionSpace,
    /// Names of the observation's features.
    pub features: Vec<String>,
    /// Id of the current task.
    pub current: Option<String>,
    pub phase: Phase,
    /// Resets so far.
    pub episodes: u64,
}

impl WorldDescription {
    /// Without latents and effects.
    pub fn without_physics(self) -> WorldDescription {
        WorldDescription { latents: None, effects: None, ..self }
    }
}

impl World {
    /// Creates a world; errors name the field of `config` that is out of range.
    pub fn new(config: WorldConfig) -> Result<World> {
        World::with_limits(RequestLimits::STANDARD, config)
    }

    /// [`World::new`] with given limits of one request.
    pub fn with_limits(limits: RequestLimits, config: WorldConfig) -> Result<World> {
        let sealed = config.sealed.unwrap_or(config.kind == WorldKind::Real);
        for task in config.tasks.tasks.iter() {
            limits.check_cost(&task.scene, 1, true)?;
        }
        config.latents.validate()?;
        check_count("max_attempts", Some(u64::from(config.max_attempts)), 1, MAX_ATTEMPTS)?;
        check_engine(&config)?;
        let copied_family = copied_family(&config);
        let (latents, effects, hidden) = match config.kind {
            WorldKind::Sim => {
                if config.noise != 0.0 {
                    return Err(Error::input("noise", config.noise, "0 for a simulated world"));
                }
                if let Some(budget) = config.budget {
                    let allowed = "null for a simulated world, where attempts are free";
                    return Err(Error::input("budget", budget, allowed));
                }
                let effects = config.effects.unwrap_or_default();
                for (i, term) in effects.iter().enumerate() {
                    effect::resolve(term, format_args!("effects[{i}]"))?;
                }
                let prior = config.tasks.family.map(|f| Latents::of(f.prior_means()));
                (config.latents.or(prior.unwrap_or_default()), effects, None)
            }
            WorldKind::Real => {
                let hidden = hidden_config(&config)?;
                let shown = (!sealed).then(|| (hidden.latents, hidden.effects.clone()));
                let (latents, effects) = shown.unwrap_or_default();
                (latents, effects, Some(Mutex::new(HiddenWorld::new(hidden)?)))
            }
        };
        let scenes = config.tasks.tasks.iter().map(|t| &t.scene);
        Ok(World {
            copied_family,
            original: None,
            features: config.tasks.feature_names().len(),
            max_body_steps: scenes.map(rollout_work).max().unwrap_or(0),
            tasks: config.tasks,
            kind: config.kind,
            engine: config.engine,
            sealed,
            seed: config.seed,
            budget: config.budget,
            max_attempts: config.max_attempts,
            effects,
            hidden,
            limits,
            account: None,
            events: EventBus::default(),
            turn: Mutex::new(()),
            state: Mutex::new(WorldState {
                latents,
                phase: Phase::New,
                task: None,
                split: None,
                episodes: 0,
                attempts: 0,
                interactions: 0,
                resets: rng::stream(config.seed, "reset"),
                last: None,
            }),
        })
    }

    /// Sets the given latent factors, durably; an error for real and sealed worlds.
    pub fn set_latents(&self, latents: Latents) -> Result<()> {
        if self.kind == WorldKind::Real || self.sealed {
            return Err(Error::Sealed {
                reason: "the latents of a real or sealed world cannot be set; \
                         set them in a simulated world and compare"
                    .into(),
            });
        }
        latents.validate()?;
        // Concurrent changes are stored, applied and published in the same order.
        let _turn = lock(&self.turn);
        let (latents, interactions) = {
            let state = lock(&self.state);
            (latents.or(state.latents), state.interactions)
        };
        if let Some(account) = &self.account {
            let text = serde_json::to_string(&latents).map_err(|e| Error::Failed(e.to_string()))?;
            account.store.set_world_latents(&account.id, interactions, &text)?;
        }
        let interactions = {
            let mut state = lock(&self.state);
            state.latents = latents;
            state.interactions
        };
        self.events.publish(interactions, || WorldEventKind::Latents(latents));
        Ok(())
    }

    /// The world's public properties.
    pub fn describe(&self) -> WorldDescription {
        let state = lock(&self.state);
        let first = &self.tasks.tasks[0];
        WorldDescription {
            task: self.tasks.name.clone(),
            kind: self.kind,
            engine: self.engine,
            sealed: self.sealed,
            latents: (!self.sealed).then_some(state.latents),
            effects: (!self.sealed).then(|| self.effects.clone()),
            interactions: state.interactions,
            budget: self.budget,
            max_attempts: self.max_attempts,
            seed: self.seed,
            actions: first.actions().clone(),
            features: self.tasks.feature_names(),
            current: state.task.map(|t| self.tasks.tasks[t].id.clone()),
            phase: state.phase,
            episodes: state.episodes,
        }
    }

    /// Whether a step takes a fraction of a millisecond and waits neither for the disk nor for another client.
    pub fn runs_inline(&self) -> bool {
        self.hidden.is_none()
            && self.max_body_steps <= MAX_INLINE_BODY_STEPS
            && !matches!(self.turn.try_lock(), Err(TryLockError::WouldBlock))
    }

    /// Simulated or real.
    pub fn kind(&self) -> WorldKind {
        self.kind
    }

    /// The tasks that the world can be reset to.
    pub fn tasks(&self) -> &TaskSet {
        &self.tasks
    }

    /// Length of an observation.
    pub fn features(&self) -> usize {
        self.features
    }

    /// Valid attempts so far.
    pub fn interactions(&self) -> u64 {
        lock(&self.state).interactions
    }

    /// Maximum number of valid attempts.
    pub fn budget(&self) -> Option<u64> {
        self.budget
    }

    /// Remaining valid attempts.
    pub fn remaining(&self) -> Option<u64> {
        self.budget.map(|b| b.saturating_sub(self.interactions()))
    }

    /// Subscribes to events: buffered ones after event number `after` (0 for all), then new ones.
    pub fn watch(&self, after: u64) -> WorldWatcher {
        self.events.watch(after)
    }

    /// The publisher of the world's events.
    pub(super) fn events(&self) -> &EventBus {
        &self.events
    }

    /// Restores the counter and, in a simulation, the latents.
    pub fn with_past(mut self, interactions: u64, latents: Option<Latents>) -> World {
        let state = self.state.get_mut().unwrap_or_else(std::sync::PoisonError::into_inner);
        state.interactions = interactions;
        if self.kind == WorldKind::Sim {
            state.latents = latents.unwrap_or_default().or(state.latents);
        }
        if let Some(hidden) = self.hidden.take() {
            let hidden = hidden.into_inner().unwrap_or_else(std::sync::PoisonError::into_inner);
            self.hidden = Some(std::sync::Mutex::new(hidden.with_spent(interactions)));
        }
        self
    }

    /// Persists the world's counter in the store under `id`.
    pub(super) fn with_account(mut self, store: Arc<Store>, id: &str) -> World {
        self.account = Some(PersistedCounter { store, id: id.into() });
        self
    }

    /// Family whose default real world has the same hidden physics: this world is a copy of it.
    pub(super) fn copied_family(&self) -> Option<&'static Family> {
        self.copied_family
    }

    /// A copy whose attempts count in the original, too.
    pub(super) fn with_original(mut self, original: Option<Arc<World>>) -> World {
        self.original = original;
        self
    }

    /// Counts attempts in a real world and in the one that it copies, of which the counter is written with the next one;
    /// returns the counter.
    fn count_measured(&self, attempts: u64) -> u64 {
        if let Some(original) = self.original.as_ref().filter(|_| attempts > 0) {
            let interactions = original.count_measured(attempts);
            if let Some(account) = &original.account {
                account.store.note_world(&account.id, interactions);
            }
        }
        let mut state = lock(&self.state);
        state.interactions += attempts;
        state.interactions
    }

    /// Writes the counter of the world that this one copies.
    fn write_original(&self) -> Result<()> {
        let account = self.original.as_ref().and_then(|world| world.account.as_ref());
        account.map_or(Ok(()), |account| account.store.flush_worlds())
    }

    pub(super) fn task_or_current(&self, id: Option<&str>) -> Result<(&Task, Latents)> {
        let state = lock(&self.state);
        let index = match id {
            Some(id) => self.tasks.find(id)?,
            None if self.tasks.tasks.len() == 1 => 0,
            None => state
                .task
                .ok_or_else(|| conflict("no current task; reset the world first, or give a `task`"))?,
        };
        Ok((&self.tasks.tasks[index], state.latents))
    }
}

impl Drop for World {
    fn drop(&mut self) {
        let interactions = lock(&self.state).interactions;
        self.events.publish(interactions, || WorldEventKind::Deleted);
    }
}

/// Physics of a real world: the client's, elsewhere the family's or the custom scene's.
fn hidden_config(config: &WorldConfig) -> Result<HiddenConfig> {
    check_sealing(config)?;
    let base = config.tasks.family.map_or_else(custom_scene_config, |f| real_world(f, config.seed));
    Ok(HiddenConfig {
        latents: config.latents.or(base.latents),
        effects: config.effects.clone().unwrap_or(base.effects),
        engine: config.engine,
        noise: check_range("noise", config.noise, 0.0, 1e3)?,
        budget: config.budget,
        seed: config.seed,
    })
}

/// The family whose default real world has the same hidden physics, if the client has not replaced all of it.
fn copied_family(config: &WorldConfig) -> Option<&'static Family> {
    let family =
        config.tasks.family.filter(|_| config.kind == WorldKind::Real && !has_own_physics(config))?;
    let (own, default) = (real_world(family, config.seed), real_world(family, 0));
    (own.latents == default.latents && own.effects == default.effects).then_some(family)
}

/// Whether the client has given all latents and effects.
fn has_own_physics(config: &WorldConfig) -> bool {
    config.latents.values().iter().all(Option::is_some) && config.effects.is_some()
}

/// Base configuration of a real world with a custom scene: the scene's own coefficients and effects.
fn custom_scene_config() -> HiddenConfig {
    HiddenConfig {
        latents: Latents::default(),
        effects: Vec::new(),
        engine: Engine::Auto,
        noise: 0.0,
        budget: None,
        seed: 0,
    }
}

/// Errors if the world would show hidden physics of its family.
fn check_sealing(config: &WorldConfig) -> Result<()> {
    if config.sealed != Some(false) || config.tasks.family.is_none() || has_own_physics(config) {
        return Ok(());
    }
    let allowed = "true for a real world of a family, whose physics is hidden, \
                   or all three latents and the effects of your own";
    Err(Error::input("sealed", false, allowed))
}

/// Fails now rather than at the first step if the engine does not support the world's scenes.
fn check_engine(config: &WorldConfig) -> Result<()> {
    let mut scene = config.tasks.tasks[0].scene.clone();
    for body in &mut scene.bodies {
        // The action sets it; any position will do for the check.
        body.position.get_or_insert([0.0, 0.0]);
    }
    let effects = config.effects.as_deref().unwrap_or_default();
    select_engine(config.engine, &Rollout { latents: config.latents, effects, ..Rollout::of(&scene) })
        .map(drop)
}
