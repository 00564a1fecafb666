//! A disc that falls on a surface and stays there: it bounces until its bounces are too low to be seen, and slides or rolls from
//! there.
//!
//! The classical Runge-Kutta method of fourth order.

use super::integrator::{find_root, state_from_nuisances};
use super::physics::{Impact, MAX_STEPS, SegmentPhysics};
use super::supported::{PlanarState, SupportedBody};

/// Speed away from the surface below which a disc stays on it, m/s: a bounce of 0.05 mm on Earth.
const SETTLING_SPEED: f64 = 0.03;
const MAX_IMPACTS: usize = 50;

impl SegmentPhysics<'_> {
    /// Passes the state at every observation of a landing segment to `visit`; the first impact.
    pub(super) fn land(
        &self,
        nuisances: &[f64],
        mut visit: impl FnMut(usize, PlanarState),
    ) -> Option<Impact> {
        let points = &self.segment.observations;
        let surface = self.segment.surface.as_ref()?;
        let offset = nuisances.get(5).copied().unwrap_or(0.0);
        let mut at = state_from_nuisances(nuisances);
        let mut time = self.true_time(points.first()?.time);
        let (mut first, mut impacts, mut supported): (Option<Impact>, usize, Option<SupportedBody>) =
            (None, 0, None);
        let longest = self.max_step_from(&at).min(MAX_STEPS[1]);
        for (i, point) in points.iter().enumerate() {
            let until = self.true_time(point.time);
            while time < until {
                let h = (until - time).min(longest);
                if let Some(body) = &mut supported {
                    body.advance(h, |s| self.acceleration(time, s), self.rolling_resistance());
                    at = body.body();
                    time += h;
                    continue;
                }
                let next = self.runge_kutta(time, &at, h);
                if !(surface.is_below(&next, offset) && surface.is_approached(&next)) || impacts > MAX_IMPACTS
                {
                    (at, time) = (next, time + h);
                    continue;
                }
                let step = h * find_root(|share| {
                    let s = self.runge_kutta(time, &at, share * h);
                    [surface.height(&s, offset), h * surface.normal_velocity(&s)]
                });
                let (after, impact) =
                    self.resolve_impact(time + step, self.runge_kutta(time, &at, step), surface);
                (at, time) = (after, time + step);
                first = first.or(Some(impact));
                impacts += 1;
                if surface.normal_velocity(&at) < SETTLING_SPEED {
                    supported = Some(SupportedBody::touching(surface, [self.friction, self.inertia], &at));
                }
            }
            visit(i, at);
        }
        first
    }

    fn runge_kutta(&self, time: f64, at: &PlanarState, h: f64) -> PlanarState {
        let slope = |t: f64, s: &PlanarState| -> PlanarState {
            let [ax, ay, spin] = self.acceleration(t, s);
            [s[2], s[3], ax, ay, spin]
        };
        let moved = |by: &PlanarState, h: f64| -> PlanarState { std::array::from_fn(|k| at[k] + h * by[k]) };
        let k1 = slope(time, at);
        let k2 = slope(time + 0.5 * h, &moved(&k1, 0.5 * h));
        let k3 = slope(time + 0.5 * h, &moved(&k2, 0.5 * h));
        let k4 = slope(time + h, &moved(&k3, h));
        std::array::from_fn(|k| at[k] + h / 6.0 * (k1[k] + 2.0 * k2[k] + 2.0 * k3[k] + k4[k]))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::inference::segment::{Segment, SegmentKind};
    use crate::inference::testing::segments::bounces;
    use crate::world::Latents;
    use crate::world::effect::find;

    fn landing() -> Segment {
        let (segments, _) = bounces(0.8, 1);
        let contact = segments.into_iter().find(|w| w.kind == SegmentKind::Contact).expect("one bounce");
        Segment { kind: SegmentKind::Landing, ..contact }
    }

    fn heights(segment: &Segment, threshold: f64) -> Vec<f64> {
        let effect = find("restitution_threshold").unwrap();
        let physics = SegmentPhysics::new(segment, &[(effect, &[threshold])], &Latents::default());
        let mut out = Vec::new();
        physics.land(&segment.nuisances, |_, s| out.push(segment.surface.as_ref().unwrap().height(&s, 0.0)));
        out
    }

    /// Below the threshold the disc stays on the surface; above it the trajectory is that of a bounce.
    #[test]
    fn slow_discs_stay_on_the_surface() {
        let segment = landing();
        let [bounced, stayed] = [0.0, 100.0].map(|threshold| heights(&segment, threshold));
        let lowest = stayed.iter().position(|h| *h < 1e-9).expect("it lands");
        assert!(stayed[lowest..].iter().all(|h| h.abs() < 1e-9), "{stayed:?}");
        assert!(bounced[lowest + 1..].iter().all(|h| *h > 1e-3), "{bounced:?}");
        let contact = Segment { kind: SegmentKind::Contact, ..segment.clone() };
        let physics = SegmentPhysics::new(&contact, &[], &Latents::default());
        let expected = physics.predict_positions(&contact.nuisances, |_, _| ());
        let physics = SegmentPhysics::new(&segment, &[], &Latents::default());
        let own = physics.predict_positions(&segment.nuisances, |_, _| ());
        assert!(own.iter().zip(&expected).all(|(a, b)| (a - b).abs() < 1e-6));
    }
}
