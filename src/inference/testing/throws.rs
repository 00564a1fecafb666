//! Test data: balls thrown with linear drag, one coefficient per trial, and a model fitted to them.

use crate::inference::data::noise::Noise;
use crate::inference::mixed_model::fitted_model::FittedModel;
use crate::inference::mixed_model::model_fit::ModelFitter;
use crate::inference::model::{FitState, ParameterLayout, SegmentData};
use crate::inference::report::Verdict;
use crate::inference::segment::{self, Segment};
use crate::inference::selection::Decision;
use crate::inference::testing::segments::term;
use crate::progress::NoProgress;
use crate::reality::trials_from_csv;
use crate::rng;
use crate::task::ball::BallScene;
use crate::world::Engine;
use rand_distr::{Distribution, StandardNormal};

/// Gravity, m/s^2; observations of a trial; interval, s; noise, m.
const GRAVITY: f64 = 9.81;
const OBSERVED: usize = 30;
const INTERVAL: f64 = 0.03;
pub const NOISE: f64 = 0.002;

/// Segments of trials, one for each drag (1/s, not 0).
pub fn throws(drags: &[f64], seed: u64) -> Vec<Segment> {
    let scene = BallScene { radius: 0.05, mass: None, gravity: Some(GRAVITY), floor: None }
        .build("ball", 1.0)
        .unwrap();
    let mut stream = rng::stream(seed, "thrown");
    let mut noise =
        || -> f64 { NOISE * <StandardNormal as Distribution<f64>>::sample(&StandardNormal, &mut stream) };
    let mut csv = String::from("trial,t,body,x,y\n");
    for (trial, c) in drags.iter().enumerate() {
        let [vx, vy] = [4.0 + 0.7 * trial as f64, 5.0 - 0.4 * trial as f64];
        for i in 0..OBSERVED {
            let t = INTERVAL * i as f64;
            let gone = (1.0 - libm::exp(-c * t)) / c;
            let x = vx * gone + noise();
            let y = 1.0 + (vy + GRAVITY / c) * gone - GRAVITY / c * t + noise();
            csv += &format!("{trial},{t},ball,{x},{y}\n");
        }
    }
    segment::segment_trials(
        &scene,
        &trials_from_csv(&csv, &scene).unwrap(),
        &vec![0; drags.len()],
        8,
        &NoProgress,
    )
    .unwrap()
    .segments
}

/// Fits a set of effects to such trials and passes the fit to `of`.
pub fn with_fit<T>(
    drags: &[f64],
    set: &[&str],
    seed: u64,
    of: impl FnOnce(&ModelFitter, &FittedModel) -> T,
) -> T {
    let segments = throws(drags, seed);
    let settings = vec![0; drags.len()];
    let data = SegmentData::new(&segments, &settings, vec![NOISE; segments.len()], Engine::Auto);
    let fitter = ModelFitter::new(&data, &Noise { sd: NOISE, rho: 0.0, degrees_of_freedom: 1e3 });
    let layout = ParameterLayout::new(&[], set.iter().map(|name| term(name)).collect(), 1);
    let values = layout.initial_values(&[0.0; 3]);
    let state = FitState::new(values, segments.iter().map(|w| w.nuisances.clone()).collect());
    of(&fitter, &fitter.fit(layout, state, 12).unwrap().unwrap())
}

/// A decision without rivals.
pub fn decision(verdict: Verdict) -> Decision {
    Decision {
        verdict,
        selected: None,
        rivals: Vec::new(),
        probabilities: Vec::new(),
        base_probability: 1.0,
        explained: None,
        gain: None,
        field: None,
        field_log_bayes_factor: None,
        is_law_open: false,
        is_balance: false,
    }
}

#[test]
fn common_drag_is_estimated() {
    with_fit(&[0.4; 8], &["linear_drag"], 1, |_, f| {
        assert!((f.state.values[0] - 0.4).abs() < 0.02, "{:?}", f.state.values);
        assert!(
            f.ci_half_width(0) < 0.03 && f.between_trial_sd(0).is_none_or(|s| s < 0.05),
            "{} {:?}",
            f.ci_half_width(0),
            f.between_trial_sd(0)
        );
    });
}
