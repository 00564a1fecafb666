//! Separation of two convex outlines and their contact points, for all lanes at once.
//!
//! Source: separating axis test of convex polygons (Ericson, "Real-Time Collision Detection", 2005, section
//! 5.2; Gregorius, GDC 2013): of all directions, an edge normal or the line between two corners has the
//! largest separation; an edge normal if the polygons overlap. The contact points are the ends of the common
//! interval of the edges that face each other along that direction (Chipmunk2D, `cpCollision.c`).
//!
//! Differences from the source: no search (GJK, EPA); every edge is tested, so that lanes stay in step.

use super::outline::{Corner, OutlineCore, PieceOutline};
use super::simd::{Register, Wide};

/// Separation of two outlines (m, negative for overlap) and the unit normal from the first to the second.
#[derive(Clone, Copy)]
pub struct Separation<R, const N: usize> {
    pub separation: Wide<R, N>,
    pub nx: Wide<R, N>,
    pub ny: Wide<R, N>,
}

/// A contact point of two outlines.
#[derive(Clone, Copy)]
pub struct ContactPoint<R, const N: usize> {
    /// Position on the first, and on the second, world frame, m.
    pub first: [Wide<R, N>; 2],
    pub second: [Wide<R, N>; 2],
    /// Gap from the first to the second along the normal, m.
    pub gap: Wide<R, N>,
    /// Id of the corners that form it, constant from step to step while they are the same.
    pub id: Wide<R, N>,
}

/// Separation of two outlines. Exact up to a gap of `reach`; a lower bound beyond, between corners.
#[inline(always)]
pub fn closest<R: Register, const N: usize>(
    first: &PieceOutline,
    second: &PieceOutline,
    reach: Wide<R, N>,
) -> Separation<R, N> {
    let radii = Wide::load(&first.radius) + Wide::load(&second.radius);
    let (a, b) = match (&first.core, &second.core) {
        (OutlineCore::Corners { here: a, .. }, OutlineCore::Corners { here: b, .. }) => (a, b),
        (OutlineCore::Corners { here, .. }, OutlineCore::Plane { nx, ny, offset }) => {
            let (nx, ny) = (Wide::load(nx), Wide::load(ny));
            let separation = lowest(here, nx, ny) - Wide::load(offset) - radii;
            return Separation { separation, nx: nx.minus(), ny: ny.minus() };
        }
        // Half planes are statics, and statics are second.
        (OutlineCore::Plane { .. }, _) => {
            let none = Wide::all(0.0);
            return Separation { separation: Wide::all(f64::INFINITY), nx: none, ny: none };
        }
    };
    let none = Wide::all(0.0);
    let start = Wide::all(f64::NEG_INFINITY);
    let mut best = Separation { separation: start, nx: none, ny: none };
    if a.len() > 1 {
        test_edge_normals(&mut best, a, b, false);
    }
    if b.len() > 1 {
        test_edge_normals(&mut best, b, a, true);
    }
    // Corners matter only if the cores are apart by less than the reach. Edge normals do not give the
    // distance of two collinear cores without interior.
    let flat = a.len() <= 2 && b.len() <= 2;
    let apart = none.less(best.separation).and(best.separation.at_most(reach + radii));
    if flat || apart.any() {
        let corners = test_corner_pairs(a, b);
        let better = best.separation.less(corners.separation);
        let better = if flat { better } else { better.and(apart) };
        best = Separation {
            separation: better.select(corners.separation, best.separation),
            nx: better.select(corners.nx, best.nx),
            ny: better.select(corners.ny, best.ny),
        };
    }
    Separation { separation: best.separation - radii, ..best }
}

