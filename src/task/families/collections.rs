//! Optional collections of built-in families, loaded by name.
//!
//! They are not loaded by default: each family brings two worlds and a hundred tasks, which slows the start.

use super::certificate::CertifiedTasks;
use super::family::Family;
use super::family_file::parse;
use crate::error::{Error, Result};

/// A collection: a folder next to this file, of `NAME.toml` and `NAME.certified.json` each.
pub struct Collection {
    pub name: &'static str,
    /// One-sentence description.
    pub about: &'static str,
    /// Each family's name, its file and its certified tasks.
    files: &'static [(&'static str, &'static str, &'static str)],
}

/// The embedded files of a folder, by family name.
macro_rules! files {
    ($folder:literal: $($name:literal),+ $(,)?) => {
        &[$((
            $name,
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
            .map(|(_, text, certified)| parse(text)?.with_tasks(CertifiedTasks::from_json(certified)?))
            .collect()
    }
}

/// The error of a family that is not among those loaded; a family of a collection names the option that loads it.
pub fn unknown_family<'a>(name: &str, loaded: impl Iterator<Item = &'a str>) -> Error {
    let own = COLLECTIONS.iter().find(|c| c.files.iter().any(|file| file.0 == name));
    let hint = own.map(|c| format!("{name} with `--tasks {}`", c.name));
    Error::not_found("task family", name, loaded.map(String::from).chain(hint))
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
            assert!(families.iter().map(|f| f.name).eq(collection.files.iter().map(|file| file.0)));
            names.extend(families.iter().map(|f| f.name));
        }
        names.extend(["bowling", "basketball"]);
        let all = names.len();
        names.sort_unstable();
        names.dedup();
        assert_eq!(names.len(), all);
        assert!(collection("levels").is_some() && collection("none").is_none());
    }

    #[test]
    fn families_of_collections_name_the_option_that_loads_them() {
        let text = |name| unknown_family(name, ["bowling"].into_iter()).to_string();
        assert!(text("carom").ends_with("known: bowling, carom with `--tasks levels`"), "{}", text("carom"));
        assert!(text("crom").ends_with("known: bowling"), "{}", text("crom"));
    }
}
