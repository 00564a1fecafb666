//! Training for as long as it helps: stretches of batches, AUCCESS on validation tasks of the *simulation* after each, the best
//! weights kept. The real world is not asked.
//!
//! Source: early stopping by progress on held-out data, Prechelt 1998, "Early stopping - but when?", criterion UP (stop after so many
//! strips without progress). Stretches are warm restarts of the step size, Loshchilov and Hutter 2017 (SGDR, equation 5): within each
//! it falls by a half cosine to zero, so that weights are looked at when they have settled. Adam's moments go on.
//!
//! Differences from the source: stretches are equally long, so that the first is the fixed training of as many batches to the
//! bit; progress counts from a margin on. Of equal weights the later are kept: few validation tasks reach 1 early, and what
//! saw more examples is not worse on them.

use serde::{Deserialize, Serialize};

use super::fit::{TrainConfig, TrainLog};
use super::{Dqn, View};
use crate::error::{Error, Result};
use crate::policy::{Check, Judge, Labelled};
use crate::progress::Progress;
use crate::rng;

/// When a training has learned what it can.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Saturation {
    /// Batches at most, in all.
    pub most_batches: usize,
    /// AUCCESS by which the best must grow for progress.
    pub margin: f64,
    /// Stretches without progress before it ends.
    pub patience: usize,
    /// Worlds that policies are judged in, where there are so many.
    pub worlds: usize,
}

impl Saturation {
    /// Three stretches without a hundredth of AUCCESS more, sixteen in all; eight worlds stand for a spread of them.
    pub fn usual(config: &TrainConfig) -> Saturation {
        Saturation { most_batches: 16 * config.batches, margin: 0.01, patience: 3, worlds: 8 }
    }

    /// Errors unless every value is allowed.
    pub fn validate(&self) -> Result<()> {
        let count = |field: &str, value: usize, high: usize| {
            let allowed = format!("a whole number from 1 to {high}");
            if (1..=high).contains(&value) { Ok(()) } else { Err(Error::input(field, value, allowed)) }
        };
        count("most_batches", self.most_batches, 1_000_000)?;
        count("patience", self.patience, 1000)?;
        count("worlds", self.worlds, 1000)?;
        crate::error::within("margin", self.margin, 0.0, 1.0).map(drop)
    }
}

/// Trains in stretches of `config.batches` until AUCCESS by the judge grows no more. The log is of all stretches, those after
/// the best too; the policy's card lists those up to it.
pub fn train_saturated(
    data: &dyn Labelled,
    judge: &Judge,
    config: &TrainConfig,
    until: &Saturation,
    progress: &dyn Progress,
) -> Result<(Dqn, TrainLog)> {
    until.validate()?;
    data.validate()?;
    let judged = |dqn: &Dqn, batches: usize| {
        let auccess = judge.auccess(dqn, progress)?;
        progress.figure("validation", batches as u64, auccess);
        Ok::<Check, Error>(Check { batches, auccess })
    };
    let mut dqn = Dqn::untrained_on(View::of(data.tasks()), data.tasks(), config)?;
    let (mut log, mut adam, mut done) = (TrainLog::default(), None, 0);
    let mut best: Option<(Dqn, f64)> = None;
    let (mut reached, mut waited) = (f64::NEG_INFINITY, 0);
    while done < until.most_batches && waited < until.patience {
        let stretch = stretch(config, done, until.most_batches);
        let shifted = Shifted { inner: progress, by: done as u64, of: until.most_batches as u64 };
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
    let (dqn, _) = best.ok_or_else(|| Error::Failed("no stretch was trained".into()))?;
    Ok((dqn, log))
}

/// The training of the stretch that begins after `done` batches; the first is the whole training's own.
fn stretch(config: &TrainConfig, done: usize, most: usize) -> TrainConfig {
    let seed = if done == 0 { config.seed } else { rng::derive(config.seed, "stretch", done as u64) };
    TrainConfig { batches: config.batches.min(most - done), seed, ..config.clone() }
}

/// Progress of a stretch as that of the whole.
struct Shifted<'a> {
    inner: &'a dyn Progress,
    by: u64,
    of: u64,
}

