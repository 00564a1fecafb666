//! Continuous collision detection against statics, so that fast bodies do not tunnel.
//!
//! Chipmunk detects contacts only at the end of a step, so a ping-pong ball at 10 m/s passes through a table.
//! Here a disc that moves more than half its radius in a step is stopped where it first penetrates a static,
//! with its velocity kept; the solver then treats the contact as usual. The remaining displacement of the
//! step is lost, an error of at most one step's time, and only at such speeds. Discs may still tunnel through
//! each other.
//!
//! Of other bodies the inscribed discs of their pieces are tested: the end of a long piece may still pass, as
//! in Chipmunk; and a body that moves farther in a step than its width is stopped, but may end up on either
//! side.

use super::outline::{BodyFrame, PieceOutline};
use super::state::{BatchState, BodyLanes, EdgeLanes, StaticCore, StaticLanes};
use crate::world::effect::LANES;

/// Displacement per radius and step up to which a disc is not tested: the next contact then still finds its
/// centre on the right side.
pub const MIN_CCD_TRAVEL_PER_RADIUS: f64 = 0.5;
/// Distance, as a fraction of both radii, at which the disc is stopped: slightly less than 1, so that it
/// touches.
const STOP_DISTANCE_PER_RADIUS: f64 = 0.9;

/// The same for inscribed discs: a disc within the first distance is stopped at the next. After a hit at a
/// corner the body rotates, and its centre may continue for a step or two.
const STOP_DISTANCES_PER_RADIUS: [f64; 4] = [STOP_DISTANCE_PER_RADIUS, 0.5, 0.25, 0.1];

/// Minimum displacement per radius into a static for a stop. Less cannot move the centre inside, and rounding
/// errors must not stop a disc that slides along a wall.
const MIN_CCD_DEPTH_PER_RADIUS: f64 = 0.25;
/// Relative tolerance of the stop distance: a disc at its stop distance counts as within it, so that the
/// contact solver handles it from then on. Without it a disc pressed into a corner by a heavier one was
/// stopped in every step, but not in the mirrored scene.
const CCD_MARGIN_TOLERANCE: f64 = 1e-9;

/// Stops bodies that would penetrate or pass a static; called after positions have advanced.
#[cold]
pub fn stop_fast_bodies(state: &mut BatchState) {
    let BatchState { bodies, frames, outlines, statics, .. } = state;
    for (i, body) in bodies.iter_mut().enumerate().filter(|(_, b)| b.fast) {
        match frames.get(i).filter(|frame| !frame.disc) {
            None => stop_disc(body, statics),
            Some(frame) => stop_pieces(body, frame, &outlines[frame.outlines[0]..frame.outlines[1]], statics),
        }
    }
}

fn stop_disc(body: &mut BodyLanes, statics: &[StaticLanes]) {
    for lane in (0..LANES).filter(|l| body.radius[*l] > 0.0) {
        let displacement = [body.displacement_x[lane], body.displacement_y[lane]];
        let from = [body.moving.x[lane] - displacement[0], body.moving.y[lane] - displacement[1]];
        let fraction =
            free_fraction(statics, lane, from, displacement, body.radius[lane], STOP_DISTANCE_PER_RADIUS);
        if fraction < 1.0 {
            body.moving.x[lane] = from[0] + displacement[0] * fraction;
            body.moving.y[lane] = from[1] + displacement[1] * fraction;
        }
    }
}

