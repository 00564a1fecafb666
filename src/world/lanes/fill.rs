//! Putting a rollout into a lane, and leaving a lane empty.

use super::outline::{self, disc_within};
use super::piece::{Piece, pieces};
use super::state::{Core, NOTHING, Pair, State, StaticLanes, TermLanes};
use super::touching::NEVER_TOUCHED;
use crate::world::effect::{Constants, MOST_PARAMETERS};
use crate::world::prepare::{Prepared, PreparedBody};

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
        for (i, (body, own)) in self.bodies.iter_mut().zip(&prepared.bodies).enumerate() {
            let arm = self.frames.get(i).map_or([0.0; 2], |f| f.arm(lane, own.angle));
            // Adding 0 turns -0 into 0: see `kernel::push`.
            body.moving.x[lane] = own.position[0] + arm[0] + 0.0;
            body.moving.y[lane] = own.position[1] + arm[1] + 0.0;
            body.moving.vx[lane] = own.velocity[0] - own.omega * arm[1] + 0.0;
            body.moving.vy[lane] = own.velocity[1] + own.omega * arm[0] + 0.0;
            body.moving.omega[lane] = own.omega + 0.0;
            body.angle[lane] = own.angle + 0.0;
            body.bias_x[lane] = 0.0;
            body.bias_y[lane] = 0.0;
            body.radius[lane] = inner_radius(own);
            body.inv_mass[lane] = 1.0 / own.mass;
            body.spin_per_impulse[lane] = inner_radius(own) / own.inertia;
            body.travel[lane] = 0.0;
            body.carried[lane] = 0.0;
            body.rolling[lane] = 0.0;
        }
        for (fixed, (_, own)) in self.statics.iter_mut().zip(pieces(prepared)) {
            fill_static(fixed, lane, own);
        }
        for pair in &mut self.pairs {
            fill_pair(pair, lane, prepared);
        }
        self.fill_near(lane, prepared);
        for (term, (_, constants)) in self.motions.iter_mut().zip(&prepared.motions) {
            fill_term(term, lane, constants);
        }
        for (term, (_, constants)) in self.touches.iter_mut().zip(&prepared.touches) {
            fill_term(term, lane, constants);
        }
    }

    /// Pairs of outlines begin anew, without contacts.
    fn fill_near(&mut self, lane: usize, prepared: &Prepared) {
        let surface = |i: usize| match prepared.bodies.get(i) {
            Some(body) => [body.friction, body.restitution],
            None => {
                let fixed = &prepared.statics[i - prepared.bodies.len()];
                [fixed.friction, fixed.restitution]
            }
        };
        for near in &mut self.near {
            let [friction, restitution] =
                prepared.rules.of_contact(surface(near.met.first), surface(near.met.other));
            near.fill(lane, NEVER_TOUCHED, friction, restitution);
        }
        for manifold in &mut self.manifolds {
            manifold.clear(lane);
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
            near.fill(lane, f64::INFINITY, 0.0, 0.0);
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
    let count = prepared.bodies.len();
    let a = &prepared.bodies[pair.first];
    let looseness = |i: usize| {
        let b = &prepared.bodies[i];
        let radius = inner_radius(b);
        (1.0 / b.mass, radius * radius / b.inertia)
    };
    let (mut inv_mass, mut turn) = looseness(pair.first);
    let theirs = if pair.second < count {
        let (m, t) = looseness(pair.second);
        (inv_mass, turn) = (inv_mass + m, turn + t);
        [prepared.bodies[pair.second].friction, prepared.bodies[pair.second].restitution]
    } else {
        let fixed = &prepared.statics[pair.met.other - count];
        [fixed.friction, fixed.restitution]
    };
    pair.limit[lane] = NEVER_TOUCHED;
    (pair.jn[lane], pair.jt[lane]) = (0.0, 0.0);
    pair.full_normal_mass[lane] = 1.0 / inv_mass;
    pair.full_tangent_mass[lane] = 1.0 / (inv_mass + turn);
    [pair.friction[lane], pair.restitution[lane]] =
        prepared.rules.of_contact([a.friction, a.restitution], theirs);
    pair.met.last_touch[lane] = NEVER_TOUCHED;
}

fn fill_static(fixed: &mut StaticLanes, lane: usize, piece: Piece) {
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
    let smallest = prepared.bodies.iter().map(|b| 2.0 * inner_radius(b)).fold(f64::INFINITY, f64::min);
    let share = (smallest / ORDINARY).min(1.0);
    SLOP * share * share
}
