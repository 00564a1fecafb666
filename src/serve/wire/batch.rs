//! Batches: many worlds in one request.

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use super::action::ActionIn;
use super::array::{Array, Data};
use super::bulk::Bulk;
use super::episode::{SplitIn, end_name};
use super::physics::{EffectIn, LatentsIn};
use super::strict::Object;
use super::world::{CreateWorld, WorldKind, WorldOut};
use crate::error::{Error, Result};
use crate::session::{Autoreset, Reset, Start, Turned};
use crate::task::Scene;

/// Worlds to make, alike but for their seeds; otherwise as one world.
#[derive(Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct CreateWorlds {
    /// How many, 1 to 4096.
    pub count: u64,
    /// One for each world; `seed`, `seed` + 1, ... if absent.
    pub seeds: Option<Vec<u64>>,
    /// A family (`bowling`) or one task (`bowling:017`).
    pub task: Option<String>,
    /// An `iplw.scene/1` document with `action` and `goal`.
    #[schema(value_type = Option<Object>)]
    pub scene: Option<Object<Scene>>,
    /// `sim` if absent.
    pub kind: Option<WorldKind>,
    /// `auto`, or the name of an engine.
    pub engine: Option<String>,
    /// Latent factors.
    #[schema(value_type = Option<LatentsIn>)]
    pub latents: Option<Object<LatentsIn>>,
    /// Effects beyond gravity and contact.
    #[schema(value_type = Option<Vec<EffectIn>>)]
    pub effects: Option<Vec<Object<EffectIn>>>,
    /// Kept share of velocity per second, in (0, 1].
    pub damping: Option<f64>,
    /// Standard deviation of observation noise, m; real worlds only.
    pub noise: Option<f64>,
    /// Most valid attempts in each world; real worlds only.
    pub budget: Option<u64>,
    /// Whether latents and effects are kept secret; default true for real, false for sim.
    pub sealed: Option<bool>,
    /// Seed of the first world.
    pub seed: Option<u64>,
}

/// The worlds made.
#[derive(Serialize, ToSchema)]
pub struct WorldsMade {
    /// Their ids, in the order of the seeds.
    pub worlds: Vec<String>,
    /// The first of them.
    pub world: WorldOut,
}

/// Worlds by id, different ones.
#[derive(Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct WorldIds {
    pub worlds: Vec<String>,
}

/// Episodes to start.
#[derive(Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct ResetWorlds {
    /// Ids, different ones.
    pub worlds: Vec<String>,
    /// One for each world: starts its sequence of tasks anew.
    pub seeds: Option<Vec<Option<u64>>>,
    /// One for each world: id of the task; drawn from the world's sequence where `null`.
    pub tasks: Option<Vec<Option<String>>>,
    /// Part of the family to draw from; `train` if absent.
    pub split: Option<SplitIn>,
    /// One for each world: whether it is reset at all.
    pub mask: Option<Vec<bool>>,
}

/// The starts of episodes, in the order of the worlds. What was not reset has zeros and `null`.
#[derive(Serialize, ToSchema)]
pub struct WorldsReset {
    /// A row for each world.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schema(value_type = Vec<Vec<f64>>, required = true)]
    pub observation: Option<Array>,
    pub task: Vec<Option<String>>,
    pub split: Vec<Option<SplitIn>>,
}

/// One action in each of many worlds. If any of them is refused, nothing is done in any.
#[derive(Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct StepWorlds {
    /// Ids, different ones.
    pub worlds: Vec<String>,
    /// One for each world: a vector, or the number of a discrete action.
    pub actions: Vec<ActionIn>,
    /// What becomes of a world whose episode has ended; `disabled` if absent.
    pub autoreset: Option<AutoresetIn>,
    /// Part of the family that such resets draw from; the one of the world's last reset if absent.
    pub split: Option<SplitIn>,
}

/// As Gymnasium's `AutoresetMode`: `disabled` (stepping it again is refused), `next_step` (the next step resets it and
/// ignores the action) or `same_step` (reset in the step that ended it).
#[derive(Clone, Copy, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum AutoresetIn {
    Disabled,
    NextStep,
    SameStep,
}

