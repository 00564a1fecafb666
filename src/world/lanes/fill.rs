//! Putting a rollout into a lane, and leaving a lane empty.

use super::outline::{self, disc_within};
use super::piece::{Piece, pieces};
use super::state::{Core, NOTHING, Pair, State, StaticLanes, TermLanes};
use crate::world::effect::{Constants, MOST_PARAMETERS};
use crate::world::prepare::{Prepared, PreparedBody};
use crate::world::record;

/// Chipmunk's share of overlap left after a second: 0.9 a 60th of a second.
const LEFT_A_FRAME: f64 = 0.9;
/// Chipmunk's slop, m, for bodies of ordinary size.
const SLOP: f64 = 0.1;
/// Extent from which a body has Chipmunk's slop, m.
const ORDINARY: f64 = 0.6;

impl State {
    /// Puts a rollout into a lane; it begins now.
    pub fn fill(&mut self, lane: usize, prepared: &Prepared) {
        let dt = prepared.time_step;
        self.dt[lane] = dt;
        self.kick_x[lane] = prepared.gravity[0] * dt;
        self.kick_y[lane] = prepared.gravity[1] * dt;
        self.touch[lane] = prepared.touch;
        self.slop[lane] = slop(prepared);
        self.bias_rate[lane] = (1.0 - libm::pow(LEFT_A_FRAME, 60.0 * dt)) / dt;
        self.born[lane] = self.tick;
        outline::fill(&mut self.frames, &mut self.outlines, lane, prepared);
        for (i, own) in prepared.bodies.iter().enumerate() {
            self.fill_body(lane, i, own);
        }
        for (fixed, (_, own)) in self.statics.iter_mut().zip(pieces(prepared)) {
            fill_static(fixed, lane, own);
        }
        for i in 0..prepared.bodies.len() + prepared.statics.len() {
            if !prepared.has_number(i) {
                self.hide(lane, i);
            }
        }
        self.fill_pairs(lane, prepared);
        self.begin_pairs(lane, |_| true);
        self.forget_touches(lane, |_| true);
        for (term, (_, constants)) in self.motions.iter_mut().zip(&prepared.motions) {
            fill_term(term, lane, constants);
        }
        for (term, (_, constants)) in self.touches.iter_mut().zip(&prepared.touches) {
            fill_term(term, lane, constants);
        }
    }

    /// Puts a body into a lane, where it starts.
    pub fn fill_body(&mut self, lane: usize, i: usize, own: &PreparedBody) {
        self.set_body(lane, i, own, &own.start());
        let body = &mut self.bodies[i];
        body.radius[lane] = inner_radius(own);
        body.travel[lane] = 0.0;
        body.carried[lane] = 0.0;
        body.rolling[lane] = 0.0;
        self.fill_matter(lane, i, own);
    }

    /// Sets where a body is and how it moves; nothing is left of what pushed it out of others.
    pub fn set_body(&mut self, lane: usize, i: usize, own: &PreparedBody, to: &record::State) {
        let (arm, body) = (own.arm(to.angle), &mut self.bodies[i]);
        // Adding 0 turns -0 into 0: see `kernel::push`.
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

    /// What follows from a body's mass.
    pub fn fill_matter(&mut self, lane: usize, i: usize, own: &PreparedBody) {
        self.bodies[i].inv_mass[lane] = 1.0 / own.mass;
        self.bodies[i].spin_per_impulse[lane] = inner_radius(own) / own.inertia;
        if let Some(frame) = self.frames.get_mut(i) {
            frame.inv_inertia[lane] = 1.0 / own.inertia;
        }
    }

    /// What follows from masses and surfaces of two things that may touch, for all of them.
    pub fn fill_pairs(&mut self, lane: usize, prepared: &Prepared) {
        for pair in &mut self.pairs {
            fill_pair(pair, lane, prepared);
        }
        for near in &mut self.near {
            let (first, other) = (prepared.surface(near.met.first), prepared.surface(near.met.other));
            [near.friction[lane], near.restitution[lane]] = prepared.rules.of_contact(first, other);
        }
    }

    /// Leaves a lane empty.
    pub fn clear(&mut self, lane: usize) {
        self.dt[lane] = 0.0;
        self.kick_x[lane] = 0.0;
        self.kick_y[lane] = 0.0;
        for body in &mut self.bodies {
            body.radius[lane] = NOTHING;
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
        for term in &mut self.motions {
            fill_term(term, lane, &[0.0; MOST_PARAMETERS]);
        }
    }
}

/// The radius, m, of a disc, or of the least of those within the body's pieces.
fn inner_radius(body: &PreparedBody) -> f64 {
    let least = || body.shape.0.iter().map(|piece| disc_within(piece).1).fold(f64::INFINITY, f64::min);
    body.shape.disc_radius().unwrap_or_else(least)
}

fn fill_pair(pair: &mut Pair, lane: usize, prepared: &Prepared) {
    let looseness = |i: usize| {
        let b = &prepared.bodies[i];
        let radius = inner_radius(b);
        (1.0 / b.mass, radius * radius / b.inertia)
    };
    let (mut inv_mass, mut turn) = looseness(pair.first);
    if pair.second < prepared.bodies.len() {
        let (m, t) = looseness(pair.second);
        (inv_mass, turn) = (inv_mass + m, turn + t);
    }
    pair.full_normal_mass[lane] = 1.0 / inv_mass;
    pair.full_tangent_mass[lane] = 1.0 / (inv_mass + turn);
    let (first, other) = (prepared.surface(pair.first), prepared.surface(pair.met.other));
    [pair.friction[lane], pair.restitution[lane]] = prepared.rules.of_contact(first, other);
}

/// Puts a piece of a static into a lane.
pub fn fill_static(fixed: &mut StaticLanes, lane: usize, piece: Piece) {
    fixed.radius[lane] = 0.0;
    match (&mut fixed.core, piece) {
        (Core::Plane { nx, ny, offset }, Piece::HalfPlane { normal, offset: own }) => {
            (nx[lane], ny[lane], offset[lane]) = (normal[0], normal[1], own);
        }
        (Core::Point { x, y }, Piece::Convex(c)) => {
            fixed.radius[lane] = c.radius;
            (x[lane], y[lane]) = (c.points[0][0], c.points[0][1]);
        }
        (Core::Polygon(edges), Piece::Convex(c)) => {
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

fn fill_term<L: ?Sized + 'static>(term: &mut TermLanes<L>, lane: usize, constants: &Constants) {
    for (row, value) in term.constants.iter_mut().zip(constants) {
        row[lane] = *value;
    }
}

/// Chipmunk's slop of 0.1 m is made for bodies of ordinary size. Smaller bodies get less, falling with the
/// square of the size, so that a ball of 4 cm sinks in by half a millimetre and not by its whole radius.
fn slop(prepared: &Prepared) -> f64 {
    prepared.bodies[..prepared.own[0]].iter().map(slop_with).fold(f64::INFINITY, f64::min)
}

/// The slop, m, if this is the smallest body.
pub fn slop_with(body: &PreparedBody) -> f64 {
    let smallest = 2.0 * inner_radius(body);
    let share = (smallest / ORDINARY).min(1.0);
    SLOP * share * share
}
