//! Worlds, episodes and batches.

use std::collections::BTreeMap;
use std::fmt;

use serde::de::{SeqAccess, Visitor};
use serde::{Deserialize, Deserializer, Serialize};
use utoipa::ToSchema;

use super::array::{Array, Data};
use super::{Bulk, Object};
use crate::error::{Error, Result};
use crate::session::{
    Action, Batch, Catalogue, Description, Kind, Reset, Rolled, Start, Step, TaskSet, WorldConfig,
};
use crate::task::scene::EffectTerm;
use crate::task::{ActionSpace, Scene, Split};
use crate::trajectory::{End, Trajectory};
use crate::world::{Engine, Latents, effect};

/// A world to make; one of `task` and `scene` is needed.
#[derive(Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct CreateWorld {
    /// A family (`bowling`) or one task (`bowling:017`).
    pub task: Option<String>,
    /// An `iplw.scene/1` document with `action` and `goal`.
    #[schema(value_type = Option<Object>)]
    pub scene: Option<Object<Scene>>,
    /// `sim` if absent.
    pub kind: Option<WorldKind>,
    /// `auto`, or the name of an engine.
    pub engine: Option<String>,
    /// Latent factors; those absent are the family's prior mean (sim) or its standard truth (real).
    #[schema(value_type = Option<LatentsIn>)]
    pub latents: Option<Object<LatentsIn>>,
    /// Effects beyond gravity and contact; a real world of a family has that family's if neither this nor
    /// `damping` is given.
    #[schema(value_type = Option<Vec<EffectIn>>)]
    pub effects: Option<Vec<Object<EffectIn>>>,
    /// Kept share of velocity per second, in (0, 1]; short for the effect `linear_drag`.
    pub damping: Option<f64>,
    /// Standard deviation of observation noise, m; real worlds only.
    pub noise: Option<f64>,
    /// Most valid attempts; real worlds only.
    pub budget: Option<u64>,
    /// Whether latents and effects are kept secret; default true for real, false for sim.
    pub sealed: Option<bool>,
    /// Seed of unseeded resets and of noise.
    pub seed: Option<u64>,
}

/// Simulated or real.
#[derive(Clone, Copy, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum WorldKind {
    Sim,
    Real,
}

/// Latent factors; any of them.
#[derive(Clone, Copy, Default, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct LatentsIn {
    /// kg/m^2
    pub density: Option<f64>,
    /// Another name for `density`.
    pub mass: Option<f64>,
    /// Surface coefficient.
    pub friction: Option<f64>,
    /// Surface coefficient.
    pub restitution: Option<f64>,
}

/// An effect by name.
#[derive(Clone, Deserialize, Serialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct EffectIn {
    /// As FORMATS lists them: `linear_drag`, ...
    pub name: String,
    /// Values in the effect's units; those absent leave the effect neutral.
    #[serde(default)]
    pub parameters: BTreeMap<String, f64>,
}

/// A world.
#[derive(Serialize, ToSchema)]
pub struct WorldOut {
    pub id: String,
    /// Family, task or custom scene.
    pub task: String,
    pub kind: WorldKind,
    pub engine: &'static str,
    pub sealed: bool,
    /// `null` if sealed.
    pub latents: Option<LatentsOut>,
    /// `null` if sealed.
    pub effects: Option<Vec<EffectIn>>,
    /// Valid attempts so far: steps, rollouts, films and jobs.
    pub interactions: u64,
    pub budget: Option<u64>,
    /// Budget not yet spent.
    pub remaining: Option<u64>,
    pub seed: u64,
    pub action_space: ActionSpaceOut,
    pub observation_space: ObservationSpaceOut,
    pub state: StateOut,
}

/// Latent factors in force; absent where bodies keep the scene's own.
#[derive(Serialize, ToSchema)]
pub struct LatentsOut {
    /// kg/m^2
    #[serde(skip_serializing_if = "Option::is_none")]
    pub density: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub friction: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub restitution: Option<f64>,
}

