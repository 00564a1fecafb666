//! Memory: actions by how often they solved training tasks.
//!
//! With n+ and n- of the training tasks solved and not solved by an action (those in which it cannot be placed count for
//! neither), its score is n+ / (n+ + n- + 1): of two that always solved, the one with more evidence comes first. Within
//! templates only tasks of the test task's own family count, across templates all do.
//!
//! Source: PHYRE's MEM (Bakhtin et al. 2019, section 5.1). Differences from the source: none that is known to us.

use std::collections::BTreeMap;

use super::agent::{Agent, Lessons, Ranks};
use super::folds::Setting;
use crate::error::{Error, Result};
use crate::policy::outcomes::{INVALID, SOLVED};
use crate::policy::table::{Place, Table};

pub(super) const AGENT: Agent = Agent {
    name: "memory",
    about: "ranks actions by the share of training tasks that they solved (PHYRE's MEM)",
    simulates: false,
    learn: |lessons, _| Ok(Box::new(Memory::new(lessons)?)),
};

/// (actions,) scores, by table within templates, the same for all across them.
enum Memory {
    Within(BTreeMap<usize, Vec<f32>>),
    Across(Vec<f32>),
}

impl Memory {
    fn new(lessons: &Lessons) -> Result<Memory> {
        let (tables, train) = (lessons.tables, &lessons.fold.train);
        if lessons.fold.setting == Setting::Within {
            let own = |t: usize| train.iter().filter(|p| p.table == t).copied().collect::<Vec<_>>();
            return Ok(Memory::Within((0..tables.len()).map(|t| (t, shares(tables, &own(t)))).collect()));
        }
        if let Some(other) = tables.iter().find(|t| t.actions() != tables[0].actions()) {
            let allowed = format!(
                "those of {:?}: memory carries over from family to family only what the same actions did",
                tables[0].family()
            );
            return Err(Error::input(
                "actions",
                format!("others in the table of {:?}", other.family()),
                allowed,
            ));
        }
        Ok(Memory::Across(shares(tables, train)))
    }
}

impl Ranks for Memory {
    fn scores(&self, place: Place) -> Result<Vec<f32>> {
        Ok(match self {
            Memory::Within(by_table) => by_table[&place.table].clone(),
            Memory::Across(all) => all.clone(),
        })
    }
}

/// Score of each action over training tasks whose tables have the same actions.
fn shares(tables: &[Table], places: &[Place]) -> Vec<f32> {
    let actions = places.first().map_or(0, |p| tables[p.table].actions().len());
    let mut counts = vec![[0u32; 2]; actions];
    for place in places {
        for (count, outcome) in counts.iter_mut().zip(tables[place.table].row(place.task)) {
            count[0] += u32::from(*outcome == SOLVED);
            count[1] += u32::from(*outcome != INVALID);
        }
    }
    counts.into_iter().map(|[solved, valid]| solved as f32 / (valid + 1) as f32).collect()
}
