//! The corner and the side, or the two rounded corners, that are nearest to each other of two outlines.

use super::contact_geometry::{ContactFeature, RoundedCorner, TurningVector};
use crate::task::geometry::dot;
use crate::task::solid::Solid;

/// Largest gap between the nearest parts, in sizes of the smaller body, and the least by which any other corner is farther away:
/// where a side lies on a side, the impulse has no one place.
const MAX_GAP: f64 = 0.15;
const MIN_LEAD: f64 = 0.1;

/// The parts of two placed solids that touch, relative to their centres (m), as if they did not turn; `None` if no parts are near
/// each other, or two pairs. `size`: of the smaller body, m.
pub fn closest_features([a, b]: [(&Solid, [f64; 2]); 2], size: f64) -> Option<[ContactFeature; 2]> {
    let [a, b] = [a, b].map(|(solid, centre)| Outline::of(solid, centre));
    let swapped = b.corner_side_pairs(&a).into_iter().map(|c| {
        let [own, corner] = c.features;
        FeaturePair { features: [corner, own], ..c }
    });
    let mut all: Vec<FeaturePair> =
        a.corner_side_pairs(&b).into_iter().chain(swapped).chain(a.corner_pairs(&b)).collect();
    // Corners behind an outline are far inside it.
    all.retain(|c| c.gap > -MAX_GAP * size);
    all.sort_by(|a, b| a.gap.total_cmp(&b.gap));
    let least = all.first().filter(|c| c.gap < MAX_GAP * size)?;
    // Pieces of a compound share corners.
    let is_other = |c: &&FeaturePair| {
        (c.corner[0] - least.corner[0]).hypot(c.corner[1] - least.corner[1]) > MIN_LEAD * size
    };
    let lead = all.iter().find(is_other).map_or(f64::INFINITY, |c| c.gap - least.gap);
    (lead > MIN_LEAD * size).then_some(least.features)
}

/// Corners of a placed solid and the sides of each convex piece, relative to its centre.
struct Outline {
    centre: [f64; 2],
    corners: Vec<RoundedCorner>,
    pieces: Vec<Vec<Side>>,
}

/// Two parts of outlines, own first, and the gap between them, m. `corner`: place of the corner that is near, m.
struct FeaturePair {
    gap: f64,
    features: [ContactFeature; 2],
    corner: [f64; 2],
}

/// A straight side with the ends of its extent along (-ny, nx) from the centre, m.
#[derive(Clone, Copy)]
struct Side {
    normal: [f64; 2],
    distance: f64,
    extent: [f64; 2],
}

impl Outline {
    fn of(solid: &Solid, centre: [f64; 2]) -> Outline {
        let relative = |p: &[f64; 2]| [p[0] - centre[0], p[1] - centre[1]];
        let mut out = Outline { centre, corners: Vec::new(), pieces: Vec::new() };
        match solid {
            Solid::HalfPlane { normal, offset } => {
                let distance = offset - dot(*normal, centre);
                let extent = [f64::NEG_INFINITY, f64::INFINITY];
                out.pieces.push(vec![Side { normal: *normal, distance, extent }]);
            }
            Solid::Bounded(pieces) => {
                for piece in &pieces.0 {
                    let points: Vec<[f64; 2]> = piece.points.iter().map(relative).collect();
                    let corner = |p: &[f64; 2]| RoundedCorner {
                        place: TurningVector { at_start: *p, rate: 0.0 },
                        radius: piece.radius,
                    };
                    out.corners.extend(points.iter().map(corner));
                    let sides = if points.len() > 1 { points.len() } else { 0 };
                    let side = |i: usize| {
                        let (p, q) = (points[i], points[(i + 1) % points.len()]);
                        let [dx, dy] = [q[0] - p[0], q[1] - p[1]];
                        let length = dx.hypot(dy);
                        let normal = [dy / length, -dx / length];
                        let way = |p: [f64; 2]| p[1] * normal[0] - p[0] * normal[1];
                        Side { normal, distance: dot(p, normal) + piece.radius, extent: [way(p), way(q)] }
                    };
                    out.pieces.push((0..sides).map(side).collect());
                }
            }
        }
        out
    }

    /// The corners of another outline beside the side of each own piece that they are farthest out of.
    fn corner_side_pairs(&self, other: &Outline) -> Vec<FeaturePair> {
        let mut out = Vec::new();
        for (corner, piece) in other.corners.iter().flat_map(|c| self.pieces.iter().map(move |p| (c, p))) {
            let corner_place = place(other, corner);
            let relative = [0, 1].map(|k| corner_place[k] - self.centre[k]);
            let gap = |side: &Side| dot(relative, side.normal) - side.distance - corner.radius;
            let Some(side) = piece.iter().max_by(|a, b| gap(a).total_cmp(&gap(b))) else { continue };
            let way = relative[1] * side.normal[0] - relative[0] * side.normal[1];
            if (side.extent[0]..=side.extent[1]).contains(&way) {
                let normal = TurningVector { at_start: side.normal, rate: 0.0 };
                let own = ContactFeature::Side { normal, distance: side.distance };
                let features = [own, ContactFeature::Corner(*corner)];
                out.push(FeaturePair { gap: gap(side), features, corner: corner_place });
            }
        }
        out
    }

