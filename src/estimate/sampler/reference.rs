//! Reference density: a mixture of a Student t near a fit, the prior, and the same t with one parameter from
//! its prior.
//!
//! The prior component covers everything that the prior allows. The single-parameter components cover long
//! ridges along one parameter (a floor rough enough to stick is as good as a rougher one), which a draw of all
//! parameters from the prior would hardly ever match. Once likely points are known, most of the mixture is near
//! them.

use nalgebra::{DMatrix, DVector};
use rand::RngExt;
use rand_distr::{Distribution, StandardNormal};

use super::prior::JointPrior;
use super::weighted_moments;
use crate::rng::Stream;
use crate::world::ParameterVector;

/// A multivariate Student t distribution.
#[derive(Clone, Debug)]
pub struct StudentT {
    centre: DVector<f64>,
    /// Lower Cholesky factor of the scale matrix.
    root: DMatrix<f64>,
    log_scale: f64,
}

/// A mixture of wide Student t distributions around fits, the same with one parameter from the prior, and the
/// prior.
#[derive(Clone, Debug)]
pub struct ReferenceDensity {
    fits: Vec<FitComponent>,
    prior: JointPrior,
}

/// Mixture component around one fit.
#[derive(Clone, Debug)]
struct FitComponent {
    /// Weight among all fits.
    share: f64,
    near: StudentT,
    /// For each parameter the density of the others near the fit; empty for a single parameter.
    others: Vec<StudentT>,
}

/// Degrees of freedom: heavier tails than any relevant posterior.
const T_DEGREES_OF_FREEDOM: f64 = 5.0;
/// Weight of the prior, and of the components with one parameter from its prior.
const PRIOR_SHARE: f64 = 0.1;
const ONE_FREE_SHARE: f64 = 0.2;
/// Weight of the original fit once likely points are known: they may cover only one mode of several.
const ORIGINAL_FIT_SHARE: f64 = 0.2;
/// Minimum scale along a direction as a share of the prior's standard deviation.
const MIN_RELATIVE_SCALE: f64 = 1e-9;

impl StudentT {
    /// A distribution with a centre and scale matrix; singular directions get a tiny scale. `unit`: prior
    /// standard deviation of each parameter.
    pub fn new(centre: DVector<f64>, scale: &DMatrix<f64>, unit: &[f64]) -> StudentT {
        let d = centre.len();
        let mut scale_matrix = 0.5 * (scale + scale.transpose());
        for (i, unit) in unit.iter().enumerate() {
            scale_matrix[(i, i)] += (MIN_RELATIVE_SCALE * unit).powi(2);
        }
        let diagonal =
            || DMatrix::from_diagonal(&scale_matrix.diagonal().map(|v| v.max(f64::MIN_POSITIVE).sqrt()));
        let root = scale_matrix.clone().cholesky().map_or_else(diagonal, |c| c.l());
        let log_scale = root.diagonal().iter().map(|v| libm::log(*v)).sum::<f64>();
        let pi = std::f64::consts::PI;
        let half = 0.5 * (T_DEGREES_OF_FREEDOM + d as f64);
        let constant = libm::lgamma(half)
            - libm::lgamma(0.5 * T_DEGREES_OF_FREEDOM)
            - 0.5 * d as f64 * libm::log(T_DEGREES_OF_FREEDOM * pi);
        StudentT { centre, root, log_scale: constant - log_scale }
    }

    /// Lower Cholesky factor of the scale matrix.
    pub fn cholesky_factor(&self) -> &DMatrix<f64> {
        &self.root
    }

    pub fn draw(&self, stream: &mut Stream) -> ParameterVector {
        let z = DVector::from_fn(self.centre.len(), |_, _| StandardNormal.sample(stream));
        // Chi squared with five degrees of freedom, as a sum of squares.
        let squares: f64 = (0..T_DEGREES_OF_FREEDOM as usize)
            .map(|_| {
                let z: f64 = StandardNormal.sample(stream);
                z * z
            })
            .sum();
        let x = &self.centre + &self.root * z * (T_DEGREES_OF_FREEDOM / squares).sqrt();
        x.as_slice().to_vec()
    }

