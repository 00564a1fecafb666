//! Runs the parts of a batch, on the CPU or on an accelerator.

use std::time::Instant;

use rayon::prelude::*;

use super::compile::RolloutModel;
use super::lanes::gpu::{self, Accelerator, LaunchResults, MeasuredSpeed};
use super::lanes::{self, BatchSettings};
use super::observe::SensorChain;
use super::partition::{AcceleratedGroup, UNIT_SIZE_RANGE, WorkUnit, lanes_units};
use super::rapier;
use super::rollout::Rollout;
use crate::budget::Budget;
use crate::error::{Error, Result};
use crate::trajectory::Trajectory;

/// Rollouts for each thread of the CPU in a measurement of its speed.
const MEASURED_ROLLOUTS_PER_THREAD: usize = 4 * UNIT_SIZE_RANGE[1];

/// A batch of rollouts, and what is done with each trajectory.
pub struct BatchRun<'a, C, K> {
    pub rollouts: &'a [Rollout<'a>],
    /// The model of a rollout.
    pub compile: C,
    /// The result of a rollout, from its index and trajectory.
    pub keep: K,
    pub budget: &'a dyn Budget,
    pub settings: BatchSettings,
}

impl<'a, C, K> BatchRun<'a, C, K>
where
    C: Fn(&Rollout) -> Result<RolloutModel> + Sync,
{
    /// Runs units on the CPU; returns indices and results. A single unit runs on the calling thread.
    pub fn on_cpu<T: Send>(&self, units: Vec<WorkUnit>) -> Result<Vec<(usize, T)>>
    where
        K: Fn(usize, Trajectory) -> T + Sync,
    {
        let run = |unit: WorkUnit| self.unit(unit);
        let finished: Vec<Result<Vec<(usize, T)>>> = match units.len() {
            0 | 1 => units.into_iter().map(run).collect(),
            _ => units.into_par_iter().map(run).collect(),
        };
        let mut results = Vec::new();
        for unit in finished {
            results.extend(unit?);
        }
        Ok(results)
    }

    /// Runs a group on the accelerator.
    pub fn on_accelerator<T: Send>(
        &self,
        accelerator: &dyn Accelerator,
        group: &AcceleratedGroup,
    ) -> Result<Vec<(usize, T)>>
    where
        K: Fn(usize, Trajectory) -> T + Sync,
    {
        let mut results = Vec::new();
        for part in group.indices.chunks(group.launch_size) {
            results.extend(self.launch(accelerator, part)?);
        }
        Ok(results)
    }

    /// Runs a group on the accelerator if that is faster than the CPU, which is measured with the first rollouts if it
    /// is not known. If the accelerator fails, the CPU continues.
    pub fn on_faster<T: Send>(
        &self,
        accelerator: &dyn Accelerator,
        speed: &MeasuredSpeed,
        group: &AcceleratedGroup,
    ) -> Result<Vec<(usize, T)>>
    where
        K: Fn(usize, Trajectory) -> T + Sync,
    {
        let (mut results, mut rest) = (Vec::new(), group.indices.as_slice());
        let launch_size = group.launch_size;
        if speed.accelerator_is_faster(group.arena_kb).is_none() {
            let capacity = accelerator.capacity(group.arena_kb).clamp(1, launch_size);
            let (first, after) = rest.split_at(capacity.min(rest.len() / 2));
            let start = Instant::now();
            if let Some(done) = self.launch_unless_failed(accelerator, speed, first)? {
                let on_accelerator = (start.elapsed(), first.len());
                results.extend(done);
                let (second, after) = after.split_at(measured_on_cpu().min(after.len()));
                let start = Instant::now();
                results.extend(self.on_cpu(lanes_units(second))?);
                speed.store(group.arena_kb, on_accelerator, (start.elapsed(), second.len()));
                rest = after;
            }
        }
        while !rest.is_empty() && speed.accelerator_is_faster(group.arena_kb) == Some(true) {
            let (part, after) = rest.split_at(launch_size.min(rest.len()));
            if let Some(done) = self.launch_unless_failed(accelerator, speed, part)? {
                results.extend(done);
                rest = after;
            }
        }
        results.extend(self.on_cpu(lanes_units(rest))?);
        Ok(results)
    }

    /// Launches rollouts; `None` if the accelerator fails, which is noted.
    fn launch_unless_failed<T: Send>(
        &self,
        accelerator: &dyn Accelerator,
        speed: &MeasuredSpeed,
        indices: &[usize],
    ) -> Result<Option<Vec<(usize, T)>>>
    where
        K: Fn(usize, Trajectory) -> T + Sync,
    {
        match self.launch(accelerator, indices) {
            Err(Error::Failed(reason)) => {
                tracing::warn!("{reason}; rollouts of `auto` run on the CPU from now on");
                speed.set_failed();
                Ok(None)
            }
            other => other.map(Some),
        }
    }

    /// Launches rollouts on the accelerator; those that do not fit into its outputs run on the CPU.
    fn launch<T: Send>(&self, accelerator: &dyn Accelerator, indices: &[usize]) -> Result<Vec<(usize, T)>>
    where
        K: Fn(usize, Trajectory) -> T + Sync,
    {
        self.budget.check()?;
        let keep = |index: usize, model: &RolloutModel, truth: Trajectory| {
            (self.keep)(index, apply_sensors(model.sensors.as_ref(), truth))
        };
        let compile = |index: usize| (self.compile)(&self.rollouts[index]);
        let LaunchResults { mut results, overflowed } = gpu::run(accelerator, indices, compile, keep)?;
        results.extend(self.on_cpu(lanes_units(&overflowed))?);
        Ok(results)
    }

    fn unit<T>(&self, unit: WorkUnit) -> Result<Vec<(usize, T)>>
    where
        K: Fn(usize, Trajectory) -> T + Sync,
    {
        self.budget.check()?;
        match unit {
            WorkUnit::Rapier(index) => {
                let model = (self.compile)(&self.rollouts[index])?;
                let truth = rapier::run(&model, self.budget)?;
                Ok(vec![(index, (self.keep)(index, apply_sensors(model.sensors.as_ref(), truth)))])
            }
            WorkUnit::Lanes(indices) => {
                let mut source = UnitSource {
                    batch: self,
                    results: Vec::with_capacity(indices.len()),
                    indices: indices.into_iter(),
                    sensors: Vec::new(),
                    cancelled: None,
                };
                lanes::run(&mut source, self.settings);
                source.cancelled.map_or(Ok(source.results), Err)
            }
        }
    }
}

