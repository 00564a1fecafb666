//! Diagnosis of driven mechanisms: what a simulation of joints and motors gets wrong, from measured joint positions and commands.
//!
//! The method of the diagnosis of bodies: y_j = f(s_j, theta) + F w + Z_j u_j + d_j + e_j. f are simulated joint positions;
//! segments of each trial have their own initial states (`recording`); F is a torque field (`discrepancy`). Groups, variance
//! components, evidence and rules of the verdict are those of `mixed_model` and `selection`.

mod curves;
mod decision;
mod discrepancy;
mod information;
mod linearization;
mod model_fit;
mod recording;
mod report;
mod resolution;
mod search;

use crate::error::Result;
use crate::progress::Progress;
use crate::reality::JointTrial;
use crate::task::Scene;
use crate::world::mechanism::{Tree, scene_terms};
pub use curves::{JointCurve, JointCurves};
use decision::decide;
pub use information::{ExcitationInformation, information};
use recording::JointRecording;
pub use report::{
    JOINT_DIAGNOSIS_FORMAT, JointDiagnosis, JointEffectEstimate, JointParameterEstimate, JointSetScore,
    effect_in_joint, parse_effect_in_joint,
};

/// Maximum number of effects in a set, by default.
pub const MAX_EFFECTS: usize = 3;

/// Estimated peak memory of a diagnosis of trials with this many rows in all, bytes: twice of what arms of two links need.
pub fn memory(rows: usize, joints: usize) -> u64 {
    (rows * joints) as u64 * 30_000
}

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
    let recording = JointRecording::new(&tree, terms, trials)?;
    progress.report("estimating variance components", 0, 1)?;
    let context = search::context(&recording, progress)?;
    let found = search::search(&context, max_effects)?;
    progress.report("comparing sets of effects", 0, 1)?;
    let (context, found) = search::refine(&context, found)?;
    let decision = decide(&context, &found, seed)?;
    Ok(report::build(scene, &recording, &found, &decision, seed))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::inference::report::Verdict;
    use crate::progress::NoProgress;
    use crate::reality::joint_worlds::{JointWorld, Mechanism, RecordingPlan};
    use crate::rng;
    use crate::task::control::control_task;
    use crate::world::mechanism::effect::find;
    use crate::world::mechanism::{Commands, JointRollout, JointTerm, simulate};
    use rand_distr::{Distribution, StandardNormal};

    const PLAN: RecordingPlan = RecordingPlan { trials: 6, duration: 2.0, rate: 50.0, noise: 1e-3 };

    fn diagnosed(
        mechanism: Mechanism,
        hidden: Option<(&str, usize)>,
        seed: u64,
    ) -> (JointWorld, JointDiagnosis) {
        let hidden = hidden.map(|(name, joint)| (find(name).unwrap(), joint));
        let world = mechanism.world(hidden, &PLAN, seed).unwrap();
        let found = diagnose_joints(&world.scene, &world.trials, 2, 0, &NoProgress).unwrap();
        (world, found)
    }

    #[test]
    fn a_hidden_effect_is_named_with_its_size() {
        for (mechanism, effect, joint) in [
            (Mechanism::Pendulum, "motor_gain", 0),
            (Mechanism::Pendulum, "backlash", 0),
            (Mechanism::Pendulum, "joint_compliance", 0),
            (Mechanism::Pendulum, "encoder_resolution", 0),
            (Mechanism::CartPole, "viscous_friction", 1),
        ] {
            let (world, found) = diagnosed(mechanism, Some((effect, joint)), 7);
            let truth = world.truth.unwrap().values[0];
            assert_eq!(found.verdict, Verdict::Named, "{}", found.reason);
            assert_eq!(found.effects[0].name, effect, "{}", found.reason);
            let estimate = &found.effects[0].parameters[0];
            let error = (estimate.value - truth).abs();
            assert!(error <= (4.0 * estimate.sd).max(1e-9), "{estimate:?} for {truth}");
        }
    }

    /// The discrepancy could stand for a part of so strong a friction: the fit must leave that optimum.
    #[test]
    fn strong_friction_is_measured_without_bias() {
        const FRICTION: f64 = 0.15;
        let scene = control_task("pendulum_swing_up").unwrap().scene.clone();
        let tree = Tree::of(&scene).unwrap();
        let mut stream = rng::stream(4, "recording");
        let times: Vec<f64> = (0..=150).map(|i| 0.02 * f64::from(i)).collect();
        let trials: Vec<JointTrial> = (0..6)
            .map(|k| {
                let wave = |t: &f64| 0.8 * libm::sin(f64::from(2 + k) * t);
                let commands = Commands::new(times.clone(), vec![times.iter().map(wave).collect()]);
                let rollout = JointRollout {
                    tree: &tree,
                    terms: vec![JointTerm {
                        values: vec![FRICTION],
                        ..find("viscous_friction").unwrap().neutral(0)
                    }],
                    position: vec![0.4 * f64::from(k) - 1.0],
                    velocity: vec![0.0],
                    start: 0.0,
                    commands: &commands,
                    times: &times,
                    field: None,
                };
                let motion = simulate(&[rollout]).remove(0);
                let noisy = |q: &f64| {
                    let z: f64 = StandardNormal.sample(&mut stream);
                    vec![q + 1e-3 * z]
                };
                let positions = motion.positions[0].iter().map(noisy).collect();
                JointTrial { id: k.to_string(), times: times.clone(), positions, commands }
            })
            .collect();
        let found = diagnose_joints(&scene, &trials, 2, 0, &NoProgress).unwrap();
        assert_eq!(found.rivals, [["viscous_friction (hinge)"]], "{}", found.reason);
        let b = &found.effects[0].parameters[0];
        assert!((b.value - FRICTION).abs() < 4.0 * b.sd && b.sd < 0.003, "{b:?}");
    }

    #[test]
    fn a_recording_without_motion_is_an_error() {
        let scene = Mechanism::Pendulum.scene();
        let times: Vec<f64> = (0..100).map(|i| 0.01 * f64::from(i)).collect();
        let positions = vec![vec![0.5]; times.len()];
        let trial = JointTrial { id: "0".into(), times, positions, commands: Commands::default() };
        let error = diagnose_joints(&scene, &[trial], 2, 0, &NoProgress).unwrap_err().to_string();
        assert!(error.contains("no joint moves"), "{error}");
    }

    #[test]
    fn nothing_is_named_if_nothing_is_hidden() {
        let (_, found) = diagnosed(Mechanism::Pendulum, None, 8);
        assert_eq!(found.verdict, Verdict::None, "{}", found.reason);
        assert!(found.effects.is_empty());
    }
}
