//! The convex pieces of statics.

use crate::task::geometry::Convex;
use crate::task::solid::Solid;
use crate::world::compile::RolloutModel;

/// A piece of a static, world frame.
#[derive(Clone, Copy)]
pub enum StaticPiece<'a> {
    Convex(&'a Convex),
    HalfPlane { normal: [f64; 2], offset: f64 },
}

impl StaticPiece<'_> {
    /// Rounding radius, m.
    pub fn radius(&self) -> f64 {
        match self {
            StaticPiece::Convex(c) => c.radius,
            StaticPiece::HalfPlane { .. } => 0.0,
        }
    }

    /// Number of corners; 0 for a half plane.
    pub fn corners(&self) -> usize {
        match self {
            StaticPiece::Convex(c) => c.points.len(),
            StaticPiece::HalfPlane { .. } => 0,
        }
    }
}

/// The pieces of all statics, each with its static's index.
pub fn pieces(model: &RolloutModel) -> impl Iterator<Item = (usize, StaticPiece<'_>)> {
    model.statics.iter().enumerate().flat_map(|(owner, fixed)| {
        let (bounded, plane) = match &fixed.shape {
            Solid::Bounded(pieces) => (pieces.0.as_slice(), None),
            Solid::HalfPlane { normal, offset } => {
                (&[][..], Some(StaticPiece::HalfPlane { normal: *normal, offset: *offset }))
            }
        };
        bounded.iter().map(StaticPiece::Convex).chain(plane).map(move |piece| (owner, piece))
    })
}
