//! A disc about the origin.

use serde::{Deserialize, Serialize};

use super::shape_geometry::{Moments, ShapeGeometry};
use crate::error::Result;
use crate::task::limits::check_length;
use crate::task::solid::{ConvexPieces, MIN_CORNERS_PER_PIECE, Solid};

/// A disc about the origin.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Disc {
    /// m
    pub radius: f64,
}

impl ShapeGeometry for Disc {
    fn validate(&self, _: bool) -> Result<()> {
        check_length("radius", self.radius)
    }

    fn corner_count(&self) -> usize {
        MIN_CORNERS_PER_PIECE
    }

    fn solid(&self) -> Solid {
        Solid::Bounded(ConvexPieces::one(vec![[0.0, 0.0]], self.radius))
    }

    fn moments(&self) -> Moments {
        let square = self.radius * self.radius;
        // pi r r, in this order: golden results depend on the last bit.
        let area = std::f64::consts::PI * self.radius * self.radius;
        Moments { area, centre: [0.0; 2], second: square / 2.0 }
    }

    fn sample() -> Disc {
        Disc { radius: 0.5 }
    }
}
