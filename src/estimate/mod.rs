//! Trials in, latents out: the cross-entropy method over simulated residuals.
//!
//! [`cem`] proposes and learns from losses (ask, tell); [`piece`] is what is simulated for a trial; [`fitness`] turns
//! samples and pieces into losses; [`shooting`] cuts trials into pieces; [`refine`] goes from where the search ends to
//! the optimum; [`interval`] says how well each latent is known, and whether it can be known at all. [`surface`] holds
//! what a task asks of the latents, by way of [`gp`]. [`belief`] is what is known as equally likely worlds, and [`forces`]
//! what of them has no name. [`tunenet`] learns a step of the latents from pairs of worlds, as another estimator to compare with.

pub mod belief;
pub mod cem;
pub mod fitness;
pub mod forces;
pub mod gp;
pub mod interval;
pub mod piece;
pub mod refine;
pub mod sampler;
pub mod shooting;
pub mod surface;
pub mod tunenet;

pub use belief::{Belief, Believed};
pub use cem::{Cem, CemConfig};
pub use interval::{LatentEstimate, told};
pub use piece::Piece;
pub use refine::{Field, Refined, refine};
pub use surface::Surface;
