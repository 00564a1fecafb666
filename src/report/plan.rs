//! The report of a plan: the best actions with their probabilities over the map of the action space.

use crate::number::{percent, significant};
use crate::picture::report::{Block, Section, ShareBar};
use crate::picture::{HtmlReport, plan_svgs};
use crate::plan::{ActionRow, PlanDocument};
use crate::task::Task;

/// Number of actions on the first screen.
const TOP_ACTIONS: usize = 10;
/// Number of actions in the first table.
const MAX_LISTED_ACTIONS: usize = 20;

/// The report; without the task, without maps and with components in [0, 1].
pub fn report(d: &PlanDocument, task: Option<&Task>) -> HtmlReport {
    let maps = task.map_or(Vec::new(), |task| plan_svgs(task, d));
    let caption = "Success rate of the actions by where they place the body, from dark (0) to yellow (1), and the best action.";
    let pictures = maps.into_iter().map(|svg| Block::Svg { svg, caption: caption.into() });
    let bar = |(i, row): (usize, &ActionRow)| {
        let p = row.best_probability();
        ShareBar { name: format!("{}", i + 1), share: p, text: probability(row), chosen: i == 0 }
    };
    let bars = d.actions.iter().take(TOP_ACTIONS).enumerate().map(bar).collect();
    let facts = vec![
        Block::card("The ten best actions", vec![Block::Bars(bars)]),
        Block::card("What to do next", vec![Block::List(next_steps(d))]),
    ];
    let pictures: Vec<Block> = pictures.collect();
    let opening = Block::pictures_and_facts(pictures, facts);
    HtmlReport {
        title: title(d),
        kicker: format!("Plan for {}, seed {}, iplw {}", d.task, d.config.seed, d.version),
        lead: format!(
            "{} actions were considered ({} cannot be placed), in {} simulations over {} samples of the parameters.",
            d.candidates, d.invalid, d.rollouts, d.posterior.draws
        ),
        opening: vec![opening],
        sections: vec![Section::folded("Actions", "best first, with their components", actions(d, task))],
    }
}

fn title(d: &PlanDocument) -> String {
    match d.actions.first() {
        None => format!("No action of {} can be placed", d.task),
        Some(row) => {
            let p = row.best_probability();
            format!("The best action solves {} with a probability of {}", d.task, percent(p))
        }
    }
}

fn next_steps(d: &PlanDocument) -> Vec<String> {
    let mut steps =
        vec!["Attempt the actions in this order; stop at the first that solves the task.".to_string()];
    if !d.complete {
        steps.push("A limit ended the search: actions that were not fully evaluated may be better. Raise `rollouts` or `seconds`.".into());
    }
    let best = d.actions.first().map_or(0.0, ActionRow::best_probability);
    if best < 0.9 && d.posterior.draws > 1 {
        steps.push(
            "The parameters are uncertain: a design recommends the measurement that helps most.".into(),
        );
    }
    steps
}

fn probability(row: &ActionRow) -> String {
    match (row.probability, row.standard_error) {
        (Some(p), Some(e)) => format!("{} \u{b1} {}", percent(p), significant(100.0 * e, 1)),
        _ => percent(row.share),
    }
}

/// The table of actions; after the first, folded once more.
fn actions(d: &PlanDocument, task: Option<&Task>) -> Vec<Block> {
    let components = task.map(|t| &t.actions().components);
    let names: Vec<String> = match components {
        Some(all) => {
            all.iter().map(|c| format!("{} {}", c.target, format!("{:?}", c.set).to_lowercase())).collect()
        }
        None => (0..d.actions.first().map_or(0, |a| a.action.len()))
            .map(|i| format!("component {}", i + 1))
            .collect(),
    };
    let value = |(i, v): (usize, &f64)| {
        significant(components.and_then(|all| all.get(i)).map_or(*v, |c| c.value(*v)), 4)
    };
    let row = |(i, row): (usize, &ActionRow)| {
        let start = [(i + 1).to_string(), probability(row), format!("{} of {}", row.successes, row.draws)];
        start.into_iter().chain(row.action.iter().enumerate().map(value)).collect()
    };
    let columns: Vec<String> =
        ["rank", "probability", "solved in ranking"].map(String::from).into_iter().chain(names).collect();
    let mut rows: Vec<Vec<String>> = d.actions.iter().enumerate().map(row).collect();
    let rest = rows.split_off(rows.len().min(MAX_LISTED_ACTIONS));
    let note =
        "Probabilities are of fresh simulations, which ranking did not use; positions in m, angles in rad.";
    let mut blocks = vec![Block::Table { columns: columns.clone(), rows, note: note.into() }];
    if !rest.is_empty() {
        let table = Block::Table { columns, rows: rest, note: String::new() };
        blocks.push(Block::Details { summary: "All other actions of the plan".into(), blocks: vec![table] });
    }
    blocks
}
