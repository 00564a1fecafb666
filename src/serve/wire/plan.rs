//! Requests for plans.

use serde::{Deserialize, Serialize};
use serde_json::{Map, Value};
use utoipa::ToSchema;

use super::json_object::JsonObject;
use super::physics::{EffectIn, LatentsIn, effects};
use super::world::engine;
use crate::error::{Error, Result, check_range};
use crate::plan::PlanConfig;
use crate::task::scene::EffectTerm;
use crate::world::Latents;

/// A task to plan, and the distribution of worlds: a posterior (`posterior`), a single world (`latents` and `effects`), or by
/// default the family's prior (with `effects`).
#[derive(Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct PlanIn {
    /// One task, `bowling:017`.
    pub task: String,
    /// An `iplw.posterior/2` document of equally weighted draws; only `columns`, `effects` and `discrepancy` are read.
    #[schema(value_type = Option<Object>)]
    pub posterior: Option<Map<String, Value>>,
    /// Latents of a single world; absent ones are the scene's own.
    #[schema(value_type = Option<LatentsIn>)]
    pub latents: Option<JsonObject<LatentsIn>>,
    /// Effects of the world.
    #[schema(value_type = Option<Vec<EffectIn>>)]
    pub effects: Option<Vec<JsonObject<EffectIn>>>,
    /// Number of candidate actions, up to 100,000. Default: 10,000.
    pub actions: Option<u64>,
    /// Maximum number of sampled worlds per action, up to 1000, and as many new ones for the best actions. Default: 64.
    pub draws: Option<u64>,
    /// Maximum perturbation of an action component, up to 1; 0 for none. Default: 0.002.
    pub perturb: Option<f64>,
    /// Number of best actions to identify exactly and re-evaluate in new worlds, up to 100. Default: 10.
    pub exact: Option<u64>,
    /// Maximum number of rollouts; the result is the best known by then.
    pub rollouts: Option<u64>,
    /// Maximum seconds, up to 3600; with it, results may differ between runs.
    pub seconds: Option<f64>,
    /// `auto`, or the name of an engine.
    pub engine: Option<String>,
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

impl PlanIn {
    /// The configuration of the search.
    pub fn config(&self) -> Result<PlanConfig> {
        let usual = PlanConfig::standard(self.seed.unwrap_or(0));
        let whole = |field: &str, value: Option<u64>, default: usize, most: u64| match value {
            None => Ok(default),
            Some(v) if (1..=most).contains(&v) => Ok(v as usize),
            Some(v) => Err(Error::input(field, v, format!("a whole number from 1 to {most}"))),
        };
        let config = PlanConfig {
            actions: whole("actions", self.actions, usual.actions, 100_000)?,
            draws: whole("draws", self.draws, usual.draws, 1000)?,
            perturb: self.perturb.unwrap_or(usual.perturb),
            exact: whole("exact", self.exact, usual.exact, 100)?,
            rollouts: self.rollouts.map(|n| whole("rollouts", Some(n), 0, 1_000_000_000)).transpose()?,
            engine: engine(self.engine.as_deref())?,
            ..usual
        };
        config.validate()?;
        self.seconds.map_or(Ok(0.0), |s| check_range("seconds", s, 0.0, 3600.0))?;
        Ok(config)
    }

    /// The distribution of worlds.
    pub fn parameter_source(self) -> Result<ParameterSource> {
        if let Some(document) = self.posterior {
            let given = [("latents", self.latents.is_some()), ("effects", self.effects.is_some())];
            if let Some((field, _)) = given.iter().find(|(_, given)| *given) {
                return Err(Error::input(*field, "given together with posterior", "one or the other"));
            }
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
