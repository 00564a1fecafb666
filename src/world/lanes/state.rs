//! The state of a batch, lanes innermost: everything that a step reads and writes.
//!
//! What a step does with it is in `kernel`; how a rollout gets into a lane is in `fill`.

use super::manifold::{Manifold, Near, pairs as near_pairs};
use super::outline::{self, Frame, Outline};
use super::piece::pieces;
use super::simd::V;
use super::touching::Met;
use crate::world::effect::{Constants, LANES, MOST_PARAMETERS, Motion, MovingLanes, Touch};
use crate::world::prepare::Prepared;
use crate::world::record;

/// Everything about up to [`LANES`] rollouts at work that a step reads or writes.
pub struct State {
    pub bodies: Vec<BodyLanes>,
    pub statics: Vec<StaticLanes>,
    /// Pairs of discs, then each disc's statics.
    pub pairs: Vec<Pair>,
    /// Where some body is no disc: what all bodies have beyond discs, outlines of bodies and statics, pairs of outlines, and the
    /// contacts of those that push, some of them spare. Else none.
    pub frames: Vec<Frame>,
    pub outlines: Vec<Outline>,
    pub near: Vec<Near>,
    pub manifolds: Vec<Manifold>,
    pub spare: Vec<usize>,
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
    /// Scratch of the step: pairs and contacts that push, what began to touch ([`State::met`]), how often a body's speed has
    /// changed.
    pub active: Vec<usize>,
    pub pressing: Vec<usize>,
    pub fresh: Vec<usize>,
    pub versions: Vec<u32>,
    pub any_bias: bool,
    /// Some state has left all reason.
    pub wild: bool,
}

/// A body in every lane. Speeds and position are those of its centre of mass.
#[derive(Clone)]
pub struct BodyLanes {
    pub moving: MovingLanes,
    /// rad
    pub angle: V,
    /// Bias speed, m/s.
    pub bias_x: V,
    pub bias_y: V,
    /// Of the disc, or of the least of those that fit into the body's pieces, m.
    pub radius: V,
    /// Whether it is anything but a disc.
    pub shaped: bool,
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
    pub met: Met,
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

/// Radius of the discs in a lane without a rollout: nothing touches them.
pub const NOTHING: f64 = -1e30;
impl State {
    /// Empty lanes for rollouts like this one.
    pub fn for_topology_of(prepared: &Prepared) -> State {
        let count = prepared.bodies.len();
        let statics: Vec<StaticLanes> =
            pieces(prepared).map(|(owner, piece)| StaticLanes::new(owner, piece.corners())).collect();
        let disc = |i: usize| prepared.bodies[i].shape.disc_radius().is_some();
        let (frames, outlines) = outline::of(prepared);
        let mut pairs = Vec::new();
        for first in (0..count).filter(|i| disc(*i)) {
            let discs = (first + 1..count).filter(|i| disc(*i));
            pairs.extend(discs.map(|second| Pair::new(first, second, second)));
        }
        for first in (0..count).filter(|i| disc(*i)) {
            let statics = statics.iter().enumerate();
            pairs.extend(statics.map(|(s, piece)| Pair::new(first, count + s, count + piece.owner)));
        }
        let none = V::all(0.0);
        State {
            bodies: (0..count).map(|i| BodyLanes { shaped: !disc(i), ..BodyLanes::empty() }).collect(),
            statics,
            pairs,
            near: near_pairs(&outlines, count, prepared.own, disc),
            frames,
            outlines,
            manifolds: Vec::new(),
            spare: Vec::new(),
            motions: prepared.motions.iter().map(|(law, _)| TermLanes::of(*law)).collect(),
            touches: prepared.touches.iter().map(|(law, _)| TermLanes::of(*law)).collect(),
            clocked: prepared.motions.iter().any(|(law, _)| !law.timeless()),
            time_step: prepared.time_step,
            dt: none,
            kick_x: none,
            kick_y: none,
            touch: none,
            slop: none,
            bias_rate: none,
            tick: 0.0,
            born: none,
            active: Vec::new(),
            pressing: Vec::new(),
            fresh: Vec::new(),
            versions: vec![0; count],
            any_bias: false,
            wild: false,
        }
    }

