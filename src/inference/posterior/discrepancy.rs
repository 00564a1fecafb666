//! Shared model discrepancy, integrated out: a force field of unknown kind and strength.
//!
//! The field is a sum of basis functions (`field`) of all inputs, of position, of velocity, of time or of
//! position and heading, with normal coefficients of common standard deviation t, m/s^2. For each kind and each
//! t, and for no field, the coefficients are integrated out around their mode (Laplace's method): with Z the
//! groups' Jacobian with respect to them and w the groups' weights at the fit,
//!
//! log p(r | t) = sum_p log student(|r_p - Z_p a|^2) - |a|^2 / (2 t^2) - log det(I + t^2 A) / 2,  a = (A + I /
//! t^2)^-1 sum_p w_p Z_p' r_p,
//!
//! A = sum_p w_p Z_p' Z_p. The prior probability of no field is that of all fields together; kinds and
//! strengths are uniform. A simulation without discrepancy loses little by that; one with discrepancy gets
//! wider posteriors.
//!
//! Source: Kennedy and O'Hagan, J. R. Stat. Soc. B 63 (2001) 425; Tierney and Kadane, J. Am. Stat. Assoc. 81
//! (1986) 82.
//!
//! Differences from the source: basis functions of fixed widths replace a Gaussian process. Poorly identified
//! directions are dropped, which understates their variance in sampled fields. Implausible kinds and strengths
//! are excluded at the fit.

use std::ops::Range;

use nalgebra::{DMatrix, DVector};
use rand_distr::{Distribution, StandardNormal};
use serde::{Deserialize, Serialize};

use super::whitened::WhitenedGroup;
use crate::error::Result;
use crate::estimate::sampler::{log_sum_exp, sample_categorical};
use crate::inference::field::FieldInputs;
use crate::inference::mixed_model::group_statistics::SCALE_DOF;
use crate::progress::Progress;
use crate::rng::Stream;

/// Standard deviations of coefficients, m/s^2.
const COEFFICIENT_SDS: [f64; 5] = [0.05, 0.2, 0.6, 2.0, 6.0];
/// Maximum number of directions per kind.
const MAX_DIRECTIONS: usize = 40;
/// Minimum information of a direction, relative to the prior of the strongest field.
const MIN_INFORMATION: f64 = 1e-2;
/// Iterations of reweighted least squares.
const IRLS_ROUNDS: usize = 3;
/// Log density gap to the best field, nats, above which a field is excluded.
const MAX_LOG_DENSITY_GAP: f64 = 25.0;

/// A kind of discrepancy field and the standard deviation of its coefficients, m/s^2 (for a sampled field the
/// root mean square over draws); strength 0 means no field.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct DiscrepancyField {
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub over: Option<FieldInputs>,
    pub strength: f64,
}

/// Range of basis functions of each kind of field.
pub type FieldRanges = Vec<(FieldInputs, Range<usize>)>;

/// Mixture over discrepancy fields.
pub struct FieldMixture {
    kinds: Vec<FieldKind>,
    /// Candidate fields: index of the kind, strength and log prior probability.
    candidates: Vec<(usize, f64, f64)>,
    /// Log prior probability of no field.
    log_prior_none: f64,
}

/// A kind of field in its identified directions.
struct FieldKind {
    over: FieldInputs,
    /// Range of its basis functions.
    range: Range<usize>,
    /// Directions, by basis function.
    directions: DMatrix<f64>,
    /// Information of each direction at the fit.
    information: DVector<f64>,
    /// By group: weight, and Jacobian with respect to the directions.
    groups: Vec<(f64, DMatrix<f64>)>,
}

