//! What an extension gains, and what the base model leaves, in metres.

use super::expected::ExpectedRss;
use super::fit::{FittedModel, held_out_square};
use super::leave_out::leave_group_out;
use super::noise::Noise;
use super::report::{BaseMisfit, HeldOutError, PredictionGain};
use super::stats::normal_survival;
use super::window::{Segment, SegmentKind};

/// Excess over the noise floor, as a share of it, below which a share of the excess means nothing.
const MIN_EXCESS_SHARE: f64 = 0.02;

/// Squares in units of the noise, told in metres.
pub struct ErrorScale {
    /// m
    pub noise: f64,
    pub coordinates: f64,
    /// What noise alone would leave.
    pub floor: f64,
    pub trials: usize,
}

impl ErrorScale {
    pub fn new(expected: &ExpectedRss, noise: &Noise, trials: usize) -> ErrorScale {
        let coordinates = expected.coordinates.iter().sum();
        ErrorScale { noise: noise.sd, coordinates, floor: expected.total(), trials }
    }

    /// Root of the mean of squares that sum to `squares`, m.
    pub fn rmse(&self, squares: f64) -> f64 {
        self.noise * (squares.max(0.0) / self.coordinates.max(1.0)).sqrt()
    }

    /// What an extension makes of the base's held-out loss.
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

/// What a model gains over the base model, on trials and on settings that it was not fitted to.
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

/// What the base model leaves.
pub fn base_misfit(
    base: &FittedModel,
    windows: &[Segment],
    expected: &ExpectedRss,
    noise: &Noise,
    scale: &ErrorScale,
) -> BaseMisfit {
    let (autocorrelation, whiteness_p) = lag_one_correlation(windows, &base.evaluation.residuals);
    BaseMisfit {
        base_rmse: root_mean_square(&base.evaluation.residuals),
        floor_rmse: scale.rmse(expected.total()),
        lack_of_fit_p: expected.misfit_of(base, windows).1,
        whiteness_p,
        autocorrelation,
        noise_correlation: noise.rho,
    }
}

/// Loss at each setting of a fit to the others; `None` without two settings of three trials or more.
fn leave_setting_out_loss(f: &FittedModel, settings: &[usize], count: usize) -> Option<f64> {
    let sizes: Vec<usize> = (0..count).map(|s| settings.iter().filter(|g| **g == s).count()).collect();
    let enough = sizes.iter().filter(|s| **s >= 3).count() >= 2 && sizes.iter().all(|s| *s > 0);
    let of = || {
        leave_group_out(&f.layout, &f.state.values, &f.evaluation.normal_equations, settings, settings, &[]).0
    };
    enough.then(|| of().iter().sum())
}

/// Share of the base's excess over the noise floor that a model leaves; `None` where there is none to speak of.
pub fn unexplained_share(
    base: &FittedModel,
    model: &FittedModel,
    expected: &ExpectedRss,
    windows: &[Segment],
) -> Option<f64> {
    let (excess, _) = expected.misfit_of(base, windows);
    let (left, _) = expected.misfit_of(model, windows);
    (excess > MIN_EXCESS_SHARE).then(|| (left / excess).clamp(0.0, 1.0))
}

/// Root of the mean square of all coordinates that count, m.
fn root_mean_square(residuals: &[Vec<f64>]) -> f64 {
    let known = || residuals.iter().flatten().filter(|r| r.is_finite());
    (known().map(|r| r * r).sum::<f64>() / known().count().max(1) as f64).sqrt()
}

/// Lag-1 correlation of residuals, and p of its being nothing.
fn lag_one_correlation(windows: &[Segment], residuals: &[Vec<f64>]) -> (f64, f64) {
    let (mut squares, mut products, mut count) = (0.0, 0.0, 0.0);
    for (window, r) in windows.iter().zip(residuals).filter(|(w, _)| w.kind != SegmentKind::Contact) {
        let bodies = window.scene.bodies.len();
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

    #[test]
    fn a_gain_is_the_share_of_the_excess_that_goes() {
        let scale = ErrorScale { noise: 0.002, coordinates: 100.0, floor: 90.0, trials: 5 };
        let gain = scale.gain(490.0, 190.0);
        assert_eq!(gain.excess_removed, Some(0.75));
        assert!((gain.floor_rmse - 0.002 * 0.9f64.sqrt()).abs() < 1e-15);
        assert_eq!(scale.gain(91.0, 80.0).excess_removed, None, "no excess to speak of");
    }

    #[test]
    fn what_does_not_count_is_in_no_mean() {
        assert_eq!(root_mean_square(&[vec![3.0, f64::NAN], vec![4.0]]), 12.5f64.sqrt());
    }
}
