//! Keeping fast discs from passing through statics between two steps.
//!
//! Chipmunk looks for contacts only where bodies stand at the end of a step, so a ping-pong ball at 10 m/s flies
//! through a table. Here a disc that moves more than half its radius in a step is stopped where it first dips
//! into a static, keeping its speed; the contact then treats it as any other. What is left of the step is lost to
//! it, an error of at most one step's time, and only at such speeds. Discs may still pass through each other.

use super::batch::{Batch, Core, EdgeLanes};
use crate::world::effect::LANES;

/// Share of its radius that a disc may move in a step without being watched: the next contact then still finds
/// its centre on the right side.
pub const WATCHED: f64 = 0.5;
/// Share of both radii at which the disc is stopped: a little less than 1, so that it touches.
const STOPPED: f64 = 0.9;

/// Stops the discs that would pass into or through a static; called after positions have advanced.
#[cold]
pub fn stop_fast_discs(batch: &mut Batch) {
    for body in batch.bodies.iter_mut().filter(|b| b.fast) {
        for lane in 0..LANES {
            let way = [body.way_x[lane], body.way_y[lane]];
            if way[0].abs() + way[1].abs() <= WATCHED * body.radius[lane] || body.radius[lane] < 0.0 {
                continue;
            }
            let to = [body.moving.x[lane], body.moving.y[lane]];
            let from = [to[0] - way[0], to[1] - way[1]];
            let mut share = 1.0f64;
            for fixed in &batch.statics {
                let margin = STOPPED * (body.radius[lane] + fixed.radius[lane]);
                let hit = match &fixed.core {
                    // Whatever passes into a half plane is found within it.
                    Core::Plane { .. } => None,
                    Core::Point { x, y } => into_disc([from[0] - x[lane], from[1] - y[lane]], way, margin),
                    Core::Polygon(edges) => into_polygon(edges, lane, from, way, margin),
                };
                share = share.min(hit.unwrap_or(1.0));
            }
            if share < 1.0 {
                body.moving.x[lane] = from[0] + way[0] * share;
                body.moving.y[lane] = from[1] + way[1] * share;
            }
        }
    }
}

/// Share of the way after which a point comes within `radius` of the origin.
fn into_disc(from: [f64; 2], way: [f64; 2], radius: f64) -> Option<f64> {
    let outside = from[0] * from[0] + from[1] * from[1] - radius * radius;
    let along = from[0] * way[0] + from[1] * way[1];
    let way2 = way[0] * way[0] + way[1] * way[1];
    let root = along * along - way2 * outside;
    (outside > 0.0 && along < 0.0 && root >= 0.0).then(|| (-along - root.sqrt()) / way2).filter(|t| *t < 1.0)
}

/// Share of the way after which a point comes into a convex polygon whose edges are moved out by `margin`.
fn into_polygon(edges: &[EdgeLanes], lane: usize, from: [f64; 2], way: [f64; 2], margin: f64) -> Option<f64> {
    let (mut enter, mut leave) = (f64::NEG_INFINITY, f64::INFINITY);
    let mut clip = |height: f64, rise: f64| {
        if rise < 0.0 {
            enter = enter.max(-height / rise);
        } else if rise > 0.0 {
            leave = leave.min(-height / rise);
        } else if height > 0.0 {
            leave = f64::NEG_INFINITY;
        }
    };
    for e in edges {
        let (nx, ny) = (e.nx[lane], e.ny[lane]);
        let (dx, dy) = (from[0] - e.ax[lane], from[1] - e.ay[lane]);
        clip(nx * dx + ny * dy - margin, nx * way[0] + ny * way[1]);
        if edges.len() == 2 {
            // A segment's two sides leave its ends open: each side closes the end it runs to.
            clip(nx * dy - ny * dx - e.length[lane] - margin, nx * way[1] - ny * way[0]);
        }
    }
    (enter >= 0.0 && enter < leave && enter < 1.0).then_some(enter)
}
