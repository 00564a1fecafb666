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
    // Only where cores are apart can corners matter, and only where that is near does it.
    let lone = a.len() == 1 && b.len() == 1;
    let apart = none.less(best.separation).and(best.separation.at_most(reach + radii));
    if lone || apart.any() {
        let corners = between_corners(a, b);
        let better = best.separation.less(corners.separation);
        let better = if lone { better } else { better.and(apart) };
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
    edge
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
fn lowest<R: Register, const N: usize>(corners: &[Corner], nx: Wide<R, N>, ny: Wide<R, N>) -> Wide<R, N> {
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
