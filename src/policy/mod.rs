//! Policies: what scores an action for success, and how good a ranking is. Sole home of dfdx.
//!
//! A policy sees the task and the action, never the world. Everything crosses this room's border as `f32`
//! slices and safetensors bytes, so that another learning library can be put behind [`Policy`].
//!
//! | file | what it does |
//! |---|---|
//! | `features` | task and action -> numbers |
//! | `shared` | the same for tasks of any family: numbers that mean the same everywhere |
//! | `thing` | a thing's place and form, for those |
//! | `placed` | what an action places, for both |
//! | `view` | which of the two a policy sees |
//! | `data` | labels actions by simulating them |
//! | `outcomes` | what many actions do in every task, for learning without a simulator |
//! | `table` | such outcomes as something to learn from and to be judged by |
//! | `agents` | what is compared over many families, and how |
//! | `dqn` | learns to score from labelled actions |
//! | `validate` | AUCCESS along a training, on tasks not learned from |
//! | `judge` | AUCCESS by attempts in simulated worlds, which says when a training has learned what it can |
//! | `random` | the floor every policy must beat |
//! | `evaluate` `auccess` | tries actions in a policy's order and condenses the outcome |

pub mod agents;
pub mod auccess;
pub mod data;
pub mod dqn;
pub mod evaluate;
pub mod features;
pub mod judge;
pub mod outcomes;
mod placed;
pub mod random;
pub mod shared;
pub mod table;
mod thing;
pub mod validate;
pub mod view;
mod weights;

use std::cmp::Ordering;

use rayon::prelude::*;

use crate::error::Result;
use crate::task::{Task, ValidAction};
pub use data::{Dataset, Example, LabelConfig, Labelled, Training, label};
pub use dqn::{Dqn, Saturation, TrainConfig, TrainLog, train, train_saturated, train_validated};
pub use evaluate::{EvaluateConfig, Evaluation, evaluate, evaluate_orders};
pub use judge::Judge;
pub use random::Random;
pub use table::{Lesson, Place, Table};
pub use validate::{Check, Validation};

/// Scores actions for success; the higher, the likelier.
pub trait Policy: Send + Sync {
    /// One score per action, in their order.
    fn score(&self, task: &Task, actions: &[ValidAction]) -> Result<Vec<f32>>;

    /// Weights and what is needed to use them again; `None` for a policy without weights.
    fn to_safetensors(&self) -> Option<Vec<u8>> {
        None
    }

    /// What it is and how it came about, for people.
    fn describe(&self) -> String;
}

/// Chunk in which 50,000 actions are scored fastest here (512 rows keep a layer's activations in L2).
pub const CHUNK: usize = 512;

/// Indices of `candidates` from the highest to the lowest score; ties keep their order. Scores are computed
/// `chunk` candidates at a time (at least one). A score that is not a number comes last.
pub fn rank(
    policy: &dyn Policy,
    task: &Task,
    candidates: &[ValidAction],
    chunk: usize,
) -> Result<Vec<usize>> {
    let parts: Vec<Vec<f32>> =
        candidates.par_chunks(chunk.max(1)).map(|part| policy.score(task, part)).collect::<Result<_>>()?;
    let scores: Vec<f32> = parts.concat();
    let key = |i: usize| if scores[i].is_nan() { f32::NEG_INFINITY } else { scores[i] };
    let mut order: Vec<usize> = (0..candidates.len()).collect();
    order.sort_by(|a, b| key(*b).partial_cmp(&key(*a)).unwrap_or(Ordering::Equal));
    Ok(order)
}

#[cfg(test)]
mod toy;
