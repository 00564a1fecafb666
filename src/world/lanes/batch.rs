//! The state of a batch, lanes innermost, and what happens to lanes now and then: filling them, observing,
//! judging goals, retiring them. Everything that happens in every step is in `kernel`.
//!
//! A lane that ends is filled with the next rollout at once, so lanes start at different times and each keeps
//! its own count of steps.

use super::contact::{Gap, with_static};
use super::kernel;
use super::rest::{LOOK_EVERY, Snapshot};
use super::simd::{Mask, Register, V, Wide};
use super::{Feed, Settings};
use crate::task::geometry::Convex;
use crate::task::geometry::polygon_contains;
use crate::task::solid::Solid;
use crate::trajectory::{End, Trajectory};
use crate::world::effect::{Constants, LANES, MOST_PARAMETERS, Motion, MovingLanes, Touch};
use crate::world::goal::{Condition, Party};
use crate::world::observe::Schedule;
use crate::world::prepare::{Prepared, PreparedBody};
use crate::world::record::{APART_STEPS, Recorder, State};

/// Everything about up to [`LANES`] rollouts at work.
pub struct Batch {
    pub bodies: Vec<BodyLanes>,
    pub statics: Vec<StaticLanes>,
    /// Pairs of bodies, then each body's statics.
    pub pairs: Vec<Pair>,
    pub motions: Vec<TermLanes<dyn Motion>>,
    pub touches: Vec<TermLanes<dyn Touch>>,
    /// Whether an effect looks at the clock.
    pub clocked: bool,
    /// s
    pub time_step: f64,
    /// s; 0 in lanes without a rollout.
    pub dt: V,
    /// Speed gained from gravity in a step, m/s.
    pub kick_x: V,
    pub kick_y: V,
    /// Gap up to which surfaces count as touching, m.
    pub touch: V,
    /// Overlap that is not pushed out, m.
    pub slop: V,
    /// Bias speed for each metre of overlap beyond the slop, 1/s.
    pub bias_rate: V,
    /// Steps since the batch began.
    pub tick: f64,
    /// Tick at which the lane's rollout began.
    pub born: V,
    goal: Option<GoalLanes>,
    lanes: [Option<Lane>; LANES],
    /// Earliest tick at which a lane is to be observed or ends.
    due: f64,
    /// Scratch of the step: pairs that push, pairs that began to touch, how often a body's speed has changed.
    pub active: Vec<usize>,
    pub fresh: Vec<usize>,
    pub versions: Vec<u32>,
    pub any_bias: bool,
    /// Some state has left all reason.
    pub wild: bool,
    /// The state after the last step, if some lane may have come to rest.
    snapshot: Option<Snapshot>,
}

/// A disc in every lane.
#[derive(Clone)]
pub struct BodyLanes {
    pub moving: MovingLanes,
    /// rad
    pub angle: V,
    /// Bias speed, m/s.
    pub bias_x: V,
    pub bias_y: V,
    /// m
    pub radius: V,
    /// 1/kg
    pub inv_mass: V,
    /// Spin gained from a tangential impulse of 1 N s at the rim, rad/s.
    pub spin_per_impulse: V,
    /// Whether the body is fast in some lane in this step, and then its way in it, m.
    pub fast: bool,
    pub way_x: V,
    pub way_y: V,
    /// Upper bound of the way travelled, m (sum of both components' sizes).
    pub travel: V,
    /// Whether a static carries the body in this step (0 or 1), and in how many steps one did.
    pub carried: V,
    pub rolling: V,
    pub any_carried: bool,
}

/// A piece of a static in every lane.
pub struct StaticLanes {
    /// Number of the static it is a piece of.
    pub owner: usize,
    /// Rounding radius, m.
    pub radius: V,
    pub core: Core,
}

/// What a static is made of.
pub enum Core {
    Point { x: V, y: V },
    Plane { nx: V, ny: V, offset: V },
    Polygon(Vec<EdgeLanes>),
}

/// An edge from (ax, ay) with outward normal (nx, ny); it runs along (-ny, nx).
#[derive(Clone)]
pub struct EdgeLanes {
    pub ax: V,
    pub ay: V,
    pub nx: V,
    pub ny: V,
    pub length: V,
}