    pub fn log_density(&self, point: &[f64]) -> f64 {
        let off = DVector::from_fn(self.centre.len(), |i, _| point[i] - self.centre[i]);
        let Some(white) = self.root.solve_lower_triangular(&off) else { return f64::NEG_INFINITY };
        let half = 0.5 * (T_DEGREES_OF_FREEDOM + self.centre.len() as f64);
        self.log_scale - half * libm::log1p(white.norm_squared() / T_DEGREES_OF_FREEDOM)
    }
}

impl ReferenceDensity {
    /// Around a fit with a covariance scaled by `wider`; no direction is wider than the prior.
    pub fn new(fit: &[f64], covariance: &DMatrix<f64>, wider: f64, prior: &JointPrior) -> ReferenceDensity {
        let unit: Vec<f64> = prior.marginals().iter().map(|m| m.centre_and_sd()[1]).collect();
        // Sum of precisions of fit and prior: the prior limits directions that the data do not determine.
        let prior_precision = DMatrix::from_diagonal(&DVector::from_fn(fit.len(), |i, _| unit[i].powi(-2)));
        let precision = covariance.clone().try_inverse();
        let combined = precision.and_then(|precision| (precision + &prior_precision).try_inverse());
        let scale = combined.unwrap_or_else(|| {
            let scale_matrix = |i: usize| (covariance[(i, i)].recip() + unit[i].powi(-2)).recip();
            DMatrix::from_diagonal(&DVector::from_fn(fit.len(), |i, _| scale_matrix(i)))
        });
        let (centre, scale) = (DVector::from_column_slice(fit), scale * wider.powi(2));
        let near = StudentT::new(centre.clone(), &scale, &unit);
        // The covariance that is sampled, in case it had to be regularised.
        let scale = near.cholesky_factor() * near.cholesky_factor().transpose();
        let without = |i: usize| {
            let unit: Vec<f64> = unit.iter().enumerate().filter(|(j, _)| *j != i).map(|(_, u)| *u).collect();
            let scale = scale.clone().remove_row(i).remove_column(i);
            StudentT::new(centre.clone().remove_row(i), &scale, &unit)
        };
        let others = if fit.len() > 1 { (0..fit.len()).map(without).collect() } else { Vec::new() };
        ReferenceDensity { fits: vec![FitComponent { share: 1.0, near, others }], prior: prior.clone() }
    }

    /// Around points, with their mean and covariance.
    pub fn from_points(points: &[ParameterVector], wider: f64, prior: &JointPrior) -> ReferenceDensity {
        let (mean, covariance) = weighted_moments(points, &vec![1.0 / points.len() as f64; points.len()]);
        ReferenceDensity::new(mean.as_slice(), &covariance, wider, prior)
    }

    /// Mixes in a component around likely points, with most of the weight.
    pub fn with_points(self, points: &[ParameterVector], wider: f64) -> ReferenceDensity {
        let about = ReferenceDensity::from_points(points, wider, &self.prior);
        let shared = |fits: Vec<FitComponent>, all: f64| {
            fits.into_iter().map(move |fit| FitComponent { share: all * fit.share, ..fit })
        };
        let fits = shared(self.fits, ORIGINAL_FIT_SHARE)
            .chain(shared(about.fits, 1.0 - ORIGINAL_FIT_SHARE))
            .collect();
        ReferenceDensity { fits, ..about }
    }

    /// Weights of the fits, and of each single-parameter component.
    fn component_shares(&self) -> [f64; 2] {
        let numbers = self.fits.first().map_or(0, |fit| fit.others.len());
        let but_one = if numbers == 0 { 0.0 } else { ONE_FREE_SHARE };
        [1.0 - PRIOR_SHARE - but_one, but_one / numbers.max(1) as f64]
    }

    pub fn draw(&self, stream: &mut Stream) -> ParameterVector {
        let u: f64 = stream.random();
        if u < PRIOR_SHARE {
            return self.prior.draw(stream);
        }
        let [near, but_one] = self.component_shares();
        let mut out = self.sample_component(stream).near.draw(stream);
        if u >= PRIOR_SHARE + near {
            let number = (((u - PRIOR_SHARE - near) / but_one) as usize).min(out.len() - 1);
            out[number] = self.prior.marginals()[number].quantile(stream.random());
        }
        out
    }

