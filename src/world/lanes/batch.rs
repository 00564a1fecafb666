//! What happens to lanes now and then: they are filled, observed, judged, and end. What happens in every step is in
//! `kernel`.
//!
//! A lane that ends is filled with the next rollout at once, so lanes start at different times and each keeps
//! its own count of steps.

use super::feed::Feed;
use super::goal::GoalLanes;
use super::intervene::intervene;
use super::rest::{LOOK_EVERY, Snapshot};
use super::settle::Settling;
use super::state::State;
use super::touching::Met;
use crate::trajectory::{End, Trajectory};
use crate::world::change::Change;
use crate::world::effect::LANES;
use crate::world::observe::Schedule;
use crate::world::prepare::{Prepared, PreparedBody};
use crate::world::record::{self, APART_STEPS, Recorder};

/// Pairs looked at, all lanes of each, between two looks at whether to go on: about a millisecond.
const PAIRS_A_LOOK: usize = 1 << 14;

/// What is compiled for a set of instructions. Both own nothing: what does, a panic would have to take away, and a way out of every
/// operation of so large a function takes the compiler minutes.
pub trait Instructions {
    /// Advances every lane by one time step.
    fn step(&self, state: &mut State);
    /// Follows the goals; whether a lane has just reached its own.
    fn judge(&self, goal: &mut GoalLanes, state: &mut State) -> bool;
}

/// Integrates everything that `feed` holds, unless it is told to stop.
pub fn run(feed: &mut dyn Feed, end_at_rest: bool, instructions: &dyn Instructions) {
    let Some(first) = feed.next() else { return };
    let mut batch = Batch::new(&first.1);
    let mut first = Some(first);
    for lane in 0..LANES {
        batch.refill(lane, feed, first.take());
    }
    let steps_a_look = (PAIRS_A_LOOK / (batch.state.pairs.len() + batch.state.near.len()).max(1)).max(1);
    let mut unlooked = 0;
    while batch.lanes.iter().any(Option::is_some) {
        unlooked += 1;
        if unlooked == steps_a_look {
            unlooked = 0;
            if !feed.goes_on() {
                return;
            }
        }
        instructions.step(&mut batch.state);
        let mut gone = [false; LANES];
        if batch.state.wild {
            gone = batch.end_diverged(feed);
        }
        if batch.settles {
            batch.settle();
        }
        if !batch.state.fresh.is_empty() {
            batch.record_begun();
        }
        if let Some(goal) = &mut batch.goal
            && instructions.judge(goal, &mut batch.state)
        {
            batch.reached(feed);
        }
        // What follows what diverged begins after this step has been judged.
        for lane in (0..LANES).filter(|lane| gone[*lane]) {
            batch.refill(lane, feed, None);
        }
        if batch.state.tick >= batch.due {
            batch.observe_due(feed);
        }
        if end_at_rest {
            if let Some(before) = batch.snapshot.take() {
                batch.end_at_rest(&before, feed);
            } else if (batch.state.tick as u64).is_multiple_of(LOOK_EVERY) {
                batch.snapshot = batch.snapshot();
            }
        }
    }
}

/// Everything about up to [`LANES`] rollouts at work.
struct Batch {
    state: State,
    goal: Option<GoalLanes>,
    lanes: [Option<Lane>; LANES],
    /// Earliest tick at which a lane is to be observed or ends.
    due: f64,
    /// The state after the last step, if some lane may have come to rest.
    snapshot: Option<Snapshot>,
    /// Whether some lane's first step may have to be made again.
    settles: bool,
}

/// A rollout at work.
struct Lane {
    index: usize,
    recorder: Recorder,
    steps: u32,
    schedule: Schedule,
    stop: bool,
    solved: bool,
    /// Step of the next observation; beyond the end, the end.
    look: u32,
    /// Tick at which it is observed, changed or ends next.
    due: f64,
    /// What is known of its things, where there are interventions; and how many of them have happened.
    prepared: Option<Box<Prepared>>,
    changed: usize,
    /// Where the first step is made again until contacts bear what they did.
    settling: Option<Settling>,
}

impl Lane {
    /// The next step at which there is something to do.
    fn next(&self) -> u32 {
        self.change().map_or(self.look, |change| change.step.min(self.look))
    }

    /// The next intervention.
    fn change(&self) -> Option<&Change> {
        self.prepared.as_ref()?.changes.get(self.changed)
    }
}

/// Where bodies start, as they were given.
fn starts(prepared: &Prepared) -> Vec<record::State> {
    let start = |b: &PreparedBody| if b.there { b.start() } else { record::State::NOWHERE };
    prepared.bodies.iter().map(start).collect()
}

