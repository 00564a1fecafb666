//! A disc that rolls along a straight surface without slip.

use crate::inference::segment::Surface;

/// x, y, vx, vy, omega
pub type PlanarState = [f64; 5];

/// State of a rolling disc.
#[derive(Clone, Copy)]
pub struct RollingDisc {
    /// Origin of the distance, m.
    origin: [f64; 2],
    normal: [f64; 2],
    radius: f64,
    inertia: f64,
    /// Along (ny, -nx), m and m/s.
    distance: f64,
    speed: f64,
    /// Offset of the surface, m, and its slope.
    height: f64,
    slope: f64,
}

impl RollingDisc {
    /// From the first observed position and the nuisances of a rolling segment.
    pub fn new(surface: &Surface, first: [f64; 2], nuisances: &[f64]) -> Option<RollingDisc> {
        let [way, speed, height, slope] = *nuisances else { return None };
        let &Surface { normal, radius, inertia, .. } = surface;
        Some(RollingDisc { origin: first, normal, radius, inertia, distance: way, speed, height, slope })
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
            -self.speed / self.radius,
        ]
    }

    /// Midpoint step of `h` seconds. `acceleration`: of a free disc, m/s^2, rad/s^2; `resistance`:
    /// deceleration under a load, both m/s^2.
    pub fn advance(
        &mut self,
        h: f64,
        acceleration: impl Fn(&PlanarState) -> [f64; 3],
        resistance: Option<impl Fn(f64) -> f64>,
    ) {
        // Driving acceleration along the surface, and resistance, m/s^2.
        let forces = |way: f64, speed: f64| {
            let at = RollingDisc { distance: way, speed, ..*self };
            let a = acceleration(&at.body());
            let along = a[0] * at.normal[1] - a[1] * at.normal[0];
            // A rolling disc turns against the tangent: centre and spin share one speed.
            let spin = -a[2] * at.radius;
            let load = -(a[0] * at.normal[0] + a[1] * at.normal[1]);
            let held = resistance.as_ref().map_or(0.0, |r| r(load.max(0.0)));
            ((along + at.inertia * spin) / (1.0 + at.inertia), held)
        };
        let slope = |way: f64, speed: f64| {
            let (free, held) = forces(way, speed);
            free - speed.signum() * held
        };
        let (free, held) = forces(self.distance, self.speed);
        if resistance.is_some() && self.speed == 0.0 && free.abs() <= held {
            return;
        }
        let a = free - self.speed.signum() * held;
        let middle = slope(self.distance + 0.5 * h * self.speed, self.speed + 0.5 * h * a);
        let next = self.speed + h * middle;
        // Static resistance holds a disc at rest.
        let stopped = next * self.speed < 0.0 && resistance.is_some();
        self.distance += h * (self.speed + 0.5 * h * middle);
        self.speed = if stopped { 0.0 } else { next };
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A disc of inertia 1/2 on a slope of 3/4.
    fn disc(speed: f64) -> RollingDisc {
        let surface = Surface {
            static_index: 0,
            normal: [0.6, 0.8],
            level: 0.0,
            friction: [1.0; 2],
            restitution: [0.0; 2],
            carries_latents: [false; 2],
            radius: 0.1,
            inertia: 0.5,
            spin_prior_sd: 0.0,
        };
        RollingDisc::new(&surface, [5.0, 2.0], &[0.0, speed, 0.0, 0.0]).unwrap()
    }

    fn rolled(mut disc: RollingDisc, seconds: f64, resistance: f64) -> PlanarState {
        for _ in 0..1000 {
            disc.advance(1e-3 * seconds, |_| [0.0, -9.81, 0.0], Some(|load: f64| resistance * load));
        }
        disc.body()
    }

    /// It accelerates at two thirds of a sliding disc, without slip.
    #[test]
    fn discs_roll_at_two_thirds_of_sliding_acceleration() {
        let (a, t) = (9.81 * 0.6 * 2.0 / 3.0, 1.5);
        let [x, y, vx, vy, omega] = rolled(disc(0.0), t, 0.0);
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

    /// Regression test: a disc that stops on a slope is held by resistance.
    #[test]
    fn resistance_holds_a_disc_at_rest() {
        let up = rolled(disc(-0.01), 0.5, 2.0);
        assert_eq!((up[2], up[3], up[4]), (0.0, 0.0, 0.0));
        assert!(rolled(disc(-0.01), 0.5, 0.0)[2] > 0.0, "nothing holds it: it rolls back");
    }
}
