//! One time step of a batch, the arithmetic of Chipmunk2D's `cpSpaceStep`.
//!
//! Source: Chipmunk2D 7 (`cpSpaceStep.c`, `cpArbiter.c`, `cpCollision.c`), which follows Catto, "Iterative
//! dynamics with temporal coherence" (GDC 2005): sequential impulses with warm starting; penetration beyond a
//! slop is pushed out by separate bias velocities that do not turn into speed. In order: positions advance with
//! the speeds and bias speeds of the last step; contacts are found, and each one's bounce speed is taken from the
//! speeds as they are; effects and gravity act; last step's impulses are applied; ten sweeps over the contacts.
//!
//! For a disc the contact arm is parallel to the normal, so normal impulses do not turn it, effective masses
//! are constants of the pair, and spin meets only the tangential part.
//!
//! Differences from the source:
//! - A sweep leaves out contacts that it cannot change: those whose last visit changed nothing and whose bodies
//!   have not changed since. The result is the same to the last bit.
//! - A pair is looked at only when its bodies may have travelled as far as they were apart.
//! - Contacts are visited in a fixed order (pairs of bodies, then each body's statics); Chipmunk's depends on
//!   its search tree.
//! - A contact lost for a step or two and found again starts without its old impulse.

use super::batch::{Batch, BodyLanes, Pair, V};
use super::contact::{between_discs, with_static};
use crate::world::effect::{Act, LANES};
use crate::world::record::{APART_STEPS, CARRIES};

/// Sweeps over the contacts in a step: Chipmunk's default.
const SWEEPS: u32 = 10;
/// m; covers the rounding of travelled ways, far below what matters and far above what rounds off.
const HAIR: f64 = 1e-6;

/// Advances every lane by one time step. Straight-line loops over lanes that LLVM turns into vectors.
#[inline(always)]
pub fn step(batch: &mut Batch) {
    batch.tick += 1.0;
    advance(batch);
    find_contacts(batch);
    push(batch);
    if !batch.active.is_empty() {
        warm_start(batch);
        if batch.any_bias { sweep::<true>(batch) } else { sweep::<false>(batch) }
    }
}

/// Positions, and the bound on how far each body has travelled.
#[inline(always)]
fn advance(batch: &mut Batch) {
    let dt = &batch.dt;
    let mut wild = false;
    for b in &mut batch.bodies {
        let mut any = false;
        for l in 0..LANES {
            let (vx, vy) = (b.moving.vx[l] + b.bias_x[l], b.moving.vy[l] + b.bias_y[l]);
            let (x, y) = (b.moving.x[l] + vx * dt[l], b.moving.y[l] + vy * dt[l]);
            b.moving.x[l] = x;
            b.moving.y[l] = y;
            b.angle[l] += b.moving.omega[l] * dt[l];
            b.bias_x[l] = 0.0;
            b.bias_y[l] = 0.0;
            let speed = vx.abs() + vy.abs();
            b.travel[l] += speed * dt[l];
            let size = x.abs() + y.abs() + speed + b.moving.omega[l].abs();
            any |= !(size < 1e7);
        }
        wild |= any;
    }
    batch.wild = wild;
}

