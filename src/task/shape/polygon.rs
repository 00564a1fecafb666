//! A convex polygon, anywhere in its owner's frame.

use serde::{Deserialize, Serialize};

use super::shape_geometry::{Moments, ShapeGeometry};
use crate::error::{Error, Result};
use crate::task::geometry::signed_area;
use crate::task::limits::{MAX_LENGTH_M, check_vector};
use crate::task::solid::{ConvexPieces, MIN_CORNERS_PER_PIECE, Solid};

/// A convex polygon, anywhere in its owner's frame.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Polygon {
    /// Corners, counter-clockwise, m.
    pub vertices: Vec<[f64; 2]>,
}

/// Minimum and maximum number of corners.
const CORNER_COUNT_RANGE: [usize; 2] = [3, 32];
/// Smallest area of a triangle of corners, m^2; smaller counts as collinear.
const MIN_TRIANGLE_AREA_M2: f64 = 1e-12;

impl ShapeGeometry for Polygon {
    fn validate(&self, _: bool) -> Result<()> {
        let (vertices, n) = (&self.vertices, self.vertices.len());
        let [fewest, most] = CORNER_COUNT_RANGE;
        if !(fewest..=most).contains(&n) {
            let allowed = format!("{fewest} to {most} vertices");
            return Err(Error::input("vertices", format!("{n} vertices"), allowed));
        }
        for (i, v) in vertices.iter().enumerate() {
            check_vector(format_args!("vertices[{i}]"), *v, MAX_LENGTH_M)?;
        }
        for i in 0..n {
            let (a, b) = (vertices[i], vertices[(i + 1) % n]);
            // All corners are tested, not only the next: a self-intersecting star also turns the
            // same way at each corner.
            if (2..n).any(|k| signed_area(&[a, b, vertices[(i + k) % n]]) <= MIN_TRIANGLE_AREA_M2) {
                let allowed = "corners of a convex polygon, counter-clockwise, no three on a line";
                return Err(Error::input(format!("vertices[{}]", (i + 1) % n), format!("{b:?}"), allowed));
            }
        }
        Ok(())
    }

    fn corner_count(&self) -> usize {
        self.vertices.len().max(MIN_CORNERS_PER_PIECE)
    }

    fn solid(&self) -> Solid {
        Solid::Bounded(ConvexPieces::one(self.vertices.clone(), 0.0))
    }

    /// Green's theorem over the triangles from the origin.
    fn moments(&self) -> Moments {
        let n = self.vertices.len();
        let (mut area, mut sum, mut second) = (0.0, [0.0, 0.0], 0.0);
        for i in 0..n {
            let (a, b) = (self.vertices[i], self.vertices[(i + 1) % n]);
            let cross = a[0] * b[1] - a[1] * b[0];
            area += cross / 2.0;
            sum = [sum[0] + cross * (a[0] + b[0]) / 6.0, sum[1] + cross * (a[1] + b[1]) / 6.0];
            let squares = |k: usize| a[k] * a[k] + a[k] * b[k] + b[k] * b[k];
            second += cross / 2.0 * (squares(0) + squares(1)) / 6.0;
        }
        let centre = [sum[0] / area, sum[1] / area];
        Moments { area, centre, second: second / area - centre[0].powi(2) - centre[1].powi(2) }
    }

    fn sample() -> Polygon {
        Polygon { vertices: vec![[-0.2, -0.3], [0.8, -0.2], [0.5, 0.6], [-0.1, 0.4]] }
    }
}
