//! Families of tasks: everything that is particular to one stands in its file, and everything else iterates
//! [`families`].
//!
//! A family is one TOML file (scenes, goal, action space, what is hidden, priors, presets, which statements of the paper
//! are checked for it), its certified tasks beside it, and one row here. A list of scenes in a file may stand for what is
//! drawn. Files of users are taken in by [`take_in`]. See `docs/extending.md`.

mod certified;
mod claims;
mod collections;
mod draw;
mod expression;
mod family;
mod file;
mod folder;
mod listed;
mod presets;
mod real;
mod source;
mod template;
#[cfg(test)]
mod tests;

use std::sync::OnceLock;

pub use certified::{Bin, CANDIDATE_SEED, CERTIFIED_FORMAT, Certificate, Certified, CertifiedRow, Selection};
pub use claims::{Ahead, Claims, Nearer};
pub use collections::{COLLECTIONS, Collection, collection};
pub use draw::Draws;
pub use family::Family;
pub use file::{FAMILY_FORMAT, parse as parse_family, parse_beside as parse_family_beside};
pub use folder::{certified_beside, read_families, read_family};
pub use presets::{Labels, Learning};
pub use real::RealPhysics;

use crate::error::{Error, Result};

/// The family that commands take if none is named.
pub const DEFAULT_FAMILY: &str = "bowling";

/// Each name: `NAME.toml` and `NAME.certified.json`.
macro_rules! built_in {
    ($($name:literal),+ $(,)?) => {
        [$((include_str!(concat!($name, ".toml")), include_str!(concat!($name, ".certified.json")))),+]
    };
}

/// Every built-in family.
static BUILT_IN: [(&str, &str); 2] = built_in!["bowling", "basketball"];

/// Families last as long as the program: they are read when they are first asked for, and do not change after that.
static FAMILIES: OnceLock<Vec<&'static Family>> = OnceLock::new();

/// Every family: the built-in ones, then those that were taken in.
pub fn families() -> &'static [&'static Family] {
    FAMILIES.get_or_init(built_in)
}

/// Takes families in, beside the built-in ones. Once, before anything asks for families.
pub fn take_in(own: Vec<Family>) -> Result<()> {
    let mut all = built_in();
    for family in own {
        if all.iter().any(|f| f.name == family.name) {
            return Err(Error::input(
                "name",
                format!("{:?}", family.name),
                "a name that no other family has",
            ));
        }
        all.push(Box::leak(Box::new(family)));
    }
    let late = || Error::Failed("families can only be taken in before the first one is asked for".into());
    FAMILIES.set(all).map_err(|_| late())
}

/// The family named `name`.
pub fn family(name: &str) -> Result<&'static Family> {
    families().iter().copied().find(|f| f.name == name).ok_or_else(|| Error::NotFound {
        kind: "task family",
        id: name.to_string(),
        known: families().iter().map(|f| f.name.to_string()).collect(),
    })
}

fn built_in() -> Vec<&'static Family> {
    let read = |(text, certified): &(&str, &str)| -> Result<Family> {
        parse_family(text)?.with(Certified::from_json(certified)?)
    };
    let one = |row| -> &'static Family {
        Box::leak(Box::new(read(row).expect("the families in the crate are well-formed: tested")))
    };
    BUILT_IN.iter().map(one).collect()
}
