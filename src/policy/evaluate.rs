//! Evaluation of a policy's ranking: actions are attempted in its order until one solves the task.
//!
//! Source: PHYRE's protocol (Bakhtin et al. 2019, section 3): up to 100 attempts per task; an action that cannot be
//! placed is not an attempt.
//!
//! Differences from the source: the candidates are a random subset of the discrete actions (PHYRE ranks 10,000 of its 100,000).
//! Attempts are made in small batches; actions of a batch after the first success do not count as attempts, although the
//! caller's world may count them as interactions.

use rand::seq::SliceRandom;
use serde::{Deserialize, Serialize};

use super::auccess::{MAX_ATTEMPTS, auccess, success_curve};
use super::{CHUNK, Policy, rank};
use crate::error::{Error, Result};
use crate::progress::Progress;
use crate::rng;
use crate::task::{Task, ValidAction};

/// Function that carries out actions of a task and returns whether each solves it; `None` if it cannot be placed.
pub type AttemptFn<'a> = dyn FnMut(&Task, &[ValidAction]) -> Result<Vec<Option<bool>>> + 'a;

/// Configuration of an evaluation.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct EvaluateConfig {
    /// Number of discrete actions ranked per task: all, or a random subset.
    pub candidates: usize,
    /// Seed of the subset; equal seeds give every policy the same candidates.
    pub seed: u64,
    /// Actions attempted per batch.
    pub batch: usize,
}

/// Outcome of an evaluation.
#[derive(Clone, Debug, PartialEq)]
pub struct Evaluation {
    /// AUCCESS, in [0, 1]; see [`super::auccess`].
    pub auccess: f64,
    /// (100,) share of tasks solved within k attempts.
    pub curve: [f64; MAX_ATTEMPTS],
    /// Number of the first solving attempt of each task, from 1; `None` if none of 100 solves it.
    pub solved_at: Vec<Option<usize>>,
}

/// Evaluates a policy: attempts up to 100 valid actions of each task in the policy's order.
pub fn evaluate(
    policy: &dyn Policy,
    tasks: &[Task],
    config: &EvaluateConfig,
    attempt: &mut AttemptFn,
    progress: &dyn Progress,
) -> Result<Evaluation> {
    solve_each_task(tasks, progress, |_, task| {
        let candidates = candidates(task, config)?;
        let order = rank(policy, task, &candidates, CHUNK)?;
        let ordered = order.into_iter().map(|i| &candidates[i]);
        first_success(task, ordered, config.batch, attempt)
    })
}

/// Evaluates rankings of an external policy: `orders[t]` are the actions of `tasks[t]`, best first; up to 100 valid attempts.
pub fn evaluate_orders(
    tasks: &[Task],
    orders: &[Vec<ValidAction>],
    batch: usize,
    attempt: &mut AttemptFn,
    progress: &dyn Progress,
) -> Result<Evaluation> {
    solve_each_task(tasks, progress, |t, task| first_success(task, orders[t].iter(), batch, attempt))
}

/// Candidate actions of `task`.
pub fn candidates(task: &Task, config: &EvaluateConfig) -> Result<Vec<ValidAction>> {
    let count = task.actions().count();
    let mut indices: Vec<usize> = (0..count).collect();
    if config.candidates < count {
        let seed = rng::derive_seed(config.seed, &task.id, 0);
        let (chosen, _) =
            indices.partial_shuffle(&mut rng::stream(seed, "evaluate candidates"), config.candidates);
        indices = chosen.to_vec();
    }
    indices.into_iter().map(|i| task.actions().at(i)).collect()
}

impl EvaluateConfig {
    /// PHYRE's preset: 10,000 candidates. Batches of 8 use two cores and the batched kernel well and waste at most seven rollouts per
    /// task.
    pub fn phyre(seed: u64) -> EvaluateConfig {
        EvaluateConfig { candidates: 10_000, seed, batch: 8 }
    }
}

impl Evaluation {
    /// Evaluation from the first solving attempt of each task.
    pub fn of(solved_at: Vec<Option<usize>>) -> Evaluation {
        Evaluation { auccess: auccess(&solved_at), curve: success_curve(&solved_at), solved_at }
    }
}

/// First solving attempt of each task, from `solve`.
fn solve_each_task(
    tasks: &[Task],
    progress: &dyn Progress,
    mut solve: impl FnMut(usize, &Task) -> Result<Option<usize>>,
) -> Result<Evaluation> {
    let mut solved_at = Vec::with_capacity(tasks.len());
    for (t, task) in tasks.iter().enumerate() {
        progress.report("evaluate", t as u64, tasks.len() as u64)?;
        solved_at.push(solve(t, task)?);
    }
    progress.report("evaluate", tasks.len() as u64, tasks.len() as u64)?;
    Ok(Evaluation::of(solved_at))
}

