//! The choice of a physics engine.

use serde::{Deserialize, Serialize};

use super::Rollout;
use super::compile::{RolloutModel, compile};
use super::lanes::{self, gpu};
use crate::error::{Error, Result};
use crate::names::names;

/// The physics engine.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Engine {
    /// The fastest engine that supports the scene: `lanes` or `rapier`. Large batches of `lanes` run on a graphics
    /// processor if it is faster, with the same results.
    #[default]
    Auto,
    /// The general engine: rapier2d.
    Rapier,
    /// The batched engine: discs, and bodies of any shape with up to 20,000 pairs of pieces.
    Lanes,
    /// The batched engine on a graphics processor; rollouts that it does not support run as with `auto`.
    Gpu,
}

names!(Engine: Auto = "auto", Rapier = "rapier", Lanes = "lanes", Gpu = "gpu");

/// Rollouts that keep a graphics processor busy.
const GPU_BATCH_SIZE: usize = 1 << 16;

impl Engine {
    /// The engine named `name`; an error if this machine does not have it.
    pub fn from_name(name: &str) -> Result<Engine> {
        let engine = Engine::named(name)
            .ok_or_else(|| Error::not_found("engine", name, Engine::ALL.map(Engine::name)))?;
        if engine == Engine::Gpu {
            gpu::find()?;
        }
        Ok(engine)
    }

    /// Rollouts to simulate together where a processor takes `on_processor`.
    pub fn batch_size(self, on_processor: usize) -> usize {
        let large = self == Engine::Gpu || self == Engine::Auto && gpu::is_installed();
        if large { on_processor.max(GPU_BATCH_SIZE) } else { on_processor }
    }
}

/// The engine that a simulation of the rollout uses.
pub fn select_engine(engine: Engine, rollout: &Rollout) -> Result<Engine> {
    engine_for(engine, &compile(rollout)?)
}

/// The same for a compiled rollout.
pub fn engine_for(engine: Engine, model: &RolloutModel) -> Result<Engine> {
    match (engine, lanes::takes(model)) {
        (Engine::Gpu, true) if gpu::thread_memory_kb(model).is_some() => Ok(Engine::Gpu),
        (Engine::Gpu, true) => Ok(Engine::Lanes),
        (Engine::Rapier, _) | (Engine::Auto | Engine::Gpu, false) => Ok(Engine::Rapier),
        (Engine::Auto | Engine::Lanes, true) => Ok(Engine::Lanes),
        (Engine::Lanes, false) => Err(Error::input(
            "engine",
            "\"lanes\"",
            format!("\"auto\" or \"rapier\" for a scene of more than {} pairs of pieces", lanes::MAX_PAIRS),
        )),
    }
}
