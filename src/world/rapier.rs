//! The general engine: rapier2d, any scene.
//!
//! Source: rapier2d 0.36.1 (TGS-soft with sub-steps, f32). Semantics as in [`super`]: products of
//! coefficients, effects before gravity once per step.
//!
//! The position of a body is that of its frame's origin, and the given and observed velocity is that of the
//! same point; rapier's velocities, and those that effects and contacts act on, are those of the centre of
//! mass. They differ by v(origin) = v(centre) - omega x (centre - origin).
//!
//! Laws of contact (`EffectKind::Contact`) act through rapier's hook on solver contacts, which sets a
//! contact's restitution and tangential target velocity from the velocities at the beginning of the step;
//! rolling resistance acts after the step, with the impulses that rapier reports. Without such laws neither
//! hook is installed.
//!
//! Differences from rapier's defaults, each of which changes results: coefficients combine by `Multiply`
//! (default: average); bodies never sleep; contact recycling is off (stale contacts of up to 5 cm of drift);
//! `length_unit` follows the smallest body so that tolerances fit centimetre-sized balls, and the speed limit
//! is 400 m/s in any unit.

mod intervene;
mod warm_start;

use std::borrow::Cow;

use rapier2d::prelude::*;

use super::compile::{BodyModel, RolloutModel};
use super::effect::{ContactResponse, ContactState, MotionState, rolling_velocity_loss};
use super::goal::{self, HoldCounter, ObjectId};
use super::record::{BodyState, Recorder};
use crate::budget::Budget;
use crate::error::{Error, Result};
use crate::task::geometry::Convex;
use crate::task::scene::{ContactRules, FrictionRule, RestitutionRule};
use crate::task::solid::Solid;
use crate::trajectory::{Termination, Trajectory};

/// Integrates one rollout.
pub fn run(model: &RolloutModel, budget: &dyn Budget) -> Result<Trajectory> {
    let mut world = RapierWorld::build(model)?;
    let mut recorder = Recorder::new(model);
    let mut watch = HoldCounter::default();
    let needed = model.goal.as_ref().map_or(0, |g| g.hold_steps(model.time_step));
    // The model; cloned when an intervention changes it.
    let mut model = Cow::Borrowed(model);
    let states = world.states();
    recorder.observe(0, &states);
    if let Some(blocked) = world.intervene(&mut model, 0, &states)? {
        return Ok(recorder.finish(0, blocked));
    }
    if model.contacts_established {
        world.settle(&model, &states);
    }
    let mut due = model.schedule.after(0);
    let steps_per_check = model.steps_per_check();
    for step in 1..=model.steps {
        if u64::from(step).is_multiple_of(steps_per_check) {
            budget.check()?;
        }
        let before = world.step(&model, step - 1);
        let states = world.states();
        if states.iter().zip(&model.bodies).any(|(s, own)| own.present && !s.is_finite()) {
            return Ok(recorder.finish(step - 1, Termination::Diverged));
        }
        world.record_contacts(&model, &before, step, &mut recorder);
        if let Some(spec) = model.goal.as_ref().filter(|goal| model.has_goal_objects(goal)) {
            let holds = goal::holds(
                &spec.condition,
                |i| (states[i].position, states[i].angle),
                |s, shape| model.statics[s].shape.signed_distance_to(shape),
                |i| &model.bodies[i].shape,
            );
            if watch.advance(&spec.condition, holds, needed) {
                recorder.set_solved();
                if model.stop_at_goal {
                    recorder.observe(step, &states);
                    return Ok(recorder.finish(step, Termination::Goal));
                }
            }
        }
        if step == due || step == model.steps {
            recorder.observe(step, &states);
            due = model.schedule.after(step);
        }
        if let Some(blocked) = world.intervene(&mut model, step, &states)? {
            return Ok(recorder.finish(step, blocked));
        }
    }
    Ok(recorder.finish(model.steps, Termination::Horizon))
}

