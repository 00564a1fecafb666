//! Recorded trials: the CSV `trial,t,body,x,y[,setting,angle,vx,vy,omega]`, read strictly, written back.
//!
//! A row per observation of one body. Rows of a trial are contiguous, `t` rises; bodies observed at the same
//! `t` share a sample. An empty cell is a missing value (NaN inside). The whole file is parsed before anything
//! is returned; an error names file, line, column and value.

use std::collections::HashSet;
use std::path::Path;

use super::Trial;
use crate::error::{Error, Input, Result};
use crate::task::Scene;
use crate::trajectory::{Track, Trajectory};

const REQUIRED: [&str; 5] = ["trial", "t", "body", "x", "y"];
const OPTIONAL: [&str; 5] = ["setting", "angle", "vx", "vy", "omega"];

/// Reads a trials file for a scene.
pub fn read_trials(path: &Path, scene: &Scene) -> Result<Vec<Trial>> {
    let bytes = std::fs::read(path).map_err(|e| Error::io(path, e))?;
    let name = path.display().to_string();
    let text = String::from_utf8(bytes).map_err(|e| {
        let line = e.as_bytes()[..e.utf8_error().valid_up_to()].iter().filter(|b| **b == b'\n').count() + 1;
        refuse(line, "", "", "UTF-8 text").at(&name)
    })?;
    trials_from_csv(&text, scene).map_err(|e| e.at(&name))
}

/// Parses trials; each starts from `scene` in the trial's setting with bodies at their first observation.
pub fn trials_from_csv(text: &str, scene: &Scene) -> Result<Vec<Trial>> {
    let mut reader = csv::ReaderBuilder::new().has_headers(false).flexible(true).from_reader(text.as_bytes());
    let mut records = reader.records();
    let header = records.next().ok_or_else(|| refuse(1, "", "an empty file", "a header line"))?;
    let columns = Columns::from_header(&header.map_err(|e| unreadable(&e))?)?;
    let mut trials: Vec<Trial> = Vec::new();
    let mut finished = HashSet::new();
    let mut last = (0, Vec::new());
    for record in records {
        let record = record.map_err(|e| unreadable(&e))?;
        let number = record.position().map_or(0, |p| p.line() as usize);
        let row = columns.row(number, &record)?;
        let digits = record.get(columns.count - 1).map(decimals);
        last.0 = number;
        last.1.extend(digits);
        if trials.last().is_none_or(|t| t.name != row.trial) {
            if !finished.insert(row.trial.clone()) {
                let allowed = "rows of a trial on end; this trial already ended above";
                return Err(refuse(number, "trial", &format!("{:?}", row.trial), allowed));
            }
            let setting = row.setting.clone();
            let base = scene.in_setting(setting.as_deref().unwrap_or_default())?;
            let bodies = scene.bodies.iter().map(|b| Track::with_capacity(&b.name, 0)).collect();
            let observed = Trajectory { bodies, ..Trajectory::default() };
            trials.push(Trial { name: row.trial.clone(), setting, scene: base, observed });
        }
        let trial = trials.last_mut().expect("a trial was pushed above if there was none");
        if trial.setting != row.setting {
            let allowed = "the same setting in all rows of a trial";
            return Err(refuse(
                number,
                "setting",
                &format!("{:?}", row.setting.as_deref().unwrap_or("")),
                allowed,
            ));
        }
        add(trial, &row, number)?;
    }
    if !text.ends_with('\n') && looks_cut(&last.1) {
        let allowed =
            "a complete last line; it has fewer digits than those above and no newline: is the file cut off?";
        return Err(refuse(last.0, "", "", allowed));
    }
    if trials.is_empty() {
        return Err(refuse(2, "", "no observation", "at least one row below the header"));
    }
    trials.iter_mut().for_each(start_from_first_observation);
    Ok(trials)
}

