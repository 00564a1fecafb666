//! Gymnasium's reset and step over a task and a world, without any transport.
//!
//! A [`World`] is what a client acts in: a set of tasks, the physics (a simulation whose latents may be set, or
//! a hidden real one) and the state of the current episode. All of its methods take `&self`: clients may share
//! a world, and counting and episodes stay right.
//!
//! | phase | `step` | after |
//! |---|---|---|
//! | `New` | refused | `reset` makes it `Ready` |
//! | `Ready` | a valid action is an attempt and ends the episode; an unplaceable one changes nothing | `Done` or `Ready` |
//! | `Done` | refused | `reset` makes it `Ready` |
//!
//! Worlds of a [`Registry`] outlive the process: what they are made from is stored when they are made, and a real
//! world's counter before a result of it is given out, so that no interaction that anybody knows of is ever
//! forgotten and a budget never overdrawn. (One whose result was lost with the process had no effect and is not
//! counted.) A simulated world's counter and latents are written within a second. The episode is not kept: a
//! world that comes back waits to be reset.

mod catalogue;
mod many;
pub mod observation;
mod registry;
mod saved;

use std::sync::{Arc, Mutex, MutexGuard, PoisonError, TryLockError};

use rand::RngExt;
use serde::{Deserialize, Serialize};

use crate::error::{Error, Result, within};
use crate::reality::{HiddenConfig, HiddenWorld, Reality, standard};
use crate::rng::{self, Stream};
use crate::task::scene::EffectTerm;
use crate::task::{ActionSpace, Placement, Scene, Split, Task, ValidAction};
use crate::trajectory::{End, Trajectory};
use crate::world::{Engine, Latents, Rollout, chosen, effect, simulate_map};
use catalogue::Posed;
pub use catalogue::{Catalogue, TaskSet};
pub use many::{Autoreset, Turned, reset_many, step_many};
use observation::Layout;
pub use registry::{Listed, Registry, RegistryConfig};
use saved::Account;
pub use saved::SavedWorld;

/// What a world is made from.
#[derive(Clone)]
pub struct WorldConfig {
    /// What may be asked in it.
    pub tasks: TaskSet,
    /// Simulated or real.
    pub kind: Kind,
    /// Engine that integrates.
    pub engine: Engine,
    /// Latent factors; where `None`, a simulation starts from the family's prior mean and a real world has the
    /// family's standard truth (a custom scene its own coefficients).
    pub latents: Latents,
    /// Effects; `None` is none for a simulation and the family's standard ones for a real world.
    pub effects: Option<Vec<EffectTerm>>,
    /// Standard deviation of observation noise, m; real worlds only.
    pub noise: f64,
    /// Most valid attempts; real worlds only.
    pub budget: Option<u64>,
    /// Whether latents and effects are kept secret and cannot be set; default true for a real world.
    pub sealed: Option<bool>,
    /// Seed of the stream that unseeded resets draw tasks from, and of observation noise.
    pub seed: u64,
}

/// Whether a world is simulated or stands for the real one.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Kind {
    Sim,
    Real,
}

/// An action as a client gives it.
#[derive(Clone, Debug, PartialEq)]
pub enum Action {
    /// Components in [0, 1].
    Vector(Vec<f64>),
    /// Number of a discrete action.
    Index(u64),
}

/// Where an episode stands.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Phase {
    /// Never reset.
    New,
    /// Waiting for an action.
    Ready,
    /// Ended by an attempt.
    Done,
}

/// A world in which tasks can be attempted.
pub struct World {
    tasks: TaskSet,
    kind: Kind,
    engine: Engine,
    sealed: bool,
    seed: u64,
    budget: Option<u64>,
    /// Of a simulation, or of a real world that is not sealed.
    effects: Vec<EffectTerm>,
    /// Numbers in an observation.
    features: usize,
    /// Body-time-steps of the longest rollout.
    longest: u64,
    hidden: Option<Mutex<HiddenWorld>>,
    /// Where the counter is kept, if anywhere.
    account: Option<Account>,
    /// Held through a whole reset or step, so that one action ends one episode.
    turn: Mutex<()>,
    /// Held only for moments; the last lock taken.
    state: Mutex<State>,
}

