//! Analyses of single trials: estimates, variation between trials, predictive checks, odd trials.

pub mod between_trial_variation;
pub mod odd_trials;
pub mod per_trial;
pub mod predictive_check;
pub mod predictive_sd;
