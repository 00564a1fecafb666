//! The deep Q-network (DQN): an action scorer trained on labelled actions. With one action per episode, Q is the probability of
//! success, and the network is a binary classifier of (scene, action) pairs; the name follows PHYRE.
//!
//! With scene features s and action features a,
//!   h = relu(W_s s + b_s),  e = relu(W_a a + b_a)
//!   f = relu((1 + W_g e + b_g) * h + W_b e + b_b)          (FiLM: the action modulates the scene's units)
//!   score = W_o relu(W_h f + b_h) + b_o                    (logit of the success probability)
//! trained by Adam on binary cross-entropy, with balanced batches (pairs of a solving and a failing action of the same task) and cosine
//! annealing of the learning rate to zero.
//!
//! Source: Semage et al. use PHYRE's DQN (Bakhtin et al. 2019). FiLM: Perez et al. 2018. Adam: Kingma and Ba 2015.
//!
//! Differences from the source: object and action-relative features instead of a convolutional net on images
//! (see `features`); the FiLM scale is 1 + gamma, so that an untrained layer passes the scene through.

mod early_stopping;
#[cfg(test)]
mod files;
mod fit;
mod model_card;
mod net;

use dfdx::prelude::Cpu;

pub use early_stopping::{EarlyStopping, train_with_early_stopping};
pub use fit::{TrainConfig, TrainLog};
pub use model_card::{FORMAT, ModelCard};

use super::features::FeatureExtractor;
use super::weights;
use super::{CHUNK, LabelledData, Policy, Validation, ValidationPoint};
use crate::error::{Error, Result};
use crate::neural::{Adam, DenseLayer, matrix};
use crate::progress::Progress;
use crate::task::{Learning, Task, ValidAction};
use fit::fit;
use net::{Net, initial, shapes};

/// A trained policy.
#[derive(Clone, Debug, PartialEq)]
pub struct Dqn {
    card: ModelCard,
    layers: Vec<DenseLayer>,
}

/// Trains a new policy on labelled actions of tasks of one or several families.
pub fn train(
    data: &dyn LabelledData,
    config: &TrainConfig,
    progress: &dyn Progress,
) -> Result<(Dqn, TrainLog)> {
    train_validated(data, None, config, progress)
}

/// As [`train`], with AUCCESS on held-out tasks recorded during training; the trained weights are the same.
pub fn train_validated(
    data: &dyn LabelledData,
    validation: Option<&Validation>,
    config: &TrainConfig,
    progress: &dyn Progress,
) -> Result<(Dqn, TrainLog)> {
    config.validate()?;
    data.validate()?;
    Dqn::untrained_on(data.tasks(), config)?.learn(data, validation, config, progress)
}

impl Dqn {
    /// An untrained policy for tasks like `task`.
    pub fn untrained(task: &Task, hidden: usize, seed: u64) -> Result<Dqn> {
        let tasks = std::slice::from_ref(task);
        let config = TrainConfig { hidden, seed, ..TrainConfig::preset(&Learning::STANDARD) };
        Dqn::untrained_on(tasks, &config)
    }

    /// An untrained policy for tasks of one or several families.
    fn untrained_on(tasks: &[Task], config: &TrainConfig) -> Result<Dqn> {
        config.validate()?;
        let first = tasks.first().ok_or_else(|| Error::input("tasks", "none", "at least one task"))?;
        let mut families: Vec<&str> = tasks.iter().map(family_of).collect();
        families.sort_unstable();
        families.dedup();
        let card = ModelCard {
            format: FORMAT.into(),
            program: env!("CARGO_PKG_VERSION").into(),
            family: families.join("+"),
            dimensions: FeatureExtractor::dimensions(first),
            trained: Vec::new(),
        };
        let layers = initial(card.dimensions, config.hidden, config.seed);
        Ok(Dqn { card, layers })
    }

    /// The policy after further training on `data`, for example from the real world. The number of hidden units is unchanged; Adam's
    /// moments are reset.
    pub fn learn_more(
        &self,
        data: &dyn LabelledData,
        config: &TrainConfig,
        progress: &dyn Progress,
    ) -> Result<(Dqn, TrainLog)> {
        self.learn(data, None, config, progress)
    }

