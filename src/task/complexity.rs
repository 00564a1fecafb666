//! Geometric complexity of a scene: limits on the number of its corners.
//!
//! Validation, placement and engines visit corners of shapes and pairs of them; these limits bound their time.

use std::collections::HashMap;

use super::body::{Body, Static};
use super::goal::Goal;
use super::limits::check_name_length;
use super::scene::Scene;
use super::shape::Shape;
use super::solid::{ConvexPieces, MIN_CORNERS_PER_PIECE, Solid};
use crate::error::{Error, Result};

/// Largest number of corners of a scene: those of its bodies, statics, added objects and goal region together. The check of overlaps
/// visits every pair of corners, in up to 0.1 s, and engines every pair of pieces.
pub const MAX_CORNERS: usize = 4096;
/// Largest number of corners of the objects that the settings of a scene override, counted once for each setting. Each such object is
/// validated again.
pub const MAX_SETTING_CORNERS: usize = 65_536;
/// Corners that a setting counts as, whatever it overrides.
const CORNERS_PER_SETTING: usize = 16;

impl Scene {
    /// Number of corners of the objects, interventions included, and of the goal region.
    pub fn corner_count(&self) -> usize {
        let bodies = self.bodies.iter().map(|b| b.shape.corner_count());
        let statics = self.statics.iter().map(|s| s.shape.corner_count());
        let added = self.interventions.iter().map(|i| i.added_shape().map_or(0, |s| s.corner_count()));
        bodies.chain(statics).chain(added).sum::<usize>() + self.region_corner_count()
    }

    /// Errors if the scene has too many corners.
    pub(super) fn check_corners(&self) -> Result<()> {
        let count = self.corner_count();
        if count <= MAX_CORNERS {
            return Ok(());
        }
        let allowed =
            format!("at most {MAX_CORNERS} corners of all shapes, pieces and the goal region together");
        Err(Error::input("bodies", format!("{count} corners in the scene"), allowed))
    }

    /// Checks the objects that settings override, and no others.
    pub(super) fn validate_settings(&self) -> Result<()> {
        let bodies: HashMap<&str, &Body> = self.bodies.iter().map(|b| (b.name.as_str(), b)).collect();
        let statics: HashMap<&str, &Static> = self.statics.iter().map(|s| (s.name.as_str(), s)).collect();
        let mut corners = 0;
        for (setting, overrides) in &self.settings {
            check_name_length("settings", setting)?;
            corners += CORNERS_PER_SETTING;
            check_setting_corners(corners)?;
            for (name, own) in &overrides.bodies {
                let Some(body) = bodies.get(name.as_str()) else {
                    return self.check_name(&format!("settings.{setting}.bodies"), name, false);
                };
                let varied = own.applied_to(body);
                varied.validate().map_err(|e| e.in_field(&format!("settings.{setting}.bodies.{name}")))?;
                corners += varied.shape.corner_count();
                check_setting_corners(corners)?;
            }
            for (name, own) in &overrides.statics {
                let Some(fixed) = statics.get(name.as_str()) else {
                    return Err(self.unknown_static(&format!("settings.{setting}.statics"), name));
                };
                let varied = own.applied_to(fixed);
                varied.validate().map_err(|e| e.in_field(&format!("settings.{setting}.statics.{name}")))?;
                corners += varied.shape.corner_count();
                check_setting_corners(corners)?;
            }
        }
        Ok(())
    }

    fn unknown_static(&self, field: &str, name: &str) -> Error {
        let known = self.statics.iter().map(|s| format!("{:?}", s.name)).collect::<Vec<_>>().join(", ");
        Error::input(field, format!("{name:?}"), format!("one of {known}"))
    }
}

fn check_setting_corners(count: usize) -> Result<()> {
    if count <= MAX_SETTING_CORNERS {
        return Ok(());
    }
    let allowed = format!(
        "at most {MAX_SETTING_CORNERS} corners of the objects that settings override, in all settings together"
    );
    Err(Error::input("settings", format!("{count} or more corners"), allowed))
}

/// Pieces and corners of an object, from which the work of a time step follows.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ShapeSize {
    pub pieces: u64,
    /// As [`Shape::corner_count`](super::Shape::corner_count) counts them.
    pub corners: u64,
}

impl ShapeSize {
    /// Of some pieces.
    pub fn of(pieces: &ConvexPieces) -> ShapeSize {
        ShapeSize { pieces: pieces.0.len() as u64, corners: pieces.corner_count() as u64 }
    }

    /// Of a solid.
    pub fn of_solid(solid: &Solid) -> ShapeSize {
        match solid {
            Solid::Bounded(pieces) => ShapeSize::of(pieces),
            Solid::HalfPlane { .. } => ShapeSize { pieces: 1, corners: MIN_CORNERS_PER_PIECE as u64 },
        }
    }

