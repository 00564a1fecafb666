//! Log densities of one world's observations given another world.
//!
//! Observations differ between worlds along few directions beyond the noise: their principal components. In these, world j's density is
//! Student's about its own observations, with measurement and actuation noise, widened to a kernel so that worlds between two samples are
//! as likely as the samples. Kernels are shrunk towards their group's mean by as much as they are widened, so that the mixture keeps the
//! group's covariance (West 1993).
//!
//! Where a world is given by its parameters (latents, effect parameters), only a smooth dependence on them is informative: the group's
//! observations are regressed on the parameters (`smooth`), and the leave-one-out residuals count as noise.
//!
//! Differences from the source: all kernels have the pooled covariance within groups and Silverman's width (1986, equation 4.14). A world is
//! left out of the density of its own observations: as a kernel, from its group's mean, and from the covariance; and there are no more
//! directions than a group's samples determine. This avoids optimistic information estimates for identical groups.

use nalgebra::{Cholesky, DMatrix, DVector, Dyn, SymmetricEigen};
use rand_distr::{Distribution, StandardNormal};

use super::predicted_observations::PredictedObservations;
use super::smooth;
use crate::error::{Error, Result};
use crate::estimate::sampler::log_sum_exp;
use crate::rng::Stream;

/// Maximal and minimal number of principal components, and draws of the smallest group for each.
const MAX_COMPONENTS: usize = 16;
const MIN_COMPONENTS: usize = 2;
const DRAWS_PER_COMPONENT: usize = 5;
/// Ridge relative to the mean variance, which keeps covariances positive definite under rounding.
const RELATIVE_RIDGE: f64 = 1e-9;
/// Variance of a component relative to the noise variance below which it is dropped.
const MIN_VARIANCE_SHARE: f64 = 0.02;
/// Degrees of freedom of the Student densities.
const STUDENT_DOF: f64 = 8.0;

/// Principal component scores of a candidate's observations, in units of the noise.
#[derive(Clone, Debug)]
pub struct ComponentScores {
    /// (directions, worlds): mean over copies.
    scores: DMatrix<f64>,
    /// (directions, worlds): the held-out copy, with measurement noise.
    observations: DMatrix<f64>,
    /// By world, the covariance of measurement and actuation noise.
    noise_covariances: Vec<DMatrix<f64>>,
}

/// Log densities between worlds.
#[derive(Clone, Debug)]
pub struct LikelihoodMatrix {
    /// (worlds, worlds): log density of world i's observations in the kernel of world j.
    components: DMatrix<f64>,
    /// Log density of world i's observations given its own parameters.
    own: Vec<f64>,
}

/// Groups of worlds that differ only in their parameter values.
#[derive(Clone, Copy)]
pub struct Grouping<'a> {
    /// By world, the index of its group.
    pub groups: &'a [usize],
    /// By world, its parameters; the same number in every world of a group.
    pub numbers: &'a [Vec<f64>],
}

impl Grouping<'_> {
    /// Number of principal components that the smallest group determines.
    fn directions(&self) -> usize {
        let mut counts = vec![0; self.groups.iter().max().map_or(0, |g| g + 1)];
        self.groups.iter().for_each(|g| counts[*g] += 1);
        let fewest = counts.into_iter().filter(|c| *c > 0).min().unwrap_or(0);
        (fewest / DRAWS_PER_COMPONENT).clamp(MIN_COMPONENTS, MAX_COMPONENTS)
    }
}

impl LikelihoodMatrix {
    fn nothing(worlds: usize) -> LikelihoodMatrix {
        LikelihoodMatrix { components: DMatrix::zeros(worlds, worlds), own: vec![0.0; worlds] }
    }

    pub fn worlds(&self) -> usize {
        self.own.len()
    }

    /// Log density of world `i`'s observations in the kernel of world `j`.
    pub fn log_density(&self, i: usize, j: usize) -> f64 {
        self.components[(i, j)]
    }

    /// Log density of world `i`'s observations given its own parameters.
    pub fn own_log_density(&self, i: usize) -> f64 {
        self.own[i]
    }
}

