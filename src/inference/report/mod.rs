//! Report of a diagnosis: its schema (`schema`), how it is built (`build`), and data for plots.

pub(super) mod build;
pub(super) mod estimates;
pub(super) mod evidence;
pub(super) mod expected_rss;
pub(super) mod extended_scene;
pub(super) mod few_trials;
pub mod plot_tables;
pub(super) mod prediction_gain;
pub(super) mod residual_map;
mod schema;
pub(super) mod text;
pub(super) mod trajectory_residuals;

pub use schema::{
    BaseMisfit, BetweenTrialVariation, CalibratedLatent, Diagnosis, EffectEstimate, FORMAT, HeldOutError,
    LawTerm, ModelScore, OddTrial, ParameterEstimate, PredictionGain, PredictiveCheck, RecommendedExperiment,
    ResidualField, ResidualLaw, ResidualSummary, SurfaceOffset, TrajectoryResiduals, TrialEffectEstimate,
    TrialEffects, TrialPredictiveCheck, TrialResiduals, UnusedContacts, Verdict, round_to_six_digits,
};
