//! The state of a batch, lanes innermost: all data that a step reads and writes.
//!
//! `kernel` advances it; `load` fills its lanes.

use super::contact_pair::ContactPair;
use super::manifold::{Manifold, OutlinePair, pairs as outline_pairs};
use super::outline::{self, BodyFrame, PieceOutline};
use super::simd::V;
use super::topology::Topology;
use crate::world::effect::{Constants, LANES, MAX_PARAMETERS, MotionStateLanes};
use crate::world::state::BodyState;

/// The state of up to [`LANES`] rollouts.
pub struct BatchState {
    pub bodies: Vec<BodyLanes>,
    pub statics: Vec<StaticLanes>,
    /// Pairs of discs, then each disc's statics.
    pub pairs: Vec<DiscPair>,
    /// Only if some body is not a disc: frames of all bodies, outlines of bodies and statics, pairs of
    /// outlines, and the manifolds of active pairs, some of them free.
    pub frames: Vec<BodyFrame>,
    pub outlines: Vec<PieceOutline>,
    pub near: Vec<OutlinePair>,
    pub manifolds: Vec<Manifold>,
    pub free_manifolds: Vec<usize>,
    pub motion_laws: Vec<LawLanes>,
    pub contact_laws: Vec<LawLanes>,
    /// Whether an effect depends on time.
    pub clocked: bool,
    /// s
    pub time_step: f64,
    /// s; 0 in lanes without a rollout.
    pub dt: V,
    /// Velocity change by gravity in a step, m/s.
    pub kick_x: V,
    pub kick_y: V,
    /// Gap up to which surfaces count as touching, m.
    pub contact_margin: V,
    /// Allowed overlap, m.
    pub slop: V,
    /// Bias velocity per metre of overlap beyond the slop, 1/s.
    pub bias_rate: V,
    /// Steps since the batch began.
    pub tick: f64,
    /// Tick at which the lane's rollout began.
    pub start_tick: V,
    /// Scratch of the step: active pairs and manifolds, new contacts ([`BatchState::contact`]), and
    /// versions of the bodies' velocities.
    pub active_pairs: Vec<usize>,
    pub active_manifolds: Vec<usize>,
    pub new_contacts: Vec<usize>,
    pub versions: Vec<u32>,
    pub any_bias: bool,
    /// Whether a state may have diverged in some lane, and then the lanes (1).
    pub may_diverge: bool,
    pub implausible: V,
}

/// A body in every lane. Velocity and position are those of its centre of mass.
#[derive(Clone)]
pub struct BodyLanes {
    pub moving: MotionStateLanes,
    /// rad
    pub angle: V,
    /// Bias velocity, m/s.
    pub bias_x: V,
    pub bias_y: V,
    /// Radius of the disc, or of the smallest inscribed disc of the body's pieces, m.
    pub radius: V,
    /// Whether it is not a disc.
    pub has_outline: bool,
    /// 1/kg
    pub inv_mass: V,
    /// Spin gained from a tangential impulse of 1 N s at the rim, rad/s.
    pub spin_per_impulse: V,
    /// Whether the body is fast in some lane in this step, and its displacement in the step, m.
    pub fast: bool,
    pub displacement_x: V,
    pub displacement_y: V,
    /// Upper bound of the distance travelled, m (sum of the absolute components).
    pub travel: V,
    /// Whether a static supports the body in this step (0 or 1), and the number of steps in which one
    /// did.
    pub supported: V,
    pub rolling: V,
    pub any_supported: bool,
}

/// A piece of a static in every lane.
pub struct StaticLanes {
    /// Index of its static.
    pub owner: usize,
    /// Rounding radius, m.
    pub radius: V,
    pub core: StaticCore,
}

/// The core of a static's piece.
pub enum StaticCore {
    Point { x: V, y: V },
    Plane { nx: V, ny: V, offset: V },
    Polygon(Vec<EdgeLanes>),
}

/// An edge from (ax, ay) with outward normal (nx, ny); its direction is (-ny, nx).
#[derive(Clone)]
pub struct EdgeLanes {
    pub ax: V,
    pub ay: V,
    pub nx: V,
    pub ny: V,
    pub length: V,
}

