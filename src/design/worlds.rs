//! Worlds sampled from the posterior.

use std::collections::BTreeMap;

use super::likelihood::Grouping;
use crate::error::{Error, Result};
use crate::estimate::{ParameterSample, ParameterSamples};
use crate::task::scene::EffectTerm;
use crate::world::effect::{ParameterDeclaration, find};

/// Sampled worlds, and the set of effects of each.
pub struct SampledWorlds<'a> {
    pub worlds: Vec<&'a ParameterSample>,
    /// By world, the index of its set.
    pub groups: Vec<usize>,
    /// By world, its latents and effect parameters; the same number in every world of a set.
    pub numbers: Vec<Vec<f64>>,
    /// By set, its probability.
    pub weights: Vec<f64>,
    /// By set, the names of its effects.
    pub sets: Vec<Vec<String>>,
}

/// Maximal number of sets of effects.
const MAX_SETS: usize = 20;

/// About `count` worlds in an order given by the seed. With `evenly`, the same number of every set, at least that many. An error for
/// more than [`MAX_SETS`] sets.
pub fn sample_worlds(
    belief: &ParameterSamples,
    count: usize,
    evenly: Option<usize>,
    seed: u64,
) -> Result<SampledWorlds<'_>> {
    let order = belief.shuffled(seed);
    let mut sets: BTreeMap<Vec<String>, usize> = BTreeMap::new();
    let mut owns = Vec::with_capacity(order.len());
    for world in &order {
        let own = effect_names(world);
        *sets.entry(own.clone()).or_insert(0) += 1;
        if sets.len() > MAX_SETS {
            let allowed = format!("draws of at most {MAX_SETS} sets of effects");
            return Err(Error::input("posterior", format!("{} sets or more", sets.len()), allowed));
        }
        owns.push(own);
    }
    let number: BTreeMap<&Vec<String>, usize> = sets.keys().enumerate().map(|(i, s)| (s, i)).collect();
    let each = evenly.map_or(count, |least| count.div_ceil(sets.len()).max(least));
    let mut taken = vec![0; sets.len()];
    let mut found = SampledWorlds {
        worlds: Vec::new(),
        groups: Vec::new(),
        numbers: Vec::new(),
        weights: sets.values().map(|n| *n as f64 / order.len() as f64).collect(),
        sets: sets.keys().cloned().collect(),
    };
    for (world, own) in order.iter().zip(&owns) {
        let set = number[own];
        if taken[set] < each && (evenly.is_some() || found.worlds.len() < count) {
            taken[set] += 1;
            found.worlds.push(world);
            found.groups.push(set);
            found.numbers.push(parameter_vector(world)?);
        }
    }
    Ok(found)
}

impl SampledWorlds<'_> {
    /// Groups by set of effects.
    pub fn grouping(&self) -> Grouping<'_> {
        Grouping { groups: &self.groups, numbers: &self.numbers }
    }
}

/// Latents and effect parameters, in the order of effect names and of their declarations. Latents left to the scene are 0; missing
/// parameters are at their neutral values.
fn parameter_vector(world: &ParameterSample) -> Result<Vec<f64>> {
    let mut effects: Vec<&EffectTerm> = world.named_effects().iter().collect();
    effects.sort_by(|a, b| a.name.cmp(&b.name));
    let mut numbers: Vec<f64> = world.latents.values().map(|v| v.unwrap_or(0.0)).to_vec();
    for term in effects {
        let own = |p: &ParameterDeclaration| term.parameters.get(p.name).copied().unwrap_or(p.neutral);
        numbers.extend(find(&term.name)?.parameters.iter().map(own));
    }
    Ok(numbers)
}

fn effect_names(world: &ParameterSample) -> Vec<String> {
    let mut own: Vec<String> = world.named_effects().iter().map(|e| e.name.clone()).collect();
    own.sort();
    own
}

#[cfg(test)]
mod tests {
    use super::*;

    /// 30 draws with drag, 10 without.
    fn samples_with_drag() -> ParameterSamples {
        let c: Vec<Option<f64>> =
            (0..40).map(|i| (i % 4 != 0).then_some(0.1 + 0.01 * f64::from(i))).collect();
        let columns = serde_json::json!({"friction": vec![0.5; 40], "linear_drag.c": c});
        ParameterSamples::from_value(serde_json::json!({"format": "iplw.posterior/2", "columns": columns}))
            .unwrap()
    }

    #[test]
    fn samples_sets_evenly_and_weights_them_by_draws() {
        let belief = samples_with_drag();
        let found = sample_worlds(&belief, 16, Some(1), 1).unwrap();
        assert_eq!(found.sets, [vec![], vec!["linear_drag".to_string()]]);
        assert_eq!((found.weights.clone(), found.worlds.len()), (vec![0.25, 0.75], 16));
        assert_eq!(found.groups.iter().filter(|g| **g == 0).count(), 8);
        let few = sample_worlds(&belief, 30, Some(1), 1).unwrap();
        assert_eq!(few.groups.iter().filter(|g| **g == 0).count(), 10, "no more than there are");
        assert_eq!(sample_worlds(&belief, 12, None, 1).unwrap().worlds.len(), 12);
        assert!(found.worlds.iter().zip(&found.groups).all(|(w, g)| w.effects.len() == *g));
    }

    /// Draws without a parameter of their set have its neutral value; too many sets are rejected.
    #[test]
    fn parameters_match_within_a_set_and_sets_are_limited() {
        let read = |columns: serde_json::Value| {
            let effects = serde_json::json!([{"name": "gust", "parameters": {"period": 2.0}}]);
            let whole =
                serde_json::json!({"format": "iplw.posterior/2", "columns": columns, "effects": effects});
            ParameterSamples::from_value(whole).unwrap()
        };
        let belief = read(serde_json::json!({"gust.ax": [1.5, null, 0.5, null]}));
        let found = sample_worlds(&belief, 4, None, 1).unwrap();
        assert_eq!(found.sets.len(), 1);
        assert!(found.numbers.windows(2).all(|w| w[0].len() == w[1].len()), "{:?}", found.numbers);
        let bit = |k: u32| (0..32).map(|i| (i >> k & 1 == 1).then_some(0.1)).collect::<Vec<Option<f64>>>();
        let names = ["wind.ax", "lift.s", "linear_drag.c", "quadratic_drag.k", "rolling_resistance.crr"];
        let effects = crate::world::effect::REGISTRY;
        let known = |name: &&str| {
            let (effect, parameter) = name.split_once('.').unwrap();
            effects.iter().any(|e| e.name == effect && e.parameters.iter().any(|p| p.name == parameter))
        };
        assert!(names.iter().all(known), "{names:?}");
        let columns: std::collections::BTreeMap<&str, _> =
            names.iter().enumerate().map(|(k, n)| (*n, bit(k as u32))).collect();
        let many = read(serde_json::json!(columns));
        let error = sample_worlds(&many, 8, Some(1), 1).err().unwrap().to_string();
        assert!(error.contains("posterior") && error.contains("20 sets"), "{error}");
    }
}
