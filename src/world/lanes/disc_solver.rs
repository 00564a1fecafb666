//! Sequential impulses with warm starting over the contacts of a step: Chipmunk2D's `cpArbiterApplyImpulse`.
//!
//! Source: as `kernel`. For a disc the lever arm is parallel to the normal, so normal impulses do not rotate
//! it, effective masses are constants of the pair, and only the tangential impulse changes spin.
//!
//! Differences from the source:
//! - A contact whose impulses would change by less than [`IMPULSE_REL_TOLERANCE`] of themselves is left
//!   unchanged.
//! - An iteration skips contacts that it cannot change: those whose last visit changed nothing and whose
//!   bodies have not changed since. The result is the same to the last bit.

use super::manifold_solver::{self, IMPULSE_REL_TOLERANCE};
use super::simd::{Register, Wide};
use super::state::{BatchState, BodyLanes, DiscPair};

/// Solver iterations per step: Chipmunk's default.
const SOLVER_ITERATIONS: u32 = 10;
/// Applies last step's impulses and iterates over the active contacts; `laws`: laws of contact are active.
#[inline(always)]
pub fn solve<R: Register, const N: usize>(state: &mut BatchState, laws: bool) {
    warm_start::<R, N>(state);
    manifold_solver::warm_start::<R, N>(state);
    match (state.any_bias, laws) {
        (false, false) => sweep::<false, false, R, N>(state),
        (true, false) => sweep::<true, false, R, N>(state),
        (false, true) => sweep::<false, true, R, N>(state),
        (true, true) => sweep::<true, true, R, N>(state),
    }
}

/// Applies the impulses of the last step.
#[inline(always)]
fn warm_start<R: Register, const N: usize>(state: &mut BatchState) {
    let count = state.bodies.len();
    for index in &state.active_pairs {
        let pair = &state.pairs[*index];
        let impulse = ContactImpulse::<R, N>::of(pair, Wide::load(&pair.jn), Wide::load(&pair.jt));
        if pair.second < count {
            let (a, b) = pair_mut(&mut state.bodies, pair.first, pair.second);
            impulse.pull(a);
            impulse.push(b);
        } else {
            impulse.push(&mut state.bodies[pair.first]);
        }
    }
}

/// Sequential impulses; without `BIAS` no pair is deeper than the slop and the bias part is skipped, without
/// `TANGENT_TARGET` the tangential target velocity is 0.
#[inline(always)]
fn sweep<const BIAS: bool, const TANGENT_TARGET: bool, R: Register, const N: usize>(state: &mut BatchState) {
    let count = state.bodies.len();
    state.versions.fill(0);
    for _ in 0..SOLVER_ITERATIONS {
        let mut changed = false;
        for index in &state.active_pairs {
            let pair = &mut state.pairs[*index];
            let other = if pair.second < count { pair.second } else { pair.first };
            let versions = [state.versions[pair.first], state.versions[other]];
            if pair.seen == versions {
                continue;
            }
            let moved = if pair.second < count {
                let (a, b) = pair_mut(&mut state.bodies, pair.first, pair.second);
                visit_pair::<BIAS, TANGENT_TARGET, R, N>(pair, a, b)
            } else {
                visit_static::<BIAS, TANGENT_TARGET, R, N>(pair, &mut state.bodies[pair.first])
            };
            if moved {
                changed = true;
                state.versions[pair.first] += 1;
                if other != pair.first {
                    state.versions[other] += 1;
                }
            } else {
                pair.seen = versions;
            }
        }
        if !state.active_manifolds.is_empty() {
            changed |= manifold_solver::sweep::<BIAS, R, N>(state);
        }
        if !changed {
            break;
        }
    }
}

/// Visits a contact of two discs; whether it changed.
#[inline(always)]
fn visit_pair<const BIAS: bool, const TANGENT_TARGET: bool, R: Register, const N: usize>(
    pair: &mut DiscPair,
    a: &mut BodyLanes,
    b: &mut BodyLanes,
) -> bool {
    let (nx, ny) = (Wide::<R, N>::load(&pair.nx), Wide::load(&pair.ny));
    let vx = Wide::load(&b.moving.vx) - Wide::load(&a.moving.vx);
    let vy = Wide::load(&b.moving.vy) - Wide::load(&a.moving.vy);
    let rim = Wide::load(&b.radius) * Wide::load(&b.moving.omega)
        + Wide::load(&a.radius) * Wide::load(&a.moving.omega);
    let (impulse, mut moved) =
        solve_impulses::<TANGENT_TARGET, R, N>(pair, vx * nx + vy * ny, vy * nx - vx * ny - rim);
    if let Some(impulse) = impulse {
        impulse.pull(a);
        impulse.push(b);
    }
    if BIAS {
        let bx = Wide::load(&b.bias_x) - Wide::load(&a.bias_x);
        let by = Wide::load(&b.bias_y) - Wide::load(&a.bias_y);
        if let Some(d) = solve_bias_impulse(pair, bx * nx + by * ny) {
            let (da, db) = (d * Wide::load(&a.inv_mass), d * Wide::load(&b.inv_mass));
            (Wide::load(&a.bias_x) - nx * da).store(&mut a.bias_x);
            (Wide::load(&a.bias_y) - ny * da).store(&mut a.bias_y);
            (Wide::load(&b.bias_x) + nx * db).store(&mut b.bias_x);
            (Wide::load(&b.bias_y) + ny * db).store(&mut b.bias_y);
            moved = true;
        }
    }
    moved
}

