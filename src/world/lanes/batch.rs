//! Management of lanes: filling, observing, finishing. The work of every step is in `kernel`.
//!
//! A finished lane is filled with the next rollout at once, so lanes start at different times and each has
//! its own count of steps.

use super::goal::GoalLanes;
use super::intervene::intervene;
use super::rest_detection::{REST_CHECK_INTERVAL_STEPS, StepSnapshot};
use super::source::RolloutSource;
use super::state::BatchState;
use super::topology::Topology;
use super::warm_start::ContactWarmStart;
use crate::trajectory::{Termination, Trajectory};
use crate::world::compile::RolloutModel;
use crate::world::compiled_intervention::CompiledIntervention;
use crate::world::effect::LANES;
use crate::world::observe::ObservationSchedule;
use crate::world::record::Recorder;

/// The code compiled for an instruction set. The functions own no data: unwinding code for every operation of
/// such large functions would take the compiler minutes.
pub trait Kernel {
    /// Advances every lane by one time step.
    fn step(&self, state: &mut BatchState);
    /// Evaluates the goals; whether a lane has just reached its own.
    fn update_goal(&self, goal: &mut GoalLanes, state: &mut BatchState) -> bool;
}

/// Integrates all rollouts of `source`, unless it is cancelled.
pub fn run(source: &mut dyn RolloutSource, end_at_rest: bool, instructions: &dyn Kernel) {
    let Some(first) = source.next() else { return };
    let steps_per_check = first.1.steps_per_check();
    let mut batch = LaneBatch::new(&first.1);
    let mut first = Some(first);
    for lane in 0..LANES {
        batch.refill(lane, source, first.take());
    }
    let mut steps_since_check = 0;
    while batch.lanes.iter().any(Option::is_some) {
        steps_since_check += 1;
        if steps_since_check == steps_per_check {
            steps_since_check = 0;
            if !source.should_continue() {
                return;
            }
        }
        instructions.step(&mut batch.state);
        let mut gone = [false; LANES];
        if batch.state.may_diverge {
            gone = batch.end_diverged(source);
        }
        if batch.has_warm_starts {
            batch.continue_warm_starts();
        }
        if !batch.state.new_contacts.is_empty() {
            batch.record_new_contacts();
        }
        if let Some(goal) = &mut batch.goal
            && instructions.update_goal(goal, &mut batch.state)
        {
            batch.finish_solved(source);
        }
        // A rollout that follows a diverged one must not be evaluated in this step.
        for lane in (0..LANES).filter(|lane| gone[*lane]) {
            batch.refill(lane, source, None);
        }
        if batch.state.tick >= batch.due {
            batch.observe_due(source);
        }
        if end_at_rest {
            if batch.snapshot.is_taken() {
                batch.end_at_rest(source);
            } else if (batch.state.tick as u64).is_multiple_of(REST_CHECK_INTERVAL_STEPS) {
                batch.snapshot.take(&batch.state, |lane| batch.lanes[lane].is_some());
            }
        }
    }
}

/// Up to [`LANES`] rollouts in progress.
struct LaneBatch {
    state: BatchState,
    goal: Option<GoalLanes>,
    lanes: [Option<LaneRollout>; LANES],
    /// Earliest tick at which a lane must be observed or ends.
    due: f64,
    /// The state after the last step, if some lane may have come to rest.
    snapshot: StepSnapshot,
    /// The warm start of each lane, which repeats the first step until contact impulses have converged.
    warm_starts: [ContactWarmStart; LANES],
    /// Whether some lane is still repeating its first step.
    has_warm_starts: bool,
}

/// A rollout in progress.
struct LaneRollout {
    index: usize,
    recorder: Recorder,
    steps: u32,
    schedule: ObservationSchedule,
    stop: bool,
    solved: bool,
    /// Step of the next observation; the last step at the latest.
    next_observation: u32,
    /// Tick of the next observation, intervention or end.
    due: f64,
    /// The model, if there are interventions; and the number of interventions already applied.
    model: Option<Box<RolloutModel>>,
    changed: usize,
}

impl LaneRollout {
    /// The next step at which something must be done.
    fn next(&self) -> u32 {
        self.change().map_or(self.next_observation, |change| change.step.min(self.next_observation))
    }

    /// The next intervention.
    fn change(&self) -> Option<&CompiledIntervention> {
        self.model.as_ref()?.interventions.get(self.changed)
    }
}