/// Rollouts that measure the speed of the CPU.
fn measured_on_cpu() -> usize {
    MEASURED_ROLLOUTS_PER_THREAD * rayon::current_num_threads()
}

/// A trajectory as measured.
fn apply_sensors(view: Option<&SensorChain>, truth: Trajectory) -> Trajectory {
    match view {
        Some(view) => view.measure(truth),
        None => truth,
    }
}

/// Feeds a unit of rollouts to the batched engine.
struct UnitSource<'a, C, K, T> {
    batch: &'a BatchRun<'a, C, K>,
    indices: std::vec::IntoIter<usize>,
    results: Vec<(usize, T)>,
    /// Sensors of the rollouts in progress that have any, by index.
    sensors: Vec<(usize, SensorChain)>,
    /// The reason why it was cancelled, if it was.
    cancelled: Option<Error>,
}

impl<T, C, K> lanes::RolloutSource for UnitSource<'_, C, K, T>
where
    C: Fn(&Rollout) -> Result<RolloutModel>,
    K: Fn(usize, Trajectory) -> T,
{
    fn next(&mut self) -> Option<(usize, RolloutModel)> {
        let index = self.indices.next()?;
        // `partition` has already compiled it without error; a rollout that fails now is reported as
        // missing.
        let mut model = (self.batch.compile)(&self.batch.rollouts[index]).ok()?;
        self.sensors.extend(model.sensors.take().map(|sensors| (index, sensors)));
        Some((index, model))
    }

    fn should_continue(&mut self) -> bool {
        self.cancelled = self.batch.budget.check().err();
        self.cancelled.is_none()
    }

    fn done(&mut self, index: usize, truth: Trajectory) {
        let view =
            self.sensors.iter().position(|(i, _)| *i == index).map(|at| self.sensors.swap_remove(at).1);
        let trajectory = apply_sensors(view.as_ref(), truth);
        self.results.push((index, (self.batch.keep)(index, trajectory)));
    }
}
