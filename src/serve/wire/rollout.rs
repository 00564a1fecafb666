//! Batches of rollouts in one world.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use super::array::{Array, ArrayData};
use super::binary_arrays::BinaryArrays;
use super::intervention::{InterventionIn, interventions};
use crate::error::Result;
use crate::json::JsonObject;
use crate::session::{Action, AttemptResult, RolloutRequest, RolloutResults};
use crate::trajectory::Trajectory;

/// A batch of rollouts outside any episode.
#[derive(Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct RolloutIn {
    /// At most 4096.
    pub actions: Vec<Action>,
    /// Id of the task. Default: the current task.
    pub task: Option<String>,
    /// Whether results contain trajectories. Default: false.
    pub trajectories: Option<bool>,
    /// Whether rollouts end when the goal is reached. Default: true; always true in a real world.
    pub stop: Option<bool>,
    /// Interventions during the rollouts: one list per action, or one for all. Not in real or sealed worlds.
    #[schema(value_type = Option<Vec<Vec<InterventionIn>>>)]
    pub interventions: Option<Vec<Vec<JsonObject<InterventionIn>>>>,
}

/// Results of a batch of rollouts.
#[derive(Serialize, ToSchema)]
pub struct RolloutOut {
    /// Engine that ran.
    pub engine: &'static str,
    pub task: String,
    /// Valid attempts in this world so far.
    pub interactions: u64,
    /// In the order of the actions.
    pub results: Vec<RolloutResultOut>,
    /// Trajectories as binary arrays: `t` (action, time), s; `states` (action, body, time, 3), m, m and rad; `length` (action),
    /// number of samples. `t` and `states` are NaN after the end, `states` also while a body is not in the scene.
    #[serde(skip)]
    pub arrays: Vec<(&'static str, Array)>,
    /// With binary arrays: names of the bodies, in the order of `states`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub bodies: Option<Vec<String>>,
}

/// Result of one action.
#[derive(Serialize, ToSchema)]
pub struct RolloutResultOut {
    pub valid: bool,
    /// Why the action could not be placed.
    pub reason: Option<String>,
    /// `null` for an invalid action.
    pub solved: Option<bool>,
    /// Simulated time steps.
    pub steps: u32,
    pub contacts: ContactsOut,
    /// Observation times, s.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub t: Option<Vec<f64>>,
    /// By body name, one state per time; `null` while the body is not in the scene.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub bodies: Option<BTreeMap<String, BodyTrack>>,
}

/// Contact counts, which define the paper's action groups.
#[derive(Serialize, ToSchema)]
pub struct ContactsOut {
    /// Number of contacts between movable bodies.
    pub collisions: u32,
    /// Time steps that bodies spent on a surface, summed over bodies.
    pub rolling_steps: u32,
}

/// Observed states of a body.
#[derive(Serialize, Deserialize, ToSchema)]
pub struct BodyTrack {
    /// m
    pub x: Vec<f64>,
    /// m, up
    pub y: Vec<f64>,
    /// rad, counter-clockwise
    pub angle: Vec<f64>,
}

impl RolloutIn {
    /// Converts the request.
    pub fn batch(self) -> Result<RolloutRequest> {
        let batch = self;
        let lists = batch.interventions.unwrap_or_default().into_iter().enumerate();
        let lists = lists.map(|(i, own)| interventions(own, None, &format!("interventions[{i}]")));
        Ok(RolloutRequest {
            interventions: lists.collect::<Result<_>>()?,
            actions: batch.actions,
            task: batch.task,
            trajectories: batch.trajectories.unwrap_or(false),
            stop: batch.stop.unwrap_or(true),
        })
    }
}

impl RolloutOut {
    /// From a batch's results, with trajectories on request: as lists, or as binary arrays if `raw`.
    pub fn new(rolled: RolloutResults, trajectories: bool, raw: bool) -> RolloutOut {
        let (mut arrays, mut bodies) = (Vec::new(), None);
        if trajectories && raw {
            let (names, pieces) = stacked(&rolled.results);
            (arrays, bodies) = (pieces, Some(names));
        }
        let result = |r: std::result::Result<Trajectory, String>| match r {
            Ok(trajectory) => RolloutResultOut::of(trajectory, trajectories && !raw),
            Err(reason) => RolloutResultOut {
                valid: false,
                reason: Some(reason),
                solved: None,
                steps: 0,
                contacts: ContactsOut { collisions: 0, rolling_steps: 0 },
                t: None,
                bodies: None,
            },
        };
        RolloutOut {
            engine: rolled.engine,
            task: rolled.task,
            interactions: rolled.interactions,
            results: rolled.results.into_iter().map(result).collect(),
            arrays,
            bodies,
        }
    }
}

impl BinaryArrays for RolloutOut {
    fn take_arrays(&mut self) -> Vec<(&'static str, Array)> {
        std::mem::take(&mut self.arrays)
    }
}

/// Stacks trajectories into the arrays `t`, `states` and `length`; also returns the body names.
fn stacked(results: &[AttemptResult]) -> (Vec<String>, Vec<(&'static str, Array)>) {
    let trajectories = || results.iter().map(|r| r.as_ref().ok());
    // The union over all rollouts, since interventions can add bodies.
    let mut names: Vec<String> = Vec::new();
    for track in trajectories().flatten().flat_map(|t| &t.bodies) {
        if !names.contains(&track.name) {
            names.push(track.name.clone());
        }
    }
    let (n, most) = (results.len(), trajectories().flatten().map(|t| t.times.len()).max().unwrap_or(0));
    let mut t = vec![f64::NAN; n * most];
    let mut states = vec![f64::NAN; n * names.len() * most * 3];
    for (i, trajectory) in trajectories().enumerate() {
        let Some(trajectory) = trajectory else { continue };
        t[i * most..][..trajectory.times.len()].copy_from_slice(&trajectory.times);
        for track in &trajectory.bodies {
            let Some(b) = names.iter().position(|name| *name == track.name) else { continue };
            let at = (i * names.len() + b) * most * 3;
            for (k, state) in states[at..][..track.len() * 3].chunks_exact_mut(3).enumerate() {
                state.copy_from_slice(&[track.x[k], track.y[k], track.angle[k]]);
            }
        }
    }
    let length = trajectories().map(|t| t.map_or(0, |t| t.times.len() as u32)).collect();
    let arrays = vec![
        ("t", Array::of(vec![n, most], ArrayData::F8(t))),
        ("states", Array::of(vec![n, names.len(), most, 3], ArrayData::F8(states))),
        ("length", Array::line(ArrayData::U4(length))),
    ];
    (names, arrays)
}

impl RolloutResultOut {
    fn of(trajectory: Trajectory, samples: bool) -> RolloutResultOut {
        let contacts =
            ContactsOut { collisions: trajectory.collisions, rolling_steps: trajectory.rolling_steps };
        let (solved, steps) = (trajectory.outcome.solved, trajectory.outcome.steps);
        let (t, bodies) = if samples {
            let tracks = trajectory.bodies.into_iter();
            let bodies = tracks.map(|b| (b.name, BodyTrack { x: b.x, y: b.y, angle: b.angle })).collect();
            (Some(trajectory.times), Some(bodies))
        } else {
            (None, None)
        };
        RolloutResultOut { valid: true, reason: None, solved, steps, contacts, t, bodies }
    }
}
