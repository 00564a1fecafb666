//! Time alignment of reported velocities.
//!
//! Integrators differ in the order in which they update positions and velocities, and gravity may be applied
//! at another substep than other forces. At equal positions they report velocities that differ by up to one
//! step of acceleration, which in a one-step prediction looks like an error of gravity. The lag can be
//! estimated from smooth motion over two intervals T: x2 - x0 = T/3 (v0 + 4 v1 + v2) + 2 T d (Simpson's
//! rule), with d = g t + (a - g) u for a lag t of gravity and a lag u of all other accelerations.

use crate::error::Result;
use crate::inference::segment::{Segment, SegmentKind};
use crate::inference::statistics::median;
use crate::progress::Progress;
use crate::reality::Trial;
use crate::task::Scene;
use crate::trajectory::{Track, Trajectory};
use crate::world::{Engine, Rollout, Simulator};

/// Maximum number of trials simulated to estimate the engine's lag.
const MAX_SIMULATED_TRIALS: usize = 20;
/// Minimum number of falling intervals, and the largest median deviation from the fitted lag, in time steps
/// of gravity.
const MIN_STRETCHES: usize = 8;
const MAX_DISAGREEMENT: f64 = 0.25;
/// Share of a time step of gravity attributed to rounding.
const ROUNDING: f64 = 1e-3;
/// Largest relative difference between the velocity changes of two consecutive intervals of smooth motion.
const MAX_UNEVENNESS: f64 = 0.2;
/// Largest acceleration other than gravity of a falling body, as a share of gravity.
const MAX_NON_GRAVITY_SHARE: f64 = 0.5;
/// Intervals that deviate by more than this multiple of the median are not used.
const OUTLIER_MULTIPLE: f64 = 3.0;
/// Smallest lag that is corrected and largest plausible one, in time steps.
const MIN_LAG_STEPS: f64 = 0.02;
const MAX_LAG_STEPS: f64 = 1.0;

/// Velocity error of an interval, m/s, and its acceleration other than gravity, m/s^2.
type LagObservation = ([f64; 2], [f64; 2]);

/// Time by which velocities lag behind positions, s.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct VelocityLag {
    /// For gravity.
    pub gravity: f64,
    /// For all other accelerations.
    pub other: f64,
}

/// Difference between the integrators of the measured system and of the simulation.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct IntegratorMismatch {
    /// Lag of the simulation.
    pub simulated: VelocityLag,
    /// Additional lag of the observed velocities.
    pub excess: VelocityLag,
}

/// Shifts the initial velocities of one-step segments to the simulation's times. `None` if there is no
/// mismatch or it cannot be estimated.
pub fn align_velocities(
    segments: &mut [Segment],
    trials: &[Trial],
    engine: Engine,
    progress: &dyn Progress,
) -> Result<Option<IntegratorMismatch>> {
    let one_step: Vec<usize> =
        (0..segments.len()).filter(|w| segments[*w].kind == SegmentKind::OneStep).collect();
    // Only trials with one-step segments are fully observed.
    let mut whole: Vec<usize> = one_step.iter().map(|w| segments[*w].trial).collect();
    whole.dedup();
    let whole: Vec<&Trial> = whole.into_iter().map(|t| &trials[t]).collect();
    let Some(stepping) = integrator_mismatch(&whole, engine, progress)? else { return Ok(None) };
    let later = stepping.excess;
    let step = |w: &usize| Scene { steps: 1, observe_every: 1, ..segments[*w].scene.clone() };
    let steps: Vec<Scene> = one_step.iter().map(step).collect();
    let usual = Default::default();
    let rollouts: Vec<Rollout> =
        one_step.iter().zip(&steps).map(|(w, scene)| segments[*w].rollout(scene, &usual)).collect();
    let after = Simulator::new(engine).budget(&progress).run(&rollouts)?;
    for (w, after) in one_step.into_iter().zip(after) {
        let segment = &mut segments[w];
        let observed = &trials[segment.trial].observed;
        let Some(at) = segment.start_index(observed) else { continue };
        let (gravity, step) = (segment.scene.gravity, segment.scene.time_step);
        for (body, (seen, moved)) in
            segment.scene.bodies.iter_mut().zip(observed.bodies.iter().zip(&after.bodies))
        {
            let first = |v: &[f64], k: usize| v.last().map_or(f64::NAN, |v| (v - body.velocity[k]) / step);
            // Whether the body is supported, by simulation: observations do not distinguish support from
            // terminal velocity.
            let is_falling = is_mostly_gravity([first(&moved.vx, 0), first(&moved.vy, 1)], gravity);
            let Some(pull) = mean_acceleration(seen, &observed.times, at).or(is_falling.then_some(gravity))
            else {
                continue;
            };
            for k in 0..2 {
                // All accelerations of a supported body have the same lag.
                body.velocity[k] += match is_falling {
                    true => gravity[k] * later.gravity + (pull[k] - gravity[k]) * later.other,
                    false => pull[k] * later.gravity,
                };
            }
        }
    }
    Ok(Some(stepping))
}