    /// Draws one of the fits by weight.
    fn sample_component(&self, stream: &mut Stream) -> &FitComponent {
        let shares: Vec<f64> = self.fits.iter().map(|fit| libm::log(fit.share)).collect();
        &self.fits[super::sample_categorical(&shares, stream).unwrap_or(0)]
    }

    pub fn log_density(&self, point: &[f64]) -> f64 {
        let [near, but_one] = self.component_shares();
        let over = |of: &dyn Fn(&FitComponent) -> f64| {
            super::log_sum_exp(self.fits.iter().map(|fit| libm::log(fit.share) + of(fit)).collect::<Vec<_>>())
        };
        let mut all = vec![
            libm::log(near) + over(&|fit| fit.near.log_density(point)),
            libm::log(PRIOR_SHARE) + self.prior.log_density(point),
        ];
        for i in 0..self.fits[0].others.len() {
            let rest: ParameterVector =
                point.iter().enumerate().filter(|(j, _)| *j != i).map(|(_, x)| *x).collect();
            let scale_matrix = self.prior.marginal_log_density(i, point[i]);
            all.push(libm::log(but_one) + scale_matrix + over(&|fit| fit.others[i].log_density(&rest)));
        }
        super::log_sum_exp(all)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::estimate::sampler::Marginal;
    use crate::rng;

    /// Draws match the density: the mean of one over the density is the volume of the support. Tested for
    /// different widths and priors, one dimension, and an indefinite covariance.
    #[test]
    fn density_matches_draws() {
        let uniform = |low, high| Marginal::Uniform { low, high };
        let normal = Marginal::Normal { mean: 0.2, sd: 0.8, low: 0.0, high: 3.0 };
        let all = [uniform(-1.0, 2.0), normal, uniform(0.0, 4.0)];
        let tilted = [0.04, 0.03, 0.0, 0.03, 0.05, 0.02, 0.0, 0.02, 0.5];
        let none = [0.04, 0.3, 0.0, 0.3, 0.05, 0.02, 0.0, 0.02, 0.5];
        for (d, covariance) in [(3, tilted), (3, none), (1, tilted)] {
            let prior = JointPrior::new(all[..d].to_vec()).unwrap();
            let covariance = DMatrix::from_row_slice(3, 3, &covariance).view((0, 0), (d, d)).into_owned();
            let reference = ReferenceDensity::new(&[0.5, 0.4, 3.0][..d], &covariance, 1.5, &prior);
            let wanted: f64 = all[..d].iter().map(|m| m.bounds()[1] - m.bounds()[0]).product();
            let near = [[0.3, 0.1, 1.0], [0.9, 0.3, 2.0], [0.6, 0.7, 1.5], [0.7, 0.2, 1.0]];
            let points = near.map(|p| p[..d].to_vec());
            for reference in [reference.clone(), reference.with_points(&points, 1.5)] {
                let [area, within] = estimate_area(&reference, &prior);
                assert!((area / wanted - 1.0).abs() < 0.06, "{area} for an area of {wanted}");
                assert!(within > 0.7, "{within}");
            }
        }
    }

    /// Monte Carlo volume within the prior's bounds, and the share of draws inside.
    fn estimate_area(reference: &ReferenceDensity, prior: &JointPrior) -> [f64; 2] {
        let mut stream = rng::stream(9, "reference");
        let n = 40_000;
        let (mut within, mut area) = (0.0, 0.0);
        for _ in 0..n {
            let x = reference.draw(&mut stream);
            if prior.contains(&x) {
                within += 1.0;
                area += (-reference.log_density(&x)).exp();
            }
        }
        [area / n as f64, within / n as f64]
    }

    /// An unidentified direction has the width of its prior.
    #[test]
    fn is_no_wider_than_the_prior() {
        let prior =
            JointPrior::new(vec![Marginal::Normal { mean: 1.0, sd: 0.5, low: 0.0, high: 9.0 }; 2]).unwrap();
        let covariance = DMatrix::from_row_slice(2, 2, &[1e8, 0.0, 0.0, 1e-6]);
        let reference = ReferenceDensity::new(&[1.0, 1.0], &covariance, 1.0, &prior);
        let root = &reference.fits[0].near.root;
        assert!((root[(0, 0)] - 0.5).abs() < 1e-3 && (root[(1, 1)] - 1e-3).abs() < 1e-5, "{root}");
    }
}