/// A disc and another object that it may touch.
#[derive(Clone)]
pub struct DiscPair {
    /// Index of a body.
    pub first: usize,
    /// Index of a body, or of a piece of a static after all bodies.
    pub second: usize,
    pub contact: ContactPair,
    /// Sum of both bodies' `travel` below which they cannot touch.
    pub limit: V,
    /// Unit normal from first to second, or from the static to the body.
    pub nx: V,
    pub ny: V,
    /// Accumulated normal, tangential and bias impulse, N s.
    pub jn: V,
    pub jt: V,
    pub jb: V,
    /// Target velocities, m/s.
    pub bounce: V,
    pub bias: V,
    /// Tangential target velocity, m/s, and whether the pair had no normal impulse in the previous step
    /// (0 or 1); used only with laws of contact.
    pub slip: V,
    pub unloaded: V,
    /// Effective masses, kg: 0 in lanes where the pair is not active.
    pub normal_mass: V,
    pub tangent_mass: V,
    pub full_normal_mass: V,
    pub full_tangent_mass: V,
    pub friction: V,
    pub restitution: V,
    /// Whether impulses of the last step are stored.
    pub pushed: bool,
    /// Solver versions of both bodies at the last visit that changed nothing.
    pub seen: [u32; 2],
}

/// A law of an effect in every lane.
pub struct LawLanes {
    /// Index of the effect in the registry.
    pub effect: usize,
    pub constants: [[f64; LANES]; MAX_PARAMETERS],
}

/// Radius of the discs in a lane without a rollout: nothing touches them.
pub const ABSENT_RADIUS_M: f64 = -1e30;
impl BatchState {
    /// Empty lanes for rollouts of a topology.
    pub fn new(topology: &Topology) -> BatchState {
        let count = topology.bodies.len();
        let piece = |(owner, corners): &(usize, usize)| StaticLanes::new(*owner, *corners);
        let statics: Vec<StaticLanes> = topology.statics.iter().map(piece).collect();
        let disc = |i: usize| topology.is_disc(i);
        let (frames, outlines) = outline::of(topology);
        let discs = (0..count).filter(|i| disc(*i)).count();
        let mut pairs = Vec::with_capacity(discs * discs.saturating_sub(1) / 2 + discs * statics.len());
        for first in (0..count).filter(|i| disc(*i)) {
            let discs = (first + 1..count).filter(|i| disc(*i));
            pairs.extend(discs.map(|second| DiscPair::new(first, second, second)));
        }
        for first in (0..count).filter(|i| disc(*i)) {
            let statics = statics.iter().enumerate();
            pairs.extend(statics.map(|(s, piece)| DiscPair::new(first, count + s, count + piece.owner)));
        }
        let none = V::all(0.0);
        BatchState {
            bodies: (0..count).map(|i| BodyLanes { has_outline: !disc(i), ..BodyLanes::empty() }).collect(),
            statics,
            pairs,
            near: outline_pairs(&outlines, count, topology.own, disc),
            frames,
            outlines,
            manifolds: Vec::new(),
            free_manifolds: Vec::new(),
            motion_laws: topology.motion_laws.iter().map(LawLanes::of).collect(),
            contact_laws: topology.contact_laws.iter().map(LawLanes::of).collect(),
            clocked: topology.clocked,
            time_step: f64::from_bits(topology.time_step),
            dt: none,
            kick_x: none,
            kick_y: none,
            contact_margin: none,
            slop: none,
            bias_rate: none,
            tick: 0.0,
            start_tick: none,
            active_pairs: Vec::new(),
            active_manifolds: Vec::new(),
            new_contacts: Vec::new(),
            versions: vec![0; count],
            any_bias: false,
            may_diverge: false,
            implausible: none,
        }
    }

    /// The bodies' states in one lane (of their frames' origins).
    pub fn bodies_in(&self, lane: usize) -> Vec<BodyState> {
        (0..self.bodies.len()).map(|i| self.body_in(i, lane)).collect()
    }

