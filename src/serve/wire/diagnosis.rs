//! What to diagnose.

use serde::Deserialize;
use utoipa::ToSchema;

use super::strict::Object;
use crate::task::Scene;

/// Measured trials, and the simulation they are held against: `scene` and `trials`, or the `job` that measured them.
#[derive(Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct DiagnosisIn {
    /// An `iplw.scene/1` document: the base model; `calibrate` names the latents to estimate along.
    #[schema(value_type = Option<Object>)]
    pub scene: Option<Object<Scene>>,
    /// Trials as CSV: `trial,t,body,x,y` and optionally `setting,angle,vx,vy,omega`.
    pub trials: Option<String>,
    /// Id of an estimation: its trials so far are diagnosed.
    pub job: Option<String>,
    pub seed: Option<u64>,
}
