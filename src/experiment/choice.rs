//! What a strategy chose in a round, and from what.

use serde::{Deserialize, Serialize};

use crate::explore::{Candidate, Chosen, Expected, Groups};

/// What a strategy chose in a round, and from what.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Choice {
    /// Actions chosen.
    pub actions: usize,
    /// Different tasks among them.
    pub tasks: usize,
    /// Mean collisions (`explore::collisions_of`) of a chosen action, as simulated.
    pub collisions: f64,
    /// Mean body time steps on a carrying surface of a chosen action, as simulated.
    pub rolling_steps: f64,
    /// The same over all candidates; of ways that ask a question, over those looked at closely.
    pub candidate_collisions: f64,
    pub candidate_rolling_steps: f64,
    /// How many were chosen from which group, where the strategy deals them out.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub groups: Option<Groups>,
    /// What they were chosen to tell of each coordinate, where the strategy reckons with it.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub expected: Vec<Expected>,
    /// Why each was chosen, in words, in the order of the proposals, where the way says so.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub reasons: Vec<String>,
    /// Rollouts simulated to choose, beyond one for each candidate; restarted segments count as the part they are.
    #[serde(default)]
    pub rollouts: u64,
}

impl Choice {
    /// Counts what was chosen of `candidates`.
    pub(super) fn of(candidates: &[Candidate], made: &Chosen) -> Choice {
        let chosen = &made.indices;
        let mean = |of: &mut dyn Iterator<Item = u32>| {
            let (sum, n) = of.fold((0.0, 0.0), |(sum, n), v| (sum + f64::from(v), n + 1.0));
            if n > 0.0 { sum / n } else { 0.0 }
        };
        let mut tasks: Vec<usize> = chosen.iter().map(|i| candidates[*i].task).collect();
        tasks.sort_unstable();
        tasks.dedup();
        Choice {
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