/// Actions: vectors in the unit cube, or numbers of discrete actions.
#[derive(Serialize, ToSchema)]
pub struct ActionSpaceOut {
    /// Numbers in an action vector, each from 0 to 1.
    pub dimension: usize,
    /// Number of discrete actions.
    pub count: usize,
    pub components: Vec<ComponentOut>,
}

/// What one number of an action sets: `low` at 0, `high` at 1, SI.
#[derive(Serialize, ToSchema)]
pub struct ComponentOut {
    pub target: String,
    /// `x`, `y`, `radius`, `angle`, `vx`, `vy` or `omega`.
    #[schema(value_type = String)]
    pub set: serde_json::Value,
    pub low: f64,
    pub high: f64,
}

/// Features of an observation and their bounds.
#[derive(Serialize, ToSchema)]
pub struct ObservationSpaceOut {
    pub names: Vec<String>,
    pub low: Vec<f64>,
    pub high: Vec<f64>,
}

/// Where the current episode stands.
#[derive(Serialize, ToSchema)]
pub struct StateOut {
    /// Id of the current task.
    pub task: Option<String>,
    /// `new`, `ready` or `done`.
    pub phase: &'static str,
    /// Resets so far.
    pub episodes: u64,
}

/// All worlds.
#[derive(Serialize, ToSchema)]
pub struct Worlds {
    pub worlds: Vec<WorldOut>,
    /// Cursor of the next page, if there is one.
    pub next: Option<String>,
}

/// What to reset to; everything may be absent.
#[derive(Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct ResetIn {
    /// Starts the world's sequence of tasks anew.
    pub seed: Option<u64>,
    /// Id of the task; drawn from the sequence if absent.
    pub task: Option<String>,
    /// Part of the family to draw from; `train` if absent.
    pub split: Option<SplitIn>,
}

/// Part of a family.
#[derive(Clone, Copy, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum SplitIn {
    Train,
    Validation,
    Test,
}

/// The start of an episode.
#[derive(Serialize, ToSchema)]
pub struct ResetOut {
    /// Each from 0 to 1, as the world's `observation_space` names them.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schema(value_type = Vec<f64>, required = true)]
    pub observation: Option<Array>,
    pub info: ResetInfo,
}

/// What else there is to know after a reset.
#[derive(Serialize, ToSchema)]
pub struct ResetInfo {
    pub task: String,
    pub split: SplitIn,
}

/// One action.
#[derive(Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct StepIn {
    pub action: ActionIn,
}

/// An action vector (each number from 0 to 1), or the number of a discrete action.
#[derive(Clone, Debug, PartialEq, Serialize, ToSchema)]
#[schema(example = json!([0.5, 0.5, 0.2]))]
#[serde(untagged)]
pub enum ActionIn {
    Vector(Vec<f64>),
    Index(u64),
}

/// Gymnasium's tuple.
#[derive(Serialize, ToSchema)]
pub struct StepOut {
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schema(value_type = Vec<f64>, required = true)]
    pub observation: Option<Array>,
    /// 1 if the task was solved, else 0.
    pub reward: f64,
    pub terminated: bool,
    /// Always false: a task takes one action.
    pub truncated: bool,
    pub info: StepInfo,
}

/// What else there is to know after a step.
#[derive(Serialize, ToSchema)]
pub struct StepInfo {
    /// Whether the action could be placed; if not, it was no attempt and the episode goes on.
    pub valid: bool,
    /// Why it could not be placed.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub reason: Option<String>,
    pub solved: bool,
    /// Simulated time steps.
    pub steps: u32,
    pub task: String,
    /// Valid attempts in this world so far.
    pub interactions: u64,
    /// Begun contacts between movable bodies.
    pub collisions: u32,
    /// Time steps that bodies spent on a surface, summed.
    pub rolling_steps: u32,
    /// `horizon`, `goal` or `diverged`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub end: Option<&'static str>,
}

