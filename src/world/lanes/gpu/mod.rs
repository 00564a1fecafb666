//! The batched engine on a graphics processor: one rollout a thread, the same bits.
//!
//! The kernel (`gpu/`) is made of this engine's own source files, compiled with one lane. Here rollouts are loaded
//! into a lane as for the processor, copied as numbers (`exchange`), run on an [`Accelerator`], and their outputs
//! recorded.
//!
//! Rollouts with interventions or established contacts, and those that need more memory than a thread may have, run on
//! the processor: see [`supports`].

mod accelerator;
mod arena;
#[cfg(target_os = "linux")]
mod cuda;
mod find;

use rayon::prelude::*;

use super::exchange::{NumberWriter, Port};
use super::goal::{GoalLanes, MAX_REGION_POINTS};
use super::state::BatchState;
use super::topology::Topology;
use crate::error::{Error, Result};
use crate::trajectory::{Termination, Trajectory};
use crate::world::compile::RolloutModel;
use crate::world::goal::GoalCondition;
use crate::world::observe::ObservationSchedule;
use crate::world::record::{BodyState, Recorder};
pub use accelerator::{Accelerator, RolloutImages};
use arena::arena_size;
pub use find::find;

/// Rollouts that are loaded by one thread before the next.
const ROLLOUTS_PER_TASK: usize = 64;
/// Contacts that an output has room for; a rollout with more is run on the processor.
const MAX_CONTACTS: usize = 128;
/// Numbers before the observations of an output: see `gpu/src/run.rs`.
const OUTPUT_HEAD: usize = 7;
/// The lane into which rollouts are loaded.
const LANE: usize = 0;
/// Maximum size of the outputs of one launch, numbers.
const MAX_OUTPUT_NUMBERS: usize = 1 << 27;

/// Whether an accelerator can run the rollout.
pub fn supports(model: &RolloutModel, topology: &Topology) -> bool {
    let region = match model.goal.as_ref().map(|goal| &goal.condition) {
        Some(GoalCondition::Inside { region, .. }) => region.len(),
        _ => 0,
    };
    !model.contacts_established
        && model.interventions.is_empty()
        && region <= MAX_REGION_POINTS
        && arena_size(topology).is_some()
}

/// Number of rollouts like this one in a launch.
pub fn launch_size(model: &RolloutModel) -> usize {
    (MAX_OUTPUT_NUMBERS / output_len(model)).max(1)
}

/// The results of a launch.
pub struct Launched<T> {
    /// By index of the rollout.
    pub results: Vec<(usize, T)>,
    /// Indices of rollouts that do not fit into their output.
    pub unfinished: Vec<usize>,
}

/// Runs rollouts of one topology; `model` compiles the one with an index, and `done` makes its result of its trajectory.
pub fn run<T: Send>(
    accelerator: &dyn Accelerator,
    indices: &[usize],
    model: impl Fn(usize) -> Result<RolloutModel> + Sync,
    done: impl Fn(usize, &RolloutModel, Trajectory) -> T + Sync,
) -> Result<Launched<T>> {
    let Some(first) = indices.first() else {
        return Ok(Launched { results: Vec::new(), unfinished: Vec::new() });
    };
    let mut topology = Topology::of(&model(*first)?);
    let arena_kb = arena_size(&topology).ok_or_else(|| {
        Error::Failed("a rollout needs more memory than a thread of the accelerator has".into())
    })?;
    let load = |part: &[usize]| -> Result<LoadedRollouts> {
        let mut loader = Loader::new(&topology);
        for index in part {
            loader.load(&model(*index)?);
        }
        Ok(loader.loaded)
    };
    let parts: Vec<LoadedRollouts> =
        indices.par_chunks(ROLLOUTS_PER_TASK).map(load).collect::<Result<Vec<LoadedRollouts>>>()?;
    let mut work = RolloutImages { arena_kb, starts: vec![0], ..RolloutImages::default() };
    topology.exchange(&mut NumberWriter(&mut work.topology));
    for part in parts {
        let before = work.images.len();
        work.images.extend(part.numbers);
        work.starts.extend(part.ends.iter().map(|end| before + end));
        work.output_len = work.output_len.max(part.output_len);
    }
    let outputs = accelerator.run(&work)?;
    let record = |(index, output): (&usize, &[f64])| -> Result<(usize, Option<T>)> {
        let model = model(*index)?;
        let trajectory = trajectory(&model, output);
        Ok((*index, trajectory.map(|trajectory| done(*index, &model, trajectory))))
    };
    let recorded: Vec<(usize, Option<T>)> =
        indices.par_iter().zip(outputs.par_chunks(work.output_len)).map(record).collect::<Result<_>>()?;
    let mut launched = Launched { results: Vec::new(), unfinished: Vec::new() };
    for (index, result) in recorded {
        match result {
            Some(result) => launched.results.push((index, result)),
            None => launched.unfinished.push(index),
        }
    }
    Ok(launched)
}

