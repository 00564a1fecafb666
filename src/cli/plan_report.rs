//! Report of plans for a family's test tasks: evaluation in the hidden world, and calibration.

use iplw::distribution::NORMAL_95;
use iplw::experiment::planning::PlanningScore;
use iplw::picture::plot::{self, Series};
use iplw::picture::{Block, HtmlReport, Section};
use iplw::plan::Calibration;

/// The HTML page with a row for each source of parameter samples.
pub fn page(family: &str, tasks: usize, rows: &[(&str, &PlanningScore)]) -> String {
    let columns = ["samples", "AUCCESS", "first attempt", "complete", "calibration error", "predictions"];
    let row = |(name, s): &(&str, &PlanningScore)| {
        let count: usize = s.calibration.bins.iter().map(|b| b.count).sum();
        vec![
            name.to_string(),
            format!("{:.3}", s.auccess),
            format!("{:.0} %", 100.0 * s.first),
            format!("{:.0} %", 100.0 * s.complete),
            if count == 0 { "-".into() } else { format!("{:.3}", s.calibration.error) },
            count.to_string(),
        ]
    };
    let note = "A plan is complete if its best actions are those of an exhaustive evaluation; the error is the expected calibration error.";
    let table = Block::Table {
        columns: columns.map(String::from).to_vec(),
        rows: rows.iter().map(row).collect(),
        note: note.into(),
    };
    let mut sections = vec![Section::new("Evaluation of plans", vec![table])];
    let curves: Vec<(&str, &Calibration)> =
        rows.iter().map(|(name, s)| (*name, &s.calibration)).filter(|(_, c)| !c.bins.is_empty()).collect();
    if !curves.is_empty() {
        let caption = "Actions of all predicted probabilities, each executed once in the hidden world; binned by prediction, with 95 % \
                       intervals (Wilson). Calibrated probabilities are on the diagonal.";
        let block = Block::Svg { svg: curve(&curves), caption: caption.into() };
        sections.push(Section::new("Calibration of predicted success", vec![block]));
    }
    let lead = format!(
        "The actions of {tasks} test tasks are ranked by their probability of success over parameter samples and executed in the hidden \
         world in that order."
    );
    HtmlReport { title: format!("Plans: {family}"), lead, sections, ..HtmlReport::default() }.to_html()
}

/// Calibration curves, and the diagonal.
fn curve(rows: &[(&str, &Calibration)]) -> String {
    let series = |(name, calibration): &(&str, &Calibration)| {
        let points = calibration.bins.iter().map(|b| (b.predicted, b.real)).collect();
        let band = calibration.bins.iter().map(|b| wilson(b.real, b.count)).collect();
        Series { name: name.to_string(), points, band: Some(band), ..Series::default() }
    };
    let series: Vec<Series> = rows.iter().map(series).collect();
    let diagonal =
        Series { name: "calibrated".into(), points: vec![(0.0, 0.0), (1.0, 1.0)], ..Series::default() };
    plot::scatter_with(
        "Calibration of predicted success",
        "predicted probability",
        "observed frequency",
        &series,
        &[diagonal],
    )
}

/// 95 % interval of a proportion of `count` trials (Wilson 1927).
fn wilson(share: f64, count: usize) -> (f64, f64) {
    let n = count as f64;
    let (z2, shrink) = (NORMAL_95.powi(2), 1.0 + NORMAL_95.powi(2) / n);
    let middle = (share + z2 / (2.0 * n)) / shrink;
    let half = NORMAL_95 * (share * (1.0 - share) / n + z2 / (4.0 * n * n)).sqrt() / shrink;
    (middle - half, middle + half)
}

#[cfg(test)]
mod tests {
    use super::*;
    use iplw::plan::calibration;

    #[test]
    fn matches_published_intervals() {
        // Brown, Cai and DasGupta 2001: 0 to 0.278 for 0 of 10, 0.237 to 0.763 for 5 of 10.
        let near = |(low, high): (f64, f64), wanted: (f64, f64)| {
            assert!((low - wanted.0).abs() < 1e-3 && (high - wanted.1).abs() < 1e-3, "{low} {high}");
        };
        near(wilson(0.0, 10), (0.0, 0.2775));
        near(wilson(0.5, 10), (0.2366, 0.7634));
    }

    #[test]
    fn page_has_a_curve_if_there_are_predictions() {
        let score = |predictions: &[(f64, bool)]| PlanningScore {
            auccess: 0.9,
            first: 0.8,
            complete: 1.0,
            calibration: calibration(predictions),
        };
        let (none, some) = (score(&[]), score(&[(0.1, false), (0.9, true), (0.95, true)]));
        let pictures = |rows: &[(&str, &PlanningScore)]| {
            page("bowling", 20, rows).matches("<div class=\"picture\"").count()
        };
        assert_eq!((pictures(&[("prior", &none)]), pictures(&[("prior", &none), ("truth", &some)])), (0, 1));
    }
}
