//! What a shape says of itself.

use crate::error::Result;
use crate::task::solid::Solid;

/// A shape: plain data in its owner's frame, lengths in m.
pub trait Form {
    /// Checks every value; errors name the field, the value and what is allowed. `movable`: it is a body's.
    fn validate(&self, movable: bool) -> Result<()>;

    /// What it is made of.
    fn solid(&self) -> Solid;

    /// How its mass is spread.
    fn moments(&self) -> Moments;

    /// One of about a metre, on which every shape is tested.
    fn sample() -> Self
    where
        Self: Sized;
}

/// How the mass of a shape of uniform density is spread.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Moments {
    /// m^2
    pub area: f64,
    /// Centre of mass, owner's frame, m.
    pub centre: [f64; 2],
    /// Second moment per area about the centre of mass (squared radius of gyration), m^2.
    pub second: f64,
}
