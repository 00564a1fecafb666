//! Transfer: a policy from a simulation (or from none) tried in the real world, and learning on there.
//!
//! Source: Semage et al., their transfer experiments: a DQN is trained in simulation, its jump start is the
//! AUCCESS on unseen tasks before any real training, and it then learns on in the real world, evaluated every
//! 125 batches of 32. Direct learning starts there without a simulation.
//!
//! Differences from the source: what is learned from in the real world is a growing set of random attempts on
//! the training tasks (as PHYRE's own agents learn), the same for every learner of a seed; every batch brings as
//! many new attempts as it holds examples. The step size falls by a half cosine over each stretch between two
//! evaluations and starts again.

use serde::{Deserialize, Serialize};

use super::past_point::{Measured, mixed};
use super::tryout::try_out;
use crate::error::{Result, within};
use crate::explore;
use crate::policy::{
    Dataset, Dqn, EvaluateConfig, Example, LabelConfig, Policy, Random, TrainConfig, Training, label, train,
};
use crate::progress::Progress;
use crate::reality::{HiddenConfig, HiddenWorld, Reality};
use crate::rng;
use crate::task::{Family, Labels, Split, Task, ValidAction, split};

/// Where a policy comes from.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(tag = "type", rename_all = "snake_case", deny_unknown_fields)]
pub enum School {
    /// Nowhere: actions in random order, never learning.
    Chance,
    /// No simulation: starts untrained and learns in the real world alone.
    Direct,
    /// A simulation.
    Simulated { training: Training },
    /// A simulation, and then what was measured while it was estimated, among the simulation's labels: [`TUNING`].
    Tuned { training: Training, measured: Vec<Measured> },
    /// The real world ranks the actions itself: nothing can do better.
    Itself,
}

/// How policies are made and tried.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TransferConfig {
    /// How training actions are labelled in simulation.
    pub label: LabelConfig,
    /// Training in simulation.
    pub train: TrainConfig,
    /// Trying out.
    pub evaluate: EvaluateConfig,
    /// Learning on in the real world; `None` for the jump start alone.
    pub learn: Option<LearnConfig>,
}

/// Learning on in the real world.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct LearnConfig {
    /// Evaluations after the jump start.
    pub evaluations: usize,
    /// Batches before each.
    pub batches: usize,
    /// Examples in a batch, and new real attempts for it.
    pub batch_size: usize,
    /// Adam's step size at the start of each stretch.
    pub learning_rate: f64,
}

/// How a policy did, before and while it learned in the real world.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Transfer {
    /// The jump start first.
    pub points: Vec<Point>,
    /// (100,) share of test tasks solved within k attempts, at the jump start.
    pub curve: Vec<f64>,
}

/// One evaluation.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Point {
    /// Batches learned in the real world.
    pub batches: usize,
    /// Real attempts learned from.
    pub interactions: u64,
    /// On the test tasks, [0, 1].
    pub auccess: f64,
}

impl TransferConfig {
    /// As in the paper: 1000 batches in simulation, of as many examples as the family's preset has.
    pub fn paper(family: &Family) -> TransferConfig {
        let label = LabelConfig::preset(&family.learning.study_labels, 0);
        let train = TrainConfig::preset(&family.learning);
        TransferConfig { label, train, evaluate: EvaluateConfig::phyre(0), learn: None }
    }

    /// A small run of the same shape, for a look.
    pub fn quick(family: &Family) -> TransferConfig {
        let mut config = TransferConfig::paper(family);
        config.label = LabelConfig::preset(&Labels { per_task: 200, ..family.learning.study_labels }, 0);
        config.train.batches = 500;
        config.evaluate.candidates = 2000;
        config
    }

    /// Errors name what is out of range.
    pub fn validate(&self) -> Result<()> {
        self.train.validate().map_err(|e| e.under("train"))?;
        self.learn.as_ref().map_or(Ok(()), |l| l.validate().map_err(|e| e.under("learn")))
    }
}

impl LearnConfig {
    /// As in the paper: batches of 32, evaluated every 125; eight times.
    pub fn paper() -> LearnConfig {
        LearnConfig { evaluations: 8, ..TUNING }
    }

    fn validate(&self) -> Result<()> {
        within("evaluations", self.evaluations as f64, 1.0, 1000.0)?;
        within("batches", self.batches as f64, 1.0, 100_000.0).map(drop)
    }
}

/// One stretch of the paper's learning in the real world.
pub const TUNING: LearnConfig =
    LearnConfig { evaluations: 1, batches: 125, batch_size: 32, learning_rate: 5e-4 };

/// Actions tried at a time where one that solves is enough: of most tasks a few in a hundred do.
const ASKED: usize = 64;

