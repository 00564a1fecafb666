//! Design of excitations: commands of motors whose recording tells what a simulation of a mechanism lacks, or measures it best.
//!
//! Candidates of several families (steps, sweeps of frequency, sums of sines, slow ramps, steps to rest) are simulated; the trials are
//! chosen one after the other, each for what the earlier ones leave open. With R_e the responses to an effect e of plausible size, in
//! units of the noise, with initial states and the shared discrepancy projected out:
//!
//! - to discriminate between effects: mean over pairs of the expected log Bayes factor at half of that size, 1/8 |R_e - (its part along R_f)|^2, at
//!   most a thousand to one a pair; the simulation without any effect is one of the rivals.
//! - for precision: 1/2 log det(I + R' R), the expected information about the sizes of all effects.
//!
//! Sources: Atkinson and Fedorov, Biometrika 62 (1975) 57 (designs for discriminating between rival models); Chaloner and Verdinelli,
//! Statistical Science 10 (1995) 273 (D-optimality as expected information).
//!
//! Differences from the source: responses are those of small effects, where these have any; trials are chosen greedily.

mod commands;
mod config;
mod score;

use nalgebra::DMatrix;
use serde::Serialize;

use self::commands::{ExcitationFamily, FAMILIES, command_ranges, draw, sample_times};
pub use self::config::{ExcitationConfig, ExcitationGoal};
use self::score::{hard_pairs, random_scores, score};
use crate::error::{Error, Result};
use crate::inference::mechanism::information;
use crate::progress::Progress;
use crate::reality::JointTrial;
use crate::rng;
use crate::task::Scene;
use crate::world::mechanism::{Commands, JointRollout, Tree, scene_terms, simulate};

/// `format` of a design of excitations.
pub const EXCITATION_FORMAT: &str = "iplw.excitation/1";
/// Number of candidates of each family.
const CANDIDATES_PER_FAMILY: usize = 10;

/// A design.
#[derive(Clone, Debug, Serialize)]
pub struct ExcitationDesign {
    pub format: String,
    pub version: String,
    pub config: ExcitationConfig,
    pub excitations: Vec<Excitation>,
    /// Mean score of as many trials of random steps, and its standard deviation; absent if the limits exclude random steps.
    pub random_score: Option<f64>,
    pub random_sd: Option<f64>,
    /// Number of candidates, and of those within the limits.
    pub candidates: usize,
    pub allowed: usize,
    /// Pairs between which the trials hardly discriminate, with the expected log Bayes factor, least first.
    pub hard_pairs: Vec<(String, String, f64)>,
}

/// A trial of a design.
#[derive(Clone, Debug, Serialize)]
pub struct Excitation {
    pub family: String,
    /// Score of the trials up to this one, nats.
    pub score: f64,
    /// s
    pub times: Vec<f64>,
    /// By motor, by the name of its joint; a value holds until the next time.
    pub commands: Vec<(String, Vec<f64>)>,
    /// Simulated positions by joint, rad or m.
    pub positions: Vec<(String, Vec<f64>)>,
}

impl Excitation {
    /// The commands for a rollout of a scene's mechanism.
    pub fn commands(&self, tree: &Tree) -> Commands {
        let of = |name: &String| self.commands.iter().find(|(joint, _)| joint == name);
        let values = tree.names.iter().map(|name| of(name).map_or(Vec::new(), |(_, own)| own.clone()));
        Commands::new(self.times.clone(), values.collect())
    }
}