struct RapierWorld {
    physics: PhysicsWorld,
    /// In the order of the model's bodies; `None` for absent ones.
    bodies: Vec<Option<RigidBodyHandle>>,
    /// Colliders of the model's statics, in their order; empty for absent ones.
    statics: Vec<Vec<ColliderHandle>>,
    /// Active hooks of the bodies' colliders.
    hooks: ActiveHooks,
    /// Centre of mass of each body, body frame.
    centres: Vec<Vector>,
    /// Body angles, unwrapped by following small rotations.
    angles: Vec<f64>,
    time_step: f64,
    /// Whether a body and a static exchanged a normal impulse in the last step: `body * statics +
    /// static`. Only maintained with laws of contact.
    loaded: Vec<bool>,
}

impl RapierWorld {
    fn build(model: &RolloutModel) -> Result<RapierWorld> {
        let mut physics = PhysicsWorld::new();
        physics.gravity = vector(model.gravity);
        let unit = (model.contact_margin / 0.005) as f32;
        let parameters = &mut physics.integration_parameters;
        parameters.dt = model.time_step as f32;
        parameters.length_unit = unit;
        parameters.normalized_max_linear_velocity = 400.0 / unit;
        parameters.contact_recycling = false;
        let hooks = if model.contact_laws.is_empty() {
            ActiveHooks::empty()
        } else {
            ActiveHooks::MODIFY_SOLVER_CONTACTS
        };
        let angles = model.bodies.iter().map(|b| b.angle).collect();
        let loaded = vec![false; model.bodies.len() * model.statics.len()];
        let centres = model.bodies.iter().map(|b| vector(b.centre)).collect();
        let bodies = vec![None; model.bodies.len()];
        let statics = vec![Vec::new(); model.statics.len()];
        let time_step = model.time_step;
        let mut world = RapierWorld { physics, bodies, statics, hooks, centres, angles, time_step, loaded };
        for (i, body) in model.bodies.iter().enumerate() {
            let path = model.input_path(ObjectId::Body(i));
            match body.present {
                true => world.insert_body(model, i, &path)?,
                // Report an invalid shape at the start, not during the rollout.
                false => body.shape.0.iter().try_for_each(|piece| collider(piece, &path).map(drop))?,
            }
        }
        for (i, fixed) in model.statics.iter().enumerate() {
            let path = model.input_path(ObjectId::Static(i));
            match fixed.present {
                true => world.insert_static(model, i, &path)?,
                false => static_colliders(&fixed.shape, &path).map(drop)?,
            }
        }
        Ok(world)
    }

    /// Inserts a body at its initial state; `path` is its path in the input, for errors.
    fn insert_body(&mut self, model: &RolloutModel, i: usize, path: &str) -> Result<()> {
        let body = &model.bodies[i];
        let rigid = RigidBodyBuilder::dynamic()
            .translation(vector(body.position))
            .rotation(body.angle as f32)
            .linvel(vector(velocity_of_centre(body)))
            .angvel(body.omega as f32)
            .can_sleep(false)
            .build();
        let handle = self.physics.bodies.insert(rigid);
        for (n, piece) in body.shape.0.iter().enumerate() {
            // The first piece carries the mass of the whole body.
            let mass = if n == 0 { mass_properties(body) } else { MassProperties::default() };
            let builder =
                set_surface(collider(piece, path)?, &model.rules, body.friction, body.restitution, i);
            let collider = builder.mass_properties(mass).active_hooks(self.hooks);
            self.physics.colliders.insert_with_parent(collider, handle, &mut self.physics.bodies);
        }
        self.bodies[i] = Some(handle);
        Ok(())
    }

    /// Inserts a static; `path` is its path in the input, for errors.
    fn insert_static(&mut self, model: &RolloutModel, i: usize, path: &str) -> Result<()> {
        let (fixed, index) = (&model.statics[i], model.bodies.len() + i);
        for builder in static_colliders(&fixed.shape, path)? {
            let builder = set_surface(builder, &model.rules, fixed.friction, fixed.restitution, index);
            self.statics[i].push(self.physics.colliders.insert(builder));
        }
        Ok(())
    }

