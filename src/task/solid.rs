//! What shapes are made of, as engines, goals, pictures and policies take it: convex pieces, or a half plane.
//!
//! Whoever asks about a shape asks this, so that a new shape needs no word anywhere else.

use super::geometry::{self, Bounds, Convex};

/// What a shape is made of, in its owner's frame or the world's.
#[derive(Clone, Debug, PartialEq)]
pub enum Solid {
    /// Something bounded.
    Bounded(Pieces),
    /// Everything below the line `normal . p = offset`, of which there is no end.
    HalfPlane { normal: [f64; 2], offset: f64 },
}

/// Convex pieces that make one thing; at least one.
#[derive(Clone, Debug, PartialEq)]
pub struct Pieces(pub Vec<Convex>);

impl Solid {
    /// The solid turned by `angle` (rad) about the origin and then moved to `position` (m).
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

    /// The smallest axis-aligned box around it; `None` for what has no end.
    pub fn bounds(&self) -> Option<Bounds> {
        match self {
            Solid::Bounded(pieces) => Some(pieces.bounds()),
            Solid::HalfPlane { .. } => None,
        }
    }

    /// Signed distance to something bounded, m: positive apart, negative by how far they overlap.
    pub fn gap_to(&self, other: &Pieces) -> f64 {
        match self {
            Solid::Bounded(own) => own.gap_to(other),
            Solid::HalfPlane { normal, offset } => {
                let above = |p: &[f64; 2]| normal[0] * p[0] + normal[1] * p[1] - offset;
                let lowest = |c: &Convex| c.points.iter().map(above).fold(f64::INFINITY, f64::min) - c.radius;
                other.0.iter().map(lowest).fold(f64::INFINITY, f64::min)
            }
        }
    }

    /// Signed distance to another solid, m. Half planes overlap without end unless they face away from each other.
    pub fn gap(&self, other: &Solid) -> f64 {
        match (self, other) {
            (_, Solid::Bounded(pieces)) => self.gap_to(pieces),
            (Solid::Bounded(pieces), _) => other.gap_to(pieces),
            (Solid::HalfPlane { normal: a, offset }, Solid::HalfPlane { normal: b, offset: beyond }) => {
                let opposed = a[0] * b[0] + a[1] * b[1] < -1.0 + 1e-9;
                if opposed { -(offset + beyond) } else { f64::NEG_INFINITY }
            }
        }
    }
}

impl Pieces {
    /// A thing of one piece.
    pub fn one(points: Vec<[f64; 2]>, radius: f64) -> Pieces {
        Pieces(vec![Convex { points, radius }])
    }

    /// The pieces turned by `angle` (rad) about the origin and then moved to `position` (m).
    pub fn placed(&self, position: [f64; 2], angle: f64) -> Pieces {
        Pieces(self.0.iter().map(|piece| piece.placed(position, angle)).collect())
    }

    /// The smallest axis-aligned box around all.
    pub fn bounds(&self) -> Bounds {
        let all = self.0.iter().map(Convex::bounds);
        all.reduce(geometry::join).expect("a solid has at least one piece")
    }

    /// The smaller side of [`Pieces::bounds`], m.
    pub fn smallest_extent(&self) -> f64 {
        let b = self.bounds();
        (b[2] - b[0]).min(b[3] - b[1])
    }

    /// Half the larger side of [`Pieces::bounds`], m.
    pub fn half_size(&self) -> f64 {
        let b = self.bounds();
        (b[2] - b[0]).max(b[3] - b[1]) / 2.0
    }

    /// The radius, m, of a disc about its own origin; `None` for anything else.
    pub fn disc_radius(&self) -> Option<f64> {
        match self.0.as_slice() {
            [piece] if piece.is_disc() => Some(piece.radius),
            _ => None,
        }
    }

    /// Signed distance, m: that of the two pieces that are closest.
    pub fn gap_to(&self, other: &Pieces) -> f64 {
        let pairs = self.0.iter().flat_map(|a| other.0.iter().map(move |b| geometry::gap(a, b)));
        pairs.fold(f64::INFINITY, f64::min)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn square(x: f64) -> Pieces {
        Pieces::one(vec![[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]], 0.0).placed([x, 0.0], 0.0)
    }

    #[test]
    fn gaps_between_solids_known_by_hand() {
        let ground = Solid::HalfPlane { normal: [0.0, 1.0], offset: -3.0 };
        let two = Solid::Bounded(Pieces([square(-5.0).0, square(5.0).0].concat()));
        let check = |a: &Solid, b: &Solid, wanted: f64| {
            assert!((a.gap(b) - wanted).abs() < 1e-12 || a.gap(b) == wanted, "{} != {wanted}", a.gap(b));
            assert_eq!(a.gap(b), b.gap(a));
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
    fn a_half_plane_turns_about_its_origin() {
        let ground = Solid::HalfPlane { normal: [0.0, 1.0], offset: 1.0 };
        let turned = ground.placed([2.0, 0.0], std::f64::consts::FRAC_PI_2);
        // Everything to the right of x = 1 - 2 ... mirrored: the normal points to -x now.
        let point = |x: f64| Pieces::one(vec![[x, 7.0]], 0.0);
        assert!((turned.gap_to(&point(0.0)) - 1.0).abs() < 1e-12, "{turned:?}");
        assert!((turned.gap_to(&point(3.0)) + 2.0).abs() < 1e-12, "{turned:?}");
        assert_eq!(ground.placed([0.0, 0.5], 0.0), Solid::HalfPlane { normal: [0.0, 1.0], offset: 1.5 });
    }
}