impl Progress for Shifted<'_> {
    fn report(&self, stage: &str, done: u64, _: u64) -> Result<()> {
        self.inner.report(stage, self.by + done, self.of)
    }

    fn figure(&self, name: &'static str, at: u64, value: f64) {
        self.inner.figure(name, self.by + at, value);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::estimate::Believed;
    use crate::policy::{EvaluateConfig, Policy, toy, train};
    use crate::progress::Silent;
    use crate::task::Task;
    use crate::task::scene::Goal;
    use crate::world::Engine;
    use std::sync::Mutex;

    fn setup() -> TrainConfig {
        TrainConfig { batches: 40, batch_size: 16, learning_rate: 3e-3, hidden: 32, seed: 1 }
    }

    fn until() -> Saturation {
        Saturation { most_batches: 400, margin: 0.01, patience: 2, worlds: 1 }
    }

    /// Solved at once where red is placed as the toy's rule wants it, and never elsewhere.
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

    fn judge() -> Judge {
        let tasks = columns(&[0.23, 0.58, 0.79].map(toy::task));
        let config = EvaluateConfig { candidates: 400, seed: 0, batch: 8 };
        Judge::new(&tasks, vec![Believed::default()], &config, Engine::Auto).unwrap()
    }

    #[test]
    fn it_ends_where_nothing_is_gained_and_keeps_the_best() {
        let data = toy::dataset(&columns(&toy::tasks(8)), 200);
        let (dqn, log) = train_saturated(&data, &judge(), &setup(), &until(), &Silent).unwrap();
        let found: Vec<f64> = log.validation.iter().map(|c| c.auccess).collect();
        let at: Vec<usize> = log.validation.iter().map(|c| c.batches).collect();
        assert_eq!(at, (1..=found.len()).map(|k| 40 * k).collect::<Vec<_>>());
        assert_eq!(log.loss.len(), 40 * found.len());
        // Two stretches without progress end it, and not one earlier.
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
        // The card says which weights these are, and the judge thinks of them as the log says.
        let kept = dqn.card().batches();
        let best = found.iter().copied().fold(0.0, f64::max);
        assert_eq!(kept / 40, 1 + found.iter().rposition(|a| *a == best).unwrap());
        assert_eq!(judge().auccess(&dqn, &Silent).unwrap(), best);
        assert_eq!(Dqn::from_safetensors(&dqn.to_safetensors().unwrap()).unwrap(), dqn);
    }

    #[test]
    fn one_stretch_is_the_fixed_training_and_a_seed_gives_the_same_bits() {
        let data = toy::dataset(&columns(&toy::tasks(4)), 80);
        let one = Saturation { most_batches: 40, ..until() };
        let fixed = train(&data, &setup(), &Silent).unwrap().0;
        let run = |until: &Saturation, threads: usize| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            pool.install(|| train_saturated(&data, &judge(), &setup(), until, &Silent).unwrap())
        };
        assert_eq!(run(&one, 2).0, fixed);
        let some = Saturation { most_batches: 100, ..until() };
        let (dqn, log) = run(&some, 1);
        assert_eq!(log.validation.last().unwrap().batches, 100, "the last stretch is what is left");
        assert_eq!(run(&some, 3), (dqn, log));
    }

    #[test]
    fn a_longer_training_remembers_what_adam_did() {
        let data = toy::dataset(&columns(&toy::tasks(4)), 80);
        let two = Saturation { most_batches: 80, margin: 0.0, patience: 9, worlds: 1 };
        let (_, log) = train_saturated(&data, &judge(), &setup(), &two, &Silent).unwrap();
        let (first, part) = train(&data, &setup(), &Silent).unwrap();
        let afresh = first.learn_more(&data, &stretch(&setup(), 40, 80), &Silent).unwrap().1;
        assert_eq!(log.loss[..40], part.loss);
        assert_eq!(log.loss[40], afresh.loss[0], "the same weights see the same batch");
        assert_ne!(log.loss[41..], afresh.loss[1..]);
    }

    #[test]
    fn it_tells_where_it_is_and_can_be_cancelled() {
        #[derive(Default)]
        struct Told {
            /// Batches done and in all, of the stage "train".
            trained: Mutex<Vec<(u64, u64)>>,
            /// Batches done at each look.
            looks: Mutex<Vec<u64>>,
            most: Option<u64>,
        }
        impl Progress for Told {
            fn report(&self, stage: &str, done: u64, of: u64) -> Result<()> {
                if stage == "train" {
                    self.trained.lock().unwrap().push((done, of));
                }
                let over = stage == "train" && self.most.is_some_and(|most| done >= most);
                if over { Err(Error::Cancelled) } else { Ok(()) }
            }
            fn figure(&self, name: &'static str, at: u64, _: f64) {
                if name == "validation" {
                    self.looks.lock().unwrap().push(at);
                }
            }
        }
        let data = toy::dataset(&columns(&toy::tasks(4)), 80);
        let run = |told: &Told| train_saturated(&data, &judge(), &setup(), &until(), told);
        let told = Told::default();
        let (_, log) = run(&told).unwrap();
        let checked: Vec<u64> = log.validation.iter().map(|c| c.batches as u64).collect();
        assert_eq!(told.looks.into_inner().unwrap(), checked);
        let trained = told.trained.into_inner().unwrap();
        assert!(trained.is_sorted() && trained.iter().all(|t| t.1 == 400), "{trained:?}");
        assert_eq!(run(&Told { most: Some(60), ..Told::default() }).unwrap_err(), Error::Cancelled);
    }

    #[test]
    fn what_cannot_be_waited_for_is_refused_by_name() {
        let data = toy::dataset(&columns(&toy::tasks(2)), 60);
        let refused = |until: Saturation, wanted: &str| {
            let error = train_saturated(&data, &judge(), &setup(), &until, &Silent).unwrap_err().to_string();
            assert!(error.contains(wanted), "{error}");
        };
        refused(Saturation { most_batches: 0, ..until() }, "most_batches");
        refused(Saturation { patience: 0, ..until() }, "patience");
        refused(Saturation { worlds: 0, ..until() }, "worlds");
        refused(Saturation { margin: f64::NAN, ..until() }, "margin");
    }
}