/// Designs trials of a scene with joints.
pub fn design_excitations(
    scene: &Scene,
    config: &ExcitationConfig,
    progress: &dyn Progress,
) -> Result<ExcitationDesign> {
    scene.validate()?;
    let tree = Tree::of(scene)?;
    let ranges = command_ranges(&tree, config)?;
    let mut stream = rng::stream(config.seed, "excitations");
    let drawn: Vec<(ExcitationFamily, Commands)> = FAMILIES
        .iter()
        .flat_map(|(family, _)| std::iter::repeat_n(*family, CANDIDATES_PER_FAMILY))
        .map(|family| (family, draw(family, &ranges, config.duration, &mut stream)))
        .collect();
    progress.report("simulating candidates", 0, 1)?;
    let (families, trials) = allowed_trials(scene, &tree, config, &drawn)?;
    let information = information(scene, &trials, &config.effects, config.noise, progress)?;
    let count = information.products[0].nrows();
    let (mut sum, mut excitations, mut chosen) = (DMatrix::zeros(count, count), Vec::new(), Vec::new());
    for k in 0..config.trials {
        progress.report("choosing trials", k as u64, config.trials as u64)?;
        let with = |i: usize| score(&information, &(&sum + &information.products[i]), config.goal);
        let free = (0..trials.len()).filter(|i| !chosen.contains(i) || chosen.len() >= trials.len());
        let scored = free.map(|i| (with(i), i));
        let Some((best, i)) = scored.max_by(|a, b| a.0.total_cmp(&b.0).then(b.1.cmp(&a.1))) else { break };
        sum += &information.products[i];
        chosen.push(i);
        excitations.push(excitation(&tree, families[i], &trials[i], best));
    }
    let steps: Vec<usize> = (0..trials.len()).filter(|i| families[*i] == ExcitationFamily::Steps).collect();
    let random = random_scores(&information, &steps, config, &mut stream);
    Ok(ExcitationDesign {
        format: EXCITATION_FORMAT.into(),
        version: env!("CARGO_PKG_VERSION").into(),
        config: config.clone(),
        excitations,
        random_score: random.map(|[mean, _]| mean),
        random_sd: random.map(|[_, sd]| sd),
        candidates: drawn.len(),
        allowed: trials.len(),
        hard_pairs: hard_pairs(&tree, &information, &sum),
    })
}

/// Simulated trials of the candidates that respect the limits.
fn allowed_trials(
    scene: &Scene,
    tree: &Tree,
    config: &ExcitationConfig,
    drawn: &[(ExcitationFamily, Commands)],
) -> Result<(Vec<ExcitationFamily>, Vec<JointTrial>)> {
    let times = sample_times(config.duration);
    let terms = scene_terms(scene, tree)?;
    let rollouts: Vec<JointRollout> = drawn
        .iter()
        .map(|(_, commands)| JointRollout {
            tree,
            terms: terms.clone(),
            position: tree.position.clone(),
            velocity: tree.velocity.clone(),
            start: 0.0,
            commands,
            times: &times,
            field: None,
        })
        .collect();
    let (mut families, mut trials) = (Vec::new(), Vec::new());
    for (motion, (family, commands)) in simulate(&rollouts).into_iter().zip(drawn) {
        let is_fast = |v: &f64| !v.is_finite() || config.max_velocity.is_some_and(|most| v.abs() > most);
        let is_outside = |(name, [low, high]): &(String, [f64; 2])| {
            let own = tree.joint(name).map(|j| &motion.positions[j]);
            own.is_some_and(|own| own.iter().any(|q| q < low || q > high))
        };
        if motion.velocities.iter().flatten().any(is_fast) || config.positions.iter().any(is_outside) {
            continue;
        }
        let row = |i: usize| motion.positions.iter().map(|own| own[i]).collect();
        families.push(*family);
        trials.push(JointTrial {
            id: trials.len().to_string(),
            times: times.clone(),
            positions: (0..times.len()).map(row).collect(),
            commands: commands.clone(),
        });
    }
    match trials.is_empty() {
        true => {
            let allowed = "limits that some of the candidates respect: a smaller range of commands, a larger range of positions or \
                           velocities, or a shorter duration";
            Err(Error::input("limits", format!("none of {} candidates is within", drawn.len()), allowed))
        }
        false => Ok((families, trials)),
    }
}