/// What the actions brought, in the order of the worlds.
#[derive(Serialize, ToSchema)]
pub struct WorldsStepped {
    /// A row for each world; with `same_step`, of the new episode where one began.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schema(value_type = Vec<Vec<f64>>, required = true)]
    pub observation: Option<Array>,
    /// 1 where the task was solved, else 0.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schema(value_type = Vec<f64>, required = true)]
    pub reward: Option<Array>,
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schema(value_type = Vec<bool>, required = true)]
    pub terminated: Option<Array>,
    /// Always false: a task takes one action.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schema(value_type = Vec<bool>, required = true)]
    pub truncated: Option<Array>,
    /// Whether the action could be placed.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schema(value_type = Vec<bool>, required = true)]
    pub valid: Option<Array>,
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schema(value_type = Vec<bool>, required = true)]
    pub solved: Option<Array>,
    /// Simulated time steps.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schema(value_type = Vec<u32>, required = true)]
    pub steps: Option<Array>,
    /// Begun contacts between movable bodies.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schema(value_type = Vec<u32>, required = true)]
    pub collisions: Option<Array>,
    /// Time steps that bodies spent on a surface, summed.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schema(value_type = Vec<u32>, required = true)]
    pub rolling_steps: Option<Array>,
    /// Valid attempts in the world so far.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schema(value_type = Vec<u64>, required = true)]
    pub interactions: Option<Array>,
    /// Whether the world was reset instead, its action ignored (`next_step`).
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schema(value_type = Vec<bool>, required = true)]
    pub reset: Option<Array>,
    /// Id of the task that `observation` is of.
    pub task: Vec<String>,
    /// Part of the family of the episode that began; `null` where none did.
    pub split: Vec<Option<SplitIn>>,
    /// Why the action could not be placed; `null` where it could.
    pub reason: Vec<Option<String>>,
    /// `horizon`, `goal` or `diverged`; `null` where nothing was simulated.
    pub end: Vec<Option<&'static str>>,
    /// With `same_step`: a row for each world, of the final state where an episode ended, else zeros.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schema(value_type = Option<Vec<Vec<f64>>>)]
    pub final_observation: Option<Array>,
    /// With `same_step`: id of the task whose episode ended, else `null`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub final_task: Option<Vec<Option<String>>>,
}

/// Most worlds in a request.
const MOST: u64 = 4096;

impl CreateWorlds {
    /// What each of them is made from, and their seeds.
    pub fn parts(self) -> Result<(CreateWorld, Vec<u64>)> {
        if !(1..=MOST).contains(&self.count) {
            return Err(Error::input("count", self.count, format!("a whole number from 1 to {MOST}")));
        }
        let first = self.seed.unwrap_or(0);
        let seeds = match self.seeds {
            None => (0..self.count).map(|i| first.wrapping_add(i)).collect(),
            Some(seeds) if self.seed.is_none() => {
                one_each("seeds", &seeds, self.count as usize)?;
                seeds
            }
            Some(_) => {
                return Err(Error::input("seed", first, "absent beside `seeds`"));
            }
        };
        let world = CreateWorld {
            task: self.task,
            scene: self.scene,
            kind: self.kind,
            engine: self.engine,
            latents: self.latents,
            effects: self.effects,
            damping: self.damping,
            noise: self.noise,
            budget: self.budget,
            sealed: self.sealed,
            seed: None,
        };
        Ok((world, seeds))
    }
}

impl WorldIds {
    /// The ids; errors if there are none.
    pub fn checked(self) -> Result<Vec<String>> {
        some(&self.worlds)?;
        Ok(self.worlds)
    }
}

impl ResetWorlds {
    /// The ids, and what each world is reset to, if it is.
    pub fn parts(self) -> Result<(Vec<String>, Vec<Option<Reset>>)> {
        let n = some(&self.worlds)?;
        if let Some(seeds) = &self.seeds {
            one_each("seeds", seeds, n)?;
        }
        if let Some(tasks) = &self.tasks {
            one_each("tasks", tasks, n)?;
        }
        if let Some(mask) = &self.mask {
            one_each("mask", mask, n)?;
        }
        let mut tasks = self.tasks.unwrap_or_default();
        let split = self.split.map(|s| s.into());
        let one = |i: usize| {
            let meant = self.mask.as_ref().is_none_or(|m| m[i]);
            meant.then(|| Reset {
                seed: self.seeds.as_ref().and_then(|s| s[i]),
                task: tasks.get_mut(i).and_then(Option::take),
                split,
            })
        };
        let resets = (0..n).map(one).collect();
        Ok((self.worlds, resets))
    }
}

impl StepWorlds {
    /// The ids, checked to be there and to have an action each.
    pub fn checked(&self) -> Result<()> {
        let n = some(&self.worlds)?;
        one_each("actions", &self.actions, n)
    }
}

fn some(worlds: &[String]) -> Result<usize> {
    match worlds.len() as u64 {
        1..=MOST => Ok(worlds.len()),
        0 => Err(Error::input("worlds", "empty", "one id or more")),
        asked => Err(Error::TooLarge { what: "worlds", asked, limit: MOST, advice: "send several batches" }),
    }
}

fn one_each<T>(field: &str, values: &[T], n: usize) -> Result<()> {
    if values.len() == n {
        return Ok(());
    }
    Err(Error::input(field, format!("{} values", values.len()), format!("{n}, one for each world")))
}

