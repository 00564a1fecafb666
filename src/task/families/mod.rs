//! Families of tasks: everything specific to a family is in its file, and all other code iterates over
//! [`families`].
//!
//! A family is one TOML file (scenes, goal, action space, hidden physics, priors, presets, claims of the
//! paper to check), its certified tasks next to it, and one row here. A file of scenes may replace the
//! sampled candidates. [`register_families`] adds users' families. See `docs/how-to/extend.md`.
//!
//! The registry is the one process-wide state of the core: it is filled once, on first use or by
//! [`register_families`], and never changes after that. `folder` is the one file that reads from disk.

mod candidate_sampler;
mod candidate_source;
mod certificate;
mod claims;
mod collections;
mod family;
mod family_file;
mod folder;
mod presets;
mod real;
mod scene_list;
mod template;
#[cfg(test)]
mod tests;

use std::sync::OnceLock;

pub use candidate_sampler::CandidateDraws;
pub use certificate::{
    CANDIDATE_SEED, CERTIFIED_FORMAT, Certificate, CertifiedRow, CertifiedTasks, Selection, SolvingShareBin,
};
pub use claims::{Claims, EstimateClaim, JumpStartClaim};
pub use collections::{COLLECTIONS, Collection, collection, unknown_family};
pub use family::Family;
pub use family_file::{
    DEFAULT_PRIOR, FAMILY_FORMAT, parse as parse_family, parse_beside as parse_family_beside,
};
pub use folder::{certified_beside, read_families, read_family};
pub use presets::{LabelCounts, Learning};
pub(crate) use real::HiddenPhysics;
pub use real::RealPhysics;

use crate::error::{Error, Result};

/// The default family of commands.
pub const DEFAULT_FAMILY: &str = "bowling";

/// The embedded files of each name: `NAME.toml` and `NAME.certified.json`.
macro_rules! built_in {
    ($($name:literal),+ $(,)?) => {
        [$((include_str!(concat!($name, ".toml")), include_str!(concat!($name, ".certified.json")))),+]
    };
}

/// Every built-in family.
static BUILT_IN: [(&str, &str); 2] = built_in!["bowling", "basketball"];

/// Parsed on first use; immutable after that.
static FAMILIES: OnceLock<Vec<&'static Family>> = OnceLock::new();

/// Every family: the built-in ones, then the registered ones.
pub fn families() -> &'static [&'static Family] {
    FAMILIES.get_or_init(built_in)
}

/// Registers additional families. Must be called at most once, before the first call of [`families`].
pub fn register_families(own: Vec<Family>) -> Result<()> {
    let mut all = built_in();
    for family in own {
        if all.iter().any(|f| f.name == family.name) {
            let allowed = "a name that no other family has";
            return Err(Error::input("name", format!("{:?}", family.name), allowed));
        }
        all.push(Box::leak(Box::new(family)));
    }
    let late = || Error::Failed("families can only be registered before the first one is used".into());
    FAMILIES.set(all).map_err(|_| late())
}

/// The family named `name`.
pub fn family(name: &str) -> Result<&'static Family> {
    families()
        .iter()
        .copied()
        .find(|f| f.name == name)
        .ok_or_else(|| unknown_family(name, families().iter().map(|f| f.name)))
}

fn built_in() -> Vec<&'static Family> {
    let read = |(text, certified): &(&str, &str)| -> Result<Family> {
        parse_family(text)?.with_tasks(CertifiedTasks::from_json(certified)?)
    };
    let one = |row| -> &'static Family {
        Box::leak(Box::new(read(row).expect("the families in the crate are well-formed: tested")))
    };
    BUILT_IN.iter().map(one).collect()
}
