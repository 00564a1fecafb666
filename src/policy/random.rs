//! Random baseline: actions in random order.

use rand::RngExt;

use super::Policy;
use crate::error::Result;
use crate::rng;
use crate::task::{Task, ValidAction};

/// Policy with random scores.
#[derive(Clone, Debug, PartialEq)]
pub struct RandomPolicy {
    /// Seed; the score is a hash of the seed, the task's id and the action.
    pub seed: u64,
}

impl Policy for RandomPolicy {
    fn score(&self, task: &Task, actions: &[ValidAction]) -> Result<Vec<f32>> {
        // A score depends on its action only, so that the ranking is independent of the chunk size.
        let score = |action: &ValidAction| {
            let bits: Vec<u8> = action.values().iter().flat_map(|v| v.to_bits().to_le_bytes()).collect();
            let seed = bits.chunks(8).fold(self.seed, |seed, c| {
                rng::derive_seed(seed, &task.id, c.iter().fold(0, |n, b| n << 8 | u64::from(*b)))
            });
            rng::stream(seed, "random policy").random::<f32>()
        };
        Ok(actions.iter().map(score).collect())
    }

    fn describe(&self) -> String {
        format!("random order, seed {}", self.seed)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::policy::{rank, toy};

    #[test]
    fn order_depends_on_seed_and_not_on_action_index() {
        let task = toy::task(0.3);
        let actions: Vec<ValidAction> = (0..200).map(|i| task.actions().at(i).unwrap()).collect();
        let order = |seed, chunk| rank(&RandomPolicy { seed }, &task, &actions, chunk).unwrap();
        assert_eq!(order(1, 7), order(1, 200));
        assert_ne!(order(1, 200), order(2, 200));
        // The mean index among the first half of the order stays near the middle.
        let mean = order(3, 50)[..100].iter().sum::<usize>() as f64 / 100.0;
        assert!((80.0..120.0).contains(&mean), "{mean}");
    }
}
