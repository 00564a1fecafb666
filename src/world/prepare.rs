//! A rollout with everything decided: what both engines integrate, so that a scene means the same in each.

use super::Rollout;
use super::effect::{self, Act, Active, Constants, Motion, Placing, Surroundings, Touch};
use super::goal::GoalSpec;
use super::observe::{Schedule, View};
use crate::error::{Error, Result};
use crate::task::Scene;
use crate::task::action::Quantity;
use crate::task::geometry::Convex;
use crate::task::scene::{EffectTerm, Shape};

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
    /// Laws of motion at work, in the order in which they act.
    pub motions: Vec<(&'static dyn Motion, Constants)>,
    /// Laws of contact at work, in the order in which they act.
    pub touches: Vec<(&'static dyn Touch, Constants)>,
    /// What sensors make of what the engine observes; `None` if they show the truth.
    pub view: Option<View>,
    pub goal: Option<GoalSpec>,
    /// Whether the rollout ends when the goal is reached.
    pub stop: bool,
    /// Gap up to which two surfaces count as touching in events and counts, m.
    pub touch: f64,
}

/// A movable body.
#[derive(Clone, Debug)]
pub struct PreparedBody {
    pub name: String,
    /// Convex core and radius, body frame.
    pub shape: Convex,
    /// kg
    pub mass: f64,
    /// kg m^2, about the centroid
    pub inertia: f64,
    pub friction: f64,
    pub restitution: f64,
    /// m
    pub position: [f64; 2],
    /// rad
    pub angle: f64,
    /// m/s
    pub velocity: [f64; 2],
    /// rad/s
    pub omega: f64,
}

/// A thing that never moves.
#[derive(Clone, Debug)]
pub struct PreparedStatic {
    pub name: String,
    pub shape: PreparedShape,
    pub friction: f64,
    pub restitution: f64,
}

/// A static's shape, world frame.
#[derive(Clone, Debug)]
pub enum PreparedShape {
    /// Convex core and radius.
    Convex(Convex),
    /// Everything below `normal . p = offset`.
    Halfspace { normal: [f64; 2], offset: f64 },
}

/// Decides everything about a rollout; errors name the field that stands in the way.
pub fn prepare(rollout: &Rollout) -> Result<Prepared> {
    let scene = rollout.scene;
    let latents = &rollout.latents;
    latents.validate()?;
    let around = Surroundings { time_step: scene.time_step, gravity: scene.gravity };
    let (mut effects, mut motions, mut touches) = (Vec::new(), Vec::new(), Vec::new());
    let (mut sensors, mut placings) = (Vec::new(), Vec::new());
    for active in active(rollout)? {
        let neutral = active.is_neutral();
        let Active { effect, values } = active;
        match effect.act {
            Act::Motion(law) => {
                effects.push(effect.name);
                motions.push((law, law.constants(&values, &around)));
            }
            Act::Contact(law) => {
                effects.push(effect.name);
                touches.push((law, law.constants(&values, &around)));
            }
            Act::Sensor(_) | Act::Action(_) if neutral => {}
            Act::Sensor(sensor) => sensors.push((sensor, sensor.constants(&values, &around))),
            Act::Action(placing) => placings.push((placing, placing.constants(&values, &around))),
        }
    }
    let view = View::new(sensors, f64::from(scene.observe_every) * scene.time_step);
    let schedule = match &view {
        Some(view) => view.schedule(scene.time_step, scene.steps, scene.observe_every)?,
        None => Schedule::Every(scene.observe_every),
    };
    let mut bodies = Vec::with_capacity(scene.bodies.len());
    for (i, body) in scene.bodies.iter().enumerate() {
        let carries = scene.carries_latents(&body.name);
        let (mass, inertia) = body.mass_properties(latents.density.filter(|_| carries));
        let Some(position) = body.position else {
            let allowed = if scene.action.as_ref().is_some_and(|a| a.places(&body.name)) {
                "an action that places it, or a position in the scene"
            } else {
                "a position in m, needed for a rollout"
            };
            return Err(Error::input(format!("bodies[{i}].position"), "missing", allowed));
        };
        bodies.push(PreparedBody {
            name: body.name.clone(),
            shape: body.shape.convex().ok_or_else(|| {
                Error::input(
                    format!("bodies[{i}].shape"),
                    "a halfspace",
                    "a bounded shape for a movable body",
                )
            })?,
            mass,
            inertia,
            friction: latents.friction.filter(|_| carries).unwrap_or(body.friction),
            restitution: latents.restitution.filter(|_| carries).unwrap_or(body.restitution),
            position: carried_out(scene, &placings, &body.name, position),
            angle: body.angle,
            velocity: body.velocity,
            omega: body.angular_velocity,
        });
    }
    let statics = scene
        .statics
        .iter()
        .map(|s| {
            let carries = scene.carries_latents(&s.name);
            let position = carried_out(scene, &placings, &s.name, s.position);
            let shape = match (&s.shape, s.shape.convex()) {
                (Shape::Halfspace { normal, offset }, _) => {
                    let shift = normal[0] * position[0] + normal[1] * position[1];
                    PreparedShape::Halfspace { normal: *normal, offset: offset + shift }
                }
                (_, Some(shape)) => PreparedShape::Convex(shape.placed(position, s.angle)),
                (_, None) => unreachable!("every shape but a halfspace has a convex core"),
            };
            PreparedStatic {
                name: s.name.clone(),
                shape,
                friction: latents.friction.filter(|_| carries).unwrap_or(s.friction),
                restitution: latents.restitution.filter(|_| carries).unwrap_or(s.restitution),
            }
        })
        .collect();
    let smallest = bodies
        .iter()
        .map(|b| {
            let s = b.shape.bounds();
            (s[2] - s[0]).min(s[3] - s[1])
        })
        .fold(f64::INFINITY, f64::min);
    Ok(Prepared {
        gravity: scene.gravity,
        time_step: scene.time_step,
        steps: scene.steps,
        schedule,
        view,
        effects,
        motions,
        touches,
        goal: scene.goal.as_ref().map(|goal| GoalSpec::new(goal, scene)),
        stop: scene.stops_at_goal() && rollout.stop,
        touch: 0.005 * smallest.min(1.0),
        bodies,
        statics,
    })
}

/// Whether a rollout is sure to be prepared without error, and for the same engine and topology, because `other` was: the
/// same scene with other numbers. Cheaper than preparing it.
pub fn is_like(rollout: &Rollout, other: &Rollout) -> bool {
    let same = |(a, b): (&EffectTerm, &EffectTerm)| a.name == b.name;
    let simulated = |a: &Active| matches!(a.effect.act, Act::Motion(_) | Act::Contact(_));
    std::ptr::eq(rollout.scene, other.scene)
        && rollout.effects.len() == other.effects.len()
        && rollout.effects.iter().zip(other.effects).all(same)
        && rollout.latents.validate().is_ok()
        && active(rollout).is_ok_and(|all| all.iter().all(simulated))
}

/// Where the thing named `name` ends up that was to stand at `asked`, if an action placed it.
fn carried_out(
    scene: &Scene,
    placings: &[(&'static dyn Placing, Constants)],
    name: &str,
    asked: [f64; 2],
) -> [f64; 2] {
    if placings.is_empty() {
        return asked;
    }
    let mut targets = scene
        .action
        .iter()
        .flat_map(|a| &a.components)
        .filter(|c| matches!(c.set, Quantity::X | Quantity::Y))
        .map(|c| c.target.as_str())
        .peekable();
    let placed = match targets.peek() {
        Some(_) => targets.any(|t| t == name),
        // Whoever set the scene up placed what can move.
        None => scene.body(name).is_some(),
    };
    if placed { placings.iter().fold(asked, |at, (p, c)| p.placed(c, at)) } else { asked }
}

/// The scene's damping, the scene's effects, the rollout's own: in this order.
fn active(rollout: &Rollout) -> Result<Vec<Active>> {
    let mut all = Vec::new();
    if let Some(kept) = rollout.scene.damping.filter(|kept| *kept < 1.0) {
        all.push(effect::resolve(&effect::damping(kept), "damping")?);
    }
    let terms = rollout.scene.effects.iter().chain(rollout.effects);
    for (i, term) in terms.enumerate() {
        all.push(effect::resolve(term, &format!("effects[{i}]"))?);
    }
    Ok(all)
}
