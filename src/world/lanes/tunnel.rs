//! Keeping what is fast from passing through statics between two steps.
//!
//! Chipmunk looks for contacts only where bodies stand at the end of a step, so a ping-pong ball at 10 m/s flies
//! through a table. Here a disc that moves more than half its radius in a step is stopped where it first dips
//! into a static, keeping its speed; the contact then treats it as any other. What is left of the step is lost to
//! it, an error of at most one step's time, and only at such speeds. Discs may still pass through each other.
//!
//! Of other bodies the discs within their pieces are stopped, the body with them: what only the end of a long piece would meet is
//! passed, as in Chipmunk; and what moves farther in a step than it is wide is met, but may come out on either side.

use super::outline::{Frame, Outline};
use super::state::{BodyLanes, Core, EdgeLanes, State, StaticLanes};
use crate::world::effect::LANES;

/// Share of its radius that a disc may move in a step without being watched: the next contact then still finds
/// its centre on the right side.
pub const WATCHED: f64 = 0.5;
/// Share of both radii at which the disc is stopped: a little less than 1, so that it touches.
const STOPPED: f64 = 0.9;

/// The same for a disc within a body that is none: one that is within the first is stopped at the next. What is hit at a corner turns, and
/// its middle may go on as before for a step or two.
const NEARER: [f64; 4] = [STOPPED, 0.5, 0.25, 0.1];

/// Share of its radius that a disc must move into a static in a step to be stopped. Less than that cannot take its
/// centre in, and a disc that slides along a wall must not be held up by what rounds off.
const DEEP: f64 = 0.25;
/// Share of a margin by which what stands at it counts as within: where a disc was stopped it stands, whichever way that was rounded, and
/// from there on contacts have it. (One that a heavier disc pressed into a corner was held up step after step, its mirror image was not.)
const STANDS: f64 = 1e-9;

/// Stops what would pass into or through a static; called after positions have advanced.
#[cold]
pub fn stop_what_is_fast(state: &mut State) {
    let State { bodies, frames, outlines, statics, .. } = state;
    for (i, body) in bodies.iter_mut().enumerate().filter(|(_, b)| b.fast) {
        match frames.get(i).filter(|frame| !frame.disc) {
            None => stop_disc(body, statics),
            Some(frame) => stop_pieces(body, frame, &outlines[frame.outlines[0]..frame.outlines[1]], statics),
        }
    }
}

fn stop_disc(body: &mut BodyLanes, statics: &[StaticLanes]) {
    for lane in (0..LANES).filter(|l| body.radius[*l] > 0.0) {
        let way = [body.way_x[lane], body.way_y[lane]];
        let from = [body.moving.x[lane] - way[0], body.moving.y[lane] - way[1]];
        let share = free_share(statics, lane, from, way, body.radius[lane], STOPPED);
        if share < 1.0 {
            body.moving.x[lane] = from[0] + way[0] * share;
            body.moving.y[lane] = from[1] + way[1] * share;
        }
    }
}

/// A body goes as far as the discs within its pieces do, each along the line from where it was to where it would be.
fn stop_pieces(body: &mut BodyLanes, frame: &Frame, pieces: &[Outline], statics: &[StaticLanes]) {
    for lane in (0..LANES).filter(|l| body.radius[*l] > 0.0) {
        let (way, turned) = ([body.way_x[lane], body.way_y[lane]], frame.turned_by[lane]);
        let (to, angle) = ([body.moving.x[lane], body.moving.y[lane]], body.angle[lane]);
        let from = [to[0] - way[0], to[1] - way[1]];
        let arm = |piece: &Outline, angle: f64| {
            let ([x, y], (sine, cosine)) =
                ([piece.middle[0][lane], piece.middle[1][lane]], libm::sincos(angle));
            [cosine * x - sine * y, sine * x + cosine * y]
        };
        let mut share = 1.0f64;
        for piece in pieces {
            let (old, new) = (arm(piece, angle - turned), arm(piece, angle));
            let start = [from[0] + old[0], from[1] + old[1]];
            let own = [way[0] + new[0] - old[0], way[1] + new[1] - old[1]];
            for near in NEARER {
                share = share.min(free_share(statics, lane, start, own, piece.inner[lane], near));
            }
        }
        if share < 1.0 {
            body.moving.x[lane] = from[0] + way[0] * share;
            body.moving.y[lane] = from[1] + way[1] * share;
            body.angle[lane] = angle - turned * (1.0 - share);
        }
    }
}

/// Share of its way that a disc may go before a static is within a share of both radii; all of it if it is slow.
fn free_share(
    statics: &[StaticLanes],
    lane: usize,
    from: [f64; 2],
    way: [f64; 2],
    radius: f64,
    near: f64,
) -> f64 {
    if way[0].abs() + way[1].abs() <= WATCHED * radius {
        return 1.0;
    }
    let least = DEEP * radius;
    let mut share = 1.0f64;
    for fixed in statics {
        let margin = near * (radius + fixed.radius[lane]);
        let hit = match &fixed.core {
            // Whatever passes into a half plane is found within it.
            Core::Plane { .. } => None,
            Core::Point { x, y } => into_disc([from[0] - x[lane], from[1] - y[lane]], way, margin, least),
            Core::Polygon(edges) => into_polygon(edges, lane, from, way, margin, least),
        };
        share = share.min(hit.unwrap_or(1.0));
    }
    share
}

/// Share of the way after which a point, coming in fast enough to matter, is within `margin` of the origin.
fn into_disc(from: [f64; 2], way: [f64; 2], margin: f64, least: f64) -> Option<f64> {
    let outside = dot(from, from) - margin * margin;
    let (along, way2) = (dot(from, way), dot(way, way));
    let root = along * along - way2 * outside;
    if outside <= STANDS * margin * margin || along >= 0.0 || root <= 0.0 {
        return None;
    }
    let share = (-along - root.sqrt()) / way2;
    // The part of the way that points at the origin, where the point comes within the margin.
    let inward = root.sqrt() / margin;
    (share < 1.0 && inward > least).then_some(share)
}

/// The same for a convex polygon: the faces moved out by `margin`, and a disc of that radius about each corner.
fn into_polygon(
    edges: &[EdgeLanes],
    lane: usize,
    from: [f64; 2],
    way: [f64; 2],
    margin: f64,
    least: f64,
) -> Option<f64> {
    let face = |e: &EdgeLanes| {
        let normal = [e.nx[lane], e.ny[lane]];
        let offset = [from[0] - e.ax[lane], from[1] - e.ay[lane]];
        let (height, inward) = (dot(normal, offset) - margin, -dot(normal, way));
        if height <= STANDS * margin || inward <= least || height >= inward {
            return None;
        }
        let share = height / inward;
        let along = |v: [f64; 2]| normal[0] * v[1] - normal[1] * v[0];
        (0.0..=e.length[lane]).contains(&(along(offset) + share * along(way))).then_some(share)
    };
    let corner = |e: &EdgeLanes| into_disc([from[0] - e.ax[lane], from[1] - e.ay[lane]], way, margin, least);
    edges.iter().flat_map(|e| [face(e), corner(e)]).flatten().reduce(f64::min)
}

fn dot(a: [f64; 2], b: [f64; 2]) -> f64 {
    a[0] * b[0] + a[1] * b[1]
}