/// Looks at every pair that may touch, writes touches down, and collects those that push.
#[inline(always)]
fn find_contacts(batch: &mut Batch) {
    batch.active.clear();
    batch.any_bias = false;
    let count = batch.bodies.len();
    for index in 0..batch.pairs.len() {
        let pair = &mut batch.pairs[index];
        let first = &batch.bodies[pair.first];
        let pushing = if pair.second < count {
            let second = &batch.bodies[pair.second];
            if !may_touch(pair, &first.travel, &second.travel) {
                continue;
            }
            between_discs(first, second, pair);
            relax(pair, &first.travel, &second.travel, &batch.touch);
            let mut speed = [0.0; LANES];
            for l in 0..LANES {
                speed[l] = (second.moving.vx[l] - first.moving.vx[l]) * pair.nx[l]
                    + (second.moving.vy[l] - first.moving.vy[l]) * pair.ny[l];
            }
            prepare(pair, &speed, &batch.touch, batch.tick, &batch.slop, &batch.bias_rate)
        } else {
            if !may_touch(pair, &first.travel, &[0.0; LANES]) {
                continue;
            }
            with_static(first, &batch.statics[pair.second - count], pair);
            relax(pair, &first.travel, &[0.0; LANES], &batch.touch);
            let mut speed = [0.0; LANES];
            for l in 0..LANES {
                speed[l] = first.moving.vx[l] * pair.nx[l] + first.moving.vy[l] * pair.ny[l];
            }
            let found = prepare(pair, &speed, &batch.touch, batch.tick, &batch.slop, &batch.bias_rate);
            if found.touches {
                let body = &mut batch.bodies[pair.first];
                for l in 0..LANES {
                    let carries = (pair.separation[l] <= batch.touch[l]) & (pair.ny[l] > CARRIES);
                    body.carried[l] = if carries { 1.0 } else { body.carried[l] };
                }
                body.any_carried = true;
            }
            found
        };
        if pushing.fresh {
            batch.fresh.push(index);
        }
        if pushing.pushes {
            batch.any_bias |= pushing.bias;
            batch.active.push(index);
        }
    }
    for body in &mut batch.bodies {
        if body.any_carried {
            body.any_carried = false;
            for l in 0..LANES {
                body.rolling[l] += body.carried[l];
                body.carried[l] = 0.0;
            }
        }
    }
}

/// Whether any lane's bodies may have come within touch since the pair was last looked at.
#[inline(always)]
fn may_touch(pair: &Pair, first: &V, second: &V) -> bool {
    let mut any = false;
    for l in 0..LANES {
        any |= first[l] + second[l] >= pair.limit[l];
    }
    any
}

/// Sets how far the bodies may travel before the pair must be looked at again.
#[inline(always)]
fn relax(pair: &mut Pair, first: &V, second: &V, touch: &V) {
    for l in 0..LANES {
        let free = pair.separation[l] - touch[l] - HAIR;
        pair.limit[l] = first[l] + second[l] + if free > 0.0 { free } else { 0.0 };
    }
}

/// What looking at a pair found, in any lane.
struct Found {
    touches: bool,
    pushes: bool,
    bias: bool,
    fresh: bool,
}

/// Chipmunk's prestep: target bounce and bias speeds; masses of 0 where a lane's pair does not push.
#[inline(always)]
fn prepare(pair: &mut Pair, speed: &V, touch: &V, tick: f64, slop: &V, bias_rate: &V) -> Found {
    let (mut touches, mut pushes) = (false, false);
    for l in 0..LANES {
        touches |= pair.separation[l] <= touch[l];
        pushes |= pair.separation[l] < 0.0;
    }
    if !touches {
        if pair.pushed {
            pair.pushed = false;
            pair.jn = [0.0; LANES];
            pair.jt = [0.0; LANES];
        }
        return Found { touches, pushes, bias: false, fresh: false };
    }
    let mut bias = false;
    let mut fresh = false;
    for l in 0..LANES {
        let touching = pair.separation[l] <= touch[l];
        let hit = pair.separation[l] < 0.0;
        let begins = touching & (tick - pair.last_touch[l] > APART_STEPS as f64);
        fresh |= begins;
        pair.begins[l] = if begins { 1.0 } else { 0.0 };
        pair.last_touch[l] = if touching { tick } else { pair.last_touch[l] };
        pair.speed[l] = speed[l];
        pair.bounce[l] = speed[l] * pair.restitution[l];
        let deep = pair.separation[l] + slop[l];
        pair.bias[l] = if deep < 0.0 { -deep * bias_rate[l] } else { 0.0 };
        bias |= deep < 0.0;
        pair.normal_mass[l] = if hit { pair.full_normal_mass[l] } else { 0.0 };
        pair.tangent_mass[l] = if hit { pair.full_tangent_mass[l] } else { 0.0 };
        pair.jn[l] = if hit { pair.jn[l] } else { 0.0 };
        pair.jt[l] = if hit { pair.jt[l] } else { 0.0 };
        pair.jb[l] = 0.0;
    }
    pair.pushed = pushes;
    pair.seen = [u32::MAX; 2];
    Found { touches, pushes, bias, fresh }
}

