//! Dynamics of a segment: free flight, one impact, rolling or sliding. Integrated in microseconds, since
//! a diagnosis needs about 10^5 trajectories.
//!
//! The acceleration of a law of motion is its velocity change over [`KICK_DURATION`]; laws of contact act at
//! the bounce; sensors transform states and time. `physics`: laws of a segment; `integrator`: flights with at
//! most one bounce; `landing`: impacts
//! after which a surface supports the body; `collision`: collisions of two bodies; `supported`: rolling and sliding.
//!
//! Differences from the engines: continuous equations, to which engines converge as their time step
//! decreases. An impact is instantaneous, with Newton's restitution and Coulomb friction.

mod collision;
mod integrator;
mod landing;
mod physics;
mod supported;

use crate::inference::segment::SegmentKind;
pub use integrator::InitialCondition;
pub use physics::{Impact, KICK_DURATION, SegmentPhysics};
use supported::{PlanarState, SupportedBody};

impl SegmentPhysics<'_> {
    /// Measured positions at the segment's observations, two numbers each; NaN if the trajectory diverges.
    /// `visit` receives every true state: index of the observation, (x, y, vx, vy).
    pub fn predict_positions(&self, nuisances: &[f64], visit: impl FnMut(usize, [f64; 4])) -> Vec<f64> {
        self.simulate(nuisances, visit).0
    }

    /// Impact of a contact segment; `None` if the surface is not reached.
    pub fn impact(&self, nuisances: &[f64]) -> Option<Impact> {
        self.simulate(nuisances, |_, _| ()).1
    }

    fn simulate(
        &self,
        nuisances: &[f64],
        mut visit: impl FnMut(usize, [f64; 4]),
    ) -> (Vec<f64>, Option<Impact>) {
        let mut out = Vec::with_capacity(2 * self.segment.observations.len());
        let mut show = |i: usize, body: PlanarState| {
            visit(i, [body[0], body[1], body[2], body[3]]);
            out.extend(self.measure(&body));
        };
        let impact = match batch_integrator(self.segment.kind) {
            Some(integrate) => integrate(&[(self, nuisances)], &mut |_, i, body| show(i, body))[0],
            None if self.segment.kind == SegmentKind::Landing => self.land(nuisances, show),
            None => {
                self.move_supported(nuisances, show);
                None
            }
        };
        (out, impact)
    }

    /// Passes the state at every observation of a supported body to `visit`.
    fn move_supported(&self, nuisances: &[f64], mut visit: impl FnMut(usize, PlanarState)) {
        let points = &self.segment.observations;
        let (Some(first), Some(surface)) = (points.first(), &self.segment.surface) else { return };
        let rolls = self.segment.kind == SegmentKind::Rolling;
        let coefficients = [if rolls { f64::INFINITY } else { self.friction }, self.inertia];
        let Some(mut own) = SupportedBody::new(surface, coefficients, first.position, nuisances) else {
            (0..points.len()).for_each(|i| visit(i, [f64::NAN; 5]));
            return;
        };
        let resists = self.rolling_resistance();
        let mut time = self.true_time(first.time);
        let longest = self.max_step_from(&own.body());
        for (i, point) in points.iter().enumerate() {
            let until = self.true_time(point.time);
            let count = ((until - time) / longest).ceil().max(1.0);
            let h = (until - time) / count;
            for k in (0..count as usize).filter(|_| h > 1e-12) {
                let now = time + h * k as f64;
                own.advance(h, |body| self.acceleration(now, body), resists);
            }
            time = until;
            visit(i, own.body());
        }
    }

    /// Deceleration of a rolling disc by its load, both m/s^2; `None` without laws of contact.
    fn rolling_resistance(&self) -> Option<impl Fn(f64) -> f64 + Copy> {
        let lost = |load: f64| -> f64 {
            self.contact_laws.iter().map(|(law, c)| law.rolling_loss(c, load * KICK_DURATION)).sum()
        };
        (!self.contact_laws.is_empty()).then_some(move |load: f64| lost(load) / KICK_DURATION)
    }
}

/// Integrates trajectories of one segment: see [`integrator::integrate`].
type BatchIntegrator =
    fn(&[InitialCondition], &mut dyn FnMut(usize, usize, PlanarState)) -> Vec<Option<Impact>>;

/// The integrator of a kind of segment; `None` if its trajectories are integrated one by one.
fn batch_integrator(kind: SegmentKind) -> Option<BatchIntegrator> {
    match kind {
        SegmentKind::Collision => Some(collision::integrate),
        _ if kind.is_supported() || kind == SegmentKind::Landing => None,
        _ => Some(integrator::integrate),
    }
}

