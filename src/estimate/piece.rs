//! What a sample is compared with: a trial, or a stretch of one, as something to simulate.

use nalgebra::{DMatrix, DVector};

use crate::reality::Trial;
use crate::residual::{differences, summed_squares};
use crate::task::Scene;
use crate::trajectory::Trajectory;

/// A stretch of a trial.
#[derive(Clone, Debug)]
pub struct Piece {
    /// Number of the trial it is cut from: pieces of one trial are not independent.
    pub trial: usize,
    /// The scene as it stands where the stretch begins, to be simulated up to its last observation.
    pub scene: Scene,
    /// What was observed in it; times count from its begin, s.
    pub observed: Trajectory,
    /// How the differences are weighed; `None` weighs every one alike.
    pub weighing: Option<Weighing>,
}

/// Weights for a piece whose start is not exactly known, and a bound on what one piece can add to a loss.
#[derive(Clone, Debug)]
pub struct Weighing {
    /// Lower Cholesky factor of the differences' covariance, in units of the variance of an observed coordinate;
    /// `None` for an exactly known start.
    pub factor: Option<DMatrix<f64>>,
    /// A loss of `l` counts as `l / (1 + l / bound)`, m^2: a piece that chance has made chaotic cannot outvote
    /// the others.
    pub bound: f64,
}

impl Piece {
    /// Every trial from its start to its end.
    pub fn whole(trials: &[Trial]) -> Vec<Piece> {
        let piece = |(trial, t): (usize, &Trial)| Piece {
            trial,
            scene: replay(t),
            observed: t.observed.clone(),
            weighing: None,
        };
        trials.iter().enumerate().map(piece).collect()
    }

    /// What a simulation of the piece adds to a sample's loss, m^2.
    pub fn loss(&self, simulated: &Trajectory) -> f64 {
        match &self.weighing {
            None => summed_squares(&self.observed, simulated),
            Some(weighing) => {
                let square: f64 = match weighing.factor {
                    None => summed_squares(&self.observed, simulated),
                    Some(_) => self.vector(simulated).iter().filter(|r| r.is_finite()).map(|r| r * r).sum(),
                };
                square / (1.0 + square / weighing.bound)
            }
        }
    }

    /// Observed minus simulated positions, m, made independent of each other; NaN where either is missing.
    pub fn vector(&self, simulated: &Trajectory) -> Vec<f64> {
        let mut raw = differences(&self.observed, simulated);
        let Some(factor) = self.weighing.as_ref().and_then(|w| w.factor.as_ref()) else { return raw };
        if factor.nrows() != raw.len() || raw.iter().any(|r| r.is_nan()) && raw.iter().all(|r| r.is_nan()) {
            return raw;
        }
        // A missing observation has no covariance with others, so it stays out of the way as a 0.
        let missing: Vec<bool> = raw.iter().map(|r| r.is_nan()).collect();
        raw.iter_mut().filter(|r| r.is_nan()).for_each(|r| *r = 0.0);
        let white = factor.solve_lower_triangular(&DVector::from_vec(raw));
        let white = white.map_or_else(|| vec![f64::NAN; missing.len()], |w| w.as_slice().to_vec());
        white.into_iter().zip(missing).map(|(w, gone)| if gone { f64::NAN } else { w }).collect()
    }
}

/// The scene to simulate for a trial: up to its last observation, goals ignored.
pub fn replay(trial: &Trial) -> Scene {
    let mut scene = trial.scene.clone();
    scene.goal = None;
    up_to_last(scene, &trial.observed)
}

/// The scene with as many steps as it takes to reach the last observation.
pub fn up_to_last(mut scene: Scene, observed: &Trajectory) -> Scene {
    let last = observed.times.last().copied().unwrap_or(0.0);
    scene.steps = ((last / scene.time_step - 1e-6).ceil() as u32).clamp(1, 1_000_000);
    scene
}
