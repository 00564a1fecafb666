//! Reports of trainings and evaluations of policies: curves and figures.

use serde_json::Value;

use super::words::sentence;
use crate::number::significant;
use crate::picture::HtmlReport;
use crate::picture::plot::{Series, XyPlot, panels};
use crate::picture::report::{Block, Section};

/// Size of a panel, px.
const PANEL_SIZE_PX: (u32, u32) = (560, 320);
/// Maximum number of points of a curve.
const MAX_POINTS: usize = 400;

/// The report of a training.
pub fn training(summary: Option<&str>, result: &Value) -> HtmlReport {
    let loss: Vec<f64> = numbers(&result["loss"]).collect();
    let rows = result["validation"].as_array().map_or(&[][..], Vec::as_slice);
    let validation = rows.iter().filter_map(|r| Some((r["batches"].as_f64()?, r["auccess"].as_f64()?)));
    let loss = curve("Loss", "batches", "cross-entropy, nats", by_batch(&loss));
    let validation = curve("AUCCESS on validation tasks", "batches", "AUCCESS", validation.collect());
    let plots: Vec<String> = [loss, validation].into_iter().flatten().collect();
    page(
        summary,
        "Training of a policy",
        "policy",
        result,
        &["policy", "batches", "examples", "solving"],
        &plots,
    )
}

/// The report of an evaluation.
pub fn evaluation(summary: Option<&str>, result: &Value) -> HtmlReport {
    let shares = numbers(&result["solved_within"]).enumerate().map(|(k, share)| ((k + 1) as f64, share));
    let plots: Vec<String> =
        curve("Share of tasks solved", "attempts", "share of tasks", shares.collect()).into_iter().collect();
    let mut report = page(
        summary,
        "Evaluation of a policy",
        "AUCCESS",
        result,
        &["auccess", "interactions", "world_kind"],
        &plots,
    );
    let row = |t: &Value| {
        let at = t["solved_at"].as_u64().map_or("not solved".into(), |k| k.to_string());
        Some(vec![t["task"].as_str()?.to_string(), at])
    };
    let rows: Vec<Vec<String>> = result["tasks"].as_array().into_iter().flatten().filter_map(row).collect();
    if !rows.is_empty() {
        let table = Block::table(&["task", "solved at attempt"], rows, "");
        report.sections.push(Section::folded("Tasks", "the attempt that solved each", vec![table]));
    }
    report
}

fn page(
    summary: Option<&str>,
    kicker: &str,
    title: &str,
    result: &Value,
    fields: &[&str],
    plots: &[String],
) -> HtmlReport {
    let value = |name: &&str| {
        let text = match &result[*name] {
            Value::Number(n) => significant(n.as_f64()?, 4),
            Value::String(text) => text.clone(),
            _ => return None,
        };
        Some((name.replace('_', " "), text))
    };
    let facts = Block::KeyValues(fields.iter().filter_map(value).collect());
    let card = Block::card("Result", vec![facts]);
    let picture = match plots.is_empty() {
        true => Vec::new(),
        false => vec![Block::Svg { svg: panels(kicker, plots, 2), caption: String::new() }],
    };
    HtmlReport {
        title: summary.map_or_else(|| title.into(), sentence).trim_end_matches('.').into(),
        kicker: kicker.into(),
        opening: picture.into_iter().chain([card]).collect(),
        ..HtmlReport::default()
    }
}

fn numbers(value: &Value) -> impl Iterator<Item = f64> {
    value.as_array().into_iter().flatten().filter_map(Value::as_f64)
}

/// Values over their number, thinned.
fn by_batch(values: &[f64]) -> Vec<(f64, f64)> {
    let stride = values.len().div_ceil(MAX_POINTS).max(1);
    values.iter().enumerate().step_by(stride).map(|(i, v)| ((i + 1) as f64, *v)).collect()
}

fn curve(title: &str, x_label: &str, y_label: &str, points: Vec<(f64, f64)>) -> Option<String> {
    (points.len() > 1).then(|| {
        let plot = XyPlot {
            title: title.into(),
            x_label: x_label.into(),
            y_label: y_label.into(),
            curves: vec![Series { points, ..Series::default() }],
            size: PANEL_SIZE_PX,
            ..XyPlot::default()
        };
        plot.svg()
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    #[test]
    fn evaluations_show_figures_curve_and_tasks() {
        let result = json!({"auccess": 0.875, "solved_within": [0.5, 0.75, 1.0], "interactions": 7,
            "tasks": [{"task": "bowling:003", "solved_at": 2}, {"task": "bowling:004", "solved_at": null}]});
        let html = evaluation(Some("AUCCESS 0.88"), &result).to_html();
        for text in ["<h1>AUCCESS 0.88</h1>", "0.875", "Share of tasks solved", "not solved", "bowling:003"] {
            assert!(html.contains(text), "{text}");
        }
    }

    #[test]
    fn trainings_without_validation_have_the_loss_alone() {
        let html = training(None, &json!({"policy": "policy-1", "loss": [0.7, 0.6, 0.5]})).to_html();
        assert!(html.contains("policy-1") && html.contains("cross-entropy") && !html.contains("validation"));
    }
}
