//! What of the windows can be trusted: runs as long as they can be foreseen, flights without outliers.

use std::collections::HashMap;

use nalgebra::{DMatrix, DVector};

use super::model::{self, Data, Layout, State};
use super::smooth::spikes;
use super::stats::median;
use super::window::{Kind, Window};
use crate::error::Result;
use crate::progress::Progress;
use crate::task::Scene;
use crate::world::{Engine, Rollout, Simulator};

/// A start's smallest error, m, and its growth beyond which a run is no longer trusted.
const SMALLEST: f64 = 1e-7;
const GROWTH: f64 = 100.0;

/// Ends runs where the start's smallest error would show.
pub fn shorten(windows: &mut [Window], engine: Engine, progress: &dyn Progress) -> Result<()> {
    for window in windows.iter_mut().filter(|w| w.kind == Kind::Run) {
        let until = foreseen(&window.scene, engine, progress)?;
        let least = window.points.get(window.scene.bodies.len()).map_or(0.0, |p| p.time);
        window.points.retain(|p| p.time < until.max(least + 1e-9));
        let last = window.points.last().map_or(0.0, |p| p.time);
        let steps =
            (last / window.scene.time_step).round() as u32 + u32::from(window.scene.observe_every == 1);
        window.scene.steps = steps.clamp(1, window.scene.steps);
    }
    Ok(())
}

/// The time from which a scene goes elsewhere if one of its bodies starts elsewhere by next to nothing, s.
fn foreseen(scene: &Scene, engine: Engine, progress: &dyn Progress) -> Result<f64> {
    let mut scenes = vec![scene.clone(); 1 + scene.bodies.len()];
    for body in 0..scene.bodies.len() {
        if let Some(p) = &mut scenes[1 + body].bodies[body].position {
            p[0] += SMALLEST;
        }
    }
    let usual = |scene| Rollout { stop_at_goal: false, ..Rollout::of(scene) };
    let rollouts: Vec<Rollout> = scenes.iter().map(usual).collect();
    let paths = Simulator::new(engine).budget(&progress).run(&rollouts)?;
    let (own, moved) = (&paths[0], &paths[1..]);
    let pairs = || moved.iter().flat_map(|p| p.bodies.iter().zip(&own.bodies));
    let parted = |i: &usize| {
        pairs().any(|(a, b)| *i < a.len() && (a.x[*i] - b.x[*i]).hypot(a.y[*i] - b.y[*i]) > GROWTH * SMALLEST)
    };
    Ok((0..own.times.len()).find(parted).map_or(f64::INFINITY, |i| own.times[i]))
}

/// Takes outliers at the ends of flights out, by what nothing but gravity leaves.
pub fn weed(
    windows: &mut [Window],
    sd: &[f64],
    settings: &[usize],
    engine: Engine,
    progress: &dyn Progress,
) -> Result<()> {
    let flights: Vec<usize> = (0..windows.len()).filter(|w| windows[*w].kind == Kind::Flight).collect();
    let own: Vec<Window> = flights.iter().map(|w| windows[*w].clone()).collect();
    let sd_of_flights = flights.iter().map(|w| sd[*w]).collect();
    let data = Data::new(&own, settings, sd_of_flights, engine).until_stopped(progress);
    let layout = Layout::new(&[], Vec::new(), 1);
    let start = State::new(Vec::new(), own.iter().map(|w| w.nuisances.clone()).collect());
    let (_, left) = model::fit(&data, &layout, start, 3)?;
    for (k, w) in flights.into_iter().enumerate() {
        progress.check_stop()?;
        let times: Vec<f64> = own[k].points.iter().map(|p| p.time).collect();
        for i in spikes(&times, &left.residuals[k], sd[w]) {
            windows[w].points[i].weight = 0.0;
        }
    }
    Ok(())
}

/// Observations that a trial's first is compared with, and the most that are rejected at a beginning.
const ONSET: usize = 9;
const MAX_ONSET: usize = 3;
/// Robust standard errors by which trials' first observations must be off on average, and multiple of the noise.
const ONSET_ERRORS: f64 = 6.0;
const ONSET_NOISE: f64 = 1.5;

