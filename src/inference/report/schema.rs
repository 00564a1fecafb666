//! Report of a diagnosis, `iplw.diagnosis/2`.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use crate::names::names;
use crate::task::Scene;
use crate::task::scene::EffectTerm;

/// The value of a diagnosis's `format` field.
pub const FORMAT: &str = "iplw.diagnosis/2";

/// Verdict of a diagnosis.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum Verdict {
    /// The base model explains the data down to the noise.
    None,
    /// One set of effects explains the discrepancy.
    Named,
    /// Several sets of effects explain it equally well.
    Ambiguous,
    /// There is discrepancy, but no set of library effects explains it.
    Unknown,
    /// The data are insufficient.
    #[default]
    InsufficientData,
}

names!(Verdict: None = "none", Named = "named", Ambiguous = "ambiguous", Unknown = "unknown",
    InsufficientData = "insufficient_data");

/// A diagnosis.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Diagnosis {
    pub format: String,
    pub verdict: Verdict,
    /// Explanation for readers.
    pub reason: String,
    /// The selected set of effects; the simplest of tied ones.
    pub effects: Vec<EffectEstimate>,
    /// Sets that the data do not distinguish from the best, by effect names.
    pub rivals: Vec<Vec<String>>,
    pub calibrated: Vec<CalibratedLatent>,
    /// Misfit of the base model; `null` where too little data were measured to tell.
    pub residual: Option<BaseMisfit>,
    pub gain: PredictionGain,
    /// Share of the excess mean squared error that the effects do not explain.
    pub unexplained_share: Option<f64>,
    /// Empirical law of the unexplained acceleration; only for the verdict `unknown`.
    pub residual_law: Option<ResidualLaw>,
    pub next_experiment: Option<RecommendedExperiment>,
    /// All fitted sets and the base model (no effects), best first.
    pub scores: Vec<ModelScore>,
    /// Residuals of the reported model.
    pub remainder: Option<ResidualSummary>,
    /// Estimates of the reported model per trial.
    pub launches: Vec<TrialEffects>,
    /// Random accelerations by which trials differ in addition to the reported model.
    pub unlike: Vec<BetweenTrialVariation>,
    /// Predictive checks of each trial from the others; `null` if not available.
    pub predictive: Option<PredictiveCheck>,
    /// Mean acceleration that the reported model lacks, by position; `null` if not requested.
    pub field: Option<ResidualField>,
    /// Residuals along trials by the base and the extended model, with predictive standard deviations.
    pub paths: TrajectoryResiduals,
    /// Trials that are unlike what the others predict of them and were left out.
    pub odd_trials: Vec<OddTrial>,
    /// Surfaces that are not where the scene has them.
    pub surface_offsets: Vec<SurfaceOffset>,
    /// Contacts that the diagnosis does not use.
    pub unused_contacts: Vec<UnusedContacts>,
    /// Sets whose fit failed; they are not ruled out.
    pub failed: Vec<Vec<String>>,
    pub seed: u64,
}

/// Contacts that are not used, for one reason.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct UnusedContacts {
    /// The kind of contact and why it is not used.
    pub reason: String,
    pub count: usize,
}

/// An effect of the selected set.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct EffectEstimate {
    pub name: String,
    /// `motion`, `contact`, `body`, `region`, `sensor` or `action`.
    pub acts_on: String,
    /// Posterior probability that the effect acts, over all sets that were tried.
    pub probability: f64,
    pub parameters: Vec<ParameterEstimate>,
}

/// A parameter estimate with its 95 % confidence interval.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct ParameterEstimate {
    pub name: String,
    pub value: f64,
    /// 95 % confidence interval; `null` where unbounded.
    pub ci95: [Option<f64>; 2],
    pub unit: String,
    /// The setting whose trials it applies to; `null` if all.
    pub setting: Option<String>,
    /// Standard deviation between trials; `null` if shared by all trials.
    pub spread: Option<f64>,
}

/// A random acceleration per trial, larger than the tolerated variation.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct BetweenTrialVariation {
    /// Name of the effect.
    pub effect: String,
    pub parameter: String,
    /// Standard deviation between trials around a mean of zero, in the parameter's unit.
    pub spread: f64,
    pub unit: String,
}

/// Empirical law of the acceleration that the effects do not explain.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ResidualLaw {
    /// Formula in SI units, or a description of a fitted force field.
    pub formula: String,
    pub terms: Vec<LawTerm>,
    /// Errors of the base model and of the effects with the law, on trials whose parameters were not fitted.
    /// (The law's terms were selected on all trials; `offered` accounts for that.)
    pub held_out: HeldOutError,
    /// Whether the extended scene includes it: it does if it is expected to improve predictions of new trials.
    pub offered: bool,
}

/// A term of an empirical law.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct LawTerm {
    /// The term as a scene's effect.
    pub term: EffectTerm,
    /// 95 % confidence intervals of the fitted parameters, by name.
    pub ci95: BTreeMap<String, [Option<f64>; 2]>,
}

/// A calibrated latent.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct CalibratedLatent {
    pub name: String,
    pub value: f64,
    pub ci95: [Option<f64>; 2],
    pub identifiable: bool,
}

/// Misfit of the base model.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct BaseMisfit {
    /// m
    pub base_rmse: f64,
    /// m
    pub floor_rmse: f64,
    pub lack_of_fit_p: f64,
    pub whiteness_p: f64,
    /// Autocorrelation of neighbouring residuals.
    pub autocorrelation: f64,
    /// Autocorrelation of the noise.
    pub noise_correlation: f64,
}

/// Prediction gain of the extension.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct PredictionGain {
    pub held_out: Option<HeldOutError>,
    pub extrapolation: Option<HeldOutError>,
}

