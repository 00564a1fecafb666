//! Topology: the properties that rollouts of one batch share.

use super::static_piece::pieces;
use crate::task::scene::GoalPoint;
use crate::task::solid::ConvexPieces;
use crate::world::compile::RolloutModel;
use crate::world::goal::{GoalCondition, ObjectId};

/// The properties that rollouts of one batch have in common.
#[derive(Clone, Debug, PartialEq, Eq, Hash)]
pub struct Topology {
    /// Corners of each piece of each body; empty for a disc.
    bodies: Vec<Vec<usize>>,
    /// Corners of each piece of each static, with the static's index; 0 for a half plane.
    statics: Vec<(usize, usize)>,
    /// Numbers of the scene's own bodies and statics.
    own: [usize; 2],
    effects: Vec<&'static str>,
    /// Bits of the time step.
    time_step: u64,
    /// Kind of the goal, and its objects.
    goal: Option<(usize, usize, usize)>,
}

impl Topology {
    /// The topology of a rollout.
    pub fn of(model: &RolloutModel) -> Topology {
        let count = model.bodies.len();
        Topology {
            bodies: model.bodies.iter().map(|b| corners(&b.shape)).collect(),
            statics: pieces(model).map(|(s, piece)| (s, piece.corners())).collect(),
            own: model.scene_counts,
            effects: model.effects.clone(),
            time_step: model.time_step.to_bits(),
            goal: model.goal.as_ref().map(|g| match &g.condition {
                GoalCondition::Inside { body, .. } => (0, *body, 0),
                GoalCondition::Contact { objects, .. } => {
                    let [a, b] = objects.map(|p| number(p, count));
                    (1, a, b)
                }
                GoalCondition::Apart { objects, .. } => {
                    let [a, b] = objects.map(|p| number(p, count));
                    (2, a, b)
                }
                GoalCondition::Above { body, point, .. } => {
                    (3, *body, usize::from(*point == GoalPoint::Centre))
                }
            }),
        }
    }
}

/// Index of an object: bodies, then statics.
fn number(party: ObjectId, bodies: usize) -> usize {
    match party {
        ObjectId::Body(i) => i,
        ObjectId::Static(i) => bodies + i,
    }
}

fn corners(shape: &ConvexPieces) -> Vec<usize> {
    match shape.disc_radius() {
        Some(_) => Vec::new(),
        None => shape.0.iter().map(|piece| piece.points.len()).collect(),
    }
}
