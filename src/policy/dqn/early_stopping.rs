//! Early stopping: trains in cycles of batches, computes AUCCESS on validation tasks in *simulation* after each, and keeps the best
//! weights. Uses no real interactions.
//!
//! Source: early stopping by progress on held-out data, Prechelt 1998, "Early stopping - but when?", criterion UP (stop after a number
//! of strips without progress). Cycles are warm restarts of the learning rate, Loshchilov and Hutter 2017 (SGDR, equation 5): it is
//! annealed to zero within each cycle, so that weights have converged when they are validated. Adam's moments are carried over.
//!
//! Differences from the source: cycles have equal length, so that the first equals a fixed training of as many batches bit for bit;
//! progress requires a margin. Ties go to later weights, since with few validation tasks AUCCESS reaches 1 early, and weights trained
//! on more examples are no worse.

use serde::{Deserialize, Serialize};

use super::Dqn;
use super::fit::{TrainConfig, TrainLog};
use crate::error::{Error, Result, check_count, check_range};
use crate::policy::{LabelledData, SimulatedValidator, ValidationPoint};
use crate::progress::Progress;
use crate::rng;

/// Configuration of early stopping.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct EarlyStopping {
    /// Maximum total number of batches.
    #[serde(rename = "most_batches")]
    pub max_batches: usize,
    /// Minimum increase of the best AUCCESS that counts as progress.
    pub margin: f64,
    /// Number of cycles without progress before training stops.
    pub patience: usize,
    /// Maximum number of worlds for validation.
    pub worlds: usize,
}

impl EarlyStopping {
    /// Standard preset: patience of three cycles with a margin of 0.01 AUCCESS, at most sixteen cycles, eight worlds.
    pub fn standard(config: &TrainConfig) -> EarlyStopping {
        EarlyStopping { max_batches: 16 * config.batches, margin: 0.01, patience: 3, worlds: 8 }
    }

    /// Errors name the field that is out of range.
    pub fn validate(&self) -> Result<()> {
        check_count("most_batches", self.max_batches, 1, 1_000_000)?;
        check_count("patience", self.patience, 1, 1000)?;
        check_count("worlds", self.worlds, 1, 1000)?;
        check_range("margin", self.margin, 0.0, 1.0).map(drop)
    }
}

/// Trains in cycles of `config.batches` until the validation AUCCESS stops increasing. The log covers all cycles, including those after
/// the best one; the policy's card lists those up to the best one.
pub fn train_with_early_stopping(
    data: &dyn LabelledData,
    judge: &SimulatedValidator,
    config: &TrainConfig,
    until: &EarlyStopping,
    progress: &dyn Progress,
) -> Result<(Dqn, TrainLog)> {
    until.validate()?;
    data.validate()?;
    let judged = |dqn: &Dqn, batches: usize| {
        let auccess = judge.auccess(dqn, progress)?;
        progress.metric("validation", batches as u64, auccess);
        Ok::<ValidationPoint, Error>(ValidationPoint { batches, auccess })
    };
    let mut dqn = Dqn::untrained_on(data.tasks(), config)?;
    let (mut log, mut adam, mut done) = (TrainLog::default(), None, 0);
    let mut best: Option<(Dqn, f64)> = None;
    let (mut reached, mut waited) = (f64::NEG_INFINITY, 0);
    while done < until.max_batches && waited < until.patience {
        let stretch = cycle_config(config, done, until.max_batches);
        let shifted = OffsetProgress { inner: progress, by: done as u64, of: until.max_batches as u64 };
        let (next, part) = dqn.learn_on(data, &mut adam, None, &stretch, &shifted)?;
        dqn = next;
        done += stretch.batches;
        let check = judged(&dqn, done)?;
        log.loss.extend(part.loss);
        log.validation.push(check);
        waited = if check.auccess > reached + until.margin { 0 } else { waited + 1 };
        if waited == 0 {
            reached = check.auccess;
        }
        if best.as_ref().is_none_or(|(_, auccess)| check.auccess >= *auccess) {
            best = Some((dqn.clone(), check.auccess));
        }
    }
    let (dqn, _) = best.ok_or_else(|| Error::Failed("no cycle was trained".into()))?;
    Ok((dqn, log))
}

