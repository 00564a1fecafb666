//! Means over repetitions, with honest uncertainty.

use serde::{Deserialize, Serialize};

use crate::distribution::t_quantile;

/// A mean over independent repetitions.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Summary {
    pub mean: f64,
    /// Of the mean; `None` for a single repetition.
    pub standard_error: Option<f64>,
    /// Half the width of the 95 % interval by Student's t; `None` for a single repetition.
    pub half_width: Option<f64>,
    /// Repetitions.
    pub n: usize,
}

/// What can be said of a claim.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Verdict {
    Reproduced,
    NotReproduced,
    /// Neither, and whatever difference there is, is smaller than what would matter.
    Small,
    Undecided,
}

/// A claim of the source, and what was found.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Claim {
    /// What is claimed.
    pub text: String,
    /// The number it is judged by.
    pub figure: String,
    pub verdict: Verdict,
}

impl Summary {
    /// Of at least one value.
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

    /// Whether the mean is above zero, below it, or cannot be told from it, with 95 % confidence.
    pub fn above_zero(&self) -> Verdict {
        match self.half_width {
            Some(w) if self.mean - w > 0.0 => Verdict::Reproduced,
            Some(w) if self.mean + w < 0.0 => Verdict::NotReproduced,
            _ => Verdict::Undecided,
        }
    }

    /// As [`Summary::above_zero`]; where the mean cannot be told from zero, whether it lies within `matters` of it.
    pub fn above_zero_by(&self, matters: f64) -> Verdict {
        let within = self.half_width.is_some_and(|w| self.mean.abs() + w < matters);
        match self.above_zero() {
            Verdict::Undecided if within => Verdict::Small,
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

impl Verdict {
    /// For tables.
    pub fn title(self) -> &'static str {
        match self {
            Verdict::Reproduced => "reproduced",
            Verdict::NotReproduced => "not reproduced",
            Verdict::Small => "small",
            Verdict::Undecided => "undecided",
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn intervals_by_hand() {
        let s = Summary::of(&[1.0, 2.0, 3.0, 4.0]);
        assert_eq!((s.mean, s.n), (2.5, 4));
        let error = (5.0f64 / 3.0 / 4.0).sqrt();
        assert!((s.standard_error.unwrap() - error).abs() < 1e-12);
        assert!((s.half_width.unwrap() - 3.182_446_305_284 * error).abs() < 1e-9);
        assert_eq!(Summary::of(&[2.0]).half_width, None);
    }

    #[test]
    fn verdicts_need_evidence() {
        assert_eq!(Summary::of(&[1.0, 1.1, 0.9]).above_zero(), Verdict::Reproduced);
        assert_eq!(Summary::of(&[-1.0, -1.1, -0.9]).above_zero(), Verdict::NotReproduced);
        assert_eq!(Summary::of(&[1.0, -1.1, 0.9]).above_zero(), Verdict::Undecided);
        assert_eq!(Summary::of(&[1.0]).above_zero(), Verdict::Undecided);
        let level = Summary::of(&[0.01, -0.01, 0.012, -0.008, 0.001]);
        assert_eq!(level.above_zero_by(0.03), Verdict::Small);
        assert_eq!(level.above_zero_by(0.01), Verdict::Undecided);
        assert_eq!(Summary::of(&[0.01, 0.011, 0.009]).above_zero_by(0.03), Verdict::Reproduced);
        assert_eq!(Summary::of(&[0.0]).above_zero_by(0.03), Verdict::Undecided);
    }
}