    /// Pairs of corners of which one at least is rounded.
    fn corner_pairs(&self, other: &Outline) -> Vec<FeaturePair> {
        let pairs = self.corners.iter().flat_map(|a| other.corners.iter().map(move |b| (a, b)));
        let rounded = pairs.filter(|(a, b)| a.radius + b.radius > 0.0);
        let candidate = |(a, b): (&RoundedCorner, &RoundedCorner)| {
            let (p, q) = (place(self, a), place(other, b));
            let gap = (p[0] - q[0]).hypot(p[1] - q[1]) - a.radius - b.radius;
            FeaturePair { gap, features: [ContactFeature::Corner(*a), ContactFeature::Corner(*b)], corner: p }
        };
        rounded.map(candidate).collect()
    }
}

/// Place of a corner of an outline, m.
fn place(outline: &Outline, corner: &RoundedCorner) -> [f64; 2] {
    [0, 1].map(|k| outline.centre[k] + corner.place.at_start[k])
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::task::solid::ConvexPieces;

    const BOX: [[f64; 2]; 4] = [[-2.0, -1.0], [2.0, -1.0], [2.0, 1.0], [-2.0, 1.0]];

    fn features(a: (Solid, [f64; 2]), b: (Solid, [f64; 2])) -> Option<[ContactFeature; 2]> {
        closest_features([(&a.0, a.1), (&b.0, b.1)], 1.0)
    }

    fn placed(points: &[[f64; 2]], radius: f64, position: [f64; 2], angle: f64) -> (Solid, [f64; 2]) {
        let pieces = ConvexPieces::one(points.to_vec(), radius);
        (Solid::Bounded(pieces).placed(position, angle), position)
    }

    fn ground() -> (Solid, [f64; 2]) {
        (Solid::HalfPlane { normal: [0.0, 1.0], offset: 0.0 }, [0.0; 2])
    }

    /// A tilted box stands on its lower corner, also slightly inside the ground; on two corners it has no one place.
    #[test]
    fn tilted_boxes_touch_by_one_corner() {
        let (sin, cos) = libm::sincos(0.3);
        let lowest = 2.0 * sin + cos;
        for gap in [0.05, -0.05] {
            let found = features(placed(&BOX, 0.0, [5.0, lowest + gap], 0.3), ground()).expect("one corner");
            let [ContactFeature::Corner(corner), ContactFeature::Side { normal, distance }] = found else {
                panic!("{found:?}")
            };
            let [x, y] = corner.place.at_start;
            assert!((x - (-2.0 * cos + sin)).abs() < 1e-12 && (y + lowest).abs() < 1e-12, "{corner:?}");
            assert_eq!((normal.at_start, distance), ([0.0, 1.0], 0.0));
        }
        assert!(features(placed(&BOX, 0.0, [5.0, 1.05], 0.001), ground()).is_none(), "it lies flat");
        assert!(features(placed(&BOX, 0.0, [5.0, lowest + 0.5], 0.3), ground()).is_none(), "it is above");
    }

    /// A disc beside a side touches that side, beyond its end the corner; a corner near the end of a side does not touch the side
    /// around it.
    #[test]
    fn discs_touch_sides_and_corners() {
        let lying = || placed(&BOX, 0.0, [0.0; 2], 0.0);
        let disc = |x: f64, y: f64| placed(&[[0.0, 0.0]], 0.5, [x, y], 0.0);
        let Some([ContactFeature::Side { normal, distance }, ContactFeature::Corner(own)]) =
            features(lying(), disc(1.0, 1.52))
        else {
            panic!("the upper side")
        };
        assert_eq!((normal.at_start, distance, own.radius), ([0.0, 1.0], 1.0, 0.5));
        let Some([ContactFeature::Corner(corner), ContactFeature::Corner(_)]) =
            features(lying(), disc(2.36, 1.36))
        else {
            panic!("the upper corner")
        };
        assert_eq!(corner.place.at_start, [2.0, 1.0]);
        let turned = placed(
            &BOX,
            0.0,
            [1.6, 1.0 + libm::hypot(2.0, 1.0) - 0.01],
            0.5 * std::f64::consts::PI - libm::atan2(1.0, 2.0),
        );
        let Some([ContactFeature::Side { normal, .. }, ContactFeature::Corner(_)]) =
            features(lying(), turned)
        else {
            panic!("the corner points down onto the upper side")
        };
        assert_eq!(normal.at_start, [0.0, 1.0]);
    }
}
