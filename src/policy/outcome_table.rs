//! Tables of cached outcomes, for training and evaluation without a simulator.
//!
//! Source: PHYRE's agents are trained and evaluated with a cache of outcomes (Bakhtin et al. 2019, section 4.2).

use super::LabelledData;
use super::auccess::MAX_ATTEMPTS;
use super::outcomes::{INVALID, SOLVED, UNSOLVED};
use crate::error::{Error, Result};
use crate::rng;
use crate::task::{LabelCounts, Task, ValidAction};
use rand::seq::SliceRandom;

/// Outcomes of actions in tasks of a family.
#[derive(Clone, Debug)]
pub struct OutcomeTable {
    family: String,
    tasks: Vec<Task>,
    actions: Vec<ValidAction>,
    /// (tasks, actions), outcome codes of `outcomes`.
    outcomes: Vec<i8>,
}

/// Index of a task in one of several tables.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct TaskIndex {
    /// Index of the table.
    pub table: usize,
    /// Index of the task in that table.
    pub task: usize,
}

/// Labelled examples drawn from tables.
pub struct OutcomeDataset<'a> {
    tables: &'a [OutcomeTable],
    places: Vec<TaskIndex>,
    tasks: Vec<Task>,
    /// (solving, failing) row indices of each task.
    pools: Vec<[Vec<usize>; 2]>,
    /// Number of row indices reserved per task.
    stride: usize,
}

impl OutcomeTable {
    /// `outcomes` has one row per task. Errors if sizes do not match or an outcome code is invalid.
    pub fn new(
        family: &str,
        tasks: Vec<Task>,
        actions: Vec<ValidAction>,
        outcomes: Vec<i8>,
    ) -> Result<OutcomeTable> {
        if tasks.is_empty() || actions.is_empty() || outcomes.len() != tasks.len() * actions.len() {
            let allowed = format!("{} tasks times {} actions, at least one each", tasks.len(), actions.len());
            return Err(Error::input("outcomes", format!("{} outcomes", outcomes.len()), allowed));
        }
        if let Some(i) = outcomes.iter().position(|o| ![SOLVED, UNSOLVED, INVALID].contains(o)) {
            let field = format!("outcomes[{}][{}]", i / actions.len(), i % actions.len());
            return Err(Error::input(field, outcomes[i], "1 (solved), -1 (not) or 0 (cannot be placed)"));
        }
        for task in &tasks {
            if task.actions().dimension() != actions[0].values().len() {
                let value = format!("{} components", actions[0].values().len());
                return Err(Error::input(
                    "actions",
                    value,
                    format!("{}, as {} has", task.actions().dimension(), task.id),
                ));
            }
        }
        Ok(OutcomeTable { family: family.into(), tasks, actions, outcomes })
    }

    /// Name of the family.
    pub fn family(&self) -> &str {
        &self.family
    }

    /// Tasks of the table.
    pub fn tasks(&self) -> &[Task] {
        &self.tasks
    }

    /// Actions of the table, the same for all tasks.
    pub fn actions(&self) -> &[ValidAction] {
        &self.actions
    }

    /// (actions,) outcome codes of task index `task`.
    pub fn row(&self, task: usize) -> &[i8] {
        &self.outcomes[task * self.actions.len()..][..self.actions.len()]
    }

    /// First solving attempt of a task for actions in `order`, from 1; `None` if none of 100 valid attempts solves it.
    pub fn solved_at(&self, task: usize, order: &[usize]) -> Option<usize> {
        let row = self.row(task);
        let valid = order.iter().map(|i| row[*i]).filter(|o| *o != INVALID).take(MAX_ATTEMPTS);
        valid.into_iter().position(|o| o == SOLVED).map(|k| k + 1)
    }
}

impl<'a> OutcomeDataset<'a> {
    /// Random valid actions of tasks, as in [`label`](super::label): `per_task` of each, and additional ones for a task with few solving
    /// actions. The draws depend only on the seed and the task's id.
    pub fn new(
        tables: &'a [OutcomeTable],
        places: &[TaskIndex],
        labels: &LabelCounts,
        seed: u64,
    ) -> OutcomeDataset<'a> {
        let stride = tables.iter().map(|t| t.actions.len()).max().unwrap_or(0);
        let pool = |(number, place): (usize, &TaskIndex)| {
            let table = &tables[place.table];
            let own = rng::derive_seed(seed, &table.tasks[place.task].id, 0);
            let row = table.row(place.task);
            let mut order: Vec<usize> = (0..row.len()).filter(|i| row[*i] != INVALID).collect();
            order.shuffle(&mut rng::stream(own, "lesson actions"));
            let mut found = [Vec::new(), Vec::new()];
            for i in order {
                let drawn = found[0].len() + found[1].len();
                let short =
                    found[0].len() < labels.enough_solving && drawn < labels.stretch * labels.per_task;
                if drawn >= labels.per_task && !short {
                    break;
                }
                found[usize::from(row[i] != SOLVED)].push(number * stride + i);
            }
            found
        };
        let pools = places.iter().enumerate().map(pool).collect();
        let tasks = places.iter().map(|p| tables[p.table].tasks[p.task].clone()).collect();
        OutcomeDataset { tables, places: places.to_vec(), tasks, pools, stride }
    }

    /// Numbers of solving and failing actions.
    pub fn counts(&self) -> [usize; 2] {
        [0, 1].map(|k| self.pools.iter().map(|p| p[k].len()).sum())
    }
}

