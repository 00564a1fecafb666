//! Predictions of some trials under the posterior: quantiles of every observed coordinate, with the initial state of each segment fitted
//! at each draw (to first order) and the noise of a measurement included.

use serde::{Deserialize, Serialize};

use super::horizon::PreparedModel;
use crate::distribution::NORMAL_95;
use crate::error::Result;
use crate::inference::data::preprocessing::PreprocessedData;
use crate::inference::model::{FitState, SegmentData, linearise};
use crate::inference::report::round_to_six_digits;
use crate::progress::Progress;
use crate::reality::Trial;
use crate::world::{Engine, ParameterVector};

/// Maximum number of trials, evenly spaced, of draws, and of observations of a trial.
const MAX_TRIALS: usize = 2;
const MAX_DRAWS: usize = 60;
const MAX_OBSERVATIONS: usize = 120;

/// The predictions of a trial's first body.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct PredictiveBand {
    /// Name of the trial.
    pub trial: String,
    pub body: String,
    /// s
    pub t: Vec<f64>,
    /// Measured positions, m.
    pub measured: Vec<[f64; 2]>,
    /// For x and y: 2.5, 50 and 97.5 % quantiles of a measurement, m.
    pub quantiles: [Vec<[f64; 3]>; 2],
}

/// Bands of a model's posterior draws; none where no trial can be predicted at them.
pub fn predictive_bands(
    model: &PreparedModel,
    ready: &PreprocessedData,
    trials: &[Trial],
    draws: &[ParameterVector],
    engine: Engine,
    progress: &dyn Progress,
) -> Result<Vec<PredictiveBand>> {
    let mut numbers: Vec<usize> =
        model.windows.iter().filter(|w| !w.kind.is_impact()).map(|w| w.trial).collect();
    numbers.dedup();
    let stride = numbers.len().div_ceil(MAX_TRIALS).max(1);
    let mut bands = Vec::new();
    for trial in numbers.into_iter().step_by(stride) {
        let of_trial = |w: &usize| model.windows[*w].trial == trial && !model.windows[*w].kind.is_impact();
        let chosen: Vec<usize> = (0..model.windows.len()).filter(of_trial).collect();
        let segments: Vec<_> = chosen.iter().map(|w| model.windows[*w].clone()).collect();
        let sd = chosen.iter().map(|w| model.sd[*w]).collect();
        let data = SegmentData::new(&segments, &ready.settings, sd, engine).until_stopped(progress);
        let mut residuals = Vec::new();
        for draw in draws.iter().step_by(draws.len().div_ceil(MAX_DRAWS).max(1)) {
            let state = FitState {
                values: draw[..model.layout.parameters.len()].to_vec(),
                nuisances: chosen.iter().map(|w| model.state.nuisances[*w].clone()).collect(),
                random_effects: Vec::new(),
            };
            residuals.push(linearise(&data, &model.layout, &state, &[])?);
        }
        let mut band = PredictiveBand {
            trial: trials[ready.trial_indices[trial]].name.clone(),
            body: segments[0].scene.bodies.first().map_or(String::new(), |b| b.name.clone()),
            t: Vec::new(),
            measured: Vec::new(),
            quantiles: [Vec::new(), Vec::new()],
        };
        for (w, segment) in segments.iter().enumerate() {
            let own: Vec<usize> =
                (0..segment.observations.len()).filter(|i| segment.observations[*i].body == 0).collect();
            for i in own.iter().step_by(own.len().div_ceil(MAX_OBSERVATIONS).max(1)) {
                let observation = &segment.observations[*i];
                let at = |k: usize| {
                    let values = residuals
                        .iter()
                        .map(|all| observation.position[k] - all[w].residual_metres(2 * i + k));
                    quantiles(values.filter(|v| v.is_finite()).collect(), model.noise.sd)
                };
                if let (Some(x), Some(y)) = (at(0), at(1)) {
                    band.t.push(round_to_six_digits(segment.start + observation.time));
                    band.measured.push(observation.position.map(round_to_six_digits));
                    band.quantiles[0].push(x);
                    band.quantiles[1].push(y);
                }
            }
        }
        if !band.t.is_empty() {
            bands.push(band);
        }
    }
    Ok(bands)
}

/// 2.5, 50 and 97.5 % quantiles of predictions with noise of this standard deviation; `None` without predictions.
fn quantiles(mut values: Vec<f64>, noise: f64) -> Option<[f64; 3]> {
    values.sort_by(f64::total_cmp);
    let last = values.len().checked_sub(1)?;
    let at = |share: f64| values[(share * last as f64).round() as usize];
    let (low, median, high) = (at(0.025), at(0.5), at(0.975));
    let wide = |end: f64| (end - median).hypot(NORMAL_95 * noise);
    Some([median - wide(low), median, median + wide(high)].map(round_to_six_digits))
}

#[cfg(test)]
mod tests {
    use super::quantiles;

    #[test]
    fn bands_contain_noise_and_the_spread_of_the_draws() {
        let [low, median, high] = quantiles((0..=100).map(f64::from).collect(), 0.0).unwrap();
        assert!((low - 2.0).abs() <= 1.0 && median == 50.0 && (high - 98.0).abs() <= 1.0, "{low} {high}");
        let [low, _, high] = quantiles(vec![1.0; 5], 0.1).unwrap();
        assert!((high - 1.196).abs() < 1e-3 && (low - 0.804).abs() < 1e-3, "{low} {high}");
        assert_eq!(quantiles(Vec::new(), 0.1), None);
    }
}
