//! Planning: candidates, successive elimination, and fresh rollouts for the best.

use rayon::prelude::*;

use crate::budget::Budget;
use crate::error::{Error, Result};
use crate::estimate::ParameterSamples;
use crate::policy::evaluate::candidates;
use crate::progress::Progress;
use crate::task::{Placement, Task, ValidAction};

use super::config::PlanConfig;
use super::perturbed_rollouts::PerturbedRollouts;
use super::ranked::{Plan, RankedAction, SuccessCount};
use super::successive_elimination::SuccessiveElimination;

/// Ranks the actions of a task by their probability of success over parameter samples. The result depends on the seed only, to the
/// bit, with any number of threads.
///
/// When `time` reports [`Error::Deadline`], the result so far is returned as incomplete. The fresh rollouts of the best
/// (`exact` times `draws`) are done after the deadline, since the ranking's success rates are biased upwards by the selection. Any
/// other error of `time`, and every error of `progress`, is returned.
pub fn plan(
    task: &Task,
    belief: &ParameterSamples,
    config: &PlanConfig,
    time: &dyn Budget,
    progress: &dyn Progress,
) -> Result<Plan> {
    config.validate()?;
    let all = candidates(task, &config.candidates())?;
    let count = all.len();
    let placeable = |a: ValidAction| -> Result<Option<ValidAction>> {
        progress.check_stop()?;
        Ok(matches!(task.place(&a), Placement::Valid(_)).then_some(a))
    };
    let valid = all.into_par_iter().map(placeable).collect::<Result<Vec<_>>>()?;
    let valid: Vec<ValidAction> = valid.into_iter().flatten().collect();
    let perturbed = PerturbedRollouts::new(task, belief, config);
    let mut elimination =
        SuccessiveElimination::new(valid.len(), perturbed.draws(), config.exact, config.look);
    let mut rollouts =
        run_elimination(&mut elimination, &valid, &perturbed, config.rollouts, time, progress)?;
    let order = elimination.order();
    let best: Vec<&ValidAction> = order.iter().take(config.exact).map(|i| &valid[*i]).collect();
    let fresh = fresh_counts(&best, &perturbed, progress)?;
    rollouts += fresh.iter().map(|c| c.rollouts).sum::<usize>();
    let ranked = |(place, i): (usize, &usize)| RankedAction {
        action: valid[*i].clone(),
        ranking_count: elimination.counts()[*i],
        fresh_count: fresh.get(place).copied(),
    };
    Ok(Plan {
        task: task.id.clone(),
        draws: perturbed.draws(),
        ranked: order.iter().enumerate().map(ranked).collect(),
        invalid: count - valid.len(),
        rollouts,
        complete: elimination.is_complete(),
    })
}

/// Runs the elimination to its end, to the deadline or to the limit of rollouts; returns the number of rollouts.
fn run_elimination(
    elimination: &mut SuccessiveElimination,
    valid: &[ValidAction],
    perturbed: &PerturbedRollouts,
    max_rollouts: Option<usize>,
    time: &dyn Budget,
    progress: &dyn Progress,
) -> Result<usize> {
    let mut spent = 0;
    loop {
        let mut step = elimination.next();
        step.truncate(max_rollouts.unwrap_or(usize::MAX) - spent);
        if step.is_empty() {
            return Ok(spent);
        }
        let [decided, all] = elimination.decided();
        progress.report("successive elimination", decided as u64, all as u64)?;
        let rollouts: Vec<(&ValidAction, usize)> = step.iter().map(|(i, k)| (&valid[*i], *k)).collect();
        match perturbed.solve(&rollouts, time) {
            Ok(solved) => elimination.record(&step, &solved),
            Err(Error::Deadline { .. }) => return Ok(spent),
            Err(error) => return Err(error),
        }
        spent += step.len();
    }
}

/// Outcomes of the best actions in fresh rollouts, not used for ranking.
fn fresh_counts(
    best: &[&ValidAction],
    perturbed: &PerturbedRollouts,
    progress: &dyn Progress,
) -> Result<Vec<SuccessCount>> {
    let draws = perturbed.draws();
    let mut counts = Vec::with_capacity(best.len());
    for action in best {
        progress.report("fresh draws for the best", counts.len() as u64, best.len() as u64)?;
        let rollouts: Vec<(&ValidAction, usize)> = (draws..2 * draws).map(|k| (*action, k)).collect();
        let mut count = SuccessCount::default();
        perturbed.solve(&rollouts, &progress)?.into_iter().for_each(|solved| count.record(solved));
        counts.push(count);
    }
    Ok(counts)
}
