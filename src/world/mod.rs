//! Simulation: scene, latents and effects in, trajectory out.
//!
//! Semantics, the same for every engine:
//! - SI units; gravity is the scene's.
//! - Friction and restitution of a contact follow the scene's mixing rules (by default products, as in
//!   Pymunk).
//! - Each time step, in this order: effects change velocities, gravity acts, contacts are resolved, positions
//!   advance. With the effect `linear_drag` this is Pymunk's damping.
//! - With sensor effects, samples are the measured values; contacts, goals and outcomes are the true ones
//!   (see [`observe`]).
//! - A latent factor sets the coefficient of every carrier, or the density of every carrying body.

pub mod compile;
mod compiled_intervention;
pub mod effect;
pub mod goal;
mod intervene;
mod lanes;
pub mod latent;
mod observe;
pub mod parameter_space;
mod rapier;
mod record;
mod rollout;
mod rollout_model;
mod state;

use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use crate::budget::{Budget, Unlimited};
use crate::error::{Error, Result};
use crate::names::names;
use crate::trajectory::Trajectory;
use compile::{RolloutModel, compile};
use lanes::Topology;
pub use lanes::{BatchSettings, SimdLevel};
#[cfg(feature = "levels")]
pub use lanes::{OperationCounts, operations};
pub use latent::Latents;
use observe::SensorChain;
pub use observe::observe;
pub use parameter_space::{EffectParameter, LINEAR_DRAG, ParameterSpace, ParameterVector};
pub use rollout::Rollout;

/// The physics engine.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Engine {
    /// The fastest engine that supports the scene.
    #[default]
    Auto,
    /// The general engine: rapier2d.
    Rapier,
    /// The batched engine: discs, and bodies of any shape with up to 20,000 pairs of pieces.
    Lanes,
}

/// Simulates batches of rollouts: a builder with the engine, the budget and the batch settings.
///
/// Batches run in parallel on rayon's pool. Results are in the order of the rollouts and have the same bits for any number
/// of threads, any budget and any settings.
#[derive(Clone, Copy)]
pub struct Simulator<'a> {
    engines: EngineChoice<'a>,
    budget: &'a dyn Budget,
    settings: BatchSettings,
}

/// The engine of each rollout in a batch.
#[derive(Clone, Copy)]
enum EngineChoice<'a> {
    Common(Engine),
    PerRollout(&'a [Engine]),
}

