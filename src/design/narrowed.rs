//! How far latents and effects' parameters would be known after an experiment.

use nalgebra::{DMatrix, DVector};
use serde::{Deserialize, Serialize};

use super::told::Seen;
use crate::estimate::Believed;
use crate::world::latent::FACTORS;

/// How far a number is known before an experiment and, by the best straight guess from what is seen, after it.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Narrowed {
    /// `friction`, `linear_drag.c`.
    pub name: String,
    /// Standard deviations in the number's unit.
    pub before: f64,
    pub after: f64,
}

/// How far every number that worlds differ in would be known, of the worlds that were looked at: the spread about the best straight guess from what is seen.
pub fn narrowed(seen: &Seen, worlds: &[&Believed]) -> Vec<Narrowed> {
    let numbers = numbers(worlds);
    let n = worlds.len();
    let rows = seen.once().nrows() + 1;
    let design = DMatrix::from_fn(n, rows, |i, k| if k == 0 { 1.0 } else { seen.once()[(k - 1, i)] });
    let qr = design.qr().q();
    let of = |(name, values): (String, Vec<f64>)| {
        let mean = values.iter().sum::<f64>() / n as f64;
        let apart = DVector::from_iterator(n, values.iter().map(|v| v - mean));
        let before = (apart.norm_squared() / (n - 1) as f64).sqrt();
        let left = &apart - &qr * qr.tr_mul(&apart);
        // Each world guessed from the others.
        let without = |i: usize| left[i] / (1.0 - qr.row(i).norm_squared()).max(1e-6);
        let after = ((0..n).map(|i| without(i).powi(2)).sum::<f64>() / n as f64).sqrt();
        Narrowed { name, before, after: after.min(before) }
    };
    let varies = |(_, values): &(String, Vec<f64>)| values.iter().any(|v| *v != values[0]);
    numbers.into_iter().filter(varies).map(of).collect()
}

/// Numbers that every draw has: latents, and parameters of effects that all share.
fn numbers(worlds: &[&Believed]) -> Vec<(String, Vec<f64>)> {
    let effects = worlds.first().into_iter().flat_map(|w| w.named());
    let parameters = effects.flat_map(|e| e.parameters.keys().map(move |p| format!("{}.{p}", e.name)));
    let names = FACTORS.iter().map(|f| f.name.to_string()).chain(parameters);
    let of = |name: String| {
        let values: Option<Vec<f64>> = worlds.iter().map(|w| w.number(&name)).collect();
        Some((name, values?))
    };
    names.filter_map(of).collect()
}

#[cfg(test)]
mod tests {
    use super::super::shown::Shown;
    use super::super::told::Alike;
    use super::*;
    use crate::rng;
    use crate::world::Latents;
    use rand_distr::{Distribution, StandardNormal};

    /// A number seen through a slope of 2 in noise of 1 keeps 1 / sqrt(5) of its deviation; one that nothing follows keeps it; one that does not
    /// vary is not spoken of. With few worlds no less.
    #[test]
    fn numbers_are_narrowed_by_what_is_seen_of_them() {
        for count in [20, 400] {
            let mut stream = rng::stream(count as u64, "narrowed");
            let mut normal = || Distribution::<f64>::sample(&StandardNormal, &mut stream);
            let friction: Vec<f64> = (0..count).map(|_| normal()).collect();
            let worlds: Vec<Believed> = friction
                .iter()
                .map(|f| Believed { latents: Latents::of([0.1, *f, normal()]), ..Believed::default() })
                .collect();
            let mean = DMatrix::from_fn(1, count, |_, j| 2.0 * friction[j]);
            let shown = Shown { held: mean.clone(), mean, spread: vec![DMatrix::zeros(1, 3); count] };
            let alike = Alike { groups: &vec![0; count], numbers: &vec![vec![]; count] };
            let seen = Seen::new(&shown, alike, 1.0, &mut rng::stream(1, "noise"));
            let found = narrowed(&seen, &worlds.iter().collect::<Vec<_>>());
            let names: Vec<&str> = found.iter().map(|n| n.name.as_str()).collect();
            assert_eq!(names, ["friction", "restitution"]);
            let share = |i: usize| found[i].after / found[i].before;
            let within = if count == 20 { 0.2 } else { 0.05 };
            assert!((share(0) - 0.447).abs() < within && share(1) > 0.9, "{count}: {found:?}");
        }
    }
}
