//! Validation of scenes: values within limits, names that exist, no overlaps.

use std::collections::HashSet;

use super::body::Body;
use super::geometry::{Aabb, disjoint, signed_area};
use super::goal::Goal;
use super::limits::{MAX_LENGTH_M, TIME_STEP_RANGE_S, check_name_length, check_text_length, check_vector};
use super::placement;
use super::scene::{FORMAT, JOINT_FORMAT, Scene};
use super::solid::{ConvexPieces, Solid};
use super::timeline;
use crate::error::{Error, Result, check_format, check_range};

/// Overlap up to this fraction of the smaller body is attributed to measurement error and accepted.
const MAX_OVERLAP_FRACTION: f64 = 0.05;
/// Largest number of effects, and of quantities to estimate.
const MAX_LIST_LENGTH: usize = 64;

impl Scene {
    /// Checks every value and reference; the first problem is the error.
    pub fn validate(&self) -> Result<()> {
        if self.format != JOINT_FORMAT {
            check_format(&self.format, FORMAT)?;
            if !(self.joints.is_empty() && self.motors.is_empty()) {
                return Err(Error::input(
                    "format",
                    FORMAT,
                    format!("{JOINT_FORMAT} for a scene with joints"),
                ));
            }
        }
        check_vector("gravity", self.gravity, 1e4)?;
        check_text_length("name", &self.name)?;
        self.check_lists()?;
        self.check_corners()?;
        if self.bodies.is_empty() || self.bodies.len() > 64 {
            return Err(Error::input("bodies", format!("{} bodies", self.bodies.len()), "1 to 64 bodies"));
        }
        if self.statics.len() > 256 {
            let allowed = "at most 256 statics";
            return Err(Error::input("statics", format!("{} statics", self.statics.len()), allowed));
        }
        let mut names = HashSet::new();
        for (i, body) in self.bodies.iter().enumerate() {
            body.validate().map_err(|e| e.in_field(&format!("bodies[{i}]")))?;
            unique(&mut names, &format!("bodies[{i}].name"), &body.name)?;
        }
        for (i, fixed) in self.statics.iter().enumerate() {
            fixed.validate().map_err(|e| e.in_field(&format!("statics[{i}]")))?;
            unique(&mut names, &format!("statics[{i}].name"), &fixed.name)?;
        }
        check_range("time_step", self.time_step, TIME_STEP_RANGE_S[0], TIME_STEP_RANGE_S[1])?;
        check_range("steps", f64::from(self.steps), 1.0, 1e6)?;
        check_range("observe_every", f64::from(self.observe_every), 1.0, 1e6)?;
        if let Some(damping) = self.damping
            && !(damping > 0.0 && damping <= 1.0)
        {
            let allowed = "the fraction of velocity kept per second, in (0, 1]";
            return Err(Error::input("damping", damping, allowed));
        }
        self.contact_rules.iter().try_for_each(|rules| rules.validate())?;
        self.goal.iter().try_for_each(|goal| self.validate_goal(goal).map_err(|e| e.in_field("goal")))?;
        for (i, name) in self.carriers.iter().flatten().enumerate() {
            self.check_name(&format!("carriers[{i}]"), name, true)?;
        }
        self.validate_settings()?;
        if let Some(space) = &self.action {
            placement::validate(space, self).map_err(|e| e.in_field("action"))?;
        }
        self.validate_joints()?;
        if self.joints.is_empty() {
            self.validate_apart()?;
        }
        timeline::schedule(self).map(drop)
    }

    /// Errors if a list of names or effects is too long.
    fn check_lists(&self) -> Result<()> {
        let objects = self.bodies.len() + self.statics.len();
        let carriers = self.carriers.as_ref().map_or(0, Vec::len);
        for (field, count, most) in [
            ("effects", self.effects.len(), MAX_LIST_LENGTH),
            ("calibrate", self.calibrate.len(), MAX_LIST_LENGTH),
            ("per_setting", self.per_setting.len(), MAX_LIST_LENGTH),
            ("carriers", carriers, objects),
        ] {
            if count > most {
                return Err(Error::input(
                    field,
                    format!("{count} entries"),
                    format!("at most {most} entries"),
                ));
            }
        }
        Ok(())
    }

