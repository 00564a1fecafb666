//! Thresholds of the verdict. `docs/calibration.md` says how they were chosen.

/// Settings of model selection.
#[derive(Clone, Copy, Debug)]
pub struct Settings {
    /// Prior probability that a given effect acts.
    pub inclusion: f64,
    /// Prior probability that an acting effect exceeds its declared standard deviation.
    pub strong_effect: f64,
    /// Posterior probability of the credible set of models.
    pub credible_mass: f64,
    /// Minimum share of the predictable misfit that the reported effects explain; below it the verdict is
    /// `unknown`.
    pub explained_share: f64,
    /// Confidence with which the explained share is below its limit before the verdict is `unknown`.
    pub confidence: f64,
    /// Minimum share of the excess error on held-out trials that a reported set removes, and of the misfit of
    /// a set without one of its effects that the effect explains: a strong effect does not support a weak
    /// one.
    pub least_gain: f64,
    /// Remaining share of gravity below which bodies are taken to be in a balance of forces.
    pub balance: f64,
    /// Expected number of equally extreme trials by chance below which a trial is left out as odd.
    pub odd_trial: f64,
    /// Shared discrepancy: standard deviation in units of gravity.
    pub discrepancy_of_gravity: f64,
    /// Shared discrepancy: standard deviation as a share of the typical acceleration beyond gravity.
    pub discrepancy_of_acceleration: f64,
    /// Shared discrepancy of observed positions: standard deviation as a share of the extent of the data.
    pub discrepancy_of_position: f64,
    /// Shared discrepancy of impacts: standard deviation of the normal impulse as a share of the approach
    /// speed, and additionally of the tangential impulse as a share of itself, since moments of inertia are
    /// seldom known better.
    pub discrepancy_of_impact: [f64; 2],
}

impl Settings {
    /// Share of the squared misfit that two standard deviations of the shared discrepancy leave.
    pub fn small_misfit(&self) -> f64 {
        (2.0 * self.discrepancy_of_acceleration).powi(2)
    }

    /// Log posterior odds from which a hypothesis is certain.
    pub fn log_odds_of_certainty(&self) -> f64 {
        (self.confidence / (1.0 - self.confidence)).ln()
    }
}

/// The settings of every diagnosis.
pub const SETTINGS: Settings = Settings {
    inclusion: 0.1,
    strong_effect: 0.5,
    credible_mass: 0.95,
    explained_share: 0.9,
    confidence: 0.95,
    least_gain: 0.5,
    balance: 0.05,
    odd_trial: 0.01,
    discrepancy_of_gravity: 0.01,
    discrepancy_of_acceleration: 0.06,
    discrepancy_of_position: 0.003,
    discrepancy_of_impact: [0.02, 0.1],
};
