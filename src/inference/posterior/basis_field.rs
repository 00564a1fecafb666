//! Discrepancy fields as parts of a model, expanded in basis functions.
//!
//! A field is a sum of basis functions, each with a pair of amplitudes: Gaussian radial basis functions
//! (`field`) or monomials of position, velocity and speed (`formula`). It acts as a force and not as an offset of
//! observations, so it persists through contacts.

use std::ops::Range;

use nalgebra::DVector;

use super::discrepancy::{FieldMixture, FieldRanges};
use super::whitened::WhitenedGroup;
use crate::error::Result;
use crate::inference::field::{self, FieldInputs, RADIAL_INPUTS};
use crate::inference::mixed_model::model_fit::ModelFitter;
use crate::inference::model::{FitState, Parameter, ParameterLayout, Perturbation, Term, segment_states};
use crate::inference::residual_law::formula::POWERS;
use crate::progress::Progress;
use crate::task::scene::EffectTerm;
use crate::world::effect::{Effect, monomial};

/// Finite-difference step of an amplitude, m/s^2.
const FD_AMPLITUDE: f64 = 0.02;
/// Minimum magnitude of a monomial along the paths, to bound its unit where it vanishes (for example x in a
/// vertical fall).
const MIN_MONOMIAL_SIZE: f64 = 1e-3;

