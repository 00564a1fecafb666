//! Overrides of a scene for one setting of measured trials.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};

use super::body::{Body, Static};
use super::shape::Shape;

/// The overrides of one setting.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Setting {
    /// Overrides by body name.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub bodies: BTreeMap<String, BodyOverride>,
    /// Overrides by name of the static.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub statics: BTreeMap<String, StaticOverride>,
}

/// Fields of a static that a setting may override.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct StaticOverride {
    #[serde(skip_serializing_if = "Option::is_none")]
    pub shape: Option<Shape>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub position: Option<[f64; 2]>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub angle: Option<f64>,
}

/// Body fields a setting may override.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct BodyOverride {
    #[serde(skip_serializing_if = "Option::is_none")]
    pub shape: Option<Shape>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub mass: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub density: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub friction: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub restitution: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub position: Option<[f64; 2]>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub angle: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub velocity: Option<[f64; 2]>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub angular_velocity: Option<f64>,
}

impl Setting {
    /// Applies the overrides to the bodies and statics they name.
    pub(super) fn apply(&self, bodies: &mut [Body], statics: &mut [Static]) {
        for body in bodies {
            if let Some(own) = self.bodies.get(&body.name) {
                own.apply(body);
            }
        }
        for fixed in statics {
            if let Some(own) = self.statics.get(&fixed.name) {
                own.apply(fixed);
            }
        }
    }
}

impl BodyOverride {
    /// The body with the overrides.
    pub(super) fn applied_to(&self, body: &Body) -> Body {
        let mut body = body.clone();
        self.apply(&mut body);
        body
    }
}

impl StaticOverride {
    /// The static with the overrides.
    pub(super) fn applied_to(&self, fixed: &Static) -> Static {
        let mut fixed = fixed.clone();
        self.apply(&mut fixed);
        fixed
    }
}

impl BodyOverride {
    fn apply(&self, body: &mut Body) {
        if let Some(shape) = &self.shape {
            body.shape = shape.clone();
        }
        if self.mass.is_some() || self.density.is_some() {
            (body.mass, body.density) = (self.mass, self.density);
        }
        body.friction = self.friction.unwrap_or(body.friction);
        body.restitution = self.restitution.unwrap_or(body.restitution);
        body.position = self.position.or(body.position);
        body.angle = self.angle.unwrap_or(body.angle);
        body.velocity = self.velocity.unwrap_or(body.velocity);
        body.angular_velocity = self.angular_velocity.unwrap_or(body.angular_velocity);
    }
}

impl StaticOverride {
    fn apply(&self, fixed: &mut Static) {
        if let Some(shape) = &self.shape {
            fixed.shape = shape.clone();
        }
        fixed.position = self.position.unwrap_or(fixed.position);
        fixed.angle = self.angle.unwrap_or(fixed.angle);
    }
}
