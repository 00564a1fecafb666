//! Position and shape of an object, for the features.

use crate::task::geometry::Convex;
use crate::task::solid::Solid;

/// Geometry of an object.
#[derive(Clone, Debug)]
pub(super) struct ObjectGeometry {
    /// Centre of the bounding box, m.
    pub centre: [f64; 2],
    /// Half extents of the bounding box, m.
    pub half: [f64; 2],
    /// m/s
    pub velocity: [f64; 2],
    /// (cosine, sine) of twice the angle of the principal axis, times the elongation in [0, 1].
    pub turned: [f64; 2],
    /// Centre of mass in the bounding box, [-1, 1] from left and bottom to right and top.
    pub lean: [f64; 2],
    /// Filled share of the bounding box.
    pub full: f64,
    pub disc: bool,
    pub several: bool,
    pub movable: bool,
    pub solid: Solid,
}

impl ObjectGeometry {
    /// `position` is used if the solid has no bounds; `area` in m^2.
    pub fn new(
        solid: Solid,
        position: [f64; 2],
        velocity: [f64; 2],
        movable: bool,
        area: f64,
    ) -> ObjectGeometry {
        let [x, y] = position;
        let b = solid.bounds().unwrap_or([x, y, x, y]);
        let centre = [(b[0] + b[2]) / 2.0, (b[1] + b[3]) / 2.0];
        let half = [(b[2] - b[0]) / 2.0, (b[3] - b[1]) / 2.0];
        let pieces: &[Convex] = match &solid {
            Solid::Bounded(pieces) => &pieces.0,
            Solid::HalfPlane { .. } => &[],
        };
        let (middle, turned) = second_moments(pieces, centre);
        let lean = [0, 1].map(|k| if half[k] > 0.0 { (middle[k] - centre[k]) / half[k] } else { 0.0 });
        let full = area / (4.0 * half[0] * half[1]).max(1e-18);
        let disc = matches!(pieces, [one] if one.points.len() == 1);
        let several = pieces.len() > 1;
        ObjectGeometry {
            centre,
            half,
            velocity,
            turned,
            lean,
            full: full.min(1.0),
            disc,
            several,
            movable,
            solid,
        }
    }

    /// Radius of a disc; mean half extent of other shapes.
    pub fn size(&self) -> f64 {
        (self.half[0] + self.half[1]) / 2.0
    }

    pub fn bottom(&self) -> f64 {
        self.centre[1] - self.half[1]
    }

    /// Height of the highest surface at `x` that is not above `from`, m.
    pub fn top(&self, x: f64, from: f64) -> Option<f64> {
        match &self.solid {
            Solid::Bounded(pieces) => {
                let tops = pieces.0.iter().filter_map(|piece| top(piece, x)).filter(|y| *y <= from);
                tops.reduce(f64::max)
            }
            Solid::HalfPlane { normal: [nx, ny], offset } => (*ny > 1e-9).then(|| (offset - nx * x) / ny),
        }
    }
}

/// Height of a convex piece's upper surface at `x`, m.
fn top(piece: &Convex, x: f64) -> Option<f64> {
    let mut best: Option<f64> = None;
    let mut reach = |y: f64| best = Some(best.map_or(y, |b| b.max(y)));
    for (i, p) in piece.points.iter().enumerate() {
        let across = x - p[0];
        if across.abs() <= piece.radius {
            reach(p[1] + (piece.radius * piece.radius - across * across).sqrt());
        }
        let q = piece.points[(i + 1) % piece.points.len()];
        let [dx, dy] = [q[0] - p[0], q[1] - p[1]];
        let long = length(dx, dy);
        if dx != 0.0 {
            // The edge, offset by the radius on its upper side.
            let up = piece.radius * dx.signum() / long;
            let share = (x - p[0] + up * dy) / dx;
            if (0.0..=1.0).contains(&share) {
                reach(p[1] + up * dx + share * dy);
            }
        }
    }
    best
}

