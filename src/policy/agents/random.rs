//! The floor: valid actions in random order.

use super::agent::{Agent, Ranks};
use crate::error::Result;
use crate::policy::table::{Place, Table};

pub(super) const AGENT: Agent = Agent {
    name: "random",
    about: "tries valid actions in random order",
    simulates: false,
    learn: |lessons, _| Ok(Box::new(Random(lessons.tables))),
};

/// Knows no action from the other: equal scores are tried in random order.
struct Random<'a>(&'a [Table]);

impl Ranks for Random<'_> {
    fn scores(&self, place: Place) -> Result<Vec<f32>> {
        Ok(vec![0.0; self.0[place.table].actions().len()])
    }
}
