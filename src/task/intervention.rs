//! `iplw.intervention/1`: what is done to a scene in the middle of a rollout, the counterfactual's "what if".
//!
//! An intervention is a moment and one change. The rollout is as without it up to that moment, whose observation still
//! shows the state before; everything after follows from the changed one. Several at one moment come in the order in
//! which they are given. What they must be is in `timeline`, what engines make of them in `world/intervene`.

use serde::{Deserialize, Serialize};

use super::body::{Body, Static};

/// A change at a moment.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(tag = "type", rename_all = "snake_case", deny_unknown_fields)]
pub enum Intervention {
    /// A blow: the velocity changes by impulse / mass at once.
    Impulse {
        /// s since the start; the nearest time step.
        at: f64,
        /// Name of a body.
        body: String,
        /// N s, world frame.
        impulse: [f64; 2],
        /// Where it acts, world frame, m, which also turns the body; at the centre of mass if absent.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        point: Option<[f64; 2]>,
    },
    /// A body is put somewhere, or given another velocity; what is absent stays.
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
    /// A body comes in; it has the density and surface that it says, whatever the latents are.
    Add {
        /// s since the start; the nearest time step.
        at: f64,
        body: Body,
    },
    /// Something that never moves comes in.
    AddStatic {
        /// s since the start; the nearest time step.
        at: f64,
        #[serde(rename = "static")]
        fixed: Static,
    },
    /// A body or a static is taken away.
    Remove {
        /// s since the start; the nearest time step.
        at: f64,
        /// Name of a body or a static.
        body: String,
    },
    /// Those latent factors that are given become others.
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
    /// When, s since the start.
    pub fn at(&self) -> f64 {
        let (Intervention::Impulse { at, .. }
        | Intervention::Set { at, .. }
        | Intervention::Add { at, .. }
        | Intervention::AddStatic { at, .. }
        | Intervention::Remove { at, .. }
        | Intervention::Latents { at, .. }) = self;
        *at
    }

    /// Name of the thing that it is about, if it is one.
    pub fn thing(&self) -> Option<&str> {
        match self {
            Intervention::Impulse { body, .. } | Intervention::Set { body, .. } => Some(body),
            Intervention::Remove { body, .. } => Some(body),
            Intervention::Add { body, .. } => Some(&body.name),
            Intervention::AddStatic { fixed, .. } => Some(&fixed.name),
            Intervention::Latents { .. } => None,
        }
    }

    /// Whether a body comes in.
    pub fn adds_body(&self) -> bool {
        matches!(self, Intervention::Add { .. })
    }
}
