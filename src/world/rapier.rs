//! The general engine: rapier2d, any scene.
//!
//! Source: rapier2d 0.36.1 (TGS-soft with sub-steps, f32). Semantics as in [`super`]: products of
//! coefficients, effects before gravity once per step.
//!
//! A body's position is its frame's origin, and so is the point whose velocity is given and observed; rapier's
//! velocities, and what effects and contacts act on, are those of the centre of mass. For a body that turns about a
//! centre of mass elsewhere the two differ by v(origin) = v(centre) - omega x (centre - origin).
//!
//! Laws of contact (effects of the form `Act::Contact`) act through rapier's hook on solver contacts, which
//! sets a contact's restitution and the slip its friction drives at from the velocities at the beginning of
//! the step; what rolls is slowed after the step, by the impulses that rapier reports. Without such laws
//! neither is called.
//!
//! Differences from rapier's defaults, each of which changes results: coefficients combine by `Multiply`
//! (default: average); bodies never sleep; contact recycling is off (stale contacts of up to 5 cm of drift);
//! `length_unit` follows the smallest body so that centimetre-sized balls are not met with metre-sized
//! tolerances, and the speed cap is kept at 400 m/s whatever the unit.

mod intervene;
mod settle;

use std::borrow::Cow;

use rapier2d::prelude::*;

use super::effect::{Answer, Meeting, Moving, rolled_off};
use super::goal::{self, Party, Watch};
use super::prepare::{Prepared, PreparedBody};
use super::record::{Recorder, State};
use crate::budget::Budget;
use crate::error::{Error, Result};
use crate::task::geometry::Convex;
use crate::task::scene::{ContactRules, FrictionRule, RestitutionRule};
use crate::task::solid::Solid;
use crate::trajectory::{End, Trajectory};

/// Body-time-steps between two looks at the budget: about a millisecond.
const WORK_A_LOOK: usize = 1024;

/// Integrates one rollout.
pub fn run(prepared: &Prepared, budget: &dyn Budget) -> Result<Trajectory> {
    let mut world = World::build(prepared)?;
    let mut recorder = Recorder::new(prepared);
    let mut watch = Watch::default();
    let needed = prepared.goal.as_ref().map_or(0, |g| g.hold_steps(prepared.time_step));
    // What is known of things; a copy as soon as an intervention changes it.
    let mut prepared = Cow::Borrowed(prepared);
    let states = world.states();
    recorder.observe(0, &states);
    if let Some(blocked) = world.intervene(&mut prepared, 0, &states)? {
        return Ok(recorder.finish(0, blocked));
    }
    if prepared.settled {
        world.settle(&prepared, &states);
    }
    let mut due = prepared.schedule.after(0);
    let steps_a_look = (WORK_A_LOOK / prepared.bodies.len().max(1)).max(1) as u32;
    for step in 1..=prepared.steps {
        if step % steps_a_look == 0 {
            budget.look()?;
        }
        let before = world.step(&prepared, step - 1);
        let states = world.states();
        if states.iter().zip(&prepared.bodies).any(|(s, own)| own.there && !s.is_finite()) {
            return Ok(recorder.finish(step - 1, End::Diverged));
        }
        world.record_contacts(&prepared, &before, step, &mut recorder);
        if let Some(spec) = prepared.goal.as_ref().filter(|goal| prepared.has(goal)) {
            let holds = goal::holds(
                &spec.condition,
                |i| (states[i].position, states[i].angle),
                |s, shape| prepared.statics[s].shape.gap_to(shape),
                |i| &prepared.bodies[i].shape,
            );
            if watch.advance(&spec.condition, holds, needed) {
                recorder.solved();
                if prepared.stop {
                    recorder.observe(step, &states);
                    return Ok(recorder.finish(step, End::Goal));
                }
            }
        }
        if step == due || step == prepared.steps {
            recorder.observe(step, &states);
            due = prepared.schedule.after(step);
        }
        if let Some(blocked) = world.intervene(&mut prepared, step, &states)? {
            return Ok(recorder.finish(step, blocked));
        }
    }
    Ok(recorder.finish(prepared.steps, End::Horizon))
}

