//! A line with rounded ends.

use serde::{Deserialize, Serialize};

use super::form::{Form, Moments};
use crate::error::{Error, Result, within};
use crate::task::limits::{FAR, NEAR, length, vector};
use crate::task::solid::{Pieces, Solid};

/// A line with rounded ends; what moves needs a radius.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Segment {
    /// m
    pub from: [f64; 2],
    /// m
    pub to: [f64; 2],
    /// Half the thickness, m.
    #[serde(default)]
    pub radius: f64,
}

impl Segment {
    fn length(&self) -> f64 {
        ((self.to[0] - self.from[0]).powi(2) + (self.to[1] - self.from[1]).powi(2)).sqrt()
    }
}

impl Form for Segment {
    fn validate(&self, movable: bool) -> Result<()> {
        vector("from", self.from, FAR)?;
        vector("to", self.to, FAR)?;
        if self.length() < NEAR {
            let allowed = format!("a point {NEAR} m or more from `from`");
            return Err(Error::input("to", format!("{:?}", self.to), allowed));
        }
        if movable {
            length("radius", self.radius)
        } else {
            within("radius", self.radius, 0.0, FAR).map(drop)
        }
    }

    fn solid(&self) -> Solid {
        Solid::Bounded(Pieces::one(vec![self.from, self.to], self.radius))
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

    fn sample() -> Segment {
        Segment { from: [-0.4, 0.1], to: [0.6, 0.3], radius: 0.2 }
    }
}
