//! Mechanisms: planar trees of bodies on joints, in reduced coordinates, without contacts.
//!
//! A scene whose bodies all hang on joints is compiled to a [`Tree`]; [`simulate`] advances batches of
//! [`JointRollout`]s, eight at a time, by the classical Runge-Kutta method with a fixed step. Commands of motors are
//! piecewise constant in time. Effects in joints are in `effect`, one file each.
//!
//! Sources: Featherstone, Rigid Body Dynamics Algorithms (2008), chapters 5 and 6: recursive Newton-Euler algorithm,
//! composite-rigid-body algorithm.
//!
//! Differences from the source: vectors are in world coordinates, with moments about the origin of the world.

mod batch;
mod command;
mod dynamics;
pub mod effect;
mod rollout;
mod torque_field;
mod tree;

pub use batch::simulate;
pub use command::Commands;
pub use dynamics::{RequiredTorques, required_torques};
pub use effect::JointTerm;
pub use rollout::{
    JointMotion, JointRollout, longest_delay, measured_position, rounded_position, scene_terms,
};
pub use torque_field::{FieldShape, TorqueField, TorqueFunction};
pub use tree::{JointStop, Link, Tree};
