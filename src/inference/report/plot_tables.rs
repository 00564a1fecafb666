//! Evidence as tables with a bounded number of rows, for plots.

use serde::{Deserialize, Serialize};

use crate::inference::report::evidence::{Evidence, EvidencePoint, ImpactRecord};
use crate::inference::report::round_to_six_digits;

/// Maximum number of rows of a table.
const MAX_ROWS: usize = 1500;
/// Largest lag of the autocorrelations.
const MAX_LAG: usize = 12;

/// Plot data of a diagnosis.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct PlotTables {
    /// Names of settings, indexed by the columns `setting`.
    pub settings: Vec<String>,
    /// Observations with residuals before and after (s, m), and velocities by the extended model (m/s).
    pub points: PlotTable,
    /// Parts of flights: position (m), speed (m/s), acceleration that the base model lacks and that the
    /// extended model adds (m/s^2).
    pub pushes: PlotTable,
    /// Bounces as observed, by the base model and by the extended one: normal approach speed, slip speed,
    /// impulse over mass along normal and tangent, m/s.
    pub bounces: PlotTable,
    /// Autocorrelation of residuals within segments by lag, from 0: before and after.
    pub autocorrelation: [Vec<f64>; 2],
}

/// Rows of numbers.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct PlotTable {
    pub columns: Vec<String>,
    pub rows: Vec<Vec<Option<f64>>>,
}

impl PlotTable {
    /// A column; NaN for missing values.
    pub fn column(&self, name: &str) -> Vec<f64> {
        column(&self.columns, &self.rows, name)
    }

    /// Lengths of the vectors in two columns, where both are finite.
    pub fn lengths(&self, [x, y]: [&str; 2]) -> Vec<f64> {
        let all = self.column(x).into_iter().zip(self.column(y)).map(|(x, y)| x.hypot(y));
        all.filter(|v| v.is_finite()).collect()
    }
}

/// A column of rows of numbers; NaN for missing values.
pub fn column(columns: &[String], rows: &[Vec<Option<f64>>], name: &str) -> Vec<f64> {
    let at = columns.iter().position(|c| c == name);
    let value = |row: &Vec<Option<f64>>| at.and_then(|i| row.get(i).copied().flatten()).unwrap_or(f64::NAN);
    rows.iter().map(value).collect()
}

const POINTS: [&str; 11] =
    ["trial", "setting", "t", "x", "y", "vx", "vy", "before_x", "before_y", "after_x", "after_y"];
const PUSHES: [&str; 7] = ["x", "y", "speed", "ax", "ay", "found_ax", "found_ay"];
const BOUNCES: [&str; 13] = [
    "setting",
    "seen_approach",
    "seen_slip",
    "seen_normal",
    "seen_along",
    "base_approach",
    "base_slip",
    "base_normal",
    "base_along",
    "extended_approach",
    "extended_slip",
    "extended_normal",
    "extended_along",
];

/// The tables of a diagnosis's evidence.
pub fn plot_tables(evidence: &Evidence) -> PlotTables {
    let point = |p: &EvidencePoint| {
        let start = [p.trial as f64, p.setting as f64, p.time];
        start.into_iter().chain([p.position, p.velocity, p.before, p.after].concat()).collect()
    };
    let met = |m: &ImpactRecord| [m.approach_speed, m.slip_speed, m.impulse[0], m.impulse[1]];
    PlotTables {
        settings: evidence.settings.clone(),
        points: table(&POINTS, &evidence.points, point),
        pushes: table(&PUSHES, &evidence.accelerations, |p| {
            [&p.position[..], &[p.speed], &p.observed, &p.modelled].concat()
        }),
        bounces: table(&BOUNCES, &evidence.bounces, |b| {
            [&[b.setting as f64][..], &met(&b.observed), &met(&b.base), &met(&b.extended)].concat()
        }),
        autocorrelation: [autocorrelation(evidence, |p| p.before), autocorrelation(evidence, |p| p.after)],
    }
}

/// A table, thinned evenly to the maximum number of rows.
fn table<T>(columns: &[&str], of: &[T], row: impl Fn(&T) -> Vec<f64>) -> PlotTable {
    let number = |v: f64| v.is_finite().then(|| round_to_six_digits(v));
    let stride = of.len().div_ceil(MAX_ROWS).max(1);
    let rows = of.iter().step_by(stride).map(|one| row(one).into_iter().map(number).collect());
    PlotTable { columns: columns.iter().map(|c| c.to_string()).collect(), rows: rows.collect() }
}

/// Mean autocorrelation of residuals within segments and bodies, by lag.
pub fn autocorrelation(evidence: &Evidence, pick: fn(&EvidencePoint) -> [f64; 2]) -> Vec<f64> {
    let mut points: Vec<&EvidencePoint> = evidence.points.iter().collect();
    points.sort_by_key(|p| (p.segment, p.body));
    let at_lag = |lag: usize| {
        let (mut products, mut squares) = (0.0, 0.0);
        for (i, point) in points.iter().enumerate() {
            let r = pick(point);
            squares += r[0] * r[0] + r[1] * r[1];
            let same = |o: &&&EvidencePoint| (o.segment, o.body) == (point.segment, point.body);
            if let Some(other) = points.get(i + lag).filter(same) {
                let o = pick(other);
                products += r[0] * o[0] + r[1] * o[1];
            }
        }
        if squares > 0.0 { products / squares } else { 0.0 }
    };
    (0..=MAX_LAG).map(at_lag).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tables_are_short_and_have_their_columns() {
        let point = |i: usize| EvidencePoint {
            trial: i / 1000,
            segment: i / 1000,
            body: 0,
            setting: 0,
            time: 0.01 * i as f64,
            position: [1.0, 2.0],
            velocity: [1.0 / 3.0, f64::NAN],
            before: [if i.is_multiple_of(2) { 1.0 } else { -1.0 }, 0.0],
            after: [0.0; 2],
            predictive_sd: [[0.0; 2]; 2],
        };
        let points = (0..4000).map(point).collect();
        let found = plot_tables(&Evidence { points, settings: vec!["a".into()], ..Evidence::default() });
        assert_eq!(found.points.rows.len(), 1334);
        assert!(found.points.rows.iter().all(|r| r.len() == found.points.columns.len()));
        assert_eq!(found.points.rows[0][5..7], [Some(0.333333), None]);
        assert!(found.pushes.rows.is_empty() && found.bounces.rows.is_empty());
        let [before, after] = found.autocorrelation;
        assert!(before.len() == 13 && before[0] == 1.0 && before[1] < -0.99 && before[2] > 0.99);
        assert!(after.iter().all(|v| *v == 0.0));
    }
}