/// Length-weighted centroid of the outlines of pieces, and their second moments: (cosine, sine) of twice the principal axis's angle,
/// times the elongation.
fn second_moments(pieces: &[Convex], centre: [f64; 2]) -> ([f64; 2], [f64; 2]) {
    let mut sums = [0.0; 6];
    for piece in pieces {
        for (i, p) in piece.points.iter().enumerate() {
            let q = piece.points[(i + 1) % piece.points.len()];
            let weight = length(q[0] - p[0], q[1] - p[1]);
            // Moments of an edge from its ends and its midpoint (Simpson's rule).
            for (point, share) in [(*p, 1.0), ([(p[0] + q[0]) / 2.0, (p[1] + q[1]) / 2.0], 4.0), (q, 1.0)] {
                let [x, y] = [point[0] - centre[0], point[1] - centre[1]];
                for (sum, v) in sums.iter_mut().zip([1.0, x, y, x * x, y * y, x * y]) {
                    *sum += weight * share / 6.0 * v;
                }
            }
        }
    }
    let [n, x, y, xx, yy, xy] = sums;
    if n <= 0.0 {
        return (centre, [0.0; 2]);
    }
    let (x, y) = (x / n, y / n);
    let (xx, yy, xy) = (xx / n - x * x, yy / n - y * y, xy / n - x * y);
    let whole = (xx + yy).max(1e-18);
    ([centre[0] + x, centre[1] + y], [(xx - yy) / whole, 2.0 * xy / whole])
}

/// Area of a simple polygon, m^2.
pub(super) fn area(points: &[[f64; 2]]) -> f64 {
    let next = points.iter().cycle().skip(1);
    points.iter().zip(next).map(|(p, q)| p[0] * q[1] - q[0] * p[1]).sum::<f64>().abs() / 2.0
}

/// Length of a vector; uses the square root only, which is identical on every machine.
pub(super) fn length(x: f64, y: f64) -> f64 {
    (x * x + y * y).sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::task::solid::ConvexPieces;

    #[test]
    fn surfaces_match_hand_computed_values() {
        let check = |points: &[[f64; 2]], radius: f64, x: f64, wanted: Option<f64>| {
            let found = top(&Convex { points: points.to_vec(), radius }, x);
            let close = found.zip(wanted).map_or(found == wanted, |(f, w)| (f - w).abs() < 1e-12);
            assert!(close, "{points:?} at {x}: {found:?}, not {wanted:?}");
        };
        let triangle = [[0.0, 0.0], [4.0, 0.0], [0.0, 2.0]];
        check(&triangle, 0.0, 1.0, Some(1.5));
        check(&triangle, 0.0, 4.5, None);
        check(&[[1.0, 1.0]], 0.5, 1.3, Some(1.4));
        check(&[[1.0, 1.0]], 0.5, 1.6, None);
        let capsule = [[0.0, 0.0], [3.0, 0.0]];
        check(&capsule, 0.2, 1.0, Some(0.2));
        check(&capsule, 0.2, 3.1, Some(0.03f64.sqrt()));
        let square = [[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]];
        let turned: Vec<[f64; 2]> = square.iter().rev().copied().collect();
        check(&square, 0.0, 0.3, Some(1.0));
        check(&turned, 0.0, 0.3, Some(1.0));
        // Twice the angle of a bar rotated by 30 degrees, with elongation near 1.
        let bar = ConvexPieces::one(vec![[-2.0, 0.0], [2.0, 0.0]], 0.0)
            .placed([3.0, 1.0], std::f64::consts::FRAC_PI_6);
        let (middle, [cos, sin]) = second_moments(&bar.0, [3.0, 1.0]);
        assert!((cos - 0.5).abs() < 1e-12 && (sin - 0.75f64.sqrt()).abs() < 1e-12 && middle == [3.0, 1.0]);
    }
}