struct State {
    /// Of a simulation, or of a real world that is not sealed.
    latents: Latents,
    phase: Phase,
    task: Option<usize>,
    /// Part of the family that the last reset drew from; an episode begun by itself draws from it too.
    split: Option<Split>,
    episodes: u64,
    interactions: u64,
    resets: Stream,
}

/// What a reset draws its task from.
enum Drawn {
    /// This one.
    Given(usize),
    /// Any of these; never empty.
    Pool(Arc<[usize]>),
}

/// What is left of a trajectory once a step is made of it.
struct Seen {
    observation: Vec<f64>,
    solved: bool,
    steps: u32,
    collisions: u32,
    rolling_steps: u32,
    end: End,
}

impl Seen {
    fn of(layout: &Layout, trajectory: &Trajectory) -> Seen {
        Seen {
            observation: layout.observe(Some(trajectory)),
            solved: trajectory.solved(),
            steps: trajectory.outcome.steps,
            collisions: trajectory.collisions,
            rolling_steps: trajectory.rolling_steps,
            end: trajectory.outcome.end,
        }
    }
}

/// A world as it may be shown.
pub struct Description {
    pub task: String,
    pub kind: Kind,
    pub engine: Engine,
    pub sealed: bool,
    /// `None` if sealed.
    pub latents: Option<Latents>,
    /// `None` if sealed.
    pub effects: Option<Vec<EffectTerm>>,
    /// Valid attempts so far, by steps, rollouts, films and jobs.
    pub interactions: u64,
    pub budget: Option<u64>,
    pub seed: u64,
    /// Of all tasks of the world.
    pub actions: ActionSpace,
    /// Names of the observation's features.
    pub features: Vec<String>,
    /// Id of the current task.
    pub current: Option<String>,
    pub phase: Phase,
    /// Resets so far.
    pub episodes: u64,
}

/// What to reset to.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Reset {
    /// Starts the world's stream of tasks anew.
    pub seed: Option<u64>,
    /// Id of the task; drawn from the stream if absent.
    pub task: Option<String>,
    /// Part of the family to draw from; train, or all tasks if the world has none there.
    pub split: Option<Split>,
}

/// The start of an episode.
#[derive(Clone, Debug, PartialEq)]
pub struct Start {
    /// (n_features,) in [0, 1].
    pub observation: Vec<f64>,
    pub task: String,
    pub split: Split,
}

/// What a step brought: Gymnasium's tuple (never truncated) and what else there is to know.
#[derive(Clone, Debug, PartialEq)]
pub struct Step {
    /// (n_features,) in [0, 1], of the final state.
    pub observation: Vec<f64>,
    /// 1 if solved, else 0.
    pub reward: f64,
    pub terminated: bool,
    /// Why the action could not be placed, if so.
    pub invalid: Option<String>,
    pub solved: bool,
    /// Simulated time steps.
    pub steps: u32,
    pub task: String,
    /// Valid attempts in this world so far.
    pub interactions: u64,
    pub collisions: u32,
    pub rolling_steps: u32,
    pub end: Option<End>,
}

/// A batch of attempts outside any episode.
#[derive(Clone, Debug, PartialEq)]
pub struct Batch {
    pub actions: Vec<Action>,
    /// Id of the task; the current one if absent.
    pub task: Option<String>,
    /// Whether results carry samples.
    pub trajectories: bool,
    /// Whether a rollout ends when the goal is reached; real worlds always do.
    pub stop: bool,
}

/// What a batch brought.
pub struct Rolled {
    /// Name of the engine that ran.
    pub engine: &'static str,
    pub task: String,
    /// Valid attempts in this world so far.
    pub interactions: u64,
    /// Valid attempts among the results.
    pub valid: u64,
    /// In the order of the actions: a trajectory (without samples unless asked for), or why not.
    pub results: Vec<Tried>,
}