    /// A body's state in one lane.
    pub fn body_in(&self, i: usize, lane: usize) -> BodyState {
        let b = &self.bodies[i];
        if b.radius[lane] == ABSENT_RADIUS_M {
            return BodyState::ABSENT;
        }
        let (angle, omega) = (b.angle[lane], b.moving.omega[lane]);
        let arm = self.frames.get(i).map_or([0.0; 2], |f| f.arm(lane, angle));
        BodyState {
            position: [b.moving.x[lane] - arm[0], b.moving.y[lane] - arm[1]],
            angle,
            velocity: [b.moving.vx[lane] + omega * arm[1], b.moving.vy[lane] - omega * arm[0]],
            omega,
        }
    }

    /// Whether the lane's rollout ends because it has diverged in this step.
    pub fn ends_diverged(&self, lane: usize) -> bool {
        // Without the lane's own mark the result would depend on the other lanes.
        self.may_diverge && self.implausible[lane] > 0.0 && self.diverged(lane)
    }

    /// Whether a body of the lane has diverged.
    pub fn diverged(&self, lane: usize) -> bool {
        let diverges =
            |i: usize| self.bodies[i].radius[lane] != ABSENT_RADIUS_M && !self.body_in(i, lane).is_finite();
        (0..self.bodies.len()).any(diverges)
    }

    /// The contact pair of an index in `new_contacts`: pairs of discs, then pairs of outlines.
    pub fn contact(&self, index: usize) -> &ContactPair {
        match self.pairs.get(index) {
            Some(pair) => &pair.contact,
            None => &self.near[index - self.pairs.len()].contact,
        }
    }

    /// All contact pairs in the order of [`BatchState::contact`].
    pub fn all_contacts(&self) -> impl Iterator<Item = &ContactPair> {
        self.pairs.iter().map(|p| &p.contact).chain(self.near.iter().map(|n| &n.contact))
    }

    /// The same, mutable.
    pub fn all_contacts_mut(&mut self) -> impl Iterator<Item = &mut ContactPair> {
        self.pairs.iter_mut().map(|p| &mut p.contact).chain(self.near.iter_mut().map(|n| &mut n.contact))
    }

    /// Number of steps of a lane's rollout.
    #[inline]
    pub fn step_of(&self, lane: usize) -> u32 {
        (self.tick - self.start_tick[lane]) as u32
    }
}

impl BodyLanes {
    /// Absent discs, which nothing touches.
    fn empty() -> BodyLanes {
        let none = V::all(0.0);
        let still = [0.0; LANES];
        BodyLanes {
            moving: MotionStateLanes { time: still, x: still, y: still, vx: still, vy: still, omega: still },
            angle: none,
            bias_x: none,
            bias_y: none,
            radius: V::all(ABSENT_RADIUS_M),
            has_outline: false,
            inv_mass: none,
            spin_per_impulse: none,
            fast: false,
            displacement_x: none,
            displacement_y: none,
            travel: none,
            supported: none,
            rolling: none,
            any_supported: false,
        }
    }
}

impl StaticLanes {
    fn new(owner: usize, corners: usize) -> StaticLanes {
        let none = V::all(0.0);
        let edge = EdgeLanes { ax: none, ay: none, nx: none, ny: none, length: none };
        let core = match corners {
            0 => StaticCore::Plane { nx: none, ny: none, offset: none },
            1 => StaticCore::Point { x: none, y: none },
            _ => StaticCore::Polygon(vec![edge; corners]),
        };
        StaticLanes { owner, radius: none, core }
    }
}

impl DiscPair {
    fn new(first: usize, second: usize, other: usize) -> DiscPair {
        let none = V::all(0.0);
        DiscPair {
            first,
            second,
            contact: ContactPair::new(first, other),
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

    /// Resets the impulses of the last step.
    #[inline]
    pub fn clear_impulses(&mut self) {
        if self.pushed {
            self.pushed = false;
            (self.jn, self.jt) = (V::all(0.0), V::all(0.0));
        }
    }
}

impl LawLanes {
    fn of(effect: &usize) -> LawLanes {
        LawLanes { effect: *effect, constants: [[0.0; LANES]; MAX_PARAMETERS] }
    }

    /// The law's constants in one lane.
    #[inline]
    pub fn constants_in(&self, lane: usize) -> Constants {
        std::array::from_fn(|c| self.constants[c][lane])
    }
}
