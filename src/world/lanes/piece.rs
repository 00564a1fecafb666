//! The convex pieces that statics are made of, as the kernel takes them.

use crate::task::geometry::Convex;
use crate::task::solid::Solid;
use crate::world::prepare::Prepared;

/// A piece of a static, world frame.
#[derive(Clone, Copy)]
pub enum Piece<'a> {
    Convex(&'a Convex),
    HalfPlane { normal: [f64; 2], offset: f64 },
}

impl Piece<'_> {
    /// By which it is rounded, m.
    pub fn radius(&self) -> f64 {
        match self {
            Piece::Convex(c) => c.radius,
            Piece::HalfPlane { .. } => 0.0,
        }
    }

    /// Number of corners; 0 for a half plane.
    pub fn corners(&self) -> usize {
        match self {
            Piece::Convex(c) => c.points.len(),
            Piece::HalfPlane { .. } => 0,
        }
    }
}

/// The pieces of all statics, each with its static's number.
pub fn pieces(prepared: &Prepared) -> impl Iterator<Item = (usize, Piece<'_>)> {
    prepared.statics.iter().enumerate().flat_map(|(owner, fixed)| {
        let (bounded, plane) = match &fixed.shape {
            Solid::Bounded(pieces) => (pieces.0.as_slice(), None),
            Solid::HalfPlane { normal, offset } => {
                (&[][..], Some(Piece::HalfPlane { normal: *normal, offset: *offset }))
            }
        };
        bounded.iter().map(Piece::Convex).chain(plane).map(move |piece| (owner, piece))
    })
}
