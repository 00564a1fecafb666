//! Predictive standard deviations of residuals.
//!
//! They include noise, trial discrepancy, random accelerations and scales, impact errors, and parameter
//! uncertainty, at the usual scale of a trial. Nuisances are fitted to the data; with P the projector on
//! their complement, var r = diag(P N P') + sum over columns c of variance c^2, the columns already
//! projected.

use nalgebra::{DMatrix, DVector};

use crate::error::Result;
use crate::inference::data::noise::Noise;
use crate::inference::kernels;
use crate::inference::mixed_model::coordinates::SegmentCoordinates;
use crate::inference::mixed_model::fitted_model::ModelView;
use crate::inference::mixed_model::group_statistics::VarianceComponents;
use crate::inference::mixed_model::groups::impact_error_response;
use crate::inference::mixed_model::model_fit::ModelFitter;
use crate::inference::mixed_model::random_design::RandomDesign;
use crate::inference::model::Linearization;
use crate::inference::segment::Segment;
use crate::inference::statistics::pseudo_inverse;

/// Predictive standard deviations of residuals by segment and observation along x and y, m; NaN for unused
/// observations. `linearizations`: linearizations with accelerations after the parameters; `known`: covariance of the
/// first parameters.
pub fn predictive_sds(
    fitter: &ModelFitter,
    model: ModelView,
    linearizations: &[Linearization],
    components: &VarianceComponents,
    known: &DMatrix<f64>,
    noise: &Noise,
) -> Result<Vec<Vec<[f64; 2]>>> {
    let columns = RandomDesign::of(model.layout, &model.state.values, fitter.gravity);
    let of = |w: usize, segment: &Segment| {
        let scale = fitter.scales[w];
        if !scale.is_finite() {
            return vec![[f64::NAN; 2]; segment.observations.len()];
        }
        let (linearization, coordinates) = (&linearizations[w], &fitter.coordinates[w]);
        let total = NuisanceProjector::of(&linearization.nuisance_jacobian);
        let mut variance =
            total.noise_variance(segment, coordinates, linearization, scale, components.discrepancy, noise);
        add_parameter_variance(
            &mut variance,
            segment,
            coordinates,
            linearization,
            &columns,
            components,
            known,
        );
        if segment.kind.is_impact() {
            for way in 0..2 {
                let error = DVector::from_fn(variance.len(), |i, _| {
                    impact_error_response(segment, linearization, linearization.impact, way, i)
                });
                let error = total.project(&error) * components.impact;
                variance += error.component_mul(&error);
            }
        }
        let metres = |i: usize| {
            variance[i].max(0.0).sqrt() / (linearization.irls_scale * linearization.weights[i / 2])
        };
        let one = |i: usize| match linearization.weights[i] > 0.0 {
            true => [metres(2 * i), metres(2 * i + 1)],
            false => [f64::NAN; 2],
        };
        (0..segment.observations.len()).map(one).collect()
    };
    fitter.data.each_segment(of)
}

/// Adds the variances of random effects and of parameters.
fn add_parameter_variance(
    variance: &mut DVector<f64>,
    segment: &Segment,
    coordinates: &SegmentCoordinates,
    linearization: &Linearization,
    columns: &RandomDesign,
    components: &VarianceComponents,
    known: &DMatrix<f64>,
) {
    let flies = segment.kind.is_airborne();
    let mut add = |of: &[(usize, f64)], sd: f64| {
        let total = of.iter().fold(DVector::zeros(linearization.jacobian.nrows()), |all, (c, size)| {
            all + linearization.jacobian.column(*c) * (*size * sd)
        });
        *variance += total.component_mul(&total);
    };
    if !segment.kind.uses_engine() {
        columns.amplitude_directions.iter().for_each(|sizes| add(sizes, components.scale));
    }
    if flies {
        let accelerations = columns.accelerations.iter().enumerate();
        accelerations.for_each(|(k, (place, _))| {
            add(&[(columns.parameter_count + k, 1.0)], components.accelerations[*place])
        });
        let renewed = columns.contact_resets.iter().filter(|_| coordinates.may_be_reset_by_contact(segment));
        renewed.for_each(|(c, plausible)| add(&[(*c, 1.0)], *plausible));
    }
    let count = known.nrows().min(columns.parameter_count);
    let known_columns = linearization.jacobian.columns(0, count);
    let within = known_columns * known.view((0, 0), (count, count));
    for i in 0..variance.len() {
        variance[i] += within.row(i).dot(&known_columns.row(i));
    }
}

/// Projector on the complement of the nuisances.
struct NuisanceProjector<'a> {
    columns: &'a DMatrix<f64>,
    inverse: DMatrix<f64>,
}

