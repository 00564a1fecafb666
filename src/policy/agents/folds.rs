//! Which tasks are learned from and which are tried.
//!
//! Source: PHYRE's settings (Bakhtin et al. 2019, section 3): *within template*, 80 % of the tasks of each template are
//! learned from and the rest are tried; *across templates*, 80 % of the templates, and tasks of the others are tried. Ten folds.

use rand::seq::SliceRandom;
use serde::{Deserialize, Serialize};

use crate::error::{Error, Result};
use crate::policy::table::{Place, Table};
use crate::rng;

/// What is new about test tasks.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Setting {
    /// Other tasks of families that were learned from.
    Within,
    /// Families that were not.
    Across,
}

/// One way to deal tasks to learning and trying.
#[derive(Clone, Debug, PartialEq)]
pub struct Fold {
    pub setting: Setting,
    /// From 0.
    pub number: usize,
    /// Decides the deal, and everything random about agents in this fold.
    pub seed: u64,
    pub train: Vec<Place>,
    pub test: Vec<Place>,
}

/// Share that is learned from.
const LEARNED: f64 = 0.8;

impl Setting {
    /// Both.
    pub const ALL: [Setting; 2] = [Setting::Within, Setting::Across];

    /// The name used on the command line and in results.
    pub fn name(self) -> &'static str {
        match self {
            Setting::Within => "within",
            Setting::Across => "across",
        }
    }

    /// The setting of that name.
    pub fn from_name(name: &str) -> Result<Setting> {
        let found = Setting::ALL.into_iter().find(|s| s.name() == name);
        found.ok_or_else(|| Error::input("setting", format!("{name:?}"), "within, across"))
    }
}

/// Fold `number` of tables, each of another family. It depends on the seed, on the families' names and on how many tasks
/// they have, and not on the order of the tables.
pub fn fold(tables: &[Table], setting: Setting, number: usize, seed: u64) -> Result<Fold> {
    let seed = rng::derive(seed, "agents fold", number as u64);
    let all = |table: usize| (0..tables[table].tasks().len()).map(move |task| Place { table, task });
    let (mut train, mut test) = (Vec::new(), Vec::new());
    match setting {
        Setting::Within => {
            for (t, table) in tables.iter().enumerate() {
                let own = rng::derive(seed, table.family(), 0);
                let mut places: Vec<Place> = all(t).collect();
                places.shuffle(&mut rng::stream(own, "agents within"));
                let learned = dealt(places.len()).ok_or_else(|| {
                    let field = format!("tasks of {}", table.family());
                    Error::input(field, places.len(), "at least 2, to learn from some and try others")
                })?;
                test.extend(places.split_off(learned));
                train.extend(places);
            }
        }
        Setting::Across => {
            let mut families: Vec<usize> = (0..tables.len()).collect();
            families.sort_by_key(|t| tables[*t].family());
            families.shuffle(&mut rng::stream(seed, "agents across"));
            let learned = dealt(families.len()).ok_or_else(|| {
                let allowed = "at least 2, to learn from some and try others; or the setting within";
                Error::input("families for across", families.len(), allowed)
            })?;
            test.extend(families[learned..].iter().flat_map(|t| all(*t)));
            train.extend(families[..learned].iter().flat_map(|t| all(*t)));
        }
    }
    train.sort_unstable();
    test.sort_unstable();
    Ok(Fold { setting, number, seed, train, test })
}

/// How many of `n` are learned from: at least one, and one is left; `None` where that cannot be.
fn dealt(n: usize) -> Option<usize> {
    let learned = (LEARNED * n as f64).round() as usize;
    (n >= 2).then(|| learned.clamp(1, n - 1))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::policy::toy;

    fn tables(families: usize, tasks: usize) -> Vec<Table> {
        let one = |f: usize| toy::table(&format!("f{f}"), &toy::tasks(tasks), 2, |_, i| [1, -1][i]);
        (0..families).map(one).collect()
    }

    #[test]
    fn shares_are_those_of_the_protocol_and_nothing_is_learned_and_tried() {
        let tables = tables(10, 20);
        for setting in Setting::ALL {
            let folds: Vec<Fold> = (0..10).map(|k| fold(&tables, setting, k, 1).unwrap()).collect();
            for f in &folds {
                assert_eq!((f.train.len(), f.test.len()), (160, 40));
                assert!(f.train.iter().all(|p| !f.test.contains(p)));
                let families = |places: &[Place]| {
                    let mut all: Vec<usize> = places.iter().map(|p| p.table).collect();
                    all.dedup();
                    all
                };
                let (learned, tried) = (families(&f.train), families(&f.test));
                match setting {
                    Setting::Within => assert!(learned.len() == 10 && tried.len() == 10),
                    Setting::Across => {
                        assert_eq!((learned.len(), tried.len()), (8, 2));
                        assert!(tried.iter().all(|t| !learned.contains(t)));
                    }
                }
            }
            assert!(folds.iter().any(|f| f.test != folds[0].test));
            assert_ne!(fold(&tables, setting, 0, 2).unwrap().test, folds[0].test);
        }
    }

    #[test]
    fn the_order_of_tables_does_not_matter() {
        let tables = tables(5, 6);
        let turned: Vec<Table> = tables.iter().rev().cloned().collect();
        for setting in Setting::ALL {
            let ids = |tables: &[Table]| {
                let f = fold(tables, setting, 3, 7).unwrap();
                let mut ids: Vec<String> =
                    f.test.iter().map(|p| tables[p.table].tasks()[p.task].id.clone()).collect();
                ids.sort_unstable();
                ids
            };
            assert_eq!(ids(&tables), ids(&turned));
        }
    }

    #[test]
    fn too_little_to_deal_is_refused() {
        let refused = |tables: &[Table], setting, wanted: &str| {
            let error = fold(tables, setting, 0, 0).unwrap_err().to_string();
            assert!(error.contains(wanted), "{error}");
        };
        refused(&tables(1, 5), Setting::Across, "`families for across` is 1");
        refused(&tables(2, 1), Setting::Within, "tasks of f0");
        let two = fold(&tables(2, 2), Setting::Across, 0, 0).unwrap();
        assert_eq!((two.train.len(), two.test.len()), (2, 2));
    }
}
