//! The workflow with an ask-and-tell interface: it proposes actions, receives measurements, updates the estimate, and proposes the next
//! actions.
//!
//! Source: Semage et al., algorithm 1. A [`Workflow`] has no access to the real world: the caller, with a hidden world in this process or
//! a remote robot, measures the proposals. Every finished round is a [`Round`] (plain data), and [`Workflow::resume`] restores the
//! workflow from its rounds. The result is then bit-identical, because all randomness derives from the seed and the number of the
//! round.

use std::sync::Arc;

use serde::{Deserialize, Serialize};

use super::acquisition;
use super::adaptive::{self, select_adaptively};
use super::config::{EstimateConfig, Memory};
use super::fit::{FitHistory, fit_round, report_on};
use super::order_constraint;
use super::progress_prefix::PrefixedProgress;
use super::report::{EstimateReport, StopReason};
use super::selection_summary::SelectionSummary;
use crate::error::{Error, Result};
use crate::estimate::cem::CemState;
use crate::estimate::{Cem, LatentEstimate};
use crate::explore::{self, AcquisitionContext, Importance};
use crate::progress::Progress;
use crate::reality::Trial;
use crate::rng;
use crate::task::{Placement, Task, ValidAction};
use crate::trajectory::Trajectory;
use crate::world::ParameterVector;

/// State of an estimation.
pub struct Workflow {
    tasks: Vec<Task>,
    config: EstimateConfig,
    importance: Option<Arc<dyn Importance>>,
    cem: Cem,
    rounds: Vec<Round>,
    /// All trials so far, in the order of their proposals.
    trials: Vec<Trial>,
    /// The proposed round without results.
    open: Option<PendingRound>,
    ended: Option<StopReason>,
}

/// An action to measure in the real world.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Proposal {
    /// Number of the proposal, from 0 over the whole estimation.
    pub number: u64,
    /// Id of the task.
    pub task: String,
    /// (dimension,) components in [0, 1].
    pub action: Vec<f64>,
}

/// Measured result of a proposal. Proposals that cannot be carried out have no result.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ProposalResult {
    /// Number of the proposal.
    pub number: u64,
    /// Observed trajectory.
    pub observed: Trajectory,
}

/// A finished round: proposals, results, and the state of the search after it.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Round {
    pub proposals: Vec<Proposal>,
    /// Results, in the order of the proposals.
    pub answers: Vec<ProposalResult>,
    pub choice: SelectionSummary,
    pub search: CemState,
    /// Refined estimate; if `None`, the estimate is the search's mean.
    #[serde(default)]
    pub refined: Option<ParameterVector>,
    /// Residual of the best sample, m^2 per trajectory; `None` without measurements.
    pub residual: Option<f64>,
    /// Rollouts simulated.
    pub rollouts: u64,
}

/// A proposed round without results.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct PendingRound {
    pub proposals: Vec<Proposal>,
    pub choice: SelectionSummary,
    /// Rollouts simulated for the selection.
    pub rollouts: u64,
}

impl Workflow {
    /// A new workflow. The strategy `gradient` needs `importance`.
    pub fn new(
        tasks: &[Task],
        config: &EstimateConfig,
        importance: Option<Arc<dyn Importance>>,
    ) -> Result<Workflow> {
        config.validate()?;
        if acquisition::question(&config.strategy)?.is_some() {
            adaptive::check(config)?;
        }
        if tasks.is_empty() {
            return Err(Error::Failed("no task to estimate on".into()));
        }
        if acquisition::needs_importance(&config.strategy)? && importance.is_none() {
            let allowed = "a strategy that needs no performance surface, or give a surface";
            return Err(Error::input("strategy", format!("{:?}", config.strategy), allowed));
        }
        let mut config = config.clone();
        config.cem =
            order_constraint::apply_constraints(&config.senses, config.cem, tasks.iter().map(|t| &t.scene))?;
        Ok(Workflow {
            tasks: tasks.to_vec(),
            config: config.clone(),
            importance,
            cem: Cem::new(config.cem.clone())?,
            rounds: Vec::new(),
            trials: Vec::new(),
            open: None,
            ended: None,
        })
    }

