//! Prior distribution of a model's parameters.
//!
//! Amplitudes of an effect have a prior that is symmetric about their neutral values in declared coordinates:
//! normal or heavy-tailed. The heavy-tailed prior is a scale mixture of normals, so that a strong effect
//! costs the logarithm of its size, not its square; the most probable component at the current values is
//! used. Half of the variance is common to all settings. Shape parameters are normal over the range of the
//! data.
//!
//! Source: scale mixtures of normals: Andrews and Mallows, J. R. Stat. Soc. B 36 (1974) 99.
//!
//! Differences from the source: the mixture is discrete, and its most probable component replaces it.

use nalgebra::{DMatrix, DVector};

use super::settings::SETTINGS;
use crate::inference::model::ParameterLayout;
use crate::inference::selection::candidates;
use crate::world::effect::DataRange;

/// Normal prior relative to a state of the model.
#[derive(Clone, Debug)]
pub struct FixedEffectsPrior {
    pub precision: DMatrix<f64>,
    /// Mean, relative to the state.
    pub mean_offset: DVector<f64>,
    /// Logarithm of the mixture's weight of the normal.
    pub log_weight: f64,
}

/// Standard deviations of the mixture, relative to the declared one. The tail's probability is divided
/// equally among all but the first.
const MULTIPLES: [f64; 9] = [1.0, 3.0, 10.0, 30.0, 100.0, 300.0, 1e3, 3e3, 1e4];
/// Share of an amplitude's prior variance that is common to all settings.
const COMMON_VARIANCE_SHARE: f64 = 0.5;

impl FixedEffectsPrior {
    /// Prior of a layout's parameters at `values`; `gravity`: of the scene, m/s^2.
    pub fn of(
        layout: &ParameterLayout,
        values: &[f64],
        range: &DataRange,
        gravity: f64,
    ) -> FixedEffectsPrior {
        let q = layout.parameters.len();
        let mut out = FixedEffectsPrior {
            precision: DMatrix::zeros(q, q),
            mean_offset: DVector::zeros(q),
            log_weight: 0.0,
        };
        for (i, slot) in layout.parameters.iter().enumerate() {
            out.precision[(i, i)] = match layout.declaration(i) {
                None => slot.min_information(),
                Some(shape) if !shape.is_amplitude() => candidates::shape_sd(shape, range).powi(-2),
                Some(_) => 0.0,
            };
        }
        for t in 0..layout.terms.len() {
            let amplitudes: Vec<usize> =
                layout.parameters_of_term(t).into_iter().filter(|i| !layout.is_shape(*i)).collect();
            out.add_amplitudes(layout, values, &amplitudes, gravity);
        }
        out
    }

    /// Prior of an empty parameter vector.
    pub fn none() -> FixedEffectsPrior {
        FixedEffectsPrior { precision: DMatrix::zeros(0, 0), mean_offset: DVector::zeros(0), log_weight: 0.0 }
    }

    /// Adds independent coefficients of standard deviation `scale` after the parameters, `all` in total.
    pub fn with_discrepancy(&self, all: usize, scale: f64) -> FixedEffectsPrior {
        let q = self.mean_offset.len();
        let mut precision = DMatrix::from_diagonal_element(all, all, scale.powi(-2));
        precision.view_mut((0, 0), (q, q)).copy_from(&self.precision);
        let mut off = DVector::zeros(all);
        off.rows_mut(0, q).copy_from(&self.mean_offset);
        FixedEffectsPrior { precision, mean_offset: off, ..*self }
    }

