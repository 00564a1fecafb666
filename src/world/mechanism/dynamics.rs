//! Accelerations of the joints of a tree, one rollout per lane.
//!
//! H(q) a + C(q, v) = tau: H from the composite inertias of subtrees, C from the forces that the motion at a = 0 needs. A
//! planar inertia is (m, m c, J), J about the origin of the world; a joint's motion is the angular velocity and the velocity
//! of the body's point at the origin.

use nalgebra::{DMatrix, DVector};

use super::super::lanes::simd::{Register, V, Wide};
use super::super::lanes::sincos::sincos;
use super::tree::{Link, Tree};
use crate::task::joint::{JointKind, MAX_JOINTS};
use crate::world::effect::LANES;

/// A tree with the links of one rollout per lane.
pub struct TreeLanes {
    pub kinds: Vec<JointKind>,
    pub parents: Vec<Option<usize>>,
    pub links: Vec<LinkLanes>,
    pub gravity: [V; 2],
}

/// A link in every lane: see [`Link`].
#[derive(Clone, Copy, Default)]
pub struct LinkLanes {
    offset: [V; 2],
    axis: [V; 2],
    centre: [V; 2],
    mass: V,
    inertia: V,
    armature: V,
}

impl LinkLanes {
    /// Sets the link in a lane.
    pub fn set(&mut self, lane: usize, link: &Link) {
        let vectors =
            [(&mut self.offset, link.offset), (&mut self.axis, link.axis), (&mut self.centre, link.centre)];
        for (to, from) in vectors {
            (to[0][lane], to[1][lane]) = (from[0], from[1]);
        }
        (self.mass[lane], self.inertia[lane], self.armature[lane]) = (link.mass, link.inertia, link.armature);
    }
}

/// Room for the joints of any tree. With one more than needed the compiler does not unroll loops over joints: code for eight links
/// takes it minutes.
pub const LARGE: usize = MAX_JOINTS + 1;

/// A number per joint, in lanes.
pub type JointValues<R, const N: usize, const D: usize> = [Wide<R, N>; D];

/// A planar vector in lanes.
type Vector<R, const N: usize> = [Wide<R, N>; 2];

#[inline(always)]
fn load<R: Register, const N: usize>(v: &[V; 2]) -> Vector<R, N> {
    [Wide::load(&v[0]), Wide::load(&v[1])]
}

#[inline(always)]
fn add<R: Register, const N: usize>(a: Vector<R, N>, b: Vector<R, N>) -> Vector<R, N> {
    [a[0] + b[0], a[1] + b[1]]
}

#[inline(always)]
fn scale<R: Register, const N: usize>(s: Wide<R, N>, v: Vector<R, N>) -> Vector<R, N> {
    [s * v[0], s * v[1]]
}

#[inline(always)]
fn dot<R: Register, const N: usize>(a: Vector<R, N>, b: Vector<R, N>) -> Wide<R, N> {
    a[0] * b[0] + a[1] * b[1]
}

#[inline(always)]
fn cross<R: Register, const N: usize>(a: Vector<R, N>, b: Vector<R, N>) -> Wide<R, N> {
    a[0] * b[1] - a[1] * b[0]
}

/// Direction of a frame, (cosine, sine), and vectors in it.
#[inline(always)]
fn rotated<R: Register, const N: usize>(frame: Vector<R, N>, v: Vector<R, N>) -> Vector<R, N> {
    [frame[0] * v[0] - frame[1] * v[1], frame[1] * v[0] + frame[0] * v[1]]
}

/// A link's frame and motion.
#[derive(Clone, Copy)]
struct Frame<R: Register, const N: usize> {
    angle: Wide<R, N>,
    /// (cosine, sine) of the angle.
    direction: Vector<R, N>,
    omega: Wide<R, N>,
    origin: Vector<R, N>,
    /// Acceleration of the origin at a = 0, minus gravity.
    acceleration: Vector<R, N>,
}

/// Inertia and force of a subtree, and the motion of its joint.
#[derive(Clone, Copy)]
struct Composite<R: Register, const N: usize> {
    mass: Wide<R, N>,
    first_moment: Vector<R, N>,
    inertia: Wide<R, N>,
    force: Vector<R, N>,
    moment: Wide<R, N>,
    /// Velocity of the joint's motion: angular, and of the point at the origin.
    turn: Wide<R, N>,
    shift: Vector<R, N>,
}

