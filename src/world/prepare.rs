//! A rollout with everything decided: what both engines integrate, so that a scene means the same in each.

use super::Rollout;
use super::effect::{self, Act, Active, Constants, Motion, Placing, Sensor, Surroundings, Touch};
use super::goal::{Condition, GoalSpec, Party};
use super::intervene::{self, Change, Matter};
use super::observe::{Schedule, View};
use super::record::State;
use crate::error::{Error, Result};
use crate::task::Scene;
use crate::task::action::Quantity;
use crate::task::scene::{Body, ContactRules, EffectTerm, Static};
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
        let adds = |c: &&Change| matches!(&c.act, intervene::Act::Add(added) if *added == thing);
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
            Condition::Contact { parties, .. } => parties.iter().all(there),
            Condition::Inside { body, .. } => self.bodies[*body].there,
        }
    }
}

/// Decides everything about a rollout; errors name the field that stands in the way.
pub fn prepare(rollout: &Rollout) -> Result<Prepared> {
    let scene = rollout.scene;
    rollout.latents.validate()?;
    let laws = Laws::of(rollout)?;
    let view = View::new(laws.sensors, f64::from(scene.observe_every) * scene.time_step);
    let schedule = match &view {
        Some(view) => view.schedule(scene.time_step, scene.steps, scene.observe_every)?,
        None => Schedule::Every(scene.observe_every),
    };
    let bodies = scene.bodies.iter().enumerate().map(|(i, body)| {
        let body = prepare_body(rollout, body, &laws.placings);
        body.map_err(|e| e.under(&format!("bodies[{i}]")))
    });
    let bodies = bodies.collect::<Result<Vec<PreparedBody>>>()?;
    let statics: Vec<PreparedStatic> =
        scene.statics.iter().map(|s| prepare_static(rollout, s, &laws.placings)).collect();
    let mut prepared = Prepared {
        gravity: scene.gravity,
        time_step: scene.time_step,
        steps: scene.steps,
        schedule,
        view,
        effects: laws.names,
        rules: scene.contact_rules.unwrap_or_default(),
        motions: laws.motions,
        touches: laws.touches,
        goal: scene.goal.as_ref().map(|goal| GoalSpec::new(goal, scene)),
        stop: scene.stops_at_goal() && rollout.stop,
        touch: bodies.iter().map(intervene::touch).fold(f64::INFINITY, f64::min),
        own: [bodies.len(), statics.len()],
        changes: Vec::new(),
        bodies,
        statics,
    };
    let placings = &laws.placings;
    intervene::decide(
        rollout,
        &mut prepared,
        |body| prepare_body(rollout, body, placings),
        |fixed| prepare_static(rollout, fixed, placings),
        |latents| matter(&Rollout { latents, ..*rollout }, placings),
    )?;
    Ok(prepared)
}

/// What latents decide of the scene's own things.
fn matter(rollout: &Rollout, placings: &[(&'static dyn Placing, Constants)]) -> Result<intervene::Act> {
    let body = |body: &Body| {
        let own = prepare_body(rollout, body, placings)?;
        Ok(Matter { mass: own.mass, inertia: own.inertia, surface: [own.friction, own.restitution] })
    };
    let fixed = |fixed: &Static| {
        let own = prepare_static(rollout, fixed, placings);
        [own.friction, own.restitution]
    };
    Ok(intervene::Act::Matter {
        bodies: rollout.scene.bodies.iter().map(body).collect::<Result<_>>()?,
        statics: rollout.scene.statics.iter().map(fixed).collect(),
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

/// The effects of a rollout by what they act on, in the order in which they act, with their constants.
#[derive(Default)]
struct Laws {
    /// Names of those that engines know of.
    names: Vec<&'static str>,
    motions: Vec<(&'static dyn Motion, Constants)>,
    touches: Vec<(&'static dyn Touch, Constants)>,
    sensors: Vec<(&'static dyn Sensor, Constants)>,
    placings: Vec<(&'static dyn Placing, Constants)>,
}

impl Laws {
    fn of(rollout: &Rollout) -> Result<Laws> {
        let scene = rollout.scene;
        let around = Surroundings { time_step: scene.time_step, gravity: scene.gravity };
        let mut laws = Laws::default();
        for active in active(rollout)? {
            let neutral = active.is_neutral();
            let Active { effect, values } = active;
            match effect.act {
                Act::Motion(law) => {
                    laws.names.push(effect.name);
                    laws.motions.push((law, law.constants(&values, &around)));
                }
                Act::Contact(law) => {
                    laws.names.push(effect.name);
                    laws.touches.push((law, law.constants(&values, &around)));
                }
                Act::Sensor(_) | Act::Action(_) if neutral => {}
                Act::Sensor(sensor) => laws.sensors.push((sensor, sensor.constants(&values, &around))),
                Act::Action(placing) => laws.placings.push((placing, placing.constants(&values, &around))),
            }
        }
        Ok(laws)
    }
}

/// Errors name the body's field.
fn prepare_body(
    rollout: &Rollout,
    body: &Body,
    placings: &[(&'static dyn Placing, Constants)],
) -> Result<PreparedBody> {
    let (scene, latents) = (rollout.scene, &rollout.latents);
    let carries = scene.carries_latents(&body.name);
    let (mass, inertia) = body.mass_properties(latents.density.filter(|_| carries));
    let Some(position) = body.position else {
        let allowed = if scene.action.as_ref().is_some_and(|a| a.places(&body.name)) {
            "an action that places it, or a position in the scene"
        } else {
            "a position in m, needed for a rollout"
        };
        return Err(Error::input("position", "missing", allowed));
    };
    let Some(shape) = body.shape.pieces() else {
        let value = format!("a {}", body.shape.name());
        return Err(Error::input("shape", value, "a bounded shape for a movable body"));
    };
    Ok(PreparedBody {
        name: body.name.clone(),
        shape,
        mass,
        inertia,
        centre: body.shape.moments().centre,
        friction: latents.friction.filter(|_| carries).unwrap_or(body.friction),
        restitution: latents.restitution.filter(|_| carries).unwrap_or(body.restitution),
        position: carried_out(scene, placings, &body.name, position),
        angle: body.angle,
        velocity: body.velocity,
        omega: body.angular_velocity,
        there: true,
    })
}

fn prepare_static(
    rollout: &Rollout,
    fixed: &Static,
    placings: &[(&'static dyn Placing, Constants)],
) -> PreparedStatic {
    let (scene, latents) = (rollout.scene, &rollout.latents);
    let carries = scene.carries_latents(&fixed.name);
    let position = carried_out(scene, placings, &fixed.name, fixed.position);
    PreparedStatic {
        name: fixed.name.clone(),
        shape: fixed.shape.solid().placed(position, fixed.angle),
        friction: latents.friction.filter(|_| carries).unwrap_or(fixed.friction),
        restitution: latents.restitution.filter(|_| carries).unwrap_or(fixed.restitution),
        there: true,
    }
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

/// The scene's own, then the rollout's.
fn active(rollout: &Rollout) -> Result<Vec<Active>> {
    let own = rollout.scene.effects.len();
    let mut all = effect::of_scene(rollout.scene)?;
    for (i, term) in rollout.effects.iter().enumerate() {
        all.push(effect::resolve(term, &format!("effects[{}]", own + i))?);
    }
    Ok(all)
}
