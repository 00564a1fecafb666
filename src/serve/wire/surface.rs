//! Performance surfaces: how the success of policies depends on the latents assumed in training.

use serde::Serialize;
use serde_json::Value;
use utoipa::ToSchema;

use super::binary_arrays::BinaryArrays;
use crate::estimate::surface::PerformanceSurface;

/// A surface, without its points.
#[derive(Serialize, ToSchema)]
pub struct SurfaceOut {
    pub id: String,
    /// Family.
    pub task: String,
    /// `ideal` or `dqn`.
    pub route: &'static str,
    /// Number of points.
    pub points: usize,
    /// Configuration of its computation.
    #[schema(value_type = Object)]
    pub config: Value,
    /// Mean slopes under the prior.
    pub sensitivities: Vec<SensitivityOut>,
    /// Id of the job that computed it.
    pub job: Option<String>,
    /// Version of the program that computed it.
    pub version: String,
}

/// Sensitivity of performance to one latent.
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
pub struct SurfaceWithPoints {
    #[serde(flatten)]
    pub about: SurfaceOut,
    #[schema(value_type = Object)]
    pub surface: PerformanceSurface,
}

/// All surfaces.
#[derive(Serialize, ToSchema)]
pub struct SurfacesPage {
    pub surfaces: Vec<SurfaceOut>,
    /// Cursor of the next page, if there is one.
    pub next: Option<String>,
}

impl BinaryArrays for SurfaceWithPoints {}
impl BinaryArrays for SurfacesPage {}
