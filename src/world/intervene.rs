//! Interventions during a rollout, shared by all engines.
//!
//! A rollout contains all objects that are ever in the scene: the scene's own first, then added ones, each
//! with a flag for its presence. At an intervention an engine calls [`apply`] on the model and the states,
//! and copies only what changed; unchanged data, warm-start impulses included, keep their bits.
//!
//! - Impulse J at r from the centre of mass: v += J / m, omega += (r x J) / I.
//! - An added object must not overlap another; a moved body may overlap as much as resting contacts do.
//! - Tolerances (the contact margin, the allowed overlap) follow the smallest body so far: they shrink when a
//!   smaller body is added and stay when one is removed, so that no other body is affected.

use super::compiled_intervention::{CompiledIntervention, InterventionOp};
use super::goal::ObjectId;
use super::latent::Latents;
use super::rollout::Rollout;
use super::rollout_model::{BodyModel, RolloutModel, StaticModel};
use super::state::BodyState;
use crate::error::{Error, Result};
use crate::task::Intervention;
use crate::task::scene::{Body, Static};
use crate::task::timeline::schedule;

/// Largest change of speed by one impulse, m/s: the speed of the fastest body.
const MAX_IMPULSE_SPEED_CHANGE_M_S: f64 = 400.0;
/// Overlap allowed for a moved body, as a fraction of its smallest extent: that of a resting contact.
const MAX_CONTACT_OVERLAP_FRACTION: f64 = 0.2;

/// Compiles a rollout's interventions and appends the added objects to `model`. `body` and `fixed` build the
/// model of an added object, `anew` the material properties of the scene's own objects for other latents.
pub fn compile_interventions(
    rollout: &Rollout,
    model: &mut RolloutModel,
    body: impl Fn(&Body) -> Result<BodyModel>,
    fixed: impl Fn(&Static) -> StaticModel,
    materials_for: impl Fn(Latents) -> Result<InterventionOp>,
) -> Result<()> {
    let list = &rollout.scene.interventions;
    if list.is_empty() {
        return Ok(());
    }
    let mut latents = rollout.latents;
    for (step, number) in schedule(rollout.scene)? {
        let in_intervention = |e: Error| e.in_field(&format!("interventions[{number}]"));
        let op = match &list[number] {
            Intervention::Impulse { body, impulse, point, .. } => {
                InterventionOp::Impulse { body: body_index(model, body), impulse: *impulse, point: *point }
            }
            Intervention::Set { body, position, angle, velocity, angular_velocity, .. } => {
                InterventionOp::SetState {
                    body: body_index(model, body),
                    position: *position,
                    angle: *angle,
                    velocity: *velocity,
                    omega: *angular_velocity,
                }
            }
            Intervention::Add { body: own, .. } => {
                let own = body(own).map_err(|e| in_intervention(e.in_field("body")))?;
                model.bodies.push(BodyModel { present: false, ..own });
                InterventionOp::Add(ObjectId::Body(model.bodies.len() - 1))
            }
            Intervention::AddStatic { fixed: own, .. } => {
                model.statics.push(StaticModel { present: false, ..fixed(own) });
                InterventionOp::Add(ObjectId::Static(model.statics.len() - 1))
            }
            Intervention::Remove { body, .. } => InterventionOp::Remove(object_named(model, body)),
            Intervention::Latents { density, friction, restitution, .. } => {
                let given = Latents { density: *density, friction: *friction, restitution: *restitution };
                given.validate().map_err(|e| e.strip_field("latents")).map_err(in_intervention)?;
                latents = given.or(latents);
                materials_for(latents).map_err(in_intervention)?
            }
        };
        model.interventions.push(CompiledIntervention { step, number, op });
    }
    validate_impulses(model)
}

/// Errors if an impulse is too large for its body.
fn validate_impulses(model: &RolloutModel) -> Result<()> {
    let mut masses: Vec<f64> = model.bodies.iter().map(|b| b.mass).collect();
    for change in &model.interventions {
        match &change.op {
            InterventionOp::SetMaterials { bodies, .. } => {
                bodies.iter().zip(&mut masses).for_each(|(own, mass)| *mass = own.mass)
            }
            InterventionOp::Impulse { body, impulse, .. } => {
                let most = MAX_IMPULSE_SPEED_CHANGE_M_S * masses[*body];
                if libm::hypot(impulse[0], impulse[1]) > most {
                    let field = format!("interventions[{}].impulse", change.number);
                    let allowed = format!(
                        "at most {most} N s: {MAX_IMPULSE_SPEED_CHANGE_M_S} m/s for this body of {} kg",
                        masses[*body]
                    );
                    return Err(Error::input(field, format!("{impulse:?}"), allowed));
                }
            }
            _ => {}
        }
    }
    Ok(())
}