impl Batch {
    fn new(prepared: &Prepared) -> Batch {
        Batch {
            state: State::for_topology_of(prepared),
            goal: prepared.goal.as_ref().map(|g| GoalLanes::new(&g.condition, prepared)),
            lanes: Default::default(),
            due: f64::INFINITY,
            snapshot: None,
            settles: false,
        }
    }

    /// Puts the next rollout, if there is one, into a lane.
    fn refill(&mut self, lane: usize, feed: &mut dyn Feed, first: Option<(usize, Prepared)>) {
        let mut next = first.or_else(|| feed.next());
        loop {
            match next {
                Some((index, prepared)) => self.fill(lane, index, prepared),
                None => self.clear(lane),
            }
            let Some(end) = self.intervene(lane, 0) else { break };
            self.hand_over(lane, 0, end, feed);
            next = feed.next();
        }
        self.due = self.lanes.iter().flatten().map(|l| l.due).fold(f64::INFINITY, f64::min);
    }

    fn fill(&mut self, lane: usize, index: usize, prepared: Prepared) {
        self.state.fill(lane, &prepared);
        if let Some(goal) = &mut self.goal {
            goal.fill(lane, &prepared);
        }
        let look = prepared.schedule.after(0).min(prepared.steps);
        let mut new = Lane {
            index,
            recorder: Recorder::new(&prepared),
            steps: prepared.steps,
            schedule: prepared.schedule.clone(),
            stop: prepared.stop,
            solved: false,
            look,
            due: self.state.tick + f64::from(look),
            prepared: None,
            changed: 0,
            settling: None,
        };
        new.recorder.observe(0, &starts(&prepared));
        if prepared.settled {
            new.settling = Some(Settling::new(prepared));
            self.settles = true;
        } else if !prepared.changes.is_empty() {
            new.prepared = Some(Box::new(prepared));
            new.due = self.state.tick + f64::from(new.next());
        }
        self.lanes[lane] = Some(new);
    }

    /// Does what is to be done in a lane after so many steps; how its rollout ends, if it does.
    fn intervene(&mut self, lane: usize, step: u32) -> Option<End> {
        let own = self.lanes[lane].as_mut()?;
        let prepared = own.prepared.as_mut()?;
        while let Some(change) = prepared.changes.get(own.changed).filter(|c| c.step == step).cloned() {
            own.changed += 1;
            // What was the same in the step before may be another from here on.
            self.snapshot = None;
            let end = intervene(&mut self.state, self.goal.as_mut(), lane, prepared, &change);
            if end.is_some() {
                return end;
            }
        }
        own.due = self.state.born[lane] + f64::from(own.next());
        None
    }

    /// Has first steps made again where contacts do not yet bear what they bore before.
    fn settle(&mut self) {
        self.settles = false;
        for lane in 0..LANES {
            let Some(own) = &mut self.lanes[lane] else { continue };
            let Some(mut settling) = own.settling.take() else { continue };
            if settling.back(&mut self.state, lane) {
                own.settling = Some(settling);
                self.settles = true;
                own.due = self.state.tick + f64::from(own.next());
                // A lane that begins again is not one at rest.
                self.snapshot = None;
            }
        }
    }

    /// Leaves a lane empty.
    fn clear(&mut self, lane: usize) {
        self.lanes[lane] = None;
        self.state.clear(lane);
        if let Some(goal) = &mut self.goal {
            goal.clear(lane);
        }
    }

    /// Hands the contacts that began in this step to the recorders.
    fn record_begun(&mut self) {
        let fresh = std::mem::take(&mut self.state.fresh);
        for index in &fresh {
            for lane in 0..LANES {
                if !self.begins(*index, lane, &fresh) {
                    continue;
                }
                let met = self.state.met(*index);
                if let Some(own) = &mut self.lanes[lane] {
                    let step = (self.state.tick - self.state.born[lane]) as u32;
                    let speed = (-met.speed[lane]).max(0.0);
                    own.recorder.begin(step, met.first, met.other, speed);
                }
            }
        }
    }

    /// Whether with this pair its two things begin to touch, of whose other pieces none touches already; of several that
    /// begin in one step the first counts.
    fn begins(&self, index: usize, lane: usize, fresh: &[usize]) -> bool {
        let own = self.state.met(index);
        let touched = |(i, met): (usize, &Met)| {
            if met.first != own.first || met.other != own.other || i == index {
                return false;
            }
            if met.begins[lane] > 0.0 && fresh.contains(&i) {
                return i < index;
            }
            self.state.tick - met.last_touch[lane] <= f64::from(APART_STEPS)
        };
        let begins = self.lanes[lane].is_some() && own.begins[lane] > 0.0;
        begins && !self.state.all_met().enumerate().any(touched)
    }