/// What became of an action: a trajectory, or why it could not be placed.
pub type Tried = std::result::Result<Trajectory, String>;

/// Keeps results together with the world's counter after them.
pub type Keep<'a> = &'a dyn Fn(&[Tried], u64) -> Result<()>;

/// Most actions in one batch.
pub const MOST_ACTIONS: usize = 4096;
/// Most sampled body states in one answer; 8 numbers each, so that an answer stays below half a gigabyte.
const MOST_SAMPLES: u64 = 4_000_000;
/// Body-time-steps up to which a rollout is light: at most about 0.2 ms.
const LIGHT: u64 = 100;
/// Most body-time-steps in one request: about a minute on two cores.
const MOST_WORK: u64 = 100_000_000;

impl World {
    /// Makes a world; errors name what in `config` is out of range.
    pub fn new(config: WorldConfig) -> Result<World> {
        let sealed = config.sealed.unwrap_or(config.kind == Kind::Real);
        for task in config.tasks.tasks.iter() {
            affordable(&task.scene, 1, true)?;
        }
        config.latents.validate()?;
        runs(&config)?;
        let (latents, effects, hidden) = match config.kind {
            Kind::Sim => {
                if config.noise != 0.0 {
                    return Err(Error::input("noise", config.noise, "0 for a simulated world"));
                }
                if let Some(budget) = config.budget {
                    return Err(Error::input(
                        "budget",
                        budget,
                        "null for a simulated world: it costs nothing",
                    ));
                }
                let effects = config.effects.unwrap_or_default();
                for (i, term) in effects.iter().enumerate() {
                    effect::resolve(term, &format!("effects[{i}]"))?;
                }
                let prior = config.tasks.family.map(|f| Latents::of(f.prior.map(|p| p.0)));
                (config.latents.or(prior.unwrap_or_default()), effects, None)
            }
            Kind::Real => {
                let base = config.tasks.family.map_or_else(bare, standard);
                let hidden = HiddenConfig {
                    latents: config.latents.or(base.latents),
                    effects: config.effects.unwrap_or(base.effects),
                    engine: config.engine,
                    noise: within("noise", config.noise, 0.0, 1e3)?,
                    budget: config.budget,
                    seed: config.seed,
                };
                let shown = (!sealed).then(|| (hidden.latents, hidden.effects.clone()));
                let (latents, effects) = shown.unwrap_or_default();
                (latents, effects, Some(Mutex::new(HiddenWorld::new(hidden)?)))
            }
        };
        let scenes = config.tasks.tasks.iter().map(|t| &t.scene);
        Ok(World {
            features: observation::names(&config.tasks.tasks[0].scene).len(),
            longest: scenes.map(|s| u64::from(s.steps) * s.bodies.len() as u64).max().unwrap_or(0),
            tasks: config.tasks,
            kind: config.kind,
            engine: config.engine,
            sealed,
            seed: config.seed,
            budget: config.budget,
            effects,
            hidden,
            account: None,
            turn: Mutex::new(()),
            state: Mutex::new(State {
                latents,
                phase: Phase::New,
                task: None,
                split: None,
                episodes: 0,
                interactions: 0,
                resets: rng::stream(config.seed, "reset"),
            }),
        })
    }

    /// Starts an episode.
    pub fn reset(&self, reset: &Reset) -> Result<Start> {
        let drawn = self.drawn(reset)?;
        let _turn = lock(&self.turn);
        Ok(self.begin(drawn, reset))
    }

    /// What a reset draws its task from.
    fn drawn(&self, reset: &Reset) -> Result<Drawn> {
        let given = reset.task.as_deref().map(|id| self.tasks.find(id)).transpose()?;
        let pool = self.pool(reset.split)?;
        match (given, reset.split) {
            (Some(task), Some(split)) if !pool.contains(&task) => {
                let own = self.tasks.tasks[task].split.name();
                let allowed = format!("{own:?}, where the task is");
                Err(Error::input("split", format!("{:?}", split.name()), allowed))
            }
            (Some(task), _) => Ok(Drawn::Given(task)),
            (None, _) => Ok(Drawn::Pool(pool)),
        }
    }

