//! The things of a scene: bodies, which move, and statics, which never do.

use serde::{Deserialize, Serialize};

use super::limits::{DENSITIES, FAR, FAST, FAST_SPIN, MASSES, vector};
use super::shape::Shape;
use super::solid::{Pieces, Solid};
use crate::error::{Error, Result, within};

/// A movable body.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Body {
    /// Unique among bodies and statics.
    pub name: String,
    /// Shape in the body's frame.
    pub shape: Shape,
    /// kg; instead of `density`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub mass: Option<f64>,
    /// kg/m^2; 1.0 if neither this nor `mass` is given.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub density: Option<f64>,
    /// Coefficient of this surface; a contact's is the product of both.
    #[serde(default = "default_coefficient")]
    pub friction: f64,
    /// Coefficient of this surface; a contact's is the product of both.
    #[serde(default = "default_coefficient")]
    pub restitution: f64,
    /// m; needed for a rollout unless an action or a trial gives it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub position: Option<[f64; 2]>,
    /// rad
    #[serde(default)]
    pub angle: f64,
    /// m/s
    #[serde(default)]
    pub velocity: [f64; 2],
    /// rad/s
    #[serde(default)]
    pub angular_velocity: f64,
}

/// A thing that never moves.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Static {
    /// Unique among bodies and statics.
    pub name: String,
    /// Shape in its own frame.
    pub shape: Shape,
    /// Coefficient of this surface.
    #[serde(default = "neutral_coefficient")]
    pub friction: f64,
    /// Coefficient of this surface.
    #[serde(default = "neutral_coefficient")]
    pub restitution: f64,
    /// m
    #[serde(default)]
    pub position: [f64; 2],
    /// rad
    #[serde(default)]
    pub angle: f64,
}

impl Body {
    /// Mass (kg) and moment of inertia about the centre of mass (kg m^2) at `density` if given, else the body's own.
    pub fn mass_properties(&self, density: Option<f64>) -> (f64, f64) {
        let moments = self.shape.moments();
        let mass = match (density, self.mass, self.density) {
            (Some(density), _, _) => density * moments.area,
            (None, Some(mass), _) => mass,
            (None, None, own) => own.unwrap_or(1.0) * moments.area,
        };
        (mass, mass * moments.second)
    }

    /// The body where it stands; `None` if it has no position yet.
    pub fn placed(&self) -> Option<Pieces> {
        Some(self.shape.pieces()?.placed(self.position?, self.angle))
    }

    /// Checks every value; errors name the field.
    pub(super) fn validate(&self) -> Result<()> {
        self.shape.validate(true)?;
        if self.mass.is_some() && self.density.is_some() {
            return Err(Error::input("mass", "given beside `density`", "one of `mass` and `density`"));
        }
        for (field, value, [low, high]) in [("mass", self.mass, MASSES), ("density", self.density, DENSITIES)]
        {
            value.map_or(Ok(0.0), |v| within(field, v, low, high))?;
        }
        within("friction", self.friction, 0.0, 100.0)?;
        within("restitution", self.restitution, 0.0, 1.0)?;
        if let Some(p) = self.position {
            vector("position", p, FAR)?;
        }
        within("angle", self.angle, -1e6, 1e6)?;
        vector("velocity", self.velocity, FAST)?;
        within("angular_velocity", self.angular_velocity, -FAST_SPIN, FAST_SPIN)?;
        Ok(())
    }
}

impl Static {
    /// The static where it stands.
    pub fn placed(&self) -> Solid {
        self.shape.solid().placed(self.position, self.angle)
    }

    /// Checks every value; errors name the field.
    pub(super) fn validate(&self) -> Result<()> {
        self.shape.validate(false)?;
        within("friction", self.friction, 0.0, 100.0)?;
        within("restitution", self.restitution, 0.0, 1.0)?;
        vector("position", self.position, FAR)?;
        within("angle", self.angle, -1e6, 1e6)?;
        if self.angle != 0.0 && self.shape.pieces().is_none() {
            let allowed = format!("0 for a {}; turn its `normal` instead", self.shape.name());
            return Err(Error::input("angle", self.angle, allowed));
        }
        Ok(())
    }
}

fn default_coefficient() -> f64 {
    0.5
}
fn neutral_coefficient() -> f64 {
    1.0
}
