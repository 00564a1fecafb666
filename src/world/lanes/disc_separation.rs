//! Separation of a disc from another disc or a static, for all lanes at once.
//!
//! A static is a convex core inflated by a radius. For a core with corners, the edge whose line has the
//! largest signed distance to the point is, or is adjacent to, the feature nearest to the point (its normal
//! has the smallest angle with the direction to the point), so one pass over the edges and a test of both
//! ends of the best edge find the nearest face or corner, or, for a point inside the core, the face with the
//! smallest penetration depth.

use super::simd::{Mask, Register, V, Wide};
use super::state::{BodyLanes, StaticCore, StaticLanes};

/// Separation of two objects (m, negative for overlap) and the unit normal: from the first disc to the
/// second, or from the static to the disc.
#[derive(Clone, Copy)]
pub struct DiscSeparation<R, const N: usize> {
    pub separation: Wide<R, N>,
    pub nx: Wide<R, N>,
    pub ny: Wide<R, N>,
}

/// Two discs.
#[inline(always)]
pub fn between_discs<R: Register, const N: usize>(a: &BodyLanes, b: &BodyLanes) -> DiscSeparation<R, N> {
    between_points(
        [Wide::load(&a.moving.x), Wide::load(&a.moving.y)],
        [Wide::load(&b.moving.x), Wide::load(&b.moving.y)],
        Wide::load(&a.radius) + Wide::load(&b.radius),
    )
}

/// A disc and a static.
#[inline(always)]
pub fn with_static<R: Register, const N: usize>(
    disc: &BodyLanes,
    fixed: &StaticLanes,
) -> DiscSeparation<R, N> {
    let (x, y) = (Wide::load(&disc.moving.x), Wide::load(&disc.moving.y));
    let radii = Wide::load(&disc.radius) + Wide::load(&fixed.radius);
    match &fixed.core {
        StaticCore::Plane { nx, ny, offset } => {
            let (nx, ny) = (Wide::load(nx), Wide::load(ny));
            DiscSeparation { separation: nx * x + ny * y - Wide::load(offset) - radii, nx, ny }
        }
        StaticCore::Point { x: px, y: py } => between_points([Wide::load(px), Wide::load(py)], [x, y], radii),
        StaticCore::Polygon(edges) => {
            let mut best = Wide::all(f64::NEG_INFINITY);
            let [mut nx, mut ny, mut dx, mut dy, mut length] = [Wide::<R, N>::all(0.0); 5];
            for e in edges {
                let (ex, ey) = (Wide::load(&e.nx), Wide::load(&e.ny));
                let (px, py) = (x - Wide::load(&e.ax), y - Wide::load(&e.ay));
                let height = ex * px + ey * py;
                let better = best.less(height);
                best = better.select(height, best);
                nx = better.select(ex, nx);
                ny = better.select(ey, ny);
                dx = better.select(px, dx);
                dy = better.select(py, dy);
                length = better.select(Wide::load(&e.length), length);
            }
            let none = Wide::all(0.0);
            let along = dy * nx - dx * ny;
            let beyond = length.less(along);
            let corner = none.at_most(best).and(along.less(none).or(beyond));
            let face = DiscSeparation { separation: best - radii, nx, ny };
            if !corner.any() {
                return face;
            }
            let reach = beyond.select(length, none);
            let (dx, dy) = (dx + reach * ny, dy - reach * nx);
            let rounded = from_offset(dx, dy, radii);
            DiscSeparation {
                separation: corner.select(rounded.separation, face.separation),
                nx: corner.select(rounded.nx, nx),
                ny: corner.select(rounded.ny, ny),
            }
        }
    }
}

/// Whether both bodies together may have travelled as far as their last distance, in any lane.
#[inline(always)]
pub fn may_touch<R: Register, const N: usize>(limit: &V, travel: Wide<R, N>) -> bool {
    let due: Mask<R, N> = Wide::load(limit).at_most(travel);
    due.any()
}

#[inline(always)]
fn between_points<R: Register, const N: usize>(
    from: [Wide<R, N>; 2],
    to: [Wide<R, N>; 2],
    radii: Wide<R, N>,
) -> DiscSeparation<R, N> {
    from_offset(to[0] - from[0], to[1] - from[1], radii)
}

#[inline(always)]
fn from_offset<R: Register, const N: usize>(
    dx: Wide<R, N>,
    dy: Wide<R, N>,
    radii: Wide<R, N>,
) -> DiscSeparation<R, N> {
    let distance = (dx * dx + dy * dy).sqrt();
    let (none, one) = (Wide::all(0.0), Wide::all(1.0));
    let apart = none.less(distance);
    let scale = one.div(apart.select(distance, one));
    // Concentric objects separate along x, as in Chipmunk.
    DiscSeparation { separation: distance - radii, nx: apart.select(dx * scale, one), ny: dy * scale }
}
