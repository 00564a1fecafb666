//! Cross-entropy method over all parameters.
//!
//! Source: Rubinstein and Kroese, The Cross-Entropy Method (2004).
//!
//! Differences from the source: mean and covariance are smoothed, and half of the first samples have nearly
//! unchanged latents.

use nalgebra::{DMatrix, DVector};
use rand_distr::{Distribution, StandardNormal};

use super::grid_scan::SearchProblem;
use crate::error::Result;
use crate::inference::model::{FitState, Parameter};
use crate::rng;

/// Samples per round and parameter, and their minimum; share of elites; rounds, and additional rounds per
/// shape parameter.
const SAMPLES: [usize; 2] = [14, 48];
const ELITES: f64 = 0.2;
const ROUNDS: [usize; 2] = [14, 2];
/// Weight of the previous mean and covariance.
const SMOOTHING: f64 = 0.2;
/// Factor on the number of samples with edges; the number of elites stays.
const EDGE_SAMPLE_FACTOR: usize = 3;
/// Factor on the standard deviation of latents in half of the first samples.
pub const LATENT_SD_FACTOR: f64 = 0.02;

impl SearchProblem<'_> {
    /// Best sampled state about `start`; `spread`: initial standard deviations.
    pub fn cross_entropy(&self, start: &FitState, spread: &[f64], seed: u64) -> Result<FitState> {
        let layout = self.layout;
        let q = layout.parameters.len();
        let shapes = (0..q).filter(|i| layout.is_shape(*i)).count();
        let edges = if layout.has_discontinuities() { EDGE_SAMPLE_FACTOR } else { 1 };
        let samples = (SAMPLES[0] * q).max(SAMPLES[1]) * edges;
        let elite = (ELITES * samples as f64).ceil() as usize / edges;
        let mut mean = DVector::from_column_slice(&start.values);
        let mut covariance = DMatrix::from_fn(q, q, |i, j| if i == j { spread[i].powi(2) } else { 0.0 });
        let mut stream = rng::stream(seed, "survey");
        let mut best = (f64::INFINITY, start.values.clone());
        for round in 0..ROUNDS[0] + ROUNDS[1] * shapes {
            let factor = root(&covariance);
            let value = |k: usize| {
                let mut draw: DVector<f64> = DVector::from_fn(q, |_, _| StandardNormal.sample(&mut stream));
                if round == 0 && k.is_multiple_of(2) {
                    // The latents may be right and only an effect missing.
                    (0..layout.latent_count()).for_each(|i| draw[i] *= LATENT_SD_FACTOR);
                }
                let value = &mean + &factor * draw;
                let within = |(v, s): (&f64, &Parameter)| v.clamp(s.bounds[0], s.bounds[1]);
                value.iter().zip(&layout.parameters).map(within).collect::<Vec<f64>>()
            };
            let mut proposed: Vec<Vec<f64>> = (0..samples).map(value).collect();
            proposed[0].clone_from(&best.1);
            let losses = self.losses(&proposed)?;
            let mut order: Vec<usize> = (0..samples).collect();
            order.sort_by(|a, b| losses[*a].total_cmp(&losses[*b]).then(a.cmp(b)));
            if losses[order[0]] < best.0 {
                best = (losses[order[0]], proposed[order[0]].clone());
            }
            let elites = order.iter().take(elite).map(|i| DVector::from_column_slice(&proposed[*i]));
            let (centre, own) = moments(&elites.collect::<Vec<_>>());
            mean = mean * SMOOTHING + centre * (1.0 - SMOOTHING);
            covariance = covariance * SMOOTHING + own * (1.0 - SMOOTHING);
        }
        Ok(FitState::new(best.1, start.nuisances.clone()))
    }
}

/// Sample mean and covariance.
fn moments(values: &[DVector<f64>]) -> (DVector<f64>, DMatrix<f64>) {
    let (q, count) = (values[0].len(), values.len() as f64);
    let centre = values.iter().fold(DVector::zeros(q), |a, e| a + e) / count;
    let mut own = DMatrix::zeros(q, q);
    for e in values {
        let off = e - &centre;
        own += &off * off.transpose() / count;
    }
    (centre, own)
}

/// Matrix square root of a covariance.
fn root(covariance: &DMatrix<f64>) -> DMatrix<f64> {
    let eigen = covariance.clone().symmetric_eigen();
    let mut root = eigen.eigenvectors;
    for (k, value) in eigen.eigenvalues.iter().enumerate() {
        root.column_mut(k).scale_mut(value.max(0.0).sqrt());
    }
    root
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::inference::model::{ParameterLayout, SegmentData};
    use crate::inference::testing::segments::{one_step_segments, term};
    use crate::world::Engine;

    /// Finds two parameters from far off; deterministic given the seed.
    #[test]
    fn two_parameters_are_found_jointly() {
        let (segments, settings) = one_step_segments(0.75);
        let data = SegmentData::new(&segments, &settings, vec![1e-3; segments.len()], Engine::Lanes);
        let layout = ParameterLayout::new(&[], vec![term("wind")], 1);
        let over = SearchProblem { data: &data, layout: &layout, segments: &[0, 3, 5] };
        let start = FitState::new(vec![-2.0, 2.0], vec![Vec::new(); segments.len()]);
        let found = |seed| over.cross_entropy(&start, &[2.0, 2.0], seed).unwrap().values;
        let one = found(1);
        assert!((one[0] - 0.75).abs() < 0.02 && one[1].abs() < 0.02, "{one:?}");
        assert_eq!(one, found(1));
        assert_ne!(one, found(2));
    }

    #[test]
    fn matrix_root_reproduces_the_covariance() {
        let covariance = DMatrix::from_row_slice(2, 2, &[4.0, 1.9, 1.9, 1.0]);
        let root = root(&covariance);
        assert!((&root * root.transpose() - covariance).amax() < 1e-12);
    }
}
