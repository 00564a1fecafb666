//! What a world is made from.

use serde::{Deserialize, Serialize};

use super::catalogue::TaskSet;
use crate::task::scene::EffectTerm;
use crate::world::{Engine, Latents};

/// What a world is made from.
#[derive(Clone)]
pub struct WorldConfig {
    /// What may be asked in it.
    pub tasks: TaskSet,
    /// Simulated or real.
    pub kind: Kind,
    /// Engine that integrates.
    pub engine: Engine,
    /// Latent factors; where `None`, a simulation starts from the family's prior mean and a real world has the
    /// family's standard truth (a custom scene its own coefficients).
    pub latents: Latents,
    /// Effects; `None` is none for a simulation and the family's standard ones for a real world.
    pub effects: Option<Vec<EffectTerm>>,
    /// Standard deviation of observation noise, m; real worlds only.
    pub noise: f64,
    /// Most valid attempts; real worlds only.
    pub budget: Option<u64>,
    /// Whether latents and effects are kept secret and cannot be set; default true for a real world.
    pub sealed: Option<bool>,
    /// Seed of the stream that unseeded resets draw tasks from, and of observation noise.
    pub seed: u64,
}

/// Whether a world is simulated or stands for the real one.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Kind {
    Sim,
    Real,
}

impl Kind {
    /// The name used on the wire.
    pub fn name(self) -> &'static str {
        match self {
            Kind::Sim => "sim",
            Kind::Real => "real",
        }
    }
}
