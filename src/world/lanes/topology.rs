//! Which rollouts may share a batch.

use super::piece::pieces;
use crate::task::solid::Pieces;
use crate::world::goal::{Condition, Party};
use crate::world::prepare::Prepared;

/// What rollouts must have in common to share a batch.
#[derive(Clone, Debug, PartialEq, Eq, Hash)]
pub struct Topology {
    /// Corners of each piece of each body; none for a disc.
    bodies: Vec<Vec<usize>>,
    /// Corners of each piece of each static, with the static's number; 0 for a half plane.
    statics: Vec<(usize, usize)>,
    /// How many of them are there from the start.
    own: [usize; 2],
    effects: Vec<&'static str>,
    /// Bits of the time step.
    time_step: u64,
    goal: Option<(usize, usize, usize)>,
}

impl Topology {
    /// The topology of a rollout.
    pub fn of(prepared: &Prepared) -> Topology {
        let count = prepared.bodies.len();
        Topology {
            bodies: prepared.bodies.iter().map(|b| corners(&b.shape)).collect(),
            statics: pieces(prepared).map(|(s, piece)| (s, piece.corners())).collect(),
            own: prepared.own,
            effects: prepared.effects.clone(),
            time_step: prepared.time_step.to_bits(),
            goal: prepared.goal.as_ref().map(|g| match &g.condition {
                Condition::Inside { body, .. } => (0, *body, 0),
                Condition::Contact { parties, .. } => {
                    let [a, b] = parties.map(|p| match p {
                        Party::Body(i) => i,
                        Party::Static(i) => count + i,
                    });
                    (1, a, b)
                }
            }),
        }
    }
}

fn corners(shape: &Pieces) -> Vec<usize> {
    match shape.disc_radius() {
        Some(_) => Vec::new(),
        None => shape.0.iter().map(|piece| piece.points.len()).collect(),
    }
}
