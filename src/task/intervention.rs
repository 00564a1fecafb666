//! `iplw.intervention/1`: changes made to a scene during a rollout, for counterfactuals.
//!
//! An intervention is a time and one change. The rollout is unchanged up to that time, whose observation
//! still shows the state before the change. Interventions at the same time are applied in the order of the
//! list. `timeline` validates them, `world/intervene` applies them.

use serde::{Deserialize, Serialize};

use super::body::{Body, Static};
use super::shape::Shape;

/// A change of a scene at a time.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(tag = "type", rename_all = "snake_case", deny_unknown_fields)]
pub enum Intervention {
    /// An impulse: the velocity changes by impulse / mass at once.
    Impulse {
        /// s since the start; the nearest time step.
        at: f64,
        /// Name of a body.
        body: String,
        /// N s, world frame.
        impulse: [f64; 2],
        /// Point of application, world frame, m, which also gives an angular impulse; the centre of
        /// mass if absent.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        point: Option<[f64; 2]>,
    },
    /// Sets the pose or velocity of a body; absent fields stay unchanged.
    Set {
        /// s since the start; the nearest time step.
        at: f64,
        /// Name of a body.
        body: String,
        /// m
        #[serde(default, skip_serializing_if = "Option::is_none")]
        position: Option<[f64; 2]>,
        /// rad
        #[serde(default, skip_serializing_if = "Option::is_none")]
        angle: Option<f64>,
        /// m/s
        #[serde(default, skip_serializing_if = "Option::is_none")]
        velocity: Option<[f64; 2]>,
        /// rad/s
        #[serde(default, skip_serializing_if = "Option::is_none")]
        angular_velocity: Option<f64>,
    },
    /// Adds a body, with its own density and surface whatever the latents are.
    Add {
        /// s since the start; the nearest time step.
        at: f64,
        body: Body,
    },
    /// Adds a static.
    AddStatic {
        /// s since the start; the nearest time step.
        at: f64,
        #[serde(rename = "static")]
        fixed: Static,
    },
    /// Removes a body or a static.
    Remove {
        /// s since the start; the nearest time step.
        at: f64,
        /// Name of a body or a static.
        body: String,
    },
    /// Changes latent factors; absent ones stay unchanged.
    Latents {
        /// s since the start; the nearest time step.
        at: f64,
        /// kg/m^2
        #[serde(default, skip_serializing_if = "Option::is_none")]
        density: Option<f64>,
        #[serde(default, skip_serializing_if = "Option::is_none")]
        friction: Option<f64>,
        #[serde(default, skip_serializing_if = "Option::is_none")]
        restitution: Option<f64>,
    },
}

impl Intervention {
    /// Time of the intervention, s since the start.
    pub fn at(&self) -> f64 {
        let (Intervention::Impulse { at, .. }
        | Intervention::Set { at, .. }
        | Intervention::Add { at, .. }
        | Intervention::AddStatic { at, .. }
        | Intervention::Remove { at, .. }
        | Intervention::Latents { at, .. }) = self;
        *at
    }

    /// Name of the object that it changes, if it changes one.
    pub fn object(&self) -> Option<&str> {
        match self {
            Intervention::Impulse { body, .. } | Intervention::Set { body, .. } => Some(body),
            Intervention::Remove { body, .. } => Some(body),
            Intervention::Add { body, .. } => Some(&body.name),
            Intervention::AddStatic { fixed, .. } => Some(&fixed.name),
            Intervention::Latents { .. } => None,
        }
    }

    /// The shape of the object that it adds, if any.
    pub fn added_shape(&self) -> Option<&Shape> {
        match self {
            Intervention::Add { body, .. } => Some(&body.shape),
            Intervention::AddStatic { fixed, .. } => Some(&fixed.shape),
            _ => None,
        }
    }

    /// Whether it adds a body.
    pub fn adds_body(&self) -> bool {
        matches!(self, Intervention::Add { .. })
    }
}
