//! A policy tried in the real world.

use crate::error::Result;
use crate::policy::{EvaluateConfig, Evaluation, Policy, evaluate};
use crate::progress::Progress;
use crate::reality::{HiddenConfig, HiddenWorld, Reality};
use crate::task::{Task, ValidAction};

/// Tries a policy's ranking on the real world; attempts are the agent's own, on a world of its own.
pub fn try_out(
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
