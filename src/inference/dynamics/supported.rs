//! A body that a straight surface supports: it slides under Coulomb friction until centre and rim have the same speed, and
//! rolls from there if friction suffices. A block is a body that cannot turn: it slides until it rests.
//!
//! Source: Coulomb friction and rolling: Goldstein, Poole and Safko, Classical Mechanics (2002), 1.6.
//!
//! Differences from the source: the load is that of the surface's mean normal; kinetic and static friction are equal.

use crate::inference::segment::Surface;

/// x, y, vx, vy, omega
pub type PlanarState = [f64; 5];

/// Slip below which a body rolls, m/s.
const ROLLING_SLIP: f64 = 1e-9;
/// Maximum number of changes between slipping, rolling and rest in a step.
const MAX_CHANGES: usize = 4;

/// Motion of a body along a surface.
#[derive(Clone, Copy)]
pub struct SupportedBody {
    /// Origin of the distance, m.
    origin: [f64; 2],
    normal: [f64; 2],
    radius: f64,
    /// Moment of inertia over mass and radius squared; infinite for a block.
    inertia: f64,
    /// Infinite for a body that rolls without slip.
    friction: f64,
    /// Along (ny, -nx), m and m/s; `rim`: speed at which a disc of that spin would roll.
    distance: f64,
    speed: f64,
    rim: f64,
    /// Offset of the surface, m, and its slope.
    height: f64,
    slope: f64,
}

/// Accelerations along the surface: of the centre and of the rim, m/s^2.
type Rates = [f64; 2];

impl SupportedBody {
    /// From friction, moment of inertia over mass and radius squared, the first observed position, and the nuisances of a rolling
    /// segment, or of a sliding one, which has the spin in addition.
    pub fn new(
        surface: &Surface,
        [friction, inertia]: [f64; 2],
        first: [f64; 2],
        nuisances: &[f64],
    ) -> Option<SupportedBody> {
        let [distance, speed, height, slope, ref spin @ ..] = *nuisances else { return None };
        let &Surface { normal, radius, .. } = surface;
        let rim = match spin.first() {
            Some(omega) => -radius * omega,
            None if inertia.is_infinite() => 0.0,
            None => speed,
        };
        Some(SupportedBody {
            origin: first,
            normal,
            radius,
            inertia,
            friction,
            distance,
            speed,
            rim,
            height,
            slope,
        })
    }

    /// A disc that touches a surface in a state.
    pub fn touching(surface: &Surface, [friction, inertia]: [f64; 2], at: &PlanarState) -> SupportedBody {
        let (n, radius) = (surface.normal, surface.radius);
        SupportedBody {
            origin: [at[0], at[1]],
            normal: n,
            radius,
            inertia,
            friction,
            distance: 0.0,
            speed: at[2] * n[1] - at[3] * n[0],
            rim: -radius * at[4],
            height: 0.0,
            slope: 0.0,
        }
    }

    /// Current state.
    pub fn body(&self) -> PlanarState {
        let n = self.normal;
        let up = self.height + self.slope * self.distance;
        [
            self.origin[0] + self.distance * n[1] + up * n[0],
            self.origin[1] - self.distance * n[0] + up * n[1],
            self.speed * n[1],
            -self.speed * n[0],
            -self.rim / self.radius,
        ]
    }

    /// Step of `h` seconds. `acceleration`: of a free body, m/s^2, rad/s^2; `resistance`: deceleration of a rolling body under a
    /// load, both m/s^2.
    pub fn advance(
        &mut self,
        h: f64,
        acceleration: impl Fn(&PlanarState) -> [f64; 3],
        resistance: Option<impl Fn(f64) -> f64>,
    ) {
        let mut left = h;
        // A step has few changes: it stops slipping, and comes to rest.
        for number in 0..=MAX_CHANGES {
            let slips = self.slipping(&acceleration);
            let middle = self.moved(0.5 * left, self.rates(slips, &acceleration, resistance.as_ref()));
            let rates = middle.rates(slips, &acceleration, resistance.as_ref());
            // Time until the slip ends, or a rolling body that is held back rests.
            let change = match slips {
                0.0 if resistance.is_some() => -self.speed / rates[0],
                0.0 => f64::INFINITY,
                _ => -self.slip() / (rates[0] - rates[1]),
            };
            let changes = change > 0.0 && change <= left && number < MAX_CHANGES;
            let step = if changes { change } else { left };
            *self = self.moved(step, rates);
            if changes && (slips == 0.0 || self.inertia.is_infinite()) {
                self.speed = 0.0;
            }
            if changes || slips == 0.0 {
                self.rim = self.speed;
            }
            left -= step;
            if left <= 0.0 {
                return;
            }
        }
    }

