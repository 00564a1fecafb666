//! Requests for plans.

use std::time::{Duration, Instant};

use serde::{Deserialize, Serialize};
use serde_json::{Map, Value};
use utoipa::ToSchema;

use super::physics::{LatentsIn, effects, engine, parse_effect, parse_latents};
use super::posterior::exclude_with_posterior;
use crate::budget::Budget;
use crate::error::{Error, Result, check_count, check_range};
use crate::estimate::ParameterSamples;
use crate::estimate::parameter_samples::PRIOR_SAMPLE_COUNT;
use crate::json::JsonObject;
use crate::plan::PlanConfig;
use crate::task::scene::EffectTerm;
use crate::task::{DEFAULT_FAMILY, family};
use crate::world::Latents;

/// A task to plan, and the distribution of worlds: a posterior (`posterior`), a single world (`latents` and `effects`), or by
/// default the family's prior (with `effects`).
#[derive(Clone, Deserialize, ToSchema, clap::Args)]
#[serde(deny_unknown_fields)]
#[schema(as = PlanIn)]
pub struct PlanRequest {
    /// One task, `bowling:017`.
    #[arg(long, default_value = DEFAULT_FAMILY, help = "Task such as bowling:017, or a family")]
    pub task: String,
    /// An `iplw.posterior/2` document of equally weighted draws; only `columns`, `effects` and `discrepancy` are read.
    #[arg(skip)]
    #[schema(value_type = Option<Object>)]
    pub posterior: Option<Map<String, Value>>,
    /// Latents of a single world; absent ones are the family's prior mean.
    #[arg(long, value_parser = parse_latents, help = "Use one world: density=..,friction=..,restitution=..")]
    #[schema(value_type = Option<LatentsIn>)]
    pub latents: Option<JsonObject<LatentsIn>>,
    /// Effects of the world.
    #[arg(long = "effect", value_name = "EFFECT", value_parser = parse_effect)]
    #[arg(help = "Effect of the simulated world, name:parameter=value,..; may be repeated")]
    #[schema(value_type = Option<Vec<EffectTerm>>)]
    pub effects: Option<Vec<JsonObject<EffectTerm>>>,
    /// Number of candidate actions, up to 100,000. Default: 10,000.
    #[arg(long, help = "Number of candidate actions [default: 10000]")]
    pub actions: Option<u64>,
    /// Maximum number of sampled worlds per action, up to 1000, and as many new ones for the best actions. Default: 64.
    #[arg(long, help = "Maximum rollouts per action; the best get as many new ones [default: 64]")]
    pub draws: Option<u64>,
    /// Maximum perturbation of an action component, up to 1; 0 for none. Default: 0.002.
    #[arg(long)]
    pub perturb: Option<f64>,
    /// Number of best actions to identify exactly and re-evaluate in new worlds, up to 100. Default: 10.
    #[arg(long, help = "Number of best actions that are exact and evaluated again [default: 10]")]
    pub exact: Option<u64>,
    /// Maximum number of rollouts; the result is the best known by then.
    #[arg(long)]
    pub rollouts: Option<u64>,
    /// Maximum seconds, up to 3600; with it, results may differ between runs.
    #[arg(long, help = "Maximum seconds of the ranking")]
    pub seconds: Option<f64>,
    /// `auto`, or the name of an engine.
    #[arg(long, help = "Physics engine: auto, rapier, lanes or gpu [default: auto]")]
    pub engine: Option<String>,
    #[arg(long, help = "Random seed [default: 0]")]
    pub seed: Option<u64>,
}

/// The distribution of worlds to plan for.
#[derive(Serialize, Deserialize)]
#[serde(tag = "source", rename_all = "snake_case")]
pub enum ParameterSource {
    Prior { effects: Vec<EffectTerm> },
    Point { latents: Latents, effects: Vec<EffectTerm> },
    Posterior { document: Value },
}

/// A time limit in addition to another budget.
pub struct TimeLimit<'a> {
    budget: &'a dyn Budget,
    /// The end, and the seconds until then.
    limit: Option<(Instant, f64)>,
}

impl PlanRequest {
    /// The configuration of the search.
    pub fn config(&self) -> Result<PlanConfig> {
        let usual = PlanConfig::standard(self.seed.unwrap_or(0));
        let config = PlanConfig {
            actions: self.actions.map_or(usual.actions, |n| n as usize),
            draws: self.draws.map_or(usual.draws, |n| n as usize),
            perturb: self.perturb.unwrap_or(usual.perturb),
            exact: self.exact.map_or(usual.exact, |n| n as usize),
            rollouts: self.rollouts.map(|n| n as usize),
            engine: engine(self.engine.as_deref())?,
            ..usual
        };
        config.validate()?;
        Ok(config)
    }

    /// Errors for more work than a server accepts.
    pub fn check_limits(&self) -> Result<()> {
        check_count("actions", self.actions, 1, 100_000)?;
        check_count("draws", self.draws, 1, 1000)?;
        check_count("exact", self.exact, 1, 100)?;
        check_count("rollouts", self.rollouts, 1, 1_000_000_000)?;
        self.seconds.map_or(Ok(0.0), |s| check_range("seconds", s, 0.0, 3600.0)).map(drop)
    }

    /// The distribution of worlds.
    pub fn parameter_source(self) -> Result<ParameterSource> {
        if let Some(document) = self.posterior {
            exclude_with_posterior(&[
                ("latents", self.latents.is_some()),
                ("effects", self.effects.is_some()),
            ])?;
            return Ok(ParameterSource::Posterior { document: Value::Object(document) });
        }
        let effects = effects(None, self.effects, "")?.unwrap_or_default();
        Ok(match self.latents {
            Some(JsonObject(latents)) => {
                ParameterSource::Point { latents: latents.checked("latents.")?, effects }
            }
            None => ParameterSource::Prior { effects },
        })
    }
}

impl ParameterSource {
    /// Draws of the distribution for planning `task`.
    pub fn samples(&self, task: &str, config: &PlanConfig) -> Result<ParameterSamples> {
        match self {
            ParameterSource::Prior { effects } => {
                let prior = family(task.split(':').next().unwrap_or_default())?.prior;
                let count = PRIOR_SAMPLE_COUNT.max(2 * config.draws);
                ParameterSamples::prior(prior, effects.clone(), count, config.seed)
            }
            ParameterSource::Point { latents, effects } => ParameterSamples::point(*latents, effects.clone()),
            ParameterSource::Posterior { document } => {
                ParameterSamples::from_value(document.clone()).map_err(|e| e.in_field("posterior"))
            }
        }
    }
}

impl TimeLimit<'_> {
    /// A limit of `seconds` from now, if any.
    pub fn new(seconds: Option<f64>, budget: &dyn Budget) -> TimeLimit<'_> {
        TimeLimit { budget, limit: seconds.map(|s| (Instant::now() + Duration::from_secs_f64(s), s)) }
    }
}

impl Budget for TimeLimit<'_> {
    fn check(&self) -> Result<()> {
        self.budget.check()?;
        match self.limit {
            Some((end, seconds)) if Instant::now() >= end => Err(Error::Deadline { seconds }),
            _ => Ok(()),
        }
    }
}
