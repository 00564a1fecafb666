//! The main path: explore -> measure -> estimate -> train -> transfer -> report.
//!
//! Source: Semage et al., algorithm 1 (Intuitive Physics Learning Workflow). [`estimate`] is its first half: in
//! each round the strategy ranks candidate actions on the simulation at the current estimate, the best are
//! spent on the real world, and the cross-entropy method moves the estimate. [`Workflow`] is the same as
//! something to ask and to tell, for a real world that is not in this process.
//!
//! Differences from the source: [`EstimateConfig::memory`] decides whether a round's fit sees all trials so far
//! (default) or only its own; the loop also ends when the estimate has settled or the budget is spent.

mod choice;
mod config;
mod deciding;
pub mod estimators;
pub mod extension;
mod fit;
pub mod grounding;
pub mod informed;
pub mod past_point;
pub mod planning;
pub mod policies;
pub mod quickstart;
mod report;
mod rows;
pub mod sense;
mod stages;
pub mod statistics;
pub mod strategies;
pub mod study;
pub mod surface;
pub mod transfer;
mod tryout;
pub mod ways;
mod workflow;

pub use choice::Choice;
pub use config::{EstimateConfig, Memory, ResidualKind};
pub use report::{EstimateReport, Stopped};
pub use sense::Sense;
pub use tryout::try_out;
pub use workflow::{Answer, Asked, Proposal, Round, Workflow};

use std::sync::Arc;

use crate::error::{Error, Result};
use crate::estimate::Cem;
use crate::explore::{self, Importance};
use crate::progress::Progress;
use crate::reality::{Reality, Trial};
use crate::rng;
use crate::task::{Task, ValidAction};
use fit::{Found, fit_round, report_on};
use stages::Staged;

/// Estimates the latents of `reality` over `tasks`; returns the report and the trials it was made from.
pub fn estimate(
    tasks: &[Task],
    reality: &mut dyn Reality,
    config: &EstimateConfig,
    progress: &dyn Progress,
) -> Result<(EstimateReport, Vec<Trial>)> {
    estimate_with(tasks, reality, config, None, progress)
}

/// [`estimate`] with a performance surface beside it: `gradient` needs one, `informative` uses one.
pub fn estimate_with(
    tasks: &[Task],
    reality: &mut dyn Reality,
    config: &EstimateConfig,
    importance: Option<Arc<dyn Importance>>,
    progress: &dyn Progress,
) -> Result<(EstimateReport, Vec<Trial>)> {
    let mut workflow = Workflow::new(tasks, config, importance)?;
    run(&mut workflow, reality, progress, &mut |_| Ok(()))?;
    Ok((workflow.report(progress)?, workflow.trials().to_vec()))
}

/// Runs a workflow to its end against `reality`. `keep` is given every round as it is finished, so that it can be
/// resumed from there; an error of its ends the run.
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

/// Fits given trials without measuring anything: as many iterations as an estimation of all rounds makes.
pub fn refit(trials: &[Trial], config: &EstimateConfig, progress: &dyn Progress) -> Result<EstimateReport> {
    let mut config = config.clone();
    config.cem = sense::apply(&config.senses, config.cem, trials.iter().map(|t| &t.scene))?;
    config.validate()?;
    let config = &config;
    let mut cem = Cem::new(config.cem.clone())?;
    let (mut residuals, mut estimates, mut rollouts) = (Vec::new(), Vec::new(), 0);
    let mut before = None;
    for round in 0..config.rounds {
        let staged = Staged { inner: progress, round, rounds: config.rounds };
        let fitted = fit_round(&mut cem, before.as_ref(), trials, config, round, &staged)?;
        residuals.push(fitted.residual);
        rollouts += fitted.rollouts;
        before = fitted.refined;
        estimates.push(before.clone().unwrap_or_else(|| cem.estimate()));
    }
    let estimate = before.unwrap_or_else(|| cem.estimate());
    let choices = Vec::new();
    let found =
        Found { residuals, estimates, choices, rollouts, real_interactions: 0, stopped: Stopped::Rounds };
    report_on(&estimate, &cem.deviations(), trials, config, found, progress)
}

/// `count` trials of random placeable actions over `tasks`, in a seed's order.
pub fn random_trials(
    tasks: &[Task],
    reality: &mut dyn Reality,
    count: usize,
    seed: u64,
    progress: &dyn Progress,
) -> Result<Vec<Trial>> {
    let drawn = explore::draw(tasks, count, &mut rng::stream(seed, "random trials"))?;
    let mut trials = Vec::with_capacity(count);
    for (task, action, _) in drawn {
        progress.report("measuring the real world", trials.len() as u64, count as u64)?;
        let name = format!("{}/{}", tasks[task].id, trials.len());
        let attempts = reality.measure(&tasks[task], &[action])?;
        trials.extend(attempts.into_iter().filter_map(|a| a.into_trial(name.clone())));
    }
    Ok(trials)
}

/// Carries the proposals out, task by task; every one was placeable in simulation, so every one is answered.
fn measure(
    workflow: &Workflow,
    reality: &mut dyn Reality,
    proposals: &[Proposal],
    progress: &dyn Progress,
) -> Result<Vec<Answer>> {
    progress.report("measuring the real world", 0, proposals.len() as u64)?;
    let mut by_task: Vec<(&str, Vec<&Proposal>)> = Vec::new();
    for proposal in proposals {
        match by_task.iter_mut().find(|(task, _)| *task == proposal.task) {
            Some((_, of_it)) => of_it.push(proposal),
            None => by_task.push((&proposal.task, vec![proposal])),
        }
    }
    let mut answers = Vec::with_capacity(proposals.len());
    for (id, of_it) in by_task {
        let task = workflow.task(id)?;
        let actions: Vec<ValidAction> = of_it.iter().map(|p| p.action_on(task)).collect::<Result<_>>()?;
        for (proposal, attempt) in of_it.iter().zip(reality.measure(task, &actions)?) {
            answers.extend(attempt.trajectory.map(|observed| Answer { number: proposal.number, observed }));
        }
    }
    Ok(answers)
}
