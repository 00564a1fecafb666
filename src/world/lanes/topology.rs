//! Which rollouts may share a batch.

use super::piece::pieces;
use crate::task::scene::Point;
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
    /// Kind, and what it is about.
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
                    let [a, b] = parties.map(|p| number(p, count));
                    (1, a, b)
                }
                Condition::Apart { parties, .. } => {
                    let [a, b] = parties.map(|p| number(p, count));
                    (2, a, b)
                }
                Condition::Above { body, point, .. } => (3, *body, usize::from(*point == Point::Centre)),
            }),
        }
    }
}

/// Bodies, then statics.
fn number(party: Party, bodies: usize) -> usize {
    match party {
        Party::Body(i) => i,
        Party::Static(i) => bodies + i,
    }
}

fn corners(shape: &Pieces) -> Vec<usize> {
    match shape.disc_radius() {
        Some(_) => Vec::new(),
        None => shape.0.iter().map(|piece| piece.points.len()).collect(),
    }
}
