//! The topology of a rollout.

use super::super::static_piece::pieces;
use super::super::topology::{GoalTopology, Topology};
use crate::task::scene::GoalPoint;
use crate::task::solid::ConvexPieces;
use crate::world::compile::RolloutModel;
use crate::world::effect::{EffectKind, REGISTRY};
use crate::world::goal::{GoalCondition, ObjectId};

impl Topology {
    /// The topology of a rollout.
    pub fn of(model: &RolloutModel) -> Topology {
        let count = model.bodies.len();
        let indices = model.effects.iter().filter_map(|name| REGISTRY.iter().position(|e| e.name == *name));
        let laws: Vec<usize> = indices.collect();
        let of_kind = |wanted: fn(&EffectKind) -> bool| {
            laws.iter().copied().filter(|i| wanted(&REGISTRY[*i].kind)).collect::<Vec<usize>>()
        };
        Topology {
            bodies: model.bodies.iter().map(|b| corners(&b.shape)).collect(),
            statics: pieces(model).map(|(s, piece)| (s, piece.corners())).collect(),
            own: model.scene_counts,
            motion_laws: of_kind(|kind| matches!(kind, EffectKind::Motion(_))),
            contact_laws: of_kind(|kind| matches!(kind, EffectKind::Contact(_))),
            clocked: model.motion_laws.iter().any(|(law, _)| !law.is_autonomous()),
            contacts_established: model.contacts_established,
            time_step: model.time_step.to_bits(),
            goal: model.goal.as_ref().map(|g| goal(&g.condition, count)),
        }
    }
}

fn goal(condition: &GoalCondition, bodies: usize) -> GoalTopology {
    match condition {
        GoalCondition::Inside { body, .. } => GoalTopology::Inside { body: *body },
        GoalCondition::Contact { objects, .. } => {
            GoalTopology::Contact { objects: objects.map(|o| index(o, bodies)) }
        }
        GoalCondition::Apart { objects, .. } => {
            GoalTopology::Apart { objects: objects.map(|o| index(o, bodies)) }
        }
        GoalCondition::Above { body, point, .. } => {
            GoalTopology::Above { body: *body, whole: *point == GoalPoint::Lowest }
        }
    }
}

/// Index of an object: bodies, then statics.
fn index(object: ObjectId, bodies: usize) -> usize {
    match object {
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