fn first_success<'a>(
    task: &Task,
    mut ordered: impl Iterator<Item = &'a ValidAction>,
    batch: usize,
    attempt: &mut AttemptFn,
) -> Result<Option<usize>> {
    let mut tried = 0;
    while tried < MAX_ATTEMPTS {
        // Limited to the attempts that can still count, to save the world's budget.
        let size = batch.max(1).min(MAX_ATTEMPTS - tried);
        let actions: Vec<ValidAction> = ordered.by_ref().take(size).cloned().collect();
        if actions.is_empty() {
            break;
        }
        let outcomes = attempt(task, &actions)?;
        if outcomes.len() != actions.len() {
            return Err(Error::Failed(format!(
                "received {} outcomes for {} actions of {}",
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::policy::toy;
    use crate::progress::NoProgress;

    /// Scores actions by decreasing x.
    struct Leftmost;
    impl Policy for Leftmost {
        fn score(&self, _: &Task, actions: &[ValidAction]) -> Result<Vec<f32>> {
            Ok(actions.iter().map(|a| -a.values()[0] as f32).collect())
        }
        fn describe(&self) -> String {
            "leftmost".into()
        }
    }

    fn config(batch: usize) -> EvaluateConfig {
        EvaluateConfig { candidates: 1000, seed: 1, batch }
    }

    /// Number of valid attempts until the first success, one at a time in order of x.
    fn by_hand(task: &Task, valid: impl Fn(f64) -> bool, solves: impl Fn(f64) -> bool) -> Option<usize> {
        let mut x: Vec<f64> = candidates(task, &config(1)).unwrap().iter().map(|a| a.values()[0]).collect();
        x.sort_by(f64::total_cmp);
        let mut tried = x.into_iter().filter(|x| valid(*x)).take(MAX_ATTEMPTS);
        tried.position(solves).map(|k| k + 1)
    }

    #[test]
    fn counts_only_valid_attempts_for_any_batch_size() {
        let task = toy::task(0.3);
        // Every third step of 0.002 cannot be placed; success begins at x = 0.07.
        let valid = |x: f64| !((x / 0.002) as u64).is_multiple_of(3);
        let solves = |x: f64| x > 0.07;
        let wanted = by_hand(&task, valid, solves);
        assert!(wanted.is_some_and(|k| k > 20), "{wanted:?}");
        for batch in [1, 7, 8, 100, 5000] {
            let mut attempt = |_: &Task, actions: &[ValidAction]| {
                let outcome = |a: &ValidAction| valid(a.values()[0]).then(|| solves(a.values()[0]));
                Ok(actions.iter().map(outcome).collect())
            };
            let found =
                evaluate(&Leftmost, std::slice::from_ref(&task), &config(batch), &mut attempt, &NoProgress)
                    .unwrap();
            assert_eq!(found.solved_at, [wanted], "batches of {batch}");
            assert_eq!(found.auccess, auccess(&[wanted]));
        }
    }

    #[test]
    fn stops_after_100_valid_attempts() {
        let task = toy::task(0.3);
        let mut tried = 0;
        let mut attempt = |_: &Task, actions: &[ValidAction]| {
            tried += actions.len();
            Ok(vec![Some(false); actions.len()])
        };
        let found = evaluate(&Leftmost, &[task], &config(8), &mut attempt, &NoProgress).unwrap();
        assert_eq!((found.solved_at, found.auccess), (vec![None], 0.0));
        assert_eq!(tried, MAX_ATTEMPTS, "no further interaction");
    }

    #[test]
    fn candidates_are_reproducible_and_distinct() {
        let task = toy::task(0.3);
        let some = candidates(&task, &config(1)).unwrap();
        assert_eq!(some, candidates(&task, &config(8)).unwrap());
        assert_eq!(some.len(), 1000);
        let all = candidates(&task, &EvaluateConfig { candidates: 9999, ..config(1) }).unwrap();
        assert_eq!(all.len(), 5000);
        assert!(some.iter().all(|a| all.contains(a)));
    }

    #[test]
    fn rejects_missing_outcomes() {
        let mut attempt = |_: &Task, _: &[ValidAction]| Ok(vec![Some(true)]);
        let result = evaluate(&Leftmost, &[toy::task(0.3)], &config(8), &mut attempt, &NoProgress);
        assert!(matches!(result, Err(Error::Failed(_))));
    }
}
