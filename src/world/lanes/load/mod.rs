//! Loads rollouts into lanes, and empties lanes.

mod goal;
pub mod outline;
mod topology;

use self::outline::disc_within;
use super::state::{ABSENT_RADIUS_M, BatchState, DiscPair, LawLanes, StaticCore, StaticLanes};
use super::static_piece::{StaticPiece, pieces};
use crate::world::compile::{BodyModel, RolloutModel};
use crate::world::effect::{Constants, MAX_PARAMETERS};
use crate::world::record;

/// Chipmunk's collision bias: fraction of the overlap left after 1/60 s.
const OVERLAP_KEPT_PER_FRAME: f64 = 0.9;
/// Chipmunk's collision slop, m, for bodies of ordinary size.
const SLOP_M: f64 = 0.1;
/// Size from which a body has Chipmunk's slop, m.
const FULL_SLOP_EXTENT_M: f64 = 0.6;

impl BatchState {
    /// Loads a rollout into a lane; it starts now.
    pub fn fill(&mut self, lane: usize, model: &RolloutModel) {
        let dt = model.time_step;
        self.dt[lane] = dt;
        self.kick_x[lane] = model.gravity[0] * dt;
        self.kick_y[lane] = model.gravity[1] * dt;
        self.contact_margin[lane] = model.contact_margin;
        self.slop[lane] = slop(model);
        self.bias_rate[lane] = (1.0 - libm::pow(OVERLAP_KEPT_PER_FRAME, 60.0 * dt)) / dt;
        self.start_tick[lane] = self.tick;
        outline::fill(&mut self.frames, &mut self.outlines, lane, model);
        for (i, own) in model.bodies.iter().enumerate() {
            self.fill_body(lane, i, own);
        }
        for (fixed, (_, own)) in self.statics.iter_mut().zip(pieces(model)) {
            fill_static(fixed, lane, own);
        }
        for i in 0..model.bodies.len() + model.statics.len() {
            if !model.is_present(i) {
                self.remove(lane, i);
            }
        }
        self.fill_pairs(lane, model);
        self.reset_pairs(lane, |_| true);
        self.reset_contact_times(lane, |_| true);
        for (term, (_, constants)) in self.motion_laws.iter_mut().zip(&model.motion_laws) {
            fill_term(term, lane, constants);
        }
        for (term, (_, constants)) in self.contact_laws.iter_mut().zip(&model.contact_laws) {
            fill_term(term, lane, constants);
        }
    }

    /// Loads a body at its initial state into a lane.
    pub fn fill_body(&mut self, lane: usize, i: usize, own: &BodyModel) {
        self.set_body(lane, i, own, &own.initial_state());
        let body = &mut self.bodies[i];
        body.radius[lane] = inner_radius(own);
        body.travel[lane] = 0.0;
        body.supported[lane] = 0.0;
        body.rolling[lane] = 0.0;
        self.load_mass(lane, i, own);
    }

    /// Sets the pose and velocity of a body and resets its bias velocity.
    pub fn set_body(&mut self, lane: usize, i: usize, own: &BodyModel, to: &record::BodyState) {
        let (arm, body) = (own.arm(to.angle), &mut self.bodies[i]);
        // Adding 0 turns -0 into 0: see `kernel::apply_forces`.
        body.moving.x[lane] = to.position[0] + arm[0] + 0.0;
        body.moving.y[lane] = to.position[1] + arm[1] + 0.0;
        body.moving.vx[lane] = to.velocity[0] - to.omega * arm[1] + 0.0;
        body.moving.vy[lane] = to.velocity[1] + to.omega * arm[0] + 0.0;
        body.moving.omega[lane] = to.omega + 0.0;
        body.angle[lane] = to.angle + 0.0;
        body.bias_x[lane] = 0.0;
        body.bias_y[lane] = 0.0;
        if let Some(frame) = self.frames.get_mut(i) {
            frame.bias_omega[lane] = 0.0;
        }
    }

    /// Loads the quantities that depend on a body's mass.
    pub fn load_mass(&mut self, lane: usize, i: usize, own: &BodyModel) {
        self.bodies[i].inv_mass[lane] = 1.0 / own.mass;
        self.bodies[i].spin_per_impulse[lane] = inner_radius(own) / own.inertia;
        if let Some(frame) = self.frames.get_mut(i) {
            frame.inv_inertia[lane] = 1.0 / own.inertia;
        }
    }

    /// Loads the quantities of all pairs that depend on masses and surfaces.
    pub fn fill_pairs(&mut self, lane: usize, model: &RolloutModel) {
        for pair in &mut self.pairs {
            fill_pair(pair, lane, model);
        }
        for near in &mut self.near {
            let (first, other) = (
                model.surface_coefficients(near.contact.first),
                model.surface_coefficients(near.contact.other),
            );
            [near.friction[lane], near.restitution[lane]] = model.rules.of_contact(first, other);
        }
    }

