//! How far from its path an observation is predicted to lie: the standard deviation of every residual that a picture shows.
//!
//! What the score has of a launch (`score`), at the points themselves: noise, slow misfit, pushes, sizes by launch, errors of
//! contacts, and what is known of the sizes, the launch's own scale being the usual one. Its start is fitted to what was
//! seen, and what that takes up is projected out as it is of the residual: with P the projector,
//! var r = diag(P N P') + sum over columns c of variance c^2, the columns projected already.

use nalgebra::{DMatrix, DVector};

use super::columns::Columns;
use super::fit::{Fitter, Shown};
use super::gaussian::Components;
use super::kernels;
use super::launch::{Frame, leap};
use super::model::Look;
use super::noise::Noise;
use super::stats::inverse;
use super::window::{Kind, Window};
use crate::error::Result;

/// Standard deviations of residuals by window and point along x and y, m; not a number where an observation does not count.
/// `looks` of the model, its pushes after its slots; what its slots are known by may leave out the last.
pub fn bands(
    fitter: &Fitter,
    model: Shown,
    looks: &[Look],
    components: &Components,
    known: &DMatrix<f64>,
    noise: &Noise,
) -> Result<Vec<Vec<[f64; 2]>>> {
    let columns = Columns::of(model.layout, &model.state.values, fitter.gravity);
    let of = |w: usize, window: &Window| {
        let scale = fitter.scales[w];
        if !scale.is_finite() {
            return vec![[f64::NAN; 2]; window.points.len()];
        }
        let (look, frame) = (&looks[w], &fitter.frames[w]);
        let own = Start::of(&look.start);
        let mut variance = own.noise(window, frame, look, scale, components.slow, noise);
        shared(&mut variance, window, frame, look, &columns, components, known);
        if let (Kind::Contact, Some(_)) = (window.kind, &window.surface) {
            for way in 0..2 {
                let error = DVector::from_fn(variance.len(), |i, _| leap(window, look, look.impact, way, i));
                let error = own.across(&error) * components.leap;
                variance += error.component_mul(&error);
            }
        }
        let metres = |i: usize| variance[i].max(0.0).sqrt() / (look.share * look.weights[i / 2]);
        let one = |i: usize| match look.weights[i] > 0.0 {
            true => [metres(2 * i), metres(2 * i + 1)],
            false => [f64::NAN; 2],
        };
        (0..window.points.len()).map(one).collect()
    };
    fitter.data.each_window(of)
}

/// Adds what columns make of the variances of a launch's sizes and pushes, and of what is known of the model's.
fn shared(
    variance: &mut DVector<f64>,
    window: &Window,
    frame: &Frame,
    look: &Look,
    columns: &Columns,
    components: &Components,
    known: &DMatrix<f64>,
) {
    let flies = matches!(window.kind, Kind::Flight | Kind::Contact);
    let mut add = |of: &[(usize, f64)], sd: f64| {
        let own = of.iter().fold(DVector::zeros(look.columns.nrows()), |all, (c, size)| {
            all + look.columns.column(*c) * (*size * sd)
        });
        *variance += own.component_mul(&own);
    };
    if !window.kind.simulated() {
        columns.strengths.iter().for_each(|sizes| add(sizes, components.strength));
    }
    if flies {
        let pushes = columns.of.iter().enumerate();
        pushes.for_each(|(k, (place, _))| add(&[(columns.slots + k, 1.0)], components.push[*place]));
        let renewed = columns.renewed.iter().filter(|_| frame.is_renewed(window));
        renewed.for_each(|(c, plausible)| add(&[(*c, 1.0)], *plausible));
    }
    let count = known.nrows().min(columns.slots);
    let told = look.columns.columns(0, count);
    let within = told * known.view((0, 0), (count, count));
    for i in 0..variance.len() {
        variance[i] += within.row(i).dot(&told.row(i));
    }
}

/// Everything across a window's start.
struct Start<'a> {
    columns: &'a DMatrix<f64>,
    inverse: DMatrix<f64>,
}