struct World {
    physics: PhysicsWorld,
    /// In the order of the prepared bodies; none for what is not there.
    bodies: Vec<Option<RigidBodyHandle>>,
    /// Colliders of the prepared statics, in their order; none for what is not there.
    statics: Vec<Vec<ColliderHandle>>,
    /// What colliders of bodies call upon.
    hooks: ActiveHooks,
    /// Centre of mass of each body, its own frame.
    centres: Vec<Vector>,
    /// Body angle, unwrapped by following small turns.
    angles: Vec<f64>,
    time_step: f64,
    /// Whether a body and a static bore a load on each other in the last step: `body * statics + static`.
    /// Kept only where laws of contact are at work.
    loaded: Vec<bool>,
}

impl World {
    fn build(prepared: &Prepared) -> Result<World> {
        let mut physics = PhysicsWorld::new();
        physics.gravity = vector(prepared.gravity);
        let unit = (prepared.touch / 0.005) as f32;
        let parameters = &mut physics.integration_parameters;
        parameters.dt = prepared.time_step as f32;
        parameters.length_unit = unit;
        parameters.normalized_max_linear_velocity = 400.0 / unit;
        parameters.contact_recycling = false;
        let hooks = if prepared.touches.is_empty() {
            ActiveHooks::empty()
        } else {
            ActiveHooks::MODIFY_SOLVER_CONTACTS
        };
        let angles = prepared.bodies.iter().map(|b| b.angle).collect();
        let loaded = vec![false; prepared.bodies.len() * prepared.statics.len()];
        let centres = prepared.bodies.iter().map(|b| vector(b.centre)).collect();
        let bodies = vec![None; prepared.bodies.len()];
        let statics = vec![Vec::new(); prepared.statics.len()];
        let time_step = prepared.time_step;
        let mut world = World { physics, bodies, statics, hooks, centres, angles, time_step, loaded };
        for (i, body) in prepared.bodies.iter().enumerate() {
            let path = prepared.path_of(Party::Body(i));
            match body.there {
                true => world.insert_body(prepared, i, &path)?,
                // Better now than in the middle.
                false => body.shape.0.iter().try_for_each(|piece| collider(piece, &path).map(drop))?,
            }
        }
        for (i, fixed) in prepared.statics.iter().enumerate() {
            let path = prepared.path_of(Party::Static(i));
            match fixed.there {
                true => world.insert_static(prepared, i, &path)?,
                false => standing(&fixed.shape, &path).map(drop)?,
            }
        }
        Ok(world)
    }

    /// Lets a body in where it starts; `path` is its own, for errors.
    fn insert_body(&mut self, prepared: &Prepared, i: usize, path: &str) -> Result<()> {
        let body = &prepared.bodies[i];
        let rigid = RigidBodyBuilder::dynamic()
            .translation(vector(body.position))
            .rotation(body.angle as f32)
            .linvel(vector(velocity_of_centre(body)))
            .angvel(body.omega as f32)
            .can_sleep(false)
            .build();
        let handle = self.physics.bodies.insert(rigid);
        for (n, piece) in body.shape.0.iter().enumerate() {
            // The first piece carries the whole body's mass.
            let mass = if n == 0 { mass_properties(body) } else { MassProperties::default() };
            let builder =
                surface(collider(piece, path)?, &prepared.rules, body.friction, body.restitution, i);
            let collider = builder.mass_properties(mass).active_hooks(self.hooks);
            self.physics.colliders.insert_with_parent(collider, handle, &mut self.physics.bodies);
        }
        self.bodies[i] = Some(handle);
        Ok(())
    }

    /// Lets a static in; `path` is its own, for errors.
    fn insert_static(&mut self, prepared: &Prepared, i: usize, path: &str) -> Result<()> {
        let (fixed, index) = (&prepared.statics[i], prepared.bodies.len() + i);
        for builder in standing(&fixed.shape, path)? {
            let builder = surface(builder, &prepared.rules, fixed.friction, fixed.restitution, index);
            self.statics[i].push(self.physics.colliders.insert(builder));
        }
        Ok(())
    }

    /// One time step after `step` others; the velocities that contacts met with.
    fn step(&mut self, prepared: &Prepared, step: u32) -> Vec<(Vector, f32)> {
        self.kick(prepared, step);
        let before = self.velocities();
        if prepared.touches.is_empty() {
            self.physics.step();
        } else {
            self.physics.step_with_events(&Laws { prepared }, &());
            self.slow_what_rolls(prepared);
        }
        before
    }

