//! Guarded Gauss-Newton refinement of an estimate, with standard errors.
//!
//! With r the residuals (observed minus simulated coordinates) and J their Jacobian with respect to the
//! latents, a step solves (sum w J J^T) delta = -sum w J r (Nocedal and Wright 2006, section 10.3). Two
//! modifications handle trajectories with contacts:
//! - Derivatives are finite differences over a step h about as wide as the latents' uncertainty. A coordinate
//!   that is not linear in the latents over that step (for example after a collision that may come out either
//!   way) is excluded. As the estimate sharpens, h shrinks and more of each trajectory takes part.
//! - Residuals far beyond the scale of the others are down-weighted with Cauchy's weight w = 1 / (1 + (r / 4
//!   s)^2).
//!
//! Standard errors are the model's, phi s^2 A^-1, and at least [`RELATIVE_RESOLUTION`]. Residuals within a
//! trial may be correlated, so phi is a dispersion factor: the mean squared score of a trial (over trials and
//! latents, corrected for the fitted parameters) relative to its expectation for independent residuals, at
//! least 1. One phi is shared by all latents, because per-latent sandwich or jackknife estimates depend on the
//! one or two most informative trials and are erratic. Intervals are Student's t with the degrees of freedom of
//! phi.
//!
//! Range of validity: the interval covers the effects of noise and of the choice of trials. It does not cover
//! model error: an estimate that compensates for a missing effect is precise and wrong. Without noise and with
//! a correct model the loss is exactly zero at the truth; the interval is then the resolution.

use nalgebra::{DMatrix, DVector};

use super::loss::{Simulation, segment_residuals};
use super::segment::TrialSegment;
use crate::distribution::t_quantile;
use crate::error::Result;
use crate::progress::Progress;
use crate::world::ParameterVector;

/// Search space of the latents.
#[derive(Clone, Debug, PartialEq)]
pub struct SearchBounds {
    /// Prior standard deviation; 0 for a coordinate that is not searched.
    pub prior_sd: ParameterVector,
    /// Lower and upper limit.
    pub limits: Vec<[f64; 2]>,
    /// Coordinates that the trials identify; the others stay fixed.
    pub identifiable: Vec<bool>,
}

/// Result of a refinement.
#[derive(Clone, Debug, PartialEq)]
pub struct RefinedEstimate {
    /// Estimated latents.
    pub estimate: ParameterVector,
    /// Standard errors; infinite where not identified.
    pub standard_error: ParameterVector,
    /// Degrees of freedom of the confidence interval.
    pub degrees_of_freedom: f64,
    /// Robust standard deviation of the residuals, m.
    pub residual_scale: f64,
    /// Number of simulated rollouts.
    pub rollouts: u64,
    /// Residuals of all segments in order.
    residuals: Vec<f64>,
}

/// Minimum standard error as a share of the prior's standard deviation: time-step discretisation, such as a
/// contact that starts one step later, limits the resolution.
pub const RELATIVE_RESOLUTION: f64 = 2e-4;
/// Maximum deviation from linearity, as a share of a coordinate's change over the finite-difference step.
const LINEARITY_TOLERANCE: f64 = 0.3;
/// Number of non-linear points of a body after which its later points are excluded.
const MAX_NONLINEAR_POINTS: usize = 4;
/// Misfits that differ by less (a tenth of a standard error) count as equal.
const MISFIT_TIE: f64 = 0.01;
/// Scale of Cauchy's weight, in units of the residual scale.
const CAUCHY_SCALE: f64 = 4.0;
/// Minimum residual scale, m.
const MIN_RESIDUAL_SCALE_M: f64 = 1e-5;
/// Minimum finite-difference step as a share of the prior's standard deviation.
const MIN_RELATIVE_FD_STEP: f64 = 1e-5;