/// Accelerations at positions `q` and velocities `v` under torques `tau`.
#[inline(always)]
pub fn accelerations<R: Register, const N: usize, const D: usize>(
    tree: &TreeLanes,
    q: &JointValues<R, N, D>,
    v: &JointValues<R, N, D>,
    tau: &JointValues<R, N, D>,
) -> JointValues<R, N, D> {
    let n = tree.links.len().min(D);
    let zero = Wide::all(0.0);
    let mut subtrees = composites(tree, q, v);
    let mut h = [[zero; D]; D];
    let mut right = *tau;
    for i in (0..n).rev() {
        let own = subtrees[i];
        let momentum = [
            own.mass * own.shift[0] - own.turn * own.first_moment[1],
            own.mass * own.shift[1] + own.turn * own.first_moment[0],
        ];
        let angular = own.inertia * own.turn + cross(own.first_moment, own.shift);
        right[i] = right[i] - (own.turn * own.moment + dot(own.shift, own.force));
        let mut j = Some(i);
        while let Some(k) = j {
            let ancestor = subtrees[k];
            h[i][k] = ancestor.turn * angular + dot(ancestor.shift, momentum);
            j = tree.parents[k];
        }
        h[i][i] = h[i][i] + Wide::load(&tree.links[i].armature);
        if let Some(p) = tree.parents[i] {
            let parent = &mut subtrees[p];
            parent.mass = parent.mass + own.mass;
            parent.first_moment = add(parent.first_moment, own.first_moment);
            parent.inertia = parent.inertia + own.inertia;
            parent.force = add(parent.force, own.force);
            parent.moment = parent.moment + own.moment;
        }
    }
    solve(n, &mut h, right)
}

/// Links with their motions, not yet summed over subtrees.
#[inline(always)]
fn composites<R: Register, const N: usize, const D: usize>(
    tree: &TreeLanes,
    q: &JointValues<R, N, D>,
    v: &JointValues<R, N, D>,
) -> [Composite<R, N>; D] {
    let zero = Wide::all(0.0);
    let gravity = load(&tree.gravity);
    let none = [zero; 2];
    let world = Frame {
        angle: zero,
        direction: [Wide::all(1.0), zero],
        omega: zero,
        origin: none,
        acceleration: [gravity[0].minus(), gravity[1].minus()],
    };
    let mut frames = [world; D];
    let empty = Composite {
        mass: zero,
        first_moment: none,
        inertia: zero,
        force: none,
        moment: zero,
        turn: zero,
        shift: none,
    };
    let mut out = [empty; D];
    for (i, link) in tree.links.iter().enumerate().take(D) {
        let parent = tree.parents[i].map_or(world, |p| frames[p]);
        let mut own = parent;
        let mut arm = load(&link.offset);
        match tree.kinds[i] {
            JointKind::Revolute => {
                own.angle = parent.angle + q[i];
                let (sine, cosine) = sincos(own.angle);
                (own.direction, own.omega) = ([cosine, sine], parent.omega + v[i]);
            }
            JointKind::Prismatic => {
                let axis = load(&link.axis);
                arm = add(arm, scale(q[i], axis));
                let along = rotated(parent.direction, axis);
                // Coriolis acceleration: 2 omega x v.
                let twice = (parent.omega + parent.omega) * v[i];
                own.acceleration = add(own.acceleration, [(twice * along[1]).minus(), twice * along[0]]);
                out[i].shift = along;
            }
        }
        let arm = rotated(parent.direction, arm);
        own.origin = add(parent.origin, arm);
        own.acceleration = add(own.acceleration, scale((parent.omega * parent.omega).minus(), arm));
        let centre = rotated(own.direction, load(&link.centre));
        let (mass, at) = (Wide::load(&link.mass), add(own.origin, centre));
        let force = scale(mass, add(own.acceleration, scale((own.omega * own.omega).minus(), centre)));
        out[i].mass = mass;
        out[i].first_moment = scale(mass, at);
        out[i].inertia = Wide::load(&link.inertia) + mass * dot(at, at);
        (out[i].force, out[i].moment) = (force, cross(at, force));
        if tree.kinds[i] == JointKind::Revolute {
            out[i].turn = Wide::all(1.0);
            out[i].shift = [own.origin[1], own.origin[0].minus()];
        }
        frames[i] = own;
    }
    out
}

