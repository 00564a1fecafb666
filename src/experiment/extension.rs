//! The simulation extended by what a diagnosis of the workflow's own trials finds, at no further real interaction.
//!
//! Past the source, which lets the estimate make up for what the simulation lacks.

use serde::{Deserialize, Serialize};

use super::EstimateConfig;
use crate::discover::report::Verdict;
use crate::discover::{self, Finding, diagnose};
use crate::error::{Error, Result};
use crate::policy::Training;
use crate::progress::Progress;
use crate::reality::{Trial, settled};
use crate::task::Scene;
use crate::task::scene::EffectTerm;
use crate::world::Latents;
use crate::world::latent::FACTORS;

/// A simulation as a diagnosis extended it.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Extension {
    /// As in `iplw.diagnosis/1`.
    pub verdict: String,
    /// Why, for people.
    pub reason: String,
    /// Every set of effects that the trials cannot tell from the best.
    pub rivals: Vec<Vec<String>>,
    /// What is added to the simulation: the simplest of those sets.
    pub effects: Vec<EffectTerm>,
    /// As estimated along with the effects; those that the trials do not tell are the workflow's.
    pub latents: Latents,
    /// Share of the excess error on held-out trials that goes away.
    pub excess_removed: Option<f64>,
}

/// What the trials say the simulation lacks, and the scene that goes with all of them.
pub fn diagnosed(
    trials: &[Trial],
    config: &EstimateConfig,
    progress: &dyn Progress,
) -> Result<(Scene, Finding)> {
    let first = trials.first().ok_or_else(|| Error::input("trials", "none", "at least one"))?;
    let (scene, trials) = settled(&first.scene.clone(), trials.to_vec())?;
    let setup = discover::Config { engine: config.engine, ..discover::Config::standard(config.seed) };
    let finding = diagnose(&scene, &trials, &setup, progress)?;
    Ok((scene, finding))
}

impl Extension {
    /// The simulation that a finding asks for, with the workflow's latents `found` where it knows no better.
    pub fn of(finding: &Finding, found: Latents) -> Extension {
        let d = &finding.diagnosis;
        let named = matches!(d.verdict, Verdict::Named | Verdict::Ambiguous);
        let mut values = found.values();
        for (i, factor) in FACTORS.iter().enumerate() {
            let told = d.calibrated.iter().find(|c| c.name == factor.name && c.identifiable);
            if let Some(c) = told.filter(|_| named) {
                values[i] = Some(c.value);
            }
        }
        let [density, friction, restitution] = values;
        Extension {
            verdict: d.verdict.name().into(),
            reason: d.reason.clone(),
            rivals: d.rivals.clone(),
            effects: if named { finding.extended.effects.clone() } else { Vec::new() },
            latents: Latents { density, friction, restitution },
            excess_removed: d.gain.held_out.as_ref().and_then(|g| g.excess_removed),
        }
    }

    /// Training in the extended simulation.
    pub fn training(&self) -> Training {
        Training::Fixed { latents: self.latents, effects: self.effects.clone() }
    }
}
