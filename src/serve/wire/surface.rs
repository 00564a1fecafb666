//! Performance surfaces: how well what is learned at some latents does in a related environment.

use serde::{Deserialize, Serialize};
use serde_json::Value;
use utoipa::ToSchema;

use super::bulk::Bulk;
use crate::estimate::surface::Surface;

/// A surface to find.
#[derive(Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct SurfaceIn {
    /// A family.
    pub task: String,
    /// `ideal` (the default): actions that solve in the simulation are tried first, no learning; `dqn`: a policy is
    /// trained at every point.
    pub route: Option<String>,
    /// Design points, 3 to 5000; default 40.
    pub points: Option<u64>,
    /// Actions sampled per task (ideal) or labelled per training task (dqn); default: the family's own.
    pub actions: Option<u64>,
    /// What is varied: two or three of `density`, `friction`, `restitution`; default friction and restitution.
    pub factors: Option<Vec<String>>,
    pub seed: Option<u64>,
}

/// A surface, without its points.
#[derive(Serialize, ToSchema)]
pub struct SurfaceOut {
    pub id: String,
    /// Family it is about.
    pub task: String,
    /// `ideal` or `dqn`.
    pub route: &'static str,
    /// Number of points it rests on.
    pub points: usize,
    /// How it was found.
    #[schema(value_type = Object)]
    pub config: Value,
    /// Slopes over what the prior holds likely.
    pub sensitivities: Vec<SensitivityOut>,
    /// Id of the job that found it.
    pub job: Option<String>,
    /// Version of the program that found it.
    pub version: String,
}

/// How much performance depends on one latent.
#[derive(Serialize, ToSchema)]
pub struct SensitivityOut {
    pub factor: String,
    /// Mean magnitude of the partial derivative, AUCCESS per unit of the factor.
    pub slope: f64,
    /// The slope times the prior's standard deviation.
    pub stake: f64,
}

/// A surface with its points: `iplw.surface/1`, as `iplw surface` writes it.
#[derive(Serialize, ToSchema)]
pub struct SurfaceWhole {
    #[serde(flatten)]
    pub about: SurfaceOut,
    #[schema(value_type = Object)]
    pub surface: Surface,
}

/// All surfaces.
#[derive(Serialize, ToSchema)]
pub struct Surfaces {
    pub surfaces: Vec<SurfaceOut>,
    /// Cursor of the next page, if there is one.
    pub next: Option<String>,
}

impl Bulk for SurfaceWhole {}
impl Bulk for Surfaces {}