/// Rejects the first observations of all trials where they do not continue into those after them, on average over trials: what is
/// released is held, hidden or blurred at first.
pub fn reject_onset(windows: &mut [Window], sd: &[f64]) {
    let mut starts: HashMap<usize, f64> = HashMap::new();
    for w in windows.iter() {
        let start = starts.entry(w.trial).or_insert(w.start);
        *start = start.min(w.start);
    }
    let first = |w: usize| windows[w].start <= starts[&windows[w].trial];
    let begins: Vec<usize> =
        (0..windows.len()).filter(|w| windows[*w].kind == Kind::Flight && first(*w)).collect();
    for k in 0..MAX_ONSET {
        let off: Vec<[f64; 2]> =
            begins.iter().filter_map(|w| Some(onset(&windows[*w], k)?.map(|v| v / sd[*w]))).collect();
        let shifted = (0..2).any(|axis| {
            let all: Vec<f64> = off.iter().map(|o| o[axis]).collect();
            let centre = median(&all);
            let spread = 1.4826 * median(&all.iter().map(|v| (v - centre).abs()).collect::<Vec<_>>());
            let error = 1.2533 * spread / (all.len().max(1) as f64).sqrt();
            all.len() >= FEWEST_ONSETS && centre.abs() > ONSET_ERRORS * error && centre.abs() > ONSET_NOISE
        });
        if !shifted {
            break;
        }
        for w in &begins {
            windows[*w].points[..=k].iter_mut().for_each(|p| p.weight = 0.0);
        }
    }
}

/// Fewest trials whose beginnings can be compared.
const FEWEST_ONSETS: usize = 6;

/// How far observation `k` is from the cubic through the next ones, m; `None` where there are too few.
fn onset(window: &Window, k: usize) -> Option<[f64; 2]> {
    let next = window.points.get(k + 1..k + 1 + ONSET)?;
    if window.points.len() < 2 * ONSET || next.iter().any(|p| p.weight == 0.0) {
        return None;
    }
    let (at, unit) = (window.points[k].time, next[ONSET - 1].time - window.points[k].time);
    let basis = DMatrix::from_fn(ONSET, 4, |i, p| ((next[i].time - at) / unit).powi(p as i32));
    let factor = basis.svd(true, true);
    let of = |axis: usize| {
        let y = DVector::from_fn(ONSET, |i, _| next[i].seen[axis]);
        let beta = factor.solve(&y, 1e-12).ok()?;
        Some(window.points[k].seen[axis] - beta[0])
    };
    Some([of(0)?, of(1)?])
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::discover::fixture::flights;
    use crate::progress::NoProgress;

    /// On a floor a ball stays as far off as it starts; off another ball's top it goes where the start's error sends it.
    #[test]
    fn a_bounce_off_a_ball_cannot_be_foreseen() {
        let until = |fixed: &str| {
            let scene = Scene::from_json(&format!(
                r#"{{"format": "iplw.scene/1", "gravity": [0, -9.8], "time_step": 0.01, "steps": 300, "observe_every": 10,
                    "bodies": [{{"name": "ball", "shape": {{"type": "disc", "radius": 0.1}}, "position": [0, 3],
                                "restitution": 1}}],
                    "statics": [{{"name": "below", "restitution": 1, {fixed}}}]}}"#
            ));
            foreseen(&scene.unwrap(), Engine::Lanes, &NoProgress).unwrap()
        };
        assert_eq!(until(r#""shape": {"type": "halfspace", "normal": [0, 1], "offset": 0}"#), f64::INFINITY);
        let met = until(r#""shape": {"type": "disc", "radius": 0.1}, "position": [0, 0]"#);
        assert!((0.8..2.5).contains(&met), "{met} s: it meets the other after 0.76 s");
    }

    #[test]
    fn one_point_off_at_the_end_is_weeded_out_alone() {
        let (mut windows, settings) = flights([0.0, 0.0], 2);
        windows[1].points[19].seen[1] += 0.02;
        weed(&mut windows, &[1e-3; 2], &settings, Engine::Auto, &NoProgress).unwrap();
        let out = |w: &Window| (0..20).filter(|i| w.points[*i].weight == 0.0).collect::<Vec<_>>();
        assert_eq!((out(&windows[0]), out(&windows[1])), (vec![], vec![19]));
    }

    /// Throws that are all held a centimetre back at first: that observation is rejected, and no other.
    #[test]
    fn what_all_trials_begin_with_is_rejected() {
        let (mut windows, _) = flights([0.0, 0.0], 8);
        reject_onset(&mut windows, &[1e-3; 8]);
        assert!(windows.iter().all(|w| w.points.iter().all(|p| p.weight == 1.0)));
        windows.iter_mut().for_each(|w| w.points[0].seen[0] -= 0.01);
        reject_onset(&mut windows, &[1e-3; 8]);
        let out = |w: &Window| (0..20).filter(|i| w.points[*i].weight == 0.0).collect::<Vec<_>>();
        assert!(windows.iter().all(|w| out(w) == [0]));
    }
}