/// Errors on held-out trials.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct HeldOutError {
    pub trials: usize,
    /// m
    pub base_rmse: f64,
    /// m
    pub extended_rmse: f64,
    /// m
    pub floor_rmse: f64,
    /// 1 - (extended^2 - floor^2) / (base^2 - floor^2); of a reported set with the random accelerations of each trial at
    /// their conditional modes.
    pub excess_removed: Option<f64>,
}

/// Recommended next experiment.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct RecommendedExperiment {
    pub why: String,
    /// The experiment.
    #[serde(rename = "do")]
    pub action: String,
    /// The rivals that it would separate.
    pub separates: Vec<String>,
    /// The experiment as a scene: its first body's initial state is to be set. `None` if it is not of that
    /// kind.
    #[serde(skip)]
    pub scene: Option<Scene>,
}

/// Comparison of a set with the best one.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ModelScore {
    pub effects: Vec<String>,
    /// Log posterior probability relative to the most probable set, nats.
    pub score: f64,
    /// Posterior probability among the sets that were tried.
    pub probability: f64,
    /// Its effects with estimates if it is in the credible set; otherwise empty.
    pub sizes: Vec<EffectEstimate>,
}

/// Residual summary of the reported model.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ResidualSummary {
    /// Systematic error of a coordinate with the base model, m: root mean square, over all observations, of the smooth part of the
    /// residuals beyond that expected from noise.
    pub slow_before_m: f64,
    /// The same with the reported model, m.
    pub slow_after_m: f64,
    /// Standard deviation of the noise, m.
    pub noise_m: f64,
    /// Share of the predictable misfit that the model explains, with its 90 % interval; `null` if there is no misfit.
    pub explained_share: Option<f64>,
    pub explained_share_interval: Option<[f64; 2]>,
    /// Log evidence of a force that no effect describes, beside the model and relative to the model alone, nats.
    pub unnamed_force_evidence: Option<f64>,
    /// The same as a sentence.
    pub text: String,
}

/// Estimates for one trial.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct TrialEffects {
    /// Index of the trial, from 0.
    pub trial: usize,
    pub name: String,
    pub setting: Option<String>,
    /// Amplitude estimates.
    pub sizes: Vec<TrialEffectEstimate>,
}

/// Amplitude estimate of an effect in one trial.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct TrialEffectEstimate {
    pub effect: String,
    pub parameter: String,
    /// Best linear unbiased prediction (BLUP), in the parameter's unit.
    pub value: f64,
    /// Its standard deviation.
    pub sd: f64,
    /// Least-squares estimate from the trial alone, and its standard deviation; `null` if not identified.
    pub alone: Option<[f64; 2]>,
}

/// Leave-one-trial-out predictive checks.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct PredictiveCheck {
    pub launches: Vec<TrialPredictiveCheck>,
    /// Share of trials outside their 95 % predictive interval; 0.05 if predictions are calibrated.
    pub outside_share: f64,
    /// Outlying trials, beyond the 97.5 % predictive quantile, most extreme first.
    pub further_off: Vec<usize>,
    /// Median ratio of observed to predicted deviation, up to the trial's own scale; 1 if calibrated.
    pub usual_ratio: f64,
    /// p-value of a Kolmogorov-Smirnov test for uniform p-values.
    pub uniform_p: f64,
    /// Sorted p-values, each with the 95 % interval of its order statistic under uniformity.
    pub sorted: Vec<[f64; 3]>,
}

/// Predictive check of one trial.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct TrialPredictiveCheck {
    /// Index of the trial, from 0.
    pub trial: usize,
    /// Predictive p-value: probability of a larger deviation.
    pub p: f64,
    /// Squared Mahalanobis distance under the predictive covariance, up to the trial's own scale, and the
    /// number of coordinates, its expectation.
    pub squares: f64,
    pub count: usize,
}

/// A trial that is unlike the others.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct OddTrial {
    /// Index of the trial, from 0.
    pub trial: usize,
    pub name: String,
    /// Probability of a larger deviation from what the other trials predict of it.
    pub p: f64,
}

/// Where a surface is, relative to where the scene has it.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct SurfaceOffset {
    /// Name of the static.
    pub name: String,
    /// Outward normal of the face.
    pub normal: [f64; 2],
    /// Offset along the normal, from all bounces off the face, m.
    pub offset: f64,
    /// Its standard error, m.
    pub sd: f64,
}

/// Residual force field of the reported model.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ResidualField {
    /// Names of the columns; m, m/s^2.
    pub columns: Vec<String>,
    /// One row per cell of the plane: mean position, mean acceleration and its standard deviations.
    pub rows: Vec<[f64; 6]>,
}

/// Residuals along trials, thinned for plots.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct TrajectoryResiduals {
    /// Names of the columns.
    pub columns: Vec<String>,
    pub launches: Vec<TrialResiduals>,
}

/// Rows of one trial; `null` for a missing value.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct TrialResiduals {
    /// Index of the trial, from 0.
    pub trial: usize,
    pub rows: Vec<Vec<Option<f64>>>,
}

/// Rounds to six significant digits, to keep long lists short.
pub fn round_to_six_digits(v: f64) -> f64 {
    format!("{v:.5e}").parse().unwrap_or(v)
}

#[cfg(test)]
mod tests {
    use super::round_to_six_digits;

    #[test]
    fn six_digits_are_kept() {
        assert_eq!(round_to_six_digits(1.0 / 3.0), 0.333333);
        assert_eq!(
            (round_to_six_digits(-123456789.0), round_to_six_digits(0.0), round_to_six_digits(2e-300)),
            (-123457000.0, 0.0, 2e-300)
        );
        assert!(
            round_to_six_digits(f64::NAN).is_nan() && round_to_six_digits(f64::INFINITY) == f64::INFINITY
        );
    }
}