/// Trials as CSV, with `setting` only if a trial has one and velocities and spins only if any was seen after the
/// start; values keep all their digits.
pub fn trials_to_csv(trials: &[Trial]) -> String {
    let settings = trials.iter().any(|t| t.setting.is_some());
    let mut tracks = trials.iter().flat_map(|t| &t.observed.bodies);
    let later = |v: &[f64]| v.iter().skip(1).any(|v| v.is_finite());
    let moving = tracks.any(|b| later(&b.vx) || later(&b.vy) || later(&b.omega));
    let mut writer = csv::Writer::from_writer(Vec::new());
    let mut write =
        |row: &[String]| writer.write_record(row).expect("rows are of one length, and memory takes them");
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
        for (i, t) in trial.observed.times.iter().enumerate() {
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
    let bytes = writer.into_inner().expect("memory takes what is left to write");
    String::from_utf8(bytes).expect("text and numbers were written")
}

struct Columns {
    /// Position of each of REQUIRED then OPTIONAL in a row.
    at: [Option<usize>; 10],
    count: usize,
}

impl Columns {
    fn from_header(cells: &csv::StringRecord) -> Result<Columns> {
        let known: Vec<&str> = REQUIRED.iter().chain(&OPTIONAL).copied().collect();
        let mut at = [None; 10];
        for (i, cell) in cells.iter().enumerate() {
            let name = cell.trim().trim_start_matches('\u{feff}');
            let Some(k) = known.iter().position(|n| *n == name) else {
                return Err(refuse(
                    1,
                    "header",
                    &format!("{name:?}"),
                    &format!("columns {}", known.join(", ")),
                ));
            };
            if at[k].replace(i).is_some() {
                return Err(refuse(1, "header", &format!("{name:?} twice"), "every column once"));
            }
        }
        if let Some(k) = (0..REQUIRED.len()).find(|k| at[*k].is_none()) {
            return Err(refuse(
                1,
                "header",
                &format!("without {:?}", REQUIRED[k]),
                &format!("at least {}", REQUIRED.join(",")),
            ));
        }
        Ok(Columns { at, count: cells.len() })
    }

    fn row(&self, line: usize, cells: &csv::StringRecord) -> Result<Row> {
        if cells.len() != self.count {
            let allowed = format!("{} cells as in the header", self.count);
            return Err(refuse(line, "", &format!("{} cells", cells.len()), &allowed));
        }
        let cell = |k: usize| self.at[k].map(|i| cells[i].trim());
        let number = |k: usize| -> Result<f64> {
            let name = if k < 5 { REQUIRED[k] } else { OPTIONAL[k - 5] };
            match cell(k) {
                None | Some("") => Ok(f64::NAN),
                Some(text) => match text.parse::<f64>() {
                    Ok(v) if v.is_finite() && v.abs() <= 1e6 => Ok(v),
                    _ => {
                        Err(refuse(line, name, &format!("{text:?}"), "a number from -1e6 to 1e6, or nothing"))
                    }
                },
            }
        };
        let t = number(1)?;
        if t.is_nan() {
            return Err(refuse(line, "t", "missing", "a time in s"));
        }
        let text = |k: usize| cell(k).unwrap_or_default().to_string();
        if text(0).is_empty() {
            return Err(refuse(line, "trial", "missing", "the trial's name"));
        }
        Ok(Row {
            trial: text(0),
            setting: cell(5).map(String::from),
            body: text(2),
            t,
            values: [number(3)?, number(4)?, number(6)?, number(7)?, number(8)?, number(9)?],
        })
    }
}

/// One parsed line.
struct Row {
    trial: String,
    setting: Option<String>,
    body: String,
    t: f64,
    /// x, y, angle, vx, vy, omega; NaN where missing.
    values: [f64; 6],
}

/// Appends a row to its trial.
fn add(trial: &mut Trial, row: &Row, line: usize) -> Result<()> {
    let observed = &mut trial.observed;
    let Some(which) = observed.bodies.iter().position(|t| t.name == row.body) else {
        let known = observed.bodies.iter().map(|t| format!("{:?}", t.name)).collect::<Vec<_>>().join(", ");
        return Err(refuse(
            line,
            "body",
            &format!("{:?}", row.body),
            &format!("a body of the scene: {known}"),
        ));
    };
    match observed.times.last() {
        Some(last) if row.t < *last => {
            let allowed = format!("a time not before {last}, the row above");
            return Err(refuse(line, "t", &row.t.to_string(), &allowed));
        }
        Some(last) if row.t == *last => {}
        _ => {
            observed.times.push(row.t);
            for track in &mut observed.bodies {
                track.push([f64::NAN; 2], f64::NAN, [f64::NAN; 2], f64::NAN);
            }
        }
    }
    let at = observed.times.len() - 1;
    let track = &mut observed.bodies[which];
    let filled = [track.x[at], track.y[at], track.angle[at]].iter().any(|v| !v.is_nan());
    if filled {
        let allowed = "each body once at each time of a trial (times must rise)";
        return Err(refuse(line, "t", &row.t.to_string(), allowed));
    }
    let [x, y, angle, vx, vy, omega] = row.values;
    (track.x[at], track.y[at], track.angle[at]) = (x, y, angle);
    (track.vx[at], track.vy[at], track.omega[at]) = (vx, vy, omega);
    Ok(())
}

/// Puts the scene's bodies where they were first seen.
fn start_from_first_observation(trial: &mut Trial) {
    for (body, track) in trial.scene.bodies.iter_mut().zip(&trial.observed.bodies) {
        let seen = (0..track.len()).find(|i| track.x[*i].is_finite() && track.y[*i].is_finite());
        if let Some(i) = seen {
            body.position = Some([track.x[i], track.y[i]]);
            if track.angle[i].is_finite() {
                body.angle = track.angle[i];
            }
            if track.vx[i].is_finite() && track.vy[i].is_finite() {
                body.velocity = [track.vx[i], track.vy[i]];
            }
            if track.omega[i].is_finite() {
                body.angular_velocity = track.omega[i];
            }
        }
    }
}

/// Digits behind the decimal point.
fn decimals(cell: &str) -> usize {
    cell.split_once('.').map_or(0, |(_, digits)| digits.len())
}

/// Whether the last of a column's numbers lost digits that all others have.
fn looks_cut(digits: &[usize]) -> bool {
    match digits.split_last() {
        Some((last, [first, rest @ ..])) if rest.len() >= 2 => {
            rest.iter().all(|d| d == first) && last < first
        }
        _ => false,
    }
}

fn unreadable(error: &csv::Error) -> Error {
    let line = error.position().map_or(0, |p| p.line() as usize);
    refuse(line, "", "", &format!("comma-separated values ({error})"))
}

fn refuse(line: usize, field: &str, value: &str, allowed: &str) -> Error {
    Error::Input(Input {
        place: line.to_string(),
        field: field.to_string(),
        value: value.to_string(),
        allowed: allowed.to_string(),
    })
}
