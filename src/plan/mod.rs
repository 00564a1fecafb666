//! Planning: ranks a task's actions by their probability of success, given samples of the world's parameters.
//!
//! A rollout costs a tenth of a millisecond, so success probabilities can be estimated by simulation: every action is simulated in
//! worlds sampled from the posterior, slightly perturbed each time, and actions are ranked by how often they solve the task.
//!
//! Source: maximising expected utility over posterior samples, with success as utility (Chaloner and Verdinelli 1995, section 1);
//! robustness to small perturbations as in PHYRE (Bakhtin et al. 2019, section 3); racing with common random numbers: Maron and
//! Moore 1997.
//!
//! Differences from the source: elimination is exact, not probabilistic: an action is dropped only once no outcome of its remaining
//! rollouts can bring it among the best.
//!
//! | file | contents |
//! |---|---|
//! | `config` | configuration |
//! | `perturbed_rollouts` | rollouts of perturbed actions in sampled worlds |
//! | `successive_elimination` | choice of the next rollouts |
//! | `search` | planning: candidates, elimination, fresh rollouts for the best |
//! | `ranked` | the result |
//! | `planner` | plans as a policy |
//! | `calibration` | calibration of predicted success probabilities |
//! | `action_map` | success rates over the action space |
//! | `document` | `iplw.plan/1` |

mod action_map;
mod calibration;
mod config;
mod document;
mod perturbed_rollouts;
mod planner;
mod ranked;
mod search;
mod successive_elimination;
#[cfg(test)]
mod tests;

pub use action_map::ActionMap;
pub use calibration::{Calibration, CalibrationBin, calibration};
pub use config::PlanConfig;
pub use document::{ActionRow, MAX_ROWS, PLAN_FORMAT, PlanDocument, SamplesSummary, document};
pub use perturbed_rollouts::PerturbedRollouts;
pub use planner::PlanPolicy;
pub use ranked::{Plan, RankedAction, SuccessCount};
pub use search::plan;
