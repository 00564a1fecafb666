//! From somewhere near the optimum to the optimum, and how well it is then known: a guarded Gauss-Newton search.
//!
//! With r the differences between observed and simulated coordinates and J their derivatives by the latents, a
//! step solves (sum w J J^T) delta = -sum w J r (Nocedal and Wright 2006, section 10.3). Two things make it fit
//! for trajectories with contacts:
//! - Derivatives are differences over a reach h about as wide as the latents are uncertain. A coordinate that is
//!   not linear in the latents over that reach (behind a collision that may come out either way, say) is left out.
//!   As the estimate sharpens, h shrinks, and more and more of each trajectory takes part.
//! - Differences far beyond the scale of the others are weighed down: w = 1 / (1 + (r / 4 s)^2), Cauchy's.
//!
//! Standard errors: the model's, phi s^2 A^-1, and not below [`RESOLUTION`]. Differences within a trial may depend on
//! each other, so phi is how much harder the trials pull at the latents (squared, mean over trials and latents, the
//! pull of each trial at the estimate itself allowed for) than independent differences of that size would, and at
//! least 1. One phi for all, as a sandwich or a jackknife by latent, tried first, rests on the one or two trials that
//! tell a latent most and is erratic: intervals came out several times too wide. Intervals are Student's with the degrees of freedom of phi.
//!
//! Range of validity: the interval covers what noise and the choice of trials do to the estimate. It does not
//! cover what the simulation leaves out: an estimate that makes up for a missing effect is tightly known and still
//! not the true value. Without noise and with a right model the loss is exactly zero at the truth; the interval is
//! then the resolution.

use nalgebra::{DMatrix, DVector};

use super::fitness::{Simulation, vectors};
use super::piece::Piece;
use crate::distribution::t_quantile;
use crate::error::Result;
use crate::progress::Progress;
use crate::world::Sample;

/// Where latents may lie, and how wide they might.
#[derive(Clone, Debug, PartialEq)]
pub struct Field {
    /// Standard deviation of the prior; 0 for a coordinate that is not searched.
    pub prior: Sample,
    /// Least and greatest value.
    pub limits: Vec<[f64; 2]>,
    /// Which coordinates the search may move; one that the trials do not tell would only wander.
    pub told: Vec<bool>,
}

/// What the search found.
#[derive(Clone, Debug, PartialEq)]
pub struct Refined {
    /// The latents.
    pub estimate: Sample,
    /// Standard errors; infinite where the trials do not tell.
    pub error: Sample,
    /// Degrees of freedom of the interval.
    pub freedom: f64,
    /// Typical difference of a coordinate, m.
    pub scale: f64,
    /// Rollouts simulated.
    pub rollouts: u64,
    /// Differences of all pieces in turn, for comparing with another's.
    differences: Vec<f64>,
}

/// Standard errors are not believed below this share of the prior's deviation: steps in time, a contact that begins
/// a step sooner or later, are not what latents are told by.
pub const RESOLUTION: f64 = 2e-4;
/// Share of a coordinate's change over the reach by which it may miss a straight line.
const STRAIGHT: f64 = 0.3;
/// Crooked coordinates of a body after which its later ones are not believed to be straight, even if they look so.
const CROOKED: usize = 4;
/// Misfits that differ by less, a tenth of a standard error's worth, are as good as each other.
const SAME: f64 = 0.01;
/// Differences beyond this many scales count less and less.
const FAR: f64 = 4.0;
/// Least scale of differences, m.
const LEAST: f64 = 1e-5;
/// Least reach as a share of the prior's deviation.
const REACH: f64 = 1e-5;

