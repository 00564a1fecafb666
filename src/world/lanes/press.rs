//! Sequential impulses over the contacts of bodies that are no discs: `solve`'s scheme with two points, in the frame of their normal.
//!
//! Source: as `kernel` (`cpArbiterApplyImpulse`): each point's normal, then its friction, from the speeds as they are when the
//! contact is visited.
//!
//! Differences from the source: those of `solve`; both points of a contact are solved in the frame of its normal, and bodies get the
//! sum of their impulses.

use super::manifold::{Manifold, Point};
use super::outline::Frame;
use super::simd::{Register, Wide};
use super::state::{BodyLanes, State};

/// A contact whose impulses would change by less than this share of the normal impulse is content and left as it
/// is: a thousand times what rounds off, so that a resting ball costs one visit and not ten.
pub const CONTENT: f64 = 1e-12;

/// Applies the impulses of the last step.
#[inline(always)]
pub fn warm_start<R: Register, const N: usize>(state: &mut State) {
    let State { pressing, manifolds, near, bodies, frames, .. } = state;
    for slot in pressing.iter() {
        let manifold = &manifolds[*slot];
        let met = &near[manifold.near].met;
        let (between, normal) =
            ([met.first, met.other], [Wide::load(&manifold.nx), Wide::load(&manifold.ny)]);
        let mut speeds = Relative::<R, N>::of(bodies, frames, between, normal);
        let mut sum = [Wide::all(0.0); 2];
        for point in &manifold.points[..manifold.count] {
            let impulse = [Wide::load(&point.jn), Wide::load(&point.jt)];
            speeds.push(point, impulse);
            sum = [sum[0] + impulse[0], sum[1] + impulse[1]];
        }
        speeds.store(bodies, between, normal, sum);
    }
}

/// One visit to every contact that a visit may change; whether any was changed.
#[inline(always)]
pub fn sweep<const BIAS: bool, R: Register, const N: usize>(state: &mut State) -> bool {
    let State { pressing, manifolds, near, bodies, frames, versions, .. } = state;
    let mut changed = false;
    for slot in pressing.iter() {
        let manifold = &mut manifolds[*slot];
        let met = &near[manifold.near].met;
        let moves = met.other < bodies.len();
        let other = if moves { met.other } else { met.first };
        let now = [versions[met.first], versions[other]];
        if manifold.seen == now {
            continue;
        }
        if visit::<BIAS, R, N>(manifold, [met.first, met.other], bodies, frames) {
            changed = true;
            versions[met.first] += 1;
            if moves {
                versions[other] += 1;
            }
        } else {
            manifold.seen = now;
        }
    }
    changed
}

/// One visit to a contact; whether it changed anything.
#[inline(always)]
fn visit<const BIAS: bool, R: Register, const N: usize>(
    manifold: &mut Manifold,
    between: [usize; 2],
    bodies: &mut [BodyLanes],
    frames: &mut [Frame],
) -> bool {
    let normal = [Wide::<R, N>::load(&manifold.nx), Wide::load(&manifold.ny)];
    let (friction, none) = (Wide::load(&manifold.friction), Wide::all(0.0));
    let mut speeds = Relative::of(bodies, frames, between, normal);
    let mut biases = if BIAS { Some(speeds.biases(bodies, frames, between, normal)) } else { None };
    let (mut sum, mut bias_sum) = ([none; 2], none);
    let (mut moved, mut pushed_out) = (false, false);
    for point in &mut manifold.points[..manifold.count] {
        if let Some(biases) = &mut biases {
            let [speed, _] = biases.at(point);
            if let Some(d) = resist_bias(point, speed) {
                biases.push(point, [d, none]);
                bias_sum = bias_sum + d;
                pushed_out = true;
            }
        }
        let speed = speeds.at(point);
        if let Some(impulse) = resist(point, friction, speed) {
            speeds.push(point, impulse);
            sum = [sum[0] + impulse[0], sum[1] + impulse[1]];
            moved = true;
        }
    }
    if moved {
        speeds.store(bodies, between, normal, sum);
    }
    if let (Some(biases), true) = (biases, pushed_out) {
        biases.store_biases(bodies, frames, between, normal, bias_sum);
    }
    moved || pushed_out
}