    /// The workflow in its state after `rounds`.
    pub fn resume(mut self, rounds: Vec<Round>) -> Result<Workflow> {
        for round in rounds {
            let fresh = self.trials_of(&round.proposals, &round.answers)?;
            self.cem = Cem::resume(self.config.cem.clone(), &round.search)?;
            self.finish(round, fresh);
        }
        Ok(self)
    }

    /// The workflow with this pending round, as returned by [`Workflow::pending_round`] in the same state.
    pub fn reopen(mut self, asked: PendingRound) -> Workflow {
        self.open = Some(asked);
        self
    }

    /// The proposed round without results, if any.
    pub fn pending_round(&self) -> Option<&PendingRound> {
        self.open.as_ref()
    }

    /// The next actions to measure, at most `room`; `None` if the estimation has ended. Repeated calls return the same proposals.
    pub fn propose(&mut self, room: Option<u64>, progress: &dyn Progress) -> Result<Option<Vec<Proposal>>> {
        if self.ended.is_some() {
            return Ok(None);
        }
        if self.open.is_none() {
            let wanted = (self.config.actions as u64).min(room.unwrap_or(u64::MAX)) as usize;
            if wanted == 0 {
                self.ended = Some(StopReason::Budget);
                return Ok(None);
            }
            let staged = self.round_progress(progress);
            let asked = self.select_proposals(wanted, &staged)?;
            self.open = Some(asked);
        }
        Ok(self.open.as_ref().map(|o| o.proposals.clone()))
    }

    /// Ends the round with its results, in any order, and updates the estimate. Errors leave the state unchanged.
    pub fn tell(&mut self, answers: &[ProposalResult], progress: &dyn Progress) -> Result<&Round> {
        let Some(asked) = self.open.clone() else {
            return Err(Error::Refused { reason: "there is no open proposal to answer".into() });
        };
        let mut answers = answers.to_vec();
        answers.sort_by_key(|a| a.number);
        answers.dedup_by_key(|a| a.number);
        let fresh = self.trials_of(&asked.proposals, &answers)?;
        let mut cem = self.cem.clone();
        let all: Vec<Trial> = match self.config.memory {
            Memory::All => self.trials.iter().chain(&fresh).cloned().collect(),
            Memory::LastRound => fresh.clone(),
        };
        let (mut residual, mut refined, mut rollouts) = (None, None, asked.rollouts);
        if !all.is_empty() {
            let staged = self.round_progress(progress);
            let before = self.rounds.iter().rev().find_map(|r| r.refined.as_ref());
            let fitted = fit_round(&mut cem, before, &all, &self.config, self.rounds.len(), &staged)?;
            (residual, refined, rollouts) =
                (Some(fitted.residual), fitted.refined, rollouts + fitted.rollouts);
        }
        let round = Round {
            proposals: asked.proposals,
            answers,
            choice: asked.choice,
            search: cem.state(),
            refined,
            residual,
            rollouts,
        };
        self.cem = cem;
        self.finish(round, fresh);
        Ok(&self.rounds[self.rounds.len() - 1])
    }

    /// The current report, with confidence intervals. Errors without measurements.
    pub fn report(&self, progress: &dyn Progress) -> Result<EstimateReport> {
        if self.trials.is_empty() {
            return Err(Error::Refused { reason: "nothing has been measured yet".into() });
        }
        report_on(
            &self.estimate(),
            &self.cem.standard_deviations(),
            &self.trials,
            &self.config,
            self.fit_history(),
            progress,
        )
    }

    /// Estimates with confidence intervals after the last round, as in the report, and the rollouts for the intervals; empty without
    /// measurements.
    pub fn latent_estimates(&self, progress: &dyn Progress) -> Result<(Vec<LatentEstimate>, u64)> {
        let round = self.rounds.len().saturating_sub(1);
        if self.trials.is_empty() {
            return Ok((Vec::new(), 0));
        }
        let report = self.report(&PrefixedProgress::round(progress, round, self.config.rounds))?;
        let before: u64 = self.rounds.iter().map(|r| r.rollouts).sum();
        Ok((report.latents.into_iter().chain(report.effects).collect(), report.rollouts - before))
    }