    /// Empties a lane.
    pub fn clear(&mut self, lane: usize) {
        self.dt[lane] = 0.0;
        self.kick_x[lane] = 0.0;
        self.kick_y[lane] = 0.0;
        for body in &mut self.bodies {
            body.radius[lane] = ABSENT_RADIUS_M;
            for v in [
                &mut body.moving.x,
                &mut body.moving.y,
                &mut body.moving.vx,
                &mut body.moving.vy,
                &mut body.moving.omega,
                &mut body.angle,
                &mut body.bias_x,
                &mut body.bias_y,
                &mut body.inv_mass,
                &mut body.spin_per_impulse,
                &mut body.travel,
            ] {
                v[lane] = 0.0;
            }
        }
        for pair in &mut self.pairs {
            (pair.jn[lane], pair.jt[lane]) = (0.0, 0.0);
            pair.limit[lane] = f64::INFINITY;
        }
        for near in &mut self.near {
            near.limit[lane] = f64::INFINITY;
            (near.friction[lane], near.restitution[lane]) = (0.0, 0.0);
        }
        for manifold in &mut self.manifolds {
            manifold.clear(lane);
        }
        for frame in &mut self.frames {
            frame.clear(lane);
        }
        for term in &mut self.motion_laws {
            fill_term(term, lane, &[0.0; MAX_PARAMETERS]);
        }
    }
}

/// The radius, m, of a disc, or the smallest radius of the discs inscribed in a body's pieces.
fn inner_radius(body: &BodyModel) -> f64 {
    let least = || body.shape.0.iter().map(|piece| disc_within(piece).1).fold(f64::INFINITY, f64::min);
    body.shape.disc_radius().unwrap_or_else(least)
}

fn fill_pair(pair: &mut DiscPair, lane: usize, model: &RolloutModel) {
    let inverse_masses = |i: usize| {
        let b = &model.bodies[i];
        let radius = inner_radius(b);
        (1.0 / b.mass, radius * radius / b.inertia)
    };
    let (mut inv_mass, mut turn) = inverse_masses(pair.first);
    if pair.second < model.bodies.len() {
        let (m, t) = inverse_masses(pair.second);
        (inv_mass, turn) = (inv_mass + m, turn + t);
    }
    pair.full_normal_mass[lane] = 1.0 / inv_mass;
    pair.full_tangent_mass[lane] = 1.0 / (inv_mass + turn);
    let (first, other) =
        (model.surface_coefficients(pair.first), model.surface_coefficients(pair.contact.other));
    [pair.friction[lane], pair.restitution[lane]] = model.rules.of_contact(first, other);
}

/// Loads a piece of a static into a lane.
pub fn fill_static(fixed: &mut StaticLanes, lane: usize, piece: StaticPiece) {
    fixed.radius[lane] = 0.0;
    match (&mut fixed.core, piece) {
        (StaticCore::Plane { nx, ny, offset }, StaticPiece::HalfPlane { normal, offset: own }) => {
            (nx[lane], ny[lane], offset[lane]) = (normal[0], normal[1], own);
        }
        (StaticCore::Point { x, y }, StaticPiece::Convex(c)) => {
            fixed.radius[lane] = c.radius;
            (x[lane], y[lane]) = (c.points[0][0], c.points[0][1]);
        }
        (StaticCore::Polygon(edges), StaticPiece::Convex(c)) => {
            fixed.radius[lane] = c.radius;
            for (i, edge) in edges.iter_mut().enumerate() {
                let (p, q) = (c.points[i], c.points[(i + 1) % c.points.len()]);
                let (dx, dy) = (q[0] - p[0], q[1] - p[1]);
                let length = (dx * dx + dy * dy).sqrt();
                (edge.ax[lane], edge.ay[lane]) = (p[0], p[1]);
                (edge.nx[lane], edge.ny[lane]) = (dy / length, -dx / length);
                edge.length[lane] = length;
            }
        }
        // Lanes of a batch have one topology: see `topology`.
        _ => unreachable!("rollouts of one batch have the same topology"),
    }
}

fn fill_term(term: &mut LawLanes, lane: usize, constants: &Constants) {
    for (row, value) in term.constants.iter_mut().zip(constants) {
        row[lane] = *value;
    }
}

/// Chipmunk's slop of 0.1 m suits bodies of ordinary size. It is reduced with the square of the size for
/// smaller bodies, so that a ball of 4 cm sinks in by half a millimetre and not by its whole radius.
fn slop(model: &RolloutModel) -> f64 {
    model.bodies[..model.scene_counts[0]].iter().map(slop_with).fold(f64::INFINITY, f64::min)
}

/// The slop, m, if this is the smallest body.
pub fn slop_with(body: &BodyModel) -> f64 {
    let smallest = 2.0 * inner_radius(body);
    let share = (smallest / FULL_SLOP_EXTENT_M).min(1.0);
    SLOP_M * share * share
}
