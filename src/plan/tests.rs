//! Tests of planning against exhaustive evaluation, and with threads, deadlines and policies.

use std::sync::atomic::{AtomicUsize, Ordering};

use super::*;
use crate::budget::{Budget, Unlimited};
use crate::error::{Error, Result};
use crate::estimate::ParameterSamples;
use crate::policy::evaluate::candidates;
use crate::policy::rank;
use crate::progress::NoProgress;
use crate::task::{Placement, Task, ValidAction, family};
use crate::world::{Latents, effect};

fn task(name: &str) -> Task {
    let family = family(name.split(':').next().unwrap()).unwrap();
    family.tasks().into_iter().find(|t| t.id == name).unwrap()
}

fn small_config(seed: u64) -> PlanConfig {
    PlanConfig { actions: 160, draws: 8, exact: 5, ..PlanConfig::standard(seed) }
}

fn prior(seed: u64) -> ParameterSamples {
    ParameterSamples::prior(family("basketball").unwrap().prior, Vec::new(), 40, seed).unwrap()
}

/// Exhaustive evaluation: (action, successes), best first.
fn exhaustive(task: &Task, belief: &ParameterSamples, config: &PlanConfig) -> Vec<(ValidAction, usize)> {
    let copies = PerturbedRollouts::new(task, belief, config);
    let all = candidates(task, &config.candidates()).unwrap();
    let valid = all.into_iter().filter(|a| matches!(task.place(a), Placement::Valid(_)));
    let mut found: Vec<(ValidAction, usize)> = valid
        .map(|action| {
            let tried: Vec<_> = (0..copies.draws()).map(|k| (&action, k)).collect();
            let solved = copies.solve(&tried, &Unlimited).unwrap().into_iter().filter(|s| *s).count();
            (action, solved)
        })
        .collect();
    found.sort_by_key(|(_, solved)| std::cmp::Reverse(*solved));
    found
}

#[test]
fn matches_exhaustive_evaluation() {
    let task = task("basketball:003");
    let beliefs = [
        prior(1),
        ParameterSamples::point(Latents::of([1.0, 0.2, 0.7]), vec![effect::damping(0.8)]).unwrap(),
    ];
    for (seed, belief) in beliefs.iter().enumerate() {
        let config = PlanConfig { actions: 600, ..small_config(seed as u64) };
        let found = plan(&task, belief, &config, &Unlimited, &NoProgress).unwrap();
        let wanted = exhaustive(&task, belief, &config);
        assert!(found.complete && wanted[0].1 > 0, "{wanted:?}");
        assert_eq!(found.ranked.len(), wanted.len());
        assert_eq!(found.ranked.len() + found.invalid, 600);
        for (ranked, (action, solved)) in found.ranked.iter().zip(&wanted).take(config.exact) {
            assert_eq!(
                (&ranked.action, ranked.ranking_count),
                (action, SuccessCount { successes: *solved, rollouts: 8 })
            );
            assert_eq!(ranked.fresh_count.unwrap().rollouts, 8);
        }
        assert!(
            found.ranked[config.exact..]
                .iter()
                .all(|r| r.fresh_count.is_none() && r.ranking_count.rollouts >= config.look)
        );
        assert!(found.rollouts < wanted.len() * config.draws);
    }
}

#[test]
fn is_deterministic_on_any_number_of_threads() {
    let task = task("basketball:003");
    let of = |threads: usize, seed: u64| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| plan(&task, &prior(1), &small_config(seed), &Unlimited, &NoProgress).unwrap())
    };
    let one = of(1, 3);
    assert_eq!(one, of(3, 3));
    assert_ne!(one, of(1, 4));
}

/// Reports a deadline after a number of checks.
struct LimitedBudget(AtomicUsize, usize);
impl Budget for LimitedBudget {
    fn check(&self) -> Result<()> {
        match self.0.fetch_add(1, Ordering::Relaxed) < self.1 {
            true => Ok(()),
            false => Err(Error::Deadline { seconds: 1.0 }),
        }
    }
}

