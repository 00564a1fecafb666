//! Means over repetitions with confidence intervals.

use serde::{Deserialize, Serialize};

use crate::distribution::t_quantile;

/// A mean over independent repetitions.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Summary {
    pub mean: f64,
    /// Standard error of the mean; `None` for a single repetition.
    pub standard_error: Option<f64>,
    /// Half-width of the 95 % confidence interval by Student's t; `None` for a single repetition.
    pub half_width: Option<f64>,
    /// Number of repetitions.
    pub n: usize,
}

/// Verdict on a claim.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum ClaimVerdict {
    Reproduced,
    NotReproduced,
    /// Neither, and the difference is smaller than the relevant one.
    Small,
    Undecided,
}

/// A claim of the source with the observed result.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Claim {
    /// Text of the claim.
    pub text: String,
    /// Observed figures.
    pub figure: String,
    pub verdict: ClaimVerdict,
}

impl Summary {
    /// Summary of at least one value.
    pub fn of(values: &[f64]) -> Summary {
        let n = values.len();
        let mean = values.iter().sum::<f64>() / n as f64;
        if n < 2 {
            return Summary { mean, standard_error: None, half_width: None, n };
        }
        let variance = values.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / (n - 1) as f64;
        let error = (variance / n as f64).sqrt();
        let half_width = Some(error * t_quantile(0.05, (n - 1) as f64));
        Summary { mean, standard_error: Some(error), half_width, n }
    }

    /// Whether the mean is above zero, below zero, or not significantly different, with 95 % confidence.
    pub fn above_zero(&self) -> ClaimVerdict {
        match self.half_width {
            Some(w) if self.mean - w > 0.0 => ClaimVerdict::Reproduced,
            Some(w) if self.mean + w < 0.0 => ClaimVerdict::NotReproduced,
            _ => ClaimVerdict::Undecided,
        }
    }

    /// As [`Summary::above_zero`]; if the mean is not significant, tests whether its interval lies within `matters` of zero.
    pub fn above_zero_by(&self, matters: f64) -> ClaimVerdict {
        let within = self.half_width.is_some_and(|w| self.mean.abs() + w < matters);
        match self.above_zero() {
            ClaimVerdict::Undecided if within => ClaimVerdict::Small,
            decided => decided,
        }
    }

    /// `mean +- standard error`, for tables.
    pub fn show(&self, digits: usize) -> String {
        match self.standard_error {
            Some(e) => format!("{:.digits$} +- {e:.digits$}", self.mean),
            None => format!("{:.digits$}", self.mean),
        }
    }
}

impl ClaimVerdict {
    /// Title for tables.
    pub fn title(self) -> &'static str {
        match self {
            ClaimVerdict::Reproduced => "reproduced",
            ClaimVerdict::NotReproduced => "not reproduced",
            ClaimVerdict::Small => "small",
            ClaimVerdict::Undecided => "undecided",
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn matches_analytic_intervals() {
        let s = Summary::of(&[1.0, 2.0, 3.0, 4.0]);
        assert_eq!((s.mean, s.n), (2.5, 4));
        let error = (5.0f64 / 3.0 / 4.0).sqrt();
        assert!((s.standard_error.unwrap() - error).abs() < 1e-12);
        assert!((s.half_width.unwrap() - 3.182_446_305_284 * error).abs() < 1e-9);
        assert_eq!(Summary::of(&[2.0]).half_width, None);
    }

    #[test]
    fn verdicts_require_significance() {
        assert_eq!(Summary::of(&[1.0, 1.1, 0.9]).above_zero(), ClaimVerdict::Reproduced);
        assert_eq!(Summary::of(&[-1.0, -1.1, -0.9]).above_zero(), ClaimVerdict::NotReproduced);
        assert_eq!(Summary::of(&[1.0, -1.1, 0.9]).above_zero(), ClaimVerdict::Undecided);
        assert_eq!(Summary::of(&[1.0]).above_zero(), ClaimVerdict::Undecided);
        let level = Summary::of(&[0.01, -0.01, 0.012, -0.008, 0.001]);
        assert_eq!(level.above_zero_by(0.03), ClaimVerdict::Small);
        assert_eq!(level.above_zero_by(0.01), ClaimVerdict::Undecided);
        assert_eq!(Summary::of(&[0.01, 0.011, 0.009]).above_zero_by(0.03), ClaimVerdict::Reproduced);
        assert_eq!(Summary::of(&[0.0]).above_zero_by(0.03), ClaimVerdict::Undecided);
    }
}
