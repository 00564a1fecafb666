//! Transfer: evaluation of a policy from simulation (or an untrained one) in the real world, and further learning there.
//!
//! Source: Semage et al., transfer experiments: a DQN is trained in simulation, its jump start is the AUCCESS on unseen tasks
//! before any real training, and it is then trained further in the real world, with an evaluation every 125 batches of 32. Direct
//! learning starts in the real world without a simulation.
//!
//! Differences from the source: the real training data are a growing set of random attempts on the training tasks (as for PHYRE's
//! agents), the same for every learner of a seed; each batch adds as many attempts as it has examples. The learning rate is annealed
//! by a half cosine between two evaluations and then restarts.

use serde::{Deserialize, Serialize};

use super::hidden_evaluation::evaluate_in_hidden_world;
use super::posterior_training::{MeasuredOutcome, mix_examples};
use crate::error::{Result, check_range};
use crate::explore;
use crate::policy::{
    Dataset, Dqn, EvaluateConfig, Example, LabelConfig, Policy, RandomPolicy, TrainConfig, TrainingPhysics,
    label, train,
};
use crate::progress::Progress;
use crate::reality::{HiddenConfig, HiddenWorld, Reality};
use crate::rng;
use crate::task::{Family, LabelCounts, Split, Task, ValidAction, split};

/// Source of a policy.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(tag = "type", rename_all = "snake_case", deny_unknown_fields)]
pub enum PolicySource {
    /// Random order of actions, without learning.
    Chance,
    /// Direct learning: starts untrained and learns in the real world only.
    Direct,
    /// Trained in simulation.
    Simulated { training: TrainingPhysics },
    /// Trained in simulation, then fine-tuned with [`TUNING`] on simulated labels mixed with the outcomes measured for the estimate.
    Tuned { training: TrainingPhysics, measured: Vec<MeasuredOutcome> },
    /// Upper bound: actions are ranked by the real world itself.
    Itself,
}

/// Configuration of training and evaluation.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TransferConfig {
    /// Labelling in simulation.
    pub label: LabelConfig,
    /// Training in simulation.
    pub train: TrainConfig,
    /// Evaluation.
    pub evaluate: EvaluateConfig,
    /// Further learning in the real world; `None` for the jump start only.
    pub learn: Option<LearnConfig>,
}

/// Configuration of further learning in the real world.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct LearnConfig {
    /// Evaluations after the jump start.
    pub evaluations: usize,
    /// Batches before each evaluation.
    pub batches: usize,
    /// Examples per batch, and new real attempts per batch.
    pub batch_size: usize,
    /// Initial learning rate of Adam after each evaluation.
    pub learning_rate: f64,
}

/// Performance of a policy before and during learning in the real world.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Transfer {
    /// Evaluations, with the jump start first.
    pub points: Vec<CurvePoint>,
    /// (100,) share of test tasks solved within k attempts, at the jump start.
    pub curve: Vec<f64>,
}

/// One evaluation.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct CurvePoint {
    /// Batches trained in the real world.
    pub batches: usize,
    /// Real attempts used for training.
    pub interactions: u64,
    /// AUCCESS on the test tasks, [0, 1].
    pub auccess: f64,
}

impl TransferConfig {
    /// The paper's preset: 1000 batches in simulation, with the batch size of the family's preset.
    pub fn paper(family: &Family) -> TransferConfig {
        let label = LabelConfig::preset(&family.learning.study_labels, 0);
        let train = TrainConfig::preset(&family.learning);
        TransferConfig { label, train, evaluate: EvaluateConfig::phyre(0), learn: None }
    }

    /// A reduced configuration for a quick run.
    pub fn quick(family: &Family) -> TransferConfig {
        let mut config = TransferConfig::paper(family);
        config.label = LabelConfig::preset(&LabelCounts { per_task: 200, ..family.learning.study_labels }, 0);
        config.train.batches = 500;
        config.evaluate.candidates = 2000;
        config
    }

    /// Errors name the field that is out of range.
    pub fn validate(&self) -> Result<()> {
        self.train.validate().map_err(|e| e.in_field("train"))?;
        self.learn.as_ref().map_or(Ok(()), |l| l.validate().map_err(|e| e.in_field("learn")))
    }
}

impl LearnConfig {
    /// The paper's preset: batches of 32, evaluated every 125 batches, eight times.
    pub fn paper() -> LearnConfig {
        LearnConfig { evaluations: 8, ..TUNING }
    }

    fn validate(&self) -> Result<()> {
        check_range("evaluations", self.evaluations as f64, 1.0, 1000.0)?;
        check_range("batches", self.batches as f64, 1.0, 100_000.0).map(drop)
    }
}

/// Fine-tuning: the paper's learning in the real world between two evaluations.
pub const TUNING: LearnConfig =
    LearnConfig { evaluations: 1, batches: 125, batch_size: 32, learning_rate: 5e-4 };

/// Batch size for finding one solving action: in most tasks a few percent of the actions solve.
const ATTEMPT_BATCH: usize = 64;

