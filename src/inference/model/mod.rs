//! Models and their linearization by simulation.
//!
//! `parameters`: the parameter vector. `segment_data`: fixed data; `fit_state`: parameters, nuisances and
//! random effects. `finite_differences`: predictions with Jacobians; `engine_linearization`: the same by a
//! physics engine. `linearization`: whitened residuals and Jacobians, nuisances projected out; `robust_loss`:
//! loss of chaotic segments. `least_squares`: fits. `prediction`: predictions without derivatives;
//! `trajectory_quantities`: states and accelerations along trajectories.

mod engine_linearization;
mod finite_differences;
mod fit_state;
mod least_squares;
mod linearization;
mod parameters;
mod prediction;
mod robust_loss;
mod segment_data;
mod trajectory_quantities;

pub use engine_linearization::{apply_initial_state, cache_jacobians, positions_at_observations};
pub use fit_state::{FitState, Perturbation, RandomEffects};
pub use least_squares::{FitEvaluation, NormalEquations, fit, sum_by_trial, total_square};
pub use linearization::{Linearization, linearise};
pub use parameters::{Bracket, Parameter, ParameterKind, ParameterLayout, Term};
pub use prediction::{predict, predict_segment};
pub use robust_loss::robust_losses;
pub use segment_data::{CachedJacobian, SegmentData};
pub use trajectory_quantities::{accelerations, impact, segment_states};
