//! Statements of the paper that experiments check, as data: which arm of an experiment is said to do better than which.

/// What is checked for a family.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Claims {
    /// About estimates, in the comparison of strategies.
    pub estimates: &'static [Nearer],
    /// About jump starts, in studies of transfer.
    pub jump_starts: &'static [Ahead],
    /// Whether the comparison of strategies also fits all trials so far in place of the last round's: five times the
    /// work, an hour where rollouts are long.
    pub all_trials: bool,
}

/// The estimates of one strategy are said to be nearer the truth than another's.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Nearer {
    /// For people.
    pub text: &'static str,
    /// Name of the strategy that is said to be nearer.
    pub better: &'static str,
    /// Name of the other.
    pub worse: &'static str,
    /// Latent factors over which the errors are averaged.
    pub factors: &'static [&'static str],
}

/// Policies of one row of a study are said to start ahead of another's.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Ahead {
    /// For people.
    pub text: &'static str,
    /// Name of the row that is said to be ahead.
    pub better: &'static str,
    /// Name of the other.
    pub worse: &'static str,
}
