//! A flight that has not been made: what a fitted model predicts of it, and how well a model explains an outcome.
//!
//! The flight is repeated, and the mean of the repetitions is explained with a free initial state, parameters as far as
//! the trials so far permit, and a plausible shared discrepancy, by the Gauss-Newton method.

use nalgebra::{DMatrix, DVector};
use rand_distr::{Distribution, StandardNormal};

use crate::inference::data::noise::Noise;
use crate::inference::mixed_model::fitted_model::FittedModel;
use crate::inference::model::{self, Parameter};
use crate::inference::segment::Segment;
use crate::inference::selection::{SharedDiscrepancy, rms_beyond_gravity};
use crate::inference::statistics::pseudo_inverse;
use crate::rng::Stream;

/// Number of numbers of an initial state, and the step of their finite differences, m and m/s.
const START: usize = 4;
const START_STEP: f64 = 1e-4;
/// Gauss-Newton steps.
const STEPS: usize = 3;

/// A planned flight.
pub struct PlannedFlight<'a> {
    segment: &'a Segment,
    /// Initial state, m and m/s.
    start: [f64; START],
    /// Response of the observations to the shared discrepancy at its largest plausible size, m: two rows per observation.
    discrepancy: DMatrix<f64>,
    /// Variance of the mean over all repetitions, m^2.
    variance: f64,
}

impl<'a> PlannedFlight<'a> {
    /// A flight that is observed `repeats` times; `by`: a model whose path stands for all.
    pub fn new(
        segment: &'a Segment,
        start: [f64; START],
        by: &FittedModel,
        discrepancy: Option<&SharedDiscrepancy>,
        noise: &Noise,
        repeats: f64,
    ) -> PlannedFlight<'a> {
        let mut path = vec![[f64::NAN; 4]; segment.observations.len()];
        let physics = by.layout.segment_physics(segment, &by.state.values, &[]);
        physics.predict_positions(&start, |i, state| path[i] = state);
        let accelerations = model::accelerations(segment, &by.layout, &by.state.values, &path);
        let typical = rms_beyond_gravity(segment, &accelerations);
        let none = || DMatrix::zeros(2 * path.len(), 0);
        PlannedFlight {
            segment,
            start,
            discrepancy: discrepancy.map_or_else(none, |d| d.responses_along(segment, &path, typical)),
            variance: noise.sd * noise.sd * noise.smooth_variance_factor() / repeats,
        }
    }

    /// Positions that a model predicts, m: two rows per observation.
    pub fn prediction(&self, model: &FittedModel) -> DVector<f64> {
        self.positions(model, &DVector::zeros(START + model.layout.parameters.len()))
    }

    /// A mean outcome under a model: parameters from their posterior, with discrepancy and noise.
    pub fn simulated(&self, model: &FittedModel, stream: &mut Stream) -> DVector<f64> {
        let mut normal = |n: usize, sd: f64| -> DVector<f64> {
            DVector::from_fn(n, |_, _| {
                let z: f64 = StandardNormal.sample(stream);
                sd * z
            })
        };
        let q = model.layout.parameters.len();
        let mut deviation = DVector::zeros(START + q);
        if let Some(factor) = model.covariance.clone().cholesky() {
            deviation.rows_mut(START, q).copy_from(&(factor.l() * normal(q, 1.0)));
        }
        let stray = &self.discrepancy * normal(self.discrepancy.ncols(), model.discrepancy_scale);
        let exact = self.positions(model, &deviation) + stray;
        &exact + normal(exact.len(), self.variance.sqrt())
    }

    /// Smallest sum of squared deviations of an outcome, and of the unknowns from what is known of them, each over its
    /// variance; 0 where the model cannot be simulated.
    pub fn misfit(&self, model: &FittedModel, observed: &DVector<f64>) -> f64 {
        let known = START + model.layout.parameters.len();
        let precision = self.precision(model);
        let mut unknowns = DVector::zeros(precision.nrows());
        let residual = |unknowns: &DVector<f64>| {
            let stray = unknowns.rows(known, unknowns.len() - known);
            observed
                - self.positions(model, &unknowns.rows(0, known).into_owned())
                - &self.discrepancy * stray
        };
        for _ in 0..STEPS {
            let left = residual(&unknowns);
            let columns = self.derivatives(model, &unknowns.rows(0, known).into_owned());
            if !left.iter().chain(columns.iter()).all(|v| v.is_finite()) {
                return 0.0;
            }
            let information = columns.tr_mul(&columns) / self.variance + &precision;
            let score = columns.tr_mul(&left) / self.variance - &precision * &unknowns;
            unknowns += pseudo_inverse(&information) * score;
        }
        residual(&unknowns).norm_squared() / self.variance + unknowns.dot(&(&precision * &unknowns))
    }

    /// Positions after a deviation of initial state and parameters from the fitted ones.
    fn positions(&self, model: &FittedModel, deviation: &DVector<f64>) -> DVector<f64> {
        let start: [f64; START] = std::array::from_fn(|k| self.start[k] + deviation[k]);
        let parameters = model.layout.parameters.iter().enumerate();
        let value = |(k, p): (usize, &Parameter)| {
            (model.state.values[k] + deviation[START + k]).clamp(p.bounds[0], p.bounds[1])
        };
        let values: Vec<f64> = parameters.map(value).collect();
        let physics = model.layout.segment_physics(self.segment, &values, &[]);
        DVector::from_vec(physics.predict_positions(&start, |_, _| ()))
    }

    /// Derivatives of the positions by initial state, parameters and discrepancy.
    fn derivatives(&self, model: &FittedModel, at: &DVector<f64>) -> DMatrix<f64> {
        let base = self.positions(model, at);
        let mut out = DMatrix::zeros(base.len(), at.len() + self.discrepancy.ncols());
        for k in 0..at.len() {
            let step = match k.checked_sub(START) {
                None => START_STEP,
                Some(p) => {
                    let parameter = &model.layout.parameters[p];
                    let is_beyond = model.state.values[p] + at[k] + parameter.fd_step > parameter.bounds[1];
                    if is_beyond { -parameter.fd_step } else { parameter.fd_step }
                }
            };
            let mut moved = at.clone();
            moved[k] += step;
            out.set_column(k, &((self.positions(model, &moved) - &base) / step));
        }
        out.columns_mut(at.len(), self.discrepancy.ncols()).copy_from(&self.discrepancy);
        out
    }

    /// Precision of initial state (none), parameters and discrepancy.
    fn precision(&self, model: &FittedModel) -> DMatrix<f64> {
        let q = model.layout.parameters.len();
        let mut out =
            DMatrix::identity(START + q + self.discrepancy.ncols(), START + q + self.discrepancy.ncols());
        out.view_mut((0, 0), (START, START)).fill(0.0);
        out.view_mut((START, START), (q, q)).copy_from(&pseudo_inverse(&model.covariance));
        out
    }
}
