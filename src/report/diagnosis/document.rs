//! The result of a diagnosis as a document: the diagnosis, the extended scene and the evidence for plots.

use serde::{Deserialize, Serialize};

use crate::inference::DiagnosisResult;
use crate::inference::report::plot_tables::{PlotTables, plot_tables};
use crate::inference::report::{Diagnosis, Verdict};
use crate::task::Scene;

/// The result of a diagnosis, as jobs store it.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct DiagnosisDocument {
    #[serde(flatten)]
    pub diagnosis: Diagnosis,
    /// The scene with the effects found and the fitted latents.
    pub extended_scene: Scene,
    /// The recommended experiment, if it is a throw or a drop.
    #[serde(default)]
    pub next_scene: Option<Scene>,
    /// Empty in results of earlier versions.
    #[serde(default)]
    pub evidence: PlotTables,
}

impl DiagnosisDocument {
    pub fn new(result: &DiagnosisResult) -> DiagnosisDocument {
        DiagnosisDocument {
            diagnosis: result.diagnosis.clone(),
            extended_scene: result.extended.clone(),
            next_scene: result.diagnosis.next_experiment.as_ref().and_then(|n| n.scene.clone()),
            evidence: plot_tables(&result.evidence),
        }
    }

    /// Whether a set of effects is reported.
    pub fn is_extended(&self) -> bool {
        let diagnosis = &self.diagnosis;
        let law = diagnosis.residual_law.as_ref().is_some_and(|l| l.offered);
        !diagnosis.effects.is_empty() && diagnosis.verdict != Verdict::None || law
    }
}

#[cfg(test)]
pub mod tests {
    use super::*;
    use crate::inference::report::{
        EffectEstimate, HeldOutError, ModelScore, ParameterEstimate, PredictionGain, PredictiveCheck,
        TrajectoryResiduals, TrialEffects, TrialPredictiveCheck, TrialResiduals,
    };

    /// A diagnosis of three trials without a verdict's details.
    pub fn document() -> DiagnosisDocument {
        let columns = ["t", "body", "stretch", "x", "y", "before_x", "before_y", "after_x", "after_y"];
        let rows = |trial: usize| -> Vec<Vec<Option<f64>>> {
            let row = |i: usize| {
                let (t, error) = (0.1 * i as f64, 0.01 * (trial + 1) as f64);
                [t, 0.0, 0.0, t, t * t, 2.0 * error * t, 0.03, 0.001, -0.001].map(Some).to_vec()
            };
            (0..6).map(row).collect()
        };
        let launches = (0..3).map(|trial| TrialResiduals { trial, rows: rows(trial) }).collect();
        let name = |trial: usize| ["throw one", "throw seven", "9"][trial].to_string();
        let effects = |trial| TrialEffects { trial, name: name(trial), setting: None, sizes: Vec::new() };
        let check =
            |trial: usize| TrialPredictiveCheck { trial, p: [0.9, 0.5, 0.01][trial], squares: 1.0, count: 1 };
        let diagnosis = Diagnosis {
            launches: (0..3).map(effects).collect(),
            paths: TrajectoryResiduals { columns: columns.map(String::from).to_vec(), launches },
            predictive: Some(PredictiveCheck {
                launches: (0..3).map(check).collect(),
                outside_share: 0.33,
                further_off: vec![2],
                usual_ratio: 1.0,
                uniform_p: 0.5,
                sorted: vec![[0.01, 0.0, 0.7], [0.5, 0.1, 0.9], [0.9, 0.3, 1.0]],
            }),
            ..Diagnosis::default()
        };
        DiagnosisDocument {
            diagnosis,
            extended_scene: Scene::empty(),
            next_scene: None,
            evidence: plot_tables(&Default::default()),
        }
    }

    /// A diagnosis that names quadratic drag.
    pub fn named() -> DiagnosisDocument {
        let mut out = document();
        let k = ParameterEstimate {
            name: "k".into(),
            value: 0.2,
            ci95: [Some(0.19), Some(0.21)],
            unit: "1/m".into(),
            setting: None,
            spread: None,
        };
        let effect = EffectEstimate {
            name: "quadratic_drag".into(),
            acts_on: "motion".into(),
            probability: 0.98,
            parameters: vec![k],
        };
        let held_out = HeldOutError {
            trials: 3,
            base_rmse: 0.15,
            extended_rmse: 0.001,
            floor_rmse: 0.001,
            excess_removed: Some(1.0),
        };
        let score = |effects: &[&str], probability: f64| ModelScore {
            effects: effects.iter().map(|e| e.to_string()).collect(),
            score: 0.0,
            probability,
            sizes: Vec::new(),
        };
        out.diagnosis.verdict = Verdict::Named;
        out.diagnosis.effects = vec![effect];
        out.diagnosis.gain = PredictionGain { held_out: Some(held_out), extrapolation: None };
        out.diagnosis.scores =
            vec![score(&["quadratic_drag"], 0.98), score(&["linear_drag"], 0.02), score(&[], 0.0)];
        out
    }

    /// Results of earlier versions without evidence have a report, too.
    #[test]
    fn documents_survive_json() {
        let document = named();
        let mut json = serde_json::to_value(&document).unwrap();
        let read = |json: &serde_json::Value| serde_json::from_value::<DiagnosisDocument>(json.clone());
        assert_eq!(read(&json).unwrap(), document);
        json.as_object_mut().unwrap().remove("evidence");
        assert_eq!(read(&json).unwrap().evidence, PlotTables::default());
    }
}
