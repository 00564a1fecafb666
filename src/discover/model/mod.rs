//! A candidate model, and how the windows' residuals depend on it, by simulation only.
//!
//! `layout`: latents to calibrate and effect terms with their parameters, laid out as one vector. `data`: what is fixed during
//! a diagnosis; `state`: where a fit stands. `moved`: what windows show, and by how much more when a number moves; `engine`: the same of those that a
//! world's engine simulates. `look`: residuals and derivatives in units of the noise, starts projected out; `loss`: how much
//! what went astray counts. `least_squares`: fits. `along`: what happens along fitted paths; `shown`: what
//! windows show, without derivatives.

mod along;
mod data;
mod engine;
mod layout;
mod least_squares;
mod look;
mod loss;
mod moved;
mod shown;
mod state;

pub use along::{accelerations, impact, segment_states};
pub use data::{CachedJacobian, SegmentData};
pub use engine::{apply_initial_state, cache_jacobians, positions_at_observations};
pub use layout::{Parameter, ParameterKind, ParameterLayout, Term};
pub use least_squares::{FitEvaluation, NormalEquations, fit, sum_by_trial, total_square};
pub use look::{Linearization, linearise};
pub use loss::robust_losses;
pub use shown::{predict, predict_segment};
pub use state::{FitState, Perturbation, RandomEffects};
