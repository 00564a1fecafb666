//! How far from its path an observation is predicted to lie: the standard deviation of every residual that a picture shows.
//!
//! What the score has of a launch (`score`), at the points themselves: noise, slow misfit, pushes, sizes by launch, errors of
//! contacts, and what is known of the sizes, the launch's own scale being the usual one. Its start is fitted to what was
//! seen, and what that takes up is projected out as it is of the residual: with P the projector,
//! var r = diag(P N P') + sum over columns c of variance c^2, the columns projected already.

use nalgebra::{DMatrix, DVector};

use super::columns::RandomDesign;
use super::fit::{ModelFitter, ModelView};
use super::gaussian::VarianceComponents;
use super::launch::{BasisCache, impact_error_response};
use super::model::Linearization;
use super::noise::{self, Noise};
use super::stats::pseudo_inverse;
use super::window::{Segment, SegmentKind};

/// Standard deviations of residuals by window and point along x and y, m; not a number where an observation does not count.
/// `looks` of the model, its pushes after its slots; what its slots are known by may leave out the last.
pub fn predictive_sds(
    fitter: &ModelFitter,
    model: ModelView,
    looks: &[Linearization],
    components: &VarianceComponents,
    known: &DMatrix<f64>,
    noise: &Noise,
) -> Vec<Vec<[f64; 2]>> {
    let columns = RandomDesign::of(model.layout, &model.state.values, fitter.gravity);
    let windows = fitter.data.segments;
    let of = |(w, window): (usize, &Segment)| {
        let scale = fitter.scales[w];
        if !scale.is_finite() {
            return vec![[f64::NAN; 2]; window.observations.len()];
        }
        let (look, frame) = (&looks[w], &fitter.basis_caches[w]);
        let own = NuisanceProjector::of(&look.nuisance_jacobian);
        let mut variance = own.noise_variance(window, frame, look, scale, components.discrepancy, noise);
        add_parameter_variance(&mut variance, window, frame, look, &columns, components, known);
        if let (SegmentKind::Contact, Some(_)) = (window.kind, &window.surface) {
            for way in 0..2 {
                let error = DVector::from_fn(variance.len(), |i, _| {
                    impact_error_response(window, look, look.impact, way, i)
                });
                let error = own.project(&error) * components.impact;
                variance += error.component_mul(&error);
            }
        }
        let metres = |i: usize| variance[i].max(0.0).sqrt() / (look.irls_scale * look.weights[i / 2]);
        let one = |i: usize| match look.weights[i] > 0.0 {
            true => [metres(2 * i), metres(2 * i + 1)],
            false => [f64::NAN; 2],
        };
        (0..window.observations.len()).map(one).collect()
    };
    windows.iter().enumerate().map(of).collect()
}

/// Adds what columns make of the variances of a launch's sizes and pushes, and of what is known of the model's.
fn add_parameter_variance(
    variance: &mut DVector<f64>,
    window: &Segment,
    frame: &BasisCache,
    look: &Linearization,
    columns: &RandomDesign,
    components: &VarianceComponents,
    known: &DMatrix<f64>,
) {
    let flies = matches!(window.kind, SegmentKind::Flight | SegmentKind::Contact);
    let mut add = |of: &[(usize, f64)], sd: f64| {
        let own = of.iter().fold(DVector::zeros(look.jacobian.nrows()), |all, (c, size)| {
            all + look.jacobian.column(*c) * (*size * sd)
        });
        *variance += own.component_mul(&own);
    };
    if !window.kind.uses_engine() {
        columns.amplitude_directions.iter().for_each(|sizes| add(sizes, components.scale));
    }
    if flies {
        let pushes = columns.accelerations.iter().enumerate();
        pushes.for_each(|(k, (place, _))| {
            add(&[(columns.parameter_count + k, 1.0)], components.accelerations[*place])
        });
        let renewed = columns.contact_resets.iter().filter(|_| frame.may_be_reset_by_contact(window));
        renewed.for_each(|(c, plausible)| add(&[(*c, 1.0)], *plausible));
    }
    let count = known.nrows().min(columns.parameter_count);
    let told = look.jacobian.columns(0, count);
    let within = told * known.view((0, 0), (count, count));
    for i in 0..variance.len() {
        variance[i] += within.row(i).dot(&told.row(i));
    }
}

