//! Results of planning.

use crate::task::ValidAction;

/// A task's actions, best first.
#[derive(Clone, Debug, PartialEq)]
pub struct Plan {
    /// Id of the task.
    pub task: String,
    /// Rollouts of a fully evaluated action.
    pub draws: usize,
    /// Candidates that can be placed, the most likely to solve first.
    pub ranked: Vec<RankedAction>,
    /// Number of candidates that can't be placed.
    pub invalid: usize,
    /// Number of rollouts, fresh ones included.
    pub rollouts: usize,
    /// Whether the best are those of an exhaustive evaluation; false if a deadline or the limit of rollouts came first.
    pub complete: bool,
}

/// An action with the outcomes of its rollouts.
#[derive(Clone, Debug, PartialEq)]
pub struct RankedAction {
    pub action: ValidAction,
    /// Rollouts used for ranking.
    pub ranking_count: SuccessCount,
    /// Fresh rollouts, not used for ranking; for the best only.
    pub fresh_count: Option<SuccessCount>,
}

/// Number of successes in a number of rollouts.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct SuccessCount {
    pub successes: usize,
    pub rollouts: usize,
}

impl SuccessCount {
    /// Posterior mean of the success rate under a uniform prior, Beta(1 + successes, 1 + failures), in (0, 1). It makes actions with
    /// different numbers of rollouts comparable.
    pub fn smoothed_share(self) -> f64 {
        (self.successes as f64 + 1.0) / (self.rollouts as f64 + 2.0)
    }

    /// Success rate; NaN without rollouts.
    pub fn mean(self) -> f64 {
        self.successes as f64 / self.rollouts as f64
    }

    /// Standard deviation of that Beta distribution: a standard error that doesn't vanish where all or none succeeded.
    pub fn standard_error(self) -> f64 {
        let share = self.smoothed_share();
        (share * (1.0 - share) / (self.rollouts as f64 + 3.0)).sqrt()
    }

    pub(super) fn failures(self) -> usize {
        self.rollouts - self.successes
    }

    pub(super) fn record(&mut self, solved: bool) {
        self.rollouts += 1;
        self.successes += usize::from(solved);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Beta(3, 2) has the mean 3/5 and the variance 1/25.
    #[test]
    fn matches_the_beta_distribution() {
        let count = SuccessCount { successes: 2, rollouts: 3 };
        assert!((count.smoothed_share() - 0.6).abs() < 1e-15);
        assert!((count.standard_error() - 0.2).abs() < 1e-15);
        let all = SuccessCount { successes: 64, rollouts: 64 };
        assert!(all.mean() == 1.0 && all.standard_error() > 0.0);
        assert_eq!(SuccessCount::default().smoothed_share(), 0.5);
    }
}
