//! Evaluation of goals during a rollout, shared by all engines.

use crate::task::geometry::polygon_contains;
use crate::task::scene::{Goal, GoalPoint, Scene};
use crate::task::solid::{ConvexPieces, Solid};

/// A goal with names resolved to indices.
#[derive(Clone, Debug)]
pub struct GoalSpec {
    /// The condition that must hold.
    pub condition: GoalCondition,
    /// Duration for which it must hold without interruption, s.
    pub hold_s: f64,
}

/// The condition of a goal.
#[derive(Clone, Debug)]
pub enum GoalCondition {
    /// The gap between two objects is at most `tolerance` (m).
    Contact { objects: [ObjectId; 2], tolerance: f64 },
    /// The gap between two objects is more than `tolerance` (m); with `after_touch` only after a contact.
    Apart { objects: [ObjectId; 2], tolerance: f64, after_touch: bool },
    /// A body's position lies in a polygon.
    Inside { body: usize, region: Vec<[f64; 2]> },
    /// A body, or only its position, is nowhere below the line `normal . p = offset`.
    Above { body: usize, point: GoalPoint, normal: [f64; 2], offset: f64 },
}

/// Index of an object: a body or a static of the rollout.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ObjectId {
    Body(usize),
    Static(usize),
}

/// Counts the steps for which the condition has held.
#[derive(Clone, Debug, Default)]
pub struct HoldCounter {
    held: u32,
    /// Whether the condition has ever been violated.
    failed: bool,
}

impl GoalSpec {
    /// Resolves the names of a validated scene's goal.
    pub fn new(goal: &Goal, scene: &Scene) -> GoalSpec {
        let body = |name: &str| scene.bodies.iter().position(|b| b.name == name);
        let known = |name: &str| body(name).expect("goal names are validated with the scene");
        let party = |name: &str| match body(name) {
            Some(i) => ObjectId::Body(i),
            None => ObjectId::Static(
                scene
                    .statics
                    .iter()
                    .position(|s| s.name == name)
                    .expect("goal names are validated with the scene"),
            ),
        };
        let objects = |bodies: &[String; 2]| [party(&bodies[0]), party(&bodies[1])];
        let (condition, hold_s) = match goal {
            Goal::Contact { bodies, hold_s, tolerance, .. } => {
                (GoalCondition::Contact { objects: objects(bodies), tolerance: *tolerance }, hold_s)
            }
            Goal::Apart { bodies, after_touch, hold_s, tolerance, .. } => {
                let (tolerance, after_touch) = (*tolerance, *after_touch);
                (GoalCondition::Apart { objects: objects(bodies), tolerance, after_touch }, hold_s)
            }
            Goal::Inside { body, region, hold_s, .. } => {
                (GoalCondition::Inside { body: known(body), region: region.clone() }, hold_s)
            }
            Goal::Above { body, point, hold_s, .. } => {
                let (normal, offset) = goal.line().expect("a goal's line is validated with the scene");
                (GoalCondition::Above { body: known(body), point: *point, normal, offset }, hold_s)
            }
        };
        GoalSpec { condition, hold_s: *hold_s }
    }

    /// Number of consecutive time steps for which the condition must hold (at least one).
    pub fn hold_steps(&self, time_step: f64) -> u32 {
        (self.hold_s / time_step - 1e-9).ceil().max(1.0) as u32
    }
}

impl HoldCounter {
    /// Advances by one time step; `true` once the condition has held for `needed` consecutive steps.
    pub fn advance(&mut self, condition: &GoalCondition, holds: bool, needed: u32) -> bool {
        let waits = matches!(condition, GoalCondition::Apart { after_touch: true, .. }) && !self.failed;
        self.failed |= !holds;
        self.held = if holds && !waits { self.held + 1 } else { 0 };
        self.held >= needed
    }
}

/// Whether the condition holds, given each body's pose and shape, and its gap to a static.
pub fn holds<'a>(
    condition: &GoalCondition,
    pose: impl Fn(usize) -> ([f64; 2], f64),
    gap_to_static: impl Fn(usize, &ConvexPieces) -> f64,
    shape: impl Fn(usize) -> &'a ConvexPieces,
) -> bool {
    let placed = |i: usize| {
        let (position, angle) = pose(i);
        shape(i).placed(position, angle)
    };
    let gap = |objects: &[ObjectId; 2]| match *objects {
        [ObjectId::Body(a), ObjectId::Body(b)] => {
            if let (Some(one), Some(other)) = (shape(a).disc_radius(), shape(b).disc_radius()) {
                // The same as the general signed distance for two discs, without constructing
                // the placed shapes: this runs every step.
                let ([ax, ay], [bx, by]) = (pose(a).0, pose(b).0);
                let (dx, dy) = (ax - bx, ay - by);
                Some((dx * dx + dy * dy).sqrt() - (one + other))
            } else {
                Some(placed(a).signed_distance_to(&placed(b)))
            }
        }
        [ObjectId::Body(a), ObjectId::Static(s)] | [ObjectId::Static(s), ObjectId::Body(a)] => {
            Some(gap_to_static(s, &placed(a)))
        }
        // The distance between two statics never changes: the scene is valid and the goal
        // unreachable.
        [ObjectId::Static(_), ObjectId::Static(_)] => None,
    };
    match condition {
        GoalCondition::Inside { body, region } => polygon_contains(region, pose(*body).0),
        GoalCondition::Contact { objects, tolerance } => gap(objects).is_some_and(|g| g <= *tolerance),
        GoalCondition::Apart { objects, tolerance, .. } => gap(objects).is_some_and(|g| g > *tolerance),
        GoalCondition::Above { body, point: GoalPoint::Centre, normal, offset } => {
            let [x, y] = pose(*body).0;
            normal[0] * x + normal[1] * y >= *offset
        }
        GoalCondition::Above { body, point: GoalPoint::Lowest, normal, offset } => {
            Solid::HalfPlane { normal: *normal, offset: *offset }.signed_distance_to(&placed(*body)) >= 0.0
        }
    }
}
