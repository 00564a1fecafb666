//! Bayesian selection among sets of effects.
//!
//! Every set is a mixed-effects model with a shared discrepancy (`discrepancy`). Its evidence is computed by
//! Laplace's method (`laplace`) with heavy-tailed priors of the parameters (`prior`); variance components are
//! estimated once, from the richest model (`context`). `candidates`, `start_grid`: candidate effects and
//! their initial values; `screening`: score tests of candidates; `search`: fitted sets. `explained`: share of the predictable misfit that a set
//! explains; `decide`: verdict from the posterior over sets; `settings`: thresholds.

pub mod candidates;
mod context;
mod decide;
mod discrepancy;
mod explained;
mod laplace;
mod prior;
mod screening;
pub mod search;
mod settings;
pub mod start_grid;

pub use context::{context, maximise_components};
pub use decide::{Decision, decide};
pub use discrepancy::{SharedDiscrepancy, rms_beyond_gravity};
pub use laplace::{Laplace, at_scale, damped_step, marginal_evidence, profile_log_posterior};
pub use prior::FixedEffectsPrior;
pub use settings::SETTINGS;
