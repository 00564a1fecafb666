//! Watching a goal while a rollout runs: the same rule for every engine.

use crate::task::geometry::polygon_contains;
use crate::task::scene::{Goal, Scene};
use crate::task::solid::Pieces;

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
    /// A body's position lies in a polygon.
    Inside { body: usize, region: Vec<[f64; 2]> },
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
}

impl GoalSpec {
    /// Resolves the names of a validated scene's goal.
    pub fn new(goal: &Goal, scene: &Scene) -> GoalSpec {
        let body = |name: &str| scene.bodies.iter().position(|b| b.name == name);
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
        match goal {
            Goal::Contact { bodies, hold_s, tolerance, .. } => GoalSpec {
                condition: Condition::Contact {
                    parties: [party(&bodies[0]), party(&bodies[1])],
                    tolerance: *tolerance,
                },
                hold_s: *hold_s,
            },
            Goal::Inside { body: name, region, hold_s, .. } => GoalSpec {
                condition: Condition::Inside {
                    body: body(name).expect("goal names are validated with the scene"),
                    region: region.clone(),
                },
                hold_s: *hold_s,
            },
        }
    }

    /// Time steps on end for which the condition must hold (at least one).
    pub fn hold_steps(&self, time_step: f64) -> u32 {
        (self.hold_s / time_step - 1e-9).ceil().max(1.0) as u32
    }
}

impl Watch {
    /// Takes in one time step; `true` once the condition has held for `needed` steps on end.
    pub fn advance(&mut self, holds: bool, needed: u32) -> bool {
        self.held = if holds { self.held + 1 } else { 0 };
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
    match condition {
        Condition::Inside { body, region } => polygon_contains(region, pose(*body).0),
        Condition::Contact { parties, tolerance } => match *parties {
            [Party::Body(a), Party::Body(b)] => {
                if let (Some(one), Some(other)) = (shape(a).disc_radius(), shape(b).disc_radius()) {
                    // What `gap_to` says of two discs, without making the placed shapes: this runs every step.
                    let ([ax, ay], [bx, by]) = (pose(a).0, pose(b).0);
                    let (dx, dy) = (ax - bx, ay - by);
                    (dx * dx + dy * dy).sqrt() - (one + other) <= *tolerance
                } else {
                    placed(a).gap_to(&placed(b)) <= *tolerance
                }
            }
            [Party::Body(a), Party::Static(s)] | [Party::Static(s), Party::Body(a)] => {
                gap_to_static(s, &placed(a)) <= *tolerance
            }
            // Two statics never come closer; the scene is legal and the goal unreachable.
            [Party::Static(_), Party::Static(_)] => false,
        },
    }
}
