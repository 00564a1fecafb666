//! Sequential impulses over the manifolds of bodies that are not discs: `disc_solver`'s scheme with two
//! points, in the frame of their normal.
//!
//! Source: as `kernel` (`cpArbiterApplyImpulse`): each point's normal impulse, then its friction, from the
//! velocities at the time of the visit.
//!
//! Differences from the source: those of `disc_solver`; both points of a manifold are solved in the frame of
//! its normal, and bodies receive the sum of their impulses.

use super::manifold::{Manifold, ManifoldPoint};
use super::outline::BodyFrame;
use super::simd::{Register, Wide};
use super::state::{BatchState, BodyLanes};

/// Convergence tolerance: a contact whose impulses would change by less than this fraction of the normal
/// impulse is left unchanged. A thousand times the rounding errors, so that a resting ball needs one visit
/// and not ten.
pub const IMPULSE_REL_TOLERANCE: f64 = 1e-12;

/// Applies the impulses of the last step.
#[inline(always)]
pub fn warm_start<R: Register, const N: usize>(state: &mut BatchState) {
    let BatchState { active_manifolds, manifolds, near, bodies, frames, .. } = state;
    for slot in active_manifolds.iter() {
        let manifold = &manifolds[*slot];
        let contact = &near[manifold.near].contact;
        let (between, normal) =
            ([contact.first, contact.other], [Wide::load(&manifold.nx), Wide::load(&manifold.ny)]);
        let mut speeds = RelativeVelocity::<R, N>::of(bodies, frames, between, normal);
        let mut sum = [Wide::all(0.0); 2];
        for point in &manifold.points[..manifold.count] {
            let impulse = [Wide::load(&point.jn), Wide::load(&point.jt)];
            speeds.push(point, impulse);
            sum = [sum[0] + impulse[0], sum[1] + impulse[1]];
        }
        speeds.store(bodies, between, normal, sum);
    }
}

/// Visits every contact that may change; whether any changed.
#[inline(always)]
pub fn sweep<const BIAS: bool, R: Register, const N: usize>(state: &mut BatchState) -> bool {
    let BatchState { active_manifolds, manifolds, near, bodies, frames, versions, .. } = state;
    let mut changed = false;
    for slot in active_manifolds.iter() {
        let manifold = &mut manifolds[*slot];
        let contact = &near[manifold.near].contact;
        let moves = contact.other < bodies.len();
        let other = if moves { contact.other } else { contact.first };
        let now = [versions[contact.first], versions[other]];
        if manifold.seen == now {
            continue;
        }
        if visit::<BIAS, R, N>(manifold, [contact.first, contact.other], bodies, frames) {
            changed = true;
            versions[contact.first] += 1;
            if moves {
                versions[other] += 1;
            }
        } else {
            manifold.seen = now;
        }
    }
    changed
}

