//! What a strategy is: what it may look at, and what it answers.

use serde::{Deserialize, Serialize};

use super::candidate::{Candidate, World};
use crate::error::Result;
use crate::progress::Progress;
use crate::reality::Trial;
use crate::task::Task;
use crate::world::Coordinates;

/// A way to choose actions from simulated candidates.
pub trait Strategy: Sync {
    /// Name on the command line and in reports.
    fn name(&self) -> &'static str;

    /// Whether [`Situation::importance`] must be there.
    fn needs_importance(&self) -> bool {
        false
    }

    /// `n` distinct candidates (fewer if there are fewer), most wanted first.
    fn choose(&self, situation: &Situation, n: usize) -> Result<Chosen>;
}

/// What a strategy may look at: nothing of it comes from the real world but the trials that were paid for.
pub struct Situation<'a> {
    /// The tasks the candidates were drawn for.
    pub tasks: &'a [Task],
    /// The actions to choose from.
    pub candidates: &'a [Candidate],
    /// The simulation they were tried in.
    pub world: &'a World,
    /// What is estimated.
    pub coordinates: &'a Coordinates,
    /// The current estimate, one value a coordinate.
    pub estimate: &'a [f64],
    /// How far the search still spreads around it, standard deviations.
    pub spread: &'a [f64],
    /// How far it spread before anything was measured, standard deviations; 0 for what is not searched.
    pub prior: &'a [f64],
    /// What was measured so far.
    pub trials: &'a [Trial],
    /// What the task's performance asks of the latents; there where the strategy needs it, and used where there.
    pub importance: Option<&'a dyn Importance>,
    /// For those that simulate more.
    pub progress: &'a dyn Progress,
}

/// What was chosen.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Chosen {
    /// Indices of candidates.
    pub indices: Vec<usize>,
    /// Rollouts simulated to choose them.
    pub rollouts: u64,
    /// How many come from which group, where the strategy deals them out.
    pub groups: Option<Groups>,
    /// What they are chosen to tell of each coordinate that is searched, where the strategy reckons with it.
    pub expected: Vec<Expected>,
}

/// How far a coordinate is known before a batch and, if the simulation is right, after it: standard deviations that the
/// trials' information leaves.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Expected {
    /// Name of the factor, or `effect.parameter`.
    pub name: String,
    /// In the coordinate's unit.
    pub before: f64,
    /// In the coordinate's unit.
    pub after: f64,
}

/// How many actions are chosen from each group.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Groups {
    /// For their collisions, which tell restitution.
    pub collisions: usize,
    /// For their rolling, which tells friction.
    pub rolling: usize,
}

/// How much the performance on a task depends on each latent factor.
pub trait Importance: Send + Sync {
    /// Partial derivatives of performance by density (per kg/m^2), friction and restitution at `latents`; NaN
    /// where they are not known.
    fn gradient(&self, latents: [f64; 3]) -> [f64; 3];
}

impl Chosen {
    /// Chosen without simulating anything.
    pub fn free(mut indices: Vec<usize>, n: usize) -> Result<Chosen> {
        indices.truncate(n);
        Ok(Chosen { indices, ..Chosen::default() })
    }
}

/// Indices ordered by descending score; ties keep the order of the candidates, which is random.
pub fn ranked(candidates: &[Candidate], score: impl Fn(&Candidate) -> f64) -> Vec<usize> {
    let mut order: Vec<usize> = (0..candidates.len()).collect();
    order.sort_by(|a, b| score(&candidates[*b]).total_cmp(&score(&candidates[*a])));
    order
}
