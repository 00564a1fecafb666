//! Rollouts of a thread: the loop over their steps, as `lanes::batch` runs it.

use crate::world::lanes::exchange::{NumberReader, Port};
use crate::world::lanes::goal::{ConditionLanes, GoalLanes, MAX_REGION_POINTS};
use crate::world::lanes::gpu_format::{
    AT_GOAL, AT_HORIZON, CONTACT_LEN, DIVERGED, OutputHead, RolloutSettings, STATE_LEN, observation_len,
};
use crate::world::lanes::kernel::step;
use crate::world::lanes::rest_detection::{REST_CHECK_INTERVAL_STEPS, StepSnapshot};
use crate::world::lanes::state::BatchState;
use crate::world::lanes::topology::Topology;
use crate::world::lanes::warm_start::ContactWarmStart;
use crate::world::state::BodyState;

/// The only lane.
const LANE: usize = 0;
/// Room for a rollout's output: see `lanes::gpu_format`.
pub struct Output<'a> {
    numbers: &'a mut [f64],
    head: OutputHead,
    /// Numbers of all observations so far.
    observed: usize,
}

/// Advances rollouts of one topology from their states to their ends, one after the other; `next` supplies an image and
/// room for the output.
///
/// `topology` and images are written by the program's engine `gpu`: an image is the rollout's settings, the steps to
/// observe if they are listed, its state and its goal. One loop over the steps of all rollouts, as in `lanes::batch`:
/// neighbouring threads step together although their rollouts end at different times.
pub fn run<'a>(topology: &[f64], mut next: impl FnMut() -> Option<(&'a [f64], Output<'a>)>) {
    let mut own = Topology::default();
    own.exchange(&mut NumberReader(topology));
    let mut state = BatchState::new(&own);
    let mut goal = GoalLanes::new(&own);
    reserve(&mut state, &mut goal);
    let mut snapshot = StepSnapshot::with_capacity(&state);
    let mut warm_start = ContactWarmStart::new(&own, &state);
    let mut current: Option<Rollout> = None;
    loop {
        let Some(rollout) = &mut current else {
            let Some((image, output)) = next() else { return };
            current = Some(Rollout::load(image, output, &mut state, &mut goal));
            snapshot.forget();
            if own.contacts_established {
                warm_start.begin(&state, LANE);
            }
            continue;
        };
        step::<f64, 1>(&mut state);
        if warm_start.is_pending() && !state.ends_diverged(LANE) && warm_start.restart(&mut state, LANE) {
            snapshot.forget();
        }
        let mut end = rollout.after_step(&mut state, &mut goal);
        if end.is_none() && snapshot.is_taken() {
            end = rollout.end_at_rest(&snapshot, &state, &goal);
            snapshot.forget();
        } else if (state.tick as u64).is_multiple_of(REST_CHECK_INTERVAL_STEPS) {
            snapshot.take(&state, |_| true);
        }
        if let Some(end) = end {
            rollout.finish(end, &state);
            current = None;
        }
    }
}

/// A rollout in progress.
struct Rollout<'a> {
    settings: RolloutSettings,
    schedule: Schedule<'a>,
    /// Step of the next observation.
    due: usize,
    output: Output<'a>,
}

/// How and after which step a rollout ended, and steps in which statics support bodies that were not simulated.
struct End {
    how: usize,
    step: usize,
    rolling: usize,
}