/// Effects, then gravity.
#[inline(always)]
fn push(batch: &mut Batch) {
    for term in &batch.terms {
        let Act::Motion(motion) = term.act;
        for body in &mut batch.bodies {
            if batch.clocked {
                for l in 0..LANES {
                    body.moving.time[l] = (batch.tick - 1.0 - batch.born[l]) * batch.time_step;
                }
            }
            motion.kick_lanes(&term.constants, &mut body.moving, batch.time_step);
        }
    }
    for body in &mut batch.bodies {
        for l in 0..LANES {
            // Adding 0 turns -0 into 0, so that adding an impulse of 0 changes no bit.
            body.moving.vx[l] += batch.kick_x[l] + 0.0;
            body.moving.vy[l] += batch.kick_y[l] + 0.0;
            body.moving.omega[l] += 0.0;
        }
    }
}

/// Applies the impulses of the last step.
#[inline(always)]
fn warm_start(batch: &mut Batch) {
    let count = batch.bodies.len();
    for index in &batch.active {
        let pair = &batch.pairs[*index];
        if pair.second < count {
            let (a, b) = two(&mut batch.bodies, pair.first, pair.second);
            for l in 0..LANES {
                let jx = pair.nx[l] * pair.jn[l] - pair.ny[l] * pair.jt[l];
                let jy = pair.ny[l] * pair.jn[l] + pair.nx[l] * pair.jt[l];
                a.moving.vx[l] -= jx * a.inv_mass[l];
                a.moving.vy[l] -= jy * a.inv_mass[l];
                b.moving.vx[l] += jx * b.inv_mass[l];
                b.moving.vy[l] += jy * b.inv_mass[l];
                a.moving.omega[l] -= pair.jt[l] * a.spin_per_impulse[l];
                b.moving.omega[l] -= pair.jt[l] * b.spin_per_impulse[l];
            }
        } else {
            let b = &mut batch.bodies[pair.first];
            for l in 0..LANES {
                let jx = pair.nx[l] * pair.jn[l] - pair.ny[l] * pair.jt[l];
                let jy = pair.ny[l] * pair.jn[l] + pair.nx[l] * pair.jt[l];
                b.moving.vx[l] += jx * b.inv_mass[l];
                b.moving.vy[l] += jy * b.inv_mass[l];
                b.moving.omega[l] -= pair.jt[l] * b.spin_per_impulse[l];
            }
        }
    }
}

/// Sequential impulses; without `BIAS` no pair is deeper than the slop and the bias part is left out.
#[inline(always)]
fn sweep<const BIAS: bool>(batch: &mut Batch) {
    let count = batch.bodies.len();
    batch.versions.fill(0);
    for _ in 0..SWEEPS {
        let mut changed = false;
        for index in &batch.active {
            let pair = &mut batch.pairs[*index];
            let other = if pair.second < count { pair.second } else { pair.first };
            let versions = [batch.versions[pair.first], batch.versions[other]];
            if pair.seen == versions {
                continue;
            }
            let moved = if pair.second < count {
                let (a, b) = two(&mut batch.bodies, pair.first, pair.second);
                visit_pair::<BIAS>(pair, a, b)
            } else {
                visit_static::<BIAS>(pair, &mut batch.bodies[pair.first])
            };
            if moved {
                changed = true;
                batch.versions[pair.first] += 1;
                if other != pair.first {
                    batch.versions[other] += 1;
                }
            } else {
                pair.seen = versions;
            }
        }
        if !changed {
            break;
        }
    }
}