impl FieldMixture {
    /// From groups with Jacobians with respect to all basis functions; `kinds`: their ranges.
    pub fn new(
        groups: &[WhitenedGroup],
        kinds: &[(FieldInputs, Range<usize>)],
        progress: &dyn Progress,
    ) -> Result<FieldMixture> {
        let log_prior_none = if kinds.is_empty() { 0.0 } else { libm::log(0.5) };
        let kind = |(over, range): &(FieldInputs, Range<usize>)| {
            FieldKind::new(groups, *over, range, None, progress)
        };
        let kinds = kinds.iter().map(kind).collect::<Result<Vec<_>>>()?;
        let residuals: Vec<DVector<f64>> = groups.iter().map(|p| p.residual.clone()).collect();
        let each = libm::log(0.5 / (kinds.len() * COEFFICIENT_SDS.len()).max(1) as f64);
        let all = (0..kinds.len()).flat_map(|k| COEFFICIENT_SDS.map(|s| (k, s, each)));
        let mut found = FieldMixture { candidates: all.collect(), kinds, log_prior_none };
        let densities = found.log_likelihoods(groups, &residuals);
        let best = densities.iter().copied().fold(f64::NEG_INFINITY, f64::max);
        let mut is_plausible = densities.iter().skip(1).map(|d| best - d < MAX_LOG_DENSITY_GAP);
        found.candidates.retain(|_| is_plausible.next().unwrap_or(false));
        Ok(found)
    }

    /// The same fields for groups with another covariance.
    pub fn with_groups(&self, groups: &[WhitenedGroup], progress: &dyn Progress) -> Result<FieldMixture> {
        let anew = |kind: &FieldKind| -> Result<FieldKind> {
            let found = FieldKind::new(groups, kind.over, &kind.range, Some(&kind.directions), progress)?;
            Ok(FieldKind { directions: &kind.directions * &found.directions, ..found })
        };
        Ok(FieldMixture {
            kinds: self.kinds.iter().map(anew).collect::<Result<_>>()?,
            candidates: self.candidates.clone(),
            log_prior_none: self.log_prior_none,
        })
    }

    /// Number of stored floats.
    pub fn stored_floats(&self) -> usize {
        self.kinds.iter().flat_map(|k| &k.groups).map(|(_, columns)| columns.len()).sum()
    }

    /// Candidate fields, no field first.
    pub fn fields(&self) -> Vec<DiscrepancyField> {
        let of = |(k, strength, _): &(usize, f64, f64)| DiscrepancyField {
            over: Some(self.kinds[*k].over),
            strength: *strength,
        };
        [DiscrepancyField { over: None, strength: 0.0 }]
            .into_iter()
            .chain(self.candidates.iter().map(of))
            .collect()
    }

    /// Log of prior probability times likelihood of residuals, by field; minus infinity for a diverged
    /// simulation.
    pub fn log_likelihoods(&self, groups: &[WhitenedGroup], residuals: &[DVector<f64>]) -> Vec<f64> {
        let density =
            |(part, residuals): (&WhitenedGroup, &DVector<f64>)| part.log_density(residuals.norm_squared());
        let mut out = vec![self.log_prior_none + groups.iter().zip(residuals).map(density).sum::<f64>()];
        let mut score: Vec<Option<DVector<f64>>> = vec![None; self.kinds.len()];
        for (k, strength, log_prior) in &self.candidates {
            let kind = &self.kinds[*k];
            let score = score[*k].get_or_insert_with(|| kind.score(residuals));
            out.push(log_prior + kind.log_likelihood(groups, residuals, score, *strength));
        }
        out
    }

    /// Samples a field given residuals at a point: index of its kind and its coefficients, m/s^2; `None` for no
    /// field. The kind is drawn by its posterior probability and the coefficients from their Laplace
    /// approximation; unidentified directions are zero. `by_field`: log likelihoods at the point.
    pub fn sample(
        &self,
        residuals: &[DVector<f64>],
        by_field: &[f64],
        stream: &mut Stream,
    ) -> Option<(usize, DVector<f64>)> {
        let (kind, strength, _) =
            *self.candidates.get(sample_categorical(by_field, stream)?.checked_sub(1)?)?;
        let group_columns = &self.kinds[kind];
        let mut coefficients = group_columns.coefficients(&group_columns.score(residuals), strength);
        for (k, a) in coefficients.iter_mut().enumerate() {
            let z: f64 = StandardNormal.sample(stream);
            *a += z * strength / (1.0 + strength.powi(2) * group_columns.information[k]).sqrt();
        }
        Some((kind, &group_columns.directions * coefficients))
    }

