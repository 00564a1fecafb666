//! Evaluation of plans in the hidden world: success of the ranking by posterior rollouts, and calibration of its probabilities.
//!
//! A plan's ranking is evaluated like a policy's (PHYRE's protocol). Calibration uses actions of all success probabilities, not only
//! the best ones: some actions per decile of the ranking's success share. Each is predicted from fresh draws and then carried out once
//! in the hidden world with the same actuation noise as in simulation; an action that cannot be placed counts as a failure.

use rand::seq::SliceRandom;
use serde::{Deserialize, Serialize};

use super::hidden_evaluation::evaluate_in_hidden_world;
use crate::budget::Budget;
use crate::error::Result;
use crate::estimate::ParameterSamples;
use crate::plan::{Calibration, PerturbedRollouts, Plan, PlanConfig, PlanPolicy, calibration, plan};
use crate::policy::{Evaluation, RandomPolicy};
use crate::progress::{NoProgress, Progress};
use crate::reality::{HiddenConfig, HiddenWorld, Reality};
use crate::rng;
use crate::task::{Task, ValidAction};

/// Configuration of plan evaluations.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct PlanningConfig {
    pub plan: PlanConfig,
    /// Hidden world in which rankings are evaluated.
    pub hidden: HiddenConfig,
    /// Actions per decile of predicted success that are compared with the hidden world.
    pub predictions: usize,
}

/// Evaluation of a task's plan in the hidden world.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct PlanEvaluation {
    /// Number of the first solving attempt, from 1; `None` if none of 100 solves the task.
    pub solved_at: Option<usize>,
    /// Rollouts simulated for the plan.
    pub rollouts: usize,
    /// Whether the plan's best actions were evaluated on all draws.
    pub complete: bool,
    /// Pairs of predicted success probability and observed success.
    pub predictions: Vec<(f64, bool)>,
}

/// Summary over tasks.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct PlanningScore {
    /// In [0, 1].
    pub auccess: f64,
    /// Share of tasks that the first attempt solved.
    pub first: f64,
    /// Share of tasks with a complete plan.
    pub complete: f64,
    /// Calibration of predicted success; empty without predictions.
    pub calibration: Calibration,
}

/// Plans a task under posterior samples and evaluates the ranking in the hidden world.
pub fn evaluate_plan(
    task: &Task,
    belief: &ParameterSamples,
    config: &PlanningConfig,
    time: &dyn Budget,
    progress: &dyn Progress,
) -> Result<PlanEvaluation> {
    let found = plan(task, belief, &config.plan, time, progress)?;
    let planner = PlanPolicy::new("a belief", std::slice::from_ref(&found));
    let candidates = config.plan.candidates();
    let tried = evaluate_in_hidden_world(
        &planner,
        std::slice::from_ref(task),
        &config.hidden,
        &candidates,
        &NoProgress,
    )?;
    Ok(PlanEvaluation {
        solved_at: tried.solved_at.first().copied().flatten(),
        rollouts: found.rollouts,
        complete: found.complete,
        predictions: predictions(task, belief, &found, config, progress)?,
    })
}

/// Evaluates actions in random order in the hidden world, as the baseline of plans.
pub fn evaluate_random(
    task: &Task,
    config: &PlanningConfig,
    progress: &dyn Progress,
) -> Result<PlanEvaluation> {
    let policy = RandomPolicy { seed: config.plan.seed };
    let candidates = config.plan.candidates();
    let tried =
        evaluate_in_hidden_world(&policy, std::slice::from_ref(task), &config.hidden, &candidates, progress)?;
    let solved_at = tried.solved_at.first().copied().flatten();
    Ok(PlanEvaluation { solved_at, rollouts: 0, complete: true, predictions: Vec::new() })
}

