//! Sequential impulses over the contacts of bodies that are no discs: `solve`'s scheme with arms and two points.
//!
//! Source: as `kernel` (`cpArbiterApplyImpulse`): each point's normal, then its friction, from the speeds as they are when the
//! contact is visited.
//!
//! Differences from the source: those of `solve`.

use super::manifold::{Manifold, Point};
use super::outline::Frame;
use super::simd::{Register, Wide};
use super::state::{BodyLanes, State};

/// A contact whose impulses would change by less than this share of the normal impulse is content and left as it
/// is: a thousand times what rounds off, so that a resting ball costs one visit and not ten.
pub const CONTENT: f64 = 1e-12;

/// Applies the impulses of the last step.
#[inline(always)]
pub fn warm_start<R: Register, const N: usize>(state: &mut State) {
    let State { pressing, manifolds, near, bodies, frames, .. } = state;
    for slot in pressing.iter() {
        let manifold = &manifolds[*slot];
        let met = &near[manifold.near].met;
        let (nx, ny) = (Wide::load(&manifold.nx), Wide::load(&manifold.ny));
        let mut both = Both::<R, N>::of(bodies, frames, [met.first, met.other]);
        for point in &manifold.points[..manifold.count] {
            both.push(&Arm::of(point), [nx, ny], Wide::load(&point.jn), Wide::load(&point.jt));
        }
        both.store(bodies, [met.first, met.other]);
    }
}

/// One visit to every contact that a visit may change; whether any was changed.
#[inline(always)]
pub fn sweep<const BIAS: bool, const SLIP: bool, R: Register, const N: usize>(state: &mut State) -> bool {
    let State { pressing, manifolds, near, bodies, frames, versions, .. } = state;
    let mut changed = false;
    for slot in pressing.iter() {
        let manifold = &mut manifolds[*slot];
        let met = &near[manifold.near].met;
        let moves = met.other < bodies.len();
        let other = if moves { met.other } else { met.first };
        let now = [versions[met.first], versions[other]];
        if manifold.seen == now {
            continue;
        }
        if visit::<BIAS, SLIP, R, N>(manifold, [met.first, met.other], bodies, frames) {
            changed = true;
            versions[met.first] += 1;
            if moves {
                versions[other] += 1;
            }
        } else {
            manifold.seen = now;
        }
    }
    changed
}

/// One visit to a contact; whether it changed anything.
#[inline(always)]
fn visit<const BIAS: bool, const SLIP: bool, R: Register, const N: usize>(
    manifold: &mut Manifold,
    between: [usize; 2],
    bodies: &mut [BodyLanes],
    frames: &mut [Frame],
) -> bool {
    let normal = [Wide::<R, N>::load(&manifold.nx), Wide::load(&manifold.ny)];
    let friction = Wide::load(&manifold.friction);
    let mut both = Both::of(bodies, frames, between);
    let (mut moved, mut pushed_out) = (false, false);
    let mut bias = if BIAS { Some(both.biased(bodies, frames, between)) } else { None };
    for point in &mut manifold.points[..manifold.count] {
        let arm = Arm::of(point);
        if let Some(bias) = &mut bias {
            let [speed, _] = bias.speeds(&arm, normal);
            if let Some(d) = resist_bias(point, speed) {
                bias.push(&arm, normal, d, Wide::all(0.0));
                pushed_out = true;
            }
        }
        let [along, across] = both.speeds(&arm, normal);
        if let Some([dn, dt]) = resist::<SLIP, R, N>(point, friction, along, across) {
            both.push(&arm, normal, dn, dt);
            moved = true;
        }
    }
    if moved {
        both.store(bodies, between);
    }
    if let Some(bias) = bias.filter(|_| pushed_out) {
        bias.store_biases(bodies, frames, between);
    }
    moved || pushed_out
}

/// Changes of the normal and tangential impulse against relative speeds; `None` where the point is content.
#[inline(always)]
fn resist<const SLIP: bool, R: Register, const N: usize>(
    point: &mut Point,
    friction: Wide<R, N>,
    along: Wide<R, N>,
    across: Wide<R, N>,
) -> Option<[Wide<R, N>; 2]> {
    let none = Wide::all(0.0);
    let (jn_old, jt_old) = (Wide::load(&point.jn), Wide::load(&point.jt));
    let jn = (jn_old - (Wide::load(&point.bounce) + along) * Wide::load(&point.normal_mass)).above(none);
    let most = friction * jn;
    let across = if SLIP { across - Wide::load(&point.slip) } else { across };
    let jt = (jt_old - across * Wide::load(&point.tangent_mass)).above(none - most).below(most);
    let (dn, dt) = (jn - jn_old, jt - jt_old);
    let content = Wide::all(CONTENT) * jn;
    let moved = content.less(dn.size()).or(content.less(dt.size()));
    if !moved.any() {
        return None;
    }
    moved.select(jn, jn_old).store(&mut point.jn);
    moved.select(jt, jt_old).store(&mut point.jt);
    Some([moved.select(dn, none), moved.select(dt, none)])
}

/// The change of the bias impulse; `None` where the point is content.
#[inline(always)]
fn resist_bias<R: Register, const N: usize>(point: &mut Point, speed: Wide<R, N>) -> Option<Wide<R, N>> {
    let (none, old) = (Wide::all(0.0), Wide::load(&point.jb));
    let new = (old + (Wide::load(&point.bias) - speed) * Wide::load(&point.normal_mass)).above(none);
    let moved = (Wide::all(CONTENT) * new).less((new - old).size());
    if !moved.any() {
        return None;
    }
    moved.select(new, old).store(&mut point.jb);
    Some(moved.select(new - old, none))
}