/// A batch of attempts outside any episode.
#[derive(Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct RolloutIn {
    /// At most 4096.
    pub actions: Vec<ActionIn>,
    /// Id of the task; the current one if absent.
    pub task: Option<String>,
    /// Whether results carry the observed trajectory; default false.
    pub trajectories: Option<bool>,
    /// Whether a rollout ends with the goal; default true, and always true in a real world.
    pub stop: Option<bool>,
}

/// What a batch brought.
#[derive(Serialize, ToSchema)]
pub struct BatchOut {
    /// Engine that ran.
    pub engine: &'static str,
    pub task: String,
    /// Valid attempts in this world so far.
    pub interactions: u64,
    /// In the order of the actions.
    pub results: Vec<ResultOut>,
    /// Trajectories, if they were asked for with raw arrays, which are more: `t` (action, time), s, and `states`
    /// (action, body, time, 3), m, m and rad, both NaN after the end; and `length` (action), their samples.
    #[serde(skip)]
    pub arrays: Vec<(&'static str, Array)>,
    /// With raw arrays: names of the bodies, in their order.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub bodies: Option<Vec<String>>,
}

/// What one action brought.
#[derive(Serialize, ToSchema)]
pub struct ResultOut {
    pub valid: bool,
    /// Why the action could not be placed.
    pub reason: Option<String>,
    /// `null` for an invalid action.
    pub solved: Option<bool>,
    /// Simulated time steps.
    pub steps: u32,
    pub contacts: ContactsOut,
    /// Observation times, s.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub t: Option<Vec<f64>>,
    /// By body name, a state for each time.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub bodies: Option<BTreeMap<String, BodyTrack>>,
}

/// Counts that the paper's action groups are made from.
#[derive(Serialize, ToSchema)]
pub struct ContactsOut {
    /// Begun contacts between movable bodies.
    pub collisions: u32,
    /// Time steps that bodies spent on a surface, summed.
    pub rolling_steps: u32,
}

/// Observed states of a body.
#[derive(Serialize, ToSchema)]
pub struct BodyTrack {
    /// m
    pub x: Vec<f64>,
    /// m, up
    pub y: Vec<f64>,
    /// rad, counter-clockwise
    pub angle: Vec<f64>,
}

impl CreateWorld {
    /// The configuration asked for.
    pub fn config(self, catalogue: &Catalogue) -> Result<WorldConfig> {
        let tasks = match (self.task, self.scene) {
            (Some(task), None) => catalogue.named(&task)?,
            (None, Some(scene)) => TaskSet::custom(scene.0).map_err(|e| e.under("scene"))?,
            (Some(_), Some(_)) => {
                return Err(Error::input("scene", "given beside `task`", "one of task and scene"));
            }
            (None, None) => return Err(Error::input("task", "missing", "one of task and scene")),
        };
        Ok(WorldConfig {
            tasks,
            kind: self.kind.map_or(Kind::Sim, Kind::from),
            engine: engine(self.engine.as_deref())?,
            latents: latents(self.latents.map(|o| o.0).unwrap_or_default(), "latents.")?,
            effects: effects(self.damping, self.effects, "")?,
            noise: self.noise.unwrap_or(0.0),
            budget: self.budget,
            sealed: self.sealed,
            seed: self.seed.unwrap_or(0),
        })
    }
}

impl LatentsIn {
    /// The latents given; an error calls its field as the user did, after `prefix`.
    pub fn checked(self, prefix: &str) -> Result<Latents> {
        latents(self, prefix)
    }
}

fn latents(given: LatentsIn, prefix: &str) -> Result<Latents> {
    if let (Some(mass), Some(_)) = (given.mass, given.density) {
        return Err(Error::input(
            format!("{prefix}mass"),
            mass,
            "only one of mass and density, which mean the same",
        ));
    }
    let latents = Latents {
        density: given.density.or(given.mass),
        friction: given.friction,
        restitution: given.restitution,
    };
    latents.validate().map_err(|e| match e {
        Error::Input(mut input) => {
            let name = input.field.strip_prefix("latents.").unwrap_or(&input.field);
            let name = if name == "density" && given.mass.is_some() { "mass" } else { name };
            input.field = format!("{prefix}{name}");
            Error::Input(input)
        }
        other => other,
    })?;
    Ok(latents)
}

/// The engine named, or `auto`.
fn engine(name: Option<&str>) -> Result<Engine> {
    let Some(name) = name else { return Ok(Engine::Auto) };
    Engine::from_name(name).map_err(|e| match e {
        Error::NotFound { known, .. } => {
            Error::input("engine", format!("{name:?}"), format!("one of {}", known.join(", ")))
        }
        other => other,
    })
}

/// Damping and effects together; `None` if neither was given. `prefix` is put before an error's field.
pub fn effects(
    damping: Option<f64>,
    given: Option<Vec<Object<EffectIn>>>,
    prefix: &str,
) -> Result<Option<Vec<EffectTerm>>> {
    if damping.is_none() && given.is_none() {
        return Ok(None);
    }
    let mut terms = Vec::new();
    if let Some(kept) = damping {
        if !(kept > 0.0 && kept <= 1.0) {
            let allowed = "a kept share of velocity per second in (0, 1]";
            return Err(Error::input(format!("{prefix}damping"), kept, allowed));
        }
        if kept < 1.0 {
            let term = effect::damping(kept);
            effect::resolve(&term, "").map_err(|_| {
                Error::input(format!("{prefix}damping"), kept, "a larger share: this one leaves no motion")
            })?;
            terms.push(term);
        }
    }
    for (i, Object(e)) in given.into_iter().flatten().enumerate() {
        let term = EffectTerm { name: e.name, parameters: e.parameters };
        effect::resolve(&term, &format!("{prefix}effects[{i}]"))?;
        terms.push(term);
    }
    if terms.len() > MOST_EFFECTS {
        let value = format!("{} effects", terms.len());
        return Err(Error::input(
            format!("{prefix}effects"),
            value,
            format!("at most {MOST_EFFECTS} effects"),
        ));
    }
    Ok(Some(terms))
}

/// Most effects of a world.
const MOST_EFFECTS: usize = 32;

impl From<WorldKind> for Kind {
    fn from(kind: WorldKind) -> Kind {
        match kind {
            WorldKind::Sim => Kind::Sim,
            WorldKind::Real => Kind::Real,
        }
    }
}

impl From<Kind> for WorldKind {
    fn from(kind: Kind) -> WorldKind {
        match kind {
            Kind::Sim => WorldKind::Sim,
            Kind::Real => WorldKind::Real,
        }
    }
}

impl From<SplitIn> for Split {
    fn from(split: SplitIn) -> Split {
        match split {
            SplitIn::Train => Split::Train,
            SplitIn::Validation => Split::Validation,
            SplitIn::Test => Split::Test,
        }
    }
}

impl From<Split> for SplitIn {
    fn from(split: Split) -> SplitIn {
        match split {
            Split::Train => SplitIn::Train,
            Split::Validation => SplitIn::Validation,
            Split::Test => SplitIn::Test,
        }
    }
}

impl From<ResetIn> for Reset {
    fn from(reset: ResetIn) -> Reset {
        Reset { seed: reset.seed, task: reset.task, split: reset.split.map(Split::from) }
    }
}

impl From<ActionIn> for Action {
    fn from(action: ActionIn) -> Action {
        match action {
            ActionIn::Vector(values) => Action::Vector(values),
            ActionIn::Index(index) => Action::Index(index),
        }
    }
}

impl From<RolloutIn> for Batch {
    fn from(batch: RolloutIn) -> Batch {
        Batch {
            actions: batch.actions.into_iter().map(Action::from).collect(),
            task: batch.task,
            trajectories: batch.trajectories.unwrap_or(false),
            stop: batch.stop.unwrap_or(true),
        }
    }
}

impl WorldOut {
    /// A world as clients see it.
    pub fn new(id: &str, d: Description) -> WorldOut {
        let features = d.features.len();
        WorldOut {
            id: id.into(),
            task: d.task,
            kind: d.kind.into(),
            engine: d.engine.name(),
            sealed: d.sealed,
            latents: d.latents.map(LatentsOut::from),
            effects: d.effects.map(|terms| terms.into_iter().map(EffectIn::from).collect()),
            interactions: d.interactions,
            budget: d.budget,
            remaining: d.budget.map(|b| b.saturating_sub(d.interactions)),
            seed: d.seed,
            action_space: ActionSpaceOut::from(&d.actions),
            observation_space: ObservationSpaceOut {
                names: d.features,
                low: vec![0.0; features],
                high: vec![1.0; features],
            },
            state: StateOut { task: d.current, phase: d.phase.name(), episodes: d.episodes },
        }
    }
}

impl From<Latents> for LatentsOut {
    fn from(l: Latents) -> LatentsOut {
        LatentsOut { density: l.density, friction: l.friction, restitution: l.restitution }
    }
}

impl From<EffectTerm> for EffectIn {
    fn from(term: EffectTerm) -> EffectIn {
        EffectIn { name: term.name, parameters: term.parameters }
    }
}

impl From<&ActionSpace> for ActionSpaceOut {
    fn from(space: &ActionSpace) -> ActionSpaceOut {
        let component = |c: &crate::task::action::Component| ComponentOut {
            target: c.target.clone(),
            set: serde_json::json!(c.set),
            low: c.low,
            high: c.high,
        };
        ActionSpaceOut {
            dimension: space.dimension(),
            count: space.count(),
            components: space.components.iter().map(component).collect(),
        }
    }
}

impl From<Start> for ResetOut {
    fn from(start: Start) -> ResetOut {
        ResetOut {
            observation: Some(Array::line(Data::F8(start.observation))),
            info: ResetInfo { task: start.task, split: start.split.into() },
        }
    }
}

impl From<Step> for StepOut {
    fn from(step: Step) -> StepOut {
        StepOut {
            observation: Some(Array::line(Data::F8(step.observation))),
            reward: step.reward,
            terminated: step.terminated,
            truncated: false,
            info: StepInfo {
                valid: step.invalid.is_none(),
                reason: step.invalid,
                solved: step.solved,
                steps: step.steps,
                task: step.task,
                interactions: step.interactions,
                collisions: step.collisions,
                rolling_steps: step.rolling_steps,
                end: step.end.map(end_name),
            },
        }
    }
}

/// The word for how a rollout ended.
pub fn end_name(end: End) -> &'static str {
    match end {
        End::Horizon => "horizon",
        End::Goal => "goal",
        End::Diverged => "diverged",
    }
}

