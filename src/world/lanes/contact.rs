//! Where a disc and something else come closest, for every lane at once.
//!
//! A static is a convex core inflated by a radius. Of a convex core with corners, the edge whose line lies
//! farthest below the point is, or is next to, the feature nearest to the point (its normal makes the smallest
//! angle with the direction to the point), so one pass over the edges and one look at the two ends of the best
//! edge find it: face, corner, or, for a point within the core, the way out that is shortest.

use super::batch::{BodyLanes, Core, Pair, StaticLanes, V};
use crate::world::effect::LANES;

/// Fills in separation and normal (from the first disc to the second).
#[inline(always)]
pub fn between_discs(a: &BodyLanes, b: &BodyLanes, pair: &mut Pair) {
    for l in 0..LANES {
        let dx = b.moving.x[l] - a.moving.x[l];
        let dy = b.moving.y[l] - a.moving.y[l];
        let distance = (dx * dx + dy * dy).sqrt();
        let apart = distance > 0.0;
        let scale = 1.0 / if apart { distance } else { 1.0 };
        pair.separation[l] = distance - (a.radius[l] + b.radius[l]);
        // Concentric discs part along x, as in Chipmunk.
        pair.nx[l] = if apart { dx * scale } else { 1.0 };
        pair.ny[l] = dy * scale;
    }
}

/// Fills in separation and normal (from the static to the disc).
#[inline(always)]
pub fn with_static(disc: &BodyLanes, fixed: &StaticLanes, pair: &mut Pair) {
    match &fixed.core {
        Core::Plane { nx, ny, offset } => {
            for l in 0..LANES {
                let height = nx[l] * disc.moving.x[l] + ny[l] * disc.moving.y[l] - offset[l];
                pair.separation[l] = height - disc.radius[l];
                pair.nx[l] = nx[l];
                pair.ny[l] = ny[l];
            }
        }
        Core::Point { x, y } => {
            for l in 0..LANES {
                let dx = disc.moving.x[l] - x[l];
                let dy = disc.moving.y[l] - y[l];
                let distance = (dx * dx + dy * dy).sqrt();
                let apart = distance > 0.0;
                let scale = 1.0 / if apart { distance } else { 1.0 };
                pair.separation[l] = distance - (disc.radius[l] + fixed.radius[l]);
                pair.nx[l] = if apart { dx * scale } else { 1.0 };
                pair.ny[l] = dy * scale;
            }
        }
        Core::Polygon(edges) => {
            let mut best: V = [f64::NEG_INFINITY; LANES];
            let (mut nx, mut ny, mut ax, mut ay, mut length) =
                ([0.0; LANES], [0.0; LANES], [0.0; LANES], [0.0; LANES], [0.0; LANES]);
            for e in edges {
                for l in 0..LANES {
                    let height =
                        e.nx[l] * (disc.moving.x[l] - e.ax[l]) + e.ny[l] * (disc.moving.y[l] - e.ay[l]);
                    let better = height > best[l];
                    best[l] = if better { height } else { best[l] };
                    nx[l] = if better { e.nx[l] } else { nx[l] };
                    ny[l] = if better { e.ny[l] } else { ny[l] };
                    ax[l] = if better { e.ax[l] } else { ax[l] };
                    ay[l] = if better { e.ay[l] } else { ay[l] };
                    length[l] = if better { e.length[l] } else { length[l] };
                }
            }
            // Vector from the corner to the disc where the corner is nearest.
            let (mut dx, mut dy, mut corner) = ([0.0; LANES], [0.0; LANES], [0.0; LANES]);
            let mut corners = 0.0;
            for l in 0..LANES {
                let (x, y) = (disc.moving.x[l] - ax[l], disc.moving.y[l] - ay[l]);
                let along = y * nx[l] - x * ny[l];
                let beyond = along > length[l];
                let at_corner = (best[l] > 0.0) & ((along < 0.0) | beyond);
                let reach = if beyond { length[l] } else { 0.0 };
                dx[l] = x + reach * ny[l];
                dy[l] = y - reach * nx[l];
                corner[l] = if at_corner { 1.0 } else { 0.0 };
                corners += corner[l];
            }
            for l in 0..LANES {
                pair.separation[l] = best[l] - (disc.radius[l] + fixed.radius[l]);
                pair.nx[l] = nx[l];
                pair.ny[l] = ny[l];
            }
            if corners > 0.0 {
                for l in 0..LANES {
                    let at_corner = corner[l] > 0.0;
                    let distance = (dx[l] * dx[l] + dy[l] * dy[l]).sqrt();
                    let scale = 1.0 / if at_corner { distance } else { 1.0 };
                    let separation = distance - (disc.radius[l] + fixed.radius[l]);
                    pair.separation[l] = if at_corner { separation } else { pair.separation[l] };
                    pair.nx[l] = if at_corner { dx[l] * scale } else { pair.nx[l] };
                    pair.ny[l] = if at_corner { dy[l] * scale } else { pair.ny[l] };
                }
            }
        }
    }
}
