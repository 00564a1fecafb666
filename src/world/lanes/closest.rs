//! Where two convex outlines come closest, and the two points at which they touch, for every lane at once.
//!
//! Source: separating axes of convex polygons (Ericson, "Real-Time Collision Detection", 2005, section 5.2; Gregorius, GDC 2013):
//! of all directions, a normal of an edge or the line between two corners separates most; where the two overlap, a
//! normal. Then the edges that face each other along that direction, and the ends of what they have in common
//! (Chipmunk2D, `cpCollision.c`), each as a point of either.
//!
//! Differences from the source: no search (GJK, EPA), every edge is looked at, so that lanes stay in step.

use super::outline::{Corner, Outline, OutlineCore};
use super::simd::{Register, Wide};

/// How far two outlines are apart (m, negative for overlap) and the unit normal from the first to the second.
#[derive(Clone, Copy)]
pub struct Closest<R, const N: usize> {
    pub separation: Wide<R, N>,
    pub nx: Wide<R, N>,
    pub ny: Wide<R, N>,
}

/// Where two outlines may push each other.
#[derive(Clone, Copy)]
pub struct Place<R, const N: usize> {
    /// On the first, and on the second, world frame, m.
    pub first: [Wide<R, N>; 2],
    pub second: [Wide<R, N>; 2],
    /// From the first to the second along the normal, m.
    pub gap: Wide<R, N>,
    /// Which corners it is made of: the same from step to step while they are.
    pub id: Wide<R, N>,
}

/// Where two outlines come closest. Up to a gap of `reach` it is the true distance; beyond, between corners, less than it.
#[inline(always)]
pub fn closest<R: Register, const N: usize>(
    first: &Outline,
    second: &Outline,
    reach: Wide<R, N>,
) -> Closest<R, N> {
    let radii = Wide::load(&first.radius) + Wide::load(&second.radius);
    let (a, b) = match (&first.core, &second.core) {
        (OutlineCore::Corners { here: a, .. }, OutlineCore::Corners { here: b, .. }) => (a, b),
        (OutlineCore::Corners { here, .. }, OutlineCore::Plane { nx, ny, offset }) => {
            let (nx, ny) = (Wide::load(nx), Wide::load(ny));
            let separation = lowest(here, nx, ny) - Wide::load(offset) - radii;
            return Closest { separation, nx: nx.minus(), ny: ny.minus() };
        }
        // Planes are statics, and statics are second.
        (OutlineCore::Plane { .. }, _) => {
            let none = Wide::all(0.0);
            return Closest { separation: Wide::all(f64::INFINITY), nx: none, ny: none };
        }
    };
    let none = Wide::all(0.0);
    let start = Wide::all(f64::NEG_INFINITY);
    let mut best = Closest { separation: start, nx: none, ny: none };
    if a.len() > 1 {
        over_edges(&mut best, a, b, false);
    }
    if b.len() > 1 {
        over_edges(&mut best, b, a, true);
    }
    // Only where cores are apart can corners matter, and only where that is near does it. Normals do not tell how far cores without an
    // inside are apart that lie on one line.
    let flat = a.len() <= 2 && b.len() <= 2;
    let apart = none.less(best.separation).and(best.separation.at_most(reach + radii));
    if flat || apart.any() {
        let corners = between_corners(a, b);
        let better = best.separation.less(corners.separation);
        let better = if flat { better } else { better.and(apart) };
        best = Closest {
            separation: better.select(corners.separation, best.separation),
            nx: better.select(corners.nx, best.nx),
            ny: better.select(corners.ny, best.ny),
        };
    }
    Closest { separation: best.separation - radii, ..best }
}

