//! Resolution of encoders: the grid on which measured positions lie.
//!
//! A grid is certain where it exists, whatever the motion: it competes with no other effect.

use crate::reality::JointTrial;

/// Minimum number of different positions, and maximum distance of a difference from a multiple of the step, in steps.
const MIN_POSITIONS: usize = 12;
const TOLERANCE: f64 = 0.1;
/// Least share of rounding in the variance of the noise for it to matter.
const LEAST_SHARE: f64 = 0.2;

/// Step of a grid with its standard deviation, rad or m.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct EncoderResolution {
    pub step: f64,
    pub sd: f64,
}

/// The grid of a joint's positions, if rounding to it is a good part of the noise, of standard deviation `noise`.
pub fn encoder_resolution(trials: &[JointTrial], joint: usize, noise: f64) -> Option<EncoderResolution> {
    let mut positions: Vec<f64> = trials.iter().flat_map(|t| &t.positions).map(|row| row[joint]).collect();
    positions.sort_by(f64::total_cmp);
    positions.dedup();
    if positions.len() < MIN_POSITIONS {
        return None;
    }
    let mut differences: Vec<f64> = positions.windows(2).map(|pair| pair[1] - pair[0]).collect();
    differences.sort_by(f64::total_cmp);
    // Printed positions have rounding errors of their own: the step is known better from many of them.
    let (mut step, mut sum, mut count) = (differences[0], 0.0, 0.0);
    for difference in differences {
        let multiple = (difference / step).round();
        if (difference - multiple * step).abs() > TOLERANCE * step {
            return None;
        }
        (sum, count) = (sum + difference, count + multiple);
        step = sum / count;
    }
    let share = step * step / (12.0 * noise * noise);
    (share >= LEAST_SHARE).then_some(EncoderResolution { step, sd: TOLERANCE * step / count })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::world::mechanism::Commands;

    fn resolution_of(of: impl Fn(f64) -> f64) -> Option<EncoderResolution> {
        let times: Vec<f64> = (0..500).map(|i| f64::from(i) * 0.01).collect();
        let positions =
            times.iter().map(|t| vec![of(libm::sin(3.0 * t) + 0.3 * libm::sin(17.0 * t))]).collect();
        let trial = JointTrial { id: "0".into(), times, positions, commands: Commands::default() };
        encoder_resolution(&[trial], 0, 0.0004)
    }

    #[test]
    fn a_grid_is_found_from_printed_positions() {
        let step = std::f64::consts::TAU / 4096.0;
        let printed = |q: f64| (1e6 * step * (q / step).round()).round() / 1e6;
        let own = resolution_of(printed).unwrap();
        assert!((own.step - step).abs() < 1e-6, "{own:?}");
    }

    #[test]
    fn positions_on_no_grid_or_on_a_fine_one_have_no_resolution() {
        assert_eq!(resolution_of(|q| q), None);
        assert_eq!(resolution_of(|q| (1e4 * q).round() / 1e4), None);
    }
}