impl Bulk for ResetOut {
    fn bulk(&mut self) -> Vec<(&'static str, Array)> {
        self.observation.take().map(|a| ("observation", a)).into_iter().collect()
    }
}

impl Bulk for StepOut {
    fn bulk(&mut self) -> Vec<(&'static str, Array)> {
        self.observation.take().map(|a| ("observation", a)).into_iter().collect()
    }
}

impl BatchOut {
    /// A batch's results, with trajectories if they were asked for: as lists, or as `raw` arrays.
    pub fn new(rolled: Rolled, trajectories: bool, raw: bool) -> BatchOut {
        let (mut arrays, mut bodies) = (Vec::new(), None);
        if trajectories && raw {
            let (names, pieces) = stacked(&rolled.results);
            (arrays, bodies) = (pieces, Some(names));
        }
        let result = |r: std::result::Result<Trajectory, String>| match r {
            Ok(trajectory) => ResultOut::of(trajectory, trajectories && !raw),
            Err(reason) => ResultOut {
                valid: false,
                reason: Some(reason),
                solved: None,
                steps: 0,
                contacts: ContactsOut { collisions: 0, rolling_steps: 0 },
                t: None,
                bodies: None,
            },
        };
        BatchOut {
            engine: rolled.engine,
            task: rolled.task,
            interactions: rolled.interactions,
            results: rolled.results.into_iter().map(result).collect(),
            arrays,
            bodies,
        }
    }
}