/// A body moves as far as its inscribed discs can, each along the line from its old to its new position.
fn stop_pieces(body: &mut BodyLanes, frame: &BodyFrame, pieces: &[PieceOutline], statics: &[StaticLanes]) {
    for lane in (0..LANES).filter(|l| body.radius[*l] > 0.0) {
        let (displacement, turned) =
            ([body.displacement_x[lane], body.displacement_y[lane]], frame.turned_by[lane]);
        let (to, angle) = ([body.moving.x[lane], body.moving.y[lane]], body.angle[lane]);
        let from = [to[0] - displacement[0], to[1] - displacement[1]];
        let arm = |piece: &PieceOutline, angle: f64| {
            let ([x, y], (sine, cosine)) =
                ([piece.middle[0][lane], piece.middle[1][lane]], libm::sincos(angle));
            [cosine * x - sine * y, sine * x + cosine * y]
        };
        let mut fraction = 1.0f64;
        for piece in pieces {
            let (old, new) = (arm(piece, angle - turned), arm(piece, angle));
            let start = [from[0] + old[0], from[1] + old[1]];
            let own = [displacement[0] + new[0] - old[0], displacement[1] + new[1] - old[1]];
            for stop_distance in STOP_DISTANCES_PER_RADIUS {
                fraction =
                    fraction.min(free_fraction(statics, lane, start, own, piece.inner[lane], stop_distance));
            }
        }
        if fraction < 1.0 {
            body.moving.x[lane] = from[0] + displacement[0] * fraction;
            body.moving.y[lane] = from[1] + displacement[1] * fraction;
            body.angle[lane] = angle - turned * (1.0 - fraction);
        }
    }
}

/// Fraction of its displacement that a disc may move before a static is within a fraction of both radii; 1 if
/// it is slow.
fn free_fraction(
    statics: &[StaticLanes],
    lane: usize,
    from: [f64; 2],
    displacement: [f64; 2],
    radius: f64,
    stop_distance: f64,
) -> f64 {
    if displacement[0].abs() + displacement[1].abs() <= MIN_CCD_TRAVEL_PER_RADIUS * radius {
        return 1.0;
    }
    let min_depth = MIN_CCD_DEPTH_PER_RADIUS * radius;
    let mut fraction = 1.0f64;
    for fixed in statics {
        let margin = stop_distance * (radius + fixed.radius[lane]);
        let hit = match &fixed.core {
            // An object inside a half plane is detected there at any depth.
            StaticCore::Plane { .. } => None,
            StaticCore::Point { x, y } => {
                into_disc([from[0] - x[lane], from[1] - y[lane]], displacement, margin, min_depth)
            }
            StaticCore::Polygon(edges) => into_polygon(edges, lane, from, displacement, margin, min_depth),
        };
        fraction = fraction.min(hit.unwrap_or(1.0));
    }
    fraction
}

/// Fraction of the displacement after which a point that enters fast enough is within `margin` of the origin.
fn into_disc(from: [f64; 2], displacement: [f64; 2], margin: f64, min_depth: f64) -> Option<f64> {
    let outside = dot(from, from) - margin * margin;
    let (along, displacement2) = (dot(from, displacement), dot(displacement, displacement));
    let root = along * along - displacement2 * outside;
    if outside <= CCD_MARGIN_TOLERANCE * margin * margin || along >= 0.0 || root <= 0.0 {
        return None;
    }
    let fraction = (-along - root.sqrt()) / displacement2;
    // The displacement towards the origin at the point of entry.
    let inward = root.sqrt() / margin;
    (fraction < 1.0 && inward > min_depth).then_some(fraction)
}

/// The same for a convex polygon: its faces moved out by `margin`, and a disc of that radius about each
/// corner.
fn into_polygon(
    edges: &[EdgeLanes],
    lane: usize,
    from: [f64; 2],
    displacement: [f64; 2],
    margin: f64,
    min_depth: f64,
) -> Option<f64> {
    let face = |e: &EdgeLanes| {
        let normal = [e.nx[lane], e.ny[lane]];
        let offset = [from[0] - e.ax[lane], from[1] - e.ay[lane]];
        let (height, inward) = (dot(normal, offset) - margin, -dot(normal, displacement));
        if height <= CCD_MARGIN_TOLERANCE * margin || inward <= min_depth || height >= inward {
            return None;
        }
        let fraction = height / inward;
        let along = |v: [f64; 2]| normal[0] * v[1] - normal[1] * v[0];
        (0.0..=e.length[lane]).contains(&(along(offset) + fraction * along(displacement))).then_some(fraction)
    };
    let corner = |e: &EdgeLanes| {
        into_disc([from[0] - e.ax[lane], from[1] - e.ay[lane]], displacement, margin, min_depth)
    };
    edges.iter().flat_map(|e| [face(e), corner(e)]).flatten().reduce(f64::min)
}

fn dot(a: [f64; 2], b: [f64; 2]) -> f64 {
    a[0] * b[0] + a[1] * b[1]
}
