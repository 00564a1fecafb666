//! Requests for diagnoses, and the trials of one.

use std::collections::BTreeMap;
use std::fmt;

use serde::de::value::MapAccessDeserializer;
use serde::de::{MapAccess, Visitor};
use serde::{Deserialize, Deserializer, Serialize};
use utoipa::ToSchema;

use super::ask_tell::TrackOut;
use super::binary_arrays::BinaryArrays;
use super::json_object::JsonObject;
use crate::reality::{TrackFile, TrackParseOptions, Trial};
use crate::task::Scene;
use crate::task::ball::{BallScene, STANDARD_GRAVITY_M_S2};

/// Measured trials and the simulation to compare them with: `scene` (or `ball`) and `trials`, or the `job` that measured
/// them.
#[derive(Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct DiagnosisIn {
    /// An `iplw.scene/1` document: the base model; its `calibrate` lists the latents to estimate, too.
    #[schema(value_type = Option<Object>)]
    pub scene: Option<JsonObject<Scene>>,
    /// A single ball, instead of a scene.
    #[schema(value_type = Option<BallIn>)]
    pub ball: Option<JsonObject<BallIn>>,
    /// Trials as CSV: `trial,t,body,x,y` and optionally `setting,angle,vx,vy,omega`; or tracks of one body as exported by
    /// tracking software.
    #[schema(value_type = Option<TrialsIn>)]
    pub trials: Option<TrialsIn>,
    /// Units and options for reading the trials.
    #[schema(value_type = Option<ReadingIn>)]
    pub reading: Option<JsonObject<ReadingIn>>,
    /// Id of an estimation, to use its trials so far.
    pub job: Option<String>,
    pub seed: Option<u64>,
}

/// The text of one file, or the texts of several by name; a file is one trial unless it has a `trial` column.
#[derive(Serialize, ToSchema)]
#[serde(untagged)]
pub enum TrialsIn {
    One(String),
    Several(BTreeMap<String, String>),
}

/// The trials of a diagnosis.
#[derive(Serialize, ToSchema)]
pub struct DiagnosisTrials {
    /// An `iplw.scene/1` document: the base model.
    #[schema(value_type = Object)]
    pub scene: Scene,
    /// In the order of the request.
    pub trials: Vec<DiagnosisTrialOut>,
    /// Cursor of the next page, if there is one.
    pub next: Option<String>,
}

/// A trial of a diagnosis.
#[derive(Serialize, ToSchema)]
pub struct DiagnosisTrialOut {
    /// Name of the trial.
    pub trial: String,
    /// Setting of the scene, if it has settings.
    pub setting: Option<String>,
    /// Times, s.
    pub t: Vec<f64>,
    /// By body name, one state per time.
    pub bodies: BTreeMap<String, TrackOut>,
}

/// A ball and optionally a floor.
#[derive(Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct BallIn {
    /// m
    pub radius: f64,
    /// kg
    pub mass: Option<f64>,
    /// m/s^2, downwards. Default: 9.81.
    pub gravity: Option<f64>,
    /// Height of the floor's surface, m.
    pub floor: Option<f64>,
}

/// Units, and the track to read, if the files do not state them.
#[derive(Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct ReadingIn {
    /// Frames per second; times are then frame numbers.
    pub fps: Option<f64>,
    /// m per pixel; coordinates are then in pixels.
    pub metres_per_pixel: Option<f64>,
    /// m, cm, mm, um, km, in, ft.
    pub length_unit: Option<String>,
    /// s, ms, us, min.
    pub time_unit: Option<String>,
    /// Whether y points down, as in images.
    pub y_down: Option<bool>,
    /// The track or body to read from files with several.
    pub track: Option<String>,
}

impl TrialsIn {
    /// As files; a single text is called `name`.
    pub fn files(self, name: &str) -> Vec<TrackFile> {
        match self {
            TrialsIn::One(text) => vec![TrackFile { name: name.into(), text }],
            TrialsIn::Several(texts) => {
                texts.into_iter().map(|(name, text)| TrackFile { name, text }).collect()
            }
        }
    }
}

impl From<Trial> for DiagnosisTrialOut {
    fn from(trial: Trial) -> DiagnosisTrialOut {
        let Trial { name, setting, observed, .. } = trial;
        let bodies = observed.bodies.iter().map(|track| (track.name.clone(), track.into())).collect();
        DiagnosisTrialOut { trial: name, setting, t: observed.times, bodies }
    }
}

impl BinaryArrays for DiagnosisTrials {}

impl From<BallIn> for BallScene {
    fn from(ball: BallIn) -> BallScene {
        let BallIn { radius, mass, gravity, floor } = ball;
        BallScene { radius, mass, gravity: gravity.unwrap_or(STANDARD_GRAVITY_M_S2), floor }
    }
}

impl From<ReadingIn> for TrackParseOptions {
    fn from(said: ReadingIn) -> TrackParseOptions {
        let ReadingIn { fps, metres_per_pixel, length_unit, time_unit, y_down, track } = said;
        TrackParseOptions { fps, metres_per_pixel, length_unit, time_unit, y_down, track }
    }
}

impl<'de> Deserialize<'de> for TrialsIn {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        // Not derived: the errors of an untagged enum name neither the position nor the allowed values.
        deserializer.deserialize_any(TrialsVisitor)
    }
}

struct TrialsVisitor;

impl<'de> Visitor<'de> for TrialsVisitor {
    type Value = TrialsIn;

    fn expecting(&self, f: &mut fmt::Formatter) -> fmt::Result {
        f.write_str("the text of a file, or an object of texts by name")
    }

    fn visit_str<E>(self, text: &str) -> Result<TrialsIn, E> {
        Ok(TrialsIn::One(text.into()))
    }

    fn visit_string<E>(self, text: String) -> Result<TrialsIn, E> {
        Ok(TrialsIn::One(text))
    }

    fn visit_map<A: MapAccess<'de>>(self, map: A) -> Result<TrialsIn, A::Error> {
        BTreeMap::deserialize(MapAccessDeserializer::new(map)).map(TrialsIn::Several)
    }
}
