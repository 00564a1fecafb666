//! Ask and tell: proposals, what was measured, and the trials of a job.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use super::bulk::Bulk;
use super::strict::Object;
use crate::error::{Error, Result};
use crate::task::Scene;
use crate::trajectory::Track;

/// What is to be carried out on the real world.
#[derive(Serialize, ToSchema)]
pub struct Proposals {
    /// Number of the round, from 0.
    pub round: u64,
    /// The job's: with `waiting`, proposals stand; with `queued` and `running`, ask again; else nothing more comes.
    pub state: &'static str,
    /// Empty unless the job waits.
    pub proposals: Vec<ProposalOut>,
}

/// An action to be carried out.
#[derive(Serialize, ToSchema)]
pub struct ProposalOut {
    /// Counts from 0 over the whole job.
    pub number: u64,
    pub task: String,
    /// Each number from 0 to 1.
    pub action: Vec<f64>,
    /// An `iplw.scene/1` document with everything placed as it is to be let go.
    #[schema(value_type = Object)]
    pub scene: Scene,
    /// Times that a simulation is observed at, s; a measurement may take others.
    pub observe_at: Vec<f64>,
    /// Whether it was answered, or reported as failed.
    pub answered: bool,
    /// Why it was chosen, in words; null where the strategy gives no reasons.
    pub reason: Option<String>,
}

/// What was measured. Nothing of a request is taken unless all of it is.
#[derive(Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct TellIn {
    #[schema(value_type = Option<Vec<TrialIn>>)]
    pub trials: Option<Vec<Object<TrialIn>>>,
    /// Numbers of proposals that could not be carried out.
    pub failed: Option<Vec<u64>>,
    /// Number of the round that is meant; guards a repeated `close` from closing the next round.
    pub round: Option<u64>,
    /// Ends the round: what is not answered then has failed.
    #[serde(default)]
    pub close: bool,
    /// Lets answers take the place of different ones given before, as long as the round is open.
    #[serde(default)]
    pub replace: bool,
}

/// One carried-out proposal.
#[derive(Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct TrialIn {
    /// Number of the proposal.
    pub proposal: u64,
    /// Rising times, s, from the moment the bodies were let go; the first from 0 to 0.1.
    pub t: Vec<f64>,
    /// By name of the body; those not observed may be left out.
    #[schema(value_type = BTreeMap<String, TrackIn>)]
    pub bodies: BTreeMap<String, Object<TrackIn>>,
}

/// A body's states, one for each time; `null` where it was not seen. Positions are needed, the rest is kept.
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

/// What stands beside answers sent as CSV.
#[derive(Default)]
pub struct TellQuery {
    pub failed: Vec<u64>,
    pub round: Option<u64>,
    pub close: bool,
    pub replace: bool,
}

/// Where the round stands.
#[derive(Serialize, ToSchema)]
pub struct Told {
    pub round: u64,
    /// Proposals measured.
    pub answered: u64,
    /// Proposals that could not be carried out.
    pub failed: u64,
    /// Proposals of which nothing is known yet.
    pub open: u64,
    /// The job's: `queued` once the round is complete.
    pub state: &'static str,
}

/// The trials of an estimation.
#[derive(Serialize, ToSchema)]
pub struct Trials {
    /// An `iplw.scene/1` document; its settings, one a trial, place what differs between these trials;
    /// `null` without trials.
    #[schema(value_type = Option<Object>)]
    pub scene: Option<Scene>,
    pub trials: Vec<TrialOut>,
    /// Cursor of the next page, if there is one.
    pub next: Option<String>,
}

/// One measured trial.
#[derive(Serialize, ToSchema)]
pub struct TrialOut {
    /// Its name, which is also that of its setting.
    pub trial: String,
    /// Number of the proposal.
    pub proposal: u64,
    pub round: u64,
    pub task: String,
    /// Each number from 0 to 1.
    pub action: Vec<f64>,
    /// Times, s.
    pub t: Vec<f64>,
    /// By name of the body, a state for each time.
    pub bodies: BTreeMap<String, TrackOut>,
}

/// A body's states; `null` where one was not seen.
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

impl TellQuery {
    /// From `failed=3,4`, `round=0`, `close=true`, `replace=true`; others are refused.
    pub fn from_query(pairs: &[(String, String)]) -> Result<TellQuery> {
        let mut query = TellQuery::default();
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
                    query.failed =
                        numbers.map_err(|_| refuse("numbers of proposals, with commas between"))?;
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

impl Bulk for Proposals {}
impl Bulk for Told {}
impl Bulk for Trials {}