    fn learn(
        &self,
        data: &dyn LabelledData,
        validation: Option<&Validation>,
        config: &TrainConfig,
        progress: &dyn Progress,
    ) -> Result<(Dqn, TrainLog)> {
        self.learn_on(data, &mut None, validation, config, progress)
    }

    /// As [`Dqn::learn_more`], with Adam's moments carried over.
    fn learn_on(
        &self,
        data: &dyn LabelledData,
        adam: &mut Option<Adam>,
        validation: Option<&Validation>,
        config: &TrainConfig,
        progress: &dyn Progress,
    ) -> Result<(Dqn, TrainLog)> {
        config.validate()?;
        data.validate()?;
        for task in data.tasks() {
            self.check_compatible(task)?;
        }
        let mut learned = self.clone();
        let mut checks = Vec::new();
        let mut look = |batches: usize, layers: &[DenseLayer]| {
            let Some(validation) = validation.filter(|v| v.due(batches, config.batches)) else {
                return Ok(());
            };
            let auccess = validation.auccess(&Dqn { card: self.card.clone(), layers: layers.to_vec() })?;
            progress.metric("validation", batches as u64, auccess);
            checks.push(ValidationPoint { batches, auccess });
            Ok(())
        };
        let loss = fit(&mut learned.layers, adam, data, config, &mut look, progress)?;
        let log = TrainLog { loss, validation: checks };
        learned.card.trained.push(TrainConfig { hidden: self.hidden(), ..config.clone() });
        Ok((learned, log))
    }

    /// Loads weights written by [`Policy::to_safetensors`].
    pub fn from_safetensors(bytes: &[u8]) -> Result<Dqn> {
        let card = ModelCard::parse(&weights::metadata(bytes)?).map_err(|e| e.in_field("metadata.iplw"))?;
        let hidden = card.trained.first().map_or(0, |t| t.hidden);
        let layers = weights::from_bytes(bytes, &shapes(card.dimensions, hidden))?;
        Ok(Dqn { card, layers })
    }

    /// Errors unless the policy can score actions of `task`.
    pub fn check_compatible(&self, task: &Task) -> Result<()> {
        // A policy of several families may be applied to others.
        let tied = !self.card.family.contains('+');
        if tied && self.card.family != family_of(task) {
            let allowed = format!("a task of {:?}, which the policy was trained on", self.card.family);
            return Err(Error::input("task", format!("{:?}", task.id), allowed));
        }
        self.has_matching_features(task)
    }

    /// Errors unless the feature dimensions of `task` match the network's.
    fn has_matching_features(&self, task: &Task) -> Result<()> {
        let [scene, action] = FeatureExtractor::dimensions(task);
        if self.card.dimensions != [scene, action] {
            let [s, a] = self.card.dimensions;
            let value = format!("{:?} with {scene} scene and {action} action features", task.id);
            return Err(Error::input("task", value, format!("a task with {s} and {a}")));
        }
        Ok(())
    }

    /// Weights with metadata, as safetensors.
    pub fn weights(&self) -> Vec<u8> {
        let card = serde_json::to_string(&self.card).expect("a card is always representable as JSON");
        weights::to_bytes(&self.layers, &card)
    }

    /// Metadata of the weights.
    pub fn card(&self) -> &ModelCard {
        &self.card
    }

    fn hidden(&self) -> usize {
        self.layers[0].shape[0]
    }
}

impl Dqn {
    /// Scores of actions in a task of any family.
    pub(super) fn score_any(&self, task: &Task, actions: &[ValidAction]) -> Result<Vec<f32>> {
        use rayon::prelude::*;
        self.has_matching_features(task)?;
        let device = Cpu::default();
        let net = Net::new(&self.layers, &device);
        let look = FeatureExtractor::new(task);
        let scene = look.scene();
        let chunk = |actions: &[ValidAction]| {
            let rows: Vec<Vec<f32>> = actions.iter().map(|a| look.action(a)).collect();
            let scene = matrix(&device, rows.iter().map(|_| &scene));
            net.forward(scene, matrix(&device, rows.iter())).as_vec()
        };
        Ok(actions.par_chunks(CHUNK).map(chunk).collect::<Vec<_>>().concat())
    }
}

impl Policy for Dqn {
    fn score(&self, task: &Task, actions: &[ValidAction]) -> Result<Vec<f32>> {
        self.check_compatible(task)?;
        self.score_any(task, actions)
    }

