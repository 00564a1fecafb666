//! Evidence of a model by Laplace's method: parameters theta and shared discrepancy w integrated out about their mode.
//!
//! With the statistics of every group of observations (X'V^-1 X, X'V^-1 r, r'V^-1 r, log det V; X = [J | F]) and the prior
//! precision L of (theta, w),
//!
//! log p(y) = sum_g log t(q_g(x)) - |x - m|_L^2 / 2 + log det L / 2 - log det H / 2,  H = L + sum_g a_g X'V^-1 X,
//!
//! x the mode by iteratively reweighted least squares, a_g = (nu + n_g) / (nu + q_g) the weight of a group whose scale is
//! integrated out (Student t). The standard deviation of w is integrated over a logarithmic grid up to its largest plausible
//! value.
//!
//! Source: Tierney and Kadane, J. Am. Stat. Assoc. 81 (1986) 82; Kass and Raftery, J. Am. Stat. Assoc. 90 (1995) 773; Lange,
//! Little and Taylor, J. Am. Stat. Assoc. 84 (1989) 881.
//!
//! Differences from the sources: H uses the weights of the mode, not their derivatives.

use nalgebra::{DMatrix, DVector};

use super::prior::FixedEffectsPrior;
use crate::estimate::sampler::log_sum_exp;
use crate::inference::mixed_model::group_statistics::GroupStatistics;

/// Standard deviations of the discrepancy, relative to its largest plausible size.
pub const SCALES: [f64; 5] = [1.0, 0.3, 0.1, 0.03, 0.01];
/// Maximum number of iterations of reweighted least squares, and convergence tolerance of the squares.
const MAX_ROUNDS: usize = 30;
const TOLERANCE: f64 = 1e-3;

/// Posterior mode of parameters and discrepancy, with the evidence.
#[derive(Clone, Debug)]
pub struct Laplace {
    pub log_evidence: f64,
    /// Log of likelihood times prior density at the mode by the linearisation.
    pub log_joint: f64,
    /// Step from the point of linearisation to the mode: parameters, then discrepancy.
    pub step: DVector<f64>,
    /// Posterior covariance of the parameters, the discrepancy integrated out.
    pub covariance: DMatrix<f64>,
    /// Standard deviation of the discrepancy at the mode, relative to its largest plausible size.
    pub scale: f64,
}

/// Evidence averaged over the discrepancy's standard deviation; mode and covariance at the most probable one. `None` where a
/// matrix is singular.
pub fn marginal_evidence(groups: &[GroupStatistics], prior: &FixedEffectsPrior) -> Option<Laplace> {
    let parameters = prior.mean_offset.len();
    if groups.first().is_none_or(|g| g.gram.ncols() == parameters) {
        return at_scale(groups, prior, 1.0);
    }
    let mut squares: Vec<f64> = groups.iter().map(|g| g.square).collect();
    let all: Vec<Laplace> =
        SCALES.iter().map(|s| from_squares(groups, prior, *s, &mut squares)).collect::<Option<_>>()?;
    let log_evidence = log_sum_exp(all.iter().map(|l| l.log_evidence)) - (all.len() as f64).ln();
    let best = all.into_iter().max_by(|a, b| a.log_evidence.total_cmp(&b.log_evidence))?;
    Some(Laplace { log_evidence, ..best })
}

/// The same at one standard deviation of the discrepancy.
pub fn at_scale(groups: &[GroupStatistics], prior: &FixedEffectsPrior, scale: f64) -> Option<Laplace> {
    from_squares(groups, prior, scale, &mut groups.iter().map(|g| g.square).collect::<Vec<f64>>())
}

