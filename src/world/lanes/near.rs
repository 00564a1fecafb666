//! Pairs of outlines, and contacts of two points of those that touch.
//!
//! Source and order of things as `kernel`; contact points as `closest`. A pair is looked at only when its bodies may have moved
//! and turned as far as they were apart. What a contact needs is kept only for pairs that push: a scene has hundreds of
//! pairs and few contacts.
//!
//! Differences from the source: impulses are kept by the corners that a point is made of, as Chipmunk does by a hash of them.

use super::closest::{Place, closest, places};
use super::contact::may_touch;
use super::manifold::{Manifold, Point};
use super::outline::{Frame, place};
use super::simd::{Mask, Register, Wide};
use super::state::{BodyLanes, State};
use super::touching::{HAIR, begin};
use crate::world::record::CARRIES;

/// Looks at every pair that may touch, writes touches down, and collects those that push.
#[inline(always)]
pub fn find<R: Register, const N: usize>(state: &mut State) {
    state.pressing.clear();
    let count = state.bodies.len();
    let touch: Wide<R, N> = Wide::load(&state.touch);
    // Where there is no rollout all outlines lie on each other.
    let used = Wide::all(0.0).less(Wide::load(&state.dt));
    for index in 0..state.near.len() {
        let (first, other) = (state.near[index].met.first, state.near[index].met.other);
        let mut travel = Wide::load(&state.bodies[first].travel);
        if other < count {
            travel = travel + Wide::load(&state.bodies[other].travel);
        }
        if !may_touch(&state.near[index].limit, travel) {
            continue;
        }
        for body in [first, other].into_iter().filter(|b| *b < count) {
            let BodyLanes { moving, angle, .. } = &state.bodies[body];
            place::<R, N>(&mut state.frames[body], &mut state.outlines, moving, angle, state.tick);
        }
        let [a, b] = state.near[index].outlines.map(|o| &state.outlines[o]);
        let normal = closest(a, b, touch);
        let near = &mut state.near[index];
        let free = normal.separation - touch - Wide::all(HAIR);
        let limit = travel + free.above(Wide::all(0.0));
        used.select(limit, Wide::all(f64::INFINITY)).store(&mut near.limit);
        let touching = used.and(normal.separation.at_most(touch));
        if !touching.any() {
            let_go(state, index);
            continue;
        }
        if other >= count {
            let carries = touching.and(Wide::all(CARRIES).less(normal.ny.minus()));
            let body = &mut state.bodies[first];
            carries.select(Wide::all(1.0), Wide::load(&body.carried)).store(&mut body.carried);
            body.any_carried = true;
        }
        let (found, places_there) = places(a, b, normal);
        meet(state, index, touching, &found[..places_there], [normal.nx, normal.ny]);
    }
}

/// Gives a pair's contact back.
fn let_go(state: &mut State, index: usize) {
    if let Some(slot) = state.near[index].slot.take() {
        state.spare.push(slot);
    }
}

/// Takes in what a touching pair's points are.
#[inline(always)]
fn meet<R: Register, const N: usize>(
    state: &mut State,
    index: usize,
    touching: Mask<R, N>,
    found: &[Place<R, N>],
    normal: [Wide<R, N>; 2],
) {
    let none = Wide::all(0.0);
    let (first, other) = (state.near[index].met.first, state.near[index].met.other);
    let (last, between) = (&found[found.len() - 1], [first, other]);
    let arms: [Arms<R, N>; 2] =
        [Arms::of(&state.bodies, between, &found[0], normal), Arms::of(&state.bodies, between, last, normal)];
    let speeds =
        [arms[0].speed(&state.bodies, between, normal), arms[1].speed(&state.bodies, between, normal)];
    // How fast they come together where they do first.
    let speed = last.gap.less(found[0].gap).select(speeds[1], speeds[0]);
    if begin(&mut state.near[index].met, touching, speed, state.tick) {
        state.fresh.push(state.pairs.len() + index);
    }
    if !touching.and(found[0].gap.less(none).or(last.gap.less(none))).any() {
        let_go(state, index);
        return;
    }
    let slot = slot_of(state, index);
    state.pressing.push(slot);
    let State { near, manifolds, bodies, frames, slop, bias_rate, any_bias, .. } = state;
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
    for (k, place) in found.iter().enumerate() {
        let (hit, point) = (touching.and(place.gap.less(none)), &mut manifold.points[k]);
        let depth = none - (place.gap + Wide::load(slop));
        arms[k].store(point);
        let [by_normal, by_tangent] = arms[k].masses(bodies, frames, [first, other]);
        hit.select(by_normal, none).store(&mut point.normal_mass);
        hit.select(by_tangent, none).store(&mut point.tangent_mass);
        (speeds[k] * Wide::load(&near.restitution)).store(&mut point.bounce);
        (depth.above(none) * Wide::load(bias_rate)).store(&mut point.bias);
        *any_bias |= none.less(depth).any();
        let (mut jn, mut jt) = (none, none);
        for [id, old_jn, old_jt] in old {
            let same = hit.and(equal(place.id, id));
            (jn, jt) = (same.select(old_jn, jn), same.select(old_jt, jt));
        }
        jn.store(&mut point.jn);
        jt.store(&mut point.jt);
        none.store(&mut point.jb);
        hit.select(place.id, none).store(&mut point.id);
    }
}