    fn to_safetensors(&self) -> Option<Vec<u8>> {
        Some(self.weights())
    }

    fn describe(&self) -> String {
        let batches = self.card.batches();
        let seed = self.card.trained.first().map_or(0, |t| t.seed);
        format!(
            "DQN for {}, {} hidden units, {batches} batches, seed {seed}",
            self.card.family,
            self.hidden()
        )
    }
}

/// Identifier of the tasks that a policy is trained for: the family, or the id of a custom task.
fn family_of(task: &Task) -> &str {
    if task.family == "custom" { &task.id } else { &task.family }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::policy::auccess::auccess;
    use crate::policy::{Dataset, RandomPolicy, rank, toy};
    use crate::progress::NoProgress;

    fn quick(seed: u64) -> TrainConfig {
        TrainConfig { batches: 300, batch_size: 16, learning_rate: 3e-3, hidden: 32, seed }
    }

    pub(super) fn trained() -> Dqn {
        train(&toy::dataset(&toy::tasks(8), 200), &quick(1), &NoProgress).unwrap().0
    }

    pub(super) fn actions(task: &Task, n: usize) -> Vec<ValidAction> {
        (0..n).map(|i| task.actions().at(i * 7).unwrap()).collect()
    }

    /// AUCCESS of a policy on toy tasks.
    fn score_on(policy: &dyn Policy, tasks: &[Task]) -> f64 {
        let first = |task: &Task| {
            let actions = actions(task, 500);
            let order = rank(policy, task, &actions, 128).unwrap();
            order.iter().position(|i| toy::solves(task, &actions[*i])).map(|k| k + 1)
        };
        auccess(&tasks.iter().map(first).collect::<Vec<_>>())
    }

    /// A policy without action features gives all actions the same score, so they keep the order of their indices.
    struct SceneOnly(Dqn);
    impl Policy for SceneOnly {
        fn score(&self, task: &Task, actions: &[ValidAction]) -> Result<Vec<f32>> {
            let fixed = task.actions().validate(&[0.5; 3])?;
            self.0.score(task, &vec![fixed; actions.len()])
        }
        fn describe(&self) -> String {
            "scene only".into()
        }
    }

    #[test]
    fn generalizes_to_unseen_tasks() {
        let unseen: Vec<Task> = [0.11, 0.23, 0.37, 0.44, 0.58, 0.66, 0.79, 0.91].map(toy::task).into();
        let dqn = trained();
        let (learned, random) = (score_on(&dqn, &unseen), score_on(&RandomPolicy { seed: 4 }, &unseen));
        let blind = score_on(&SceneOnly(dqn), &unseen);
        assert!(learned > 0.9, "{learned}");
        assert!(learned > random + 0.3 && learned > blind + 0.3, "{learned}, {random}, {blind}");
    }

    #[test]
    fn loss_decreases() {
        let (_, log) = train(&toy::dataset(&toy::tasks(8), 200), &quick(2), &NoProgress).unwrap();
        let mean = |l: &[f32]| l.iter().sum::<f32>() / l.len() as f32;
        assert_eq!(log.loss.len(), 300);
        assert!((mean(&log.loss[..5]) - std::f32::consts::LN_2).abs() < 0.1, "loss of an untrained network");
        assert!(mean(&log.loss[250..]) < 0.3, "{}", mean(&log.loss[250..]));
    }

    #[test]
    fn same_seed_same_bytes_for_any_number_of_threads() {
        let data = toy::dataset(&toy::tasks(3), 60);
        // Layers and batches wide enough that products would be shared among threads.
        let config = TrainConfig { batches: 12, batch_size: 64, hidden: 256, ..quick(7) };
        let run = |threads: usize| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            pool.install(|| {
                let (dqn, log) = train(&data, &config, &NoProgress).unwrap();
                let task = &data.tasks[1];
                let scores = dqn.score(task, &actions(task, 700)).unwrap();
                (dqn.to_safetensors(), log, scores.iter().map(|s| s.to_bits()).collect::<Vec<_>>())
            })
        };
        let one = run(1);
        for threads in [2, 3, 8] {
            assert!(run(threads) == one, "{threads} threads");
        }
        let other = train(&data, &TrainConfig { seed: 8, ..config }, &NoProgress).unwrap().0;
        assert_ne!(other.to_safetensors(), one.0);
    }

    #[test]
    fn scores_are_independent_of_batch() {
        let (dqn, task) = (trained(), toy::task(0.4));
        let all = actions(&task, 600);
        let together = dqn.score(&task, &all).unwrap();
        for i in [0, 1, 255, 511, 512, 599] {
            let alone = dqn.score(&task, &all[i..=i]).unwrap()[0];
            assert!((alone - together[i]).abs() <= 1e-5 * together[i].abs().max(1.0), "action {i}");
        }
        assert!(dqn.score(&task, &[]).unwrap().is_empty());
    }

    #[test]
    fn further_training_keeps_performance() {
        let dqn = trained();
        let config = TrainConfig { batches: 50, learning_rate: 1e-4, ..quick(3) };
        let more = dqn.learn_more(&toy::dataset(&toy::tasks(2), 60), &config, &NoProgress).unwrap().0;
        assert_ne!(more, dqn);
        assert_eq!(more.card().trained.len(), 2);
        let unseen = [0.13, 0.41, 0.63, 0.88].map(toy::task);
        assert!(score_on(&more, &unseen) > score_on(&dqn, &unseen) - 0.1);
        assert_eq!(Dqn::from_safetensors(&more.to_safetensors().unwrap()).unwrap(), more);
    }

    #[test]
    fn rejects_data_without_both_outcomes() {
        let check = |data: &dyn LabelledData, config: &TrainConfig, wanted: &str| {
            let error = train(data, config, &NoProgress).unwrap_err().to_string();
            assert!(error.contains(wanted), "{error}");
        };
        let full = toy::dataset(&toy::tasks(2), 60);
        let only = |solved| {
            let rows = full.rows.iter().filter(|r| r.solved == solved).cloned().collect();
            Dataset { rows, ..full.clone() }
        };
        check(&only(true), &quick(0), "no failing action");
        check(&only(false), &quick(0), "no solving action");
        check(&Dataset::default(), &quick(0), "at least one task");
        let mut dangling = full.clone();
        dangling.rows[3].task = 9;
        check(&dangling, &quick(0), "rows[3].task");
        let mut mixed = full.clone();
        mixed.tasks[1] = crate::task::family("basketball").unwrap().tasks().remove(0);
        mixed.rows.retain(|row| row.task == 0);
        check(&mixed, &quick(0), "action features");
        check(&full, &TrainConfig { batches: 0, ..quick(0) }, "batches");
        check(&full, &TrainConfig { batch_size: 1, ..quick(0) }, "batch_size");
        check(&full, &TrainConfig { batch_size: 15, ..quick(0) }, "even");
        check(&full, &TrainConfig { learning_rate: f64::NAN, ..quick(0) }, "learning_rate");
        check(&full, &TrainConfig { hidden: 1 << 20, ..quick(0) }, "hidden");
        let mut poisoned = trained();
        poisoned.layers[0].weight[0] = f32::MAX;
        poisoned.layers[0].bias.fill(f32::MAX);
        let error = poisoned.learn_more(&full, &quick(0), &NoProgress).unwrap_err();
        assert!(matches!(&error, Error::Failed(m) if m.contains("diverged")), "{error}");
    }

    #[test]
    fn cancellation_ends_training() {
        struct Stop;
        impl Progress for Stop {
            fn report(&self, _: &str, done: u64, _: u64) -> Result<()> {
                if done >= 40 { Err(Error::Cancelled) } else { Ok(()) }
            }
        }
        let result = train(&toy::dataset(&toy::tasks(2), 60), &quick(0), &Stop);
        assert_eq!(result.unwrap_err(), Error::Cancelled);
    }

    #[test]
    fn rejects_incompatible_tasks() {
        let dqn = trained();
        let mut other = toy::task(0.3);
        other.family = "bowling".into();
        let error = dqn.score(&other, &[]).unwrap_err().to_string();
        assert!(error.contains("bowling") || error.contains("toy"), "{error}");
        let mut fewer_components = toy::task(0.3);
        fewer_components.scene.action.as_mut().unwrap().components.pop();
        let error = dqn.score(&fewer_components, &[]).unwrap_err().to_string();
        assert!(error.contains("action features"), "{error}");
    }
}
