//! What physics does: scene, latents and effects in, trajectory out.
//!
//! Semantics, the same for every engine:
//! - SI units; gravity is the scene's.
//! - Friction and restitution of a contact are the products of the two surfaces' coefficients (as in Pymunk).
//! - Once per time step, in this order: effects act on velocities, gravity acts, contacts are resolved,
//!   positions advance. With the effect `linear_drag` this is Pymunk's damping.
//! - A latent factor sets the coefficient of every carrier and the density of every carrying body.

pub mod effect;
pub mod goal;
pub mod latent;
pub mod prepare;
mod rapier;
mod record;

use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use crate::error::{Error, Result};
use crate::task::Scene;
use crate::task::scene::EffectTerm;
use crate::trajectory::Trajectory;
pub use latent::Latents;
use prepare::{Prepared, prepare};

/// One rollout to simulate.
#[derive(Clone, Copy, Debug)]
pub struct Rollout<'a> {
    /// The scene with everything placed.
    pub scene: &'a Scene,
    /// Latent factors; `None` leaves the scene's own.
    pub latents: Latents,
    /// Effects beyond the scene's own.
    pub effects: &'a [EffectTerm],
    /// `false` simulates on after the goal is reached, whatever the scene says.
    pub stop: bool,
}

/// Which engine integrates.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Engine {
    /// The fastest engine that takes the scene.
    #[default]
    Auto,
    /// The general engine.
    Rapier,
}

/// Simulates a batch, in parallel on rayon's pool; results in the order of the rollouts, and the same bits
/// for any number of threads.
pub fn simulate(rollouts: &[Rollout], engine: Engine) -> Result<Vec<Trajectory>> {
    simulate_map(rollouts, engine, |_, trajectory| trajectory)
}

/// [`simulate`], keeping only what `keep(index, trajectory)` returns, so that memory does not grow with the
/// length of trajectories.
pub fn simulate_map<T: Send>(
    rollouts: &[Rollout],
    engine: Engine,
    keep: impl Fn(usize, Trajectory) -> T + Sync,
) -> Result<Vec<T>> {
    // Preparing first means that bad input is refused before any work is done.
    let prepared: Vec<Prepared> = rollouts.iter().map(prepare).collect::<Result<_>>()?;
    prepared
        .par_iter()
        .enumerate()
        .map(|(i, p)| {
            let trajectory = match engine_for(engine, p) {
                Engine::Rapier | Engine::Auto => rapier::run(p)?,
            };
            Ok(keep(i, trajectory))
        })
        .collect()
}

/// The engine that [`simulate`] would use for a scene.
pub fn chosen(engine: Engine, rollout: &Rollout) -> Result<Engine> {
    Ok(engine_for(engine, &prepare(rollout)?))
}

fn engine_for(engine: Engine, _prepared: &Prepared) -> Engine {
    match engine {
        Engine::Auto | Engine::Rapier => Engine::Rapier,
    }
}

impl Engine {
    /// The name used on the wire and the command line.
    pub fn name(self) -> &'static str {
        match self {
            Engine::Auto => "auto",
            Engine::Rapier => "rapier",
        }
    }

    /// The engine named `name`.
    pub fn from_name(name: &str) -> Result<Engine> {
        [Engine::Auto, Engine::Rapier].into_iter().find(|e| e.name() == name).ok_or_else(|| Error::NotFound {
            kind: "engine",
            id: name.to_string(),
            known: vec!["auto".into(), "rapier".into()],
        })
    }
}
