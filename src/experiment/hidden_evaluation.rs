//! Evaluation of a policy in the hidden real world.

use crate::error::Result;
use crate::policy::{EvaluateConfig, Evaluation, Policy, evaluate};
use crate::progress::Progress;
use crate::reality::{HiddenConfig, HiddenWorld, Reality};
use crate::task::{Task, ValidAction};

/// Evaluates a policy's ranking in a fresh instance of the hidden world; its attempts do not count against other budgets.
pub fn evaluate_in_hidden_world(
    policy: &dyn Policy,
    tasks: &[Task],
    hidden: &HiddenConfig,
    config: &EvaluateConfig,
    progress: &dyn Progress,
) -> Result<Evaluation> {
    let mut world = HiddenWorld::new(hidden.clone())?;
    let mut attempt = |task: &Task, actions: &[ValidAction]| {
        let tried = world.measure(task, actions)?;
        Ok(tried.iter().map(|a| a.trajectory.as_ref().map(|t| t.solved())).collect())
    };
    evaluate(policy, tasks, config, &mut attempt, progress)
}
