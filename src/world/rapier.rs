//! The general engine: rapier2d, any scene.
//!
//! Source: rapier2d 0.36.1 (TGS-soft with sub-steps, f32). Semantics as in [`super`]: products of
//! coefficients, effects before gravity once per step.
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

use rapier2d::prelude::*;

use super::effect::{Answer, Meeting, Moving, rolled_off};
use super::goal::{self, Watch};
use super::prepare::{Prepared, PreparedBody, PreparedShape};
use super::record::{Recorder, State};
use crate::error::{Error, Result};
use crate::task::geometry::{Convex, gap};
use crate::trajectory::{End, Trajectory};

/// Integrates one rollout.
pub fn run(prepared: &Prepared) -> Result<Trajectory> {
    let mut world = World::build(prepared)?;
    let mut recorder = Recorder::new(prepared);
    let mut watch = Watch::default();
    let needed = prepared.goal.as_ref().map_or(0, |g| g.hold_steps(prepared.time_step));
    recorder.observe(0, &world.states());
    let mut due = prepared.schedule.after(0);
    for step in 1..=prepared.steps {
        world.kick(prepared, step - 1);
        let before = world.velocities();
        if prepared.touches.is_empty() {
            world.physics.step();
        } else {
            world.physics.step_with_events(&Laws { prepared }, &());
            world.slow_what_rolls(prepared);
        }
        let states = world.states();
        if states.iter().any(|s| !s.is_finite()) {
            return Ok(recorder.finish(step - 1, End::Diverged));
        }
        world.record_contacts(prepared, &before, step, &mut recorder);
        if let Some(spec) = &prepared.goal {
            let holds = goal::holds(
                &spec.condition,
                |i| (states[i].position, states[i].angle),
                |s, shape| gap_to_static(&prepared.statics[s].shape, shape),
                |i| &prepared.bodies[i].shape,
            );
            if watch.advance(holds, needed) {
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
    }
    Ok(recorder.finish(prepared.steps, End::Horizon))
}

struct World {
    physics: PhysicsWorld,
    /// In the order of the prepared bodies.
    bodies: Vec<RigidBodyHandle>,
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
        let mut bodies = Vec::new();
        for (i, body) in prepared.bodies.iter().enumerate() {
            let rigid = RigidBodyBuilder::dynamic()
                .translation(vector(body.position))
                .rotation(body.angle as f32)
                .linvel(vector(body.velocity))
                .angvel(body.omega as f32)
                .can_sleep(false)
                .build();
            let handle = physics.bodies.insert(rigid);
            let builder = collider(&body.shape, &format!("bodies[{i}]"))?;
            let collider = surface(builder, body.friction, body.restitution, i);
            let collider = collider.mass_properties(mass_properties(body)).active_hooks(hooks);
            physics.colliders.insert_with_parent(collider, handle, &mut physics.bodies);
            bodies.push(handle);
        }
        for (i, fixed) in prepared.statics.iter().enumerate() {
            let builder = match &fixed.shape {
                PreparedShape::Convex(shape) => {
                    // Corners about the shape's own middle: far from the origin an f32 cannot tell them apart.
                    let (centre, own) = centred(shape);
                    collider(&own, &format!("statics[{i}]"))?.translation(vector(centre))
                }
                PreparedShape::Halfspace { normal, offset } => {
                    let at = [normal[0] * offset, normal[1] * offset];
                    halfspace(*normal).translation(vector(at))
                }
            };
            let index = prepared.bodies.len() + i;
            physics.colliders.insert(surface(builder, fixed.friction, fixed.restitution, index));
        }
        let angles = prepared.bodies.iter().map(|b| b.angle).collect();
        let loaded = vec![false; prepared.bodies.len() * prepared.statics.len()];
        Ok(World { physics, bodies, angles, time_step: prepared.time_step, loaded })
    }

    /// Lets the motion effects act on every body.
    fn kick(&mut self, prepared: &Prepared, step: u32) {
        if prepared.motions.is_empty() {
            return;
        }
        let time = f64::from(step) * self.time_step;
        for handle in &self.bodies {
            let body = &mut self.physics.bodies[*handle];
            let (at, v) = (body.translation(), body.linvel());
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
            if body >= count || fixed < count || !prepared.bodies[body].shape.is_disc() {
                continue;
            }
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
                    let rigid = &mut self.physics.bodies[self.bodies[body]];
                    let (v, spin) = (rigid.linvel(), rigid.angvel());
                    let radius = prepared.bodies[body].shape.radius;
                    let [lost, turn] = rolled_off(v.dot(tangent).into(), spin.into(), radius, off);
                    rigid.set_linvel(v - tangent * lost as f32, false);
                    rigid.set_angvel(spin - turn as f32, false);
                }
            }
        }
        self.loaded = loaded;
    }

    fn velocities(&self) -> Vec<(Vector, f32)> {
        self.bodies
            .iter()
            .map(|h| (self.physics.bodies[*h].linvel(), self.physics.bodies[*h].angvel()))
            .collect()
    }

    fn states(&mut self) -> Vec<State> {
        let mut states = Vec::with_capacity(self.bodies.len());
        for (handle, angle) in self.bodies.iter().zip(&mut self.angles) {
            let body = &self.physics.bodies[*handle];
            let wrapped = f64::from(body.rotation().angle());
            let turn = (wrapped - *angle + std::f64::consts::PI).rem_euclid(std::f64::consts::TAU);
            *angle += turn - std::f64::consts::PI;
            let (at, v) = (body.translation(), body.linvel());
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
                    let centre = self.physics.bodies[self.bodies[i]].translation();
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

fn surface(builder: ColliderBuilder, friction: f64, restitution: f64, index: usize) -> ColliderBuilder {
    builder
        .friction(friction as f32)
        .restitution(restitution as f32)
        .friction_combine_rule(CoefficientCombineRule::Multiply)
        .restitution_combine_rule(CoefficientCombineRule::Multiply)
        .user_data(index as u128)
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
    let centre = match body.shape.points.as_slice() {
        [p] => *p,
        points => centroid(points),
    };
    MassProperties::new(vector(centre), body.mass as f32, body.inertia as f32)
}

/// Centroid of a segment or convex polygon.
fn centroid(points: &[[f64; 2]]) -> [f64; 2] {
    if points.len() == 2 {
        return [(points[0][0] + points[1][0]) / 2.0, (points[0][1] + points[1][1]) / 2.0];
    }
    let (mut area, mut sum) = (0.0, [0.0, 0.0]);
    for i in 0..points.len() {
        let (a, b) = (points[i], points[(i + 1) % points.len()]);
        let cross = a[0] * b[1] - a[1] * b[0];
        area += cross / 2.0;
        sum = [sum[0] + cross * (a[0] + b[0]) / 6.0, sum[1] + cross * (a[1] + b[1]) / 6.0];
    }
    [sum[0] / area, sum[1] / area]
}

fn gap_to_static(fixed: &PreparedShape, shape: &Convex) -> f64 {
    match fixed {
        PreparedShape::Convex(own) => gap(own, shape),
        PreparedShape::Halfspace { normal, offset } => {
            let below = |p: &[f64; 2]| normal[0] * p[0] + normal[1] * p[1] - offset;
            shape.points.iter().map(below).fold(f64::INFINITY, f64::min) - shape.radius
        }
    }
}

fn vector(v: [f64; 2]) -> Vector {
    Vector::new(v[0] as f32, v[1] as f32)
}