/// Searches from `start`; `reach` says how far off each coordinate may be.
pub fn refine(
    start: &Sample,
    reach: &Sample,
    field: &Field,
    pieces: &[Piece],
    simulation: Simulation,
    most_steps: usize,
    progress: &dyn Progress,
) -> Result<Refined> {
    let active: Vec<usize> =
        (0..field.prior.len()).filter(|j| field.prior[*j] > 0.0 && field.told[*j]).collect();
    let mut at = start.clone();
    let mut reach: Sample =
        reach.iter().zip(&field.prior).map(|(r, prior)| r.clamp(0.02 * prior, 0.3 * prior)).collect();
    let mut visited: Vec<Visit> = Vec::new();
    for step in 0..=most_steps {
        let visit = Visit::at(&at, &reach, &active, field, pieces, simulation, progress)?;
        let delta = visit.step(&active, field);
        let done = step == most_steps || delta.is_none();
        let (next, close) = match delta {
            Some((delta, error)) => {
                let share = active
                    .iter()
                    .map(|j| 2.0 * reach[*j] / delta[*j].abs().max(1e-300))
                    .fold(1.0f64, f64::min);
                let mut next = at.clone();
                for j in &active {
                    let moved = delta[*j] * share;
                    next[*j] = (at[*j] + moved).clamp(field.limits[*j][0], field.limits[*j][1]);
                    let wanted = (2.0 * error[*j]).max(0.5 * moved.abs());
                    let most = if share < 1.0 { 1.5 * reach[*j] } else { reach[*j] };
                    reach[*j] = wanted.clamp(0.15 * reach[*j], most).max(REACH * field.prior[*j]);
                }
                let small = |j: &usize| {
                    delta[*j].abs() < 0.05 * error[*j].max(RESOLUTION * field.prior[*j])
                        && reach[*j] < 4.0 * error[*j].max(RESOLUTION * field.prior[*j])
                };
                (next, active.iter().all(small))
            }
            None => (at.clone(), true),
        };
        visited.push(visit);
        if done || close {
            break;
        }
        at = next;
    }
    let scale = visited.iter().map(|v| v.scale).fold(f64::INFINITY, f64::min);
    let rollouts = visited.iter().map(|v| v.rollouts).sum();
    // Compared by what is straight at the end, since the rest is chance; of equals the later, whose reach, and so what
    // it says of the error, is the better one.
    let straight = visited.last().map(|v| v.straight.clone()).unwrap_or_default();
    let among = |v: &Visit| misfit(v.differences.iter().zip(&straight).filter(|d| *d.1).map(|d| d.0), scale);
    let off: Vec<f64> = visited.iter().map(among).collect();
    let least = off.iter().copied().fold(f64::INFINITY, f64::min);
    let best = off.iter().rposition(|o| *o <= least + SAME).unwrap_or(0);
    let best = visited.swap_remove(best);
    let (error, freedom) = best.error(&active, field);
    Ok(Refined {
        estimate: best.at,
        error,
        freedom,
        scale: best.scale,
        rollouts,
        differences: best.differences,
    })
}

impl Refined {
    /// Whether these latents explain the pieces better than another's.
    pub fn beats(&self, other: &Refined) -> bool {
        let scale = self.scale.min(other.scale);
        misfit(&self.differences, scale) < misfit(&other.differences, scale)
    }

    /// 95 % interval of a coordinate, within the limits.
    pub fn interval(&self, j: usize, field: &Field) -> [f64; 2] {
        let half = t_quantile(0.05, self.freedom) * self.error[j];
        let [low, high] = field.limits[j];
        [(self.estimate[j] - half).clamp(low, high), (self.estimate[j] + half).clamp(low, high)]
    }
}

/// Negative log-likelihood of heavy-tailed differences (Cauchy's), up to constants: most differences small beats few
/// differences large, so a chaotic minority decides nothing.
fn misfit<'a>(differences: impl IntoIterator<Item = &'a f64>, scale: f64) -> f64 {
    let s = scale.max(1e-5);
    differences.into_iter().filter(|r| r.is_finite()).map(|r| libm::log(1.0 + (r / s).powi(2))).sum()
}

/// One coordinate at one time.
struct Term {
    trial: usize,
    r: f64,
    /// Its derivatives, one a coordinate.
    j: DVector<f64>,
}

/// What was found at a point of the search.
struct Visit {
    at: Sample,
    terms: Vec<Term>,
    differences: Vec<f64>,
    /// Which of them are linear in the latents over the reach.
    straight: Vec<bool>,
    scale: f64,
    rollouts: u64,
}