    /// Work for contact with another object: corners of all pairs of pieces; 0 for a pair of simple ones.
    fn contact_work(self, other: ShapeSize) -> u64 {
        (self.corners * other.pieces + other.corners * self.pieces) / (2 * MIN_CORNERS_PER_PIECE as u64) - 1
    }
}

/// Number of distant pairs of pieces that take as long as a body.
const PAIRS_PER_BODY: u64 = 32;
/// Number of corners of a goal region, and of pairs of corners of two objects of a goal, that take as long as a body.
const REGION_CORNERS_PER_BODY: u64 = 512;
const GOAL_PAIRS_PER_BODY: u64 = 64;

/// Work of one time step, in units of a simple body: about a microsecond in the general engine.
///
/// Engines visit every body, every pair of pieces to see whether it is near, and the outlines of pairs in contact; a body is taken to
/// be in contact with the most complex other object. Measured with rows of 1 to 64 bodies of 1 to 32 pieces that touch: 0.1 to 10
/// microseconds a unit.
pub fn step_cost(bodies: &[ShapeSize], statics: &[ShapeSize], goal_work: u64) -> u64 {
    let pieces = |of: &[ShapeSize]| of.iter().map(|s| s.pieces).sum::<u64>();
    let (moving, fixed) = (pieces(bodies), pieces(statics));
    let pairs = moving * moving.saturating_sub(1) / 2 + moving * fixed;
    let contact = |(i, own): (usize, &ShapeSize)| {
        let others = bodies.iter().enumerate().filter(|(k, _)| *k != i).map(|(_, s)| s).chain(statics);
        others.map(|other| own.contact_work(*other)).max().unwrap_or(0)
    };
    let contacts: u64 = bodies.iter().enumerate().map(contact).sum();
    bodies.len() as u64 + pairs / PAIRS_PER_BODY + contacts + goal_work
}

/// Work to see whether a body is in a region of some corners.
pub fn region_work(corners: usize) -> u64 {
    corners as u64 / REGION_CORNERS_PER_BODY
}

/// Work to measure the distance of two objects of a goal.
pub fn distance_work(objects: [ShapeSize; 2]) -> u64 {
    objects[0].corners * objects[1].corners / GOAL_PAIRS_PER_BODY
}

impl Scene {
    /// [`step_cost`] of the scene, with the objects that interventions add.
    pub fn step_cost(&self) -> u64 {
        let size = |shape: &Shape| ShapeSize::of_solid(&shape.solid());
        let (mut bodies, mut statics): (Vec<ShapeSize>, Vec<ShapeSize>) = (
            self.bodies.iter().map(|b| size(&b.shape)).collect(),
            self.statics.iter().map(|s| size(&s.shape)).collect(),
        );
        for change in &self.interventions {
            let sizes = if change.adds_body() { &mut bodies } else { &mut statics };
            sizes.extend(change.added_shape().map(size));
        }
        let named = |name: &str| {
            let body = self.body(name).map(|b| &b.shape);
            let fixed = || self.statics.iter().find(|s| s.name == name).map(|s| &s.shape);
            body.or_else(fixed).map_or(ShapeSize { pieces: 1, corners: 1 }, size)
        };
        let goal_work = match &self.goal {
            Some(Goal::Contact { bodies, .. } | Goal::Apart { bodies, .. }) => {
                distance_work([named(&bodies[0]), named(&bodies[1])])
            }
            _ => region_work(self.region_corner_count()),
        };
        step_cost(&bodies, &statics, goal_work)
    }

    fn region_corner_count(&self) -> usize {
        match &self.goal {
            Some(Goal::Inside { region, .. }) => region.len(),
            _ => 0,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn size(pieces: u64, corners: u64) -> ShapeSize {
        ShapeSize { pieces, corners: corners * pieces }
    }

    /// A few simple bodies cost one each, so that the limit on work is that on bodies and steps; compound bodies cost more.
    #[test]
    fn simple_bodies_cost_one() {
        let simple = size(1, 4);
        for (bodies, statics) in [(1, 0), (3, 5), (2, 10)] {
            assert_eq!(
                step_cost(&vec![simple; bodies], &vec![simple; statics], region_work(12)),
                bodies as u64
            );
        }
        let jars = step_cost(&[size(3, 4); 2], &[simple], 0);
        assert!((10..30).contains(&jars), "{jars}");
        let rows = step_cost(&[size(32, 4); 8], &[size(32, 4); 8], region_work(4096));
        assert!(rows > 8 * 1000, "{rows}");
    }
}
