//! Jobs and their events; requests for estimations.

use std::fmt;

use serde::de::value::MapAccessDeserializer;
use serde::de::{MapAccess, Visitor};
use serde::{Deserialize, Deserializer, Serialize};
use serde_json::Value;
use utoipa::openapi::schema::{ObjectBuilder, OneOfBuilder, Type};
use utoipa::openapi::{Ref, RefOr, Schema};
use utoipa::{PartialSchema, ToSchema};

use super::binary_arrays::BinaryArrays;
use super::json_object::JsonObject;
use super::physics::{EffectIn, LatentsIn};
use crate::job::{Figure, Job};
use crate::serve::problem::Problem;

/// An estimation to run. The real world is `world` (interactions are counted there), one created for this job from `real`, or,
/// with `"real": "ask_tell"`, the client's own: it carries out `/v1/iplw/{id}/proposals` and submits measurements to
/// `/v1/iplw/{id}/trials`. Default: the family's standard real world.
#[derive(Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct EstimationIn {
    /// A family (its training tasks are explored) or one task.
    pub task: String,
    /// Id of a real world of that family.
    pub world: Option<String>,
    /// A real world to create for this job, or `ask_tell`.
    pub real: Option<RealChoice>,
    /// `mixed` (default), `collisions`, `rolling`, `random`, `gradient`, `informative`; or, based on posterior draws and taking
    /// about a minute per round, `probing` (most information on parameters) or `success` (on whether plans work).
    pub strategy: Option<String>,
    /// Id of the family's performance surface, for `gradient` and `informative`; `gradient` computes a small one by default.
    pub surface: Option<String>,
    /// `trajectory` (default): simulate from start to end; `shooting` (multiple shooting): simulate segments from observed
    /// states, which is robust to noise, chaotic collisions and small model errors.
    pub residual: Option<String>,
    /// Effect parameters to estimate together with the latents: `linear_drag.c`, `wind.ax`.
    pub fit: Option<Vec<String>>,
    /// Maximum number of rounds of exploring, measuring and fitting. Default: 5.
    pub rounds: Option<u64>,
    /// Real interactions per round. Default: 10.
    pub actions: Option<u64>,
    /// Latent samples per iteration of the search.
    pub samples: Option<u64>,
    pub seed: Option<u64>,
    /// Maximum number of real interactions.
    pub budget: Option<u64>,
}

/// `ask_tell`, or a world to create.
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
#[derive(Default, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct RealIn {
    /// Fraction of velocity kept per second, in (0, 1].
    pub damping: Option<f64>,
    #[schema(value_type = Option<LatentsIn>)]
    pub latents: Option<JsonObject<LatentsIn>>,
    #[schema(value_type = Option<Vec<EffectIn>>)]
    pub effects: Option<Vec<JsonObject<EffectIn>>>,
    /// Standard deviation of observation noise, m.
    pub noise: Option<f64>,
}

/// An asynchronous job.
#[derive(Serialize, ToSchema)]
pub struct JobOut {
    pub id: String,
    /// `iplw`, `diagnose`, `surface`, `train`, `learn` or `evaluate`.
    pub kind: String,
    /// `queued`, `running`, `waiting` (for submitted trials), `succeeded`, `failed` or `cancelled`.
    pub state: &'static str,
    pub progress: ProgressOut,
    /// The request, without large data.
    #[schema(value_type = Object)]
    pub config: Value,
    /// Result, if succeeded.
    #[schema(value_type = Option<Object>)]
    pub result: Option<Value>,
    /// Error, if failed.
    #[schema(value_type = Option<Problem>)]
    pub error: Option<Value>,
    pub seed: u64,
    /// Version of the program that ran it.
    pub version: String,
}

/// Progress of a job.
#[derive(Serialize, ToSchema)]
pub struct ProgressOut {
    pub stage: String,
    pub done: u64,
    pub total: u64,
    /// Estimated remaining seconds: of all rounds for an estimation (after the first), otherwise of the stage; `null` while
    /// unknown.
    pub eta_s: Option<f64>,
    /// In events: metrics since the previous event. `loss`: mean binary cross-entropy of the batches since then, nats;
    /// `validation`: AUCCESS on validation tasks.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub figures: Vec<FigureOut>,
}

/// A metric reported during a job.
#[derive(Serialize, ToSchema)]
pub struct FigureOut {
    pub name: &'static str,
    /// Completed units of the stage.
    pub at: u64,
    pub value: f64,
}

/// All jobs.
#[derive(Serialize, ToSchema)]
pub struct JobsPage {
    pub jobs: Vec<JobOut>,
    /// Cursor of the next page, if there is one.
    pub next: Option<String>,
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

impl From<Job> for JobOut {
    fn from(job: Job) -> JobOut {
        let row = job.row;
        JobOut {
            id: job.id,
            kind: row.kind,
            state: row.state.name(),
            progress: ProgressOut {
                stage: row.stage,
                done: row.done,
                total: row.total,
                eta_s: job.left,
                figures: job.figures.into_iter().map(FigureOut::from).collect(),
            },
            config: row.config,
            result: row.result,
            error: row.error,
            seed: row.seed,
            version: row.version,
        }
    }
}

impl From<Figure> for FigureOut {
    fn from(Figure { name, at, value }: Figure) -> FigureOut {
        FigureOut { name, at, value }
    }
}

impl BinaryArrays for JobOut {}
impl BinaryArrays for JobsPage {}
