//! One time step of a batch, the arithmetic of Chipmunk2D's `cpSpaceStep`.
//!
//! Source: Chipmunk2D 7 (`cpSpaceStep.c`, `cpArbiter.c`, `cpCollision.c`), which follows Catto, "Iterative
//! dynamics with temporal coherence" (GDC 2005): sequential impulses with warm starting; penetration beyond a
//! slop is pushed out by separate bias velocities that do not turn into speed. In order: positions advance with
//! the speeds and bias speeds of the last step; contacts are found, and each one's bounce speed is taken from the
//! speeds as they are; effects and gravity act; last step's impulses are applied; ten sweeps over the contacts (`solve`).
//!
//! Differences from the source:
//! - Speeds below [`STILL`] are taken for none at the start of a step.
//! - A pair is looked at only when its bodies may have travelled as far as they were apart.
//! - Contacts are visited in a fixed order (pairs of bodies, then each body's statics); Chipmunk's depends on
//!   its search tree.
//! - A contact lost for a step or two and found again starts without its old impulse.

use super::contact::{Gap, between_discs, may_touch, with_static};
use super::near;
use super::simd::{Mask, Register, Wide};
use super::solve::solve;
use super::state::{Pair, State};
use super::touch;
use super::touching::{HAIR, begin};
use super::tunnel::{WATCHED, stop_what_is_fast};
use crate::world::effect::LANES;
use crate::world::record::CARRIES;

/// Speed, m/s or rad/s, that is taken for none: a hair above what contacts leave of rounding, so that things at
/// rest come to a state that the next step repeats. It adds up to less than an atom's width in a rollout.
const STILL: f64 = 1e-12;
/// Size of a sum of coordinates and speeds above which a state is looked at for divergence.
const WILD: f64 = 1e7;

/// Advances every lane by one time step.
#[inline(always)]
pub fn step<R: Register, const N: usize>(state: &mut State) {
    state.tick += 1.0;
    advance::<R, N>(state);
    find_contacts::<R, N>(state);
    if !state.near.is_empty() {
        near::find::<R, N>(state);
    }
    count_carried::<R, N>(state);
    let laws = !state.touches.is_empty();
    if laws {
        touch::meet(state);
        touch::meet_at_points(state);
    }
    push::<R, N>(state);
    if !(state.active.is_empty() && state.pressing.is_empty()) {
        solve::<R, N>(state, laws);
        if laws {
            touch::roll(state);
        }
    }
}

/// Positions, and the bound on how far each body has travelled.
#[inline(always)]
fn advance<R: Register, const N: usize>(state: &mut State) {
    let dt: Wide<R, N> = Wide::load(&state.dt);
    let none = Wide::all(0.0);
    let (mut tame, mut fast) = (true, false);
    for b in &mut state.bodies {
        let [mut vx, mut vy] = [Wide::load(&b.moving.vx), Wide::load(&b.moving.vy)];
        let mut omega = Wide::load(&b.moving.omega);
        let still = [settled(vx), settled(vy), settled(omega)];
        still[0].store(&mut b.moving.vx);
        still[1].store(&mut b.moving.vy);
        still[2].store(&mut b.moving.omega);
        if b.shaped {
            // What rests on two points is left with more than rounds off, and an angle near 0 shows it.
            [vx, vy, omega] = still;
        }
        let (vx, vy) = (vx + Wide::load(&b.bias_x), vy + Wide::load(&b.bias_y));
        let (way_x, way_y) = (vx * dt, vy * dt);
        let (x, y) = (Wide::load(&b.moving.x) + way_x, Wide::load(&b.moving.y) + way_y);
        x.store(&mut b.moving.x);
        y.store(&mut b.moving.y);
        (Wide::load(&b.angle) + omega * dt).store(&mut b.angle);
        none.store(&mut b.bias_x);
        none.store(&mut b.bias_y);
        let way = way_x.size() + way_y.size();
        (Wide::load(&b.travel) + way).store(&mut b.travel);
        b.fast = !b.shaped && (Wide::all(WATCHED) * Wide::load(&b.radius).size()).less(way).any();
        fast |= b.fast;
        if b.fast || b.shaped {
            way_x.store(&mut b.way_x);
            way_y.store(&mut b.way_y);
        }
        let size = x.size() + y.size() + vx.size() + vy.size() + omega.size();
        // A NaN is not at most anything.
        let odd = size.at_most(Wide::all(WILD)).select(none, Wide::all(1.0));
        tame &= !none.less(odd).any();
    }
    state.wild = !tame;
    fast |= turn_bodies::<R, N>(state);
    if fast {
        stop_what_is_fast(state);
    }
}