/// Refines `start`; `fd_step` is the initial finite-difference step of each coordinate.
pub fn refine(
    start: &ParameterVector,
    fd_step: &ParameterVector,
    bounds: &SearchBounds,
    segments: &[TrialSegment],
    simulation: Simulation,
    max_steps: usize,
    progress: &dyn Progress,
) -> Result<RefinedEstimate> {
    let active: Vec<usize> =
        (0..bounds.prior_sd.len()).filter(|j| bounds.prior_sd[*j] > 0.0 && bounds.identifiable[*j]).collect();
    let mut at = start.clone();
    let mut fd_step: ParameterVector =
        fd_step.iter().zip(&bounds.prior_sd).map(|(r, prior)| r.clamp(0.02 * prior, 0.3 * prior)).collect();
    let mut iterates: Vec<GaussNewtonIterate> = Vec::new();
    for step in 0..=max_steps {
        let iterate =
            GaussNewtonIterate::evaluate(&at, &fd_step, &active, bounds, segments, simulation, progress)?;
        let delta = iterate.step(&active, bounds);
        let done = step == max_steps || delta.is_none();
        let (next, close) = match delta {
            Some((delta, error)) => {
                let largest_share = |j: &usize| 2.0 * fd_step[*j] / delta[*j].abs().max(1e-300);
                let share = active.iter().map(largest_share).fold(1.0f64, f64::min);
                let mut next = at.clone();
                for j in &active {
                    let moved = delta[*j] * share;
                    next[*j] = (at[*j] + moved).clamp(bounds.limits[*j][0], bounds.limits[*j][1]);
                    let wanted = (2.0 * error[*j]).max(0.5 * moved.abs());
                    let most = if share < 1.0 { 1.5 * fd_step[*j] } else { fd_step[*j] };
                    fd_step[*j] = wanted
                        .clamp(0.15 * fd_step[*j], most)
                        .max(MIN_RELATIVE_FD_STEP * bounds.prior_sd[*j]);
                }
                let small = |j: &usize| {
                    delta[*j].abs() < 0.05 * error[*j].max(RELATIVE_RESOLUTION * bounds.prior_sd[*j])
                        && fd_step[*j] < 4.0 * error[*j].max(RELATIVE_RESOLUTION * bounds.prior_sd[*j])
                };
                (next, active.iter().all(small))
            }
            None => (at.clone(), true),
        };
        iterates.push(iterate);
        if done || close {
            break;
        }
        at = next;
    }
    let scale = iterates.iter().map(|v| v.scale).fold(f64::INFINITY, f64::min);
    let rollouts = iterates.iter().map(|v| v.rollouts).sum();
    // Iterates are compared on the coordinates that are linear at the end. Among equal misfits the later
    // iterate wins: its smaller step gives the better standard error.
    let linear = iterates.last().map(|v| v.linear.clone()).unwrap_or_default();
    let among = |v: &GaussNewtonIterate| {
        cauchy_misfit(v.residuals.iter().zip(&linear).filter(|d| *d.1).map(|d| d.0), scale)
    };
    let misfits: Vec<f64> = iterates.iter().map(among).collect();
    let lowest = misfits.iter().copied().fold(f64::INFINITY, f64::min);
    let best = misfits.iter().rposition(|o| *o <= lowest + MISFIT_TIE).unwrap_or(0);
    let best = iterates.swap_remove(best);
    let (error, freedom) = best.standard_errors(&active, bounds);
    Ok(RefinedEstimate {
        estimate: best.at,
        standard_error: error,
        degrees_of_freedom: freedom,
        residual_scale: best.scale,
        rollouts,
        residuals: best.residuals,
    })
}

impl RefinedEstimate {
    /// Whether these latents have a smaller misfit than another estimate.
    pub fn fits_better_than(&self, other: &RefinedEstimate) -> bool {
        let scale = self.residual_scale.min(other.residual_scale);
        cauchy_misfit(&self.residuals, scale) < cauchy_misfit(&other.residuals, scale)
    }

    /// 95 % confidence interval of a coordinate, clipped to the limits.
    pub fn confidence_interval(&self, j: usize, bounds: &SearchBounds) -> [f64; 2] {
        let half = t_quantile(0.05, self.degrees_of_freedom) * self.standard_error[j];
        let [low, high] = bounds.limits[j];
        [(self.estimate[j] - half).clamp(low, high), (self.estimate[j] + half).clamp(low, high)]
    }
}