/// Rollouts as numbers: where each ends, and the longest output.
#[derive(Default)]
struct LoadedRollouts {
    numbers: Vec<f64>,
    ends: Vec<usize>,
    output_len: usize,
}

/// A lane through which rollouts become numbers.
struct Loader {
    state: BatchState,
    goal: Option<GoalLanes>,
    loaded: LoadedRollouts,
}

impl Loader {
    fn new(topology: &Topology) -> Loader {
        Loader {
            state: BatchState::new(topology),
            goal: GoalLanes::new(topology),
            loaded: LoadedRollouts::default(),
        }
    }

    fn load(&mut self, model: &RolloutModel) {
        self.state.fill(LANE, model);
        let mut port = NumberWriter(&mut self.loaded.numbers);
        port.whole(model.steps as usize);
        port.whole(usize::from(model.stop_at_goal));
        match &model.schedule {
            ObservationSchedule::Every(steps) => {
                port.whole(*steps as usize);
            }
            ObservationSchedule::At(steps) => {
                port.whole(0);
                port.whole(steps.len());
                steps.iter().for_each(|step| _ = port.whole(*step as usize));
            }
        }
        self.state.exchange(LANE, &mut port);
        if let Some(goal) = &mut self.goal {
            goal.fill(LANE, model);
            goal.exchange(LANE, &mut port);
        }
        self.loaded.ends.push(self.loaded.numbers.len());
        self.loaded.output_len = self.loaded.output_len.max(output_len(model));
    }
}

/// Numbers of a rollout's output.
fn output_len(model: &RolloutModel) -> usize {
    OUTPUT_HEAD + model.schedule.count(model.steps) * observation_len(model) + 4 * MAX_CONTACTS
}

fn observation_len(model: &RolloutModel) -> usize {
    1 + 6 * model.bodies.len()
}

/// The trajectory of an output; `None` if it did not fit.
fn trajectory(model: &RolloutModel, output: &[f64]) -> Option<Trajectory> {
    let &[end, step, solved, rolling, observations, contacts, full] = output.first_chunk::<OUTPUT_HEAD>()?;
    if full != 0.0 {
        return None;
    }
    let mut recorder = Recorder::new(model);
    recorder.observe(0, &model.initial_states());
    let body = |s: &[f64]| match *s {
        [x, y, angle, vx, vy, omega] => BodyState { position: [x, y], angle, velocity: [vx, vy], omega },
        _ => BodyState::ABSENT,
    };
    let all = output[OUTPUT_HEAD..].chunks_exact(observation_len(model)).take(observations as usize);
    for observation in all {
        let states: Vec<BodyState> = observation[1..].chunks_exact(6).map(body).collect();
        recorder.observe(observation[0] as u32, &states);
    }
    for contact in output.rchunks_exact(4).take(contacts as usize) {
        recorder.begin_contact(contact[0] as u32, contact[1] as usize, contact[2] as usize, contact[3]);
    }
    recorder.add_rolling_steps(rolling as u32);
    if solved != 0.0 {
        recorder.set_solved();
    }
    let end = match end {
        0.0 => Termination::Horizon,
        1.0 => Termination::Goal,
        _ => Termination::Diverged,
    };
    Some(recorder.finish(step as u32, end))
}
