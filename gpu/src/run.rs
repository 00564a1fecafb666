//! One rollout: the loop over its steps, as `lanes::batch` runs it.

use crate::world::lanes::exchange::Port;
use crate::world::lanes::goal::GoalLanes;
use crate::world::lanes::kernel::step;
use crate::world::lanes::state::BatchState;
use crate::world::lanes::topology::Topology;
use crate::world::state::BodyState;

/// The only lane.
const LANE: usize = 0;
/// How a rollout ended, as numbers.
const AT_HORIZON: f64 = 0.0;
const AT_GOAL: f64 = 1.0;
const DIVERGED: f64 = 2.0;

/// What a rollout returns: [`Output::HEAD`] numbers, then for each observation its step and six numbers a body
/// (x, y, angle, vx, vy, omega), then from the end backwards four numbers a contact (step, first, other, speed).
pub struct Output<'a> {
    numbers: &'a mut [f64],
    observations: usize,
    contacts: usize,
    /// Whether a contact did not fit.
    full: bool,
}

/// Advances a rollout from its state in `image` to its end.
///
/// `topology` and `image` are written by the program's `gpu` engine: first the number of steps, whether the goal ends
/// the rollout, and the steps between two observations, or 0 and a list of steps.
pub fn run(topology: &[f64], image: &[f64], output: &mut Output) {
    let mut own = Topology::default();
    own.exchange(&mut Reader(topology));
    let mut reader = Reader(image);
    let steps = reader.whole(0);
    let stop = reader.whole(0) == 1;
    let every = reader.whole(0);
    let listed = if every == 0 { reader.whole(0) } else { 0 };
    let (list, rest) = reader.0.split_at(listed.min(reader.0.len()));
    let mut reader = Reader(rest);
    let mut schedule = Schedule { every, list, next: 0 };
    let mut state = BatchState::new(&own);
    reserve(&mut state);
    let mut goal = GoalLanes::new(&own);
    state.exchange(LANE, &mut reader);
    if let Some(goal) = &mut goal {
        goal.exchange(LANE, &mut reader);
    }
    let mut solved = false;
    let mut due = schedule.after(state.step_of(LANE) as usize).min(steps);
    let (end, at) = loop {
        step::<f64, 1>(&mut state);
        let now = state.step_of(LANE) as usize;
        if state.ends_diverged(LANE) {
            // The state after the diverged step is discarded.
            break (DIVERGED, now - 1);
        }
        for k in 0..state.new_contacts.len() {
            let index = state.new_contacts[k];
            if state.is_new_contact(index, LANE) {
                let contact = state.contact(index);
                let speed = (-contact.speed[LANE]).max(0.0);
                output.contact([now as f64, contact.first as f64, contact.other as f64, speed]);
            }
        }
        state.new_contacts.clear();
        if let Some(goal) = &mut goal
            && goal.update::<f64, 1>(&mut state)
        {
            goal.needed[LANE] = f64::INFINITY;
            solved = true;
            if stop {
                output.observe(now, &state);
                break (AT_GOAL, now);
            }
        }
        if now >= due {
            output.observe(now, &state);
            due = schedule.after(now).min(steps);
        }
        if now >= steps {
            break (AT_HORIZON, steps);
        }
    };
    let rolling: f64 = state.bodies.iter().map(|b| b.rolling[LANE]).sum();
    output.finish([end, at as f64, f64::from(u8::from(solved)), rolling]);
}

/// Reserves memory for everything that steps may add: memory is only returned at the end.
fn reserve(state: &mut BatchState) {
    let (pairs, near) = (state.pairs.len(), state.near.len());
    state.active_pairs.reserve_exact(pairs);
    state.active_manifolds.reserve_exact(near);
    state.free_manifolds.reserve_exact(near);
    state.manifolds.reserve_exact(near);
    state.new_contacts.reserve_exact(pairs + near);
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
        Output { numbers, observations: 0, contacts: 0, full: false }
    }

    fn observe(&mut self, step: usize, state: &BatchState) {
        let width = 1 + 6 * state.bodies.len();
        let from = Self::HEAD + self.observations * width;
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
    }

    fn contact(&mut self, contact: [f64; 4]) {
        let end = self.numbers.len() - 4 * self.contacts;
        if end < Self::HEAD + 4 {
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
