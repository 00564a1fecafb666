//! A half space: unbounded ground; for statics only.

use serde::{Deserialize, Serialize};

use super::shape_geometry::{Moments, ShapeGeometry};
use crate::error::{Error, Result, check_range};
use crate::task::limits::{MAX_LENGTH_M, check_vector};
use crate::task::solid::{MIN_CORNERS_PER_PIECE, Solid};

/// The half space below the line `normal . p = offset`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Halfspace {
    /// Outward unit normal.
    pub normal: [f64; 2],
    /// m
    pub offset: f64,
}

/// Tolerance of the normal's length.
const NORMAL_LENGTH_TOLERANCE: f64 = 1e-3;

impl ShapeGeometry for Halfspace {
    fn validate(&self, _: bool) -> Result<()> {
        check_vector("normal", self.normal, 1.1)?;
        let size = (self.normal[0].powi(2) + self.normal[1].powi(2)).sqrt();
        if (size - 1.0).abs() > NORMAL_LENGTH_TOLERANCE {
            return Err(Error::input("normal", format!("{:?}", self.normal), "a vector of length 1"));
        }
        check_range("offset", self.offset, -MAX_LENGTH_M, MAX_LENGTH_M).map(drop)
    }

    fn corner_count(&self) -> usize {
        MIN_CORNERS_PER_PIECE
    }

    fn solid(&self) -> Solid {
        Solid::HalfPlane { normal: self.normal, offset: self.offset }
    }

    fn moments(&self) -> Moments {
        Moments { area: f64::INFINITY, centre: [0.0; 2], second: f64::INFINITY }
    }

    fn sample() -> Halfspace {
        Halfspace { normal: [0.0, 1.0], offset: 0.0 }
    }
}
