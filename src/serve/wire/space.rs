//! Action and observation spaces.

use serde::Serialize;
use utoipa::ToSchema;

use crate::task::ActionSpace;

/// Actions: vectors in the unit cube, or indices of discrete actions.
#[derive(Serialize, ToSchema)]
pub struct ActionSpaceOut {
    /// Length of an action vector, whose components are from 0 to 1.
    pub dimension: usize,
    /// Number of discrete actions.
    pub count: usize,
    pub components: Vec<ComponentOut>,
}

/// The quantity that an action component sets: `low` at 0, `high` at 1, SI units.
#[derive(Serialize, ToSchema)]
pub struct ComponentOut {
    pub target: String,
    /// `x`, `y`, `radius`, `angle`, `vx`, `vy` or `omega`.
    #[schema(value_type = String)]
    pub set: serde_json::Value,
    pub low: f64,
    pub high: f64,
}

/// Features of an observation and their bounds.
#[derive(Serialize, ToSchema)]
pub struct ObservationSpaceOut {
    pub names: Vec<String>,
    pub low: Vec<f64>,
    pub high: Vec<f64>,
}

impl From<&ActionSpace> for ActionSpaceOut {
    fn from(space: &ActionSpace) -> ActionSpaceOut {
        let component = |c: &crate::task::action::ActionComponent| ComponentOut {
            target: c.target.clone(),
            set: serde_json::json!(c.set),
            low: c.low,
            high: c.high,
        };
        ActionSpaceOut {
            dimension: space.dimension(),
            count: space.count(),
            components: space.components.iter().map(component).collect(),
        }
    }
}
