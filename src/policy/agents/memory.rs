//! Memory agent: ranks actions by how often they solve training tasks.
//!
//! An action that solves n+ training tasks and fails in n- (not counting those in which it cannot be placed) has the score
//! n+ / (n+ + n- + 1), so that of two actions that always solve, the one with more evidence comes first. Within templates only
//! training tasks of the test task's family count, across templates all do.
//!
//! Source: PHYRE's MEM (Bakhtin et al. 2019, section 5.1).
//!
//! Differences from the source: if a family's table has other actions, the outcome of its nearest action in the unit cube counts.

use std::collections::BTreeMap;

use rayon::prelude::*;

use super::agent::{Agent, Ranker, TrainingSet};
use super::folds::GeneralizationSetting;
use crate::error::Result;
use crate::policy::outcome_table::{OutcomeTable, TaskIndex};
use crate::policy::outcomes::{INVALID, SOLVED};
use crate::progress::Progress;
use crate::task::ValidAction;

pub(super) const AGENT: Agent = Agent {
    name: "memory",
    about: "ranks actions by the share of training tasks that they solved (PHYRE's MEM)",
    simulates: false,
    learn: |lessons, progress| Ok(Box::new(MemoryRanker::new(lessons, progress)?)),
};

/// Scores per table index: from its own training tasks within templates, from all training tasks across templates.
struct MemoryRanker(BTreeMap<usize, Vec<f32>>);

impl MemoryRanker {
    fn new(lessons: &TrainingSet, progress: &dyn Progress) -> Result<MemoryRanker> {
        let (tables, fold) = (lessons.tables, lessons.fold);
        let mut tried: Vec<usize> = fold.test.iter().map(|p| p.table).collect();
        tried.dedup();
        let mut scores = BTreeMap::new();
        for (i, own) in tried.iter().enumerate() {
            progress.report("remember", i as u64, tried.len() as u64)?;
            let counts = |p: &&TaskIndex| fold.setting == GeneralizationSetting::Across || p.table == *own;
            let learned: Vec<TaskIndex> = fold.train.iter().filter(counts).copied().collect();
            scores.insert(*own, solving_shares(tables, *own, &learned));
        }
        Ok(MemoryRanker(scores))
    }
}

impl Ranker for MemoryRanker {
    fn scores(&self, place: TaskIndex) -> Result<Vec<f32>> {
        Ok(self.0[&place.table].clone())
    }
}

/// Scores of a table's actions over training tasks.
fn solving_shares(tables: &[OutcomeTable], own: usize, learned: &[TaskIndex]) -> Vec<f32> {
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

/// Index of the nearest of `others` for each of `actions`; ties go to the first.
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
    fn uses_nearest_action_and_breaks_ties_by_evidence() {
        // The second family's table has the first 100 of the first family's 400 actions.
        let outcome = |t: usize, i: usize| [[1, -1, 0, -1], [1, 1, 0, 0]][t][i % 4];
        let tables = [("a", 400), ("b", 100)].map(|(name, n)| toy::table(name, &toy::tasks(2), n, outcome));
        let places = |table: usize| [0, 1].map(|task| TaskIndex { table, task });
        let scores = solving_shares(&tables, 1, &places(0));
        let wanted = [2.0 / 3.0, 1.0 / 3.0, 0.0, 0.0];
        assert!((0..100).all(|i| scores[i] == wanted[i % 4]));
        // One solved task is less evidence than two.
        assert_eq!(solving_shares(&tables, 0, &places(0)[..1])[0], 0.5);
        let (all, few) = (tables[0].actions(), tables[1].actions());
        let found = nearest(all, few);
        let apart = |a: &ValidAction, b: &ValidAction| -> f64 {
            a.values().iter().zip(b.values()).map(|(a, b)| (a - b).powi(2)).sum()
        };
        assert!((0..100).all(|i| found[i] == i), "an action is its own nearest neighbour");
        assert!((0..400).all(|i| few.iter().all(|f| apart(&all[i], &few[found[i]]) <= apart(&all[i], f))));
        assert_eq!(solving_shares(&tables, 0, &places(1))[300], wanted[found[300] % 4]);
    }
}
