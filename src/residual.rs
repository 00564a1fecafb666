//! Residuals between a simulated and an observed trajectory.
//!
//! Source: Semage et al., equation 2: the sum of squared differences between observed and simulated states,
//! averaged over trajectories.
//!
//! Differences from the source: states are positions (m) only, without angles and velocities, so the residual
//! is in m^2 and comparable for measured data without these. Observations missing on either side are skipped.

use crate::trajectory::{Termination, Track, Trajectory, hermite};

/// Residual of a diverged simulation, m^2: finite, and larger than that of any trajectory within a scene.
pub const DIVERGED_RESIDUAL_M2: f64 = 1e12;

/// Tolerance of observation times, s.
const TIME_TOLERANCE_S: f64 = 1e-9;

/// Sum over bodies and observation times of the squared distance (m^2) between observed and simulated
/// positions. The simulation is interpolated at the observed times; times after its end are skipped.
pub fn sum_of_squares(observed: &Trajectory, simulated: &Trajectory) -> f64 {
    if simulated.outcome.end == Termination::Diverged {
        return DIVERGED_RESIDUAL_M2;
    }
    let mut sum = 0.0;
    for_each_difference(observed, simulated, |[dx, dy]| {
        let square = dx.powi(2) + dy.powi(2);
        if square.is_finite() {
            sum += square;
        }
    });
    sum
}

/// Observed minus simulated positions, m: x and y of every observation time of every observed body in turn.
/// NaN where either side is missing, and everywhere if the simulation diverged.
pub fn position_residuals(observed: &Trajectory, simulated: &Trajectory) -> Vec<f64> {
    let mut all = Vec::with_capacity(2 * observed.times.len() * observed.bodies.len());
    if simulated.outcome.end == Termination::Diverged {
        all.resize(all.capacity(), f64::NAN);
        return all;
    }
    for_each_difference(observed, simulated, |d| all.extend(d));
    all
}

/// Calls `each` with the difference at every observation time of every observed body.
fn for_each_difference(observed: &Trajectory, simulated: &Trajectory, mut each: impl FnMut([f64; 2])) {
    let aligned = observed.times == simulated.times;
    for track in &observed.bodies {
        let other = simulated.track(&track.name);
        let mut cursor = 0;
        for (i, t) in observed.times.iter().enumerate() {
            let position = other.and_then(|other| match aligned {
                true => Some([other.x[i], other.y[i]]),
                false => position_at(&simulated.times, other, *t, &mut cursor),
            });
            each(position.map_or([f64::NAN; 2], |[x, y]| [track.x[i] - x, track.y[i] - y]));
        }
    }
}

/// Number of observed positions in a trajectory.
pub fn count_observations(observed: &Trajectory) -> usize {
    observed
        .bodies
        .iter()
        .map(|t| (0..t.len()).filter(|i| t.x[*i].is_finite() && t.y[*i].is_finite()).count())
        .sum()
}

/// Position at time `t` by cubic Hermite interpolation between samples; `cursor` is the last interval used.
fn position_at(times: &[f64], track: &Track, t: f64, cursor: &mut usize) -> Option<[f64; 2]> {
    let last = times.len().checked_sub(1)?;
    // The tolerance allows for rounding at either end, not for extrapolation.
    if t < times[0] - TIME_TOLERANCE_S || t > times[last] + TIME_TOLERANCE_S {
        return None;
    }
    while *cursor + 1 < last && times[*cursor + 1] < t {
        *cursor += 1;
    }
    let (i, j) = (*cursor, (*cursor + 1).min(last));
    let span = times[j] - times[i];
    if span <= 0.0 {
        return Some([track.x[i], track.y[i]]);
    }
    let s = ((t - times[i]) / span).clamp(0.0, 1.0);
    Some([
        hermite([track.x[i], track.x[j]], [track.vx[i], track.vx[j]], span, s),
        hermite([track.y[i], track.y[j]], [track.vy[i], track.vy[j]], span, s),
    ])
}

#[cfg(test)]
mod tests {
    use super::*;

    fn falling(times: &[f64]) -> Trajectory {
        let mut track = Track::with_capacity("ball", times.len());
        for t in times {
            track.push([2.0 * t, 10.0 - 4.9 * t * t], 0.0, [2.0, -9.8 * t], 0.0);
        }
        Trajectory { times: times.to_vec(), bodies: vec![track], ..Trajectory::default() }
    }

    #[test]
    fn free_fall_interpolates_exactly() {
        // A cubic reproduces a parabola at any sampling.
        let observed = falling(&[0.0, 0.13, 0.4, 0.77, 1.0]);
        let simulated = falling(&[0.0, 0.25, 0.5, 0.75, 1.0]);
        assert!(sum_of_squares(&observed, &simulated) < 1e-24);
    }

    #[test]
    fn counts_each_observation_once_and_skips_missing_ones() {
        let observed = falling(&[0.0, 0.5, 1.0]);
        let mut shifted = falling(&[0.0, 0.5, 1.0]);
        shifted.bodies[0].x.iter_mut().for_each(|x| *x += 0.5);
        assert!((sum_of_squares(&observed, &shifted) - 0.75).abs() < 1e-12);
        let mut gappy = observed.clone();
        gappy.bodies[0].y[1] = f64::NAN;
        assert!((sum_of_squares(&gappy, &shifted) - 0.5).abs() < 1e-12);
        assert_eq!(count_observations(&gappy), 2);
    }

    #[test]
    fn diverged_simulation_has_the_largest_residual() {
        let mut diverged = falling(&[0.0]);
        diverged.outcome.end = Termination::Diverged;
        assert_eq!(sum_of_squares(&falling(&[0.0, 1.0]), &diverged), DIVERGED_RESIDUAL_M2);
    }
}
