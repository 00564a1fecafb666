//! Solid geometry of shapes as convex pieces or a half plane, for engines, goals, pictures and policies.
//!
//! All geometric queries go through this type, so a new shape needs no change elsewhere.

use super::geometry::{self, Aabb, Convex};

/// The geometry of a shape, in its owner's frame or the world's.
#[derive(Clone, Debug, PartialEq)]
pub enum Solid {
    /// Bounded geometry.
    Bounded(ConvexPieces),
    /// The unbounded half plane below the line `normal . p = offset`.
    HalfPlane { normal: [f64; 2], offset: f64 },
}

/// The convex pieces of one object; at least one.
#[derive(Clone, Debug, PartialEq)]
pub struct ConvexPieces(pub Vec<Convex>);

/// Number of corners that a piece counts as at least: engines take as long for a disc as for a box.
pub const MIN_CORNERS_PER_PIECE: usize = 4;

impl Solid {
    /// The solid rotated by `angle` (rad) about the origin, then translated to `position` (m).
    pub fn placed(&self, position: [f64; 2], angle: f64) -> Solid {
        match self {
            Solid::Bounded(pieces) => Solid::Bounded(pieces.placed(position, angle)),
            Solid::HalfPlane { normal: [x, y], offset } => {
                let (sin, cos) = libm::sincos(angle);
                let normal = [cos * x - sin * y, sin * x + cos * y];
                let shift = normal[0] * position[0] + normal[1] * position[1];
                Solid::HalfPlane { normal, offset: offset + shift }
            }
        }
    }

    /// The axis-aligned bounding box; `None` for a half plane.
    pub fn bounds(&self) -> Option<Aabb> {
        match self {
            Solid::Bounded(pieces) => Some(pieces.bounds()),
            Solid::HalfPlane { .. } => None,
        }
    }

    /// Signed distance to a bounded object, m: positive if apart, minus the penetration depth if they
    /// overlap.
    pub fn signed_distance_to(&self, other: &ConvexPieces) -> f64 {
        match self {
            Solid::Bounded(own) => own.signed_distance_to(other),
            Solid::HalfPlane { normal, offset } => {
                let above = |p: &[f64; 2]| normal[0] * p[0] + normal[1] * p[1] - offset;
                let lowest = |c: &Convex| c.points.iter().map(above).fold(f64::INFINITY, f64::min) - c.radius;
                other.0.iter().map(lowest).fold(f64::INFINITY, f64::min)
            }
        }
    }

    /// Signed distance to another solid, m. Half planes overlap without bound unless their normals are
    /// opposed.
    pub fn signed_distance(&self, other: &Solid) -> f64 {
        match (self, other) {
            (_, Solid::Bounded(pieces)) => self.signed_distance_to(pieces),
            (Solid::Bounded(pieces), _) => other.signed_distance_to(pieces),
            (Solid::HalfPlane { normal: a, offset }, Solid::HalfPlane { normal: b, offset: beyond }) => {
                let opposed = a[0] * b[0] + a[1] * b[1] < -1.0 + 1e-9;
                if opposed { -(offset + beyond) } else { f64::NEG_INFINITY }
            }
        }
    }
}

impl ConvexPieces {
    /// An object of one piece.
    pub fn one(points: Vec<[f64; 2]>, radius: f64) -> ConvexPieces {
        ConvexPieces(vec![Convex { points, radius }])
    }

    /// The pieces rotated by `angle` (rad) about the origin, then translated to `position` (m).
    pub fn placed(&self, position: [f64; 2], angle: f64) -> ConvexPieces {
        ConvexPieces(self.0.iter().map(|piece| piece.placed(position, angle)).collect())
    }

    /// The axis-aligned bounding box of all pieces.
    pub fn bounds(&self) -> Aabb {
        let all = self.0.iter().map(Convex::bounds);
        all.reduce(geometry::union_box).expect("a solid has at least one piece")
    }

    /// Number of corners of all pieces, at least [`MIN_CORNERS_PER_PIECE`] each.
    pub fn corner_count(&self) -> usize {
        self.0.iter().map(|piece| piece.points.len().max(MIN_CORNERS_PER_PIECE)).sum()
    }

    /// The smaller side of [`ConvexPieces::bounds`], m.
    pub fn smallest_extent(&self) -> f64 {
        let b = self.bounds();
        (b[2] - b[0]).min(b[3] - b[1])
    }

    /// Half the larger side of [`ConvexPieces::bounds`], m.
    pub fn half_size(&self) -> f64 {
        let b = self.bounds();
        (b[2] - b[0]).max(b[3] - b[1]) / 2.0
    }

    /// The radius, m, of a disc about its own origin; `None` for other shapes.
    pub fn disc_radius(&self) -> Option<f64> {
        match self.0.as_slice() {
            [piece] if piece.is_disc() => Some(piece.radius),
            _ => None,
        }
    }

    /// Signed distance, m: that of the closest pair of pieces.
    pub fn signed_distance_to(&self, other: &ConvexPieces) -> f64 {
        let pairs = self.0.iter().flat_map(|a| other.0.iter().map(move |b| geometry::signed_distance(a, b)));
        pairs.fold(f64::INFINITY, f64::min)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn square(x: f64) -> ConvexPieces {
        ConvexPieces::one(vec![[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]], 0.0).placed([x, 0.0], 0.0)
    }

    #[test]
    fn signed_distances_match_known_values() {
        let ground = Solid::HalfPlane { normal: [0.0, 1.0], offset: -3.0 };
        let two = Solid::Bounded(ConvexPieces([square(-5.0).0, square(5.0).0].concat()));
        let check = |a: &Solid, b: &Solid, wanted: f64| {
            assert!(
                (a.signed_distance(b) - wanted).abs() < 1e-12 || a.signed_distance(b) == wanted,
                "{} != {wanted}",
                a.signed_distance(b)
            );
            assert_eq!(a.signed_distance(b), b.signed_distance(a));
        };
        check(&ground, &two, 2.0);
        check(&two, &Solid::Bounded(square(1.0)), 2.0);
        check(&two, &Solid::Bounded(square(4.0)), -1.0);
        check(&ground, &Solid::HalfPlane { normal: [0.0, -1.0], offset: -1.0 }, 4.0);
        check(&ground, &Solid::HalfPlane { normal: [1.0, 0.0], offset: 0.0 }, f64::NEG_INFINITY);
        assert_eq!(two.bounds(), Some([-6.0, -1.0, 6.0, 1.0]));
        assert_eq!(ground.bounds(), None);
    }

    #[test]
    fn half_plane_rotates_about_its_origin() {
        let ground = Solid::HalfPlane { normal: [0.0, 1.0], offset: 1.0 };
        let turned = ground.placed([2.0, 0.0], std::f64::consts::FRAC_PI_2);
        // The half plane lies to the right of the origin's image: the normal now points along -x.
        let point = |x: f64| ConvexPieces::one(vec![[x, 7.0]], 0.0);
        assert!((turned.signed_distance_to(&point(0.0)) - 1.0).abs() < 1e-12, "{turned:?}");
        assert!((turned.signed_distance_to(&point(3.0)) + 2.0).abs() < 1e-12, "{turned:?}");
        assert_eq!(ground.placed([0.0, 0.5], 0.0), Solid::HalfPlane { normal: [0.0, 1.0], offset: 1.5 });
    }
}