    /// The current estimate.
    pub fn estimate(&self) -> ParameterVector {
        self.rounds.last().map_or_else(|| self.cem.estimate(), |r| self.estimate_at(r))
    }

    /// The estimate after each round.
    pub fn estimates(&self) -> Vec<ParameterVector> {
        self.rounds.iter().map(|r| self.estimate_at(r)).collect()
    }

    /// Real interactions after each round.
    pub fn interactions(&self) -> Vec<u64> {
        let sum = |spent: &mut u64, round: &Round| {
            *spent += round.answers.len() as u64;
            Some(*spent)
        };
        self.rounds.iter().scan(0, sum).collect()
    }

    /// All trials so far.
    pub fn trials(&self) -> &[Trial] {
        &self.trials
    }

    /// The finished rounds.
    pub fn rounds(&self) -> &[Round] {
        &self.rounds
    }

    /// Reason for stopping, if the estimation has ended.
    pub fn ended(&self) -> Option<StopReason> {
        self.ended
    }

    /// Configuration of the estimation.
    pub fn config(&self) -> &EstimateConfig {
        &self.config
    }

    /// Scene of a proposal with its action placed.
    pub fn placed_scene(&self, proposal: &Proposal) -> Result<crate::task::Scene> {
        let task = self.task(&proposal.task)?;
        match task.place(&task.actions().validate(&proposal.action)?) {
            Placement::Valid(scene) => Ok(*scene),
            Placement::Invalid(reason) => Err(Error::input(
                "action",
                format!("{:?}", proposal.action),
                format!("one that can be placed ({reason})"),
            )),
        }
    }

    /// The task called `id`.
    pub fn task(&self, id: &str) -> Result<&Task> {
        self.tasks
            .iter()
            .find(|t| t.id == id)
            .ok_or_else(|| Error::not_found("task", id, self.tasks.iter().map(|t| &t.id)))
    }

