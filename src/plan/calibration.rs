//! Calibration of predicted success probabilities.
//!
//! Expected calibration error: ECE = sum over bins of n_b / N |mean predicted - share that succeeded|, bins of equal width
//! (Naeini, Cooper and Hauskrecht 2015; Guo et al. 2017, equation 3). There are ten bins.

use serde::{Deserialize, Serialize};

/// Predicted probabilities compared with observed frequencies.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Calibration {
    /// Expected calibration error, in [0, 1]; 0 without predictions.
    pub error: f64,
    /// The bins that aren't empty, in rising order.
    pub bins: Vec<CalibrationBin>,
}

/// Predictions within one bin.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CalibrationBin {
    /// Index of the bin: [tenth / 10, (tenth + 1) / 10); the last one includes 1.
    pub tenth: usize,
    /// Number of predictions.
    pub count: usize,
    /// Mean predicted probability.
    pub predicted: f64,
    /// Observed frequency of success.
    pub real: f64,
}

/// Calibration of (predicted probability, outcome) pairs; predictions are clamped to [0, 1].
pub fn calibration(predictions: &[(f64, bool)]) -> Calibration {
    let tenth = |p: f64| ((p * N_BINS as f64) as usize).min(N_BINS - 1);
    let bin = |b: usize| {
        let own: Vec<&(f64, bool)> = predictions.iter().filter(|(p, _)| tenth(*p) == b).collect();
        let count = own.len();
        let mean = |of: &dyn Fn(&(f64, bool)) -> f64| own.iter().map(|o| of(o)).sum::<f64>() / count as f64;
        let bin = || CalibrationBin {
            tenth: b,
            count,
            predicted: mean(&|(p, _)| p.clamp(0.0, 1.0)),
            real: mean(&|(_, happened)| f64::from(u8::from(*happened))),
        };
        (count > 0).then(bin)
    };
    let bins: Vec<CalibrationBin> = (0..N_BINS).filter_map(bin).collect();
    let apart = bins.iter().fold(0.0, |sum, b| sum + b.count as f64 * (b.predicted - b.real).abs());
    Calibration { error: apart / predictions.len().max(1) as f64, bins }
}

const N_BINS: usize = 10;

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn weights_bins_by_their_counts() {
        // 30 predictions of 0.25, a third of which are true; 10 of 1.0, none of which is.
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
