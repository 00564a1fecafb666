//! `iplw outcomes`: a table of what many actions do in every task of a family, as NumPy arrays.

use std::fs::OpenOptions;
use std::io::Write;
use std::path::{Path, PathBuf};

use iplw::error::{Error, Result};
use iplw::policy::outcomes::{INVALID, OutcomesConfig, SOLVED, UNSOLVED, chosen, outcomes};
use iplw::progress::Progress;
use iplw::task::{DEFAULT_FAMILY, Task, ValidAction, split};
use iplw::world::Engine;
use serde_json::{Value, json};

use super::{output, parse};

/// Finds out what many actions do in every task of a family, so that agents learn and are judged without a simulator.
///
/// Writes actions.npy (float64: actions by components, each in [0, 1]), outcomes.npy (int8: tasks by actions; 1 solved, -1 not,
/// 0 cannot be placed) and outcomes.json (which tasks, which physics, which version). Stopped, it goes on where it was when
/// it is begun again. In Python: `iplw.Outcomes("outcomes")`.
#[derive(clap::Args)]
pub struct Args {
    /// A family, or one of its tasks.
    #[arg(long, default_value = DEFAULT_FAMILY)]
    task: String,
    /// train, validation or test; all tasks if not given.
    #[arg(long)]
    split: Option<String>,
    /// Discrete actions of the family's space: all if it has no more, else a random subset.
    #[arg(long, default_value_t = 100_000)]
    actions: usize,
    /// Latents of the simulation, `density=..,friction=..,restitution=..`; the scene's own where not given.
    #[arg(long, default_value = "")]
    latents: String,
    /// Effect of the simulation, `name:parameter=value,...`; may be repeated.
    #[arg(long = "effect", value_name = "EFFECT")]
    effects: Vec<String>,
    /// auto, lanes or rapier.
    #[arg(long, default_value = "auto")]
    engine: String,
    /// Decides the subset.
    #[arg(long, default_value_t = 0)]
    seed: u64,
    /// Directory for the table.
    #[arg(long, default_value = "outcomes")]
    out: PathBuf,
}

pub fn run(args: &Args) -> Result<()> {
    let (tasks, family) = parse::tasks(&args.task)?;
    let tasks = match &args.split {
        None => tasks,
        Some(name) => split(&tasks, parse::part(name)?),
    };
    let Some(first) = tasks.first() else {
        return Err(Error::input("--split", format!("{:?}", args.split), "a part that has tasks"));
    };
    let config = OutcomesConfig {
        latents: parse::latents(&args.latents)?,
        effects: args.effects.iter().map(|e| parse::effect(e)).collect::<Result<_>>()?,
        engine: Engine::from_name(&args.engine)?,
    };
    iplw::error::within("--actions", args.actions as f64, 1.0, 1e6)?;
    let numbers = chosen(first.actions(), args.actions, args.seed)?;
    let actions: Vec<ValidAction> = numbers.iter().map(|i| first.actions().at(*i)).collect::<Result<_>>()?;
    output::directory("--out", &args.out)?;
    let of = json!({
        "format": "iplw.outcomes/1", "version": env!("CARGO_PKG_VERSION"), "family": family.name, "digest": family.digest,
        "latents": config.latents, "effects": config.effects, "engine": config.engine,
        "actions": actions.len(), "seed": args.seed, "codes": {"solved": SOLVED, "unsolved": UNSOLVED, "invalid": INVALID},
        "tasks": tasks.iter().map(|t| json!({"id": t.id, "split": t.split.name()})).collect::<Vec<_>>(),
    });
    let mut table = Table::open(&args.out, &of, [tasks.len(), actions.len()])?;
    let values: Vec<u8> =
        actions.iter().flat_map(|a| a.values().iter().flat_map(|v| v.to_le_bytes())).collect();
    let shape = [actions.len(), first.actions().dimension()];
    output::write_whole(&args.out.join("actions.npy"), &npy("<f8", shape, &values))?;
    fill(&mut table, &tasks, &actions, &config)?;
    let found = table.finish([tasks.len(), actions.len()])?;
    output::print(&told(&tasks, &found, actions.len(), &args.out))
}

fn fill(table: &mut Table, tasks: &[Task], actions: &[ValidAction], config: &OutcomesConfig) -> Result<()> {
    let bar = output::Bar::new();
    let total = (tasks.len() * actions.len()) as u64;
    for (t, task) in tasks.iter().enumerate().skip(table.rows) {
        let before = (t * actions.len()) as u64;
        let mut look = |done: usize| bar.report("outcomes", before + done as u64, total);
        table.add(&outcomes(task, actions, config, &mut look)?)?;
    }
    bar.clear();
    Ok(())
}

