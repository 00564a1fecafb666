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
mod contact_criteria;
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
pub use lanes::gpu::{Accelerator, Work};
use lanes::{Topology, gpu};
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
    /// The batched engine on a graphics processor; rollouts that it does not support run as with `auto`.
    Gpu,
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
    accelerator: Option<&'a dyn Accelerator>,
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
        Simulator { engines, budget: &Unlimited, settings, accelerator: None }
    }

    /// Checks the budget about every millisecond; an error of the budget ends the simulation.
    pub fn budget(self, budget: &'a dyn Budget) -> Simulator<'a> {
        Simulator { budget, ..self }
    }

    /// Settings of the batched engine, which change the computing time only: for tests and benchmarks.
    pub fn settings(self, settings: BatchSettings) -> Simulator<'a> {
        Simulator { settings, ..self }
    }

    /// What [`Engine::Gpu`] runs on, in place of this machine's graphics processor: for tests.
    pub fn accelerator(self, accelerator: &'a dyn Accelerator) -> Simulator<'a> {
        Simulator { accelerator: Some(accelerator), ..self }
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
        let (work, on_accelerator) = split_off_accelerated(partition(rollouts, engine, budget)?);
        let (mut accelerated, unfinished) = self.accelerate(rollouts, on_accelerator, &keep)?;
        let work: Vec<WorkUnit> = work.into_iter().chain(unfinished).collect();
        let run = |unit: WorkUnit| -> Result<Vec<(usize, T)>> {
            budget.check()?;
            match unit {
                WorkUnit::Rapier(index) => {
                    let model = compile(&rollouts[index])?;
                    let truth = rapier::run(&model, budget)?;
                    Ok(vec![(index, keep(index, apply_sensors(model.sensors.as_ref(), truth)))])
                }
                WorkUnit::Lanes(indices) | WorkUnit::Accelerated(indices) => {
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
        for unit in finished {
            accelerated.extend(unit?);
        }
        let mut results: Vec<Option<T>> = rollouts.iter().map(|_| None).collect();
        for (index, result) in accelerated {
            results[index] = Some(result);
        }
        complete(results)
    }

    /// Runs units on the accelerator; returns their results, and units of rollouts that must run on the processor.
    fn accelerate<T: Send>(
        &self,
        rollouts: &[Rollout],
        units: Vec<Vec<usize>>,
        keep: &(impl Fn(usize, Trajectory) -> T + Sync),
    ) -> Result<(Vec<(usize, T)>, Vec<WorkUnit>)> {
        let (mut results, mut rest) = (Vec::new(), Vec::new());
        if units.is_empty() {
            return Ok((results, rest));
        }
        let accelerator: &dyn Accelerator = match self.accelerator {
            Some(accelerator) => accelerator,
            None => gpu::find()?,
        };
        let done = |index: usize, model: &RolloutModel, truth: Trajectory| {
            keep(index, apply_sensors(model.sensors.as_ref(), truth))
        };
        for indices in units {
            self.budget.check()?;
            let (finished, unfinished) =
                gpu::run(accelerator, &indices, |index| compile(&rollouts[index]), done)?;
            results.extend(finished);
            rest.extend(unfinished.chunks(UNIT_SIZE_RANGE[1]).map(|part| WorkUnit::Lanes(part.to_vec())));
        }
        Ok((results, rest))
    }

    /// One batch per engine.
    fn map_mixed<T: Send>(
        &self,
        engines: &[Engine],
        rollouts: &[Rollout],
        keep: impl Fn(usize, Trajectory) -> T + Sync,
    ) -> Result<Vec<T>> {
        let mut results: Vec<Option<T>> = rollouts.iter().map(|_| None).collect();
        for engine in Engine::ALL {
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
    let model = compile(rollout)?;
    engine_for(engine, &model, &Topology::of(&model))
}

fn engine_for(engine: Engine, model: &RolloutModel, topology: &Topology) -> Result<Engine> {
    match (engine, lanes::takes(model)) {
        (Engine::Gpu, true) if gpu::supports(model, topology) => Ok(Engine::Gpu),
        (Engine::Gpu, true) => Ok(Engine::Lanes),
        (Engine::Rapier, _) | (Engine::Auto | Engine::Gpu, false) => Ok(Engine::Rapier),
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
    /// The same for one launch on an accelerator.
    Accelerated(Vec<usize>),
}

/// The units of the processor, and those of an accelerator.
fn split_off_accelerated(work: Vec<WorkUnit>) -> (Vec<WorkUnit>, Vec<Vec<usize>>) {
    let (mut processor, mut accelerator) = (Vec::new(), Vec::new());
    for unit in work {
        match unit {
            WorkUnit::Accelerated(indices) => accelerator.push(indices),
            unit => processor.push(unit),
        }
    }
    (processor, accelerator)
}

/// The engine and the topology of a group; without topology for the general engine.
#[derive(PartialEq)]
struct GroupKind {
    topology: Option<Topology>,
    /// Rollouts of a launch on an accelerator; `None` on the processor.
    launch: Option<usize>,
}

/// Indices of the rollouts of one kind.
type TopologyGroup = (GroupKind, Vec<usize>);

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
            let same_start = |other: &Rollout| rollout.contacts_established == other.contacts_established;
            if i > 0 && compile::is_variant_of(rollout, &rollouts[i - 1]) && same_start(&rollouts[i - 1]) {
                groups[last].1.push(chunk * UNIT_SIZE_RANGE[1] + i);
                continue;
            }
            let model = compile(rollout)?;
            let topology = Topology::of(&model);
            let kind = match engine_for(engine, &model, &topology)? {
                Engine::Lanes => GroupKind { topology: Some(topology), launch: None },
                Engine::Gpu => {
                    GroupKind { topology: Some(topology), launch: Some(gpu::launch_size(&model)) }
                }
                Engine::Rapier | Engine::Auto => GroupKind { topology: None, launch: None },
            };
            last = group(&mut groups, kind);
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
        for (kind, indices) in chunk? {
            let at = group(&mut groups, kind);
            groups[at].1.extend(indices);
        }
    }
    let share = rollouts.len().div_ceil(4 * rayon::current_num_threads());
    let size = share.clamp(UNIT_SIZE_RANGE[0], UNIT_SIZE_RANGE[1]);
    let parts = groups.into_iter().flat_map(|(kind, indices)| match kind {
        GroupKind { topology: None, .. } => {
            indices.into_iter().map(WorkUnit::Rapier).collect::<Vec<WorkUnit>>()
        }
        GroupKind { launch: Some(size), .. } => {
            indices.chunks(size).map(|part| WorkUnit::Accelerated(part.to_vec())).collect()
        }
        _ => indices.chunks(size).map(|part| WorkUnit::Lanes(part.to_vec())).collect(),
    });
    Ok(parts.collect())
}

/// Index of the group of a kind, added if there is none.
fn group(groups: &mut Vec<TopologyGroup>, kind: GroupKind) -> usize {
    groups.iter().rposition(|(k, _)| *k == kind).unwrap_or_else(|| {
        groups.push((kind, Vec::new()));
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

names!(Engine: Auto = "auto", Rapier = "rapier", Lanes = "lanes", Gpu = "gpu");

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
