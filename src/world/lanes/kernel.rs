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
//! - A contact whose impulses would change by less than [`CONTENT`] of themselves is left as it is.
//! - Speeds below [`STILL`] are taken for none at the start of a step.
//! - A sweep leaves out contacts that it cannot change: those whose last visit changed nothing and whose bodies
//!   have not changed since. The result is the same to the last bit.
//! - A pair is looked at only when its bodies may have travelled as far as they were apart.
//! - Contacts are visited in a fixed order (pairs of bodies, then each body's statics); Chipmunk's depends on
//!   its search tree.
//! - A contact lost for a step or two and found again starts without its old impulse.

use super::batch::{Batch, BodyLanes, Pair};
use super::contact::{Gap, between_discs, may_touch, with_static};
use super::simd::{Mask, Register, Wide};
use super::touch;
use super::tunnel::{WATCHED, stop_fast_discs};
use crate::world::effect::LANES;
use crate::world::record::{APART_STEPS, CARRIES};

/// Sweeps over the contacts in a step: Chipmunk's default.
const SWEEPS: u32 = 10;
/// m; covers the rounding of travelled ways, far below what matters and far above what rounds off.
const HAIR: f64 = 1e-6;
/// A contact whose impulses would change by less than this share of the normal impulse is content and left as it
/// is: a thousand times what rounds off, so that a resting ball costs one visit and not ten.
const CONTENT: f64 = 1e-12;
/// Speed, m/s or rad/s, that is taken for none: a hair above what contacts leave of rounding, so that things at
/// rest come to a state that the next step repeats. It adds up to less than an atom's width in a rollout.
const STILL: f64 = 1e-12;
/// Size of a sum of coordinates and speeds above which a state is looked at for divergence.
const WILD: f64 = 1e7;

/// Advances every lane by one time step.
#[inline(always)]
pub fn step<R: Register, const N: usize>(batch: &mut Batch) {
    batch.tick += 1.0;
    advance::<R, N>(batch);
    find_contacts::<R, N>(batch);
    let laws = !batch.touches.is_empty();
    if laws {
        touch::meet(batch);
    }
    push::<R, N>(batch);
    if !batch.active.is_empty() {
        warm_start::<R, N>(batch);
        match (batch.any_bias, laws) {
            (false, false) => sweep::<false, false, R, N>(batch),
            (true, false) => sweep::<true, false, R, N>(batch),
            (false, true) => sweep::<false, true, R, N>(batch),
            (true, true) => sweep::<true, true, R, N>(batch),
        }
        if laws {
            touch::roll(batch);
        }
    }
}

/// Positions, and the bound on how far each body has travelled.
#[inline(always)]
fn advance<R: Register, const N: usize>(batch: &mut Batch) {
    let dt: Wide<R, N> = Wide::load(&batch.dt);
    let none = Wide::all(0.0);
    let (mut tame, mut fast) = (true, false);
    for b in &mut batch.bodies {
        let [vx, vy] = [Wide::load(&b.moving.vx), Wide::load(&b.moving.vy)];
        let omega = Wide::load(&b.moving.omega);
        settled(vx).store(&mut b.moving.vx);
        settled(vy).store(&mut b.moving.vy);
        settled(omega).store(&mut b.moving.omega);
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
        b.fast = (Wide::all(WATCHED) * Wide::load(&b.radius).size()).less(way).any();
        if b.fast {
            fast = true;
            way_x.store(&mut b.way_x);
            way_y.store(&mut b.way_y);
        }
        let size = x.size() + y.size() + vx.size() + vy.size() + omega.size();
        // A NaN is not at most anything.
        let odd = size.at_most(Wide::all(WILD)).select(none, Wide::all(1.0));
        tame &= !none.less(odd).any();
    }
    batch.wild = !tame;
    if fast {
        stop_fast_discs(batch);
    }
}

/// A speed, or 0 where it is too small to matter.
#[inline(always)]
fn settled<R: Register, const N: usize>(speed: Wide<R, N>) -> Wide<R, N> {
    Wide::all(STILL).less(speed.size()).select(speed, Wide::all(0.0))
}

/// Looks at every pair that may touch, writes touches down, and collects those that push.
#[inline(always)]
fn find_contacts<R: Register, const N: usize>(batch: &mut Batch) {
    batch.active.clear();
    batch.any_bias = false;
    let count = batch.bodies.len();
    let touch: Wide<R, N> = Wide::load(&batch.touch);
    for index in 0..batch.pairs.len() {
        let pair = &mut batch.pairs[index];
        let first = &batch.bodies[pair.first];
        let (gap, travel, vx, vy): (Gap<R, N>, _, _, _);
        if pair.second < count {
            let second = &batch.bodies[pair.second];
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
            gap = with_static(first, &batch.statics[pair.second - count]);
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
            let body = &mut batch.bodies[pair.first];
            carries.select(Wide::all(1.0), Wide::load(&body.carried)).store(&mut body.carried);
            body.any_carried = true;
        }
        let speed = vx * gap.nx + vy * gap.ny;
        if begin(pair, touching, speed, batch.tick) {
            batch.fresh.push(index);
        }
        let hit = gap.separation.less(Wide::all(0.0));
        if !hit.any() {
            pair.let_go();
            continue;
        }
        let depth = Wide::all(0.0) - (gap.separation + Wide::load(&batch.slop));
        batch.any_bias |= prepare(pair, gap, hit, speed, depth, Wide::load(&batch.bias_rate));
        batch.active.push(index);
    }
    for body in &mut batch.bodies {
        if body.any_carried {
            body.any_carried = false;
            let rolling: Wide<R, N> = Wide::load(&body.rolling) + Wide::load(&body.carried);
            rolling.store(&mut body.rolling);
            Wide::<R, N>::all(0.0).store(&mut body.carried);
        }
    }
}

