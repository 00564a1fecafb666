//! Expected standard deviations of latents and effect parameters after an experiment.

use nalgebra::{DMatrix, DVector};
use serde::{Deserialize, Serialize};

use super::likelihood::ComponentScores;
use crate::estimate::ParameterSample;
use crate::world::latent::FACTORS;

/// Standard deviation of a parameter before an experiment and, by the best linear prediction from the observations, after it.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ExpectedSd {
    /// `friction`, `linear_drag.c`.
    pub name: String,
    /// Standard deviations in the parameter's unit.
    pub before: f64,
    pub after: f64,
}

/// Expected standard deviation of every parameter that varies over the worlds: the leave-one-out error of the best linear prediction
/// from the observations.
pub fn expected_sds(scores: &ComponentScores, worlds: &[&ParameterSample]) -> Vec<ExpectedSd> {
    let numbers = shared_parameters(worlds);
    let n = worlds.len();
    let rows = scores.observations().nrows() + 1;
    let design =
        DMatrix::from_fn(n, rows, |i, k| if k == 0 { 1.0 } else { scores.observations()[(k - 1, i)] });
    let qr = design.qr().q();
    let of = |(name, values): (String, Vec<f64>)| {
        let mean = values.iter().sum::<f64>() / n as f64;
        let deviations = DVector::from_iterator(n, values.iter().map(|v| v - mean));
        let before = (deviations.norm_squared() / (n - 1) as f64).sqrt();
        let residuals = &deviations - &qr * qr.tr_mul(&deviations);
        // Leave-one-out residual from the hat matrix.
        let without = |i: usize| residuals[i] / (1.0 - qr.row(i).norm_squared()).max(1e-6);
        let after = ((0..n).map(|i| without(i).powi(2)).sum::<f64>() / n as f64).sqrt();
        ExpectedSd { name, before, after: after.min(before) }
    };
    let varies = |(_, values): &(String, Vec<f64>)| values.iter().any(|v| *v != values[0]);
    numbers.into_iter().filter(varies).map(of).collect()
}

/// Parameters that every draw has: latents, and parameters of effects in all draws.
fn shared_parameters(worlds: &[&ParameterSample]) -> Vec<(String, Vec<f64>)> {
    let effects = worlds.first().into_iter().flat_map(|w| w.named_effects());
    let parameters = effects.flat_map(|e| e.parameters.keys().map(move |p| format!("{}.{p}", e.name)));
    let names = FACTORS.iter().map(|f| f.name.to_string()).chain(parameters);
    let of = |name: String| {
        let values: Option<Vec<f64>> = worlds.iter().map(|w| w.value(&name)).collect();
        Some((name, values?))
    };
    names.filter_map(of).collect()
}

#[cfg(test)]
mod tests {
    use super::super::likelihood::Grouping;
    use super::super::predicted_observations::PredictedObservations;
    use super::*;
    use crate::rng;
    use crate::world::Latents;
    use rand_distr::{Distribution, StandardNormal};

    /// A parameter of unit variance observed with a slope of 2 in noise of 1 keeps 1 / sqrt(5) of its standard deviation; an unobserved
    /// one keeps all of it; a constant one is left out. The same holds with few worlds.
    #[test]
    fn matches_the_linear_gaussian_posterior() {
        for count in [20, 400] {
            let mut stream = rng::stream(count as u64, "narrowed");
            let mut normal = || Distribution::<f64>::sample(&StandardNormal, &mut stream);
            let friction: Vec<f64> = (0..count).map(|_| normal()).collect();
            let worlds: Vec<ParameterSample> = friction
                .iter()
                .map(|f| ParameterSample {
                    latents: Latents::of([0.1, *f, normal()]),
                    ..ParameterSample::default()
                })
                .collect();
            let mean = DMatrix::from_fn(1, count, |_, j| 2.0 * friction[j]);
            let predicted =
                PredictedObservations { held: mean.clone(), mean, spread: vec![DMatrix::zeros(1, 3); count] };
            let grouping = Grouping { groups: &vec![0; count], numbers: &vec![vec![]; count] };
            let scores = ComponentScores::new(&predicted, grouping, 1.0, &mut rng::stream(1, "noise"));
            let found = expected_sds(&scores, &worlds.iter().collect::<Vec<_>>());
            let names: Vec<&str> = found.iter().map(|n| n.name.as_str()).collect();
            assert_eq!(names, ["friction", "restitution"]);
            let share = |i: usize| found[i].after / found[i].before;
            let within = if count == 20 { 0.2 } else { 0.05 };
            assert!((share(0) - 0.447).abs() < within && share(1) > 0.9, "{count}: {found:?}");
        }
    }
}
