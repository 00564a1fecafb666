//! Truncation of segments at their predictability horizon and rejection of outliers.

use std::collections::{HashMap, HashSet};

use nalgebra::{DMatrix, DVector};

use crate::error::Result;
use crate::inference::data::smoothing::local_outliers;
use crate::inference::model::{self, FitState, ParameterLayout, SegmentData};
use crate::inference::segment::{Segment, SegmentKind};
use crate::inference::statistics::median;
use crate::progress::Progress;
use crate::task::Scene;
use crate::world::{Engine, Rollout, Simulator};

/// Perturbation of the initial position, m, and its growth that defines the predictability horizon.
const INITIAL_ERROR: f64 = 1e-7;
const MAX_ERROR_GROWTH: f64 = 100.0;

/// Truncates initial segments at their predictability horizon.
pub fn truncate_at_horizon(segments: &mut [Segment], engine: Engine, progress: &dyn Progress) -> Result<()> {
    for segment in segments.iter_mut().filter(|w| w.kind == SegmentKind::FromInitialState) {
        let until = predictability_horizon(&segment.scene, engine, progress)?;
        let least = segment.observations.get(segment.scene.bodies.len()).map_or(0.0, |p| p.time);
        segment.observations.retain(|p| p.time < until.max(least + 1e-9));
        let last = segment.observations.last().map_or(0.0, |p| p.time);
        let steps =
            (last / segment.scene.time_step).round() as u32 + u32::from(segment.scene.observe_every == 1);
        segment.scene.steps = steps.clamp(1, segment.scene.steps);
    }
    Ok(())
}

/// Predictability horizon: time at which a perturbation of one body's initial position has grown by
/// [`MAX_ERROR_GROWTH`], s.
fn predictability_horizon(scene: &Scene, engine: Engine, progress: &dyn Progress) -> Result<f64> {
    let mut scenes = vec![scene.clone(); 1 + scene.bodies.len()];
    for body in 0..scene.bodies.len() {
        if let Some(p) = &mut scenes[1 + body].bodies[body].position {
            p[0] += INITIAL_ERROR;
        }
    }
    let usual = |scene| Rollout { stop_at_goal: false, ..Rollout::of(scene) };
    let rollouts: Vec<Rollout> = scenes.iter().map(usual).collect();
    let paths = Simulator::new(engine).budget(&progress).run(&rollouts)?;
    let (own, moved) = (&paths[0], &paths[1..]);
    let pairs = || moved.iter().flat_map(|p| p.bodies.iter().zip(&own.bodies));
    let parted = |i: &usize| {
        pairs().any(|(a, b)| {
            *i < a.len() && (a.x[*i] - b.x[*i]).hypot(a.y[*i] - b.y[*i]) > MAX_ERROR_GROWTH * INITIAL_ERROR
        })
    };
    Ok((0..own.times.len()).find(parted).map_or(f64::INFINITY, |i| own.times[i]))
}

/// Rejects outliers of flights by the residuals of a fit with gravity alone, also in the contacts that share the observations.
pub fn reject_outliers(
    segments: &mut [Segment],
    sd: &[f64],
    settings: &[usize],
    engine: Engine,
    progress: &dyn Progress,
) -> Result<()> {
    let flights: Vec<usize> =
        (0..segments.len()).filter(|w| segments[*w].kind == SegmentKind::Flight).collect();
    let own: Vec<Segment> = flights.iter().map(|w| segments[*w].clone()).collect();
    let sd_of_flights = flights.iter().map(|w| sd[*w]).collect();
    let data = SegmentData::new(&own, settings, sd_of_flights, engine).until_stopped(progress);
    let layout = ParameterLayout::new(&[], Vec::new(), 1);
    let start = FitState::new(Vec::new(), own.iter().map(|w| w.nuisances.clone()).collect());
    let (_, left) = model::fit(&data, &layout, start, 3)?;
    let mut rejected: HashSet<(usize, i64)> = HashSet::new();
    for (k, w) in flights.into_iter().enumerate() {
        progress.check_stop()?;
        let times: Vec<f64> = own[k].observations.iter().map(|p| p.time).collect();
        for i in local_outliers(&times, &left.residuals[k], sd[w]) {
            segments[w].observations[i].weight = 0.0;
        }
        let segment = &segments[w];
        let unused = segment.observations.iter().filter(|p| p.weight == 0.0);
        rejected.extend(unused.map(|p| observation_key(segment, p.time)));
    }
    for segment in segments.iter_mut().filter(|w| w.kind.is_impact()) {
        for i in 0..segment.observations.len() {
            if rejected.contains(&observation_key(segment, segment.observations[i].time)) {
                segment.observations[i].weight = 0.0;
            }
        }
    }
    Ok(())
}

/// The trial of an observation and its time in the trial, to a nanosecond.
fn observation_key(segment: &Segment, time: f64) -> (usize, i64) {
    (segment.trial, ((segment.start + time) * 1e9).round() as i64)
}

/// Number of observations with which the first of a trial is compared, and the maximum number of rejected
/// ones.
const ONSET_NEIGHBOURS: usize = 9;
const MAX_REJECTED_ONSETS: usize = 3;
/// Minimum mean deviation of first observations, in robust standard errors and in noise standard deviations.
const ONSET_ERRORS: f64 = 6.0;
const ONSET_NOISE: f64 = 1.5;

