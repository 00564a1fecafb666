//! What counts of windows in which a collision may go another way than simulated, whatever the model.

use super::data::Data;
use super::engine::predicted;
use super::layout::Layout;
use crate::error::Result;
use crate::world::{Rollout, Simulator};

/// Square of a residual, over what noise leaves, from which it counts for less and less (as Cauchy's distribution has it).
const TAME: f64 = 6.0;
/// Square of what diverged.
const DIVERGED: f64 = 1e12;

/// Losses of many values over some of the windows that start from what was seen.
pub fn losses(data: &Data, layout: &Layout, all: &[Vec<f64>], windows: &[usize]) -> Result<Vec<f64>> {
    let mut physics = Vec::with_capacity(all.len() * windows.len());
    for w in windows {
        for values in all {
            let window = &data.windows[*w];
            physics.push((*w, layout.physics(values, window.setting, window.start)));
        }
    }
    let rollouts: Vec<Rollout> = physics
        .iter()
        .map(|(w, physics)| data.windows[*w].rollout(&data.windows[*w].scene, physics))
        .collect();
    let squares = Simulator::new(data.engine).budget(&data.progress).map(&rollouts, |i, path| {
        let w = physics[i].0;
        let window = &data.windows[w];
        let off = |(i, v): (usize, &f64)| (window.points[i / 2].seen[i % 2] - v) / data.sd[w];
        let square: f64 = predicted(window, &path).iter().enumerate().map(|v| off(v).powi(2)).sum();
        tamed(if square.is_finite() { square } else { DIVERGED }, 2.0 * window.points.len() as f64)
    })?;
    let of = |k: usize| squares.iter().skip(k).step_by(all.len()).sum();
    Ok((0..all.len()).map(of).collect())
}

/// A square as it counts, of which noise would leave `left`.
pub fn tamed(square: f64, left: f64) -> f64 {
    if square > TAME * left { TAME * left * (1.0 + (square / (TAME * left)).ln()) } else { square }
}

/// By how much a residual with such a square is made smaller: it then pulls as the slope of [`tamed`] does.
pub fn share(square: f64, left: f64) -> f64 {
    if square > TAME * left { (TAME * left / square).sqrt() } else { 1.0 }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::discover::fixture::{leaps, term};
    use crate::world::Engine;

    /// The share of a residual, squared, is the slope of what its square counts.
    #[test]
    fn a_share_is_the_slope_of_the_loss() {
        for square in [1.0, 30.0, 100.0, 1e6] {
            let h = 1e-4 * square;
            let slope = (tamed(square + h, 8.0) - tamed(square - h, 8.0)) / (2.0 * h);
            assert!((share(square, 8.0).powi(2) / slope - 1.0).abs() < 1e-6, "{square}");
        }
    }

    /// Of winds about the true one it loses least, in order of how far off they are.
    #[test]
    fn the_truth_loses_least() {
        let (windows, settings) = leaps(0.7);
        let data = Data::new(&windows, &settings, vec![1e-3; windows.len()], Engine::Lanes);
        let layout = Layout::new(&[], vec![term("wind")], 1);
        let winds = [0.0, 0.5, 0.7, 0.8].map(|w| vec![w, 0.0]);
        let all: Vec<usize> = (0..windows.len()).collect();
        let found = losses(&data, &layout, &winds, &all).unwrap();
        assert!(
            found[2] < 1e-9 && found[2] < found[3] && found[3] < found[1] && found[1] < found[0],
            "{found:?}"
        );
    }
}
