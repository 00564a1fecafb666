//! Reading tables back: whole, of a family that is still the same, and with actions that are some.

use std::hash::{DefaultHasher, Hasher};
use std::path::{Path, PathBuf};

use iplw::error::{Error, Result};
use iplw::policy::Table;
use iplw::rng;
use iplw::task::{Task, ValidAction, family};
use serde::Deserialize;
use serde_json::Value;

/// Value of a table's `format`.
pub const FORMAT: &str = "iplw.outcomes/1";

/// A table with what is known of it.
pub struct Read {
    pub table: Table,
    /// What `outcomes.json` says.
    pub about: Value,
    /// Another for other contents, within one build of the program.
    pub digest: u64,
}

/// What of `outcomes.json` is needed.
#[derive(Deserialize)]
struct About {
    format: String,
    family: String,
    digest: String,
    tasks: Vec<Named>,
}

#[derive(Deserialize)]
struct Named {
    id: String,
    /// As [`scene`] tells it.
    scene: String,
}

/// Another for another scene: a family whose tasks were certified anew has other scenes under the same names.
pub fn scene(task: &Task) -> String {
    format!("{:016x}", rng::derive(0, &task.scene.to_json(), 0))
}

/// The table in a directory that `option` named.
fn read(option: &str, folder: &Path) -> Result<Read> {
    read_files(folder).map_err(|e| e.at(format!("{option} {}", folder.display())))
}

/// The tables in directories, of one family each, with action vectors of one length.
pub fn read_all(option: &str, folders: &[PathBuf]) -> Result<Vec<Read>> {
    let all: Vec<Read> = folders.iter().map(|f| read(option, f)).collect::<Result<_>>()?;
    for (i, one) in all.iter().enumerate() {
        let (name, width) = (one.table.family(), |r: &Read| r.table.actions()[0].values().len());
        if all[..i].iter().any(|other| other.table.family() == name) {
            return Err(Error::input(
                option,
                folders[i].display(),
                format!("one table of {name}: there are two"),
            ));
        }
        if width(one) != width(&all[0]) {
            let value = format!("{} with actions of {} components", folders[i].display(), width(one));
            let allowed =
                format!("{} as in {}: tables that fit each other", width(&all[0]), folders[0].display());
            return Err(Error::input(option, value, allowed));
        }
    }
    Ok(all)
}

fn read_files(folder: &Path) -> Result<Read> {
    let bytes = |name: &str| {
        let path = folder.join(name);
        std::fs::read(&path).map_err(|e| match e.kind() {
            std::io::ErrorKind::NotFound => {
                let allowed = "a finished table, which `iplw outcomes` makes (begun again, it goes on)";
                Error::input(name, "not there", allowed)
            }
            _ => Error::io(&path, e),
        })
    };
    let text = bytes("outcomes.json")?;
    let whole =
        |e: serde_json::Error| Error::input("outcomes.json", format!("{e}"), "what `iplw outcomes` wrote");
    let about: Value = serde_json::from_slice(&text).map_err(whole)?;
    let known = About::deserialize(&about).map_err(whole)?;
    if known.format != FORMAT {
        return Err(Error::input("format", format!("{:?}", known.format), format!("{FORMAT:?}")));
    }
    let family = family(&known.family)?;
    if family.digest != known.digest {
        let allowed = format!("{:?}: {} was changed, make its table anew", family.digest, family.name);
        return Err(Error::input("digest", format!("{:?}", known.digest), allowed));
    }
    let all = family.tasks();
    let find = |named: &Named| {
        let found = all.iter().find(|t| t.id == named.id).cloned();
        let found = found.ok_or_else(|| {
            Error::input("tasks", format!("{:?}", named.id), format!("tasks of {}", family.name))
        })?;
        if scene(&found) != named.scene {
            let allowed = format!("tasks of {} as they are now: make its table anew", family.name);
            return Err(Error::input("tasks", format!("{:?} with another scene", named.id), allowed));
        }
        Ok(found)
    };
    let tasks: Vec<Task> = known.tasks.iter().map(find).collect::<Result<_>>()?;
    let (actions, outcomes) = (bytes("actions.npy")?, bytes("outcomes.npy")?);
    let mut hasher = DefaultHasher::new();
    [&text, &actions, &outcomes].into_iter().for_each(|part| hasher.write(part));
    let ([count, width], data) = array("actions.npy", &actions, "<f8", 8)?;
    let values: Vec<f64> =
        data.chunks_exact(8).map(|b| f64::from_le_bytes(b.try_into().expect("eight bytes"))).collect();
    let space = family.tasks().first().map(|t| t.actions().clone());
    let action = |v: &[f64]| -> Result<ValidAction> {
        space.as_ref().ok_or_else(|| Error::Failed("a family without tasks".into()))?.validate(v)
    };
    let actions = values.chunks(width.max(1)).map(action).collect::<Result<Vec<_>>>();
    let actions = actions.map_err(|e| e.under("actions.npy"))?;
    let (shape, data) = array("outcomes.npy", &outcomes, "|i1", 1)?;
    if shape != [tasks.len(), count] {
        let allowed = format!("[{}, {count}]: tasks and actions of this table", tasks.len());
        return Err(Error::input("outcomes.npy shape", format!("{shape:?}"), allowed));
    }
    let outcomes = data.iter().map(|b| *b as i8).collect();
    let table = Table::new(family.name, tasks, actions, outcomes)?;
    Ok(Read { table, about, digest: hasher.finish() })
}

