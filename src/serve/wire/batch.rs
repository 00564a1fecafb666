//! Batches: vector environments, many worlds in one request.

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use super::array::{Array, ArrayData};
use super::binary_arrays::BinaryArrays;
use super::episode::end_name;
use super::world::{CreateWorld, WorldOut};
use crate::commands::LatentsIn;
use crate::error::{Error, Result, check_count};
use crate::json::JsonObject;
use crate::session::{Action, Autoreset, BatchStepResult, EpisodeStart, Reset, WorldKind};
use crate::task::scene::EffectTerm;
use crate::task::{Scene, Split};

/// Worlds to create, identical except for their seeds.
#[derive(Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct CreateWorlds {
    /// Number of worlds, 1 to 4096.
    pub count: u64,
    /// One per world. Default: `seed`, `seed` + 1, ...
    pub seeds: Option<Vec<u64>>,
    /// A family (`bowling`) or one task (`bowling:017`).
    pub task: Option<String>,
    /// An `iplw.scene/1` document with `action` and `goal`.
    #[schema(value_type = Option<Object>)]
    pub scene: Option<JsonObject<Scene>>,
    /// Default: `sim`.
    pub kind: Option<WorldKind>,
    /// `auto`, or the name of an engine.
    pub engine: Option<String>,
    /// Latent factors.
    #[schema(value_type = Option<LatentsIn>)]
    pub latents: Option<JsonObject<LatentsIn>>,
    /// Effects beyond gravity and contact.
    #[schema(value_type = Option<Vec<EffectTerm>>)]
    pub effects: Option<Vec<JsonObject<EffectTerm>>>,
    /// Fraction of velocity kept per second, in (0, 1].
    pub damping: Option<f64>,
    /// Standard deviation of observation noise, m; real worlds only.
    pub noise: Option<f64>,
    /// Maximum number of valid attempts per world; real worlds only.
    pub budget: Option<u64>,
    /// Maximum number of valid attempts in an episode. With more than one, an episode continues with the same task until it is solved
    /// (the reward is its AUCCESS, 1 at the first attempt) or all attempts have failed. Default: 1.
    pub max_attempts: Option<u32>,
    /// Whether latents and effects are hidden. Default: true for real, false for sim.
    pub sealed: Option<bool>,
    /// Seed of the first world.
    pub seed: Option<u64>,
}

/// The created worlds.
#[derive(Serialize, ToSchema)]
pub struct CreatedWorlds {
    /// Ids in the order of the seeds.
    pub worlds: Vec<String>,
    /// The first world.
    pub world: WorldOut,
}

/// Distinct worlds by id.
#[derive(Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct WorldIds {
    pub worlds: Vec<String>,
}

/// Episodes to start.
#[derive(Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct ResetWorlds {
    /// Distinct ids.
    pub worlds: Vec<String>,
    /// One per world: restarts its task sequence.
    pub seeds: Option<Vec<Option<u64>>>,
    /// One per world: id of the task, or `null` for the next of its task sequence.
    pub tasks: Option<Vec<Option<String>>>,
    /// Split to draw from. Default: `train`.
    pub split: Option<Split>,
    /// One per world: whether to reset it.
    pub mask: Option<Vec<bool>>,
}

/// The new episodes, in the order of the worlds. Worlds that were not reset have zeros and `null`.
#[derive(Serialize, ToSchema)]
pub struct ResetWorldsOut {
    /// One row per world.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schema(value_type = Vec<Vec<f64>>, required = true)]
    pub observation: Option<Array>,
    pub task: Vec<Option<String>>,
    pub split: Vec<Option<Split>>,
}

/// One action per world. If any is rejected, nothing is done.
#[derive(Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct StepWorlds {
    /// Distinct ids.
    pub worlds: Vec<String>,
    /// One per world: a vector, or the index of a discrete action.
    pub actions: Vec<Action>,
    /// How to handle finished episodes. Default: `disabled`.
    pub autoreset: Option<Autoreset>,
    /// Split that automatic resets draw from. Default: the split of the world's last reset.
    pub split: Option<Split>,
}