/// The contact points along a normal: two, or one if one of the outlines is a disc.
#[inline(always)]
pub fn places<R: Register, const N: usize>(
    first: &PieceOutline,
    second: &PieceOutline,
    normal: Separation<R, N>,
) -> ([ContactPoint<R, N>; 2], usize) {
    let OutlineCore::Corners { here: a, .. } = &first.core else { unreachable!("a plane is never first") };
    let (nx, ny) = (normal.nx, normal.ny);
    let (ra, rb) = (Wide::load(&first.radius), Wide::load(&second.radius));
    let one = facing_edge(a, nx, ny);
    let single = a.len() == 1;
    match &second.core {
        OutlineCore::Plane { nx: px, ny: py, offset } => {
            let (px, py, offset) = (Wide::load(px), Wide::load(py), Wide::load(offset));
            let from = above_plane(one.from, one.from_id, [nx, ny], [px, py], offset, ra);
            let to = above_plane(one.to, one.to_id, [nx, ny], [px, py], offset, ra);
            ([from, to], if single { 1 } else { 2 })
        }
        OutlineCore::Corners { here: b, .. } => {
            let other = facing_edge(b, nx.minus(), ny.minus());
            // Coordinates along the edges, in the direction of the first's.
            let ours = [tangential_coordinate(one.from, nx, ny), tangential_coordinate(one.to, nx, ny)];
            let theirs = [tangential_coordinate(other.from, nx, ny), tangential_coordinate(other.to, nx, ny)];
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

/// Coordinate perpendicular to a normal.
#[inline(always)]
fn tangential_coordinate<R: Register, const N: usize>(
    [x, y]: [Wide<R, N>; 2],
    nx: Wide<R, N>,
    ny: Wide<R, N>,
) -> Wide<R, N> {
    y * nx - x * ny
}

/// Contact point of a corner with a half plane (outward normal and offset).
#[inline(always)]
fn above_plane<R: Register, const N: usize>(
    [x, y]: [Wide<R, N>; 2],
    id: Wide<R, N>,
    [nx, ny]: [Wide<R, N>; 2],
    [px, py]: [Wide<R, N>; 2],
    offset: Wide<R, N>,
    radius: Wide<R, N>,
) -> ContactPoint<R, N> {
    let gap = px * x + py * y - offset - radius;
    let first = [x + nx * radius, y + ny * radius];
    ContactPoint { first, second: [first[0] + nx * gap, first[1] + ny * gap], gap, id }
}

/// Contact point of two points of the cores.
#[inline(always)]
fn between_edges<R: Register, const N: usize>(
    [[x, y], [u, v]]: [[Wide<R, N>; 2]; 2],
    id: Wide<R, N>,
    [nx, ny]: [Wide<R, N>; 2],
    [ra, rb]: [Wide<R, N>; 2],
) -> ContactPoint<R, N> {
    let first = [x + nx * ra, y + ny * ra];
    let second = [u - nx * rb, v - ny * rb];
    let gap = (second[0] - first[0]) * nx + (second[1] - first[1]) * ny;
    ContactPoint { first, second, gap, id }
}

/// Length of an edge perpendicular to the normal below which it counts as seen edge-on, m.
const EDGE_ON_TOLERANCE_M: f64 = 1e-9;

/// The edge of an outline that faces a direction most directly.
struct FacingEdge<R, const N: usize> {
    from: [Wide<R, N>; 2],
    to: [Wide<R, N>; 2],
    from_id: Wide<R, N>,
    to_id: Wide<R, N>,
}

#[inline(always)]
fn facing_edge<R: Register, const N: usize>(
    corners: &[Corner],
    nx: Wide<R, N>,
    ny: Wide<R, N>,
) -> FacingEdge<R, N> {
    let n = corners.len();
    let mut edge =
        FacingEdge { from: at(&corners[0]), to: at(&corners[1 % n]), from_id: id(0), to_id: id(1 % n) };
    let mut best = nx * Wide::load(&corners[0].nx) + ny * Wide::load(&corners[0].ny);
    for (i, corner) in corners.iter().enumerate().skip(1) {
        let facing_edge = nx * Wide::load(&corner.nx) + ny * Wide::load(&corner.ny);
        let better = best.less(facing_edge);
        best = better.select(facing_edge, best);
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

/// A segment seen edge-on is reduced to its nearer end.
#[inline(always)]
fn end_on<R: Register, const N: usize>(
    edge: FacingEdge<R, N>,
    nx: Wide<R, N>,
    ny: Wide<R, N>,
) -> FacingEdge<R, N> {
    let (dx, dy) = (edge.to[0] - edge.from[0], edge.to[1] - edge.from[1]);
    let seen = (dy * nx - dx * ny).abs().at_most(Wide::all(EDGE_ON_TOLERANCE_M));
    let farther = Wide::all(0.0).less(dx * nx + dy * ny);
    let nearer = [farther.select(edge.to[0], edge.from[0]), farther.select(edge.to[1], edge.from[1])];
    FacingEdge {
        from: [seen.select(nearer[0], edge.from[0]), seen.select(nearer[1], edge.from[1])],
        to: [seen.select(nearer[0], edge.to[0]), seen.select(nearer[1], edge.to[1])],
        ..edge
    }
}

/// Position of a corner.
#[inline(always)]
fn at<R: Register, const N: usize>(corner: &Corner) -> [Wide<R, N>; 2] {
    [Wide::load(&corner.x), Wide::load(&corner.y)]
}

#[inline(always)]
fn id<R: Register, const N: usize>(corner: usize) -> Wide<R, N> {
    Wide::all(1.0 + corner as f64)
}

/// The point between two points at which a coordinate, whose values at both are given, equals `wanted`, or
/// the nearest end.
#[inline(always)]
fn between<R: Register, const N: usize>(
    from: [Wide<R, N>; 2],
    to: [Wide<R, N>; 2],
    [a, b]: [Wide<R, N>; 2],
    wanted: Wide<R, N>,
) -> [Wide<R, N>; 2] {
    let (none, one) = (Wide::all(0.0), Wide::all(1.0));
    let width = b - a;
    // An edge seen edge-on has no width: either end is correct.
    let some = none.less(width.abs());
    let share = some.select((wanted - a).div(some.select(width, one)), none).above(none).below(one);
    [from[0] + (to[0] - from[0]) * share, from[1] + (to[1] - from[1]) * share]
}

/// Tests the edge normals of `from` as separating directions; `reversed`: they point towards the first
/// outline, not away from it.
#[inline(always)]
fn test_edge_normals<R: Register, const N: usize>(
    best: &mut Separation<R, N>,
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

/// Minimum coordinate of corners along a direction.
#[inline(always)]
pub fn lowest<R: Register, const N: usize>(corners: &[Corner], nx: Wide<R, N>, ny: Wide<R, N>) -> Wide<R, N> {
    let mut low = nx * Wide::load(&corners[0].x) + ny * Wide::load(&corners[0].y);
    for c in &corners[1..] {
        low = (nx * Wide::load(&c.x) + ny * Wide::load(&c.y)).below(low);
    }
    low
}

/// Tests the line between the two closest corners as a separating direction.
#[inline(always)]
fn test_corner_pairs<R: Register, const N: usize>(a: &[Corner], b: &[Corner]) -> Separation<R, N> {
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
    // Concentric objects separate along x, as in Chipmunk.
    let (nx, ny) = (apart.select(dx * scale, one), dy * scale);
    if a.len() == 1 && b.len() == 1 {
        return Separation { separation: distance, nx, ny };
    }
    let farthest = lowest(a, nx.minus(), ny.minus()).minus();
    Separation { separation: lowest(b, nx, ny) - farthest, nx, ny }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::task::geometry::{Convex, signed_distance};
    use crate::world::lanes::load::outline;

    /// A piece with few corners; integer coordinates make many collinear or edge-on.
    fn piece() -> impl Strategy<Value = Convex> {
        let whole = prop_oneof![(-4..5i32).prop_map(f64::from), -4.0..4.0f64];
        let point = [whole.clone(), whole];
        (point, 1..6usize, 0..8u32, 0.3..1.5f64, 0.0..0.5f64, any::<bool>()).prop_map(
            |(at, corners, turn, abs, radius, straight)| {
                let turn = f64::from(turn) * std::f64::consts::FRAC_PI_4 + if straight { 0.0 } else { 0.3 };
                let corner = |i: usize| {
                    let angle = turn + std::f64::consts::TAU * i as f64 / corners as f64;
                    let (sin, cos) = if straight && corners == 2 {
                        [(0.0, 1.0), (1.0, 0.0), (0.0, -1.0), (-1.0, 0.0)][(2 * i + (turn as usize % 2)) % 4]
                    } else {
                        angle.sin_cos()
                    };
                    [at[0] + abs * cos, at[1] + abs * sin]
                };
                let points = if corners == 1 { vec![at] } else { (0..corners).map(corner).collect() };
                Convex { points, radius: if corners < 3 { radius + 0.05 } else { radius } }
            },
        )
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(2000))]

        /// Within reach the separation equals the exact distance, and so does the smallest gap of the
        /// contact points.
        #[test]
        fn separation_matches_exact_distance(a in piece(), b in piece()) {
            let (one, other) = (outline::single(&a), outline::single(&b));
            let found: Separation<f64, 8> = closest(&one, &other, Wide::all(100.0));
            let (own, wanted) = (first(found.separation), signed_distance(&a, &b));
            // Overlapping cores separate along an edge normal of either; crossing segments have
            // no defined normal.
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