/// Arms of a point.
struct Arm<R, const N: usize> {
    first: [Wide<R, N>; 2],
    second: [Wide<R, N>; 2],
}

impl<R: Register, const N: usize> Arm<R, N> {
    #[inline(always)]
    fn of(point: &Point) -> Self {
        Arm {
            first: [Wide::load(&point.first[0]), Wide::load(&point.first[1])],
            second: [Wide::load(&point.second[0]), Wide::load(&point.second[1])],
        }
    }
}

/// Speeds of two bodies, or of one and of what never moves, with how loose they are.
struct Both<R, const N: usize> {
    first: Loose<R, N>,
    second: Option<Loose<R, N>>,
}

#[derive(Clone, Copy)]
struct Loose<R, const N: usize> {
    vx: Wide<R, N>,
    vy: Wide<R, N>,
    omega: Wide<R, N>,
    inv_mass: Wide<R, N>,
    inv_inertia: Wide<R, N>,
}

impl<R: Register, const N: usize> Both<R, N> {
    #[inline(always)]
    fn of(bodies: &[BodyLanes], frames: &[Frame], [first, other]: [usize; 2]) -> Self {
        let second =
            if other < bodies.len() { Some(Loose::of(&bodies[other], &frames[other])) } else { None };
        Both { first: Loose::of(&bodies[first], &frames[first]), second }
    }

    /// The same bodies with their bias speeds.
    #[inline(always)]
    fn biased(&self, bodies: &[BodyLanes], frames: &[Frame], [first, other]: [usize; 2]) -> Self {
        let second = match self.second {
            Some(own) => Some(own.biased(&bodies[other], &frames[other])),
            None => None,
        };
        Both { first: self.first.biased(&bodies[first], &frames[first]), second }
    }

    /// Speeds of the second against the first at a point: along the normal, and across it.
    #[inline(always)]
    fn speeds(&self, arm: &Arm<R, N>, [nx, ny]: [Wide<R, N>; 2]) -> [Wide<R, N>; 2] {
        let [ax, ay] = self.first.at(&arm.first);
        let [x, y] = match &self.second {
            Some(b) => {
                let [bx, by] = b.at(&arm.second);
                [bx - ax, by - ay]
            }
            None => [ax.minus(), ay.minus()],
        };
        [x * nx + y * ny, y * nx - x * ny]
    }

    /// An impulse on the second, and in reverse on the first.
    #[inline(always)]
    fn push(
        &mut self,
        arm: &Arm<R, N>,
        [nx, ny]: [Wide<R, N>; 2],
        normal: Wide<R, N>,
        tangential: Wide<R, N>,
    ) {
        let (x, y) = (nx * normal - ny * tangential, ny * normal + nx * tangential);
        let a = &mut self.first;
        a.vx = a.vx - x * a.inv_mass;
        a.vy = a.vy - y * a.inv_mass;
        a.omega = a.omega - (arm.first[0] * y - arm.first[1] * x) * a.inv_inertia;
        if let Some(b) = &mut self.second {
            b.vx = b.vx + x * b.inv_mass;
            b.vy = b.vy + y * b.inv_mass;
            b.omega = b.omega + (arm.second[0] * y - arm.second[1] * x) * b.inv_inertia;
        }
    }

    #[inline(always)]
    fn store(&self, bodies: &mut [BodyLanes], [first, other]: [usize; 2]) {
        self.first.store(&mut bodies[first]);
        if let Some(b) = &self.second {
            b.store(&mut bodies[other]);
        }
    }

    #[inline(always)]
    fn store_biases(&self, bodies: &mut [BodyLanes], frames: &mut [Frame], [first, other]: [usize; 2]) {
        self.first.store_bias(&mut bodies[first], &mut frames[first]);
        if let Some(b) = &self.second {
            b.store_bias(&mut bodies[other], &mut frames[other]);
        }
    }
}

impl<R: Register, const N: usize> Loose<R, N> {
    #[inline(always)]
    fn of(body: &BodyLanes, frame: &Frame) -> Self {
        Loose {
            vx: Wide::load(&body.moving.vx),
            vy: Wide::load(&body.moving.vy),
            omega: Wide::load(&body.moving.omega),
            inv_mass: Wide::load(&body.inv_mass),
            inv_inertia: Wide::load(&frame.inv_inertia),
        }
    }

    #[inline(always)]
    fn biased(self, body: &BodyLanes, frame: &Frame) -> Self {
        let (vx, vy) = (Wide::load(&body.bias_x), Wide::load(&body.bias_y));
        Loose { vx, vy, omega: Wide::load(&frame.bias_omega), ..self }
    }

    /// Velocity at the end of an arm, m/s.
    #[inline(always)]
    fn at(&self, arm: &[Wide<R, N>; 2]) -> [Wide<R, N>; 2] {
        [self.vx - self.omega * arm[1], self.vy + self.omega * arm[0]]
    }

    #[inline(always)]
    fn store(&self, body: &mut BodyLanes) {
        self.vx.store(&mut body.moving.vx);
        self.vy.store(&mut body.moving.vy);
        self.omega.store(&mut body.moving.omega);
    }

    #[inline(always)]
    fn store_bias(&self, body: &mut BodyLanes, frame: &mut Frame) {
        self.vx.store(&mut body.bias_x);
        self.vy.store(&mut body.bias_y);
        self.omega.store(&mut frame.bias_omega);
    }
}
