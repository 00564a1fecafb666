//! Ask and tell: proposals, submitted measurements, and the trials of a job.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use super::binary_arrays::BinaryArrays;
use crate::error::{Error, Result};
use crate::json::JsonObject;
use crate::task::Scene;
use crate::trajectory::Track;

/// The open proposals of an estimation.
#[derive(Serialize, ToSchema)]
pub struct Proposals {
    /// Number of the round, from 0.
    pub round: u64,
    /// State of the job: `waiting` if there are proposals, `queued` or `running` if they will come, otherwise final.
    pub state: &'static str,
    /// Empty unless the job is `waiting`.
    pub proposals: Vec<ProposalOut>,
}

/// An action to carry out on the real world.
#[derive(Serialize, ToSchema)]
pub struct ProposalOut {
    /// From 0, counted over the whole job.
    pub number: u64,
    pub task: String,
    /// Components from 0 to 1.
    pub action: Vec<f64>,
    /// An `iplw.scene/1` document with the action placed: the initial state to measure from.
    #[schema(value_type = Object)]
    pub scene: Scene,
    /// Observation times of the simulation, s; a measurement may use others.
    pub observe_at: Vec<f64>,
    /// Whether a trial was submitted or the proposal was reported as failed.
    pub answered: bool,
    /// Why it was chosen; null if the strategy gives no reasons.
    pub reason: Option<String>,
}

/// Measured trials to submit. A request is accepted as a whole or not at all.
#[derive(Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct TrialsSubmission {
    #[schema(value_type = Option<Vec<TrialIn>>)]
    pub trials: Option<Vec<JsonObject<TrialIn>>>,
    /// Numbers of proposals that could not be carried out.
    pub failed: Option<Vec<u64>>,
    /// Number of the round; keeps a repeated `close` from closing the next round.
    pub round: Option<u64>,
    /// Ends the round: proposals without a trial are treated as failed.
    #[serde(default)]
    pub close: bool,
    /// Allows replacing earlier submissions while the round is open.
    #[serde(default)]
    pub replace: bool,
}

/// The trial measured for a proposal.
#[derive(Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct TrialIn {
    /// Number of the proposal.
    pub proposal: u64,
    /// Increasing times since the start, s; the first from 0 to 0.1.
    pub t: Vec<f64>,
    /// By body name; unobserved bodies may be omitted.
    #[schema(value_type = BTreeMap<String, TrackIn>)]
    pub bodies: BTreeMap<String, JsonObject<TrackIn>>,
}

/// A body's states, one per time; `null` where not observed. Positions are required, the rest is optional.
#[derive(Default, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct TrackIn {
    /// m
    pub x: Option<Vec<Option<f64>>>,
    /// m, up
    pub y: Option<Vec<Option<f64>>>,
    /// rad, counter-clockwise
    pub angle: Option<Vec<Option<f64>>>,
    /// m/s
    pub vx: Option<Vec<Option<f64>>>,
    /// m/s
    pub vy: Option<Vec<Option<f64>>>,
    /// rad/s
    pub omega: Option<Vec<Option<f64>>>,
}

/// Query parameters of a submission as CSV.
#[derive(Default)]
pub struct SubmissionQuery {
    pub failed: Vec<u64>,
    pub round: Option<u64>,
    pub close: bool,
    pub replace: bool,
}

/// Status of the round after a submission.
#[derive(Serialize, ToSchema)]
pub struct SubmissionStatus {
    pub round: u64,
    /// Proposals with a trial.
    pub answered: u64,
    /// Proposals that could not be carried out.
    pub failed: u64,
    /// Proposals without a submission.
    pub open: u64,
    /// State of the job: `queued` once the round is complete.
    pub state: &'static str,
}

/// The trials of an estimation.
#[derive(Serialize, ToSchema)]
pub struct TrialsPage {
    /// An `iplw.scene/1` document with one setting per trial for the values that differ between trials; `null` without
    /// trials.
    #[schema(value_type = Option<Object>)]
    pub scene: Option<Scene>,
    pub trials: Vec<TrialOut>,
    /// Cursor of the next page, if there is one.
    pub next: Option<String>,
}

/// One measured trial.
#[derive(Serialize, ToSchema)]
pub struct TrialOut {
    /// Name of the trial and of its setting.
    pub trial: String,
    /// Number of the proposal.
    pub proposal: u64,
    pub round: u64,
    pub task: String,
    /// Components from 0 to 1.
    pub action: Vec<f64>,
    /// Times, s.
    pub t: Vec<f64>,
    /// By body name, one state per time.
    pub bodies: BTreeMap<String, TrackOut>,
}

/// A body's states; `null` where not observed.
#[derive(Serialize, ToSchema)]
pub struct TrackOut {
    /// m
    pub x: Vec<Option<f64>>,
    /// m, up
    pub y: Vec<Option<f64>>,
    /// rad, counter-clockwise
    pub angle: Vec<Option<f64>>,
    /// m/s
    pub vx: Vec<Option<f64>>,
    /// m/s
    pub vy: Vec<Option<f64>>,
    /// rad/s
    pub omega: Vec<Option<f64>>,
}

impl SubmissionQuery {
    /// Parses `failed=3,4`, `round=0`, `close=true` and `replace=true`; rejects other parameters.
    pub fn from_query(pairs: &[(String, String)]) -> Result<SubmissionQuery> {
        let mut query = SubmissionQuery::default();
        for (i, (name, value)) in pairs.iter().enumerate() {
            let refuse = |allowed: &str| Error::input(name, format!("{value:?}"), allowed);
            if pairs[..i].iter().any(|(n, _)| n == name) {
                return Err(Error::input(name, "given twice", "each parameter once"));
            }
            let flag = || value.parse::<bool>().map_err(|_| refuse("true or false"));
            match name.as_str() {
                "close" => query.close = flag()?,
                "replace" => query.replace = flag()?,
                "round" => query.round = Some(value.parse().map_err(|_| refuse("the number of a round"))?),
                "failed" => {
                    let numbers = value.split(',').map(|n| n.trim().parse());
                    let numbers = numbers.collect::<std::result::Result<_, _>>();
                    query.failed = numbers.map_err(|_| refuse("comma-separated numbers of proposals"))?;
                }
                _ => return Err(refuse("the parameters failed, round, close and replace")),
            }
        }
        Ok(query)
    }
}

impl From<&Track> for TrackOut {
    fn from(track: &Track) -> TrackOut {
        let column = |values: &[f64]| values.iter().map(|v| v.is_finite().then_some(*v)).collect();
        TrackOut {
            x: column(&track.x),
            y: column(&track.y),
            angle: column(&track.angle),
            vx: column(&track.vx),
            vy: column(&track.vy),
            omega: column(&track.omega),
        }
    }
}

impl BinaryArrays for Proposals {}
impl BinaryArrays for SubmissionStatus {}
impl BinaryArrays for TrialsPage {}