/// The same from initial squares, which are updated to those at the mode.
fn from_squares(
    groups: &[GroupStatistics],
    prior: &FixedEffectsPrior,
    scale: f64,
    squares: &mut [f64],
) -> Option<Laplace> {
    let parameters = prior.mean_offset.len();
    let all = groups.first().map_or(parameters, |g| g.gram.ncols());
    let (precision, mean) = joint_prior(prior, all, scale);
    let pull = &precision * &mean;
    let mut step = DVector::zeros(all);
    let mut factor = None;
    for _ in 0..MAX_ROUNDS {
        let weight = |(g, square): (&GroupStatistics, &f64)| g.weight_at(*square);
        let weights = groups.iter().zip(squares.iter()).map(weight);
        let (h, score) = normal_equations(groups, weights, &precision, &pull);
        let cholesky = h.cholesky()?;
        step = cholesky.solve(&score);
        factor = Some(cholesky);
        let mut change = 0.0f64;
        for (g, square) in groups.iter().zip(squares.iter_mut()) {
            let now = g.square_after(&step);
            change = change.max((now - *square).abs() / (1.0 + square.abs()));
            *square = now;
        }
        if change < TOLERANCE {
            break;
        }
    }
    let factor = factor?;
    let log_det = |l: &DMatrix<f64>| 2.0 * l.diagonal().iter().map(|d| d.ln()).sum::<f64>();
    let off = &step - &mean;
    let log_joint = groups.iter().zip(squares.iter()).map(|(g, s)| g.log_density_at(*s)).sum::<f64>()
        - 0.5 * off.dot(&(&precision * &off))
        + prior.log_weight
        + 0.5 * log_det(precision.cholesky()?.l_dirty());
    let log_evidence = log_joint - 0.5 * log_det(factor.l_dirty());
    let mut unit = DMatrix::zeros(all, parameters);
    (0..parameters).for_each(|k| unit[(k, k)] = 1.0);
    let covariance = factor.solve(&unit).rows(0, parameters).into_owned();
    log_evidence.is_finite().then_some(Laplace { log_evidence, log_joint, step, covariance, scale })
}

/// Precision and mean of parameters and discrepancy, `all` in number.
fn joint_prior(prior: &FixedEffectsPrior, all: usize, scale: f64) -> (DMatrix<f64>, DVector<f64>) {
    let parameters = prior.mean_offset.len();
    let mut precision = DMatrix::from_diagonal_element(all, all, scale.powi(-2));
    precision.view_mut((0, 0), (parameters, parameters)).copy_from(&prior.precision);
    let mut mean = DVector::zeros(all);
    mean.rows_mut(0, parameters).copy_from(&prior.mean_offset);
    (precision, mean)
}

/// The step towards a mode with the parameters' information increased by the factor 1 + `damping` (Levenberg, Q. Appl. Math. 2
/// (1944) 164; Marquardt, J. SIAM 11 (1963) 431): shorter, and least where they are known best. `None` if a matrix is singular.
pub fn damped_step(
    groups: &[GroupStatistics],
    prior: &FixedEffectsPrior,
    mode: &Laplace,
    damping: f64,
) -> Option<DVector<f64>> {
    let (precision, mean) = joint_prior(prior, mode.step.len(), mode.scale);
    let weights = groups.iter().map(|g| g.weight_after(&mode.step));
    let (mut h, score) = normal_equations(groups, weights, &precision, &(&precision * &mean));
    (0..prior.mean_offset.len()).for_each(|k| h[(k, k)] *= 1.0 + damping);
    Some(h.cholesky()?.solve(&score))
}

/// Matrix and right-hand side of the weighted normal equations of all groups with the prior.
fn normal_equations(
    groups: &[GroupStatistics],
    weights: impl Iterator<Item = f64>,
    precision: &DMatrix<f64>,
    pull: &DVector<f64>,
) -> (DMatrix<f64>, DVector<f64>) {
    let (mut h, mut score) = (precision.clone(), pull.clone());
    for (g, weight) in groups.iter().zip(weights) {
        add_times(h.as_mut_slice(), g.gram.as_slice(), weight);
        score.axpy(weight, &g.score, 1.0);
    }
    (h, score)
}

/// Adds a multiple of a slice to another.
fn add_times(to: &mut [f64], from: &[f64], times: f64) {
    to.iter_mut().zip(from).for_each(|(to, from)| *to += times * from);
}

