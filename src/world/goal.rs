//! Watching a goal while a rollout runs: the same rule for every engine.

use crate::task::geometry::polygon_contains;
use crate::task::scene::{Goal, Point, Scene};
use crate::task::solid::{Pieces, Solid};

/// A goal with names resolved to indices.
#[derive(Clone, Debug)]
pub struct GoalSpec {
    /// What must hold.
    pub condition: Condition,
    /// s, on end
    pub hold_s: f64,
}

/// What must hold for the goal to be reached.
#[derive(Clone, Debug)]
pub enum Condition {
    /// The gap between two things is at most `tolerance` (m).
    Contact { parties: [Party; 2], tolerance: f64 },
    /// The gap between two things is more than `tolerance` (m), `after_touch` only once it has not been.
    Apart { parties: [Party; 2], tolerance: f64, after_touch: bool },
    /// A body's position lies in a polygon.
    Inside { body: usize, region: Vec<[f64; 2]> },
    /// A body, or its position if only that is asked for, is nowhere below the line `normal . p = offset`.
    Above { body: usize, point: Point, normal: [f64; 2], offset: f64 },
}

/// One side of a contact goal: index into the prepared bodies or statics.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Party {
    Body(usize),
    Static(usize),
}

/// Counts how long the condition has held.
#[derive(Clone, Debug, Default)]
pub struct Watch {
    held: u32,
    /// Whether it has once not held.
    failed: bool,
}

impl GoalSpec {
    /// Resolves the names of a validated scene's goal.
    pub fn new(goal: &Goal, scene: &Scene) -> GoalSpec {
        let body = |name: &str| scene.bodies.iter().position(|b| b.name == name);
        let known = |name: &str| body(name).expect("goal names are validated with the scene");
        let party = |name: &str| match body(name) {
            Some(i) => Party::Body(i),
            None => Party::Static(
                scene
                    .statics
                    .iter()
                    .position(|s| s.name == name)
                    .expect("goal names are validated with the scene"),
            ),
        };
        let parties = |bodies: &[String; 2]| [party(&bodies[0]), party(&bodies[1])];
        let (condition, hold_s) = match goal {
            Goal::Contact { bodies, hold_s, tolerance, .. } => {
                (Condition::Contact { parties: parties(bodies), tolerance: *tolerance }, hold_s)
            }
            Goal::Apart { bodies, after_touch, hold_s, tolerance, .. } => {
                let (tolerance, after_touch) = (*tolerance, *after_touch);
                (Condition::Apart { parties: parties(bodies), tolerance, after_touch }, hold_s)
            }
            Goal::Inside { body, region, hold_s, .. } => {
                (Condition::Inside { body: known(body), region: region.clone() }, hold_s)
            }
            Goal::Above { body, point, hold_s, .. } => {
                let (normal, offset) = goal.line().expect("a goal's line is validated with the scene");
                (Condition::Above { body: known(body), point: *point, normal, offset }, hold_s)
            }
        };
        GoalSpec { condition, hold_s: *hold_s }
    }

    /// Time steps on end for which the condition must hold (at least one).
    pub fn hold_steps(&self, time_step: f64) -> u32 {
        (self.hold_s / time_step - 1e-9).ceil().max(1.0) as u32
    }
}

impl Watch {
    /// Takes in one time step; `true` once the condition has held for `needed` steps on end.
    pub fn advance(&mut self, condition: &Condition, holds: bool, needed: u32) -> bool {
        let waits = matches!(condition, Condition::Apart { after_touch: true, .. }) && !self.failed;
        self.failed |= !holds;
        self.held = if holds && !waits { self.held + 1 } else { 0 };
        self.held >= needed
    }
}

/// Whether the condition holds, given each body's pose and shape, and its gap to a static.
pub fn holds<'a>(
    condition: &Condition,
    pose: impl Fn(usize) -> ([f64; 2], f64),
    gap_to_static: impl Fn(usize, &Pieces) -> f64,
    shape: impl Fn(usize) -> &'a Pieces,
) -> bool {
    let placed = |i: usize| {
        let (position, angle) = pose(i);
        shape(i).placed(position, angle)
    };
    let gap = |parties: &[Party; 2]| match *parties {
        [Party::Body(a), Party::Body(b)] => {
            if let (Some(one), Some(other)) = (shape(a).disc_radius(), shape(b).disc_radius()) {
                // What `gap_to` says of two discs, without making the placed shapes: this runs every step.
                let ([ax, ay], [bx, by]) = (pose(a).0, pose(b).0);
                let (dx, dy) = (ax - bx, ay - by);
                Some((dx * dx + dy * dy).sqrt() - (one + other))
            } else {
                Some(placed(a).gap_to(&placed(b)))
            }
        }
        [Party::Body(a), Party::Static(s)] | [Party::Static(s), Party::Body(a)] => {
            Some(gap_to_static(s, &placed(a)))
        }
        // Two statics never come closer, nor part; the scene is legal and the goal unreachable.
        [Party::Static(_), Party::Static(_)] => None,
    };
    match condition {
        Condition::Inside { body, region } => polygon_contains(region, pose(*body).0),
        Condition::Contact { parties, tolerance } => gap(parties).is_some_and(|g| g <= *tolerance),
        Condition::Apart { parties, tolerance, .. } => gap(parties).is_some_and(|g| g > *tolerance),
        Condition::Above { body, point: Point::Centre, normal, offset } => {
            let [x, y] = pose(*body).0;
            normal[0] * x + normal[1] * y >= *offset
        }
        Condition::Above { body, point: Point::Lowest, normal, offset } => {
            Solid::HalfPlane { normal: *normal, offset: *offset }.gap_to(&placed(*body)) >= 0.0
        }
    }
}