    /// Makes one time step after `step` others; returns the velocities before contacts are resolved.
    fn step(&mut self, model: &RolloutModel, step: u32) -> Vec<(Vector, f32)> {
        self.apply_motion_laws(model, step);
        let before = self.velocities();
        if model.contact_laws.is_empty() {
            self.physics.step();
        } else {
            self.physics.step_with_events(&ContactHooks { model }, &());
            self.apply_rolling_resistance(model);
        }
        before
    }

    /// Applies the motion effects to every body, at its centre of mass.
    fn apply_motion_laws(&mut self, model: &RolloutModel, step: u32) {
        if model.motion_laws.is_empty() {
            return;
        }
        let time = f64::from(step) * self.time_step;
        for (handle, centre) in self.bodies.iter().zip(&self.centres) {
            let Some(handle) = handle else { continue };
            let body = &mut self.physics.bodies[*handle];
            let (at, v) = (body.translation() + arm(body, *centre), body.linvel());
            let mut moving = MotionState {
                time,
                x: at.x.into(),
                y: at.y.into(),
                vx: v.x.into(),
                vy: v.y.into(),
                omega: body.angvel().into(),
            };
            for (motion, constants) in &model.motion_laws {
                [moving.vx, moving.vy, moving.omega] = motion.kick(constants, moving, self.time_step);
            }
            body.set_linvel(Vector::new(moving.vx as f32, moving.vy as f32), false);
            body.set_angvel(moving.omega as f32, false);
        }
    }

    /// Applies rolling resistance to the discs that roll on statics.
    fn apply_rolling_resistance(&mut self, model: &RolloutModel) {
        let count = model.bodies.len();
        let mut loaded = vec![false; self.loaded.len()];
        for pair in self.physics.narrow_phase.contact_pairs() {
            let PairContacts::Rigid(contacts) = &pair.contacts else { continue };
            let index = |c: ColliderHandle| self.physics.colliders[c].user_data as usize;
            let (first, second) = (index(pair.collider1), index(pair.collider2));
            let (body, fixed) = (first.min(second), first.max(second));
            if body >= count || fixed < count {
                continue;
            }
            let Some(radius) = model.bodies[body].shape.disc_radius() else { continue };
            for manifold in &contacts.manifolds {
                let impulse: f64 = manifold.points.iter().map(|p| f64::from(p.data.impulse)).sum();
                let slot = body * model.statics.len() + fixed - count;
                loaded[slot] |= impulse > 0.0;
                if impulse <= 0.0 || !self.loaded[slot] {
                    continue;
                }
                let load = impulse / model.bodies[body].mass;
                let off: f64 = model.contact_laws.iter().map(|(law, own)| law.rolling_loss(own, load)).sum();
                if off > 0.0 {
                    // From the static to the disc.
                    let normal = if first == body { -manifold.data.normal } else { manifold.data.normal };
                    let tangent = Vector::new(-normal.y, normal.x);
                    let Some(handle) = self.bodies[body] else { continue };
                    let rigid = &mut self.physics.bodies[handle];
                    let (v, spin) = (rigid.linvel(), rigid.angvel());
                    let [lost, turn] = rolling_velocity_loss(v.dot(tangent).into(), spin.into(), radius, off);
                    rigid.set_linvel(v - tangent * lost as f32, false);
                    rigid.set_angvel(spin - turn as f32, false);
                }
            }
        }
        self.loaded = loaded;
    }

    fn velocities(&self) -> Vec<(Vector, f32)> {
        let of = |h: &RigidBodyHandle| (self.physics.bodies[*h].linvel(), self.physics.bodies[*h].angvel());
        self.bodies.iter().map(|h| h.as_ref().map_or((Vector::ZERO, 0.0), of)).collect()
    }