    /// Speed of the body's side of the contact along the surface, m/s; 0 if it rolls or rests.
    fn slip(&self) -> f64 {
        let slip = self.speed - self.rim;
        if slip.abs() < ROLLING_SLIP { 0.0 } else { slip }
    }

    /// Sign of the slip, or of the slip that begins because friction does not suffice; 0 if the body rolls or rests.
    fn slipping(&self, acceleration: impl Fn(&PlanarState) -> [f64; 3]) -> f64 {
        let slip = self.slip();
        if slip != 0.0 {
            return slip.signum();
        }
        let forces = self.forces(acceleration);
        let grips = self.friction.is_infinite() || forces.holding().abs() <= self.friction * forces.load;
        if grips { 0.0 } else { -forces.holding().signum() }
    }

    fn moved(&self, h: f64, [centre, rim]: Rates) -> SupportedBody {
        SupportedBody {
            distance: self.distance + h * (self.speed + 0.5 * h * centre),
            speed: self.speed + h * centre,
            rim: self.rim + h * rim,
            ..*self
        }
    }

    /// Accelerations while the body slips in the direction `slips`; 0: while it rolls or rests.
    fn rates(
        &self,
        slips: f64,
        acceleration: impl Fn(&PlanarState) -> [f64; 3],
        resistance: Option<&impl Fn(f64) -> f64>,
    ) -> Rates {
        let forces = self.forces(acceleration);
        let friction = if slips == 0.0 { forces.holding() } else { -slips * self.friction * forces.load };
        let rates = [forces.along + friction, forces.turned - friction / self.inertia];
        let held = resistance.map_or(0.0, |r| r(forces.load));
        if slips != 0.0 || held == 0.0 {
            return rates;
        }
        // Static resistance holds a rolling body at rest.
        if self.speed == 0.0 && rates[0].abs() <= held {
            return [0.0; 2];
        }
        let against = if self.speed == 0.0 { rates[0].signum() } else { self.speed.signum() };
        rates.map(|r| r - against * held)
    }

    fn forces(&self, acceleration: impl Fn(&PlanarState) -> [f64; 3]) -> Forces {
        let a = acceleration(&self.body());
        Forces {
            along: a[0] * self.normal[1] - a[1] * self.normal[0],
            load: -(a[0] * self.normal[0] + a[1] * self.normal[1]).min(0.0),
            turned: if self.inertia.is_infinite() { 0.0 } else { -a[2] * self.radius },
            inertia: self.inertia,
        }
    }
}

/// Forces on a body without friction, per mass, m/s^2.
struct Forces {
    along: f64,
    /// Towards the surface.
    load: f64,
    /// Acceleration of the rim.
    turned: f64,
    inertia: f64,
}