/// One visit to a contact of two discs; whether it changed anything.
#[inline(always)]
fn visit_pair<const BIAS: bool>(pair: &mut Pair, a: &mut BodyLanes, b: &mut BodyLanes) -> bool {
    let mut moved = 0u64;
    for l in 0..LANES {
        let (nx, ny) = (pair.nx[l], pair.ny[l]);
        let (vx, vy) = (b.moving.vx[l] - a.moving.vx[l], b.moving.vy[l] - a.moving.vy[l]);
        let normal = vx * nx + vy * ny;
        let tangent = vy * nx - vx * ny - (b.radius[l] * b.moving.omega[l] + a.radius[l] * a.moving.omega[l]);
        let jn = above(pair.jn[l] - (pair.bounce[l] + normal) * pair.normal_mass[l], 0.0);
        let most = pair.friction[l] * jn;
        let jt = below(above(pair.jt[l] - tangent * pair.tangent_mass[l], -most), most);
        let (dn, dt) = (jn - pair.jn[l], jt - pair.jt[l]);
        moved |= changed(jn, pair.jn[l]) | changed(jt, pair.jt[l]);
        pair.jn[l] = jn;
        pair.jt[l] = jt;
        let (jx, jy) = (nx * dn - ny * dt, ny * dn + nx * dt);
        a.moving.vx[l] -= jx * a.inv_mass[l];
        a.moving.vy[l] -= jy * a.inv_mass[l];
        b.moving.vx[l] += jx * b.inv_mass[l];
        b.moving.vy[l] += jy * b.inv_mass[l];
        a.moving.omega[l] -= dt * a.spin_per_impulse[l];
        b.moving.omega[l] -= dt * b.spin_per_impulse[l];
    }
    if BIAS {
        for l in 0..LANES {
            let (nx, ny) = (pair.nx[l], pair.ny[l]);
            let speed = (b.bias_x[l] - a.bias_x[l]) * nx + (b.bias_y[l] - a.bias_y[l]) * ny;
            let jb = above(pair.jb[l] + (pair.bias[l] - speed) * pair.normal_mass[l], 0.0);
            let d = jb - pair.jb[l];
            moved |= changed(jb, pair.jb[l]);
            pair.jb[l] = jb;
            a.bias_x[l] -= nx * d * a.inv_mass[l];
            a.bias_y[l] -= ny * d * a.inv_mass[l];
            b.bias_x[l] += nx * d * b.inv_mass[l];
            b.bias_y[l] += ny * d * b.inv_mass[l];
        }
    }
    moved != 0
}

/// One visit to a contact of a disc with a static; whether it changed anything.
#[inline(always)]
fn visit_static<const BIAS: bool>(pair: &mut Pair, b: &mut BodyLanes) -> bool {
    let mut moved = 0u64;
    for l in 0..LANES {
        let (nx, ny) = (pair.nx[l], pair.ny[l]);
        let (vx, vy) = (b.moving.vx[l], b.moving.vy[l]);
        let normal = vx * nx + vy * ny;
        let tangent = vy * nx - vx * ny - b.radius[l] * b.moving.omega[l];
        let jn = above(pair.jn[l] - (pair.bounce[l] + normal) * pair.normal_mass[l], 0.0);
        let most = pair.friction[l] * jn;
        let jt = below(above(pair.jt[l] - tangent * pair.tangent_mass[l], -most), most);
        let (dn, dt) = (jn - pair.jn[l], jt - pair.jt[l]);
        moved |= changed(jn, pair.jn[l]) | changed(jt, pair.jt[l]);
        pair.jn[l] = jn;
        pair.jt[l] = jt;
        b.moving.vx[l] = vx + (nx * dn - ny * dt) * b.inv_mass[l];
        b.moving.vy[l] = vy + (ny * dn + nx * dt) * b.inv_mass[l];
        b.moving.omega[l] -= dt * b.spin_per_impulse[l];
    }
    if BIAS {
        for l in 0..LANES {
            let (nx, ny) = (pair.nx[l], pair.ny[l]);
            let speed = b.bias_x[l] * nx + b.bias_y[l] * ny;
            let jb = above(pair.jb[l] + (pair.bias[l] - speed) * pair.normal_mass[l], 0.0);
            let d = jb - pair.jb[l];
            moved |= changed(jb, pair.jb[l]);
            pair.jb[l] = jb;
            b.bias_x[l] += nx * d * b.inv_mass[l];
            b.bias_y[l] += ny * d * b.inv_mass[l];
        }
    }
    moved != 0
}

/// The greater; the bound where the value is NaN. One machine instruction, unlike `f64::max`.
#[inline(always)]
fn above(value: f64, bound: f64) -> f64 {
    if value > bound { value } else { bound }
}

#[inline(always)]
fn below(value: f64, bound: f64) -> f64 {
    if value < bound { value } else { bound }
}

#[inline(always)]
fn changed(new: f64, old: f64) -> u64 {
    new.to_bits() ^ old.to_bits()
}

#[inline(always)]
fn two(bodies: &mut [BodyLanes], first: usize, second: usize) -> (&mut BodyLanes, &mut BodyLanes) {
    let (head, tail) = bodies.split_at_mut(second);
    (&mut head[first], &mut tail[0])
}
