//! The moment of a step that velocities are of.
//!
//! One engine moves bodies first and then changes their velocities, another the other way round or several times a step:
//! beside the same position they report velocities of moments that lie up to a step apart. A rollout that starts from
//! states seen elsewhere is then off by that moment's acceleration from its first step on, as a little more or less gravity
//! would have it. What is seen tells: for smooth motion over two intervals T,
//! x2 - x0 = T/3 (v0 + 4 v1 + v2) + 2 T d (Simpson), and d = a t if the velocities are those of a time t earlier.

use super::stats::median;
use super::window::{Kind, Window};
use crate::error::Result;
use crate::reality::Trial;
use crate::task::Scene;
use crate::trajectory::{Track, Trajectory};
use crate::world::{Engine, Rollout, simulate};

/// Trials whose simulation tells the engine's own moment.
const TRIALS: usize = 20;
/// Stretches of smooth motion that must agree, and how far their middle half may lie apart, in time steps.
const FEWEST: usize = 8;
const APART: f64 = 0.5;
/// By how much the two halves of smooth motion may change a velocity differently, as a share of the whole change.
const SMOOTH: f64 = 0.2;
/// Least acceleration that tells a time, m/s^2.
const PULL: f64 = 2.0;
/// Difference that is none, and the largest that engines have, in time steps.
const NONE: f64 = 0.02;
const MOST: f64 = 1.0;

/// Starts every leap from the velocities that its engine would have reported of the state that was seen.
pub fn align(windows: &mut [Window], trials: &[Trial], engine: Engine) -> Result<()> {
    let leaps: Vec<usize> = (0..windows.len()).filter(|w| windows[*w].kind == Kind::Leap).collect();
    // Only of trials with leaps is it known that everything was seen and placed.
    let mut whole: Vec<usize> = leaps.iter().map(|w| windows[*w].trial).collect();
    whole.dedup();
    let later = difference(&whole.into_iter().map(|t| &trials[t]).collect::<Vec<_>>(), engine)?;
    if later == 0.0 {
        return Ok(());
    }
    let step = |w: &usize| Scene { steps: 1, observe_every: 1, ..windows[*w].scene.clone() };
    let after = rolled(&leaps.iter().map(step).collect::<Vec<_>>(), engine)?;
    for (w, after) in leaps.into_iter().zip(after) {
        let window = &mut windows[w];
        let observed = &trials[window.trial].observed;
        let Some(at) = observed.times.iter().position(|t| *t == window.start) else { continue };
        let (gravity, step) = (window.scene.gravity, window.scene.time_step);
        for (body, (seen, moved)) in
            window.scene.bodies.iter_mut().zip(observed.bodies.iter().zip(&after.bodies))
        {
            let falls = |k: usize| {
                let change = [&moved.vx, &moved.vy][k].last().map_or(f64::NAN, |v| v - body.velocity[k]);
                (change - gravity[k] * step).abs() < SMOOTH * gravity[0].hypot(gravity[1]) * step
            };
            let smooth = at.checked_sub(1).and_then(|first| acceleration(seen, &observed.times, first));
            let Some(pull) = smooth.or((falls(0) && falls(1)).then_some(gravity)) else { continue };
            (0..2).for_each(|k| body.velocity[k] += pull[k] * later);
        }
    }
    Ok(())
}

/// How much earlier the moment of the velocities seen is than the simulation's, s; 0 where that cannot be told or is nothing.
fn difference(trials: &[&Trial], engine: Engine) -> Result<f64> {
    let Some(step) = trials.first().map(|t| t.scene.time_step) else { return Ok(0.0) };
    let observed: Vec<&Trajectory> = trials.iter().map(|t| &t.observed).collect();
    let Some(seen) = earlier(&observed, step) else { return Ok(0.0) };
    let scenes: Vec<Scene> = trials.iter().take(TRIALS).map(|t| t.scene.clone()).collect();
    let paths = rolled(&scenes, engine)?;
    let own = earlier(&paths.iter().collect::<Vec<_>>(), step);
    let difference = own.map_or(0.0, |own| seen - own);
    Ok(if (NONE * step..MOST * step).contains(&difference.abs()) { difference } else { 0.0 })
}

