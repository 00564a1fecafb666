//! The objects of a scene: movable bodies and fixed statics.

use serde::{Deserialize, Serialize};

use super::limits::{
    DENSITY_RANGE_KG_M2, FRICTION_RANGE, INERTIA_RANGE_KG_M2, MASS_RANGE_KG, MAX_LENGTH_M, MAX_SPEED_M_S,
    MAX_SPIN_RAD_S, RESTITUTION_RANGE, check_vector,
};
use super::shape::Shape;
use super::solid::{ConvexPieces, Solid};
use crate::error::{Error, Result, check_range};

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
    /// Moment of inertia about the centre of mass; by default that of a uniform body of this shape.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub inertia: Option<Inertia>,
    /// Coefficient of this surface, by default 0.5; a contact's is the product of both.
    #[serde(default = "default_coefficient")]
    pub friction: f64,
    /// Coefficient of this surface, by default 0.5; a contact's is the product of both.
    #[serde(default = "default_coefficient")]
    pub restitution: f64,
    /// m; required for a rollout unless an action or a trial sets it.
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

/// A body's moment of inertia.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(untagged)]
pub enum Inertia {
    /// kg m^2, for the body's own mass; in proportion for another.
    Value(f64),
    /// That of a round body of the disc's radius.
    Of(RoundBody),
}

/// Mass distribution of a round body.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum RoundBody {
    /// I = m R^2 / 2
    Disc,
    /// I = 2 m R^2 / 5
    SolidSphere,
    /// I = 2 m R^2 / 3
    HollowSphere,
    /// I = m R^2
    Hoop,
}

/// Moments of inertia of round bodies over m R^2.
impl RoundBody {
    fn ratio(self) -> f64 {
        match self {
            RoundBody::Disc => 0.5,
            RoundBody::SolidSphere => 0.4,
            RoundBody::HollowSphere => 2.0 / 3.0,
            RoundBody::Hoop => 1.0,
        }
    }
}

/// An object that never moves.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Static {
    /// Unique among bodies and statics.
    pub name: String,
    /// Shape in its own frame.
    pub shape: Shape,
    /// Coefficient of this surface, by default 1.0, neutral in a product.
    #[serde(default = "neutral_coefficient")]
    pub friction: f64,
    /// Coefficient of this surface, by default 1.0, neutral in a product.
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
    /// Mass (kg) and moment of inertia about the centre of mass (kg m^2). `density` overrides the body's
    /// own density or mass.
    pub fn mass_properties(&self, density: Option<f64>) -> (f64, f64) {
        let moments = self.shape.moments();
        let own = self.mass.unwrap_or_else(|| self.density.unwrap_or(1.0) * moments.area);
        let mass = density.map_or(own, |density| density * moments.area);
        let per_mass = match (self.inertia, self.shape.disc_radius()) {
            (Some(Inertia::Value(inertia)), _) => inertia / own,
            (Some(Inertia::Of(round)), Some(radius)) => round.ratio() * radius * radius,
            _ => moments.second,
        };
        (mass, mass * per_mass)
    }

    /// The body's geometry at its position and angle; `None` without a position.
    pub fn placed(&self) -> Option<ConvexPieces> {
        Some(self.shape.pieces()?.placed(self.position?, self.angle))
    }

    /// Checks every value; errors name the field.
    pub(super) fn validate(&self) -> Result<()> {
        self.shape.validate(true)?;
        if self.mass.is_some() && self.density.is_some() {
            return Err(Error::input("mass", "given together with `density`", "one of `mass` and `density`"));
        }
        for (field, value, [low, high]) in
            [("mass", self.mass, MASS_RANGE_KG), ("density", self.density, DENSITY_RANGE_KG_M2)]
        {
            value.map_or(Ok(0.0), |v| check_range(field, v, low, high))?;
        }
        match self.inertia {
            Some(Inertia::Value(value)) => {
                let [low, high] = INERTIA_RANGE_KG_M2;
                check_range("inertia", value, low, high)?;
            }
            Some(Inertia::Of(_)) if self.shape.disc_radius().is_none() => {
                let allowed = "a number in kg m^2, or a disc as `shape`";
                return Err(Error::input(
                    "inertia",
                    format!("of a round body, for a {}", self.shape.name()),
                    allowed,
                ));
            }
            _ => {}
        }
        check_range("friction", self.friction, FRICTION_RANGE[0], FRICTION_RANGE[1])?;
        check_range("restitution", self.restitution, RESTITUTION_RANGE[0], RESTITUTION_RANGE[1])?;
        if let Some(p) = self.position {
            check_vector("position", p, MAX_LENGTH_M)?;
        }
        check_range("angle", self.angle, -1e6, 1e6)?;
        check_vector("velocity", self.velocity, MAX_SPEED_M_S)?;
        check_range("angular_velocity", self.angular_velocity, -MAX_SPIN_RAD_S, MAX_SPIN_RAD_S)?;
        Ok(())
    }
}

impl Static {
    /// The static's geometry at its position and angle.
    pub fn placed(&self) -> Solid {
        self.shape.solid().placed(self.position, self.angle)
    }

    /// Checks every value; errors name the field.
    pub(super) fn validate(&self) -> Result<()> {
        self.shape.validate(false)?;
        check_range("friction", self.friction, FRICTION_RANGE[0], FRICTION_RANGE[1])?;
        check_range("restitution", self.restitution, RESTITUTION_RANGE[0], RESTITUTION_RANGE[1])?;
        check_vector("position", self.position, MAX_LENGTH_M)?;
        check_range("angle", self.angle, -1e6, 1e6)?;
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