/// Everything across a window's start.
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

    /// Variances of what noise and slow misfit leave, rows as the look has them.
    fn noise_variance(
        &self,
        window: &Segment,
        frame: &BasisCache,
        look: &Linearization,
        scale: f64,
        slow: f64,
        noise: &Noise,
    ) -> DVector<f64> {
        let n = window.observations.len();
        let rho = if window.kind.uses_engine() { 0.0 } else { noise.rho };
        let mut within = noise::ar1_correlation(n, rho);
        if let Some(misfit) = frame.gp_covariance_at_observations() {
            within += misfit * (slow * slow);
        }
        // Rows of a point are its deviation over this.
        let unit = |i: usize| window.observations[i].weight.sqrt() * look.irls_scale / scale;
        let rows = look.nuisance_jacobian.nrows();
        let k = look.nuisance_jacobian.ncols();
        // N S, axis by axis; what is held of a start stands for itself.
        let mut moved = DMatrix::zeros(rows, k);
        for axis in 0..2 {
            let along = DMatrix::from_fn(n, k, |i, c| self.columns[(2 * i + axis, c)] * unit(i));
            let along = &within * along;
            (0..n).for_each(|i| (0..k).for_each(|c| moved[(2 * i + axis, c)] = unit(i) * along[(i, c)]));
        }
        let held = look.irls_scale * look.irls_scale;
        (2 * n..rows).for_each(|i| (0..k).for_each(|c| moved[(i, c)] = held * self.columns[(i, c)]));
        let taken = self.columns * &self.inverse;
        let both = &taken * self.columns.tr_mul(&moved);
        DVector::from_fn(rows, |i, _| {
            let own = if i < 2 * n { unit(i / 2).powi(2) * within[(i / 2, i / 2)] } else { held };
            own - 2.0 * moved.row(i).dot(&taken.row(i)) + both.row(i).dot(&taken.row(i))
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::discover::thrown::{self, NOISE};

    fn of(
        fitter: &ModelFitter,
        f: &crate::discover::fit::FittedModel,
        components: &VarianceComponents,
    ) -> Vec<Vec<[f64; 2]>> {
        let (looks, _) = fitter.groups(&f.layout, &f.state, &[]).unwrap().unwrap();
        let noise = Noise { sd: NOISE, rho: 0.0, degrees_of_freedom: 1e3 };
        predictive_sds(fitter, f.view(), &looks, components, &f.covariance, &noise)
    }

    /// Noise alone: a start of two numbers an axis takes two observations' worth of its variance, as in any least squares.
    #[test]
    fn a_start_takes_up_four_coordinates() {
        thrown::with_fit(&[1e-6; 6], &[], 8, |fitter, f| {
            let none =
                VarianceComponents { discrepancy: 0.0, impact: 0.0, scale: 0.0, accelerations: vec![0.0; 3] };
            for (window, band) in fitter.data.segments.iter().zip(of(fitter, f, &none)) {
                let all: f64 = band.iter().flatten().map(|sd| (sd / NOISE).powi(2)).sum();
                assert!((all - (2.0 * window.observations.len() as f64 - 4.0)).abs() < 1e-3, "{all}");
            }
        });
    }

    /// What launches leave is as wide as predicted, where they differ by no more than they have reason to.
    #[test]
    fn residuals_are_as_wide_as_their_bands() {
        let drags = [0.32, 0.48, 0.36, 0.46, 0.38, 0.34, 0.43, 0.49];
        thrown::with_fit(&drags, &["linear_drag"], 9, |fitter, f| {
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
