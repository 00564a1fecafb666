//! A discrepancy field that is part of the model: its coefficients are sampled with the parameters and
//! simulated at every point.
//!
//! A point has the field's coefficients, m/s^2, after the model's parameters. Their prior is a scale mixture of
//! normals with four standard deviations: most coefficients are small, some are not.
//!
//! Differences from Kennedy and O'Hagan (2001): the field is a force and not an offset of the observations, so
//! it persists through contacts. Its prior is heavy-tailed, as in sparse regression (Carvalho, Polson and
//! Scott, Biometrika 97 (2010) 465), because discrepancy is mostly one simple law.

use nalgebra::{DMatrix, DVector};

use super::basis_field::BasisField;
use super::discrepancy::DiscrepancyField;
use super::whitened::WhitenedGroup;
use crate::estimate::discrepancy_forces::DiscrepancyForces;
use crate::estimate::sampler::Marginal;
use crate::inference::mixed_model::group_statistics::SCALE_DOF;
use crate::inference::model::ParameterLayout;
use crate::world::ParameterVector;

/// Standard deviations of the mixture, and bound of a coefficient, m/s^2.
const COEFFICIENT_SDS: [f64; 4] = [0.6, 2.0, 6.0, 20.0];
const MAX_COEFFICIENT: f64 = 100.0;

/// Iterations of reweighted least squares for the mode.
const IRLS_ROUNDS: usize = 4;

/// Prior of a coefficient.
pub const SCALE_MIXTURE_PRIOR: Marginal =
    Marginal::Scales { mean: 0.0, sds: COEFFICIENT_SDS, low: -MAX_COEFFICIENT, high: MAX_COEFFICIENT };

/// A sampled field.
pub struct SampledField {
    /// The field at the fit.
    basis: BasisField,
    /// Number of model parameters, which precede the coefficients in a point.
    parameter_count: usize,
    /// Step from the fit to the posterior mode of the linearised model.
    step: DVector<f64>,
    covariance: DMatrix<f64>,
}

impl SampledField {
    /// Linearises the posterior of parameters and coefficients from whitened groups; `None` if a covariance
    /// fails. `precision`: prior precision of the parameters.
    pub fn new(
        groups: &[WhitenedGroup],
        basis: &BasisField,
        precision: &DMatrix<f64>,
    ) -> Option<SampledField> {
        let (parameter_count, functions) = (precision.nrows(), basis.coefficients.len());
        let all = parameter_count + functions;
        let mut prior_precision =
            DMatrix::from_diagonal_element(all, all, SCALE_MIXTURE_PRIOR.centre_and_sd()[1].powi(-2));
        prior_precision.view_mut((0, 0), (parameter_count, parameter_count)).copy_from(precision);
        let prior_offset = DVector::from_fn(all, |k, _| {
            if k < parameter_count { 0.0 } else { -basis.coefficients[k - parameter_count] }
        });
        let jacobians = |group: &WhitenedGroup| {
            let mut jacobians = group.jacobian.clone().resize_horizontally(all, 0.0);
            jacobians.columns_mut(parameter_count, functions).copy_from(&group.field_jacobian);
            jacobians
        };
        let jacobians: Vec<DMatrix<f64>> = groups.iter().map(jacobians).collect();
        let (mut step, mut covariance) = (DVector::zeros(all), DMatrix::zeros(0, 0));
        for _ in 0..IRLS_ROUNDS {
            let (mut gram, mut score) = (prior_precision.clone(), &prior_precision * &prior_offset);
            for (group, jacobians) in groups.iter().zip(&jacobians) {
                let square = (&group.residual - jacobians * &step).norm_squared();
                let weight = (SCALE_DOF + group.residual.len() as f64) / (SCALE_DOF + square);
                gram += jacobians.tr_mul(jacobians) * weight;
                score.gemv_tr(weight, jacobians, &group.residual, 1.0);
            }
            let factor = gram.cholesky()?;
            step = factor.solve(&score);
            covariance = factor.inverse();
        }
        Some(SampledField { basis: basis.clone(), parameter_count, step, covariance })
    }

    /// Coefficients at the fit.
    pub fn coefficients(&self) -> &[f64] {
        &self.basis.coefficients
    }

    /// Posterior mode of the linearised model, and its covariance.
    pub fn posterior_mode(&self, values: &[f64]) -> (Vec<f64>, &DMatrix<f64>) {
        let from = values.iter().chain(&self.basis.coefficients);
        (from.zip(self.step.iter()).map(|(v, step)| v + step).collect(), &self.covariance)
    }

    /// The field at a point.
    fn field_at(&self, point: &[f64]) -> BasisField {
        self.basis.with_coefficients(point[self.parameter_count..].to_vec())
    }

