//! Families of tasks: everything that is particular to one stands in its file, and everything else iterates
//! [`FAMILIES`].
//!
//! A family is one file (scenes, goal, action space, what is hidden, priors, presets, which statements of the paper are
//! checked for it), its certified tasks beside it, and one row here. See `docs/extending.md`.

mod basketball;
mod bowling;
mod certified;
mod claims;
mod family;
mod presets;
mod real;

pub use certified::{CANDIDATE_SEED, Certificate, CertifiedRow, Selection};
pub use claims::{Ahead, Claims, Nearer};
pub use family::Family;
pub use presets::{Labels, Learning};
pub use real::RealPhysics;

use crate::error::{Error, Result};

/// Every built-in task family.
pub static FAMILIES: [&Family; 2] = [&bowling::FAMILY, &basketball::FAMILY];

/// The family named `name`.
pub fn family(name: &str) -> Result<&'static Family> {
    FAMILIES.iter().copied().find(|f| f.name == name).ok_or_else(|| Error::NotFound {
        kind: "task family",
        id: name.to_string(),
        known: FAMILIES.iter().map(|f| f.name.to_string()).collect(),
    })
}