    /// Starts an episode; the caller has the turn.
    fn begin(&self, drawn: Drawn, reset: &Reset) -> Start {
        let mut state = lock(&self.state);
        if let Some(seed) = reset.seed {
            state.resets = rng::stream(seed, "reset");
        }
        let index = match drawn {
            Drawn::Given(task) => task,
            Drawn::Pool(pool) => pool[state.resets.random_range(0..pool.len())],
        };
        state.task = Some(index);
        state.split = reset.split;
        state.phase = Phase::Ready;
        state.episodes += 1;
        let Posed { task, layout } = self.tasks.posed(index);
        Start { observation: layout.observe(None), task: task.id.clone(), split: task.split }
    }

    /// Carries out one action; see the table of phases.
    pub fn step(&self, action: &Action) -> Result<Step> {
        let _turn = lock(&self.turn);
        let (posed, latents) = self.ready()?;
        let task = posed.task;
        let action = action.resolve(task.actions(), "action")?;
        let (mut results, interactions) = self.attempt(task, &[action], latents, true, |t| t, None)?;
        let result = results.pop().ok_or_else(|| Error::Failed("an attempt without a result".into()))?;
        Ok(self.stepped(posed, result.map(|t| Seen::of(posed.layout, &t)), interactions))
    }

    /// The task of the episode that waits for an action, and the latents it is attempted with.
    fn ready(&self) -> Result<(Posed<'_>, Latents)> {
        let state = lock(&self.state);
        match (state.phase, state.task) {
            (Phase::Ready, Some(task)) => Ok((self.tasks.posed(task), state.latents)),
            (Phase::Done, _) => Err(refused("the episode has ended; reset the world first")),
            _ => Err(refused("no episode has begun; reset the world first")),
        }
    }

    /// Takes in what an action brought; a valid one ends the episode.
    fn stepped(&self, posed: Posed, seen: std::result::Result<Seen, String>, interactions: u64) -> Step {
        let task_id = posed.task.id.clone();
        match seen {
            Err(reason) => Step {
                observation: posed.layout.observe(None),
                reward: 0.0,
                terminated: false,
                invalid: Some(reason),
                solved: false,
                steps: 0,
                task: task_id,
                interactions,
                collisions: 0,
                rolling_steps: 0,
                end: None,
            },
            Ok(seen) => {
                lock(&self.state).phase = Phase::Done;
                Step {
                    observation: seen.observation,
                    reward: f64::from(u8::from(seen.solved)),
                    terminated: true,
                    invalid: None,
                    solved: seen.solved,
                    steps: seen.steps,
                    task: task_id,
                    interactions,
                    collisions: seen.collisions,
                    rolling_steps: seen.rolling_steps,
                    end: Some(seen.end),
                }
            }
        }
    }

    /// Sets those latent factors that are given; refused by a real or sealed world.
    pub fn set_latents(&self, latents: Latents) -> Result<()> {
        if self.kind == Kind::Real || self.sealed {
            return Err(Error::Sealed {
                reason: "the latents of a real or sealed world cannot be set; \
                         set them in a simulated world and compare"
                    .into(),
            });
        }
        latents.validate()?;
        let mut state = lock(&self.state);
        state.latents = latents.or(state.latents);
        if let Some(account) = &self.account {
            let text = serde_json::to_string(&state.latents).ok();
            account.store.note_world(&account.id, state.interactions, text);
        }
        Ok(())
    }