/// A field expanded in basis functions.
#[derive(Clone)]
pub struct BasisField {
    pub over: FieldInputs,
    /// The basis effects, two functions each: their first two parameters are the amplitudes.
    pub effects: Vec<(&'static Effect, Vec<f64>)>,
    /// Amplitude of each effect for a maximum acceleration of 1 m/s^2.
    units: Vec<f64>,
    /// Coefficients, m/s^2.
    pub coefficients: Vec<f64>,
}

impl BasisField {
    /// A zero field of the given effects.
    fn zero(over: FieldInputs, effects: Vec<(&'static Effect, Vec<f64>)>) -> BasisField {
        BasisField {
            over,
            units: vec![1.0; effects.len()],
            coefficients: vec![0.0; 2 * effects.len()],
            effects,
        }
    }

    /// The same basis with other coefficients.
    pub fn with_coefficients(&self, coefficients: Vec<f64>) -> BasisField {
        BasisField { coefficients, ..self.clone() }
    }

    /// One perturbation of the model per basis function.
    fn perturbations(&self) -> Vec<Perturbation> {
        let of = |((effect, values), unit): (&(&'static Effect, Vec<f64>), &f64)| {
            [0, 1].map(|k| {
                let mut values = values.clone();
                (values[0], values[1]) = (0.0, 0.0);
                values[k] = FD_AMPLITUDE * unit;
                Perturbation { effect, values, unit: FD_AMPLITUDE }
            })
        };
        self.effects.iter().zip(&self.units).flat_map(of).collect()
    }

    /// The layout with this field in place of another of the same basis.
    pub fn replacing(&self, layout: &ParameterLayout) -> ParameterLayout {
        let mut layout = layout.clone();
        layout.terms.truncate(layout.terms.len() - self.effects.len());
        layout.terms.extend(self.terms());
        layout
    }

    /// The effects as fixed terms of a model.
    fn terms(&self) -> impl Iterator<Item = Term> {
        let with_amplitudes = self.effects.iter().zip(&self.units).zip(self.coefficients.chunks_exact(2));
        with_amplitudes.map(|(((effect, values), unit), coefficients)| {
            let mut start = values.clone();
            for k in 0..2 {
                let [low, high] = effect.parameters[k].bounds;
                start[k] = (coefficients[k] * unit).clamp(low, high);
            }
            Term {
                effect,
                per_setting: false,
                free: vec![false; start.len()],
                start,
                fd_step: None,
                bracket: None,
            }
        })
    }

    /// Amplitudes of the field with `more` added to its coefficients, two per effect, in the effects' units.
    pub fn amplitudes(&self, increments: &DVector<f64>) -> Vec<f64> {
        let coefficients = self
            .coefficients
            .iter()
            .zip(increments.iter())
            .map(|(own, increments)| own + increments)
            .collect();
        self.with_coefficients(coefficients).terms().flat_map(|term| [term.start[0], term.start[1]]).collect()
    }

    /// The effects without amplitudes (their first two parameters).
    pub fn effect_terms(&self) -> Vec<EffectTerm> {
        let of = |(effect, values): &(&'static Effect, Vec<f64>)| {
            let rest = effect.parameters.iter().zip(values).skip(2);
            let parameters = rest.map(|(p, v)| (p.name.to_string(), *v)).collect();
            EffectTerm { name: effect.name.into(), parameters }
        };
        self.effects.iter().map(of).collect()
    }

    /// The layout with this field's terms after the named ones.
    pub fn appended_to(&self, named: &[Term], layout: &ParameterLayout, settings: usize) -> ParameterLayout {
        let latents: Vec<usize> = layout.parameters.iter().filter_map(Parameter::latent).collect();
        ParameterLayout::new(&latents, named.iter().cloned().chain(self.terms()).collect(), settings)
    }
}

/// How model discrepancy is treated.
pub enum DiscrepancyModel<'a> {
    Absent,
    /// A radial-basis field of any kind, integrated out.
    Marginalised(AllFields),
    /// The model's own field, whose coefficients are sampled.
    Sampled(&'a BasisField),
}

/// All candidate fields along the segments' paths, with zero coefficients.
pub struct AllFields {
    pub powers: BasisField,
    bumps: BasisField,
    /// Range of basis functions of each kind of field.
    kinds: FieldRanges,
}

impl AllFields {
    /// Along the segments' paths at a state.
    pub fn along_paths(
        fitter: &ModelFitter,
        layout: &ParameterLayout,
        state: &FitState,
    ) -> Result<AllFields> {
        let paths = segment_states(fitter.data, layout, state)?;
        let functions = field::field_basis(fitter.data.segments, &paths);
        Ok(AllFields {
            powers: monomials(&paths),
            bumps: BasisField::zero(FieldInputs::All, functions.effects()),
            kinds: RADIAL_INPUTS.map(|over| (over, functions.indices(over))).to_vec(),
        })
    }

    /// The field of one kind.
    fn rbf_field(&self, over: FieldInputs, range: &Range<usize>) -> BasisField {
        BasisField::zero(over, self.bumps.effects[range.start / 2..range.end / 2].to_vec())
    }
}

/// Monomials of position, velocity and speed, scaled by their maximum along the paths.
pub fn monomials(paths: &[Vec<[f64; 4]>]) -> BasisField {
    let largest = |powers: &[u8; 5]| {
        let of = |s: &[f64; 4]| {
            let all = [s[0], s[1], s[2], s[3], s[2].hypot(s[3])];
            all.iter().zip(powers).map(|(v, p)| v.abs().powi(i32::from(*p))).product::<f64>()
        };
        paths.iter().flatten().map(of).filter(|v| v.is_finite()).fold(0.0, f64::max).max(MIN_MONOMIAL_SIZE)
    };
    let effect = |powers: &[u8; 5]| {
        let values = [0.0; 2].into_iter().chain(powers.iter().map(|p| f64::from(*p)));
        (&monomial::EFFECT, values.collect())
    };
    let units = POWERS.iter().map(|p| 1.0 / largest(p)).collect();
    BasisField { units, ..BasisField::zero(FieldInputs::Powers, POWERS.iter().map(effect).collect()) }
}

impl DiscrepancyModel<'_> {
    /// One perturbation of the model per basis function.
    pub fn perturbations(&self) -> Vec<Perturbation> {
        match self {
            DiscrepancyModel::Absent => Vec::new(),
            DiscrepancyModel::Marginalised(every) => every.bumps.perturbations(),
            DiscrepancyModel::Sampled(field) => field.perturbations(),
        }
    }

    /// Zero fields of each kind that is integrated out, in the order of [`DiscrepancyModel::discrepancy`].
    pub fn kinds(&self) -> Vec<BasisField> {
        match self {
            DiscrepancyModel::Marginalised(every) => {
                every.kinds.iter().map(|(over, range)| every.rbf_field(*over, range)).collect()
            }
            DiscrepancyModel::Absent | DiscrepancyModel::Sampled(_) => Vec::new(),
        }
    }

    /// The mixture of fields to integrate out, from groups with Jacobians.
    pub fn discrepancy(&self, groups: &[WhitenedGroup], progress: &dyn Progress) -> Result<FieldMixture> {
        match self {
            DiscrepancyModel::Marginalised(every) => FieldMixture::new(groups, &every.kinds, progress),
            DiscrepancyModel::Absent | DiscrepancyModel::Sampled(_) => {
                FieldMixture::new(groups, &[], progress)
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::inference::testing::segments::term;

    /// Paths of two bodies.
    fn synthetic_field() -> BasisField {
        monomials(&[vec![[2.0, -1.0, 3.0, 4.0], [1.0, 0.5, 0.0, 0.0]], vec![[-1.0, 0.0, f64::NAN, 0.0]]])
    }

    /// A coefficient is the maximum acceleration of its monomial; a vanishing monomial has a finite unit.
    #[test]
    fn coefficients_are_maximum_accelerations() {
        let field = synthetic_field();
        let place = |powers: [u8; 5]| POWERS.iter().position(|p| *p == powers).unwrap();
        assert_eq!(field.units[place([0; 5])], 1.0);
        assert_eq!(field.units[place([1, 0, 0, 0, 0])], 0.5);
        assert_eq!(field.units[place([0, 0, 0, 1, 1])], 1.0 / 20.0);
        assert_eq!((field.coefficients.len(), field.effects.len()), (2 * POWERS.len(), POWERS.len()));
        let still = monomials(&[vec![[0.0; 4]]]);
        assert!(still.units.iter().all(|u| u.is_finite()));
        let within = |e: &Perturbation| (0..2).all(|k| e.values[k].abs() < e.effect.parameters[k].bounds[1]);
        assert!(still.perturbations().iter().all(within), "a body at rest can be simulated");
        let extra = &field.perturbations()[2 * place([0, 0, 0, 1, 1]) + 1];
        assert_eq!((extra.values[0], extra.values[1], extra.unit), (0.0, FD_AMPLITUDE / 20.0, FD_AMPLITUDE));
    }

    /// Its terms follow the named ones, none is fitted, and the layout's parameters stay the same.
    #[test]
    fn field_adds_no_fitted_parameters() {
        let named = ParameterLayout::new(&[1], vec![term("quadratic_drag")], 1);
        let coefficients = vec![0.4; 2 * POWERS.len()];
        let layout = BasisField { coefficients, ..synthetic_field() }.appended_to(&named.terms, &named, 1);
        assert_eq!((layout.parameters.len(), layout.terms.len()), (named.parameters.len(), 1 + POWERS.len()));
        assert_eq!(layout.terms[0].effect.name, "quadratic_drag");
        assert_eq!(layout.terms[2].start[..2], [0.2, 0.2], "x: 0.4 m/s^2 at 2 m");
    }
}