/// Negative log-likelihood of Cauchy residuals, up to constants. It prefers many small residuals to few large
/// ones, so a chaotic minority has little influence.
fn cauchy_misfit<'a>(residuals: impl IntoIterator<Item = &'a f64>, scale: f64) -> f64 {
    let s = scale.max(1e-5);
    residuals.into_iter().filter(|r| r.is_finite()).map(|r| libm::log(1.0 + (r / s).powi(2))).sum()
}

/// Residual of one coordinate at one time.
struct ResidualTerm {
    trial: usize,
    r: f64,
    /// Gradient with respect to the latents.
    j: DVector<f64>,
}

/// Linearisation at one iterate.
struct GaussNewtonIterate {
    at: ParameterVector,
    terms: Vec<ResidualTerm>,
    residuals: Vec<f64>,
    /// Which residuals are linear in the latents over the finite-difference step.
    linear: Vec<bool>,
    scale: f64,
    rollouts: u64,
}

impl GaussNewtonIterate {
    fn evaluate(
        at: &ParameterVector,
        fd_step: &ParameterVector,
        active: &[usize],
        bounds: &SearchBounds,
        segments: &[TrialSegment],
        simulation: Simulation,
        progress: &dyn Progress,
    ) -> Result<GaussNewtonIterate> {
        let mut samples = vec![at.clone()];
        for j in active {
            for to in [-1.0, 1.0] {
                let mut moved = at.clone();
                moved[*j] = (at[*j] + to * fd_step[*j]).clamp(bounds.limits[*j][0], bounds.limits[*j][1]);
                samples.push(moved);
            }
        }
        let rows = segment_residuals(&samples, segments, simulation, "refining", progress)?;
        let (mut terms, mut all_linear) = (Vec::new(), Vec::new());
        for (p, segment) in segments.iter().enumerate() {
            let times = segment.observed.times.len();
            let mut nonlinear = 0;
            for i in (0..rows[0][p].len()).step_by(2) {
                if i % (2 * times) == 0 {
                    nonlinear = 0;
                }
                let (mut pair, mut linear) = (Vec::new(), true);
                for c in [i, i + 1] {
                    let r = rows[0][p][c];
                    let (mut slope, mut change, mut miss) = (DVector::zeros(at.len()), 0.0, 0.0);
                    for (k, j) in active.iter().enumerate() {
                        let (low, high) = (samples[1 + 2 * k][*j], samples[2 + 2 * k][*j]);
                        let (before, after) = (rows[1 + 2 * k][p][c], rows[2 + 2 * k][p][c]);
                        let share = (at[*j] - low) / (high - low);
                        slope[*j] = (after - before) / (high - low);
                        change += (after - before).powi(2) / 4.0;
                        miss += (before + share * (after - before) - r).powi(2);
                    }
                    if !(r.is_finite() && change.is_finite()) {
                        continue;
                    }
                    linear &= miss <= LINEARITY_TOLERANCE.powi(2) * change + 1e-24;
                    if change > 0.0 {
                        pair.push(ResidualTerm { trial: segment.trial, r, j: slope });
                    }
                }
                let is_linear = linear && nonlinear < MAX_NONLINEAR_POINTS;
                all_linear.extend([is_linear; 2]);
                if is_linear {
                    terms.append(&mut pair);
                } else if !linear && segment.whitening.is_none() {
                    nonlinear += 1;
                }
            }
        }
        let residuals: Vec<f64> = rows[0].iter().flatten().copied().collect();
        let scale = (1.4826 * median(terms.iter().map(|t| t.r.abs()).collect())).max(MIN_RESIDUAL_SCALE_M);
        let rollouts = (samples.len() * segments.len()) as u64;
        Ok(GaussNewtonIterate { at: at.clone(), terms, residuals, linear: all_linear, scale, rollouts })
    }

    /// Zero normal equations.
    fn zeros(&self) -> (DMatrix<f64>, DVector<f64>) {
        let n = self.at.len();
        (DMatrix::zeros(n, n), DVector::zeros(n))
    }

    /// Weight of a residual, and derivative of its influence.
    fn weight(&self, r: f64) -> (f64, f64) {
        let q = (r / (CAUCHY_SCALE * self.scale)).powi(2);
        (1.0 / (1.0 + q), (1.0 - q).max(0.0) / (1.0 + q).powi(2))
    }

