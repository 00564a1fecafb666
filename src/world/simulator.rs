//! Simulation of batches of rollouts.

use super::batch_run::BatchRun;
use super::compile::{RolloutModel, compile};
use super::engine::Engine;
use super::lanes::gpu::{self, Accelerator, MeasuredSpeed};
use super::lanes::{BatchSettings, SimdLevel};
use super::observe::ObservationSchedule;
use super::partition::{Partition, lanes_units, partition};
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

    /// Runs rollouts on this, in place of this machine's graphics processor: for tests.
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
        let compile = |rollout: &Rollout| self.compile(rollout);
        let Partition { units, accelerated } = partition(rollouts, engine, self.budget, compile)?;
        let batch = BatchRun { rollouts, compile, keep, budget: self.budget, settings: self.settings };
        let mut results: Vec<Option<T>> = rollouts.iter().map(|_| None).collect();
        let mut store =
            |done: Vec<(usize, T)>| done.into_iter().for_each(|(i, result)| results[i] = Some(result));
        let own_speed = MeasuredSpeed::default();
        for group in accelerated {
            let found = match self.accelerator {
                Some(accelerator) => Ok((accelerator, &own_speed)),
                None => {
                    gpu::find().map(|device| (device.accelerator.as_ref() as &dyn Accelerator, &device.speed))
                }
            };
            store(match (engine, found) {
                (Engine::Auto, Ok((accelerator, speed))) => batch.on_faster(accelerator, speed, &group)?,
                (Engine::Auto, Err(_)) => batch.on_cpu(lanes_units(&group.indices))?,
                (_, found) => batch.on_accelerator(found?.0, &group)?,
            });
        }
        store(batch.on_cpu(units)?);
        complete(results)
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
