//! Policies: scoring of actions by success, and evaluation of rankings. The only module that uses dfdx.
//!
//! A policy receives the task and the action, never the world. The module's interface consists of `f32` slices and safetensors bytes,
//! so that another learning library can implement [`Policy`].
//!
//! | module | purpose |
//! |---|---|
//! | `features` | features of a task and an action |
//! | `object_geometry` | position and shape of an object, for the features |
//! | `action_target` | objects that an action places |
//! | `goal_frame` | objects in the order of their roles in the goal |
//! | `data` | labels actions by simulating them |
//! | `outcomes` | cache of the outcomes of many actions in every task, for learning without a simulator |
//! | `outcome_table` | cached outcomes as training data and for evaluation |
//! | `agents` | comparison of agents over many families |
//! | `dqn` | network trained on labelled actions |
//! | `validate` | AUCCESS on held-out tasks during training, from labelled actions |
//! | `simulated_validation` | AUCCESS on held-out tasks in simulated worlds, for early stopping |
//! | `random` | random baseline |
//! | `evaluate` `auccess` | attempts in a policy's order, and their summary |

mod action_target;
pub mod agents;
pub mod auccess;
pub mod data;
pub mod dqn;
pub mod evaluate;
pub mod features;
mod goal_frame;
mod object_geometry;
pub mod outcome_table;
pub mod outcomes;
pub mod random;
pub mod simulated_validation;
pub mod validate;
mod weights;

use std::cmp::Ordering;

use rayon::prelude::*;

use crate::error::Result;
use crate::task::{Task, ValidAction};
pub use data::{Dataset, Example, LabelConfig, LabelledData, TrainingPhysics, label};
pub use dqn::{Dqn, EarlyStopping, TrainConfig, TrainLog, train, train_validated, train_with_early_stopping};
pub use evaluate::{EvaluateConfig, Evaluation, evaluate, evaluate_orders};
pub use outcome_table::{OutcomeDataset, OutcomeTable, TaskIndex};
pub use random::RandomPolicy;
pub use simulated_validation::SimulatedValidator;
pub use validate::{Validation, ValidationPoint};

/// Scores actions; a higher score means a higher success probability.
pub trait Policy: Send + Sync {
    /// One score per action, in their order.
    fn score(&self, task: &Task, actions: &[ValidAction]) -> Result<Vec<f32>>;

    /// Weights with metadata; `None` for a policy without weights.
    fn to_safetensors(&self) -> Option<Vec<u8>> {
        None
    }

    /// Human-readable description of the policy and its training.
    fn describe(&self) -> String;
}

/// Actions scored per chunk: 512 rows keep a layer's activations in the L2 cache.
pub const CHUNK: usize = 512;

/// Indices of `candidates` in order of decreasing score; ties keep their order, NaN comes last. Scores are computed for `chunk`
/// candidates (at least one) at a time.
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
