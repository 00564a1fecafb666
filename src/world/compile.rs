//! Compiles a rollout into the model that the engines integrate, so that a scene has the same meaning in
//! each.

use super::Rollout;
use super::compiled_intervention::{InterventionOp, MaterialProperties};
use super::effect::{
    self, ActiveEffect, BodyLaw, Constants, ContactLaw, EffectKind, MassProperties, MotionLaw, PlacementLaw,
    Sensor, SimulationContext,
};
use super::goal::GoalSpec;
use super::intervene;
use super::observe::{ObservationSchedule, SensorChain};
pub use super::rollout_model::{BodyModel, RolloutModel, StaticModel};
use crate::error::{Error, Result};
use crate::task::Scene;
use crate::task::action::ActionQuantity;
use crate::task::scene::{Body, EffectTerm, Static};

/// Compiles a rollout; errors name the invalid field.
pub fn compile(rollout: &Rollout) -> Result<RolloutModel> {
    let scene = rollout.scene;
    scene.check_without_joints()?;
    rollout.latents.validate()?;
    let laws = ResolvedEffects::of(rollout)?;
    let view = SensorChain::new(laws.sensors, f64::from(scene.observe_every) * scene.time_step);
    let schedule = match &view {
        Some(view) => view.schedule(scene.time_step, scene.steps, scene.observe_every)?,
        None => ObservationSchedule::Every(scene.observe_every),
    };
    let bodies = scene.bodies.iter().enumerate().map(|(i, body)| {
        let body = compile_body(rollout, body, &laws.objects);
        body.map_err(|e| e.in_field(&format!("bodies[{i}]")))
    });
    let bodies = bodies.collect::<Result<Vec<BodyModel>>>()?;
    let statics: Vec<StaticModel> =
        scene.statics.iter().map(|s| compile_static(rollout, s, &laws.objects.placement_laws)).collect();
    let mut model = RolloutModel {
        gravity: scene.gravity,
        time_step: scene.time_step,
        steps: scene.steps,
        schedule,
        records_contacts: true,
        sensors: view,
        effects: laws.names,
        rules: scene.contact_rules.unwrap_or_default(),
        motion_laws: laws.motion_laws,
        contact_laws: laws.contact_laws,
        goal: scene.goal.as_ref().map(|goal| GoalSpec::new(goal, scene)),
        stop_at_goal: scene.stops_at_goal() && rollout.stop_at_goal,
        contacts_established: rollout.contacts_established
            && scene.goal.is_none()
            && scene.interventions.is_empty(),
        contact_margin: bodies.iter().map(BodyModel::contact_margin).fold(f64::INFINITY, f64::min),
        scene_counts: [bodies.len(), statics.len()],
        interventions: Vec::new(),
        bodies,
        statics,
    };
    intervene::compile_interventions(
        rollout,
        &mut model,
        |body| compile_body(rollout, body, &laws.objects),
        |fixed| compile_static(rollout, fixed, &laws.objects.placement_laws),
        |latents| material_properties(&Rollout { latents, ..*rollout }, &laws.objects),
    )?;
    Ok(model)
}

/// Material properties of the scene's own objects for the rollout's latents.
fn material_properties(rollout: &Rollout, laws: &ObjectLaws) -> Result<InterventionOp> {
    let body = |body: &Body| {
        let own = compile_body(rollout, body, laws)?;
        Ok(MaterialProperties {
            mass: own.mass,
            inertia: own.inertia,
            surface: [own.friction, own.restitution],
        })
    };
    let fixed = |fixed: &Static| {
        let own = compile_static(rollout, fixed, &laws.placement_laws);
        [own.friction, own.restitution]
    };
    Ok(InterventionOp::SetMaterials {
        bodies: rollout.scene.bodies.iter().map(body).collect::<Result<_>>()?,
        statics: rollout.scene.statics.iter().map(fixed).collect(),
    })
}

/// Whether a rollout certainly compiles without error, for the same engine and topology, because `other` did:
/// the same scene with other numbers. Cheaper than compiling it.
pub fn is_variant_of(rollout: &Rollout, other: &Rollout) -> bool {
    let same = |(a, b): (&EffectTerm, &EffectTerm)| a.name == b.name;
    let simulated = |a: &ActiveEffect| {
        matches!(a.effect.kind, EffectKind::Motion(_) | EffectKind::Contact(_) | EffectKind::Body(_))
    };
    std::ptr::eq(rollout.scene, other.scene)
        && rollout.effects.len() == other.effects.len()
        && rollout.effects.iter().zip(other.effects).all(same)
        && rollout.latents.validate().is_ok()
        && active_effects(rollout).is_ok_and(|all| all.iter().all(simulated))
}

