//! Batched integration of one segment's trajectories for many nearly equal initial conditions and parameters.
//!
//! The classical Runge-Kutta method of fourth order with dense output by quintic Hermite interpolation of
//! position, velocity and acceleration. Steps are uniform if all laws are smooth; otherwise they end at
//! observations. An impact is located on the interpolant, and integration restarts there. All trajectories
//! take as many steps as the first, so that difference quotients are those of one smooth map.

use std::array::from_fn;

use super::physics::{Impact, KICK_DURATION, SegmentPhysics};
use super::supported::PlanarState;

use crate::inference::segment::{SegmentKind, Surface};
use crate::world::effect::{
    Effect, EffectKind, LANES, MAX_PARAMETERS, MotionLaw, MotionStateLanes, SimulationContext,
};

/// Maximum number of iterations for the impact time; bisection alone gives a picosecond.
const MAX_ROOT_ITERATIONS: usize = 40;

pub(super) type LaneValues = [f64; LANES];
/// x, y, vx, vy, omega by lane.
type PlanarStateLanes = [LaneValues; 5];

/// Physics and nuisances that define a trajectory.
pub type InitialCondition<'a, 'b> = (&'b SegmentPhysics<'a>, &'b [f64]);

/// Passes the state at every observation to `visit` (trajectory, observation, state), and returns the
/// impacts. All trajectories belong to one segment, and either all laws are smooth or all may have edges.
pub fn integrate(
    paths: &[InitialCondition],
    visit: &mut dyn FnMut(usize, usize, PlanarState),
) -> Vec<Option<Impact>> {
    let mut steps = [None; 2];
    let longest = paths
        .first()
        .map_or(f64::INFINITY, |(physics, start)| physics.max_step_from(&state_from_nuisances(start)));
    let mut impacts = Vec::with_capacity(paths.len());
    for (first, group) in paths.chunks(LANES).enumerate().map(|(g, group)| (g * LANES, group)) {
        let (flight, met) = BatchedIntegrator::of(group, longest).dense_trajectory(&mut steps);
        for (lane, (physics, _)) in group.iter().enumerate() {
            let mut places = [0; 2];
            for (i, point) in physics.segment.observations.iter().enumerate() {
                visit(first + lane, i, flight.at(lane, physics.true_time(point.time), &mut places));
            }
        }
        impacts.extend(met.into_iter().take(group.len()));
    }
    impacts
}

/// Initial state from nuisances.
pub(super) fn state_from_nuisances(nuisances: &[f64]) -> PlanarState {
    match nuisances {
        [x, y, vx, vy, rest @ ..] => [*x, *y, *vx, *vy, rest.first().copied().unwrap_or(0.0)],
        _ => [f64::NAN; 5],
    }
}

/// Up to [`LANES`] trajectories; unused lanes repeat the first.
pub(super) struct BatchedIntegrator<'a, 'b> {
    pub(super) paths: [InitialCondition<'a, 'b>; LANES],
    laws: Vec<(&'static dyn MotionLaw, [LaneValues; MAX_PARAMETERS])>,
    gravity: [f64; 2],
    /// Longest step, s.
    max_step: f64,
}

/// A trajectory up to an impact and after it.
pub(super) struct DenseTrajectory {
    pub(super) arcs: [SmoothArc; 2],
    /// Impact times; infinite without impact.
    pub(super) impact_times: LaneValues,
}

/// Integration steps between times, with their interpolants.
#[derive(Default)]
pub(super) struct SmoothArc {
    pub(super) times: Vec<LaneValues>,
    polynomials: Vec<HermitePolynomial>,
}

/// Impact of a lane: time, state after it, and kinematics.
type SurfaceEvent = Option<(f64, PlanarState, Impact)>;

/// An integration step with its end points.
pub(super) struct IntegrationStep<'s> {
    now: &'s LaneValues,
    h: LaneValues,
    bodies: &'s PlanarStateLanes,
    slope: &'s PlanarStateLanes,
    next: &'s PlanarStateLanes,
    piece: &'s HermitePolynomial,
}

/// Coefficients of the interpolating polynomials in the fraction of a step: of x and y, and of the spin.
pub(super) struct HermitePolynomial {
    place: [[LaneValues; 6]; 2],
    spin: [LaneValues; 4],
}

impl<'a, 'b> BatchedIntegrator<'a, 'b> {
    pub(super) fn of(group: &[InitialCondition<'a, 'b>], max_step: f64) -> BatchedIntegrator<'a, 'b> {
        let paths: [InitialCondition; LANES] = from_fn(|lane| *group.get(lane).unwrap_or(&group[0]));
        let gravity = paths[0].0.segment.scene.gravity;
        // A law that is inactive in some lanes has neutral values there, which change nothing.
        let mut known: Vec<(usize, &'static Effect)> = Vec::new();
        for acting in paths.iter().flat_map(|p| &p.0.motion_laws) {
            let (place, effect) = (acting.place, acting.effect);
            if !known.iter().any(|k| k.0 == place && k.1.name == effect.name) {
                known.push((place, effect));
            }
        }
        known.sort_by_key(|k| k.0);
        let law = |(place, effect): (usize, &'static Effect)| {
            let EffectKind::Motion(law) = effect.kind else { return None };
            let own = |(physics, _): &InitialCondition| {
                let acting =
                    physics.motion_laws.iter().find(|m| m.place == place && m.effect.name == effect.name);
                acting.map_or_else(
                    || {
                        let neutral: Vec<f64> = effect.parameters.iter().map(|p| p.neutral).collect();
                        law.constants(&neutral, &SimulationContext { time_step: KICK_DURATION, gravity })
                    },
                    |m| m.constants,
                )
            };
            let constants: [_; LANES] = from_fn(|lane| own(&paths[lane]));
            Some((law, from_fn(|c| from_fn(|lane| constants[lane][c]))))
        };
        BatchedIntegrator { paths, laws: known.into_iter().filter_map(law).collect(), gravity, max_step }
    }

    /// The trajectory and its impacts. `steps`: numbers of steps before and after the impact, set by the
    /// first batch.
    fn dense_trajectory(&self, steps: &mut [Option<usize>; 2]) -> (DenseTrajectory, [Option<Impact>; LANES]) {
        let segment = self.paths[0].0.segment;
        let start: [PlanarState; LANES] = from_fn(|lane| state_from_nuisances(self.paths[lane].1));
        let mut events: [SurfaceEvent; LANES] = [None; LANES];
        let surface = segment.surface.as_ref().filter(|_| segment.kind == SegmentKind::Contact);
        let surfaces = surface.map(|s| self.paths.map(|(_, nuisances)| s.with_angle(nuisances)));
        let from = self.true_times(segment.observations.first().map_or(0.0, |p| p.time));
        let first = self.integrate_arc(self.step_times(&from, &mut steps[0]), &start, |step| {
            let Some(surfaces) = &surfaces else { return true };
            for (lane, events) in events.iter_mut().enumerate().filter(|(_, events)| events.is_none()) {
                *events = self.surface_event(step, lane, &surfaces[lane]);
            }
            events.iter().any(Option::is_none)
        });
        let met: LaneValues = from_fn(|lane| events[lane].map_or(f64::INFINITY, |o| o.0));
        let mut second = SmoothArc::default();
        if events.iter().any(Option::is_some) {
            let until = first.times.last().copied().unwrap_or(from);
            let from: LaneValues = from_fn(|lane| events[lane].map_or(until[lane], |o| o.0));
            let start: [PlanarState; LANES] = from_fn(|lane| events[lane].map_or(start[lane], |o| o.1));
            second = self.integrate_arc(self.step_times(&from, &mut steps[1]), &start, |_| true);
        }
        (DenseTrajectory { arcs: [first, second], impact_times: met }, events.map(|o| o.map(|o| o.2)))
    }

    /// True times by lane of a time since the segment's start, s.
    pub(super) fn true_times(&self, time: f64) -> LaneValues {
        from_fn(|lane| self.paths[lane].0.true_time(time))
    }

    /// Ends of the steps from some times to the last observation: uniform steps (counted if `steps` is
    /// `None`), or steps that end at every observation.
    fn step_times(&self, from: &LaneValues, steps: &mut Option<usize>) -> Vec<LaneValues> {
        let lead = self.paths[0].0;
        let points = &lead.segment.observations;
        let count = |from: f64, until: f64| ((until - from) / self.max_step).ceil().max(1.0) as usize;
        let mut out = vec![*from];
        let mut on = |until: &LaneValues, count: usize| {
            let last = out[out.len() - 1];
            out.extend((1..=count).map(|k| -> LaneValues {
                from_fn(|lane| last[lane] + (until[lane] - last[lane]) * (k as f64 / count as f64))
            }));
        };
        if lead.is_smooth() {
            let until = self.true_times(points.last().map_or(0.0, |p| p.time));
            on(&until, *steps.get_or_insert_with(|| count(from[0], until[0])));
            return out;
        }
        for pair in points.windows(2) {
            let [before, after] = [pair[0].time, pair[1].time].map(|time| self.true_times(time));
            if from.iter().zip(&after).any(|(from, after)| from < after) {
                // Lanes that start within the interval take shorter steps; those that start later have steps
                // of length zero.
                let until: LaneValues = from_fn(|lane| after[lane].max(from[lane]));
                on(&until, count(before[0], after[0]));
            }
        }
        if out.len() < 2 {
            out.push(*from);
        }
        out
    }

    /// Integrates between times until `goes_on` returns false.
    pub(super) fn integrate_arc(
        &self,
        times: Vec<LaneValues>,
        start: &[PlanarState; LANES],
        mut goes_on: impl FnMut(&IntegrationStep) -> bool,
    ) -> SmoothArc {
        let mut bodies: PlanarStateLanes = from_fn(|k| from_fn(|lane| start[lane][k]));
        let mut slope = self.derivative(&times[0], &bodies);
        let mut pieces = Vec::with_capacity(times.len());
        for pair in times.windows(2) {
            let [now, then] = [&pair[0], &pair[1]];
            let h: LaneValues = from_fn(|lane| then[lane] - now[lane]);
            let next = self.runge_kutta_step(now, &bodies, &slope, &h);
            let beyond = self.derivative(then, &next);
            let piece = HermitePolynomial::between([&bodies, &next], [&slope, &beyond], &h);
            let on = goes_on(&IntegrationStep {
                now,
                h,
                bodies: &bodies,
                slope: &slope,
                next: &next,
                piece: &piece,
            });
            pieces.push(piece);
            if !on {
                break;
            }
            (bodies, slope) = (next, beyond);
        }
        SmoothArc { times, polynomials: pieces }
    }

    /// The impact of a lane within a step, if there is one.
    fn surface_event(&self, step: &IntegrationStep, lane: usize, surface: &Surface) -> SurfaceEvent {
        let (physics, nuisances) = self.paths[lane];
        let offset = nuisances.get(5).copied().unwrap_or(0.0);
        let h = step.h[lane];
        let touching = |s: &PlanarState, share: f64| {
            surface.touching_state(s, physics.observed_time(step.now[lane] + h * share))
        };
        let next = touching(&from_fn(|k| step.next[k][lane]), 1.0);
        if !(surface.is_below(&next, offset) && surface.is_approached(&next)) {
            return None;
        }
        let body = |share: f64| match physics.is_smooth() {
            true => step.piece.body(lane, share, h),
            // Interpolation is invalid across a discontinuity: integrate instead.
            false => {
                let at = self.runge_kutta_step(step.now, step.bodies, step.slope, &step.h.map(|h| share * h));
                from_fn(|k| at[k][lane])
            }
        };
        let share = find_root(|share| {
            let at = touching(&body(share), share);
            [surface.height(&at, offset), h * surface.normal_velocity(&at)]
        });
        let time = step.now[lane] + h * share;
        let (after, impact) = physics.resolve_impact(time, body(share), surface);
        Some((time, after, impact))
    }

    fn derivative(&self, time: &LaneValues, s: &PlanarStateLanes) -> PlanarStateLanes {
        let mut moving = MotionStateLanes { time: *time, x: s[0], y: s[1], vx: s[2], vy: s[3], omega: s[4] };
        for (law, constants) in &self.laws {
            law.kick_lanes(constants, &mut moving, KICK_DURATION);
        }
        let [gx, gy] = self.gravity;
        let mut out = [s[2], s[3], moving.vx, moving.vy, moving.omega];
        for (gained, (before, g)) in out[2..].iter_mut().zip(s[2..].iter().zip([gx, gy, 0.0])) {
            gained.iter_mut().zip(before).for_each(|(a, v)| *a = (*a - v) / KICK_DURATION + g);
        }
        out
    }

    /// A Runge-Kutta step with known initial derivative.
    fn runge_kutta_step(
        &self,
        time: &LaneValues,
        s: &PlanarStateLanes,
        k1: &PlanarStateLanes,
        h: &LaneValues,
    ) -> PlanarStateLanes {
        let half = h.map(|h| h / 2.0);
        let middle = sum(time, &half);
        let k2 = self.derivative(&middle, &advance(s, k1, &half));
        let k3 = self.derivative(&middle, &advance(s, &k2, &half));
        let k4 = self.derivative(&sum(time, h), &advance(s, &k3, h));
        let mut mean = *k1;
        for (mean, (k2, (k3, k4))) in mean.iter_mut().zip(k2.iter().zip(k3.iter().zip(&k4))) {
            for (mean, (k2, (k3, k4))) in mean.iter_mut().zip(k2.iter().zip(k3.iter().zip(k4))) {
                *mean = *mean + 2.0 * k2 + 2.0 * k3 + k4;
            }
        }
        advance(s, &mean, &h.map(|h| h / 6.0))
    }
}

fn sum(a: &LaneValues, b: &LaneValues) -> LaneValues {
    let mut out = *a;
    out.iter_mut().zip(b).for_each(|(a, b)| *a += b);
    out
}

/// Explicit Euler step of `h` seconds.
fn advance(s: &PlanarStateLanes, slope: &PlanarStateLanes, h: &LaneValues) -> PlanarStateLanes {
    let mut out = *s;
    for (body, slope) in out.iter_mut().zip(slope) {
        body.iter_mut().zip(slope.iter().zip(h)).for_each(|(b, (slope, h))| *b += h * slope);
    }
    out
}

impl SmoothArc {
    /// State of a lane at the fraction `share` of step `k`.
    pub(super) fn state(&self, k: usize, lane: usize, share: f64) -> PlanarState {
        self.polynomials[k].body(lane, share, self.step(k, lane)[1])
    }

    /// Start and length of a lane's step, s.
    pub(super) fn step(&self, k: usize, lane: usize) -> [f64; 2] {
        let now = self.times[k][lane];
        [now, self.times[k + 1][lane] - now]
    }
}

impl DenseTrajectory {
    /// State of a lane at a time. `places`: steps by arc that contained an earlier time.
    pub(super) fn at(&self, lane: usize, time: f64, places: &mut [usize; 2]) -> PlanarState {
        let which = usize::from(time > self.impact_times[lane]);
        let (leg, k) = (&self.arcs[which], &mut places[which]);
        while *k + 1 < leg.polynomials.len() && leg.times[*k + 1][lane] < time {
            *k += 1;
        }
        let [now, h] = leg.step(*k, lane);
        let share = if h > 0.0 { (time - now) / h } else { 0.0 };
        leg.polynomials[*k].body(lane, share, h)
    }
}

impl HermitePolynomial {
    /// Interpolation between the ends of a step of `h` seconds: quintic Hermite of the position, cubic of the
    /// spin.
    fn between(
        [a, b]: [&PlanarStateLanes; 2],
        [from, to]: [&PlanarStateLanes; 2],
        h: &LaneValues,
    ) -> HermitePolynomial {
        let mut out = HermitePolynomial { place: [[[0.0; LANES]; 6]; 2], spin: [[0.0; LANES]; 4] };
        for (k, c) in out.place.iter_mut().enumerate() {
            for (l, h) in h.iter().enumerate() {
                let (v, w) = (h * a[k + 2][l], h * b[k + 2][l]);
                let (f, g) = (h * h * from[k + 2][l], h * h * to[k + 2][l]);
                // Deviations of position, velocity and acceleration at the end from the parabola of the
                // start.
                let (p, q, r) = (b[k][l] - a[k][l] - v - 0.5 * f, w - v - f, g - f);
                (c[0][l], c[1][l], c[2][l]) = (a[k][l], v, 0.5 * f);
                c[3][l] = 10.0 * p - 4.0 * q + 0.5 * r;
                c[4][l] = -15.0 * p + 7.0 * q - r;
                c[5][l] = 6.0 * p - 3.0 * q + 0.5 * r;
            }
        }
        for (l, h) in h.iter().enumerate() {
            let (v, w) = (h * from[4][l], h * to[4][l]);
            let (p, q) = (b[4][l] - a[4][l] - v, w - v);
            (out.spin[0][l], out.spin[1][l]) = (a[4][l], v);
            (out.spin[2][l], out.spin[3][l]) = (3.0 * p - q, q - 2.0 * p);
        }
        out
    }

    /// State of a lane at the fraction `s` of a step of `h` seconds.
    fn body(&self, lane: usize, s: f64, h: f64) -> PlanarState {
        let [x, y] = [0, 1].map(|k| polynomial_value(&self.place[k], lane, s));
        let per_second = if h > 0.0 { 1.0 / h } else { 1.0 };
        let [vx, vy] = [0, 1].map(|k| polynomial_derivative(&self.place[k], lane, s) * per_second);
        [x, y, vx, vy, polynomial_value(&self.spin, lane, s)]
    }
}

/// Root of a height in a step, given its value and slope: Newton's method, safeguarded by bisection.
pub(super) fn find_root(height: impl Fn(f64) -> [f64; 2]) -> f64 {
    let (mut low, mut high) = (0.0, 1.0);
    let mut at = 0.5;
    for _ in 0..MAX_ROOT_ITERATIONS {
        let [value, slope] = height(at);
        if value > 0.0 {
            low = at
        } else {
            high = at
        }
        let newton = at - value / slope;
        let next = if low < newton && newton < high { newton } else { 0.5 * (low + high) };
        if (next - at).abs() < 1e-14 {
            break;
        }
        at = next;
    }
    at
}

/// Value of a lane's polynomial (Horner's method).
fn polynomial_value<const N: usize>(c: &[LaneValues; N], lane: usize, s: f64) -> f64 {
    (0..N).rev().fold(0.0, |sum, i| sum * s + c[i][lane])
}

fn polynomial_derivative<const N: usize>(c: &[LaneValues; N], lane: usize, s: f64) -> f64 {
    (1..N).rev().fold(0.0, |sum, i| sum * s + i as f64 * c[i][lane])
}

#[cfg(test)]
mod tests {
    use super::super::physics::MAX_STEPS;
    use super::*;
    use crate::inference::segment::Segment;
    use crate::inference::testing::segments::{bounces, flights};
    use crate::world::Latents;
    use crate::world::effect::find;

    fn with<'a>(segment: &'a Segment, name: &str, values: &[f64]) -> SegmentPhysics<'a> {
        SegmentPhysics::new(segment, &[(find(name).unwrap(), values)], &Latents::default())
    }

    const LAWS: [(&str, &[f64]); 4] = [
        ("gust", &[2.0, 1.0, 3.0, 0.4]),
        ("lift", &[0.8]),
        ("quadratic_drag", &[0.2]),
        ("time_scale", &[1.01]),
    ];

    /// States by trajectory and observation.
    fn flown(paths: &[InitialCondition]) -> Vec<Vec<PlanarState>> {
        let mut out = vec![Vec::new(); paths.len()];
        integrate(paths, &mut |p, _, body| out[p].push(body));
        out
    }

    /// Large steps agree with short ones, also after an impact.
    #[test]
    fn large_steps_match_short_steps() {
        let ((flights, _), (bounces, _)) = (flights([0.0, 0.0], 1), bounces(0.8, 1));
        let contact = bounces.iter().find(|w| w.kind == SegmentKind::Contact).expect("one bounce");
        for ((name, values), segment) in LAWS.iter().flat_map(|law| [(law, &flights[0]), (law, contact)]) {
            let physics = with(segment, name, values);
            let shorter = SegmentPhysics { max_step: MAX_STEPS[1], ..with(segment, name, values) };
            let paths: [InitialCondition; 2] =
                [(&physics, &segment.nuisances), (&shorter, &segment.nuisances)];
            let [own, expected] = paths.map(|path| flown(&[path]).remove(0));
            for (at, expected) in own.iter().zip(expected) {
                let off = |k: usize| (at[k] - expected[k]).hypot(at[k + 1] - expected[k + 1]);
                assert!(off(0) < 1e-6 && off(2) < 1e-5, "{name}: {} and {}", off(0), off(2));
            }
            let met = paths.map(|path| integrate(&[path], &mut |_, _, _| ())[0]);
            assert!(met.iter().all(|m| m.is_some() == (segment.kind == SegmentKind::Contact)));
            if let [Some(a), Some(b)] = met {
                let off =
                    [a.time - b.time, a.approach - b.approach, a.normal - b.normal, a.tangent - b.tangent];
                assert!(off.iter().all(|o| o.abs() < 1e-6), "{name}: {off:?}");
            }
        }
    }

    /// A trajectory is bitwise the same in any batch.
    #[test]
    fn batching_does_not_change_trajectories() {
        let (segments, _) = bounces(0.8, 1);
        for (segment, step) in segments.iter().flat_map(|w| MAX_STEPS.map(|step| (w, step))) {
            let physics =
                |k: usize| SegmentPhysics { max_step: step, ..with(segment, LAWS[k % 3].0, LAWS[k % 3].1) };
            for (k, (name, _)) in LAWS.iter().take(3).enumerate() {
                // As the first, whose number of steps all take, and beyond the lanes.
                let all: Vec<SegmentPhysics> = (k..k + LANES + 2).map(physics).collect();
                let paths: Vec<InitialCondition> =
                    all.iter().map(|p| (p, segment.nuisances.as_slice())).collect();
                let (together, alone) = (flown(&paths), flown(&paths[..1]));
                assert!(together[0] == alone[0] && together[LANES + 1] == alone[0], "{name}");
            }
        }
    }
}