impl ComponentScores {
    /// Scores of predicted observations. `noise`: standard deviation of a coordinate, m.
    pub fn new(
        predicted: &PredictedObservations,
        grouping: Grouping,
        noise: f64,
        stream: &mut Stream,
    ) -> ComponentScores {
        let (n, worlds) = predicted.mean.shape();
        let actuation_variances: Vec<DVector<f64>> = predicted.spread.iter().map(variances).collect();
        let scale = coordinate_scales(&actuation_variances, noise, n);
        let centre = predicted.mean.column_mean();
        let white = |m: &DMatrix<f64>| DMatrix::from_fn(n, worlds, |t, j| (m[(t, j)] - centre[t]) / scale[t]);
        let mean = white(&predicted.mean);
        let mut held_out = white(&predicted.held);
        for mut column in held_out.column_iter_mut() {
            for (t, value) in column.iter_mut().enumerate() {
                let sample: f64 = StandardNormal.sample(stream);
                *value += sample * noise / scale[t];
            }
        }
        let basis = principal_directions(&mean, grouping.directions());
        let of =
            |j: usize| noise_covariance(&basis, &predicted.spread[j], &actuation_variances[j], &scale, noise);
        ComponentScores {
            scores: basis.tr_mul(&mean),
            observations: basis.tr_mul(&held_out),
            noise_covariances: (0..worlds).map(of).collect(),
        }
    }

    /// Scores of both experiments together.
    pub fn combined_with(&self, other: &ComponentScores, grouping: Grouping) -> ComponentScores {
        let below = |a: &DMatrix<f64>, b: &DMatrix<f64>| {
            let mut both = DMatrix::zeros(a.nrows() + b.nrows(), a.ncols());
            both.rows_mut(0, a.nrows()).copy_from(a);
            both.rows_mut(a.nrows(), b.nrows()).copy_from(b);
            both
        };
        let scores = below(&self.scores, &other.scores);
        let basis = principal_directions(&scores, grouping.directions());
        let of = |(a, b): (&DMatrix<f64>, &DMatrix<f64>)| {
            let n = a.nrows();
            let (first, second) = (basis.rows(0, n), basis.rows(n, b.nrows()));
            first.tr_mul(&(a * first)) + second.tr_mul(&(b * second))
        };
        ComponentScores {
            observations: basis.tr_mul(&below(&self.observations, &other.observations)),
            noise_covariances: self.noise_covariances.iter().zip(&other.noise_covariances).map(of).collect(),
            scores: basis.tr_mul(&scores),
        }
    }

    /// One noisy observation of each world, (directions, worlds).
    pub fn observations(&self) -> &DMatrix<f64> {
        &self.observations
    }

    /// Log densities between worlds; an error where a covariance is singular.
    pub fn likelihoods(&self, grouping: Grouping) -> Result<LikelihoodMatrix> {
        let worlds = self.scores.ncols();
        let mut likelihoods = LikelihoodMatrix::nothing(worlds);
        if self.scores.nrows() == 0 {
            return Ok(likelihoods);
        }
        let groups = GroupMoments::new(&self.scores, grouping.groups);
        let follow = regress_on_parameters(&self.scores, &self.noise_covariances, grouping);
        for i in 0..worlds {
            let own = factorise(&self.noise_covariances[i] + &follow.residual_covariances[i])?;
            likelihoods.own[i] =
                log_density(&own, &(self.observations.column(i) - follow.predictions.column(i)));
        }
        // Kernels, or one Gaussian-like density for each group: whichever predicts left-out worlds better.
        let (kernels, whole) = (self.components(&groups, false)?, self.components(&groups, true)?);
        likelihoods.components = if leave_one_out_log_likelihood(&kernels, &groups)
            > leave_one_out_log_likelihood(&whole, &groups)
        {
            kernels
        } else {
            whole
        };
        Ok(likelihoods)
    }

    /// (worlds, worlds): log density of world i's observations in the kernel of world j, or in its group as a whole; 0 on the diagonal.
    fn components(&self, groups: &GroupMoments, whole: bool) -> Result<DMatrix<f64>> {
        let (directions, worlds) = self.scores.shape();
        let mut densities = DMatrix::zeros(worlds, worlds);
        for i in 0..worlds {
            let within = groups.covariance_without(&self.scores, i);
            for j in (0..worlds).filter(|j| *j != i) {
                let group = groups.of[j];
                let width = if whole { 1.0 } else { groups.width(group, directions) };
                let mean = groups.mean_without(&self.scores, group, i);
                let place = &mean + (self.scores.column(j) - &mean) * (1.0 - width * width).sqrt();
                let kernel = factorise(&self.noise_covariances[j] + &within * (width * width))?;
                densities[(i, j)] = log_density(&kernel, &(self.observations.column(i) - place));
            }
        }
        Ok(densities)
    }
}