impl<'a> Rollout<'a> {
    fn load(
        image: &'a [f64],
        output: Output<'a>,
        state: &mut BatchState,
        goal: &mut Option<GoalLanes>,
    ) -> Rollout<'a> {
        let (mut settings, mut reader) = (RolloutSettings::default(), NumberReader(image));
        settings.exchange(&mut reader);
        let (list, rest) = reader.0.split_at(settings.listed);
        let mut reader = NumberReader(rest);
        let mut schedule = Schedule { every: settings.every, list, next: 0 };
        state.exchange(LANE, &mut reader);
        if let Some(goal) = goal {
            goal.exchange(LANE, &mut reader);
        }
        let due = schedule.after(0).min(settings.steps);
        Rollout { settings, schedule, due, output }
    }

    /// Records a step; whether the rollout ends with it.
    fn after_step(&mut self, state: &mut BatchState, goal: &mut Option<GoalLanes>) -> Option<End> {
        let now = state.step_of(LANE) as usize;
        if state.ends_diverged(LANE) {
            state.new_contacts.clear();
            // The state after the diverged step is discarded.
            return Some(End { how: DIVERGED, step: now - 1, rolling: 0 });
        }
        for k in 0..state.new_contacts.len() {
            let index = state.new_contacts[k];
            if state.is_new_contact(index, LANE) {
                let contact = state.contact(index);
                let speed = (-contact.speed[LANE]).max(0.0);
                self.output.head.collisions += usize::from(contact.other < state.bodies.len());
                if self.settings.records_contacts {
                    self.output.contact([now as f64, contact.first as f64, contact.other as f64, speed]);
                }
            }
        }
        state.new_contacts.clear();
        if let Some(goal) = goal
            && goal.update::<f64, 1>(state)
        {
            goal.needed[LANE] = f64::INFINITY;
            self.output.head.solved = true;
            if self.settings.stop_at_goal {
                self.output.observe(now, state);
                return Some(End { how: AT_GOAL, step: now, rolling: 0 });
            }
        }
        if now >= self.due {
            self.output.observe(now, state);
            self.due = self.schedule.after(now).min(self.settings.steps);
        }
        (now >= self.settings.steps).then_some(End { how: AT_HORIZON, step: self.settings.steps, rolling: 0 })
    }

    /// Ends the rollout if its last step changed nothing: every further step would be the same.
    fn end_at_rest(
        &mut self,
        before: &StepSnapshot,
        state: &BatchState,
        goal: &Option<GoalLanes>,
    ) -> Option<End> {
        let supported = before.same(state, LANE)? as usize;
        let now = state.step_of(LANE) as usize;
        let (mut how, mut last) = (AT_HORIZON, self.settings.steps);
        let more = goal.as_ref().and_then(|goal| goal.steps_remaining(LANE)).map(|more| more as usize);
        if let Some(more) = more.filter(|more| *more <= self.settings.steps - now) {
            self.output.head.solved = true;
            if self.settings.stop_at_goal {
                (how, last) = (AT_GOAL, now + more);
            }
        }
        let mut step = self.schedule.after(now);
        while step < last {
            self.output.observe(step, state);
            step = self.schedule.after(step);
        }
        if last > now {
            self.output.observe(last, state);
        }
        Some(End { how, step: last, rolling: supported * (last - now) })
    }

    fn finish(&mut self, end: End, state: &BatchState) {
        let rolling: f64 = state.bodies.iter().map(|b| b.rolling[LANE]).sum();
        let head = &mut self.output.head;
        (head.end, head.step, head.rolling_steps) = (end.how, end.step, rolling as usize + end.rolling);
        head.exchange(&mut SliceWriter(self.output.numbers));
    }
}

/// Reserves memory for everything that steps may add: memory is only returned at the end.
fn reserve(state: &mut BatchState, goal: &mut Option<GoalLanes>) {
    let (pairs, near) = (state.pairs.len(), state.near.len());
    state.active_pairs.reserve_exact(pairs);
    state.active_manifolds.reserve_exact(near);
    state.free_manifolds.reserve_exact(near);
    state.manifolds.reserve_exact(near);
    state.new_contacts.reserve_exact(pairs + near);
    if let Some(ConditionLanes::Inside { regions, .. }) = goal.as_mut().map(|goal| &mut goal.condition) {
        regions[LANE].reserve_exact(MAX_REGION_POINTS);
    }
}

/// Writes numbers to the start of a slice.
struct SliceWriter<'a>(&'a mut [f64]);

impl Port for SliceWriter<'_> {
    fn number(&mut self, value: &mut f64) {
        if let [first, rest @ ..] = std::mem::take(&mut self.0) {
            (*first, self.0) = (*value, rest);
        }
    }
}

/// The steps to observe.
struct Schedule<'a> {
    every: usize,
    list: &'a [f64],
    /// Index of the next one of the list.
    next: usize,
}

impl Schedule<'_> {
    /// The next step to observe after `step`.
    fn after(&mut self, step: usize) -> usize {
        if self.every > 0 {
            return (step / self.every + 1) * self.every;
        }
        while self.next < self.list.len() && self.list[self.next] as usize <= step {
            self.next += 1;
        }
        self.list.get(self.next).map_or(usize::MAX, |step| *step as usize)
    }
}

impl Output<'_> {
    /// An output in these numbers, with room for all observations.
    pub fn new(numbers: &mut [f64]) -> Output<'_> {
        Output { numbers, head: OutputHead::default(), observed: 0 }
    }

    fn observe(&mut self, step: usize, state: &BatchState) {
        let len = observation_len(state.bodies.len());
        let from = OutputHead::LEN + self.observed;
        if from + len > self.free_end() {
            self.head.overflowed = true;
            return;
        }
        self.numbers[from] = step as f64;
        for i in 0..state.bodies.len() {
            let BodyState { position: [x, y], angle, velocity: [vx, vy], omega } = state.body_in(i, LANE);
            let numbers: [f64; STATE_LEN] = [x, y, angle, vx, vy, omega];
            self.numbers[from + 1 + STATE_LEN * i..][..STATE_LEN].copy_from_slice(&numbers);
        }
        self.head.observations += 1;
        self.observed += len;
    }

    fn contact(&mut self, contact: [f64; CONTACT_LEN]) {
        let end = self.free_end();
        if end < OutputHead::LEN + self.observed + CONTACT_LEN {
            self.head.overflowed = true;
            return;
        }
        self.numbers[end - CONTACT_LEN..end].copy_from_slice(&contact);
        self.head.contacts += 1;
    }

    /// End of the free part, after which contacts are stored.
    fn free_end(&self) -> usize {
        self.numbers.len() - CONTACT_LEN * self.head.contacts
    }
}