impl LaneBatch {
    fn new(model: &RolloutModel) -> LaneBatch {
        let topology = Topology::of(model);
        let state = BatchState::new(&topology);
        LaneBatch {
            snapshot: StepSnapshot::with_capacity(&state),
            warm_starts: std::array::from_fn(|_| ContactWarmStart::new(&topology, &state)),
            state,
            goal: GoalLanes::new(&topology),
            lanes: Default::default(),
            due: f64::INFINITY,
            has_warm_starts: false,
        }
    }

    /// Loads the next rollout, if there is one, into a lane.
    fn refill(&mut self, lane: usize, source: &mut dyn RolloutSource, first: Option<(usize, RolloutModel)>) {
        let mut next = first.or_else(|| source.next());
        loop {
            match next {
                Some((index, model)) => self.fill(lane, index, model),
                None => self.clear(lane),
            }
            let Some(end) = self.intervene(lane, 0) else { break };
            self.finish_lane(lane, 0, end, source);
            next = source.next();
        }
        self.due = self.lanes.iter().flatten().map(|l| l.due).fold(f64::INFINITY, f64::min);
    }

    fn fill(&mut self, lane: usize, index: usize, model: RolloutModel) {
        self.state.fill(lane, &model);
        if let Some(goal) = &mut self.goal {
            goal.fill(lane, &model);
        }
        let next_observation = model.schedule.after(0).min(model.steps);
        let mut new = LaneRollout {
            index,
            recorder: Recorder::new(&model),
            steps: model.steps,
            schedule: model.schedule.clone(),
            stop: model.stop_at_goal,
            solved: false,
            next_observation,
            due: self.state.tick + f64::from(next_observation),
            model: None,
            changed: 0,
        };
        new.recorder.observe(0, &model.initial_states());
        if model.contacts_established {
            self.warm_starts[lane].begin(&self.state, lane);
            self.has_warm_starts = true;
        } else if !model.interventions.is_empty() {
            new.model = Some(Box::new(model));
            new.due = self.state.tick + f64::from(new.next());
        }
        self.lanes[lane] = Some(new);
    }

    /// Applies the interventions of a lane after so many steps; returns how its rollout ends, if it does.
    fn intervene(&mut self, lane: usize, step: u32) -> Option<Termination> {
        let lane_rollout = self.lanes[lane].as_mut()?;
        let model = lane_rollout.model.as_mut()?;
        while let Some(change) =
            model.interventions.get(lane_rollout.changed).filter(|c| c.step == step).cloned()
        {
            lane_rollout.changed += 1;
            // A lane that was at rest may move after an intervention.
            self.snapshot.forget();
            let end = intervene(&mut self.state, self.goal.as_mut(), lane, model, &change);
            if end.is_some() {
                return end;
            }
        }
        lane_rollout.due = self.state.start_tick[lane] + f64::from(lane_rollout.next());
        None
    }

    /// Repeats first steps whose contact impulses have not converged.
    fn continue_warm_starts(&mut self) {
        self.has_warm_starts = false;
        for lane in 0..LANES {
            let (Some(lane_rollout), warm_start) = (&mut self.lanes[lane], &mut self.warm_starts[lane])
            else {
                continue;
            };
            if warm_start.is_pending() && warm_start.restart(&mut self.state, lane) {
                self.has_warm_starts = true;
                lane_rollout.due = self.state.tick + f64::from(lane_rollout.next());
                // A lane that restarts is not at rest.
                self.snapshot.forget();
            }
        }
    }

    /// Empties a lane.
    fn clear(&mut self, lane: usize) {
        self.lanes[lane] = None;
        self.state.clear(lane);
        if let Some(goal) = &mut self.goal {
            goal.clear(lane);
        }
    }

    /// Reports the contacts that began in this step to the recorders.
    fn record_new_contacts(&mut self) {
        for index in self.state.new_contacts.clone() {
            for lane in 0..LANES {
                let Some(lane_rollout) = &mut self.lanes[lane] else { continue };
                if self.state.is_new_contact(index, lane) {
                    let contact = self.state.contact(index);
                    let step = self.state.step_of(lane);
                    let speed = (-contact.speed[lane]).max(0.0);
                    lane_rollout.recorder.begin_contact(step, contact.first, contact.other, speed);
                }
            }
        }
        self.state.new_contacts.clear();
    }

    fn finish_solved(&mut self, source: &mut dyn RolloutSource) {
        for lane in 0..LANES {
            let Some(goal) = &mut self.goal else { return };
            if goal.held[lane] < goal.needed[lane] {
                continue;
            }
            goal.needed[lane] = f64::INFINITY;
            let Some(lane_rollout) = &mut self.lanes[lane] else { continue };
            lane_rollout.solved = true;
            if lane_rollout.stop {
                let step = self.state.step_of(lane);
                self.observe(lane, step);
                self.retire(lane, step, Termination::Goal, source);
            }
        }
    }

