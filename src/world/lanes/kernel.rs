//! One time step of a batch: the arithmetic of Chipmunk2D's `cpSpaceStep`.
//!
//! Source: Chipmunk2D 7 (`cpSpaceStep.c`, `cpArbiter.c`, `cpCollision.c`), which follows Catto, "Iterative
//! dynamics with temporal coherence" (GDC 2005): sequential impulses with warm starting; penetration beyond a
//! slop is corrected by separate bias velocities that do not add kinetic energy. In order: positions advance
//! with the velocities and bias velocities of the last step; contacts are detected, and their target rebound
//! speeds set from the current velocities; effects and gravity act; last step's impulses are applied; ten
//! iterations over the contacts (`disc_solver`).
//!
//! Differences from the source:
//! - Speeds below [`MIN_SPEED_M_S`] are set to zero at the start of a step.
//! - A pair is tested only when its bodies may have travelled as far as their last distance.
//! - Contacts are visited in a fixed order (pairs of bodies, then each body's statics); Chipmunk's depends on
//!   its search tree.
//! - A contact lost for a step or two and found again starts without its old impulse.

use super::collision;
use super::contact_laws;
use super::contact_pair::{TRAVEL_TOLERANCE_M, begin};
use super::continuous_collision::{MIN_CCD_TRAVEL_PER_RADIUS, stop_fast_bodies};
use super::disc_separation::{DiscSeparation, between_discs, may_touch, with_static};
use super::disc_solver::solve;
use super::simd::{Mask, Register, Wide};
use super::state::{BatchState, DiscPair};
use crate::world::contact_criteria::MIN_SUPPORT_NORMAL_Y;
use crate::world::effect::{LANES, dispatch};

/// Speed, m/s or rad/s, below which it is set to zero: slightly above the rounding errors of contacts, so
/// that objects at rest reach a state that the next step repeats. The total displacement lost is below atomic
/// size.
const MIN_SPEED_M_S: f64 = 1e-12;
/// Sum of absolute coordinates and speeds above which a state is tested for divergence.
const DIVERGENCE_THRESHOLD: f64 = 1e7;

/// Advances every lane by one time step.
#[inline(always)]
pub fn step<R: Register, const N: usize>(state: &mut BatchState) {
    state.tick += 1.0;
    integrate_positions::<R, N>(state);
    find_contacts::<R, N>(state);
    if !state.near.is_empty() {
        collision::find_contacts::<R, N>(state);
    }
    count_supported::<R, N>(state);
    let laws = !state.contact_laws.is_empty();
    if laws {
        contact_laws::apply_contact_laws(state);
        contact_laws::apply_contact_laws_at_points(state);
    }
    apply_forces::<R, N>(state);
    if !(state.active_pairs.is_empty() && state.active_manifolds.is_empty()) {
        solve::<R, N>(state, laws);
        if laws {
            contact_laws::apply_rolling_resistance(state);
        }
    }
}

