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

/// How far every number that draws differ in would be known: the spread about the best straight guess from what is seen.
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
        let guessed = &qr * qr.tr_mul(&apart);
        let degrees = n.saturating_sub(rows).max(1) as f64;
        let after = ((apart - guessed).norm_squared() / degrees).sqrt();
        Narrowed { name, before, after: after.min(before) }
    };
    numbers.into_iter().map(of).filter(|n| n.before > 0.0).collect()
}

/// Numbers that every draw has: latents, and parameters of effects that all share.
fn numbers(worlds: &[&Believed]) -> Vec<(String, Vec<f64>)> {
    let mut all = Vec::new();
    for (k, factor) in FACTORS.iter().enumerate() {
        let values: Option<Vec<f64>> = worlds.iter().map(|w| w.latents.values()[k]).collect();
        all.extend(values.map(|v| (factor.name.to_string(), v)));
    }
    let parameters = worlds.first().into_iter().flat_map(|w| &w.effects);
    for (effect, parameter) in
        parameters.flat_map(|e| e.parameters.keys().map(|p| (e.name.clone(), p.clone())))
    {
        let of = |w: &&Believed| {
            let own = w.effects.iter().find(|e| e.name == effect)?;
            own.parameters.get(&parameter).copied()
        };
        let values: Option<Vec<f64>> = worlds.iter().map(of).collect();
        all.extend(values.map(|v| (format!("{effect}.{parameter}"), v)));
    }
    all
}
