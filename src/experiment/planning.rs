//! Plans in the hidden world: what ranking by rollouts under a belief is worth, and whether its probabilities are true.
//!
//! A plan's order is tried as a policy's is (PHYRE's protocol). What it predicts is held against the hidden world on actions
//! of every likelihood, not on the best alone: some from each tenth of the order's share, each predicted from fresh draws,
//! then done once in the hidden world as it was in the simulation: moved a little, and failed if it cannot be placed so.

use rand::seq::SliceRandom;
use serde::{Deserialize, Serialize};

use super::tryout::try_out;
use crate::budget::{Budget, Endless};
use crate::error::Result;
use crate::estimate::Belief;
use crate::plan::{Calibration, Copies, Plan, PlanConfig, Planner, calibration, plan};
use crate::policy::Evaluation;
use crate::progress::{Progress, Silent};
use crate::reality::{HiddenConfig, HiddenWorld, Reality};
use crate::rng;
use crate::task::{Task, ValidAction};

/// What is tried.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct PlanningConfig {
    pub plan: PlanConfig,
    /// Where orders are tried.
    pub hidden: HiddenConfig,
    /// Actions of each tenth of a plan's shares whose predicted success is held against the hidden world's.
    pub predictions: usize,
}

/// A task's plan, tried.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct PlannedTask {
    /// The attempt that solved it, from 1; `None` if none of 100 did.
    pub solved_at: Option<usize>,
    /// Copies tried for the plan.
    pub rollouts: usize,
    /// Whether the plan's best are exact.
    pub complete: bool,
    /// (predicted probability, whether it succeeded).
    pub predictions: Vec<(f64, bool)>,
}

/// Planned tasks condensed.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct PlanningScore {
    /// In [0, 1].
    pub auccess: f64,
    /// Share of the tasks that the first attempt solved.
    pub first: f64,
    /// Share of the tasks whose plan was complete.
    pub complete: f64,
    /// Predicted against real success; without predictions, of nothing.
    pub calibration: Calibration,
}

/// Plans a task under a belief and tries the order in the hidden world.
pub fn plan_and_try(
    task: &Task,
    belief: &Belief,
    config: &PlanningConfig,
    time: &dyn Budget,
    progress: &dyn Progress,
) -> Result<PlannedTask> {
    let found = plan(task, belief, &config.plan, time, progress)?;
    let planner = Planner::new("a belief", std::slice::from_ref(&found));
    let candidates = config.plan.candidates();
    let tried = try_out(&planner, std::slice::from_ref(task), &config.hidden, &candidates, &Silent)?;
    Ok(PlannedTask {
        solved_at: tried.solved_at.first().copied().flatten(),
        rollouts: found.rollouts,
        complete: found.complete,
        predictions: predictions(task, belief, &found, config, progress)?,
    })
}

/// What planned tasks come to; NaN of none.
pub fn score(tasks: &[PlannedTask]) -> PlanningScore {
    let share = |of: &dyn Fn(&PlannedTask) -> bool| {
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

/// Predicted and real success of actions of every likelihood.
fn predictions(
    task: &Task,
    belief: &Belief,
    plan: &Plan,
    config: &PlanningConfig,
    progress: &dyn Progress,
) -> Result<Vec<(f64, bool)>> {
    let copies = Copies::new(task, belief, &config.plan);
    // The hand that acts in the hidden world trembles in its own way.
    let seed = rng::derive(config.plan.seed, "hand", 0);
    let hand = Copies::new(task, belief, &PlanConfig { seed, ..config.plan.clone() });
    let mut world = HiddenWorld::new(HiddenConfig { budget: None, ..config.hidden.clone() })?;
    let chosen = chosen(plan, config);
    let mut found = Vec::with_capacity(chosen.len());
    for (i, action) in chosen.iter().enumerate() {
        progress.report("predicted against real success", i as u64, chosen.len() as u64)?;
        let draws = copies.draws();
        let fresh: Vec<(&ValidAction, usize)> = (draws..2 * draws).map(|k| (*action, k)).collect();
        let solving = copies.solve(&fresh, &Endless)?.into_iter().filter(|s| *s).count();
        let done = world.measure(task, &[hand.moved(action, i % draws)])?.pop();
        let solved = done.and_then(|a| a.trajectory).is_some_and(|t| t.solved());
        found.push((solving as f64 / draws as f64, solved));
    }
    Ok(found)
}

/// Some actions of each tenth of the plan's shares, in a seed's order.
fn chosen<'a>(plan: &'a Plan, config: &PlanningConfig) -> Vec<&'a ValidAction> {
    let seed = rng::derive(config.plan.seed, &plan.task, 0);
    let mut stream = rng::stream(seed, "planning predictions");
    let of = |tenth: usize| {
        let within = |share: f64| ((share * 10.0) as usize).min(9) == tenth;
        let mut own: Vec<&ValidAction> =
            plan.ranked.iter().filter(|r| within(r.raced.share())).map(|r| &r.action).collect();
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

    /// Planned with the truth, a task is solved at once, and what is predicted happens.
    #[test]
    fn the_truth_plans_well() {
        let family = family("basketball").unwrap();
        let hidden = standard(family);
        let truth = HiddenWorld::new(hidden.clone()).unwrap().reveal();
        let belief = Belief::point(truth.latents, truth.effects).unwrap();
        let plan = PlanConfig { actions: 1500, draws: 8, ..PlanConfig::standard(1) };
        let config = PlanningConfig { plan, hidden, predictions: 6 };
        let tasks = family.tasks();
        let run = |task| plan_and_try(task, &belief, &config, &Endless, &Silent).unwrap();
        let found: Vec<PlannedTask> = tasks[..3].iter().map(run).collect();
        assert!(found.iter().all(|t| t.complete && t.solved_at.is_some_and(|k| k <= 3)), "{found:?}");
        let score = score(&found);
        assert!(score.auccess > 0.9 && score.calibration.error < 0.2, "{score:?}");
        assert_eq!(run(&tasks[0]), found[0]);
    }
}
