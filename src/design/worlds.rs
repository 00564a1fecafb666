//! The draws that stand for a belief.

use super::told::Alike;
use crate::estimate::{Belief, Believed};
use crate::task::scene::EffectTerm;

/// Worlds of a belief, and the set of effects that each has.
pub struct Worlds<'a> {
    pub worlds: Vec<&'a Believed>,
    /// By world, the number of its set.
    pub groups: Vec<usize>,
    /// By world, its latents and effects' parameters; as many in every world of a set.
    pub numbers: Vec<Vec<f64>>,
    /// By set, how likely it is.
    pub weights: Vec<f64>,
    /// By set, the names of its effects.
    pub sets: Vec<Vec<String>>,
}

/// About `count` worlds in a seed's order: as many of every set of effects where `evenly`, else as they come.
pub fn worlds(belief: &Belief, count: usize, evenly: bool, seed: u64) -> Worlds<'_> {
    let order = belief.shuffled(seed);
    let sets = sets(belief);
    let of = |b: &Believed| {
        let own = names(b);
        sets.iter().position(|s| *s == own).unwrap_or_default()
    };
    let numbers: Vec<usize> = order.iter().map(|b| of(b)).collect();
    let each = if evenly { count.div_ceil(sets.len().max(1)) } else { count };
    let mut taken = vec![0; sets.len()];
    let mut found = Worlds {
        worlds: Vec::new(),
        groups: Vec::new(),
        numbers: Vec::new(),
        weights: (0..sets.len())
            .map(|s| numbers.iter().filter(|n| **n == s).count() as f64 / numbers.len() as f64)
            .collect(),
        sets: sets.clone(),
    };
    for (world, set) in order.iter().zip(&numbers) {
        if taken[*set] < each && (evenly || found.worlds.len() < count) {
            taken[*set] += 1;
            found.worlds.push(world);
            found.groups.push(*set);
            found.numbers.push(numbers_of(world));
        }
    }
    found
}

impl Worlds<'_> {
    /// What told worlds are alike in.
    pub fn alike(&self) -> Alike<'_> {
        Alike { groups: &self.groups, numbers: &self.numbers }
    }
}

/// Latents, and parameters in the order of effects' and their names; what a world leaves to the scene is 0 in it.
fn numbers_of(world: &Believed) -> Vec<f64> {
    let mut effects: Vec<&EffectTerm> = world.effects.iter().collect();
    effects.sort_by(|a, b| a.name.cmp(&b.name));
    let latents = world.latents.values().map(|v| v.unwrap_or(0.0));
    latents.into_iter().chain(effects.iter().flat_map(|e| e.parameters.values().copied())).collect()
}

/// The sets of effects of a belief's draws, in the order of their names.
pub fn sets(belief: &Belief) -> Vec<Vec<String>> {
    let mut all: Vec<Vec<String>> = belief.draws().iter().map(names).collect();
    all.sort();
    all.dedup();
    all
}

fn names(world: &Believed) -> Vec<String> {
    let mut own: Vec<String> = world.effects.iter().map(|e| e.name.clone()).collect();
    own.sort();
    own
}

#[cfg(test)]
mod tests {
    use super::*;

    /// 30 draws with a drag, 10 without.
    fn belief() -> Belief {
        let c: Vec<Option<f64>> =
            (0..40).map(|i| (i % 4 != 0).then_some(0.1 + 0.01 * f64::from(i))).collect();
        let columns = serde_json::json!({"friction": vec![0.5; 40], "linear_drag.c": c});
        Belief::from_value(serde_json::json!({"format": "iplw.posterior/1", "columns": columns})).unwrap()
    }

    #[test]
    fn sets_are_as_likely_as_their_draws_and_evenly_taken() {
        let belief = belief();
        let found = worlds(&belief, 16, true, 1);
        assert_eq!(found.sets, [vec![], vec!["linear_drag".to_string()]]);
        assert_eq!((found.weights.clone(), found.worlds.len()), (vec![0.25, 0.75], 16));
        assert_eq!(found.groups.iter().filter(|g| **g == 0).count(), 8);
        let few = worlds(&belief, 30, true, 1);
        assert_eq!(few.groups.iter().filter(|g| **g == 0).count(), 10, "no more than there are");
        assert_eq!(worlds(&belief, 12, false, 1).worlds.len(), 12);
        assert!(found.worlds.iter().zip(&found.groups).all(|(w, g)| w.effects.len() == *g));
    }
}
