//! Claims of the paper that experiments check, as data: which arm of an experiment is expected to perform
//! better than which.

/// The claims checked for a family.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Claims {
    /// Claims about estimation error, in the comparison of strategies.
    pub estimates: &'static [EstimateClaim],
    /// Claims about jump starts, in transfer studies.
    pub jump_starts: &'static [JumpStartClaim],
    /// Whether the comparison of strategies also fits all trials so far instead of only the last round's:
    /// five times the work, an hour where rollouts are long.
    pub all_trials: bool,
}

/// The estimates of one strategy are expected to be closer to the truth than another's.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct EstimateClaim {
    /// Text shown to users.
    pub text: &'static str,
    /// Name of the strategy expected to be closer.
    pub better: &'static str,
    /// Name of the other strategy.
    pub worse: &'static str,
    /// Latent factors over which the errors are averaged.
    pub factors: &'static [&'static str],
}

/// The policies of one row of a study are expected to start with a better score than another's.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct JumpStartClaim {
    /// Text shown to users.
    pub text: &'static str,
    /// Name of the row expected to be better.
    pub better: &'static str,
    /// Name of the other row.
    pub worse: &'static str,
}

impl JumpStartClaim {
    /// The claim that `better` starts with a better score than `worse`.
    pub const fn new(text: &'static str, better: &'static str, worse: &'static str) -> JumpStartClaim {
        JumpStartClaim { text, better, worse }
    }
}