impl<'a> Simulator<'a> {
    /// A simulator with one engine for all rollouts, without a budget, at the widest SIMD level.
    pub fn new(engine: Engine) -> Simulator<'a> {
        Simulator::with_engines(EngineChoice::Common(engine))
    }

    /// A simulator with an engine for each rollout, in the order of the batch.
    pub fn per_rollout(engines: &'a [Engine]) -> Simulator<'a> {
        Simulator::with_engines(EngineChoice::PerRollout(engines))
    }

    fn with_engines(engines: EngineChoice<'a>) -> Simulator<'a> {
        let settings = BatchSettings { level: SimdLevel::best(), end_at_rest: true };
        Simulator { engines, budget: &Unlimited, settings }
    }

    /// Checks the budget about every millisecond; an error of the budget ends the simulation.
    pub fn budget(self, budget: &'a dyn Budget) -> Simulator<'a> {
        Simulator { budget, ..self }
    }

    /// Settings of the batched engine, which change the computing time only: for tests and benchmarks.
    pub fn settings(self, settings: BatchSettings) -> Simulator<'a> {
        Simulator { settings, ..self }
    }

    /// The trajectories of a batch.
    pub fn run(&self, rollouts: &[Rollout]) -> Result<Vec<Trajectory>> {
        self.map(rollouts, |_, trajectory| trajectory)
    }

    /// The trajectory of one rollout.
    pub fn one(&self, rollout: Rollout) -> Result<Trajectory> {
        self.run(&[rollout]).map(|mut trajectories| trajectories.swap_remove(0))
    }

    /// `keep(index, trajectory)` of each trajectory of a batch, so that memory does not grow with the length of
    /// trajectories.
    pub fn map<T: Send>(
        &self,
        rollouts: &[Rollout],
        keep: impl Fn(usize, Trajectory) -> T + Sync,
    ) -> Result<Vec<T>> {
        match self.engines {
            EngineChoice::Common(engine) => self.map_batch(engine, rollouts, keep),
            EngineChoice::PerRollout(engines) => self.map_mixed(engines, rollouts, keep),
        }
    }

    fn map_batch<T: Send>(
        &self,
        engine: Engine,
        rollouts: &[Rollout],
        keep: impl Fn(usize, Trajectory) -> T + Sync,
    ) -> Result<Vec<T>> {
        let (budget, settings) = (self.budget, self.settings);
        let work = partition(rollouts, engine, budget)?;
        let run = |unit: WorkUnit| -> Result<Vec<(usize, T)>> {
            budget.check()?;
            match unit {
                WorkUnit::Rapier(index) => {
                    let model = compile(&rollouts[index])?;
                    let truth = rapier::run(&model, budget)?;
                    Ok(vec![(index, keep(index, apply_sensors(model.sensors.as_ref(), truth)))])
                }
                WorkUnit::Lanes(indices) => {
                    let results = Vec::with_capacity(indices.len());
                    let (indices, sensors) = (indices.into_iter(), Vec::new());
                    let mut source = UnitSource {
                        rollouts,
                        indices,
                        keep: &keep,
                        results,
                        sensors,
                        budget,
                        cancelled: None,
                    };
                    lanes::run(&mut source, settings);
                    source.cancelled.map_or(Ok(source.results), Err)
                }
            }
        };
        // A single unit runs on the calling thread.
        let finished: Vec<Result<Vec<(usize, T)>>> = match work.len() {
            0 | 1 => work.into_iter().map(run).collect(),
            _ => work.into_par_iter().map(run).collect(),
        };
        let mut results: Vec<Option<T>> = rollouts.iter().map(|_| None).collect();
        for unit in finished {
            for (index, result) in unit? {
                results[index] = Some(result);
            }
        }
        complete(results)
    }

    /// One batch per engine.
    fn map_mixed<T: Send>(
        &self,
        engines: &[Engine],
        rollouts: &[Rollout],
        keep: impl Fn(usize, Trajectory) -> T + Sync,
    ) -> Result<Vec<T>> {
        let mut results: Vec<Option<T>> = rollouts.iter().map(|_| None).collect();
        for engine in [Engine::Auto, Engine::Rapier, Engine::Lanes] {
            let indices: Vec<usize> = (0..rollouts.len()).filter(|i| engines[*i] == engine).collect();
            let batch: Vec<Rollout> = indices.iter().map(|i| rollouts[*i]).collect();
            let batch_results =
                self.map_batch(engine, &batch, |k, trajectory| keep(indices[k], trajectory))?;
            for (i, result) in indices.iter().zip(batch_results) {
                results[*i] = Some(result);
            }
        }
        complete(results)
    }
}

/// All results; an error if one is missing.
fn complete<T>(results: Vec<Option<T>>) -> Result<Vec<T>> {
    results.into_iter().map(|r| r.ok_or_else(|| Error::Failed("a rollout has no result".into()))).collect()
}

fn apply_sensors(view: Option<&SensorChain>, truth: Trajectory) -> Trajectory {
    match view {
        Some(view) => view.measure(truth),
        None => truth,
    }
}

/// The engine that a simulation of the rollout uses.
pub fn select_engine(engine: Engine, rollout: &Rollout) -> Result<Engine> {
    engine_for(engine, &compile(rollout)?)
}

fn engine_for(engine: Engine, model: &RolloutModel) -> Result<Engine> {
    match (engine, lanes::takes(model)) {
        (Engine::Rapier, _) | (Engine::Auto, false) => Ok(Engine::Rapier),
        (Engine::Auto | Engine::Lanes, true) => Ok(Engine::Lanes),
        (Engine::Lanes, false) => Err(Error::input(
            "engine",
            "\"lanes\"",
            format!("\"auto\" or \"rapier\" for a scene of more than {} pairs of pieces", lanes::MAX_PAIRS),
        )),
    }
}

/// A unit of work for one thread: indices of rollouts.
enum WorkUnit {
    Rapier(usize),
    /// Rollouts of one topology.
    Lanes(Vec<usize>),
}

/// Indices of the rollouts of one topology; `None` for the general engine's.
type TopologyGroup = (Option<Topology>, Vec<usize>);

/// Minimum and maximum number of rollouts per unit: enough to keep all lanes busy until near the end, and
/// enough units for all threads.
const UNIT_SIZE_RANGE: [usize; 2] = [2 * effect::LANES, 32 * effect::LANES];

/// Up to this many rollouts are checked on the calling thread.
const MAX_SERIAL_ROLLOUTS: usize = effect::LANES;

/// Checks every rollout, so that invalid input is rejected before any work is done, and partitions the work.
/// The partition does not affect results. Compiled models are discarded: memory stays constant in the number
/// of rollouts.
fn partition(rollouts: &[Rollout], engine: Engine, budget: &dyn Budget) -> Result<Vec<WorkUnit>> {
    let check_chunk = |(chunk, rollouts): (usize, &[Rollout])| -> Result<Vec<TopologyGroup>> {
        let mut groups: Vec<TopologyGroup> = Vec::new();
        // Group of the previous rollout.
        let mut last = 0;
        budget.check()?;
        for (i, rollout) in rollouts.iter().enumerate() {
            if i > 0 && compile::is_variant_of(rollout, &rollouts[i - 1]) {
                groups[last].1.push(chunk * UNIT_SIZE_RANGE[1] + i);
                continue;
            }
            let model = compile(rollout)?;
            let topology = match engine_for(engine, &model)? {
                Engine::Lanes => Some(Topology::of(&model)),
                Engine::Rapier | Engine::Auto => None,
            };
            last = group(&mut groups, topology);
            groups[last].1.push(chunk * UNIT_SIZE_RANGE[1] + i);
        }
        Ok(groups)
    };
    let checked_chunks: Vec<Result<Vec<TopologyGroup>>> = match rollouts.len() {
        0..=MAX_SERIAL_ROLLOUTS => rollouts.chunks(UNIT_SIZE_RANGE[1]).enumerate().map(check_chunk).collect(),
        _ => rollouts.par_chunks(UNIT_SIZE_RANGE[1]).enumerate().map(check_chunk).collect(),
    };
    let mut groups = Vec::new();
    for chunk in checked_chunks {
        for (topology, indices) in chunk? {
            let at = group(&mut groups, topology);
            groups[at].1.extend(indices);
        }
    }
    let share = rollouts.len().div_ceil(4 * rayon::current_num_threads());
    let size = share.clamp(UNIT_SIZE_RANGE[0], UNIT_SIZE_RANGE[1]);
    let parts = groups.into_iter().flat_map(|(topology, indices)| match topology {
        None => indices.into_iter().map(WorkUnit::Rapier).collect::<Vec<_>>(),
        Some(_) => indices.chunks(size).map(|c| WorkUnit::Lanes(c.to_vec())).collect(),
    });
    Ok(parts.collect())
}

/// Index of the group with the topology, added if there is none.
fn group(groups: &mut Vec<TopologyGroup>, topology: Option<Topology>) -> usize {
    groups.iter().rposition(|(t, _)| *t == topology).unwrap_or_else(|| {
        groups.push((topology, Vec::new()));
        groups.len() - 1
    })
}

/// Feeds a unit of rollouts to the batched engine.
struct UnitSource<'a, K, T> {
    rollouts: &'a [Rollout<'a>],
    indices: std::vec::IntoIter<usize>,
    keep: &'a K,
    results: Vec<(usize, T)>,
    /// Sensors of the rollouts in progress that have any, by index.
    sensors: Vec<(usize, SensorChain)>,
    budget: &'a dyn Budget,
    /// The reason why it was cancelled, if it was.
    cancelled: Option<Error>,
}