/// A disc and what it may touch.
#[derive(Clone)]
pub struct Pair {
    /// Index of a body.
    pub first: usize,
    /// Index of a body, or of a piece of a static after all bodies.
    pub second: usize,
    /// Index of a body, or of a static after all bodies.
    pub other: usize,
    /// Sum of both bodies' `travel` below which they cannot touch.
    pub limit: V,
    /// Unit normal from first to second, or from the static to the body.
    pub nx: V,
    pub ny: V,
    /// Accumulated normal, tangential and bias impulse, N s.
    pub jn: V,
    pub jt: V,
    pub jb: V,
    /// Target speeds, m/s.
    pub bounce: V,
    pub bias: V,
    /// Slip that friction drives at, m/s, and whether the pair bore no load in the step before (0 or 1); kept
    /// only where laws of contact are at work.
    pub slip: V,
    pub unloaded: V,
    /// Effective masses, kg: 0 in lanes where the pair does not push.
    pub normal_mass: V,
    pub tangent_mass: V,
    pub full_normal_mass: V,
    pub full_tangent_mass: V,
    pub friction: V,
    pub restitution: V,
    /// Tick of the last touch.
    pub last_touch: V,
    /// Lanes that begin to touch (1), and the normal speed (negative: approach), in this step.
    pub begins: V,
    pub speed: V,
    /// Whether impulses of the last step are kept.
    pub pushed: bool,
    /// Versions of both bodies when a visit last changed nothing.
    pub seen: [u32; 2],
}

/// A law of an effect in every lane.
pub struct TermLanes<L: ?Sized + 'static> {
    pub law: &'static L,
    pub constants: [[f64; LANES]; MOST_PARAMETERS],
}

/// A goal in every lane; all lanes' goals are of one kind and between the same parties.
struct GoalLanes {
    condition: ConditionLanes,
    /// Steps for which the condition has held, and must hold.
    held: V,
    needed: V,
}

#[expect(clippy::large_enum_variant, reason = "there is one in a batch")]
enum ConditionLanes {
    /// Squared distance of centres up to which two discs count as touching.
    Discs {
        first: usize,
        second: usize,
        reach2: V,
    },
    /// The static's pieces.
    DiscStatic {
        body: usize,
        fixed: Vec<usize>,
        tolerance: V,
    },
    /// Polygon and the box around it, by lane.
    Inside {
        body: usize,
        regions: [Vec<[f64; 2]>; LANES],
        low: [V; 2],
        high: [V; 2],
    },
    Never,
}

/// A rollout at work.
struct Lane {
    index: usize,
    recorder: Recorder,
    steps: u32,
    schedule: Schedule,
    stop: bool,
    solved: bool,
    /// Ticks of the next observation and of the end.
    due: f64,
}

/// Chipmunk's share of overlap left after a second: 0.9 a 60th of a second.
const LEFT_A_FRAME: f64 = 0.9;
/// Chipmunk's slop, m, for bodies of ordinary size.
const SLOP: f64 = 0.1;
/// Extent from which a body has Chipmunk's slop, m.
const ORDINARY: f64 = 0.6;
/// Radius of the discs in a lane without a rollout: nothing touches them.
const NOTHING: f64 = -1e30;
/// Tick of the last touch, and limit of travel, of a pair not yet looked at.
const NEVER_TOUCHED: f64 = -1e9;

/// Integrates everything that `feed` holds.
#[inline(always)]
pub fn run<R: Register, const N: usize>(feed: &mut dyn Feed, settings: Settings) {
    let Some((index, first)) = feed.next() else { return };
    let mut batch = Batch::for_topology_of(&first);
    batch.fill(0, index, &first);
    for lane in 1..LANES {
        batch.refill(lane, feed);
    }
    while batch.lanes.iter().any(Option::is_some) {
        kernel::step::<R, N>(&mut batch);
        if batch.wild {
            batch.retire_diverged(feed);
        }
        if !batch.fresh.is_empty() {
            batch.record_begun();
        }
        if batch.judge::<R, N>() {
            batch.reached(feed);
        }
        if batch.tick >= batch.due {
            batch.observe_due(feed);
        }
        if settings.end_at_rest {
            if let Some(before) = batch.snapshot.take() {
                batch.end_at_rest(&before, feed);
            } else if batch.tick % LOOK_EVERY == 0.0 {
                batch.snapshot = Snapshot::of(&batch);
            }
        }
    }
}

