//! Robust loss for segments in which a collision may diverge under any model.

use super::engine_linearization::positions_at_observations;
use super::parameters::ParameterLayout;
use super::segment_data::SegmentData;
use crate::error::Result;
use crate::world::{Rollout, Simulator};

/// Square over its degrees of freedom above which the loss grows logarithmically (Cauchy).
const CAUCHY_THRESHOLD: f64 = 6.0;
/// Square of a diverged trajectory.
const DIVERGED_SQUARE: f64 = 1e12;

/// Losses of many parameter vectors over segments with known initial states.
pub fn robust_losses(
    data: &SegmentData,
    layout: &ParameterLayout,
    all: &[Vec<f64>],
    segments: &[usize],
) -> Result<Vec<f64>> {
    let mut physics = Vec::with_capacity(all.len() * segments.len());
    for w in segments {
        for values in all {
            let segment = &data.segments[*w];
            physics.push((*w, layout.effects_and_latents(values, segment.setting, segment.start)));
        }
    }
    let rollouts: Vec<Rollout> = physics
        .iter()
        .map(|(w, physics)| data.segments[*w].rollout(&data.segments[*w].scene, physics))
        .collect();
    let squares = Simulator::new(data.engine).budget(&data.progress).map(&rollouts, |i, path| {
        let w = physics[i].0;
        let segment = &data.segments[w];
        let off = |(i, v): (usize, &f64)| (segment.observations[i / 2].position[i % 2] - v) / data.sd[w];
        let square: f64 =
            positions_at_observations(segment, &path).iter().enumerate().map(|v| off(v).powi(2)).sum();
        robust_square(
            if square.is_finite() { square } else { DIVERGED_SQUARE },
            2.0 * segment.observations.len() as f64,
        )
    })?;
    let of = |k: usize| squares.iter().skip(k).step_by(all.len()).sum();
    Ok((0..all.len()).map(of).collect())
}

/// Robust loss of a square with `left` degrees of freedom.
pub fn robust_square(square: f64, left: f64) -> f64 {
    if square > CAUCHY_THRESHOLD * left {
        CAUCHY_THRESHOLD * left * (1.0 + (square / (CAUCHY_THRESHOLD * left)).ln())
    } else {
        square
    }
}

/// Square root of the derivative of [`robust_square`]: the scale of a residual in iteratively reweighted
/// least squares.
pub fn irls_scale(square: f64, left: f64) -> f64 {
    if square > CAUCHY_THRESHOLD * left { (CAUCHY_THRESHOLD * left / square).sqrt() } else { 1.0 }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::inference::testing::segments::{one_step_segments, term};
    use crate::world::Engine;

    /// The squared scale is the derivative of the loss.
    #[test]
    fn squared_irls_scale_is_the_slope_of_the_loss() {
        for square in [1.0, 30.0, 100.0, 1e6] {
            let h = 1e-4 * square;
            let slope = (robust_square(square + h, 8.0) - robust_square(square - h, 8.0)) / (2.0 * h);
            assert!((irls_scale(square, 8.0).powi(2) / slope - 1.0).abs() < 1e-6, "{square}");
        }
    }

    /// The true wind has the smallest loss, and losses grow with the distance from it.
    #[test]
    fn true_parameters_have_the_smallest_loss() {
        let (segments, settings) = one_step_segments(0.7);
        let data = SegmentData::new(&segments, &settings, vec![1e-3; segments.len()], Engine::Lanes);
        let layout = ParameterLayout::new(&[], vec![term("wind")], 1);
        let winds = [0.0, 0.5, 0.7, 0.8].map(|w| vec![w, 0.0]);
        let all: Vec<usize> = (0..segments.len()).collect();
        let found = robust_losses(&data, &layout, &winds, &all).unwrap();
        assert!(
            found[2] < 1e-9 && found[2] < found[3] && found[3] < found[1] && found[1] < found[0],
            "{found:?}"
        );
    }
}