/// Whether an acceleration is mostly gravity.
fn is_mostly_gravity(pull: [f64; 2], gravity: [f64; 2]) -> bool {
    let strength = gravity[0].hypot(gravity[1]);
    strength > 0.0 && (pull[0] - gravity[0]).hypot(pull[1] - gravity[1]) < MAX_NON_GRAVITY_SHARE * strength
}

/// Lags of the simulation and of the observations; `None` if they cannot be estimated or do not differ.
fn integrator_mismatch(
    trials: &[&Trial],
    engine: Engine,
    progress: &dyn Progress,
) -> Result<Option<IntegratorMismatch>> {
    let Some(first) = trials.first() else { return Ok(None) };
    let (step, gravity) = (first.scene.time_step, first.scene.gravity);
    let observed: Vec<&Trajectory> = trials.iter().map(|t| &t.observed).collect();
    let Some(seen) = estimate_lag(&observed, gravity, step) else { return Ok(None) };
    let scenes: Vec<Scene> = trials.iter().take(MAX_SIMULATED_TRIALS).map(|t| t.scene.clone()).collect();
    let usual = |scene| Rollout { stop_at_goal: false, ..Rollout::of(scene) };
    let rollouts: Vec<Rollout> = scenes.iter().map(usual).collect();
    let paths = Simulator::new(engine).budget(&progress).run(&rollouts)?;
    let Some(own) = estimate_lag(&paths.iter().collect::<Vec<_>>(), gravity, step) else { return Ok(None) };
    let later = VelocityLag { gravity: seen.gravity - own.gravity, other: seen.other - own.other };
    Ok((MIN_LAG_STEPS * step..MAX_LAG_STEPS * step)
        .contains(&later.gravity.abs())
        .then_some(IntegratorMismatch { simulated: own, excess: later }))
}

/// Lag by reweighted least squares over falling intervals; `None` if they disagree.
fn estimate_lag(trajectories: &[&Trajectory], gravity: [f64; 2], step: f64) -> Option<VelocityLag> {
    let mut lag_observations: Vec<LagObservation> = Vec::new();
    for trajectory in trajectories {
        let times = &trajectory.times;
        for track in &trajectory.bodies {
            lag_observations.extend((0..track.len().saturating_sub(2)).filter_map(|i| {
                let pull =
                    central_acceleration(track, times, i).filter(|pull| is_mostly_gravity(*pull, gravity))?;
                let time = times[i + 2] - times[i];
                let off = |x: &[f64], v: &[f64]| {
                    (x[i + 2] - x[i]) / time - (v[i] + 4.0 * v[i + 1] + v[i + 2]) / 6.0
                };
                let off = [off(&track.x, &track.vx), off(&track.y, &track.vy)];
                let whole = off.iter().all(|o| o.is_finite());
                whole.then_some((off, [pull[0] - gravity[0], pull[1] - gravity[1]]))
            }));
        }
    }
    let by_step = step * gravity[0].hypot(gravity[1]);
    let (mut lag, mut usual) = (VelocityLag { gravity: 0.0, other: 0.0 }, f64::INFINITY);
    for _ in 0..4 {
        let near: Vec<_> = lag_observations
            .iter()
            .filter(|t| lag.residual(t, gravity) <= OUTLIER_MULTIPLE * usual)
            .copied()
            .collect();
        lag = least_squares(&near, gravity)?;
        usual = median(&lag_observations.iter().map(|t| lag.residual(t, gravity)).collect::<Vec<_>>())
            .max(ROUNDING * by_step);
    }
    (lag_observations.len() >= MIN_STRETCHES && usual < MAX_DISAGREEMENT * by_step).then_some(lag)
}

impl VelocityLag {
    /// Residual velocity error, m/s.
    fn residual(&self, (off, rest): &LagObservation, gravity: [f64; 2]) -> f64 {
        let left = |k: usize| off[k] - self.gravity * gravity[k] - self.other * rest[k];
        left(0).hypot(left(1))
    }
}

