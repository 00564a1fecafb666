//! Design of excitations: commands of motors whose recording tells what a simulation of a mechanism lacks, or measures it best.
//!
//! Candidates of several families (steps, sweeps of frequency, sums of sines, slow ramps, steps to rest) are simulated; the trials are
//! chosen one after the other, each for what the earlier ones leave open. With R_e the responses to an effect e of half the plausible size, in
//! units of the noise, with initial states and the shared discrepancy projected out:
//!
//! - to discriminate between effects: mean over pairs of the expected log Bayes factor, 1/2 |R_e - (its part along R_f)|^2, at most
//!   [`ENOUGH`] a pair; the simulation without any effect is one of the rivals.
//! - for precision: 1/2 log det(I + R' R), the expected information about the sizes of all effects.
//!
//! Sources: Atkinson and Fedorov, Biometrika 62 (1975) 57 (designs for discriminating between rival models); Chaloner and Verdinelli,
//! Statistical Science 10 (1995) 273 (D-optimality as expected information).
//!
//! Differences from the source: responses are linearised at plausible sizes; trials are chosen greedily.

use nalgebra::DMatrix;
use rand::RngExt;
use serde::Serialize;

use crate::error::{Error, Result};
use crate::inference::mechanism::{ExcitationInformation, information};
use crate::progress::Progress;
use crate::reality::JointTrial;
use crate::rng::{self, Stream};
use crate::task::Scene;
use crate::task::joint::Control;
use crate::world::mechanism::{Commands, JointRollout, Tree, scene_terms, simulate};

/// `format` of a design of excitations.
pub const EXCITATION_FORMAT: &str = "iplw.excitation/1";
/// Candidates of each family, and random designs for comparison.
const CANDIDATES_PER_FAMILY: usize = 10;
const RANDOM_DESIGNS: usize = 50;
/// Rate of commands and of simulated observations, 1/s.
const RATE: f64 = 100.0;
/// Log Bayes factor from which a recording discriminates between two effects: a thousand to one.
const ENOUGH: f64 = 6.9;
/// Size at which effects are to be discriminated, in plausible standard deviations: six effects in ten are larger.
const SIZE: f64 = 0.5;
/// Largest command as a share of a motor's torque limit.
const SHARE_OF_LIMIT: f64 = 0.9;

/// The purpose of a design.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum ExcitationGoal {
    /// To discriminate between effects.
    Discriminate,
    /// To measure their sizes.
    Precision,
}

/// Settings of a design.
#[derive(Clone, Debug, Serialize)]
pub struct ExcitationConfig {
    pub goal: ExcitationGoal,
    /// Number of trials.
    pub trials: usize,
    /// Duration of a trial, s.
    pub duration: f64,
    /// Effects in question, as (effect, joint); all that the scene may lack if there are none.
    pub effects: Vec<(String, String)>,
    /// Standard deviation of measured positions, rad or m.
    pub noise: f64,
    /// Largest velocity of any joint, rad/s or m/s.
    pub max_velocity: Option<f64>,
    /// By joint: lowest and highest position.
    pub positions: Vec<(String, [f64; 2])>,
    /// By motor, by the name of its joint: lowest and highest command; of motors with torque commands 90 % of the limit by default.
    pub commands: Vec<(String, [f64; 2])>,
    pub seed: u64,
}

/// A design.
#[derive(Clone, Debug, Serialize)]
pub struct ExcitationDesign {
    pub format: String,
    pub version: String,
    pub config: ExcitationConfig,
    pub excitations: Vec<Excitation>,
    /// Mean score of as many trials of random steps, and its standard deviation.
    pub random_score: f64,
    pub random_sd: f64,
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

/// A family of commands.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum ExcitationFamily {
    Steps,
    Sweep,
    Sines,
    Ramps,
    Releases,
}

/// Every family with its name.
const FAMILIES: [(ExcitationFamily, &str); 5] = [
    (ExcitationFamily::Steps, "random steps"),
    (ExcitationFamily::Sweep, "sweep of frequency"),
    (ExcitationFamily::Sines, "sum of sines"),
    (ExcitationFamily::Ramps, "slow ramps"),
    (ExcitationFamily::Releases, "steps to rest"),
];

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
    if information.effects.is_empty() {
        let value = config.effects.iter().map(|(e, j)| format!("{e} ({j})")).collect::<Vec<_>>().join(", ");
        return Err(Error::input("effects", value, "effects that a joint of the scene can have"));
    }
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
    let [random_score, random_sd] = random_scores(&information, &steps, config, &mut stream);
    Ok(ExcitationDesign {
        format: EXCITATION_FORMAT.into(),
        version: env!("CARGO_PKG_VERSION").into(),
        config: config.clone(),
        excitations,
        random_score,
        random_sd,
        candidates: drawn.len(),
        allowed: trials.len(),
        hard_pairs: hard_pairs(&tree, &information, &sum),
    })
}

