//! Measured trials and the simulation to compare them with: requests for diagnoses, and the data of other requests.

use std::borrow::Cow;
use std::collections::BTreeMap;
use std::fmt;

use serde::de::value::MapAccessDeserializer;
use serde::de::{MapAccess, Visitor};
use serde::{Deserialize, Deserializer};
use utoipa::openapi::RefOr;
use utoipa::openapi::schema::{OneOfBuilder, Schema};
use utoipa::{PartialSchema, ToSchema};

use crate::budget::Budget;
use crate::error::{Error, Result};
use crate::json::JsonObject;
use crate::reality::{LoadedTrials, Subject, TrackFile, TrackParseOptions, load_tracks};
use crate::task::Scene;
use crate::task::ball::BallScene;
use crate::world::effect;

/// Measured trials and the simulation to compare them with: `scene` (or `ball`) and `trials`, or the `job` that measured
/// them.
#[derive(Clone, Default, Deserialize, ToSchema, clap::Args)]
#[serde(deny_unknown_fields)]
#[schema(as = DiagnosisIn)]
pub struct DiagnosisRequest {
    /// An `iplw.scene/1` document: the base model; its `calibrate` lists the latents to estimate, too.
    #[arg(skip)]
    #[schema(value_type = Option<Object>)]
    pub scene: Option<JsonObject<Scene>>,
    /// A single ball, instead of a scene.
    #[arg(skip)]
    #[schema(value_type = Option<BallScene>)]
    pub ball: Option<JsonObject<BallScene>>,
    /// Trials as CSV: `trial,t,body,x,y` and optionally `setting,angle,vx,vy,omega`; or tracks of one body as exported by
    /// tracking software.
    #[arg(skip)]
    pub trials: Option<TrialFiles>,
    /// Units and options for reading the trials.
    #[arg(skip)]
    #[schema(value_type = Option<TrackParseOptions>)]
    pub reading: Option<JsonObject<TrackParseOptions>>,
    /// Id of an estimation, to use its trials so far.
    #[arg(skip)]
    pub job: Option<String>,
    #[arg(long, help = "Seed of the global search and of the bootstrap [default: 0]")]
    pub seed: Option<u64>,
}

/// Files of trials. In JSON they are the text of one, called `trials`, or texts by name.
#[derive(Clone)]
pub struct TrialFiles(pub Vec<TrackFile>);

impl DiagnosisRequest {
    /// Reads the trials and builds the scene. Errors name the request's fields.
    pub fn load(&self, budget: &dyn Budget) -> Result<LoadedTrials> {
        let subject = match (&self.scene, &self.ball) {
            (Some(JsonObject(scene)), None) => Subject::Scene(scene),
            (None, Some(JsonObject(ball))) => Subject::Ball(ball),
            (Some(_), Some(_)) => {
                return Err(Error::input("ball", "given together with scene", "one or the other"));
            }
            (None, None) => {
                let allowed = "a scene (or a ball) and its trials, or a job that has both";
                return Err(Error::input("scene", "missing", allowed));
            }
        };
        let Some(TrialFiles(files)) = &self.trials else {
            return Err(Error::input("trials", "missing", "a scene and its trials, or a job that has both"));
        };
        if let Subject::Scene(scene) = subject {
            let valid = scene.validate().and_then(|()| effect::validate_terms(&scene.effects));
            valid.map_err(|e| e.in_field("scene"))?;
        }
        if files.is_empty() {
            return Err(Error::input("trials", "empty", "at least one file"));
        }
        let default = TrackParseOptions::default();
        let reading = self.reading.as_ref().map_or(&default, |JsonObject(options)| options);
        load_tracks(files, subject, reading, budget).map_err(with_request_field)
    }
}

/// Prefixes an error's field with the field of the request it belongs to.
fn with_request_field(error: Error) -> Error {
    let Error::Input(input) = &error else { return error };
    let within = match input.field.as_str() {
        _ if !input.place.is_empty() => "trials",
        "radius" | "mass" | "gravity" | "floor" => "ball",
        "fps" | "metres_per_pixel" | "length_unit" | "time_unit" | "track" => "reading",
        _ => "trials",
    };
    error.in_field(within)
}

impl PartialSchema for TrialFiles {
    fn schema() -> RefOr<Schema> {
        let about = "The text of one file, or the texts of several by name; a file is one trial unless it has a `trial` column.";
        let texts = BTreeMap::<String, String>::schema();
        OneOfBuilder::new().item(String::schema()).item(texts).description(Some(about)).into()
    }
}

impl ToSchema for TrialFiles {
    fn name() -> Cow<'static, str> {
        "TrialsIn".into()
    }
}

impl<'de> Deserialize<'de> for TrialFiles {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> std::result::Result<Self, D::Error> {
        // Not derived: the errors of an untagged enum name neither the position nor the allowed values.
        deserializer.deserialize_any(TrialsVisitor)
    }
}

struct TrialsVisitor;

impl<'de> Visitor<'de> for TrialsVisitor {
    type Value = TrialFiles;

    fn expecting(&self, f: &mut fmt::Formatter) -> fmt::Result {
        f.write_str("the text of a file, or an object of texts by name")
    }

    fn visit_str<E: serde::de::Error>(self, text: &str) -> std::result::Result<TrialFiles, E> {
        self.visit_string(text.into())
    }

    fn visit_string<E: serde::de::Error>(self, text: String) -> std::result::Result<TrialFiles, E> {
        Ok(TrialFiles(vec![TrackFile { name: "trials".into(), text }]))
    }

    fn visit_map<A: MapAccess<'de>>(self, map: A) -> std::result::Result<TrialFiles, A::Error> {
        let texts = BTreeMap::<String, String>::deserialize(MapAccessDeserializer::new(map))?;
        Ok(TrialFiles(texts.into_iter().map(|(name, text)| TrackFile { name, text }).collect()))
    }
}
