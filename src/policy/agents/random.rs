//! Random baseline: valid actions in random order.

use super::agent::{Agent, Ranker};
use crate::error::Result;
use crate::policy::outcome_table::{OutcomeTable, TaskIndex};

pub(super) const AGENT: Agent = Agent {
    name: "random",
    about: "tries valid actions in random order",
    simulates: false,
    learn: |lessons, _| Ok(Box::new(RandomRanker(lessons.tables))),
};

/// Gives all actions the same score; ties are attempted in random order.
struct RandomRanker<'a>(&'a [OutcomeTable]);

impl Ranker for RandomRanker<'_> {
    fn scores(&self, place: TaskIndex) -> Result<Vec<f32>> {
        Ok(vec![0.0; self.0[place.table].actions().len()])
    }
}
