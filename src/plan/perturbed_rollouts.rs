//! Rollouts of perturbed actions in worlds sampled from a posterior.
//!
//! The k-th rollout has the same world and the same perturbation for every action (common random numbers), which reduces the variance of
//! differences between actions. Perturbed components are clamped to [0, 1], as for certificates; a perturbed action that can't be placed
//! counts as a failure.

use rayon::prelude::*;

use crate::budget::Budget;
use crate::error::Result;
use crate::estimate::{ParameterSample, ParameterSamples};
use crate::rng;
use crate::task::{Placement, Scene, Task, ValidAction};
use crate::world::{Engine, Rollout, Simulator};

use super::config::PlanConfig;

/// Number of placed scenes in memory at once, up to about 100 kB each.
const SCENES_PER_BATCH: usize = 1024;

/// Rollouts of the actions of one task.
pub struct PerturbedRollouts<'a> {
    task: &'a Task,
    /// By index of the rollout.
    worlds: Vec<&'a ParameterSample>,
    /// Maximal perturbation of a component, and the seed of perturbations.
    perturb: f64,
    seed: u64,
    engine: Engine,
}

impl<'a> PerturbedRollouts<'a> {
    /// Twice as many rollouts per action as configured; the second half is fresh. A posterior with fewer draws is repeated, with other
    /// perturbations.
    pub fn new(task: &'a Task, belief: &'a ParameterSamples, config: &PlanConfig) -> PerturbedRollouts<'a> {
        let order = belief.shuffled(config.seed);
        let count = 2 * effective_draws(belief, config);
        PerturbedRollouts {
            task,
            worlds: (0..count).map(|k| order[k % order.len()]).collect(),
            perturb: config.perturb,
            seed: config.seed,
            engine: config.engine,
        }
    }

    /// Number of rollouts for ranking an action; as many fresh ones follow.
    pub fn draws(&self) -> usize {
        self.worlds.len() / 2
    }

    /// The k-th perturbation of an action, the same for every action.
    pub fn perturbed_action(&self, action: &ValidAction, k: usize) -> ValidAction {
        let mut stream = rng::stream(rng::derive_seed(self.seed, "plan copy", k as u64), "move");
        action.perturbed(self.perturb, &mut stream)
    }

    /// Whether each (action, index of the rollout) solves the task, in order.
    pub fn solve(&self, copies: &[(&ValidAction, usize)], budget: &dyn Budget) -> Result<Vec<bool>> {
        let mut solved = Vec::with_capacity(copies.len());
        for chunk in copies.chunks(self.engine.batch_size(SCENES_PER_BATCH)) {
            solved.extend(self.solve_batch(chunk, budget)?);
        }
        Ok(solved)
    }

    fn solve_batch(&self, copies: &[(&ValidAction, usize)], budget: &dyn Budget) -> Result<Vec<bool>> {
        let place = |(action, k): &(&ValidAction, usize)| -> Result<Option<Box<Scene>>> {
            budget.check()?;
            Ok(match self.task.place(&self.perturbed_action(action, *k)) {
                Placement::Valid(scene) => Some(scene),
                Placement::Invalid(_) => None,
            })
        };
        let placed: Vec<Option<Box<Scene>>> = copies.par_iter().map(place).collect::<Result<_>>()?;
        let rollouts: Vec<Rollout> = placed
            .iter()
            .zip(copies)
            .filter_map(|(scene, (_, k))| {
                let world = self.worlds[*k];
                let (latents, effects) = (world.latents, world.effects.as_slice());
                Some(Rollout { latents, effects, ..Rollout::of(scene.as_deref()?) })
            })
            .collect();
        let solved = Simulator::new(self.engine).budget(budget).solved(&rollouts)?;
        let mut solved = solved.into_iter();
        Ok(placed.iter().map(|scene| scene.is_some() && solved.next() == Some(true)).collect())
    }
}

/// Number of distinct rollouts: without perturbation, a repeated world would repeat its result.
fn effective_draws(belief: &ParameterSamples, config: &PlanConfig) -> usize {
    match config.perturb == 0.0 {
        true => config.draws.min(belief.draws().len()),
        false => config.draws,
    }
}