impl Batch {
    fn for_topology_of(prepared: &Prepared) -> Batch {
        let count = prepared.bodies.len();
        let blank = BodyLanes {
            moving: MovingLanes {
                time: [0.0; LANES],
                x: [0.0; LANES],
                y: [0.0; LANES],
                vx: [0.0; LANES],
                vy: [0.0; LANES],
                omega: [0.0; LANES],
            },
            angle: V::all(0.0),
            bias_x: V::all(0.0),
            bias_y: V::all(0.0),
            radius: V::all(NOTHING),
            inv_mass: V::all(0.0),
            spin_per_impulse: V::all(0.0),
            fast: false,
            way_x: V::all(0.0),
            way_y: V::all(0.0),
            travel: V::all(0.0),
            carried: V::all(0.0),
            rolling: V::all(0.0),
            any_carried: false,
        };
        let statics: Vec<StaticLanes> =
            pieces(prepared).map(|(owner, piece)| StaticLanes::new(owner, piece.corners())).collect();
        let mut pairs = Vec::new();
        for first in 0..count {
            pairs.extend((first + 1..count).map(|second| Pair::new(first, second, second)));
        }
        for first in 0..count {
            let statics = statics.iter().enumerate();
            pairs.extend(statics.map(|(s, piece)| Pair::new(first, count + s, count + piece.owner)));
        }
        Batch {
            bodies: vec![blank; count],
            statics,
            pairs,
            motions: prepared.motions.iter().map(|(law, _)| TermLanes::of(*law)).collect(),
            touches: prepared.touches.iter().map(|(law, _)| TermLanes::of(*law)).collect(),
            clocked: prepared.motions.iter().any(|(law, _)| !law.timeless()),
            time_step: prepared.time_step,
            dt: V::all(0.0),
            kick_x: V::all(0.0),
            kick_y: V::all(0.0),
            touch: V::all(0.0),
            slop: V::all(0.0),
            bias_rate: V::all(0.0),
            tick: 0.0,
            born: V::all(0.0),
            goal: prepared.goal.as_ref().map(|g| GoalLanes::new(&g.condition, prepared)),
            lanes: Default::default(),
            due: f64::INFINITY,
            active: Vec::new(),
            fresh: Vec::new(),
            versions: vec![0; count],
            any_bias: false,
            wild: false,
            snapshot: None,
        }
    }

    /// Puts the next rollout, if there is one, into a lane.
    fn refill(&mut self, lane: usize, feed: &mut dyn Feed) {
        match feed.next() {
            Some((index, prepared)) => self.fill(lane, index, &prepared),
            None => self.clear(lane),
        }
        self.due = self.lanes.iter().flatten().map(|l| l.due).fold(f64::INFINITY, f64::min);
    }

    fn fill(&mut self, lane: usize, index: usize, prepared: &Prepared) {
        let dt = prepared.time_step;
        self.dt[lane] = dt;
        self.kick_x[lane] = prepared.gravity[0] * dt;
        self.kick_y[lane] = prepared.gravity[1] * dt;
        self.touch[lane] = prepared.touch;
        self.slop[lane] = slop(prepared);
        self.bias_rate[lane] = (1.0 - libm::pow(LEFT_A_FRAME, 60.0 * dt)) / dt;
        self.born[lane] = self.tick;
        for (body, own) in self.bodies.iter_mut().zip(&prepared.bodies) {
            // Adding 0 turns -0 into 0: see `kernel::push`.
            body.moving.x[lane] = own.position[0] + 0.0;
            body.moving.y[lane] = own.position[1] + 0.0;
            body.moving.vx[lane] = own.velocity[0] + 0.0;
            body.moving.vy[lane] = own.velocity[1] + 0.0;
            body.moving.omega[lane] = own.omega + 0.0;
            body.angle[lane] = own.angle + 0.0;
            body.bias_x[lane] = 0.0;
            body.bias_y[lane] = 0.0;
            body.radius[lane] = radius(own);
            body.inv_mass[lane] = 1.0 / own.mass;
            body.spin_per_impulse[lane] = radius(own) / own.inertia;
            body.travel[lane] = 0.0;
            body.carried[lane] = 0.0;
            body.rolling[lane] = 0.0;
        }
        for (fixed, (_, own)) in self.statics.iter_mut().zip(pieces(prepared)) {
            fixed.fill(lane, own);
        }
        for pair in &mut self.pairs {
            pair.fill(lane, prepared);
        }
        for (term, (_, constants)) in self.motions.iter_mut().zip(&prepared.motions) {
            term.fill(lane, constants);
        }
        for (term, (_, constants)) in self.touches.iter_mut().zip(&prepared.touches) {
            term.fill(lane, constants);
        }
        if let (Some(lanes), Some(own)) = (&mut self.goal, &prepared.goal) {
            lanes.held[lane] = 0.0;
            lanes.needed[lane] = f64::from(own.hold_steps(dt));
            lanes.condition.fill(lane, &own.condition, prepared);
        }
        let mut new = Lane {
            index,
            recorder: Recorder::new(prepared),
            steps: prepared.steps,
            schedule: prepared.schedule.clone(),
            stop: prepared.stop,
            solved: false,
            due: self.tick + f64::from(prepared.schedule.after(0).min(prepared.steps)),
        };
        new.recorder.observe(0, &self.states(lane));
        self.lanes[lane] = Some(new);
    }

