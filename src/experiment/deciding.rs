//! Experiments that decide, as a workflow's way to choose: what is known so far is drawn, and the next actions are those expected
//! to tell most of a question.
//!
//! Source: as [`crate::design`]. What is known are draws of the posterior given the trials so far; before one can be drawn, the prior.
//! Positions are taken to be seen with 5 mm of noise, and of an effect of which something is fitted along all parameters to be open.

use super::EstimateConfig;
use super::choice::Choice;
use super::estimators::{Asked, Estimator};
use super::grounding::FIRST;
use crate::design::{DesignConfig, Experiment, Question, design, document};
use crate::error::{Error, Result};
use crate::estimate::Belief;
use crate::estimate::belief::PRIOR_DRAWS;
use crate::progress::Progress;
use crate::reality::Trial;
use crate::task::Task;

/// Draws of a posterior.
const DRAWS: usize = 512;
/// Most actions that are looked at, and most that are chosen together: as `POST /v1/designs` takes.
const MOST_CANDIDATES: usize = 2000;
const MOST_TOGETHER: usize = 20;

/// What is to be done next, and why.
pub struct Decided {
    /// In the order in which they were chosen.
    pub experiments: Vec<Experiment>,
    /// Why each was, in words.
    pub reasons: Vec<String>,
    /// What else was looked at closely.
    pub others: Vec<Experiment>,
    /// Of the design; what a posterior simulates is not counted.
    pub rollouts: u64,
}

/// Errors unless a configuration can be decided by: what is known of it can be drawn.
pub fn check(config: &EstimateConfig) -> Result<()> {
    let refused = |beside: &str, allowed: &str| {
        let allowed = format!("a strategy that ranks at the estimate, or {allowed}");
        Err(Error::input("strategy", format!("{:?} beside {beside}", config.strategy), allowed))
    };
    if !config.effects.is_empty() {
        return refused("effects", "the effects fitted along: what is known of them is drawn");
    }
    if !config.senses.is_empty() {
        return refused("senses", "no senses: draws of what is known do not see them");
    }
    if config.actions > MOST_TOGETHER {
        let allowed = format!("at most {MOST_TOGETHER} where a strategy decides what to measure");
        return Err(Error::input("actions", config.actions, allowed));
    }
    let set = config.cem.effects_fitted();
    Belief::of_sets(config.cem.prior, &[set], 1, config.seed).map(drop).map_err(|error| match error {
        Error::Input(input) => Error::input("fit", input.value, input.allowed),
        other => other,
    })
}

impl Decided {
    /// What was chosen, counted; `step`: a time step of the tasks, s. Candidates are those that were looked at closely.
    pub fn choice(&self, step: f64) -> Choice {
        let mean = |of: &[&Experiment], f: &dyn Fn(&Experiment) -> f64| {
            of.iter().map(|e| f(e)).sum::<f64>() / of.len().max(1) as f64
        };
        let chosen: Vec<&Experiment> = self.experiments.iter().collect();
        let all: Vec<&Experiment> = self.experiments.iter().chain(&self.others).collect();
        let mut tasks: Vec<&str> = chosen.iter().map(|e| e.task.as_str()).collect();
        tasks.sort_unstable();
        tasks.dedup();
        let rolling = |e: &Experiment| e.rolling / step;
        Choice {
            actions: chosen.len(),
            tasks: tasks.len(),
            collisions: mean(&chosen, &|e| e.collisions),
            rolling_steps: mean(&chosen, &rolling),
            candidate_collisions: mean(&all, &|e| e.collisions),
            candidate_rolling_steps: mean(&all, &rolling),
            groups: None,
            expected: Vec::new(),
            reasons: self.reasons.clone(),
            rollouts: self.rollouts,
        }
    }
}

/// The `count` actions on `tasks` that together tell most of a question, after what was measured.
pub fn decided(
    tasks: &[Task],
    trials: &[Trial],
    config: &EstimateConfig,
    question: Question,
    (count, seed): (usize, u64),
    progress: &dyn Progress,
) -> Result<Decided> {
    let (belief, told) = known(tasks, trials, config, seed, progress)?;
    let usual = DesignConfig::standard(question, seed);
    let setup = DesignConfig {
        candidates: config.candidates.clamp(count, MOST_CANDIDATES),
        shortlist: usual.shortlist.max(count),
        batch: count,
        engine: config.engine,
        ..usual
    };
    let mut found = design(tasks, tasks, &belief, &setup, progress)?;
    let before = if told { "" } else { "by what is believed beforehand: " };
    let rows = document(&found, &setup).experiments.into_iter();
    let reasons = rows.map(|e| format!("{before}{}", e.reason)).collect();
    let others = found.experiments.split_off(found.batch);
    Ok(Decided { experiments: found.experiments, reasons, others, rollouts: found.rollouts as u64 })
}

