//! Residuals along trials for the report, thinned.

use crate::inference::report::evidence::{Evidence, EvidencePoint};
use crate::inference::report::{TrajectoryResiduals, TrialResiduals, round_to_six_digits};

/// Maximum number of rows per trial.
const MAX_ROWS: usize = 24;
/// Columns: time (s), body, segment, position, residuals before and after, and their predictive standard
/// deviations (m).
const COLUMNS: [&str; 13] = [
    "t",
    "body",
    "stretch",
    "x",
    "y",
    "before_x",
    "before_y",
    "after_x",
    "after_y",
    "sd_before_x",
    "sd_before_y",
    "sd_after_x",
    "sd_after_y",
];

/// Rows of every trial; `used`: index of each trial.
pub fn trajectory_residuals(evidence: &Evidence, used: &[usize]) -> TrajectoryResiduals {
    let launch = |(i, trial): (usize, &usize)| {
        let own: Vec<&EvidencePoint> = evidence.points.iter().filter(|p| p.trial == i).collect();
        let first = own.first().map_or(0, |p| p.segment);
        let rows = own.iter().step_by(own.len().div_ceil(MAX_ROWS).max(1)).map(|p| row(p, first)).collect();
        TrialResiduals { trial: *trial, rows }
    };
    TrajectoryResiduals {
        columns: COLUMNS.map(String::from).to_vec(),
        launches: used.iter().enumerate().map(launch).collect(),
    }
}

fn row(p: &EvidencePoint, first: usize) -> Vec<Option<f64>> {
    let [before, after] = p.predictive_sd;
    let start = [p.time, p.body as f64, (p.segment - first) as f64];
    let all = [p.position, p.before, p.after, before, after];
    let numbers = start.into_iter().chain(all.into_iter().flatten());
    numbers.map(|v| v.is_finite().then(|| round_to_six_digits(v))).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rows_are_few_and_have_their_columns() {
        let point = |i: usize| EvidencePoint {
            trial: 1,
            segment: 5 + i / 40,
            body: 0,
            setting: 0,
            time: 0.01 * i as f64,
            position: [1.0, 2.0],
            velocity: [0.0; 2],
            before: [0.3, 0.4],
            after: [1.0 / 3.0, 0.0],
            predictive_sd: [[f64::NAN; 2], [0.5, 0.6]],
        };
        let evidence = Evidence { points: (0..60).map(point).collect(), ..Evidence::default() };
        let paths = trajectory_residuals(&evidence, &[3, 9]);
        assert!(paths.launches[0].rows.is_empty() && paths.launches[1].trial == 9);
        let rows = &paths.launches[1].rows;
        assert_eq!((rows.len(), paths.columns.len()), (20, 13));
        assert!(rows.iter().all(|r| r.len() == 13));
        let at = |name: &str| paths.columns.iter().position(|c| *c == name).unwrap();
        let last = rows.last().unwrap();
        assert_eq!(
            (last[at("stretch")], last[at("after_x")], last[at("sd_before_y")]),
            (Some(1.0), Some(0.333333), None)
        );
        assert_eq!(last[at("sd_after_y")], Some(0.6));
    }
}
