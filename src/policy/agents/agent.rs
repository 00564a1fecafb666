//! Interface of an agent: it is trained on a fold's training tasks and scores actions of the test tasks.

use serde::{Deserialize, Serialize};

use super::folds::Fold;
use crate::error::{Result, check_range};
use crate::policy::TrainConfig;
use crate::policy::outcome_table::{OutcomeTable, TaskIndex};
use crate::progress::Progress;
use crate::task::LabelCounts;

/// An agent: a row of [`agents`](super::agents).
pub struct Agent {
    pub name: &'static str,
    /// One-sentence description.
    pub about: &'static str,
    /// Whether the agent needs tables of simulated outcomes.
    pub simulates: bool,
    pub(super) learn: for<'a> fn(&TrainingSet<'a>, &dyn Progress) -> Result<Box<dyn Ranker + 'a>>,
}

/// Training data of an agent.
pub struct TrainingSet<'a> {
    pub tables: &'a [OutcomeTable],
    /// Outcomes predicted by the simulation: a table with the same actions for each of `tables`, or empty.
    pub posteriors: &'a [OutcomeTable],
    /// Fold with training tasks, test tasks and seed.
    pub fold: &'a Fold,
    pub config: &'a AgentsConfig,
}

/// Scores a table's actions in a task; actions with higher scores are attempted first.
pub trait Ranker {
    /// (actions,) scores.
    fn scores(&self, place: TaskIndex) -> Result<Vec<f32>>;
}

/// Configuration of the agents' training.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct AgentsConfig {
    /// Valid labelled actions per training task for the DQN.
    pub per_task: usize,
    /// Number of solving actions below which a task contributes additional actions.
    pub enough_solving: usize,
    /// Maximum number of actions per task, as a multiple of `per_task`.
    pub stretch: usize,
    /// Training configuration of the DQN; its seed is replaced by the fold's.
    pub train: TrainConfig,
}

impl AgentsConfig {
    /// Standard preset: 2000 labelled actions per task and batches of 64; takes minutes on two cores. Longer training may rank better.
    pub fn standard() -> AgentsConfig {
        let train = TrainConfig { batches: 5000, batch_size: 64, learning_rate: 1e-3, hidden: 256, seed: 0 };
        AgentsConfig { per_task: 2000, enough_solving: 15, stretch: 5, train }
    }

    /// Errors name the field that is out of range.
    pub fn validate(&self) -> Result<()> {
        check_range("per_task", self.per_task as f64, 1.0, 1e6)?;
        self.train.validate()
    }

    pub(super) fn labels(&self) -> LabelCounts {
        let AgentsConfig { per_task, enough_solving, stretch, .. } = *self;
        LabelCounts { per_task, enough_solving, stretch }
    }
}
