//! What each of many actions does in each task: so that agents learn, and are judged, without a simulator.
//!
//! Source: PHYRE's cache of the outcomes of 100,000 actions a task (Bakhtin et al. 2019, section 4.2; its codes: 1 solved, -1 not, 0
//! invalid).
//!
//! Differences from the source: made on the spot, for any physics; the actions are discrete ones of the family's space; whether a
//! solution survives small changes is not told.

use rand::seq::SliceRandom;
use rayon::prelude::*;
use serde::Serialize;

use crate::error::{Result, within};
use crate::rng;
use crate::task::scene::EffectTerm;
use crate::task::{ActionSpace, Placement, Scene, Task, ValidAction};
use crate::world::{Engine, Latents, Rollout, simulate_map};

/// The action solves the task.
pub const SOLVED: i8 = 1;
/// It does not.
pub const UNSOLVED: i8 = -1;
/// It cannot be placed.
pub const INVALID: i8 = 0;

/// The physics that outcomes are of.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct OutcomesConfig {
    /// The scene's own where not given.
    pub latents: Latents,
    /// Beyond a scene's own.
    pub effects: Vec<EffectTerm>,
    pub engine: Engine,
}

/// Actions simulated between two looks at whether to go on.
const CHUNK: usize = 4096;

/// `count` discrete actions of a space by number, rising: all if there are no more, else a random subset that `seed` decides.
pub fn chosen(space: &ActionSpace, count: usize, seed: u64) -> Result<Vec<usize>> {
    within("actions", count as f64, 1.0, 1e6)?;
    let mut all: Vec<usize> = (0..space.count()).collect();
    if count >= all.len() {
        return Ok(all);
    }
    let (subset, _) = all.partial_shuffle(&mut rng::stream(seed, "outcomes actions"), count);
    let mut subset = subset.to_vec();
    subset.sort_unstable();
    Ok(subset)
}

/// The outcome of each action in a task, in order; `look` is told how many are done and may end the work by an error. The result
/// does not depend on the number of threads.
pub fn outcomes(
    task: &Task,
    actions: &[ValidAction],
    config: &OutcomesConfig,
    look: &mut dyn FnMut(usize) -> Result<()>,
) -> Result<Vec<i8>> {
    let mut found = Vec::with_capacity(actions.len());
    for chunk in actions.chunks(CHUNK) {
        look(found.len())?;
        let placed: Vec<Option<Box<Scene>>> = chunk.par_iter().map(|a| valid(task, a)).collect();
        let rollouts: Vec<Rollout> = placed
            .iter()
            .flatten()
            .map(|scene| Rollout { latents: config.latents, effects: &config.effects, ..Rollout::of(scene) })
            .collect();
        let mut solved = simulate_map(&rollouts, config.engine, |_, t| t.solved())?.into_iter();
        found.extend(placed.iter().map(|scene| match scene {
            None => INVALID,
            Some(_) if solved.next() == Some(true) => SOLVED,
            Some(_) => UNSOLVED,
        }));
    }
    look(found.len())?;
    Ok(found)
}

fn valid(task: &Task, action: &ValidAction) -> Option<Box<Scene>> {
    match task.place(action) {
        Placement::Valid(scene) => Some(scene),
        Placement::Invalid(_) => None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::task::family;

    #[test]
    fn outcomes_are_what_single_rollouts_say() {
        let task = &family("basketball").unwrap().tasks()[0];
        let numbers = chosen(task.actions(), 300, 7).unwrap();
        assert!(
            numbers.len() == 300 && numbers.is_sorted() && numbers != chosen(task.actions(), 300, 8).unwrap()
        );
        let actions: Vec<ValidAction> = numbers.iter().map(|i| task.actions().at(*i).unwrap()).collect();
        let config =
            OutcomesConfig { latents: Latents::default(), effects: Vec::new(), engine: Engine::Auto };
        let mut looks = 0;
        let found = outcomes(task, &actions, &config, &mut |_| {
            looks += 1;
            Ok(())
        });
        let found = found.unwrap();
        assert!(looks == 2 && found.contains(&SOLVED) && found.contains(&UNSOLVED));
        for (action, outcome) in actions.iter().zip(found) {
            let wanted = match task.place(action) {
                Placement::Invalid(_) => INVALID,
                Placement::Valid(scene) => {
                    let rollout = Rollout::of(&scene);
                    let solved = simulate_map(&[rollout], Engine::Auto, |_, t| t.solved()).unwrap()[0];
                    if solved { SOLVED } else { UNSOLVED }
                }
            };
            assert_eq!(outcome, wanted);
        }
    }

    #[test]
    fn a_space_with_fewer_actions_gives_all_of_them() {
        let task = &family("bowling").unwrap().tasks()[0];
        assert_eq!(chosen(task.actions(), 1_000_000, 0).unwrap().len(), task.actions().count());
        assert!(chosen(task.actions(), 0, 0).unwrap_err().to_string().contains("actions"));
    }
}
