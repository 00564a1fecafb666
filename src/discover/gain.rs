//! What an extension gains, and what the base model leaves, in metres.

use super::expected::Expected;
use super::fit::{Fitted, held};
use super::leave_out::leave_out;
use super::noise::Noise;
use super::report::{BaseMisfit, HeldOutError, PredictionGain};
use super::stats::normal_above;
use super::window::{Kind, Window};

/// Excess over the noise floor, as a share of it, below which a share of the excess means nothing.
const SLIGHT: f64 = 0.02;

/// Squares in units of the noise, told in metres.
pub struct Scale {
    /// m
    pub noise: f64,
    pub coordinates: f64,
    /// What noise alone would leave.
    pub floor: f64,
    pub trials: usize,
}

impl Scale {
    pub fn new(expected: &Expected, noise: &Noise, trials: usize) -> Scale {
        let coordinates = expected.coordinates.iter().sum();
        Scale { noise: noise.sd, coordinates, floor: expected.total(), trials }
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
            excess_removed: (excess > SLIGHT * self.floor).then(|| 1.0 - (extended - self.floor) / excess),
        }
    }
}

/// What a model gains over the base model, on trials and on settings that it was not fitted to.
pub fn gain(
    base: &Fitted,
    best: Option<&Fitted>,
    settings: &[usize],
    count: usize,
    scale: &Scale,
) -> PredictionGain {
    let loss = |f: &Fitted| at_other_settings(f, settings, count);
    PredictionGain {
        held_out: best.map(|f| scale.gain(held(base), held(f))),
        extrapolation: best.and_then(|f| Some(scale.gain(loss(base)?, loss(f)?))),
    }
}

/// What the base model leaves.
pub fn residual(
    base: &Fitted,
    windows: &[Window],
    expected: &Expected,
    noise: &Noise,
    scale: &Scale,
) -> BaseMisfit {
    let (autocorrelation, whiteness_p) = whiteness(windows, &base.pass.residuals);
    BaseMisfit {
        base_rmse: root_mean_square(windows, &base.pass.residuals),
        floor_rmse: scale.rmse(expected.total()),
        lack_of_fit_p: expected.misfit_of(base, windows).1,
        whiteness_p,
        autocorrelation,
        noise_correlation: noise.rho,
    }
}

/// Loss at each setting of a fit to the others; `None` without two settings of three trials or more.
fn at_other_settings(f: &Fitted, settings: &[usize], count: usize) -> Option<f64> {
    let sizes: Vec<usize> = (0..count).map(|s| settings.iter().filter(|g| **g == s).count()).collect();
    let enough = sizes.iter().filter(|s| **s >= 3).count() >= 2 && sizes.iter().all(|s| *s > 0);
    let of = || leave_out(&f.layout, &f.state.values, &f.pass.trials, settings, settings, &[]).0;
    enough.then(|| of().iter().sum())
}

/// Share of the base's excess over the noise floor that a model leaves; `None` where there is none to speak of.
pub fn unexplained(base: &Fitted, model: &Fitted, expected: &Expected, windows: &[Window]) -> Option<f64> {
    let (excess, _) = expected.misfit_of(base, windows);
    let (left, _) = expected.misfit_of(model, windows);
    (excess > SLIGHT).then(|| (left / excess).clamp(0.0, 1.0))
}

/// Root of the mean square of all coordinates that count, m.
fn root_mean_square(windows: &[Window], residuals: &[Vec<f64>]) -> f64 {
    let (mut square, mut count) = (0.0, 0.0);
    for (window, residuals) in windows.iter().zip(residuals) {
        square += window.averaged.square;
        for (i, r) in residuals.iter().enumerate().filter(|(_, r)| r.is_finite()) {
            let weight = window.points[i / 2].weight;
            (square, count) = (square + weight * r * r, count + weight);
        }
    }
    (square / f64::max(count, 1.0)).sqrt()
}

/// Lag-1 correlation of residuals, and p of its being nothing.
fn whiteness(windows: &[Window], residuals: &[Vec<f64>]) -> (f64, f64) {
    let (mut squares, mut products, mut count) = (0.0, 0.0, 0.0);
    for (window, r) in windows.iter().zip(residuals).filter(|(w, _)| w.kind != Kind::Contact) {
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
    (rho, (2.0 * normal_above(rho.abs() * f64::sqrt(count))).min(1.0))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::discover::fixture::flights;

    #[test]
    fn a_gain_is_the_share_of_the_excess_that_goes() {
        let scale = Scale { noise: 0.002, coordinates: 100.0, floor: 90.0, trials: 5 };
        let gain = scale.gain(490.0, 190.0);
        assert_eq!(gain.excess_removed, Some(0.75));
        assert!((gain.floor_rmse - 0.002 * 0.9f64.sqrt()).abs() < 1e-15);
        assert_eq!(scale.gain(91.0, 80.0).excess_removed, None, "no excess to speak of");
    }

    #[test]
    fn what_does_not_count_is_in_no_mean() {
        let (windows, _) = flights([0.0; 2], 2);
        assert_eq!(root_mean_square(&windows, &[vec![3.0, f64::NAN], vec![4.0]]), 12.5f64.sqrt());
    }
}
