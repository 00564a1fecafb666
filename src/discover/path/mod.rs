//! How one body moves in a window: through the air, against one surface once, or rolling along it; integrated here in
//! microseconds, since a diagnosis needs a hundred thousand such paths.
//!
//! Effects enter as the registry has them: a law of motion's kick over [`INSTANT`] is its acceleration, a law of contact
//! is asked once at the bounce, a sensor shows each state at the time its clock stands for. `physics` puts them together, `fan` integrates
//! flights, with a bounce on the way or without, `roll` what rolls.
//!
//! Differences from the engines: these are the continuous equations, which engines approach as their step shrinks. A
//! bounce takes no time: normal speed turns by the restitution, slip goes to what the laws of contact ask for as far
//! as friction reaches. Rolling is without slip.

mod fan;
mod physics;
mod roll;

use super::window::SegmentKind;
pub use fan::InitialCondition;
pub use physics::{Impact, KICK_DURATION, SegmentPhysics};
use roll::{PlanarState, RollingDisc};

impl SegmentPhysics<'_> {
    /// Seen positions at the window's points, two numbers each; NaN where the path leaves all bounds. `visit` is given
    /// every true state: index of the point, (x, y, vx, vy).
    pub fn predict_positions(&self, nuisances: &[f64], visit: impl FnMut(usize, [f64; 4])) -> Vec<f64> {
        self.simulate(nuisances, visit).0
    }

    /// What happens in a contact window; `None` if the surface is not met.
    pub fn impact(&self, nuisances: &[f64]) -> Option<Impact> {
        self.simulate(nuisances, |_, _| ()).1
    }

    fn simulate(
        &self,
        nuisances: &[f64],
        mut visit: impl FnMut(usize, [f64; 4]),
    ) -> (Vec<f64>, Option<Impact>) {
        let mut out = Vec::with_capacity(2 * self.window.observations.len());
        let mut show = |i: usize, body: PlanarState| {
            visit(i, [body[0], body[1], body[2], body[3]]);
            out.extend(self.measure(&body));
        };
        if self.window.kind == SegmentKind::Rolling {
            self.roll(nuisances, show);
            return (out, None);
        }
        let impacts = fan::integrate(&[(self, nuisances)], |_, i, body| show(i, body));
        (out, impacts[0])
    }

    /// Hands over the body at every point of a roll.
    fn roll(&self, nuisances: &[f64], mut visit: impl FnMut(usize, PlanarState)) {
        let points = &self.window.observations;
        let (Some(first), Some(surface)) = (points.first(), &self.window.surface) else { return };
        let Some(mut rolling) = RollingDisc::new(surface, first.position, nuisances) else {
            (0..points.len()).for_each(|i| visit(i, [f64::NAN; 5]));
            return;
        };
        let resists = |load: f64| {
            self.contact_laws.iter().map(|(law, c)| law.rolling_loss(c, load * KICK_DURATION)).sum::<f64>()
                / KICK_DURATION
        };
        let resists = (!self.contact_laws.is_empty()).then_some(resists);
        let mut time = self.true_time(first.time);
        let longest = self.max_step_from(&rolling.body());
        for (i, point) in points.iter().enumerate() {
            let until = self.true_time(point.time);
            let count = ((until - time) / longest).ceil().max(1.0);
            let h = (until - time) / count;
            for k in (0..count as usize).filter(|_| h > 1e-12) {
                let now = time + h * k as f64;
                rolling.advance(h, |body| self.acceleration(now, body), resists);
            }
            time = until;
            visit(i, rolling.body());
        }
    }
}

