//! How much has been learned: the information gained from one belief to the next.
//!
//! Source: Lindley 1956: the entropy that is gone. Entropies are those of normal distributions with the draws' covariances
//! (Chaloner and Verdinelli 1995, section 2: Bayesian D-optimality), so what is gained is
//! `(ln det C_before - ln det C_after) / 2` nats over the numbers that are asked about.
//!
//! Differences from the source: draws that are no normal distribution have less entropy than that, before as after.

use nalgebra::DMatrix;

use super::grounding::moments;
use crate::estimate::Believed;

/// Nats gained about the named numbers (`friction`, `linear_drag.c`); `None` where there is nothing to say: no number, a point, or draws
/// that lack one of them.
pub fn gained(before: &[Believed], after: &[Believed], names: &[String]) -> Option<f64> {
    if names.is_empty() {
        return None;
    }
    let deviation = |name: &String| Some(moments(&column(before, name)?).1).filter(|sd| *sd > 0.0);
    let scale: Vec<f64> = names.iter().map(deviation).collect::<Option<_>>()?;
    let before = entropy(before, names, &scale)?;
    Some(before - entropy(after, names, &scale)?)
}

/// Of a normal distribution with the draws' covariance, in units of `scale`, up to what all have in common.
fn entropy(draws: &[Believed], names: &[String], scale: &[f64]) -> Option<f64> {
    let n = draws.len();
    if n <= names.len() {
        return None;
    }
    let columns: Vec<Vec<f64>> = names.iter().map(|name| column(draws, name)).collect::<Option<_>>()?;
    let mut data = DMatrix::from_fn(n, names.len(), |row, c| columns[c][row] / scale[c]);
    for mut own in data.column_iter_mut() {
        let mean = own.mean();
        own.add_scalar_mut(-mean);
    }
    let covariance = data.transpose() * &data / (n - 1) as f64;
    let roots = covariance.cholesky()?.l().diagonal();
    Some(roots.iter().map(|root| libm::log(*root)).sum())
}

fn column(draws: &[Believed], name: &str) -> Option<Vec<f64>> {
    draws.iter().map(|draw| draw.number(name)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::world::Latents;

    /// Draws of friction and restitution with these deviations, and a share of the second that follows the first.
    fn draws(sd: [f64; 2], share: f64) -> Vec<Believed> {
        let wave = |i: usize, k: f64| libm::sin(k * i as f64) * std::f64::consts::SQRT_2;
        (0..20_000)
            .map(|i| {
                let (a, b) = (wave(i, 1.0), wave(i, 2.7));
                let second = share * a + (1.0 - share * share).sqrt() * b;
                let latents = Latents::of([1.0, 0.5 + sd[0] * a, 0.5 + sd[1] * second]);
                Believed::new(latents, Vec::new())
            })
            .collect()
    }

    #[test]
    fn a_tenth_of_the_spread_is_known_by_hand() {
        let names = ["friction".to_string(), "restitution".to_string()];
        let prior = draws([0.2, 0.1], 0.0);
        let near = |found: Option<f64>, wanted: f64| {
            assert!((found.unwrap() - wanted).abs() < 2e-3, "{found:?} {wanted}");
        };
        near(gained(&prior, &prior, &names), 0.0);
        near(gained(&prior, &draws([0.02, 0.1], 0.0), &names), libm::log(10.0));
        // What goes together is known better than each by itself.
        near(gained(&prior, &draws([0.02, 0.01], 0.8), &names), 2.0 * libm::log(10.0) - libm::log(0.6));
        assert!(gained(&prior, &draws([0.2, 0.1], 0.0)[..1], &names).is_none(), "a point");
        assert!(gained(&prior, &prior, &["linear_drag.c".into()]).is_none(), "what no draw has");
        assert!(gained(&prior, &prior, &[]).is_none(), "nothing asked about");
        assert!(gained(&draws([0.0, 0.1], 0.0), &prior, &names).is_none(), "what was known for sure");
    }
}
