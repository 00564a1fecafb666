//! Requests for posteriors.

use std::collections::BTreeMap;

use serde::Deserialize;
use utoipa::ToSchema;

use super::diagnosis::{BallIn, DiagnosisIn, ReadingIn, TrialsIn};
use super::json_object::JsonObject;
use crate::discover::posterior::PosteriorOptions;
use crate::task::Scene;
use crate::world::Engine;

/// Measured trials, their simulation, and the parameters to infer: latents and effect parameters.
#[derive(Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct PosteriorIn {
    /// An `iplw.scene/1` document; its `calibrate` lists the latents to infer.
    #[schema(value_type = Option<Object>)]
    pub scene: Option<JsonObject<Scene>>,
    /// A single ball, instead of a scene.
    #[schema(value_type = Option<BallIn>)]
    pub ball: Option<JsonObject<BallIn>>,
    /// Trials as CSV, as for a diagnosis.
    #[schema(value_type = Option<TrialsIn>)]
    pub trials: Option<TrialsIn>,
    /// Units and options for reading the trials.
    #[schema(value_type = Option<ReadingIn>)]
    pub reading: Option<JsonObject<ReadingIn>>,
    /// Id of an estimation, to use its trials so far.
    pub job: Option<String>,
    /// Sets of effects, one model each, weighted by cross-validated predictive density. Default: one empty set.
    pub sets: Option<Vec<Vec<String>>>,
    /// Latents to infer, instead of the scene's `calibrate`.
    pub calibrate: Option<Vec<String>>,
    /// Mean and standard deviation by latent. Default: 1 and 0.5; restitution 0.5 and 0.25.
    pub prior: Option<BTreeMap<String, [f64; 2]>>,
    /// `smc` (sequential Monte Carlo) or `mcmc` (Markov chains).
    pub method: Option<String>,
    /// Total number of draws. Default: 1024.
    pub draws: Option<usize>,
    /// Whether to account for model discrepancy shared by the trials. Default: true.
    pub discrepancy: Option<bool>,
    /// Whether a likely discrepancy field is simulated and sampled with the parameters: wider, more honest intervals, for minutes of
    /// CPU time instead of seconds. Requires `discrepancy`. Default: false.
    pub sample_discrepancy: Option<bool>,
    pub seed: Option<u64>,
}

impl PosteriorIn {
    /// The dataset, the posterior options, and the latents that override the scene's `calibrate`.
    pub fn parts(self) -> (DiagnosisIn, PosteriorOptions, Option<Vec<String>>) {
        let PosteriorIn { scene, ball, trials, reading, job, seed, .. } = self;
        let wanted = PosteriorOptions {
            sets: self.sets.unwrap_or_default(),
            prior: self.prior.unwrap_or_default(),
            method: self.method,
            draws: self.draws,
            discrepancy: self.discrepancy,
            sample_discrepancy: self.sample_discrepancy.unwrap_or(false),
            engine: Engine::Auto,
            seed: seed.unwrap_or(0),
        };
        (DiagnosisIn { scene, ball, trials, reading, job, seed }, wanted, self.calibrate)
    }
}
