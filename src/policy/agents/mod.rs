//! Agents over many families, and their comparison without a simulator.
//!
//! Every task allows 100 attempts; an action that cannot be placed is not an attempt. Agents are trained on the training tasks of a
//! fold and rank the table's actions for its test tasks.
//!
//! Source: PHYRE (Bakhtin et al. 2019, sections 3 and 5).
//!
//! Differences from the source: all actions of a table are ranked (PHYRE's DQN ranks 10,000 of 100,000); the folds differ.
//!
//! An agent is one file and one row of [`agents`].

mod agent;
mod dqn;
mod folds;
mod memory;
mod random;
mod simulate;

use std::collections::BTreeMap;

use rand::seq::SliceRandom;
use serde::{Deserialize, Serialize};

use super::auccess::auccess;
use super::outcome_table::TaskIndex;
use super::outcomes::{INVALID, SOLVED};
use crate::error::{Error, Result};
use crate::progress::Progress;
use crate::rng;
pub use agent::{Agent, AgentsConfig, Ranker, TrainingSet};
pub use folds::{Fold, GeneralizationSetting, fold};

/// All agents.
pub fn agents() -> [Agent; 4] {
    [random::AGENT, memory::AGENT, dqn::AGENT, simulate::AGENT]
}

/// Result of an agent in a fold.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct FoldResult {
    /// AUCCESS over the test tasks, in [0, 1].
    pub auccess: f64,
    /// Upper bound of AUCCESS: the share of test tasks that any action of the table solves.
    pub best: f64,
    /// AUCCESS by family.
    pub families: BTreeMap<String, f64>,
    /// First solving attempt of each test task, from 1; `None` if none of 100 solves it.
    pub solved_at: Vec<(String, Option<usize>)>,
}

/// The agent called `name`.
pub fn agent(name: &str) -> Result<Agent> {
    agents()
        .into_iter()
        .find(|a| a.name == name)
        .ok_or_else(|| Error::not_found("agent", name, agents().iter().map(|a| a.name)))
}

/// Trains an agent on a fold's training tasks and evaluates its ranking on the test tasks. The result depends on the seed, but not on
/// the number of threads.
pub fn evaluate_agent(agent: &Agent, lessons: &TrainingSet, progress: &dyn Progress) -> Result<FoldResult> {
    if agent.simulates && lessons.posteriors.len() != lessons.tables.len() {
        let allowed = "a table of simulated outcomes of the same actions, for each family";
        return Err(Error::input("posteriors", format!("{} tables", lessons.posteriors.len()), allowed));
    }
    let ranks = (agent.learn)(lessons, progress)?;
    let test = &lessons.fold.test;
    let mut solved_at = Vec::with_capacity(test.len());
    let mut best = 0;
    for (i, place) in test.iter().enumerate() {
        progress.report("try", i as u64, test.len() as u64)?;
        let table = &lessons.tables[place.table];
        let order = order(&ranks.scores(*place)?, table.row(place.task), seed_of(lessons, *place));
        solved_at.push(table.solved_at(place.task, &order));
        best += usize::from(table.row(place.task).contains(&SOLVED));
    }
    progress.report("try", test.len() as u64, test.len() as u64)?;
    let mut families: BTreeMap<String, Vec<Option<usize>>> = BTreeMap::new();
    for (place, at) in test.iter().zip(&solved_at) {
        families.entry(lessons.tables[place.table].family().into()).or_default().push(*at);
    }
    let name = |place: &TaskIndex| lessons.tables[place.table].tasks()[place.task].id.clone();
    Ok(FoldResult {
        auccess: auccess(&solved_at),
        best: best as f64 / test.len().max(1) as f64,
        families: families.into_iter().map(|(family, at)| (family, auccess(&at))).collect(),
        solved_at: test.iter().map(name).zip(solved_at).collect(),
    })
}

fn seed_of(lessons: &TrainingSet, place: TaskIndex) -> u64 {
    rng::derive_seed(lessons.fold.seed, &lessons.tables[place.table].tasks()[place.task].id, 0)
}