/// Marks the lanes that begin to touch; whether any does.
#[inline(always)]
fn begin<R: Register, const N: usize>(
    pair: &mut Pair,
    touching: Mask<R, N>,
    speed: Wide<R, N>,
    tick: f64,
) -> bool {
    let now = Wide::all(tick);
    let last = Wide::load(&pair.last_touch);
    touching.select(now, last).store(&mut pair.last_touch);
    let begins = touching.and(Wide::all(f64::from(APART_STEPS)).less(now - last));
    if !begins.any() {
        return false;
    }
    begins.select(Wide::all(1.0), Wide::all(0.0)).store(&mut pair.begins);
    speed.store(&mut pair.speed);
    true
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
fn push<R: Register, const N: usize>(batch: &mut Batch) {
    for term in &batch.motions {
        for body in &mut batch.bodies {
            if batch.clocked {
                for l in 0..LANES {
                    body.moving.time[l] = (batch.tick - 1.0 - batch.born[l]) * batch.time_step;
                }
            }
            term.law.kick_lanes(&term.constants, &mut body.moving, batch.time_step);
        }
    }
    let (kick_x, kick_y): (Wide<R, N>, Wide<R, N>) = (Wide::load(&batch.kick_x), Wide::load(&batch.kick_y));
    let none = Wide::all(0.0);
    for body in &mut batch.bodies {
        // Adding 0 turns -0 into 0, so that adding an impulse of 0 changes no bit.
        (Wide::load(&body.moving.vx) + kick_x + none).store(&mut body.moving.vx);
        (Wide::load(&body.moving.vy) + kick_y + none).store(&mut body.moving.vy);
        (Wide::load(&body.moving.omega) + none).store(&mut body.moving.omega);
    }
}

/// Applies the impulses of the last step.
#[inline(always)]
fn warm_start<R: Register, const N: usize>(batch: &mut Batch) {
    let count = batch.bodies.len();
    for index in &batch.active {
        let pair = &batch.pairs[*index];
        let impulse = Impulse::<R, N>::of(pair, Wide::load(&pair.jn), Wide::load(&pair.jt));
        if pair.second < count {
            let (a, b) = two(&mut batch.bodies, pair.first, pair.second);
            impulse.pull(a);
            impulse.push(b);
        } else {
            impulse.push(&mut batch.bodies[pair.first]);
        }
    }
}

/// Sequential impulses; without `BIAS` no pair is deeper than the slop and the bias part is left out, without
/// `SLIP` friction drives at rest.
#[inline(always)]
fn sweep<const BIAS: bool, const SLIP: bool, R: Register, const N: usize>(batch: &mut Batch) {
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
                visit_pair::<BIAS, SLIP, R, N>(pair, a, b)
            } else {
                visit_static::<BIAS, SLIP, R, N>(pair, &mut batch.bodies[pair.first])
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
fn visit_pair<const BIAS: bool, const SLIP: bool, R: Register, const N: usize>(
    pair: &mut Pair,
    a: &mut BodyLanes,
    b: &mut BodyLanes,
) -> bool {
    let (nx, ny) = (Wide::<R, N>::load(&pair.nx), Wide::load(&pair.ny));
    let vx = Wide::load(&b.moving.vx) - Wide::load(&a.moving.vx);
    let vy = Wide::load(&b.moving.vy) - Wide::load(&a.moving.vy);
    let rim = Wide::load(&b.radius) * Wide::load(&b.moving.omega)
        + Wide::load(&a.radius) * Wide::load(&a.moving.omega);
    let (impulse, mut moved) = resist::<SLIP, R, N>(pair, vx * nx + vy * ny, vy * nx - vx * ny - rim);
    if let Some(impulse) = impulse {
        impulse.pull(a);
        impulse.push(b);
    }
    if BIAS {
        let bx = Wide::load(&b.bias_x) - Wide::load(&a.bias_x);
        let by = Wide::load(&b.bias_y) - Wide::load(&a.bias_y);
        if let Some(d) = resist_bias(pair, bx * nx + by * ny) {
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

/// One visit to a contact of a disc with a static; whether it changed anything.
#[inline(always)]
fn visit_static<const BIAS: bool, const SLIP: bool, R: Register, const N: usize>(
    pair: &mut Pair,
    b: &mut BodyLanes,
) -> bool {
    let (nx, ny) = (Wide::<R, N>::load(&pair.nx), Wide::load(&pair.ny));
    let (vx, vy) = (Wide::load(&b.moving.vx), Wide::load(&b.moving.vy));
    let rim = Wide::load(&b.radius) * Wide::load(&b.moving.omega);
    let (impulse, mut moved) = resist::<SLIP, R, N>(pair, vx * nx + vy * ny, vy * nx - vx * ny - rim);
    if let Some(impulse) = impulse {
        impulse.push(b);
    }
    if BIAS {
        let (bx, by) = (Wide::load(&b.bias_x), Wide::load(&b.bias_y));
        if let Some(d) = resist_bias(pair, bx * nx + by * ny) {
            let db = d * Wide::load(&b.inv_mass);
            (bx + nx * db).store(&mut b.bias_x);
            (by + ny * db).store(&mut b.bias_y);
            moved = true;
        }
    }
    moved
}

/// Normal and tangential impulses against relative speeds (of the second against the first); `None` where the
/// contact is content.
#[inline(always)]
fn resist<const SLIP: bool, R: Register, const N: usize>(
    pair: &mut Pair,
    normal: Wide<R, N>,
    tangent: Wide<R, N>,
) -> (Option<Impulse<R, N>>, bool) {
    let none = Wide::all(0.0);
    let (jn_old, jt_old) = (Wide::load(&pair.jn), Wide::load(&pair.jt));
    let jn = (jn_old - (Wide::load(&pair.bounce) + normal) * Wide::load(&pair.normal_mass)).above(none);
    let most = Wide::load(&pair.friction) * jn;
    let tangent = if SLIP { tangent - Wide::load(&pair.slip) } else { tangent };
    let jt = (jt_old - tangent * Wide::load(&pair.tangent_mass)).above(none - most).below(most);
    let (dn, dt) = (jn - jn_old, jt - jt_old);
    let content = Wide::all(CONTENT) * jn;
    let moved = content.less(dn.size()).or(content.less(dt.size()));
    if !moved.any() {
        return (None, false);
    }
    let (jn, jt) = (moved.select(jn, jn_old), moved.select(jt, jt_old));
    let (dn, dt) = (moved.select(dn, none), moved.select(dt, none));
    jn.store(&mut pair.jn);
    jt.store(&mut pair.jt);
    (Some(Impulse::of(pair, dn, dt)), true)
}

/// The change of the bias impulse; `None` where the contact is content.
#[inline(always)]
fn resist_bias<R: Register, const N: usize>(pair: &mut Pair, speed: Wide<R, N>) -> Option<Wide<R, N>> {
    let old = Wide::load(&pair.jb);
    let new = (old + (Wide::load(&pair.bias) - speed) * Wide::load(&pair.normal_mass)).above(Wide::all(0.0));
    let moved = (Wide::all(CONTENT) * new).less((new - old).size());
    if !moved.any() {
        return None;
    }
    moved.select(new, old).store(&mut pair.jb);
    Some(moved.select(new - old, Wide::all(0.0)))
}

/// An impulse at a contact, N s.
struct Impulse<R, const N: usize> {
    x: Wide<R, N>,
    y: Wide<R, N>,
    tangential: Wide<R, N>,
}

impl<R: Register, const N: usize> Impulse<R, N> {
    #[inline(always)]
    fn of(pair: &Pair, normal: Wide<R, N>, tangential: Wide<R, N>) -> Self {
        let (nx, ny) = (Wide::load(&pair.nx), Wide::load(&pair.ny));
        Impulse { x: nx * normal - ny * tangential, y: ny * normal + nx * tangential, tangential }
    }

    /// Acts on the body that the normal points to.
    #[inline(always)]
    fn push(&self, b: &mut BodyLanes) {
        let inv_mass = Wide::load(&b.inv_mass);
        (Wide::load(&b.moving.vx) + self.x * inv_mass).store(&mut b.moving.vx);
        (Wide::load(&b.moving.vy) + self.y * inv_mass).store(&mut b.moving.vy);
        self.spin(b);
    }

    /// Acts in reverse on the body that the normal points away from.
    #[inline(always)]
    fn pull(&self, a: &mut BodyLanes) {
        let inv_mass = Wide::load(&a.inv_mass);
        (Wide::load(&a.moving.vx) - self.x * inv_mass).store(&mut a.moving.vx);
        (Wide::load(&a.moving.vy) - self.y * inv_mass).store(&mut a.moving.vy);
        self.spin(a);
    }

    /// Both discs are turned the same way: force and arm are reversed.
    #[inline(always)]
    fn spin(&self, body: &mut BodyLanes) {
        let turned = Wide::load(&body.moving.omega) - self.tangential * Wide::load(&body.spin_per_impulse);
        turned.store(&mut body.moving.omega);
    }
}

#[inline(always)]
fn two(bodies: &mut [BodyLanes], first: usize, second: usize) -> (&mut BodyLanes, &mut BodyLanes) {
    let (head, tail) = bodies.split_at_mut(second);
    (&mut head[first], &mut tail[0])
}