/// What is known after the trials, and whether they say any of it: their posterior, with the effects that are fitted along; the prior
/// as long as they are too few, or no posterior can be drawn of them.
fn known(
    tasks: &[Task],
    trials: &[Trial],
    config: &EstimateConfig,
    seed: u64,
    progress: &dyn Progress,
) -> Result<(Belief, bool)> {
    let set = config.cem.effects_fitted();
    let prior =
        || Ok((Belief::of_sets(config.cem.prior, std::slice::from_ref(&set), PRIOR_DRAWS, seed)?, false));
    let Some(base) = tasks.first().filter(|_| trials.len() >= FIRST) else { return prior() };
    let asked = Asked {
        prior: config.cem.prior,
        base: &base.scene,
        set: &set,
        engine: config.engine,
        draws: DRAWS,
        noise: DesignConfig::standard(Question::Latents, seed).noise,
        seed,
    };
    match asked.told(Estimator::Posterior, trials, progress) {
        Ok(told) => Ok((Belief::of_draws(told.draws)?, true)),
        // Trials that tell nothing of what is asked about, or too little to fit.
        Err(Error::Input(_) | Error::Failed(_)) => prior(),
        Err(error) => Err(error),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::experiment::{Workflow, run};
    use crate::progress::Silent;
    use crate::reality::{HiddenConfig, HiddenWorld, standard};
    use crate::task::scene::EffectTerm;
    use crate::task::{Split, family, split};
    use crate::world::EffectParameter;

    /// Each proposal comes with its reason, before there is a posterior and after; a workflow that goes on later asks the same.
    #[test]
    fn proposals_are_decided_with_reasons() {
        let family = family("basketball").unwrap();
        let tasks = split(&family.fold(0), Split::Train)[..3].to_vec();
        let usual = EstimateConfig::fast(family.prior);
        let config = EstimateConfig {
            strategy: "probing".into(),
            rounds: 2,
            actions: FIRST,
            candidates: 16,
            settled: 0.0,
            ..usual
        };
        let hidden = HiddenConfig { noise: 0.005, seed: 4, ..standard(family) };
        let mut world = HiddenWorld::new(hidden).unwrap();
        let mut workflow = Workflow::new(&tasks, &config, None).unwrap();
        run(&mut workflow, &mut world, &Silent, &mut |_| Ok(())).unwrap();
        let rounds = workflow.rounds();
        assert_eq!(rounds.len(), 2);
        for round in rounds {
            assert_eq!((round.proposals.len(), round.choice.reasons.len()), (FIRST, FIRST));
            assert!(round.choice.reasons.iter().all(|r| r.contains("collisions")), "{:?}", round.choice);
            assert!(round.choice.rollouts > 0 && round.choice.actions == FIRST);
        }
        assert_ne!(rounds[0].proposals[0].action, rounds[1].proposals[0].action);
        let again = Workflow::new(&tasks, &config, None).unwrap().resume(rounds[..1].to_vec()).unwrap();
        let mut again = again;
        assert_eq!(again.propose(None, &Silent).unwrap().unwrap(), rounds[1].proposals);
        let beside = EstimateConfig {
            effects: vec![EffectTerm { name: "linear_drag".into(), parameters: [("c".into(), 0.2)].into() }],
            ..config
        };
        assert!(refused(&beside).contains("strategy"));
        let many = EstimateConfig { actions: 21, effects: Vec::new(), ..beside.clone() };
        assert!(refused(&many).contains("actions"));
        let mut somewhere = EstimateConfig { effects: Vec::new(), ..beside };
        somewhere.cem.fit_along(EffectParameter::parse("sticky_patch.c").unwrap());
        assert!(refused(&somewhere).contains("fit"));
    }

    fn refused(config: &EstimateConfig) -> String {
        check(config).unwrap_err().to_string()
    }

    /// An effect that no search of a posterior looks for: what is believed beforehand is what there is.
    #[test]
    fn what_no_posterior_can_be_drawn_of_is_as_believed() {
        let family = family("basketball").unwrap();
        let tasks = split(&family.fold(0), Split::Train)[..2].to_vec();
        let mut config = EstimateConfig { candidates: 12, ..EstimateConfig::fast(family.prior) };
        config.cem.fit_along(EffectParameter::parse("spin_decay.c").unwrap());
        let hidden = HiddenConfig { noise: 0.005, seed: 4, ..standard(family) };
        let trials =
            crate::experiment::random_trials(&tasks, &mut HiddenWorld::new(hidden).unwrap(), 4, 1, &Silent)
                .unwrap();
        let (belief, told) = known(&tasks, &trials, &config, 1, &Silent).unwrap();
        assert!(!told && belief.draws()[0].number("spin_decay.c").is_some());
    }
}
