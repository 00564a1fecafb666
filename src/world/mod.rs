//! Simulation: scene, latents and effects in, trajectory out.
//!
//! Semantics, the same for every engine:
//! - SI units; gravity is the scene's.
//! - Friction and restitution of a contact follow the scene's mixing rules (by default products, as in
//!   Pymunk).
//! - Each time step, in this order: effects change velocities, gravity acts, contacts are resolved, positions
//!   advance. With the effect `linear_drag` this is Pymunk's damping.
//! - With sensor effects, samples are the measured values; contacts, goals and outcomes are the true ones
//!   (see [`observe`]).
//! - A latent factor sets the coefficient of every carrier, or the density of every carrying body.

mod batch_run;
mod compile;
mod compiled_intervention;
mod contact_criteria;
pub mod effect;
mod engine;
pub mod goal;
mod intervene;
mod lanes;
pub mod latent;
pub mod mechanism;
mod observe;
pub mod parameter_space;
mod partition;
mod rapier;
mod record;
mod rollout;
mod rollout_model;
mod simulator;
mod state;

pub use engine::{Engine, select_engine};
pub use lanes::gpu::{Accelerator, RolloutImages};
pub use lanes::{BatchSettings, SimdLevel};
#[cfg(feature = "levels")]
pub use lanes::{OperationCounts, operations};
pub use latent::Latents;
pub use observe::observe;
pub use parameter_space::{EffectParameter, LINEAR_DRAG, ParameterSpace, ParameterVector};
pub use rollout::Rollout;
pub use simulator::Simulator;
