//! Task families in addition to the built-in ones: collections and directories of the user.

use std::path::{Path, PathBuf};

use iplw::error::{Error, Result};
use iplw::task::{COLLECTIONS, Family, collection, read_families, register_families};

/// Heading of the options that all commands share, in the help of each command.
pub const COMMON_OPTIONS: &str = "Common options (details: `iplw --help`)";

// Sources of additional task families.
#[derive(clap::Args)]
pub struct TaskSources {
    /// Additional task families: levels, phyre, or a directory; may be repeated [default: $IPLW_TASKS]
    #[arg(long, value_name = "NAME|DIR", help_heading = COMMON_OPTIONS)]
    tasks: Vec<PathBuf>,
}

impl TaskSources {
    /// Registers the families; must be called before any family is looked up.
    pub fn load(&self) -> Result<()> {
        let mut sources = self.tasks.clone();
        if sources.is_empty() {
            let variable = std::env::var_os("IPLW_TASKS").unwrap_or_default();
            sources.extend(std::env::split_paths(&variable).filter(|p| !p.as_os_str().is_empty()));
        }
        let found = sources.iter().map(|source| families_of(source)).collect::<Result<Vec<_>>>()?;
        if found.is_empty() { Ok(()) } else { register_families(found.into_iter().flatten().collect()) }
    }
}

/// The families of a collection or of a directory. (`./levels` is always a directory.)
fn families_of(source: &Path) -> Result<Vec<Family>> {
    if let Some(known) = source.to_str().and_then(collection) {
        return known.families();
    }
    if !source.exists() {
        let names: Vec<&str> = COLLECTIONS.iter().map(|c| c.name).collect();
        let allowed = format!("a collection ({}) or a directory of families", names.join(", "));
        return Err(Error::input("--tasks", source.display(), allowed));
    }
    let found = read_families(source)?;
    if found.is_empty() {
        // A warning only: the user may be writing the first family.
        eprintln!(
            "iplw: no families in {}: it should contain *.toml files with their certified tasks (see `iplw tasks check`)",
            source.display()
        );
    }
    Ok(found)
}
