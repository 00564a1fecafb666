//! Rollouts of mechanisms.

use super::command::Commands;
use super::effect::{JointLaw, JointTerm, resolve};
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
    /// As measured: with effects of the encoder.
    pub positions: Vec<Vec<f64>>,
    /// Actual velocities.
    pub velocities: Vec<Vec<f64>>,
    /// Actual positions and velocities from which a rollout that starts at the last observed time continues.
    pub end: (Vec<f64>, Vec<f64>),
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

    /// Measured position for the actual one of a joint.
    pub(super) fn measured(&self, joint: usize, position: f64) -> f64 {
        measured_position(&self.terms, joint, position)
    }
}

/// Sum of all delays of commands and ages of measurements among `terms`, s: what happened earlier has no effect.
pub fn longest_delay<'a>(terms: impl IntoIterator<Item = &'a JointTerm>) -> f64 {
    let own = |t: &&JointTerm| matches!(t.effect.law, JointLaw::CommandDelay | JointLaw::EncoderLag);
    terms.into_iter().filter(own).map(|t| t.values[0]).sum()
}

/// Measured position for the actual one of a joint, with the encoder's effects among `terms`.
pub fn measured_position<'a>(
    terms: impl IntoIterator<Item = &'a JointTerm>,
    joint: usize,
    position: f64,
) -> f64 {
    let own = terms.into_iter().filter(|t| t.joint == joint);
    own.fold(position, |q, term| match term.effect.law {
        JointLaw::Encoder(measure) => measure(&term.values, q),
        _ => q,
    })
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
