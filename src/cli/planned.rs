//! What the plans of a family's test tasks come to, as a page: orders tried, and predicted against real success.

use iplw::distribution::NORMAL_95;
use iplw::experiment::planning::PlanningScore;
use iplw::picture::plot::{self, Series};
use iplw::picture::{Block, Report, Section};
use iplw::plan::Calibration;

/// A page on every belief's plans, by name.
pub fn page(family: &str, tasks: usize, rows: &[(&str, &PlanningScore)]) -> String {
    let columns = ["belief", "AUCCESS", "first attempt", "complete", "calibration error", "predictions"];
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
    let note = "A plan is complete if its best are those of trying everything; the error is the expected calibration error.";
    let table = Block::Table {
        columns: columns.map(String::from).to_vec(),
        rows: rows.iter().map(row).collect(),
        note: note.into(),
    };
    let mut sections = vec![Section { heading: "Orders tried".into(), blocks: vec![table] }];
    let curves: Vec<(&str, &Calibration)> =
        rows.iter().map(|(name, s)| (*name, &s.calibration)).filter(|(_, c)| !c.bins.is_empty()).collect();
    if !curves.is_empty() {
        let caption = "Actions of every likelihood, each done once in the hidden world; by tenths of what is predicted, with 95 % \
                       intervals (Wilson's). On the diagonal probabilities are true.";
        let block = Block::Svg { svg: curve(&curves), caption: caption.into() };
        sections.push(Section { heading: "Predicted against real success".into(), blocks: vec![block] });
    }
    let lead = format!(
        "Every action of {tasks} test tasks ranked by how likely it is to succeed under what is believed, then tried in the hidden world \
         in that order."
    );
    Report { title: format!("Plans: {family}"), lead, sections }.to_html()
}

/// Calibration curves, and the diagonal.
fn curve(rows: &[(&str, &Calibration)]) -> String {
    let series = |(name, calibration): &(&str, &Calibration)| {
        let points = calibration.bins.iter().map(|b| (b.predicted, b.real)).collect();
        let band = calibration.bins.iter().map(|b| wilson(b.real, b.count)).collect();
        Series { name: name.to_string(), points, band: Some(band) }
    };
    let series: Vec<Series> = rows.iter().map(series).collect();
    let diagonal = Series { name: "true".into(), points: vec![(0.0, 0.0), (1.0, 1.0)], band: None };
    plot::scatter_with(
        "Predicted against real success",
        "predicted",
        "share that succeeded",
        &series,
        &[diagonal],
    )
}

/// 95 % interval of a share of `count` (Wilson 1927).
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
    fn intervals_by_hand() {
        // Brown, Cai and DasGupta 2001: of none in ten, 0 to 0.278; of five, 0.237 to 0.763.
        let near = |(low, high): (f64, f64), wanted: (f64, f64)| {
            assert!((low - wanted.0).abs() < 1e-3 && (high - wanted.1).abs() < 1e-3, "{low} {high}");
        };
        near(wilson(0.0, 10), (0.0, 0.2775));
        near(wilson(0.5, 10), (0.2366, 0.7634));
    }

    #[test]
    fn a_page_has_a_curve_where_something_was_predicted() {
        let score = |predictions: &[(f64, bool)]| PlanningScore {
            auccess: 0.9,
            first: 0.8,
            complete: 1.0,
            calibration: calibration(predictions),
        };
        let (none, some) = (score(&[]), score(&[(0.1, false), (0.9, true), (0.95, true)]));
        let pictures =
            |rows: &[(&str, &PlanningScore)]| page("bowling", 20, rows).matches("data:image/svg").count();
        assert_eq!((pictures(&[("prior", &none)]), pictures(&[("prior", &none), ("truth", &some)])), (0, 1));
    }
}
