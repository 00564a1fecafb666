//! Expected residual sum of squares under noise alone, and the excess of a fit.

use crate::error::Result;
use crate::inference::data::noise::{Noise, expected_rss_moments};
use crate::inference::mixed_model::fitted_model::FittedModel;
use crate::inference::segment::{Segment, SegmentKind};
use crate::inference::statistics::{mean_and_error, t_survival};
use crate::progress::Progress;

/// Expected residual sum of squares by trial, and its variance, under noise alone; in units of the noise.
pub struct ExpectedRss {
    pub mean: Vec<f64>,
    /// Expected sum of squares of contact segments in all trials.
    pub contacts: f64,
    pub variance: Vec<f64>,
    /// Number of coordinates by trial.
    pub coordinates: Vec<f64>,
    /// Relative standard error of the noise variance.
    pub noise_variance_error: f64,
}

/// Residual sum of squares of one trial over its expectation, and the ratio's standard error under noise alone.
pub struct TrialExcess {
    pub ratio: f64,
    pub standard_error: f64,
}

impl ExpectedRss {
    /// Sum over trials, contacts included.
    pub fn total(&self) -> f64 {
        self.mean.iter().sum::<f64>() + self.contacts
    }

    /// Misfit of a fit without contact segments.
    pub fn misfit_of(&self, fit: &FittedModel, segments: &[Segment]) -> (f64, f64) {
        self.misfit(&self.by_trial(&fit.evaluation.squares, segments))
    }

    /// The squares of all segments but contacts by trial, over their expected sums; without trials in which nothing is expected.
    pub fn excess_by_trial(&self, squares: &[f64], segments: &[Segment]) -> Vec<TrialExcess> {
        let sums = self.by_trial(squares, segments);
        let of = |(i, sum): (usize, &f64)| {
            let (mean, variance) = (self.mean[i], self.variance[i]);
            let relative = variance / (mean * mean) + self.noise_variance_error.powi(2);
            (mean > 0.0).then(|| TrialExcess { ratio: sum / mean, standard_error: relative.sqrt() })
        };
        sums.iter().enumerate().filter_map(of).collect()
    }

    fn by_trial(&self, squares: &[f64], segments: &[Segment]) -> Vec<f64> {
        let mut sums = vec![0.0; self.mean.len()];
        for (w, segment) in segments.iter().enumerate().filter(|(_, w)| !w.kind.is_impact()) {
            sums[segment.trial] += squares[w];
        }
        sums
    }

    /// Excess over the expected sum as a share of it, and the one-sided p-value of no excess, with trials as
    /// units.
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

/// Expected residual sums of squares of segments; `sd`: of each segment's residuals, m.
pub fn expected_rss(
    segments: &[Segment],
    sd: &[f64],
    trials: usize,
    noise: &Noise,
    progress: &dyn Progress,
) -> Result<ExpectedRss> {
    let mut out = ExpectedRss {
        mean: vec![0.0; trials],
        contacts: 0.0,
        variance: vec![0.0; trials],
        coordinates: vec![0.0; trials],
        noise_variance_error: noise.relative_variance_error(),
    };
    for (w, _) in segments.iter().zip(sd).filter(|(_, sd)| sd.is_finite()) {
        progress.check_stop()?;
        let n = w.observations.iter().filter(|p| p.weight > 0.0).count() as f64;
        let axes = w.smooth.as_ref().map_or(2.0, |s| s.axes);
        let (mean, variance) = match w.kind {
            SegmentKind::Flight | SegmentKind::Rolling => {
                let times: Vec<f64> = w.observations.iter().map(|p| p.time).collect();
                let weights: Vec<f64> = w.observations.iter().map(|p| p.weight).collect();
                expected_rss_moments(&times, &weights, axes, noise.rho)
            }
            SegmentKind::Contact | SegmentKind::Landing | SegmentKind::Collision => {
                out.contacts += w.impact_degrees_of_freedom();
                out.coordinates[w.trial] += 2.0 * n;
                continue;
            }
            SegmentKind::Sliding
            | SegmentKind::FromInitialState
            | SegmentKind::OneStep
            | SegmentKind::MultiStep => {
                let left = (2.0 * n - w.nuisances.len() as f64).max(1.0);
                (left, 2.0 * left)
            }
        };
        out.mean[w.trial] += mean.max(0.0);
        out.variance[w.trial] += variance;
        out.coordinates[w.trial] += axes * n;
    }
    Ok(out)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::inference::testing::segments::{flights, multi_step_segments};
    use crate::progress::NoProgress;

    fn noise() -> Noise {
        Noise { sd: 1e-3, rho: 0.0, degrees_of_freedom: 1e3 }
    }

    /// Degrees of freedom: coordinates minus nuisances.
    #[test]
    fn expected_rss_excludes_nuisances() {
        let (segments, _) = flights([0.0, 0.0], 2);
        let flown = expected_rss(&segments, &[1e-3, f64::INFINITY], 2, &noise(), &NoProgress).unwrap();
        assert!((flown.mean[0] - 36.0).abs() < 1e-9 && flown.coordinates == [40.0, 0.0], "{:?}", flown.mean);
        assert_eq!(flown.mean[1], 0.0, "unused segments have no residual");
        let (segments, _) = multi_step_segments();
        assert_eq!(expected_rss(&segments, &[1e-3], 1, &noise(), &NoProgress).unwrap().total(), 16.0 - 10.0);
    }

    /// Noise alone is no misfit; twice its square in every trial is an excess of 1.
    #[test]
    fn misfit_is_the_excess_over_the_expectation() {
        let (segments, _) = flights([0.0, 0.0], 8);
        let expected = expected_rss(&segments, &[1e-3; 8], 8, &noise(), &NoProgress).unwrap();
        let (share, p) = expected.misfit(&expected.mean);
        assert!(share.abs() < 1e-12 && (p - 0.5).abs() < 1e-9);
        let (share, p) = expected.misfit(&[72.0; 8]);
        assert!((share - 1.0).abs() < 1e-9 && p < 1e-3, "{share} {p}");
    }
}
