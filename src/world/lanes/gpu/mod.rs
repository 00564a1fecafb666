//! The batched engine on a graphics processor: one rollout a thread, the same bits.
//!
//! The kernel (`gpu/`) is made of this engine's own source files, compiled with one lane. Here rollouts are loaded
//! into a lane as for the processor, copied as numbers (`exchange`), run on an [`Accelerator`], and their outputs
//! recorded.
//!
//! Rollouts with interventions, and those that need more memory than a thread may have, run on
//! the processor: see [`thread_memory_kb`].

mod accelerator;
mod arena;
#[cfg(target_os = "linux")]
mod cuda;
mod find;
mod measured_speed;

use rayon::prelude::*;

use super::exchange::{NumberReader, NumberWriter, Port};
use super::goal::{GoalLanes, MAX_REGION_POINTS};
use super::gpu_format::{
    AT_GOAL, AT_HORIZON, CONTACT_LEN, DIVERGED, OutputHead, RolloutSettings, STATE_LEN, observation_len,
};
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
pub use find::{find, is_installed};
pub use measured_speed::MeasuredSpeed;

/// Rollouts that are loaded by one thread before the next.
const ROLLOUTS_PER_TASK: usize = 64;
/// Contacts that an output has room for; a rollout with more is run on the processor.
const MAX_CONTACTS: usize = 128;
/// The lane into which rollouts are loaded.
const LANE: usize = 0;
/// Maximum size of the outputs of one launch, numbers.
const MAX_OUTPUT_NUMBERS: usize = 1 << 27;

/// Memory of a thread for rollouts like this one, kB; `None` if an accelerator cannot run them.
pub fn thread_memory_kb(model: &RolloutModel) -> Option<usize> {
    let region = match model.goal.as_ref().map(|goal| &goal.condition) {
        Some(GoalCondition::Inside { region, .. }) => region.len(),
        _ => 0,
    };
    let supported = model.interventions.is_empty() && region <= MAX_REGION_POINTS;
    supported.then(|| arena_size(&Topology::of(model))).flatten()
}

/// Number of rollouts like this one in a launch.
pub fn launch_size(model: &RolloutModel) -> usize {
    (MAX_OUTPUT_NUMBERS / output_len(model)).max(1)
}

/// The results of a launch.
pub struct LaunchResults<T> {
    /// By index of the rollout.
    pub results: Vec<(usize, T)>,
    /// Indices of rollouts that do not fit into their output.
    pub overflowed: Vec<usize>,
}

/// Runs rollouts of one topology; `model` compiles the one with an index, and `keep` makes its result of its trajectory.
pub fn run<T: Send>(
    accelerator: &dyn Accelerator,
    indices: &[usize],
    model: impl Fn(usize) -> Result<RolloutModel> + Sync,
    keep: impl Fn(usize, &RolloutModel, Trajectory) -> T + Sync,
) -> Result<LaunchResults<T>> {
    let Some(first) = indices.first() else {
        return Ok(LaunchResults { results: Vec::new(), overflowed: Vec::new() });
    };
    let mut topology = Topology::of(&model(*first)?);
    let arena_kb = arena_size(&topology).ok_or_else(|| {
        Error::Failed("a rollout needs more memory than a thread of the accelerator has".into())
    })?;
    let load = |part: &[usize]| -> Result<InputBuffer> {
        let mut loader = Loader::new(&topology);
        for index in part {
            loader.load(&model(*index)?);
        }
        Ok(loader.loaded)
    };
    let parts: Vec<InputBuffer> =
        indices.par_chunks(ROLLOUTS_PER_TASK).map(load).collect::<Result<Vec<InputBuffer>>>()?;
    let mut work = RolloutImages { arena_kb, starts: vec![0], ..RolloutImages::default() };
    topology.exchange(&mut NumberWriter(&mut work.topology));
    work.images.reserve_exact(parts.iter().map(|part| part.numbers.len()).sum());
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
        Ok((*index, trajectory.map(|trajectory| keep(*index, &model, trajectory))))
    };
    let recorded: Vec<(usize, Option<T>)> =
        indices.par_iter().zip(outputs.par_chunks(work.output_len)).map(record).collect::<Result<_>>()?;
    let mut done = LaunchResults { results: Vec::new(), overflowed: Vec::new() };
    for (index, result) in recorded {
        match result {
            Some(result) => done.results.push((index, result)),
            None => done.overflowed.push(index),
        }
    }
    Ok(done)
}

/// Rollouts as numbers: where each ends, and the longest output.
#[derive(Default)]
struct InputBuffer {
    numbers: Vec<f64>,
    ends: Vec<usize>,
    output_len: usize,
}

/// A lane through which rollouts become numbers.
struct Loader {
    state: BatchState,
    goal: Option<GoalLanes>,
    loaded: InputBuffer,
}

impl Loader {
    fn new(topology: &Topology) -> Loader {
        Loader {
            state: BatchState::new(topology),
            goal: GoalLanes::new(topology),
            loaded: InputBuffer::default(),
        }
    }

    fn load(&mut self, model: &RolloutModel) {
        self.state.fill(LANE, model);
        let mut port = NumberWriter(&mut self.loaded.numbers);
        let (every, listed): (u32, &[u32]) = match &model.schedule {
            ObservationSchedule::Every(steps) => (*steps, &[]),
            ObservationSchedule::At(steps) => (0, steps),
        };
        let mut settings = RolloutSettings {
            steps: model.steps as usize,
            stop_at_goal: model.stop_at_goal,
            records_contacts: model.records_contacts,
            every: every as usize,
            listed: listed.len(),
        };
        settings.exchange(&mut port);
        listed.iter().for_each(|step| _ = port.whole(*step as usize));
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
    let contacts = if model.records_contacts { MAX_CONTACTS } else { 0 };
    let observations = model.schedule.count(model.steps) * observation_len(model.bodies.len());
    OutputHead::LEN + observations + CONTACT_LEN * contacts
}

/// The trajectory of an output; `None` if it did not fit.
fn trajectory(model: &RolloutModel, output: &[f64]) -> Option<Trajectory> {
    let mut head = OutputHead::default();
    head.exchange(&mut NumberReader(output));
    if head.overflowed {
        return None;
    }
    let mut recorder = Recorder::new(model);
    recorder.observe(0, &model.initial_states());
    let body = |s: &[f64]| match *s {
        [x, y, angle, vx, vy, omega] => BodyState { position: [x, y], angle, velocity: [vx, vy], omega },
        _ => BodyState::ABSENT,
    };
    let observations = output[OutputHead::LEN..].chunks_exact(observation_len(model.bodies.len()));
    for observation in observations.take(head.observations) {
        let states: Vec<BodyState> = observation[1..].chunks_exact(STATE_LEN).map(body).collect();
        recorder.observe(observation[0] as u32, &states);
    }
    if model.records_contacts {
        for contact in output.rchunks_exact(CONTACT_LEN).take(head.contacts) {
            recorder.begin_contact(contact[0] as u32, contact[1] as usize, contact[2] as usize, contact[3]);
        }
    } else {
        recorder.add_collisions(head.collisions as u32);
    }
    recorder.add_rolling_steps(head.rolling_steps as u32);
    if head.solved {
        recorder.set_solved();
    }
    let end = match head.end {
        AT_HORIZON => Termination::Horizon,
        AT_GOAL => Termination::Goal,
        DIVERGED => Termination::Diverged,
        _ => return None,
    };
    Some(recorder.finish(head.step as u32, end))
}