/// Solves H a = b by elimination without pivots, H symmetric and positive definite, given below its diagonal.
#[inline(always)]
#[expect(clippy::needless_range_loop, reason = "rows and columns of one matrix")]
fn solve<R: Register, const N: usize, const D: usize>(
    n: usize,
    h: &mut [[Wide<R, N>; D]; D],
    mut b: JointValues<R, N, D>,
) -> JointValues<R, N, D> {
    // H = L d L', from the last joint to the first: links on different branches stay uncoupled.
    for k in (0..n).rev() {
        for i in 0..k {
            let factor = h[k][i].div(h[k][k]);
            for j in 0..=i {
                h[i][j] = h[i][j] - factor * h[k][j];
            }
            b[i] = b[i] - factor * b[k];
        }
    }
    for k in 0..n {
        for i in 0..k {
            b[k] = b[k] - h[k][i] * b[i];
        }
        b[k] = b[k].div(h[k][k]);
    }
    b
}

/// An empty lane: links of unit mass that do not move.
pub const IDLE_LINK: Link = Link {
    offset: [0.0; 2],
    axis: [0.0; 2],
    centre: [0.0; 2],
    tip: [0.0; 2],
    mass: 1.0,
    inertia: 1.0,
    armature: 0.0,
};

/// Zeros in all lanes.
pub const NONE: V = V([0.0; LANES]);

/// Torques of a tree at a state: what the accelerations need, and what gravity needs at rest. Numbers by joint.
pub struct RequiredTorques {
    pub total: Vec<f64>,
    pub gravity: Vec<f64>,
}

/// Inverse dynamics by the accelerations under unit torques.
pub fn required_torques(tree: &Tree, q: &[f64], v: &[f64], a: &[f64]) -> Option<RequiredTorques> {
    let n = tree.links.len();
    let at = |v: &[f64], tau: &[f64]| -> Vec<f64> {
        let mut lanes = TreeLanes {
            kinds: tree.kinds.clone(),
            parents: tree.parents.clone(),
            links: vec![LinkLanes::default(); n],
            gravity: tree.gravity.map(V::all),
        };
        for lane in 0..LANES {
            lanes.links.iter_mut().zip(&tree.links).for_each(|(to, from)| to.set(lane, from));
        }
        // Registers that every machine has.
        #[cfg(target_arch = "x86_64")]
        return accelerations_alike::<std::arch::x86_64::__m128d, 4>(&lanes, q, v, tau);
        #[cfg(not(target_arch = "x86_64"))]
        return accelerations_alike::<f64, LANES>(&lanes, q, v, tau);
    };
    let (none, still) = (vec![0.0; n], vec![0.0; n]);
    let (free, hanging) = (at(v, &none), at(&still, &none));
    let column = |j: usize| {
        let mut unit = none.clone();
        unit[j] = 1.0;
        at(&still, &unit)
    };
    let columns: Vec<Vec<f64>> = (0..n).map(column).collect();
    let mobility = DMatrix::from_fn(n, n, |i, j| columns[j][i] - hanging[i]).lu();
    let solve = |right: Vec<f64>| Some(mobility.solve(&DVector::from_vec(right))?.as_slice().to_vec());
    Some(RequiredTorques {
        total: solve((0..n).map(|j| a[j] - free[j]).collect())?,
        gravity: solve(hanging.iter().map(|a| -a).collect())?,
    })
}

/// Accelerations at a state that is the same in all lanes.
fn accelerations_alike<R: Register, const N: usize>(
    tree: &TreeLanes,
    q: &[f64],
    v: &[f64],
    tau: &[f64],
) -> Vec<f64> {
    let all = |values: &[f64]| -> JointValues<R, N, LARGE> {
        std::array::from_fn(|j| Wide::all(values.get(j).copied().unwrap_or(0.0)))
    };
    let found = accelerations(tree, &all(q), &all(v), &all(tau));
    let first = |wide: &Wide<R, N>| {
        let mut lanes = [0.0; LANES];
        wide.store(&mut lanes);
        lanes[0]
    };
    found[..tree.links.len()].iter().map(first).collect()
}