fn excitation(tree: &Tree, family: ExcitationFamily, trial: &JointTrial, score: f64) -> Excitation {
    let driven = (0..tree.names.len()).filter(|j| trial.commands.drives(*j));
    let of = |j: usize| trial.times.iter().map(|t| trial.commands.mean(j, [*t, *t])).collect();
    let position = |j: usize| trial.positions.iter().map(|row| row[j]).collect();
    Excitation {
        family: FAMILIES
            .iter()
            .find(|(own, _)| *own == family)
            .map_or(String::new(), |(_, name)| (*name).into()),
        score,
        times: trial.times.clone(),
        commands: driven.map(|j| (tree.names[j].clone(), of(j))).collect(),
        positions: tree.names.iter().enumerate().map(|(j, name)| (name.clone(), position(j))).collect(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::progress::NoProgress;
    use crate::reality::joint_worlds::Mechanism;

    fn config(goal: ExcitationGoal) -> ExcitationConfig {
        ExcitationConfig {
            goal,
            trials: 1,
            duration: 1.0,
            effects: Vec::new(),
            noise: 1e-3,
            max_velocity: None,
            positions: Vec::new(),
            commands: Vec::new(),
            seed: 5,
        }
    }

    #[test]
    fn effects_that_move_a_pendulum_alike_remain_and_the_others_are_separated_better_than_by_random_steps() {
        let scene = Mechanism::Pendulum.scene();
        let found = design_excitations(&scene, &config(ExcitationGoal::Discriminate), &NoProgress).unwrap();
        assert!(
            found.excitations[0].score > found.random_score.unwrap() + found.random_sd.unwrap(),
            "{found:?}"
        );
        let has = |a: &str, b: &str| {
            let is = |name: &str, effect: &str| name.starts_with(effect);
            found.hard_pairs.iter().any(|(x, y, _)| is(x, a) && is(y, b))
        };
        // A turned base and a shifted encoder, a late command and a late encoder are the same on one hinge.
        assert!(
            has("base_tilt", "encoder_offset") && has("command_delay", "encoder_lag"),
            "{:?}",
            found.hard_pairs
        );
        assert!(!has("viscous_friction", "coulomb_friction") && !has("viscous_friction", "none"));
    }

    #[test]
    fn limits_are_kept() {
        let scene = Mechanism::CartPole.scene();
        let wanted = ExcitationConfig {
            max_velocity: Some(12.0),
            positions: vec![("slide".into(), [-1.0, 1.0])],
            ..config(ExcitationGoal::Precision)
        };
        let found = design_excitations(&scene, &wanted, &NoProgress).unwrap();
        assert!(found.allowed < found.candidates);
        let (_, slide) = &found.excitations[0].positions[0];
        assert!(slide.iter().all(|x| x.abs() <= 1.0));
        let force = &found.excitations[0].commands[0].1;
        assert!(force.iter().all(|f| f.abs() <= 7.2) && force.iter().any(|f| f.abs() > 0.5));
    }

    #[test]
    fn limits_that_no_candidate_keeps_and_unknown_joints_are_errors() {
        let scene = Mechanism::CartPole.scene();
        let with = |positions: Vec<(String, [f64; 2])>| {
            let wanted = ExcitationConfig { positions, ..config(ExcitationGoal::Discriminate) };
            design_excitations(&scene, &wanted, &NoProgress).unwrap_err().to_string()
        };
        assert!(with(vec![("slide".into(), [-1e-3, 1e-3])]).contains("within"));
        assert!(with(vec![("foot".into(), [-1.0, 1.0])]).contains("slide"));
        let effects = vec![("payload".into(), "foot".into())];
        let wanted = ExcitationConfig { effects, ..config(ExcitationGoal::Discriminate) };
        let error = design_excitations(&scene, &wanted, &NoProgress).unwrap_err().to_string();
        assert!(error.contains("payload (foot)") && error.contains("payload (pivot)"), "{error}");
    }

    /// A motor whose limit is not stated has no largest command.
    #[test]
    fn a_motor_without_a_limit_needs_a_range() {
        let mut scene = Mechanism::Pendulum.scene();
        scene.motors = vec![serde_json::from_str(r#"{"joint": "hinge", "control": "torque"}"#).unwrap()];
        let error = design_excitations(&scene, &config(ExcitationGoal::Precision), &NoProgress).unwrap_err();
        assert!(error.to_string().contains("commands.hinge"), "{error}");
        let commands = vec![("hinge".into(), [-0.2, 0.4])];
        let wanted = ExcitationConfig { commands, ..config(ExcitationGoal::Precision) };
        let found = design_excitations(&scene, &wanted, &NoProgress).unwrap();
        assert!(found.excitations[0].commands[0].1.iter().all(|tau| (-0.2..=0.4).contains(tau)));
    }
}
