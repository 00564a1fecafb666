//! Families beside the built-in ones, for every command that knows families: of collections and of the user's own.

use std::path::{Path, PathBuf};

use iplw::error::{Error, Result};
use iplw::task::{COLLECTIONS, Family, collection, read_families, take_in};

/// Where they are.
#[derive(clap::Args)]
pub struct OwnFamilies {
    /// More families beside bowling and basketball: a collection that comes with the program (`levels`: solved by who knows a
    /// latent; `phyre`: PHYRE's 25 templates of one ball), or a folder of your own, each *.toml with its certified tasks (`iplw tasks
    /// check` makes them). May be repeated. If not given, the environment variable IPLW_TASKS says it, several as in PATH.
    #[arg(long, value_name = "NAME|DIR")]
    tasks: Vec<PathBuf>,
}

impl OwnFamilies {
    /// Takes them in; nothing may have asked for families before.
    pub fn take(&self) -> Result<()> {
        let mut wanted = self.tasks.clone();
        if wanted.is_empty() {
            let said = std::env::var_os("IPLW_TASKS").unwrap_or_default();
            wanted.extend(std::env::split_paths(&said).filter(|p| !p.as_os_str().is_empty()));
        }
        let found = wanted.iter().map(|named| of(named)).collect::<Result<Vec<_>>>()?;
        if found.is_empty() { Ok(()) } else { take_in(found.into_iter().flatten().collect()) }
    }
}

/// The families of a collection's name, or of a folder. (`./levels` is a folder, whatever collections there are.)
fn of(named: &Path) -> Result<Vec<Family>> {
    if let Some(known) = named.to_str().and_then(collection) {
        return known.families();
    }
    if !named.exists() {
        let names: Vec<&str> = COLLECTIONS.iter().map(|c| c.name).collect();
        let allowed = format!("a collection ({}) or a folder of families", names.join(", "));
        return Err(Error::input("--tasks", named.display(), allowed));
    }
    let found = read_families(named)?;
    if found.is_empty() {
        // Somebody may be about to write the first.
        eprintln!(
            "iplw: no families in {}: they are *.toml, each with its certified tasks beside it (`iplw tasks check`)",
            named.display()
        );
    }
    Ok(found)
}
