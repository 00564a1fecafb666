//! A design: candidates, a first look at all, a close one at the best, and of those the batch that tells most together.

use super::config::DesignConfig;
use super::costs::{self, Costs};
use super::gain::{Gain, Labels, over};
use super::look::{Candidate, Search};
use super::narrowed::{Narrowed, narrowed};
use super::question::Question;
use super::shown::Hand;
use super::told::{Alike, Seen};
use super::worlds::{Worlds, worlds};
use crate::error::{Error, Result};
use crate::estimate::Belief;
use crate::explore;
use crate::progress::Progress;
use crate::rng;
use crate::task::{Split, Task, ValidAction, split};
use rayon::prelude::*;
use std::collections::BTreeSet;

/// Fewest worlds of a look, and of a set that is asked about; and so many of each set are looked at where there are: fewer do not tell
/// the shape of what a set's worlds show.
const FEW: usize = 8;
const EACH: usize = 16;

/// What was found.
#[derive(Clone, Debug, PartialEq)]
pub struct Design {
    /// The batch, in the order in which it was chosen; then the others that were looked at closely, the most telling first.
    pub experiments: Vec<Experiment>,
    /// How many of them are the batch.
    pub batch: usize,
    /// Of the batch together.
    pub together: Gain,
    /// Sets of effects of the belief, and how likely each is.
    pub sets: Vec<(Vec<String>, f64)>,
    /// Candidates that were looked at.
    pub candidates: usize,
    pub rollouts: usize,
}

/// An action, and what it would tell.
#[derive(Clone, Debug, PartialEq)]
pub struct Experiment {
    /// Id of its task.
    pub task: String,
    pub action: ValidAction,
    /// What it tells by itself.
    pub gain: Gain,
    /// What it adds to those of the batch before it, nats; of the batch only.
    pub adds: Option<f64>,
    /// What it costs: after those of the batch before it, or by itself.
    pub cost: f64,
    /// How far latents and parameters would be known.
    pub expected: Vec<Narrowed>,
    /// What happens, over worlds: contacts begun between movable bodies, and seconds that bodies spend on surfaces, of all bodies together.
    pub collisions: f64,
    pub rolling: f64,
}

/// Which actions on `tasks` would tell the most about the question, under a belief; `asked`: the tasks whose success is asked about, where
/// it is. Same seed, same bits, on any number of threads.
pub fn design(
    tasks: &[Task],
    asked: &[Task],
    belief: &Belief,
    config: &DesignConfig,
    progress: &dyn Progress,
) -> Result<Design> {
    config.validate()?;
    let [early, closely] = looks(belief, config)?;
    let hand = Hand { copies: config.copies, perturb: config.perturb, seed: config.seed };
    let mut stream = rng::stream(config.seed, "design candidates");
    let mut copied = Vec::with_capacity(config.candidates);
    for (task, action, _) in explore::draw(tasks, config.candidates, &mut stream)? {
        copied.extend(hand.copied(&tasks[task], &action).map(|c| (task, action, c)));
    }
    if copied.is_empty() {
        let allowed = "actions that can be placed a little aside, too: a smaller `perturb`";
        return Err(Error::input("perturb", config.perturb, allowed));
    }
    let mut search = Search { config, belief, asked, planned: Vec::new(), rollouts: 0, progress };
    let labels = search.labels(&early)?;
    let look = search.look("first look", &copied, (&early, &labels), |_, gain| gain.information)?;
    let mut order: Vec<usize> = (0..copied.len()).collect();
    order.sort_by(|a, b| look[*b].total_cmp(&look[*a]).then(a.cmp(b)));
    let order = costs::shortlist(&order, |i| copied[i].0, config.shortlist, &config.costs);
    let mut shortlist: Vec<Candidate> = Vec::with_capacity(order.len());
    let mut rest: Vec<Option<Candidate>> = copied.into_iter().map(Some).collect();
    shortlist.extend(order.iter().filter_map(|i| rest[*i].take()));
    let labels = search.labels(&closely)?;
    let found = search.look("close look", &shortlist, (&closely, &labels), |seen, gain| (seen, gain))?;
    let on: Vec<usize> = shortlist.iter().map(|(task, ..)| *task).collect();
    let (chosen, together) = batch(&found, &labels, closely.alike(), (&on, config), progress)?;
    let happens = search.happens(tasks, &shortlist, &closely)?;
    let mut after: Vec<usize> =
        (0..shortlist.len()).filter(|i| !chosen.iter().any(|c| c.index == *i)).collect();
    after.sort_by(|a, b| found[*b].1.information.total_cmp(&found[*a].1.information).then(a.cmp(b)));
    let alone = config.costs.of(0, &BTreeSet::new());
    let all = chosen.iter().map(|c| (c.index, Some(c.adds), c.cost));
    let all = all.chain(after.into_iter().map(|i| (i, None, alone)));
    let experiment = |(i, adds, cost): (usize, Option<f64>, f64)| Experiment {
        task: tasks[shortlist[i].0].id.clone(),
        action: shortlist[i].1.clone(),
        gain: found[i].1,
        adds,
        cost,
        expected: narrowed(&found[i].0, &closely.worlds),
        collisions: happens[i][0],
        rolling: happens[i][1],
    };
    Ok(Design {
        experiments: all.map(experiment).collect(),
        batch: chosen.len(),
        together,
        sets: closely.sets.iter().cloned().zip(closely.weights.iter().copied()).collect(),
        candidates: look.len(),
        rollouts: search.rollouts,
    })
}