impl<'a> NuisanceProjector<'a> {
    fn of(columns: &'a DMatrix<f64>) -> NuisanceProjector<'a> {
        NuisanceProjector { columns, inverse: pseudo_inverse(&columns.tr_mul(columns)) }
    }

    fn project(&self, of: &DVector<f64>) -> DVector<f64> {
        of - self.columns * (&self.inverse * self.columns.tr_mul(of))
    }

    /// Variances of projected noise and trial discrepancy, rows as in the linearization.
    fn noise_variance(
        &self,
        segment: &Segment,
        coordinates: &SegmentCoordinates,
        linearization: &Linearization,
        scale: f64,
        slow: f64,
        noise: &Noise,
    ) -> DVector<f64> {
        let n = segment.observations.len();
        let rho = if segment.kind.uses_engine() { 0.0 } else { noise.rho };
        let sizes: Vec<f64> = segment.observations.iter().map(|p| p.weight).collect();
        let misfit = coordinates.gp_covariance_at_observations().filter(|_| slow > 0.0);
        let within = |correlated: DMatrix<f64>| {
            let noise = kernels::autoregressive(rho, &sizes, &correlated);
            match &misfit {
                Some((half, basis)) => noise + basis.tr_mul(&(half * correlated)) * (slow * slow),
                None => noise,
            }
        };
        // Variance of a row: noise and trial discrepancy.
        let variance = |i: usize| {
            let misfit = misfit.as_ref().map_or(0.0, |(half, basis)| half.column(i).dot(&basis.column(i)));
            kernels::block_variance(rho, sizes[i]) + misfit * slow * slow
        };
        // Rows are deviations, in units of their own noise, over this.
        let unit = |i: usize| f64::from(sizes[i] > 0.0) * linearization.irls_scale / scale;
        let rows = linearization.nuisance_jacobian.nrows();
        let k = linearization.nuisance_jacobian.ncols();
        // N S, axis by axis; pseudo-observations are independent.
        let mut projected = DMatrix::zeros(rows, k);
        for axis in 0..2 {
            let correlated = DMatrix::from_fn(n, k, |i, c| self.columns[(2 * i + axis, c)] * unit(i));
            let correlated = within(correlated);
            (0..n).for_each(|i| {
                (0..k).for_each(|c| projected[(2 * i + axis, c)] = unit(i) * correlated[(i, c)])
            });
        }
        let held = linearization.irls_scale * linearization.irls_scale;
        (2 * n..rows).for_each(|i| (0..k).for_each(|c| projected[(i, c)] = held * self.columns[(i, c)]));
        let taken = self.columns * &self.inverse;
        let both = &taken * self.columns.tr_mul(&projected);
        DVector::from_fn(rows, |i, _| {
            let total = if i < 2 * n { unit(i / 2).powi(2) * variance(i / 2) } else { held };
            total - 2.0 * projected.row(i).dot(&taken.row(i)) + both.row(i).dot(&taken.row(i))
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::inference::testing::throws::{self, NOISE};

    fn of(
        fitter: &ModelFitter,
        f: &crate::inference::mixed_model::fitted_model::FittedModel,
        components: &VarianceComponents,
    ) -> Vec<Vec<[f64; 2]>> {
        let (linearizations, _) = fitter.groups(&f.layout, &f.state, &[]).unwrap().unwrap();
        let noise = Noise { sd: NOISE, rho: 0.0, degrees_of_freedom: 1e3 };
        predictive_sds(fitter, f.view(), &linearizations, components, &f.covariance, &noise).unwrap()
    }

    /// With noise alone the nuisances take two degrees of freedom per axis.
    #[test]
    fn nuisances_take_four_degrees_of_freedom() {
        throws::with_fit(&[1e-6; 6], &[], 8, |fitter, f| {
            let none =
                VarianceComponents { discrepancy: 0.0, impact: 0.0, scale: 0.0, accelerations: vec![0.0; 3] };
            for (segment, band) in fitter.data.segments.iter().zip(of(fitter, f, &none)) {
                let all: f64 = band.iter().flatten().map(|sd| (sd / NOISE).powi(2)).sum();
                assert!((all - (2.0 * segment.observations.len() as f64 - 4.0)).abs() < 1e-3, "{all}");
            }
        });
    }

    /// Residuals agree with their predictive standard deviations.
    #[test]
    fn residuals_match_their_predictive_sd() {
        let drags = [0.32, 0.48, 0.36, 0.46, 0.38, 0.34, 0.43, 0.49];
        throws::with_fit(&drags, &["linear_drag"], 9, |fitter, f| {
            let bands = of(fitter, f, &f.components);
            let pairs = bands.iter().zip(&f.evaluation.residuals);
            let square = |(band, left): (&Vec<[f64; 2]>, &Vec<f64>)| -> f64 {
                band.iter().flatten().zip(left).map(|(sd, r)| (r / sd).powi(2)).sum::<f64>()
                    / left.len() as f64
            };
            let mean = pairs.map(square).sum::<f64>() / 8.0;
            assert!((0.3..2.0).contains(&mean), "{mean}");
        });
    }
}
