//! Rows of observations, independent of the file format, and their assembly into trials.

use std::collections::HashSet;

use super::size::check_trials;
use crate::budget::{Budget, checked};
use crate::error::{Error, InvalidInput, Result};
use crate::reality::Trial;
use crate::task::Scene;
use crate::task::limits::check_text_length;
use crate::trajectory::{Track, Trajectory};

/// Observation of one body at one time.
#[derive(Default)]
pub struct TrackRow {
    /// Line of the file, from 1.
    pub line: usize,
    pub trial: String,
    pub setting: Option<String>,
    pub body: String,
    /// Time, s.
    pub t: f64,
    /// x (m), y (m, up), angle (rad), vx, vy (m/s), omega (rad/s); NaN where missing.
    pub values: [f64; 6],
}

/// The points of one trial of one body.
pub struct TrialPoints {
    pub trial: String,
    /// Time, s, x and y, m, where y is observed.
    pub points: Vec<[f64; 3]>,
}

impl TrialPoints {
    /// The points of each trial; rows of a trial are contiguous.
    pub fn by_trial(rows: &[TrackRow]) -> impl Iterator<Item = TrialPoints> {
        rows.chunk_by(|a, b| a.trial == b.trial).map(|trial| TrialPoints {
            trial: trial[0].trial.clone(),
            points: trial
                .iter()
                .map(|r| [r.t, r.values[0], r.values[1]])
                .filter(|p| p[2].is_finite())
                .collect(),
        })
    }
}

/// Assembles trials from rows in contiguous blocks; each trial starts from `scene` in the trial's setting with bodies at their first
/// observation.
pub fn assemble(rows: Vec<TrackRow>, scene: &Scene, budget: &dyn Budget) -> Result<Vec<Trial>> {
    let mut trials: Vec<Trial> = Vec::new();
    let bare = scene.without_settings();
    check_trials(rows.chunk_by(|a, b| a.trial == b.trial).count(), scene)?;
    let mut finished = HashSet::new();
    for row in checked(rows, budget) {
        let row = row?;
        if trials.last().is_none_or(|t| t.name != row.trial) {
            if !finished.insert(row.trial.clone()) {
                let allowed = "contiguous rows of a trial; this trial already ended above";
                return Err(invalid_value(row.line, "trial", &format!("{:?}", row.trial), allowed));
            }
            for (field, name) in [("trial", Some(&row.trial)), ("setting", row.setting.as_ref())] {
                check_text_length(field, name.map_or("", String::as_str)).map_err(|e| e.in_file(row.line))?;
            }
            let setting = row.setting.clone();
            let base = bare.with_setting(setting.as_ref().and_then(|s| scene.settings.get(s)));
            let bodies = scene.bodies.iter().map(|b| Track::with_capacity(&b.name, 0)).collect();
            let observed = Trajectory { bodies, ..Trajectory::default() };
            trials.push(Trial { name: row.trial.clone(), setting, scene: base, observed });
        }
        let trial = trials.last_mut().expect("a trial was pushed above if there was none");
        if trial.setting != row.setting {
            let value = format!("{:?}", row.setting.as_deref().unwrap_or(""));
            return Err(invalid_value(
                row.line,
                "setting",
                &value,
                "the same setting in all rows of a trial",
            ));
        }
        add(trial, &row)?;
    }
    if trials.is_empty() {
        return Err(invalid_value(2, "", "no observation", "at least one row below the header"));
    }
    trials.iter_mut().for_each(start_from_first_observation);
    Ok(trials)
}

/// Error for an invalid value in a file.
pub fn invalid_value(line: usize, field: &str, value: &str, allowed: &str) -> Error {
    Error::Input(InvalidInput {
        place: line.to_string(),
        field: field.to_string(),
        value: value.to_string(),
        allowed: allowed.to_string(),
    })
}

/// Errors if a file seems truncated within its last number: no final newline, and fewer digits than all numbers above.
/// `cells` are the last numbers of the rows.
pub fn check_complete<'a>(text: &str, line: usize, cells: impl IntoIterator<Item = &'a str>) -> Result<()> {
    let decimals = |cell: &str| cell.split_once(['.', ',']).map_or(0, |(_, digits)| digits.len());
    let digits: Vec<usize> = cells.into_iter().map(decimals).collect();
    let lost = match digits.split_last() {
        Some((last, [first, rest @ ..])) if rest.len() >= 2 => {
            rest.iter().all(|d| d == first) && last < first
        }
        _ => false,
    };
    if lost && !text.ends_with(['\n', '\r']) {
        let allowed =
            "a complete last line; it has fewer digits than those above and no newline: is the file cut off?";
        return Err(invalid_value(line, "", "", allowed));
    }
    Ok(())
}

/// Appends a row to its trial.
fn add(trial: &mut Trial, row: &TrackRow) -> Result<()> {
    let observed = &mut trial.observed;
    let Some(which) = observed.bodies.iter().position(|t| t.name == row.body) else {
        let known = observed.bodies.iter().map(|t| format!("{:?}", t.name)).collect::<Vec<_>>().join(", ");
        let allowed = format!("a body of the scene: {known}");
        return Err(invalid_value(row.line, "body", &format!("{:?}", row.body), &allowed));
    };
    match observed.times.last() {
        Some(last) if row.t < *last => {
            let allowed = format!("a time not before {last}, the row above");
            return Err(invalid_value(row.line, "t", &row.t.to_string(), &allowed));
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
        return Err(invalid_value(row.line, "t", &row.t.to_string(), allowed));
    }
    let [x, y, angle, vx, vy, omega] = row.values;
    (track.x[at], track.y[at], track.angle[at]) = (x, y, angle);
    (track.vx[at], track.vy[at], track.omega[at]) = (vx, vy, omega);
    Ok(())
}

/// Places the scene's bodies at their first observations.
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
