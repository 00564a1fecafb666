//! Success rates of a plan over the action space, in cells of two components.

use std::collections::BTreeSet;

use serde::{Deserialize, Serialize};

use super::ranked::Plan;
use crate::task::Task;
use crate::task::action::ActionQuantity;

/// Maximal number of cells along an axis, and mean number of actions in a cell: 32 cells for 10,000 actions.
const MAX_CELLS_PER_AXIS: usize = 32;
const ACTIONS_PER_CELL: f64 = 9.7;

/// Mean success rate of the actions in each cell of two components, over all others.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ActionMap {
    /// Indices of the components.
    pub axes: [usize; 2],
    /// (rows, columns): mean success rate of the actions in each cell of [0, 1] along the second and the first component; `null`
    /// without actions.
    pub means: Vec<Vec<Option<f64>>>,
}

impl ActionMap {
    /// Cells along both components.
    pub fn counts(&self) -> [usize; 2] {
        [self.means.first().map_or(0, Vec::len), self.means.len()]
    }
}

/// A map for each body that actions place; for actions without x and y components, one over their first two components.
pub fn action_maps(task: &Task, plan: &Plan) -> Vec<ActionMap> {
    let components = &task.actions().components;
    let find = |target: &str, set: ActionQuantity| {
        components.iter().position(|c| c.target == target && c.set == set)
    };
    let mut targets: Vec<&str> = Vec::new();
    for component in components {
        if !targets.contains(&component.target.as_str()) {
            targets.push(&component.target);
        }
    }
    let placed =
        targets.into_iter().filter_map(|t| Some([find(t, ActionQuantity::X)?, find(t, ActionQuantity::Y)?]));
    let maps: Vec<ActionMap> = placed.map(|axes| map(plan, axes, square_counts(task, plan, axes))).collect();
    if !maps.is_empty() {
        return maps;
    }
    let axes = [0, 1.min(components.len() - 1)];
    vec![map(plan, axes, axes.map(|axis| cells_along(plan, axis)))]
}

/// Numbers of cells that are square in the scene.
fn square_counts(task: &Task, plan: &Plan, axes: [usize; 2]) -> [usize; 2] {
    let component = |k: usize| &task.actions().components[axes[k]];
    let span = [0, 1].map(|k| component(k).high - component(k).low);
    let size = [0, 1].map(|k| span[k] / cells_along(plan, axes[k]) as f64).into_iter().fold(0.0, f64::max);
    span.map(|s| if size > 0.0 { ((s / size).round() as usize).max(1) } else { 1 })
}

fn map(plan: &Plan, axes: [usize; 2], counts: [usize; 2]) -> ActionMap {
    let mut sums = vec![vec![(0.0, 0usize); counts[0]]; counts[1]];
    for ranked in plan.ranked.iter().filter(|r| r.ranking_count.rollouts > 0) {
        let cell =
            |k: usize| ((ranked.action.values()[axes[k]] * counts[k] as f64) as usize).min(counts[k] - 1);
        let sum = &mut sums[cell(1)][cell(0)];
        *sum = (sum.0 + ranked.ranking_count.mean(), sum.1 + 1);
    }
    let mean = |(sum, n): (f64, usize)| (n > 0).then(|| sum / n as f64);
    ActionMap { axes, means: sums.into_iter().map(|row| row.into_iter().map(mean).collect()).collect() }
}

/// Cells along a component: one for each of its values, but no more than the number of actions fills.
fn cells_along(plan: &Plan, axis: usize) -> usize {
    let all: BTreeSet<u64> = plan.ranked.iter().map(|r| r.action.values()[axis].to_bits()).collect();
    let filled = (plan.ranked.len() as f64 / ACTIONS_PER_CELL).sqrt() as usize;
    all.len().clamp(1, filled.clamp(1, MAX_CELLS_PER_AXIS))
}
