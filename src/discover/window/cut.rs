//! Trials into windows.

use super::flight::flights;
use super::kind::Window;
use super::whole::{leaps, run, shots};
use crate::error::Result;
use crate::progress::Progress;
use crate::reality::Trial;
use crate::task::Scene;

/// Leaps of all trials together, more or less, and the fewest that a trial is given: without nuisances and noise a few
/// tell a lot.
const LEAPS: usize = 160;
const FEWEST: usize = 3;

/// All windows of all trials; `settings[i]` is the setting index of trial i, `run` the most intervals of a beginning, which has no
/// unknowns.
pub fn cut(
    base: &Scene,
    trials: &[Trial],
    settings: &[usize],
    run: usize,
    progress: &dyn Progress,
) -> Result<Vec<Window>> {
    let most = LEAPS.div_ceil(trials.len().max(1)).max(FEWEST);
    let bare = base.without_settings();
    let mut out = Vec::new();
    for (i, trial) in trials.iter().enumerate() {
        progress.report("segmenting trials", i as u64, trials.len() as u64)?;
        let placed = bare.with_setting(trial.setting.as_ref().and_then(|s| base.settings.get(s)));
        let own = windows(&placed, trial, most, run);
        out.extend(own.into_iter().map(|w| Window { trial: i, setting: settings[i], ..w }));
    }
    Ok(out)
}

/// A trial's windows, `placed` being the scene in its setting: of everything together where it is known where it starts, of each body by itself where it is not, and
/// of a body that is alone if it flies.
fn windows(placed: &Scene, trial: &Trial, most: usize, longest: usize) -> Vec<Window> {
    let known = start_is_known(placed, trial);
    let bodies = trial.scene.bodies.len();
    let mut out = if known { leaps(trial, most) } else { Vec::new() };
    if out.is_empty() && (!known || bodies == 1) {
        out = (0..bodies).flat_map(|body| flights(trial, body)).collect();
    }
    if out.is_empty() && known {
        out = run(trial, longest).into_iter().chain(shots(trial)).collect();
    }
    out
}

/// m. What a start may be off by that was set rather than measured: single precision leaves some micrometres of it.
const EXACT: f64 = 1e-5;

/// Whether the scene in the trial's setting says where everything starts and the first observation says the same.
fn start_is_known(placed: &Scene, trial: &Trial) -> bool {
    let from_run = trial.setting.is_none() && placed.action.is_some();
    trial.observed.bodies.iter().enumerate().all(|(k, track)| {
        let expected = if from_run { trial.scene.bodies[k].position } else { placed.bodies[k].position };
        match (expected, track.x.first(), track.y.first()) {
            (Some(p), Some(x), Some(y)) => (p[0] - x).abs() < EXACT && (p[1] - y).abs() < EXACT,
            _ => false,
        }
    })
}

#[cfg(test)]
mod tests {
    use std::fmt::Write as _;

    use super::super::Kind;
    use super::*;
    use crate::progress::NoProgress;
    use crate::reality::trials_from_csv;

    /// A ball on a floor, at heights by the way it has gone (m), at 1 m/s.
    fn rolled(height: impl Fn(f64) -> f64) -> Vec<Window> {
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
        cut(&scene, &trials_from_csv(&csv, &scene).unwrap(), &[0], 8, &NoProgress).unwrap()
    }

    /// A camera turned by a fifth of a degree shows a ball up to a centimetre off the floor that it rolls on.
    #[test]
    fn a_rolling_ball_seen_askew_does_not_fly() {
        for tilt in [0.0, 0.0035, -0.0035] {
            let windows = rolled(|x| 0.05 + tilt * x);
            assert!(!windows.is_empty(), "{tilt}");
            assert!(windows.iter().all(|w| w.kind == Kind::Roll), "{tilt}");
        }
    }

    #[test]
    fn a_ball_that_falls_flies() {
        let windows = rolled(|x| 3.0 + x - 0.5 * 9.81 * x * x / 4.0);
        assert!(windows.iter().any(|w| w.kind == Kind::Flight));
    }
}
