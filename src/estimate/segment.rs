//! A trial, or a segment of one, as a unit of simulation and comparison.

use nalgebra::{DMatrix, DVector};

use crate::reality::Trial;
use crate::residual::{position_residuals, sum_of_squares};
use crate::task::Scene;
use crate::trajectory::Trajectory;

/// A segment of a trial.
#[derive(Clone, Debug)]
pub struct TrialSegment {
    /// Index of the trial: segments of one trial are not independent.
    pub trial: usize,
    /// The scene in its state at the start of the segment, simulated up to the last observation.
    pub scene: Scene,
    /// Observations; times are relative to the start of the segment, s.
    pub observed: Trajectory,
    /// Whitening of the residuals; `None` weights all residuals equally.
    pub whitening: Option<ResidualWhitening>,
}

/// Whitening of residuals for a segment with an uncertain initial state, and the saturation of its loss.
#[derive(Clone, Debug)]
pub struct ResidualWhitening {
    /// Lower Cholesky factor of the residuals' covariance, in units of the variance of an observed coordinate;
    /// `None` for an exactly known initial state.
    pub factor: Option<DMatrix<f64>>,
    /// A loss `l` counts as `l / (1 + l / loss_scale)`, m^2, so that one chaotic segment cannot dominate the
    /// others.
    pub loss_scale: f64,
}

impl TrialSegment {
    /// Every trial as one segment.
    pub fn whole_trials(trials: &[Trial]) -> Vec<TrialSegment> {
        let segment = |(trial, t): (usize, &Trial)| TrialSegment {
            trial,
            scene: replay_scene(t),
            observed: t.observed.clone(),
            whitening: None,
        };
        trials.iter().enumerate().map(segment).collect()
    }

    /// Contribution of a simulated segment to a sample's loss, m^2.
    pub fn loss(&self, simulated: &Trajectory) -> f64 {
        match &self.whitening {
            None => sum_of_squares(&self.observed, simulated),
            Some(whitening) => {
                let square: f64 = match whitening.factor {
                    None => sum_of_squares(&self.observed, simulated),
                    Some(_) => finite_sum_of_squares(&self.residuals(simulated)),
                };
                square / (1.0 + square / whitening.loss_scale)
            }
        }
    }

    /// Whitened residuals: observed minus simulated positions, m; NaN where either is missing.
    pub fn residuals(&self, simulated: &Trajectory) -> Vec<f64> {
        let mut raw = position_residuals(&self.observed, simulated);
        let Some(factor) = self.whitening.as_ref().and_then(|w| w.factor.as_ref()) else { return raw };
        if factor.nrows() != raw.len() || raw.iter().any(|r| r.is_nan()) && raw.iter().all(|r| r.is_nan()) {
            return raw;
        }
        // A missing observation is uncorrelated with the others, so it enters as 0.
        let missing: Vec<bool> = raw.iter().map(|r| r.is_nan()).collect();
        raw.iter_mut().filter(|r| r.is_nan()).for_each(|r| *r = 0.0);
        let white = factor.solve_lower_triangular(&DVector::from_vec(raw));
        let white = white.map_or_else(|| vec![f64::NAN; missing.len()], |w| w.as_slice().to_vec());
        white.into_iter().zip(missing).map(|(w, gone)| if gone { f64::NAN } else { w }).collect()
    }
}

/// Sum of the squares of the finite values.
pub fn finite_sum_of_squares(values: &[f64]) -> f64 {
    values.iter().filter(|v| v.is_finite()).map(|v| v * v).sum()
}

/// The scene that replays a trial up to its last observation, without goal.
pub fn replay_scene(trial: &Trial) -> Scene {
    let mut scene = trial.scene.clone();
    scene.goal = None;
    truncate_to_last_observation(scene, &trial.observed)
}

/// The scene with the number of steps that reaches the last observation.
pub fn truncate_to_last_observation(mut scene: Scene, observed: &Trajectory) -> Scene {
    let last = observed.times.last().copied().unwrap_or(0.0);
    scene.steps = ((last / scene.time_step - 1e-6).ceil() as u32).clamp(1, 1_000_000);
    scene
}
