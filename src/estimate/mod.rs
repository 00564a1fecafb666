//! Estimates latent factors from measured trials.
//!
//! - [`cem`]: cross-entropy search over simulated residuals (ask, tell).
//! - [`segment`]: the unit of a trial that is simulated and compared with its observations.
//! - [`loss`]: losses of parameter samples on segments.
//! - [`shooting`]: cuts trials into multiple-shooting segments.
//! - [`refine`]: Gauss-Newton refinement from the end of the search to the optimum.
//! - [`interval`]: identifiability and confidence intervals.
//! - [`surface`]: performance surface of a task over the latents, interpolated by [`gp`].
//! - [`parameter_samples`]: equally weighted samples of a world's parameters; [`discrepancy_forces`]: their
//!   forces without a named effect.
//! - [`sampler`]: posterior samplers.
//! - [`tunenet`]: an estimator learned from pairs of simulated worlds, for comparison.

pub mod cem;
pub mod discrepancy_forces;
pub mod gp;
pub mod interval;
pub mod loss;
pub mod parameter_samples;
pub mod refine;
pub mod sampler;
pub mod segment;
pub mod shooting;
pub mod surface;
pub mod tunenet;

pub use cem::{Cem, CemConfig};
pub use interval::{LatentEstimate, identifiable_coordinates};
pub use parameter_samples::{ParameterSample, ParameterSamples};
pub use refine::{RefinedEstimate, SearchBounds, refine};
pub use segment::TrialSegment;
pub use surface::PerformanceSurface;
