//! Rollouts of a thread: the loop over their steps, as `lanes::batch` runs it.

use crate::world::lanes::exchange::Port;
use crate::world::lanes::goal::{ConditionLanes, GoalLanes, MAX_REGION_POINTS};
use crate::world::lanes::kernel::step;
use crate::world::lanes::rest_detection::{REST_CHECK_INTERVAL_STEPS, StepSnapshot};
use crate::world::lanes::state::BatchState;
use crate::world::lanes::topology::Topology;
use crate::world::state::BodyState;

/// The only lane.
const LANE: usize = 0;
/// How a rollout ended, as numbers.
const AT_HORIZON: f64 = 0.0;
const AT_GOAL: f64 = 1.0;
const DIVERGED: f64 = 2.0;

/// Output of a rollout: [`Output::HEAD`] numbers, then for each observation its step and six numbers a body
/// (x, y, angle, vx, vy, omega), then from the end backwards four numbers a contact (step, first, other, speed).
pub struct Output<'a> {
    numbers: &'a mut [f64],
    observations: usize,
    contacts: usize,
    /// Numbers of all observations so far.
    observed: usize,
    /// Whether an observation or a contact did not fit.
    full: bool,
}

/// Advances rollouts of one topology from their states to their ends, one after the other; `next` supplies an image and
/// room for the output.
///
/// `topology` and images are written by the program's `gpu` engine; an image begins with the number of steps, whether
/// the goal ends the rollout, and the steps between two observations, or 0 and a list of steps. One loop over the steps
/// of all rollouts, as in `lanes::batch`: neighbouring threads step together although their rollouts end at different
/// times.
pub fn run<'a>(topology: &[f64], mut next: impl FnMut() -> Option<(&'a [f64], Output<'a>)>) {
    let mut own = Topology::default();
    own.exchange(&mut Reader(topology));
    let mut state = BatchState::new(&own);
    let mut goal = GoalLanes::new(&own);
    reserve(&mut state, &mut goal);
    let mut snapshot = StepSnapshot::with_capacity(&state);
    let mut current: Option<Rollout> = None;
    loop {
        let Some(rollout) = &mut current else {
            let Some((image, output)) = next() else { return };
            current = Some(Rollout::load(image, output, &mut state, &mut goal));
            snapshot.forget();
            continue;
        };
        step::<f64, 1>(&mut state);
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
    steps: usize,
    stop: bool,
    schedule: Schedule<'a>,
    /// Step of the next observation.
    due: usize,
    solved: bool,
    output: Output<'a>,
}

/// How and after which step a rollout ended, and steps in which statics support bodies that were not simulated.
struct End {
    how: f64,
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
        let mut reader = Reader(image);
        let (steps, stop, every) = (reader.whole(0), reader.whole(0) == 1, reader.whole(0));
        let listed = if every == 0 { reader.whole(0) } else { 0 };
        let (list, rest) = reader.0.split_at(listed.min(reader.0.len()));
        let mut reader = Reader(rest);
        let mut schedule = Schedule { every, list, next: 0 };
        state.exchange(LANE, &mut reader);
        if let Some(goal) = goal {
            goal.exchange(LANE, &mut reader);
        }
        let due = schedule.after(state.step_of(LANE) as usize).min(steps);
        Rollout { steps, stop, schedule, due, solved: false, output }
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
                self.output.contact([now as f64, contact.first as f64, contact.other as f64, speed]);
            }
        }
        state.new_contacts.clear();
        if let Some(goal) = goal
            && goal.update::<f64, 1>(state)
        {
            goal.needed[LANE] = f64::INFINITY;
            self.solved = true;
            if self.stop {
                self.output.observe(now, state);
                return Some(End { how: AT_GOAL, step: now, rolling: 0 });
            }
        }
        if now >= self.due {
            self.output.observe(now, state);
            self.due = self.schedule.after(now).min(self.steps);
        }
        (now >= self.steps).then_some(End { how: AT_HORIZON, step: self.steps, rolling: 0 })
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
        let (mut how, mut last) = (AT_HORIZON, self.steps);
        let more = goal.as_ref().and_then(|goal| goal.steps_remaining(LANE)).map(|more| more as usize);
        if let Some(more) = more.filter(|more| *more <= self.steps - now) {
            self.solved = true;
            if self.stop {
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
        let solved = f64::from(u8::from(self.solved));
        self.output.finish([end.how, end.step as f64, solved, rolling + end.rolling as f64]);
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

/// Reads numbers that the program has written.
struct Reader<'a>(&'a [f64]);

impl Port for Reader<'_> {
    fn number(&mut self, value: &mut f64) {
        if let [first, rest @ ..] = self.0 {
            (*value, self.0) = (*first, rest);
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
    /// End, last step, whether the goal was reached, rolling steps, observations, contacts, whether contacts are missing.
    pub const HEAD: usize = 7;

    /// An output in these numbers, with room for all observations.
    pub fn new(numbers: &mut [f64]) -> Output<'_> {
        Output { numbers, observations: 0, contacts: 0, observed: 0, full: false }
    }

    fn observe(&mut self, step: usize, state: &BatchState) {
        let width = 1 + 6 * state.bodies.len();
        let from = Self::HEAD + self.observed;
        if from + width > self.numbers.len() - 4 * self.contacts {
            self.full = true;
            return;
        }
        self.numbers[from] = step as f64;
        for i in 0..state.bodies.len() {
            let BodyState { position: [x, y], angle, velocity: [vx, vy], omega } = state.body_in(i, LANE);
            self.numbers[from + 1 + 6 * i..][..6].copy_from_slice(&[x, y, angle, vx, vy, omega]);
        }
        self.observations += 1;
        self.observed += width;
    }

    fn contact(&mut self, contact: [f64; 4]) {
        let end = self.numbers.len() - 4 * self.contacts;
        if end < Self::HEAD + self.observed + 4 {
            self.full = true;
            return;
        }
        self.numbers[end - 4..end].copy_from_slice(&contact);
        self.contacts += 1;
    }

    fn finish(&mut self, [end, step, solved, rolling]: [f64; 4]) {
        let full = f64::from(u8::from(self.full));
        let head = [end, step, solved, rolling, self.observations as f64, self.contacts as f64, full];
        self.numbers[..Self::HEAD].copy_from_slice(&head);
    }
}