/// Tasks that are acted on, and those whose success is asked about; of one task, or of a family without such parts, all.
pub fn parts(tasks: &[Task]) -> (Vec<Task>, Vec<Task>) {
    let part = |of: Split| {
        let own = split(tasks, of);
        if tasks.len() > 1 && !own.is_empty() { own } else { tasks.to_vec() }
    };
    (part(Split::Train), part(Split::Test))
}

/// The worlds of the first look and of the close one; an error where a belief has no two answers to a question.
pub fn looks<'a>(belief: &'a Belief, config: &DesignConfig) -> Result<[Worlds<'a>; 2]> {
    let evenly = config.question == Question::Effects;
    let drawn = |count| worlds(belief, count, evenly.then_some(EACH), config.seed);
    let looks = [drawn(config.worlds[0])?, drawn(config.worlds[1])?];
    let sets = looks[0].sets.len();
    let refused = |value: String, allowed: &str| Err(Error::input("belief", value, allowed));
    if evenly && sets < 2 {
        let allowed = "draws of two sets of effects or more (`--set` of iplw posterior, repeated)";
        return refused("one set of effects".into(), allowed);
    }
    if looks[0].worlds.len() < FEW {
        let allowed = "at least 8 draws: a posterior, or a prior";
        return refused(format!("{} draws", looks[0].worlds.len()), allowed);
    }
    let counts = |s: usize| looks[0].groups.iter().filter(|g| **g == s).count();
    if let Some(s) = (0..sets).find(|s| evenly && counts(*s) < FEW) {
        let set = looks[0].sets[s].join("+");
        let allowed =
            "at least 8 draws of every set that is asked about: more draws, or a belief without the set";
        return refused(format!("{} draws of the set {set:?}", counts(s)), allowed);
    }
    Ok(looks)
}

/// One of a batch.
struct Chosen {
    index: usize,
    /// What it adds to those before it, nats.
    adds: f64,
    cost: f64,
}

/// The batch, each the one that adds most for its cost to those before it, and what they tell together; `on`: the task of each.
fn batch(
    found: &[(Seen, Gain)],
    labels: &[Labels],
    alike: Alike,
    (on, config): (&[usize], &DesignConfig),
    progress: &dyn Progress,
) -> Result<(Vec<Chosen>, Gain)> {
    let (size, costs) = (config.batch.min(found.len()), &config.costs);
    let mut chosen: Vec<Chosen> = Vec::with_capacity(size);
    let (mut sum, mut known): (Option<Seen>, Gain) = (None, Gain::default());
    let (mut set_up, mut spent) = (BTreeSet::new(), 0.0);
    while chosen.len() < size {
        progress.report("choosing together", chosen.len() as u64, size as u64)?;
        let with = |i: usize| match &sum {
            Some(sum) => {
                let both = sum.and(&found[i].0, alike);
                let gain = over(&both.told(alike)?, labels);
                Ok((both, gain))
            }
            None => Ok(found[i].clone()),
        };
        let left = (0..found.len()).filter(|i| !chosen.iter().any(|c| c.index == *i));
        let paid: Vec<(usize, f64)> = left
            .map(|i| (i, costs.of(on[i], &set_up)))
            .filter(|(_, cost)| costs.pays(spent, *cost))
            .collect();
        let told: Vec<(usize, f64, (Seen, Gain))> =
            paid.into_par_iter().map(|(i, cost)| Ok((i, cost, with(i)?))).collect::<Result<_>>()?;
        let worth = |(_, cost, (_, gain)): &(usize, f64, (Seen, Gain))| {
            Costs::worth(gain.information - known.information, *cost)
        };
        let best = told.into_iter().reduce(|best, own| if worth(&own) > worth(&best) { own } else { best });
        let Some((index, cost, (seen, gain))) = best else { break };
        chosen.push(Chosen { index, adds: gain.information - known.information, cost });
        set_up.insert(on[index]);
        spent += cost;
        (sum, known) = (Some(seen), gain);
    }
    Ok((chosen, known))
}
