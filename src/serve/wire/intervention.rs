//! Interventions.

use serde::Deserialize;
use utoipa::ToSchema;

use crate::error::{Error, Result};
use crate::json::JsonObject;
use crate::task::Intervention;
use crate::task::scene::{Body, Static};

/// A change during a rollout at time `at`, s since the start, rounded to the nearest time step. The observation at that time
/// shows the state before the change.
#[derive(Clone, Deserialize, ToSchema)]
#[serde(tag = "type", rename_all = "snake_case", deny_unknown_fields)]
pub enum InterventionIn {
    /// Applies an impulse: the velocity changes by impulse / mass.
    Impulse {
        /// s. Default: the time of the branch.
        at: Option<f64>,
        /// Name of a body.
        body: String,
        /// N s; at most 400 m/s times the body's mass.
        impulse: [f64; 2],
        /// Point of application, m, which also changes the angular velocity. Default: the centre of mass.
        point: Option<[f64; 2]>,
    },
    /// Sets a body's pose or velocity; absent values stay unchanged.
    Set {
        /// s. Default: the time of the branch.
        at: Option<f64>,
        /// Name of a body.
        body: String,
        /// m
        position: Option<[f64; 2]>,
        /// rad
        angle: Option<f64>,
        /// m/s
        velocity: Option<[f64; 2]>,
        /// rad/s
        angular_velocity: Option<f64>,
    },
    /// Adds a body with its own density and surface coefficients.
    Add {
        /// s. Default: the time of the branch.
        at: Option<f64>,
        /// A body as in `bodies` of an `iplw.scene/1` document.
        #[schema(value_type = Value)]
        body: JsonObject<Body>,
    },
    /// Adds a static object.
    AddStatic {
        /// s. Default: the time of the branch.
        at: Option<f64>,
        /// A static as in `statics` of an `iplw.scene/1` document.
        #[serde(rename = "static")]
        #[schema(value_type = Value)]
        fixed: JsonObject<Static>,
    },
    /// Removes a body or a static.
    Remove {
        /// s. Default: the time of the branch.
        at: Option<f64>,
        /// Name of a body or a static.
        body: String,
    },
    /// Changes the given latent factors.
    Latents {
        /// s. Default: the time of the branch.
        at: Option<f64>,
        /// kg/m^2
        density: Option<f64>,
        friction: Option<f64>,
        restitution: Option<f64>,
    },
}

impl InterventionIn {
    /// The intervention; `moment` is the default of its time.
    pub fn at(self, moment: Option<f64>) -> Result<Intervention> {
        let when = |at: Option<f64>| {
            at.or(moment)
                .ok_or_else(|| Error::input("at", "missing", "a time, s since the start of the rollout"))
        };
        Ok(match self {
            InterventionIn::Impulse { at, body, impulse, point } => {
                Intervention::Impulse { at: when(at)?, body, impulse, point }
            }
            InterventionIn::Set { at, body, position, angle, velocity, angular_velocity } => {
                Intervention::Set { at: when(at)?, body, position, angle, velocity, angular_velocity }
            }
            InterventionIn::Add { at, body: JsonObject(body) } => Intervention::Add { at: when(at)?, body },
            InterventionIn::AddStatic { at, fixed: JsonObject(fixed) } => {
                Intervention::AddStatic { at: when(at)?, fixed }
            }
            InterventionIn::Remove { at, body } => Intervention::Remove { at: when(at)?, body },
            InterventionIn::Latents { at, density, friction, restitution } => {
                Intervention::Latents { at: when(at)?, density, friction, restitution }
            }
        })
    }
}

/// Converts interventions; `moment` is the default of their time. Errors name `field`.
pub fn interventions(
    given: Vec<JsonObject<InterventionIn>>,
    moment: Option<f64>,
    field: &str,
) -> Result<Vec<Intervention>> {
    let one = |(k, JsonObject(own)): (usize, JsonObject<InterventionIn>)| {
        own.at(moment).map_err(|e| e.in_field(&format!("{field}[{k}]")))
    };
    given.into_iter().enumerate().map(one).collect()
}
