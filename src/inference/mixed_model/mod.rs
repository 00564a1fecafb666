//! Mixed-effects model of the residuals of all trials, and its fit.

pub mod conditional_modes;
pub mod coordinates;
pub mod cross_validation;
pub mod fitted_model;
pub mod group_statistics;
pub mod groups;
pub mod leave_group_out;
pub mod model_fit;
pub mod random_design;
pub mod variance_components;