impl Forces {
    /// Friction that keeps a slip of zero.
    fn holding(&self) -> f64 {
        (self.turned - self.along) / (1.0 + self.inertia.recip())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const INERTIA: f64 = 0.5;

    fn surface() -> Surface {
        Surface {
            static_index: 0,
            normal: [0.6, 0.8],
            level: 0.0,
            friction: [1.0; 2],
            restitution: [0.0; 2],
            carries_latents: [false; 2],
            radius: 0.1,
            inertia: INERTIA,
            corner: None,
            angle_prior_sd: 0.0,
            spin_prior_sd: 0.0,
        }
    }

    /// A rolling disc of inertia 1/2 on a slope of 3/4.
    fn disc(speed: f64) -> SupportedBody {
        let nuisances = [0.0, speed, 0.0, 0.0];
        SupportedBody::new(&surface(), [f64::INFINITY, INERTIA], [5.0, 2.0], &nuisances).unwrap()
    }

    fn moved(mut body: SupportedBody, seconds: f64, resistance: f64) -> PlanarState {
        for _ in 0..1000 {
            body.advance(1e-3 * seconds, |_| [0.0, -9.81, 0.0], Some(|load: f64| resistance * load));
        }
        body.body()
    }

    /// It accelerates at two thirds of a frictionless disc, without slip.
    #[test]
    fn discs_roll_at_two_thirds_of_frictionless_acceleration() {
        let (a, t) = (9.81 * 0.6 * 2.0 / 3.0, 1.5);
        let [x, y, vx, vy, omega] = moved(disc(0.0), t, 0.0);
        let way = 0.5 * a * t * t;
        let off = [
            x - 5.0 - 0.8 * way,
            y - 2.0 + 0.6 * way,
            vx - 0.8 * a * t,
            vy + 0.6 * a * t,
            omega + 10.0 * a * t,
        ];
        assert!(off.iter().all(|o| o.abs() < 1e-9), "{off:?}");
    }

    /// Regression test: infinite friction times no load, as of a disc that rolls along a wall seen from above, is no number.
    #[test]
    fn discs_roll_without_load() {
        let mut along_wall = disc(1.5);
        along_wall.advance(0.2, |_| [0.0; 3], None::<fn(f64) -> f64>);
        assert!(
            (along_wall.distance - 0.3).abs() < 1e-12 && along_wall.speed == 1.5 && along_wall.rim == 1.5
        );
    }

    /// Regression test: a disc that stops on a slope is held by resistance.
    #[test]
    fn resistance_holds_a_disc_at_rest() {
        let up = moved(disc(-0.01), 0.5, 2.0);
        assert_eq!((up[2], up[3], up[4]), (0.0, 0.0, 0.0));
        assert!(moved(disc(-0.01), 0.5, 0.0)[2] > 0.0, "nothing holds it: it rolls back");
    }

    /// A body of 2 m/s on level ground with friction 0.2, in a few large steps: a disc slides for v / (3 mu g) and rolls with two
    /// thirds of its speed; a block rests after v / (mu g).
    #[test]
    fn bodies_slide_until_they_roll_or_rest() {
        let level = Surface { normal: [0.0, 1.0], ..surface() };
        let (v, mu, g) = (2.0, 0.2, 9.81);
        let state = |inertia: f64, nuisances: &[f64], seconds: f64| {
            let mut body = SupportedBody::new(&level, [mu, inertia], [0.0; 2], nuisances).unwrap();
            (0..20).for_each(|_| body.advance(seconds / 20.0, |_| [0.0, -g, 0.0], None::<fn(f64) -> f64>));
            body.body()
        };
        let sliding = v / (3.0 * mu * g);
        let [x, _, vx, _, omega] = state(INERTIA, &[0.0, v, 0.0, 0.0, 0.0], 1.0);
        let way = v * sliding - 0.5 * mu * g * sliding * sliding + 2.0 / 3.0 * v * (1.0 - sliding);
        assert!((x - way).abs() < 1e-9 && (vx - 2.0 / 3.0 * v).abs() < 1e-9, "{x} {vx}");
        assert!((omega + vx / 0.1).abs() < 1e-9);
        let [x, _, vx, ..] = state(f64::INFINITY, &[0.0, v, 0.0, 0.0], 2.0);
        assert!((x - v * v / (2.0 * mu * g)).abs() < 1e-9 && vx == 0.0, "{x} {vx}");
    }

    /// On a slope of 3/4 a disc needs friction 1/4 to roll, and a block 3/4 to rest.
    #[test]
    fn steep_slopes_make_bodies_slip() {
        let along = |inertia: f64, mu: f64| {
            let mut body = SupportedBody::new(&surface(), [mu, inertia], [0.0; 2], &[0.0; 4]).unwrap();
            (0..10).for_each(|_| body.advance(0.1, |_| [0.0, -9.81, 0.0], None::<fn(f64) -> f64>));
            body.speed
        };
        assert!((along(INERTIA, 0.2) - 9.81 * (0.6 - 0.2 * 0.8)).abs() < 1e-9);
        assert!((along(INERTIA, 0.3) - 9.81 * 0.4).abs() < 1e-9);
        assert!((along(f64::INFINITY, 0.7) - 9.81 * (0.6 - 0.7 * 0.8)).abs() < 1e-9);
        assert_eq!(along(f64::INFINITY, 0.8), 0.0);
    }
}