/// Lowest and highest command by joint; none for a joint without a motor.
fn command_ranges(tree: &Tree, config: &ExcitationConfig) -> Result<Vec<Option<[f64; 2]>>> {
    if let Some((unknown, _)) =
        config.commands.iter().chain(&config.positions).find(|(n, _)| tree.joint(n).is_none())
    {
        return Err(Error::not_found("joint", unknown, tree.names.iter().map(String::as_str)));
    }
    let of = |(name, motor): (&String, &Option<crate::task::joint::Motor>)| {
        let Some(motor) = motor else { return Ok(None) };
        match config.commands.iter().find(|(own, _)| own == name) {
            Some((_, range)) => Ok(Some(*range)),
            None if motor.control == Control::Torque => {
                Ok(Some([-SHARE_OF_LIMIT * motor.max_torque, SHARE_OF_LIMIT * motor.max_torque]))
            }
            None => {
                let allowed = "the lowest and highest command of a motor that is not commanded by torque";
                Err(Error::input(format!("commands.{name}"), "none", allowed))
            }
        }
    };
    let ranges: Vec<Option<[f64; 2]>> = tree.names.iter().zip(&tree.motors).map(of).collect::<Result<_>>()?;
    match ranges.iter().any(Option::is_some) {
        true => Ok(ranges),
        false => Err(Error::input("motors", "none", "a scene with a motor: excitations are commands")),
    }
}

/// Commands of a family for all motors.
fn draw(
    family: ExcitationFamily,
    ranges: &[Option<[f64; 2]>],
    duration: f64,
    stream: &mut Stream,
) -> Commands {
    let times: Vec<f64> = (0..=(duration * RATE).round() as usize).map(|i| i as f64 / RATE).collect();
    let values = ranges.iter().map(|range| match range {
        None => Vec::new(),
        Some([low, high]) => {
            let scale = |share: f64| 0.5 * (low + high) + 0.5 * (high - low) * share.clamp(-1.0, 1.0);
            shares(family, &times, duration, stream).into_iter().map(scale).collect()
        }
    });
    Commands::new(times.clone(), values.collect())
}

/// Commands of one motor, from -1 to 1.
fn shares(family: ExcitationFamily, times: &[f64], duration: f64, stream: &mut Stream) -> Vec<f64> {
    use std::f64::consts::TAU;
    let size: f64 = stream.random_range(0.3..1.0);
    match family {
        ExcitationFamily::Steps | ExcitationFamily::Releases => {
            let is_release = family == ExcitationFamily::Releases;
            let (mut level, mut until, mut rests) = (0.0, 0.0, true);
            let mut value = |t: f64| {
                if t >= until {
                    rests = !rests;
                    level = if is_release && rests { 0.0 } else { stream.random_range(-1.0..1.0) };
                    until = t + stream.random_range(0.1..0.6) * if is_release { 2.0 } else { 1.0 };
                }
                level
            };
            times.iter().map(|t| value(*t)).collect()
        }
        ExcitationFamily::Sweep => {
            let from: f64 = stream.random_range(0.1..0.5);
            let to: f64 = stream.random_range(1.0..6.0);
            let phase = |t: f64| TAU * (from * t + 0.5 * (to - from) * t * t / duration);
            times.iter().map(|t| size * libm::sin(phase(*t))).collect()
        }
        ExcitationFamily::Sines => {
            let waves: [(f64, f64); 5] =
                std::array::from_fn(|_| (stream.random_range(0.2..4.0), stream.random_range(0.0..TAU)));
            let sum = |t: f64| waves.iter().map(|(f, phase)| libm::sin(TAU * f * t + phase)).sum::<f64>();
            times.iter().map(|t| size * sum(*t) / 2.5).collect()
        }
        ExcitationFamily::Ramps => {
            let period: f64 = stream.random_range(0.5..2.0) * duration;
            let start: f64 = stream.random_range(0.0..1.0);
            let triangle = |t: f64| {
                let phase = t / period + start;
                4.0 * (phase - (phase + 0.5).floor()).abs() - 1.0
            };
            times.iter().map(|t| size * triangle(*t)).collect()
        }
    }
}