    /// Lets the motion effects act on every body, at its centre of mass.
    fn kick(&mut self, prepared: &Prepared, step: u32) {
        if prepared.motions.is_empty() {
            return;
        }
        let time = f64::from(step) * self.time_step;
        for (handle, centre) in self.bodies.iter().zip(&self.centres) {
            let Some(handle) = handle else { continue };
            let body = &mut self.physics.bodies[*handle];
            let (at, v) = (body.translation() + arm(body, *centre), body.linvel());
            let mut moving = Moving {
                time,
                x: at.x.into(),
                y: at.y.into(),
                vx: v.x.into(),
                vy: v.y.into(),
                omega: body.angvel().into(),
            };
            for (motion, constants) in &prepared.motions {
                [moving.vx, moving.vy, moving.omega] = motion.kick(constants, moving, self.time_step);
            }
            body.set_linvel(Vector::new(moving.vx as f32, moving.vy as f32), false);
            body.set_angvel(moving.omega as f32, false);
        }
    }

    /// Lets the laws of contact slow the discs that roll on statics.
    fn slow_what_rolls(&mut self, prepared: &Prepared) {
        let count = prepared.bodies.len();
        let mut loaded = vec![false; self.loaded.len()];
        for pair in self.physics.narrow_phase.contact_pairs() {
            let PairContacts::Rigid(contacts) = &pair.contacts else { continue };
            let index = |c: ColliderHandle| self.physics.colliders[c].user_data as usize;
            let (first, second) = (index(pair.collider1), index(pair.collider2));
            let (body, fixed) = (first.min(second), first.max(second));
            if body >= count || fixed < count {
                continue;
            }
            let Some(radius) = prepared.bodies[body].shape.disc_radius() else { continue };
            for manifold in &contacts.manifolds {
                let impulse: f64 = manifold.points.iter().map(|p| f64::from(p.data.impulse)).sum();
                let slot = body * prepared.statics.len() + fixed - count;
                loaded[slot] |= impulse > 0.0;
                if impulse <= 0.0 || !self.loaded[slot] {
                    continue;
                }
                let load = impulse / prepared.bodies[body].mass;
                let off: f64 = prepared.touches.iter().map(|(law, own)| law.roll(own, load)).sum();
                if off > 0.0 {
                    // From the static to the disc.
                    let normal = if first == body { -manifold.data.normal } else { manifold.data.normal };
                    let tangent = Vector::new(-normal.y, normal.x);
                    let Some(handle) = self.bodies[body] else { continue };
                    let rigid = &mut self.physics.bodies[handle];
                    let (v, spin) = (rigid.linvel(), rigid.angvel());
                    let [lost, turn] = rolled_off(v.dot(tangent).into(), spin.into(), radius, off);
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

    fn states(&mut self) -> Vec<State> {
        let mut states = Vec::with_capacity(self.bodies.len());
        for ((handle, centre), angle) in self.bodies.iter().zip(&self.centres).zip(&mut self.angles) {
            let Some(handle) = handle else {
                states.push(State::NOWHERE);
                continue;
            };
            let body = &self.physics.bodies[*handle];
            let wrapped = f64::from(body.rotation().angle());
            let turn = (wrapped - *angle + std::f64::consts::PI).rem_euclid(std::f64::consts::TAU);
            *angle += turn - std::f64::consts::PI;
            let (at, v) = (body.translation(), velocity_of_origin(body, *centre));
            states.push(State {
                position: [at.x.into(), at.y.into()],
                angle: *angle,
                velocity: [v.x.into(), v.y.into()],
                omega: body.angvel().into(),
            });
        }
        states
    }

    /// Hands the touching pairs of this step to the recorder.
    fn record_contacts(
        &self,
        prepared: &Prepared,
        before: &[(Vector, f32)],
        step: u32,
        recorder: &mut Recorder,
    ) {
        let count = prepared.bodies.len();
        recorder.begin_step();
        for pair in self.physics.narrow_phase.contact_pairs() {
            let PairContacts::Rigid(contacts) = &pair.contacts else { continue };
            let index = |c: ColliderHandle| self.physics.colliders[c].user_data as usize;
            let (first, second) = (index(pair.collider1), index(pair.collider2));
            for manifold in &contacts.manifolds {
                let touching = manifold
                    .points
                    .iter()
                    .find(|p| p.data.impulse > 0.0 || f64::from(p.dist) <= prepared.touch);
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
                recorder.touch(step, first, second, [normal.x.into(), normal.y.into()], approach.into());
                break;
            }
        }
    }
}

/// The laws of contact as rapier calls them.
struct Laws<'a> {
    prepared: &'a Prepared,
}

impl PhysicsHooks for Laws<'_> {
    fn modify_solver_contacts(&self, context: &mut ContactModificationContext) {
        let (bodies, handles) = (context.bodies, [context.rigid_body1, context.rigid_body2]);
        let velocity = |handle: Option<RigidBodyHandle>, at: Vector| {
            handle.map_or(Vector::ZERO, |h| bodies[h].velocity_at_point(at))
        };
        let Some(manifold) = context.rigid_mut() else { return };
        let normal = *manifold.normal;
        let tangent = Vector::new(-normal.y, normal.x);
        let own = f64::from(*manifold.restitution);
        // Restitution is the manifold's: of its points, the fastest decides.
        let mut fastest = 0.0;
        for contact in manifold.solver_contacts.iter_mut() {
            let speed = velocity(handles[1], contact.anchor2) - velocity(handles[0], contact.anchor1);
            let meeting = Meeting {
                approach: f64::from(-speed.dot(normal)).max(0.0),
                slip: speed.dot(tangent).into(),
                begins: contact.contact_id[0] & NEW_CONTACT_BIT != 0,
            };
            let answer = Answer { restitution: own, slip: 0.0 };
            let answer = self.prepared.touches.iter().fold(answer, |a, (law, c)| law.meet(c, meeting, a));
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

fn surface(
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

/// The colliders of a static where it stands; `owner` as for [`collider`].
fn standing(solid: &Solid, owner: &str) -> Result<Vec<ColliderBuilder>> {
    match solid {
        // Corners about the piece's own middle: far from the origin an f32 cannot tell them apart.
        Solid::Bounded(pieces) => {
            let middles = pieces.0.iter().map(centred);
            middles.map(|(centre, own)| Ok(collider(&own, owner)?.translation(vector(centre)))).collect()
        }
        Solid::HalfPlane { normal, offset } => {
            let at = [normal[0] * offset, normal[1] * offset];
            Ok(vec![halfspace(*normal).translation(vector(at))])
        }
    }
}

/// The mean of a shape's corners, and the shape moved so that it is at the origin.
fn centred(shape: &Convex) -> ([f64; 2], Convex) {
    let count = shape.points.len() as f64;
    let centre = [0, 1].map(|k| shape.points.iter().map(|p| p[k]).sum::<f64>() / count);
    let points = shape.points.iter().map(|p| [p[0] - centre[0], p[1] - centre[1]]).collect();
    (centre, Convex { points, radius: shape.radius })
}

/// `owner` is the path of the thing whose shape it is, for errors.
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
    // Validated to be of length 1 with the scene; re-normalised for f32.
    ColliderBuilder::halfspace(nalgebra::Unit::new_unchecked(vector(normal).normalize()))
}

fn mass_properties(body: &PreparedBody) -> MassProperties {
    MassProperties::new(vector(body.centre), body.mass as f32, body.inertia as f32)
}

/// What rapier calls a body's velocity at the start: that of the centre of mass, m/s.
fn velocity_of_centre(body: &PreparedBody) -> [f64; 2] {
    if body.centre == [0.0; 2] {
        return body.velocity;
    }
    let (sin, cos) = libm::sincos(body.angle);
    let [x, y] = body.centre;
    let arm = [cos * x - sin * y, sin * x + cos * y];
    [body.velocity[0] - body.omega * arm[1], body.velocity[1] + body.omega * arm[0]]
}

/// What we call a body's velocity: that of its frame's origin, m/s.
fn velocity_of_origin(body: &RigidBody, centre: Vector) -> Vector {
    if centre == Vector::ZERO {
        return body.linvel();
    }
    let arm = arm(body, centre);
    body.linvel() - Vector::new(-arm.y, arm.x) * body.angvel()
}

/// From a body's origin to its centre of mass, world frame, m.
fn arm(body: &RigidBody, centre: Vector) -> Vector {
    *body.rotation() * centre
}

fn vector(v: [f64; 2]) -> Vector {
    Vector::new(v[0] as f32, v[1] as f32)
}