    fn observe_due(&mut self, source: &mut dyn RolloutSource) {
        for lane in 0..LANES {
            let step = self.state.step_of(lane);
            let Some(lane_rollout) = &mut self.lanes[lane] else { continue };
            if lane_rollout.due > self.state.tick {
                continue;
            }
            let (steps, next_observation) = (lane_rollout.steps, lane_rollout.next_observation);
            if step >= next_observation {
                lane_rollout.next_observation = lane_rollout.schedule.after(step).min(steps);
                lane_rollout.due = self.state.start_tick[lane] + f64::from(lane_rollout.next());
                self.observe(lane, step);
            }
            if step >= steps {
                self.retire(lane, steps, Termination::Horizon, source);
            } else if let Some(end) = self.intervene(lane, step) {
                self.retire(lane, step, end, source);
            }
        }
        self.due = self.lanes.iter().flatten().map(|l| l.due).fold(f64::INFINITY, f64::min);
    }

    fn observe(&mut self, lane: usize, step: u32) {
        let states = self.state.bodies_in(lane);
        if let Some(lane_rollout) = &mut self.lanes[lane] {
            lane_rollout.recorder.observe(step, &states);
        }
    }

    /// Finishes diverged lanes; returns which ones.
    fn end_diverged(&mut self, source: &mut dyn RolloutSource) -> [bool; LANES] {
        let mut gone = [false; LANES];
        for (lane, gone) in gone.iter_mut().enumerate() {
            if self.lanes[lane].is_some() && self.state.ends_diverged(lane) {
                // The state after the diverged step is discarded.
                let step = self.state.step_of(lane) - 1;
                self.finish_lane(lane, step, Termination::Diverged, source);
                *gone = true;
            }
            // Absent bodies would keep falling.
            self.state.reset_absent(lane);
        }
        gone
    }

    /// Finishes a rollout and refills its lane.
    fn retire(&mut self, lane: usize, step: u32, end: Termination, source: &mut dyn RolloutSource) {
        self.finish_lane(lane, step, end, source);
        self.refill(lane, source, None);
    }

    /// Passes a finished rollout on.
    fn finish_lane(&mut self, lane: usize, step: u32, end: Termination, source: &mut dyn RolloutSource) {
        if let Some(mut lane_rollout) = self.lanes[lane].take() {
            self.warm_starts[lane].end();
            let rolling: f64 = self.state.bodies.iter().map(|b| b.rolling[lane]).sum();
            lane_rollout.recorder.add_rolling_steps(rolling as u32);
            if lane_rollout.solved {
                lane_rollout.recorder.set_solved();
            }
            let trajectory: Trajectory = lane_rollout.recorder.finish(step, end);
            source.done(lane_rollout.index, trajectory);
        }
    }

    /// Finishes the lanes in which the last step changed nothing: every further step would be the same.
    fn end_at_rest(&mut self, source: &mut dyn RolloutSource) {
        // Refilled lanes and interventions must not change what the lanes are compared with.
        let mut before = std::mem::take(&mut self.snapshot);
        for lane in 0..LANES {
            let Some(rolling) = before.same(&self.state, lane).filter(|_| self.lanes[lane].is_some()) else {
                continue;
            };
            let step = self.state.step_of(lane);
            let (states, finish_solved) =
                (self.state.bodies_in(lane), self.goal.as_ref().and_then(|g| g.steps_remaining(lane)));
            // A lane with pending interventions is not finished early.
            let Some(lane_rollout) =
                self.lanes[lane].as_mut().filter(|lane_rollout| lane_rollout.change().is_none())
            else {
                continue;
            };
            let mut last = lane_rollout.steps;
            let mut end = Termination::Horizon;
            if let Some(more) = finish_solved.filter(|more| *more <= lane_rollout.steps - step) {
                lane_rollout.solved = true;
                if lane_rollout.stop {
                    (last, end) = (step + more, Termination::Goal);
                }
            }
            let mut k = lane_rollout.schedule.after(step);
            while k < last {
                lane_rollout.recorder.observe(k, &states);
                k = lane_rollout.schedule.after(k);
            }
            if last > step {
                lane_rollout.recorder.observe(last, &states);
            }
            lane_rollout.recorder.add_rolling_steps(rolling * (last - step));
            self.retire(lane, last, end, source);
        }
        before.forget();
        self.snapshot = before;
    }
}