    /// Adds the prior of a term's amplitudes, in all settings.
    fn add_amplitudes(
        &mut self,
        layout: &ParameterLayout,
        values: &[f64],
        amplitudes: &[usize],
        gravity: f64,
    ) {
        let n = amplitudes.len();
        let (mut deviation, mut slope) = (DVector::zeros(n), DVector::zeros(n));
        let mut precision = DMatrix::zeros(n, n);
        for (a, i) in amplitudes.iter().enumerate() {
            let Some(parameter) = layout.declaration(*i) else { continue };
            [deviation[a], slope[a]] = parameter.prior_deviation(values[*i], gravity);
            let alike = |j: &usize| layout.parameters[*j].kind == layout.parameters[*i].kind;
            let settings = amplitudes.iter().filter(|j| alike(j)).count();
            for (b, j) in amplitudes.iter().enumerate().filter(|(_, j)| alike(j)) {
                precision[(a, b)] =
                    common_precision(i == j, settings) / (parameter.prior_sd * parameter.prior_sd);
            }
        }
        let square = deviation.dot(&(&precision * &deviation));
        let heavy = amplitudes.iter().any(|i| layout.declaration(*i).is_some_and(|p| p.heavy_tailed));
        let strong = if heavy { SETTINGS.strong_effect } else { 0.0 };
        let weight = |k: usize| match k {
            0 => (1.0 - strong).ln(),
            _ => (strong / (MULTIPLES.len() - 1) as f64).ln(),
        };
        let density = |k: &usize| {
            weight(*k) - n as f64 * MULTIPLES[*k].ln() - 0.5 * square / (MULTIPLES[*k] * MULTIPLES[*k])
        };
        let best = (0..MULTIPLES.len()).max_by(|a, b| density(a).total_cmp(&density(b))).unwrap_or(0);
        self.log_weight += weight(best);
        for (a, i) in amplitudes.iter().enumerate() {
            self.mean_offset[*i] = -deviation[a] / slope[a];
            for (b, j) in amplitudes.iter().enumerate() {
                self.precision[(*i, *j)] = precision[(a, b)] * slope[a] * slope[b] / MULTIPLES[best].powi(2);
            }
        }
    }
}

/// An entry of the inverse of (1 - c) I + c J over so many settings, c the common share.
fn common_precision(is_diagonal: bool, settings: usize) -> f64 {
    let c = if settings > 1 { COMMON_VARIANCE_SHARE } else { 0.0 };
    (f64::from(is_diagonal) - c / (1.0 - c + c * settings as f64)) / (1.0 - c)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::inference::model::Term;
    use crate::inference::testing::segments::term;

    const RANGE: DataRange =
        DataRange { area: [0.0, 0.0, 2.0, 1.0], duration: 1.0, speed: 3.0, interval: 0.02 };

    /// Log density of a layout's values, up to a constant that depends on the number of parameters only.
    fn log_density(layout: &ParameterLayout, values: &[f64]) -> f64 {
        let prior = FixedEffectsPrior::of(layout, values, &RANGE, 9.81);
        prior.log_weight + 0.5 * prior.precision.determinant().ln()
            - 0.5 * prior.mean_offset.dot(&(&prior.precision * &prior.mean_offset))
    }

    /// Amplitudes in several settings have half of their variance in common.
    #[test]
    fn sizes_by_setting_are_correlated() {
        let lift = Term { per_setting: true, ..term("lift") };
        let layout = ParameterLayout::new(&[], vec![lift, term("quadratic_drag")], 2);
        let covariance =
            FixedEffectsPrior::of(&layout, &[0.5, 0.3, 0.1], &RANGE, 9.81).precision.try_inverse().unwrap();
        let square = term("lift").effect.parameters[0].prior_sd.powi(2);
        assert!(
            (covariance[(0, 0)] - square).abs() < 1e-9 && (covariance[(0, 1)] - 0.5 * square).abs() < 1e-9
        );
        assert_eq!(covariance[(0, 2)], 0.0);
    }

    /// A clock, a length scale and gravity with the same effect on the curvature of flights are equally
    /// probable at every size: densities of the logarithm of the curvature's ratio.
    #[test]
    fn twins_are_equally_probable() {
        for ratio in [0.0625, 0.25, 0.9, 1.02, 1.5, 4.0f64] {
            let of = |name: &str, value: f64, by_log: f64| {
                log_density(&ParameterLayout::new(&[], vec![term(name)], 1), &[value]) + by_log.abs().ln()
            };
            // Values and their derivatives by the logarithm of the ratio.
            let scale = of("position_scale", ratio, ratio);
            let clock = of("time_scale", ratio.powf(-0.5), 0.5 * ratio.powf(-0.5));
            let gravity = of("gravity_error", 9.81 * (ratio - 1.0), 9.81 * ratio);
            assert!(
                (scale - clock).abs() < 1e-6 && (scale - gravity).abs() < 0.1,
                "{scale} {clock} {gravity}"
            );
        }
    }

    /// A thousand times the declared size costs nats in tens, not in hundreds of thousands.
    #[test]
    fn strong_effects_are_possible() {
        let layout = ParameterLayout::new(&[], vec![term("linear_drag")], 1);
        let cost = log_density(&layout, &[0.1]) - log_density(&layout, &[700.0]);
        assert!((7.0..12.0).contains(&cost), "{cost}");
    }
}
