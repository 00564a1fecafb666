//! Plans against brute force, threads, clocks and policies.

use std::sync::atomic::{AtomicUsize, Ordering};

use super::*;
use crate::budget::{Budget, Endless};
use crate::error::{Error, Result};
use crate::estimate::Belief;
use crate::policy::evaluate::candidates;
use crate::policy::rank;
use crate::progress::Silent;
use crate::task::{Placement, Task, ValidAction, family};
use crate::world::{Latents, effect};

fn task(name: &str) -> Task {
    let family = family(name.split(':').next().unwrap()).unwrap();
    family.tasks().into_iter().find(|t| t.id == name).unwrap()
}

fn small(seed: u64) -> PlanConfig {
    PlanConfig { actions: 160, draws: 8, exact: 5, ..PlanConfig::standard(seed) }
}

fn prior(seed: u64) -> Belief {
    Belief::prior(family("basketball").unwrap().prior, Vec::new(), 40, seed).unwrap()
}

/// Everything tried: (action, successes), best first.
fn brute(task: &Task, belief: &Belief, config: &PlanConfig) -> Vec<(ValidAction, usize)> {
    let copies = Copies::new(task, belief, config);
    let all = candidates(task, &config.candidates()).unwrap();
    let valid = all.into_iter().filter(|a| matches!(task.place(a), Placement::Valid(_)));
    let mut found: Vec<(ValidAction, usize)> = valid
        .map(|action| {
            let tried: Vec<_> = (0..copies.draws()).map(|k| (&action, k)).collect();
            let solved = copies.solve(&tried, &Endless).unwrap().into_iter().filter(|s| *s).count();
            (action, solved)
        })
        .collect();
    found.sort_by_key(|(_, solved)| std::cmp::Reverse(*solved));
    found
}

#[test]
fn the_best_are_those_of_trying_everything() {
    let task = task("basketball:003");
    let beliefs =
        [prior(1), Belief::point(Latents::of([1.0, 0.2, 0.7]), vec![effect::damping(0.8)]).unwrap()];
    for (seed, belief) in beliefs.iter().enumerate() {
        let config = PlanConfig { actions: 600, ..small(seed as u64) };
        let found = plan(&task, belief, &config, &Endless, &Silent).unwrap();
        let wanted = brute(&task, belief, &config);
        assert!(found.complete && wanted[0].1 > 0, "{wanted:?}");
        assert_eq!(found.ranked.len(), wanted.len());
        assert_eq!(found.ranked.len() + found.invalid, 600);
        for (ranked, (action, solved)) in found.ranked.iter().zip(&wanted).take(config.exact) {
            assert_eq!((&ranked.action, ranked.raced), (action, Count { successes: *solved, tried: 8 }));
            assert_eq!(ranked.fresh.unwrap().tried, 8);
        }
        assert!(
            found.ranked[config.exact..].iter().all(|r| r.fresh.is_none() && r.raced.tried >= config.look)
        );
        assert!(found.rollouts < wanted.len() * config.draws);
    }
}

#[test]
fn a_seed_gives_the_same_bits_on_any_number_of_threads() {
    let task = task("basketball:003");
    let of = |threads: usize, seed: u64| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| plan(&task, &prior(1), &small(seed), &Endless, &Silent).unwrap())
    };
    let one = of(1, 3);
    assert_eq!(one, of(3, 3));
    assert_ne!(one, of(1, 4));
}

/// Ends after so many looks.
struct Looks(AtomicUsize, usize);
impl Budget for Looks {
    fn look(&self) -> Result<()> {
        match self.0.fetch_add(1, Ordering::Relaxed) < self.1 {
            true => Ok(()),
            false => Err(Error::Deadline { seconds: 1.0 }),
        }
    }
}

#[test]
fn a_plan_that_runs_out_of_time_answers_and_says_so() {
    let task = task("basketball:003");
    let found = plan(&task, &prior(1), &small(1), &Looks(AtomicUsize::new(0), 0), &Silent).unwrap();
    assert!(!found.complete);
    assert!(found.ranked.iter().all(|r| r.raced == Count::default()));
    assert_eq!(found.rollouts, 5 * 8, "fresh draws only");
    let few = PlanConfig { rollouts: Some(300), ..small(1) };
    let found = plan(&task, &prior(1), &few, &Endless, &Silent).unwrap();
    assert_eq!((found.complete, found.rollouts), (false, 300 + 40));
    // Whoever was tried and failed stands behind whoever was not tried.
    let shares: Vec<f64> = found.ranked.iter().map(|r| r.raced.share()).collect();
    assert!(shares.windows(2).all(|w| w[0] >= w[1]));
}

#[test]
fn other_errors_end_the_work() {
    struct Left;
    impl Budget for Left {
        fn look(&self) -> Result<()> {
            Err(Error::Cancelled)
        }
    }
    let found = plan(&task("basketball:003"), &prior(1), &small(1), &Left, &Silent);
    assert_eq!(found, Err(Error::Cancelled));
}

/// Copies are the same worlds and moves for every action, and not moved if that is asked for.
#[test]
fn copies_are_common_to_all_actions() {
    let task = task("basketball:003");
    let belief = prior(1);
    let copies = Copies::new(&task, &belief, &small(1));
    let space = task.actions();
    let (a, b) = (space.at(7).unwrap(), space.at(20_111).unwrap());
    for k in 0..16 {
        let by = |x: &ValidAction| copies.moved(x, k).values()[0] - x.values()[0];
        assert!((by(&a) - by(&b)).abs() < 1e-12 && by(&a).abs() <= 0.002 && by(&a) != 0.0);
    }
    let still = Copies::new(&task, &belief, &PlanConfig { perturb: 0.0, draws: 100, ..small(1) });
    assert_eq!(still.moved(&a, 3), a);
    assert_eq!(still.draws(), 40, "each of the belief's 40 worlds once");
}

#[test]
fn a_planner_ranks_as_its_plan_does() {
    let task = task("basketball:003");
    let config = small(2);
    let found = plan(&task, &prior(1), &config, &Endless, &Silent).unwrap();
    let planner = Planner::new("the prior", std::slice::from_ref(&found));
    let all = candidates(&task, &config.candidates()).unwrap();
    let order = rank(&planner, &task, &all, 64).unwrap();
    for (ranked, i) in found.ranked.iter().zip(&order) {
        assert_eq!(ranked.action, all[*i]);
    }
    let other = family("bowling").unwrap().tasks().remove(0);
    assert!(matches!(rank(&planner, &other, &all[..1], 1), Err(Error::NotFound { .. })));
}

#[test]
fn what_no_plan_can_be_is_refused_by_name() {
    let odd = |change: fn(&mut PlanConfig)| {
        let mut config = small(0);
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