    /// The model's layout with the field of a point.
    pub fn layout(&self, layout: &ParameterLayout, point: &[f64]) -> ParameterLayout {
        self.field_at(point).replacing(layout)
    }

    /// Kind of the field, and root mean square of its coefficients over points, m/s^2.
    pub fn summary(&self, points: &[ParameterVector]) -> DiscrepancyField {
        let all = points.iter().flat_map(|p| &p[self.parameter_count..]);
        let (n, sum) = all.fold((0usize, 0.0), |(n, sum), b| (n + 1, sum + b * b));
        DiscrepancyField { over: Some(self.basis.over), strength: (sum / n.max(1) as f64).sqrt() }
    }

    /// Forces of the field at points.
    pub fn forces(&self, points: &[ParameterVector]) -> DiscrepancyForces {
        let nothing = DVector::zeros(self.basis.coefficients.len());
        let amplitudes = points.iter().map(|p| self.field_at(p).amplitudes(&nothing)).collect();
        DiscrepancyForces {
            effects: self.basis.effect_terms(),
            draws: (0..points.len()).collect(),
            amplitudes,
        }
    }
}

#[cfg(test)]
mod tests {
    use rand::RngExt as _;

    use super::*;
    use crate::inference::posterior::basis_field::monomials;
    use crate::inference::testing::segments::term;
    use crate::rng;

    /// Groups of six residuals that are linear in one parameter and the field's coefficients, almost without
    /// noise.
    fn synthetic_groups(basis: &BasisField, truth: &[f64]) -> Vec<WhitenedGroup> {
        let functions = basis.coefficients.len();
        let mut stream = rng::stream(1, "parts");
        let mut group = |_| {
            let mut random =
                |columns: usize| DMatrix::from_fn(6, columns, |_, _| 50.0 * (stream.random::<f64>() - 0.5));
            let (jacobian, field) = (random(1), random(functions));
            let residual = &jacobian * truth[0] + &field * DVector::from_column_slice(&truth[1..]);
            WhitenedGroup { residual, jacobian, field_jacobian: field, log_det: 0.0 }
        };
        (0..40).map(&mut group).collect()
    }

    /// For a linear model the mode is the truth, independently of the fit.
    #[test]
    fn mode_recovers_linear_truth() {
        let basis = monomials(&[vec![[2.0, -1.0, 3.0, 4.0]]]);
        let mut truth = vec![0.0; 1 + basis.coefficients.len()];
        (truth[0], truth[7], truth[10]) = (0.3, -1.5, -4.0);
        let found =
            SampledField::new(&synthetic_groups(&basis, &truth), &basis, &DMatrix::from_element(1, 1, 1e-6))
                .unwrap();
        let (at, covariance) = found.posterior_mode(&[0.5]);
        assert_eq!((at.len(), covariance.nrows()), (truth.len(), truth.len()));
        assert!(
            (at[0] - 0.8).abs() < 1e-3 && (at[7] + 1.5).abs() < 0.01 && (at[10] + 4.0).abs() < 0.01,
            "{at:?}"
        );
        assert!((0..truth.len()).all(|k| covariance[(k, k)] > 0.0 && covariance[(k, k)] < 0.01));
    }

    /// A point's field replaces the fit's after the named effects.
    #[test]
    fn layout_uses_the_field_of_a_point() {
        let basis = monomials(&[vec![[2.0, -1.0, 3.0, 4.0]]]);
        let named = ParameterLayout::new(&[1], vec![term("quadratic_drag")], 1);
        let layout = basis.appended_to(&named.terms, &named, 1);
        let parameter_count = layout.parameters.len();
        let along =
            SampledField::new(&[], &basis, &DMatrix::identity(parameter_count, parameter_count)).unwrap();
        let mut point = vec![0.0; parameter_count + basis.coefficients.len()];
        (point[0], point[parameter_count + 2]) = (0.7, 0.4);
        let own = along.layout(&layout, &point);
        assert_eq!((own.terms.len(), own.parameters.len()), (layout.terms.len(), parameter_count));
        assert_eq!(
            (own.terms[0].effect.name, own.terms[2].start[0]),
            ("quadratic_drag", 0.2),
            "0.4 m/s^2 at 2 m"
        );
        assert_eq!(layout.terms[2].start[0], 0.0);
        let forces = along.forces(&[point.clone(), point.clone()]);
        assert_eq!((forces.draws, forces.amplitudes[1][2]), (vec![0, 1], 0.2));
        let strength = along.summary(&[point]).strength;
        assert!((strength - 0.4 / (basis.coefficients.len() as f64).sqrt()).abs() < 1e-12, "{strength}");
    }
}