    /// Ends the lanes in which the last step changed nothing: every further step would be the same.
    fn end_at_rest(&mut self, before: &Snapshot, feed: &mut dyn Feed) {
        for lane in 0..LANES {
            let Some(rolling) = before.same(self, lane) else { continue };
            let step = self.step_of(lane);
            let (states, reached) = (self.states(lane), self.steps_to_goal(lane));
            let Some(own) = &mut self.lanes[lane] else { continue };
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

    /// After how many more steps like the last one the goal is reached.
    fn steps_to_goal(&self, lane: usize) -> Option<u32> {
        let goal = self.goal.as_ref()?;
        let unsolved = goal.held[lane] > 0.0 && goal.needed[lane].is_finite();
        unsolved.then(|| (goal.needed[lane] - goal.held[lane]) as u32)
    }

    /// Whether the lane holds a rollout.
    pub fn is_used(&self, lane: usize) -> bool {
        self.lanes[lane].is_some()
    }

    /// Leaves a lane empty.
    fn clear(&mut self, lane: usize) {
        self.lanes[lane] = None;
        self.dt[lane] = 0.0;
        self.kick_x[lane] = 0.0;
        self.kick_y[lane] = 0.0;
        for body in &mut self.bodies {
            body.radius[lane] = NOTHING;
            for v in [
                &mut body.moving.x,
                &mut body.moving.y,
                &mut body.moving.vx,
                &mut body.moving.vy,
                &mut body.moving.omega,
                &mut body.bias_x,
                &mut body.bias_y,
                &mut body.inv_mass,
                &mut body.spin_per_impulse,
                &mut body.travel,
            ] {
                v[lane] = 0.0;
            }
        }
        for pair in &mut self.pairs {
            (pair.jn[lane], pair.jt[lane]) = (0.0, 0.0);
            pair.limit[lane] = f64::INFINITY;
        }
        for term in &mut self.motions {
            term.fill(lane, &[0.0; MOST_PARAMETERS]);
        }
        if let Some(goal) = &mut self.goal {
            goal.needed[lane] = f64::INFINITY;
        }
    }

    fn states(&self, lane: usize) -> Vec<State> {
        let state = |b: &BodyLanes| State {
            position: [b.moving.x[lane], b.moving.y[lane]],
            angle: b.angle[lane],
            velocity: [b.moving.vx[lane], b.moving.vy[lane]],
            omega: b.moving.omega[lane],
        };
        self.bodies.iter().map(state).collect()
    }

    fn step_of(&self, lane: usize) -> u32 {
        (self.tick - self.born[lane]) as u32
    }

    /// Hands the contacts that began in this step to the recorders.
    fn record_begun(&mut self) {
        let fresh = std::mem::take(&mut self.fresh);
        for index in &fresh {
            for lane in 0..LANES {
                if !self.begins(*index, lane, &fresh) {
                    continue;
                }
                let pair = &self.pairs[*index];
                if let Some(own) = &mut self.lanes[lane] {
                    let step = (self.tick - self.born[lane]) as u32;
                    let speed = (-pair.speed[lane]).max(0.0);
                    own.recorder.begin(step, pair.first, pair.other, speed);
                }
            }
        }
    }

    /// Whether with this pair its two things begin to touch, of whose other pieces none touches already; of several that
    /// begin in one step the first counts.
    fn begins(&self, index: usize, lane: usize, fresh: &[usize]) -> bool {
        let own = &self.pairs[index];
        let touched = |(i, pair): (usize, &Pair)| {
            let same = pair.first == own.first && pair.other == own.other && i != index;
            let begins = fresh.contains(&i) && pair.begins[lane] > 0.0;
            same && if begins {
                i < index
            } else {
                self.tick - pair.last_touch[lane] <= f64::from(APART_STEPS)
            }
        };
        own.begins[lane] > 0.0 && !self.pairs.iter().enumerate().any(touched)
    }

    /// Follows the goals; whether a lane has just reached its own.
    #[inline(always)]
    fn judge<R: Register, const N: usize>(&mut self) -> bool {
        let Some(goal) = &mut self.goal else { return false };
        let none = Wide::all(0.0);
        let holds: Mask<R, N> = match &goal.condition {
            ConditionLanes::Never => return false,
            ConditionLanes::Discs { first, second, reach2 } => {
                let (a, b) = (&self.bodies[*first].moving, &self.bodies[*second].moving);
                let (dx, dy) = (Wide::load(&b.x) - Wide::load(&a.x), Wide::load(&b.y) - Wide::load(&a.y));
                (dx * dx + dy * dy).at_most(Wide::load(reach2))
            }
            ConditionLanes::DiscStatic { body, fixed, tolerance } => {
                let within = |piece: &usize| {
                    let gap: Gap<R, N> = with_static(&self.bodies[*body], &self.statics[*piece]);
                    gap.separation.at_most(Wide::load(tolerance))
                };
                let first = within(&fixed[0]);
                fixed[1..].iter().fold(first, |any, piece| any.or(within(piece)))
            }
            ConditionLanes::Inside { body, regions, low, high } => {
                let at = &self.bodies[*body].moving;
                let (x, y) = (Wide::load(&at.x), Wide::load(&at.y));
                let across = Wide::load(&low[0]).at_most(x).and(x.at_most(Wide::load(&high[0])));
                let near = across.and(Wide::load(&low[1]).at_most(y)).and(y.at_most(Wide::load(&high[1])));
                if near.any() {
                    let mut holds = V::all(0.0);
                    for l in 0..LANES {
                        holds[l] = f64::from(u8::from(polygon_contains(&regions[l], [at.x[l], at.y[l]])));
                    }
                    near.and(none.less(Wide::load(&holds)))
                } else {
                    near
                }
            }
        };
        let held = holds.select(Wide::load(&goal.held) + Wide::all(1.0), none);
        held.store(&mut goal.held);
        Wide::load(&goal.needed).at_most(held).any()
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
                let step = self.step_of(lane);
                self.observe(lane, step);
                self.retire(lane, step, End::Goal, feed);
            }
        }
    }

