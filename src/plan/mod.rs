//! Plans: which actions of a task are the likeliest to solve it under what is believed of the world.
//!
//! A rollout costs a tenth of a millisecond, so a calibrated simulation can be asked outright: every action is tried in
//! worlds drawn from the belief, moved a little each time as a hand would, and actions are ranked by how often they solve.
//!
//! Source: ranking by rollouts over draws of a belief is the simplest Bayes-optimal choice of one action (Chaloner and
//! Verdinelli 1995, section 1, with success as utility); that a plan should survive small changes is PHYRE's (Bakhtin et al.
//! 2019, section 3). Racing with common random numbers: Maron and Moore 1997.
//!
//! Differences from the source: the race is exact, not probable: an action is dropped only once no outcome of the draws it
//! has left can bring it among the best.
//!
//! | file | what it does |
//! |---|---|
//! | `config` | what a plan is to be |
//! | `copies` | tries copies of actions in drawn worlds |
//! | `race` | which copies are worth trying |
//! | `search` | a plan: candidates, race, fresh draws for the best |
//! | `ranked` | what is found |
//! | `planner` | plans as a policy |
//! | `calibration` | predicted against real success |
//! | `document` | `iplw.plan/1` |

mod calibration;
mod config;
mod copies;
mod document;
mod planner;
mod race;
mod ranked;
mod search;
#[cfg(test)]
mod tests;

pub use calibration::{Bin, Calibration, calibration};
pub use config::PlanConfig;
pub use copies::Copies;
pub use document::{ActionRow, BeliefAbout, MOST_ROWS, PLAN_FORMAT, PlanDocument, document};
pub use planner::Planner;
pub use ranked::{Count, Plan, Ranked};
pub use search::plan;
