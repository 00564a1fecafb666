//! Memory: actions by how often they solved training tasks.
//!
//! With n+ and n- of the training tasks solved and not solved by an action (those in which it cannot be placed count for
//! neither), its score is n+ / (n+ + n- + 1): of two that always solved, the one with more evidence comes first. Within
//! templates only tasks of the test task's own family count, across templates all do.
//!
//! Source: PHYRE's MEM (Bakhtin et al. 2019, section 5.1).
//!
//! Differences from the source: where a family was tried with other actions, what its nearest action in the unit cube did counts.

use std::collections::BTreeMap;

use rayon::prelude::*;

use super::agent::{Agent, Lessons, Ranks};
use super::folds::Setting;
use crate::error::Result;
use crate::policy::outcomes::{INVALID, SOLVED};
use crate::policy::table::{Place, Table};
use crate::progress::Progress;
use crate::task::ValidAction;

pub(super) const AGENT: Agent = Agent {
    name: "memory",
    about: "ranks actions by the share of training tasks that they solved (PHYRE's MEM)",
    simulates: false,
    learn: |lessons, progress| Ok(Box::new(Memory::new(lessons, progress)?)),
};

/// Scores by table: within templates each has its own, across them all have those of all training tasks.
struct Memory(BTreeMap<usize, Vec<f32>>);

impl Memory {
    fn new(lessons: &Lessons, progress: &dyn Progress) -> Result<Memory> {
        let (tables, fold) = (lessons.tables, lessons.fold);
        let mut tried: Vec<usize> = fold.test.iter().map(|p| p.table).collect();
        tried.dedup();
        let mut scores = BTreeMap::new();
        for (i, own) in tried.iter().enumerate() {
            progress.report("remember", i as u64, tried.len() as u64)?;
            let counts = |p: &&Place| fold.setting == Setting::Across || p.table == *own;
            let learned: Vec<Place> = fold.train.iter().filter(counts).copied().collect();
            scores.insert(*own, shares(tables, *own, &learned));
        }
        Ok(Memory(scores))
    }
}

impl Ranks for Memory {
    fn scores(&self, place: Place) -> Result<Vec<f32>> {
        Ok(self.0[&place.table].clone())
    }
}

/// Score of each of a table's actions over training tasks.
fn shares(tables: &[Table], own: usize, learned: &[Place]) -> Vec<f32> {
    let actions = tables[own].actions();
    let mut counts = vec![[0u32; 2]; actions.len()];
    for of_table in learned.chunk_by(|p, q| p.table == q.table) {
        let table = &tables[of_table[0].table];
        let same = nearest(actions, table.actions());
        for place in of_table {
            let row = table.row(place.task);
            for (count, i) in counts.iter_mut().zip(&same) {
                count[0] += u32::from(row[*i] == SOLVED);
                count[1] += u32::from(row[*i] != INVALID);
            }
        }
    }
    counts.into_iter().map(|[solved, valid]| solved as f32 / (valid + 1) as f32).collect()
}

/// For each of `actions` the nearest of `others`; of equally near ones the first.
fn nearest(actions: &[ValidAction], others: &[ValidAction]) -> Vec<usize> {
    if actions == others {
        return (0..actions.len()).collect();
    }
    let apart = |a: &ValidAction, b: &ValidAction| -> f64 {
        a.values().iter().zip(b.values()).map(|(a, b)| (a - b) * (a - b)).sum()
    };
    let closest = |action: &ValidAction| {
        let all = others.iter().enumerate().map(|(i, other)| (i, apart(action, other)));
        all.min_by(|p, q| p.1.total_cmp(&q.1)).map_or(0, |(i, _)| i)
    };
    actions.par_iter().map(closest).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::policy::toy;

    #[test]
    fn what_the_nearest_action_did_counts_and_evidence_breaks_ties() {
        // The second family was tried with the first 100 of the first one's 400 actions.
        let outcome = |t: usize, i: usize| [[1, -1, 0, -1], [1, 1, 0, 0]][t][i % 4];
        let tables = [("a", 400), ("b", 100)].map(|(name, n)| toy::table(name, &toy::tasks(2), n, outcome));
        let places = |table: usize| [0, 1].map(|task| Place { table, task });
        let scores = shares(&tables, 1, &places(0));
        let wanted = [2.0 / 3.0, 1.0 / 3.0, 0.0, 0.0];
        assert!((0..100).all(|i| scores[i] == wanted[i % 4]));
        // One task in which it solved is less than two.
        assert_eq!(shares(&tables, 0, &places(0)[..1])[0], 0.5);
        let (all, few) = (tables[0].actions(), tables[1].actions());
        let found = nearest(all, few);
        let apart = |a: &ValidAction, b: &ValidAction| -> f64 {
            a.values().iter().zip(b.values()).map(|(a, b)| (a - b).powi(2)).sum()
        };
        assert!((0..100).all(|i| found[i] == i), "itself is the nearest");
        assert!((0..400).all(|i| few.iter().all(|f| apart(&all[i], &few[found[i]]) <= apart(&all[i], f))));
        assert_eq!(shares(&tables, 0, &places(1))[300], wanted[found[300] % 4]);
    }
}