    fn validate_goal(&self, goal: &Goal) -> Result<()> {
        let longest = f64::from(self.steps) * self.time_step;
        match goal {
            Goal::Contact { bodies, hold_s, tolerance, .. }
            | Goal::Apart { bodies, hold_s, tolerance, .. } => {
                self.check_name("bodies[0]", &bodies[0], true)?;
                self.check_name("bodies[1]", &bodies[1], true)?;
                if bodies[0] == bodies[1] {
                    return Err(Error::input("bodies", format!("{bodies:?}"), "two different names"));
                }
                check_range("tolerance", *tolerance, 0.0, MAX_LENGTH_M)?;
                check_range("hold_s", *hold_s, 0.0, longest)?;
            }
            Goal::Inside { body, region, hold_s, .. } => {
                self.check_name("body", body, false)?;
                if region.len() < 3 {
                    let allowed = "3 or more corner points";
                    return Err(Error::input("region", format!("{} points", region.len()), allowed));
                }
                for (i, p) in region.iter().enumerate() {
                    check_vector(format_args!("region[{i}]"), *p, MAX_LENGTH_M)?;
                }
                if signed_area(region).abs() < 1e-12 {
                    return Err(Error::input("region", "without area", "corners of a polygon with area"));
                }
                check_range("hold_s", *hold_s, 0.0, longest)?;
            }
            Goal::Above { body, height, line, hold_s, .. } => {
                self.check_name("body", body, false)?;
                validate_line(goal, *height, *line)?;
                check_range("hold_s", *hold_s, 0.0, longest)?;
            }
        }
        Ok(())
    }

    /// Bodies with a given position must not overlap each other or a static. Objects placed by an action
    /// are checked at placement.
    fn validate_apart(&self) -> Result<()> {
        let placed_by_action = |name: &str| self.action.as_ref().is_some_and(|a| a.places(name));
        let shapes: Vec<(usize, &Body, ConvexPieces, Aabb)> = self
            .bodies
            .iter()
            .enumerate()
            .filter(|(_, b)| !placed_by_action(&b.name))
            .filter_map(|(i, b)| {
                let shape = b.placed()?;
                let bounds = shape.bounds();
                Some((i, b, shape, bounds))
            })
            .collect();
        let fixed: Vec<(&str, Solid, Option<Aabb>)> = self
            .statics
            .iter()
            .filter(|s| !placed_by_action(&s.name))
            .map(|s| {
                let solid = s.placed();
                let bounds = solid.bounds();
                (s.name.as_str(), solid, bounds)
            })
            .collect();
        for (n, (i, body, shape, bounds)) in shapes.iter().enumerate() {
            let give = -MAX_OVERLAP_FRACTION * shape.smallest_extent();
            let bodies = shapes[..n].iter().map(|(_, other, theirs, around)| {
                let give = give.max(-MAX_OVERLAP_FRACTION * theirs.smallest_extent());
                (other.name.as_str(), !disjoint(bounds, around) && shape.signed_distance_to(theirs) < give)
            });
            let statics = fixed.iter().map(|(name, solid, around)| {
                let near = around.is_none_or(|around| !disjoint(bounds, &around));
                (*name, near && solid.signed_distance_to(shape) < give)
            });
            if let Some((other, _)) = bodies.chain(statics).find(|(_, overlaps)| *overlaps) {
                let place = format!("bodies[{i}].position");
                let at = body.position.unwrap_or_default();
                let value = format!("{at:?} ({:?} overlaps {other:?})", body.name);
                return Err(Error::input(place, value, "a position clear of all other bodies and statics"));
            }
        }
        Ok(())
    }
}

/// Errors unless the goal has exactly one line, with an upper side.
fn validate_line(goal: &Goal, height: Option<f64>, line: Option<[[f64; 2]; 2]>) -> Result<()> {
    if height.is_some() == line.is_some() {
        let value = if line.is_some() { "given together with a line" } else { "missing" };
        let allowed = "either a height, or a line given by two points";
        return Err(Error::input("height", value, allowed));
    }
    height.map_or(Ok(0.0), |h| check_range("height", h, -MAX_LENGTH_M, MAX_LENGTH_M))?;
    for (i, point) in line.iter().flatten().enumerate() {
        check_vector(format_args!("line[{i}]"), *point, MAX_LENGTH_M)?;
    }
    if goal.line().is_none() {
        let allowed = "two points with different x, for a line that is not vertical";
        return Err(Error::input("line", format!("{:?}", line.unwrap_or_default()), allowed));
    }
    Ok(())
}

fn unique(names: &mut HashSet<String>, field: &str, name: &str) -> Result<()> {
    check_name_length(field, name)?;
    if names.insert(name.to_string()) {
        Ok(())
    } else {
        Err(Error::input(field, format!("{name:?}"), "a name that no other body or static has"))
    }
}
