//! Reading and validating tables of outcomes.

use std::hash::{DefaultHasher, Hasher};
use std::path::{Path, PathBuf};

use iplw::error::{Error, Result, check_format};
use iplw::policy::OutcomeTable;
use iplw::rng;
use iplw::task::{Task, ValidAction, family};
use serde::Deserialize;
use serde_json::Value;

use crate::cli::arrays::npy::{self, F64, I8};

/// Value of a table's `format`.
pub const FORMAT: &str = "iplw.outcomes/1";

/// A table with its metadata.
pub struct OutcomesTable {
    pub table: OutcomeTable,
    /// Contents of `outcomes.json`.
    pub about: Value,
    /// Digest of the contents, comparable within one build of the program.
    pub digest: u64,
}

/// The required fields of `outcomes.json`.
#[derive(Deserialize)]
struct OutcomesHeader {
    format: String,
    family: String,
    digest: String,
    tasks: Vec<TaskEntry>,
}

#[derive(Deserialize)]
struct TaskEntry {
    id: String,
    /// Digest of the scene, see [`scene_digest`].
    scene: String,
}

/// Digest of a task's scene: scenes may change under the same id when a family is certified again.
pub fn scene_digest(task: &Task) -> String {
    format!("{:016x}", rng::derive_seed(0, &task.scene.to_json(), 0))
}

/// Reads the table in a directory given by `option`.
fn read_table(option: &str, folder: &Path) -> Result<OutcomesTable> {
    read_files(folder).map_err(|e| e.in_file(format!("{option} {}", folder.display())))
}

/// Reads tables of different families, with action vectors of the same length.
pub fn read_all(option: &str, folders: &[PathBuf]) -> Result<Vec<OutcomesTable>> {
    let all: Vec<OutcomesTable> = folders.iter().map(|f| read_table(option, f)).collect::<Result<_>>()?;
    for (i, one) in all.iter().enumerate() {
        let (name, width) = (one.table.family(), |r: &OutcomesTable| r.table.actions()[0].values().len());
        if all[..i].iter().any(|other| other.table.family() == name) {
            return Err(Error::input(option, folders[i].display(), format!("only one table of {name}")));
        }
        if width(one) != width(&all[0]) {
            let value = format!("{} with actions of {} components", folders[i].display(), width(one));
            let allowed = format!(
                "{} components as in {}: the tables have to fit each other",
                width(&all[0]),
                folders[0].display()
            );
            return Err(Error::input(option, value, allowed));
        }
    }
    Ok(all)
}

fn read_files(folder: &Path) -> Result<OutcomesTable> {
    let bytes = |name: &str| {
        let path = folder.join(name);
        std::fs::read(&path).map_err(|e| match e.kind() {
            std::io::ErrorKind::NotFound => {
                let allowed = "a finished table of `iplw outcomes` (run it again to resume)";
                Error::input(name, "not there", allowed)
            }
            _ => Error::io(&path, e),
        })
    };
    let text = bytes("outcomes.json")?;
    let invalid =
        |e: serde_json::Error| Error::input("outcomes.json", format!("{e}"), "what `iplw outcomes` wrote");
    let about: Value = serde_json::from_slice(&text).map_err(invalid)?;
    let header_fields = OutcomesHeader::deserialize(&about).map_err(invalid)?;
    check_format(&header_fields.format, FORMAT)?;
    let family = family(&header_fields.family)?;
    if family.digest != header_fields.digest {
        let allowed = format!("{:?}: {} was changed, recompute its table", family.digest, family.name);
        return Err(Error::input("digest", format!("{:?}", header_fields.digest), allowed));
    }
    let all = family.tasks();
    let find = |named: &TaskEntry| {
        let found = all.iter().find(|t| t.id == named.id).cloned();
        let found = found.ok_or_else(|| {
            Error::input("tasks", format!("{:?}", named.id), format!("tasks of {}", family.name))
        })?;
        if scene_digest(&found) != named.scene {
            let allowed = format!("the current tasks of {}: recompute its table", family.name);
            return Err(Error::input("tasks", format!("{:?} with another scene", named.id), allowed));
        }
        Ok(found)
    };
    let tasks: Vec<Task> = header_fields.tasks.iter().map(find).collect::<Result<_>>()?;
    let (actions, outcomes) = (bytes("actions.npy")?, bytes("outcomes.npy")?);
    let mut hasher = DefaultHasher::new();
    [&text, &actions, &outcomes].into_iter().for_each(|part| hasher.write(part));
    let ([count, width], data) = array("actions.npy", &actions, F64, 8)?;
    let values: Vec<f64> =
        data.chunks_exact(8).map(|b| f64::from_le_bytes(b.try_into().expect("eight bytes"))).collect();
    let space = family.tasks().first().map(|t| t.actions().clone());
    let action = |v: &[f64]| -> Result<ValidAction> {
        space.as_ref().ok_or_else(|| Error::Failed("a family without tasks".into()))?.validate(v)
    };
    let actions = values.chunks(width.max(1)).map(action).collect::<Result<Vec<_>>>();
    let actions = actions.map_err(|e| e.in_field("actions.npy"))?;
    let (shape, data) = array("outcomes.npy", &outcomes, I8, 1)?;
    if shape != [tasks.len(), count] {
        let allowed = format!("[{}, {count}]: tasks and actions of this table", tasks.len());
        return Err(Error::input("outcomes.npy shape", format!("{shape:?}"), allowed));
    }
    let outcomes = data.iter().map(|b| *b as i8).collect();
    let table = OutcomeTable::new(family.name, tasks, actions, outcomes)?;
    Ok(OutcomesTable { table, about, digest: hasher.finish() })
}

/// Shape and data of a two-dimensional array.
fn array<'a>(file: &str, bytes: &'a [u8], kind: &str, size: usize) -> Result<([usize; 2], &'a [u8])> {
    let (shape, data) = npy::parse(file, bytes, kind, size)?;
    let [rows, columns] = shape[..] else {
        return Err(Error::input(file, format!("an array of shape {shape:?}"), "an array of two dimensions"));
    };
    Ok(([rows, columns], data))
}
