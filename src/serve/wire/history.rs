//! History of an estimation, round by round.

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use super::binary_arrays::BinaryArrays;
use crate::estimate::LatentEstimate;
use crate::experiment::{Proposal, SelectionSummary};
use crate::explore::{ExpectedPosteriorSd, GroupCounts};

/// The rounds of an estimation.
#[derive(Serialize, ToSchema)]
pub struct EstimationHistory {
    /// State of the job.
    pub state: &'static str,
    /// Real interactions so far, including the open round.
    pub interactions: u64,
    /// In order; the last round may be open.
    pub rounds: Vec<RoundOut>,
    /// Cursor of the next page, if there is one.
    pub next: Option<String>,
}

/// One round.
#[derive(Serialize, Deserialize, ToSchema)]
pub struct RoundOut {
    /// From 0.
    pub number: u64,
    /// Whether the round is fitted; if not, residual and latents are not known yet.
    pub fitted: bool,
    pub proposals: Vec<RoundProposalOut>,
    pub choice: ChoiceOut,
    /// Real interactions up to and including this round.
    pub interactions: u64,
    /// Residual of the best sample, m^2 per trajectory; `null` if nothing was measured.
    pub residual: Option<f64>,
    /// Estimates after this round of the latents and of free effect parameters.
    pub latents: Vec<LatentEstimate>,
}

/// A proposed action.
#[derive(Serialize, Deserialize, ToSchema)]
pub struct RoundProposalOut {
    /// From 0, counted over the whole job.
    pub number: u64,
    pub task: String,
    /// Components from 0 to 1.
    pub action: Vec<f64>,
    /// Whether it was measured; `false` if it could not be carried out, `null` if still open.
    pub measured: Option<bool>,
}

/// Statistics of the selected actions, as simulated, compared with all candidates.
#[derive(Serialize, Deserialize, ToSchema)]
pub struct ChoiceOut {
    /// Number of selected actions.
    pub actions: u64,
    /// Number of distinct tasks among them.
    pub tasks: u64,
    /// Mean number of contacts between movable bodies per selected action.
    pub collisions: f64,
    /// Mean time steps that bodies spend on a surface per selected action, summed over bodies.
    pub rolling_steps: f64,
    /// Mean over all candidates; for strategies with a question, over the shortlist.
    pub candidate_collisions: f64,
    pub candidate_rolling_steps: f64,
    /// Number of actions per purpose, if the strategy distributes them.
    pub groups: Option<GroupCounts>,
    /// Expected reduction of uncertainty, if the strategy predicts it; otherwise empty.
    pub expected: Vec<ExpectedPosteriorSd>,
    /// Why each action was chosen, in the order of the proposals; empty if the strategy gives no reasons.
    pub reasons: Vec<String>,
}

impl From<(Option<bool>, Proposal)> for RoundProposalOut {
    fn from((measured, proposal): (Option<bool>, Proposal)) -> RoundProposalOut {
        let Proposal { number, task, action } = proposal;
        RoundProposalOut { number, task, action, measured }
    }
}

impl From<SelectionSummary> for ChoiceOut {
    fn from(choice: SelectionSummary) -> ChoiceOut {
        ChoiceOut {
            actions: choice.actions as u64,
            tasks: choice.tasks as u64,
            collisions: choice.collisions,
            rolling_steps: choice.rolling_steps,
            candidate_collisions: choice.candidate_collisions,
            candidate_rolling_steps: choice.candidate_rolling_steps,
            groups: choice.groups,
            expected: choice.expected,
            reasons: choice.reasons,
        }
    }
}

impl BinaryArrays for EstimationHistory {}