    /// Posterior probability of every field, averaged over posterior draws.
    pub fn probabilities(&self, by_point: &[Vec<f64>]) -> Vec<f64> {
        let mut out = vec![0.0; 1 + self.candidates.len()];
        for of in by_point {
            let all = log_sum_exp(of.iter().copied());
            out.iter_mut().zip(of).for_each(|(sum, l)| *sum += libm::exp(l - all) / by_point.len() as f64);
        }
        out
    }
}

impl FieldKind {
    /// A kind of field from its basis functions, optionally restricted to given directions.
    fn new(
        groups: &[WhitenedGroup],
        over: FieldInputs,
        range: &Range<usize>,
        coefficients: Option<&DMatrix<f64>>,
        progress: &dyn Progress,
    ) -> Result<FieldKind> {
        let by = |part: &WhitenedGroup| {
            let group_columns = part.field_jacobian.columns(range.start, range.len());
            coefficients.map_or_else(|| group_columns.into_owned(), |directions| group_columns * directions)
        };
        let columns: Vec<DMatrix<f64>> = groups.iter().map(by).collect();
        let mut weights = vec![1.0; groups.len()];
        let mut found = FieldKind::diagonalise(&columns, &weights, over, range, progress)?;
        let group_columns: Vec<DVector<f64>> = groups.iter().map(|p| p.residual.clone()).collect();
        for _ in 0..IRLS_ROUNDS {
            let score = found.score(&group_columns);
            let density = |s: &f64| found.log_likelihood(groups, &group_columns, &score, *s);
            let best = COEFFICIENT_SDS
                .into_iter()
                .max_by(|a, b| density(a).total_cmp(&density(b)))
                .unwrap_or(COEFFICIENT_SDS[0]);
            let field = found.coefficients(&score, best);
            for ((weight, (_, columns)), residuals) in
                weights.iter_mut().zip(&found.groups).zip(&group_columns)
            {
                let n = residuals.len() as f64;
                let square = (residuals - columns * &field).norm_squared();
                *weight = (SCALE_DOF + n) / (SCALE_DOF + square);
            }
            found = FieldKind::diagonalise(&columns, &weights, over, range, progress)?;
        }
        Ok(found)
    }

    /// Rotates the basis to directions with diagonal information.
    fn diagonalise(
        by: &[DMatrix<f64>],
        weights: &[f64],
        over: FieldInputs,
        range: &Range<usize>,
        progress: &dyn Progress,
    ) -> Result<FieldKind> {
        let count = by.first().map_or(0, DMatrix::ncols);
        let mut gram = DMatrix::zeros(count, count);
        for (group_columns, weight) in by.iter().zip(weights) {
            progress.check_stop()?;
            gram += group_columns.tr_mul(group_columns) * *weight;
        }
        let eigen = gram.symmetric_eigen();
        let strongest = COEFFICIENT_SDS[COEFFICIENT_SDS.len() - 1];
        let is_identified = |k: &usize| eigen.eigenvalues[*k] * strongest.powi(2) > MIN_INFORMATION;
        let mut order: Vec<usize> = (0..count).filter(is_identified).collect();
        order.sort_by(|a, b| eigen.eigenvalues[*b].total_cmp(&eigen.eigenvalues[*a]).then(a.cmp(b)));
        order.truncate(MAX_DIRECTIONS);
        let directions = eigen.eigenvectors.select_columns(&order);
        let turned = |(group_columns, weight): (&DMatrix<f64>, &f64)| {
            progress.check_stop().map(|()| (*weight, group_columns * &directions))
        };
        Ok(FieldKind {
            over,
            range: range.clone(),
            information: DVector::from_fn(order.len(), |k, _| eigen.eigenvalues[order[k]]),
            groups: by.iter().zip(weights).map(turned).collect::<Result<_>>()?,
            directions,
        })
    }

