//! CSV format of recorded trials, `trial,t,body,x,y[,setting,angle,vx,vy,omega]`: strict parser and writer.
//!
//! One row per observation of one body. Rows of a trial are contiguous and `t` increases; bodies observed at the same
//! `t` share a sample. An empty cell is a missing value (NaN in memory). An error names line, column and value.

use super::Trial;
use super::track_files::{TrackRow, assemble, check_cells, check_complete, invalid_value};
use crate::budget::{Budget, Unlimited, checked};
use crate::error::{Error, Result};
use crate::task::Scene;

const REQUIRED: [&str; 5] = ["trial", "t", "body", "x", "y"];
const OPTIONAL: [&str; 5] = ["setting", "angle", "vx", "vy", "omega"];

/// Parses trials; each starts from `scene` in the trial's setting with bodies at their first observation.
pub fn trials_from_csv(text: &str, scene: &Scene) -> Result<Vec<Trial>> {
    read_trials_csv(text, scene, &Unlimited)
}

/// As [`trials_from_csv`], with a budget.
pub fn read_trials_csv(text: &str, scene: &Scene, budget: &dyn Budget) -> Result<Vec<Trial>> {
    check_cells([text])?;
    assemble(rows(text, budget)?, scene, budget)
}

/// The rows of a file in this format.
pub fn rows(text: &str, budget: &dyn Budget) -> Result<Vec<TrackRow>> {
    let mut reader = csv::ReaderBuilder::new().has_headers(false).flexible(true).from_reader(text.as_bytes());
    let mut records = reader.records();
    let header = records.next().ok_or_else(|| invalid_value(1, "", "an empty file", "a header line"))?;
    let columns = RecordingColumns::from_header(&header.map_err(|e| unreadable(&e))?)?;
    let mut rows: Vec<TrackRow> = Vec::new();
    let mut last = Vec::new();
    for record in checked(records, budget) {
        let record = record?.map_err(|e| unreadable(&e))?;
        let number = record.position().map_or(0, |p| p.line() as usize);
        rows.push(columns.row(number, &record)?);
        last.extend(record.get(columns.count - 1).map(String::from));
    }
    check_complete(text, rows.last().map_or(1, |r| r.line), last.iter().map(String::as_str))?;
    Ok(rows)
}

/// Whether a header line has all required columns of this format.
pub fn is_header(cells: &[&str]) -> bool {
    REQUIRED.iter().all(|name| cells.contains(name))
}

/// Trials as CSV. Contains `setting` only if a trial has one, and velocities and spins only if any is observed after the start; values
/// keep all digits.
pub fn trials_to_csv(trials: &[Trial]) -> String {
    write_trials_csv(trials, &Unlimited).expect("an unlimited budget does not end")
}

/// As [`trials_to_csv`], with a budget.
pub fn write_trials_csv(trials: &[Trial], budget: &dyn Budget) -> Result<String> {
    let settings = trials.iter().any(|t| t.setting.is_some());
    let mut tracks = trials.iter().flat_map(|t| &t.observed.bodies);
    let later = |v: &[f64]| v.iter().skip(1).any(|v| v.is_finite());
    let moving = tracks.any(|b| later(&b.vx) || later(&b.vy) || later(&b.omega));
    let mut writer = csv::Writer::from_writer(Vec::new());
    let mut write =
        |row: &[String]| writer.write_record(row).expect("writing rows of equal length to memory succeeds");
    let if_any =
        |there: bool, cells: &[&str]| cells.iter().filter(|_| there).map(|c| c.to_string()).collect();
    let header: [Vec<String>; 4] = [
        if_any(true, &["trial"]),
        if_any(settings, &["setting"]),
        if_any(true, &["t", "body", "x", "y", "angle"]),
        if_any(moving, &["vx", "vy", "omega"]),
    ];
    write(&header.concat());
    let cell = |v: &[f64], i: usize| v.get(i).filter(|v| v.is_finite()).map_or(String::new(), f64::to_string);
    for trial in trials {
        for sample in checked(trial.observed.times.iter().enumerate(), budget) {
            let (i, t) = sample?;
            for track in &trial.observed.bodies {
                let mut row = vec![trial.name.clone()];
                row.extend(settings.then(|| trial.setting.clone().unwrap_or_default()));
                row.extend([t.to_string(), track.name.clone()]);
                row.extend([&track.x, &track.y, &track.angle].map(|v| cell(v, i)));
                if moving {
                    row.extend([&track.vx, &track.vy, &track.omega].map(|v| cell(v, i)));
                }
                write(&row);
            }
        }
    }
    let bytes = writer.into_inner().expect("flushing to memory succeeds");
    Ok(String::from_utf8(bytes).expect("the CSV is UTF-8"))
}

struct RecordingColumns {
    /// Column index of each of REQUIRED, then OPTIONAL.
    at: [Option<usize>; 10],
    count: usize,
}

impl RecordingColumns {
    fn from_header(cells: &csv::StringRecord) -> Result<RecordingColumns> {
        let known: Vec<&str> = REQUIRED.iter().chain(&OPTIONAL).copied().collect();
        let mut at = [None; 10];
        for (i, cell) in cells.iter().enumerate() {
            let name = cell.trim().trim_start_matches('\u{feff}');
            let Some(k) = known.iter().position(|n| *n == name) else {
                return Err(invalid_value(
                    1,
                    "header",
                    &format!("{name:?}"),
                    &format!("columns {}", known.join(", ")),
                ));
            };
            if at[k].replace(i).is_some() {
                return Err(invalid_value(1, "header", &format!("{name:?} twice"), "every column once"));
            }
        }
        if let Some(k) = (0..REQUIRED.len()).find(|k| at[*k].is_none()) {
            return Err(invalid_value(
                1,
                "header",
                &format!("without {:?}", REQUIRED[k]),
                &format!("at least {}", REQUIRED.join(",")),
            ));
        }
        Ok(RecordingColumns { at, count: cells.len() })
    }

    fn row(&self, line: usize, cells: &csv::StringRecord) -> Result<TrackRow> {
        if cells.len() != self.count {
            let allowed = format!("{} cells as in the header", self.count);
            return Err(invalid_value(line, "", &format!("{} cells", cells.len()), &allowed));
        }
        let cell = |k: usize| self.at[k].map(|i| cells[i].trim());
        let number = |k: usize| -> Result<f64> {
            let name = if k < 5 { REQUIRED[k] } else { OPTIONAL[k - 5] };
            match cell(k) {
                None | Some("") => Ok(f64::NAN),
                Some(text) => match text.parse::<f64>() {
                    Ok(v) if v.is_finite() && v.abs() <= 1e6 => Ok(v),
                    _ => Err(invalid_value(
                        line,
                        name,
                        &format!("{text:?}"),
                        "a number from -1e6 to 1e6, or nothing",
                    )),
                },
            }
        };
        let t = number(1)?;
        if t.is_nan() {
            return Err(invalid_value(line, "t", "missing", "a time in s"));
        }
        let text = |k: usize| cell(k).unwrap_or_default().to_string();
        if text(0).is_empty() {
            return Err(invalid_value(line, "trial", "missing", "the trial's name"));
        }
        Ok(TrackRow {
            line,
            trial: text(0),
            setting: cell(5).map(String::from),
            body: text(2),
            t,
            values: [number(3)?, number(4)?, number(6)?, number(7)?, number(8)?, number(9)?],
        })
    }
}

fn unreadable(error: &csv::Error) -> Error {
    let line = error.position().map_or(0, |p| p.line() as usize);
    invalid_value(line, "", "", &format!("comma-separated values ({error})"))
}
