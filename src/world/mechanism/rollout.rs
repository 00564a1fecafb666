//! Rollouts of mechanisms.

use std::array;

use super::command::Commands;
use super::effect::{JointLaw, JointState, JointTerm, resolve};
use super::torque_field::TorqueField;
use super::tree::{Link, Tree};
use crate::error::{Error, Result};
use crate::task::Scene;

/// A rollout: a tree with effects, an initial state and commands.
#[derive(Clone)]
pub struct JointRollout<'a> {
    pub tree: &'a Tree,
    pub terms: Vec<JointTerm>,
    /// Initial positions and velocities of the joints, as measured at `start`, s: with encoders that lag, of that much earlier.
    pub position: Vec<f64>,
    pub velocity: Vec<f64>,
    pub start: f64,
    pub commands: &'a Commands,
    /// Times at which the joints are observed, s: ascending, none before `start`.
    pub times: &'a [f64],
    /// A torque field with the coefficients of some of its functions, N m.
    pub field: Option<(&'a TorqueField, Vec<(usize, f64)>)>,
}

/// Motion of the joints: by joint, one number per observed time.
#[derive(Clone, Debug, PartialEq)]
pub struct JointMotion {
    /// As measured: with effects of the encoder, not yet rounded to its resolution.
    pub positions: Vec<Vec<f64>>,
    /// Actual velocities.
    pub velocities: Vec<Vec<f64>>,
    /// Actual positions and velocities from which a rollout that starts at the last observed time continues.
    pub end: (Vec<f64>, Vec<f64>),
}

impl JointMotion {
    /// Rounds measured positions to the resolution of the encoders.
    pub fn round_positions(&mut self, terms: &[JointTerm]) {
        for (joint, own) in self.positions.iter_mut().enumerate() {
            own.iter_mut().for_each(|q| *q = rounded_position(terms, joint, *q));
        }
    }
}

impl JointRollout<'_> {
    /// Links and gravity with the effects.
    pub(super) fn physics(&self) -> (Vec<Link>, [f64; 2]) {
        let (mut links, mut gravity) = (self.tree.links.clone(), self.tree.gravity);
        for term in &self.terms {
            match term.effect.law {
                JointLaw::Links(change) => change(&term.values, term.joint, &self.tree.parents, &mut links),
                JointLaw::Gravity(change) => gravity = change(&term.values, gravity),
                _ => {}
            }
        }
        (links, gravity)
    }

    /// Delay of a joint's commands and age of its measured positions, s.
    pub(super) fn delays(&self, joint: usize) -> [f64; 2] {
        let of = |wanted: fn(&JointLaw) -> bool| {
            let own = self.terms.iter().filter(|t| t.joint == joint && wanted(&t.effect.law));
            own.map(|t| t.values[0]).sum::<f64>()
        };
        [of(|law| matches!(law, JointLaw::CommandDelay)), of(|law| matches!(law, JointLaw::EncoderLag))]
    }

    /// Time at which the simulation begins, s.
    pub(super) fn first_time(&self) -> f64 {
        self.start - (0..self.tree.links.len()).map(|j| self.delays(j)[1]).fold(0.0, f64::max)
    }

    /// Whether an effect of the encoder changes a joint's measured positions.
    pub(super) fn has_encoder_effect(&self, joint: usize) -> bool {
        self.terms.iter().any(|t| t.joint == joint && matches!(t.effect.law, JointLaw::Encoder(_)))
    }

    /// Measured position of a joint at its actual state at `time`, s. A command that begins then does not act yet.
    pub(super) fn measured(&self, joint: usize, time: f64, [position, velocity]: [f64; 2]) -> f64 {
        let mut state = JointState { position, velocity, drive: 0.0, max_torque: 0.0 };
        if let Some(motor) = &self.tree.motors[joint] {
            let end = time - self.delays(joint)[0];
            let command = self.commands.mean(joint, [end - self.tree.time_step, end]);
            state.drive = motor.torque(command, position, velocity);
            state.max_torque = motor.max_torque;
            for term in self.terms.iter().filter(|t| t.joint == joint) {
                if let JointLaw::Drive(law) = term.effect.law {
                    let values = array::from_fn(|k| term.values.get(k).copied().unwrap_or(0.0));
                    state.drive = law.drive(&values, state);
                }
            }
        }
        measured_position(&self.terms, joint, state)
    }
}

/// Sum of all delays of commands and ages of measurements among `terms`, s: what happened earlier has no effect.
pub fn longest_delay<'a>(terms: impl IntoIterator<Item = &'a JointTerm>) -> f64 {
    let own = |t: &&JointTerm| matches!(t.effect.law, JointLaw::CommandDelay | JointLaw::EncoderLag);
    terms.into_iter().filter(own).map(|t| t.values[0]).sum()
}

/// Measured position at the actual state of a joint, with the encoder's effects among `terms`.
pub fn measured_position<'a>(
    terms: impl IntoIterator<Item = &'a JointTerm>,
    joint: usize,
    mut state: JointState,
) -> f64 {
    for term in terms.into_iter().filter(|t| t.joint == joint) {
        if let JointLaw::Encoder(measure) = term.effect.law {
            state.position = measure(&term.values, state);
        }
    }
    state.position
}

/// A measured position, with its noise, rounded to the encoder's resolution.
pub fn rounded_position<'a>(
    terms: impl IntoIterator<Item = &'a JointTerm>,
    joint: usize,
    position: f64,
) -> f64 {
    let own = |t: &&JointTerm| t.joint == joint && matches!(t.effect.law, JointLaw::Resolution);
    let step = terms.into_iter().find(own).map_or(0.0, |t| t.values[0]);
    if step > 0.0 { step * (position / step).round() } else { position }
}

/// The effects that a scene declares in its joints.
pub fn scene_terms(scene: &Scene, tree: &Tree) -> Result<Vec<JointTerm>> {
    let mut all = Vec::new();
    for (i, joint) in scene.joints.iter().enumerate() {
        let index =
            tree.joint(&joint.name).ok_or_else(|| Error::Failed(format!("no joint {}", joint.name)))?;
        for (k, term) in joint.effects.iter().enumerate() {
            all.push(resolve(term, index, &format!("joints[{i}].effects[{k}]"))?);
        }
    }
    Ok(all)
}
