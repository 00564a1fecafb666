//! A plan as maps of success rates over the action space.

use std::collections::BTreeSet;

use super::plot::{Heatmap, heatmap};
use super::scene::Style;
use super::success_map::success_map_svg;
use crate::plan::Plan;
use crate::task::action::ActionQuantity;
use crate::task::{Placement, Task};

/// Maximal number of cells along an axis: about ten of 10,000 actions in a cell.
const MAX_CELLS_PER_AXIS: usize = 32;

/// A map for each body that actions place: the mean success rate in each cell, from dark (0) to yellow (1), over the scene with the
/// best action. For actions without x and y components, a heat map over their first two components.
pub fn plan_svgs(task: &Task, plan: &Plan) -> Vec<String> {
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
    let best = plan.ranked.first().map(|r| task.place(&r.action));
    let scene = match &best {
        Some(Placement::Valid(scene)) => scene,
        _ => &Box::new(task.scene.clone()),
    };
    let map =
        |axes: [usize; 2]| success_map_svg(&cell_means(task, plan, axes), scene, None, &Style::default());
    let maps: Vec<String> = placed.map(map).collect();
    if maps.is_empty() { vec![component_heatmap(task, plan)] } else { maps }
}

/// (position in m, mean success rate) of each cell with actions in it; cells are square.
fn cell_means(task: &Task, plan: &Plan, axes: [usize; 2]) -> Vec<([f64; 2], f64)> {
    let component = |k: usize| &task.actions().components[axes[k]];
    let span = [0, 1].map(|k| component(k).high - component(k).low);
    let size = [0, 1].map(|k| span[k] / cells_along(plan, axes[k]) as f64).into_iter().fold(0.0, f64::max);
    let counts = span.map(|s| if size > 0.0 { ((s / size).round() as usize).max(1) } else { 1 });
    let centre = |k: usize, cell: usize| component(k).value((cell as f64 + 0.5) / counts[k] as f64);
    mean_grid(plan, axes, counts)
        .into_iter()
        .enumerate()
        .flat_map(|(row, cells)| cells.into_iter().enumerate().map(move |(column, mean)| (column, row, mean)))
        .filter(|(_, _, mean)| !mean.is_nan())
        .map(|(column, row, mean)| ([centre(0, column), centre(1, row)], mean))
        .collect()
}

/// A heat map over the first two components, or over the only one.
fn component_heatmap(task: &Task, plan: &Plan) -> String {
    let components = &task.actions().components;
    let axes = [0, 1.min(components.len() - 1)];
    let counts = axes.map(|axis| cells_along(plan, axis));
    let label =
        |axis: usize| format!("{} {:?}", components[axis].target, components[axis].set).to_lowercase();
    let centres = |k: usize| -> Vec<f64> {
        (0..counts[k]).map(|i| components[axes[k]].value((i as f64 + 0.5) / counts[k] as f64)).collect()
    };
    let at = |values: &[f64]| axes.map(|axis| components[axis].value(values[axis]));
    let mark = plan.ranked.first().map(|r| at(r.action.values()));
    let title = format!("{}: how likely actions solve it", plan.task);
    heatmap(
        &title,
        &Heatmap {
            x_label: label(axes[0]),
            y_label: label(axes[1]),
            value_label: "share that solved, 1".into(),
            x: centres(0),
            y: centres(1),
            values: mean_grid(plan, axes, counts),
            marks: mark.into_iter().map(|[x, y]| (x, y, "best".into())).collect(),
            ..Heatmap::default()
        },
    )
}

/// (rows, columns) mean success rate of the actions in each cell; NaN for empty cells.
fn mean_grid(plan: &Plan, axes: [usize; 2], counts: [usize; 2]) -> Vec<Vec<f64>> {
    let mut sums = vec![vec![(0.0, 0usize); counts[0]]; counts[1]];
    for ranked in plan.ranked.iter().filter(|r| r.ranking_count.rollouts > 0) {
        let cell =
            |k: usize| ((ranked.action.values()[axes[k]] * counts[k] as f64) as usize).min(counts[k] - 1);
        let sum = &mut sums[cell(1)][cell(0)];
        *sum = (sum.0 + ranked.ranking_count.mean(), sum.1 + 1);
    }
    sums.into_iter().map(|row| row.into_iter().map(|(sum, n)| sum / n as f64).collect()).collect()
}

/// Cells along a component: one for each of its values, up to [`MAX_CELLS_PER_AXIS`].
fn cells_along(plan: &Plan, axis: usize) -> usize {
    let all: BTreeSet<u64> = plan.ranked.iter().map(|r| r.action.values()[axis].to_bits()).collect();
    all.len().clamp(1, MAX_CELLS_PER_AXIS)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::picture::scene::tests::check_svg;
    use crate::plan::{RankedAction, SuccessCount};
    use crate::task::family;

    /// A plan in which actions left of the middle solve, spread over the whole space.
    fn plan(task: &Task) -> Plan {
        let ranked = (0..2000).map(|i| {
            let action = task.actions().at(i * 7919 % task.actions().count()).unwrap();
            let successes = if action.values()[0] < 0.5 { 4 } else { 0 };
            RankedAction { action, ranking_count: SuccessCount { successes, rollouts: 4 }, fresh_count: None }
        });
        let ranked = ranked.collect();
        Plan { task: task.id.clone(), draws: 4, ranked, invalid: 0, rollouts: 8000, complete: true }
    }

    #[test]
    fn maps_show_success_rates() {
        let tasks = ["bowling", "basketball"].map(|name| family(name).unwrap().tasks().remove(0));
        for (task, maps) in tasks.iter().zip([1, 2]) {
            let plan = plan(task);
            let drawn = plan_svgs(task, &plan);
            assert_eq!(drawn.len(), maps);
            drawn.iter().for_each(|svg| check_svg(svg));
            let means = cell_means(task, &plan, [0, 1]);
            let middle = task.actions().components[0].value(0.5);
            // Cells near the middle contain actions of both kinds.
            let sides = means.iter().filter(|([x, _], _)| (*x - middle).abs() > 1.0);
            let (mut told, mut wrong) = (0, 0);
            for ([x, _], mean) in sides {
                told += 1;
                wrong += usize::from(*mean != f64::from(u8::from(*x < middle)));
            }
            assert!(told > 50 && wrong == 0, "{wrong} of {told}");
        }
    }

    #[test]
    fn actions_without_positions_have_a_heat_map() {
        let mut task = family("bowling").unwrap().tasks().remove(0);
        task.scene.action.as_mut().unwrap().components.remove(0);
        let drawn = plan_svgs(&task, &plan(&task));
        assert_eq!(drawn.len(), 1);
        assert!(drawn[0].contains("share that solved"));
        check_svg(&drawn[0]);
        let none = Plan { ranked: Vec::new(), ..plan(&task) };
        assert!(plan_svgs(&task, &none)[0].contains("<svg"));
    }
}
