//! Recordings of mechanisms: measured joint positions and the commands of motors.
//!
//! One row per time: `trial,t`, a column for each joint by its name, and `JOINT.command` for each motor, whose value holds
//! until the next row of the trial.

use crate::error::{Error, Result};
use crate::task::Scene;
use crate::task::joint::MAX_JOINTS;
use crate::world::mechanism::{Commands, Tree};

/// Maximum number of rows of a recording.
const MAX_ROWS: usize = 2_000_000;
/// Maximum number of time steps of the scene in a trial.
const MAX_STEPS_PER_TRIAL: f64 = 1e7;
/// Suffix of the columns of commands.
const COMMAND_SUFFIX: &str = ".command";

/// A measured trial of a mechanism.
#[derive(Clone, Debug)]
pub struct JointTrial {
    /// Its identifier in the recording.
    pub id: String,
    /// s, ascending
    pub times: Vec<f64>,
    /// By time, then by joint in the order of the tree; rad or m.
    pub positions: Vec<Vec<f64>>,
    pub commands: Commands,
}

/// Parses a recording of a scene with joints.
pub fn joint_trials_from_csv(text: &str, scene: &Scene) -> Result<Vec<JointTrial>> {
    let tree = Tree::of(scene)?;
    let mut reader = csv::ReaderBuilder::new().trim(csv::Trim::All).from_reader(text.as_bytes());
    let header = reader.headers().map_err(|e| unreadable(&e))?.clone();
    let columns = Columns::of(&header, &tree)?;
    let mut trials: Vec<TrialRows> = Vec::new();
    for record in reader.records() {
        let record = record.map_err(|e| unreadable(&e))?;
        let line = record.position().map_or(0, |p| p.line());
        if trials.iter().map(|t| t.times.len()).sum::<usize>() >= MAX_ROWS {
            return Err(Error::input("rows", "too many", format!("at most {MAX_ROWS} rows")));
        }
        let id = record.get(columns.trial).unwrap_or_default();
        if trials.last().is_none_or(|last| last.id != id) {
            if trials.iter().any(|t| t.id == id) {
                return Err(Error::input(format!("line {line}, trial"), id, "the rows of a trial together"));
            }
            trials.push(TrialRows { id: id.into(), ..TrialRows::default() });
        }
        let Some(trial) = trials.last_mut() else { continue };
        trial.add(&record, &columns, line)?;
    }
    let trials: Vec<JointTrial> = trials.into_iter().map(TrialRows::into_trial).collect();
    let duration = |t: &JointTrial| t.times[t.times.len() - 1] - t.times[0];
    if let Some(long) = trials.iter().find(|t| duration(t) > MAX_STEPS_PER_TRIAL * scene.time_step) {
        let allowed =
            format!("at most {MAX_STEPS_PER_TRIAL:.0} time steps of the scene ({} s)", scene.time_step);
        return Err(Error::input(format!("trial {}, t", long.id), format!("{} s", duration(long)), allowed));
    }
    match trials.iter().find(|t| t.times.len() < 3) {
        Some(short) => Err(Error::input(
            format!("trial {}", short.id),
            format!("{} rows", short.times.len()),
            "3 rows or more",
        )),
        None if trials.is_empty() => {
            Err(Error::input("rows", "none", "a row for each time after the header"))
        }
        None => Ok(trials),
    }
}

/// Parses commands of motors alone: `t` and a column `JOINT.command` for each motor.
pub fn commands_from_csv(text: &str, scene: &Scene) -> Result<Commands> {
    let tree = Tree::of(scene)?;
    let mut reader = csv::ReaderBuilder::new().trim(csv::Trim::All).from_reader(text.as_bytes());
    let header = reader.headers().map_err(|e| unreadable(&e))?.clone();
    let columns = Columns::of_commands(&header, &tree)?;
    let mut rows = TrialRows::default();
    for record in reader.records() {
        let record = record.map_err(|e| unreadable(&e))?;
        rows.add(&record, &columns, record.position().map_or(0, |p| p.line()))?;
    }
    match rows.times.is_empty() {
        true => Err(Error::input("rows", "none", "a row for each change of the commands")),
        false => Ok(Commands::new(rows.times, rows.commands)),
    }
}

