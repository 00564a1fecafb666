//! Latent factors.

use serde::Serialize;
use utoipa::ToSchema;

use crate::world::Latents;

/// Active latent factors; absent where bodies have the scene's own values.
#[derive(Serialize, ToSchema)]
pub struct LatentsOut {
    /// kg/m^2
    #[serde(skip_serializing_if = "Option::is_none")]
    pub density: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub friction: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub restitution: Option<f64>,
}

impl From<Latents> for LatentsOut {
    fn from(l: Latents) -> LatentsOut {
        LatentsOut { density: l.density, friction: l.friction, restitution: l.restitution }
    }
}