    fn observe_due(&mut self, feed: &mut dyn Feed) {
        for lane in 0..LANES {
            let step = self.step_of(lane);
            let Some(own) = &mut self.lanes[lane] else { continue };
            if own.due > self.tick {
                continue;
            }
            let (steps, next) = (own.steps, own.schedule.after(step));
            own.due = self.born[lane] + f64::from(next.min(steps));
            self.observe(lane, step);
            if step >= steps {
                self.retire(lane, steps, End::Horizon, feed);
            }
        }
        self.due = self.lanes.iter().flatten().map(|l| l.due).fold(f64::INFINITY, f64::min);
    }

    fn observe(&mut self, lane: usize, step: u32) {
        let states = self.states(lane);
        if let Some(own) = &mut self.lanes[lane] {
            own.recorder.observe(step, &states);
        }
    }

    fn retire_diverged(&mut self, feed: &mut dyn Feed) {
        for lane in 0..LANES {
            if self.lanes[lane].is_some() && !self.states(lane).iter().all(State::is_finite) {
                // Nothing of the step that diverged is kept.
                let step = self.step_of(lane) - 1;
                self.retire(lane, step, End::Diverged, feed);
            }
        }
    }

    /// Hands a finished rollout over and fills its lane again.
    fn retire(&mut self, lane: usize, step: u32, end: End, feed: &mut dyn Feed) {
        if let Some(mut own) = self.lanes[lane].take() {
            let rolling: f64 = self.bodies.iter().map(|b| b.rolling[lane]).sum();
            own.recorder.rolled(rolling as u32);
            if own.solved {
                own.recorder.solved();
            }
            let trajectory: Trajectory = own.recorder.finish(step, end);
            feed.done(own.index, trajectory);
        }
        self.refill(lane, feed);
    }
}

