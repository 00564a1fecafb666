//! Information gain between two sets of parameter samples.
//!
//! Source: Lindley 1956 (decrease of entropy). Entropies are those of normal distributions with the draws' covariances
//! (Chaloner and Verdinelli 1995, section 2: Bayesian D-optimality), so the gain is
//! `(ln det C_before - ln det C_after) / 2` nats over the selected parameters.
//!
//! Range of validity: the normal entropy is an upper bound for non-normal draws, both before and after.

use nalgebra::DMatrix;

use super::grounding::mean_and_sd;
use crate::estimate::ParameterSample;

/// Information gain about the named parameters (`friction`, `linear_drag.c`), nats. `None` without names, for a point estimate, or if
/// the draws lack one of the parameters.
pub fn information_gain(
    before: &[ParameterSample],
    after: &[ParameterSample],
    names: &[String],
) -> Option<f64> {
    if names.is_empty() {
        return None;
    }
    let deviation =
        |name: &String| Some(mean_and_sd(&parameter_values(before, name)?).1).filter(|sd| *sd > 0.0);
    let scale: Vec<f64> = names.iter().map(deviation).collect::<Option<_>>()?;
    let before = entropy(before, names, &scale)?;
    Some(before - entropy(after, names, &scale)?)
}

/// Entropy of a normal distribution with the draws' covariance, in units of `scale`, up to an additive constant.
fn entropy(draws: &[ParameterSample], names: &[String], scale: &[f64]) -> Option<f64> {
    let n = draws.len();
    if n <= names.len() {
        return None;
    }
    let columns: Vec<Vec<f64>> =
        names.iter().map(|name| parameter_values(draws, name)).collect::<Option<_>>()?;
    let mut data = DMatrix::from_fn(n, names.len(), |row, c| columns[c][row] / scale[c]);
    for mut own in data.column_iter_mut() {
        let mean = own.mean();
        own.add_scalar_mut(-mean);
    }
    let covariance = data.transpose() * &data / (n - 1) as f64;
    let roots = covariance.cholesky()?.l().diagonal();
    Some(roots.iter().map(|root| libm::log(*root)).sum())
}

fn parameter_values(draws: &[ParameterSample], name: &str) -> Option<Vec<f64>> {
    draws.iter().map(|draw| draw.value(name)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::world::Latents;

    /// Draws of friction and restitution with these standard deviations and this correlation.
    fn draws(sd: [f64; 2], share: f64) -> Vec<ParameterSample> {
        let wave = |i: usize, k: f64| libm::sin(k * i as f64) * std::f64::consts::SQRT_2;
        (0..20_000)
            .map(|i| {
                let (a, b) = (wave(i, 1.0), wave(i, 2.7));
                let second = share * a + (1.0 - share * share).sqrt() * b;
                let latents = Latents::of([1.0, 0.5 + sd[0] * a, 0.5 + sd[1] * second]);
                ParameterSample::new(latents, Vec::new())
            })
            .collect()
    }

    #[test]
    fn matches_analytic_gain() {
        let names = ["friction".to_string(), "restitution".to_string()];
        let prior = draws([0.2, 0.1], 0.0);
        let near = |found: Option<f64>, wanted: f64| {
            assert!((found.unwrap() - wanted).abs() < 2e-3, "{found:?} {wanted}");
        };
        near(information_gain(&prior, &prior, &names), 0.0);
        near(information_gain(&prior, &draws([0.02, 0.1], 0.0), &names), libm::log(10.0));
        // Correlation adds to the information gain.
        near(
            information_gain(&prior, &draws([0.02, 0.01], 0.8), &names),
            2.0 * libm::log(10.0) - libm::log(0.6),
        );
        assert!(information_gain(&prior, &draws([0.2, 0.1], 0.0)[..1], &names).is_none(), "a point");
        assert!(
            information_gain(&prior, &prior, &["linear_drag.c".into()]).is_none(),
            "a parameter that no draw has"
        );
        assert!(information_gain(&prior, &prior, &[]).is_none(), "no parameter");
        assert!(information_gain(&draws([0.0, 0.1], 0.0), &prior, &names).is_none(), "no variance before");
    }
}
