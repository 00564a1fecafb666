//! Cross-validation folds: training and test tasks.
//!
//! Source: PHYRE's generalization settings (Bakhtin et al. 2019, section 3), ten folds each. *Within template*: 80 % of the tasks of
//! each template are for training, the rest for testing. *Across templates*: 80 % of the templates are for training, the others
//! for testing.

use rand::seq::SliceRandom;
use serde::{Deserialize, Serialize};

use crate::error::{Error, Result};
use crate::names::names;
use crate::policy::outcome_table::{OutcomeTable, TaskIndex};
use crate::rng;

/// Generalization setting: relation between training and test tasks.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum GeneralizationSetting {
    /// Test tasks are new tasks of the training families.
    Within,
    /// Test tasks are of new families.
    Across,
}

/// A split of tasks into training and test tasks.
#[derive(Clone, Debug, PartialEq)]
pub struct Fold {
    pub setting: GeneralizationSetting,
    /// Number of the fold, from 0.
    pub number: usize,
    /// Seed of the split and of the agents in this fold.
    pub seed: u64,
    pub train: Vec<TaskIndex>,
    pub test: Vec<TaskIndex>,
}

/// Training share.
const TRAINING_SHARE: f64 = 0.8;

names!(GeneralizationSetting: Within = "within", Across = "across");

impl GeneralizationSetting {
    /// The setting called `name`.
    pub fn from_name(name: &str) -> Result<GeneralizationSetting> {
        GeneralizationSetting::named(name)
            .ok_or_else(|| Error::input("setting", format!("{name:?}"), "within, across"))
    }
}

/// Fold `number` of tables of distinct families. It depends on the seed, the families' names and their numbers of tasks, but not
/// on the order of the tables.
pub fn fold(
    tables: &[OutcomeTable],
    setting: GeneralizationSetting,
    number: usize,
    seed: u64,
) -> Result<Fold> {
    let seed = rng::derive_seed(seed, "agents fold", number as u64);
    let all = |table: usize| (0..tables[table].tasks().len()).map(move |task| TaskIndex { table, task });
    let (mut train, mut test) = (Vec::new(), Vec::new());
    match setting {
        GeneralizationSetting::Within => {
            for (t, table) in tables.iter().enumerate() {
                let own = rng::derive_seed(seed, table.family(), 0);
                let mut places: Vec<TaskIndex> = all(t).collect();
                places.shuffle(&mut rng::stream(own, "agents within"));
                let learned = fold_assignment(places.len()).ok_or_else(|| {
                    let field = format!("tasks of {}", table.family());
                    Error::input(field, places.len(), "at least 2, for training and testing")
                })?;
                test.extend(places.split_off(learned));
                train.extend(places);
            }
        }
        GeneralizationSetting::Across => {
            let mut families: Vec<usize> = (0..tables.len()).collect();
            families.sort_by_key(|t| tables[*t].family());
            families.shuffle(&mut rng::stream(seed, "agents across"));
            let learned = fold_assignment(families.len()).ok_or_else(|| {
                let allowed = "at least 2, for training and testing; or the setting within";
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

/// Number of training items of `n`, with at least one training and one test item; `None` if that is impossible.
fn fold_assignment(n: usize) -> Option<usize> {
    let learned = (TRAINING_SHARE * n as f64).round() as usize;
    (n >= 2).then(|| learned.clamp(1, n - 1))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::policy::toy;

    fn tables(families: usize, tasks: usize) -> Vec<OutcomeTable> {
        let one = |f: usize| toy::table(&format!("f{f}"), &toy::tasks(tasks), 2, |_, i| [1, -1][i]);
        (0..families).map(one).collect()
    }

    #[test]
    fn folds_match_protocol_and_are_disjoint() {
        let tables = tables(10, 20);
        for setting in GeneralizationSetting::ALL {
            let folds: Vec<Fold> = (0..10).map(|k| fold(&tables, setting, k, 1).unwrap()).collect();
            for f in &folds {
                assert_eq!((f.train.len(), f.test.len()), (160, 40));
                assert!(f.train.iter().all(|p| !f.test.contains(p)));
                let families = |places: &[TaskIndex]| {
                    let mut all: Vec<usize> = places.iter().map(|p| p.table).collect();
                    all.dedup();
                    all
                };
                let (learned, tried) = (families(&f.train), families(&f.test));
                match setting {
                    GeneralizationSetting::Within => assert!(learned.len() == 10 && tried.len() == 10),
                    GeneralizationSetting::Across => {
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
    fn folds_are_independent_of_table_order() {
        let tables = tables(5, 6);
        let turned: Vec<OutcomeTable> = tables.iter().rev().cloned().collect();
        for setting in GeneralizationSetting::ALL {
            let ids = |tables: &[OutcomeTable]| {
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
    fn rejects_too_few_items() {
        let refused = |tables: &[OutcomeTable], setting, wanted: &str| {
            let error = fold(tables, setting, 0, 0).unwrap_err().to_string();
            assert!(error.contains(wanted), "{error}");
        };
        refused(&tables(1, 5), GeneralizationSetting::Across, "`families for across` is 1");
        refused(&tables(2, 1), GeneralizationSetting::Within, "tasks of f0");
        let two = fold(&tables(2, 2), GeneralizationSetting::Across, 0, 0).unwrap();
        assert_eq!((two.train.len(), two.test.len()), (2, 2));
    }
}
