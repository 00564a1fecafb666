//! Simulate-and-rank agent: actions that solve the task in simulation come first, ordered by robustness.
//!
//! The score of action a is s(a) plus the share of solving actions among the valid actions within distance h of a in the unit cube
//! (including a), where s is 1 if a solves in simulation and 0 otherwise. The radius h corresponds to 16 actions on average. Actions
//! with solving neighbours are more robust to a difference between simulation and real world.
//!
//! Source: robustness of plans to nearby worlds is a common criterion (PHYRE requires solutions that are stable under small changes:
//! Bakhtin et al. 2019, section 3). The score is specific to this project.

use std::collections::BTreeMap;

use super::agent::{Agent, Ranker};
use crate::error::Result;
use crate::policy::outcome_table::{OutcomeTable, TaskIndex};
use crate::policy::outcomes::{INVALID, SOLVED};
use crate::task::ValidAction;

pub(super) const AGENT: Agent = Agent {
    name: "simulate",
    about: "ranks actions by their own and their neighbours' outcomes in simulation",
    simulates: true,
    learn: |lessons, progress| {
        let mut near = BTreeMap::new();
        for (i, place) in lessons.fold.test.iter().enumerate() {
            progress.report("neighbours", i as u64, lessons.fold.test.len() as u64)?;
            let table = &lessons.posteriors[place.table];
            near.entry(place.table).or_insert_with(|| ActionGrid::new(table.actions()));
        }
        Ok(Box::new(SimulationRanker { posteriors: lessons.posteriors, near }))
    },
};

/// Average number of actions within the neighbourhood radius.
const NEIGHBOURHOOD_ACTIONS: f64 = 16.0;

struct SimulationRanker<'a> {
    posteriors: &'a [OutcomeTable],
    near: BTreeMap<usize, ActionGrid>,
}

impl Ranker for SimulationRanker<'_> {
    fn scores(&self, place: TaskIndex) -> Result<Vec<f32>> {
        let table = &self.posteriors[place.table];
        let row = table.row(place.task);
        let share = self.near[&place.table].neighbourhood_shares(table.actions(), row);
        let own = row.iter().map(|o| f32::from(u8::from(*o == SOLVED)));
        Ok(own.zip(share).map(|(own, share)| own + share).collect())
    }
}

/// Grid over the unit cube with the neighbourhood radius as cell size.
struct ActionGrid {
    reach: f64,
    cells: BTreeMap<Vec<i32>, Vec<usize>>,
}

impl ActionGrid {
    fn new(actions: &[ValidAction]) -> ActionGrid {
        let dimension = actions.first().map_or(1, |a| a.values().len());
        let d = dimension as f64;
        // Volume of the unit ball.
        let ball = libm::pow(std::f64::consts::PI, d / 2.0) / libm::tgamma(d / 2.0 + 1.0);
        let reach = libm::pow(NEIGHBOURHOOD_ACTIONS / (actions.len() as f64 * ball), 1.0 / d).min(1.0);
        let mut cells: BTreeMap<Vec<i32>, Vec<usize>> = BTreeMap::new();
        for (i, action) in actions.iter().enumerate() {
            cells.entry(cell(action, reach)).or_default().push(i);
        }
        ActionGrid { reach, cells }
    }

    /// (actions,) share of solving actions among the valid actions within the radius; 0 if there is none.
    fn neighbourhood_shares(&self, actions: &[ValidAction], row: &[i8]) -> Vec<f32> {
        let mut shares = vec![0.0; actions.len()];
        for (place, members) in &self.cells {
            let beside: Vec<usize> =
                self.adjacent_cells(place).into_iter().filter(|j| row[*j] != INVALID).collect();
            for i in members {
                let near = beside.iter().filter(|j| distance(&actions[*i], &actions[**j]) <= self.reach);
                let (mut valid, mut solving) = (0u32, 0u32);
                for j in near {
                    valid += 1;
                    solving += u32::from(row[*j] == SOLVED);
                }
                shares[*i] = solving as f32 / valid.max(1) as f32;
            }
        }
        shares
    }

    /// Actions in a cell and its adjacent cells.
    fn adjacent_cells(&self, place: &[i32]) -> Vec<usize> {
        let around = 3usize.checked_pow(place.len() as u32).unwrap_or(usize::MAX);
        if around > self.cells.len() {
            let close = |other: &[i32]| place.iter().zip(other).all(|(a, b)| (a - b).abs() <= 1);
            return self.cells.iter().filter(|(c, _)| close(c)).flat_map(|(_, m)| m).copied().collect();
        }
        let at = |code: usize| -> Vec<i32> {
            let mut rest = code;
            let step = |v: &i32| {
                let moved = v + (rest % 3) as i32 - 1;
                rest /= 3;
                moved
            };
            place.iter().map(step).collect()
        };
        (0..around).filter_map(|code| self.cells.get(&at(code))).flatten().copied().collect()
    }
}

fn cell(action: &ValidAction, reach: f64) -> Vec<i32> {
    action.values().iter().map(|v| (v / reach) as i32).collect()
}

fn distance(a: &ValidAction, b: &ValidAction) -> f64 {
    a.values().iter().zip(b.values()).map(|(a, b)| (a - b) * (a - b)).sum::<f64>().sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::policy::toy;

    #[test]
    fn shares_match_all_pairs() {
        // Few actions (all cells are visited) and many (adjacent cells only).
        for actions in [20, 1500] {
            let outcome = |_, i: usize| [1, -1, -1, 0, 1][i * 7 % 5];
            let table = toy::table("toy", &toy::tasks(1), actions, outcome);
            let cells = ActionGrid::new(table.actions());
            let shares = cells.neighbourhood_shares(table.actions(), table.row(0));
            for (i, a) in table.actions().iter().enumerate() {
                let near: Vec<i8> = (0..actions)
                    .filter(|j| distance(a, &table.actions()[*j]) <= cells.reach)
                    .map(|j| table.row(0)[j])
                    .filter(|o| *o != INVALID)
                    .collect();
                let solving = near.iter().filter(|o| **o == SOLVED).count();
                assert_eq!(shares[i], solving as f32 / near.len().max(1) as f32, "action {i} of {actions}");
            }
        }
    }
}
