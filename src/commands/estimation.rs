//! Requests for estimations.

use std::collections::BTreeMap;
use std::fmt;

use serde::de::value::MapAccessDeserializer;
use serde::de::{MapAccess, Visitor};
use serde::{Deserialize, Deserializer};
use utoipa::openapi::schema::{ObjectBuilder, OneOfBuilder, Type};
use utoipa::openapi::{Ref, RefOr, Schema};
use utoipa::{PartialSchema, ToSchema};

use super::physics::LatentsIn;
use crate::error::{Error, check_count, check_range};
use crate::experiment::{EstimateConfig, ResidualKind, acquisition};
use crate::json::JsonObject;
use crate::task::scene::EffectTerm;
use crate::task::{DEFAULT_FAMILY, Scene};
use crate::world::EffectParameter;
use crate::world::latent::{FACTORS, factor_index};

/// Description of `--strategy`.
const STRATEGY_HELP: &str = "Strategy: collisions, rolling, random, mixed, gradient, informative, probing or success [default: mixed]

The first six choose among candidates simulated at the current estimate. `probing` and `success` maximise the expected information gain over \
posterior samples, about latents and parameters or about the success of plans; they take about a minute a round.";

/// An estimation to run. The real world is `world` (interactions are counted there), one created for this job from `real`, or,
/// with `"real": "ask_tell"`, the client's own: it carries out `/v1/iplw/{id}/proposals` and submits measurements to
/// `/v1/iplw/{id}/trials`. Default: the family's standard real world.
#[derive(Clone, Deserialize, ToSchema, clap::Args)]
#[serde(deny_unknown_fields)]
#[schema(as = EstimationIn)]
pub struct EstimationRequest {
    /// A family (its training tasks are explored) or one task.
    #[serde(default)]
    #[arg(long, default_value = DEFAULT_FAMILY, help = "Family, or a task such as bowling:017")]
    pub task: String,
    /// Instead of `task`: an `iplw.scene/1` document of your rig, with an action space (`action`) and no goal.
    #[arg(skip)]
    #[schema(value_type = Option<Object>)]
    pub scene: Option<JsonObject<Scene>>,
    /// Prior of latents, `{"friction": [mean, standard deviation]}`. Default: the family's; with
    /// a `scene` density 1 +- 0.5 kg/m^2, friction 0.5 +- 0.25, restitution 0.5 +- 0.25.
    #[arg(skip)]
    pub prior: Option<BTreeMap<String, Vec<f64>>>,
    /// Id of a real world of that family.
    #[arg(skip)]
    pub world: Option<String>,
    /// A real world to create for this job, or `ask_tell`.
    #[arg(skip)]
    pub real: Option<RealChoice>,
    /// `mixed` (default), `collisions`, `rolling`, `random`, `gradient`, `informative`; or, based on posterior draws and taking
    /// about a minute per round, `probing` (most information on parameters) or `success` (on whether plans work).
    #[arg(long, long_help = STRATEGY_HELP)]
    #[arg(
        help = "Strategy: collisions, rolling, random, mixed, gradient, informative, probing or success [default: mixed]"
    )]
    pub strategy: Option<String>,
    /// Id of the family's performance surface, for `gradient` and `informative`; `gradient` computes a small one by default.
    #[arg(skip)]
    pub surface: Option<String>,
    /// `trajectory` (default): simulate from start to end; `shooting` (multiple shooting): simulate segments from observed
    /// states, which is robust to noise, chaotic collisions and small model errors.
    #[arg(long)]
    #[arg(
        help = "Residual: trajectory (simulated from start to end) or shooting (from observed states) [default: trajectory]"
    )]
    pub residual: Option<String>,
    /// Effect parameters to estimate together with the latents: `linear_drag.c`, `wind.ax`.
    #[arg(long, help = "Effect parameter to fit as well, such as wind.ax; may be repeated")]
    pub fit: Option<Vec<String>>,
    /// Maximum number of rounds of exploring, measuring and fitting. Default: 5.
    #[arg(long, help = "Maximum number of rounds [default: the preset's]")]
    pub rounds: Option<u64>,
    /// Real interactions per round. Default: 10.
    #[arg(long, help = "Real interactions per round [default: the preset's]")]
    pub actions: Option<u64>,
    /// Latent samples per iteration of the search.
    #[arg(long, help = "Latent samples per iteration of the search [default: the preset's]")]
    pub samples: Option<u64>,
    #[arg(long, help = "Random seed [default: 0]")]
    pub seed: Option<u64>,
    /// Maximum number of real interactions.
    #[arg(long)]
    pub budget: Option<u64>,
}