/// Leave-one-out log likelihood within groups (likelihood cross-validation: Duin, IEEE Trans. Comput. 25 (1976) 1175).
fn leave_one_out_log_likelihood(components: &DMatrix<f64>, groups: &GroupMoments) -> f64 {
    let of = |i: usize| {
        let others = (0..groups.of.len()).filter(|j| *j != i && groups.of[*j] == groups.of[i]);
        log_sum_exp(others.map(|j| components[(i, j)]).collect::<Vec<_>>())
    };
    (0..groups.of.len()).map(of).filter(|v| v.is_finite()).sum()
}

/// Cholesky factor of a covariance.
fn factorise(mut covariance: DMatrix<f64>) -> Result<Cholesky<f64, Dyn>> {
    let ridge = RELATIVE_RIDGE * covariance.trace() / covariance.nrows() as f64;
    (0..covariance.nrows()).for_each(|r| covariance[(r, r)] += ridge);
    let failed = || {
        Error::Failed(
            "the covariance of predicted observations is singular: use more noise or a larger `perturb`"
                .into(),
        )
    };
    Cholesky::new(covariance).ok_or_else(failed)
}

/// By coordinate, the variance over copies, m^2.
fn variances(spread: &DMatrix<f64>) -> DVector<f64> {
    DVector::from_iterator(spread.nrows(), spread.row_iter().map(|r| r.norm_squared()))
}

/// By coordinate, the expected standard deviation: measurement noise and the median actuation noise, m.
fn coordinate_scales(actuation_variances: &[DVector<f64>], noise: f64, n: usize) -> Vec<f64> {
    let of = |t: usize| {
        let mut all: Vec<f64> = actuation_variances.iter().map(|v| v[t]).collect();
        all.sort_by(f64::total_cmp);
        (noise * noise + all[all.len() / 2]).sqrt()
    };
    (0..n).map(of).collect()
}

/// Principal directions in which worlds differ by more than the noise, (n, directions).
fn principal_directions(white: &DMatrix<f64>, most: usize) -> DMatrix<f64> {
    let degrees = (white.ncols() - 1).max(1) as f64;
    let eigen = SymmetricEigen::new(white.tr_mul(white));
    let mut order: Vec<usize> = (0..eigen.eigenvalues.len()).collect();
    order.sort_by(|a, b| eigen.eigenvalues[*b].total_cmp(&eigen.eigenvalues[*a]));
    order.retain(|k| eigen.eigenvalues[*k] / degrees > MIN_VARIANCE_SHARE);
    order.truncate(most);
    let columns: Vec<DVector<f64>> =
        order.iter().map(|k| white * eigen.eigenvectors.column(*k) / eigen.eigenvalues[*k].sqrt()).collect();
    if columns.is_empty() { DMatrix::zeros(white.nrows(), 0) } else { DMatrix::from_columns(&columns) }
}

/// Noise covariance in principal components, measurement and actuation noise together.
///
/// The spread of copies counts twice, with its covariance and coordinate by coordinate: the covariance of so few copies has too low
/// a rank.
fn noise_covariance(
    basis: &DMatrix<f64>,
    spread: &DMatrix<f64>,
    actuation_variances: &DVector<f64>,
    scale: &[f64],
    noise: f64,
) -> DMatrix<f64> {
    let alone = DMatrix::from_fn(basis.nrows(), basis.ncols(), |t, r| {
        basis[(t, r)] * (noise * noise + actuation_variances[t]).sqrt() / scale[t]
    });
    let white = DMatrix::from_fn(spread.nrows(), spread.ncols(), |t, k| spread[(t, k)] / scale[t]);
    let together = basis.tr_mul(&white);
    alone.tr_mul(&alone) + &together * together.transpose()
}

/// Means and covariance of groups.
struct GroupMoments<'a> {
    of: &'a [usize],
    counts: Vec<f64>,
    means: Vec<DVector<f64>>,
    /// Sum over worlds of the outer product of their deviation from their group's mean.
    scatter: DMatrix<f64>,
}

