//! Requests for the training of policies in simulation.

use serde::Deserialize;
use serde_json::{Map, Value};
use utoipa::ToSchema;

use super::physics::{LatentsIn, effects, parse_effect, parse_latents};
use super::posterior::exclude_with_posterior;
use crate::error::{Error, Result, check_count};
use crate::estimate::ParameterSamples;
use crate::json::JsonObject;
use crate::policy::{TrainConfig, TrainingPhysics};
use crate::task::scene::EffectTerm;
use crate::task::{DEFAULT_FAMILY, Learning};
use crate::world::Latents;

/// Maximum number of posterior draws to store with a training.
const MAX_DRAWS: usize = 10_000;
/// Description of `--preset`, whose default depends on other options.
const PRESET_HELP: &str = "Length of training: saturating or paper [default: saturating for a family, otherwise paper]

`saturating` trains until AUCCESS on the simulated validation tasks stops improving, and keeps the best weights; by default it labels at \
least 1000 actions per task and uses batches of at least 64. `paper` does the family's number of updates. With --batches, with --outcomes \
and for a single task the default is `paper`.";

/// A policy to train in simulation: in a fixed one (`latents` and `effects`), with domain randomisation (`training`), or in draws
/// from a posterior (`posterior`).
#[derive(Clone, Deserialize, ToSchema, clap::Args)]
#[serde(deny_unknown_fields)]
#[schema(as = TrainIn)]
pub struct TrainingRequest {
    /// A family (its training tasks are used) or one task.
    #[arg(long, default_value = DEFAULT_FAMILY, help = "Family, or one of its tasks")]
    pub task: String,
    /// `fixed` (default): one simulation; `randomised`: random latents for every rollout.
    #[arg(long = "randomised", num_args = 0, default_missing_value = "randomised")]
    #[arg(conflicts_with = "latents", help = "Domain randomisation over the paper's ranges")]
    pub training: Option<TrainingWorlds>,
    /// An `iplw.posterior/2` document: every action is labelled in one of its draws, including their discrepancy fields. Replaces
    /// `training`, `latents` and `effects`.
    #[arg(skip)]
    #[schema(value_type = Option<Object>)]
    pub posterior: Option<Map<String, Value>>,
    /// Latents of the fixed simulation, such as an estimate. Default: the family's prior mean.
    #[arg(long, value_parser = parse_latents)]
    #[arg(
        help = "Latents of the simulation: density=..,friction=..,restitution=.. [default: the family's prior mean]"
    )]
    #[schema(value_type = Option<LatentsIn>)]
    pub latents: Option<JsonObject<LatentsIn>>,
    /// Effects of the simulation.
    #[arg(long = "effect", value_name = "EFFECT", value_parser = parse_effect)]
    #[arg(help = "Effect of the simulation, name:parameter=value,..; may be repeated")]
    #[schema(value_type = Option<Vec<EffectTerm>>)]
    pub effects: Option<Vec<JsonObject<EffectTerm>>>,
    /// Training length. `paper` (default): a fixed number of `batches`. `saturating`: early stopping on AUCCESS of the validation
    /// tasks in the same simulation, keeping the best weights and reporting `validation`; uses at least 1000 labels per task and
    /// batches of 64.
    #[arg(long, long_help = PRESET_HELP)]
    #[arg(help = "Length of training [default: saturating for a family, otherwise paper]")]
    pub preset: Option<TrainingPreset>,
    /// Number of updates. Default: the family's.
    #[arg(long, help = "Number of updates (implies --preset paper) [default: the family's]")]
    pub batches: Option<u64>,
    /// Examples per update. Default: the family's.
    #[arg(long, help = "Examples per update, half of them successes [default: the family's]")]
    pub batch_size: Option<u64>,
    /// Number of evaluations of AUCCESS on validation tasks during training, up to 100; reported in events and result as
    /// `validation`. Default: 0.
    #[arg(skip)]
    pub validations: Option<u64>,
    #[arg(long, help = "Random seed [default: 0]")]
    pub seed: Option<u64>,
}

/// How the training simulation's latents are chosen.
#[derive(Clone, Copy, PartialEq, Deserialize, ToSchema, clap::ValueEnum)]
#[serde(rename_all = "snake_case")]
#[schema(as = TrainingIn)]
pub enum TrainingWorlds {
    Fixed,
    Randomised,
}

/// Training length of a policy.
#[derive(Clone, Copy, PartialEq, Deserialize, ToSchema, clap::ValueEnum)]
#[serde(rename_all = "snake_case")]
#[schema(as = TrainPresetIn)]
pub enum TrainingPreset {
    Paper,
    Saturating,
}

impl TrainingRequest {
    /// The length of training; by default that of `usual`.
    pub fn config(&self, usual: &Learning) -> Result<TrainConfig> {
        let usual = TrainConfig::preset(usual);
        let config = TrainConfig {
            batches: self.batches.map_or(usual.batches, |n| n as usize),
            batch_size: self.batch_size.map_or(usual.batch_size, |n| n as usize),
            seed: self.seed.unwrap_or(0),
            ..usual
        };
        config.validate()?;
        Ok(config)
    }

    /// Errors for more work than a server accepts.
    pub fn check_limits(&self) -> Result<()> {
        check_count("batches", self.batches, 1, 100_000)?;
        check_count("validations", self.validations, 0, 100)
    }

    /// The simulation in which actions are labelled; `usual` are the latents of a fixed one by default.
    pub fn physics(&mut self, usual: Latents) -> Result<TrainingPhysics> {
        if let Some(document) = self.posterior.take() {
            exclude_with_posterior(&[
                ("training", self.training.is_some()),
                ("latents", self.latents.is_some()),
                ("effects", self.effects.is_some()),
            ])?;
            let samples =
                ParameterSamples::from_value(Value::Object(document)).map_err(|e| e.in_field("posterior"))?;
            let draws = samples.draws().len();
            if draws > MAX_DRAWS {
                return Err(Error::input(
                    "posterior",
                    format!("{draws} draws"),
                    format!("at most {MAX_DRAWS}"),
                ));
            }
            return Ok(TrainingPhysics::from_posterior(&samples));
        }
        let given = self.latents.take().map(|JsonObject(l)| l.checked("latents.")).transpose()?;
        let effects = effects(None, self.effects.take(), "")?.unwrap_or_default();
        match self.training.unwrap_or(TrainingWorlds::Fixed) {
            TrainingWorlds::Fixed => {
                Ok(TrainingPhysics::Fixed { latents: given.unwrap_or_default().or(usual), effects })
            }
            TrainingWorlds::Randomised if given.is_some() => {
                let allowed = "no latents: randomised training draws them";
                Err(Error::input("latents", "given together with `training`: \"randomised\"", allowed))
            }
            TrainingWorlds::Randomised => Ok(TrainingPhysics::paper_randomised(effects)),
        }
    }
}