    /// Proposals grouped by task, in order, with their actions.
    pub fn by_task<'a>(
        &self,
        proposals: impl IntoIterator<Item = &'a Proposal>,
    ) -> Result<Vec<TaskProposals<'a, '_>>> {
        let mut groups: Vec<TaskProposals> = Vec::new();
        for proposal in proposals {
            let task = self.task(&proposal.task)?;
            let action = proposal.action_on(task)?;
            match groups.iter_mut().find(|(known, ..)| known.id == task.id) {
                Some((_, proposals, actions)) => {
                    proposals.push(proposal);
                    actions.push(action);
                }
                None => groups.push((task, vec![proposal], vec![action])),
            }
        }
        Ok(groups)
    }

    fn finish(&mut self, round: Round, fresh: Vec<Trial>) {
        self.rounds.push(round);
        self.trials.extend(fresh);
        self.open = None;
        if self.has_settled() {
            self.ended = Some(StopReason::Settled);
        } else if self.rounds.len() == self.config.rounds {
            self.ended = Some(StopReason::Rounds);
        }
    }

    /// Selects the actions to measure in this round.
    fn select_proposals(&self, wanted: usize, progress: &dyn Progress) -> Result<PendingRound> {
        let round = self.rounds.len() as u64;
        let seed = rng::derive_seed(self.config.seed, "explore", round);
        if let Some(question) = acquisition::question(&self.config.strategy)? {
            let made = select_adaptively(
                &self.tasks,
                &self.trials,
                &self.config,
                question,
                (wanted, seed),
                progress,
            )?;
            let choice = made.choice(self.tasks[0].scene.time_step);
            let actions = made.experiments.into_iter().map(|e| (e.task, e.action.values().to_vec()));
            return Ok(PendingRound {
                proposals: self.number_proposals(actions),
                choice,
                rollouts: made.rollouts,
            });
        }
        let mut stream = rng::stream(seed, "candidates");
        let (estimate, coordinates) = (self.estimate(), self.config.cem.coordinates());
        let world = explore::CandidateSimulation {
            latents: coordinates.latents(&estimate),
            effects: coordinates.effects(&estimate, &self.config.effects),
            engine: self.config.engine,
        };
        let candidates =
            explore::simulate_candidates(&self.tasks, self.config.candidates, &world, &mut stream, progress)?;
        let situation = AcquisitionContext {
            tasks: &self.tasks,
            candidates: &candidates,
            world: &world,
            coordinates: &coordinates,
            estimate: &estimate,
            spread: &self.cem.standard_deviations(),
            prior: &self.config.cem.prior_sd(),
            trials: &self.trials,
            importance: self.importance.as_deref(),
            progress,
        };
        let chosen = explore::strategy(&self.config.strategy)?.select(&situation, wanted)?;
        let actions = chosen.indices.iter().map(|i| {
            let own = &candidates[*i];
            (self.tasks[own.task].id.clone(), own.action.values().to_vec())
        });
        Ok(PendingRound {
            proposals: self.number_proposals(actions),
            choice: SelectionSummary::of(&candidates, &chosen),
            rollouts: candidates.len() as u64 + chosen.rollouts,
        })
    }

    /// Numbers actions, each with the id of its task, as proposals.
    fn number_proposals(&self, actions: impl Iterator<Item = (String, Vec<f64>)>) -> Vec<Proposal> {
        let first = self.rounds.iter().map(|r| r.proposals.len() as u64).sum::<u64>();
        actions.zip(first..).map(|((task, action), number)| Proposal { number, task, action }).collect()
    }

    /// Trials from results and their proposals; errors for a result without a proposal.
    fn trials_of(&self, proposals: &[Proposal], answers: &[ProposalResult]) -> Result<Vec<Trial>> {
        let trial = |answer: &ProposalResult| {
            let asked = proposals.iter().find(|p| p.number == answer.number).ok_or_else(|| {
                let numbers = proposals.first().zip(proposals.last());
                let allowed = numbers.map_or("none".into(), |(a, b)| format!("{} to {}", a.number, b.number));
                Error::input("number", answer.number, format!("the number of an open proposal: {allowed}"))
            })?;
            Ok(Trial {
                name: format!("{}/{}", asked.task, asked.number),
                setting: None,
                scene: self.placed_scene(asked)?,
                observed: answer.observed.clone(),
            })
        };
        answers.iter().map(trial).collect()
    }

    /// Convergence test: whether friction and restitution changed by less than the tolerance in the last two rounds. Density is
    /// excluded, since it cancels if all moving bodies share it and its estimate then drifts.
    fn has_settled(&self) -> bool {
        let [.., a, b, c] = &self.rounds[..] else { return false };
        let moved = |from: &Round, to: &Round| {
            let (from, to) = (self.estimate_at(from), self.estimate_at(to));
            (1..3).map(|i| (to[i] - from[i]).abs() / self.config.cem.prior[i].1).fold(0.0, f64::max)
        };
        let settled = self.config.settled;
        settled > 0.0 && moved(a, b) < settled && moved(b, c) < settled
    }

    fn estimate_at(&self, round: &Round) -> ParameterVector {
        let searched = || Cem::resume(self.config.cem.clone(), &round.search).map(|cem| cem.estimate());
        round.refined.clone().unwrap_or_else(|| searched().unwrap_or_else(|_| round.search.mean.clone()))
    }

    fn fit_history(&self) -> FitHistory {
        FitHistory {
            residuals: self.rounds.iter().filter_map(|r| r.residual).collect(),
            estimates: self.estimates(),
            choices: self.rounds.iter().map(|r| r.choice.clone()).collect(),
            rollouts: self.rounds.iter().map(|r| r.rollouts).sum(),
            real_interactions: self.trials.len() as u64,
            stopped: self.ended.unwrap_or(StopReason::Unfinished),
        }
    }

    fn round_progress<'a>(&self, inner: &'a dyn Progress) -> PrefixedProgress<'a> {
        PrefixedProgress::round(inner, self.rounds.len(), self.config.rounds)
    }
}

/// A task, the proposals for it, and their actions.
type TaskProposals<'a, 'w> = (&'w Task, Vec<&'a Proposal>, Vec<ValidAction>);

impl Proposal {
    /// The action, validated against its task.
    pub fn action_on(&self, task: &Task) -> Result<ValidAction> {
        task.actions().validate(&self.action)
    }
}