impl Bulk for BatchOut {
    fn bulk(&mut self) -> Vec<(&'static str, Array)> {
        std::mem::take(&mut self.arrays)
    }
}

/// Names of the bodies, and the trajectories as `t`, `states` and `length`.
fn stacked(results: &[crate::session::Tried]) -> (Vec<String>, Vec<(&'static str, Array)>) {
    let trajectories = || results.iter().map(|r| r.as_ref().ok());
    let names: Vec<String> = match trajectories().flatten().next() {
        Some(first) => first.bodies.iter().map(|b| b.name.clone()).collect(),
        None => Vec::new(),
    };
    let (n, most) = (results.len(), trajectories().flatten().map(|t| t.times.len()).max().unwrap_or(0));
    let mut t = vec![f64::NAN; n * most];
    let mut states = vec![f64::NAN; n * names.len() * most * 3];
    for (i, trajectory) in trajectories().enumerate() {
        let Some(trajectory) = trajectory else { continue };
        t[i * most..][..trajectory.times.len()].copy_from_slice(&trajectory.times);
        for (b, track) in trajectory.bodies.iter().enumerate() {
            let at = (i * names.len() + b) * most * 3;
            for (k, state) in states[at..][..track.len() * 3].chunks_exact_mut(3).enumerate() {
                state.copy_from_slice(&[track.x[k], track.y[k], track.angle[k]]);
            }
        }
    }
    let length = trajectories().map(|t| t.map_or(0, |t| t.times.len() as u32)).collect();
    let arrays = vec![
        ("t", Array::of(vec![n, most], Data::F8(t))),
        ("states", Array::of(vec![n, names.len(), most, 3], Data::F8(states))),
        ("length", Array::line(Data::U4(length))),
    ];
    (names, arrays)
}

impl ResultOut {
    fn of(trajectory: Trajectory, samples: bool) -> ResultOut {
        let contacts =
            ContactsOut { collisions: trajectory.collisions, rolling_steps: trajectory.rolling_steps };
        let (solved, steps) = (trajectory.outcome.solved, trajectory.outcome.steps);
        let (t, bodies) = if samples {
            let tracks = trajectory.bodies.into_iter();
            let bodies = tracks.map(|b| (b.name, BodyTrack { x: b.x, y: b.y, angle: b.angle })).collect();
            (Some(trajectory.times), Some(bodies))
        } else {
            (None, None)
        };
        ResultOut { valid: true, reason: None, solved, steps, contacts, t, bodies }
    }
}

impl<'de> Deserialize<'de> for ActionIn {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> std::result::Result<Self, D::Error> {
        // Not derived: an untagged enum's errors name neither the place nor what is allowed.
        deserializer.deserialize_any(ActionVisitor)
    }
}

struct ActionVisitor;

impl<'de> Visitor<'de> for ActionVisitor {
    type Value = ActionIn;

    fn expecting(&self, f: &mut fmt::Formatter) -> fmt::Result {
        f.write_str("an array of numbers from 0 to 1, or the whole number of a discrete action")
    }

    fn visit_u64<E>(self, index: u64) -> std::result::Result<ActionIn, E> {
        Ok(ActionIn::Index(index))
    }

    fn visit_seq<A: SeqAccess<'de>>(self, mut seq: A) -> std::result::Result<ActionIn, A::Error> {
        let mut values = Vec::with_capacity(seq.size_hint().unwrap_or(4).min(16));
        while let Some(v) = seq.next_element()? {
            values.push(v);
        }
        Ok(ActionIn::Vector(values))
    }
}