/// The places at which two outlines may push each other along a normal: two, or one where one of them is a disc.
#[inline(always)]
pub fn places<R: Register, const N: usize>(
    first: &Outline,
    second: &Outline,
    normal: Closest<R, N>,
) -> ([Place<R, N>; 2], usize) {
    let OutlineCore::Corners { here: a, .. } = &first.core else { unreachable!("a plane is never first") };
    let (nx, ny) = (normal.nx, normal.ny);
    let (ra, rb) = (Wide::load(&first.radius), Wide::load(&second.radius));
    let one = facing(a, nx, ny);
    let single = a.len() == 1;
    match &second.core {
        OutlineCore::Plane { nx: px, ny: py, offset } => {
            let (px, py, offset) = (Wide::load(px), Wide::load(py), Wide::load(offset));
            let from = above_plane(one.from, one.from_id, [nx, ny], [px, py], offset, ra);
            let to = above_plane(one.to, one.to_id, [nx, ny], [px, py], offset, ra);
            ([from, to], if single { 1 } else { 2 })
        }
        OutlineCore::Corners { here: b, .. } => {
            let other = facing(b, nx.minus(), ny.minus());
            // Along the edges, in the sense in which the first's runs.
            let ours = [along(one.from, nx, ny), along(one.to, nx, ny)];
            let theirs = [along(other.from, nx, ny), along(other.to, nx, ny)];
            let many = Wide::all(64.0);
            let (ids, radii) =
                ([one.from_id * many + other.to_id, one.to_id * many + other.from_id], [ra, rb]);
            let low =
                [between(one.from, one.to, ours, theirs[1]), between(other.from, other.to, theirs, ours[0])];
            let high =
                [between(one.from, one.to, ours, theirs[0]), between(other.from, other.to, theirs, ours[1])];
            let low = between_edges(low, ids[0], [nx, ny], radii);
            let high = between_edges(high, ids[1], [nx, ny], radii);
            ([low, high], if single || b.len() == 1 { 1 } else { 2 })
        }
    }
}

/// Coordinate across a normal.
#[inline(always)]
fn along<R: Register, const N: usize>([x, y]: [Wide<R, N>; 2], nx: Wide<R, N>, ny: Wide<R, N>) -> Wide<R, N> {
    y * nx - x * ny
}

/// Where a corner may push on a plane (of this outward normal and offset).
#[inline(always)]
fn above_plane<R: Register, const N: usize>(
    [x, y]: [Wide<R, N>; 2],
    id: Wide<R, N>,
    [nx, ny]: [Wide<R, N>; 2],
    [px, py]: [Wide<R, N>; 2],
    offset: Wide<R, N>,
    radius: Wide<R, N>,
) -> Place<R, N> {
    let gap = px * x + py * y - offset - radius;
    let first = [x + nx * radius, y + ny * radius];
    Place { first, second: [first[0] + nx * gap, first[1] + ny * gap], gap, id }
}

/// Where two points within the roundings may push each other.
#[inline(always)]
fn between_edges<R: Register, const N: usize>(
    [[x, y], [u, v]]: [[Wide<R, N>; 2]; 2],
    id: Wide<R, N>,
    [nx, ny]: [Wide<R, N>; 2],
    [ra, rb]: [Wide<R, N>; 2],
) -> Place<R, N> {
    let first = [x + nx * ra, y + ny * ra];
    let second = [u - nx * rb, v - ny * rb];
    let gap = (second[0] - first[0]) * nx + (second[1] - first[1]) * ny;
    Place { first, second, gap, id }
}

/// An edge seen no wider than this, m, is seen end on.
const END_ON: f64 = 1e-9;

/// The edge of an outline that faces a direction most.
struct Edge<R, const N: usize> {
    from: [Wide<R, N>; 2],
    to: [Wide<R, N>; 2],
    from_id: Wide<R, N>,
    to_id: Wide<R, N>,
}

