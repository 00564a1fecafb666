//! A disc about the origin.

use serde::{Deserialize, Serialize};

use super::form::{Form, Moments};
use crate::error::Result;
use crate::task::limits::length;
use crate::task::solid::{Pieces, Solid};

/// A disc about the origin.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Disc {
    /// m
    pub radius: f64,
}

impl Form for Disc {
    fn validate(&self, _: bool) -> Result<()> {
        length("radius", self.radius)
    }

    fn solid(&self) -> Solid {
        Solid::Bounded(Pieces::one(vec![[0.0, 0.0]], self.radius))
    }

    fn moments(&self) -> Moments {
        let square = self.radius * self.radius;
        // pi r r, in this order: goldens hold the last bit.
        let area = std::f64::consts::PI * self.radius * self.radius;
        Moments { area, centre: [0.0; 2], second: square / 2.0 }
    }

    fn sample() -> Disc {
        Disc { radius: 0.5 }
    }
}