    /// The bodies' states in one lane: those of their frames' origins.
    pub fn bodies_in(&self, lane: usize) -> Vec<record::State> {
        let state = |(i, b): (usize, &BodyLanes)| {
            if b.radius[lane] == NOTHING {
                return record::State::NOWHERE;
            }
            let (angle, omega) = (b.angle[lane], b.moving.omega[lane]);
            let arm = self.frames.get(i).map_or([0.0; 2], |f| f.arm(lane, angle));
            record::State {
                position: [b.moving.x[lane] - arm[0], b.moving.y[lane] - arm[1]],
                angle,
                velocity: [b.moving.vx[lane] + omega * arm[1], b.moving.vy[lane] - omega * arm[0]],
                omega,
            }
        };
        self.bodies.iter().enumerate().map(state).collect()
    }

    /// Whether a body of the lane has left all reason.
    pub fn diverged(&self, lane: usize) -> bool {
        let states = self.bodies_in(lane);
        self.bodies.iter().zip(&states).any(|(b, state)| b.radius[lane] != NOTHING && !state.is_finite())
    }

    /// Who touched, of what `fresh` holds: numbers of pairs, then of pairs of outlines.
    pub fn met(&self, index: usize) -> &Met {
        match self.pairs.get(index) {
            Some(pair) => &pair.met,
            None => &self.near[index - self.pairs.len()].met,
        }
    }

    /// Everybody who may touch, numbered as [`State::met`] takes them.
    pub fn all_met(&self) -> impl Iterator<Item = &Met> {
        self.pairs.iter().map(|p| &p.met).chain(self.near.iter().map(|n| &n.met))
    }

    /// The same, to be changed.
    pub fn all_met_mut(&mut self) -> impl Iterator<Item = &mut Met> {
        self.pairs.iter_mut().map(|p| &mut p.met).chain(self.near.iter_mut().map(|n| &mut n.met))
    }

    /// Steps that a lane's rollout has made.
    #[inline]
    pub fn step_of(&self, lane: usize) -> u32 {
        (self.tick - self.born[lane]) as u32
    }
}

impl BodyLanes {
    /// Discs that nothing touches.
    fn empty() -> BodyLanes {
        let none = V::all(0.0);
        let still = [0.0; LANES];
        BodyLanes {
            moving: MovingLanes { time: still, x: still, y: still, vx: still, vy: still, omega: still },
            angle: none,
            bias_x: none,
            bias_y: none,
            radius: V::all(NOTHING),
            shaped: false,
            inv_mass: none,
            spin_per_impulse: none,
            fast: false,
            way_x: none,
            way_y: none,
            travel: none,
            carried: none,
            rolling: none,
            any_carried: false,
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
}

impl Pair {
    fn new(first: usize, second: usize, other: usize) -> Pair {
        let none = V::all(0.0);
        Pair {
            first,
            second,
            met: Met::new(first, other),
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
            pushed: false,
            seen: [u32::MAX; 2],
        }
    }

    /// Forgets the impulses of the last step.
    #[inline]
    pub fn let_go(&mut self) {
        if self.pushed {
            self.pushed = false;
            (self.jn, self.jt) = (V::all(0.0), V::all(0.0));
        }
    }
}

impl<L: ?Sized + 'static> TermLanes<L> {
    fn of(law: &'static L) -> TermLanes<L> {
        TermLanes { law, constants: [[0.0; LANES]; MOST_PARAMETERS] }
    }

    /// The law's constants in one lane.
    #[inline]
    pub fn own(&self, lane: usize) -> Constants {
        std::array::from_fn(|c| self.constants[c][lane])
    }
}
