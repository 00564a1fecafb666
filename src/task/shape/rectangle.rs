//! A box about the origin, its sides along the axes.

use serde::{Deserialize, Serialize};

use super::form::{Form, Moments};
use crate::error::Result;
use crate::task::limits::length;
use crate::task::solid::{Pieces, Solid};

/// A box about the origin, its sides along the axes.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Rectangle {
    /// m
    pub half_width: f64,
    /// m
    pub half_height: f64,
}

impl Form for Rectangle {
    fn validate(&self, _: bool) -> Result<()> {
        length("half_width", self.half_width)?;
        length("half_height", self.half_height)
    }

    fn solid(&self) -> Solid {
        let (w, h) = (self.half_width, self.half_height);
        Solid::Bounded(Pieces::one(vec![[-w, -h], [w, -h], [w, h], [-w, h]], 0.0))
    }

    fn moments(&self) -> Moments {
        let (w, h) = (self.half_width, self.half_height);
        Moments { area: 4.0 * w * h, centre: [0.0; 2], second: (w * w + h * h) / 3.0 }
    }

    fn sample() -> Rectangle {
        Rectangle { half_width: 0.7, half_height: 0.3 }
    }
}
