//! A convex polygon, anywhere in its owner's frame.

use serde::{Deserialize, Serialize};

use super::form::{Form, Moments};
use crate::error::{Error, Result};
use crate::task::geometry::signed_area;
use crate::task::limits::{FAR, vector};
use crate::task::solid::{Pieces, Solid};

/// A convex polygon, anywhere in its owner's frame.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Polygon {
    /// Corners, counter-clockwise, m.
    pub vertices: Vec<[f64; 2]>,
}

/// Fewest and most corners.
const CORNERS: [usize; 2] = [3, 32];
/// Smallest area of a triangle of corners, m^2: less is a line.
const FLAT: f64 = 1e-12;

impl Form for Polygon {
    fn validate(&self, _: bool) -> Result<()> {
        let (vertices, n) = (&self.vertices, self.vertices.len());
        let [fewest, most] = CORNERS;
        if !(fewest..=most).contains(&n) {
            return Err(Error::input(
                "vertices",
                format!("{n} vertices"),
                format!("{fewest} to {most} vertices"),
            ));
        }
        for (i, v) in vertices.iter().enumerate() {
            vector(&format!("vertices[{i}]"), *v, FAR)?;
        }
        for i in 0..n {
            let (a, b) = (vertices[i], vertices[(i + 1) % n]);
            // Every other corner, not only the next: a star turns the same way at each corner too.
            if (2..n).any(|k| signed_area(&[a, b, vertices[(i + k) % n]]) <= FLAT) {
                let allowed = "corners of a convex polygon, counter-clockwise, no three on a line";
                return Err(Error::input(format!("vertices[{}]", (i + 1) % n), format!("{b:?}"), allowed));
            }
        }
        Ok(())
    }

    fn solid(&self) -> Solid {
        Solid::Bounded(Pieces::one(self.vertices.clone(), 0.0))
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