/// Advances positions, and the bounds on the distance each body has travelled.
#[inline(always)]
fn integrate_positions<R: Register, const N: usize>(state: &mut BatchState) {
    let dt: Wide<R, N> = Wide::load(&state.dt);
    let none = Wide::all(0.0);
    let (mut implausible, mut fast) = (none, false);
    for b in &mut state.bodies {
        let [mut vx, mut vy] = [Wide::load(&b.moving.vx), Wide::load(&b.moving.vy)];
        let mut omega = Wide::load(&b.moving.omega);
        let still = [flush_small_speed(vx), flush_small_speed(vy), flush_small_speed(omega)];
        still[0].store(&mut b.moving.vx);
        still[1].store(&mut b.moving.vy);
        still[2].store(&mut b.moving.omega);
        if b.has_outline {
            // Rounding errors of a body on two points of contact are larger, and visible in an
            // angle near 0.
            [vx, vy, omega] = still;
        }
        let (vx, vy) = (vx + Wide::load(&b.bias_x), vy + Wide::load(&b.bias_y));
        let (displacement_x, displacement_y) = (vx * dt, vy * dt);
        let (x, y) = (Wide::load(&b.moving.x) + displacement_x, Wide::load(&b.moving.y) + displacement_y);
        x.store(&mut b.moving.x);
        y.store(&mut b.moving.y);
        (Wide::load(&b.angle) + omega * dt).store(&mut b.angle);
        none.store(&mut b.bias_x);
        none.store(&mut b.bias_y);
        let distance = displacement_x.abs() + displacement_y.abs();
        (Wide::load(&b.travel) + distance).store(&mut b.travel);
        b.fast = !b.has_outline
            && (Wide::all(MIN_CCD_TRAVEL_PER_RADIUS) * Wide::load(&b.radius).abs()).less(distance).any();
        fast |= b.fast;
        if b.fast || b.has_outline {
            displacement_x.store(&mut b.displacement_x);
            displacement_y.store(&mut b.displacement_y);
        }
        let magnitude = x.abs() + y.abs() + vx.abs() + vy.abs() + omega.abs();
        // A NaN compares false.
        implausible = magnitude.at_most(Wide::all(DIVERGENCE_THRESHOLD)).select(implausible, Wide::all(1.0));
    }
    state.may_diverge = none.less(implausible).any();
    if state.may_diverge {
        implausible.store(&mut state.implausible);
    }
    fast |= integrate_angles::<R, N>(state);
    if fast {
        stop_fast_bodies(state);
    }
}

/// The angles of bodies that are not discs, with bias rotation and the distance travelled by rotation.
/// Whether one is fast.
#[inline(always)]
fn integrate_angles<R: Register, const N: usize>(state: &mut BatchState) -> bool {
    let dt: Wide<R, N> = Wide::load(&state.dt);
    let mut fast = false;
    for (frame, body) in state.frames.iter_mut().zip(&mut state.bodies) {
        let bias = Wide::load(&frame.bias_omega);
        Wide::<R, N>::all(0.0).store(&mut frame.bias_omega);
        if frame.disc {
            continue;
        }
        (Wide::load(&body.angle) + bias * dt).store(&mut body.angle);
        let turned = (Wide::load(&body.moving.omega) + bias) * dt;
        turned.store(&mut frame.turned_by);
        let distance = Wide::load(&frame.extent) * turned.abs();
        (Wide::load(&body.travel) + distance).store(&mut body.travel);
        let all = distance + Wide::load(&body.displacement_x).abs() + Wide::load(&body.displacement_y).abs();
        body.fast = (Wide::all(MIN_CCD_TRAVEL_PER_RADIUS) * Wide::load(&body.radius).abs()).less(all).any();
        fast |= body.fast;
    }
    fast
}

/// A speed, or 0 where it is negligible.
#[inline(always)]
fn flush_small_speed<R: Register, const N: usize>(speed: Wide<R, N>) -> Wide<R, N> {
    Wide::all(MIN_SPEED_M_S).less(speed.abs()).select(speed, Wide::all(0.0))
}

/// Tests every pair that may touch, records contacts, and collects the active pairs.
#[inline(always)]
fn find_contacts<R: Register, const N: usize>(state: &mut BatchState) {
    state.active_pairs.clear();
    state.any_bias = false;
    let count = state.bodies.len();
    let touch: Wide<R, N> = Wide::load(&state.contact_margin);
    for index in 0..state.pairs.len() {
        let pair = &mut state.pairs[index];
        let first = &state.bodies[pair.first];
        let (gap, travel, vx, vy): (DiscSeparation<R, N>, _, _, _);
        if pair.second < count {
            let second = &state.bodies[pair.second];
            travel = Wide::load(&first.travel) + Wide::load(&second.travel);
            if !may_touch(&pair.limit, travel) {
                continue;
            }
            gap = between_discs(first, second);
            vx = Wide::load(&second.moving.vx) - Wide::load(&first.moving.vx);
            vy = Wide::load(&second.moving.vy) - Wide::load(&first.moving.vy);
        } else {
            travel = Wide::load(&first.travel);
            if !may_touch(&pair.limit, travel) {
                continue;
            }
            gap = with_static(first, &state.statics[pair.second - count]);
            (vx, vy) = (Wide::load(&first.moving.vx), Wide::load(&first.moving.vy));
        }
        // Distance that the bodies may travel before the pair must be tested again.
        let free = gap.separation - touch - Wide::all(TRAVEL_TOLERANCE_M);
        (travel + free.above(Wide::all(0.0))).store(&mut pair.limit);
        let touching = gap.separation.at_most(touch);
        if !touching.any() {
            pair.clear_impulses();
            continue;
        }
        if pair.second >= count {
            let carries = touching.and(Wide::all(MIN_SUPPORT_NORMAL_Y).less(gap.ny));
            let body = &mut state.bodies[pair.first];
            carries.select(Wide::all(1.0), Wide::load(&body.supported)).store(&mut body.supported);
            body.any_supported = true;
        }
        let speed = vx * gap.nx + vy * gap.ny;
        if begin(&mut pair.contact, touching, speed, state.tick) {
            state.new_contacts.push(index);
        }
        let hit = gap.separation.less(Wide::all(0.0));
        if !hit.any() {
            pair.clear_impulses();
            continue;
        }
        let depth = Wide::all(0.0) - (gap.separation + Wide::load(&state.slop));
        state.any_bias |= prestep(pair, gap, hit, speed, depth, Wide::load(&state.bias_rate));
        state.active_pairs.push(index);
    }
}

