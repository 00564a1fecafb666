//! Search for a design: random candidates are screened, the shortlist is evaluated in more worlds, and a batch is chosen greedily.

use super::config::DesignConfig;
use super::costs::{self, Costs};
use super::gain::{AnswerPartition, InformationGain, mean_information_gain};
use super::likelihood::{ComponentScores, Grouping};
use super::posterior_sd::{ExpectedSd, expected_sds};
use super::predicted_observations::ActuationNoise;
use super::question::Question;
use super::screening::{CandidateScreening, DesignCandidate};
use super::worlds::{SampledWorlds, sample_worlds};
use crate::error::{Error, Result};
use crate::estimate::ParameterSamples;
use crate::explore;
use crate::progress::Progress;
use crate::rng;
use crate::task::{Split, Task, ValidAction, split};
use rayon::prelude::*;
use std::collections::BTreeSet;

/// Minimal number of worlds, in total and (for the question of effects) of each set. Where available, `WORLDS_PER_SET` worlds of each
/// set are used: the covariance of a set's observations isn't well determined by fewer.
const MIN_WORLDS: usize = 8;
const WORLDS_PER_SET: usize = 16;

/// Result of a search.
#[derive(Clone, Debug, PartialEq)]
pub struct Design {
    /// The batch, in the order in which it was chosen; then the rest of the shortlist, the most informative first.
    pub experiments: Vec<Experiment>,
    /// Size of the batch.
    pub batch: usize,
    /// Information gain of the whole batch.
    pub together: InformationGain,
    /// Sets of effects in the posterior, and the probability of each.
    pub sets: Vec<(Vec<String>, f64)>,
    /// Number of candidates that were evaluated.
    pub candidates: usize,
    pub rollouts: usize,
}

/// An action with its expected information gain.
#[derive(Clone, Debug, PartialEq)]
pub struct Experiment {
    /// Id of its task.
    pub task: String,
    pub action: ValidAction,
    /// Information gain of this experiment alone.
    pub gain: InformationGain,
    /// Information gain beyond the experiments of the batch before it, nats; for the batch only.
    pub adds: Option<f64>,
    /// Cost: after the experiments of the batch before it, or alone.
    pub cost: f64,
    /// Expected standard deviations of latents and effect parameters.
    pub expected: Vec<ExpectedSd>,
    /// Contacts begun between movable bodies, and seconds on surfaces summed over bodies; means over worlds.
    pub collisions: f64,
    pub rolling: f64,
}

/// The most informative actions on `tasks` about the question. `test_tasks`: the tasks whose success is in question, for that question
/// only. The result depends on the seed only, to the bit, with any number of threads.
pub fn design(
    tasks: &[Task],
    test_tasks: &[Task],
    belief: &ParameterSamples,
    config: &DesignConfig,
    progress: &dyn Progress,
) -> Result<Design> {
    config.validate()?;
    let [screening, refined] = screening_worlds(belief, config)?;
    let actuation = ActuationNoise { copies: config.copies, perturb: config.perturb, seed: config.seed };
    let mut stream = rng::stream(config.seed, "design candidates");
    let mut candidates = Vec::with_capacity(config.candidates);
    for (task, action, _) in explore::draw_placeable(tasks, config.candidates, &mut stream, progress)? {
        candidates.extend(actuation.perturb(&tasks[task], &action).map(|c| (task, action, c)));
    }
    if candidates.is_empty() {
        let allowed = "a smaller perturbation: no candidate action can be placed when perturbed";
        return Err(Error::input("perturb", config.perturb, allowed));
    }
    let mut search =
        CandidateScreening { config, belief, test_tasks, planned_actions: Vec::new(), rollouts: 0, progress };
    let labels = search.partitions(&screening)?;
    let gains =
        search.screen("first look", &candidates, (&screening, &labels), |_, gain| gain.information)?;
    let mut order: Vec<usize> = (0..candidates.len()).collect();
    order.sort_by(|a, b| gains[*b].total_cmp(&gains[*a]).then(a.cmp(b)));
    let order = costs::shortlist(&order, |i| candidates[i].0, config.shortlist, &config.costs);
    let mut shortlist: Vec<DesignCandidate> = Vec::with_capacity(order.len());
    let mut rest: Vec<Option<DesignCandidate>> = candidates.into_iter().map(Some).collect();
    shortlist.extend(order.iter().filter_map(|i| rest[*i].take()));
    let labels = search.partitions(&refined)?;
    let evaluated_shortlist =
        search.screen("close look", &shortlist, (&refined, &labels), |seen, gain| (seen, gain))?;
    let task_of: Vec<usize> = shortlist.iter().map(|(task, ..)| *task).collect();
    let (chosen, together) =
        select_batch(&evaluated_shortlist, &labels, refined.grouping(), (&task_of, config), progress)?;
    let contacts = search.contact_statistics(tasks, &shortlist, &refined)?;
    let mut after: Vec<usize> =
        (0..shortlist.len()).filter(|i| !chosen.iter().any(|c| c.index == *i)).collect();
    after.sort_by(|a, b| {
        evaluated_shortlist[*b].1.information.total_cmp(&evaluated_shortlist[*a].1.information).then(a.cmp(b))
    });
    let alone = config.costs.cost_of(0, &BTreeSet::new());
    let all = chosen.iter().map(|c| (c.index, Some(c.adds), c.cost));
    let all = all.chain(after.into_iter().map(|i| (i, None, alone)));
    let experiment = |(i, adds, cost): (usize, Option<f64>, f64)| Experiment {
        task: tasks[shortlist[i].0].id.clone(),
        action: shortlist[i].1.clone(),
        gain: evaluated_shortlist[i].1,
        adds,
        cost,
        expected: expected_sds(&evaluated_shortlist[i].0, &refined.worlds),
        collisions: contacts[i][0],
        rolling: contacts[i][1],
    };
    Ok(Design {
        experiments: all.map(experiment).collect(),
        batch: chosen.len(),
        together,
        sets: refined.sets.iter().cloned().zip(refined.weights.iter().copied()).collect(),
        candidates: gains.len(),
        rollouts: search.rollouts,
    })
}