    /// Attempts many actions on a task, leaving the episode as it is.
    pub fn rollout(&self, batch: &Batch) -> Result<Rolled> {
        let (task, latents) = self.task_or_current(batch.task.as_deref())?;
        if batch.actions.len() > MOST_ACTIONS {
            return Err(Error::TooLarge {
                what: "actions",
                asked: batch.actions.len() as u64,
                limit: MOST_ACTIONS as u64,
                advice: "send several batches",
            });
        }
        if self.kind == Kind::Real && !batch.stop {
            return Err(Error::input("stop", false, "true: a real world ends with its goal"));
        }
        let actions: Vec<ValidAction> = batch
            .actions
            .iter()
            .enumerate()
            .map(|(i, a)| a.resolve(task.actions(), &format!("actions[{i}]")))
            .collect::<Result<_>>()?;
        // A real world keeps all samples while it measures.
        affordable(&task.scene, actions.len() as u64, batch.trajectories || self.kind == Kind::Real)?;
        let keep = |mut t: Trajectory| {
            if !batch.trajectories {
                (t.times, t.bodies, t.events) = Default::default();
            }
            t
        };
        let (results, interactions) = self.attempt(task, &actions, latents, batch.stop, keep, None)?;
        Ok(Rolled {
            engine: self.engine_for(task, &actions),
            task: task.id.clone(),
            interactions,
            valid: results.iter().filter(|r| r.is_ok()).count() as u64,
            results,
        })
    }

    /// The scene of a task (the current one if `task` is absent) as it stands, or with an action placed in it.
    pub fn scene(&self, task: Option<&str>, action: Option<&Action>) -> Result<Scene> {
        let task = match self.task_or_current(task) {
            Ok((task, _)) => task,
            // A world never reset shows its first task.
            Err(Error::Refused { .. }) => &self.tasks.tasks[0],
            Err(e) => return Err(e),
        };
        let Some(action) = action else { return Ok(task.scene.clone()) };
        match task.place(&action.resolve(task.actions(), "action")?) {
            Placement::Valid(scene) => Ok(*scene),
            Placement::Invalid(reason) => Err(unplaceable(action, &reason)),
        }
    }

    /// The placed scene and the trajectory of one action, for a film; an attempt like any other.
    pub fn film(&self, task: Option<&str>, action: &Action) -> Result<(Scene, Trajectory)> {
        let (task, latents) = self.task_or_current(task)?;
        let scene = self.scene(Some(&task.id), Some(action))?;
        let resolved = action.resolve(task.actions(), "action")?;
        let (mut results, _) = self.attempt(task, &[resolved], latents, true, |t| t, None)?;
        match results.pop() {
            Some(Ok(trajectory)) => Ok((scene, trajectory)),
            Some(Err(reason)) => Err(unplaceable(action, &reason)),
            None => Err(Error::Failed("an attempt without a result".into())),
        }
    }

    /// The world as it may be shown.
    pub fn describe(&self) -> Description {
        let state = lock(&self.state);
        let first = &self.tasks.tasks[0];
        Description {
            task: self.tasks.name.clone(),
            kind: self.kind,
            engine: self.engine,
            sealed: self.sealed,
            latents: (!self.sealed).then_some(state.latents),
            effects: (!self.sealed).then(|| self.effects.clone()),
            interactions: state.interactions,
            budget: self.budget,
            seed: self.seed,
            actions: first.actions().clone(),
            features: observation::names(&first.scene),
            current: state.task.map(|t| self.tasks.tasks[t].id.clone()),
            phase: state.phase,
            episodes: state.episodes,
        }
    }

    /// Whether everything but a large batch is done here in a fraction of a millisecond, without waiting for the disk
    /// or for somebody else's turn.
    pub fn is_light(&self) -> bool {
        self.hidden.is_none()
            && self.longest <= LIGHT
            && !matches!(self.turn.try_lock(), Err(TryLockError::WouldBlock))
    }

    /// Simulated or real.
    pub fn kind(&self) -> Kind {
        self.kind
    }

    /// The tasks the world may be reset to.
    pub fn tasks(&self) -> &TaskSet {
        &self.tasks
    }

    /// Numbers in an observation.
    pub fn features(&self) -> usize {
        self.features
    }

    /// Valid attempts so far.
    pub fn interactions(&self) -> u64 {
        lock(&self.state).interactions
    }

    /// Most valid attempts allowed.
    pub fn budget(&self) -> Option<u64> {
        self.budget
    }

    /// Valid attempts still allowed.
    pub fn remaining(&self) -> Option<u64> {
        self.budget.map(|b| b.saturating_sub(self.interactions()))
    }