/// Places of the columns.
struct Columns {
    trial: usize,
    time: usize,
    /// By joint of the tree.
    positions: Vec<usize>,
    commands: Vec<Option<usize>>,
    names: Vec<String>,
}

impl Columns {
    fn of(header: &csv::StringRecord, tree: &Tree) -> Result<Columns> {
        let mut out = Columns::of_commands(header, tree)?;
        out.trial = out.place("trial")?;
        out.positions = tree.names.iter().map(|name| out.place(name)).collect::<Result<_>>()?;
        Ok(out)
    }

    /// Times and commands alone.
    fn of_commands(header: &csv::StringRecord, tree: &Tree) -> Result<Columns> {
        let known = |column: &str| {
            let joint = column.strip_suffix(COMMAND_SUFFIX).unwrap_or(column);
            column == "trial" || column == "t" || tree.joint(joint).is_some()
        };
        if let Some(unknown) = header.iter().find(|column| !known(column)) {
            let allowed =
                format!("trial, t, and with or without {COMMAND_SUFFIX}: {}", tree.names.join(", "));
            return Err(Error::input(format!("column {unknown}"), "unknown", allowed));
        }
        let names: Vec<String> = header.iter().map(String::from).collect();
        let mut out = Columns { trial: 0, time: 0, positions: Vec::new(), commands: Vec::new(), names };
        out.time = out.place("t")?;
        for (joint, motor) in tree.names.iter().zip(&tree.motors) {
            let column = out.place(&format!("{joint}{COMMAND_SUFFIX}"));
            out.commands.push(match motor {
                Some(_) => Some(column?),
                None if column.is_ok() => {
                    let allowed = "absent: the joint has no motor";
                    return Err(Error::input(format!("column {joint}{COMMAND_SUFFIX}"), "given", allowed));
                }
                None => None,
            });
        }
        Ok(out)
    }

    /// Place of a column that must exist.
    fn place(&self, name: &str) -> Result<usize> {
        self.names.iter().position(|column| column == name).ok_or_else(|| {
            let have: Vec<&str> = self.names.iter().take(2 * MAX_JOINTS + 2).map(String::as_str).collect();
            Error::input(
                format!("column {name}"),
                "missing",
                format!("a column of this name; the file has {}", have.join(", ")),
            )
        })
    }

    fn number(&self, record: &csv::StringRecord, column: usize, line: u64) -> Result<f64> {
        let cell = record.get(column).unwrap_or_default();
        let number = cell.parse::<f64>().ok().filter(|v| v.is_finite());
        number.ok_or_else(|| {
            Error::input(
                format!("line {line}, {}", self.names[column]),
                format!("{cell:?}"),
                "a finite number",
            )
        })
    }
}

/// Rows of a trial.
#[derive(Default)]
struct TrialRows {
    id: String,
    times: Vec<f64>,
    positions: Vec<Vec<f64>>,
    /// By joint.
    commands: Vec<Vec<f64>>,
}

impl TrialRows {
    fn add(&mut self, record: &csv::StringRecord, columns: &Columns, line: u64) -> Result<()> {
        let time = columns.number(record, columns.time, line)?;
        if self.times.last().is_some_and(|last| time <= *last) {
            return Err(Error::input(format!("line {line}, t"), time, "later than the row before"));
        }
        self.times.push(time);
        let positions = columns.positions.iter().map(|c| columns.number(record, *c, line));
        self.positions.push(positions.collect::<Result<_>>()?);
        self.commands.resize(columns.commands.len(), Vec::new());
        for (values, column) in self.commands.iter_mut().zip(&columns.commands) {
            if let Some(column) = column {
                values.push(columns.number(record, *column, line)?);
            }
        }
        Ok(())
    }

    fn into_trial(self) -> JointTrial {
        let commands = Commands::new(self.times.clone(), self.commands);
        JointTrial { id: self.id, times: self.times, positions: self.positions, commands }
    }
}

fn unreadable(error: &csv::Error) -> Error {
    let line = error.position().map_or(0, |p| p.line());
    Error::input(
        format!("line {line}"),
        error.to_string(),
        "CSV with as many cells in every row as in the header",
    )
}
