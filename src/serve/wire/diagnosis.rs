//! What to diagnose.

use std::collections::BTreeMap;
use std::fmt;

use serde::de::value::MapAccessDeserializer;
use serde::de::{MapAccess, Visitor};
use serde::{Deserialize, Deserializer, Serialize};
use utoipa::ToSchema;

use super::asked::TrackOut;
use super::bulk::Bulk;
use super::strict::Object;
use crate::reality::{File, Reading, Trial};
use crate::task::Scene;
use crate::task::ball::{Ball, GRAVITY};

/// Measured trials, and the simulation they are held against: `scene` (or `ball`) and `trials`, or the `job` that
/// measured them.
#[derive(Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct DiagnosisIn {
    /// An `iplw.scene/1` document: the base model; `calibrate` names the latents to estimate along.
    #[schema(value_type = Option<Object>)]
    pub scene: Option<Object<Scene>>,
    /// Instead of a scene, where one ball flies.
    #[schema(value_type = Option<BallIn>)]
    pub ball: Option<Object<BallIn>>,
    /// Trials as CSV: `trial,t,body,x,y` and optionally `setting,angle,vx,vy,omega`; or, of one body, tracks as tracking
    /// programs write them.
    #[schema(value_type = Option<TrialsIn>)]
    pub trials: Option<TrialsIn>,
    /// What the trials do not say of themselves.
    #[schema(value_type = Option<ReadingIn>)]
    pub reading: Option<Object<ReadingIn>>,
    /// Id of an estimation: its trials so far are diagnosed.
    pub job: Option<String>,
    pub seed: Option<u64>,
}

/// The text of a file, or the texts of several by name: each of one trial, unless a column says otherwise.
#[derive(Serialize, ToSchema)]
#[serde(untagged)]
pub enum TrialsIn {
    One(String),
    Several(BTreeMap<String, String>),
}

/// The trials that a diagnosis was given.
#[derive(Serialize, ToSchema)]
pub struct GivenTrials {
    /// An `iplw.scene/1` document: the base model.
    #[schema(value_type = Object)]
    pub scene: Scene,
    /// In the order in which they were given.
    pub trials: Vec<GivenOut>,
    /// Cursor of the next page, if there is one.
    pub next: Option<String>,
}

/// One of them.
#[derive(Serialize, ToSchema)]
pub struct GivenOut {
    /// Its name.
    pub trial: String,
    /// The setting of the scene that it was measured in, if there are any.
    pub setting: Option<String>,
    /// Times, s.
    pub t: Vec<f64>,
    /// By name of the body, a state for each time.
    pub bodies: BTreeMap<String, TrackOut>,
}

/// A ball, and a floor if there is one.
#[derive(Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct BallIn {
    /// m
    pub radius: f64,
    /// kg
    pub mass: Option<f64>,
    /// m/s^2, downwards; 9.81 if absent.
    pub gravity: Option<f64>,
    /// Height of the floor's surface, m.
    pub floor: Option<f64>,
}

/// Units, and the track to read, where the files do not say.
#[derive(Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct ReadingIn {
    /// Pictures a second: times are numbers of pictures.
    pub fps: Option<f64>,
    /// m: coordinates are in pixels.
    pub metres_per_pixel: Option<f64>,
    /// m, cm, mm, um, km, in, ft.
    pub length_unit: Option<String>,
    /// s, ms, us, min.
    pub time_unit: Option<String>,
    /// Whether y is counted downwards, as in pictures.
    pub y_down: Option<bool>,
    /// Which track, or body, of files that hold several.
    pub track: Option<String>,
}

impl TrialsIn {
    /// As files; `name` is that of an only one.
    pub fn files(self, name: &str) -> Vec<File> {
        match self {
            TrialsIn::One(text) => vec![File { name: name.into(), text }],
            TrialsIn::Several(texts) => texts.into_iter().map(|(name, text)| File { name, text }).collect(),
        }
    }
}

impl From<Trial> for GivenOut {
    fn from(trial: Trial) -> GivenOut {
        let Trial { name, setting, observed, .. } = trial;
        let bodies = observed.bodies.iter().map(|track| (track.name.clone(), track.into())).collect();
        GivenOut { trial: name, setting, t: observed.times, bodies }
    }
}

impl Bulk for GivenTrials {}

impl From<BallIn> for Ball {
    fn from(ball: BallIn) -> Ball {
        let BallIn { radius, mass, gravity, floor } = ball;
        Ball { radius, mass, gravity: gravity.unwrap_or(GRAVITY), floor }
    }
}

impl From<ReadingIn> for Reading {
    fn from(said: ReadingIn) -> Reading {
        let ReadingIn { fps, metres_per_pixel, length_unit, time_unit, y_down, track } = said;
        Reading { fps, metres_per_pixel, length_unit, time_unit, y_down, track }
    }
}

impl<'de> Deserialize<'de> for TrialsIn {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        // Not derived: an untagged enum's errors name neither the place nor what is allowed.
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
