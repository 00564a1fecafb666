//! Converts track files into trials of a given scene, or of a scene built for a single ball.

use std::path::Path;

use super::Trial;
use super::parse_options::TrackParseOptions;
use super::track_rows::{TrackRow, assemble};
use super::track_table::{self, TrackTable};
use super::trials_csv;
use super::unit_checks::{self, DeclaredUnits};
use crate::budget::Budget;
use crate::error::{Error, Result};
use crate::task::Scene;
use crate::task::ball::BallScene;

/// A track file. Its name appears in errors and is the default name of its trial.
#[derive(Clone, Debug, PartialEq)]
pub struct TrackFile {
    pub name: String,
    pub text: String,
}

/// Subject of the tracks.
#[derive(Clone, Copy, Debug)]
pub enum Subject<'a> {
    Scene(&'a Scene),
    Ball(&'a BallScene),
}

/// Trials with their scene.
#[derive(Clone, Debug)]
pub struct LoadedTrials {
    pub scene: Scene,
    pub trials: Vec<Trial>,
    /// Notes for the user: unused columns, implausible values.
    pub notes: Vec<String>,
    /// Whether all files are in this project's own format and no option is set.
    pub own_format: bool,
}

/// Parses track files. Files of a scene with several bodies, and those with a header `trial,t,body,x,y`, are in this project's own
/// format; others contain one body's track from a tracking program. Implausible units are errors; if they are declared, or in this
/// project's own format with a given scene, they are notes. Ends early with `budget`.
pub fn load_tracks(
    files: &[TrackFile],
    of: Subject,
    reading: &TrackParseOptions,
    budget: &dyn Budget,
) -> Result<LoadedTrials> {
    reading.validate()?;
    let one = match of {
        Subject::Scene(scene) => (scene.bodies.len() == 1).then(|| scene.bodies[0].name.as_str()),
        Subject::Ball(_) => Some(BALL),
    };
    let mut tables = Vec::new();
    for (file, name) in files.iter().zip(names(files)) {
        let read = || match one {
            Some(body) => track_table::read(&file.text, &name, body, reading, budget),
            None if reading.is_silent() => own_format(&file.text, budget),
            None => {
                Err(Error::input("scene", "of several bodies", "one body, if units or a track are given"))
            }
        };
        let mut table = read().map_err(|e| e.in_file(&file.name))?;
        if files.len() > 1 && table.names_trials {
            table.rows.iter_mut().for_each(|r| r.trial = format!("{name}/{}", r.trial));
        }
        tables.push(table);
    }
    let declared = DeclaredUnits {
        length: tables.iter().all(|t| t.units_declared[0]),
        time: tables.iter().all(|t| t.units_declared[1]),
        up: reading.y_down.is_some(),
    };
    let mut notes: Vec<String> = tables.iter().zip(files).filter_map(|(t, f)| unused(t, f)).collect();
    let scene = match of {
        Subject::Scene(scene) => scene.clone(),
        Subject::Ball(ball) => ball.build(body(&tables)?, seconds(&tables))?,
    };
    let own = tables.iter().all(|t| t.own_format) && matches!(of, Subject::Scene(_));
    let mut trials = Vec::new();
    for (table, file) in tables.into_iter().zip(files) {
        let assembled = assemble(table.rows, &scene, budget);
        trials.extend(assembled.map_err(|e| e.in_file(&file.name))?);
    }
    if scene.bodies.len() == 1 {
        let all_declared = DeclaredUnits { length: true, time: true, up: true };
        notes.extend(unit_checks::check_units(&trials, if own { all_declared } else { declared })?);
    }
    if let Subject::Ball(ball) = of {
        notes.extend(unit_checks::check_floor(&trials, ball.radius, ball.floor)?);
    }
    Ok(LoadedTrials { scene, trials, notes, own_format: own && reading.is_silent() })
}

/// Default name of a ball.
const BALL: &str = "ball";

fn own_format(text: &str, budget: &dyn Budget) -> Result<TrackTable> {
    let rows = trials_csv::rows(text, budget)?;
    Ok(TrackTable {
        rows,
        names_trials: true,
        own_format: true,
        unused: Vec::new(),
        units_declared: [true; 2],
    })
}

/// Default trial name of each file: its stem, or its full name if the stems are not unique.
fn names(files: &[TrackFile]) -> Vec<String> {
    let stem = |f: &TrackFile| {
        Path::new(&f.name).file_stem().map_or(f.name.clone(), |s| s.to_string_lossy().into_owned())
    };
    let stems: Vec<String> = files.iter().map(stem).collect();
    let alike = (1..stems.len()).any(|i| stems[..i].contains(&stems[i]));
    if alike { files.iter().map(|f| f.name.clone()).collect() } else { stems }
}

fn unused(table: &TrackTable, file: &TrackFile) -> Option<String> {
    let columns = table.unused.iter().map(|n| format!("{n:?}")).collect::<Vec<_>>().join(", ");
    (!columns.is_empty()).then(|| format!("{}: unused columns: {columns}", file.name))
}

/// Name of the only body.
fn body(tables: &[TrackTable]) -> Result<&str> {
    let mut rows = tables.iter().flat_map(|t| &t.rows);
    let first = rows.next().map_or(BALL, |r| r.body.as_str());
    match rows.find(|r| r.body != first) {
        Some(other) => {
            let both = format!("{first:?} and {:?}", other.body);
            Err(Error::input(
                "body",
                both,
                "one ball; select it with `track`, or give a scene with all bodies",
            ))
        }
        None => Ok(first),
    }
}

/// Duration of the longest trial, s.
fn seconds(tables: &[TrackTable]) -> f64 {
    let mut longest: f64 = 0.0;
    for table in tables {
        let mut first: Option<&TrackRow> = None;
        for row in &table.rows {
            let start = first.filter(|f| f.trial == row.trial).unwrap_or(row);
            longest = longest.max(row.t - start.t);
            first = Some(start);
        }
    }
    longest
}