    /// Attempts actions in this world's physics and counts the valid ones. `store` is given the results and the
    /// counter before anybody else is, and keeps both or neither; what it cannot keep is not given out.
    pub fn attempts(&self, task: &Task, actions: &[ValidAction], store: Option<Keep>) -> Result<Vec<Tried>> {
        let latents = lock(&self.state).latents;
        Ok(self.attempt(task, actions, latents, true, |t| t, store)?.0)
    }

    /// Results in the order of the actions, and the count of valid attempts after them.
    fn attempt(
        &self,
        task: &Task,
        actions: &[ValidAction],
        latents: Latents,
        stop: bool,
        keep: impl Fn(Trajectory) -> Trajectory + Sync,
        store: Option<Keep>,
    ) -> Result<(Vec<Tried>, u64)> {
        if let Some(hidden) = &self.hidden {
            let mut hidden = lock(hidden);
            let attempts = hidden.measure(task, actions)?;
            let interactions = hidden.interactions();
            lock(&self.state).interactions = interactions;
            let results = attempts.into_iter().map(|a| match (a.placement, a.trajectory) {
                (Err(reason), _) => Err(reason),
                (Ok(_), Some(trajectory)) => Ok(keep(trajectory)),
                (Ok(_), None) => Err("nothing was observed".into()),
            });
            let results: Vec<Tried> = results.collect();
            match store {
                // The world stays locked, so that what is counted is what is kept.
                Some(store) => store(&results, interactions)?,
                None => {
                    drop(hidden);
                    if let Some(account) = &self.account {
                        account.store.count_world(&account.id, interactions)?;
                    }
                }
            }
            return Ok((results, interactions));
        }
        let placements: Vec<Placement> = actions.iter().map(|a| task.place(a)).collect();
        let rollouts: Vec<Rollout> = placements
            .iter()
            .filter_map(|p| match p {
                Placement::Valid(scene) => Some(Rollout { scene, latents, effects: &self.effects, stop }),
                Placement::Invalid(_) => None,
            })
            .collect();
        let valid = rollouts.len() as u64;
        let mut simulated = simulate_map(&rollouts, self.engine, |_, t| keep(t))?.into_iter();
        let results: Vec<Tried> = placements
            .iter()
            .map(|p| match p {
                Placement::Invalid(reason) => Err(reason.clone()),
                Placement::Valid(_) => simulated.next().ok_or_else(|| "nothing was simulated".into()),
            })
            .collect();
        let interactions = {
            let mut state = lock(&self.state);
            state.interactions += valid;
            state.interactions
        };
        if let Some(account) = &self.account {
            account.store.note_world(&account.id, interactions, None);
        }
        if let Some(store) = store {
            store(&results, interactions)?;
        }
        Ok((results, interactions))
    }

    /// Name of the engine that runs the first placeable of the actions.
    fn engine_for(&self, task: &Task, actions: &[ValidAction]) -> &'static str {
        let placed = actions.iter().find_map(|a| match task.place(a) {
            Placement::Valid(scene) => Some(scene),
            Placement::Invalid(_) => None,
        });
        let engine = placed.and_then(|scene| {
            let rollout =
                Rollout { scene: &scene, latents: Latents::default(), effects: &self.effects, stop: true };
            chosen(self.engine, &rollout).ok()
        });
        engine.unwrap_or(self.engine).name()
    }

    /// Indices of the tasks a reset draws from; never empty.
    fn pool(&self, split: Option<Split>) -> Result<Arc<[usize]>> {
        let of = |split| Some(self.tasks.pool(Some(split))).filter(|pool| !pool.is_empty());
        match split {
            Some(split) => of(split).cloned().ok_or_else(|| {
                let there: Vec<String> = [Split::Train, Split::Validation, Split::Test]
                    .into_iter()
                    .filter(|s| of(*s).is_some())
                    .map(|s| format!("{:?}", s.name()))
                    .collect();
                Error::input(
                    "split",
                    format!("{:?}", split.name()),
                    format!("{} in this world", there.join(", ")),
                )
            }),
            None => Ok(of(Split::Train).unwrap_or_else(|| self.tasks.pool(None)).clone()),
        }
    }

    fn task_or_current(&self, id: Option<&str>) -> Result<(&Task, Latents)> {
        let state = lock(&self.state);
        let index = match id {
            Some(id) => self.tasks.find(id)?,
            None if self.tasks.tasks.len() == 1 => 0,
            None => state
                .task
                .ok_or_else(|| refused("no current task; reset the world first, or name a `task`"))?,
        };
        Ok((&self.tasks.tasks[index], state.latents))
    }
}