    fn states(&mut self) -> Vec<BodyState> {
        let mut states = Vec::with_capacity(self.bodies.len());
        for ((handle, centre), angle) in self.bodies.iter().zip(&self.centres).zip(&mut self.angles) {
            let Some(handle) = handle else {
                states.push(BodyState::ABSENT);
                continue;
            };
            let body = &self.physics.bodies[*handle];
            let wrapped = f64::from(body.rotation().angle());
            let turn = (wrapped - *angle + std::f64::consts::PI).rem_euclid(std::f64::consts::TAU);
            *angle += turn - std::f64::consts::PI;
            let (at, v) = (body.translation(), velocity_of_origin(body, *centre));
            states.push(BodyState {
                position: [at.x.into(), at.y.into()],
                angle: *angle,
                velocity: [v.x.into(), v.y.into()],
                omega: body.angvel().into(),
            });
        }
        states
    }

    /// Reports the touching pairs of this step to the recorder.
    fn record_contacts(
        &self,
        model: &RolloutModel,
        before: &[(Vector, f32)],
        step: u32,
        recorder: &mut Recorder,
    ) {
        let count = model.bodies.len();
        recorder.begin_step();
        for pair in self.physics.narrow_phase.contact_pairs() {
            let PairContacts::Rigid(contacts) = &pair.contacts else { continue };
            let index = |c: ColliderHandle| self.physics.colliders[c].user_data as usize;
            let (first, second) = (index(pair.collider1), index(pair.collider2));
            for manifold in &contacts.manifolds {
                let touching = manifold
                    .points
                    .iter()
                    .find(|p| p.data.impulse > 0.0 || f64::from(p.dist) <= model.contact_margin);
                let Some(point) = touching else { continue };
                let normal = manifold.data.normal;
                let at = self.physics.colliders[pair.collider1].position() * point.local_p1;
                let speed_at = |i: usize| {
                    if i >= count {
                        return Vector::ZERO;
                    }
                    let Some(handle) = self.bodies[i] else { return Vector::ZERO };
                    let body = &self.physics.bodies[handle];
                    let centre = body.translation() + arm(body, self.centres[i]);
                    let (v, spin) = before[i];
                    v + Vector::new(-(at.y - centre.y), at.x - centre.x) * spin
                };
                let approach = (speed_at(first) - speed_at(second)).dot(normal).max(0.0);
                recorder.record_contact(
                    step,
                    first,
                    second,
                    [normal.x.into(), normal.y.into()],
                    approach.into(),
                );
                break;
            }
        }
    }
}

/// Applies the laws of contact in rapier's hook.
struct ContactHooks<'a> {
    model: &'a RolloutModel,
}

impl PhysicsHooks for ContactHooks<'_> {
    fn modify_solver_contacts(&self, context: &mut ContactModificationContext) {
        let (bodies, handles) = (context.bodies, [context.rigid_body1, context.rigid_body2]);
        let velocity = |handle: Option<RigidBodyHandle>, at: Vector| {
            handle.map_or(Vector::ZERO, |h| bodies[h].velocity_at_point(at))
        };
        let Some(manifold) = context.rigid_mut() else { return };
        let normal = *manifold.normal;
        let tangent = Vector::new(-normal.y, normal.x);
        let own = f64::from(*manifold.restitution);
        // Restitution belongs to the manifold: the point with the fastest approach decides.
        let mut fastest = 0.0;
        for contact in manifold.solver_contacts.iter_mut() {
            let speed = velocity(handles[1], contact.anchor2) - velocity(handles[0], contact.anchor1);
            let meeting = ContactState {
                approach: f64::from(-speed.dot(normal)).max(0.0),
                slip: speed.dot(tangent).into(),
                begins: contact.contact_id[0] & NEW_CONTACT_BIT != 0,
            };
            let answer = ContactResponse { restitution: own, slip: 0.0 };
            let answer =
                self.model.contact_laws.iter().fold(answer, |a, (law, c)| law.respond(c, meeting, a));
            if meeting.approach > fastest {
                fastest = meeting.approach;
                *manifold.restitution = answer.restitution as f32;
            }
            if answer.slip != 0.0 {
                contact.tangent_velocity = tangent * answer.slip as f32;
            }
        }
    }
}

