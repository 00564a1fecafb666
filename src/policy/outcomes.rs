//! Outcomes of many actions in each task, computed once so that agents can be trained and evaluated without a simulator.
//!
//! Source: PHYRE's cache of the outcomes of 100,000 actions per task (Bakhtin et al. 2019, section 4.2; codes: 1 solved, -1 not solved,
//! 0 invalid).
//!
//! Differences from the source: computed on demand, for any physics; the actions are discrete actions of the family's space; the
//! stability of solutions under perturbations is not recorded.

use rand::seq::SliceRandom;
use rayon::prelude::*;
use serde::Serialize;

use crate::error::{Result, check_range};
use crate::rng;
use crate::task::scene::EffectTerm;
use crate::task::{ActionSpace, Placement, Scene, Task, ValidAction};
use crate::world::{Engine, Latents, Rollout, Simulator};

/// Code of an action that solves the task.
pub const SOLVED: i8 = 1;
/// Code of a valid action that does not solve the task.
pub const UNSOLVED: i8 = -1;
/// Code of an action that cannot be placed.
pub const INVALID: i8 = 0;

/// Physics of the rollouts.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct OutcomesConfig {
    /// Latents; unset values are those of the scene.
    pub latents: Latents,
    /// Effects added to those of the scene.
    pub effects: Vec<EffectTerm>,
    pub engine: Engine,
}

/// Actions simulated between two progress reports.
const PROGRESS_CHUNK: usize = 4096;

/// Sorted indices of `count` discrete actions of a space: all of them if there are no more, otherwise a random subset.
pub fn select_action_indices(space: &ActionSpace, count: usize, seed: u64) -> Result<Vec<usize>> {
    check_range("actions", count as f64, 1.0, 1e6)?;
    let mut all: Vec<usize> = (0..space.count()).collect();
    if count >= all.len() {
        return Ok(all);
    }
    let (subset, _) = all.partial_shuffle(&mut rng::stream(seed, "outcomes actions"), count);
    let mut subset = subset.to_vec();
    subset.sort_unstable();
    Ok(subset)
}

/// Outcome codes of the actions in a task, in order. `look` receives the number of finished actions and can cancel with an error. The
/// result does not depend on the number of threads.
pub fn outcomes(
    task: &Task,
    actions: &[ValidAction],
    config: &OutcomesConfig,
    look: &mut dyn FnMut(usize) -> Result<()>,
) -> Result<Vec<i8>> {
    let mut found = Vec::with_capacity(actions.len());
    for chunk in actions.chunks(config.engine.batch_size(PROGRESS_CHUNK)) {
        look(found.len())?;
        let placed: Vec<Option<Box<Scene>>> = chunk.par_iter().map(|a| valid(task, a)).collect();
        let rollouts: Vec<Rollout> = placed
            .iter()
            .flatten()
            .map(|scene| Rollout { latents: config.latents, effects: &config.effects, ..Rollout::of(scene) })
            .collect();
        let mut solved = Simulator::new(config.engine).solved(&rollouts)?.into_iter();
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
    fn outcomes_match_single_rollouts() {
        let task = &family("basketball").unwrap().tasks()[0];
        let numbers = select_action_indices(task.actions(), 300, 7).unwrap();
        assert!(
            numbers.len() == 300
                && numbers.is_sorted()
                && numbers != select_action_indices(task.actions(), 300, 8).unwrap()
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
                    let solved = Simulator::new(Engine::Auto).solved(&[rollout]).unwrap()[0];
                    if solved { SOLVED } else { UNSOLVED }
                }
            };
            assert_eq!(outcome, wanted);
        }
    }

    #[test]
    fn small_spaces_return_all_actions() {
        let task = &family("bowling").unwrap().tasks()[0];
        assert_eq!(
            select_action_indices(task.actions(), 1_000_000, 0).unwrap().len(),
            task.actions().count()
        );
        assert!(select_action_indices(task.actions(), 0, 0).unwrap_err().to_string().contains("actions"));
    }
}
