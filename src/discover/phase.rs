//! The moments of a step that velocities are of.
//!
//! One engine moves bodies first and then changes their velocities, another the other way round or several times a step,
//! and gravity need not be what drag is: beside the same position they report velocities that are up to a step of
//! acceleration apart. A rollout that starts from states seen elsewhere is then off from its first step on, as a little
//! more or less gravity would have it. What is seen tells: for smooth motion over two intervals T,
//! x2 - x0 = T/3 (v0 + 4 v1 + v2) + 2 T d (Simpson), and d = g t + (a - g) u if velocities lag behind by a time t in what
//! gravity does and by u in what all else does.

use super::stats::median;
use super::window::{Kind, Window};
use crate::error::Result;
use crate::progress::Progress;
use crate::reality::Trial;
use crate::task::Scene;
use crate::trajectory::{Track, Trajectory};
use crate::world::{Engine, Rollout, Simulator};

/// Trials whose simulation tells the engine's own moments.
const TRIALS: usize = 20;
/// Stretches of falling that must agree, and how far the usual one may be off, in time steps of gravity.
const FEWEST: usize = 8;
const APART: f64 = 0.25;
/// What of that is rounding, and no disagreement.
const ROUNDING: f64 = 1e-3;
/// By how much the two halves of smooth motion may change a velocity differently, as a share of the whole change.
const SMOOTH: f64 = 0.2;
/// By how much what falls may be accelerated otherwise than by gravity, as a share of it.
const FALLING: f64 = 0.5;
/// Stretches off by more than this many times what is usual have no say.
const ODD: f64 = 3.0;
/// Difference that is none, and the largest that engines have, in time steps.
const NONE: f64 = 0.02;
const MOST: f64 = 1.0;

/// By how much the velocities of a stretch are off, m/s, and what of its acceleration is not gravity, m/s^2.
type Told = ([f64; 2], [f64; 2]);

/// By how much velocities lag behind the positions beside them, s.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Lag {
    /// In what gravity does.
    pub gravity: f64,
    /// In what everything else does.
    pub rest: f64,
}

/// How what was seen steps where that is not as the simulation does.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Stepping {
    /// The simulation's own lag.
    pub own: Lag,
    /// How much more the velocities seen lag.
    pub later: Lag,
}

/// Starts every leap from the velocities that its engine would have reported of the state that was seen. `None` if what
/// was seen steps as the simulation does, or that cannot be told.
pub fn align(
    windows: &mut [Window],
    trials: &[Trial],
    engine: Engine,
    progress: &dyn Progress,
) -> Result<Option<Stepping>> {
    let leaps: Vec<usize> = (0..windows.len()).filter(|w| windows[*w].kind == Kind::Leap).collect();
    // Only of trials with leaps is it known that everything was seen and placed.
    let mut whole: Vec<usize> = leaps.iter().map(|w| windows[*w].trial).collect();
    whole.dedup();
    let whole: Vec<&Trial> = whole.into_iter().map(|t| &trials[t]).collect();
    let Some(stepping) = difference(&whole, engine, progress)? else { return Ok(None) };
    let later = stepping.later;
    let step = |w: &usize| Scene { steps: 1, observe_every: 1, ..windows[*w].scene.clone() };
    let steps: Vec<Scene> = leaps.iter().map(step).collect();
    let usual = Default::default();
    let rollouts: Vec<Rollout> =
        leaps.iter().zip(&steps).map(|(w, scene)| windows[*w].rollout(scene, &usual)).collect();
    let after = Simulator::new(engine).budget(&progress).run(&rollouts)?;
    for (w, after) in leaps.into_iter().zip(after) {
        let window = &mut windows[w];
        let observed = &trials[window.trial].observed;
        let Some(at) = window.first(observed) else { continue };
        let (gravity, step) = (window.scene.gravity, window.scene.time_step);
        for (body, (seen, moved)) in
            window.scene.bodies.iter_mut().zip(observed.bodies.iter().zip(&after.bodies))
        {
            let first = |v: &[f64], k: usize| v.last().map_or(f64::NAN, |v| (v - body.velocity[k]) / step);
            // Whether something carries it. (By what was seen it cannot be told from what falls as fast as drag lets it.)
            let is_falling = falls([first(&moved.vx, 0), first(&moved.vy, 1)], gravity);
            let Some(pull) = during(seen, &observed.times, at).or(is_falling.then_some(gravity)) else {
                continue;
            };
            for k in 0..2 {
                // What something carries lags as a whole. (Of drag above half of gravity that made air that rises at 0.15 m/s.)
                body.velocity[k] += match is_falling {
                    true => gravity[k] * later.gravity + (pull[k] - gravity[k]) * later.rest,
                    false => pull[k] * later.gravity,
                };
            }
        }
    }
    Ok(Some(stepping))
}

/// Whether an acceleration is mostly gravity.
fn falls(pull: [f64; 2], gravity: [f64; 2]) -> bool {
    let strength = gravity[0].hypot(gravity[1]);
    strength > 0.0 && (pull[0] - gravity[0]).hypot(pull[1] - gravity[1]) < FALLING * strength
}

