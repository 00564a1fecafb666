//! The compiled model of a rollout, which both engines integrate.

use super::compiled_intervention::{CompiledIntervention, InterventionOp};
use super::effect::{Constants, ContactLaw, MotionLaw};
use super::goal::{GoalCondition, GoalSpec, ObjectId};
use super::observe::{ObservationSchedule, SensorChain};
use super::state::BodyState;
use crate::task::complexity::{ShapeSize, distance_work, region_work, step_cost};
use crate::task::scene::ContactRules;
use crate::task::solid::{ConvexPieces, Solid};

/// Numbers only, without names to look up or open options.
#[derive(Clone)]
pub struct RolloutModel {
    /// m/s^2
    pub gravity: [f64; 2],
    /// s
    pub time_step: f64,
    pub steps: u32,
    pub schedule: ObservationSchedule,
    /// Whether contact events are recorded, and not only counted.
    pub records_contacts: bool,
    pub bodies: Vec<BodyModel>,
    pub statics: Vec<StaticModel>,
    /// Names of the effects that engines apply, in order.
    pub effects: Vec<&'static str>,
    /// Mixing rules for the coefficients of two surfaces.
    pub rules: ContactRules,
    /// Active laws of motion, in order of application.
    pub motion_laws: Vec<(&'static dyn MotionLaw, Constants)>,
    /// Active laws of contact, in order of application.
    pub contact_laws: Vec<(&'static dyn ContactLaw, Constants)>,
    /// Sensors applied to the observations; `None` without sensor effects.
    pub sensors: Option<SensorChain>,
    pub goal: Option<GoalSpec>,
    /// Whether the rollout ends when the goal is reached.
    pub stop_at_goal: bool,
    /// Whether contacts at the start are already established.
    pub contacts_established: bool,
    /// Gap up to which two surfaces count as touching in events and counts, m.
    pub contact_margin: f64,
    /// Numbers of the scene's own bodies and statics; added ones follow.
    pub scene_counts: [usize; 2],
    /// Interventions in order of their step.
    pub interventions: Vec<CompiledIntervention>,
}

/// Work between two checks of the budget, in units of [`step_cost`]: about a millisecond.
const STEP_COST_PER_CHECK: u64 = 1024;

/// A movable body.
#[derive(Clone, Debug)]
pub struct BodyModel {
    pub name: String,
    /// Body frame.
    pub shape: ConvexPieces,
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
    /// Whether it is currently in the scene.
    pub present: bool,
}

/// An object that never moves.
#[derive(Clone, Debug)]
pub struct StaticModel {
    pub name: String,
    /// World frame.
    pub shape: Solid,
    pub friction: f64,
    pub restitution: f64,
    /// Whether it is currently in the scene.
    pub present: bool,
}

impl RolloutModel {
    /// Number of time steps between two checks of the budget: about a millisecond.
    pub fn steps_per_check(&self) -> u64 {
        let bodies: Vec<ShapeSize> = self.bodies.iter().map(|b| ShapeSize::of(&b.shape)).collect();
        let statics: Vec<ShapeSize> = self.statics.iter().map(|s| ShapeSize::of_solid(&s.shape)).collect();
        let object = |id: &ObjectId| match id {
            ObjectId::Body(i) => bodies[*i],
            ObjectId::Static(i) => statics[*i],
        };
        let goal_work = match self.goal.as_ref().map(|goal| &goal.condition) {
            Some(GoalCondition::Contact { objects, .. } | GoalCondition::Apart { objects, .. }) => {
                distance_work([object(&objects[0]), object(&objects[1])])
            }
            Some(GoalCondition::Inside { region, .. }) => region_work(region.len()),
            Some(GoalCondition::Above { .. }) | None => 0,
        };
        (STEP_COST_PER_CHECK / step_cost(&bodies, &statics, goal_work).max(1)).max(1)
    }
}

impl BodyModel {
    /// The initial state.
    pub fn initial_state(&self) -> BodyState {
        // Adding 0 turns -0 into 0, as in the engines.
        BodyState {
            position: self.position.map(|x| x + 0.0),
            angle: self.angle + 0.0,
            velocity: self.velocity.map(|v| v + 0.0),
            omega: self.omega + 0.0,
        }
    }

    /// Gap up to which two surfaces count as touching if this is the smallest body, m.
    pub fn contact_margin(&self) -> f64 {
        0.005 * self.shape.smallest_extent().min(1.0)
    }

    /// Vector from the frame's origin to the centre of mass at an angle, world frame, m.
    pub fn arm(&self, angle: f64) -> [f64; 2] {
        let [x, y] = self.centre;
        if [x, y] == [0.0; 2] {
            return [0.0; 2];
        }
        let (sine, cosine) = libm::sincos(angle);
        [cosine * x - sine * y, sine * x + cosine * y]
    }
}

impl RolloutModel {
    /// Path of an object in the input, for errors.
    pub fn input_path(&self, object: ObjectId) -> String {
        let adds =
            |c: &&CompiledIntervention| matches!(&c.op, InterventionOp::Add(added) if *added == object);
        match (self.interventions.iter().find(adds), object) {
            (Some(change), ObjectId::Body(_)) => format!("interventions[{}].body", change.number),
            (Some(change), ObjectId::Static(_)) => format!("interventions[{}].static", change.number),
            (None, ObjectId::Body(i)) => format!("bodies[{i}]"),
            (None, ObjectId::Static(i)) => format!("statics[{i}]"),
        }
    }

    /// Initial states of the bodies.
    pub fn initial_states(&self) -> Vec<BodyState> {
        let start = |b: &BodyModel| if b.present { b.initial_state() } else { BodyState::ABSENT };
        self.bodies.iter().map(start).collect()
    }

    /// Friction and restitution of an object by index: bodies, then statics.
    pub fn surface_coefficients(&self, number: usize) -> [f64; 2] {
        match self.bodies.get(number) {
            Some(body) => [body.friction, body.restitution],
            None => {
                let fixed = &self.statics[number - self.bodies.len()];
                [fixed.friction, fixed.restitution]
            }
        }
    }

    /// Whether an object is in the scene; by index.
    pub fn is_present(&self, number: usize) -> bool {
        match self.bodies.get(number) {
            Some(body) => body.present,
            None => self.statics[number - self.bodies.len()].present,
        }
    }

    /// Whether all objects of a goal are in the scene.
    pub fn has_goal_objects(&self, goal: &GoalSpec) -> bool {
        let present = |object: &ObjectId| match object {
            ObjectId::Body(i) => self.bodies[*i].present,
            ObjectId::Static(i) => self.statics[*i].present,
        };
        match &goal.condition {
            GoalCondition::Contact { objects, .. } | GoalCondition::Apart { objects, .. } => {
                objects.iter().all(present)
            }
            GoalCondition::Inside { body, .. } | GoalCondition::Above { body, .. } => {
                self.bodies[*body].present
            }
        }
    }
}
