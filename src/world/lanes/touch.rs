//! Laws of contact (effects of the form `Act::Contact`) in a batch, one lane at a time: scenes with such laws
//! are few beside those without, and a scene without never comes here.

use super::manifold::{Manifold, Point};
use super::simd::V;
use super::state::{BodyLanes, Pair, State, TermLanes};
use super::touching::Met;
use crate::world::effect::{Answer, LANES, Meeting, MovingLanes, Touch, rolled_off};

/// Asks the laws what every contact that pushes is to give back; called when contacts are found, and before
/// effects and gravity act, as Chipmunk's bounce speed is taken.
#[cold]
pub fn meet(state: &mut State) {
    let count = state.bodies.len();
    for index in &state.active {
        let pair = &mut state.pairs[*index];
        for lane in (0..LANES).filter(|l| pair.normal_mass[*l] > 0.0) {
            let other = (pair.second < count).then(|| &state.bodies[pair.second]);
            let [normal, tangent] = relative(pair, lane, &state.bodies[pair.first], other);
            let begins = pair.jn[lane] == 0.0;
            let meeting = Meeting { approach: (-normal).max(0.0), slip: tangent, begins };
            let answer = answer(&state.touches, lane, meeting, pair.restitution[lane]);
            pair.bounce[lane] = normal * answer.restitution;
            pair.slip[lane] = answer.slip;
            pair.unloaded[lane] = f64::from(u8::from(begins));
        }
    }
}

/// The same for the contacts of bodies that are no discs, point by point.
#[cold]
pub fn meet_at_points(state: &mut State) {
    let State { pressing, manifolds, near, bodies, touches, .. } = state;
    for slot in pressing.iter() {
        let manifold = &mut manifolds[*slot];
        let near = &near[manifold.near];
        for k in 0..manifold.count {
            let mass = manifold.points[k].normal_mass;
            for lane in (0..LANES).filter(|l| mass[*l] > 0.0) {
                let point = &manifold.points[k];
                let [normal, tangent] = relative_at(manifold, point, lane, &near.met, bodies);
                let begins = point.jn[lane] == 0.0;
                let meeting = Meeting { approach: (-normal).max(0.0), slip: tangent, begins };
                let answer = answer(touches, lane, meeting, near.restitution[lane]);
                manifold.points[k].bounce[lane] = normal * answer.restitution;
                manifold.points[k].slip[lane] = answer.slip;
            }
        }
    }
}

/// What the laws make of a meeting, in order.
fn answer(touches: &[TermLanes<dyn Touch>], lane: usize, meeting: Meeting, restitution: f64) -> Answer {
    let own = Answer { restitution, slip: 0.0 };
    touches.iter().fold(own, |answer, law| law.law.meet(&law.own(lane), meeting, answer))
}

/// Normal and tangential speed of the second surface against the first at a point, m/s.
fn relative_at(manifold: &Manifold, point: &Point, lane: usize, met: &Met, bodies: &[BodyLanes]) -> [f64; 2] {
    let (nx, ny) = (manifold.nx[lane], manifold.ny[lane]);
    let at = |i: usize, arms: &[V; 2]| {
        let Some(MovingLanes { vx, vy, omega, .. }) = bodies.get(i).map(|b| &b.moving) else {
            return [0.0; 2];
        };
        let (along, across) = (vx[lane] * nx + vy[lane] * ny, vy[lane] * nx - vx[lane] * ny);
        [along + omega[lane] * arms[0][lane], across + omega[lane] * arms[1][lane]]
    };
    let ([ax, ay], [bx, by]) = (at(met.first, &point.first), at(met.other, &point.second));
    [bx - ax, by - ay]
}

/// Slows the discs that roll on statics; called when contacts are resolved.
#[cold]
pub fn roll(state: &mut State) {
    let count = state.bodies.len();
    for index in &state.active {
        let pair = &state.pairs[*index];
        if pair.second < count {
            continue;
        }
        let body = &mut state.bodies[pair.first];
        for lane in (0..LANES).filter(|l| pair.jn[*l] > 0.0 && pair.unloaded[*l] == 0.0) {
            let load = pair.jn[lane] * body.inv_mass[lane];
            let off: f64 = state.touches.iter().map(|t| t.law.roll(&t.own(lane), load)).sum();
            if off > 0.0 {
                let (nx, ny) = (pair.nx[lane], pair.ny[lane]);
                let moving = &mut body.moving;
                let along = moving.vy[lane] * nx - moving.vx[lane] * ny;
                let [lost, turn] = rolled_off(along, moving.omega[lane], body.radius[lane], off);
                // Of what is lost, nothing stays but +0: see `kernel::push`.
                moving.vx[lane] = moving.vx[lane] + lost * ny + 0.0;
                moving.vy[lane] = moving.vy[lane] - lost * nx + 0.0;
                moving.omega[lane] = moving.omega[lane] - turn + 0.0;
            }
        }
    }
}

/// Normal and tangential speed of the second surface against the first, as the kernel has them, m/s.
#[inline]
fn relative(pair: &Pair, lane: usize, first: &BodyLanes, second: Option<&BodyLanes>) -> [f64; 2] {
    let (nx, ny) = (pair.nx[lane], pair.ny[lane]);
    let of = |b: &BodyLanes| (b.moving.vx[lane], b.moving.vy[lane], b.radius[lane] * b.moving.omega[lane]);
    let (ax, ay, a_rim) = of(first);
    let (vx, vy, rim) = match second {
        Some(b) => {
            let (bx, by, b_rim) = of(b);
            (bx - ax, by - ay, b_rim + a_rim)
        }
        None => (ax, ay, a_rim),
    };
    [vx * nx + vy * ny, vy * nx - vx * ny - rim]
}
