//! What a scene must be: every value within its limits, every name known, nothing within anything else.

use std::collections::HashSet;

use super::body::Body;
use super::geometry::{Bounds, apart, signed_area};
use super::goal::Goal;
use super::limits::{FAR, TIME_STEPS, vector};
use super::placement;
use super::scene::{FORMAT, Scene};
use super::solid::{Pieces, Solid};
use super::timeline;
use crate::error::{Error, Result, within};

/// Overlap up to this share of the smaller body is put down to measurement, not refused.
const OVERLAP_SHARE: f64 = 0.05;

impl Scene {
    /// Checks every value and reference; the first problem is the error.
    pub fn validate(&self) -> Result<()> {
        if self.format != FORMAT {
            return Err(Error::input("format", format!("{:?}", self.format), format!("{FORMAT:?}")));
        }
        vector("gravity", self.gravity, 1e4)?;
        if self.bodies.is_empty() || self.bodies.len() > 64 {
            return Err(Error::input("bodies", format!("{} bodies", self.bodies.len()), "1 to 64 bodies"));
        }
        if self.statics.len() > 256 {
            return Err(Error::input(
                "statics",
                format!("{} statics", self.statics.len()),
                "at most 256 statics",
            ));
        }
        let mut names = HashSet::new();
        for (i, body) in self.bodies.iter().enumerate() {
            body.validate().map_err(|e| e.under(&format!("bodies[{i}]")))?;
            unique(&mut names, &format!("bodies[{i}].name"), &body.name)?;
        }
        for (i, fixed) in self.statics.iter().enumerate() {
            fixed.validate().map_err(|e| e.under(&format!("statics[{i}]")))?;
            unique(&mut names, &format!("statics[{i}].name"), &fixed.name)?;
        }
        within("time_step", self.time_step, TIME_STEPS[0], TIME_STEPS[1])?;
        within("steps", f64::from(self.steps), 1.0, 1e6)?;
        within("observe_every", f64::from(self.observe_every), 1.0, 1e6)?;
        if let Some(damping) = self.damping
            && !(damping > 0.0 && damping <= 1.0)
        {
            return Err(Error::input("damping", damping, "a kept share of velocity per second in (0, 1]"));
        }
        self.contact_rules.iter().try_for_each(|rules| rules.validate())?;
        self.goal.iter().try_for_each(|goal| self.validate_goal(goal).map_err(|e| e.under("goal")))?;
        for (i, name) in self.carriers.iter().flatten().enumerate() {
            self.named(&format!("carriers[{i}]"), name, true)?;
        }
        let bare = self.bare();
        self.settings.keys().try_for_each(|name| self.validate_setting(name, &bare))?;
        if let Some(space) = &self.action {
            placement::validate(space, self).map_err(|e| e.under("action"))?;
        }
        self.validate_apart()?;
        timeline::in_order(self).map(drop)
    }

    /// `bare`: the scene without its settings.
    fn validate_setting(&self, name: &str, bare: &Scene) -> Result<()> {
        let Some(setting) = self.settings.get(name) else { return Ok(()) };
        for body in setting.bodies.keys() {
            self.named(&format!("settings.{name}.bodies"), body, false)?;
        }
        let known: Vec<&String> = self.statics.iter().map(|s| &s.name).collect();
        if let Some(unknown) = setting.statics.keys().find(|n| !known.contains(n)) {
            let known = known.iter().map(|n| format!("{n:?}")).collect::<Vec<_>>().join(", ");
            let field = format!("settings.{name}.statics");
            return Err(Error::input(field, format!("{unknown:?}"), format!("one of {known}")));
        }
        let varied = bare.varied(Some(setting));
        for fixed in &varied.statics {
            let place = format!("settings.{name}.statics.{}", fixed.name);
            fixed.validate().map_err(|e| e.under(&place))?;
        }
        for (i, body) in varied.bodies.iter().enumerate() {
            let place = format!("settings.{name}.bodies.{}", self.bodies[i].name);
            body.validate().map_err(|e| e.under(&place))?;
        }
        Ok(())
    }

