//! Environments of control tasks: `reset` and `step` for a vector of environments, returns of command sequences, and planning.
//!
//! | module | contents |
//! |---|---|
//! | `physics` | how a world differs from the scene: effects and noise, with what is drawn at a reset |
//! | `model` | a task's mechanism and expressions: motion of states under commands, numbers, rewards |
//! | `world` | a vector of environments with Gymnasium's rules |
//! | `mppi` | planning by sampled commands under a set of possible physics |

mod model;
pub mod mppi;
mod physics;
mod world;

pub use model::{ControlModel, ControlOutcome, ControlState, RewardKind};
pub use physics::ControlPhysics;
pub use world::{ControlStep, ControlUsage, ControlWorld, ControlWorldConfig};
