//! Laws of a segment: those of the scene and of a model's terms; impacts on a surface.

use super::supported::PlanarState;
use crate::inference::segment::{CollidingPair, Segment, Surface, contact_gap};
use crate::world::Latents;
use crate::world::effect::{
    BodyLaw, Constants, ContactLaw, ContactResponse, ContactState, Effect, EffectKind, EffectTarget,
    MassProperties, Measurement, MotionLaw, MotionState, Sensor, SimulationContext,
};

/// Duration of a velocity change from which accelerations are computed, s; small against all motion, large
/// against rounding.
pub const KICK_DURATION: f64 = 1e-6;
/// Longest integration step, s, and the longest if a law has edges in space.
pub(super) const MAX_STEPS: [f64; 2] = [0.03, 0.007];
/// Steps in relaxation times: for accuracy, and for stability if accuracy needs more than `MANY_STEPS`;
/// maximum number of steps.
const ACCURACY_STEPS: f64 = 0.4;
const STABILITY_STEPS: f64 = 2.0;
const MANY_STEPS: f64 = 2000.0;
const MAX_STEP_COUNT: f64 = 10_000.0;
/// Finite-difference step for the relaxation rate, m/s.
const SMALL_SPEED: f64 = 1e-3;

/// Laws of a segment.
pub struct SegmentPhysics<'a> {
    pub(super) segment: &'a Segment,
    pub(super) motion_laws: Vec<ActiveMotionLaw>,
    pub(super) contact_laws: Vec<(&'static dyn ContactLaw, Constants)>,
    pub(super) sensors: Vec<(&'static dyn Sensor, Constants)>,
    /// True time = rate * stamp + offset.
    pub(super) clock: [f64; 2],
    pub(super) max_step: f64,
    pub(super) restitution: f64,
    pub(super) friction: f64,
    /// Moment of inertia over mass and radius squared of the body of a surface.
    pub(super) inertia: f64,
    /// Of the bodies of a collision.
    pub(super) masses: [MassProperties; 2],
}

/// A law of motion with the index of its effect.
pub(super) struct ActiveMotionLaw {
    pub(super) place: usize,
    pub(super) effect: &'static Effect,
    law: &'static dyn MotionLaw,
    pub(super) constants: Constants,
}

/// Kinematics of an impact.
#[derive(Clone, Copy, Debug)]
pub struct Impact {
    /// s since the segment's start, by the observations' clock
    pub time: f64,
    /// Speed towards the surface, m/s.
    pub approach: f64,
    /// Speed of the contact point along (-ny, nx), m/s.
    pub slip: f64,
    /// Impulse over mass along the normal (nx, ny), m/s.
    pub normal: f64,
    /// The same along (-ny, nx).
    pub tangent: f64,
    /// (nx, ny): away from the surface, or from the second body to the first.
    pub direction: [f64; 2],
    /// Velocity change of each body over that of the first off a static: 1 there; in a collision, whose impulses are over the
    /// reduced mass, the reduced mass over the body's own, negative for the second.
    pub shares: [f64; 2],
}

impl<'a> SegmentPhysics<'a> {
    /// The scene's effects and `terms`, with values in the registry's order.
    pub fn new(
        segment: &'a Segment,
        terms: &[(&'static Effect, &[f64])],
        latents: &Latents,
    ) -> SegmentPhysics<'a> {
        let around = SimulationContext { time_step: KICK_DURATION, gravity: segment.scene.gravity };
        let own = segment.scene_effects.iter().map(|a| (a.effect, a.values.as_slice()));
        let (mut motion_laws, mut contact_laws, mut sensors) = (Vec::new(), Vec::new(), Vec::new());
        let mut body_laws: Vec<(&'static dyn BodyLaw, Constants)> = Vec::new();
        let mut max_step = MAX_STEPS[0];
        for (place, (effect, values)) in own.chain(terms.iter().copied()).enumerate() {
            if effect.parameters.iter().zip(values).all(|(p, v)| p.neutral == *v) {
                continue;
            }
            match effect.kind {
                EffectKind::Motion(law) => {
                    let constants = law.constants(values, &around);
                    motion_laws.push(ActiveMotionLaw { place, effect, law, constants });
                }
                EffectKind::Contact(law) => contact_laws.push((law, law.constants(values, &around))),
                EffectKind::Body(law) => body_laws.push((law, law.constants(values, &around))),
                EffectKind::Sensor(sensor) => sensors.push((sensor, sensor.constants(values, &around))),
                // A free initial state absorbs any effect on placement.
                EffectKind::Action(_) => {}
            }
            if effect.target() == EffectTarget::Region || effect.is_abrupt {
                max_step = MAX_STEPS[1];
            }
        }
        let clock = sensors.iter().fold([1.0, 0.0], |[rate, offset], (sensor, c)| {
            let [r, o] = sensor.clock(c);
            [rate * r, rate * o + offset]
        });
        let [friction, restitution] = contact_coefficients(segment, latents);
        let body = |body, own| body_laws.iter().fold(own, |m, (law, c)| law.apply(c, body, m));
        let inertia = segment.surface.as_ref().map_or(1.0, |s| {
            let whole = body(usize::MAX, MassProperties { mass: 1.0, inertia: s.inertia });
            whole.inertia / whole.mass
        });
        let masses = segment.pair.map_or([MassProperties { mass: 1.0, inertia: 1.0 }; 2], |pair| {
            [0, 1].map(|k| {
                let density = latents.density.filter(|_| pair.carries_latents[k]);
                let (mass, inertia) = segment.scene.bodies[k].mass_properties(density);
                body(pair.bodies[k], MassProperties { mass, inertia })
            })
        });
        SegmentPhysics {
            segment,
            motion_laws,
            contact_laws,
            sensors,
            clock,
            max_step,
            restitution,
            friction,
            inertia,
            masses,
        }
    }

    /// Measured position of a body; NaN if it left all bounds.
    pub(super) fn measure(&self, body: &PlanarState) -> [f64; 2] {
        let state =
            Measurement { x: body[0], y: body[1], angle: 0.0, vx: body[2], vy: body[3], omega: body[4] };
        let measured = self.sensors.iter().fold(state, |s, (sensor, c)| sensor.measure(c, s));
        let fine = measured.x.abs() < 1e7 && measured.y.abs() < 1e7;
        if fine { [measured.x, measured.y] } else { [f64::NAN; 2] }
    }

    /// Longest integration step from a state, s: short against the relaxation time of velocities there and at
    /// the typical observed velocity.
    pub(super) fn max_step_from(&self, body: &PlanarState) -> f64 {
        let points = &self.segment.observations;
        let (Some(first), Some(last)) = (points.first(), points.last()) else { return self.max_step };
        let duration = (last.time - first.time).max(1e-9);
        let usual = [0, 1].map(|k| (last.position[k] - first.position[k]) / duration);
        let velocities = [[body[2], body[3]], usual].into_iter().filter(|v| v.iter().all(|v| v.is_finite()));
        let rate = velocities.map(|[vx, vy]| self.relaxation_rate(&[body[0], body[1], vx, vy, body[4]]));
        let rate = rate.fold(0.0, f64::max);
        let stable = (duration / MANY_STEPS).min(STABILITY_STEPS / rate).max(duration / MAX_STEP_COUNT);
        self.max_step.min((ACCURACY_STEPS / rate).max(stable))
    }

    /// Largest derivative of an acceleration by a velocity, 1/s.
    fn relaxation_rate(&self, body: &PlanarState) -> f64 {
        let current = self.acceleration(self.clock[1], body);
        let by = |k: usize| {
            let mut moved = *body;
            moved[k] += SMALL_SPEED;
            let candidate = self.acceleration(self.clock[1], &moved);
            (candidate[0] - current[0]).hypot(candidate[1] - current[1]) / SMALL_SPEED
        };
        by(2).max(by(3))
    }

    /// Whether all laws are smooth; then steps need not end at observations.
    pub(super) fn is_smooth(&self) -> bool {
        self.max_step == MAX_STEPS[0]
    }

    /// Acceleration at a time since the segment's start and a true state (x, y, vx, vy) without spin, m/s^2.
    pub fn acceleration_at(&self, time: f64, [x, y, vx, vy]: [f64; 4]) -> [f64; 2] {
        let [ax, ay, _] = self.acceleration(self.true_time(time), &[x, y, vx, vy, 0.0]);
        [ax, ay]
    }

    /// [`Physics::stamp`] backwards.
    pub(super) fn observed_time(&self, true_time: f64) -> f64 {
        (true_time - self.clock[1]) / self.clock[0] - self.segment.start
    }

    /// True time of a time since the segment's start, s.
    pub(super) fn true_time(&self, time: f64) -> f64 {
        self.clock[0] * (self.segment.start + time) + self.clock[1]
    }

    pub(super) fn acceleration(&self, time: f64, s: &PlanarState) -> [f64; 3] {
        let mut v = [s[2], s[3], s[4]];
        for acting in &self.motion_laws {
            let moving = MotionState { time, x: s[0], y: s[1], vx: v[0], vy: v[1], omega: v[2] };
            v = acting.law.kick(&acting.constants, moving, KICK_DURATION);
        }
        let g = self.segment.scene.gravity;
        [
            (v[0] - s[2]) / KICK_DURATION + g[0],
            (v[1] - s[3]) / KICK_DURATION + g[1],
            (v[2] - s[4]) / KICK_DURATION,
        ]
    }

    /// State after an impact on a surface, and its kinematics.
    pub(super) fn resolve_impact(
        &self,
        time: f64,
        mut at: PlanarState,
        surface: &Surface,
    ) -> (PlanarState, Impact) {
        let n = surface.normal;
        let time = self.observed_time(time);
        // Contact point relative to the centre along the normal and along (-ny, nx), in radii.
        let arm = surface.corner.map_or([-1.0, 0.0], |corner| {
            let [x, y] = corner.place.at(time);
            let [normal, tangent] = [x * n[0] + y * n[1] - corner.radius, y * n[0] - x * n[1]];
            [normal / surface.radius, tangent / surface.radius]
        });
        let speed = at[2] * n[0] + at[3] * n[1] - surface.radius * arm[1] * at[4];
        let slip = at[3] * n[0] - at[2] * n[1] + surface.radius * arm[0] * at[4];
        let mobility = Mobility {
            normal: 1.0 + arm[1] * arm[1] / self.inertia,
            tangent: 1.0 + arm[0] * arm[0] / self.inertia,
            cross: -arm[0] * arm[1] / self.inertia,
        };
        let (normal, tangent) = self.impulses([speed, slip], mobility);
        at[2] += normal * n[0] - tangent * n[1];
        at[3] += normal * n[1] + tangent * n[0];
        at[4] += (arm[0] * tangent - arm[1] * normal) / (self.inertia * surface.radius);
        let approach = (-speed).max(0.0);
        (at, Impact { time, approach, slip, normal, tangent, direction: n, shares: [1.0, 0.0] })
    }

    /// States of two bodies after they collide, and the kinematics; impulses are over the reduced mass.
    pub(super) fn resolve_collision(
        &self,
        time: f64,
        [mut a, mut b]: [PlanarState; 2],
        pair: &CollidingPair,
    ) -> ([PlanarState; 2], Impact) {
        let time = self.observed_time(time);
        let met = contact_gap(&pair.features, time, [[a[0], a[1]], [b[0], b[1]]], 0.0);
        let n = met.normal;
        // Contact point relative to each centre along the normal and along (-ny, nx), m.
        let arms = met.arms.map(|[x, y]| [x * n[0] + y * n[1], y * n[0] - x * n[1]]);
        let [vx, vy] = [a[2] - b[2], a[3] - b[3]];
        let speed = vx * n[0] + vy * n[1] - arms[0][1] * a[4] + arms[1][1] * b[4];
        let slip = vy * n[0] - vx * n[1] + arms[0][0] * a[4] - arms[1][0] * b[4];
        let [m, w] = self.masses;
        let reduced = m.mass * w.mass / (m.mass + w.mass);
        let turn = |k: usize, axis: usize| reduced * arms[k][axis] / self.masses[k].inertia;
        let mobility = Mobility {
            normal: 1.0 + arms[0][1] * turn(0, 1) + arms[1][1] * turn(1, 1),
            tangent: 1.0 + arms[0][0] * turn(0, 0) + arms[1][0] * turn(1, 0),
            cross: -(arms[0][0] * turn(0, 1) + arms[1][0] * turn(1, 1)),
        };
        let (normal, tangent) = self.impulses([speed, slip], mobility);
        let shares = [reduced / m.mass, -reduced / w.mass];
        for (k, state) in [&mut a, &mut b].into_iter().enumerate() {
            state[2] += shares[k] * (normal * n[0] - tangent * n[1]);
            state[3] += shares[k] * (normal * n[1] + tangent * n[0]);
            let sign = [1.0, -1.0][k];
            state[4] += sign * (tangent * turn(k, 0) - normal * turn(k, 1));
        }
        let approach = (-speed).max(0.0);
        ([a, b], Impact { time, approach, slip, normal, tangent, direction: n, shares })
    }

    /// Impulses over mass along the normal and along (-ny, nx), for the speeds of the contact point away and along the surface.
    fn impulses(&self, [speed, slip]: [f64; 2], mobility: Mobility) -> (f64, f64) {
        let contact = ContactState { approach: (-speed).max(0.0), slip, begins: true };
        let own = ContactResponse { restitution: self.restitution, slip: 0.0 };
        let response = self.contact_laws.iter().fold(own, |a, (law, c)| law.respond(c, contact, a));
        let [up, aside] = [-(1.0 + response.restitution) * speed, response.slip - slip];
        let Mobility { normal: nn, tangent: tt, cross } = mobility;
        // The body sticks, unless that takes more friction than there is.
        let determinant = nn - cross * cross / tt;
        let normal = (up - cross * aside / tt) / determinant;
        let tangent = (aside - cross * normal) / tt;
        if tangent.abs() <= self.friction * normal {
            return (normal, tangent);
        }
        let friction = self.friction.copysign(tangent);
        let sliding = nn + cross * friction;
        if sliding <= 0.0 {
            // Friction would wedge the body in without bound: it sticks.
            return (normal, tangent);
        }
        let normal = up / sliding;
        // No tangential impulse without normal impulse.
        (normal, (friction.abs() * normal).max(0.0).copysign(tangent))
    }
}

/// Velocity changes of the contact point by unit impulses over mass: along the normal by a normal one, along (-ny, nx) by a
/// tangential one, and along either by the other.
#[derive(Clone, Copy)]
struct Mobility {
    normal: f64,
    tangent: f64,
    cross: f64,
}

/// Friction and restitution of a segment's contact.
fn contact_coefficients(segment: &Segment, latents: &Latents) -> [f64; 2] {
    let (own, carries) = match (&segment.surface, &segment.pair) {
        (Some(s), _) => ([0, 1].map(|k| [s.friction[k], s.restitution[k]]), s.carries_latents),
        (None, Some(pair)) => {
            let of = |k: usize| [segment.scene.bodies[k].friction, segment.scene.bodies[k].restitution];
            ([0, 1].map(of), pair.carries_latents)
        }
        (None, None) => return [1.0; 2],
    };
    let of = |k: usize| {
        let carried = |latent: Option<f64>, own: f64| latent.filter(|_| carries[k]).unwrap_or(own);
        [carried(latents.friction, own[k][0]), carried(latents.restitution, own[k][1])]
    };
    segment.scene.contact_rules.unwrap_or_default().of_contact(of(0), of(1))
}

impl Surface {
    /// Position and velocity of the part of the body that bounces off it: its corner, or its centre for a disc. `time`: since the
    /// segment's start, s.
    pub(super) fn touching_state(&self, s: &PlanarState, time: f64) -> PlanarState {
        self.corner.map_or(*s, |corner| {
            let ([x, y], [vx, vy]) = (corner.place.at(time), corner.place.velocity_at(time));
            [s[0] + x, s[1] + y, s[2] + vx, s[3] + vy, s[4]]
        })
    }

    pub(super) fn height(&self, s: &PlanarState, offset: f64) -> f64 {
        s[0] * self.normal[0] + s[1] * self.normal[1] - self.level - offset
    }

    pub(super) fn is_below(&self, s: &PlanarState, offset: f64) -> bool {
        self.height(s, offset) < 0.0
    }

    /// Speed away from the surface, m/s.
    pub(super) fn normal_velocity(&self, s: &PlanarState) -> f64 {
        s[2] * self.normal[0] + s[3] * self.normal[1]
    }

    pub(super) fn is_approached(&self, s: &PlanarState) -> bool {
        self.normal_velocity(s) < 0.0
    }
}
