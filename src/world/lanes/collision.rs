//! Collision detection of outlines: pairs that may touch, and their contact manifolds.
//!
//! Source and order of operations as in `kernel`; contact points as in `outline_separation`. A pair is tested
//! only when its bodies may have travelled and rotated as far as their last distance. Manifolds are stored
//! only for active pairs: a scene has hundreds of pairs and few contacts.
//!
//! Differences from the source: impulses are matched by the corners that form a point, as Chipmunk does by
//! their hash.

use super::contact_pair::{TRAVEL_TOLERANCE_M, begin};
use super::disc_separation::may_touch;
use super::manifold::{Manifold, ManifoldPoint};
use super::outline::{BodyFrame, update_outlines};
use super::outline_separation::{ContactPoint, closest, places};
use super::simd::{Mask, Register, Wide};
use super::state::{BatchState, BodyLanes};
use crate::world::contact_criteria::MIN_SUPPORT_NORMAL_Y;

/// Tests every pair that may touch, records contacts, and collects the active manifolds.
#[inline(always)]
pub fn find_contacts<R: Register, const N: usize>(state: &mut BatchState) {
    state.active_manifolds.clear();
    let count = state.bodies.len();
    let touch: Wide<R, N> = Wide::load(&state.contact_margin);
    // In lanes without a rollout all outlines coincide.
    let used = Wide::all(0.0).less(Wide::load(&state.dt));
    for index in 0..state.near.len() {
        let (first, other) = (state.near[index].contact.first, state.near[index].contact.other);
        let mut travel = Wide::load(&state.bodies[first].travel);
        if other < count {
            travel = travel + Wide::load(&state.bodies[other].travel);
        }
        if !may_touch(&state.near[index].limit, travel) {
            continue;
        }
        for body in [first, other].into_iter().filter(|b| *b < count) {
            let BodyLanes { moving, angle, .. } = &state.bodies[body];
            update_outlines::<R, N>(&mut state.frames[body], &mut state.outlines, moving, angle, state.tick);
        }
        let [a, b] = state.near[index].outlines.map(|o| &state.outlines[o]);
        let normal = closest(a, b, touch);
        let near = &mut state.near[index];
        let free = normal.separation - touch - Wide::all(TRAVEL_TOLERANCE_M);
        let limit = travel + free.above(Wide::all(0.0));
        used.select(limit, Wide::all(f64::INFINITY)).store(&mut near.limit);
        let touching = used.and(normal.separation.at_most(touch));
        if !touching.any() {
            release_manifold(state, index);
            continue;
        }
        if other >= count {
            let carries = touching.and(Wide::all(MIN_SUPPORT_NORMAL_Y).less(normal.ny.minus()));
            let body = &mut state.bodies[first];
            carries.select(Wide::all(1.0), Wide::load(&body.supported)).store(&mut body.supported);
            body.any_supported = true;
        }
        let (found, count_found) = places(a, b, normal);
        update_manifold(state, index, touching, &found[..count_found], [normal.nx, normal.ny]);
    }
}

/// Releases a pair's manifold.
fn release_manifold(state: &mut BatchState, index: usize) {
    if let Some(slot) = state.near[index].slot.take() {
        state.free_manifolds.push(slot);
    }
}

/// Updates a touching pair's manifold.
#[inline(always)]
fn update_manifold<R: Register, const N: usize>(
    state: &mut BatchState,
    index: usize,
    touching: Mask<R, N>,
    found: &[ContactPoint<R, N>],
    normal: [Wide<R, N>; 2],
) {
    let none = Wide::all(0.0);
    let (first, other) = (state.near[index].contact.first, state.near[index].contact.other);
    let (last, between) = (&found[found.len() - 1], [first, other]);
    let arms: [LeverArms<R, N>; 2] = [
        LeverArms::of(&state.bodies, between, &found[0], normal),
        LeverArms::of(&state.bodies, between, last, normal),
    ];
    let speeds =
        [arms[0].speed(&state.bodies, between, normal), arms[1].speed(&state.bodies, between, normal)];
    // Approach velocity at the point with the smaller gap.
    let speed = last.gap.less(found[0].gap).select(speeds[1], speeds[0]);
    if begin(&mut state.near[index].contact, touching, speed, state.tick) {
        state.new_contacts.push(state.pairs.len() + index);
    }
    if !touching.and(found[0].gap.less(none).or(last.gap.less(none))).any() {
        release_manifold(state, index);
        return;
    }
    let slot = manifold_slot(state, index);
    state.active_manifolds.push(slot);
    let BatchState { near, manifolds, bodies, frames, slop, bias_rate, any_bias, .. } = state;
    let (near, manifold) = (&near[index], &mut manifolds[slot]);
    let [one, two] = &manifold.points;
    let old: [[Wide<R, N>; 3]; 2] = [
        [Wide::load(&one.id), Wide::load(&one.jn), Wide::load(&one.jt)],
        [Wide::load(&two.id), Wide::load(&two.jn), Wide::load(&two.jt)],
    ];
    normal[0].store(&mut manifold.nx);
    normal[1].store(&mut manifold.ny);
    manifold.friction = near.friction;
    manifold.count = found.len();
    manifold.seen = [u32::MAX; 2];
    for (k, update_outlines) in found.iter().enumerate() {
        let (hit, point) = (touching.and(update_outlines.gap.less(none)), &mut manifold.points[k]);
        let depth = none - (update_outlines.gap + Wide::load(slop));
        arms[k].store(point);
        let [by_normal, by_tangent] = arms[k].masses(bodies, frames, [first, other]);
        hit.select(by_normal, none).store(&mut point.normal_mass);
        hit.select(by_tangent, none).store(&mut point.tangent_mass);
        (speeds[k] * Wide::load(&near.restitution)).store(&mut point.bounce);
        (depth.above(none) * Wide::load(bias_rate)).store(&mut point.bias);
        *any_bias |= none.less(depth).any();
        let (mut jn, mut jt) = (none, none);
        for [id, old_jn, old_jt] in old {
            let same = hit.and(equal(update_outlines.id, id));
            (jn, jt) = (same.select(old_jn, jn), same.select(old_jt, jt));
        }
        jn.store(&mut point.jn);
        jt.store(&mut point.jt);
        none.store(&mut point.jb);
        hit.select(update_outlines.id, none).store(&mut point.id);
    }
}

