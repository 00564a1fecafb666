//! Validation of joints and motors.

use std::collections::HashSet;

use super::joint::MAX_JOINTS;
use super::scene::Scene;
use crate::error::{Error, Result};

impl Scene {
    /// Checks joints and motors: names that exist, every body on one joint, and no cycle.
    pub(super) fn validate_joints(&self) -> Result<()> {
        if self.joints.len() > MAX_JOINTS {
            let allowed = format!("at most {MAX_JOINTS} joints");
            return Err(Error::input("joints", format!("{} joints", self.joints.len()), allowed));
        }
        let (mut names, mut moved) = (HashSet::new(), HashSet::new());
        for (i, joint) in self.joints.iter().enumerate() {
            let in_joint = |e: Error| e.in_field(&format!("joints[{i}]"));
            joint.validate().map_err(in_joint)?;
            if !names.insert(&joint.name) {
                return Err(in_joint(Error::input("name", &joint.name, "a name that no other joint has")));
            }
            for (field, name) in [("body", Some(&joint.body)), ("parent", joint.parent.as_ref())] {
                let Some(name) = name else { continue };
                let body = self
                    .body(name)
                    .ok_or_else(|| in_joint(Error::input(field, name, "a body of the scene")))?;
                if body.position.is_none() {
                    return Err(in_joint(Error::input(field, name, "a body with a `position`")));
                }
            }
            if !moved.insert(&joint.body) {
                let allowed = "a body that no other joint moves: closed chains are not supported";
                return Err(in_joint(Error::input("body", &joint.body, allowed)));
            }
        }
        for (i, joint) in self.joints.iter().enumerate() {
            let parent_of = |body: &String| self.joints.iter().find(|j| j.body == *body)?.parent.as_ref();
            let ancestors = std::iter::successors(joint.parent.as_ref(), |body| parent_of(body));
            if ancestors.take(self.joints.len() + 1).any(|body| *body == joint.body) {
                let allowed = "a body that does not hang on this one";
                return Err(Error::input(format!("joints[{i}].parent"), joint.body.as_str(), allowed));
            }
        }
        self.motors.iter().enumerate().try_for_each(|(i, motor)| {
            let in_motor = |e: Error| e.in_field(&format!("motors[{i}]"));
            motor.validate().map_err(in_motor)?;
            let twice = self.motors[..i].iter().any(|other| other.joint == motor.joint);
            match names.contains(&motor.joint) && !twice {
                true => Ok(()),
                false => Err(in_motor(Error::input(
                    "joint",
                    motor.joint.as_str(),
                    "a joint of the scene without another motor",
                ))),
            }
        })
    }
}