/// Predicted positions and impacts of several trajectories of one segment.
pub fn predict_batch(paths: &[InitialCondition]) -> Vec<(Vec<f64>, Option<Impact>)> {
    let Some((lead, _)) = paths.first() else { return Vec::new() };
    let Some(integrate) = batch_integrator(lead.segment.kind) else {
        return paths.iter().map(|(physics, nuisances)| physics.simulate(nuisances, |_, _| ())).collect();
    };
    let room =
        |(physics, _): &InitialCondition| (Vec::with_capacity(2 * physics.segment.observations.len()), None);
    let mut out: Vec<(Vec<f64>, Option<Impact>)> = paths.iter().map(room).collect();
    for smooth in [true, false] {
        let those: Vec<usize> = (0..paths.len()).filter(|i| paths[*i].0.is_smooth() == smooth).collect();
        let together: Vec<InitialCondition> = those.iter().map(|i| paths[*i]).collect();
        let impacts = integrate(&together, &mut |p, _, body| {
            out[those[p]].0.extend(together[p].0.measure(&body));
        });
        those.iter().zip(impacts).for_each(|(i, impact)| out[*i].1 = impact);
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::inference::segment::Segment;
    use crate::inference::testing::segments::{bounces, flights};
    use crate::world::Latents;
    use crate::world::effect::find;

    fn with<'a>(segment: &'a Segment, name: &str, values: &[f64]) -> SegmentPhysics<'a> {
        SegmentPhysics::new(segment, &[(find(name).unwrap(), values)], &Latents::default())
    }

    /// Exact solution without gravity: v = v0 / (1 + k v0 t), x = ln(1 + k v0 t) / k.
    #[test]
    fn quadratic_drag_is_exact() {
        let (mut segments, _) = flights([0.0, 9.81], 1);
        segments[0].scene.gravity = [0.0, 0.0];
        let (k, v) = (0.15, 8.0);
        let mut speeds = Vec::new();
        let observed = with(&segments[0], "quadratic_drag", &[k])
            .predict_positions(&[1.0, 2.0, v, 0.0], |_, s| speeds.push(s[2]));
        for (i, t) in segments[0].observations.iter().map(|p| p.time).enumerate() {
            let expected = 1.0 + libm::log(1.0 + k * v * t) / k;
            let off =
                [observed[2 * i] - expected, observed[2 * i + 1] - 2.0, speeds[i] - v / (1.0 + k * v * t)];
            assert!(off.iter().all(|o| o.abs() < 2e-5), "{off:?} at {t}");
        }
    }

    /// A fast clock and a length scale change the measured trajectory.
    #[test]
    fn sensors_transform_time_and_position() {
        let (segments, _) = flights([0.0, 0.0], 1);
        let (start, last) = ([0.0, 1.0, 3.0, 4.0], segments[0].observations[19].time);
        let show =
            |name, values: &[f64]| with(&segments[0], name, values).predict_positions(&start, |_, _| ())[38];
        assert!((show("position_scale", &[1.1]) - 3.3 * last).abs() < 1e-9);
        assert!((show("time_scale", &[1.1]) - 3.0 * last / 1.1).abs() < 1e-9);
    }

    /// Restitution reverses the normal speed; friction reduces slip to at least zero, which leaves a disc two
    /// thirds of its speed.
    #[test]
    fn bounces_follow_newton_and_coulomb() {
        let (mut segments, _) = bounces(0.8, 1);
        let segment = segments.iter_mut().find(|w| w.kind == SegmentKind::Contact).expect("one bounce");
        for (friction, used) in [(0.02, 1.0 - 0.02 * 1.8 * 5.0), (9.0, 2.0 / 3.0)] {
            let surface = segment.surface.as_mut().unwrap();
            (surface.friction, surface.restitution) = ([friction, 1.0], [0.8, 1.0]);
            let surface = *surface;
            let physics = SegmentPhysics::new(segment, &[], &Latents::default());
            // Impact at 5 m/s down and 1 m/s along the surface.
            let (after, met) = physics.resolve_impact(0.0, [0.0, 0.05, 1.0, -5.0, 0.0], &surface);
            assert!((after[2] - used).abs() < 1e-6 && (after[3] - 4.0).abs() < 1e-6, "{after:?}");
            assert!((met.approach - 5.0).abs() < 1e-6 && (met.normal - 9.0).abs() < 1e-6);
        }
    }

    /// A body that already separates at contact gets no tangential impulse.
    #[test]
    fn separating_contacts_have_no_tangential_impulse() {
        let (segments, _) = bounces(0.8, 1);
        let segment = segments.iter().find(|w| w.kind == SegmentKind::Contact).expect("one bounce");
        let surface = segment.surface.as_ref().expect("what it bounces off");
        let physics = SegmentPhysics::new(segment, &[], &Latents::default());
        let (after, met) = physics.resolve_impact(0.0, [0.0, 0.051, 1.0, 0.5, 0.0], surface);
        assert_eq!((met.approach, met.tangent), (0.0, 0.0));
        assert!(after.iter().all(|v| v.is_finite()));
    }
}