/// Changes of the normal and tangential impulse against relative speeds; `None` where the point is content.
#[inline(always)]
fn resist<R: Register, const N: usize>(
    point: &mut Point,
    friction: Wide<R, N>,
    [along, across]: [Wide<R, N>; 2],
) -> Option<[Wide<R, N>; 2]> {
    let none = Wide::all(0.0);
    let (jn_old, jt_old) = (Wide::load(&point.jn), Wide::load(&point.jt));
    let jn = (jn_old - (Wide::load(&point.bounce) + along) * Wide::load(&point.normal_mass)).above(none);
    let most = friction * jn;
    let across = across - Wide::load(&point.slip);
    let jt = (jt_old - across * Wide::load(&point.tangent_mass)).above(none - most).below(most);
    let (dn, dt) = (jn - jn_old, jt - jt_old);
    let content = Wide::all(CONTENT) * jn;
    let moved = content.less(dn.size()).or(content.less(dt.size()));
    if !moved.any() {
        return None;
    }
    moved.select(jn, jn_old).store(&mut point.jn);
    moved.select(jt, jt_old).store(&mut point.jt);
    Some([moved.select(dn, none), moved.select(dt, none)])
}

/// The change of the bias impulse; `None` where the point is content.
#[inline(always)]
fn resist_bias<R: Register, const N: usize>(point: &mut Point, speed: Wide<R, N>) -> Option<Wide<R, N>> {
    let (none, old) = (Wide::all(0.0), Wide::load(&point.jb));
    let new = (old + (Wide::load(&point.bias) - speed) * Wide::load(&point.normal_mass)).above(none);
    let moved = (Wide::all(CONTENT) * new).less((new - old).size());
    if !moved.any() {
        return None;
    }
    moved.select(new, old).store(&mut point.jb);
    Some(moved.select(new - old, none))
}

/// Speeds of two bodies, or of one and of what never moves, against each other.
struct Relative<R, const N: usize> {
    /// Of the second's centre of mass against the first's: along the normal, and across it, m/s.
    along: Wide<R, N>,
    across: Wide<R, N>,
    /// Spin of each, rad/s.
    spins: [Wide<R, N>; 2],
    /// Of both together, 1/kg.
    inv_mass: Wide<R, N>,
    /// Of each, 1/(kg m^2).
    inv_inertias: [Wide<R, N>; 2],
    /// Whether the second moves.
    moves: bool,
}

impl<R: Register, const N: usize> Relative<R, N> {
    #[inline(always)]
    fn of(
        bodies: &[BodyLanes],
        frames: &[Frame],
        [first, other]: [usize; 2],
        normal: [Wide<R, N>; 2],
    ) -> Self {
        let (a, none) = (&bodies[first], Wide::all(0.0));
        let inertia = Wide::load(&frames[first].inv_inertia);
        let (vx, vy) = (Wide::load(&a.moving.vx), Wide::load(&a.moving.vy));
        let (spin, inv_mass) = (Wide::load(&a.moving.omega), Wide::load(&a.inv_mass));
        if other >= bodies.len() {
            let [along, across] = split([none - vx, none - vy], normal);
            let (spins, inv_inertias) = ([spin, none], [inertia, none]);
            return Relative { along, across, spins, inv_mass, inv_inertias, moves: false };
        }
        let b = &bodies[other];
        let v = [Wide::load(&b.moving.vx) - vx, Wide::load(&b.moving.vy) - vy];
        let [along, across] = split(v, normal);
        Relative {
            along,
            across,
            spins: [spin, Wide::load(&b.moving.omega)],
            inv_mass: inv_mass + Wide::load(&b.inv_mass),
            inv_inertias: [inertia, Wide::load(&frames[other].inv_inertia)],
            moves: true,
        }
    }

    /// Bias speeds of the same.
    #[inline(always)]
    fn biases(
        &self,
        bodies: &[BodyLanes],
        frames: &[Frame],
        [first, other]: [usize; 2],
        normal: [Wide<R, N>; 2],
    ) -> Self {
        let none = Wide::all(0.0);
        let (mut v, mut spins) = ([none; 2], [Wide::load(&frames[first].bias_omega), none]);
        if self.moves {
            v = [Wide::load(&bodies[other].bias_x), Wide::load(&bodies[other].bias_y)];
            spins[1] = Wide::load(&frames[other].bias_omega);
        }
        v = [v[0] - Wide::load(&bodies[first].bias_x), v[1] - Wide::load(&bodies[first].bias_y)];
        let [along, across] = split(v, normal);
        Relative { along, across, spins, ..*self }
    }

