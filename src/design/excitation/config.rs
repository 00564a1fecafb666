//! Configuration of a design of excitations.

use serde::Serialize;

/// The purpose of a design.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum ExcitationGoal {
    /// To discriminate between effects.
    Discriminate,
    /// To measure their sizes.
    Precision,
}

/// Settings of a design.
#[derive(Clone, Debug, Serialize)]
pub struct ExcitationConfig {
    pub goal: ExcitationGoal,
    /// Number of trials.
    pub trials: usize,
    /// Duration of a trial, s.
    pub duration: f64,
    /// Effects in question, as (effect, joint); all that the scene may lack if there are none.
    pub effects: Vec<(String, String)>,
    /// Standard deviation of measured positions, rad or m.
    pub noise: f64,
    /// Largest velocity of any joint, rad/s or m/s.
    pub max_velocity: Option<f64>,
    /// By joint: lowest and highest position.
    pub positions: Vec<(String, [f64; 2])>,
    /// By motor, by the name of its joint: lowest and highest command; of motors with torque commands 90 % of the limit by default.
    pub commands: Vec<(String, [f64; 2])>,
    pub seed: u64,
}