fn told(tasks: &[Task], found: &[u8], actions: usize, out: &Path) -> String {
    let count = |row: &[u8], code: i8| row.iter().filter(|o| **o == code as u8).count();
    let rows = || found.chunks_exact(actions);
    let shares: Vec<f64> = rows()
        .map(|row| count(row, SOLVED) as f64 / (row.len() - count(row, INVALID)).max(1) as f64)
        .collect();
    let never = shares.iter().filter(|share| **share == 0.0).count();
    format!(
        "{} tasks, {actions} actions each: {:.1} % cannot be placed; of the others {:.2} % solve ({:.2} to {:.2} % by task); {never} tasks that none solves\ntable: {}\n",
        tasks.len(),
        100.0 * count(found, INVALID) as f64 / found.len() as f64,
        100.0 * shares.iter().sum::<f64>() / shares.len() as f64,
        100.0 * shares.iter().copied().fold(f64::INFINITY, f64::min),
        100.0 * shares.iter().copied().fold(0.0, f64::max),
        out.display()
    )
}

/// A table that is being made: rows are added to `outcomes.part` until all are there.
struct Table {
    folder: PathBuf,
    /// Rows that are there.
    rows: usize,
}

impl Table {
    /// Begins a table of so many tasks and actions, or goes on with one of the same. Another's, and whatever else has its files'
    /// names, is left alone.
    fn open(folder: &Path, of: &Value, [rows, width]: [usize; 2]) -> Result<Table> {
        let mut table = Table { folder: folder.into(), rows: 0 };
        let about = folder.join("outcomes.json");
        let there = ["outcomes.json", "outcomes.npy", "outcomes.part", "actions.npy"]
            .iter()
            .any(|f| folder.join(f).exists());
        if there {
            let text = std::fs::read_to_string(&about).unwrap_or_default();
            if serde_json::from_str::<Value>(&text).ok().as_ref() != Some(of) {
                let allowed = "another directory: there is something else, or a table of other tasks, actions or physics";
                return Err(Error::input("--out", folder.display(), allowed));
            }
            if table.whole().exists() {
                eprintln!("  all of it is there");
                return Ok(Table { rows, ..table });
            }
            table.rows = std::fs::metadata(table.part()).map_or(0, |m| m.len() as usize / width);
        }
        // A row that was half written when the work was stopped is found again.
        let part = OpenOptions::new().create(true).append(true).open(table.part());
        let cut = part.and_then(|part| part.set_len((table.rows * width) as u64));
        cut.map_err(|e| Error::io(&table.part(), e))?;
        if table.rows > 0 {
            eprintln!("  goes on after {} tasks in {}", table.rows, table.part().display());
        }
        output::write_whole(&about, format!("{of:#}\n").as_bytes())?;
        Ok(table)
    }

    fn part(&self) -> PathBuf {
        self.folder.join("outcomes.part")
    }

    fn whole(&self) -> PathBuf {
        self.folder.join("outcomes.npy")
    }

    fn add(&mut self, row: &[i8]) -> Result<()> {
        let bytes: Vec<u8> = row.iter().map(|o| *o as u8).collect();
        let added = OpenOptions::new().append(true).open(self.part()).and_then(|mut part| {
            part.write_all(&bytes)?;
            part.sync_data()
        });
        added.map_err(|e| Error::io(&self.part(), e))?;
        self.rows += 1;
        Ok(())
    }

    /// The array takes the place of its parts; what it holds.
    fn finish(self, [rows, columns]: [usize; 2]) -> Result<Vec<u8>> {
        let read = |path: PathBuf| std::fs::read(&path).map_err(|e| Error::io(&path, e));
        if self.whole().exists() {
            let bytes = read(self.whole())?;
            return match bytes.len().checked_sub(rows * columns) {
                Some(header) => Ok(bytes[header..].to_vec()),
                None => Err(Error::input(
                    "--out",
                    self.whole().display(),
                    "a whole table: this one was cut short",
                )),
            };
        }
        let found = read(self.part())?;
        output::write_whole(&self.whole(), &npy("|i1", [rows, columns], &found))?;
        std::fs::remove_file(self.part()).map_err(|e| Error::io(&self.part(), e))?;
        Ok(found)
    }
}

/// A two-dimensional array as NumPy reads it (version 1.0 of its format), rows one after the other.
fn npy(kind: &str, [rows, columns]: [usize; 2], data: &[u8]) -> Vec<u8> {
    let mut header = format!("{{'descr': '{kind}', 'fortran_order': False, 'shape': ({rows}, {columns}), }}");
    // Data begin at a multiple of 64, after a line's end.
    let length = (10 + header.len() + 1).next_multiple_of(64) - 10;
    header += &" ".repeat(length - 1 - header.len());
    header.push('\n');
    let mut bytes = b"\x93NUMPY\x01\x00".to_vec();
    bytes.extend((length as u16).to_le_bytes());
    bytes.extend(header.as_bytes());
    bytes.extend(data);
    bytes
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn arrays_begin_where_numpy_looks_for_them() {
        let bytes = npy("|i1", [2, 3], &[1, 255, 0, 1, 1, 0]);
        assert_eq!((bytes.len() - 6) % 64, 0);
        assert_eq!(&bytes[..8], b"\x93NUMPY\x01\x00");
        let length = usize::from(u16::from_le_bytes([bytes[8], bytes[9]]));
        let header = std::str::from_utf8(&bytes[10..10 + length]).unwrap();
        assert!(
            header.starts_with("{'descr': '|i1', 'fortran_order': False, 'shape': (2, 3), }")
                && header.ends_with('\n')
        );
        assert_eq!(&bytes[10 + length..], [1, 255, 0, 1, 1, 0]);
    }
}
