//! Predicted against real success.
//!
//! Expected calibration error: ECE = sum over bins of n_b / N |mean predicted - share that succeeded|, bins of equal width
//! (Naeini, Cooper and Hauskrecht 2015; Guo et al. 2017, equation 3). Bins are the tenths of [0, 1].

use serde::{Deserialize, Serialize};

/// How far predicted probabilities are from what happens.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Calibration {
    /// Expected calibration error, in [0, 1]; 0 of no predictions.
    pub error: f64,
    /// The tenths of [0, 1] with anything in them, rising.
    pub bins: Vec<Bin>,
}

/// Predictions within a tenth.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Bin {
    /// `[from, to)` in tenths of [0, 1]; the last holds 1, too.
    pub tenth: usize,
    /// How many.
    pub count: usize,
    /// Mean predicted probability.
    pub predicted: f64,
    /// Share that succeeded.
    pub real: f64,
}

/// Of (predicted probability, whether it happened); predictions are taken into [0, 1].
pub fn calibration(predictions: &[(f64, bool)]) -> Calibration {
    let tenth = |p: f64| ((p * TENTHS as f64) as usize).min(TENTHS - 1);
    let bin = |b: usize| {
        let own: Vec<&(f64, bool)> = predictions.iter().filter(|(p, _)| tenth(*p) == b).collect();
        let count = own.len();
        let mean = |of: &dyn Fn(&(f64, bool)) -> f64| own.iter().map(|o| of(o)).sum::<f64>() / count as f64;
        let bin = || Bin {
            tenth: b,
            count,
            predicted: mean(&|(p, _)| p.clamp(0.0, 1.0)),
            real: mean(&|(_, happened)| f64::from(u8::from(*happened))),
        };
        (count > 0).then(bin)
    };
    let bins: Vec<Bin> = (0..TENTHS).filter_map(bin).collect();
    let apart = bins.iter().fold(0.0, |sum, b| sum + b.count as f64 * (b.predicted - b.real).abs());
    Calibration { error: apart / predictions.len().max(1) as f64, bins }
}

const TENTHS: usize = 10;

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn errors_are_weighed_by_how_many_they_are_of() {
        // 30 of 0.25 of which a third happens; 10 of 1, none of which does.
        let mut all: Vec<(f64, bool)> = (0..30).map(|i| (0.25, i % 3 == 0)).collect();
        all.extend([(1.0, false); 10]);
        let found = calibration(&all);
        let wanted = 0.75 * (1.0 / 3.0 - 0.25) + 0.25;
        assert!((found.error - wanted).abs() < 1e-12, "{found:?}");
        let of: Vec<(usize, usize)> = found.bins.iter().map(|b| (b.tenth, b.count)).collect();
        assert_eq!(of, [(2, 30), (9, 10)]);
        assert_eq!(calibration(&[]), Calibration { error: 0.0, bins: Vec::new() });
    }
}
