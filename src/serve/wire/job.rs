//! Jobs and their events; the request of an estimation.

use std::fmt;

use serde::de::value::MapAccessDeserializer;
use serde::de::{MapAccess, Visitor};
use serde::{Deserialize, Deserializer, Serialize};
use serde_json::Value;
use utoipa::openapi::schema::{ObjectBuilder, OneOfBuilder, Type};
use utoipa::openapi::{Ref, RefOr, Schema};
use utoipa::{PartialSchema, ToSchema};

use super::bulk::Bulk;
use super::physics::{EffectIn, LatentsIn};
use super::strict::Object;
use crate::job::{Figure, Job};
use crate::serve::problem::Problem;

/// An estimation to run. The real world is `world` (its interactions are counted there), one made for this job from
/// `real`, or, with `"real": "ask_tell"`, whoever carries out `/v1/iplw/{id}/proposals` and sends what was measured
/// to `/v1/iplw/{id}/trials`; without either, the family's standard one.
#[derive(Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct Estimation {
    /// A family (`bowling`: its training tasks are explored) or one task.
    pub task: String,
    /// Id of a real world of that family.
    pub world: Option<String>,
    /// A real world for this job alone, or `ask_tell`.
    pub real: Option<RealChoice>,
    /// `collisions`, `rolling`, `random`, `gradient`, `informative` or `mixed` (the default); or, of what is drawn as known, `probing` (what
    /// tells most of latents and parameters) or `success` (what tells most of whether plans work), a minute a round.
    pub strategy: Option<String>,
    /// Id of the family's performance surface, for `gradient` and `informative`; `gradient` finds a small one itself
    /// if none is named.
    pub surface: Option<String>,
    /// `trajectory` (the default): simulated from the start to the end; `shooting`: anew from where things were seen,
    /// a stretch at a time, which bears noise, chance in collisions and a simulation that is not quite the world.
    pub residual: Option<String>,
    /// Parameters of effects that the simulation is given and that are fitted along with the latents:
    /// `linear_drag.c`, `wind.ax`.
    pub fit: Option<Vec<String>>,
    /// Most rounds of exploring, measuring and fitting; default 5.
    pub rounds: Option<u64>,
    /// Real interactions a round; default 10.
    pub actions: Option<u64>,
    /// Latent samples per iteration of the search.
    pub samples: Option<u64>,
    pub seed: Option<u64>,
    /// Most real interactions in all.
    pub budget: Option<u64>,
}

/// `ask_tell`, or a world to be made.
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

/// A real world, where it differs from the family's standard one.
#[derive(Default, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct RealIn {
    /// Kept share of velocity per second, in (0, 1].
    pub damping: Option<f64>,
    #[schema(value_type = Option<LatentsIn>)]
    pub latents: Option<Object<LatentsIn>>,
    #[schema(value_type = Option<Vec<EffectIn>>)]
    pub effects: Option<Vec<Object<EffectIn>>>,
    /// Standard deviation of observation noise, m.
    pub noise: Option<f64>,
}

/// Long work.
#[derive(Serialize, ToSchema)]
pub struct JobOut {
    pub id: String,
    /// `iplw`, `diagnose`, `surface`, `train`, `learn` or `evaluate`.
    pub kind: String,
    /// `queued`, `running`, `waiting` (for answers to its proposals), `succeeded`, `failed` or `cancelled`.
    pub state: &'static str,
    pub progress: ProgressOut,
    /// What was asked for.
    #[schema(value_type = Object)]
    pub config: Value,
    /// When succeeded.
    #[schema(value_type = Option<Object>)]
    pub result: Option<Value>,
    /// When failed: why.
    #[schema(value_type = Option<Problem>)]
    pub error: Option<Value>,
    pub seed: u64,
    /// Version of the program that ran it.
    pub version: String,
}

/// How far a job is.
#[derive(Serialize, ToSchema)]
pub struct ProgressOut {
    pub stage: String,
    pub done: u64,
    pub total: u64,
    /// Seconds left at the rate so far: of all rounds for an estimation (once one is finished), else of the stage;
    /// `null` while not known.
    pub eta_s: Option<f64>,
    /// In events: what the work told since the event before. `loss`: binary cross-entropy, nats, the mean of the batches
    /// since the last one told; `validation`: AUCCESS on tasks not learned from.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub figures: Vec<FigureOut>,
}

/// A figure on the way.
#[derive(Serialize, ToSchema)]
pub struct FigureOut {
    pub name: &'static str,
    /// Units of the stage that were done.
    pub at: u64,
    pub value: f64,
}

/// All jobs.
#[derive(Serialize, ToSchema)]
pub struct Jobs {
    pub jobs: Vec<JobOut>,
    /// Cursor of the next page, if there is one.
    pub next: Option<String>,
}

impl<'de> Deserialize<'de> for RealChoice {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        // Not derived: an untagged enum's errors name neither the place nor what is allowed.
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

impl Bulk for JobOut {}
impl Bulk for Jobs {}
