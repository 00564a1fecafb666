//! Files of measured tracks into trials of a scene: of one that is given, or of the one that a ball makes.

use std::path::Path;

use super::Trial;
use super::reading::Reading;
use super::recorded;
use super::rows::{Row, assemble};
use super::suspicion::{self, Said};
use super::tracked::{self, Table};
use crate::budget::Budget;
use crate::error::{Error, Result};
use crate::task::Scene;
use crate::task::ball::Ball;

/// A file, whose name stands in errors and is its trial's where it holds one without a name.
#[derive(Clone, Debug, PartialEq)]
pub struct File {
    pub name: String,
    pub text: String,
}

/// What the tracks are of.
#[derive(Clone, Copy, Debug)]
pub enum Of<'a> {
    Scene(&'a Scene),
    Ball(&'a Ball),
}

/// Trials with the scene that they are of.
#[derive(Clone, Debug)]
pub struct Gathered {
    pub scene: Scene,
    pub trials: Vec<Trial>,
    /// What a user should know: columns that were not read, what looks odd.
    pub notes: Vec<String>,
    /// Whether all files were in this project's own format, and nothing was said of their units.
    pub own_format: bool,
}

/// Reads files. Those of a scene with several bodies, and all with a header `trial,t,body,x,y`, are in this project's own
/// format; others are one body's track as tracking programs write it. Units that look wrong are errors, unless they were
/// said outright; in this project's own format, of which a scene is given, they are notes. Ends early with `budget`.
pub fn gather(files: &[File], of: Of, reading: &Reading, budget: &dyn Budget) -> Result<Gathered> {
    reading.validate()?;
    let one = match of {
        Of::Scene(scene) => (scene.bodies.len() == 1).then(|| scene.bodies[0].name.as_str()),
        Of::Ball(_) => Some(BALL),
    };
    let mut tables = Vec::new();
    for (file, name) in files.iter().zip(names(files)) {
        let read = || match one {
            Some(body) => tracked::read(&file.text, &name, body, reading, budget),
            None if reading.is_silent() => own_format(&file.text, budget),
            None => Err(Error::input(
                "scene",
                "of several bodies",
                "one body, for tracks that need units or a track said",
            )),
        };
        let mut table = read().map_err(|e| e.at(&file.name))?;
        if files.len() > 1 && table.names_trials {
            table.rows.iter_mut().for_each(|r| r.trial = format!("{name}/{}", r.trial));
        }
        tables.push(table);
    }
    let said = Said {
        length: tables.iter().all(|t| t.said[0]),
        time: tables.iter().all(|t| t.said[1]),
        up: reading.y_down.is_some(),
    };
    let mut notes: Vec<String> = tables.iter().zip(files).filter_map(|(t, f)| unused(t, f)).collect();
    let scene = match of {
        Of::Scene(scene) => scene.clone(),
        Of::Ball(ball) => ball.scene(body(&tables)?, seconds(&tables))?,
    };
    let own = tables.iter().all(|t| t.own_format) && matches!(of, Of::Scene(_));
    let mut trials = Vec::new();
    for (table, file) in tables.into_iter().zip(files) {
        let assembled = assemble(table.rows, &scene, budget);
        trials.extend(assembled.map_err(|e| e.at(&file.name))?);
    }
    if scene.bodies.len() == 1 {
        let outright = Said { length: true, time: true, up: true };
        notes.extend(suspicion::units(&trials, if own { outright } else { said })?);
    }
    if let Of::Ball(ball) = of {
        notes.extend(suspicion::floor(&trials, ball.radius, ball.floor)?);
    }
    Ok(Gathered { scene, trials, notes, own_format: own && reading.is_silent() })
}

/// What a ball is called that the files give no name.
const BALL: &str = "ball";

fn own_format(text: &str, budget: &dyn Budget) -> Result<Table> {
    let rows = recorded::rows(text, budget)?;
    Ok(Table { rows, names_trials: true, own_format: true, unused: Vec::new(), said: [true; 2] })
}

/// Names of trials by file: the files' stems, or all of their names where stems are not enough.
fn names(files: &[File]) -> Vec<String> {
    let stem = |f: &File| {
        Path::new(&f.name).file_stem().map_or(f.name.clone(), |s| s.to_string_lossy().into_owned())
    };
    let stems: Vec<String> = files.iter().map(stem).collect();
    let alike = (1..stems.len()).any(|i| stems[..i].contains(&stems[i]));
    if alike { files.iter().map(|f| f.name.clone()).collect() } else { stems }
}

fn unused(table: &Table, file: &File) -> Option<String> {
    let columns = table.unused.iter().map(|n| format!("{n:?}")).collect::<Vec<_>>().join(", ");
    (!columns.is_empty()).then(|| format!("{}: columns that were not read: {columns}", file.name))
}

/// The name of the only body.
fn body(tables: &[Table]) -> Result<&str> {
    let mut rows = tables.iter().flat_map(|t| &t.rows);
    let first = rows.next().map_or(BALL, |r| r.body.as_str());
    match rows.find(|r| r.body != first) {
        Some(other) => {
            let both = format!("{first:?} and {:?}", other.body);
            Err(Error::input("body", both, "one ball; say which with `track`, or give a scene of all"))
        }
        None => Ok(first),
    }
}

/// Duration of the longest trial, s.
fn seconds(tables: &[Table]) -> f64 {
    let mut longest: f64 = 0.0;
    for table in tables {
        let mut first: Option<&Row> = None;
        for row in &table.rows {
            let start = first.filter(|f| f.trial == row.trial).unwrap_or(row);
            longest = longest.max(row.t - start.t);
            first = Some(start);
        }
    }
    longest
}