/// Training tasks to act on, and test tasks whose success is in question; all tasks for a single task or a family without splits.
pub fn training_and_test_tasks(tasks: &[Task]) -> (Vec<Task>, Vec<Task>) {
    let part = |of: Split| {
        let own = split(tasks, of);
        if tasks.len() > 1 && !own.is_empty() { own } else { tasks.to_vec() }
    };
    (part(Split::Train), part(Split::Test))
}

/// Worlds for the screening and for the shortlist; an error where the posterior has fewer than two answers to the question.
pub fn screening_worlds<'a>(
    belief: &'a ParameterSamples,
    config: &DesignConfig,
) -> Result<[SampledWorlds<'a>; 2]> {
    let evenly = config.question == Question::Effects;
    let sample = |count| sample_worlds(belief, count, evenly.then_some(WORLDS_PER_SET), config.seed);
    let stages = [sample(config.worlds[0])?, sample(config.worlds[1])?];
    let sets = stages[0].sets.len();
    let refused = |value: String, allowed: &str| Err(Error::input("posterior", value, allowed));
    if evenly && sets < 2 {
        let allowed = "draws of two sets of effects or more (repeat `--set` of iplw posterior)";
        return refused("one set of effects".into(), allowed);
    }
    if stages[0].worlds.len() < MIN_WORLDS {
        let allowed = "at least 8 draws: a posterior, or a prior";
        return refused(format!("{} draws", stages[0].worlds.len()), allowed);
    }
    let counts = |s: usize| stages[0].groups.iter().filter(|g| **g == s).count();
    if let Some(s) = (0..sets).find(|s| evenly && counts(*s) < MIN_WORLDS) {
        let set = stages[0].sets[s].join("+");
        let allowed = "at least 8 draws of every set: more draws, or a posterior without this set";
        return refused(format!("{} draws of the set {set:?}", counts(s)), allowed);
    }
    Ok(stages)
}

/// One experiment of a batch.
struct BatchEntry {
    index: usize,
    /// Information gain beyond those before it, nats.
    adds: f64,
    cost: f64,
}

/// The greedily chosen batch, each experiment the one that adds most per cost, and the gain of all together. `task_of`: each candidate's task.
fn select_batch(
    evaluated_shortlist: &[(ComponentScores, InformationGain)],
    labels: &[AnswerPartition],
    grouping: Grouping,
    (task_of, config): (&[usize], &DesignConfig),
    progress: &dyn Progress,
) -> Result<(Vec<BatchEntry>, InformationGain)> {
    let (size, costs) = (config.batch.min(evaluated_shortlist.len()), &config.costs);
    let mut chosen: Vec<BatchEntry> = Vec::with_capacity(size);
    let (mut sum, mut known): (Option<ComponentScores>, InformationGain) = (None, InformationGain::default());
    let (mut set_up, mut spent) = (BTreeSet::new(), 0.0);
    while chosen.len() < size {
        progress.report("choosing the batch", chosen.len() as u64, size as u64)?;
        let with = |i: usize| match &sum {
            Some(sum) => {
                progress.check_stop()?;
                let both = sum.combined_with(&evaluated_shortlist[i].0, grouping);
                let gain = mean_information_gain(&both.likelihoods(grouping)?, labels);
                Ok((both, gain))
            }
            None => Ok(evaluated_shortlist[i].clone()),
        };
        let remaining = (0..evaluated_shortlist.len()).filter(|i| !chosen.iter().any(|c| c.index == *i));
        let affordable: Vec<(usize, f64)> = remaining
            .map(|i| (i, costs.cost_of(task_of[i], &set_up)))
            .filter(|(_, cost)| costs.affords(spent, *cost))
            .collect();
        let evaluated: Vec<(usize, f64, (ComponentScores, InformationGain))> =
            affordable.into_par_iter().map(|(i, cost)| Ok((i, cost, with(i)?))).collect::<Result<_>>()?;
        let worth = |(_, cost, (_, gain)): &(usize, f64, (ComponentScores, InformationGain))| {
            Costs::priority(gain.information - known.information, *cost)
        };
        let best =
            evaluated.into_iter().reduce(|best, own| if worth(&own) > worth(&best) { own } else { best });
        let Some((index, cost, (seen, gain))) = best else { break };
        chosen.push(BatchEntry { index, adds: gain.information - known.information, cost });
        set_up.insert(task_of[index]);
        spent += cost;
        (sum, known) = (Some(seen), gain);
    }
    Ok((chosen, known))
}
