//! A rollout with everything decided: what both engines integrate, so that a scene means the same in each.

use super::Rollout;
use super::change::{Act as Deed, Matter};
use super::effect::{self, Act, Active, Constants, Motion, Placing, Sensor, Surroundings, Touch};
use super::goal::GoalSpec;
use super::intervene;
use super::observe::{Schedule, View};
pub use super::prepared::{Prepared, PreparedBody, PreparedStatic};
use crate::error::{Error, Result};
use crate::task::Scene;
use crate::task::action::Quantity;
use crate::task::scene::{Body, EffectTerm, Static};

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
        settled: rollout.settled && scene.goal.is_none() && scene.interventions.is_empty(),
        touch: bodies.iter().map(PreparedBody::touch).fold(f64::INFINITY, f64::min),
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
fn matter(rollout: &Rollout, placings: &[(&'static dyn Placing, Constants)]) -> Result<Deed> {
    let body = |body: &Body| {
        let own = prepare_body(rollout, body, placings)?;
        Ok(Matter { mass: own.mass, inertia: own.inertia, surface: [own.friction, own.restitution] })
    };
    let fixed = |fixed: &Static| {
        let own = prepare_static(rollout, fixed, placings);
        [own.friction, own.restitution]
    };
    Ok(Deed::Matter {
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
        all.push(effect::resolve(term, format_args!("effects[{}]", own + i))?);
    }
    Ok(all)
}
