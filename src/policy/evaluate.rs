//! How good a policy's ranking is: actions are tried in its order until one solves the task.
//!
//! Source: PHYRE's protocol (Bakhtin et al. 2019, section 3): up to 100 attempts a task; an action that cannot be
//! placed is not an attempt.
//!
//! Differences from the source: the candidates are a seeded subset of the discrete actions (PHYRE ranks 10,000
//! of its 100,000); attempts are made in small batches, and what a batch tried beyond the first success is not
//! counted as an attempt (the caller's world may have counted it as an interaction).

use rand::seq::SliceRandom;
use serde::{Deserialize, Serialize};

use super::auccess::{ATTEMPTS, auccess, curve};
use super::{CHUNK, Policy, rank};
use crate::error::{Error, Result};
use crate::progress::Progress;
use crate::rng;
use crate::task::{Task, ValidAction};

/// Tries actions of a task: for each whether it solved it, `None` if it cannot be placed.
pub type Attempt<'a> = dyn FnMut(&Task, &[ValidAction]) -> Result<Vec<Option<bool>>> + 'a;

/// What is ranked and how it is tried.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct EvaluateConfig {
    /// Discrete actions ranked for each task: all if there are no more, else a random subset.
    pub candidates: usize,
    /// Decides the subset; the same for every policy, so that they are compared on the same actions.
    pub seed: u64,
    /// Actions tried at a time.
    pub batch: usize,
}

/// Outcome of an evaluation.
#[derive(Clone, Debug, PartialEq)]
pub struct Evaluation {
    /// In [0, 1]; see [`super::auccess`].
    pub auccess: f64,
    /// (100,) share of tasks solved within k attempts.
    pub curve: [f64; ATTEMPTS],
    /// For each task the attempt that first solved it, from 1; `None` if none of 100 did.
    pub solved_at: Vec<Option<usize>>,
}

/// Tries actions of each task in the policy's order, up to 100 valid ones.
pub fn evaluate(
    policy: &dyn Policy,
    tasks: &[Task],
    config: &EvaluateConfig,
    attempt: &mut Attempt,
    progress: &dyn Progress,
) -> Result<Evaluation> {
    let mut solved_at = Vec::with_capacity(tasks.len());
    for (i, task) in tasks.iter().enumerate() {
        progress.report("evaluate", i as u64, tasks.len() as u64)?;
        let candidates = candidates(task, config)?;
        let order = rank(policy, task, &candidates, CHUNK)?;
        solved_at.push(first_success(task, &candidates, &order, config.batch, attempt)?);
    }
    progress.report("evaluate", tasks.len() as u64, tasks.len() as u64)?;
    Ok(Evaluation::of(solved_at))
}

/// The actions of `task` that a policy ranks.
pub fn candidates(task: &Task, config: &EvaluateConfig) -> Result<Vec<ValidAction>> {
    let count = task.actions().count();
    let mut indices: Vec<usize> = (0..count).collect();
    if config.candidates < count {
        let seed = rng::derive(config.seed, &task.id, 0);
        let (chosen, _) =
            indices.partial_shuffle(&mut rng::stream(seed, "evaluate candidates"), config.candidates);
        indices = chosen.to_vec();
    }
    indices.into_iter().map(|i| task.actions().at(i)).collect()
}

impl EvaluateConfig {
    /// 10,000 candidates, as PHYRE ranks; a batch of 8 keeps two cores and a batched kernel busy while wasting
    /// at most seven rollouts a task.
    pub fn phyre(seed: u64) -> EvaluateConfig {
        EvaluateConfig { candidates: 10_000, seed, batch: 8 }
    }
}

impl Evaluation {
    /// Condenses the attempt at which each task was solved.
    pub fn of(solved_at: Vec<Option<usize>>) -> Evaluation {
        Evaluation { auccess: auccess(&solved_at), curve: curve(&solved_at), solved_at }
    }
}

fn first_success(
    task: &Task,
    candidates: &[ValidAction],
    order: &[usize],
    batch: usize,
    attempt: &mut Attempt,
) -> Result<Option<usize>> {
    let mut tried = 0;
    let mut next = 0;
    while next < order.len() && tried < ATTEMPTS {
        // No more than could still count, so that a world's budget is not spent on what does not.
        let size = batch.max(1).min(ATTEMPTS - tried).min(order.len() - next);
        let actions: Vec<ValidAction> =
            order[next..next + size].iter().map(|i| candidates[*i].clone()).collect();
        next += size;
        let outcomes = attempt(task, &actions)?;
        if outcomes.len() != actions.len() {
            return Err(Error::Failed(format!(
                "{} outcomes came back for {} actions of {}",
                outcomes.len(),
                actions.len(),
                task.id
            )));
        }
        for solved in outcomes.into_iter().flatten() {
            tried += 1;
            if solved {
                return Ok(Some(tried));
            }
        }
    }
    Ok(None)
}
