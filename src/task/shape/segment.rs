//! A line segment with rounded ends (a capsule).

use serde::{Deserialize, Serialize};

use super::shape_geometry::{Moments, ShapeGeometry};
use crate::error::{Error, Result, check_range};
use crate::task::limits::{MAX_LENGTH_M, MIN_LENGTH_M, check_length, check_vector};
use crate::task::solid::{ConvexPieces, MIN_CORNERS_PER_PIECE, Solid};

/// A line segment with rounded ends; a movable one needs a positive radius.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SegmentShape {
    /// m
    pub from: [f64; 2],
    /// m
    pub to: [f64; 2],
    /// Half the thickness, m.
    #[serde(default)]
    pub radius: f64,
}

impl SegmentShape {
    fn length(&self) -> f64 {
        ((self.to[0] - self.from[0]).powi(2) + (self.to[1] - self.from[1]).powi(2)).sqrt()
    }
}

impl ShapeGeometry for SegmentShape {
    fn validate(&self, movable: bool) -> Result<()> {
        check_vector("from", self.from, MAX_LENGTH_M)?;
        check_vector("to", self.to, MAX_LENGTH_M)?;
        if self.length() < MIN_LENGTH_M {
            let allowed = format!("a point {MIN_LENGTH_M} m or more from `from`");
            return Err(Error::input("to", format!("{:?}", self.to), allowed));
        }
        if movable {
            check_length("radius", self.radius)
        } else {
            check_range("radius", self.radius, 0.0, MAX_LENGTH_M).map(drop)
        }
    }

    fn corner_count(&self) -> usize {
        MIN_CORNERS_PER_PIECE
    }

    fn solid(&self) -> Solid {
        Solid::Bounded(ConvexPieces::one(vec![self.from, self.to], self.radius))
    }

    /// A rectangle and two half discs, each half disc's centroid at 4 r / 3 pi beyond the end.
    fn moments(&self) -> Moments {
        let (length, r) = (self.length(), self.radius);
        let (ends, middle) = (std::f64::consts::PI * r * r, 2.0 * r * length);
        let beyond = 4.0 * r / (3.0 * std::f64::consts::PI);
        let reach = length / 2.0 + beyond;
        let half_disc = r * r / 2.0 - beyond.powi(2);
        let rectangle = (length * length + 4.0 * r * r) / 12.0;
        let area = ends + middle;
        Moments {
            area,
            centre: [(self.from[0] + self.to[0]) / 2.0, (self.from[1] + self.to[1]) / 2.0],
            second: (middle * rectangle + ends * (half_disc + reach * reach)) / area,
        }
    }

    fn sample() -> SegmentShape {
        SegmentShape { from: [-0.4, 0.1], to: [0.6, 0.3], radius: 0.2 }
    }
}
