//! Training: batches of pairs, half of them solving, binary cross-entropy, a step size that falls by half a cosine.

use dfdx::prelude::{Backward, Cpu, OwnedTape, TensorFromVec, Trace, binary_cross_entropy_with_logits_loss};
use dfdx::tensor::AsArray;
use rand::RngExt;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use super::net::Net;
use crate::error::{Error, Result};
use crate::neural::{Adam, Layer, half_cosine, matrix, one_thread};
use crate::policy::view::{Look, View};
use crate::policy::{Check, Labelled};
use crate::progress::Progress;
use crate::rng;
use crate::task::Learning;

/// How a policy is trained. More is not better by itself: on 48,000 labels of 60 bowling tasks 3000 batches of 64
/// ranked unseen tasks worse than the paper's 1000 of 16 (AUCCESS 0.66 against 0.68). [`super::train_saturated`] finds how many
/// are.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TrainConfig {
    /// Updates.
    pub batches: usize,
    /// Examples per update, an even number: half of them solving.
    pub batch_size: usize,
    /// Adam's step size at the start.
    pub learning_rate: f64,
    /// Units per hidden layer.
    pub hidden: usize,
    pub seed: u64,
}

/// What happened in training.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct TrainLog {
    /// (batches,) binary cross-entropy of each batch before its update, nats.
    pub loss: Vec<f32>,
    /// AUCCESS on held-out tasks on the way, if it was looked at.
    pub validation: Vec<Check>,
}

impl TrainConfig {
    /// A family's preset: the paper's pretraining, for the families that are the paper's.
    pub fn preset(learning: &Learning) -> TrainConfig {
        let Learning { batches, batch_size, .. } = *learning;
        TrainConfig { batches, batch_size, learning_rate: 1e-3, hidden: 256, seed: 0 }
    }

    /// Errors unless every value is allowed.
    pub fn validate(&self) -> Result<()> {
        let count = |field: &str, value: usize, low: usize, high: usize| {
            if (low..=high).contains(&value) {
                Ok(())
            } else {
                Err(Error::input(field, value, format!("a whole number from {low} to {high}")))
            }
        };
        count("batches", self.batches, 1, 1_000_000)?;
        count("batch_size", self.batch_size, 2, 4096)?;
        if !self.batch_size.is_multiple_of(2) {
            return Err(Error::input("batch_size", self.batch_size, "an even number: half solve, half fail"));
        }
        count("hidden", self.hidden, 1, MOST_UNITS)?;
        if !(self.learning_rate > 0.0 && self.learning_rate <= 1.0) {
            return Err(Error::input("learning_rate", self.learning_rate, "a number in (0, 1]"));
        }
        Ok(())
    }
}

/// Most units and features that a file may ask memory for.
pub(super) const MOST_UNITS: usize = 4096;

/// Losses told along a training, at most: a curve as fine as a screen shows.
const TOLD: usize = 200;

/// Batches whose rows are looked at together, on all threads, before they are learned from.
const AHEAD: usize = 64;

/// Trains `layers` in place and returns the loss of each batch; `look` sees the layers at the start and after each
/// batch; `adam` goes on from what it remembers. On one thread: batches are too small to gain from more, and one thread cannot change the order in which
/// products are summed.
pub(super) fn fit(
    layers: &mut [Layer],
    adam: &mut Option<Adam>,
    (data, view): (&dyn Labelled, View),
    config: &TrainConfig,
    look: &mut (dyn FnMut(usize, &[Layer]) -> Result<()> + Send),
    progress: &dyn Progress,
) -> Result<Vec<f32>> {
    let pairs = Pairs::new(data)?;
    let looks: Vec<Look> = data.tasks().par_iter().map(|task| view.look(task)).collect();
    let scenes: Vec<Vec<f32>> = looks.iter().map(Look::scene).collect();
    let pool = one_thread()?;
    let mut rng = rng::stream(config.seed, "dqn batches");
    let mut state = State { layers, adam, losses: Vec::new() };
    look(0, state.layers)?;
    while state.losses.len() < config.batches {
        let batches = AHEAD.min(config.batches - state.losses.len());
        let rows: Vec<usize> =
            (0..batches * config.batch_size / 2).flat_map(|_| pairs.draw(&mut rng)).collect();
        let seen: Vec<(usize, Vec<f32>)> = rows
            .par_iter()
            .map(|row| {
                let (task, action) = data.row(*row);
                (task, looks[task].action(action))
            })
            .collect();
        pool.install(|| {
            seen.chunks(config.batch_size)
                .try_for_each(|batch| state.learn(batch, &scenes, config, look, progress))
        })?;
    }
    progress.report("train", config.batches as u64, config.batches as u64)?;
    Ok(state.losses)
}

