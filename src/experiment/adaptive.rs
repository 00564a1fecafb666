//! Adaptive experimental design as a workflow's selection method: samples the current posterior and selects the actions with the
//! highest expected information about a question.
//!
//! Source: as [`crate::design`]. Current knowledge is a set of posterior draws given the trials so far, or prior draws while there are
//! too few trials. Assumptions: positions have 5 mm of measurement noise; if one parameter of an effect is fitted, all its parameters
//! are unknown.

use super::EstimateConfig;
use super::estimators::{Estimator, EstimatorInput};
use super::grounding::MIN_INTERACTIONS;
use super::selection_summary::SelectionSummary;
use crate::design::{DesignConfig, Experiment, Question, design, document};
use crate::error::{Error, Result};
use crate::estimate::ParameterSamples;
use crate::progress::Progress;
use crate::reality::Trial;
use crate::task::Task;

/// Posterior draws.
const DRAWS: usize = 512;
/// Limits on the candidates and on the selected batch, as in `POST /v1/designs`.
const MAX_CANDIDATES: usize = 2000;
const MAX_BATCH_ACTIONS: usize = 20;

/// Selected actions with reasons.
pub struct AdaptiveSelection {
    /// In the order of selection.
    pub experiments: Vec<Experiment>,
    /// Reason for each experiment.
    pub reasons: Vec<String>,
    /// Shortlisted experiments that were not selected.
    pub others: Vec<Experiment>,
    /// Rollouts of the design; those of the posterior are not counted.
    pub rollouts: u64,
}

/// Errors unless posterior draws are available for the configuration.
pub fn check(config: &EstimateConfig) -> Result<()> {
    let refused = |beside: &str, allowed: &str| {
        let allowed = format!("a strategy that ranks at the estimate, or {allowed}");
        Err(Error::input("strategy", format!("{:?} with {beside}", config.strategy), allowed))
    };
    if !config.effects.is_empty() {
        return refused("effects", "effects in `fit`, so that the posterior includes them");
    }
    if !config.senses.is_empty() {
        return refused("senses", "no `senses`: posterior draws do not respect them");
    }
    if config.actions > MAX_BATCH_ACTIONS {
        let allowed = format!("at most {MAX_BATCH_ACTIONS} with an adaptive design");
        return Err(Error::input("actions", config.actions, allowed));
    }
    let set = config.cem.free_effects();
    ParameterSamples::prior_over_sets(config.cem.prior, &[set], 1, config.seed).map(drop).map_err(|error| {
        match error {
            Error::Input(input) => Error::input("fit", input.value, input.allowed),
            other => other,
        }
    })
}