impl LabelledData for OutcomeDataset<'_> {
    fn tasks(&self) -> &[Task] {
        &self.tasks
    }

    fn validate(&self) -> Result<()> {
        Ok(())
    }

    fn pools(&self) -> Vec<[Vec<usize>; 2]> {
        self.pools.clone()
    }

    fn row(&self, row: usize) -> (usize, &ValidAction) {
        let task = row / self.stride;
        (task, &self.tables[self.places[task].table].actions[row % self.stride])
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::policy::toy;

    #[test]
    fn attempts_count_valid_actions_only() {
        let table = toy::table("toy", &toy::tasks(1), 4, |_, _| 0);
        let with = |outcomes: Vec<i8>| OutcomeTable { outcomes, ..table.clone() };
        assert_eq!(with(vec![0, -1, 1, 1]).solved_at(0, &[0, 1, 2, 3]), Some(2));
        assert_eq!(with(vec![0, -1, 1, 1]).solved_at(0, &[3, 1, 2, 0]), Some(1));
        assert_eq!(with(vec![0, -1, -1, 0]).solved_at(0, &[3, 1, 2, 0]), None);
        let late = toy::table("toy", &toy::tasks(1), 102, |_, i| if i >= 100 { 1 } else { -1 });
        let order: Vec<usize> = (0..102).collect();
        assert_eq!(late.solved_at(0, &order), None, "the 101st attempt does not count");
        assert_eq!(late.solved_at(0, &order[1..]), Some(100));
    }

    #[test]
    fn dataset_draws_valid_actions_and_more_where_few_solve() {
        // Every tenth action solves the first task, every hundredth the second; every third cannot be placed.
        let outcome = |task: usize, i: usize| match (i % 3, i % [10, 100][task]) {
            (0, _) => INVALID,
            (_, 0) => SOLVED,
            _ => UNSOLVED,
        };
        let tables = [toy::table("toy", &toy::tasks(2), 3000, outcome)];
        let places = [TaskIndex { table: 0, task: 0 }, TaskIndex { table: 0, task: 1 }];
        let labels = LabelCounts { per_task: 200, enough_solving: 10, stretch: 5 };
        let lesson = OutcomeDataset::new(&tables, &places, &labels, 3);
        let pools = lesson.pools();
        let size = |t: usize| pools[t][0].len() + pools[t][1].len();
        assert_eq!(size(0), 200);
        assert!(size(1) > 200 && size(1) <= 1000 && pools[1][0].len() <= 10, "{}", size(1));
        for (t, pool) in pools.iter().enumerate() {
            for (k, code) in [SOLVED, UNSOLVED].into_iter().enumerate() {
                for row in &pool[k] {
                    let (task, action) = lesson.row(*row);
                    let i = tables[0].actions().iter().position(|a| a == action).unwrap();
                    assert_eq!((task, tables[0].row(t)[i]), (t, code));
                }
            }
        }
        // The draws are independent of the order of tasks.
        let turned = OutcomeDataset::new(&tables, &[places[1], places[0]], &labels, 3).pools();
        let actions = |pool: &[Vec<usize>; 2]| pool.concat().iter().map(|r| r % 3000).collect::<Vec<_>>();
        assert_eq!(actions(&turned[0]), actions(&pools[1]));
    }

    #[test]
    fn rejects_inconsistent_tables() {
        let (tasks, table) = (toy::tasks(2), toy::table("toy", &toy::tasks(2), 3, |_, _| 1));
        let refused = |actions: &[ValidAction], outcomes: &[i8], wanted: &str| {
            let error =
                OutcomeTable::new("toy", tasks.clone(), actions.to_vec(), outcomes.to_vec()).unwrap_err();
            assert!(error.to_string().contains(wanted), "{error}");
        };
        refused(table.actions(), &[1; 5], "2 tasks times 3 actions");
        refused(&[], &[], "at least one");
        refused(table.actions(), &[1, 1, 1, 1, 2, 1], "outcomes[1][1]");
        let flat = crate::task::family("basketball").unwrap().tasks()[0].actions().at(0).unwrap();
        refused(&vec![flat; 3], &[1; 6], "3, as toy");
    }
}
