//! Prediction gain of an extension, and misfit of the base model, in metres.

use crate::inference::data::noise::Noise;
use crate::inference::mixed_model::fitted_model::{FittedModel, held_out_square};
use crate::inference::mixed_model::leave_group_out::leave_group_out;
use crate::inference::report::expected_rss::ExpectedRss;
use crate::inference::report::{BaseMisfit, HeldOutError, PredictionGain};
use crate::inference::segment::Segment;
use crate::inference::statistics::normal_survival;

/// Excess over the noise floor, as a share of it, below which shares of the excess are undefined.
const MIN_EXCESS_SHARE: f64 = 0.02;

/// Conversion of squares in units of the noise to metres.
pub struct ErrorScale {
    /// m
    pub noise: f64,
    pub coordinates: f64,
    /// Expected square of noise alone.
    pub floor: f64,
    pub trials: usize,
}

impl ErrorScale {
    pub fn new(expected: &ExpectedRss, noise: &Noise, trials: usize) -> ErrorScale {
        let coordinates = expected.coordinates.iter().sum();
        ErrorScale { noise: noise.sd, coordinates, floor: expected.total(), trials }
    }

    /// Root mean square error of a sum of squares, m.
    pub fn rmse(&self, squares: f64) -> f64 {
        self.noise * (squares.max(0.0) / self.coordinates.max(1.0)).sqrt()
    }

    /// Errors on held-out data before and after an extension.
    pub fn gain(&self, base: f64, extended: f64) -> HeldOutError {
        let rmse = |squares: f64| self.noise * (squares / self.coordinates).sqrt();
        let excess = base - self.floor;
        HeldOutError {
            trials: self.trials,
            base_rmse: rmse(base),
            extended_rmse: rmse(extended),
            floor_rmse: rmse(self.floor),
            excess_removed: (excess > MIN_EXCESS_SHARE * self.floor)
                .then(|| 1.0 - (extended - self.floor) / excess),
        }
    }
}

/// Prediction gain of a model on held-out trials and on held-out settings.
pub fn prediction_gain(
    base: &FittedModel,
    best: Option<&FittedModel>,
    settings: &[usize],
    count: usize,
    scale: &ErrorScale,
) -> PredictionGain {
    let loss = |f: &FittedModel| leave_setting_out_loss(f, settings, count);
    PredictionGain {
        held_out: best.map(|f| scale.gain(held_out_square(base), held_out_square(f))),
        extrapolation: best.and_then(|f| Some(scale.gain(loss(base)?, loss(f)?))),
    }
}

/// Misfit of the base model.
pub fn base_misfit(
    base: &FittedModel,
    segments: &[Segment],
    expected: &ExpectedRss,
    noise: &Noise,
    scale: &ErrorScale,
) -> BaseMisfit {
    let (autocorrelation, whiteness_p) = lag_one_correlation(segments, &base.evaluation.residuals);
    BaseMisfit {
        base_rmse: root_mean_square(segments, &base.evaluation.residuals),
        floor_rmse: scale.rmse(expected.total()),
        lack_of_fit_p: expected.misfit_of(base, segments).1,
        whiteness_p,
        autocorrelation,
        noise_correlation: noise.rho,
    }
}

/// Leave-one-setting-out loss; `None` without two settings of three trials or more.
fn leave_setting_out_loss(f: &FittedModel, settings: &[usize], count: usize) -> Option<f64> {
    let sizes: Vec<usize> = (0..count).map(|s| settings.iter().filter(|g| **g == s).count()).collect();
    let enough = sizes.iter().filter(|s| **s >= 3).count() >= 2 && sizes.iter().all(|s| *s > 0);
    let of = || {
        leave_group_out(&f.layout, &f.state.values, &f.evaluation.normal_equations, settings, settings, &[]).0
    };
    enough.then(|| of().iter().sum())
}

/// Share of the base model's excess error that a model does not explain; `None` without excess.
pub fn unexplained_share(
    base: &FittedModel,
    model: &FittedModel,
    expected: &ExpectedRss,
    segments: &[Segment],
) -> Option<f64> {
    let (excess, _) = expected.misfit_of(base, segments);
    let (left, _) = expected.misfit_of(model, segments);
    (excess > MIN_EXCESS_SHARE).then(|| (left / excess).clamp(0.0, 1.0))
}

/// Root mean square of all used coordinates, m.
fn root_mean_square(segments: &[Segment], residuals: &[Vec<f64>]) -> f64 {
    let (mut square, mut count) = (0.0, 0.0);
    for (segment, residuals) in segments.iter().zip(residuals) {
        square += segment.within_blocks.sum_of_squares;
        for (i, r) in residuals.iter().enumerate().filter(|(_, r)| r.is_finite()) {
            let weight = segment.observations[i / 2].weight;
            (square, count) = (square + weight * r * r, count + weight);
        }
    }
    (square / f64::max(count, 1.0)).sqrt()
}

/// Lag-1 autocorrelation of residuals, and its p-value.
fn lag_one_correlation(segments: &[Segment], residuals: &[Vec<f64>]) -> (f64, f64) {
    let (mut squares, mut products, mut count) = (0.0, 0.0, 0.0);
    for (segment, r) in segments.iter().zip(residuals).filter(|(w, _)| !w.kind.is_impact()) {
        let bodies = segment.scene.bodies.len();
        for i in 0..r.len() {
            let j = i + 2 * bodies;
            if r[i].is_finite() {
                squares += r[i] * r[i];
                if j < r.len() && r[j].is_finite() {
                    products += r[i] * r[j];
                    count += 1.0;
                }
            }
        }
    }
    let rho = if squares > 0.0 { products / squares } else { 0.0 };
    (rho, (2.0 * normal_survival(rho.abs() * f64::sqrt(count))).min(1.0))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::inference::testing::segments::flights;

    #[test]
    fn gain_is_the_removed_share_of_the_excess() {
        let scale = ErrorScale { noise: 0.002, coordinates: 100.0, floor: 90.0, trials: 5 };
        let gain = scale.gain(490.0, 190.0);
        assert_eq!(gain.excess_removed, Some(0.75));
        assert!((gain.floor_rmse - 0.002 * 0.9f64.sqrt()).abs() < 1e-15);
        assert_eq!(scale.gain(91.0, 80.0).excess_removed, None, "no excess to speak of");
    }

    #[test]
    fn unused_coordinates_are_ignored() {
        let (segments, _) = flights([0.0; 2], 2);
        assert_eq!(root_mean_square(&segments, &[vec![3.0, f64::NAN], vec![4.0]]), 12.5f64.sqrt());
    }
}
