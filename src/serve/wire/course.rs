//! The course of an estimation, round by round.

use serde::Serialize;
use utoipa::ToSchema;

use super::bulk::Bulk;
use crate::estimate::LatentEstimate;
use crate::experiment::{Choice, Proposal};

/// The rounds of an estimation.
#[derive(Serialize, ToSchema)]
pub struct Course {
    /// The job's.
    pub state: &'static str,
    /// Real interactions so far, those of the open round too.
    pub interactions: u64,
    /// In order; the last one may be open.
    pub rounds: Vec<RoundOut>,
    /// Cursor of the next page, if there is one.
    pub next: Option<String>,
}

/// One round.
#[derive(Serialize, ToSchema)]
pub struct RoundOut {
    /// From 0.
    pub number: u64,
    /// Whether it is finished; else its residual and latents are not known yet.
    pub fitted: bool,
    pub proposals: Vec<ProposedOut>,
    pub choice: ChoiceOut,
    /// Real interactions up to here.
    pub interactions: u64,
    /// Of the best sample, m^2 per trajectory; `null` if nothing was measured.
    pub residual: Option<f64>,
    /// What was known after it of latents, and of parameters fitted along.
    pub latents: Vec<KnownOut>,
}

/// An action that was proposed.
#[derive(Serialize, ToSchema)]
pub struct ProposedOut {
    /// Counts from 0 over the whole job.
    pub number: u64,
    pub task: String,
    /// Each number from 0 to 1.
    pub action: Vec<f64>,
    /// Whether it was measured; `false` for one that could not be carried out, `null` while nothing is known.
    pub measured: Option<bool>,
}

/// Why these actions: how they differ, as simulated, from all candidates they were chosen from.
#[derive(Serialize, ToSchema)]
pub struct ChoiceOut {
    /// Actions chosen.
    pub actions: u64,
    /// Different tasks among them.
    pub tasks: u64,
    /// Mean begun contacts between movable bodies of a chosen action.
    pub collisions: f64,
    /// Mean time steps that bodies of a chosen action spend on a surface, summed over bodies.
    pub rolling_steps: f64,
    /// The same over all candidates; of strategies that ask a question, over those looked at closely.
    pub candidate_collisions: f64,
    pub candidate_rolling_steps: f64,
    /// How many were chosen for what, where the strategy deals them out.
    pub groups: Option<GroupsOut>,
    /// What they were chosen to tell, where the strategy reckons with it; else empty.
    pub expected: Vec<ExpectedOut>,
    /// Why each was chosen, in words, in the order of the proposals, where the strategy says so; else empty.
    pub reasons: Vec<String>,
}

/// How far something is known before a round and, if the simulation is right, after it.
#[derive(Serialize, ToSchema)]
pub struct ExpectedOut {
    /// Name of the latent, or `effect.parameter`.
    pub name: String,
    /// Standard deviation, in its unit.
    pub before: f64,
    /// Standard deviation, in its unit.
    pub after: f64,
}

/// How many actions were chosen for what.
#[derive(Serialize, ToSchema)]
pub struct GroupsOut {
    /// For their collisions, which tell restitution.
    pub collisions: u64,
    /// For their rolling, which tells friction.
    pub rolling: u64,
}

/// What is known of a latent, or of an effect's parameter fitted along.
#[derive(Serialize, ToSchema)]
pub struct KnownOut {
    /// Name of the latent, or `effect.parameter`.
    pub name: String,
    /// The estimate; of one that cannot be identified, merely where the search stands.
    pub value: f64,
    /// 95 % interval; `[null, null]` stands for an infinite one.
    pub ci95: [Option<f64>; 2],
    /// Whether the trials tell it.
    pub identifiable: bool,
}

impl From<(Option<bool>, Proposal)> for ProposedOut {
    fn from((measured, proposal): (Option<bool>, Proposal)) -> ProposedOut {
        let Proposal { number, task, action } = proposal;
        ProposedOut { number, task, action, measured }
    }
}

impl From<Choice> for ChoiceOut {
    fn from(choice: Choice) -> ChoiceOut {
        let groups = |g: crate::explore::Groups| GroupsOut {
            collisions: g.collisions as u64,
            rolling: g.rolling as u64,
        };
        let expected =
            |e: crate::explore::Expected| ExpectedOut { name: e.name, before: e.before, after: e.after };
        ChoiceOut {
            actions: choice.actions as u64,
            tasks: choice.tasks as u64,
            collisions: choice.collisions,
            rolling_steps: choice.rolling_steps,
            candidate_collisions: choice.candidate_collisions,
            candidate_rolling_steps: choice.candidate_rolling_steps,
            groups: choice.groups.map(groups),
            expected: choice.expected.into_iter().map(expected).collect(),
            reasons: choice.reasons,
        }
    }
}

impl From<LatentEstimate> for KnownOut {
    fn from(known: LatentEstimate) -> KnownOut {
        let LatentEstimate { name, value, ci95, identifiable } = known;
        KnownOut { name, value, ci95, identifiable }
    }
}

impl Bulk for Course {}
