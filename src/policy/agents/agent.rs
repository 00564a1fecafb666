//! What an agent is: it learns from a fold's training tasks, and scores actions of others.

use serde::{Deserialize, Serialize};

use super::folds::Fold;
use crate::error::{Result, within};
use crate::policy::TrainConfig;
use crate::policy::table::{Place, Table};
use crate::progress::Progress;
use crate::task::Labels;

/// An agent that can be compared: a row of [`agents`](super::agents).
pub struct Agent {
    pub name: &'static str,
    /// What it does, one sentence.
    pub about: &'static str,
    /// Whether it needs tables of what the simulation believes.
    pub simulates: bool,
    pub(super) learn: for<'a> fn(&Lessons<'a>, &dyn Progress) -> Result<Box<dyn Ranks + 'a>>,
}

/// What an agent may learn from.
pub struct Lessons<'a> {
    pub tables: &'a [Table],
    /// What the simulation believes: a table of the same actions for each of `tables`, or none at all.
    pub beliefs: &'a [Table],
    /// Training tasks, test tasks and seed.
    pub fold: &'a Fold,
    pub config: &'a AgentsConfig,
}

/// Scores a table's actions in a task, the higher the sooner they are tried.
pub trait Ranks {
    /// (actions,)
    fn scores(&self, place: Place) -> Result<Vec<f32>>;
}

/// How agents learn.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct AgentsConfig {
    /// Valid actions of each training task that the DQN learns from.
    pub per_task: usize,
    /// A task with fewer solving actions than this gives more of them...
    pub enough_solving: usize,
    /// ... until they are this many times `per_task`.
    pub stretch: usize,
    /// The DQN's training; a fold's seed takes the place of its seed.
    pub train: TrainConfig,
}

impl AgentsConfig {
    /// 2000 labelled actions a task, and batches of 64 for minutes on two cores; longer may rank better.
    pub fn standard() -> AgentsConfig {
        let train = TrainConfig { batches: 5000, batch_size: 64, learning_rate: 1e-3, hidden: 256, seed: 0 };
        AgentsConfig { per_task: 2000, enough_solving: 15, stretch: 5, train }
    }

    /// Errors unless every value is allowed.
    pub fn validate(&self) -> Result<()> {
        within("per_task", self.per_task as f64, 1.0, 1e6)?;
        self.train.validate()
    }

    pub(super) fn labels(&self) -> Labels {
        let AgentsConfig { per_task, enough_solving, stretch, .. } = *self;
        Labels { per_task, enough_solving, stretch }
    }
}
