//! Trials into windows.

use super::flight::single_body_segments;
use super::kind::Segment;
use super::whole::{initial_segment, multi_step_segments, one_step_segments};
use crate::reality::Trial;
use crate::task::Scene;

/// Leaps of all trials together, more or less, and the fewest that a trial is given: without nuisances and noise a few
/// tell a lot.
const ONE_STEP_SEGMENTS: usize = 160;
const MIN_ONE_STEP_PER_TRIAL: usize = 3;

/// All windows of all trials; `settings[i]` is the setting index of trial i, `run` the most intervals of a beginning, which has no
/// unknowns.
pub fn segment_trials(base: &Scene, trials: &[Trial], settings: &[usize], run: usize) -> Vec<Segment> {
    let most = ONE_STEP_SEGMENTS.div_ceil(trials.len().max(1)).max(MIN_ONE_STEP_PER_TRIAL);
    let bare = base.without_settings();
    let of = |(i, trial): (usize, &Trial)| {
        let placed = bare.with_setting(trial.setting.as_ref().and_then(|s| base.settings.get(s)));
        let own = trial_segments(&placed, trial, most, run);
        own.into_iter().map(move |w| Segment { trial: i, setting: settings[i], ..w })
    };
    trials.iter().enumerate().flat_map(of).collect()
}

/// A trial's windows, `placed` being the scene in its setting: of everything together where it is known where it starts, of each body by itself where it is not, and
/// of a body that is alone if it flies.
fn trial_segments(placed: &Scene, trial: &Trial, most: usize, longest: usize) -> Vec<Segment> {
    let known = has_known_initial_state(placed, trial);
    let bodies = trial.scene.bodies.len();
    let mut out = if known { one_step_segments(trial, most) } else { Vec::new() };
    if out.is_empty() && (!known || bodies == 1) {
        out = (0..bodies).flat_map(|body| single_body_segments(trial, body)).collect();
    }
    if out.is_empty() && known {
        out = initial_segment(trial, longest).into_iter().chain(multi_step_segments(trial)).collect();
    }
    out
}

/// m. What a start may be off by that was set rather than measured: single precision leaves some micrometres of it.
const INITIAL_STATE_TOLERANCE: f64 = 1e-5;

/// Whether the scene in the trial's setting says where everything starts and the first observation says the same.
fn has_known_initial_state(placed: &Scene, trial: &Trial) -> bool {
    let from_run = trial.setting.is_none() && placed.action.is_some();
    trial.observed.bodies.iter().enumerate().all(|(k, track)| {
        let expected = if from_run { trial.scene.bodies[k].position } else { placed.bodies[k].position };
        match (expected, track.x.first(), track.y.first()) {
            (Some(p), Some(x), Some(y)) => {
                (p[0] - x).abs() < INITIAL_STATE_TOLERANCE && (p[1] - y).abs() < INITIAL_STATE_TOLERANCE
            }
            _ => false,
        }
    })
}

#[cfg(test)]
mod tests {
    use std::fmt::Write as _;

    use super::super::SegmentKind;
    use super::*;
    use crate::reality::trials_from_csv;

    /// A ball on a floor, at heights by the way it has gone (m), at 1 m/s.
    fn rolled(height: impl Fn(f64) -> f64) -> Vec<Segment> {
        let scene = Scene::from_json(
            r#"{"format": "iplw.scene/1", "gravity": [0, -9.81], "time_step": 0.005,
                "bodies": [{"name": "ball", "shape": {"type": "disc", "radius": 0.05}, "mass": 0.1}],
                "statics": [{"name": "floor", "shape": {"type": "halfspace", "normal": [0, 1], "offset": 0}}]}"#,
        )
        .unwrap();
        let mut csv = String::from("trial,t,body,x,y\n");
        for i in 0..100 {
            let x = 0.03 * f64::from(i);
            let noise = |k: i32| 1e-4 * libm::sin(f64::from(k + i * i));
            let _ = writeln!(csv, "a,{x},ball,{},{}", x + noise(0), height(x) + noise(7));
        }
        segment_trials(&scene, &trials_from_csv(&csv, &scene).unwrap(), &[0], 8)
    }

    /// A camera turned by a fifth of a degree shows a ball up to a centimetre off the floor that it rolls on.
    #[test]
    fn a_rolling_ball_seen_askew_does_not_fly() {
        for tilt in [0.0, 0.0035, -0.0035] {
            let windows = rolled(|x| 0.05 + tilt * x);
            assert!(!windows.is_empty(), "{tilt}");
            assert!(windows.iter().all(|w| w.kind == SegmentKind::Rolling), "{tilt}");
        }
    }

    #[test]
    fn a_ball_that_falls_flies() {
        let windows = rolled(|x| 3.0 + x - 0.5 * 9.81 * x * x / 4.0);
        assert!(windows.iter().any(|w| w.kind == SegmentKind::Flight));
    }
}
