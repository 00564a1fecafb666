//! What a plan finds.

use crate::task::ValidAction;

/// A task's actions, best first.
#[derive(Clone, Debug, PartialEq)]
pub struct Plan {
    /// Id of the task.
    pub task: String,
    /// Copies that an action tried to the end was tried in.
    pub draws: usize,
    /// Candidates that can be placed, the likeliest to solve first.
    pub ranked: Vec<Ranked>,
    /// Candidates that cannot be placed.
    pub invalid: usize,
    /// Copies that were tried, fresh ones among them.
    pub rollouts: usize,
    /// Whether the best are those of trying everything. If not, the time or the rollouts there were ended the race.
    pub complete: bool,
}

/// An action with what became of its copies.
#[derive(Clone, Debug, PartialEq)]
pub struct Ranked {
    pub action: ValidAction,
    /// Of the copies that it was ranked by.
    pub raced: Count,
    /// Of fresh copies, which had no say in the ranking; for the best only.
    pub fresh: Option<Count>,
}

/// How many of how many solved.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Count {
    pub successes: usize,
    pub tried: usize,
}

impl Count {
    /// Mean of the share of successes given the count and a uniform prior, Beta(1 + successes, 1 + failures): what actions
    /// that got different numbers of draws are compared by. In (0, 1).
    pub fn share(self) -> f64 {
        (self.successes as f64 + 1.0) / (self.tried as f64 + 2.0)
    }

    /// Share of successes; NaN if nothing was tried.
    pub fn mean(self) -> f64 {
        self.successes as f64 / self.tried as f64
    }

    /// Standard deviation of that Beta distribution: a standard error that does not vanish where all or none succeeded.
    pub fn standard_error(self) -> f64 {
        let share = self.share();
        (share * (1.0 - share) / (self.tried as f64 + 3.0)).sqrt()
    }

    pub(super) fn failures(self) -> usize {
        self.tried - self.successes
    }

    pub(super) fn add(&mut self, solved: bool) {
        self.tried += 1;
        self.successes += usize::from(solved);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Beta(3, 2) has the mean 3/5 and the variance 1/25.
    #[test]
    fn counts_are_beta_distributions() {
        let count = Count { successes: 2, tried: 3 };
        assert!((count.share() - 0.6).abs() < 1e-15);
        assert!((count.standard_error() - 0.2).abs() < 1e-15);
        let all = Count { successes: 64, tried: 64 };
        assert!(all.mean() == 1.0 && all.standard_error() > 0.0);
        assert_eq!(Count::default().share(), 0.5);
    }
}
