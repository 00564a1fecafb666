//! The simulation extended by what a diagnosis of the workflow's own trials finds, at no further real interaction.
//!
//! Past the source, which lets the estimate make up for what the simulation lacks.

use serde::{Deserialize, Serialize};

use super::{EstimateConfig, refit};
use crate::discover::{self, Finding, diagnose};
use crate::error::{Error, Result};
use crate::policy::Training;
use crate::progress::Progress;
use crate::reality::{Trial, settled};
use crate::task::Scene;
use crate::task::scene::EffectTerm;
use crate::world::DRAG;
use crate::world::Latents;

/// A simulation as a diagnosis extended it.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Extension {
    /// As in `iplw.diagnosis/1`.
    pub verdict: String,
    /// Why, for people.
    pub reason: String,
    /// Every set of effects that the trials cannot tell from the best.
    pub rivals: Vec<Vec<String>>,
    /// What is added to the simulation beyond the scenes' own effects: the simplest of those sets; of what is unknown,
    /// as much as the diagnosis offers.
    pub effects: Vec<EffectTerm>,
    /// As estimated in the extended simulation.
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

/// The simulation that a finding asks for. Latents are fitted to the trials again, in the extended simulation and with
/// the workflow's own estimator, which sees whole trials where a diagnosis sees stretches; `linear_drag` alone is
/// fitted along, other effects stay as they were found. What has no name, or only part of one, is added all the same where
/// it holds on trials it was not fitted to. Where nothing was found it is the workflow's simulation with the latents
/// `found`.
pub fn extended(
    finding: &Finding,
    trials: &[Trial],
    config: &EstimateConfig,
    found: Latents,
    progress: &dyn Progress,
) -> Result<Extension> {
    let d = &finding.diagnosis;
    // The trials' scenes, and those trained in, have their own effects already.
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
        [one] if one.name == DRAG.effect.name => one.parameters.get(DRAG.parameter().name).copied(),
        _ => None,
    };
    if let Some(c) = drag {
        setup.effects.clear();
        setup.cem.drag = Some((c, DRAG.parameter().prior().1));
    }
    let report = refit(trials, &setup, progress)?;
    extension.latents = Latents::of(report.values());
    if drag.is_some() {
        extension.effects = report.extension();
    }
    Ok(extension)
}

impl Extension {
    /// Training in the extended simulation.
    pub fn training(&self) -> Training {
        Training::Fixed { latents: self.latents, effects: self.effects.clone() }
    }
}
