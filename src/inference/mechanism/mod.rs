//! Diagnosis of driven mechanisms: what a simulation of joints and motors gets wrong, from measured joint positions and commands.
//!
//! The method of the diagnosis of bodies: y_j = f(s_j, theta) + F w + Z_j u_j + d_j + e_j. f are simulated joint positions;
//! segments of each trial have their own initial states (`recording`); F is a torque field (`discrepancy`). Groups, variance
//! components, evidence and rules of the verdict are those of `mixed_model` and `selection`.

mod decision;
mod discrepancy;
mod linearization;
mod model_fit;
mod recording;
mod report;
mod search;

use crate::error::Result;
use crate::progress::Progress;
use crate::reality::JointTrial;
use crate::task::Scene;
use crate::world::mechanism::{Tree, scene_terms};
use decision::decide;
use recording::Recording;
pub use report::{JointDiagnosis, JointEffectEstimate, JointParameterEstimate};

/// Diagnoses a scene with joints from measured trials.
pub fn diagnose_joints(
    scene: &Scene,
    trials: &[JointTrial],
    max_effects: usize,
    seed: u64,
    progress: &dyn Progress,
) -> Result<JointDiagnosis> {
    scene.validate()?;
    let tree = Tree::of(scene)?;
    let terms = scene_terms(scene, &tree)?;
    progress.report("segmenting trials", 0, 1)?;
    let recording = Recording::new(&tree, terms, trials)?;
    progress.report("estimating variance components", 0, 1)?;
    let context = search::context(&recording, progress)?;
    let found = search::search(&context, max_effects)?;
    progress.report("comparing sets of effects", 0, 1)?;
    let decision = decide(&context, &found, seed)?;
    Ok(report::build(scene, &recording, &found, &decision, seed))
}