/// What bodies that are no discs do beyond that: the bias turns them, and to turn is to travel. Whether one is fast.
#[inline(always)]
fn turn_bodies<R: Register, const N: usize>(state: &mut State) -> bool {
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
        let way = Wide::load(&frame.extent) * turned.size();
        (Wide::load(&body.travel) + way).store(&mut body.travel);
        let all = way + Wide::load(&body.way_x).size() + Wide::load(&body.way_y).size();
        body.fast = (Wide::all(WATCHED) * Wide::load(&body.radius).size()).less(all).any();
        fast |= body.fast;
    }
    fast
}

/// A speed, or 0 where it is too small to matter.
#[inline(always)]
fn settled<R: Register, const N: usize>(speed: Wide<R, N>) -> Wide<R, N> {
    Wide::all(STILL).less(speed.size()).select(speed, Wide::all(0.0))
}

/// Looks at every pair that may touch, writes touches down, and collects those that push.
#[inline(always)]
fn find_contacts<R: Register, const N: usize>(state: &mut State) {
    state.active.clear();
    state.any_bias = false;
    let count = state.bodies.len();
    let touch: Wide<R, N> = Wide::load(&state.touch);
    for index in 0..state.pairs.len() {
        let pair = &mut state.pairs[index];
        let first = &state.bodies[pair.first];
        let (gap, travel, vx, vy): (Gap<R, N>, _, _, _);
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
        // How far the bodies may travel before the pair must be looked at again.
        let free = gap.separation - touch - Wide::all(HAIR);
        (travel + free.above(Wide::all(0.0))).store(&mut pair.limit);
        let touching = gap.separation.at_most(touch);
        if !touching.any() {
            pair.let_go();
            continue;
        }
        if pair.second >= count {
            let carries = touching.and(Wide::all(CARRIES).less(gap.ny));
            let body = &mut state.bodies[pair.first];
            carries.select(Wide::all(1.0), Wide::load(&body.carried)).store(&mut body.carried);
            body.any_carried = true;
        }
        let speed = vx * gap.nx + vy * gap.ny;
        if begin(&mut pair.met, touching, speed, state.tick) {
            state.fresh.push(index);
        }
        let hit = gap.separation.less(Wide::all(0.0));
        if !hit.any() {
            pair.let_go();
            continue;
        }
        let depth = Wide::all(0.0) - (gap.separation + Wide::load(&state.slop));
        state.any_bias |= prepare(pair, gap, hit, speed, depth, Wide::load(&state.bias_rate));
        state.active.push(index);
    }
}

/// Adds up in how many steps a static carried each body.
#[inline(always)]
fn count_carried<R: Register, const N: usize>(state: &mut State) {
    for body in &mut state.bodies {
        if body.any_carried {
            body.any_carried = false;
            let rolling: Wide<R, N> = Wide::load(&body.rolling) + Wide::load(&body.carried);
            rolling.store(&mut body.rolling);
            Wide::<R, N>::all(0.0).store(&mut body.carried);
        }
    }
}

/// Chipmunk's prestep: target bounce and bias speeds; masses of 0 where a lane's pair does not push. Whether
/// any lane is deeper than its slop.
#[inline(always)]
fn prepare<R: Register, const N: usize>(
    pair: &mut Pair,
    gap: Gap<R, N>,
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

/// Effects, then gravity.
#[inline(always)]
fn push<R: Register, const N: usize>(state: &mut State) {
    for term in &state.motions {
        for body in &mut state.bodies {
            if state.clocked {
                for l in 0..LANES {
                    body.moving.time[l] = (state.tick - 1.0 - state.born[l]) * state.time_step;
                }
            }
            term.law.kick_lanes(&term.constants, &mut body.moving, state.time_step);
        }
    }
    let (kick_x, kick_y): (Wide<R, N>, Wide<R, N>) = (Wide::load(&state.kick_x), Wide::load(&state.kick_y));
    let none = Wide::all(0.0);
    for body in &mut state.bodies {
        // Adding 0 turns -0 into 0, so that adding an impulse of 0 changes no bit.
        (Wide::load(&body.moving.vx) + kick_x + none).store(&mut body.moving.vx);
        (Wide::load(&body.moving.vy) + kick_y + none).store(&mut body.moving.vy);
        (Wide::load(&body.moving.omega) + none).store(&mut body.moving.omega);
    }
}