/// Results of the steps, in the order of the worlds.
#[derive(Serialize, ToSchema)]
pub struct StepWorldsOut {
    /// One row per world; with `same_step`, of the new episode where one started.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schema(value_type = Vec<Vec<f64>>, required = true)]
    pub observation: Option<Array>,
    /// 0 where the task was not solved; else the episode's AUCCESS, 1 at the first attempt.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schema(value_type = Vec<f64>, required = true)]
    pub reward: Option<Array>,
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schema(value_type = Vec<bool>, required = true)]
    pub terminated: Option<Array>,
    /// Always false: the number of attempts is part of the task.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schema(value_type = Vec<bool>, required = true)]
    pub truncated: Option<Array>,
    /// Valid attempts in the episode so far.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schema(value_type = Vec<u32>, required = true)]
    pub attempt: Option<Array>,
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
    /// Number of contacts between movable bodies.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schema(value_type = Vec<u32>, required = true)]
    pub collisions: Option<Array>,
    /// Time steps that bodies spent on a surface, summed over bodies.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schema(value_type = Vec<u32>, required = true)]
    pub rolling_steps: Option<Array>,
    /// Valid attempts in the world so far.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schema(value_type = Vec<u64>, required = true)]
    pub interactions: Option<Array>,
    /// Whether the world was reset and its action ignored (`next_step`).
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schema(value_type = Vec<bool>, required = true)]
    pub reset: Option<Array>,
    /// Id of the task of `observation`.
    pub task: Vec<String>,
    /// Split of the new episode; `null` where none started.
    pub split: Vec<Option<Split>>,
    /// Why the action could not be placed; `null` where it could.
    pub reason: Vec<Option<String>>,
    /// `horizon`, `goal` or `diverged`; `null` where nothing was simulated.
    pub end: Vec<Option<&'static str>>,
    /// With `same_step`: one row per world, the final state where an episode ended, otherwise zeros.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schema(value_type = Option<Vec<Vec<f64>>>)]
    pub final_observation: Option<Array>,
    /// With `same_step`: id of the task whose episode ended, otherwise `null`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub final_task: Option<Vec<Option<String>>>,
}

/// Maximum number of worlds in a request.
const MAX_WORLDS_PER_BATCH: u64 = 4096;

