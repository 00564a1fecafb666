//! Optional collections of built-in families, loaded by name.
//!
//! They are not loaded by default: each family brings two worlds and a hundred tasks, which slows the start.

use super::certificate::CertifiedTasks;
use super::family::Family;
use super::family_file::parse;
use crate::error::Result;

/// A collection: a folder next to this file, of `NAME.toml` and `NAME.certified.json` each.
pub struct Collection {
    pub name: &'static str,
    /// One-sentence description.
    pub about: &'static str,
    /// Each family's file and its certified tasks.
    files: &'static [(&'static str, &'static str)],
}

/// The embedded files of a folder, by family name.
macro_rules! files {
    ($folder:literal: $($name:literal),+ $(,)?) => {
        &[$((
            include_str!(concat!($folder, "/", $name, ".toml")),
            include_str!(concat!($folder, "/", $name, ".certified.json")),
        )),+]
    };
}

/// Every collection.
pub static COLLECTIONS: [Collection; 2] = [
    Collection {
        name: "levels",
        about: "ten families whose solutions depend on friction, restitution or density",
        files: files![
            "levels":
            "carom", "chute", "cradle", "hurdle", "jar", "scales", "seesaw", "shunt", "spin", "uphill",
        ],
    },
    Collection {
        name: "phyre",
        about: "PHYRE-B's 25 single-ball templates, reimplemented",
        files: files![
            "phyre":
            "phyre_00", "phyre_01", "phyre_02", "phyre_03", "phyre_04", "phyre_05", "phyre_06", "phyre_07",
            "phyre_08", "phyre_09", "phyre_10", "phyre_11", "phyre_12", "phyre_13", "phyre_14", "phyre_15", "phyre_16",
            "phyre_17", "phyre_18", "phyre_19", "phyre_20", "phyre_21", "phyre_22", "phyre_23", "phyre_24",
        ],
    },
];

impl Collection {
    /// Parses its families.
    pub fn families(&self) -> Result<Vec<Family>> {
        self.files
            .iter()
            .map(|(text, certified)| parse(text)?.with_tasks(CertifiedTasks::from_json(certified)?))
            .collect()
    }
}

/// The collection named `name`, if any.
pub fn collection(name: &str) -> Option<&'static Collection> {
    COLLECTIONS.iter().find(|c| c.name == name)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn families_are_well_formed_with_unique_names() {
        let mut names = Vec::new();
        for collection in &COLLECTIONS {
            let families = collection.families().unwrap_or_else(|e| panic!("{}: {e}", collection.name));
            names.extend(families.iter().map(|f| f.name));
        }
        names.extend(["bowling", "basketball"]);
        let all = names.len();
        names.sort_unstable();
        names.dedup();
        assert_eq!(names.len(), all);
        assert!(collection("levels").is_some() && collection("none").is_none());
    }
}
