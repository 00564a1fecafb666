//! Agents over many families: what is compared, and how they are judged without a simulator.
//!
//! Every task has up to 100 attempts; an action that cannot be placed is none. Agents learn from the training tasks of a fold
//! and rank the table's actions of its test tasks.
//!
//! Source: PHYRE (Bakhtin et al. 2019, sections 3 and 5).
//!
//! Differences from the source: all actions of a table are ranked (PHYRE's DQN ranks 10,000 of 100,000); the folds are our own.
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
use super::outcomes::{INVALID, SOLVED};
use super::table::Place;
use crate::error::{Error, Result};
use crate::progress::Progress;
use crate::rng;
pub use agent::{Agent, AgentsConfig, Lessons, Ranks};
pub use folds::{Fold, Setting, fold};

/// Every agent.
pub fn agents() -> [Agent; 4] {
    [random::AGENT, memory::AGENT, dqn::AGENT, simulate::AGENT]
}

/// How an agent did in a fold.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Tried {
    /// In [0, 1], over the test tasks.
    pub auccess: f64,
    /// The same of whoever knows the table: the share of test tasks that any of its actions solves.
    pub best: f64,
    /// AUCCESS by family.
    pub families: BTreeMap<String, f64>,
    /// For each test task the attempt that first solved it, from 1; `None` if none of 100 did.
    pub solved_at: Vec<(String, Option<usize>)>,
}

/// The agent called `name`.
pub fn agent(name: &str) -> Result<Agent> {
    agents().into_iter().find(|a| a.name == name).ok_or_else(|| Error::NotFound {
        kind: "agent",
        id: name.into(),
        known: agents().iter().map(|a| a.name.to_string()).collect(),
    })
}

/// Lets an agent learn from a fold's training tasks and tries its ranking on the test tasks. The result depends on the seed
/// and not on the number of threads.
pub fn try_agent(agent: &Agent, lessons: &Lessons, progress: &dyn Progress) -> Result<Tried> {
    if agent.simulates && lessons.beliefs.len() != lessons.tables.len() {
        let allowed = "a table of the same actions as the simulation believes them, for each family";
        return Err(Error::input("beliefs", format!("{} tables", lessons.beliefs.len()), allowed));
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
    let name = |place: &Place| lessons.tables[place.table].tasks()[place.task].id.clone();
    Ok(Tried {
        auccess: auccess(&solved_at),
        best: best as f64 / test.len().max(1) as f64,
        families: families.into_iter().map(|(family, at)| (family, auccess(&at))).collect(),
        solved_at: test.iter().map(name).zip(solved_at).collect(),
    })
}

fn seed_of(lessons: &Lessons, place: Place) -> u64 {
    rng::derive(lessons.fold.seed, &lessons.tables[place.table].tasks()[place.task].id, 0)
}

/// Valid actions from the highest score down; equal ones, and among the last those whose score is no number, in random order.
fn order(scores: &[f32], row: &[i8], seed: u64) -> Vec<usize> {
    let mut order: Vec<usize> = (0..row.len()).filter(|i| row[*i] != INVALID).collect();
    order.shuffle(&mut rng::stream(seed, "agents ties"));
    let key = |i: usize| if scores[i].is_nan() { f32::NEG_INFINITY } else { scores[i] };
    order.sort_by(|a, b| key(*b).total_cmp(&key(*a)));
    order
}
