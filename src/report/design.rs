//! The report of a design: the recommended experiments, their information and the reason for each.

use super::words::{plain_names, sentence, set_name};
use crate::design::{DesignDocument, ExperimentRow};
use crate::number::{percent, significant};
use crate::picture::HtmlReport;
use crate::picture::report::{Block, Section, ShareBar};

/// Number of alternatives on the first screen.
const MAX_ALTERNATIVES: usize = 5;

/// The report.
pub fn report(d: &DesignDocument) -> HtmlReport {
    let all: Vec<&ExperimentRow> = d.experiments.iter().chain(&d.others).collect();
    let largest = all.iter().map(|e| e.gain.information).fold(f64::MIN_POSITIVE, f64::max);
    let bar = |(i, e): (usize, &&ExperimentRow)| ShareBar {
        name: format!("{}. {}", i + 1, e.task),
        share: e.gain.information / largest,
        text: format!("{} nats", significant(e.gain.information, 2)),
        chosen: i < d.experiments.len(),
    };
    let bars = all.iter().take(d.experiments.len() + MAX_ALTERNATIVES).enumerate().map(bar).collect();
    let card = |(i, e): (usize, &ExperimentRow)| Block::Card {
        heading: format!("{}. {}, action ({})", i + 1, e.task, action(e)),
        blocks: vec![Block::Text(sentence(&plain_names(&e.reason)))],
    };
    let cards = d.experiments.iter().enumerate().map(card).collect();
    let bars = Block::card("Expected information", vec![Block::Bars(bars)]);
    HtmlReport {
        title: title(d),
        kicker: format!("Design, seed {}, iplw {}", d.config.seed, d.version),
        lead: format!(
            "{} possible experiments were simulated in worlds from the prior or posterior, in {} rollouts. One nat reduces the uncertainty of \
             one parameter to about a third.",
            d.candidates, d.rollouts
        ),
        opening: vec![Block::Columns { main: true, columns: vec![cards, vec![bars]] }],
        sections: vec![
            Section::folded("Expected precision", "standard deviations before and after", precision(d)),
            Section::folded(
                "Alternatives",
                "other experiments, most informative first",
                vec![alternatives(d)],
            ),
        ],
    }
}

fn title(d: &DesignDocument) -> String {
    let information = significant(d.together.information, 2);
    match (d.experiments.len(), d.together.right) {
        (0, _) => "No experiment adds information".into(),
        (1, Some([before, after])) => format!(
            "The best experiment answers the question with a probability of {}, {} before",
            percent(after),
            percent(before)
        ),
        (1, None) => format!("The best experiment is expected to bring {information} nats"),
        (n, _) => format!("The best {n} experiments are expected to bring {information} nats together"),
    }
}

fn action(e: &ExperimentRow) -> String {
    e.action.iter().map(|v| significant(*v, 3)).collect::<Vec<_>>().join(", ")
}

/// A parameter's standard deviations before and after each experiment.
fn precision(d: &DesignDocument) -> Vec<Block> {
    let rows = d.experiments.iter().enumerate().flat_map(|(i, e)| {
        e.expected.iter().map(move |s| {
            let ratio = significant(s.before / s.after.max(f64::MIN_POSITIVE), 2);
            vec![
                (i + 1).to_string(),
                plain_names(&s.name),
                significant(s.before, 3),
                significant(s.after, 3),
                ratio,
            ]
        })
    });
    let rows: Vec<Vec<String>> = rows.collect();
    let columns = ["experiment", "parameter", "sd before", "expected sd after", "times more precise"];
    match rows.is_empty() {
        true => Vec::new(),
        false => {
            vec![Block::table(&columns, rows, "")]
        }
    }
}

fn alternatives(d: &DesignDocument) -> Block {
    let row = |e: &ExperimentRow| {
        let gain = format!(
            "{} \u{b1} {}",
            significant(e.gain.information, 3),
            significant(e.gain.standard_error, 1)
        );
        vec![e.task.clone(), action(e), gain, plain_names(&e.reason)]
    };
    let sets: Vec<String> =
        d.sets.iter().map(|s| format!("{} ({})", set_name(&s.effects), percent(s.weight))).collect();
    Block::table(
        &["task", "action, from 0 to 1", "information, nats", "reason"],
        d.others.iter().map(row).collect(),
        &format!("Sets of effects considered: {}.", sets.join(", ")),
    )
}
