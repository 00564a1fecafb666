//! Trajectories of rollouts and measurements: sampled states, contact events and an outcome.

use serde::{Deserialize, Serialize};

/// One rollout, observed at `times`.
///
/// Every track has as many samples as `times`. A missing measured value is NaN in memory and an empty cell or
/// `null` in files.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Trajectory {
    /// (n_samples,) seconds since the start; increasing.
    pub times: Vec<f64>,
    /// One track per movable body, in the scene's order.
    pub bodies: Vec<Track>,
    /// Contact events (first touch) in order of time; empty for measured trials.
    pub events: Vec<Contact>,
    /// Number of contact events between two movable bodies ("collisions" of the paper's action groups).
    pub collisions: u32,
    /// Time steps in which a surface supported a body (upward component of the contact normal above cos
    /// 60 degrees), summed over movable bodies, moving or at rest ("rolling" of the paper's action
    /// groups).
    pub rolling_steps: u32,
    /// The outcome of the rollout.
    pub outcome: RolloutOutcome,
}

/// The sampled states of one body; world frame.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Track {
    /// The body's name in its scene.
    pub name: String,
    /// (n_samples,) position, m.
    #[serde(with = "nan_as_null")]
    pub x: Vec<f64>,
    /// (n_samples,) position, m, up.
    #[serde(with = "nan_as_null")]
    pub y: Vec<f64>,
    /// (n_samples,) rad, counter-clockwise, not wrapped.
    #[serde(with = "nan_as_null")]
    pub angle: Vec<f64>,
    /// (n_samples,) m/s.
    #[serde(with = "nan_as_null")]
    pub vx: Vec<f64>,
    /// (n_samples,) m/s.
    #[serde(with = "nan_as_null")]
    pub vy: Vec<f64>,
    /// (n_samples,) rad/s.
    #[serde(with = "nan_as_null")]
    pub omega: Vec<f64>,
}

/// The beginning of a contact between two objects.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Contact {
    /// Seconds since the start.
    pub time: f64,
    /// Names of the two bodies or statics.
    pub between: [String; 2],
    /// Approach speed along the contact normal, m/s, not negative.
    pub speed: f64,
}

/// The outcome of a rollout.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct RolloutOutcome {
    /// Whether the goal was reached; `None` where the scene has none.
    pub solved: Option<bool>,
    /// Number of simulated time steps.
    pub steps: u32,
    /// The reason for its end.
    pub end: Termination,
}

/// The reason why a rollout ended.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Termination {
    /// All steps were simulated.
    #[default]
    Horizon,
    /// The goal was reached, and the scene stops there.
    Goal,
    /// A state became non-finite or implausibly large; samples end before it.
    Diverged,
    /// An object added or moved by an intervention would overlap another; samples end before it.
    Blocked {
        /// Index of the intervention.
        intervention: usize,
        /// Index of the obstacle: bodies, then statics, added ones after the scene's own.
        by: usize,
    },
}

/// Missing values: NaN in memory, `null` in files.
mod nan_as_null {
    use serde::{Deserialize, Deserializer, Serialize, Serializer};

    pub fn serialize<S: Serializer>(values: &[f64], to: S) -> Result<S::Ok, S::Error> {
        // serde_json already writes NaN as null; converted here so that all formats do.
        values.iter().map(|v| (!v.is_nan()).then_some(*v)).collect::<Vec<Option<f64>>>().serialize(to)
    }

    pub fn deserialize<'de, D: Deserializer<'de>>(from: D) -> Result<Vec<f64>, D::Error> {
        let values = Vec::<Option<f64>>::deserialize(from)?;
        Ok(values.into_iter().map(|v| v.unwrap_or(f64::NAN)).collect())
    }
}

/// Cubic Hermite interpolation at the fraction `share` (0 to 1) of an interval of `span` seconds, from the
/// positions and velocities at both ends: exact for motion under constant force.
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

    /// Keeps only the first samples.
    pub fn truncate(&mut self, samples: usize) {
        self.columns().into_iter().for_each(|column| column.truncate(samples));
    }

    fn columns(&mut self) -> [&mut Vec<f64>; 6] {
        [&mut self.x, &mut self.y, &mut self.angle, &mut self.vx, &mut self.vy, &mut self.omega]
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

    /// Every k-th sample and the last, with the least k that leaves at most `states` sampled states of bodies, or twice that.
    pub fn thinned(mut self, states: usize) -> Trajectory {
        let (samples, every) =
            (self.times.len(), (self.times.len() * self.bodies.len()).div_ceil(states.max(1)));
        if every > 1 {
            let thin = |column: &mut Vec<f64>| {
                let mut sample = 0..;
                column.retain(|_| {
                    sample.next().is_some_and(|i: usize| i.is_multiple_of(every) || i + 1 == samples)
                });
            };
            thin(&mut self.times);
            for track in &mut self.bodies {
                track.columns().into_iter().for_each(thin);
            }
        }
        self
    }

    /// Whether the goal was reached (a scene without a goal is never solved).
    pub fn solved(&self) -> bool {
        self.outcome.solved == Some(true)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn thins_to_every_kth_sample_and_the_last() {
        let mut track = Track::with_capacity("ball", 10);
        (0..10).for_each(|i| track.push([f64::from(i), 0.0], 0.0, [0.0, 0.0], 0.0));
        let whole = Trajectory {
            times: (0..10).map(f64::from).collect(),
            bodies: vec![track],
            ..Trajectory::default()
        };
        let thinned = whole.clone().thinned(3);
        assert_eq!(thinned.times, [0.0, 4.0, 8.0, 9.0]);
        assert_eq!(thinned.bodies[0].x, thinned.times);
        assert_eq!(whole.clone().thinned(10), whole);
    }
}