/// Configuration of the cycle that begins after `done` batches; the first one keeps the seed.
fn cycle_config(config: &TrainConfig, done: usize, most: usize) -> TrainConfig {
    let seed = if done == 0 { config.seed } else { rng::derive_seed(config.seed, "stretch", done as u64) };
    TrainConfig { batches: config.batches.min(most - done), seed, ..config.clone() }
}

/// Reports a cycle's progress as a part of the whole training.
struct OffsetProgress<'a> {
    inner: &'a dyn Progress,
    by: u64,
    of: u64,
}

impl Progress for OffsetProgress<'_> {
    fn report(&self, stage: &str, done: u64, _: u64) -> Result<()> {
        self.inner.report(stage, self.by + done, self.of)
    }

    fn metric(&self, name: &'static str, at: u64, value: f64) {
        self.inner.metric(name, self.by + at, value);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::estimate::ParameterSample;
    use crate::policy::{EvaluateConfig, Policy, toy, train};
    use crate::progress::NoProgress;
    use crate::task::Task;
    use crate::task::scene::Goal;
    use crate::world::Engine;
    use std::sync::Mutex;

    fn setup() -> TrainConfig {
        TrainConfig { batches: 40, batch_size: 16, learning_rate: 3e-3, hidden: 32, seed: 1 }
    }

    fn until() -> EarlyStopping {
        EarlyStopping { max_batches: 400, margin: 0.01, patience: 2, worlds: 1 }
    }

    /// Tasks that are solved exactly where red is placed according to the toy rule.
    fn columns(tasks: &[Task]) -> Vec<Task> {
        let column = |task: &Task| {
            let mut task = task.clone();
            task.scene.steps = 2;
            let solved = |x: f64| {
                let action = task.actions().validate(&[x, 0.5, 0.5]).unwrap();
                toy::solves(&task, &action)
            };
            let grid: Vec<f64> = (0..=1000).map(|i| f64::from(i) / 1000.0).filter(|x| solved(*x)).collect();
            let [left, right] = [grid[0], grid[grid.len() - 1]].map(|x| 10.0 * x);
            let region = vec![[left, -99.0], [right, -99.0], [right, 99.0], [left, 99.0]];
            task.scene.goal = Some(Goal::Inside { body: "red".into(), region, hold_s: 0.0, stop: None });
            task
        };
        tasks.iter().map(column).collect()
    }

    fn judge() -> SimulatedValidator {
        let tasks = columns(&[0.23, 0.58, 0.79].map(toy::task));
        let config = EvaluateConfig { candidates: 400, seed: 0, batch: 8 };
        SimulatedValidator::new(&tasks, vec![ParameterSample::default()], &config, Engine::Auto).unwrap()
    }

    #[test]
    fn stops_without_progress_and_keeps_best_weights() {
        let data = toy::dataset(&columns(&toy::tasks(8)), 200);
        let (dqn, log) = train_with_early_stopping(&data, &judge(), &setup(), &until(), &NoProgress).unwrap();
        let found: Vec<f64> = log.validation.iter().map(|c| c.auccess).collect();
        let at: Vec<usize> = log.validation.iter().map(|c| c.batches).collect();
        assert_eq!(at, (1..=found.len()).map(|k| 40 * k).collect::<Vec<_>>());
        assert_eq!(log.loss.len(), 40 * found.len());
        // Training stops exactly after two cycles without progress.
        let mut reached = f64::NEG_INFINITY;
        let progress: Vec<bool> = found
            .iter()
            .map(|a| {
                *a > reached + 0.01 && {
                    reached = *a;
                    true
                }
            })
            .collect();
        let ended = progress.windows(2).position(|w| w == [false, false]).map(|k| k + 2);
        assert_eq!(ended.unwrap_or(10), found.len(), "{found:?}");
        assert!(found.len() < 10 && found.iter().copied().fold(0.0, f64::max) > found[0] + 0.02, "{found:?}");
        // The card identifies the weights, and their validation AUCCESS equals the logged one.
        let kept = dqn.card().batches();
        let best = found.iter().copied().fold(0.0, f64::max);
        assert_eq!(kept / 40, 1 + found.iter().rposition(|a| *a == best).unwrap());
        assert_eq!(judge().auccess(&dqn, &NoProgress).unwrap(), best);
        assert_eq!(Dqn::from_safetensors(&dqn.to_safetensors().unwrap()).unwrap(), dqn);
    }

    #[test]
    fn single_cycle_equals_fixed_training() {
        let data = toy::dataset(&columns(&toy::tasks(4)), 80);
        let one = EarlyStopping { max_batches: 40, ..until() };
        let fixed = train(&data, &setup(), &NoProgress).unwrap().0;
        let run = |until: &EarlyStopping, threads: usize| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            pool.install(|| train_with_early_stopping(&data, &judge(), &setup(), until, &NoProgress).unwrap())
        };
        assert_eq!(run(&one, 2).0, fixed);
        let some = EarlyStopping { max_batches: 100, ..until() };
        let (dqn, log) = run(&some, 1);
        assert_eq!(log.validation.last().unwrap().batches, 100, "the last cycle has the remaining batches");
        assert_eq!(run(&some, 3), (dqn, log));
    }

    #[test]
    fn cycles_carry_over_adam_moments() {
        let data = toy::dataset(&columns(&toy::tasks(4)), 80);
        let two = EarlyStopping { max_batches: 80, margin: 0.0, patience: 9, worlds: 1 };
        let (_, log) = train_with_early_stopping(&data, &judge(), &setup(), &two, &NoProgress).unwrap();
        let (first, part) = train(&data, &setup(), &NoProgress).unwrap();
        let afresh = first.learn_more(&data, &cycle_config(&setup(), 40, 80), &NoProgress).unwrap().1;
        assert_eq!(log.loss[..40], part.loss);
        assert_eq!(log.loss[40], afresh.loss[0], "same weights and same batch");
        assert_ne!(log.loss[41..], afresh.loss[1..]);
    }

    #[test]
    fn reports_progress_and_can_be_cancelled() {
        #[derive(Default)]
        struct StageRecorder {
            /// (done, total) batches of the stage "train".
            trained: Mutex<Vec<(u64, u64)>>,
            /// Batches done at each validation.
            looks: Mutex<Vec<u64>>,
            most: Option<u64>,
        }
        impl Progress for StageRecorder {
            fn report(&self, stage: &str, done: u64, of: u64) -> Result<()> {
                if stage == "train" {
                    self.trained.lock().unwrap().push((done, of));
                }
                let over = stage == "train" && self.most.is_some_and(|most| done >= most);
                if over { Err(Error::Cancelled) } else { Ok(()) }
            }
            fn metric(&self, name: &'static str, at: u64, _: f64) {
                if name == "validation" {
                    self.looks.lock().unwrap().push(at);
                }
            }
        }
        let data = toy::dataset(&columns(&toy::tasks(4)), 80);
        let run = |told: &StageRecorder| train_with_early_stopping(&data, &judge(), &setup(), &until(), told);
        let told = StageRecorder::default();
        let (_, log) = run(&told).unwrap();
        let checked: Vec<u64> = log.validation.iter().map(|c| c.batches as u64).collect();
        assert_eq!(told.looks.into_inner().unwrap(), checked);
        let trained = told.trained.into_inner().unwrap();
        assert!(trained.is_sorted() && trained.iter().all(|t| t.1 == 400), "{trained:?}");
        assert_eq!(
            run(&StageRecorder { most: Some(60), ..StageRecorder::default() }).unwrap_err(),
            Error::Cancelled
        );
    }

    #[test]
    fn rejects_invalid_configuration() {
        let data = toy::dataset(&columns(&toy::tasks(2)), 60);
        let refused = |until: EarlyStopping, wanted: &str| {
            let error = train_with_early_stopping(&data, &judge(), &setup(), &until, &NoProgress)
                .unwrap_err()
                .to_string();
            assert!(error.contains(wanted), "{error}");
        };
        refused(EarlyStopping { max_batches: 0, ..until() }, "most_batches");
        refused(EarlyStopping { patience: 0, ..until() }, "patience");
        refused(EarlyStopping { worlds: 0, ..until() }, "worlds");
        refused(EarlyStopping { margin: f64::NAN, ..until() }, "margin");
    }
}
