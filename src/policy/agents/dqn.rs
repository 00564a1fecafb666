//! The DQN agent, trained jointly on labelled actions of all training tasks from their outcome tables.
//!
//! Source: PHYRE's DQN (Bakhtin et al. 2019, section 5.1): balanced batches of actions of all training tasks, one network for
//! all templates. See [`crate::policy::dqn`] for the network, [`crate::policy::features`] for the inputs.
//!
//! Differences from the source: object features instead of images; pairs of a solving and a failing action of the same task (PHYRE
//! draws both from all tasks); far fewer updates.

use super::agent::{Agent, Ranker, TrainingSet};
use crate::error::Result;
use crate::policy::outcome_table::{OutcomeDataset, OutcomeTable, TaskIndex};
use crate::policy::{Dqn, TrainConfig, train};
use crate::progress::Progress;

pub(super) const AGENT: Agent = Agent {
    name: "dqn",
    about: "scores actions with a DQN trained on labelled actions of the training tasks",
    simulates: false,
    learn: |lessons, progress| Ok(Box::new(learn(lessons, progress)?)),
};

struct DqnRanker<'a> {
    tables: &'a [OutcomeTable],
    dqn: Dqn,
}

fn learn<'a>(lessons: &TrainingSet<'a>, progress: &dyn Progress) -> Result<DqnRanker<'a>> {
    let (fold, config) = (lessons.fold, lessons.config);
    let lesson = OutcomeDataset::new(lessons.tables, &fold.train, &config.labels(), fold.seed);
    let config = TrainConfig { seed: fold.seed, ..config.train.clone() };
    let (dqn, _) = train(&lesson, &config, progress)?;
    Ok(DqnRanker { tables: lessons.tables, dqn })
}

impl Ranker for DqnRanker<'_> {
    fn scores(&self, place: TaskIndex) -> Result<Vec<f32>> {
        let table = &self.tables[place.table];
        self.dqn.score_any(&table.tasks()[place.task], table.actions())
    }
}
