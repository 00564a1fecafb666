//! Extends the simulation by the effects that a diagnosis of the workflow's own trials finds, without further real interactions.
//!
//! Beyond the source, in which the latents compensate for the simulation's missing effects.

use serde::{Deserialize, Serialize};

use super::{EstimateConfig, refit};
use crate::error::{Error, Result};
use crate::inference::{self, DiagnosisResult, diagnose};
use crate::policy::TrainingPhysics;
use crate::progress::Progress;
use crate::reality::{Trial, with_trial_settings};
use crate::task::Scene;
use crate::task::scene::EffectTerm;
use crate::world::LINEAR_DRAG;
use crate::world::Latents;

/// A simulation extended by a diagnosis.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Extension {
    /// Verdict of the diagnosis, as in `iplw.diagnosis/2`; `not_needed` without one.
    pub verdict: String,
    /// Reason for the verdict.
    pub reason: String,
    /// All sets of effects that the trials cannot distinguish from the best one.
    pub rivals: Vec<Vec<String>>,
    /// Effects added to those of the scenes: the simplest of these sets or, for an unknown effect, the diagnosis's partial
    /// explanation or empirical law.
    pub effects: Vec<EffectTerm>,
    /// Latents estimated in the extended simulation.
    pub latents: Latents,
    /// Share of the excess error on held-out trials that the extension removes.
    pub excess_removed: Option<f64>,
}

/// Diagnosis of the trials, and the scene common to all of them.
pub fn diagnose_trials(
    trials: &[Trial],
    config: &EstimateConfig,
    progress: &dyn Progress,
) -> Result<(Scene, DiagnosisResult)> {
    let first = trials.first().ok_or_else(|| Error::input("trials", "none", "at least one"))?;
    let (scene, trials) = with_trial_settings(&first.scene.clone(), trials.to_vec())?;
    let setup = inference::DiagnosisConfig {
        engine: config.engine,
        ..inference::DiagnosisConfig::standard(config.seed)
    };
    let finding = diagnose(&scene, &trials, &setup, progress)?;
    Ok((scene, finding))
}

/// The simulation extended according to a diagnosis. The latents are refitted in the extended simulation with the workflow's own
/// estimator, which uses whole trials where a diagnosis uses segments. `linear_drag` is refitted with them; other effects keep
/// the diagnosed values. An unnamed or partly named effect is added if it improves the prediction of held-out trials. If
/// the diagnosis found no effect, the result is the workflow's simulation with the latents `found`.
pub fn extend_simulation(
    finding: &DiagnosisResult,
    trials: &[Trial],
    config: &EstimateConfig,
    found: Latents,
    progress: &dyn Progress,
) -> Result<Extension> {
    let d = &finding.diagnosis;
    // The scenes of the trials and of the training tasks already contain their own effects.
    let own = trials.first().map_or(0, |t| t.scene.effects.len());
    let law = d.residual_law.as_ref().filter(|l| l.offered).map(|l| &l.held_out);
    let gain = law.or(d.gain.held_out.as_ref());
    let mut extension = Extension {
        verdict: d.verdict.name().into(),
        reason: d.reason.clone(),
        rivals: d.rivals.clone(),
        effects: finding.extended.effects.iter().skip(own).cloned().collect(),
        latents: found,
        excess_removed: gain.and_then(|g| g.excess_removed),
    };
    if extension.effects.is_empty() {
        return Ok(extension);
    }
    let mut setup = EstimateConfig { effects: extension.effects.clone(), ..config.clone() };
    let drag = match extension.effects.as_slice() {
        [one] if one.name == LINEAR_DRAG.effect.name => {
            one.parameters.get(LINEAR_DRAG.parameter().name).copied()
        }
        _ => None,
    };
    if let Some(c) = drag {
        setup.effects.clear();
        setup.cem.drag = Some((c, LINEAR_DRAG.parameter().weak_prior().1));
    }
    let report = refit(trials, &setup, progress)?;
    extension.latents = Latents::of(report.values());
    if drag.is_some() {
        extension.effects = report.extension();
    }
    Ok(extension)
}

impl Extension {
    /// No extension, of a simulation that reproduces the trials with the latents `found`.
    pub fn unnecessary(found: Latents) -> Extension {
        Extension {
            verdict: "not_needed".into(),
            reason: "the simulation reproduces the trials within the noise".into(),
            rivals: Vec::new(),
            effects: Vec::new(),
            latents: found,
            excess_removed: None,
        }
    }

    /// Training physics of the extended simulation.
    pub fn training(&self) -> TrainingPhysics {
        TrainingPhysics::Fixed { latents: self.latents, effects: self.effects.clone() }
    }
}