/// Summary of plan evaluations; NaN without tasks.
pub fn score(tasks: &[PlanEvaluation]) -> PlanningScore {
    let share = |of: &dyn Fn(&PlanEvaluation) -> bool| {
        tasks.iter().filter(|t| of(t)).count() as f64 / tasks.len() as f64
    };
    let predictions: Vec<(f64, bool)> = tasks.iter().flat_map(|t| t.predictions.iter().copied()).collect();
    PlanningScore {
        auccess: Evaluation::of(tasks.iter().map(|t| t.solved_at).collect()).auccess,
        first: share(&|t| t.solved_at == Some(1)),
        complete: share(&|t| t.complete),
        calibration: calibration(&predictions),
    }
}

/// Predicted and observed success for actions of all success probabilities.
fn predictions(
    task: &Task,
    belief: &ParameterSamples,
    plan: &Plan,
    config: &PlanningConfig,
    progress: &dyn Progress,
) -> Result<Vec<(f64, bool)>> {
    let copies = PerturbedRollouts::new(task, belief, &config.plan);
    // Independent actuation noise for the hidden world.
    let seed = rng::derive_seed(config.plan.seed, "hand", 0);
    let hand = PerturbedRollouts::new(task, belief, &PlanConfig { seed, ..config.plan.clone() });
    let mut world = HiddenWorld::new(HiddenConfig { budget: None, ..config.hidden.clone() })?;
    let chosen = select_actions(plan, config);
    let mut found = Vec::with_capacity(chosen.len());
    for (i, action) in chosen.iter().enumerate() {
        progress.report("predicted against real success", i as u64, chosen.len() as u64)?;
        let draws = copies.draws();
        let fresh: Vec<(&ValidAction, usize)> = (draws..2 * draws).map(|k| (*action, k)).collect();
        let solving = copies.solve(&fresh, &progress)?.into_iter().filter(|s| *s).count();
        let done = world.measure(task, &[hand.perturbed_action(action, i % draws)])?.pop();
        let solved = done.and_then(|a| a.trajectory).is_some_and(|t| t.solved());
        found.push((solving as f64 / draws as f64, solved));
    }
    Ok(found)
}

/// Actions from each decile of the plan's success shares, in random order.
fn select_actions<'a>(plan: &'a Plan, config: &PlanningConfig) -> Vec<&'a ValidAction> {
    let seed = rng::derive_seed(config.plan.seed, &plan.task, 0);
    let mut stream = rng::stream(seed, "planning predictions");
    let of = |tenth: usize| {
        let within = |share: f64| ((share * 10.0) as usize).min(9) == tenth;
        let mut own: Vec<&ValidAction> = plan
            .ranked
            .iter()
            .filter(|r| within(r.ranking_count.smoothed_share()))
            .map(|r| &r.action)
            .collect();
        own.shuffle(&mut stream);
        own.truncate(config.predictions);
        own
    };
    (0..10).flat_map(of).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::reality::standard;
    use crate::task::family;

    /// Plans under the true parameters solve tasks within few attempts, and their predictions are calibrated.
    #[test]
    fn true_parameters_give_good_plans() {
        let family = family("basketball").unwrap();
        let hidden = standard(family);
        let truth = HiddenWorld::new(hidden.clone()).unwrap().reveal();
        let belief = ParameterSamples::point(truth.latents, truth.effects).unwrap();
        let plan = PlanConfig { actions: 1500, draws: 8, ..PlanConfig::standard(1) };
        let config = PlanningConfig { plan, hidden, predictions: 6 };
        let tasks = family.tasks();
        let run =
            |task| evaluate_plan(task, &belief, &config, &crate::budget::Unlimited, &NoProgress).unwrap();
        let found: Vec<PlanEvaluation> = tasks[..3].iter().map(run).collect();
        assert!(found.iter().all(|t| t.complete && t.solved_at.is_some_and(|k| k <= 3)), "{found:?}");
        let score = score(&found);
        assert!(score.auccess > 0.9 && score.calibration.error < 0.2, "{score:?}");
        assert_eq!(run(&tasks[0]), found[0]);
    }
}