    fn reached(&mut self, feed: &mut dyn Feed) {
        for lane in 0..LANES {
            let Some(goal) = &mut self.goal else { return };
            if goal.held[lane] < goal.needed[lane] {
                continue;
            }
            goal.needed[lane] = f64::INFINITY;
            let Some(own) = &mut self.lanes[lane] else { continue };
            own.solved = true;
            if own.stop {
                let step = self.state.step_of(lane);
                self.observe(lane, step);
                self.retire(lane, step, End::Goal, feed);
            }
        }
    }

    fn observe_due(&mut self, feed: &mut dyn Feed) {
        for lane in 0..LANES {
            let step = self.state.step_of(lane);
            let Some(own) = &mut self.lanes[lane] else { continue };
            if own.due > self.state.tick {
                continue;
            }
            let (steps, look) = (own.steps, own.look);
            if step >= look {
                own.look = own.schedule.after(step).min(steps);
                own.due = self.state.born[lane] + f64::from(own.next());
                self.observe(lane, step);
            }
            if step >= steps {
                self.retire(lane, steps, End::Horizon, feed);
            } else if let Some(end) = self.intervene(lane, step) {
                self.retire(lane, step, end, feed);
            }
        }
        self.due = self.lanes.iter().flatten().map(|l| l.due).fold(f64::INFINITY, f64::min);
    }

    fn observe(&mut self, lane: usize, step: u32) {
        let states = self.state.bodies_in(lane);
        if let Some(own) = &mut self.lanes[lane] {
            own.recorder.observe(step, &states);
        }
    }

    /// Hands over what diverged; the lanes that it leaves.
    fn end_diverged(&mut self, feed: &mut dyn Feed) -> [bool; LANES] {
        let mut gone = [false; LANES];
        for (lane, gone) in gone.iter_mut().enumerate() {
            if self.lanes[lane].is_some() && self.state.diverged(lane) {
                // Nothing of the step that diverged is kept.
                let step = self.state.step_of(lane) - 1;
                self.hand_over(lane, step, End::Diverged, feed);
                *gone = true;
            }
            // What is out of the scene falls on and on.
            self.state.park(lane);
        }
        gone
    }

    /// Hands a finished rollout over and fills its lane again.
    fn retire(&mut self, lane: usize, step: u32, end: End, feed: &mut dyn Feed) {
        self.hand_over(lane, step, end, feed);
        self.refill(lane, feed, None);
    }

    /// Hands a finished rollout over.
    fn hand_over(&mut self, lane: usize, step: u32, end: End, feed: &mut dyn Feed) {
        if let Some(mut own) = self.lanes[lane].take() {
            let rolling: f64 = self.state.bodies.iter().map(|b| b.rolling[lane]).sum();
            own.recorder.rolled(rolling as u32);
            if own.solved {
                own.recorder.solved();
            }
            let trajectory: Trajectory = own.recorder.finish(step, end);
            feed.done(own.index, trajectory);
        }
    }

    /// The state now, if some lane may be at rest.
    fn snapshot(&self) -> Option<Snapshot> {
        Snapshot::of(&self.state, |lane| self.lanes[lane].is_some())
    }

    /// Ends the lanes in which the last step changed nothing: every further step would be the same.
    fn end_at_rest(&mut self, before: &Snapshot, feed: &mut dyn Feed) {
        for lane in 0..LANES {
            let Some(rolling) = before.same(&self.state, lane).filter(|_| self.lanes[lane].is_some()) else {
                continue;
            };
            let step = self.state.step_of(lane);
            let (states, reached) =
                (self.state.bodies_in(lane), self.goal.as_ref().and_then(|g| g.steps_to_go(lane)));
            // What an intervention is still to come to is at rest for now only.
            let Some(own) = self.lanes[lane].as_mut().filter(|own| own.change().is_none()) else { continue };
            let mut last = own.steps;
            let mut end = End::Horizon;
            if let Some(more) = reached.filter(|more| *more <= own.steps - step) {
                own.solved = true;
                if own.stop {
                    (last, end) = (step + more, End::Goal);
                }
            }
            let mut k = own.schedule.after(step);
            while k < last {
                own.recorder.observe(k, &states);
                k = own.schedule.after(k);
            }
            if last > step {
                own.recorder.observe(last, &states);
            }
            own.recorder.rolled(rolling * (last - step));
            self.retire(lane, last, end, feed);
        }
    }
}