    /// Gauss-Newton step and model-based standard errors; `None` if the normal matrix is singular.
    fn step(&self, active: &[usize], bounds: &SearchBounds) -> Option<(DVector<f64>, ParameterVector)> {
        let (mut a, mut b) = self.zeros();
        for t in &self.terms {
            let w = self.weight(t.r).0;
            add_outer_product(&mut a, &t.j, w);
            b.axpy(w * t.r, &t.j, 1.0);
        }
        let inverse = active_inverse(a, active, bounds)?;
        let error = inverse.diagonal().iter().map(|v| self.scale * v.max(0.0).sqrt()).collect();
        Some((-(inverse * b), error))
    }

    /// Standard errors and degrees of freedom.
    fn standard_errors(&self, active: &[usize], bounds: &SearchBounds) -> (ParameterVector, f64) {
        let trials = self.terms.iter().map(|t| t.trial + 1).max().unwrap_or(0);
        let mut per_trial = vec![self.zeros(); trials];
        let mut influence = 0.0;
        for t in &self.terms {
            let (w, growth) = self.weight(t.r);
            add_outer_product(&mut per_trial[t.trial].0, &t.j, growth);
            per_trial[t.trial].1.axpy(w * t.r, &t.j, 1.0);
            influence += (w * t.r).powi(2);
        }
        let a = per_trial.iter().fold(self.zeros().0, |sum, p| sum + &p.0);
        let n = self.at.len();
        let unknown = (0..n).map(|j| if active.contains(&j) { f64::INFINITY } else { 0.0 }).collect();
        let Some(inverse_a) = active_inverse(a, active, bounds) else { return (unknown, 1.0) };
        let variance = influence / (self.terms.len() as f64 - active.len() as f64).max(1.0);
        // Dispersion: squared scores of the trials relative to their expectation for independent residuals.
        let (mut excess, mut count) = (0.0, 0.0);
        for (of_trial, score) in &per_trial {
            let expected = (of_trial - of_trial * &inverse_a * of_trial) * variance;
            for j in active {
                let information = of_trial[(*j, *j)] * variance;
                if expected[(*j, *j)] > 0.1 * information && information > 0.0 {
                    excess += score[*j].powi(2) / expected[(*j, *j)];
                    count += 1.0;
                }
            }
        }
        let inflation = if count > 0.0 { (excess / count).max(1.0) } else { 1.0 };
        let error = (0..n)
            .map(|j| {
                (inflation * variance * inverse_a[(j, j)])
                    .sqrt()
                    .hypot(RELATIVE_RESOLUTION * bounds.prior_sd[j])
            })
            .collect();
        (error, (count - active.len() as f64).max(1.0))
    }
}

/// a += w j j^T
fn add_outer_product(a: &mut DMatrix<f64>, j: &DVector<f64>, w: f64) {
    for column in 0..j.len() {
        for row in 0..j.len() {
            a[(row, column)] += j[row] * j[column] * w;
        }
    }
}

/// Inverse over the active coordinates, zero elsewhere; `None` if singular.
fn active_inverse(a: DMatrix<f64>, active: &[usize], bounds: &SearchBounds) -> Option<DMatrix<f64>> {
    let n = a.nrows();
    // Scaled by the prior's standard deviation; inactive coordinates get a unit diagonal.
    let unit = DVector::from_fn(n, |j, _| if active.contains(&j) { bounds.prior_sd[j] } else { 0.0 });
    let mut scaled = DMatrix::from_fn(n, n, |i, j| a[(i, j)] * unit[i] * unit[j]);
    let largest = (0..n).map(|j| scaled[(j, j)]).fold(0.0, f64::max);
    if !(largest.is_finite() && largest > 0.0) {
        return None;
    }
    for j in 0..n {
        if unit[j] == 0.0 {
            scaled[(j, j)] = largest;
        } else {
            scaled[(j, j)] += 1e-12 * largest;
        }
    }
    let inverse = scaled.cholesky()?.inverse();
    Some(DMatrix::from_fn(n, n, |i, j| inverse[(i, j)] * unit[i] * unit[j]))
}

fn median(mut values: Vec<f64>) -> f64 {
    values.sort_by(f64::total_cmp);
    values.get(values.len() / 2).copied().unwrap_or(0.0)
}