/// `ask_tell`, or a world to create.
#[derive(Clone)]
pub enum RealChoice {
    AskTell,
    World(Box<RealIn>),
}

impl PartialSchema for RealChoice {
    fn schema() -> RefOr<Schema> {
        let word = ObjectBuilder::new().schema_type(Type::String).enum_values(Some(["ask_tell"]));
        OneOfBuilder::new().item(word).item(Ref::from_schema_name("RealIn")).into()
    }
}

impl ToSchema for RealChoice {
    fn schemas(schemas: &mut Vec<(String, RefOr<Schema>)>) {
        schemas.push(("RealIn".into(), RealIn::schema()));
        RealIn::schemas(schemas);
    }
}

/// A real world; absent fields are those of the family's standard real world.
#[derive(Clone, Default, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct RealIn {
    /// Fraction of velocity kept per second, in (0, 1].
    pub damping: Option<f64>,
    #[schema(value_type = Option<LatentsIn>)]
    pub latents: Option<JsonObject<LatentsIn>>,
    #[schema(value_type = Option<Vec<EffectTerm>>)]
    pub effects: Option<Vec<JsonObject<EffectTerm>>>,
    /// Standard deviation of observation noise, m.
    pub noise: Option<f64>,
}

impl EstimationRequest {
    /// `preset` with the request's values.
    pub fn config(&self, preset: EstimateConfig) -> crate::error::Result<EstimateConfig> {
        let mut config = preset;
        for (name, moments) in self.prior.iter().flatten() {
            let [mean, sd] = moments.as_slice() else {
                let value = format!("{} numbers", moments.len());
                return Err(Error::input(format!("prior.{name}"), value, "[mean, standard deviation]"));
            };
            let factor = factor_index(name).map_err(|e| e.unknown_in("prior"))?;
            let [low, high] = FACTORS[factor].bounds;
            check_range(&format!("prior.{name}[0]"), *mean, low, high)?;
            check_range(&format!("prior.{name}[1]"), *sd, 1e-6, high - low)?;
            config.cem.prior[factor] = (*mean, *sd);
        }
        if let Some(name) = &self.strategy {
            acquisition::question(name).map_err(|e| e.unknown_in("strategy"))?;
            config.strategy = name.clone();
        }
        if let Some(name) = &self.residual {
            config.residual = ResidualKind::from_name(name).map_err(|e| e.unknown_in("residual"))?;
        }
        for name in self.fit.iter().flatten() {
            config.cem.add_free_parameter(EffectParameter::parse(name).map_err(|e| e.unknown_in("fit"))?);
        }
        config.rounds = self.rounds.map_or(config.rounds, |n| n as usize);
        config.actions = self.actions.map_or(config.actions, |n| n as usize);
        config.candidates = config.candidates.max(config.actions.saturating_mul(10));
        check_count("samples", self.samples, 4, 100_000)?;
        if let Some(samples) = self.samples {
            config.cem.elites = (samples as usize * config.cem.elites / config.cem.samples).max(2);
            config.cem.samples = samples as usize;
        }
        config.seed = self.seed.unwrap_or(0);
        config.validate()?;
        Ok(config)
    }
}

impl<'de> Deserialize<'de> for RealChoice {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        // Not derived: the errors of an untagged enum name neither the position nor the allowed values.
        deserializer.deserialize_any(RealVisitor)
    }
}

struct RealVisitor;

impl<'de> Visitor<'de> for RealVisitor {
    type Value = RealChoice;

    fn expecting(&self, f: &mut fmt::Formatter) -> fmt::Result {
        f.write_str("\"ask_tell\", or an object that describes a real world")
    }

    fn visit_str<E: serde::de::Error>(self, word: &str) -> Result<RealChoice, E> {
        match word {
            "ask_tell" => Ok(RealChoice::AskTell),
            other => Err(E::invalid_value(serde::de::Unexpected::Str(other), &self)),
        }
    }

    fn visit_map<A: MapAccess<'de>>(self, map: A) -> Result<RealChoice, A::Error> {
        RealIn::deserialize(MapAccessDeserializer::new(map)).map(|real| RealChoice::World(Box::new(real)))
    }
}