/// Applies a change to the model and the bodies' states (of the frames' origins; NaN for absent bodies). If
/// an object would overlap another, nothing changes and the error is the obstacle's index (bodies, then
/// statics).
pub fn apply(
    model: &mut RolloutModel,
    states: &mut [BodyState],
    op: &InterventionOp,
) -> std::result::Result<(), usize> {
    match op {
        InterventionOp::Impulse { body, impulse, point } => {
            let own = &model.bodies[*body];
            states[*body] = apply_impulse(own, states[*body], *impulse, *point);
        }
        InterventionOp::SetState { body, position, angle, velocity, omega } => {
            let before = states[*body];
            let after = BodyState {
                position: position.map_or(before.position, |p| p.map(|x| x + 0.0)),
                angle: angle.map_or(before.angle, |a| a + 0.0),
                velocity: velocity.map_or(before.velocity, |v| v.map(|x| x + 0.0)),
                omega: omega.map_or(before.omega, |w| w + 0.0),
            };
            if after.pose_differs_from(&before) {
                first_overlap(model, states, *body, &after, MAX_CONTACT_OVERLAP_FRACTION)
                    .map_or(Ok(()), Err)?;
            }
            states[*body] = after;
        }
        InterventionOp::Add(ObjectId::Body(i)) => {
            let start = model.bodies[*i].initial_state();
            first_overlap(model, states, *i, &start, 0.0).map_or(Ok(()), Err)?;
            model.bodies[*i].present = true;
            model.contact_margin = model.contact_margin.min(model.bodies[*i].contact_margin());
            states[*i] = start;
        }
        InterventionOp::Add(ObjectId::Static(s)) => {
            let fixed = &model.statics[*s].shape;
            let overlaps = |i: &usize| {
                let (own, at) = (&model.bodies[*i], &states[*i]);
                own.present && fixed.signed_distance_to(&own.shape.placed(at.position, at.angle)) < 0.0
            };
            (0..model.bodies.len()).find(overlaps).map_or(Ok(()), Err)?;
            model.statics[*s].present = true;
        }
        InterventionOp::Remove(ObjectId::Body(i)) => {
            model.bodies[*i].present = false;
            states[*i] = BodyState::ABSENT;
        }
        InterventionOp::Remove(ObjectId::Static(s)) => model.statics[*s].present = false,
        InterventionOp::SetMaterials { bodies, statics } => {
            for (own, new) in model.bodies.iter_mut().zip(bodies) {
                (own.mass, own.inertia) = (new.mass, new.inertia);
                [own.friction, own.restitution] = new.surface;
            }
            for (own, new) in model.statics.iter_mut().zip(statics) {
                [own.friction, own.restitution] = *new;
            }
        }
    }
    Ok(())
}

/// The state after an impulse.
fn apply_impulse(
    own: &BodyModel,
    before: BodyState,
    impulse: [f64; 2],
    point: Option<[f64; 2]>,
) -> BodyState {
    let [ax, ay] = own.arm(before.angle);
    let turn = point.map_or(0.0, |[x, y]| {
        let (rx, ry) = (x - before.position[0] - ax, y - before.position[1] - ay);
        (rx * impulse[1] - ry * impulse[0]) / own.inertia
    });
    // The velocity is that of the frame's origin, which rotates about the centre of mass.
    let add = [impulse[0] / own.mass + turn * ay, impulse[1] / own.mass - turn * ax];
    BodyState {
        velocity: [before.velocity[0] + add[0], before.velocity[1] + add[1]],
        omega: before.omega + turn,
        ..before
    }
}

/// The first object that a body would overlap at a pose, by more than a fraction of its smallest extent or of
/// the other body's, whichever is smaller.
fn first_overlap(
    model: &RolloutModel,
    states: &[BodyState],
    body: usize,
    at: &BodyState,
    share: f64,
) -> Option<usize> {
    let extent = model.bodies[body].shape.smallest_extent();
    let give = share * extent;
    let own = model.bodies[body].shape.placed(at.position, at.angle);
    let others = model.bodies.iter().zip(states).enumerate();
    let mut others = others.filter(|(i, (other, _))| *i != body && other.present);
    let in_it = others.find(|(_, (other, at))| {
        let give = share * extent.min(other.shape.smallest_extent());
        own.signed_distance_to(&other.shape.placed(at.position, at.angle)) < -give
    });
    let fixed = || {
        let mut statics = model.statics.iter().enumerate().filter(|(_, s)| s.present);
        statics.find(|(_, s)| s.shape.signed_distance_to(&own) < -give).map(|(s, _)| model.bodies.len() + s)
    };
    in_it.map(|(i, _)| i).or_else(fixed)
}

/// Index of a body whose name [`schedule`] has validated.
fn body_index(model: &RolloutModel, name: &str) -> usize {
    let found = model.bodies.iter().position(|b| b.name == name);
    found.expect("names of interventions are checked before")
}

fn object_named(model: &RolloutModel, name: &str) -> ObjectId {
    match model.statics.iter().position(|s| s.name == name) {
        Some(fixed) => ObjectId::Static(fixed),
        None => ObjectId::Body(body_index(model, name)),
    }
}
