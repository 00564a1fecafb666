//! Latent factors: density, friction and restitution of the objects that carry them.
//!
//! Source: Semage et al., section on the problem setting: mass, friction and coefficient of restitution are
//! hidden parameters; composition is homogeneous, so all carriers of a scene share one value each.
//!
//! Differences from the source: mass is given as density (kg/m^2), since the bodies of a task differ in size.

use serde::{Deserialize, Serialize};

use crate::error::{Error, Result, check_range};

/// Values of the latent factors; `None` keeps the scene's own.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Latents {
    /// kg/m^2 of every carrying body.
    #[serde(alias = "mass", skip_serializing_if = "Option::is_none")]
    pub density: Option<f64>,
    /// Friction coefficient of every carrying surface; a contact's is the product of both surfaces'.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub friction: Option<f64>,
    /// Restitution coefficient of every carrying surface; a contact's is the product of both surfaces'.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub restitution: Option<f64>,
}

/// The declaration of a latent factor.
#[derive(Debug, PartialEq)]
pub struct LatentFactor {
    /// Name in files and on the wire.
    pub name: &'static str,
    /// SI unit.
    pub unit: &'static str,
    /// Bounds, inclusive.
    pub bounds: [f64; 2],
}

/// The latent factors, in the order of all vectors of latents.
pub const FACTORS: [LatentFactor; 3] = [
    LatentFactor { name: "density", unit: "kg/m^2", bounds: [1e-3, 1e3] },
    LatentFactor { name: "friction", unit: "1", bounds: [0.0, 10.0] },
    LatentFactor { name: "restitution", unit: "1", bounds: [0.0, 1.0] },
];

impl Latents {
    /// Latents with all three values, in the order of [`FACTORS`].
    pub fn of(values: [f64; 3]) -> Latents {
        Latents { density: Some(values[0]), friction: Some(values[1]), restitution: Some(values[2]) }
    }

    /// The values in the order of [`FACTORS`].
    pub fn values(&self) -> [Option<f64>; 3] {
        [self.density, self.friction, self.restitution]
    }

    /// These latents where set, `other`'s elsewhere.
    pub fn or(self, other: Latents) -> Latents {
        Latents {
            density: self.density.or(other.density),
            friction: self.friction.or(other.friction),
            restitution: self.restitution.or(other.restitution),
        }
    }

    /// Errors unless every value is within its factor's bounds.
    pub fn validate(&self) -> Result<()> {
        for (factor, value) in FACTORS.iter().zip(self.values()) {
            if let Some(v) = value {
                check_range(factor.name, v, factor.bounds[0], factor.bounds[1])
                    .map_err(|e| e.in_field("latents"))?;
            }
        }
        Ok(())
    }
}

/// The nearest vector of latents within the bounds.
pub fn clamp(values: [f64; 3]) -> [f64; 3] {
    std::array::from_fn(|i| values[i].clamp(FACTORS[i].bounds[0], FACTORS[i].bounds[1]))
}

/// Index of the factor named `name` (`mass` is an alias of `density`).
pub fn factor_index(name: &str) -> Result<usize> {
    let name = if name == "mass" { "density" } else { name };
    FACTORS
        .iter()
        .position(|f| f.name == name)
        .ok_or_else(|| Error::not_found("latent factor", name, FACTORS.iter().map(|f| f.name)))
}