/// Lever arms about both centres of mass of a normal and of a tangential impulse at a point, m; 0 for
/// statics.
struct LeverArms<R, const N: usize> {
    first: [Wide<R, N>; 2],
    second: [Wide<R, N>; 2],
}

impl<R: Register, const N: usize> LeverArms<R, N> {
    #[inline(always)]
    fn of(
        bodies: &[BodyLanes],
        [first, other]: [usize; 2],
        update_outlines: &ContactPoint<R, N>,
        normal: [Wide<R, N>; 2],
    ) -> Self {
        let first = arms_of(&bodies[first], update_outlines.first, normal);
        let second = match bodies.get(other) {
            Some(body) => arms_of(body, update_outlines.second, normal),
            None => [Wide::all(0.0); 2],
        };
        LeverArms { first, second }
    }

    #[inline(always)]
    fn store(&self, point: &mut ManifoldPoint) {
        for k in 0..2 {
            self.first[k].store(&mut point.first[k]);
            self.second[k].store(&mut point.second[k]);
        }
    }

    /// Normal velocity of the second body relative to the first, m/s.
    #[inline(always)]
    fn speed(
        &self,
        bodies: &[BodyLanes],
        [first, other]: [usize; 2],
        [nx, ny]: [Wide<R, N>; 2],
    ) -> Wide<R, N> {
        let second = match bodies.get(other) {
            Some(body) => speed_along(body, self.second[0], [nx, ny]),
            None => Wide::all(0.0),
        };
        second - speed_along(&bodies[first], self.first[0], [nx, ny])
    }

    /// Effective masses of the normal and the tangential impulse, kg.
    #[inline(always)]
    fn masses(
        &self,
        bodies: &[BodyLanes],
        frames: &[BodyFrame],
        [first, other]: [usize; 2],
    ) -> [Wide<R, N>; 2] {
        let [mut normal, mut tangent] = inverse_masses(&bodies[first], &frames[first], self.first);
        if other < bodies.len() {
            let [n, t] = inverse_masses(&bodies[other], &frames[other], self.second);
            (normal, tangent) = (normal + n, tangent + t);
        }
        [inverse(normal), inverse(tangent)]
    }
}

/// Lever arms about a body's centre of mass of impulses at a point, m.
#[inline(always)]
fn arms_of<R: Register, const N: usize>(
    body: &BodyLanes,
    [x, y]: [Wide<R, N>; 2],
    [nx, ny]: [Wide<R, N>; 2],
) -> [Wide<R, N>; 2] {
    let (x, y) = (x - Wide::load(&body.moving.x), y - Wide::load(&body.moving.y));
    [x * ny - y * nx, x * nx + y * ny]
}

/// A body's velocity along a direction, at the end of a lever arm, m/s.
#[inline(always)]
fn speed_along<R: Register, const N: usize>(
    body: &BodyLanes,
    arm: Wide<R, N>,
    [nx, ny]: [Wide<R, N>; 2],
) -> Wide<R, N> {
    let v = Wide::load(&body.moving.vx) * nx + Wide::load(&body.moving.vy) * ny;
    v + Wide::load(&body.moving.omega) * arm
}

/// Inverse effective masses of a body for a normal and a tangential impulse at its lever arms, 1/kg.
#[inline(always)]
fn inverse_masses<R: Register, const N: usize>(
    body: &BodyLanes,
    frame: &BodyFrame,
    [n, t]: [Wide<R, N>; 2],
) -> [Wide<R, N>; 2] {
    let (mass, inertia) = (Wide::load(&body.inv_mass), Wide::load(&frame.inv_inertia));
    [mass + inertia * n * n, mass + inertia * t * t]
}

/// 1/x, and 0 in lanes without a rollout, whose bodies have no mass.
#[inline(always)]
fn inverse<R: Register, const N: usize>(x: Wide<R, N>) -> Wide<R, N> {
    let (none, one) = (Wide::all(0.0), Wide::all(1.0));
    let some = none.less(x);
    some.select(one.div(some.select(x, one)), none)
}

/// Index of the pair's manifold, created if it has none.
fn manifold_slot(state: &mut BatchState, index: usize) -> usize {
    if let Some(slot) = state.near[index].slot {
        return slot;
    }
    let slot = state.free_manifolds.pop().unwrap_or_else(|| {
        state.manifolds.push(Manifold::empty());
        state.manifolds.len() - 1
    });
    state.manifolds[slot] = Manifold { near: index, ..Manifold::empty() };
    state.near[index].slot = Some(slot);
    slot
}

#[inline(always)]
fn equal<R: Register, const N: usize>(a: Wide<R, N>, b: Wide<R, N>) -> Mask<R, N> {
    a.at_most(b).and(b.at_most(a))
}
