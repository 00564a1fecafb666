//! What a diagnosis says: `iplw.diagnosis/1`.

use std::collections::BTreeMap;

use serde::Serialize;

use crate::task::Scene;
use crate::task::scene::EffectTerm;

/// The value of a diagnosis's `format` field.
pub const FORMAT: &str = "iplw.diagnosis/1";

/// What was found.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Verdict {
    /// The base model explains the data to its noise floor.
    None,
    /// One set of effects does.
    Named,
    /// Several sets tie.
    Ambiguous,
    /// Real misfit that no set in the library explains.
    Unknown,
    /// Too little to say.
    InsufficientData,
}

impl Verdict {
    /// The name used in files.
    pub fn name(self) -> &'static str {
        match self {
            Verdict::None => "none",
            Verdict::Named => "named",
            Verdict::Ambiguous => "ambiguous",
            Verdict::Unknown => "unknown",
            Verdict::InsufficientData => "insufficient_data",
        }
    }
}

/// A diagnosis.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Diagnosis {
    pub format: &'static str,
    pub verdict: Verdict,
    /// Why: a sentence for people.
    pub reason: String,
    /// The found set; the simplest of several.
    pub effects: Vec<FoundEffect>,
    /// Every set that the data cannot tell from the best, by names.
    pub rivals: Vec<Vec<String>>,
    pub calibrated: Vec<Calibrated>,
    pub residual: Residual,
    pub gain: Gain,
    /// Share of the excess mean squared error that the effects leave.
    pub unexplained_share: Option<f64>,
    /// What acceleration the unexplained looks like; only for the verdict `unknown`.
    pub residual_law: Option<ResidualLaw>,
    pub next_experiment: Option<NextExperiment>,
    /// Every set that was fitted and the base model (no effects), best first.
    pub scores: Vec<Score>,
    /// What the reported model leaves.
    pub remainder: Option<Remainder>,
    /// What the reported model makes of every launch that was used.
    pub launches: Vec<Launch>,
    /// What launches differ by, each in its own way, beside the reported model.
    pub unlike: Vec<Unlike>,
    /// Whether launches are as far as they should be from what the others predict of them; `None` where that is not told.
    pub predictive: Option<Predictive>,
    /// What pushes launches beside the reported model, where they flew; `None` where that was not asked.
    pub field: Option<FieldLeft>,
    /// Residuals along launches by the base model and the extended one, and how wide they should be.
    pub paths: Paths,
    /// Sets that could not be fitted: they have not lost.
    pub failed: Vec<Vec<String>>,
    pub seed: u64,
}

/// An effect of the found set.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct FoundEffect {
    pub name: String,
    pub acts_on: String,
    /// Corrected for the search over the library.
    pub p_value: f64,
    pub parameters: Vec<FoundParameter>,
}

/// A parameter with its 95 % interval.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct FoundParameter {
    pub name: String,
    pub value: f64,
    /// `null` where the data set no bound.
    pub ci95: [Option<f64>; 2],
    pub unit: String,
    pub setting: Option<String>,
    /// Standard deviation from launch to launch; `None` if launches share it.
    pub spread: Option<f64>,
}

/// An acceleration that every launch has of its own, by more than every launch may a little.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Unlike {
    /// The effect that it is an amplitude of, and which.
    pub effect: String,
    pub parameter: String,
    /// Standard deviation from launch to launch, about a mean of nothing, in the parameter's unit.
    pub spread: f64,
    pub unit: String,
}

/// An acceleration without a name that describes what effects leave.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct ResidualLaw {
    /// In words and symbols: m, s. Of a force field, how many bumps of which kind it is.
    pub formula: String,
    pub terms: Vec<LawTerm>,
    /// The base model's error, and that of the effects found and the law, on trials whose numbers they were not fitted to.
    /// (Which functions make the law up was chosen on all trials; that choice is charged where it is decided about `offered`.)
    pub held_out: HeldOut,
    /// Whether it is part of the extended scene: it is if it is likely to help on trials that it was not fitted to.
    pub offered: bool,
}

/// A term of a law.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct LawTerm {
    /// As a scene takes it.
    pub term: EffectTerm,
    /// 95 % intervals of the parameters that were fitted, by name; the others are the shape.
    pub ci95: BTreeMap<String, [Option<f64>; 2]>,
}

/// A calibrated latent.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Calibrated {
    pub name: String,
    pub value: f64,
    pub ci95: [Option<f64>; 2],
    pub identifiable: bool,
}

/// The base model's misfit.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Residual {
    /// m
    pub base_rmse: f64,
    /// m
    pub floor_rmse: f64,
    pub lack_of_fit_p: f64,
    pub whiteness_p: f64,
    /// Of neighbouring residuals.
    pub autocorrelation: f64,
    /// Of the noise itself.
    pub noise_correlation: f64,
}

