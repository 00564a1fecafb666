//! What may be asked of a scene.

use serde::{Deserialize, Serialize};

use super::limits::NEAR;

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
    /// Two bodies do not touch for a while on end.
    Apart {
        bodies: [String; 2],
        /// Whether that counts only once they have touched; from the start, if not.
        #[serde(default, skip_serializing_if = "is_false")]
        after_touch: bool,
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
    /// A body is above a line for a while on end.
    Above {
        body: String,
        /// Of a level line, m; either this or `line`.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        height: Option<f64>,
        /// Two points of the line, one not above the other, m.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        line: Option<[[f64; 2]; 2]>,
        /// What of the body has to be above it.
        #[serde(default, skip_serializing_if = "Point::is_lowest")]
        point: Point,
        /// s
        #[serde(default)]
        hold_s: f64,
        /// `false` lets a rollout run on after the goal is reached.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        stop: Option<bool>,
    },
}

/// What of a body has to be above a line.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Point {
    /// The whole body: its point that is lowest, seen along the line.
    #[default]
    Lowest,
    /// Its centre: the origin of its frame.
    Centre,
}

impl Goal {
    /// Whether a rollout ends when the goal is reached, as far as the goal says.
    pub fn stops(&self) -> bool {
        let (Goal::Contact { stop, .. }
        | Goal::Apart { stop, .. }
        | Goal::Inside { stop, .. }
        | Goal::Above { stop, .. }) = self;
        *stop != Some(false)
    }

    /// Names of the bodies and statics that it is about.
    pub fn names(&self) -> Vec<&str> {
        match self {
            Goal::Contact { bodies, .. } | Goal::Apart { bodies, .. } => {
                bodies.iter().map(String::as_str).collect()
            }
            Goal::Inside { body, .. } | Goal::Above { body, .. } => vec![body],
        }
    }

    /// The line that a body is to be above: the upward unit normal, and how far along it the line is, m; `None` if the goal has none, or
    /// none that can be stood above.
    pub fn line(&self) -> Option<([f64; 2], f64)> {
        let Goal::Above { height, line, .. } = self else { return None };
        match (height, line) {
            (Some(height), None) => Some(([0.0, 1.0], *height)),
            (None, Some([from, to])) => {
                let (dx, dy) = (to[0] - from[0], to[1] - from[1]);
                let length = (dx * dx + dy * dy).sqrt();
                // Upwards, whichever point comes first.
                let sign = if dx < 0.0 { -1.0 } else { 1.0 };
                let normal = [-dy * sign / length, dx * sign / length];
                let offset = normal[0] * from[0] + normal[1] * from[1];
                (dx.abs() >= NEAR && normal[1] >= NEAR).then_some((normal, offset))
            }
            _ => None,
        }
    }
}

impl Point {
    fn is_lowest(&self) -> bool {
        *self == Point::Lowest
    }
}

fn default_tolerance() -> f64 {
    0.0167
}

fn is_false(value: &bool) -> bool {
    !value
}