    /// Weighted score of the coefficients, Z' w r.
    fn score(&self, residuals: &[DVector<f64>]) -> DVector<f64> {
        let mut score = DVector::zeros(self.information.len());
        for ((weight, columns), residuals) in self.groups.iter().zip(residuals) {
            score.gemv_tr(*weight, columns, residuals, 1.0);
        }
        score
    }

    /// Posterior mode of the coefficients for a strength.
    fn coefficients(&self, score: &DVector<f64>, strength: f64) -> DVector<f64> {
        let variance = strength.powi(2);
        let room = |k: usize| 1.0 + variance * self.information[k];
        DVector::from_fn(score.len(), |k, _| variance * score[k] / room(k))
    }

    fn log_likelihood(
        &self,
        groups: &[WhitenedGroup],
        residuals: &[DVector<f64>],
        score: &DVector<f64>,
        strength: f64,
    ) -> f64 {
        let field = self.coefficients(score, strength);
        let mut group_columns = -0.5 * field.norm_squared() / strength.powi(2);
        for ((part, residuals), (_, columns)) in groups.iter().zip(residuals).zip(&self.groups) {
            let mut rest = residuals.clone();
            rest.gemv(-1.0, columns, &field, 1.0);
            group_columns += part.log_density(rest.norm_squared());
        }
        let room = |i: &f64| libm::log1p(strength.powi(2) * i);
        group_columns - 0.5 * self.information.iter().map(room).sum::<f64>()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::progress::NoProgress;

    /// Groups of six residuals and one basis function with coefficient `amount`.
    fn synthetic_groups(amount: f64) -> Vec<WhitenedGroup> {
        let wave = |k: usize| libm::sin(1.7 * k as f64 + 0.4);
        let part = |p: usize| {
            let field = DMatrix::from_fn(6, 1, |i, _| 3.0 * wave(7 * p + i));
            let noise = DVector::from_fn(6, |i, _| 1.3 * wave(311 * p + 17 * i * i));
            WhitenedGroup {
                residual: noise + field.column(0) * amount,
                jacobian: DMatrix::zeros(6, 0),
                field_jacobian: field,
                log_det: 0.0,
            }
        };
        (0..20).map(part).collect()
    }

    fn residuals(groups: &[WhitenedGroup]) -> Vec<DVector<f64>> {
        groups.iter().map(|p| p.residual.clone()).collect()
    }

    fn fitted_mixture(groups: &[WhitenedGroup]) -> FieldMixture {
        FieldMixture::new(groups, &[(FieldInputs::Place, 0..1)], &NoProgress).unwrap()
    }

    /// Without discrepancy no field is most likely; with a strong one it is impossible.
    #[test]
    fn detects_a_field_from_residuals() {
        let of = |amount: f64| {
            let groups = synthetic_groups(amount);
            let found = fitted_mixture(&groups);
            let all = found.log_likelihoods(&groups, &residuals(&groups));
            (found.fields(), found.probabilities(&[all]))
        };
        let (fields, nothing) = of(0.0);
        assert!(
            nothing[0] > 0.5 && fields[0] == DiscrepancyField { over: None, strength: 0.0 },
            "{nothing:?}"
        );
        let (fields, much) = of(2.0);
        let most = (0..much.len()).max_by(|a, b| much[*a].total_cmp(&much[*b])).unwrap();
        assert!(much[0] < 1e-6 && fields[most].strength >= 0.6, "{much:?}");
        assert!((much.iter().sum::<f64>() - 1.0).abs() < 1e-9);
    }

    /// Laplace's method matches numerical integration for one basis function.
    #[test]
    fn laplace_matches_numerical_integral() {
        for amount in [0.0, 0.6] {
            let groups = synthetic_groups(amount);
            let found = fitted_mixture(&groups);
            let all = found.log_likelihoods(&groups, &residuals(&groups));
            for (field, density) in found.fields().iter().zip(&all).skip(1) {
                let n = 4001;
                let at = |i: usize| field.strength * 8.0 * (2.0 * i as f64 / (n - 1) as f64 - 1.0);
                let of = |a: f64| {
                    let group_columns = groups
                        .iter()
                        .map(|p| p.log_density((&p.residual - &p.field_jacobian * a).norm_squared()));
                    let normal =
                        -0.5 * (a / field.strength).powi(2) - libm::log(field.strength * 2.506_628_274_631);
                    group_columns.sum::<f64>() + normal
                };
                let logs: Vec<f64> = (0..n).map(|i| of(at(i))).collect();
                let wanted = log_sum_exp(logs.iter().copied()) + libm::log(at(1) - at(0)) + libm::log(0.1);
                assert!((density - wanted).abs() < 0.12, "{field:?}: {density} for {wanted}");
            }
        }
    }

    /// Sampled coefficients have the posterior's mean and sd from a grid; no field is sampled if it is certain
    /// that there is none.
    #[test]
    fn samples_match_grid_posterior() {
        let groups = synthetic_groups(2.0);
        let found = fitted_mixture(&groups);
        let residuals = residuals(&groups);
        let by_field = found.log_likelihoods(&groups, &residuals);
        let mut stream = crate::rng::stream(4, "test");
        let drawn: Vec<f64> = (0..4000)
            .map(|_| found.sample(&residuals, &by_field, &mut stream).expect("no field is impossible").1[0])
            .collect();
        let n = 4001;
        let at = |i: usize| 1.0 + 2.0 * i as f64 / (n - 1) as f64;
        let of = |a: f64| {
            let group_columns = groups
                .iter()
                .map(|p| p.log_density((&p.residual - &p.field_jacobian * a).norm_squared()))
                .sum::<f64>();
            let log_prior = COEFFICIENT_SDS.map(|s| -0.5 * (a / s).powi(2) - libm::log(s));
            group_columns + log_sum_exp(log_prior)
        };
        let logs: Vec<f64> = (0..n).map(|i| of(at(i))).collect();
        let all = log_sum_exp(logs.iter().copied());
        let moment = |power: i32, about: f64| {
            let of = |i: usize| libm::exp(logs[i] - all) * (at(i) - about).powi(power);
            (0..n).map(of).sum::<f64>()
        };
        let mean = moment(1, 0.0);
        let sd = moment(2, mean).sqrt();
        let group_columns = drawn.iter().sum::<f64>() / drawn.len() as f64;
        let spread =
            (drawn.iter().map(|a| (a - group_columns).powi(2)).sum::<f64>() / drawn.len() as f64).sqrt();
        assert!((group_columns - mean).abs() < 0.3 * sd, "{group_columns} for {mean} +- {sd}");
        assert!((spread / sd - 1.0).abs() < 0.2, "{spread} for {sd}");
        let never = vec![f64::NEG_INFINITY; by_field.len() - 1];
        let log_prior_none: Vec<f64> = [0.0].into_iter().chain(never).collect();
        assert_eq!(found.sample(&residuals, &log_prior_none, &mut stream), None);
    }

    #[test]
    fn no_basis_means_no_field() {
        let groups = synthetic_groups(1.0);
        let found = FieldMixture::new(&groups, &[], &NoProgress).unwrap();
        let all = found.log_likelihoods(&groups, &residuals(&groups));
        let group_columns: f64 = groups.iter().map(|p| p.log_density(p.residual.norm_squared())).sum();
        assert_eq!(all, [group_columns]);
    }
}