/// Visits a contact; whether it changed.
#[inline(always)]
fn visit<const BIAS: bool, R: Register, const N: usize>(
    manifold: &mut Manifold,
    between: [usize; 2],
    bodies: &mut [BodyLanes],
    frames: &mut [BodyFrame],
) -> bool {
    let normal = [Wide::<R, N>::load(&manifold.nx), Wide::load(&manifold.ny)];
    let (friction, none) = (Wide::load(&manifold.friction), Wide::all(0.0));
    let mut speeds = RelativeVelocity::of(bodies, frames, between, normal);
    let mut biases = if BIAS { Some(speeds.biases(bodies, frames, between, normal)) } else { None };
    let (mut sum, mut bias_sum) = ([none; 2], none);
    let (mut moved, mut pushed_out) = (false, false);
    for point in &mut manifold.points[..manifold.count] {
        if let Some(biases) = &mut biases {
            let [speed, _] = biases.at(point);
            if let Some(d) = solve_bias_impulse(point, speed) {
                biases.push(point, [d, none]);
                bias_sum = bias_sum + d;
                pushed_out = true;
            }
        }
        let speed = speeds.at(point);
        if let Some(impulse) = solve_impulses(point, friction, speed) {
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

/// Changes of the normal and tangential impulse for relative velocities; `None` where the point has
/// converged.
#[inline(always)]
fn solve_impulses<R: Register, const N: usize>(
    point: &mut ManifoldPoint,
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
    let content = Wide::all(IMPULSE_REL_TOLERANCE) * jn;
    let moved = content.less(dn.abs()).or(content.less(dt.abs()));
    if !moved.any() {
        return None;
    }
    moved.select(jn, jn_old).store(&mut point.jn);
    moved.select(jt, jt_old).store(&mut point.jt);
    Some([moved.select(dn, none), moved.select(dt, none)])
}

/// The change of the bias impulse; `None` where the point has converged.
#[inline(always)]
fn solve_bias_impulse<R: Register, const N: usize>(
    point: &mut ManifoldPoint,
    speed: Wide<R, N>,
) -> Option<Wide<R, N>> {
    let (none, old) = (Wide::all(0.0), Wide::load(&point.jb));
    let new = (old + (Wide::load(&point.bias) - speed) * Wide::load(&point.normal_mass)).above(none);
    let moved = (Wide::all(IMPULSE_REL_TOLERANCE) * new).less((new - old).abs());
    if !moved.any() {
        return None;
    }
    moved.select(new, old).store(&mut point.jb);
    Some(moved.select(new - old, none))
}

/// Relative velocity of two bodies, or of a body and a static.
struct RelativeVelocity<R, const N: usize> {
    /// Of the second's centre of mass relative to the first's: normal and tangential, m/s.
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

impl<R: Register, const N: usize> RelativeVelocity<R, N> {
    #[inline(always)]
    fn of(
        bodies: &[BodyLanes],
        frames: &[BodyFrame],
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
            return RelativeVelocity { along, across, spins, inv_mass, inv_inertias, moves: false };
        }
        let b = &bodies[other];
        let v = [Wide::load(&b.moving.vx) - vx, Wide::load(&b.moving.vy) - vy];
        let [along, across] = split(v, normal);
        RelativeVelocity {
            along,
            across,
            spins: [spin, Wide::load(&b.moving.omega)],
            inv_mass: inv_mass + Wide::load(&b.inv_mass),
            inv_inertias: [inertia, Wide::load(&frames[other].inv_inertia)],
            moves: true,
        }
    }

    /// The bias velocities of the same bodies.
    #[inline(always)]
    fn biases(
        &self,
        bodies: &[BodyLanes],
        frames: &[BodyFrame],
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
        RelativeVelocity { along, across, spins, ..*self }
    }

    /// Velocities at a point: normal and tangential, m/s.
    #[inline(always)]
    fn at(&self, point: &ManifoldPoint) -> [Wide<R, N>; 2] {
        let [n, t] = [Wide::load(&point.first[0]), Wide::load(&point.first[1])];
        let (mut by_n, mut by_t) = (self.spins[0] * n, self.spins[0] * t);
        if self.moves {
            by_n = by_n - self.spins[1] * Wide::load(&point.second[0]);
            by_t = by_t - self.spins[1] * Wide::load(&point.second[1]);
        }
        [self.along - by_n, self.across - by_t]
    }

    /// Applies an impulse at a point (normal and tangential, N s) to the second body, and its reaction to
    /// the first.
    #[inline(always)]
    fn push(&mut self, point: &ManifoldPoint, [normal, across]: [Wide<R, N>; 2]) {
        self.along = self.along + normal * self.inv_mass;
        self.across = self.across + across * self.inv_mass;
        let turn = Wide::load(&point.first[0]) * normal + Wide::load(&point.first[1]) * across;
        self.spins[0] = self.spins[0] - turn * self.inv_inertias[0];
        if self.moves {
            let turn = Wide::load(&point.second[0]) * normal + Wide::load(&point.second[1]) * across;
            self.spins[1] = self.spins[1] + turn * self.inv_inertias[1];
        }
    }

    /// Writes the bodies' spins, and their velocities after the sum of the impulses.
    #[inline(always)]
    fn store(
        &self,
        bodies: &mut [BodyLanes],
        [first, other]: [usize; 2],
        normal: [Wide<R, N>; 2],
        sum: [Wide<R, N>; 2],
    ) {
        let [x, y] = join(sum, normal);
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

    /// The same for bias velocities, whose impulses are along the normal.
    #[inline(always)]
    fn store_biases(
        &self,
        bodies: &mut [BodyLanes],
        frames: &mut [BodyFrame],
        [first, other]: [usize; 2],
        normal: [Wide<R, N>; 2],
        sum: Wide<R, N>,
    ) {
        let [x, y] = join([sum, Wide::all(0.0)], normal);
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

/// Normal and tangential components of a vector.
#[inline(always)]
fn split<R: Register, const N: usize>([x, y]: [Wide<R, N>; 2], [nx, ny]: [Wide<R, N>; 2]) -> [Wide<R, N>; 2] {
    [x * nx + y * ny, y * nx - x * ny]
}

/// The inverse of [`split`].
#[inline(always)]
fn join<R: Register, const N: usize>([n, t]: [Wide<R, N>; 2], [nx, ny]: [Wide<R, N>; 2]) -> [Wide<R, N>; 2] {
    [nx * n - ny * t, ny * n + nx * t]
}