impl CreateWorlds {
    /// The common configuration, and the seeds.
    pub fn parts(self) -> Result<(CreateWorld, Vec<u64>)> {
        check_count("count", self.count, 1, MAX_WORLDS_PER_BATCH)?;
        let first = self.seed.unwrap_or(0);
        let seeds = match self.seeds {
            None => (0..self.count).map(|i| first.wrapping_add(i)).collect(),
            Some(seeds) if self.seed.is_none() => {
                check_one_each("seeds", &seeds, self.count as usize)?;
                seeds
            }
            Some(_) => {
                return Err(Error::input("seed", first, "no `seed` together with `seeds`"));
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
            max_attempts: self.max_attempts,
            sealed: self.sealed,
            seed: None,
        };
        Ok((world, seeds))
    }
}

impl WorldIds {
    /// The ids; fails if there are none.
    pub fn checked(self) -> Result<Vec<String>> {
        check_world_count(&self.worlds)?;
        Ok(self.worlds)
    }
}

impl ResetWorlds {
    /// The ids, and the reset of each world that the mask selects.
    pub fn parts(self) -> Result<(Vec<String>, Vec<Option<Reset>>)> {
        let n = check_world_count(&self.worlds)?;
        if let Some(seeds) = &self.seeds {
            check_one_each("seeds", seeds, n)?;
        }
        if let Some(tasks) = &self.tasks {
            check_one_each("tasks", tasks, n)?;
        }
        if let Some(mask) = &self.mask {
            check_one_each("mask", mask, n)?;
        }
        let mut tasks = self.tasks.unwrap_or_default();
        let split = self.split;
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
    /// Checks that there are worlds, with one action each.
    pub fn checked(&self) -> Result<()> {
        let n = check_world_count(&self.worlds)?;
        check_one_each("actions", &self.actions, n)
    }
}

fn check_world_count(worlds: &[String]) -> Result<usize> {
    match worlds.len() as u64 {
        1..=MAX_WORLDS_PER_BATCH => Ok(worlds.len()),
        0 => Err(Error::input("worlds", "empty", "at least one id")),
        asked => Err(Error::TooLarge {
            what: "worlds",
            asked,
            limit: MAX_WORLDS_PER_BATCH,
            advice: "send several batches",
        }),
    }
}

fn check_one_each<T>(field: &str, values: &[T], n: usize) -> Result<()> {
    if values.len() == n {
        return Ok(());
    }
    Err(Error::input(field, format!("{} values", values.len()), format!("{n}, one per world")))
}

impl ResetWorldsOut {
    /// From episodes in the order of the worlds, with observations of length `features`.
    pub fn new(starts: Vec<Option<EpisodeStart>>, features: usize) -> ResetWorldsOut {
        let (mut rows, mut task, mut split) = (Vec::new(), Vec::new(), Vec::new());
        for start in starts {
            task.push(start.as_ref().map(|s| s.task.clone()));
            split.push(start.as_ref().map(|s| s.split));
            rows.push(start.map_or_else(|| vec![0.0; features], |s| s.observation));
        }
        ResetWorldsOut { observation: Some(Array::rows(rows)), task, split }
    }
}

impl StepWorldsOut {
    /// From step results and counters in the order of the worlds.
    pub fn new(turned: Vec<BatchStepResult>, interactions: Vec<u64>, autoreset: Autoreset) -> StepWorldsOut {
        let n = turned.len();
        let steps = || turned.iter().map(|t| t.step.as_ref());
        let flags = |of: fn(&crate::session::StepResult) -> bool, without: bool| {
            Some(Array::line(ArrayData::Bool(steps().map(|s| s.map_or(without, of)).collect())))
        };
        let counts = |of: fn(&crate::session::StepResult) -> u32| {
            Some(Array::line(ArrayData::U4(steps().map(|s| s.map_or(0, of)).collect())))
        };
        let reward = steps().map(|s| s.map_or(0.0, |s| s.reward)).collect();
        let same_step = autoreset == Autoreset::SameStep;
        let reason = steps().map(|s| s.and_then(|s| s.invalid.clone())).collect();
        let end = steps().map(|s| s.and_then(|s| s.end).map(end_name)).collect();
        let out = StepWorldsOut {
            observation: None,
            reward: Some(Array::line(ArrayData::F8(reward))),
            terminated: flags(|s| s.terminated, false),
            truncated: Some(Array::line(ArrayData::Bool(vec![false; n]))),
            attempt: counts(|s| s.attempt),
            valid: flags(|s| s.invalid.is_none(), true),
            solved: flags(|s| s.solved, false),
            steps: counts(|s| s.steps),
            collisions: counts(|s| s.collisions),
            rolling_steps: counts(|s| s.rolling_steps),
            interactions: Some(Array::line(ArrayData::U8(interactions))),
            reset: Some(Array::line(ArrayData::Bool(steps().map(|s| s.is_none()).collect()))),
            task: Vec::new(),
            split: turned.iter().map(|t| t.start.as_ref().map(|s| s.split)).collect(),
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
        StepWorldsOut {
            observation: Some(Array::rows(rows)),
            task,
            final_observation: same_step.then(|| Array::rows(final_rows)),
            final_task: same_step.then_some(final_task),
            ..out
        }
    }
}

impl BinaryArrays for ResetWorldsOut {
    fn take_arrays(&mut self) -> Vec<(&'static str, Array)> {
        self.observation.take().map(|a| ("observation", a)).into_iter().collect()
    }
}

impl BinaryArrays for StepWorldsOut {
    fn take_arrays(&mut self) -> Vec<(&'static str, Array)> {
        let all = [
            ("observation", &mut self.observation),
            ("reward", &mut self.reward),
            ("terminated", &mut self.terminated),
            ("truncated", &mut self.truncated),
            ("attempt", &mut self.attempt),
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

impl BinaryArrays for CreatedWorlds {}