/// Shape and data of a two-dimensional array as `iplw outcomes`, or NumPy's `save`, writes it.
fn array<'a>(file: &str, bytes: &'a [u8], kind: &str, size: usize) -> Result<([usize; 2], &'a [u8])> {
    let refused = |value: &str| {
        Error::input(file, value, format!("a whole two-dimensional NumPy array of type {kind:?}, rows first"))
    };
    let fixed =
        bytes.get(..10).filter(|b| b.starts_with(b"\x93NUMPY\x01")).ok_or_else(|| refused("no array"))?;
    let length = usize::from(u16::from_le_bytes([fixed[8], fixed[9]]));
    let header = bytes.get(10..10 + length).and_then(|b| std::str::from_utf8(b).ok());
    let header = header.ok_or_else(|| refused("an array whose header is cut short"))?;
    let said = |text: &str| header.contains(text);
    if !(said(&format!("'descr': '{kind}'")) && said("'fortran_order': False")) {
        return Err(refused("an array of another type or order"));
    }
    let inner = header.split_once("'shape': (").and_then(|(_, rest)| rest.split_once(')'));
    let shape: Vec<usize> =
        inner.map_or("", |(s, _)| s).split(',').filter_map(|n| n.trim().parse().ok()).collect();
    let [rows, columns] = shape[..] else { return Err(refused("an array of another shape")) };
    let data = &bytes[10 + length..];
    match rows.checked_mul(columns).and_then(|n| n.checked_mul(size)) {
        Some(wanted) if wanted == data.len() => Ok(([rows, columns], data)),
        _ => Err(refused(&format!("an array of {rows} by {columns} that holds {} bytes", data.len()))),
    }
}

#[cfg(test)]
mod tests {
    use super::super::table::npy;
    use super::*;

    #[test]
    fn arrays_read_back_what_was_written_and_nothing_else() {
        let bytes = npy("|i1", [2, 3], &[1, 255, 0, 1, 1, 0]);
        assert_eq!(array("a", &bytes, "|i1", 1).unwrap(), ([2, 3], &[1, 255, 0, 1, 1, 0][..]));
        let longer = [bytes.clone(), vec![0]].concat();
        let fortran = String::from_utf8_lossy(&bytes[10..]).replace("False", "True ");
        let turned = [&bytes[..10], fortran.as_bytes()].concat();
        for (broken, kind) in
            [(&bytes[..bytes.len() - 1], "|i1"), (&bytes[..40], "|i1"), (&bytes[..5], "|i1"), (&bytes, "<f8")]
        {
            assert!(array("a", broken, kind, 1).is_err(), "{} bytes as {kind}", broken.len());
        }
        assert!(array("a", &longer, "|i1", 1).is_err() && array("a", &turned, "|i1", 1).is_err());
        assert!(array("a", &npy("|i1", [usize::MAX, 2], &[]), "|i1", 1).is_err());
    }
}