impl AdaptiveSelection {
    /// Summary of the selection; `step` is the tasks' time step, s. Candidates are the shortlisted experiments.
    pub fn choice(&self, step: f64) -> SelectionSummary {
        let mean = |of: &[&Experiment], f: &dyn Fn(&Experiment) -> f64| {
            of.iter().map(|e| f(e)).sum::<f64>() / of.len().max(1) as f64
        };
        let chosen: Vec<&Experiment> = self.experiments.iter().collect();
        let all: Vec<&Experiment> = self.experiments.iter().chain(&self.others).collect();
        let mut tasks: Vec<&str> = chosen.iter().map(|e| e.task.as_str()).collect();
        tasks.sort_unstable();
        tasks.dedup();
        let rolling = |e: &Experiment| e.rolling / step;
        SelectionSummary {
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

/// The batch of `count` actions on `tasks` with the highest expected information about `question`, given `trials`.
pub fn select_adaptively(
    tasks: &[Task],
    trials: &[Trial],
    config: &EstimateConfig,
    question: Question,
    (count, seed): (usize, u64),
    progress: &dyn Progress,
) -> Result<AdaptiveSelection> {
    let (belief, told) = current_posterior(tasks, trials, config, seed, progress)?;
    let usual = DesignConfig::standard(question, seed);
    let setup = DesignConfig {
        candidates: config.candidates.clamp(count, MAX_CANDIDATES),
        shortlist: usual.shortlist.max(count),
        batch: count,
        engine: config.engine,
        ..usual
    };
    let mut found = design(tasks, tasks, &belief, &setup, progress)?;
    let before = if told { "" } else { "given the prior: " };
    let rows = document(&found, &setup).experiments.into_iter();
    let reasons = rows.map(|e| format!("{before}{}", e.reason)).collect();
    let others = found.experiments.split_off(found.batch);
    Ok(AdaptiveSelection { experiments: found.experiments, reasons, others, rollouts: found.rollouts as u64 })
}

/// Draws of the latents and fitted effects, and whether they come from the posterior: prior draws while there are too few trials, or
/// if no posterior can be sampled.
fn current_posterior(
    tasks: &[Task],
    trials: &[Trial],
    config: &EstimateConfig,
    seed: u64,
    progress: &dyn Progress,
) -> Result<(ParameterSamples, bool)> {
    let set = config.cem.free_effects();
    let prior = || {
        let sets = std::slice::from_ref(&set);
        Ok((ParameterSamples::standard_prior(config.cem.prior, sets, seed)?, false))
    };
    let Some(base) = tasks.first().filter(|_| trials.len() >= MIN_INTERACTIONS) else { return prior() };
    let asked = EstimatorInput {
        prior: config.cem.prior,
        base: &base.scene,
        set: &set,
        engine: config.engine,
        draws: DRAWS,
        noise: DesignConfig::standard(Question::Latents, seed).noise,
        seed,
    };
    match asked.estimate(Estimator::Posterior, trials, progress) {
        Ok(told) => Ok((ParameterSamples::from_draws(told.draws)?, true)),
        // The trials do not identify the parameters.
        Err(Error::Input(_) | Error::Failed(_)) => prior(),
        Err(error) => Err(error),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::experiment::{Workflow, run};
    use crate::progress::NoProgress;
    use crate::reality::{HiddenConfig, HiddenWorld, standard};
    use crate::task::scene::EffectTerm;
    use crate::task::{Split, family, split};
    use crate::world::EffectParameter;

    /// Each proposal has a reason, with the prior and with a posterior; a resumed workflow makes the same proposals.
    #[test]
    fn proposals_have_reasons() {
        let family = family("basketball").unwrap();
        let tasks = split(&family.fold(0), Split::Train)[..3].to_vec();
        let usual = EstimateConfig::fast(family.prior);
        let config = EstimateConfig {
            strategy: "probing".into(),
            rounds: 2,
            actions: MIN_INTERACTIONS,
            candidates: 16,
            settled: 0.0,
            ..usual
        };
        let hidden = HiddenConfig { noise: 0.005, seed: 4, ..standard(family) };
        let mut world = HiddenWorld::new(hidden).unwrap();
        let mut workflow = Workflow::new(&tasks, &config, None).unwrap();
        run(&mut workflow, &mut world, &NoProgress, &mut |_| Ok(())).unwrap();
        let rounds = workflow.rounds();
        assert_eq!(rounds.len(), 2);
        for round in rounds {
            assert_eq!(
                (round.proposals.len(), round.choice.reasons.len()),
                (MIN_INTERACTIONS, MIN_INTERACTIONS)
            );
            assert!(round.choice.reasons.iter().all(|r| r.contains("collisions")), "{:?}", round.choice);
            assert!(round.choice.rollouts > 0 && round.choice.actions == MIN_INTERACTIONS);
        }
        assert_ne!(rounds[0].proposals[0].action, rounds[1].proposals[0].action);
        let again = Workflow::new(&tasks, &config, None).unwrap().resume(rounds[..1].to_vec()).unwrap();
        let mut again = again;
        assert_eq!(again.propose(None, &NoProgress).unwrap().unwrap(), rounds[1].proposals);
        let beside =
            EstimateConfig { effects: vec![EffectTerm::new("linear_drag", &[("c", 0.2)])], ..config };
        assert!(refused(&beside).contains("strategy"));
        let many = EstimateConfig { actions: 21, effects: Vec::new(), ..beside.clone() };
        assert!(refused(&many).contains("actions"));
        let mut somewhere = EstimateConfig { effects: Vec::new(), ..beside };
        somewhere.cem.add_free_parameter(EffectParameter::parse("sticky_patch.c").unwrap());
        assert!(refused(&somewhere).contains("fit"));
    }

    fn refused(config: &EstimateConfig) -> String {
        check(config).unwrap_err().to_string()
    }

    /// For an effect that the posterior does not cover, the prior is used.
    #[test]
    fn falls_back_to_prior_without_posterior() {
        let family = family("basketball").unwrap();
        let tasks = split(&family.fold(0), Split::Train)[..2].to_vec();
        let mut config = EstimateConfig { candidates: 12, ..EstimateConfig::fast(family.prior) };
        config.cem.add_free_parameter(EffectParameter::parse("spin_decay.c").unwrap());
        let hidden = HiddenConfig { noise: 0.005, seed: 4, ..standard(family) };
        let trials = crate::experiment::random_trials(
            &tasks,
            &mut HiddenWorld::new(hidden).unwrap(),
            4,
            1,
            &NoProgress,
        )
        .unwrap();
        let (belief, told) = current_posterior(&tasks, &trials, &config, 1, &NoProgress).unwrap();
        assert!(!told && belief.draws()[0].value("spin_decay.c").is_some());
    }
}
