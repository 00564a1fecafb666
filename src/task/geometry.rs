//! Convex shapes with rounded corners, and the signed distance between two of them.
//!
//! A disc is a point with a radius, a segment two points with a radius, a box or polygon its corners with
//! radius 0. Placement checks, goals and the batched kernel need nothing else of a shape.

/// A convex core (one to n points, counter-clockwise) inflated by a radius; world or body frame.
#[derive(Clone, Debug, PartialEq)]
pub struct Convex {
    /// Corner points, m.
    pub points: Vec<[f64; 2]>,
    /// Rounding radius, m.
    pub radius: f64,
}

/// An axis-aligned bounding box `[x_min, y_min, x_max, y_max]`, m.
pub type Aabb = [f64; 4];

impl Convex {
    /// The shape rotated by `angle` (rad) about the origin, then translated to `position`.
    pub fn placed(&self, position: [f64; 2], angle: f64) -> Convex {
        // libm: the same bits on every machine.
        let (sin, cos) = libm::sincos(angle);
        let turn =
            |p: &[f64; 2]| [position[0] + cos * p[0] - sin * p[1], position[1] + sin * p[0] + cos * p[1]];
        Convex { points: self.points.iter().map(turn).collect(), radius: self.radius }
    }

    /// Whether the shape is a disc about its own origin.
    pub fn is_disc(&self) -> bool {
        self.points == [[0.0, 0.0]]
    }

    /// The smallest axis-aligned box around the shape.
    pub fn bounds(&self) -> Aabb {
        let mut b = [f64::INFINITY, f64::INFINITY, f64::NEG_INFINITY, f64::NEG_INFINITY];
        for p in &self.points {
            b = [b[0].min(p[0]), b[1].min(p[1]), b[2].max(p[0]), b[3].max(p[1])];
        }
        [b[0] - self.radius, b[1] - self.radius, b[2] + self.radius, b[3] + self.radius]
    }

    /// Area enclosed, m^2, rounding included.
    pub fn area(&self) -> f64 {
        let perimeter: f64 = match self.points.len() {
            1 => 0.0,
            2 => 2.0 * distance(self.points[0], self.points[1]),
            _ => self.edges().map(|(a, b)| distance(a, b)).sum(),
        };
        signed_area(&self.points)
            + perimeter * self.radius
            + std::f64::consts::PI * (self.radius * self.radius)
    }

    fn edges(&self) -> impl Iterator<Item = ([f64; 2], [f64; 2])> + '_ {
        let n = self.points.len();
        (0..n).map(move |i| (self.points[i], self.points[(i + 1) % n]))
    }

    /// Whether `p` lies in the core (polygons only; points and segments have no interior).
    fn core_contains(&self, p: [f64; 2]) -> bool {
        self.points.len() > 2 && self.edges().all(|(a, b)| cross(sub(b, a), sub(p, a)) >= 0.0)
    }
}

/// Signed distance between two shapes, m: positive if they are apart, minus the penetration depth if they
/// overlap.
pub fn signed_distance(a: &Convex, b: &Convex) -> f64 {
    let radii = a.radius + b.radius;
    let apart = core_distance(a, b);
    if apart > 0.0 { apart - radii } else { -radii - overlap_depth(a, b) }
}

/// Distance from a point to the segment `a b`, m.
pub fn point_segment(p: [f64; 2], a: [f64; 2], b: [f64; 2]) -> f64 {
    let ab = sub(b, a);
    let length2 = dot(ab, ab);
    let t = if length2 > 0.0 { (dot(sub(p, a), ab) / length2).clamp(0.0, 1.0) } else { 0.0 };
    distance(p, [a[0] + t * ab[0], a[1] + t * ab[1]])
}

/// Whether `p` lies within the simple polygon `corners` (boundary included up to rounding).
pub fn polygon_contains(corners: &[[f64; 2]], p: [f64; 2]) -> bool {
    let n = corners.len();
    let mut inside = false;
    for i in 0..n {
        let (a, b) = (corners[i], corners[(i + 1) % n]);
        if (a[1] > p[1]) != (b[1] > p[1]) && p[0] < a[0] + (p[1] - a[1]) / (b[1] - a[1]) * (b[0] - a[0]) {
            inside = !inside;
        }
    }
    inside
}

/// Signed area by the shoelace formula: positive for counter-clockwise corners, m^2.
pub fn signed_area(corners: &[[f64; 2]]) -> f64 {
    let n = corners.len();
    (0..n).map(|i| cross(corners[i], corners[(i + 1) % n])).sum::<f64>() / 2.0
}

/// Whether two boxes do not overlap.
pub fn disjoint(a: &Aabb, b: &Aabb) -> bool {
    a[0] > b[2] || b[0] > a[2] || a[1] > b[3] || b[1] > a[3]
}