/// Both lags; `None` where they cannot be told or do not differ.
fn difference(trials: &[&Trial], engine: Engine, progress: &dyn Progress) -> Result<Option<Stepping>> {
    let Some(first) = trials.first() else { return Ok(None) };
    let (step, gravity) = (first.scene.time_step, first.scene.gravity);
    let observed: Vec<&Trajectory> = trials.iter().map(|t| &t.observed).collect();
    let Some(seen) = lag(&observed, gravity, step) else { return Ok(None) };
    let scenes: Vec<Scene> = trials.iter().take(TRIALS).map(|t| t.scene.clone()).collect();
    let usual = |scene| Rollout { stop_at_goal: false, ..Rollout::of(scene) };
    let rollouts: Vec<Rollout> = scenes.iter().map(usual).collect();
    let paths = Simulator::new(engine).budget(&progress).run(&rollouts)?;
    let Some(own) = lag(&paths.iter().collect::<Vec<_>>(), gravity, step) else { return Ok(None) };
    let later = Lag { gravity: seen.gravity - own.gravity, rest: seen.rest - own.rest };
    Ok((NONE * step..MOST * step).contains(&later.gravity.abs()).then_some(Stepping { own, later }))
}

/// The lag on which stretches of falling agree.
fn lag(trajectories: &[&Trajectory], gravity: [f64; 2], step: f64) -> Option<Lag> {
    let mut told: Vec<Told> = Vec::new();
    for trajectory in trajectories {
        let times = &trajectory.times;
        for track in &trajectory.bodies {
            told.extend((0..track.len().saturating_sub(2)).filter_map(|i| {
                let pull = acceleration(track, times, i).filter(|pull| falls(*pull, gravity))?;
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
    let (mut lag, mut usual) = (Lag { gravity: 0.0, rest: 0.0 }, f64::INFINITY);
    for _ in 0..4 {
        let near: Vec<_> = told.iter().filter(|t| lag.leaves(t, gravity) <= ODD * usual).copied().collect();
        lag = least_squares(&near, gravity)?;
        usual =
            median(&told.iter().map(|t| lag.leaves(t, gravity)).collect::<Vec<_>>()).max(ROUNDING * by_step);
    }
    (told.len() >= FEWEST && usual < APART * by_step).then_some(lag)
}

impl Lag {
    /// What it leaves of what is `off`, m/s.
    fn leaves(&self, (off, rest): &Told, gravity: [f64; 2]) -> f64 {
        let left = |k: usize| off[k] - self.gravity * gravity[k] - self.rest * rest[k];
        left(0).hypot(left(1))
    }
}

/// The lag that leaves least of what is off. Where nothing but gravity acts, all else is taken to lag as gravity does.
fn least_squares(told: &[Told], g: [f64; 2]) -> Option<Lag> {
    let dot = |a: &[f64; 2], b: &[f64; 2]| a[0] * b[0] + a[1] * b[1];
    let sum = |f: &dyn Fn(&[f64; 2], &[f64; 2]) -> f64| told.iter().map(|(o, r)| f(o, r)).sum::<f64>();
    let n = told.len() as f64;
    // As if one stretch in a hundred had shown something a tenth of gravity to lag as gravity does.
    let prior = 1e-4 * n * dot(&g, &g);
    let (gg, gr, rr) =
        (n * dot(&g, &g) + prior, sum(&|_, r| dot(&g, r)) - prior, sum(&|_, r| dot(r, r)) + prior);
    let (og, or) = (sum(&|o, _| dot(o, &g)), sum(&|o, r| dot(o, r)));
    let determinant = gg * rr - gr * gr;
    let lag = Lag { gravity: (og * rr - or * gr) / determinant, rest: (or * gg - og * gr) / determinant };
    (determinant > 0.0).then_some(lag)
}

/// Mean acceleration between an observation and the next, if the motion about that is smooth.
fn during(track: &Track, times: &[f64], at: usize) -> Option<[f64; 2]> {
    let before = at.checked_sub(1).and_then(|first| acceleration(track, times, first));
    before.or_else(|| acceleration(track, times, at))?;
    let time = times[at + 1] - times[at];
    Some([(track.vx[at + 1] - track.vx[at]) / time, (track.vy[at + 1] - track.vy[at]) / time])
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

#[cfg(test)]
mod tests {
    use super::*;

    const G: [f64; 2] = [0.0, -9.8];

    /// A throw in a wind that turns; velocities lag in what gravity does and in what the wind does, s.
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
    fn smooth_motion_tells_the_moment_of_its_velocities() {
        let step = 1.0 / 240.0;
        for wanted in [0.0, 0.5 * step, -0.625 * step] {
            for wind in [wanted, 0.0] {
                let (one, other) = (thrown(wanted, wind, 0.0), thrown(wanted, wind, 0.3));
                let found = lag(&[&one, &other], G, step).unwrap();
                assert!((found.gravity - wanted).abs() < 0.02 * step, "{found:?} for {wanted}");
                assert!((found.rest - wind).abs() < 0.02 * step, "{found:?} for {wind}");
            }
        }
        assert_eq!(lag(&[&thrown(0.0, 0.0, 0.0)], G, step), None, "six stretches are too few");
        let (one, other) = (thrown(step, step, 0.0), thrown(-step, -step, 0.3));
        assert_eq!(lag(&[&one, &other], G, step), None, "they do not agree");
    }

    #[test]
    fn a_bounce_is_no_smooth_motion() {
        let mut track = thrown(0.0, 0.0, 0.0).bodies.remove(0);
        let times = thrown(0.0, 0.0, 0.0).times;
        assert!(acceleration(&track, &times, 2).is_some());
        track.vy[4] += 6.0;
        assert_eq!(acceleration(&track, &times, 2), None);
        assert_eq!(acceleration(&track, &times, 6), None, "past the end");
    }
}
