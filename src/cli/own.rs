//! Families of the user's own, for every command that knows families.

use std::path::PathBuf;

use iplw::error::Result;
use iplw::task::{read_families, take_in};

/// Where they are.
#[derive(clap::Args)]
pub struct OwnFamilies {
    /// A folder of families of your own, which stand beside the built-in ones: each *.toml with its certified tasks (`iplw tasks
    /// check` makes them). If not given, the environment variable IPLW_TASKS says it.
    #[arg(long, value_name = "DIR")]
    tasks: Option<PathBuf>,
}

impl OwnFamilies {
    /// Takes them in; nothing may have asked for families before.
    pub fn take(&self) -> Result<()> {
        let named = || std::env::var_os("IPLW_TASKS").filter(|v| !v.is_empty()).map(PathBuf::from);
        match self.tasks.clone().or_else(named) {
            Some(folder) => take_in(read_families(&folder)?),
            None => Ok(()),
        }
    }
}
