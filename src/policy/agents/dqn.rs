//! The DQN, trained on labelled actions of all training tasks at once, straight from their tables.
//!
//! Source: PHYRE's DQN (Bakhtin et al. 2019, section 5.1): balanced batches of actions of all training tasks, one network for
//! all templates. See [`crate::policy::dqn`] for the network, [`crate::policy::shared`] for what it sees.
//!
//! Differences from the source: numbers about objects instead of images; a solving and a failing action of the same task
//! make a pair (PHYRE draws both kinds from all tasks); far fewer updates.

use super::agent::{Agent, Lessons, Ranks};
use crate::error::Result;
use crate::policy::TrainConfig;
use crate::policy::dqn::{Dqn, train_seeing};
use crate::policy::table::{Lesson, Place, Table};
use crate::policy::view::View;
use crate::progress::Progress;

pub(super) const AGENT: Agent = Agent {
    name: "dqn",
    about: "learns from labelled actions of the training tasks to score actions of others",
    simulates: false,
    learn: |lessons, progress| Ok(Box::new(learn(lessons, progress)?)),
};

struct Learned<'a> {
    tables: &'a [Table],
    dqn: Dqn,
}

fn learn<'a>(lessons: &Lessons<'a>, progress: &dyn Progress) -> Result<Learned<'a>> {
    let (fold, config) = (lessons.fold, lessons.config);
    let lesson = Lesson::new(lessons.tables, &fold.train, &config.labels(), fold.seed);
    let train = TrainConfig { seed: fold.seed, ..config.train.clone() };
    // With one view for all, whether tables are of one family or of many.
    let (dqn, _) = train_seeing(View::Shared, &lesson, None, &train, progress)?;
    Ok(Learned { tables: lessons.tables, dqn })
}

impl Ranks for Learned<'_> {
    fn scores(&self, place: Place) -> Result<Vec<f32>> {
        let table = &self.tables[place.table];
        self.dqn.score_any(&table.tasks()[place.task], table.actions())
    }
}
