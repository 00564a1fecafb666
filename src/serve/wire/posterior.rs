//! What is to be known, and from which trials.

use std::collections::BTreeMap;

use serde::Deserialize;
use utoipa::ToSchema;

use super::diagnosis::{BallIn, DiagnosisIn, ReadingIn, TrialsIn};
use super::strict::Object;
use crate::discover::posterior::Wanted;
use crate::task::Scene;
use crate::world::Engine;

/// Measured trials, the simulation they are of, and what is to be known: latents and parameters of effects.
#[derive(Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct PosteriorIn {
    /// An `iplw.scene/1` document; `calibrate` names the latents to be known.
    #[schema(value_type = Option<Object>)]
    pub scene: Option<Object<Scene>>,
    /// Instead of a scene, where one ball flies.
    #[schema(value_type = Option<BallIn>)]
    pub ball: Option<Object<BallIn>>,
    /// Trials as CSV, as for a diagnosis.
    #[schema(value_type = Option<TrialsIn>)]
    pub trials: Option<TrialsIn>,
    /// What the trials do not say of themselves.
    #[schema(value_type = Option<ReadingIn>)]
    pub reading: Option<Object<ReadingIn>>,
    /// Id of an estimation: its trials so far are asked.
    pub job: Option<String>,
    /// Sets of effects by name, each a model of its own, weighed by how it predicts trials from the others; `[]` is the scene as it
    /// is, which is the default.
    pub sets: Option<Vec<Vec<String>>>,
    /// Latents to be known, in place of the scene's `calibrate`.
    pub calibrate: Option<Vec<String>>,
    /// Mean and standard deviation by latent; else 1 and 0.5, for restitution 0.5 and 0.25.
    pub prior: Option<BTreeMap<String, [f64; 2]>>,
    /// `smc` (sequential Monte Carlo) or `mcmc` (Markov chains).
    pub method: Option<String>,
    /// Draws in all; 1024 if absent.
    pub draws: Option<usize>,
    /// Whether what trials share and the model lacks is allowed for; true if absent.
    pub discrepancy: Option<bool>,
    pub seed: Option<u64>,
}

impl PosteriorIn {
    /// The trials and their scene, what is wanted, and the latents that are to be known in place of the scene's.
    pub fn parts(self) -> (DiagnosisIn, Wanted, Option<Vec<String>>) {
        let PosteriorIn { scene, ball, trials, reading, job, seed, .. } = self;
        let wanted = Wanted {
            sets: self.sets.unwrap_or_default(),
            prior: self.prior.unwrap_or_default(),
            method: self.method,
            draws: self.draws,
            discrepancy: self.discrepancy,
            // Minutes of a server's processors for one request: on the command line only.
            follow: false,
            engine: Engine::Auto,
            seed: seed.unwrap_or(0),
        };
        (DiagnosisIn { scene, ball, trials, reading, job, seed }, wanted, self.calibrate)
    }
}
