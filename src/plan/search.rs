//! A plan: candidates, the race among them, and fresh draws for the best.

use rayon::prelude::*;

use crate::budget::{Budget, Endless};
use crate::error::{Error, Result};
use crate::estimate::Belief;
use crate::policy::evaluate::candidates;
use crate::progress::Progress;
use crate::task::{Placement, Task, ValidAction};

use super::config::PlanConfig;
use super::copies::Copies;
use super::race::Race;
use super::ranked::{Count, Plan, Ranked};

/// Ranks the actions of a task by how likely they solve it under a belief. Same seed, same bits, on any number of threads.
///
/// Where `time` says that it is over ([`Error::Deadline`]), the answer is what is known by then, and says that it is not
/// complete; the fresh draws of the best (`exact` times `draws` rollouts) come on top, since a probability that was not
/// drawn afresh is too good to be true. Any other error of `time`, and every one of `progress`, ends the work.
pub fn plan(
    task: &Task,
    belief: &Belief,
    config: &PlanConfig,
    time: &dyn Budget,
    progress: &dyn Progress,
) -> Result<Plan> {
    config.validate()?;
    let all = candidates(task, &config.candidates())?;
    let count = all.len();
    let placeable = |a: &ValidAction| matches!(task.place(a), Placement::Valid(_));
    let valid: Vec<ValidAction> = all.into_par_iter().filter(placeable).collect();
    let copies = Copies::new(task, belief, config);
    let mut race = Race::new(valid.len(), copies.draws(), config.exact, config.look);
    let mut rollouts = run(&mut race, &valid, &copies, config.rollouts, time, progress)?;
    let order = race.order();
    let best: Vec<&ValidAction> = order.iter().take(config.exact).map(|i| &valid[*i]).collect();
    let fresh = afresh(&best, &copies, progress)?;
    rollouts += fresh.iter().map(|c| c.tried).sum::<usize>();
    let ranked = |(place, i): (usize, &usize)| Ranked {
        action: valid[*i].clone(),
        raced: race.counts()[*i],
        fresh: fresh.get(place).copied(),
    };
    Ok(Plan {
        task: task.id.clone(),
        draws: copies.draws(),
        ranked: order.iter().enumerate().map(ranked).collect(),
        invalid: count - valid.len(),
        rollouts,
        complete: race.is_over(),
    })
}

/// Runs the race to its end, or to the end of the time or of the rollouts there are; how many copies were tried.
fn run(
    race: &mut Race,
    valid: &[ValidAction],
    copies: &Copies,
    most: Option<usize>,
    time: &dyn Budget,
    progress: &dyn Progress,
) -> Result<usize> {
    let mut spent = 0;
    loop {
        let mut step = race.next();
        step.truncate(most.unwrap_or(usize::MAX) - spent);
        if step.is_empty() {
            return Ok(spent);
        }
        let [known, all] = race.known();
        progress.report("race of actions", known as u64, all as u64)?;
        let tried: Vec<(&ValidAction, usize)> = step.iter().map(|(i, k)| (&valid[*i], *k)).collect();
        match copies.solve(&tried, time) {
            Ok(solved) => race.tell(&step, &solved),
            Err(Error::Deadline { .. }) => return Ok(spent),
            Err(error) => return Err(error),
        }
        spent += step.len();
    }
}

/// The best under copies that had no say in the ranking.
fn afresh(best: &[&ValidAction], copies: &Copies, progress: &dyn Progress) -> Result<Vec<Count>> {
    let draws = copies.draws();
    let mut counts = Vec::with_capacity(best.len());
    for action in best {
        progress.report("fresh draws for the best", counts.len() as u64, best.len() as u64)?;
        let tried: Vec<(&ValidAction, usize)> = (draws..2 * draws).map(|k| (*action, k)).collect();
        let mut count = Count::default();
        copies.solve(&tried, &Endless)?.into_iter().for_each(|solved| count.add(solved));
        counts.push(count);
    }
    Ok(counts)
}