/// The smallest box that contains both.
pub fn union_box(a: Aabb, b: Aabb) -> Aabb {
    [a[0].min(b[0]), a[1].min(b[1]), a[2].max(b[2]), a[3].max(b[3])]
}

fn core_distance(a: &Convex, b: &Convex) -> f64 {
    if let ([p], [q]) = (a.points.as_slice(), b.points.as_slice()) {
        return distance(*p, *q);
    }
    let crossing = a.edges().any(|(p, q)| b.edges().any(|(r, s)| segments_cross(p, q, r, s)));
    if crossing || a.core_contains(b.points[0]) || b.core_contains(a.points[0]) {
        return 0.0;
    }
    let nearest = |from: &Convex, to: &Convex| {
        from.points
            .iter()
            .flat_map(|p| to.edges().map(move |(r, s)| point_segment(*p, r, s)))
            .fold(f64::INFINITY, f64::min)
    };
    nearest(a, b).min(nearest(b, a))
}

/// Penetration depth of the cores: the smallest separation along an edge normal of either (separating axes).
fn overlap_depth(a: &Convex, b: &Convex) -> f64 {
    let mut least = f64::INFINITY;
    for (p, q) in a.edges().chain(b.edges()) {
        let length = distance(p, q);
        if length == 0.0 {
            continue;
        }
        let normal = [(q[1] - p[1]) / length, (p[0] - q[0]) / length];
        let span = |c: &Convex| {
            c.points.iter().fold((f64::INFINITY, f64::NEG_INFINITY), |(lo, hi), p| {
                let d = dot(*p, normal);
                (lo.min(d), hi.max(d))
            })
        };
        let ((a_lo, a_hi), (b_lo, b_hi)) = (span(a), span(b));
        least = least.min((a_hi - b_lo).min(b_hi - a_lo).max(0.0));
    }
    if least.is_finite() { least } else { 0.0 }
}

fn segments_cross(p: [f64; 2], q: [f64; 2], r: [f64; 2], s: [f64; 2]) -> bool {
    let side = |a: [f64; 2], b: [f64; 2], c: [f64; 2]| cross(sub(b, a), sub(c, a));
    side(p, q, r) * side(p, q, s) < 0.0 && side(r, s, p) * side(r, s, q) < 0.0
}

/// a - b
pub fn sub(a: [f64; 2], b: [f64; 2]) -> [f64; 2] {
    [a[0] - b[0], a[1] - b[1]]
}
/// Scalar product.
pub fn dot(a: [f64; 2], b: [f64; 2]) -> f64 {
    a[0] * b[0] + a[1] * b[1]
}
fn cross(a: [f64; 2], b: [f64; 2]) -> f64 {
    a[0] * b[1] - a[1] * b[0]
}
fn distance(a: [f64; 2], b: [f64; 2]) -> f64 {
    let d = sub(a, b);
    dot(d, d).sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn disc(x: f64, y: f64, radius: f64) -> Convex {
        Convex { points: vec![[x, y]], radius }
    }
    fn square(x: f64, y: f64, half: f64) -> Convex {
        let points =
            vec![[x - half, y - half], [x + half, y - half], [x + half, y + half], [x - half, y + half]];
        Convex { points, radius: 0.0 }
    }

    #[test]
    fn signed_distances_match_known_values() {
        let check = |a: &Convex, b: &Convex, expected: f64| {
            assert!(
                (signed_distance(a, b) - expected).abs() < 1e-12,
                "{} != {expected}",
                signed_distance(a, b)
            );
            assert!((signed_distance(b, a) - expected).abs() < 1e-12, "not symmetric");
        };
        check(&disc(0.0, 0.0, 1.0), &disc(3.0, 4.0, 2.0), 2.0);
        check(&disc(0.0, 0.0, 1.0), &square(3.0, 0.0, 1.0), 1.0);
        check(&disc(0.0, 0.0, 1.0), &square(1.5, 0.0, 1.0), -0.5);
        check(&disc(0.0, 0.0, 1.0), &square(0.0, 0.0, 2.0), -3.0);
        check(&square(0.0, 0.0, 1.0), &square(1.5, 0.0, 1.0), -0.5);
        let capsule = Convex { points: vec![[-1.0, 2.0], [1.0, 2.0]], radius: 0.25 };
        check(&disc(0.0, 0.0, 1.0), &capsule, 0.75);
    }

    #[test]
    fn areas_and_containment_match_known_values() {
        assert!((square(0.0, 0.0, 1.0).area() - 4.0).abs() < 1e-12);
        assert!((disc(0.0, 0.0, 2.0).area() - 4.0 * std::f64::consts::PI).abs() < 1e-12);
        let corners = square(0.0, 0.0, 1.0).points;
        assert!(polygon_contains(&corners, [0.5, -0.5]) && !polygon_contains(&corners, [1.5, 0.0]));
    }
}
