//! Report of a diagnosis of joints.

use serde::{Deserialize, Serialize};

use super::curves::{JointCurves, worst_trial};
use super::decision::JointDecision;
use super::linearization::slots;
use super::model_fit::JointFit;
use super::recording::JointRecording;
use super::resolution::EncoderResolution;
use super::search::JointSearch;
use crate::inference::report::Verdict;
use crate::task::Scene;
use crate::task::joint::JointKind;
use crate::task::scene::EffectTerm;
use crate::world::mechanism::effect::REGISTRY;

/// `format` of a report.
pub const JOINT_DIAGNOSIS_FORMAT: &str = "iplw.joint_diagnosis/1";
/// Half width of a 95 % and of a 90 % interval, standard deviations.
const WIDTH_95: f64 = 1.96;

/// Errors of a simulation of a mechanism.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct JointDiagnosis {
    pub format: String,
    pub verdict: Verdict,
    pub reason: String,
    /// The most probable set.
    pub effects: Vec<JointEffectEstimate>,
    /// Credible sets, most probable first: effect and joint of each.
    pub rivals: Vec<Vec<String>>,
    /// Every fitted set, most probable first.
    pub scores: Vec<JointSetScore>,
    /// Posterior probability that each effect acts in each joint, most probable first, those below 1 % left out.
    pub inclusion: Vec<(String, f64)>,
    /// Posterior probability that nothing in the library is missing.
    pub none_probability: f64,
    /// Share of the predictable misfit that the set explains, with a 90 % interval; absent without misfit.
    pub explained_share: Option<f64>,
    pub explained_interval: Option<[f64; 2]>,
    /// Share of the excess squared error on held-out trials that it removes.
    pub held_out_gain: Option<f64>,
    /// Standard deviation of the noise of each joint's positions, rad or m.
    pub noise: Vec<f64>,
    pub trials: usize,
    pub segments: usize,
    pub seed: u64,
    pub version: String,
    /// Positions in the trial that the simulation predicts worst.
    pub curves: JointCurves,
    /// The scene with the effects in its joints.
    pub extended_scene: Scene,
}

/// A fitted set of effects.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct JointSetScore {
    /// Effect and joint of each; empty for the given simulation.
    pub effects: Vec<String>,
    /// Log posterior relative to the most probable set, nats.
    pub score: f64,
    pub probability: f64,
}

/// An effect in a joint.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct JointEffectEstimate {
    pub name: String,
    /// The joint.
    pub acts_on: String,
    pub equation: String,
    /// Posterior probability that it acts.
    pub probability: f64,
    pub parameters: Vec<JointParameterEstimate>,
}

/// A parameter with its uncertainty.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct JointParameterEstimate {
    pub name: String,
    pub unit: String,
    pub value: f64,
    pub sd: f64,
    /// 95 % interval.
    pub ci95: [f64; 2],
}

/// Builds the report.
pub fn build(
    scene: &Scene,
    recording: &JointRecording,
    found: &JointSearch,
    decision: &JointDecision,
    seed: u64,
) -> JointDiagnosis {
    let mut inclusion = inclusion(recording, found, decision);
    let mut effects = decision
        .rivals
        .first()
        .map_or(Vec::new(), |best| estimates(recording, &found.fits[*best], &inclusion));
    let names = |fit: &JointFit| {
        fit.terms
            .iter()
            .map(|t| effect_in_joint(t.effect.name, &recording.tree.names[t.joint]))
            .collect::<Vec<String>>()
    };
    let mut rivals: Vec<Vec<String>> = decision.rivals.iter().map(|i| names(&found.fits[*i])).collect();
    let (mut verdict, mut none_probability) = (decision.verdict, decision.base_probability);
    for own in resolutions(recording) {
        none_probability = 0.0;
        if verdict == Verdict::None {
            (verdict, rivals) = (Verdict::Named, vec![Vec::new()]);
        }
        let name = effect_in_joint(&own.name, &own.acts_on);
        rivals.iter_mut().for_each(|set| set.push(name.clone()));
        inclusion.insert(0, (name, 1.0));
        effects.push(own);
    }
    let best = found.log_posterior.iter().copied().fold(found.base.log_evidence, f64::max);
    let mut scores: Vec<JointSetScore> = found
        .ranked(|_| true)
        .into_iter()
        .map(|i| JointSetScore {
            effects: names(&found.fits[i]),
            score: found.log_posterior[i] - best,
            probability: decision.probabilities[i],
        })
        .collect();
    let base = JointSetScore {
        effects: Vec::new(),
        score: found.base.log_evidence - best,
        probability: decision.base_probability,
    };
    scores.insert(scores.partition_point(|s| s.score > base.score), base);
    JointDiagnosis {
        format: JOINT_DIAGNOSIS_FORMAT.into(),
        verdict,
        reason: reason(verdict, decision, &rivals),
        rivals,
        scores,
        inclusion: inclusion.into_iter().filter(|(_, p)| *p >= 0.01).collect(),
        none_probability,
        explained_share: decision.explained.map(|(share, _)| share),
        explained_interval: decision.explained.map(|(_, interval)| interval),
        held_out_gain: decision.gain,
        noise: recording.noise.clone(),
        trials: recording.trials.len(),
        segments: recording.segments.len(),
        seed,
        version: env!("CARGO_PKG_VERSION").into(),
        curves: worst_trial(recording, &found.base, decision.rivals.first().map(|i| &found.fits[*i])),
        extended_scene: extended(scene, &effects),
        effects,
    }
}

