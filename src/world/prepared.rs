//! What both engines integrate: a rollout with everything decided.

use super::change::{Act, Change};
use super::effect::{Constants, Motion, Touch};
use super::goal::{Condition, GoalSpec, Party};
use super::observe::{Schedule, View};
use super::state::State;
use crate::task::scene::ContactRules;
use crate::task::solid::{Pieces, Solid};

/// Numbers only; no names to look up, no options left open.
#[derive(Clone)]
pub struct Prepared {
    /// m/s^2
    pub gravity: [f64; 2],
    /// s
    pub time_step: f64,
    pub steps: u32,
    pub schedule: Schedule,
    pub bodies: Vec<PreparedBody>,
    pub statics: Vec<PreparedStatic>,
    /// Names of the effects that engines know of, in the order in which they act.
    pub effects: Vec<&'static str>,
    /// How two surfaces' coefficients make a contact's.
    pub rules: ContactRules,
    /// Laws of motion at work, in the order in which they act.
    pub motions: Vec<(&'static dyn Motion, Constants)>,
    /// Laws of contact at work, in the order in which they act.
    pub touches: Vec<(&'static dyn Touch, Constants)>,
    /// What sensors make of what the engine observes; `None` if they show the truth.
    pub view: Option<View>,
    pub goal: Option<GoalSpec>,
    /// Whether the rollout ends when the goal is reached.
    pub stop: bool,
    /// Whether what touches at the start has long done so.
    pub settled: bool,
    /// Gap up to which two surfaces count as touching in events and counts, m.
    pub touch: f64,
    /// How many of the bodies and statics are the scene's own; the others come in later.
    pub own: [usize; 2],
    /// What is done on the way; `step` rising.
    pub changes: Vec<Change>,
}

/// A movable body.
#[derive(Clone, Debug)]
pub struct PreparedBody {
    pub name: String,
    /// Body frame.
    pub shape: Pieces,
    /// kg
    pub mass: f64,
    /// kg m^2, about the centre of mass
    pub inertia: f64,
    /// Centre of mass, body frame, m.
    pub centre: [f64; 2],
    pub friction: f64,
    pub restitution: f64,
    /// Of the frame's origin, m.
    pub position: [f64; 2],
    /// rad
    pub angle: f64,
    /// Of the frame's origin, m/s.
    pub velocity: [f64; 2],
    /// rad/s
    pub omega: f64,
    /// Whether it is in the scene.
    pub there: bool,
}

/// A thing that never moves.
#[derive(Clone, Debug)]
pub struct PreparedStatic {
    pub name: String,
    /// World frame.
    pub shape: Solid,
    pub friction: f64,
    pub restitution: f64,
    /// Whether it is in the scene.
    pub there: bool,
}

impl PreparedBody {
    /// Where it starts, as it was given.
    pub fn start(&self) -> State {
        // Adding 0 turns -0 into 0, as for all that follows.
        State {
            position: self.position.map(|x| x + 0.0),
            angle: self.angle + 0.0,
            velocity: self.velocity.map(|v| v + 0.0),
            omega: self.omega + 0.0,
        }
    }

    /// Gap up to which two surfaces count as touching if this is the smallest body, m.
    pub fn touch(&self) -> f64 {
        0.005 * self.shape.smallest_extent().min(1.0)
    }

    /// From the frame's origin to the centre of mass at an angle, world frame, m.
    pub fn arm(&self, angle: f64) -> [f64; 2] {
        let [x, y] = self.centre;
        if [x, y] == [0.0; 2] {
            return [0.0; 2];
        }
        let (sine, cosine) = libm::sincos(angle);
        [cosine * x - sine * y, sine * x + cosine * y]
    }
}

impl Prepared {
    /// Where a thing was given, for errors.
    pub fn path_of(&self, thing: Party) -> String {
        let adds = |c: &&Change| matches!(&c.act, Act::Add(added) if *added == thing);
        match (self.changes.iter().find(adds), thing) {
            (Some(change), Party::Body(_)) => format!("interventions[{}].body", change.number),
            (Some(change), Party::Static(_)) => format!("interventions[{}].static", change.number),
            (None, Party::Body(i)) => format!("bodies[{i}]"),
            (None, Party::Static(i)) => format!("statics[{i}]"),
        }
    }

    /// Friction and restitution of a thing by its number: bodies, then statics.
    pub fn surface(&self, number: usize) -> [f64; 2] {
        match self.bodies.get(number) {
            Some(body) => [body.friction, body.restitution],
            None => {
                let fixed = &self.statics[number - self.bodies.len()];
                [fixed.friction, fixed.restitution]
            }
        }
    }

    /// Whether a thing is in the scene; by its number.
    pub fn has_number(&self, number: usize) -> bool {
        match self.bodies.get(number) {
            Some(body) => body.there,
            None => self.statics[number - self.bodies.len()].there,
        }
    }

    /// Whether all that a goal is about is in the scene.
    pub fn has(&self, goal: &GoalSpec) -> bool {
        let there = |thing: &Party| match thing {
            Party::Body(i) => self.bodies[*i].there,
            Party::Static(i) => self.statics[*i].there,
        };
        match &goal.condition {
            Condition::Contact { parties, .. } | Condition::Apart { parties, .. } => {
                parties.iter().all(there)
            }
            Condition::Inside { body, .. } | Condition::Above { body, .. } => self.bodies[*body].there,
        }
    }
}
