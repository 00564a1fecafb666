//! Copies of actions, moved a little, in worlds drawn from a belief.
//!
//! The k-th copy is the same world and the same move for every action (common random numbers), so that two actions differ by
//! what they do and not by their luck. A copy's components are clamped to [0, 1], as where certificates are checked; one
//! that cannot be placed has failed: the hand hit what stood in the way.

use rayon::prelude::*;

use crate::budget::Budget;
use crate::error::Result;
use crate::estimate::{Belief, Believed};
use crate::rng;
use crate::task::{Placement, Scene, Task, ValidAction};
use crate::world::{Engine, Rollout, simulate_within};

use super::config::PlanConfig;

/// The copies of any action of a task.
pub struct Copies<'a> {
    task: &'a Task,
    /// By number of the copy.
    worlds: Vec<&'a Believed>,
    /// Most that a component of a copied action is moved, and what decides how.
    perturb: f64,
    seed: u64,
    engine: Engine,
}

impl<'a> Copies<'a> {
    /// Copies of a task's actions: twice as many as draws are asked for, the second half fresh ones. Where a belief has
    /// fewer draws, they come round again, in other moves.
    pub fn new(task: &'a Task, belief: &'a Belief, config: &PlanConfig) -> Copies<'a> {
        let order = belief.shuffled(config.seed);
        let count = 2 * draws(belief, config);
        Copies {
            task,
            worlds: (0..count).map(|k| order[k % order.len()]).collect(),
            perturb: config.perturb,
            seed: config.seed,
            engine: config.engine,
        }
    }

    /// How many copies a race is over; fresh ones have the numbers from there on, as many again.
    pub fn draws(&self) -> usize {
        self.worlds.len() / 2
    }

    /// The k-th copy of an action: the same move for every action.
    pub fn moved(&self, action: &ValidAction, k: usize) -> ValidAction {
        let mut stream = rng::stream(rng::derive(self.seed, "plan copy", k as u64), "move");
        action.trembled(self.perturb, &mut stream)
    }

    /// Whether each (action, number of its copy) solves the task, in their order.
    pub fn solve(&self, copies: &[(&ValidAction, usize)], budget: &dyn Budget) -> Result<Vec<bool>> {
        let place = |(action, k): &(&ValidAction, usize)| match self.task.place(&self.moved(action, *k)) {
            Placement::Valid(scene) => Some(scene),
            Placement::Invalid(_) => None,
        };
        let placed: Vec<Option<Box<Scene>>> = copies.par_iter().map(place).collect();
        let rollouts: Vec<Rollout> = placed
            .iter()
            .zip(copies)
            .filter_map(|(scene, (_, k))| {
                let world = self.worlds[*k];
                let (latents, effects) = (world.latents, world.effects.as_slice());
                Some(Rollout { latents, effects, ..Rollout::of(scene.as_deref()?) })
            })
            .collect();
        let solved = simulate_within(budget, &rollouts, self.engine, |_, t| t.solved())?;
        let mut solved = solved.into_iter();
        Ok(placed.iter().map(|scene| scene.is_some() && solved.next() == Some(true)).collect())
    }
}

/// Copies that tell something: where actions are not moved, a world tried twice says the same twice.
fn draws(belief: &Belief, config: &PlanConfig) -> usize {
    match config.perturb == 0.0 {
        true => config.draws.min(belief.draws().len()),
        false => config.draws,
    }
}