/// Simulated trials of the candidates that respect the limits.
fn allowed_trials(
    scene: &Scene,
    tree: &Tree,
    config: &ExcitationConfig,
    drawn: &[(ExcitationFamily, Commands)],
) -> Result<(Vec<ExcitationFamily>, Vec<JointTrial>)> {
    let times: Vec<f64> = (0..=(config.duration * RATE).round() as usize).map(|i| i as f64 / RATE).collect();
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

/// Products of the effects' columns with the shared discrepancy projected out.
fn without_discrepancy(information: &ExcitationInformation, products: &DMatrix<f64>) -> DMatrix<f64> {
    let own = information.columns.last().map_or(0, |range| range.end);
    without(products, 0..own, own..products.nrows())
}

/// The block of `kept` rows and columns after `gone` unknowns of unit standard deviation are projected out.
fn without(
    products: &DMatrix<f64>,
    kept: std::ops::Range<usize>,
    gone: std::ops::Range<usize>,
) -> DMatrix<f64> {
    let (n, m) = (kept.len(), gone.len());
    let view = |rows: &std::ops::Range<usize>, columns: &std::ops::Range<usize>| {
        products.view((rows.start, columns.start), (rows.len(), columns.len())).into_owned()
    };
    let across = view(&gone, &kept);
    let inner = view(&gone, &gone) + DMatrix::identity(m, m);
    let along = inner.cholesky().map_or_else(|| DMatrix::zeros(m, n), |factor| factor.solve(&across));
    view(&kept, &kept) - across.tr_mul(&along)
}

/// Expected log Bayes factors of each effect against each rival (`None`: the scene without any effect), nats.
fn bayes_factors(
    information: &ExcitationInformation,
    products: &DMatrix<f64>,
) -> Vec<(usize, Option<usize>, f64)> {
    let own = without_discrepancy(information, products);
    let columns = &information.columns;
    let mut out = Vec::new();
    for (e, kept) in columns.iter().enumerate() {
        let half = |m: DMatrix<f64>| 0.5 * SIZE * SIZE * m.trace() / kept.len() as f64;
        out.push((e, None, half(own.view((kept.start, kept.start), (kept.len(), kept.len())).into_owned())));
        for (f, gone) in columns.iter().enumerate() {
            if f != e {
                out.push((e, Some(f), half(without(&own, kept.clone(), gone.clone()))));
            }
        }
    }
    out
}

/// Score of trials with these products, nats.
fn score(information: &ExcitationInformation, products: &DMatrix<f64>, goal: ExcitationGoal) -> f64 {
    match goal {
        ExcitationGoal::Discriminate => {
            let all = bayes_factors(information, products);
            all.iter().map(|(_, _, factor)| factor.min(ENOUGH)).sum::<f64>() / all.len() as f64
        }
        ExcitationGoal::Precision => {
            let own = without_discrepancy(information, products);
            let n = own.nrows();
            let factor = (own + DMatrix::identity(n, n)).cholesky();
            factor.map_or(f64::NEG_INFINITY, |f| f.l().diagonal().iter().map(|d| libm::log(*d)).sum::<f64>())
        }
    }
}

/// Mean and standard deviation of the scores of random trials among `steps`.
fn random_scores(
    information: &ExcitationInformation,
    steps: &[usize],
    config: &ExcitationConfig,
    stream: &mut Stream,
) -> [f64; 2] {
    let count = information.products[0].nrows();
    let mut one = || {
        let mut sum = DMatrix::zeros(count, count);
        for _ in 0..config.trials {
            sum += &information.products[steps[stream.random_range(0..steps.len())]];
        }
        score(information, &sum, config.goal)
    };
    if steps.is_empty() {
        return [f64::NAN; 2];
    }
    let scores: Vec<f64> = (0..RANDOM_DESIGNS).map(|_| one()).collect();
    let mean = scores.iter().sum::<f64>() / scores.len() as f64;
    let square = scores.iter().map(|s| (s - mean).powi(2)).sum::<f64>() / (scores.len() - 1) as f64;
    [mean, square.sqrt()]
}

/// Pairs that the trials leave below [`ENOUGH`], least first, each once; an effect that does not show is a pair with none alone.
fn hard_pairs(
    tree: &Tree,
    information: &ExcitationInformation,
    products: &DMatrix<f64>,
) -> Vec<(String, String, f64)> {
    let name = |e: usize| {
        let term = &information.effects[e];
        format!("{} ({})", term.effect.name, tree.names[term.joint])
    };
    let all = bayes_factors(information, products);
    let hidden: Vec<usize> =
        all.iter().filter(|(_, f, factor)| f.is_none() && *factor < ENOUGH).map(|(e, ..)| *e).collect();
    let is_listed =
        |e: usize, f: Option<usize>| f.is_none_or(|f| f > e && ![e, f].iter().any(|k| hidden.contains(k)));
    let mut out: Vec<(String, String, f64)> = all
        .into_iter()
        .filter(|(e, f, factor)| *factor < ENOUGH && is_listed(*e, *f))
        .map(|(e, f, factor)| (name(e), f.map_or("none".into(), name), factor))
        .collect();
    out.sort_by(|a, b| a.2.total_cmp(&b.2));
    out
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
        assert!(found.excitations[0].score > found.random_score + found.random_sd, "{found:?}");
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
    }
}
