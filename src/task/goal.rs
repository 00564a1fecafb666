//! The goal of a scene.

use serde::{Deserialize, Serialize};

use super::limits::MIN_LENGTH_M;

/// The condition that solves a scene.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(tag = "type", rename_all = "snake_case", deny_unknown_fields)]
pub enum Goal {
    /// Two bodies stay in contact for `hold_s`.
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
    /// Two bodies stay apart for `hold_s`.
    Apart {
        bodies: [String; 2],
        /// Whether the time apart counts only after a contact; otherwise it counts from the start.
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
    /// A body's centre stays within a polygon for `hold_s`.
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
    /// A body stays above a line for `hold_s`.
    Above {
        body: String,
        /// Height of a horizontal line, m; either this or `line`.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        height: Option<f64>,
        /// Two points of the line, m; the line must not be vertical.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        line: Option<[[f64; 2]; 2]>,
        /// Which point of the body must be above the line.
        #[serde(default, skip_serializing_if = "GoalPoint::is_lowest")]
        point: GoalPoint,
        /// s
        #[serde(default)]
        hold_s: f64,
        /// `false` lets a rollout run on after the goal is reached.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        stop: Option<bool>,
    },
}

/// The point of a body that must be above a line.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum GoalPoint {
    /// The lowest point of the body, measured along the line's normal: the whole body is above the line.
    #[default]
    Lowest,
    /// The body's centre: the origin of its frame.
    Centre,
}

impl Goal {
    /// Whether a rollout ends when the goal is reached; a scene may override it.
    pub fn stops(&self) -> bool {
        let (Goal::Contact { stop, .. }
        | Goal::Apart { stop, .. }
        | Goal::Inside { stop, .. }
        | Goal::Above { stop, .. }) = self;
        *stop != Some(false)
    }

    /// Names of the bodies and statics in the goal.
    pub fn names(&self) -> Vec<&str> {
        match self {
            Goal::Contact { bodies, .. } | Goal::Apart { bodies, .. } => {
                bodies.iter().map(String::as_str).collect()
            }
            Goal::Inside { body, .. } | Goal::Above { body, .. } => vec![body],
        }
    }

    /// The line of an `above` goal: upward unit normal and offset along it, m. `None` for other goals and
    /// for a line without an upper side.
    pub fn line(&self) -> Option<([f64; 2], f64)> {
        let Goal::Above { height, line, .. } = self else { return None };
        match (height, line) {
            (Some(height), None) => Some(([0.0, 1.0], *height)),
            (None, Some([from, to])) => {
                let (dx, dy) = (to[0] - from[0], to[1] - from[1]);
                let length = (dx * dx + dy * dy).sqrt();
                // The normal points up, whichever point comes first.
                let sign = if dx < 0.0 { -1.0 } else { 1.0 };
                let normal = [-dy * sign / length, dx * sign / length];
                let offset = normal[0] * from[0] + normal[1] * from[1];
                (dx.abs() >= MIN_LENGTH_M && normal[1] >= MIN_LENGTH_M).then_some((normal, offset))
            }
            _ => None,
        }
    }
}

impl GoalPoint {
    fn is_lowest(&self) -> bool {
        *self == GoalPoint::Lowest
    }
}

fn default_tolerance() -> f64 {
    0.0167
}

fn is_false(value: &bool) -> bool {
    !value
}
