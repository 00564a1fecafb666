//! Trials in, latents out: the cross-entropy method over simulated residuals.
//!
//! [`cem`] proposes and learns from losses (ask, tell); [`fitness`] turns samples and trials into losses;
//! [`interval`] says how well each latent is known, and whether it can be known at all.

pub mod cem;
pub mod fitness;
pub mod interval;

pub use cem::{Cem, CemConfig};
pub use interval::{LatentEstimate, intervals};
