//! The registry of shapes: a shape is one file and one row here.
//!
//! No other module matches on shapes: engines, goals, pictures, observations and policies use a shape's
//! [`Solid`], bounds or moments.

mod compound;
mod disc;
mod halfspace;
mod polygon;
mod rectangle;
mod segment;
mod shape_geometry;

use serde::{Deserialize, Serialize};

pub use compound::{Compound, CompoundPiece};
pub use disc::Disc;
pub use halfspace::Halfspace;
pub use polygon::Polygon;
pub use rectangle::Rectangle;
pub use segment::SegmentShape;
pub use shape_geometry::Moments;
use shape_geometry::ShapeGeometry;

use super::geometry::Aabb;
use super::solid::{ConvexPieces, Solid};
use crate::error::{Error, Result};

/// Generates for each row: its variant, its name in JSON (`type`), its sample, and the conversion to
/// [`ShapeGeometry`].
macro_rules! shapes {
    ($($name:literal $variant:ident($form:ty)),+ $(,)?) => {
        /// A shape; lengths in m, frame of its owner.
        #[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
        #[serde(tag = "type")]
        pub enum Shape {
            $(#[serde(rename = $name)] $variant($form)),+
        }

        impl Shape {
            /// The value of `type`.
            pub fn name(&self) -> &'static str {
                match self {
                    $(Shape::$variant(_) => $name),+
                }
            }

            /// One of each, of about a metre, for tests of all shapes.
            pub fn samples() -> Vec<Shape> {
                vec![$(Shape::$variant(<$form>::sample())),+]
            }
        }

        impl AsRef<dyn ShapeGeometry> for Shape {
            fn as_ref(&self) -> &(dyn ShapeGeometry + 'static) {
                match self {
                    $(Shape::$variant(form) => form),+
                }
            }
        }

        $(impl From<$form> for Shape {
            fn from(form: $form) -> Shape {
                Shape::$variant(form)
            }
        })+
    };
}

shapes! {
    "disc" Disc(Disc),
    "box" Box(Rectangle),
    "polygon" Polygon(Polygon),
    "segment" Segment(SegmentShape),
    "halfspace" Halfspace(Halfspace),
    "compound" Compound(Compound<Shape>),
}

impl Shape {
    /// The solid geometry, owner's frame.
    pub fn solid(&self) -> Solid {
        self.as_ref().solid()
    }

    /// The convex pieces, owner's frame; `None` for a half space.
    pub fn pieces(&self) -> Option<ConvexPieces> {
        match self.solid() {
            Solid::Bounded(pieces) => Some(pieces),
            Solid::HalfPlane { .. } => None,
        }
    }

    /// Number of corners of all pieces, at least `MIN_CORNERS_PER_PIECE` each.
    pub fn corner_count(&self) -> usize {
        self.as_ref().corner_count()
    }

    /// The axis-aligned bounding box, owner's frame; `None` for a half space.
    pub fn bounds(&self) -> Option<Aabb> {
        self.solid().bounds()
    }

    /// The radius, m, of a disc about its owner's origin; `None` for other shapes.
    pub fn disc_radius(&self) -> Option<f64> {
        self.pieces()?.disc_radius()
    }

    /// Mass moments for uniform density.
    pub fn moments(&self) -> Moments {
        self.as_ref().moments()
    }

    /// Checks every value; errors name the field below `shape`. A movable body must have a bounded shape.
    pub fn validate(&self, movable: bool) -> Result<()> {
        if movable && self.pieces().is_none() {
            let bounded: Vec<&str> =
                Shape::samples().iter().filter(|s| s.pieces().is_some()).map(Shape::name).collect();
            let (last, others) = bounded.split_last().expect("there are bounded shapes");
            let allowed = format!("{} or {last} for a movable body", others.join(", "));
            return Err(Error::input("shape.type", format!("{:?}", self.name()), allowed));
        }
        self.as_ref().validate(movable).map_err(|e| e.in_field("shape"))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::task::geometry::polygon_contains;

    #[test]
    fn samples_are_valid_and_serialise_back() {
        for shape in Shape::samples() {
            shape.validate(shape.pieces().is_some()).unwrap();
            let json = serde_json::to_value(&shape).unwrap();
            assert_eq!(json["type"], shape.name());
            assert_eq!(serde_json::from_value::<Shape>(json.clone()).unwrap(), shape);
            let mut odd = json;
            odd["odd"] = 1.into();
            assert!(serde_json::from_value::<Shape>(odd).unwrap_err().to_string().contains("odd"));
        }
    }

    /// Area, centre and second moment against sums over a fine grid of points inside the pieces.
    #[test]
    fn moments_match_numerical_integration() {
        for shape in Shape::samples() {
            let Some(pieces) = shape.pieces() else {
                assert!(shape.moments().area.is_infinite());
                continue;
            };
            let (b, n) = (pieces.bounds(), 800);
            let cell = [(b[2] - b[0]) / f64::from(n), (b[3] - b[1]) / f64::from(n)];
            let (mut count, mut sum, mut squares) = (0.0, [0.0; 2], 0.0);
            for i in 0..n * n {
                let at = |k: usize, j: i32| b[k] + (f64::from(j) + 0.5) * cell[k];
                let p = [at(0, i % n), at(1, i / n)];
                let point = ConvexPieces::one(vec![p], 0.0);
                let within = pieces.0.iter().any(|c| c.points.len() > 2 && polygon_contains(&c.points, p));
                if within || pieces.signed_distance_to(&point) < 0.0 {
                    count += 1.0;
                    sum = [sum[0] + p[0], sum[1] + p[1]];
                    squares += p[0] * p[0] + p[1] * p[1];
                }
            }
            let own = shape.moments();
            let centre = [sum[0] / count, sum[1] / count];
            let second = squares / count - centre[0] * centre[0] - centre[1] * centre[1];
            let close = |a: f64, b: f64| (a - b).abs() < 0.005 * b.abs().max(0.1);
            assert!(close(count * cell[0] * cell[1], own.area), "{shape:?}");
            assert!(close(centre[0], own.centre[0]) && close(centre[1], own.centre[1]), "{shape:?}");
            assert!(close(second, own.second), "{shape:?}: {second} != {}", own.second);
        }
    }

    #[test]
    fn rejects_movable_half_space() {
        let ground: Shape = Halfspace::sample().into();
        let error = ground.validate(true).unwrap_err().to_string();
        assert!(error.contains("\"halfspace\"") && error.contains("disc, box, polygon"), "{error}");
        assert!(error.ends_with("for a movable body"), "{error}");
    }
}
