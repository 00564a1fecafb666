//! Segmentation of trials.

use super::collision::collision_segments;
use super::definition::Segment;
use super::full_state::{initial_segment, multi_step_segments, one_step_segments};
use super::single_body::BodyObservations;
use super::unused_contacts::unused_contacts;
use crate::error::Result;
use crate::progress::Progress;
use crate::reality::Trial;
use crate::task::Scene;

/// Total number of one-step segments (approximately), and the minimum per trial. Without nuisances and noise
/// few suffice.
const ONE_STEP_SEGMENTS: usize = 160;
const MIN_ONE_STEP_PER_TRIAL: usize = 3;

/// Segments of all trials.
pub struct Segmentation {
    pub segments: Vec<Segment>,
    /// Trial of each contact that no segment uses, and why.
    pub unused_contacts: Vec<(usize, String)>,
}

/// All segments of all trials; `settings[i]` is the index of the setting of trial i, `run` the maximum number
/// of intervals of an initial segment.
pub fn segment_trials(
    base: &Scene,
    trials: &[Trial],
    settings: &[usize],
    run: usize,
    progress: &dyn Progress,
) -> Result<Segmentation> {
    let most = ONE_STEP_SEGMENTS.div_ceil(trials.len().max(1)).max(MIN_ONE_STEP_PER_TRIAL);
    let bare = base.without_settings();
    let mut out = Segmentation { segments: Vec::new(), unused_contacts: Vec::new() };
    for (i, trial) in trials.iter().enumerate() {
        progress.report("segmenting trials", i as u64, trials.len() as u64)?;
        let placed = bare.with_setting(trial.setting.as_ref().and_then(|s| base.settings.get(s)));
        let (own, unused) = trial_segments(&placed, trial, most, run, progress)?;
        out.segments.extend(own.into_iter().map(|w| Segment { trial: i, setting: settings[i], ..w }));
        out.unused_contacts.extend(unused.into_iter().map(|reason| (i, reason)));
    }
    Ok(out)
}

/// Segments of a trial: one-step or initial segments of all bodies if the initial state is known; single-body
/// segments if it is not, and for a single body in flight; and the reasons why contacts are in none. `placed` is the scene in the
/// trial's setting.
fn trial_segments(
    placed: &Scene,
    trial: &Trial,
    most: usize,
    longest: usize,
    progress: &dyn Progress,
) -> Result<(Vec<Segment>, Vec<String>)> {
    let known = has_known_initial_state(placed, trial);
    let bodies = trial.scene.bodies.len();
    let mut out = if known { one_step_segments(trial, most) } else { Vec::new() };
    let mut unused = Vec::new();
    if out.is_empty() && (!known || bodies == 1) {
        let observed = (0..bodies).filter_map(|body| BodyObservations::of(trial, body, progress).transpose());
        let observed = observed.collect::<Result<Vec<_>>>()?;
        for own in &observed {
            out.extend(own.segments(progress)?);
        }
        out.extend(collision_segments(&observed));
        unused = unused_contacts(&observed, &out);
    }
    if out.is_empty() && known {
        // An engine simulates every contact.
        unused.clear();
        out = initial_segment(trial, longest).into_iter().chain(multi_step_segments(trial)).collect();
    }
    Ok((out, unused))
}

/// Tolerance of a known initial position, m: rounding to single precision.
const INITIAL_STATE_TOLERANCE: f64 = 1e-5;

/// Whether the scene in the trial's setting defines all initial positions and the first observation agrees
/// with them.
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
    use crate::progress::NoProgress;
    use crate::reality::trials_from_csv;

    /// A ball at 1 m/s whose height is a function of its horizontal position (m).
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
        segment_trials(&scene, &trials_from_csv(&csv, &scene).unwrap(), &[0], 8, &NoProgress)
            .unwrap()
            .segments
    }

    /// A camera turned by a fifth of a degree shows a ball up to a centimetre off the floor that it rolls on.
    #[test]
    fn tilted_cameras_do_not_turn_rolling_into_flight() {
        for tilt in [0.0, 0.0035, -0.0035] {
            let segments = rolled(|x| 0.05 + tilt * x);
            assert!(!segments.is_empty(), "{tilt}");
            assert!(segments.iter().all(|w| w.kind == SegmentKind::Rolling), "{tilt}");
        }
    }

    #[test]
    fn falling_balls_fly() {
        let segments = rolled(|x| 3.0 + x - 0.5 * 9.81 * x * x / 4.0);
        assert!(segments.iter().any(|w| w.kind == SegmentKind::Flight));
    }
}