impl GroupMoments<'_> {
    fn new<'a>(scores: &DMatrix<f64>, of: &'a [usize]) -> GroupMoments<'a> {
        let dimensions = scores.nrows();
        let count = of.iter().max().map_or(0, |g| g + 1);
        let (mut counts, mut means) = (vec![0.0; count], vec![DVector::zeros(dimensions); count]);
        for (j, group) in of.iter().enumerate() {
            counts[*group] += 1.0;
            means[*group] += scores.column(j);
        }
        means.iter_mut().zip(&counts).for_each(|(mean, n)| *mean /= f64::max(*n, 1.0));
        let scatter =
            of.iter().enumerate().fold(DMatrix::zeros(dimensions, dimensions), |sum, (j, group)| {
                let deviation = scores.column(j) - &means[*group];
                sum + &deviation * deviation.transpose()
            });
        GroupMoments { of, counts, means, scatter }
    }

    /// Mean of a group without world `i`.
    fn mean_without(&self, scores: &DMatrix<f64>, group: usize, i: usize) -> DVector<f64> {
        let n = self.counts[group];
        match self.of[i] == group && n > 1.0 {
            true => (&self.means[group] * n - scores.column(i)) / (n - 1.0),
            false => self.means[group].clone(),
        }
    }

    /// Covariance within groups without world `i`.
    fn covariance_without(&self, scores: &DMatrix<f64>, i: usize) -> DMatrix<f64> {
        let group = self.of[i];
        let n = self.counts[group];
        let deviation = scores.column(i) - &self.means[group];
        let share = if n > 1.0 { n / (n - 1.0) } else { 0.0 };
        let groups = self.counts.iter().filter(|c| **c > 0.0).count() as f64;
        let degrees = (self.of.len() as f64 - 1.0 - groups).max(1.0);
        (&self.scatter - &deviation * deviation.transpose() * share) / degrees
    }

    /// Kernel width of a group relative to the standard deviation within groups.
    fn width(&self, group: usize, dimensions: usize) -> f64 {
        let d = dimensions as f64;
        libm::pow(4.0 / (d + 2.0) / self.counts[group].max(1.0), 1.0 / (d + 4.0)).min(1.0)
    }
}

/// Regression of the scores on the worlds' parameters.
struct SmoothFit {
    /// (directions, worlds): leave-one-out predictions from the others of the group.
    predictions: DMatrix<f64>,
    /// By world, the residual covariance of the others of its group.
    residual_covariances: Vec<DMatrix<f64>>,
}

fn regress_on_parameters(
    scores: &DMatrix<f64>,
    noise_covariances: &[DMatrix<f64>],
    grouping: Grouping,
) -> SmoothFit {
    let dimensions = scores.nrows();
    let count = grouping.groups.iter().max().map_or(0, |g| g + 1);
    let nothing = DMatrix::zeros(dimensions, dimensions);
    let mut densities = SmoothFit {
        predictions: scores.clone(),
        residual_covariances: vec![nothing.clone(); grouping.groups.len()],
    };
    for group in 0..count {
        let own: Vec<usize> = (0..grouping.groups.len()).filter(|j| grouping.groups[*j] == group).collect();
        let numbers: Vec<&[f64]> = own.iter().map(|j| grouping.numbers[*j].as_slice()).collect();
        let targets = DMatrix::from_fn(own.len(), dimensions, |i, r| scores[(r, own[i])]);
        let noise: Vec<f64> = (0..dimensions)
            .map(|r| own.iter().map(|j| noise_covariances[*j][(r, r)]).sum::<f64>() / own.len().max(1) as f64)
            .collect();
        let deviation = smooth::leave_one_out_residuals(&numbers, &targets, &noise);
        let outer = |i: usize| deviation.row(i).transpose() * deviation.row(i);
        let all = (0..own.len()).fold(nothing.clone(), |sum, i| sum + outer(i));
        for (i, j) in own.iter().enumerate() {
            densities.predictions.set_column(*j, &(scores.column(*j) - deviation.row(i).transpose()));
            densities.residual_covariances[*j] = (&all - outer(i)) / (own.len() as f64 - 1.0).max(1.0);
        }
    }
    densities
}

/// Log of Student's density with [`STUDENT_DOF`] degrees of freedom, without terms that don't depend on the covariance.
fn log_density(covariance: &Cholesky<f64, Dyn>, deviation: &DVector<f64>) -> f64 {
    let l = covariance.l_dirty();
    let log_det: f64 = l.diagonal().iter().map(|v| libm::log(*v)).sum();
    let white = l.solve_lower_triangular(deviation).map_or(f64::INFINITY, |w| w.norm_squared());
    -log_det - 0.5 * (STUDENT_DOF + deviation.len() as f64) * libm::log1p(white / STUDENT_DOF)
}
