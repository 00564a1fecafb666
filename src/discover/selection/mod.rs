//! Bayesian selection among sets of effects.
//!
//! Every set is a mixed-effects model with a discrepancy that all trials share (`discrepancy`). Its evidence is computed by
//! Laplace's method (`laplace`), parameters having heavy-tailed priors (`prior`); variance components are estimated once, from the richest model (`context`). `explained`: the
//! share of the predictable misfit that a set explains; `decide`: from the posterior over sets to a verdict; `settings`: the
//! constants that decide.

pub mod candidates;
mod context;
mod decide;
mod discrepancy;
mod explained;
mod laplace;
mod prior;
pub mod search;
mod settings;
pub mod start_grid;

pub use context::context;
pub use decide::{Decision, decide};
pub use discrepancy::SharedDiscrepancy;
pub use laplace::{Laplace, at_scale, marginal_evidence, profile_log_posterior};
pub use prior::FixedEffectsPrior;
pub use settings::SETTINGS;