/// Log joint density at the linearization point, the discrepancy at its mode.
pub fn profile_log_posterior(groups: &[GroupStatistics], prior: &FixedEffectsPrior, scale: f64) -> f64 {
    let q = prior.mean_offset.len();
    let own: Vec<GroupStatistics> = groups.iter().map(|g| g.after_parameters(q)).collect();
    let Some(factor) = prior.precision.clone().cholesky() else { return f64::NEG_INFINITY };
    let fixed = prior.log_weight + factor.l_dirty().diagonal().iter().map(|d| d.ln()).sum::<f64>()
        - 0.5 * prior.mean_offset.dot(&(&prior.precision * &prior.mean_offset));
    at_scale(&own, &FixedEffectsPrior::none(), scale).map_or(f64::NEG_INFINITY, |mode| mode.log_joint + fixed)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Groups that each observe one parameter `true_value` with unit noise in eight coordinates.
    fn groups(count: usize, true_value: f64) -> Vec<GroupStatistics> {
        let of = |k: usize| {
            let x = DVector::from_fn(8, |i, _| libm::sin(1.0 + 0.7 * (i + 3 * k) as f64));
            let y = DVector::from_fn(8, |i, _| true_value * x[i] + libm::sin(7.0 * (i * i + 5 * k) as f64));
            GroupStatistics {
                trial: k,
                gram: DMatrix::from_element(1, 1, x.norm_squared()),
                score: DVector::from_element(1, x.dot(&y)),
                square: y.norm_squared(),
                log_det: 0.3,
                count: 8.0,
                misfit_tolerance: 0.0,
            }
        };
        (0..count).map(of).collect()
    }

    fn prior(sd: f64) -> FixedEffectsPrior {
        FixedEffectsPrior {
            precision: DMatrix::from_element(1, 1, sd.powi(-2)),
            mean_offset: DVector::from_element(1, -0.2),
            log_weight: 0.0,
        }
    }

    /// The evidence is the integral of likelihood times prior, by quadrature.
    #[test]
    fn evidence_matches_quadrature() {
        let (groups, prior) = (groups(10, 0.8), prior(0.7));
        let found = at_scale(&groups, &prior, 1.0).unwrap();
        let log_density = |x: f64| {
            let step = DVector::from_element(1, x);
            let likelihood: f64 = groups.iter().map(|g| g.log_density_after(&step)).sum();
            likelihood - 0.5 * ((x + 0.2) / 0.7).powi(2) - 0.5 * (2.0 * std::f64::consts::PI * 0.49).ln()
        };
        let h = 1e-3;
        let exact = log_sum_exp((-4000..4000).map(|i| log_density(h * f64::from(i)))) + h.ln();
        assert!((found.log_evidence - exact).abs() < 0.1, "{} and {exact}", found.log_evidence);
        assert!((found.step[0] - 0.8).abs() < 0.3, "{}", found.step[0]);
    }

    /// Without damping the step is that to the mode; damping shortens it.
    #[test]
    fn damping_shortens_the_step() {
        let (groups, prior) = (groups(10, 0.8), prior(0.7));
        let mode = at_scale(&groups, &prior, 1.0).unwrap();
        let step = |damping: f64| damped_step(&groups, &prior, &mode, damping).unwrap()[0];
        assert!((step(0.0) - mode.step[0]).abs() < 1e-3, "{} and {}", step(0.0), mode.step[0]);
        assert!((step(1.0) / step(0.0) - 0.5).abs() < 1e-9);
    }

    /// A wider prior costs the logarithm of its width for equal data.
    #[test]
    fn a_wider_prior_costs_its_width() {
        let at = |sd: f64| {
            at_scale(
                &groups(40, 0.0),
                &FixedEffectsPrior { mean_offset: DVector::zeros(1), ..prior(sd) },
                1.0,
            )
            .unwrap()
        };
        let cost = at(1.0).log_evidence - at(10.0).log_evidence;
        assert!((cost - 10f64.ln()).abs() < 0.2, "{cost}");
    }

    /// Without discrepancy in the data its smallest size is most probable.
    #[test]
    fn absent_discrepancy_is_small() {
        let wide = |g: GroupStatistics| {
            let mut gram = DMatrix::zeros(2, 2);
            gram[(0, 0)] = g.gram[(0, 0)];
            gram[(1, 1)] = 400.0;
            GroupStatistics { score: DVector::from_vec(vec![g.score[0], 0.0]), gram, ..g }
        };
        let groups: Vec<GroupStatistics> = groups(10, 0.8).into_iter().map(wide).collect();
        let found = marginal_evidence(&groups, &prior(0.7)).unwrap();
        assert_eq!((found.scale, found.covariance.nrows()), (SCALES[4], 1));
    }
}
