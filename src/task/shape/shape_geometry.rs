//! The geometry of a shape, as one trait.

use crate::error::Result;
use crate::task::solid::Solid;

/// A shape: plain data in its owner's frame, lengths in m.
pub trait ShapeGeometry {
    /// Checks every value; errors name the field, the value and the allowed range. `movable`: the shape
    /// of a body.
    fn validate(&self, movable: bool) -> Result<()>;

    /// Number of corners of all pieces, at least `MIN_CORNERS_PER_PIECE` each.
    fn corner_count(&self) -> usize;

    /// The solid geometry.
    fn solid(&self) -> Solid;

    /// Mass moments for uniform density.
    fn moments(&self) -> Moments;

    /// An example of about a metre, on which every shape is tested.
    fn sample() -> Self
    where
        Self: Sized;
}

/// Moments of a shape of uniform density.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Moments {
    /// m^2
    pub area: f64,
    /// Centre of mass, owner's frame, m.
    pub centre: [f64; 2],
    /// Second moment per area about the centre of mass (squared radius of gyration), m^2.
    pub second: f64,
}