impl<T, K: Fn(usize, Trajectory) -> T> lanes::RolloutSource for UnitSource<'_, K, T> {
    fn next(&mut self) -> Option<(usize, RolloutModel)> {
        let index = self.indices.next()?;
        // `partition` has already compiled it without error; a rollout that fails now is reported as
        // missing.
        let mut model = compile(&self.rollouts[index]).ok()?;
        self.sensors.extend(model.sensors.take().map(|sensors| (index, sensors)));
        Some((index, model))
    }

    fn should_continue(&mut self) -> bool {
        self.cancelled = self.budget.check().err();
        self.cancelled.is_none()
    }

    fn done(&mut self, index: usize, truth: Trajectory) {
        let view =
            self.sensors.iter().position(|(i, _)| *i == index).map(|at| self.sensors.swap_remove(at).1);
        let trajectory = apply_sensors(view.as_ref(), truth);
        self.results.push((index, (self.keep)(index, trajectory)));
    }
}

names!(Engine: Auto = "auto", Rapier = "rapier", Lanes = "lanes");

impl Engine {
    /// The engine named `name`.
    pub fn from_name(name: &str) -> Result<Engine> {
        Engine::named(name).ok_or_else(|| Error::not_found("engine", name, Engine::ALL.map(Engine::name)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::task::scene::Goal;
    use crate::task::{Placement, family};

    /// Bowling scenes with strong drag and friction come to rest early; the early end must not change
    /// results.
    #[test]
    fn early_end_at_rest_keeps_all_bits() {
        let mut scenes = Vec::new();
        for (i, scene) in family("bowling").unwrap().candidates(0).enumerate().take(60) {
            let space = scene.action.as_ref().unwrap();
            let action = space.at(i * 7919 % space.count()).unwrap();
            if let Placement::Valid(mut placed) = space.place(&scene, &action) {
                placed.damping = Some(0.01);
                placed.goal = Some(Goal::Contact {
                    bodies: ["green".into(), "floor".into()],
                    hold_s: f64::from(i as u32 % 12),
                    tolerance: 0.02,
                    stop: (i % 3 == 0).then_some(false),
                });
                scenes.push(*placed);
            }
        }
        let rollouts: Vec<Rollout> = scenes.iter().map(Rollout::of).collect();
        let run = |end_at_rest| {
            let settings = BatchSettings { level: SimdLevel::best(), end_at_rest };
            Simulator::new(Engine::Lanes).settings(settings).run(&rollouts).unwrap()
        };
        let (quick, slow) = (run(true), run(false));
        assert_eq!(quick, slow);
        let solved = slow.iter().filter(|t| t.solved()).count();
        let rests = |t: &Trajectory| {
            t.bodies
                .iter()
                .all(|b| b.x.iter().rev().zip(b.x.iter().rev().skip(1)).take(3).all(|(p, q)| p == q))
        };
        let resting = slow.iter().filter(|t| rests(t)).count();
        assert!(
            solved > 5 && resting > 5,
            "{solved} solved and {resting} at rest: the test shows too little"
        );
    }
}
