//! Laws of contact (effects of the kind `EffectKind::Contact`) in a batch, one lane at a time: few scenes
//! have such laws, and others never execute this code.

use super::contact_pair::ContactPair;
use super::manifold::{Manifold, ManifoldPoint};
use super::simd::V;
use super::state::{BatchState, BodyLanes, DiscPair, LawLanes};
use crate::world::effect::{
    ContactResponse, ContactState, LANES, MotionStateLanes, dispatch, rolling_velocity_loss,
};

/// Sets the response of every active contact from the laws; called after contact detection and before effects
/// and gravity, like Chipmunk's rebound speed.
#[cold]
pub fn apply_contact_laws(state: &mut BatchState) {
    let count = state.bodies.len();
    for index in &state.active_pairs {
        let pair = &mut state.pairs[*index];
        for lane in (0..LANES).filter(|l| pair.normal_mass[*l] > 0.0) {
            let other = (pair.second < count).then(|| &state.bodies[pair.second]);
            let [normal, tangent] = relative(pair, lane, &state.bodies[pair.first], other);
            let begins = pair.jn[lane] == 0.0;
            let meeting = ContactState { approach: (-normal).max(0.0), slip: tangent, begins };
            let response = response(&state.contact_laws, lane, meeting, pair.restitution[lane]);
            pair.bounce[lane] = normal * response.restitution;
            pair.slip[lane] = response.slip;
            pair.unloaded[lane] = f64::from(u8::from(begins));
        }
    }
}

/// The same for the manifolds of bodies that are not discs, point by point.
#[cold]
pub fn apply_contact_laws_at_points(state: &mut BatchState) {
    let BatchState { active_manifolds, manifolds, near, bodies, contact_laws, .. } = state;
    for slot in active_manifolds.iter() {
        let manifold = &mut manifolds[*slot];
        let near = &near[manifold.near];
        for k in 0..manifold.count {
            let mass = manifold.points[k].normal_mass;
            for lane in (0..LANES).filter(|l| mass[*l] > 0.0) {
                let point = &manifold.points[k];
                let [normal, tangent] = relative_at(manifold, point, lane, &near.contact, bodies);
                let begins = point.jn[lane] == 0.0;
                let meeting = ContactState { approach: (-normal).max(0.0), slip: tangent, begins };
                let response = response(contact_laws, lane, meeting, near.restitution[lane]);
                manifold.points[k].bounce[lane] = normal * response.restitution;
                manifold.points[k].slip[lane] = response.slip;
            }
        }
    }
}

/// The combined response of the laws, in order.
fn response(
    contact_laws: &[LawLanes],
    lane: usize,
    meeting: ContactState,
    restitution: f64,
) -> ContactResponse {
    let own = ContactResponse { restitution, slip: 0.0 };
    contact_laws
        .iter()
        .fold(own, |response, law| dispatch::respond(law.effect, &law.constants_in(lane), meeting, response))
}

/// Normal and tangential velocity of the second surface relative to the first at a point, m/s.
fn relative_at(
    manifold: &Manifold,
    point: &ManifoldPoint,
    lane: usize,
    contact: &ContactPair,
    bodies: &[BodyLanes],
) -> [f64; 2] {
    let (nx, ny) = (manifold.nx[lane], manifold.ny[lane]);
    let at = |i: usize, arms: &[V; 2]| {
        let Some(MotionStateLanes { vx, vy, omega, .. }) = bodies.get(i).map(|b| &b.moving) else {
            return [0.0; 2];
        };
        let (along, across) = (vx[lane] * nx + vy[lane] * ny, vy[lane] * nx - vx[lane] * ny);
        [along + omega[lane] * arms[0][lane], across + omega[lane] * arms[1][lane]]
    };
    let ([ax, ay], [bx, by]) = (at(contact.first, &point.first), at(contact.other, &point.second));
    [bx - ax, by - ay]
}

/// Slows the discs that roll on statics; called after contacts are resolved.
#[cold]
pub fn apply_rolling_resistance(state: &mut BatchState) {
    let count = state.bodies.len();
    for index in &state.active_pairs {
        let pair = &state.pairs[*index];
        if pair.second < count {
            continue;
        }
        let body = &mut state.bodies[pair.first];
        for lane in (0..LANES).filter(|l| pair.jn[*l] > 0.0 && pair.unloaded[*l] == 0.0) {
            let load = pair.jn[lane] * body.inv_mass[lane];
            let off: f64 = state
                .contact_laws
                .iter()
                .map(|t| dispatch::rolling_loss(t.effect, &t.constants_in(lane), load))
                .sum();
            if off > 0.0 {
                let (nx, ny) = (pair.nx[lane], pair.ny[lane]);
                let moving = &mut body.moving;
                let along = moving.vy[lane] * nx - moving.vx[lane] * ny;
                let [lost, turn] = rolling_velocity_loss(along, moving.omega[lane], body.radius[lane], off);
                // Adding 0 turns -0 into 0: see `kernel::apply_forces`.
                moving.vx[lane] = moving.vx[lane] + lost * ny + 0.0;
                moving.vy[lane] = moving.vy[lane] - lost * nx + 0.0;
                moving.omega[lane] = moving.omega[lane] - turn + 0.0;
            }
        }
    }
}

/// Normal and tangential velocity of the second surface relative to the first, with the kernel's sign, m/s.
#[inline]
fn relative(pair: &DiscPair, lane: usize, first: &BodyLanes, second: Option<&BodyLanes>) -> [f64; 2] {
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