#[inline(always)]
fn facing<R: Register, const N: usize>(corners: &[Corner], nx: Wide<R, N>, ny: Wide<R, N>) -> Edge<R, N> {
    let n = corners.len();
    let mut edge = Edge { from: at(&corners[0]), to: at(&corners[1 % n]), from_id: id(0), to_id: id(1 % n) };
    let mut best = nx * Wide::load(&corners[0].nx) + ny * Wide::load(&corners[0].ny);
    for (i, corner) in corners.iter().enumerate().skip(1) {
        let facing = nx * Wide::load(&corner.nx) + ny * Wide::load(&corner.ny);
        let better = best.less(facing);
        best = better.select(facing, best);
        let (from, to) = (at(corner), at(&corners[(i + 1) % n]));
        for k in 0..2 {
            edge.from[k] = better.select(from[k], edge.from[k]);
            edge.to[k] = better.select(to[k], edge.to[k]);
        }
        edge.from_id = better.select(id(i), edge.from_id);
        edge.to_id = better.select(id((i + 1) % n), edge.to_id);
    }
    if n == 2 { end_on(edge, nx, ny) } else { edge }
}

/// An edge without an outline about it, as what it is where it is seen end on: its nearer end.
#[inline(always)]
fn end_on<R: Register, const N: usize>(edge: Edge<R, N>, nx: Wide<R, N>, ny: Wide<R, N>) -> Edge<R, N> {
    let (dx, dy) = (edge.to[0] - edge.from[0], edge.to[1] - edge.from[1]);
    let seen = (dy * nx - dx * ny).size().at_most(Wide::all(END_ON));
    let farther = Wide::all(0.0).less(dx * nx + dy * ny);
    let nearer = [farther.select(edge.to[0], edge.from[0]), farther.select(edge.to[1], edge.from[1])];
    Edge {
        from: [seen.select(nearer[0], edge.from[0]), seen.select(nearer[1], edge.from[1])],
        to: [seen.select(nearer[0], edge.to[0]), seen.select(nearer[1], edge.to[1])],
        ..edge
    }
}

/// Where a corner is.
#[inline(always)]
fn at<R: Register, const N: usize>(corner: &Corner) -> [Wide<R, N>; 2] {
    [Wide::load(&corner.x), Wide::load(&corner.y)]
}

#[inline(always)]
fn id<R: Register, const N: usize>(corner: usize) -> Wide<R, N> {
    Wide::all(1.0 + corner as f64)
}

/// The point between two at which a coordinate, that of the two given, is `wanted`, or the end nearest to it.
#[inline(always)]
fn between<R: Register, const N: usize>(
    from: [Wide<R, N>; 2],
    to: [Wide<R, N>; 2],
    [a, b]: [Wide<R, N>; 2],
    wanted: Wide<R, N>,
) -> [Wide<R, N>; 2] {
    let (none, one) = (Wide::all(0.0), Wide::all(1.0));
    let width = b - a;
    // An edge seen end on has no width: either end will do.
    let some = none.less(width.size());
    let share = some.select((wanted - a).div(some.select(width, one)), none).above(none).below(one);
    [from[0] + (to[0] - from[0]) * share, from[1] + (to[1] - from[1]) * share]
}

/// Normals of the edges of `from` as directions; `reversed`: they point at the first of the two, not away from it.
#[inline(always)]
fn over_edges<R: Register, const N: usize>(
    best: &mut Closest<R, N>,
    from: &[Corner],
    to: &[Corner],
    reversed: bool,
) {
    for c in from {
        let (nx, ny) = (Wide::load(&c.nx), Wide::load(&c.ny));
        let height = lowest(to, nx, ny) - (nx * Wide::load(&c.x) + ny * Wide::load(&c.y));
        let better = best.separation.less(height);
        let (nx, ny) = if reversed { (nx.minus(), ny.minus()) } else { (nx, ny) };
        best.separation = better.select(height, best.separation);
        best.nx = better.select(nx, best.nx);
        best.ny = better.select(ny, best.ny);
    }
}

/// Least coordinate of corners along a direction.
#[inline(always)]
pub fn lowest<R: Register, const N: usize>(corners: &[Corner], nx: Wide<R, N>, ny: Wide<R, N>) -> Wide<R, N> {
    let mut low = nx * Wide::load(&corners[0].x) + ny * Wide::load(&corners[0].y);
    for c in &corners[1..] {
        low = (nx * Wide::load(&c.x) + ny * Wide::load(&c.y)).below(low);
    }
    low
}

