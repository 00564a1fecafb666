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

impl Claims {
    /// For a family that the paper does not speak of: no statement is checked but those every experiment makes itself.
    pub const NONE: Claims = Claims { estimates: &[], jump_starts: &[], all_trials: false };
}

/// The paper's comparison of strategies by jump start, made for both of its families.
pub(super) const STRATEGIES_BY_JUMP_START: &[Ahead] = &[
    ahead("gradient beats collisions", "gradient", "collisions"),
    ahead("mixed beats collisions", "mixed", "collisions"),
    ahead("gradient beats rolling", "gradient", "rolling"),
    ahead("mixed beats rolling", "mixed", "rolling"),
    ahead("mixed beats domain randomisation", "mixed", "domain randomisation"),
    ahead("collisions beats rolling", "collisions", "rolling"),
    ahead("gradient beats random", "gradient", "random"),
];

const fn ahead(text: &'static str, better: &'static str, worse: &'static str) -> Ahead {
    Ahead { text, better, worse }
}

/// A row of a family's [`Claims::estimates`].
pub(super) const fn nearer(
    text: &'static str,
    better: &'static str,
    worse: &'static str,
    factors: &'static [&'static str],
) -> Nearer {
    Nearer { text, better, worse, factors }
}
