//! A plan as maps of success rates over the action space.

use super::plot::{Heatmap, heatmap};
use super::scene::Style;
use super::success_map::success_map_svg;
use crate::plan::{ActionMap, PlanDocument};
use crate::task::action::ActionQuantity;
use crate::task::{Placement, Task};

/// The maps of a plan, from dark (0) to yellow (1): over the scene with the best action, where the components are a position; otherwise
/// as heat maps.
pub fn plan_svgs(task: &Task, plan: &PlanDocument) -> Vec<String> {
    let best = plan
        .actions
        .first()
        .and_then(|row| task.actions().validate(&row.action).ok())
        .map(|a| task.place(&a));
    let scene = match &best {
        Some(Placement::Valid(scene)) => scene,
        _ => &Box::new(task.scene.clone()),
    };
    let components = &task.actions().components;
    let is_position = |map: &ActionMap| {
        let sets = map.axes.map(|axis| components.get(axis).map(|c| c.set));
        sets == [Some(ActionQuantity::X), Some(ActionQuantity::Y)]
    };
    let draw = |map: &ActionMap| match is_position(map) {
        true => success_map_svg(&cell_means(task, map), scene, None, &Style::default()),
        false => component_heatmap(task, plan, map),
    };
    plan.maps.iter().filter(|map| map.axes.iter().all(|axis| *axis < components.len())).map(draw).collect()
}

/// (position in m, mean success rate) of each cell with actions in it.
fn cell_means(task: &Task, map: &ActionMap) -> Vec<([f64; 2], f64)> {
    let counts = map.counts();
    let centre = |k: usize, cell: usize| {
        task.actions().components[map.axes[k]].value((cell as f64 + 0.5) / counts[k] as f64)
    };
    let cells =
        map.means.iter().enumerate().flat_map(|(row, cells)| {
            cells.iter().enumerate().map(move |(column, mean)| (column, row, *mean))
        });
    cells.filter_map(|(column, row, mean)| Some(([centre(0, column), centre(1, row)], mean?))).collect()
}

/// A heat map over two components, or over the only one.
fn component_heatmap(task: &Task, plan: &PlanDocument, map: &ActionMap) -> String {
    let (components, counts) = (&task.actions().components, map.counts());
    let label =
        |axis: usize| format!("{} {:?}", components[axis].target, components[axis].set).to_lowercase();
    let centres = |k: usize| -> Vec<f64> {
        (0..counts[k]).map(|i| components[map.axes[k]].value((i as f64 + 0.5) / counts[k] as f64)).collect()
    };
    let at = |values: &[f64]| map.axes.map(|axis| components[axis].value(values[axis]));
    let mark = plan.actions.first().map(|row| at(&row.action));
    let values = map.means.iter().map(|row| row.iter().map(|m| m.unwrap_or(f64::NAN)).collect());
    heatmap(
        &format!("{}: success rate", plan.task),
        &Heatmap {
            x_label: label(map.axes[0]),
            y_label: label(map.axes[1]),
            value_label: "success rate".into(),
            x: centres(0),
            y: centres(1),
            values: values.collect(),
            marks: mark.into_iter().map(|[x, y]| (x, y, "best".into())).collect(),
            ..Heatmap::default()
        },
    )
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::estimate::ParameterSamples;
    use crate::picture::scene::tests::check_svg;
    use crate::plan::{Plan, PlanConfig, RankedAction, SuccessCount, document};
    use crate::task::family;
    use crate::world::Latents;

    /// A plan in which actions left of the middle solve, spread over the whole space.
    fn plan(task: &Task, actions: usize) -> PlanDocument {
        let ranked = (0..actions).map(|i| {
            let action = task.actions().at(i * 7919 % task.actions().count()).unwrap();
            let successes = if action.values()[0] < 0.5 { 4 } else { 0 };
            RankedAction { action, ranking_count: SuccessCount { successes, rollouts: 4 }, fresh_count: None }
        });
        let ranked = ranked.collect();
        let plan =
            Plan { task: task.id.clone(), draws: 4, ranked, invalid: 0, rollouts: 8000, complete: true };
        let samples = ParameterSamples::point(Latents::of([1.0, 0.5, 0.5]), Vec::new()).unwrap();
        document(task, &plan, &PlanConfig::standard(0), &samples)
    }

    #[test]
    fn maps_show_success_rates() {
        let tasks = ["bowling", "basketball"].map(|name| family(name).unwrap().tasks().remove(0));
        for (task, maps) in tasks.iter().zip([1, 2]) {
            let plan = plan(task, 2000);
            let svgs = plan_svgs(task, &plan);
            assert_eq!(svgs.len(), maps);
            svgs.iter().for_each(|svg| check_svg(svg));
            let means = cell_means(task, &plan.maps[0]);
            let middle = task.actions().components[0].value(0.5);
            // Cells near the middle contain actions of both kinds.
            let sides: Vec<_> = means.iter().filter(|([x, _], _)| (*x - middle).abs() > 1.0).collect();
            let wrong =
                sides.iter().filter(|([x, _], mean)| *mean != f64::from(u8::from(*x < middle))).count();
            assert!(sides.len() > 50 && wrong == 0, "{wrong} of {}", sides.len());
        }
    }

    #[test]
    fn actions_without_positions_have_a_heat_map() {
        let mut task = family("bowling").unwrap().tasks().remove(0);
        task.scene.action.as_mut().unwrap().components.remove(0);
        let svgs = plan_svgs(&task, &plan(&task, 2000));
        assert_eq!(svgs.len(), 1);
        assert!(svgs[0].contains("success rate"));
        check_svg(&svgs[0]);
        assert!(plan_svgs(&task, &plan(&task, 0))[0].contains("<svg"));
    }
}
