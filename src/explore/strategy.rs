//! The interface of a selection strategy.

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use super::candidate::{ActionCandidate, CandidateSimulation};
use crate::error::Result;
use crate::progress::Progress;
use crate::reality::Trial;
use crate::task::Task;
use crate::world::ParameterSpace;

/// Selects actions from simulated candidates.
pub trait Strategy: Sync {
    /// Name on the command line and in reports.
    fn name(&self) -> &'static str;

    /// Whether [`AcquisitionContext::importance`] is required.
    fn needs_importance(&self) -> bool {
        false
    }

    /// Selects `n` distinct candidates (fewer if there are fewer), best first.
    fn select(&self, situation: &AcquisitionContext, n: usize) -> Result<ActionSelection>;
}

/// Input of a strategy. The only real-world information in it is the trials measured so far.
pub struct AcquisitionContext<'a> {
    /// The tasks the candidates were drawn for.
    pub tasks: &'a [Task],
    /// The actions to choose from.
    pub candidates: &'a [ActionCandidate],
    /// The simulation of the candidates.
    pub world: &'a CandidateSimulation,
    /// The estimated coordinates.
    pub coordinates: &'a ParameterSpace,
    /// The current estimate, one value per coordinate.
    pub estimate: &'a [f64],
    /// Current standard deviations of the search.
    pub spread: &'a [f64],
    /// Prior standard deviations; 0 for a fixed coordinate.
    pub prior: &'a [f64],
    /// Trials measured so far.
    pub trials: &'a [Trial],
    /// Sensitivity of the task's performance to the latents, if known.
    pub importance: Option<&'a dyn Importance>,
    /// Progress of strategies that simulate.
    pub progress: &'a dyn Progress,
}

/// The selected actions.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct ActionSelection {
    /// Indices into the candidates, best first.
    pub indices: Vec<usize>,
    /// Rollouts simulated for the selection.
    pub rollouts: u64,
    /// Number of actions from each group, for strategies that allocate by group.
    pub groups: Option<GroupCounts>,
    /// Expected posterior standard deviation of each searched coordinate, if the strategy computes it.
    pub expected: Vec<ExpectedPosteriorSd>,
}

/// Posterior standard deviation before a round, and expected after it if the simulation is correct.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
#[schema(as = ExpectedSdOut)]
pub struct ExpectedPosteriorSd {
    /// Name of the latent, or `effect.parameter`.
    pub name: String,
    /// Standard deviation, in its unit.
    pub before: f64,
    /// Standard deviation, in its unit.
    pub after: f64,
}

/// Number of actions chosen per purpose.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[schema(as = GroupsOut)]
pub struct GroupCounts {
    /// Chosen for collisions, which inform restitution.
    #[schema(value_type = u64)]
    pub collisions: usize,
    /// Chosen for rolling, which informs friction.
    #[schema(value_type = u64)]
    pub rolling: usize,
}

/// Sensitivity of a task's performance to each latent factor.
pub trait Importance: Send + Sync {
    /// Partial derivatives of performance with respect to density (per kg/m^2), friction and restitution at
    /// `latents`; NaN if unknown.
    fn gradient(&self, latents: [f64; 3]) -> [f64; 3];
}

impl ActionSelection {
    /// The first `n` of `indices`, without simulation cost.
    pub fn first(mut indices: Vec<usize>, n: usize) -> Result<ActionSelection> {
        indices.truncate(n);
        Ok(ActionSelection { indices, ..ActionSelection::default() })
    }
}

/// Indices by descending score; ties keep the (random) order of candidates.
pub fn rank_by(candidates: &[ActionCandidate], score: impl Fn(&ActionCandidate) -> f64) -> Vec<usize> {
    let mut order: Vec<usize> = (0..candidates.len()).collect();
    order.sort_by(|a, b| score(&candidates[*b]).total_cmp(&score(&candidates[*a])));
    order
}