/// Rejects the first observations of all trials if they systematically deviate from the extrapolation of
/// later ones: released bodies are held, hidden or blurred at first.
pub fn reject_onset(segments: &mut [Segment], sd: &[f64]) {
    let mut starts: HashMap<usize, f64> = HashMap::new();
    for w in segments.iter() {
        let start = starts.entry(w.trial).or_insert(w.start);
        *start = start.min(w.start);
    }
    let first = |w: usize| segments[w].start <= starts[&segments[w].trial];
    let begins: Vec<usize> =
        (0..segments.len()).filter(|w| segments[*w].kind == SegmentKind::Flight && first(*w)).collect();
    for k in 0..MAX_REJECTED_ONSETS {
        let off: Vec<[f64; 2]> = begins
            .iter()
            .filter_map(|w| Some(onset_deviation(&segments[*w], k)?.map(|v| v / sd[*w])))
            .collect();
        let shifted = (0..2).any(|axis| {
            let all: Vec<f64> = off.iter().map(|o| o[axis]).collect();
            let centre = median(&all);
            let spread = 1.4826 * median(&all.iter().map(|v| (v - centre).abs()).collect::<Vec<_>>());
            let error = 1.2533 * spread / (all.len().max(1) as f64).sqrt();
            all.len() >= MIN_ONSETS && centre.abs() > ONSET_ERRORS * error && centre.abs() > ONSET_NOISE
        });
        if !shifted {
            break;
        }
        for w in &begins {
            segments[*w].observations[..=k].iter_mut().for_each(|p| p.weight = 0.0);
        }
    }
}

/// Minimum number of trials for this comparison.
const MIN_ONSETS: usize = 6;

/// Deviation of observation `k` from a cubic through the following ones, m; `None` if there are too few.
fn onset_deviation(segment: &Segment, k: usize) -> Option<[f64; 2]> {
    let next = segment.observations.get(k + 1..k + 1 + ONSET_NEIGHBOURS)?;
    if segment.observations.len() < 2 * ONSET_NEIGHBOURS || next.iter().any(|p| p.weight == 0.0) {
        return None;
    }
    let (at, unit) =
        (segment.observations[k].time, next[ONSET_NEIGHBOURS - 1].time - segment.observations[k].time);
    let basis = DMatrix::from_fn(ONSET_NEIGHBOURS, 4, |i, p| ((next[i].time - at) / unit).powi(p as i32));
    let factor = basis.svd(true, true);
    let of = |axis: usize| {
        let y = DVector::from_fn(ONSET_NEIGHBOURS, |i, _| next[i].position[axis]);
        let beta = factor.solve(&y, 1e-12).ok()?;
        Some(segment.observations[k].position[axis] - beta[0])
    };
    Some([of(0)?, of(1)?])
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::inference::testing::segments::flights;
    use crate::progress::NoProgress;

    /// A perturbation does not grow on a flat floor; it does after a bounce off a disc.
    #[test]
    fn horizon_ends_at_a_bounce_off_a_disc() {
        let until = |fixed: &str| {
            let scene = Scene::from_json(&format!(
                r#"{{"format": "iplw.scene/1", "gravity": [0, -9.8], "time_step": 0.01, "steps": 300, "observe_every": 10,
                    "bodies": [{{"name": "ball", "shape": {{"type": "disc", "radius": 0.1}}, "position": [0, 3],
                                "restitution": 1}}],
                    "statics": [{{"name": "below", "restitution": 1, {fixed}}}]}}"#
            ));
            predictability_horizon(&scene.unwrap(), Engine::Lanes, &NoProgress).unwrap()
        };
        assert_eq!(until(r#""shape": {"type": "halfspace", "normal": [0, 1], "offset": 0}"#), f64::INFINITY);
        let met = until(r#""shape": {"type": "disc", "radius": 0.1}, "position": [0, 0]"#);
        assert!((0.8..2.5).contains(&met), "{met} s: it meets the other after 0.76 s");
    }

    #[test]
    fn single_outliers_are_rejected() {
        let (mut segments, settings) = flights([0.0, 0.0], 2);
        segments[1].observations[19].position[1] += 0.02;
        reject_outliers(&mut segments, &[1e-3; 2], &settings, Engine::Auto, &NoProgress).unwrap();
        let out = |w: &Segment| (0..20).filter(|i| w.observations[*i].weight == 0.0).collect::<Vec<_>>();
        assert_eq!((out(&segments[0]), out(&segments[1])), (vec![], vec![19]));
    }

    /// An outlier of a flight is one of the contact that shares the observation, too.
    #[test]
    fn outliers_are_rejected_in_contacts() {
        let (mut segments, settings) = flights([0.0, 0.0], 2);
        segments[0].observations[15].position[1] += 0.02;
        let mut contact = Segment { kind: SegmentKind::Contact, ..segments[0].clone() };
        contact.observations.drain(..12);
        segments.push(contact);
        reject_outliers(&mut segments, &[1e-3; 3], &settings, Engine::Auto, &NoProgress).unwrap();
        let weights: Vec<f64> = segments[2].observations.iter().map(|p| p.weight).collect();
        assert_eq!(weights, [1.0, 1.0, 1.0, 0.0, 1.0, 1.0, 1.0, 1.0]);
    }

    /// A first observation that is shifted by 1 cm in all trials is rejected, and no other.
    #[test]
    fn systematic_onsets_are_rejected() {
        let (mut segments, _) = flights([0.0, 0.0], 8);
        reject_onset(&mut segments, &[1e-3; 8]);
        assert!(segments.iter().all(|w| w.observations.iter().all(|p| p.weight == 1.0)));
        segments.iter_mut().for_each(|w| w.observations[0].position[0] -= 0.01);
        reject_onset(&mut segments, &[1e-3; 8]);
        let out = |w: &Segment| (0..20).filter(|i| w.observations[*i].weight == 0.0).collect::<Vec<_>>();
        assert!(segments.iter().all(|w| out(w) == [0]));
    }
}