/// The effects of a rollout by kind, in order of application, with their constants.
#[derive(Default)]
struct ResolvedEffects {
    /// Names of the effects that engines apply.
    names: Vec<&'static str>,
    motion_laws: Vec<(&'static dyn MotionLaw, Constants)>,
    contact_laws: Vec<(&'static dyn ContactLaw, Constants)>,
    sensors: Vec<(&'static dyn Sensor, Constants)>,
    objects: ObjectLaws,
}

/// Laws of inertial properties and of placement.
#[derive(Default)]
struct ObjectLaws {
    body_laws: Vec<(&'static dyn BodyLaw, Constants)>,
    placement_laws: Vec<(&'static dyn PlacementLaw, Constants)>,
}

impl ResolvedEffects {
    fn of(rollout: &Rollout) -> Result<ResolvedEffects> {
        let scene = rollout.scene;
        let context = SimulationContext { time_step: scene.time_step, gravity: scene.gravity };
        let mut laws = ResolvedEffects::default();
        for active in active_effects(rollout)? {
            let neutral = active.is_neutral();
            let ActiveEffect { effect, values } = active;
            match effect.kind {
                EffectKind::Motion(law) => {
                    laws.names.push(effect.name);
                    laws.motion_laws.push((law, law.constants(&values, &context)));
                }
                EffectKind::Contact(law) => {
                    laws.names.push(effect.name);
                    laws.contact_laws.push((law, law.constants(&values, &context)));
                }
                EffectKind::Body(law) => {
                    laws.names.push(effect.name);
                    laws.objects.body_laws.push((law, law.constants(&values, &context)));
                }
                EffectKind::Sensor(_) | EffectKind::Action(_) if neutral => {}
                EffectKind::Sensor(sensor) => {
                    laws.sensors.push((sensor, sensor.constants(&values, &context)))
                }
                EffectKind::Action(placing) => {
                    laws.objects.placement_laws.push((placing, placing.constants(&values, &context)))
                }
            }
        }
        Ok(laws)
    }
}

/// Errors name the body's field.
fn compile_body(rollout: &Rollout, body: &Body, laws: &ObjectLaws) -> Result<BodyModel> {
    let (scene, latents) = (rollout.scene, &rollout.latents);
    let carries = scene.carries_latents(&body.name);
    let (mass, inertia) = body.mass_properties(latents.density.filter(|_| carries));
    let index = scene.bodies.iter().position(|b| b.name == body.name).unwrap_or(scene.bodies.len());
    let own = MassProperties { mass, inertia };
    let MassProperties { mass, inertia } =
        laws.body_laws.iter().fold(own, |m, (law, c)| law.apply(c, index, m));
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
    Ok(BodyModel {
        name: body.name.clone(),
        shape,
        mass,
        inertia,
        centre: body.shape.moments().centre,
        friction: latents.friction.filter(|_| carries).unwrap_or(body.friction),
        restitution: latents.restitution.filter(|_| carries).unwrap_or(body.restitution),
        position: placed_position(scene, &laws.placement_laws, &body.name, position),
        angle: body.angle,
        velocity: body.velocity,
        omega: body.angular_velocity,
        present: true,
    })
}

fn compile_static(
    rollout: &Rollout,
    fixed: &Static,
    placement_laws: &[(&'static dyn PlacementLaw, Constants)],
) -> StaticModel {
    let (scene, latents) = (rollout.scene, &rollout.latents);
    let carries = scene.carries_latents(&fixed.name);
    let position = placed_position(scene, placement_laws, &fixed.name, fixed.position);
    StaticModel {
        name: fixed.name.clone(),
        shape: fixed.shape.solid().placed(position, fixed.angle),
        friction: latents.friction.filter(|_| carries).unwrap_or(fixed.friction),
        restitution: latents.restitution.filter(|_| carries).unwrap_or(fixed.restitution),
        present: true,
    }
}

/// Actual position of the object `name` for the intended position `asked`, if an action placed it.
fn placed_position(
    scene: &Scene,
    placement_laws: &[(&'static dyn PlacementLaw, Constants)],
    name: &str,
    asked: [f64; 2],
) -> [f64; 2] {
    if placement_laws.is_empty() {
        return asked;
    }
    let mut targets = scene
        .action
        .iter()
        .flat_map(|a| &a.components)
        .filter(|c| matches!(c.set, ActionQuantity::X | ActionQuantity::Y))
        .map(|c| c.target.as_str())
        .peekable();
    let placed = match targets.peek() {
        Some(_) => targets.any(|t| t == name),
        // Without placing actions, the author of the scene placed all movable bodies.
        None => scene.body(name).is_some(),
    };
    if placed { placement_laws.iter().fold(asked, |at, (p, c)| p.place(c, at)) } else { asked }
}

/// The scene's own effects, then the rollout's.
fn active_effects(rollout: &Rollout) -> Result<Vec<ActiveEffect>> {
    let own = rollout.scene.effects.len();
    let mut all = effect::scene_effects(rollout.scene)?;
    for (i, term) in rollout.effects.iter().enumerate() {
        all.push(effect::resolve(term, format_args!("effects[{}]", own + i))?);
    }
    Ok(all)
}