/// Valid actions by decreasing score, NaN last; ties are in random order.
fn order(scores: &[f32], row: &[i8], seed: u64) -> Vec<usize> {
    let mut order: Vec<usize> = (0..row.len()).filter(|i| row[*i] != INVALID).collect();
    order.shuffle(&mut rng::stream(seed, "agents ties"));
    let key = |i: usize| if scores[i].is_nan() { f32::NEG_INFINITY } else { scores[i] };
    order.sort_by(|a, b| key(*b).total_cmp(&key(*a)));
    order
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::policy::outcome_table::OutcomeTable;
    use crate::policy::{TrainConfig, toy};
    use crate::progress::NoProgress;

    fn config() -> AgentsConfig {
        let train = TrainConfig { batches: 250, batch_size: 16, learning_rate: 3e-3, hidden: 32, seed: 0 };
        AgentsConfig { per_task: 300, train, ..AgentsConfig::standard() }
    }

    /// Five families of the toy rule.
    fn tables() -> Vec<OutcomeTable> {
        (0..5).map(|f| toy::ruled(&format!("f{f}"), &toy::tasks(5), 400)).collect()
    }

    fn result_of(
        name: &str,
        tables: &[OutcomeTable],
        posteriors: &[OutcomeTable],
        setting: GeneralizationSetting,
    ) -> FoldResult {
        let fold = fold(tables, setting, 0, 1).unwrap();
        let lessons = TrainingSet { tables, posteriors, fold: &fold, config: &config() };
        evaluate_agent(&agent(name).unwrap(), &lessons, &NoProgress).unwrap()
    }

    #[test]
    fn agents_generalize_within_and_across_families() {
        let tables = tables();
        for setting in GeneralizationSetting::ALL {
            let of = |name: &str| result_of(name, &tables, &tables, setting);
            let [random, dqn, simulate] = ["random", "dqn", "simulate"].map(|name| of(name).auccess);
            assert!((0.1..0.75).contains(&random), "{random}");
            assert!(dqn > random + 0.15, "{setting:?}: {dqn}, random {random}");
            assert_eq!(simulate, 1.0, "an exact simulation needs one attempt");
            let one = of("random");
            assert_eq!(one.solved_at.len(), 5);
            assert!(
                one.best == 1.0
                    && one.families.len() == if setting == GeneralizationSetting::Within { 5 } else { 1 }
            );
        }
    }

    /// The first action solves all tasks of a family except one, the second solves only that one.
    #[test]
    fn memory_ranks_by_solving_frequency() {
        let one = |f: usize| {
            let solves = move |t: usize, i: usize| i == if t == 0 { 399 } else { 7 + f };
            toy::table(&format!("f{f}"), &toy::tasks(10), 400, move |t, i| if solves(t, i) { 1 } else { -1 })
        };
        let tables: Vec<OutcomeTable> = (0..5).map(one).collect();
        let within = result_of("memory", &tables, &[], GeneralizationSetting::Within);
        for (id, at) in &within.solved_at {
            let odd = toy::tasks(10)[0].id.replace("toy", "");
            assert!(at == &Some(1) || id.ends_with(&odd), "{id} at {at:?}");
        }
        // Across families a different action solves: those of the four training families come first.
        let across = result_of("memory", &tables, &[], GeneralizationSetting::Across);
        let first = across.solved_at.iter().filter(|(_, at)| *at == Some(1)).count();
        assert_eq!((first, across.families.len()), (0, 1));
        assert!(across.solved_at.iter().any(|(_, at)| at.is_some_and(|k| k <= 5)), "the odd action");
    }

    /// If the simulation misses half of the solving actions, their neighbours still rank them first.
    #[test]
    fn neighbours_compensate_simulation_errors() {
        let real: Vec<OutcomeTable> = tables().into_iter().take(2).collect();
        let forgets = |table: &OutcomeTable| {
            let tasks = toy::tasks(5);
            let row = |t: usize, i: usize| {
                if i.is_multiple_of(2) && table.row(t)[i] == 1 { -1 } else { table.row(t)[i] }
            };
            toy::table(table.family(), &tasks, 400, row)
        };
        let believed: Vec<OutcomeTable> = real.iter().map(forgets).collect();
        let wrong = |table: &OutcomeTable| {
            let tasks = toy::tasks(5);
            toy::table(table.family(), &tasks, 400, |t, i| if i % 2 == 0 { -table.row(t)[i] } else { -1 })
        };
        let turned: Vec<OutcomeTable> = real.iter().map(wrong).collect();
        let [good, bad] = [&believed, &turned]
            .map(|b| result_of("simulate", &real, b, GeneralizationSetting::Within).auccess);
        assert!(good > 0.95 && bad < 0.5, "{good}, {bad}");
    }

    #[test]
    fn results_are_independent_of_threads() {
        let tables = tables();
        for name in agents().map(|a| a.name) {
            let run = |threads: usize| {
                let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
                pool.install(|| result_of(name, &tables, &tables, GeneralizationSetting::Across))
            };
            assert_eq!(run(1), run(3), "{name}");
        }
    }

    #[test]
    fn rejects_missing_beliefs_and_unknown_agents() {
        let tables = tables();
        let fold = fold(&tables, GeneralizationSetting::Within, 0, 1).unwrap();
        let lessons = TrainingSet { tables: &tables, posteriors: &[], fold: &fold, config: &config() };
        let refused = |found: Result<FoldResult>, wanted: &str| {
            let error = found.unwrap_err().to_string();
            assert!(error.contains(wanted), "{error}");
        };
        refused(evaluate_agent(&agent("simulate").unwrap(), &lessons, &NoProgress), "posteriors");
        refused(agent("oracle").map(|_| -> FoldResult { unreachable!() }), "simulate");
        assert_eq!(order(&[0.5, f32::NAN, 2.0, 0.1], &[1, 1, 1, 0], 3), [2, 0, 1]);
    }
}