/// Schools a policy, tries it on the test tasks of the hidden world, and lets it learn on there.
///
/// `seed` decides the labels drawn, the weights and the batches; `tasks` are split.
pub fn transfer(
    tasks: &[Task],
    school: &School,
    hidden: &HiddenConfig,
    config: &TransferConfig,
    seed: u64,
    progress: &dyn Progress,
) -> Result<(Transfer, Option<Dqn>)> {
    config.validate()?;
    let (training, test) = (split(tasks, Split::Train), split(tasks, Split::Test));
    let mut learner = match school {
        School::Chance | School::Itself => None,
        School::Direct => Some(Dqn::untrained(&training[0], config.train.hidden, seed)?),
        School::Simulated { training: from } => Some(taught(&training, from, config, seed, progress)?),
        School::Tuned { training: from, measured } => {
            Some(tuned(&training, from, measured, config, seed, progress)?)
        }
    };
    let try_policy = |policy: &dyn Policy| try_out(policy, &test, hidden, &config.evaluate, progress);
    let first = match (&learner, school) {
        (Some(dqn), _) => try_policy(dqn)?,
        (None, School::Itself) => best_possible(&test, hidden, &config.evaluate, progress)?,
        (None, _) => try_policy(&Random { seed })?,
    };
    let mut found = Transfer {
        points: vec![Point { batches: 0, interactions: 0, auccess: first.auccess }],
        curve: first.curve.to_vec(),
    };
    let (Some(dqn), Some(learn)) = (&mut learner, &config.learn) else { return Ok((found, learner)) };
    let mut world = HiddenWorld::new(HiddenConfig { seed, ..hidden.clone() })?;
    let mut data = Dataset { tasks: training, rows: Vec::new() };
    for stretch in 0..learn.evaluations {
        let attempts = learn.batches * learn.batch_size;
        let draw = rng::derive(seed, "real attempts", stretch as u64);
        gather(&mut data, &mut world, attempts, draw, progress)?;
        let setup = TrainConfig {
            batches: learn.batches,
            batch_size: learn.batch_size,
            learning_rate: learn.learning_rate,
            hidden: config.train.hidden,
            seed: rng::derive(seed, "learning on", stretch as u64),
        };
        *dqn = dqn.learn_more(&data, &setup, progress)?.0;
        found.points.push(Point {
            batches: (stretch + 1) * learn.batches,
            interactions: world.interactions(),
            auccess: try_policy(dqn)?.auccess,
        });
    }
    Ok((found, learner))
}

/// A policy trained in simulation.
pub fn taught(
    tasks: &[Task],
    training: &Training,
    config: &TransferConfig,
    seed: u64,
    progress: &dyn Progress,
) -> Result<Dqn> {
    Ok(taught_by(tasks, training, config, seed, progress)?.0)
}

/// The same, then trained for a stretch on the same labels with measured ones among them.
fn tuned(
    tasks: &[Task],
    training: &Training,
    measured: &[Measured],
    config: &TransferConfig,
    seed: u64,
    progress: &dyn Progress,
) -> Result<Dqn> {
    let (policy, data) = taught_by(tasks, training, config, seed, progress)?;
    let LearnConfig { batches, batch_size, learning_rate, .. } = TUNING;
    let (hidden, seed) = (config.train.hidden, rng::derive(seed, "tuning", 0));
    let setup = TrainConfig { batches, batch_size, learning_rate, hidden, seed };
    Ok(policy.learn_more(&mixed(&data, measured)?, &setup, progress)?.0)
}

/// A policy trained in simulation, and the labels that it was trained on.
fn taught_by(
    tasks: &[Task],
    training: &Training,
    config: &TransferConfig,
    seed: u64,
    progress: &dyn Progress,
) -> Result<(Dqn, Dataset)> {
    let labels = LabelConfig { seed: rng::derive(seed, "label", 0), ..config.label.clone() };
    let data = label(tasks, training, &labels, progress)?;
    let policy = train(&data, &TrainConfig { seed, ..config.train.clone() }, progress)?.0;
    Ok((policy, data))
}

/// Adds `count` random real attempts on the data's tasks.
fn gather(
    data: &mut Dataset,
    world: &mut HiddenWorld,
    count: usize,
    seed: u64,
    progress: &dyn Progress,
) -> Result<()> {
    let drawn = explore::draw(&data.tasks, count, &mut rng::stream(seed, "attempts"))?;
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

/// What the real world's own ranking would reach: a task is solved at once if any of the ranked actions solves it.
fn best_possible(
    tasks: &[Task],
    hidden: &HiddenConfig,
    config: &EvaluateConfig,
    progress: &dyn Progress,
) -> Result<crate::policy::Evaluation> {
    let mut world = HiddenWorld::new(hidden.clone())?;
    let mut solved = Vec::with_capacity(tasks.len());
    for (t, task) in tasks.iter().enumerate() {
        progress.report("asking the real world itself", t as u64, tasks.len() as u64)?;
        let candidates = crate::policy::evaluate::candidates(task, config)?;
        let mut any = false;
        for part in candidates.chunks(ASKED) {
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