/// A training in the middle.
struct State<'a> {
    layers: &'a mut [Layer],
    adam: &'a mut Option<Adam>,
    /// Of each batch so far.
    losses: Vec<f32>,
}

impl State<'_> {
    /// One update, on (task, action features) of a batch: solving and failing in turn.
    fn learn(
        &mut self,
        rows: &[(usize, Vec<f32>)],
        scenes: &[Vec<f32>],
        config: &TrainConfig,
        look: &mut (dyn FnMut(usize, &[Layer]) -> Result<()> + Send),
        progress: &dyn Progress,
    ) -> Result<()> {
        let batch = self.losses.len();
        if batch.is_multiple_of(20) {
            progress.report("train", batch as u64, config.batches as u64)?;
        }
        let device = Cpu::default();
        let scene = matrix(&device, rows.iter().map(|(task, _)| &scenes[*task]));
        let action = matrix(&device, rows.iter().map(|(_, action)| action));
        let solved: Vec<f32> = (0..rows.len()).map(|i| if i % 2 == 0 { 1.0 } else { 0.0 }).collect();
        let solved = device.tensor_from_vec(solved, (rows.len(), 1));
        let net = Net::new(self.layers, &device);
        let scores = net.forward::<OwnedTape<f32, Cpu>>(scene.leaky_traced(), action.leaky_traced());
        let loss = binary_cross_entropy_with_logits_loss(scores, solved);
        let value = loss.array();
        self.losses.push(value);
        let rate = half_cosine(config.learning_rate, batch, config.batches);
        let adam = self.adam.get_or_insert_with(|| Adam::new(self.layers));
        adam.update(self.layers, &net.layers, &loss.backward(), rate as f32);
        // Not the loss alone: a rectifier turns a NaN into 0 and hides it.
        if !(value.is_finite() && self.layers.iter().all(Layer::is_finite)) {
            return Err(Error::Failed(format!(
                "training diverged: after batch {batch} loss or weights are not finite (loss {value}); \
                 a smaller learning_rate than {} may help",
                config.learning_rate
            )));
        }
        let (done, every) = (batch + 1, config.batches.div_ceil(TOLD));
        if done % every == 0 || done == config.batches {
            let since = &self.losses[batch / every * every..];
            let mean = since.iter().map(|v| f64::from(*v)).sum::<f64>() / since.len() as f64;
            progress.figure("loss", done as u64, mean);
        }
        look(done, self.layers)
    }
}

/// Examples by task and outcome. Drawing a task first and then a solving and a failing action of it keeps easy
/// tasks from crowding out hard ones, and leaves nothing to be learned from the scene alone: on bowling this
/// raised AUCCESS on unseen tasks from 0.65 to 0.69 (1000 batches of 16; pools of 800 actions, random 0.28).
struct Pairs {
    /// (solving, failing) row numbers of each task that has a solving action.
    tasks: Vec<[Vec<usize>; 2]>,
    /// All failing rows, for tasks that have none of their own.
    failing: Vec<usize>,
}

impl Pairs {
    fn new(data: &dyn Labelled) -> Result<Pairs> {
        let mut tasks = data.pools();
        let examples: usize = tasks.iter().flatten().map(Vec::len).sum();
        let mut failing: Vec<usize> = tasks.iter().flat_map(|[_, failing]| failing).copied().collect();
        failing.sort_unstable();
        tasks.retain(|[solving, _]| !solving.is_empty());
        for (missing, kind) in [(tasks.is_empty(), "solving"), (failing.is_empty(), "failing")] {
            if missing {
                return Err(Error::Failed(format!(
                    "no {kind} action among the {examples} examples: a policy learns from both kinds; label more actions"
                )));
            }
        }
        Ok(Pairs { tasks, failing })
    }

    /// A solving and a failing row.
    fn draw(&self, rng: &mut rng::Stream) -> [usize; 2] {
        let [solving, failing] = &self.tasks[rng.random_range(0..self.tasks.len())];
        let failing = if failing.is_empty() { &self.failing } else { failing };
        [solving[rng.random_range(0..solving.len())], failing[rng.random_range(0..failing.len())]]
    }
}