/// What several paths of one window show, as [`Physics::seen`] has it, and what happens in a contact window.
pub fn predict_batch(paths: &[InitialCondition]) -> Vec<(Vec<f64>, Option<Impact>)> {
    if paths.first().is_some_and(|(physics, _)| physics.window.kind == SegmentKind::Rolling) {
        return paths.iter().map(|(physics, nuisances)| physics.simulate(nuisances, |_, _| ())).collect();
    }
    let room =
        |(physics, _): &InitialCondition| (Vec::with_capacity(2 * physics.window.observations.len()), None);
    let mut out: Vec<(Vec<f64>, Option<Impact>)> = paths.iter().map(room).collect();
    for smooth in [true, false] {
        let those: Vec<usize> = (0..paths.len()).filter(|i| paths[*i].0.is_smooth() == smooth).collect();
        let together: Vec<InitialCondition> = those.iter().map(|i| paths[*i]).collect();
        let impacts =
            fan::integrate(&together, |p, _, body| out[those[p]].0.extend(together[p].0.measure(&body)));
        those.iter().zip(impacts).for_each(|(i, impact)| out[*i].1 = impact);
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::discover::fixture::{bounces, flights};
    use crate::discover::window::Segment;
    use crate::world::Latents;
    use crate::world::effect::find;

    fn with<'a>(window: &'a Segment, name: &str, values: &[f64]) -> SegmentPhysics<'a> {
        SegmentPhysics::new(window, &[(find(name).unwrap(), values)], &Latents::default())
    }

    /// Along a straight line without gravity: v = v0 / (1 + k v0 t), x = ln(1 + k v0 t) / k.
    #[test]
    fn quadratic_drag_is_met() {
        let (mut windows, _) = flights([0.0, 9.81], 1);
        windows[0].scene.gravity = [0.0, 0.0];
        let (k, v) = (0.15, 8.0);
        let mut speeds = Vec::new();
        let seen = with(&windows[0], "quadratic_drag", &[k])
            .predict_positions(&[1.0, 2.0, v, 0.0], |_, s| speeds.push(s[2]));
        for (i, t) in windows[0].observations.iter().map(|p| p.time).enumerate() {
            let wanted = 1.0 + libm::log(1.0 + k * v * t) / k;
            let off = [seen[2 * i] - wanted, seen[2 * i + 1] - 2.0, speeds[i] - v / (1.0 + k * v * t)];
            assert!(off.iter().all(|o| o.abs() < 2e-5), "{off:?} at {t}");
        }
    }

    /// A clock that runs fast shows the path of a longer time; a scale shows it larger.
    #[test]
    fn sensors_show_the_path_at_their_time_and_scale() {
        let (windows, _) = flights([0.0, 0.0], 1);
        let (start, last) = ([0.0, 1.0, 3.0, 4.0], windows[0].observations[19].time);
        let show =
            |name, values: &[f64]| with(&windows[0], name, values).predict_positions(&start, |_, _| ())[38];
        assert!((show("position_scale", &[1.1]) - 3.3 * last).abs() < 1e-9);
        assert!((show("time_scale", &[1.1]) - 3.0 * last / 1.1).abs() < 1e-9);
    }

    /// Normal speed turns by the restitution; slip goes as far as friction reaches, and to nothing at most, which leaves a disc
    /// two thirds of its speed.
    #[test]
    fn a_bounce_turns_speed_and_takes_slip() {
        let (mut windows, _) = bounces(0.8, 1);
        let window = windows.iter_mut().find(|w| w.kind == SegmentKind::Contact).expect("one bounce");
        for (friction, kept) in [(0.02, 1.0 - 0.02 * 1.8 * 5.0), (9.0, 2.0 / 3.0)] {
            let surface = window.surface.as_mut().unwrap();
            (surface.friction, surface.restitution) = ([friction, 1.0], [0.8, 1.0]);
            let surface = surface.clone();
            let physics = SegmentPhysics::new(window, &[], &Latents::default());
            // At the surface, 5 m/s down and 1 m/s along.
            let (after, met) = physics.resolve_impact(0.0, [0.0, 0.05, 1.0, -5.0, 0.0], &surface);
            assert!((after[2] - kept).abs() < 1e-6 && (after[3] - 4.0).abs() < 1e-6, "{after:?}");
            assert!((met.approach - 5.0).abs() < 1e-6 && (met.normal - 9.0).abs() < 1e-6);
        }
    }

    /// What leaves a surface at the very moment of meeting it is not held, and nothing breaks.
    #[test]
    fn a_surface_met_while_leaving_holds_nothing() {
        let (windows, _) = bounces(0.8, 1);
        let window = windows.iter().find(|w| w.kind == SegmentKind::Contact).expect("one bounce");
        let surface = window.surface.as_ref().expect("what it bounces off");
        let physics = SegmentPhysics::new(window, &[], &Latents::default());
        let (after, met) = physics.resolve_impact(0.0, [0.0, 0.051, 1.0, 0.5, 0.0], surface);
        assert_eq!((met.approach, met.tangent), (0.0, 0.0));
        assert!(after.iter().all(|v| v.is_finite()));
    }
}