/// Least-squares lag. Without other accelerations than gravity the two lags are equal.
fn least_squares(lag_observations: &[LagObservation], g: [f64; 2]) -> Option<VelocityLag> {
    let dot = |a: &[f64; 2], b: &[f64; 2]| a[0] * b[0] + a[1] * b[1];
    let sum =
        |f: &dyn Fn(&[f64; 2], &[f64; 2]) -> f64| lag_observations.iter().map(|(o, r)| f(o, r)).sum::<f64>();
    let n = lag_observations.len() as f64;
    // Weak prior: equal lags, as if 1 % of the intervals had another acceleration of a tenth of gravity.
    let prior = 1e-4 * n * dot(&g, &g);
    let (gg, gr, rr) =
        (n * dot(&g, &g) + prior, sum(&|_, r| dot(&g, r)) - prior, sum(&|_, r| dot(r, r)) + prior);
    let (og, or) = (sum(&|o, _| dot(o, &g)), sum(&|o, r| dot(o, r)));
    let determinant = gg * rr - gr * gr;
    let lag =
        VelocityLag { gravity: (og * rr - or * gr) / determinant, other: (or * gg - og * gr) / determinant };
    (determinant > 0.0).then_some(lag)
}

/// Mean acceleration between an observation and the next; `None` if the motion is not smooth there.
fn mean_acceleration(track: &Track, times: &[f64], at: usize) -> Option<[f64; 2]> {
    let before = at.checked_sub(1).and_then(|first| central_acceleration(track, times, first));
    before.or_else(|| central_acceleration(track, times, at))?;
    let time = times[at + 1] - times[at];
    Some([(track.vx[at + 1] - track.vx[at]) / time, (track.vy[at + 1] - track.vy[at]) / time])
}

/// Acceleration at the middle of three evenly spaced observations; `None` if the motion is not smooth.
fn central_acceleration(track: &Track, times: &[f64], first: usize) -> Option<[f64; 2]> {
    let (i, j, k) = (first, first + 1, first + 2);
    let time = times.get(k)? - times[i];
    let even = (times[j] - times[i] - 0.5 * time).abs() < 1e-6 * time;
    let halves = |v: &[f64]| [v[j] - v[i], v[k] - v[j]];
    let (x, y) = (halves(&track.vx), halves(&track.vy));
    let [whole, uneven] = [1.0, -1.0].map(|s| (x[1] + s * x[0]).hypot(y[1] + s * y[0]));
    (even && uneven < MAX_UNEVENNESS * whole).then(|| [(x[0] + x[1]) / time, (y[0] + y[1]) / time])
}

#[cfg(test)]
mod tests {
    use super::*;

    const G: [f64; 2] = [0.0, -9.8];

    /// A throw in a rotating wind, with lags of gravity and of the wind, s.
    fn thrown(earlier: f64, wind: f64, from: f64) -> Trajectory {
        let times: Vec<f64> = (0..8).map(|i| 0.25 * f64::from(i)).collect();
        let of = |f: &dyn Fn(f64) -> f64, shift: f64| times.iter().map(|t| f(t + from - shift)).collect();
        let track = Track {
            x: of(&|t| 3.0 * t + (2.0 * t).sin(), 0.0),
            y: of(&|t| 4.0 * t - 4.9 * t * t, 0.0),
            vx: of(&|t| 3.0 + 2.0 * (2.0 * t).cos(), wind),
            vy: of(&|t| 4.0 - 9.8 * t, earlier),
            ..Track::default()
        };
        Trajectory { times, bodies: vec![track], ..Trajectory::default() }
    }

    #[test]
    fn lags_are_estimated_from_smooth_motion() {
        let step = 1.0 / 240.0;
        for expected in [0.0, 0.5 * step, -0.625 * step] {
            for wind in [expected, 0.0] {
                let (one, other) = (thrown(expected, wind, 0.0), thrown(expected, wind, 0.3));
                let found = estimate_lag(&[&one, &other], G, step).unwrap();
                assert!((found.gravity - expected).abs() < 0.02 * step, "{found:?} for {expected}");
                assert!((found.other - wind).abs() < 0.02 * step, "{found:?} for {wind}");
            }
        }
        assert_eq!(estimate_lag(&[&thrown(0.0, 0.0, 0.0)], G, step), None, "six stretches are too few");
        let (one, other) = (thrown(step, step, 0.0), thrown(-step, -step, 0.3));
        assert_eq!(estimate_lag(&[&one, &other], G, step), None, "they do not agree");
    }

    #[test]
    fn a_bounce_is_no_smooth_motion() {
        let mut track = thrown(0.0, 0.0, 0.0).bodies.remove(0);
        let times = thrown(0.0, 0.0, 0.0).times;
        assert!(central_acceleration(&track, &times, 2).is_some());
        track.vy[4] += 6.0;
        assert_eq!(central_acceleration(&track, &times, 2), None);
        assert_eq!(central_acceleration(&track, &times, 6), None, "past the end");
    }
}
