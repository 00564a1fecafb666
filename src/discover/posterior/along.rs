//! A field that a model has without a name, drawn along with the model's numbers and simulated anew at every point.
//!
//! Behind the numbers of the model a point has the field's coefficients, m/s^2. What is believed of them beforehand lets most be small and some
//! not: each is normal about nothing with one of four deviations.
//!
//! Differences from Kennedy and O'Hagan (2001): the field is part of the forces and not of what is seen, so that it goes on through
//! contacts; and its prior is heavy-tailed, as those of sparse regression are (Carvalho, Polson and Scott, Biometrika 97 (2010) 465), for what
//! is left out is most often one simple law and not a little of everything.

use nalgebra::{DMatrix, DVector};

use super::discrepancy::Field;
use super::unnamed::Unnamed;
use super::whitened::Whitened;
use crate::discover::gaussian::FREEDOM;
use crate::discover::model::Layout;
use crate::estimate::forces::UnnamedForces;
use crate::estimate::sampler::Marginal;
use crate::world::Sample;

/// Standard deviations that a coefficient may have, and most that it may be, m/s^2.
const STRENGTHS: [f64; 4] = [0.6, 2.0, 6.0, 20.0];
const MOST: f64 = 100.0;

/// Rounds in which weights of parts and the likeliest point are found in turn.
const ROUNDS: usize = 4;

/// What is believed of a coefficient.
pub const BELIEVED: Marginal = Marginal::Scales { mean: 0.0, sds: STRENGTHS, low: -MOST, high: MOST };

/// Where a field may be.
pub struct Along {
    /// As it is at the fit.
    unnamed: Unnamed,
    /// Numbers of the model, which come first in every point.
    slots: usize,
    /// From the fit to the likeliest point, and what points about that are known by, as far as everything is straight.
    step: DVector<f64>,
    covariance: DMatrix<f64>,
}

impl Along {
    /// Of the parts of a model with a field, derivatives by its functions in them; nothing where their covariance fails. `precision`: of
    /// the model's numbers, beforehand.
    pub fn new(parts: &[Whitened], unnamed: &Unnamed, precision: &DMatrix<f64>) -> Option<Along> {
        let (slots, functions) = (precision.nrows(), unnamed.amounts.len());
        let all = slots + functions;
        let mut believed = DMatrix::from_diagonal_element(all, all, BELIEVED.centre()[1].powi(-2));
        believed.view_mut((0, 0), (slots, slots)).copy_from(precision);
        let off = DVector::from_fn(all, |k, _| if k < slots { 0.0 } else { -unnamed.amounts[k - slots] });
        let by = |part: &Whitened| {
            let mut by = part.slots.clone().resize_horizontally(all, 0.0);
            by.columns_mut(slots, functions).copy_from(&part.field);
            by
        };
        let by: Vec<DMatrix<f64>> = parts.iter().map(by).collect();
        let (mut step, mut covariance) = (DVector::zeros(all), DMatrix::zeros(0, 0));
        for _ in 0..ROUNDS {
            let (mut gram, mut score) = (believed.clone(), &believed * &off);
            for (part, by) in parts.iter().zip(&by) {
                let square = (&part.left - by * &step).norm_squared();
                let weight = (FREEDOM + part.left.len() as f64) / (FREEDOM + square);
                gram += by.tr_mul(by) * weight;
                score.gemv_tr(weight, by, &part.left, 1.0);
            }
            let factor = gram.cholesky()?;
            step = factor.solve(&score);
            covariance = factor.inverse();
        }
        Some(Along { unnamed: unnamed.clone(), slots, step, covariance })
    }

    /// Coefficients at the fit.
    pub fn amounts(&self) -> &[f64] {
        &self.unnamed.amounts
    }

    /// The likeliest point, of a fit's values, and the covariance of points about it.
    pub fn likeliest(&self, values: &[f64]) -> (Vec<f64>, &DMatrix<f64>) {
        let from = values.iter().chain(&self.unnamed.amounts);
        (from.zip(self.step.iter()).map(|(v, step)| v + step).collect(), &self.covariance)
    }

    /// The field of a point.
    fn at(&self, point: &[f64]) -> Unnamed {
        self.unnamed.with(point[self.slots..].to_vec())
    }

    /// The model's layout with the field of a point.
    pub fn layout(&self, layout: &Layout, point: &[f64]) -> Layout {
        self.at(point).instead(layout)
    }

