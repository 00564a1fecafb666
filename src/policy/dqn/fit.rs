//! Training: balanced batches of pairs, binary cross-entropy, cosine annealing of the learning rate.

use dfdx::prelude::{Backward, Cpu, OwnedTape, TensorFromVec, Trace, binary_cross_entropy_with_logits_loss};
use dfdx::tensor::AsArray;
use rand::RngExt;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use super::net::Net;
use crate::error::{Error, Result, check_count};
use crate::neural::{Adam, DenseLayer, cosine_annealing, matrix, single_thread_pool};
use crate::policy::features::FeatureExtractor;
use crate::policy::{LabelledData, ValidationPoint};
use crate::progress::Progress;
use crate::rng;
use crate::task::Learning;

/// Training configuration. More batches can rank unseen tasks worse (overfitting); [`super::train_with_early_stopping`] selects the
/// number of batches.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TrainConfig {
    /// Number of updates.
    pub batches: usize,
    /// Examples per update, an even number: half of them solve their task.
    pub batch_size: usize,
    /// Initial learning rate of Adam.
    pub learning_rate: f64,
    /// Units per hidden layer.
    pub hidden: usize,
    pub seed: u64,
}

/// Training log.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct TrainLog {
    /// (batches,) binary cross-entropy of each batch before its update, nats.
    pub loss: Vec<f32>,
    /// AUCCESS on held-out tasks during training, if validated.
    pub validation: Vec<ValidationPoint>,
}

impl TrainConfig {
    /// Preset of a family; for the paper's families, the paper's pretraining.
    pub fn preset(learning: &Learning) -> TrainConfig {
        let Learning { batches, batch_size, .. } = *learning;
        TrainConfig { batches, batch_size, learning_rate: 1e-3, hidden: 256, seed: 0 }
    }

    /// Errors name the field that is out of range.
    pub fn validate(&self) -> Result<()> {
        check_count("batches", self.batches, 1, 1_000_000)?;
        check_count("batch_size", self.batch_size, 2, 4096)?;
        if !self.batch_size.is_multiple_of(2) {
            return Err(Error::input("batch_size", self.batch_size, "an even number: half solve, half fail"));
        }
        check_count("hidden", self.hidden, 1, MAX_UNITS)?;
        if !(self.learning_rate > 0.0 && self.learning_rate <= 1.0) {
            return Err(Error::input("learning_rate", self.learning_rate, "a number in (0, 1]"));
        }
        Ok(())
    }
}

/// Maximum number of units and features, which bounds the memory that a file can request.
pub(super) const MAX_UNITS: usize = 4096;

/// Maximum number of losses reported during training: the resolution of a plot.
const MAX_REPORTED_LOSSES: usize = 200;

/// Number of batches whose features are computed together on all threads before training on them.
const PREFETCH_BATCHES: usize = 64;

/// Trains `layers` in place and returns the loss of each batch; `look` is called with the layers at the start and after each batch;
/// `adam` keeps its moments. Uses one thread: batches are too small to gain from more, and the order of summation is fixed.
pub(super) fn fit(
    layers: &mut [DenseLayer],
    adam: &mut Option<Adam>,
    data: &dyn LabelledData,
    config: &TrainConfig,
    look: &mut (dyn FnMut(usize, &[DenseLayer]) -> Result<()> + Send),
    progress: &dyn Progress,
) -> Result<Vec<f32>> {
    let pairs = BalancedPairs::new(data)?;
    let looks: Vec<FeatureExtractor> = data.tasks().par_iter().map(FeatureExtractor::new).collect();
    let scenes: Vec<Vec<f32>> = looks.iter().map(FeatureExtractor::scene).collect();
    let pool = single_thread_pool()?;
    let mut rng = rng::stream(config.seed, "dqn batches");
    let mut state = TrainState { layers, adam, losses: Vec::new() };
    look(0, state.layers)?;
    while state.losses.len() < config.batches {
        let batches = PREFETCH_BATCHES.min(config.batches - state.losses.len());
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

/// State of a training.
struct TrainState<'a> {
    layers: &'a mut [DenseLayer],
    adam: &'a mut Option<Adam>,
    /// Loss of each batch so far.
    losses: Vec<f32>,
}

impl TrainState<'_> {
    /// One update on a batch of (task, action features), alternately solving and failing.
    fn learn(
        &mut self,
        rows: &[(usize, Vec<f32>)],
        scenes: &[Vec<f32>],
        config: &TrainConfig,
        look: &mut (dyn FnMut(usize, &[DenseLayer]) -> Result<()> + Send),
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
        let rate = cosine_annealing(config.learning_rate, batch, config.batches);
        let adam = self.adam.get_or_insert_with(|| Adam::new(self.layers));
        adam.update(self.layers, &net.layers, &loss.backward(), rate as f32);
        // Checking the loss alone is insufficient: a rectifier turns NaN into 0.
        if !(value.is_finite() && self.layers.iter().all(DenseLayer::is_finite)) {
            return Err(Error::Failed(format!(
                "training diverged: after batch {batch} loss or weights are not finite (loss {value}); \
                 a smaller learning_rate than {} may help",
                config.learning_rate
            )));
        }
        let (done, every) = (batch + 1, config.batches.div_ceil(MAX_REPORTED_LOSSES));
        if done % every == 0 || done == config.batches {
            let since = &self.losses[batch / every * every..];
            let mean = since.iter().map(|v| f64::from(*v)).sum::<f64>() / since.len() as f64;
            progress.metric("loss", done as u64, mean);
        }
        look(done, self.layers)
    }
}

/// Examples by task and outcome. A pair is drawn by task first, then a solving and a failing action of it, so that easy tasks do not
/// dominate and the scene alone is not predictive. Chosen in docs/calibration.md.
struct BalancedPairs {
    /// (solving, failing) row indices of each task with a solving action.
    tasks: Vec<[Vec<usize>; 2]>,
    /// All failing rows, for tasks without failing actions.
    failing: Vec<usize>,
}

impl BalancedPairs {
    fn new(data: &dyn LabelledData) -> Result<BalancedPairs> {
        let mut tasks = data.pools();
        let examples: usize = tasks.iter().flatten().map(Vec::len).sum();
        let mut failing: Vec<usize> = tasks.iter().flat_map(|[_, failing]| failing).copied().collect();
        failing.sort_unstable();
        tasks.retain(|[solving, _]| !solving.is_empty());
        for (missing, kind) in [(tasks.is_empty(), "solving"), (failing.is_empty(), "failing")] {
            if missing {
                return Err(Error::Failed(format!(
                    "no {kind} action among the {examples} examples; training needs both kinds: label more actions"
                )));
            }
        }
        Ok(BalancedPairs { tasks, failing })
    }

    /// Draws a solving and a failing row.
    fn draw(&self, rng: &mut rng::Stream) -> [usize; 2] {
        let [solving, failing] = &self.tasks[rng.random_range(0..self.tasks.len())];
        let failing = if failing.is_empty() { &self.failing } else { failing };
        [solving[rng.random_range(0..solving.len())], failing[rng.random_range(0..failing.len())]]
    }
}
