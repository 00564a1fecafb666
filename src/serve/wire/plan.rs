//! Plans to make.

use serde::{Deserialize, Serialize};
use serde_json::{Map, Value};
use utoipa::ToSchema;

use super::physics::{EffectIn, LatentsIn, effects};
use super::strict::Object;
use super::world::engine;
use crate::error::{Error, Result, within};
use crate::plan::PlanConfig;
use crate::task::scene::EffectTerm;
use crate::world::Latents;

/// A task to plan, and what is believed of the world: the `belief` of a posterior, one world (`latents`, and `effects`), or, if
/// neither is given, the family's prior (and `effects`).
#[derive(Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct PlanIn {
    /// One task, `bowling:017`.
    pub task: String,
    /// An `iplw.posterior/1` document: equally likely draws as `columns`, of which only those, `effects` and `unnamed` are read.
    #[schema(value_type = Option<Object>)]
    pub belief: Option<Map<String, Value>>,
    /// One world; the scene's own where absent.
    #[schema(value_type = Option<LatentsIn>)]
    pub latents: Option<Object<LatentsIn>>,
    /// Effects of the believed world.
    #[schema(value_type = Option<Vec<EffectIn>>)]
    pub effects: Option<Vec<Object<EffectIn>>>,
    /// Actions looked at, up to 100,000; default 10,000.
    pub actions: Option<u64>,
    /// Worlds in which an action is tried, at most, up to 1000; and as many fresh ones for the best. Default 64.
    pub draws: Option<u64>,
    /// Most that a component of an action is moved in a copy, up to 1; default 0.002, and 0 tries actions as they are.
    pub perturb: Option<f64>,
    /// So many of the best are exact, and tried again under fresh draws: up to 100, default 10.
    pub exact: Option<u64>,
    /// Most rollouts of the race; what is known by then is the answer.
    pub rollouts: Option<u64>,
    /// Most seconds of the race, up to 3600; likewise, and the same request may then be answered differently.
    pub seconds: Option<f64>,
    /// `auto`, or the name of an engine.
    pub engine: Option<String>,
    pub seed: Option<u64>,
}

/// What is believed, as it was asked for.
#[derive(Serialize, Deserialize)]
#[serde(tag = "source", rename_all = "snake_case")]
pub enum Believing {
    Prior { effects: Vec<EffectTerm> },
    Point { latents: Latents, effects: Vec<EffectTerm> },
    Posterior { document: Value },
}

impl PlanIn {
    /// How the plan is searched for.
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
        self.seconds.map_or(Ok(0.0), |s| within("seconds", s, 0.0, 3600.0))?;
        Ok(config)
    }

    /// What is believed.
    pub fn believing(self) -> Result<Believing> {
        if let Some(document) = self.belief {
            let given = [("latents", self.latents.is_some()), ("effects", self.effects.is_some())];
            if let Some((field, _)) = given.iter().find(|(_, given)| *given) {
                return Err(Error::input(*field, "given beside belief", "one or the other"));
            }
            return Ok(Believing::Posterior { document: Value::Object(document) });
        }
        let effects = effects(None, self.effects, "")?.unwrap_or_default();
        Ok(match self.latents {
            Some(Object(latents)) => Believing::Point { latents: latents.checked("latents.")?, effects },
            None => Believing::Prior { effects },
        })
    }
}