impl<'a> Start<'a> {
    fn of(columns: &'a DMatrix<f64>) -> Start<'a> {
        Start { columns, inverse: inverse(&columns.tr_mul(columns)) }
    }

    fn across(&self, of: &DVector<f64>) -> DVector<f64> {
        of - self.columns * (&self.inverse * self.columns.tr_mul(of))
    }

    /// Variances of what noise and slow misfit leave, rows as the look has them.
    fn noise(
        &self,
        window: &Window,
        frame: &Frame,
        look: &Look,
        scale: f64,
        slow: f64,
        noise: &Noise,
    ) -> DVector<f64> {
        let n = window.points.len();
        let rho = if window.kind.simulated() { 0.0 } else { noise.rho };
        let sizes: Vec<f64> = window.points.iter().map(|p| p.weight).collect();
        let misfit = frame.slow_at_points().filter(|_| slow > 0.0);
        let within = |along: DMatrix<f64>| {
            let noise = kernels::autoregressive(rho, &sizes, &along);
            match &misfit {
                Some((half, basis)) => noise + basis.tr_mul(&(half * along)) * (slow * slow),
                None => noise,
            }
        };
        let own = |i: usize| {
            let misfit = misfit.as_ref().map_or(0.0, |(half, basis)| half.column(i).dot(&basis.column(i)));
            kernels::block_variance(rho, sizes[i]) + misfit * slow * slow
        };
        // Rows of a point are its deviation, over its own noise, times this.
        let unit = |i: usize| f64::from(sizes[i] > 0.0) * look.share / scale;
        let rows = look.start.nrows();
        let k = look.start.ncols();
        // N S, axis by axis; what is held of a start stands for itself.
        let mut moved = DMatrix::zeros(rows, k);
        for axis in 0..2 {
            let along = DMatrix::from_fn(n, k, |i, c| self.columns[(2 * i + axis, c)] * unit(i));
            let along = within(along);
            (0..n).for_each(|i| (0..k).for_each(|c| moved[(2 * i + axis, c)] = unit(i) * along[(i, c)]));
        }
        let held = look.share * look.share;
        (2 * n..rows).for_each(|i| (0..k).for_each(|c| moved[(i, c)] = held * self.columns[(i, c)]));
        let taken = self.columns * &self.inverse;
        let both = &taken * self.columns.tr_mul(&moved);
        DVector::from_fn(rows, |i, _| {
            let own = if i < 2 * n { unit(i / 2).powi(2) * own(i / 2) } else { held };
            own - 2.0 * moved.row(i).dot(&taken.row(i)) + both.row(i).dot(&taken.row(i))
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::discover::thrown::{self, NOISE};

    fn of(fitter: &Fitter, f: &crate::discover::fit::Fitted, components: &Components) -> Vec<Vec<[f64; 2]>> {
        let (looks, _) = fitter.parts(&f.layout, &f.state, &[]).unwrap().unwrap();
        let noise = Noise { sd: NOISE, rho: 0.0, freedom: 1e3 };
        bands(fitter, f.shown(), &looks, components, &f.covariance, &noise).unwrap()
    }

    /// Noise alone: a start of two numbers an axis takes two observations' worth of its variance, as in any least squares.
    #[test]
    fn a_start_takes_up_four_coordinates() {
        thrown::fitted(&[1e-6; 6], &[], 8, |fitter, f| {
            let none = Components { slow: 0.0, leap: 0.0, strength: 0.0, push: vec![0.0; 3] };
            for (window, band) in fitter.data.windows.iter().zip(of(fitter, f, &none)) {
                let all: f64 = band.iter().flatten().map(|sd| (sd / NOISE).powi(2)).sum();
                assert!((all - (2.0 * window.points.len() as f64 - 4.0)).abs() < 1e-3, "{all}");
            }
        });
    }

    /// What launches leave is as wide as predicted, where they differ by no more than they have reason to.
    #[test]
    fn residuals_are_as_wide_as_their_bands() {
        let drags = [0.32, 0.48, 0.36, 0.46, 0.38, 0.34, 0.43, 0.49];
        thrown::fitted(&drags, &["linear_drag"], 9, |fitter, f| {
            let bands = of(fitter, f, &f.components);
            let pairs = bands.iter().zip(&f.pass.residuals);
            let square = |(band, left): (&Vec<[f64; 2]>, &Vec<f64>)| -> f64 {
                band.iter().flatten().zip(left).map(|(sd, r)| (r / sd).powi(2)).sum::<f64>()
                    / left.len() as f64
            };
            let mean = pairs.map(square).sum::<f64>() / 8.0;
            assert!((0.3..2.0).contains(&mean), "{mean}");
        });
    }
}
