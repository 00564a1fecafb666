//! What a rollout or a measurement leaves behind: sampled states, contact events and an outcome.

use serde::{Deserialize, Serialize};

/// One rollout, observed at `times`.
///
/// Every track holds as many samples as `times`. A missing measured value is NaN in memory and an empty cell
/// or `null` outside.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Trajectory {
    /// (n_samples,) seconds since the start; rising.
    pub times: Vec<f64>,
    /// One track per movable body, in the scene's order.
    pub bodies: Vec<Track>,
    /// Begin-of-contact events in order of time; empty for measured trials.
    pub events: Vec<Contact>,
    /// Begun contacts between two movable bodies ("collisions" of the paper's action groups).
    pub collisions: u32,
    /// Sum over movable bodies of the time steps spent on a surface that carries them (contact normal more
    /// upward than 60 degrees from vertical), at rest or not ("rolling" of the paper's action groups).
    pub rolling_steps: u32,
    /// How it ended.
    pub outcome: Outcome,
}

/// The sampled states of one body; world frame.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Track {
    /// The body's name in its scene.
    pub name: String,
    /// (n_samples,) position, m.
    #[serde(with = "gaps")]
    pub x: Vec<f64>,
    /// (n_samples,) position, m, up.
    #[serde(with = "gaps")]
    pub y: Vec<f64>,
    /// (n_samples,) rad, counter-clockwise, not wrapped.
    #[serde(with = "gaps")]
    pub angle: Vec<f64>,
    /// (n_samples,) m/s.
    #[serde(with = "gaps")]
    pub vx: Vec<f64>,
    /// (n_samples,) m/s.
    #[serde(with = "gaps")]
    pub vy: Vec<f64>,
    /// (n_samples,) rad/s.
    #[serde(with = "gaps")]
    pub omega: Vec<f64>,
}

/// Two things began to touch.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Contact {
    /// Seconds since the start.
    pub time: f64,
    /// Names of the two bodies or statics.
    pub between: [String; 2],
    /// Speed at which they approached along the contact normal, m/s, not negative.
    pub speed: f64,
}

/// How a rollout ended.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Outcome {
    /// Whether the goal was reached; `None` where the scene has none.
    pub solved: Option<bool>,
    /// Simulated time steps.
    pub steps: u32,
    /// Why it ended.
    pub end: End,
}

/// Why a rollout ended.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum End {
    /// All steps were simulated.
    #[default]
    Horizon,
    /// The goal was reached and the scene stops there.
    Goal,
    /// A state stopped being finite; samples end before it.
    Diverged,
    /// What an intervention puts into the scene has no place there; samples end before it.
    Blocked {
        /// Number of the intervention.
        intervention: usize,
        /// What is in the way: bodies, then statics, what came in behind each.
        by: usize,
    },
}

/// Missing values: NaN in memory, `null` outside.
mod gaps {
    use serde::{Deserialize, Deserializer, Serialize, Serializer};

    pub fn serialize<S: Serializer>(values: &[f64], to: S) -> Result<S::Ok, S::Error> {
        // serde_json writes NaN as null by itself; said here so that no other format can disagree.
        values.iter().map(|v| (!v.is_nan()).then_some(*v)).collect::<Vec<Option<f64>>>().serialize(to)
    }

    pub fn deserialize<'de, D: Deserializer<'de>>(from: D) -> Result<Vec<f64>, D::Error> {
        let values = Vec::<Option<f64>>::deserialize(from)?;
        Ok(values.into_iter().map(|v| v.unwrap_or(f64::NAN)).collect())
    }
}

/// A position `share` (0 to 1) of the way through an interval of `span` seconds, by the cubic polynomial that
/// has the positions and velocities of both ends (Hermite): exact for motion under constant force.
pub fn hermite(positions: [f64; 2], velocities: [f64; 2], span: f64, share: f64) -> f64 {
    let s = share;
    let (s2, s3) = (s * s, s * s * s);
    (2.0 * s3 - 3.0 * s2 + 1.0) * positions[0]
        + (s3 - 2.0 * s2 + s) * span * velocities[0]
        + (3.0 * s2 - 2.0 * s3) * positions[1]
        + (s3 - s2) * span * velocities[1]
}

impl Track {
    /// An empty track with room for `samples`.
    pub fn with_capacity(name: &str, samples: usize) -> Self {
        let column = || Vec::with_capacity(samples);
        Track {
            name: name.to_string(),
            x: column(),
            y: column(),
            angle: column(),
            vx: column(),
            vy: column(),
            omega: column(),
        }
    }

    /// Appends one state: position (m), angle (rad), velocity (m/s), spin (rad/s).
    pub fn push(&mut self, position: [f64; 2], angle: f64, velocity: [f64; 2], omega: f64) {
        self.x.push(position[0]);
        self.y.push(position[1]);
        self.angle.push(angle);
        self.vx.push(velocity[0]);
        self.vy.push(velocity[1]);
        self.omega.push(omega);
    }

    /// Forgets all but the first samples.
    pub fn truncate(&mut self, samples: usize) {
        for column in [&mut self.x, &mut self.y, &mut self.angle, &mut self.vx, &mut self.vy, &mut self.omega]
        {
            column.truncate(samples);
        }
    }

    /// Number of samples.
    pub fn len(&self) -> usize {
        self.x.len()
    }

    /// Whether there is no sample.
    pub fn is_empty(&self) -> bool {
        self.x.is_empty()
    }
}

impl Trajectory {
    /// The track of the body named `name`.
    pub fn track(&self, name: &str) -> Option<&Track> {
        self.bodies.iter().find(|t| t.name == name)
    }

    /// Whether the goal was reached (a scene without a goal is never solved).
    pub fn solved(&self) -> bool {
        self.outcome.solved == Some(true)
    }
}