/// Visits a contact of a disc with a static; whether it changed.
#[inline(always)]
fn visit_static<const BIAS: bool, const TANGENT_TARGET: bool, R: Register, const N: usize>(
    pair: &mut DiscPair,
    b: &mut BodyLanes,
) -> bool {
    let (nx, ny) = (Wide::<R, N>::load(&pair.nx), Wide::load(&pair.ny));
    let (vx, vy) = (Wide::load(&b.moving.vx), Wide::load(&b.moving.vy));
    let rim = Wide::load(&b.radius) * Wide::load(&b.moving.omega);
    let (impulse, mut moved) =
        solve_impulses::<TANGENT_TARGET, R, N>(pair, vx * nx + vy * ny, vy * nx - vx * ny - rim);
    if let Some(impulse) = impulse {
        impulse.push(b);
    }
    if BIAS {
        let (bx, by) = (Wide::load(&b.bias_x), Wide::load(&b.bias_y));
        if let Some(d) = solve_bias_impulse(pair, bx * nx + by * ny) {
            let db = d * Wide::load(&b.inv_mass);
            (bx + nx * db).store(&mut b.bias_x);
            (by + ny * db).store(&mut b.bias_y);
            moved = true;
        }
    }
    moved
}

/// Changes of the normal and tangential impulse for relative velocities (of the second relative to the
/// first); `None` where the contact has converged.
#[inline(always)]
fn solve_impulses<const TANGENT_TARGET: bool, R: Register, const N: usize>(
    pair: &mut DiscPair,
    normal: Wide<R, N>,
    tangent: Wide<R, N>,
) -> (Option<ContactImpulse<R, N>>, bool) {
    let none = Wide::all(0.0);
    let (jn_old, jt_old) = (Wide::load(&pair.jn), Wide::load(&pair.jt));
    let jn = (jn_old - (Wide::load(&pair.bounce) + normal) * Wide::load(&pair.normal_mass)).above(none);
    let most = Wide::load(&pair.friction) * jn;
    let tangent = if TANGENT_TARGET { tangent - Wide::load(&pair.slip) } else { tangent };
    let jt = (jt_old - tangent * Wide::load(&pair.tangent_mass)).above(none - most).below(most);
    let (dn, dt) = (jn - jn_old, jt - jt_old);
    let content = Wide::all(IMPULSE_REL_TOLERANCE) * jn;
    let moved = content.less(dn.abs()).or(content.less(dt.abs()));
    if !moved.any() {
        return (None, false);
    }
    let (jn, jt) = (moved.select(jn, jn_old), moved.select(jt, jt_old));
    let (dn, dt) = (moved.select(dn, none), moved.select(dt, none));
    jn.store(&mut pair.jn);
    jt.store(&mut pair.jt);
    (Some(ContactImpulse::of(pair, dn, dt)), true)
}

/// The change of the bias impulse; `None` where the contact has converged.
#[inline(always)]
fn solve_bias_impulse<R: Register, const N: usize>(
    pair: &mut DiscPair,
    speed: Wide<R, N>,
) -> Option<Wide<R, N>> {
    let old = Wide::load(&pair.jb);
    let new = (old + (Wide::load(&pair.bias) - speed) * Wide::load(&pair.normal_mass)).above(Wide::all(0.0));
    let moved = (Wide::all(IMPULSE_REL_TOLERANCE) * new).less((new - old).abs());
    if !moved.any() {
        return None;
    }
    moved.select(new, old).store(&mut pair.jb);
    Some(moved.select(new - old, Wide::all(0.0)))
}

/// An impulse at a contact, N s.
struct ContactImpulse<R, const N: usize> {
    x: Wide<R, N>,
    y: Wide<R, N>,
    tangential: Wide<R, N>,
}

impl<R: Register, const N: usize> ContactImpulse<R, N> {
    #[inline(always)]
    fn of(pair: &DiscPair, normal: Wide<R, N>, tangential: Wide<R, N>) -> Self {
        let (nx, ny) = (Wide::load(&pair.nx), Wide::load(&pair.ny));
        ContactImpulse { x: nx * normal - ny * tangential, y: ny * normal + nx * tangential, tangential }
    }

    /// Applies it to the body that the normal points to.
    #[inline(always)]
    fn push(&self, b: &mut BodyLanes) {
        let inv_mass = Wide::load(&b.inv_mass);
        (Wide::load(&b.moving.vx) + self.x * inv_mass).store(&mut b.moving.vx);
        (Wide::load(&b.moving.vy) + self.y * inv_mass).store(&mut b.moving.vy);
        self.spin(b);
    }

    /// Applies the reaction to the body that the normal points away from.
    #[inline(always)]
    fn pull(&self, a: &mut BodyLanes) {
        let inv_mass = Wide::load(&a.inv_mass);
        (Wide::load(&a.moving.vx) - self.x * inv_mass).store(&mut a.moving.vx);
        (Wide::load(&a.moving.vy) - self.y * inv_mass).store(&mut a.moving.vy);
        self.spin(a);
    }

    /// Both discs rotate in the same direction: force and lever arm are both reversed.
    #[inline(always)]
    fn spin(&self, body: &mut BodyLanes) {
        let turned = Wide::load(&body.moving.omega) - self.tangential * Wide::load(&body.spin_per_impulse);
        turned.store(&mut body.moving.omega);
    }
}

#[inline(always)]
fn pair_mut(bodies: &mut [BodyLanes], first: usize, second: usize) -> (&mut BodyLanes, &mut BodyLanes) {
    let (head, tail) = bodies.split_at_mut(second);
    (&mut head[first], &mut tail[0])
}
