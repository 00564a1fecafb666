//! The main path: explore, measure, estimate, train, transfer, report.
//!
//! Source: Semage et al., algorithm 1 (Intuitive Physics Learning Workflow). [`estimate`] is its first half. In each
//! round the strategy ranks candidate actions in the simulation at the current estimate, the best ones are measured in
//! the real world, and the cross-entropy method updates the estimate. [`Workflow`] is the same algorithm with an
//! ask-and-tell interface, for a real world outside this process.
//!
//! Differences from the source: [`EstimateConfig::memory`] selects whether a round is fitted to all trials so far
//! (default) or to its own trials only. The loop also ends when the estimate has converged or the budget is spent.

pub mod acquisition;
mod adaptive;
mod config;
pub mod estimate_accuracy;
pub mod estimators;
pub mod extension;
mod fit;
pub mod grounding;
mod hidden_evaluation;
pub mod information_gain;
pub mod order_constraint;
pub mod planning;
pub mod policies;
pub mod posterior_training;
mod progress_prefix;
pub mod quickstart;
mod quickstart_config;
mod quickstart_seed;
mod report;
mod rows;
mod selection_summary;
pub mod statistics;
pub mod strategies;
pub mod study;
mod study_variants;
pub mod surface;
pub mod transfer;
mod workflow;

pub use config::{EstimateConfig, Memory, ResidualKind};
pub use hidden_evaluation::evaluate_in_hidden_world;
pub use order_constraint::OrderConstraint;
pub use report::{EstimateReport, StopReason};
pub use selection_summary::SelectionSummary;
pub use workflow::{PendingRound, Proposal, ProposalResult, Round, Workflow};

use std::sync::Arc;

use crate::error::{Error, Result};
use crate::estimate::Cem;
use crate::explore::{self, Importance};
use crate::progress::Progress;
use crate::reality::{Reality, Trial};
use crate::rng;
use crate::task::Task;
use fit::{FitHistory, fit_round, report_on};
use progress_prefix::PrefixedProgress;

/// Estimates the latents of `reality` on `tasks`; returns the report and the trials that it uses.
pub fn estimate(
    tasks: &[Task],
    reality: &mut dyn Reality,
    config: &EstimateConfig,
    progress: &dyn Progress,
) -> Result<(EstimateReport, Vec<Trial>)> {
    estimate_with(tasks, reality, config, None, progress)
}

/// [`estimate`] with a performance surface: the strategy `gradient` needs one, `informative` uses one if available.
pub fn estimate_with(
    tasks: &[Task],
    reality: &mut dyn Reality,
    config: &EstimateConfig,
    importance: Option<Arc<dyn Importance>>,
    progress: &dyn Progress,
) -> Result<(EstimateReport, Vec<Trial>)> {
    let mut workflow = Workflow::new(tasks, config, importance)?;
    run(&mut workflow, reality, progress, &mut |_| Ok(()))?;
    let mut report = workflow.report(progress)?;
    report.check_fit(workflow.trials(), progress)?;
    Ok((report, workflow.trials().to_vec()))
}

/// Runs a workflow to its end against `reality`. `keep` is called with every finished round, so that the workflow can be
/// resumed from there; an error from `keep` ends the run.
pub fn run(
    workflow: &mut Workflow,
    reality: &mut dyn Reality,
    progress: &dyn Progress,
    keep: &mut dyn FnMut(&Round) -> Result<()>,
) -> Result<()> {
    loop {
        let room = reality.budget().map(|b| b.saturating_sub(reality.interactions()));
        let Some(proposals) = workflow.propose(room, progress)? else { break };
        let answers = measure(workflow, reality, &proposals, progress)?;
        keep(workflow.tell(&answers, progress)?)?;
    }
    if workflow.trials().is_empty() {
        let (limit, spent) = (reality.budget().unwrap_or(0), reality.interactions());
        return Err(Error::Budget { limit, spent, asked: 1 });
    }
    Ok(())
}

/// Fits existing trials without new measurements, with as many iterations as an estimation over all rounds.
pub fn refit(trials: &[Trial], config: &EstimateConfig, progress: &dyn Progress) -> Result<EstimateReport> {
    let mut config = config.clone();
    config.cem =
        order_constraint::apply_constraints(&config.senses, config.cem, trials.iter().map(|t| &t.scene))?;
    config.validate()?;
    let config = &config;
    let mut cem = Cem::new(config.cem.clone())?;
    let (mut residuals, mut estimates, mut rollouts) = (Vec::new(), Vec::new(), 0);
    let mut before = None;
    for round in 0..config.rounds {
        let staged = PrefixedProgress::round(progress, round, config.rounds);
        let fitted = fit_round(&mut cem, before.as_ref(), trials, config, round, &staged)?;
        residuals.push(fitted.residual);
        rollouts += fitted.rollouts;
        before = fitted.refined;
        estimates.push(before.clone().unwrap_or_else(|| cem.estimate()));
    }
    let estimate = before.unwrap_or_else(|| cem.estimate());
    let choices = Vec::new();
    let found = FitHistory {
        residuals,
        estimates,
        choices,
        rollouts,
        real_interactions: 0,
        stopped: StopReason::Rounds,
    };
    report_on(&estimate, &cem.standard_deviations(), trials, config, found, progress)
}

/// `count` trials of random placeable actions on `tasks`; `seed` determines the actions and their order.
pub fn random_trials(
    tasks: &[Task],
    reality: &mut dyn Reality,
    count: usize,
    seed: u64,
    progress: &dyn Progress,
) -> Result<Vec<Trial>> {
    let drawn = explore::draw_placeable(tasks, count, &mut rng::stream(seed, "random trials"), progress)?;
    let mut trials = Vec::with_capacity(count);
    for (task, action, _) in drawn {
        progress.report("measuring the real world", trials.len() as u64, count as u64)?;
        let name = format!("{}/{}", tasks[task].id, trials.len());
        let attempts = reality.measure(&tasks[task], &[action])?;
        trials.extend(attempts.into_iter().filter_map(|a| a.into_trial(name.clone())));
    }
    Ok(trials)
}

/// Measures the proposals, task by task. Every proposal was placeable in simulation, so every one has a result.
fn measure(
    workflow: &Workflow,
    reality: &mut dyn Reality,
    proposals: &[Proposal],
    progress: &dyn Progress,
) -> Result<Vec<ProposalResult>> {
    progress.report("measuring the real world", 0, proposals.len() as u64)?;
    let mut answers = Vec::with_capacity(proposals.len());
    for (task, of_it, actions) in workflow.by_task(proposals)? {
        for (proposal, attempt) in of_it.iter().zip(reality.measure(task, &actions)?) {
            let number = proposal.number;
            answers.extend(attempt.trajectory.map(|observed| ProposalResult { number, observed }));
        }
    }
    Ok(answers)
}
