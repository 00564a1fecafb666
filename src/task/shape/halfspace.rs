//! Everything below a line: ground that never ends; statics only.

use serde::{Deserialize, Serialize};

use super::form::{Form, Moments};
use crate::error::{Error, Result, within};
use crate::task::limits::{FAR, vector};
use crate::task::solid::Solid;

/// Everything below the line `normal . p = offset`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Halfspace {
    /// Unit vector out of it.
    pub normal: [f64; 2],
    /// m
    pub offset: f64,
}

/// By how much the normal's length may differ from 1.
const ROUNDING: f64 = 1e-3;

impl Form for Halfspace {
    fn validate(&self, _: bool) -> Result<()> {
        vector("normal", self.normal, 1.1)?;
        let size = (self.normal[0].powi(2) + self.normal[1].powi(2)).sqrt();
        if (size - 1.0).abs() > ROUNDING {
            return Err(Error::input("normal", format!("{:?}", self.normal), "a vector of length 1"));
        }
        within("offset", self.offset, -FAR, FAR).map(drop)
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