/// Arms of an impulse at a point about both centres of mass, m: of one along the normal, and of one across it; of what never
/// moves, none.
struct Arms<R, const N: usize> {
    first: [Wide<R, N>; 2],
    second: [Wide<R, N>; 2],
}

impl<R: Register, const N: usize> Arms<R, N> {
    #[inline(always)]
    fn of(
        bodies: &[BodyLanes],
        [first, other]: [usize; 2],
        place: &Place<R, N>,
        normal: [Wide<R, N>; 2],
    ) -> Self {
        let first = arms_of(&bodies[first], place.first, normal);
        let second = match bodies.get(other) {
            Some(body) => arms_of(body, place.second, normal),
            None => [Wide::all(0.0); 2],
        };
        Arms { first, second }
    }

    #[inline(always)]
    fn store(&self, point: &mut Point) {
        for k in 0..2 {
            self.first[k].store(&mut point.first[k]);
            self.second[k].store(&mut point.second[k]);
        }
    }

    /// Speed of the second against the first along the normal, m/s.
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

    /// Effective masses along the normal and across it, kg.
    #[inline(always)]
    fn masses(&self, bodies: &[BodyLanes], frames: &[Frame], [first, other]: [usize; 2]) -> [Wide<R, N>; 2] {
        let [mut normal, mut tangent] = looseness(&bodies[first], &frames[first], self.first);
        if other < bodies.len() {
            let [n, t] = looseness(&bodies[other], &frames[other], self.second);
            (normal, tangent) = (normal + n, tangent + t);
        }
        [inverse(normal), inverse(tangent)]
    }
}

/// Arms about a body's centre of mass of impulses at a place, m.
#[inline(always)]
fn arms_of<R: Register, const N: usize>(
    body: &BodyLanes,
    [x, y]: [Wide<R, N>; 2],
    [nx, ny]: [Wide<R, N>; 2],
) -> [Wide<R, N>; 2] {
    let (x, y) = (x - Wide::load(&body.moving.x), y - Wide::load(&body.moving.y));
    [x * ny - y * nx, x * nx + y * ny]
}

/// A body's speed along a direction about which it has an arm, m/s.
#[inline(always)]
fn speed_along<R: Register, const N: usize>(
    body: &BodyLanes,
    arm: Wide<R, N>,
    [nx, ny]: [Wide<R, N>; 2],
) -> Wide<R, N> {
    let v = Wide::load(&body.moving.vx) * nx + Wide::load(&body.moving.vy) * ny;
    v + Wide::load(&body.moving.omega) * arm
}

/// Speed that a body gains at the end of its arms from an impulse of 1 N s there: along the normal, and across it, 1/kg.
#[inline(always)]
fn looseness<R: Register, const N: usize>(
    body: &BodyLanes,
    frame: &Frame,
    [n, t]: [Wide<R, N>; 2],
) -> [Wide<R, N>; 2] {
    let (mass, inertia) = (Wide::load(&body.inv_mass), Wide::load(&frame.inv_inertia));
    [mass + inertia * n * n, mass + inertia * t * t]
}

/// 1/x, and 0 in lanes without a rollout, which have no mass.
#[inline(always)]
fn inverse<R: Register, const N: usize>(x: Wide<R, N>) -> Wide<R, N> {
    let (none, one) = (Wide::all(0.0), Wide::all(1.0));
    let some = none.less(x);
    some.select(one.div(some.select(x, one)), none)
}

/// The pair's contact, made if it has none.
fn slot_of(state: &mut State, index: usize) -> usize {
    if let Some(slot) = state.near[index].slot {
        return slot;
    }
    let slot = state.spare.pop().unwrap_or_else(|| {
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