#[test]
fn returns_incomplete_plans_after_the_deadline() {
    let task = task("basketball:003");
    let found = plan(&task, &prior(1), &small_config(1), &LimitedBudget(AtomicUsize::new(0), 0), &NoProgress)
        .unwrap();
    assert!(!found.complete);
    assert!(found.ranked.iter().all(|r| r.ranking_count == SuccessCount::default()));
    assert_eq!(found.rollouts, 5 * 8, "fresh draws only");
    let few = PlanConfig { rollouts: Some(300), ..small_config(1) };
    let found = plan(&task, &prior(1), &few, &Unlimited, &NoProgress).unwrap();
    assert_eq!((found.complete, found.rollouts), (false, 300 + 40));
    // Actions with failures rank behind those without rollouts.
    let shares: Vec<f64> = found.ranked.iter().map(|r| r.ranking_count.smoothed_share()).collect();
    assert!(shares.windows(2).all(|w| w[0] >= w[1]));
}

#[test]
fn propagates_other_errors() {
    struct CancelledBudget;
    impl Budget for CancelledBudget {
        fn check(&self) -> Result<()> {
            Err(Error::Cancelled)
        }
    }
    let found = plan(&task("basketball:003"), &prior(1), &small_config(1), &CancelledBudget, &NoProgress);
    assert_eq!(found, Err(Error::Cancelled));
}

/// Every action has the same worlds and perturbations, and none without perturbation.
#[test]
fn uses_common_random_numbers() {
    let task = task("basketball:003");
    let belief = prior(1);
    let copies = PerturbedRollouts::new(&task, &belief, &small_config(1));
    let space = task.actions();
    let (a, b) = (space.at(7).unwrap(), space.at(20_111).unwrap());
    for k in 0..16 {
        let by = |x: &ValidAction| copies.perturbed_action(x, k).values()[0] - x.values()[0];
        assert!((by(&a) - by(&b)).abs() < 1e-12 && by(&a).abs() <= 0.002 && by(&a) != 0.0);
    }
    let still =
        PerturbedRollouts::new(&task, &belief, &PlanConfig { perturb: 0.0, draws: 100, ..small_config(1) });
    assert_eq!(still.perturbed_action(&a, 3), a);
    assert_eq!(still.draws(), 40, "each of the belief's 40 worlds once");
}

#[test]
fn planner_ranks_like_its_plan() {
    let task = task("basketball:003");
    let config = small_config(2);
    let found = plan(&task, &prior(1), &config, &Unlimited, &NoProgress).unwrap();
    let planner = PlanPolicy::new("the prior", std::slice::from_ref(&found));
    let all = candidates(&task, &config.candidates()).unwrap();
    let order = rank(&planner, &task, &all, 64).unwrap();
    for (ranked, i) in found.ranked.iter().zip(&order) {
        assert_eq!(ranked.action, all[*i]);
    }
    let other = family("bowling").unwrap().tasks().remove(0);
    assert!(matches!(rank(&planner, &other, &all[..1], 1), Err(Error::NotFound { .. })));
}

#[test]
fn rejects_values_out_of_range_by_name() {
    let odd = |change: fn(&mut PlanConfig)| {
        let mut config = small_config(0);
        change(&mut config);
        config.validate().unwrap_err().to_string()
    };
    assert!(odd(|c| c.actions = 0).contains("actions"));
    assert!(odd(|c| c.draws = 0).contains("draws"));
    assert!(odd(|c| c.perturb = f64::NAN).contains("perturb"));
    assert!(odd(|c| c.exact = 0).contains("exact"));
    assert!(odd(|c| c.look = 0).contains("look"));
    assert!(odd(|c| c.rollouts = Some(0)).contains("rollouts"));
}