impl Pair {
    fn new(first: usize, second: usize, other: usize) -> Pair {
        let none = V::all(0.0);
        Pair {
            first,
            second,
            other,
            limit: V::all(f64::INFINITY),
            nx: none,
            ny: none,
            jn: none,
            jt: none,
            jb: none,
            bounce: none,
            bias: none,
            slip: none,
            unloaded: none,
            normal_mass: none,
            tangent_mass: none,
            full_normal_mass: none,
            full_tangent_mass: none,
            friction: none,
            restitution: none,
            last_touch: V::all(NEVER_TOUCHED),
            begins: none,
            speed: none,
            pushed: false,
            seen: [u32::MAX; 2],
        }
    }

    /// Forgets the impulses of the last step.
    pub fn let_go(&mut self) {
        if self.pushed {
            self.pushed = false;
            (self.jn, self.jt) = (V::all(0.0), V::all(0.0));
        }
    }

    fn fill(&mut self, lane: usize, prepared: &Prepared) {
        let count = prepared.bodies.len();
        let a = &prepared.bodies[self.first];
        let looseness = |i: usize| {
            let b = &prepared.bodies[i];
            (1.0 / b.mass, radius(b) * radius(b) / b.inertia)
        };
        let (mut inv_mass, mut turn) = looseness(self.first);
        let (friction, restitution) = if self.second < count {
            let (m, t) = looseness(self.second);
            (inv_mass, turn) = (inv_mass + m, turn + t);
            (prepared.bodies[self.second].friction, prepared.bodies[self.second].restitution)
        } else {
            let fixed = &prepared.statics[self.other - count];
            (fixed.friction, fixed.restitution)
        };
        self.limit[lane] = NEVER_TOUCHED;
        (self.jn[lane], self.jt[lane]) = (0.0, 0.0);
        self.full_normal_mass[lane] = 1.0 / inv_mass;
        self.full_tangent_mass[lane] = 1.0 / (inv_mass + turn);
        self.friction[lane] = a.friction * friction;
        self.restitution[lane] = a.restitution * restitution;
        self.last_touch[lane] = NEVER_TOUCHED;
    }
}

impl<L: ?Sized + 'static> TermLanes<L> {
    fn of(law: &'static L) -> TermLanes<L> {
        TermLanes { law, constants: [[0.0; LANES]; MOST_PARAMETERS] }
    }

    /// The law's constants in one lane.
    pub fn own(&self, lane: usize) -> Constants {
        std::array::from_fn(|c| self.constants[c][lane])
    }

    fn fill(&mut self, lane: usize, constants: &Constants) {
        for (row, value) in self.constants.iter_mut().zip(constants) {
            row[lane] = *value;
        }
    }
}

impl StaticLanes {
    fn new(owner: usize, corners: usize) -> StaticLanes {
        let none = V::all(0.0);
        let edge = EdgeLanes { ax: none, ay: none, nx: none, ny: none, length: none };
        let core = match corners {
            0 => Core::Plane { nx: none, ny: none, offset: none },
            1 => Core::Point { x: none, y: none },
            _ => Core::Polygon(vec![edge; corners]),
        };
        StaticLanes { owner, radius: none, core }
    }

    fn fill(&mut self, lane: usize, piece: Piece) {
        match (&mut self.core, piece) {
            (Core::Plane { nx, ny, offset }, Piece::HalfPlane { normal, offset: own }) => {
                (nx[lane], ny[lane], offset[lane]) = (normal[0], normal[1], own);
            }
            (Core::Point { x, y }, Piece::Convex(c)) => {
                self.radius[lane] = c.radius;
                (x[lane], y[lane]) = (c.points[0][0], c.points[0][1]);
            }
            (Core::Polygon(edges), Piece::Convex(c)) => {
                self.radius[lane] = c.radius;
                for (i, edge) in edges.iter_mut().enumerate() {
                    let (p, q) = (c.points[i], c.points[(i + 1) % c.points.len()]);
                    let (dx, dy) = (q[0] - p[0], q[1] - p[1]);
                    let length = (dx * dx + dy * dy).sqrt();
                    (edge.ax[lane], edge.ay[lane]) = (p[0], p[1]);
                    (edge.nx[lane], edge.ny[lane]) = (dy / length, -dx / length);
                    edge.length[lane] = length;
                }
            }
            // Lanes of a batch have one topology: see `super::Topology`.
            _ => unreachable!("rollouts of one batch have the same topology"),
        }
    }
}

