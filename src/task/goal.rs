//! What may be asked of a scene.

use serde::{Deserialize, Serialize};

/// What is asked of a scene.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(tag = "type", rename_all = "snake_case", deny_unknown_fields)]
pub enum Goal {
    /// Two bodies touch for a while on end.
    Contact {
        bodies: [String; 2],
        /// s
        #[serde(default)]
        hold_s: f64,
        /// Gap up to which two surfaces count as touching, m.
        #[serde(default = "default_tolerance")]
        tolerance: f64,
        /// `false` lets a rollout run on after the goal is reached.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        stop: Option<bool>,
    },
    /// A body's centre is within a polygon for a while on end.
    Inside {
        body: String,
        region: Vec<[f64; 2]>,
        /// s
        #[serde(default)]
        hold_s: f64,
        /// `false` lets a rollout run on after the goal is reached.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        stop: Option<bool>,
    },
}

impl Goal {
    /// Whether a rollout ends when the goal is reached, as far as the goal says.
    pub fn stops(&self) -> bool {
        let (Goal::Contact { stop, .. } | Goal::Inside { stop, .. }) = self;
        *stop != Some(false)
    }
}

fn default_tolerance() -> f64 {
    0.0167
}