fn set_surface(
    builder: ColliderBuilder,
    rules: &ContactRules,
    friction: f64,
    restitution: f64,
    index: usize,
) -> ColliderBuilder {
    let by_friction = match rules.friction {
        FrictionRule::Product => CoefficientCombineRule::Multiply,
        FrictionRule::GeometricMean => CoefficientCombineRule::GeometricMean,
    };
    let by_restitution = match rules.restitution {
        RestitutionRule::Product => CoefficientCombineRule::Multiply,
        RestitutionRule::Max => CoefficientCombineRule::Max,
    };
    builder
        .friction(friction as f32)
        .restitution(restitution as f32)
        .friction_combine_rule(by_friction)
        .restitution_combine_rule(by_restitution)
        .user_data(index as u128)
}

/// The colliders of a static; `owner` as for [`collider`].
fn static_colliders(solid: &Solid, owner: &str) -> Result<Vec<ColliderBuilder>> {
    match solid {
        // Corners relative to the piece's centre: f32 cannot resolve them far from the origin.
        Solid::Bounded(pieces) => {
            let middles = pieces.0.iter().map(centre_points);
            middles.map(|(centre, own)| Ok(collider(&own, owner)?.translation(vector(centre)))).collect()
        }
        Solid::HalfPlane { normal, offset } => {
            let at = [normal[0] * offset, normal[1] * offset];
            Ok(vec![halfspace(*normal).translation(vector(at))])
        }
    }
}

/// The mean of a shape's corners, and the shape relative to it.
fn centre_points(shape: &Convex) -> ([f64; 2], Convex) {
    let count = shape.points.len() as f64;
    let centre = [0, 1].map(|k| shape.points.iter().map(|p| p[k]).sum::<f64>() / count);
    let points = shape.points.iter().map(|p| [p[0] - centre[0], p[1] - centre[1]]).collect();
    (centre, Convex { points, radius: shape.radius })
}

/// `owner` is the path of the shape's owner, for errors.
fn collider(shape: &Convex, owner: &str) -> Result<ColliderBuilder> {
    let points: Vec<Vector> = shape.points.iter().map(|p| vector(*p)).collect();
    let radius = shape.radius as f32;
    Ok(match points.as_slice() {
        [centre] => ColliderBuilder::ball(radius).translation(*centre),
        [a, b] if radius == 0.0 => ColliderBuilder::segment(*a, *b),
        [a, b] => ColliderBuilder::capsule_from_endpoints(*a, *b, radius),
        _ => ColliderBuilder::convex_polyline(points).ok_or_else(|| {
            let allowed = "a polygon wide enough to have an inside in f32 (rapier engine)";
            Error::input(format!("{owner}.shape"), "too thin", allowed)
        })?,
    })
}

fn halfspace(normal: [f64; 2]) -> ColliderBuilder {
    // Scenes validate that its length is 1; re-normalised for f32.
    ColliderBuilder::halfspace(nalgebra::Unit::new_unchecked(vector(normal).normalize()))
}

fn mass_properties(body: &BodyModel) -> MassProperties {
    MassProperties::new(vector(body.centre), body.mass as f32, body.inertia as f32)
}

/// Rapier's initial velocity of a body: that of the centre of mass, m/s.
fn velocity_of_centre(body: &BodyModel) -> [f64; 2] {
    if body.centre == [0.0; 2] {
        return body.velocity;
    }
    let (sin, cos) = libm::sincos(body.angle);
    let [x, y] = body.centre;
    let arm = [cos * x - sin * y, sin * x + cos * y];
    [body.velocity[0] - body.omega * arm[1], body.velocity[1] + body.omega * arm[0]]
}

/// The observed velocity of a body: that of its frame's origin, m/s.
fn velocity_of_origin(body: &RigidBody, centre: Vector) -> Vector {
    if centre == Vector::ZERO {
        return body.linvel();
    }
    let arm = arm(body, centre);
    body.linvel() - Vector::new(-arm.y, arm.x) * body.angvel()
}

/// Vector from a body's origin to its centre of mass, world frame, m.
fn arm(body: &RigidBody, centre: Vector) -> Vector {
    *body.rotation() * centre
}

fn vector(v: [f64; 2]) -> Vector {
    Vector::new(v[0] as f32, v[1] as f32)
}