/// Counts the steps in which a static supported each body.
#[inline(always)]
fn count_supported<R: Register, const N: usize>(state: &mut BatchState) {
    for body in &mut state.bodies {
        if body.any_supported {
            body.any_supported = false;
            let rolling: Wide<R, N> = Wide::load(&body.rolling) + Wide::load(&body.supported);
            rolling.store(&mut body.rolling);
            Wide::<R, N>::all(0.0).store(&mut body.supported);
        }
    }
}

/// Chipmunk's prestep: target rebound and bias velocities; effective masses of 0 in lanes where the pair is
/// not active. Whether any lane is deeper than its slop.
#[inline(always)]
fn prestep<R: Register, const N: usize>(
    pair: &mut DiscPair,
    gap: DiscSeparation<R, N>,
    hit: Mask<R, N>,
    speed: Wide<R, N>,
    depth: Wide<R, N>,
    bias_rate: Wide<R, N>,
) -> bool {
    let none = Wide::all(0.0);
    gap.nx.store(&mut pair.nx);
    gap.ny.store(&mut pair.ny);
    (speed * Wide::load(&pair.restitution)).store(&mut pair.bounce);
    hit.select(Wide::load(&pair.full_normal_mass), none).store(&mut pair.normal_mass);
    hit.select(Wide::load(&pair.full_tangent_mass), none).store(&mut pair.tangent_mass);
    hit.select(Wide::load(&pair.jn), none).store(&mut pair.jn);
    hit.select(Wide::load(&pair.jt), none).store(&mut pair.jt);
    (depth.above(none) * bias_rate).store(&mut pair.bias);
    none.store(&mut pair.jb);
    pair.pushed = true;
    pair.seen = [u32::MAX; 2];
    none.less(depth).any()
}

/// Applies effects, then gravity.
#[inline(always)]
fn apply_forces<R: Register, const N: usize>(state: &mut BatchState) {
    for term in &state.motion_laws {
        for body in &mut state.bodies {
            if state.clocked {
                for l in 0..LANES {
                    body.moving.time[l] = (state.tick - 1.0 - state.start_tick[l]) * state.time_step;
                }
            }
            dispatch::kick_lanes(term.effect, &term.constants, &mut body.moving, state.time_step);
        }
    }
    let (kick_x, kick_y): (Wide<R, N>, Wide<R, N>) = (Wide::load(&state.kick_x), Wide::load(&state.kick_y));
    let none = Wide::all(0.0);
    for body in &mut state.bodies {
        // Adding 0 turns -0 into 0, so that adding a zero impulse changes no bit.
        (Wide::load(&body.moving.vx) + kick_x + none).store(&mut body.moving.vx);
        (Wide::load(&body.moving.vy) + kick_y + none).store(&mut body.moving.vy);
        (Wide::load(&body.moving.omega) + none).store(&mut body.moving.omega);
    }
}