impl Visit {
    fn at(
        at: &Sample,
        reach: &Sample,
        active: &[usize],
        field: &Field,
        pieces: &[Piece],
        simulation: Simulation,
        progress: &dyn Progress,
    ) -> Result<Visit> {
        let mut samples = vec![at.clone()];
        for j in active {
            for to in [-1.0, 1.0] {
                let mut moved = at.clone();
                moved[*j] = (at[*j] + to * reach[*j]).clamp(field.limits[*j][0], field.limits[*j][1]);
                samples.push(moved);
            }
        }
        let rows = vectors(&samples, pieces, simulation, "refining", progress)?;
        let (mut terms, mut all_straight) = (Vec::new(), Vec::new());
        for (p, piece) in pieces.iter().enumerate() {
            let times = piece.observed.times.len();
            let mut crooked = 0;
            for i in (0..rows[0][p].len()).step_by(2) {
                if i % (2 * times) == 0 {
                    crooked = 0;
                }
                let (mut pair, mut straight) = (Vec::new(), true);
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
                    straight &= miss <= STRAIGHT.powi(2) * change + 1e-24;
                    if change > 0.0 {
                        pair.push(Term { trial: piece.trial, r, j: slope });
                    }
                }
                let believed = straight && crooked < CROOKED;
                all_straight.extend([believed; 2]);
                if believed {
                    terms.append(&mut pair);
                } else if !straight && piece.weighing.is_none() {
                    crooked += 1;
                }
            }
        }
        let differences: Vec<f64> = rows[0].iter().flatten().copied().collect();
        let scale = (1.4826 * median(terms.iter().map(|t| t.r.abs()).collect())).max(LEAST);
        let rollouts = (samples.len() * pieces.len()) as u64;
        Ok(Visit { at: at.clone(), terms, differences, straight: all_straight, scale, rollouts })
    }

    /// Nothing summed yet.
    fn zeros(&self) -> (DMatrix<f64>, DVector<f64>) {
        let n = self.at.len();
        (DMatrix::zeros(n, n), DVector::zeros(n))
    }

    /// Weight of a term, and the share of it by which its influence still grows.
    fn weight(&self, r: f64) -> (f64, f64) {
        let q = (r / (FAR * self.scale)).powi(2);
        (1.0 / (1.0 + q), (1.0 - q).max(0.0) / (1.0 + q).powi(2))
    }

    /// The Gauss-Newton step and the model's standard errors; `None` if the terms do not determine one.
    fn step(&self, active: &[usize], field: &Field) -> Option<(DVector<f64>, Sample)> {
        let (mut a, mut b) = self.zeros();
        for t in &self.terms {
            let w = self.weight(t.r).0;
            add_square(&mut a, &t.j, w);
            b.axpy(w * t.r, &t.j, 1.0);
        }
        let inverse = inverse(a, active, field)?;
        let error = inverse.diagonal().iter().map(|v| self.scale * v.max(0.0).sqrt()).collect();
        Some((-(inverse * b), error))
    }

    /// Standard errors and degrees of freedom.
    fn error(&self, active: &[usize], field: &Field) -> (Sample, f64) {
        let trials = self.terms.iter().map(|t| t.trial + 1).max().unwrap_or(0);
        let mut parts = vec![self.zeros(); trials];
        let mut influence = 0.0;
        for t in &self.terms {
            let (w, growth) = self.weight(t.r);
            add_square(&mut parts[t.trial].0, &t.j, growth);
            parts[t.trial].1.axpy(w * t.r, &t.j, 1.0);
            influence += (w * t.r).powi(2);
        }
        let a = parts.iter().fold(self.zeros().0, |sum, p| sum + &p.0);
        let n = self.at.len();
        let unknown = (0..n).map(|j| if active.contains(&j) { f64::INFINITY } else { 0.0 }).collect();
        let Some(inverse_a) = inverse(a, active, field) else { return (unknown, 1.0) };
        let variance = influence / (self.terms.len() as f64 - active.len() as f64).max(1.0);
        // How much more the trials pull than independent differences would, seen over all trials and latents.
        let (mut excess, mut seen) = (0.0, 0.0);
        for (of_trial, pull) in &parts {
            let expected = (of_trial - of_trial * &inverse_a * of_trial) * variance;
            for j in active {
                let whole = of_trial[(*j, *j)] * variance;
                if expected[(*j, *j)] > 0.1 * whole && whole > 0.0 {
                    excess += pull[*j].powi(2) / expected[(*j, *j)];
                    seen += 1.0;
                }
            }
        }
        let inflation = if seen > 0.0 { (excess / seen).max(1.0) } else { 1.0 };
        let error = (0..n)
            .map(|j| (inflation * variance * inverse_a[(j, j)]).sqrt().hypot(RESOLUTION * field.prior[j]))
            .collect();
        (error, (seen - active.len() as f64).max(1.0))
    }
}

/// a += w j j^T
fn add_square(a: &mut DMatrix<f64>, j: &DVector<f64>, w: f64) {
    for column in 0..j.len() {
        for row in 0..j.len() {
            a[(row, column)] += j[row] * j[column] * w;
        }
    }
}

/// Inverse over the active coordinates, zero elsewhere; `None` if it has none.
fn inverse(a: DMatrix<f64>, active: &[usize], field: &Field) -> Option<DMatrix<f64>> {
    let n = a.nrows();
    // In units of the prior's deviation, with ones for what is not active.
    let unit = DVector::from_fn(n, |j, _| if active.contains(&j) { field.prior[j] } else { 0.0 });
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