/// A piece of a static, world frame.
#[derive(Clone, Copy)]
pub enum Piece<'a> {
    Convex(&'a Convex),
    HalfPlane { normal: [f64; 2], offset: f64 },
}

impl Piece<'_> {
    /// Number of corners; 0 for a half plane.
    pub fn corners(&self) -> usize {
        match self {
            Piece::Convex(c) => c.points.len(),
            Piece::HalfPlane { .. } => 0,
        }
    }
}

/// The pieces of all statics, each with its static's number.
pub fn pieces(prepared: &Prepared) -> impl Iterator<Item = (usize, Piece<'_>)> {
    prepared.statics.iter().enumerate().flat_map(|(owner, fixed)| {
        let (bounded, plane) = match &fixed.shape {
            Solid::Bounded(pieces) => (pieces.0.as_slice(), None),
            Solid::HalfPlane { normal, offset } => {
                (&[][..], Some(Piece::HalfPlane { normal: *normal, offset: *offset }))
            }
        };
        bounded.iter().map(Piece::Convex).chain(plane).map(move |piece| (owner, piece))
    })
}

/// m
fn radius(body: &PreparedBody) -> f64 {
    body.shape.disc_radius().expect("the engine takes only scenes whose bodies are discs")
}

impl GoalLanes {
    fn new(condition: &Condition, prepared: &Prepared) -> GoalLanes {
        let none = V::all(0.0);
        let condition = match condition {
            Condition::Inside { body, .. } => ConditionLanes::Inside {
                body: *body,
                regions: Default::default(),
                low: [none; 2],
                high: [none; 2],
            },
            Condition::Contact { parties, .. } => match *parties {
                [Party::Body(first), Party::Body(second)] => {
                    ConditionLanes::Discs { first, second, reach2: none }
                }
                [Party::Body(b), Party::Static(s)] | [Party::Static(s), Party::Body(b)] => {
                    let of_it = pieces(prepared).enumerate().filter(|(_, (owner, _))| *owner == s);
                    let fixed = of_it.map(|(piece, _)| piece).collect();
                    ConditionLanes::DiscStatic { body: b, fixed, tolerance: none }
                }
                [Party::Static(_), Party::Static(_)] => ConditionLanes::Never,
            },
        };
        GoalLanes { condition, held: none, needed: V::all(f64::INFINITY) }
    }
}

impl ConditionLanes {
    fn fill(&mut self, lane: usize, own: &Condition, prepared: &Prepared) {
        match (self, own) {
            (ConditionLanes::Discs { first, second, reach2 }, Condition::Contact { tolerance, .. }) => {
                let radii = radius(&prepared.bodies[*first]) + radius(&prepared.bodies[*second]);
                reach2[lane] = (radii + tolerance) * (radii + tolerance);
            }
            (ConditionLanes::DiscStatic { tolerance, .. }, Condition::Contact { tolerance: own, .. }) => {
                tolerance[lane] = *own;
            }
            (ConditionLanes::Inside { regions, low, high, .. }, Condition::Inside { region, .. }) => {
                for k in 0..2 {
                    low[k][lane] = region.iter().map(|p| p[k]).fold(f64::INFINITY, f64::min);
                    high[k][lane] = region.iter().map(|p| p[k]).fold(f64::NEG_INFINITY, f64::max);
                }
                regions[lane].clone_from(region);
            }
            _ => {}
        }
    }
}

/// Chipmunk's slop of 0.1 m is made for bodies of ordinary size. Smaller bodies get less, falling with the
/// square of the size, so that a ball of 4 cm sinks in by half a millimetre and not by its whole radius.
fn slop(prepared: &Prepared) -> f64 {
    let smallest = prepared.bodies.iter().map(|b| 2.0 * radius(b)).fold(f64::INFINITY, f64::min);
    let share = (smallest / ORDINARY).min(1.0);
    SLOP * share * share
}
