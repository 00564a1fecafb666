//! A box about the origin, with sides along the axes.

use serde::{Deserialize, Serialize};

use super::shape_geometry::{Moments, ShapeGeometry};
use crate::error::Result;
use crate::task::limits::check_length;
use crate::task::solid::{ConvexPieces, MIN_CORNERS_PER_PIECE, Solid};

/// A box about the origin, with sides along the axes.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Rectangle {
    /// m
    pub half_width: f64,
    /// m
    pub half_height: f64,
}

impl ShapeGeometry for Rectangle {
    fn validate(&self, _: bool) -> Result<()> {
        check_length("half_width", self.half_width)?;
        check_length("half_height", self.half_height)
    }

    fn corner_count(&self) -> usize {
        MIN_CORNERS_PER_PIECE
    }

    fn solid(&self) -> Solid {
        let (w, h) = (self.half_width, self.half_height);
        Solid::Bounded(ConvexPieces::one(vec![[-w, -h], [w, -h], [w, h], [-w, h]], 0.0))
    }

    fn moments(&self) -> Moments {
        let (w, h) = (self.half_width, self.half_height);
        Moments { area: 4.0 * w * h, centre: [0.0; 2], second: (w * w + h * h) / 3.0 }
    }

    fn sample() -> Rectangle {
        Rectangle { half_width: 0.7, half_height: 0.3 }
    }
}
