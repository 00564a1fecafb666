//! The trials of a diagnosis.

use std::collections::BTreeMap;

use serde::Serialize;
use utoipa::ToSchema;

use super::ask_tell::TrackOut;
use super::binary_arrays::BinaryArrays;
use crate::reality::Trial;
use crate::task::Scene;

/// The trials of a diagnosis.
#[derive(Serialize, ToSchema)]
pub struct DiagnosisTrials {
    /// An `iplw.scene/1` document: the base model.
    #[schema(value_type = Object)]
    pub scene: Scene,
    /// In the order of the request.
    pub trials: Vec<DiagnosisTrialOut>,
    /// Cursor of the next page, if there is one.
    pub next: Option<String>,
}

/// A trial of a diagnosis.
#[derive(Serialize, ToSchema)]
pub struct DiagnosisTrialOut {
    /// Name of the trial.
    pub trial: String,
    /// Setting of the scene, if it has settings.
    pub setting: Option<String>,
    /// Times, s.
    pub t: Vec<f64>,
    /// By body name, one state per time.
    pub bodies: BTreeMap<String, TrackOut>,
}

impl From<Trial> for DiagnosisTrialOut {
    fn from(trial: Trial) -> DiagnosisTrialOut {
        let Trial { name, setting, observed, .. } = trial;
        let bodies = observed.bodies.iter().map(|track| (track.name.clone(), track.into())).collect();
        DiagnosisTrialOut { trial: name, setting, t: observed.times, bodies }
    }
}

impl BinaryArrays for DiagnosisTrials {}
