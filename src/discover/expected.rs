//! What would be left if only noise were, and how far a fit is above it.

use super::fit::FittedModel;
use super::noise::{Noise, expected_rss_moments};
use super::stats::{mean_and_error, t_survival};
use super::window::{Segment, SegmentKind};

/// Expected sum of squares by trial, and its variance, if only noise were left; units of the noise.
pub struct ExpectedRss {
    pub mean: Vec<f64>,
    /// Sum of squares that contact windows leave in all trials, if contacts are as good as the usual one.
    pub contacts: f64,
    pub variance: Vec<f64>,
    /// Number of coordinates by trial.
    pub coordinates: Vec<f64>,
    /// Relative error of the noise's own variance.
    pub noise_variance_error: f64,
}

impl ExpectedRss {
    /// Sum over trials, contacts and all.
    pub fn total(&self) -> f64 {
        self.mean.iter().sum::<f64>() + self.contacts
    }

    /// [`Expected::misfit`] of a fit, by its flights and runs: what a contact leaves is not what noise leaves.
    pub fn misfit_of(&self, fit: &FittedModel, windows: &[Segment]) -> (f64, f64) {
        let mut squares = vec![0.0; self.mean.len()];
        for (w, window) in windows.iter().enumerate().filter(|(_, w)| w.kind != SegmentKind::Contact) {
            squares[window.trial] += fit.evaluation.squares[w];
        }
        self.misfit(&squares)
    }

    /// Excess over the floor as a share of it, and the one-sided p, by trial, of the hypothesis that there is none.
    fn misfit(&self, squares: &[f64]) -> (f64, f64) {
        let excess: Vec<f64> = squares.iter().zip(&self.mean).map(|(s, m)| s - m).collect();
        let g = excess.len() as f64;
        let (mean, error) = mean_and_error(&excess);
        let expected_error = self.variance.iter().sum::<f64>().sqrt() / g;
        let all = self.mean.iter().sum::<f64>();
        let floor = all / g * self.noise_variance_error;
        let se = (error.max(expected_error).powi(2) + floor * floor).sqrt();
        (mean * g / all.max(1e-9), t_survival(mean / se.max(1e-12), g - 1.0))
    }
}

/// What noise alone would leave of some windows; `sd`: of each window's residuals, m.
pub fn expected_rss(windows: &[Segment], sd: &[f64], trials: usize, noise: &Noise) -> ExpectedRss {
    let mut out = ExpectedRss {
        mean: vec![0.0; trials],
        contacts: 0.0,
        variance: vec![0.0; trials],
        coordinates: vec![0.0; trials],
        noise_variance_error: noise.relative_variance_error(),
    };
    for (w, _) in windows.iter().zip(sd).filter(|(_, sd)| sd.is_finite()) {
        let n = w.observations.iter().filter(|p| p.weight > 0.0).count() as f64;
        let axes = w.smooth.as_ref().map_or(2.0, |s| s.axes);
        let (mean, variance) = match w.kind {
            SegmentKind::Flight | SegmentKind::Rolling => {
                let times: Vec<f64> = w.observations.iter().map(|p| p.time).collect();
                let weights: Vec<f64> = w.observations.iter().map(|p| p.weight).collect();
                expected_rss_moments(&times, &weights, axes, noise.rho)
            }
            SegmentKind::Contact => {
                out.contacts += 2.0 * n - 5.0;
                out.coordinates[w.trial] += 2.0 * n;
                continue;
            }
            SegmentKind::FromInitialState | SegmentKind::OneStep | SegmentKind::MultiStep => {
                let left = (2.0 * n - w.nuisances.len() as f64).max(1.0);
                (left, 2.0 * left)
            }
        };
        out.mean[w.trial] += mean.max(0.0);
        out.variance[w.trial] += variance;
        out.coordinates[w.trial] += axes * n;
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::discover::fixture::{flights, multi_step_segments};

    fn noise() -> Noise {
        Noise { sd: 1e-3, rho: 0.0, degrees_of_freedom: 1e3 }
    }

    /// 20 observations of two coordinates less a start; 4 observations of two bodies less a position, velocity and spin each.
    #[test]
    fn what_a_start_takes_up_is_not_expected() {
        let (windows, _) = flights([0.0, 0.0], 2);
        let flown = expected_rss(&windows, &[1e-3, f64::INFINITY], 2, &noise());
        assert!((flown.mean[0] - 36.0).abs() < 1e-9 && flown.coordinates == [40.0, 0.0], "{:?}", flown.mean);
        assert_eq!(flown.mean[1], 0.0, "what is left out leaves nothing");
        let (windows, _) = multi_step_segments();
        assert_eq!(expected_rss(&windows, &[1e-3], 1, &noise()).total(), 16.0 - 10.0);
    }

    /// What noise alone leaves is no misfit; twice as much in every trial is one of a whole floor, and sure.
    #[test]
    fn misfit_is_what_is_above_the_floor() {
        let (windows, _) = flights([0.0, 0.0], 8);
        let expected = expected_rss(&windows, &[1e-3; 8], 8, &noise());
        let (share, p) = expected.misfit(&expected.mean);
        assert!(share.abs() < 1e-12 && (p - 0.5).abs() < 1e-9);
        let (share, p) = expected.misfit(&[72.0; 8]);
        assert!((share - 1.0).abs() < 1e-9 && p < 1e-3, "{share} {p}");
    }
}