/// What the extension gains.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Gain {
    pub held_out: Option<HeldOut>,
    pub extrapolation: Option<HeldOut>,
}

/// Errors on trials that were not fitted.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct HeldOut {
    pub trials: usize,
    /// m
    pub base_rmse: f64,
    /// m
    pub extended_rmse: f64,
    /// m
    pub floor_rmse: f64,
    /// 1 - (extended^2 - floor^2) / (base^2 - floor^2)
    pub excess_removed: Option<f64>,
}

/// What to measure next.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct NextExperiment {
    pub why: String,
    #[serde(rename = "do")]
    pub action: String,
    pub separates: Vec<String>,
    /// The experiment as it would be simulated: its first body's start is the launch. `None` where it is not of that
    /// kind.
    #[serde(skip)]
    pub scene: Option<Scene>,
}

/// How a set compares with the best.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Score {
    pub effects: Vec<String>,
    /// Log predictive density of all launches, each told from the others, less what choosing the set costs; nats above the
    /// best whose effects are all there.
    pub score: f64,
    /// Probability that it predicts launches worse than the best.
    pub probability_worse: f64,
    /// Its effects with their sizes, where it ties with the best; nothing of others.
    pub sizes: Vec<FoundEffect>,
}

/// What the reported model leaves.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Remainder {
    /// Root of the mean square of what held-out launches leave above the noise and what changes slowly along a path, by the base
    /// model, m.
    pub slow_before_m: f64,
    /// The same by the reported model, m.
    pub slow_after_m: f64,
    /// Standard deviation of the noise, m.
    pub noise_m: f64,
    /// Share of what can be predicted of launches, with a force field of no name beside the model, that the model explains by
    /// itself; `None` where that cannot be asked.
    pub explained_share: Option<f64>,
    /// Nats by which such a field predicts launches better, and the probability that it does.
    pub field: Option<[f64; 2]>,
    /// The same in words.
    pub text: String,
}

/// A launch by the reported model.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Launch {
    /// Index of the trial, from 0.
    pub trial: usize,
    pub name: String,
    pub setting: Option<String>,
    /// Every amplitude of the model.
    pub sizes: Vec<LaunchSize>,
}

/// The size that an effect has in a launch.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct LaunchSize {
    pub effect: String,
    pub parameter: String,
    /// Best linear prediction: what the launch says, and how sizes are spread among launches; in the parameter's unit.
    pub value: f64,
    /// Its standard deviation.
    pub sd: f64,
    /// Least squares of the launch alone, and its standard deviation; `None` where the launch does not tell it.
    pub alone: Option<[f64; 2]>,
}

/// How launches stand to what the others predict of them.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Predictive {
    pub launches: Vec<Predicted>,
    /// Share of launches outside the 95 % range of predictions: 0.05 if they are right.
    pub outside_share: f64,
    /// Trials that are further off than 97.5 % of predictions, the furthest first.
    pub further_off: Vec<usize>,
    /// How far off the usual launch is over what was predicted, the launch's own scale aside: 1 if they are right.
    pub usual_ratio: f64,
    /// Probability of launches' p being so far from uniform (Kolmogorov), if predictions are right.
    pub uniform_p: f64,
    /// All p in order, each with the 95 % range of its place if they are uniform.
    pub sorted: Vec<[f64; 3]>,
}

/// A launch and what the others predict of it.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Predicted {
    /// Index of the trial, from 0.
    pub trial: usize,
    /// Probability of a launch further off than this.
    pub p: f64,
    /// Square of how far off it is under the predictive covariance, the launch's own scale aside, and the number of
    /// coordinates: what is expected of it.
    pub squares: f64,
    pub count: usize,
}

/// A force field without a name beside the reported model.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct FieldLeft {
    /// What the numbers of a row are: m, m/s^2.
    pub columns: &'static [&'static str],
    /// A cell of the plane each: its mean place, the mean acceleration there, and standard deviations.
    pub rows: Vec<[f64; 6]>,
}

/// Residuals along launches, few enough to be drawn.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Paths {
    /// What the numbers of a row are.
    pub columns: &'static [&'static str],
    pub launches: Vec<Path>,
}

/// A launch's rows; `None` where a number is not told.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Path {
    /// Index of the trial, from 0.
    pub trial: usize,
    pub rows: Vec<Vec<Option<f64>>>,
}

/// A number to six significant digits: so that long lists stay short.
pub fn rounded(v: f64) -> f64 {
    format!("{v:.5e}").parse().unwrap_or(v)
}

#[cfg(test)]
mod tests {
    use super::rounded;

    #[test]
    fn six_digits_are_kept() {
        assert_eq!(rounded(1.0 / 3.0), 0.333333);
        assert_eq!((rounded(-123456789.0), rounded(0.0), rounded(2e-300)), (-123457000.0, 0.0, 2e-300));
        assert!(rounded(f64::NAN).is_nan() && rounded(f64::INFINITY) == f64::INFINITY);
    }
}