/// Creates a policy, evaluates it on the test tasks of the hidden world, and trains it further there.
///
/// `seed` determines labels, weights and batches; `tasks` contain all splits.
pub fn transfer(
    tasks: &[Task],
    school: &PolicySource,
    hidden: &HiddenConfig,
    config: &TransferConfig,
    seed: u64,
    progress: &dyn Progress,
) -> Result<(Transfer, Option<Dqn>)> {
    config.validate()?;
    let (training, test) = (split(tasks, Split::Train), split(tasks, Split::Test));
    let mut learner = match school {
        PolicySource::Chance | PolicySource::Itself => None,
        PolicySource::Direct => Some(Dqn::untrained(&training[0], config.train.hidden, seed)?),
        PolicySource::Simulated { training: from } => {
            Some(train_with_labels(&training, from, config, seed, progress)?.0)
        }
        PolicySource::Tuned { training: from, measured } => {
            Some(fine_tune(&training, from, measured, config, seed, progress)?)
        }
    };
    let try_policy =
        |policy: &dyn Policy| evaluate_in_hidden_world(policy, &test, hidden, &config.evaluate, progress);
    let first = match (&learner, school) {
        (Some(dqn), _) => try_policy(dqn)?,
        (None, PolicySource::Itself) => best_possible(&test, hidden, &config.evaluate, progress)?,
        (None, _) => try_policy(&RandomPolicy { seed })?,
    };
    let mut found = Transfer {
        points: vec![CurvePoint { batches: 0, interactions: 0, auccess: first.auccess }],
        curve: first.curve.to_vec(),
    };
    let (Some(dqn), Some(learn)) = (&mut learner, &config.learn) else { return Ok((found, learner)) };
    let mut world = HiddenWorld::new(HiddenConfig { seed, ..hidden.clone() })?;
    let mut data = Dataset { tasks: training, rows: Vec::new() };
    for stretch in 0..learn.evaluations {
        let attempts = learn.batches * learn.batch_size;
        let draw = rng::derive_seed(seed, "real attempts", stretch as u64);
        add_real_attempts(&mut data, &mut world, attempts, draw, progress)?;
        let setup = TrainConfig {
            batches: learn.batches,
            batch_size: learn.batch_size,
            learning_rate: learn.learning_rate,
            hidden: config.train.hidden,
            seed: rng::derive_seed(seed, "learning on", stretch as u64),
        };
        *dqn = dqn.learn_more(&data, &setup, progress)?.0;
        found.points.push(CurvePoint {
            batches: (stretch + 1) * learn.batches,
            interactions: world.interactions(),
            auccess: try_policy(dqn)?.auccess,
        });
    }
    Ok((found, learner))
}

/// A policy trained in simulation, then fine-tuned on the same labels mixed with measured ones.
fn fine_tune(
    tasks: &[Task],
    training: &TrainingPhysics,
    measured: &[MeasuredOutcome],
    config: &TransferConfig,
    seed: u64,
    progress: &dyn Progress,
) -> Result<Dqn> {
    let (policy, data) = train_with_labels(tasks, training, config, seed, progress)?;
    let LearnConfig { batches, batch_size, learning_rate, .. } = TUNING;
    let (hidden, seed) = (config.train.hidden, rng::derive_seed(seed, "tuning", 0));
    let setup = TrainConfig { batches, batch_size, learning_rate, hidden, seed };
    Ok(policy.learn_more(&mix_examples(&data, measured)?, &setup, progress)?.0)
}

/// A policy trained in simulation, and its labels.
fn train_with_labels(
    tasks: &[Task],
    training: &TrainingPhysics,
    config: &TransferConfig,
    seed: u64,
    progress: &dyn Progress,
) -> Result<(Dqn, Dataset)> {
    let labels = LabelConfig { seed: rng::derive_seed(seed, "label", 0), ..config.label.clone() };
    let data = label(tasks, training, &labels, progress)?;
    let policy = train(&data, &TrainConfig { seed, ..config.train.clone() }, progress)?.0;
    Ok((policy, data))
}

/// Adds `count` random real attempts on the data's tasks.
fn add_real_attempts(
    data: &mut Dataset,
    world: &mut HiddenWorld,
    count: usize,
    seed: u64,
    progress: &dyn Progress,
) -> Result<()> {
    let drawn = explore::draw_placeable(&data.tasks, count, &mut rng::stream(seed, "attempts"), progress)?;
    for (t, task) in data.tasks.iter().enumerate() {
        progress.report("acting in the real world", t as u64, data.tasks.len() as u64)?;
        let actions: Vec<ValidAction> = drawn.iter().filter(|d| d.0 == t).map(|d| d.1.clone()).collect();
        let attempts = world.measure(task, &actions)?;
        data.rows.extend(actions.into_iter().zip(attempts).filter_map(|(action, attempt)| {
            attempt.trajectory.map(|seen| Example { task: t, action, solved: seen.solved() })
        }));
    }
    Ok(())
}

/// Upper bound: the real world's own ranking solves a task at the first attempt if any ranked action solves it.
fn best_possible(
    tasks: &[Task],
    hidden: &HiddenConfig,
    config: &EvaluateConfig,
    progress: &dyn Progress,
) -> Result<crate::policy::Evaluation> {
    let mut world = HiddenWorld::new(hidden.clone())?;
    let mut solved = Vec::with_capacity(tasks.len());
    for (t, task) in tasks.iter().enumerate() {
        progress.report("evaluating the upper bound in the real world", t as u64, tasks.len() as u64)?;
        let candidates = crate::policy::evaluate::candidates(task, config)?;
        let mut any = false;
        for part in candidates.chunks(ATTEMPT_BATCH) {
            let attempts = world.measure(task, part)?;
            any = attempts.iter().any(|a| a.trajectory.as_ref().is_some_and(|seen| seen.solved()));
            if any {
                break;
            }
        }
        solved.push(any.then_some(1));
    }
    Ok(crate::policy::Evaluation::of(solved))
}