    /// What kind of field it is, and the root mean square of its coefficients over points, m/s^2.
    pub fn field(&self, points: &[Sample]) -> Field {
        let all = points.iter().flat_map(|p| &p[self.slots..]);
        let (n, sum) = all.fold((0usize, 0.0), |(n, sum), b| (n + 1, sum + b * b));
        Field { over: Some(self.unnamed.over), strength: (sum / n.max(1) as f64).sqrt() }
    }

    /// The fields of points.
    pub fn forces(&self, points: &[Sample]) -> UnnamedForces {
        let nothing = DVector::zeros(self.unnamed.amounts.len());
        let amplitudes = points.iter().map(|p| self.at(p).amplitudes(&nothing)).collect();
        UnnamedForces { effects: self.unnamed.shapes(), draws: (0..points.len()).collect(), amplitudes }
    }
}

#[cfg(test)]
mod tests {
    use rand::RngExt as _;

    use super::*;
    use crate::discover::fixture::term;
    use crate::discover::posterior::unnamed::powers;
    use crate::rng;

    /// Parts of six coordinates that are a number of the model and a field's functions, straight, and next to no noise.
    fn parts(unnamed: &Unnamed, truth: &[f64]) -> Vec<Whitened> {
        let functions = unnamed.amounts.len();
        let mut stream = rng::stream(1, "parts");
        let mut part = |_| {
            let mut random =
                |columns: usize| DMatrix::from_fn(6, columns, |_, _| 50.0 * (stream.random::<f64>() - 0.5));
            let (slots, field) = (random(1), random(functions));
            let left = &slots * truth[0] + &field * DVector::from_column_slice(&truth[1..]);
            Whitened { left, slots, field, log_det: 0.0 }
        };
        (0..40).map(&mut part).collect()
    }

    /// Where everything is straight, the likeliest point is the truth, whatever the fit made up for it with.
    #[test]
    fn the_likeliest_point_is_where_parts_lead() {
        let unnamed = powers(&[vec![[2.0, -1.0, 3.0, 4.0]]]);
        let mut truth = vec![0.0; 1 + unnamed.amounts.len()];
        (truth[0], truth[7], truth[10]) = (0.3, -1.5, -4.0);
        let found =
            Along::new(&parts(&unnamed, &truth), &unnamed, &DMatrix::from_element(1, 1, 1e-6)).unwrap();
        let (at, covariance) = found.likeliest(&[0.5]);
        assert_eq!((at.len(), covariance.nrows()), (truth.len(), truth.len()));
        assert!(
            (at[0] - 0.8).abs() < 1e-3 && (at[7] + 1.5).abs() < 0.01 && (at[10] + 4.0).abs() < 0.01,
            "{at:?}"
        );
        assert!((0..truth.len()).all(|k| covariance[(k, k)] > 0.0 && covariance[(k, k)] < 0.01));
    }

    /// A point's field stands in for the fit's among the terms, behind those that have names, and is what is carried.
    #[test]
    fn a_point_has_its_own_field() {
        let unnamed = powers(&[vec![[2.0, -1.0, 3.0, 4.0]]]);
        let named = Layout::new(&[1], vec![term("quadratic_drag")], 1);
        let layout = unnamed.beside(&named.terms, &named, 1);
        let slots = layout.slots.len();
        let along = Along::new(&[], &unnamed, &DMatrix::identity(slots, slots)).unwrap();
        let mut point = vec![0.0; slots + unnamed.amounts.len()];
        (point[0], point[slots + 2]) = (0.7, 0.4);
        let own = along.layout(&layout, &point);
        assert_eq!((own.terms.len(), own.slots.len()), (layout.terms.len(), slots));
        assert_eq!(
            (own.terms[0].effect.name, own.terms[2].start[0]),
            ("quadratic_drag", 0.2),
            "0.4 m/s^2 at 2 m"
        );
        assert_eq!(layout.terms[2].start[0], 0.0);
        let forces = along.forces(&[point.clone(), point.clone()]);
        assert_eq!((forces.draws, forces.amplitudes[1][2]), (vec![0, 1], 0.2));
        let strength = along.field(&[point]).strength;
        assert!((strength - 0.4 / (unnamed.amounts.len() as f64).sqrt()).abs() < 1e-12, "{strength}");
    }
}
