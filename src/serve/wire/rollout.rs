//! A batch of attempts in one world.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use super::action::ActionIn;
use super::array::{Array, Data};
use super::bulk::Bulk;
use super::intervention::{InterventionIn, interventions};
use super::strict::Object;
use crate::error::Result;
use crate::session::{Action, Batch, Rolled, Tried};
use crate::trajectory::Trajectory;

/// A batch of attempts outside any episode.
#[derive(Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct RolloutIn {
    /// At most 4096.
    pub actions: Vec<ActionIn>,
    /// Id of the task; the current one if absent.
    pub task: Option<String>,
    /// Whether results carry the observed trajectory; default false.
    pub trajectories: Option<bool>,
    /// Whether a rollout ends with the goal; default true, and always true in a real world.
    pub stop: Option<bool>,
    /// What is done in the middle of rollouts: a list for each action, or one for all of them. Not in a real or sealed world.
    #[schema(value_type = Option<Vec<Vec<InterventionIn>>>)]
    pub interventions: Option<Vec<Vec<Object<InterventionIn>>>>,
}

/// What a batch brought.
#[derive(Serialize, ToSchema)]
pub struct BatchOut {
    /// Engine that ran.
    pub engine: &'static str,
    pub task: String,
    /// Valid attempts in this world so far.
    pub interactions: u64,
    /// In the order of the actions.
    pub results: Vec<ResultOut>,
    /// Trajectories, if they were asked for with raw arrays, which are more: `t` (action, time), s, and `states`
    /// (action, body, time, 3), m, m and rad, both NaN after the end and while a body is not in the scene; and `length` (action), their samples.
    #[serde(skip)]
    pub arrays: Vec<(&'static str, Array)>,
    /// With raw arrays: names of the bodies, in their order.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub bodies: Option<Vec<String>>,
}

/// What one action brought.
#[derive(Serialize, ToSchema)]
pub struct ResultOut {
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
    /// By body name, a state for each time; `null` while an intervention has the body out of the scene.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub bodies: Option<BTreeMap<String, BodyTrack>>,
}

/// Counts that the paper's action groups are made from.
#[derive(Serialize, ToSchema)]
pub struct ContactsOut {
    /// Begun contacts between movable bodies.
    pub collisions: u32,
    /// Time steps that bodies spent on a surface, summed.
    pub rolling_steps: u32,
}

/// Observed states of a body.
#[derive(Serialize, ToSchema)]
pub struct BodyTrack {
    /// m
    pub x: Vec<f64>,
    /// m, up
    pub y: Vec<f64>,
    /// rad, counter-clockwise
    pub angle: Vec<f64>,
}

impl RolloutIn {
    /// What is asked for.
    pub fn batch(self) -> Result<Batch> {
        let batch = self;
        let lists = batch.interventions.unwrap_or_default().into_iter().enumerate();
        let lists = lists.map(|(i, own)| interventions(own, None, &format!("interventions[{i}]")));
        Ok(Batch {
            interventions: lists.collect::<Result<_>>()?,
            actions: batch.actions.into_iter().map(Action::from).collect(),
            task: batch.task,
            trajectories: batch.trajectories.unwrap_or(false),
            stop: batch.stop.unwrap_or(true),
        })
    }
}

impl BatchOut {
    /// A batch's results, with trajectories if they were asked for: as lists, or as `raw` arrays.
    pub fn new(rolled: Rolled, trajectories: bool, raw: bool) -> BatchOut {
        let (mut arrays, mut bodies) = (Vec::new(), None);
        if trajectories && raw {
            let (names, pieces) = stacked(&rolled.results);
            (arrays, bodies) = (pieces, Some(names));
        }
        let result = |r: std::result::Result<Trajectory, String>| match r {
            Ok(trajectory) => ResultOut::of(trajectory, trajectories && !raw),
            Err(reason) => ResultOut {
                valid: false,
                reason: Some(reason),
                solved: None,
                steps: 0,
                contacts: ContactsOut { collisions: 0, rolling_steps: 0 },
                t: None,
                bodies: None,
            },
        };
        BatchOut {
            engine: rolled.engine,
            task: rolled.task,
            interactions: rolled.interactions,
            results: rolled.results.into_iter().map(result).collect(),
            arrays,
            bodies,
        }
    }
}

impl Bulk for BatchOut {
    fn bulk(&mut self) -> Vec<(&'static str, Array)> {
        std::mem::take(&mut self.arrays)
    }
}

/// Names of the bodies, and the trajectories as `t`, `states` and `length`.
fn stacked(results: &[Tried]) -> (Vec<String>, Vec<(&'static str, Array)>) {
    let trajectories = || results.iter().map(|r| r.as_ref().ok());
    // Of all that is ever in any of them: interventions let bodies in.
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
        ("t", Array::of(vec![n, most], Data::F8(t))),
        ("states", Array::of(vec![n, names.len(), most, 3], Data::F8(states))),
        ("length", Array::line(Data::U4(length))),
    ];
    (names, arrays)
}

impl ResultOut {
    fn of(trajectory: Trajectory, samples: bool) -> ResultOut {
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
        ResultOut { valid: true, reason: None, solved, steps, contacts, t, bodies }
    }
}
