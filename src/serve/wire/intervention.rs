//! Interventions.

use serde::Deserialize;
use utoipa::ToSchema;

use super::strict::Object;
use crate::error::{Error, Result};
use crate::task::Intervention;
use crate::task::scene::{Body, Static};

/// Something done in the middle of a rollout: at a moment `at`, s since the start (the nearest time step), of which the
/// observation still shows the state before.
#[derive(Clone, Deserialize, ToSchema)]
#[serde(tag = "type", rename_all = "snake_case", deny_unknown_fields)]
pub enum InterventionIn {
    /// A blow: the velocity changes by impulse / mass at once.
    Impulse {
        /// s; a branch's own moment if absent.
        at: Option<f64>,
        /// Name of a body.
        body: String,
        /// N s; at most 400 m/s times the body's mass.
        impulse: [f64; 2],
        /// Where it acts, m, which also turns the body; at the centre of mass if absent.
        point: Option<[f64; 2]>,
    },
    /// A body is put somewhere, or given another velocity; what is absent stays.
    Set {
        /// s; a branch's own moment if absent.
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
    /// A body comes in, with the density and surface that it says.
    Add {
        /// s; a branch's own moment if absent.
        at: Option<f64>,
        /// As `bodies` of an `iplw.scene/1` document has them.
        #[schema(value_type = Value)]
        body: Object<Body>,
    },
    /// Something that never moves comes in.
    AddStatic {
        /// s; a branch's own moment if absent.
        at: Option<f64>,
        /// As `statics` of an `iplw.scene/1` document has them.
        #[serde(rename = "static")]
        #[schema(value_type = Value)]
        fixed: Object<Static>,
    },
    /// A body or a static is taken away.
    Remove {
        /// s; a branch's own moment if absent.
        at: Option<f64>,
        /// Name of a body or a static.
        body: String,
    },
    /// Those latent factors that are given become others.
    Latents {
        /// s; a branch's own moment if absent.
        at: Option<f64>,
        /// kg/m^2
        density: Option<f64>,
        friction: Option<f64>,
        restitution: Option<f64>,
    },
}

impl InterventionIn {
    /// The intervention, at `moment` if it does not say when.
    pub fn at(self, moment: Option<f64>) -> Result<Intervention> {
        let when = |at: Option<f64>| {
            at.or(moment)
                .ok_or_else(|| Error::input("at", "missing", "a moment, s since the start of the rollout"))
        };
        Ok(match self {
            InterventionIn::Impulse { at, body, impulse, point } => {
                Intervention::Impulse { at: when(at)?, body, impulse, point }
            }
            InterventionIn::Set { at, body, position, angle, velocity, angular_velocity } => {
                Intervention::Set { at: when(at)?, body, position, angle, velocity, angular_velocity }
            }
            InterventionIn::Add { at, body: Object(body) } => Intervention::Add { at: when(at)?, body },
            InterventionIn::AddStatic { at, fixed: Object(fixed) } => {
                Intervention::AddStatic { at: when(at)?, fixed }
            }
            InterventionIn::Remove { at, body } => Intervention::Remove { at: when(at)?, body },
            InterventionIn::Latents { at, density, friction, restitution } => {
                Intervention::Latents { at: when(at)?, density, friction, restitution }
            }
        })
    }
}

/// Interventions, at `moment` if they do not say when; errors are about `field`.
pub fn interventions(
    given: Vec<Object<InterventionIn>>,
    moment: Option<f64>,
    field: &str,
) -> Result<Vec<Intervention>> {
    let one = |(k, Object(own)): (usize, Object<InterventionIn>)| {
        own.at(moment).map_err(|e| e.under(&format!("{field}[{k}]")))
    };
    given.into_iter().enumerate().map(one).collect()
}