impl WorldsReset {
    /// Starts in the order of the worlds, `features` numbers an observation.
    pub fn new(starts: Vec<Option<Start>>, features: usize) -> WorldsReset {
        let (mut rows, mut task, mut split) = (Vec::new(), Vec::new(), Vec::new());
        for start in starts {
            task.push(start.as_ref().map(|s| s.task.clone()));
            split.push(start.as_ref().map(|s| s.split.into()));
            rows.push(start.map_or_else(|| vec![0.0; features], |s| s.observation));
        }
        WorldsReset { observation: Some(Array::rows(rows)), task, split }
    }
}

impl WorldsStepped {
    /// What was brought, in the order of the worlds, and each world's counter.
    pub fn new(turned: Vec<Turned>, interactions: Vec<u64>, autoreset: Autoreset) -> WorldsStepped {
        let n = turned.len();
        let steps = || turned.iter().map(|t| t.step.as_ref());
        let flags = |of: fn(&crate::session::Step) -> bool, without: bool| {
            Some(Array::line(Data::Bool(steps().map(|s| s.map_or(without, of)).collect())))
        };
        let counts = |of: fn(&crate::session::Step) -> u32| {
            Some(Array::line(Data::U4(steps().map(|s| s.map_or(0, of)).collect())))
        };
        let reward = steps().map(|s| s.map_or(0.0, |s| s.reward)).collect();
        let same_step = autoreset == Autoreset::SameStep;
        let reason = steps().map(|s| s.and_then(|s| s.invalid.clone())).collect();
        let end = steps().map(|s| s.and_then(|s| s.end).map(end_name)).collect();
        let out = WorldsStepped {
            observation: None,
            reward: Some(Array::line(Data::F8(reward))),
            terminated: flags(|s| s.terminated, false),
            truncated: Some(Array::line(Data::Bool(vec![false; n]))),
            valid: flags(|s| s.invalid.is_none(), true),
            solved: flags(|s| s.solved, false),
            steps: counts(|s| s.steps),
            collisions: counts(|s| s.collisions),
            rolling_steps: counts(|s| s.rolling_steps),
            interactions: Some(Array::line(Data::U8(interactions))),
            reset: Some(Array::line(Data::Bool(steps().map(|s| s.is_none()).collect()))),
            task: Vec::new(),
            split: turned.iter().map(|t| t.start.as_ref().map(|s| s.split.into())).collect(),
            reason,
            end,
            final_observation: None,
            final_task: None,
        };
        let (mut rows, mut task) = (Vec::with_capacity(n), Vec::with_capacity(n));
        let (mut final_rows, mut final_task) = (Vec::new(), Vec::new());
        for one in turned {
            let (now, ended) = match (one.start, one.step) {
                (Some(start), step) => {
                    ((start.observation, start.task), step.map(|s| (s.observation, s.task)))
                }
                (None, Some(step)) => ((step.observation, step.task), None),
                (None, None) => ((Vec::new(), String::new()), None),
            };
            if same_step {
                final_task.push(ended.as_ref().map(|e| e.1.clone()));
                final_rows.push(ended.map_or_else(|| vec![0.0; now.0.len()], |e| e.0));
            }
            rows.push(now.0);
            task.push(now.1);
        }
        WorldsStepped {
            observation: Some(Array::rows(rows)),
            task,
            final_observation: same_step.then(|| Array::rows(final_rows)),
            final_task: same_step.then_some(final_task),
            ..out
        }
    }
}

impl From<AutoresetIn> for Autoreset {
    fn from(mode: AutoresetIn) -> Autoreset {
        match mode {
            AutoresetIn::Disabled => Autoreset::Disabled,
            AutoresetIn::NextStep => Autoreset::NextStep,
            AutoresetIn::SameStep => Autoreset::SameStep,
        }
    }
}

impl Bulk for WorldsReset {
    fn bulk(&mut self) -> Vec<(&'static str, Array)> {
        self.observation.take().map(|a| ("observation", a)).into_iter().collect()
    }
}

impl Bulk for WorldsStepped {
    fn bulk(&mut self) -> Vec<(&'static str, Array)> {
        let all = [
            ("observation", &mut self.observation),
            ("reward", &mut self.reward),
            ("terminated", &mut self.terminated),
            ("truncated", &mut self.truncated),
            ("valid", &mut self.valid),
            ("solved", &mut self.solved),
            ("steps", &mut self.steps),
            ("collisions", &mut self.collisions),
            ("rolling_steps", &mut self.rolling_steps),
            ("interactions", &mut self.interactions),
            ("reset", &mut self.reset),
            ("final_observation", &mut self.final_observation),
        ];
        all.into_iter().filter_map(|(name, array)| Some((name, array.take()?))).collect()
    }
}

impl Bulk for WorldsMade {}
