//! Simulation of batches of rollouts.

use rayon::prelude::*;

use super::compile::{RolloutModel, compile};
use super::engine::Engine;
use super::lanes::gpu::{self, Accelerator};
use super::lanes::{self, BatchSettings, SimdLevel};
use super::observe::{ObservationSchedule, SensorChain};
use super::partition::{Partition, UNIT_SIZE_RANGE, WorkUnit, partition};
use super::rapier;
use super::rollout::Rollout;
use crate::budget::{Budget, Unlimited};
use crate::error::{Error, Result};
use crate::trajectory::Trajectory;

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
    /// Whether trajectories have samples between start and end.
    samples: bool,
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
        Simulator { engines, budget: &Unlimited, settings, accelerator: None, samples: true }
    }

    /// Checks the budget about every millisecond, on a GPU before each launch; an error of the budget ends the simulation.
    pub fn budget(self, budget: &'a dyn Budget) -> Simulator<'a> {
        Simulator { budget, ..self }
    }

    /// Settings of the batched engine, which change the computing time only: for tests and benchmarks.
    pub fn settings(self, settings: BatchSettings) -> Simulator<'a> {
        Simulator { settings, ..self }
    }

    /// Runs [`Engine::Gpu`] on this, in place of this machine's graphics processor: for tests.
    pub fn accelerator(self, accelerator: &'a dyn Accelerator) -> Simulator<'a> {
        Simulator { accelerator: Some(accelerator), ..self }
    }

    /// The trajectories of a batch.
    pub fn run(&self, rollouts: &[Rollout]) -> Result<Vec<Trajectory>> {
        self.map(rollouts, |_, trajectory| trajectory)
    }

    /// Whether each rollout of a batch solves its task, without samples.
    pub fn solved(&self, rollouts: &[Rollout]) -> Result<Vec<bool>> {
        self.without_samples().map(rollouts, |_, trajectory| trajectory.solved())
    }

    /// A simulator whose trajectories have outcomes and counts, but no contact events and only the first and the last sample.
    pub fn without_samples(self) -> Simulator<'a> {
        Simulator { samples: false, ..self }
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
        let Partition { mut units, launches } =
            partition(rollouts, engine, budget, |rollout| self.compile(rollout))?;
        let mut all = self.launch(rollouts, launches, &keep, &mut units)?;
        let run = |unit: WorkUnit| -> Result<Vec<(usize, T)>> {
            budget.check()?;
            match unit {
                WorkUnit::Rapier(index) => {
                    let model = self.compile(&rollouts[index])?;
                    let truth = rapier::run(&model, budget)?;
                    Ok(vec![(index, keep(index, apply_sensors(model.sensors.as_ref(), truth)))])
                }
                WorkUnit::Lanes(indices) => {
                    let results = Vec::with_capacity(indices.len());
                    let (indices, sensors) = (indices.into_iter(), Vec::new());
                    let mut source = UnitSource {
                        simulator: self,
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
        let finished: Vec<Result<Vec<(usize, T)>>> = match units.len() {
            0 | 1 => units.into_iter().map(run).collect(),
            _ => units.into_par_iter().map(run).collect(),
        };
        for unit in finished {
            all.extend(unit?);
        }
        let mut results: Vec<Option<T>> = rollouts.iter().map(|_| None).collect();
        for (index, result) in all {
            results[index] = Some(result);
        }
        complete(results)
    }

    /// Runs launches on the accelerator; returns their results, and adds to `units` what must run on the CPU.
    fn launch<T: Send>(
        &self,
        rollouts: &[Rollout],
        launches: Vec<Vec<usize>>,
        keep: &(impl Fn(usize, Trajectory) -> T + Sync),
        units: &mut Vec<WorkUnit>,
    ) -> Result<Vec<(usize, T)>> {
        let mut results = Vec::new();
        if launches.is_empty() {
            return Ok(results);
        }
        let accelerator: &dyn Accelerator = match self.accelerator {
            Some(accelerator) => accelerator,
            None => gpu::find()?,
        };
        let keep_measured = |index: usize, model: &RolloutModel, truth: Trajectory| {
            keep(index, apply_sensors(model.sensors.as_ref(), truth))
        };
        for indices in launches {
            self.budget.check()?;
            let done =
                gpu::run(accelerator, &indices, |index| self.compile(&rollouts[index]), keep_measured)?;
            results.extend(done.results);
            units.extend(
                done.overflowed.chunks(UNIT_SIZE_RANGE[1]).map(|part| WorkUnit::Lanes(part.to_vec())),
            );
        }
        Ok(results)
    }

    /// The model of a rollout, which observes what is kept.
    fn compile(&self, rollout: &Rollout) -> Result<RolloutModel> {
        let mut model = compile(rollout)?;
        if !self.samples {
            (model.schedule, model.sensors) = (ObservationSchedule::At(Vec::new()), None);
            model.records_contacts = false;
        }
        Ok(model)
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

/// Feeds a unit of rollouts to the batched engine.
struct UnitSource<'a, K, T> {
    simulator: &'a Simulator<'a>,
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
        let mut model = self.simulator.compile(&self.rollouts[index]).ok()?;
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