    fn validate_goal(&self, goal: &Goal) -> Result<()> {
        let longest = f64::from(self.steps) * self.time_step;
        match goal {
            Goal::Contact { bodies, hold_s, tolerance, .. }
            | Goal::Apart { bodies, hold_s, tolerance, .. } => {
                self.named("bodies[0]", &bodies[0], true)?;
                self.named("bodies[1]", &bodies[1], true)?;
                if bodies[0] == bodies[1] {
                    return Err(Error::input("bodies", format!("{bodies:?}"), "two different names"));
                }
                within("tolerance", *tolerance, 0.0, FAR)?;
                within("hold_s", *hold_s, 0.0, longest)?;
            }
            Goal::Inside { body, region, hold_s, .. } => {
                self.named("body", body, false)?;
                if region.len() < 3 {
                    return Err(Error::input(
                        "region",
                        format!("{} points", region.len()),
                        "3 or more corner points",
                    ));
                }
                for (i, p) in region.iter().enumerate() {
                    vector(&format!("region[{i}]"), *p, FAR)?;
                }
                if signed_area(region).abs() < 1e-12 {
                    return Err(Error::input("region", "without area", "corners of a polygon with area"));
                }
                within("hold_s", *hold_s, 0.0, longest)?;
            }
            Goal::Above { body, height, line, hold_s, .. } => {
                self.named("body", body, false)?;
                validate_line(goal, *height, *line)?;
                within("hold_s", *hold_s, 0.0, longest)?;
            }
        }
        Ok(())
    }

    /// Bodies with a given position must not overlap each other or a static. What an action places is judged
    /// when it is placed.
    fn validate_apart(&self) -> Result<()> {
        let placed_by_action = |name: &str| self.action.as_ref().is_some_and(|a| a.places(name));
        let shapes: Vec<(usize, &Body, Pieces, Bounds)> = self
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
        let fixed: Vec<(&str, Solid, Option<Bounds>)> = self
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
            let give = -OVERLAP_SHARE * shape.smallest_extent();
            let bodies = shapes[..n].iter().map(|(_, other, theirs, around)| {
                let give = give.max(-OVERLAP_SHARE * theirs.smallest_extent());
                (other.name.as_str(), !apart(bounds, around) && shape.gap_to(theirs) < give)
            });
            let statics = fixed.iter().map(|(name, solid, around)| {
                let near = around.is_none_or(|around| !apart(bounds, &around));
                (*name, near && solid.gap_to(shape) < give)
            });
            if let Some((other, _)) = bodies.chain(statics).find(|(_, overlaps)| *overlaps) {
                let place = format!("bodies[{i}].position");
                let at = body.position.unwrap_or_default();
                let value = format!("{at:?} ({:?} overlaps {other:?})", body.name);
                return Err(Error::input(place, value, "a place clear of all other bodies and statics"));
            }
        }
        Ok(())
    }
}

/// A body is to be above one line, which has an upper side.
fn validate_line(goal: &Goal, height: Option<f64>, line: Option<[[f64; 2]; 2]>) -> Result<()> {
    if height.is_some() == line.is_some() {
        let value = if line.is_some() { "beside a line" } else { "missing" };
        let allowed = "either a height, or a line given by two points";
        return Err(Error::input("height", value, allowed));
    }
    height.map_or(Ok(0.0), |h| within("height", h, -FAR, FAR))?;
    for (i, point) in line.iter().flatten().enumerate() {
        vector(&format!("line[{i}]"), *point, FAR)?;
    }
    if goal.line().is_none() {
        let allowed = "two points of which one is farther right: a line that has a side above it";
        return Err(Error::input("line", format!("{:?}", line.unwrap_or_default()), allowed));
    }
    Ok(())
}

fn unique(names: &mut HashSet<String>, field: &str, name: &str) -> Result<()> {
    if name.is_empty() || name.len() > 100 {
        return Err(Error::input(field, format!("{name:?}"), "a name of 1 to 100 characters"));
    }
    if names.insert(name.to_string()) {
        Ok(())
    } else {
        Err(Error::input(field, format!("{name:?}"), "a name that no other body or static has"))
    }
}