    /// Speeds at a point: along the normal, and across it, m/s.
    #[inline(always)]
    fn at(&self, point: &Point) -> [Wide<R, N>; 2] {
        let [n, t] = [Wide::load(&point.first[0]), Wide::load(&point.first[1])];
        let (mut by_n, mut by_t) = (self.spins[0] * n, self.spins[0] * t);
        if self.moves {
            by_n = by_n - self.spins[1] * Wide::load(&point.second[0]);
            by_t = by_t - self.spins[1] * Wide::load(&point.second[1]);
        }
        [self.along - by_n, self.across - by_t]
    }

    /// An impulse at a point (along the normal, and across it, N s) on the second, and in reverse on the first.
    #[inline(always)]
    fn push(&mut self, point: &Point, [normal, across]: [Wide<R, N>; 2]) {
        self.along = self.along + normal * self.inv_mass;
        self.across = self.across + across * self.inv_mass;
        let turn = Wide::load(&point.first[0]) * normal + Wide::load(&point.first[1]) * across;
        self.spins[0] = self.spins[0] - turn * self.inv_inertias[0];
        if self.moves {
            let turn = Wide::load(&point.second[0]) * normal + Wide::load(&point.second[1]) * across;
            self.spins[1] = self.spins[1] + turn * self.inv_inertias[1];
        }
    }

    /// Gives the bodies their spins, and the speeds that the sum of the impulses makes.
    #[inline(always)]
    fn store(
        &self,
        bodies: &mut [BodyLanes],
        [first, other]: [usize; 2],
        normal: [Wide<R, N>; 2],
        sum: [Wide<R, N>; 2],
    ) {
        let [x, y] = joined(sum, normal);
        let a = &mut bodies[first];
        let inv_mass = Wide::load(&a.inv_mass);
        (Wide::load(&a.moving.vx) - x * inv_mass).store(&mut a.moving.vx);
        (Wide::load(&a.moving.vy) - y * inv_mass).store(&mut a.moving.vy);
        self.spins[0].store(&mut a.moving.omega);
        if self.moves {
            let b = &mut bodies[other];
            let inv_mass = Wide::load(&b.inv_mass);
            (Wide::load(&b.moving.vx) + x * inv_mass).store(&mut b.moving.vx);
            (Wide::load(&b.moving.vy) + y * inv_mass).store(&mut b.moving.vy);
            self.spins[1].store(&mut b.moving.omega);
        }
    }

    /// The same for bias speeds, whose impulses are along the normal.
    #[inline(always)]
    fn store_biases(
        &self,
        bodies: &mut [BodyLanes],
        frames: &mut [Frame],
        [first, other]: [usize; 2],
        normal: [Wide<R, N>; 2],
        sum: Wide<R, N>,
    ) {
        let [x, y] = joined([sum, Wide::all(0.0)], normal);
        let a = &mut bodies[first];
        let inv_mass = Wide::load(&a.inv_mass);
        (Wide::load(&a.bias_x) - x * inv_mass).store(&mut a.bias_x);
        (Wide::load(&a.bias_y) - y * inv_mass).store(&mut a.bias_y);
        self.spins[0].store(&mut frames[first].bias_omega);
        if self.moves {
            let b = &mut bodies[other];
            let inv_mass = Wide::load(&b.inv_mass);
            (Wide::load(&b.bias_x) + x * inv_mass).store(&mut b.bias_x);
            (Wide::load(&b.bias_y) + y * inv_mass).store(&mut b.bias_y);
            self.spins[1].store(&mut frames[other].bias_omega);
        }
    }
}

/// A vector along a normal, and across it.
#[inline(always)]
fn split<R: Register, const N: usize>([x, y]: [Wide<R, N>; 2], [nx, ny]: [Wide<R, N>; 2]) -> [Wide<R, N>; 2] {
    [x * nx + y * ny, y * nx - x * ny]
}

/// [`split`] backwards.
#[inline(always)]
fn joined<R: Register, const N: usize>(
    [n, t]: [Wide<R, N>; 2],
    [nx, ny]: [Wide<R, N>; 2],
) -> [Wide<R, N>; 2] {
    [nx * n - ny * t, ny * n + nx * t]
}