/// How much earlier than the positions beside them velocities are, s, where smooth stretches agree on it.
fn earlier(trajectories: &[&Trajectory], step: f64) -> Option<f64> {
    let mut told = Vec::new();
    for trajectory in trajectories {
        let times = &trajectory.times;
        for track in &trajectory.bodies {
            told.extend((0..track.len().saturating_sub(2)).filter_map(|i| {
                let pull = acceleration(track, times, i)?;
                let strength = pull[0].hypot(pull[1]);
                let time = times[i + 2] - times[i];
                let off = |x: &[f64], v: &[f64]| {
                    (x[i + 2] - x[i]) / time - (v[i] + 4.0 * v[i + 1] + v[i + 2]) / 6.0
                };
                let along = off(&track.x, &track.vx) * pull[0] + off(&track.y, &track.vy) * pull[1];
                (strength > PULL).then(|| along / strength.powi(2))
            }));
        }
    }
    told.retain(|t| t.is_finite());
    told.sort_by(f64::total_cmp);
    let n = told.len();
    let agree = n >= FEWEST && told[3 * n / 4] - told[n / 4] < APART * step;
    agree.then(|| median(&told))
}

/// Acceleration at the middle one of three observations, evenly spaced, if the motion over them is smooth.
fn acceleration(track: &Track, times: &[f64], first: usize) -> Option<[f64; 2]> {
    let (i, j, k) = (first, first + 1, first + 2);
    let time = times.get(k)? - times[i];
    let even = (times[j] - times[i] - 0.5 * time).abs() < 1e-6 * time;
    let halves = |v: &[f64]| [v[j] - v[i], v[k] - v[j]];
    let (x, y) = (halves(&track.vx), halves(&track.vy));
    let [whole, uneven] = [1.0, -1.0].map(|s| (x[1] + s * x[0]).hypot(y[1] + s * y[0]));
    (even && uneven < SMOOTH * whole).then(|| [(x[0] + x[1]) / time, (y[0] + y[1]) / time])
}

fn rolled(scenes: &[Scene], engine: Engine) -> Result<Vec<Trajectory>> {
    let usual = |scene| Rollout { scene, latents: Default::default(), effects: &[], stop: false };
    simulate(&scenes.iter().map(usual).collect::<Vec<_>>(), engine)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A throw in a wind that turns, its velocities those of a time earlier than its positions.
    fn thrown(earlier: f64, from: f64) -> Trajectory {
        let times: Vec<f64> = (0..8).map(|i| 0.25 * f64::from(i)).collect();
        let of = |f: &dyn Fn(f64) -> f64, shift: f64| times.iter().map(|t| f(t + from - shift)).collect();
        let track = Track {
            x: of(&|t| 3.0 * t + (2.0 * t).sin(), 0.0),
            y: of(&|t| 4.0 * t - 4.9 * t * t, 0.0),
            vx: of(&|t| 3.0 + 2.0 * (2.0 * t).cos(), earlier),
            vy: of(&|t| 4.0 - 9.8 * t, earlier),
            ..Track::default()
        };
        Trajectory { times, bodies: vec![track], ..Trajectory::default() }
    }

    #[test]
    fn smooth_motion_tells_the_moment_of_its_velocities() {
        let step = 1.0 / 240.0;
        for wanted in [0.0, 0.5 * step, -0.625 * step] {
            let (one, other) = (thrown(wanted, 0.0), thrown(wanted, 0.3));
            let found = earlier(&[&one, &other], step).unwrap();
            assert!((found - wanted).abs() < 0.02 * step, "{found} for {wanted}");
        }
        assert_eq!(earlier(&[&thrown(0.0, 0.0)], step), None, "six stretches are too few");
        let (one, other) = (thrown(step, 0.0), thrown(-step, 0.3));
        assert_eq!(earlier(&[&one, &other], step), None, "they do not agree");
    }

    #[test]
    fn a_bounce_is_no_smooth_motion() {
        let mut track = thrown(0.0, 0.0).bodies.remove(0);
        let times = thrown(0.0, 0.0).times;
        assert!(acceleration(&track, &times, 2).is_some());
        track.vy[4] += 6.0;
        assert_eq!(acceleration(&track, &times, 2), None);
        assert_eq!(acceleration(&track, &times, 6), None, "past the end");
    }
}