/// The scene with effects in its joints.
fn extended(scene: &Scene, effects: &[JointEffectEstimate]) -> Scene {
    let mut extended_scene = scene.clone();
    for effect in effects {
        let joint = extended_scene.joints.iter_mut().find(|joint| joint.name == effect.acts_on);
        let parameters: Vec<(&str, f64)> =
            effect.parameters.iter().map(|p| (p.name.as_str(), p.value)).collect();
        joint.into_iter().for_each(|joint| joint.effects.push(EffectTerm::new(&effect.name, &parameters)));
    }
    extended_scene
}

/// A unit of a revolute joint, for a joint of this kind.
fn unit(of_revolute: &str, kind: JointKind) -> String {
    match kind {
        JointKind::Revolute => of_revolute.into(),
        JointKind::Prismatic => {
            of_revolute.replace("N m s/rad", "N s/m").replace("N m", "N").replace("rad", "m")
        }
    }
}

/// An effect in a joint as reports name it.
pub fn effect_in_joint(effect: &str, joint: &str) -> String {
    format!("{effect} ({joint})")
}

/// The effect and the joint of such a name.
pub fn parse_effect_in_joint(name: &str) -> Option<(&str, &str)> {
    name.strip_suffix(')')?.split_once(" (")
}

/// Inclusion probabilities of all effects in joints, most probable first.
fn inclusion(
    recording: &JointRecording,
    found: &JointSearch,
    decision: &JointDecision,
) -> Vec<(String, f64)> {
    let mut all: Vec<(String, f64)> = Vec::new();
    for (fit, probability) in found.fits.iter().zip(&decision.probabilities) {
        for term in &fit.terms {
            let own = effect_in_joint(term.effect.name, &recording.tree.names[term.joint]);
            match all.iter_mut().find(|(known, _)| *known == own) {
                Some((_, sum)) => *sum += probability,
                None => all.push((own, *probability)),
            }
        }
    }
    all.sort_by(|a, b| b.1.total_cmp(&a.1).then_with(|| a.0.cmp(&b.0)));
    all
}

fn estimates(
    recording: &JointRecording,
    fit: &JointFit,
    inclusion: &[(String, f64)],
) -> Vec<JointEffectEstimate> {
    let slots = slots(&fit.terms);
    let of = |(t, term): (usize, &crate::world::mechanism::JointTerm)| {
        let own = effect_in_joint(term.effect.name, &recording.tree.names[term.joint]);
        let parameters =
            term.effect.parameters.iter().zip(&term.values).enumerate().map(|(p, (declared, value))| {
                let slot = slots.iter().position(|slot| slot.term == t && slot.parameter == p);
                let sd = slot.map_or(0.0, |k| fit.laplace.covariance[(k, k)].sqrt());
                let end =
                    |sign: f64| (value + sign * WIDTH_95 * sd).clamp(declared.bounds[0], declared.bounds[1]);
                JointParameterEstimate {
                    name: declared.name.into(),
                    unit: unit(declared.unit, recording.tree.kinds[term.joint]),
                    value: *value,
                    sd,
                    ci95: [end(-1.0), end(1.0)],
                }
            });
        JointEffectEstimate {
            name: term.effect.name.into(),
            acts_on: recording.tree.names[term.joint].clone(),
            equation: term.effect.equation.into(),
            probability: inclusion.iter().find(|(known, _)| *known == own).map_or(0.0, |(_, p)| *p),
            parameters: parameters.collect(),
        }
    };
    fit.terms.iter().enumerate().map(of).collect()
}

/// Resolutions of the encoders that the positions show.
fn resolutions(recording: &JointRecording) -> Vec<JointEffectEstimate> {
    let Some(effect) = REGISTRY.iter().find(|effect| effect.is_resolution()) else { return Vec::new() };
    let of = |(joint, found): (usize, &Option<EncoderResolution>)| {
        let EncoderResolution { step, sd } = (*found)?;
        let declared = &effect.parameters[0];
        Some(JointEffectEstimate {
            name: effect.name.into(),
            acts_on: recording.tree.names[joint].clone(),
            equation: effect.equation.into(),
            probability: 1.0,
            parameters: vec![JointParameterEstimate {
                name: declared.name.into(),
                unit: unit(declared.unit, recording.tree.kinds[joint]),
                value: step,
                sd,
                ci95: [step - WIDTH_95 * sd, step + WIDTH_95 * sd],
            }],
        })
    };
    recording.resolutions.iter().enumerate().filter_map(of).collect()
}

fn reason(verdict: Verdict, decision: &JointDecision, sets: &[Vec<String>]) -> String {
    let listed = || sets.iter().map(|set| set.join(" + ")).collect::<Vec<String>>().join(" | ");
    let share = decision.explained.map_or(String::new(), |(share, [low, high])| {
        format!(
            " The set explains {:.0} % ({:.0} to {:.0} %) of the predictable misfit.",
            100.0 * share,
            100.0 * low,
            100.0 * high
        )
    });
    match verdict {
        Verdict::None => format!(
            "The simulation agrees with the recording: probability {:.2} that nothing is missing.",
            decision.base_probability
        ),
        Verdict::Named => format!("The simulation lacks {}.{share}", listed()),
        Verdict::Ambiguous => format!("The recording does not discriminate between {}.{share}", listed()),
        Verdict::Unknown | Verdict::InsufficientData if sets.is_empty() => {
            "The simulation lacks something that no effect in the library explains.".into()
        }
        Verdict::Unknown | Verdict::InsufficientData => format!(
            "The simulation lacks something that no effect in the library explains well; best: {}.{share}",
            listed()
        ),
    }
}