impl Action {
    /// The action in `space`; `field` is what an error calls it.
    pub fn resolve(&self, space: &ActionSpace, field: &str) -> Result<ValidAction> {
        let resolved = match self {
            Action::Vector(values) => space.validate(values),
            Action::Index(index) => space.at(usize::try_from(*index).unwrap_or(usize::MAX)),
        };
        resolved.map_err(|e| match e {
            Error::Input(mut input) => {
                input.field = format!("{field}{}", input.field.strip_prefix("action").unwrap_or_default());
                Error::Input(input)
            }
            other => other,
        })
    }
}

impl Phase {
    /// The name used on the wire.
    pub fn name(self) -> &'static str {
        match self {
            Phase::New => "new",
            Phase::Ready => "ready",
            Phase::Done => "done",
        }
    }
}

impl Kind {
    /// The name used on the wire.
    pub fn name(self) -> &'static str {
        match self {
            Kind::Sim => "sim",
            Kind::Real => "real",
        }
    }
}

/// A real world of a custom scene: the scene's own coefficients and effects.
fn bare() -> HiddenConfig {
    HiddenConfig {
        latents: Latents::default(),
        effects: Vec::new(),
        engine: Engine::Auto,
        noise: 0.0,
        budget: None,
        seed: 0,
    }
}

/// Errors unless the engine takes the world's scenes: better now than at the first step.
fn runs(config: &WorldConfig) -> Result<()> {
    let mut scene = config.tasks.tasks[0].scene.clone();
    for body in &mut scene.bodies {
        // An action decides; any place will do to ask.
        body.position.get_or_insert([0.0, 0.0]);
    }
    let effects = config.effects.as_deref().unwrap_or_default();
    chosen(config.engine, &Rollout { scene: &scene, latents: config.latents, effects, stop: true }).map(drop)
}

/// Errors if so many body-time-steps are more than one request may cost.
fn bearable(work: u64) -> Result<()> {
    if work <= MOST_WORK {
        return Ok(());
    }
    let what = "bodies x time steps x actions";
    let advice = "take fewer actions, steps or bodies";
    Err(Error::TooLarge { what, asked: work, limit: MOST_WORK, advice })
}

/// Errors if `rollouts` of `scene` are more than one request may cost.
fn affordable(scene: &Scene, rollouts: u64, samples_kept: bool) -> Result<()> {
    let bodies = scene.bodies.len() as u64;
    bearable(rollouts.saturating_mul(u64::from(scene.steps)).saturating_mul(bodies))?;
    let each = u64::from(scene.steps / scene.observe_every.max(1)) + 2;
    let samples = rollouts.saturating_mul(each).saturating_mul(bodies);
    if samples_kept && samples > MOST_SAMPLES {
        let advice = "take fewer actions or a larger `observe_every`";
        return Err(Error::TooLarge {
            what: "sampled body states",
            asked: samples,
            limit: MOST_SAMPLES,
            advice,
        });
    }
    Ok(())
}

fn unplaceable(action: &Action, reason: &str) -> Error {
    let value = match action {
        Action::Vector(values) => format!("{values:?}"),
        Action::Index(index) => index.to_string(),
    };
    Error::input("action", value, format!("an action that can be placed ({reason})"))
}

fn refused(reason: &str) -> Error {
    Error::Refused { reason: reason.into() }
}

/// A panic elsewhere leaves the data as it was after the last completed statement: still usable.
fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}