/// The line between the two corners that are closest as a direction, and how far it separates.
#[inline(always)]
fn between_corners<R: Register, const N: usize>(a: &[Corner], b: &[Corner]) -> Closest<R, N> {
    let (none, one) = (Wide::all(0.0), Wide::all(1.0));
    let [mut dx, mut dy] = [none; 2];
    let mut least = Wide::all(f64::INFINITY);
    for p in a {
        let [px, py] = at(p);
        for q in b {
            let [qx, qy] = at(q);
            let (x, y) = (qx - px, qy - py);
            let squared = x * x + y * y;
            let better = squared.less(least);
            least = better.select(squared, least);
            dx = better.select(x, dx);
            dy = better.select(y, dy);
        }
    }
    let distance = least.sqrt();
    let apart = none.less(distance);
    let scale = one.div(apart.select(distance, one));
    // Concentric things part along x, as in Chipmunk.
    let (nx, ny) = (apart.select(dx * scale, one), dy * scale);
    if a.len() == 1 && b.len() == 1 {
        return Closest { separation: distance, nx, ny };
    }
    let farthest = lowest(a, nx.minus(), ny.minus()).minus();
    Closest { separation: lowest(b, nx, ny) - farthest, nx, ny }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::task::geometry::{Convex, gap};
    use crate::world::lanes::outline;

    /// A piece with few corners; of whole numbers, so that many lie on one line or see each other end on.
    fn piece() -> impl Strategy<Value = Convex> {
        let whole = prop_oneof![(-4..5i32).prop_map(f64::from), -4.0..4.0f64];
        let point = [whole.clone(), whole];
        (point, 1..6usize, 0..8u32, 0.3..1.5f64, 0.0..0.5f64, any::<bool>()).prop_map(
            |(at, corners, turn, size, radius, straight)| {
                let turn = f64::from(turn) * std::f64::consts::FRAC_PI_4 + if straight { 0.0 } else { 0.3 };
                let corner = |i: usize| {
                    let angle = turn + std::f64::consts::TAU * i as f64 / corners as f64;
                    let (sin, cos) = if straight && corners == 2 {
                        [(0.0, 1.0), (1.0, 0.0), (0.0, -1.0), (-1.0, 0.0)][(2 * i + (turn as usize % 2)) % 4]
                    } else {
                        angle.sin_cos()
                    };
                    [at[0] + size * cos, at[1] + size * sin]
                };
                let points = if corners == 1 { vec![at] } else { (0..corners).map(corner).collect() };
                Convex { points, radius: if corners < 3 { radius + 0.05 } else { radius } }
            },
        )
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(2000))]

        /// Within reach the separation is the gap of exact geometry, and there the least gap of the places is that, too.
        #[test]
        fn outlines_are_as_far_apart_as_pieces_are(a in piece(), b in piece()) {
            let (one, other) = (outline::alone(&a), outline::alone(&b));
            let found: Closest<f64, 8> = closest(&one, &other, Wide::all(100.0));
            let (own, wanted) = (first(found.separation), gap(&a, &b));
            // Overlapping cores part along a normal of either, and two that cross anywhere.
            let cores = wanted + a.radius + b.radius;
            if cores > 1e-9 {
                prop_assert!((own - wanted).abs() < 1e-9, "{own} for {wanted}");
            } else {
                prop_assert!(own < 1e-9 - a.radius - b.radius + 1e-6, "{own} for {wanted}");
            }
            if cores > 1e-6 {
                let (places, count) = places(&one, &other, found);
                let least = places[..count].iter().map(|p| first(p.gap)).fold(f64::INFINITY, f64::min);
                prop_assert!((least - wanted).abs() < 1e-6, "a place at {least} for {wanted}");
            }
        }
    }

    fn first(wide: Wide<f64, 8>) -> f64 {
        let mut lanes = [0.0; 8];
        wide.store(&mut lanes);
        lanes[0]
    }
}
