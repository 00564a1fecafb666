//! Validation during training: AUCCESS of a policy on labelled actions of held-out tasks.
//!
//! Source: PHYRE's metric (see `auccess`).
//!
//! Differences from the source: a few hundred labelled actions per task are ranked instead of 10,000, so that validation needs no
//! rollouts. The best of few actions are worse than the best of many, so a good policy scores higher in its evaluation. Tasks without
//! a solving labelled action score 0 for every policy and are excluded.

use serde::{Deserialize, Serialize};

use super::auccess::auccess;
use super::{CHUNK, Dataset, Policy, rank};
use crate::error::{Error, Result};
use crate::task::{Task, ValidAction};

/// Held-out tasks with labelled actions, and the validation schedule.
pub struct Validation {
    tasks: Vec<LabelledTask>,
    /// Number of evenly spaced validations during training, after the one at its start.
    times: usize,
}

/// Validation result during training.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct ValidationPoint {
    /// Number of updates so far.
    pub batches: usize,
    /// AUCCESS on the held-out tasks, [0, 1].
    pub auccess: f64,
}

struct LabelledTask {
    task: Task,
    actions: Vec<ValidAction>,
    /// Whether each action solves the task.
    solved: Vec<bool>,
}

impl Validation {
    /// Validation on held-out labelled tasks; errors if no labelled action solves any of them.
    pub fn new(data: &Dataset, times: usize) -> Result<Validation> {
        let of = |(t, task): (usize, &Task)| {
            let rows = || data.rows.iter().filter(|r| r.task == t);
            let (actions, solved) = (rows().map(|r| r.action.clone()), rows().map(|r| r.solved));
            LabelledTask { task: task.clone(), actions: actions.collect(), solved: solved.collect() }
        };
        let tasks: Vec<LabelledTask> =
            data.tasks.iter().enumerate().map(of).filter(|l| l.solved.contains(&true)).collect();
        if tasks.is_empty() {
            return Err(Error::Failed(format!(
                "none of {} actions solves a validation task, so there is nothing to validate on; \
                 train without validations",
                data.rows.len()
            )));
        }
        Ok(Validation { tasks, times })
    }

    /// Whether a validation is due after `done` batches.
    pub(super) fn due(&self, done: usize, batches: usize) -> bool {
        let looks = |done: usize| done * self.times / batches;
        done == 0 || looks(done) > looks(done - 1)
    }

    /// AUCCESS of a policy's ranking of the labelled actions.
    pub fn auccess(&self, policy: &dyn Policy) -> Result<f64> {
        let first = |l: &LabelledTask| {
            let order = rank(policy, &l.task, &l.actions, CHUNK)?;
            Ok(order.iter().position(|i| l.solved[*i]).map(|k| k + 1))
        };
        Ok(auccess(&self.tasks.iter().map(first).collect::<Result<Vec<_>>>()?))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::policy::{Dqn, TrainConfig, toy, train_validated};
    use crate::progress::{NoProgress, Progress};
    use std::sync::Mutex;

    /// Records all metrics.
    #[derive(Default)]
    struct MetricRecorder(Mutex<Vec<(&'static str, u64, f64)>>);
    impl Progress for MetricRecorder {
        fn report(&self, _: &str, _: u64, _: u64) -> Result<()> {
            Ok(())
        }
        fn metric(&self, name: &'static str, at: u64, value: f64) {
            self.0.lock().unwrap().push((name, at, value));
        }
    }

    #[test]
    fn validation_improves_and_does_not_affect_training() {
        let data = toy::dataset(&toy::tasks(8), 200);
        let unseen = toy::dataset(&[0.11, 0.23, 0.58, 0.79].map(toy::task), 200);
        let validation = Validation::new(&unseen, 4).unwrap();
        let config = TrainConfig { batches: 300, batch_size: 16, learning_rate: 3e-3, hidden: 32, seed: 1 };
        let told = MetricRecorder::default();
        let (with, log) = train_validated(&data, Some(&validation), &config, &told).unwrap();
        let (without, plain) = train_validated(&data, None, &config, &NoProgress).unwrap();
        assert_eq!((with.to_safetensors(), &log.loss), (without.to_safetensors(), &plain.loss));
        let at: Vec<usize> = log.validation.iter().map(|c| c.batches).collect();
        assert_eq!((at, plain.validation), (vec![0, 75, 150, 225, 300], Vec::new()));
        let [first, last] = [log.validation[0].auccess, log.validation[4].auccess];
        assert!(last > first + 0.2 && last > 0.8, "{first} to {last}");
        assert_eq!(last, validation.auccess(&with).unwrap());
        let told = told.0.into_inner().unwrap();
        let of = |name: &str| told.iter().filter(|f| f.0 == name).map(|f| (f.1, f.2)).collect::<Vec<_>>();
        let checks: Vec<_> = log.validation.iter().map(|c| (c.batches as u64, c.auccess)).collect();
        assert_eq!(of("validation"), checks);
        let loss = of("loss");
        assert_eq!((loss.first().unwrap().0, loss.last().unwrap().0, loss.len()), (2, 300, 150));
        let mean = loss.iter().scan(0, |seen, (at, v)| Some((*at - std::mem::replace(seen, *at)) as f64 * v));
        let sum: f64 = log.loss.iter().map(|v| f64::from(*v)).sum();
        assert!((mean.sum::<f64>() - sum).abs() < 1e-3, "each batch contributes to one mean");
    }

    #[test]
    fn excludes_tasks_without_solution() {
        let mut data = toy::dataset(&[0.2, 0.7].map(toy::task), 50);
        data.rows.iter_mut().filter(|r| r.task == 0).for_each(|r| r.solved = false);
        let policy = Dqn::untrained(&data.tasks[0], 8, 1).unwrap();
        let both = Validation::new(&data, 1).unwrap().auccess(&policy).unwrap();
        data.rows.retain(|r| r.task == 1);
        assert_eq!(Validation::new(&data, 1).unwrap().auccess(&policy).unwrap(), both);
        data.rows.iter_mut().for_each(|r| r.solved = false);
        assert!(matches!(Validation::new(&data, 1), Err(Error::Failed(_))));
    }
}
