//! Summary of the actions that a strategy selected in a round.

use serde::{Deserialize, Serialize};

use crate::explore::{ActionCandidate, ActionSelection, ExpectedPosteriorSd, GroupCounts};

/// Summary of the actions that a strategy selected in a round, and of its candidates.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct SelectionSummary {
    /// Number of selected actions.
    pub actions: usize,
    /// Number of different tasks among them.
    pub tasks: usize,
    /// Mean number of simulated collisions (`explore::collisions_of`) of a selected action.
    pub collisions: f64,
    /// Mean number of simulated body time steps on a supporting surface, per selected action.
    pub rolling_steps: f64,
    /// The same over all candidates; for design methods, over the shortlisted ones.
    pub candidate_collisions: f64,
    pub candidate_rolling_steps: f64,
    /// Number of actions selected from each group, for strategies that divide candidates into groups.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub groups: Option<GroupCounts>,
    /// Expected posterior standard deviation of each coordinate, for strategies that compute it.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub expected: Vec<ExpectedPosteriorSd>,
    /// Reason for each selection, in the order of the proposals, for methods that report one.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub reasons: Vec<String>,
    /// Rollouts simulated for the selection, beyond one per candidate; a restarted segment counts as its share of a rollout.
    #[serde(default)]
    pub rollouts: u64,
}

impl SelectionSummary {
    /// Summarises a selection from `candidates`.
    pub(super) fn of(candidates: &[ActionCandidate], made: &ActionSelection) -> SelectionSummary {
        let chosen = &made.indices;
        let mean = |of: &mut dyn Iterator<Item = u32>| {
            let (sum, n) = of.fold((0.0, 0.0), |(sum, n), v| (sum + f64::from(v), n + 1.0));
            if n > 0.0 { sum / n } else { 0.0 }
        };
        let mut tasks: Vec<usize> = chosen.iter().map(|i| candidates[*i].task).collect();
        tasks.sort_unstable();
        tasks.dedup();
        SelectionSummary {
            actions: chosen.len(),
            tasks: tasks.len(),
            collisions: mean(&mut chosen.iter().map(|i| candidates[*i].collisions)),
            rolling_steps: mean(&mut chosen.iter().map(|i| candidates[*i].rolling_steps)),
            candidate_collisions: mean(&mut candidates.iter().map(|c| c.collisions)),
            candidate_rolling_steps: mean(&mut candidates.iter().map(|c| c.rolling_steps)),
            groups: made.groups,
            expected: made.expected.clone(),
            reasons: Vec::new(),
            rollouts: made.rollouts,
        }
    }
}
