//! Empirical law for the acceleration that no set of effects explains: a formula (`formula`) or a force field
//! of radial functions (`radial_field`), both fitted like effects. They are compared by log evidence minus
//! the logarithm of the number of ways to choose the terms.

pub mod formula;
pub mod radial_field;

use std::collections::BTreeMap;

use crate::error::Result;
use crate::inference::data::noise::Noise;
use crate::inference::field::{self, FieldFit};
use crate::inference::mixed_model::fitted_model::{FittedModel, ModelView, held_out_square};
use crate::inference::mixed_model::model_fit::ModelFitter;
use crate::inference::model::{ParameterKind, ParameterLayout, Term};
use crate::inference::report::prediction_gain::ErrorScale;
use crate::inference::report::{LawTerm, ResidualLaw};

/// Least-squares steps.
const LEAST_SQUARES_STEPS: usize = 12;

/// A model with an empirical law for its residuals.
pub struct FittedLaw {
    fit: FittedModel,
    /// Whether it improves held-out predictions: then it is part of the extended scene.
    pub offered: bool,
    /// Log evidence less the penalty for choosing its terms.
    log_posterior: f64,
    kind: LawKind,
}

/// A kind of law.
#[derive(Clone, Copy)]
struct LawKind {
    /// Describes the terms of a layout from an index on.
    text: fn(&ParameterLayout, &[f64], usize) -> String,
    /// Number of terms to choose from.
    choice_count: usize,
}

/// A reported model and its discrepancy field, for which a law is fitted.
pub struct LawProblem<'a, 'b, 'c> {
    pub fitter: &'c ModelFitter<'a, 'b>,
    pub base: &'c FittedModel,
    pub model: &'c FittedModel,
    pub field: Option<&'c FieldFit>,
}

impl LawProblem<'_, '_, '_> {
    /// The more probable of a formula and a field; `None` if neither can be fitted.
    pub fn law(&self, noise: &Noise) -> Result<Option<FittedLaw>> {
        let form = LawKind { text: formula::formula, choice_count: formula::FUNCTION_COUNT };
        let formula = self.fitted(formula::formula_terms(self.fitter.data, self.model, noise)?, form)?;
        let field = match &self.field {
            Some(field) => {
                // Radial functions of all inputs are candidates.
                let of = field::FieldSpec { inputs: field::FieldInputs::All, ..field.spec };
                let form =
                    LawKind { text: radial_field::describe, choice_count: field::BASIS_FUNCTION_COUNT };
                self.fitted(radial_field::radial_terms(self.fitter, self.model, of)?, form)?
            }
            None => None,
        };
        let rank = |l: &FittedLaw| (l.offered, l.log_posterior);
        Ok([formula, field].into_iter().flatten().reduce(|a, b| if rank(&b) > rank(&a) { b } else { a }))
    }

    /// Fits the model with more terms; `None` without any or if the fit fails.
    fn fitted(&self, terms: Vec<Term>, form: LawKind) -> Result<Option<FittedLaw>> {
        if terms.is_empty() {
            return Ok(None);
        }
        let penalty = log_choices(terms.len(), form.choice_count);
        let (layout, start) = self.model.with_terms(terms, self.fitter.data.setting_count());
        let Some(fit) = self.fitter.fit(layout, start, LEAST_SQUARES_STEPS)? else { return Ok(None) };
        let log_posterior = fit.log_evidence - penalty;
        let offered = held_out_square(&fit) < held_out_square(self.base).min(held_out_square(self.model));
        Ok(Some(FittedLaw { fit, offered, log_posterior, kind: form }))
    }
}

/// Logarithm of the number of ways to choose `size` terms.
fn log_choices(size: usize, among: usize) -> f64 {
    (0..size.min(among)).map(|k| ((among - k) as f64 / (k + 1) as f64).ln()).sum()
}

impl FittedLaw {
    /// View of the model with the law.
    pub fn view(&self) -> ModelView<'_> {
        self.fit.view()
    }

    /// For the report.
    pub fn report(&self, base: &FittedModel, model: &FittedModel, scale: &ErrorScale) -> ResidualLaw {
        let first = model.effects.len();
        ResidualLaw {
            formula: (self.kind.text)(&self.fit.layout, &self.fit.state.values, first),
            terms: law_terms(&self.fit, first),
            held_out: scale.gain(held_out_square(base), held_out_square(&self.fit)),
            offered: self.offered,
        }
    }
}

/// The terms of a law: those of a model from `first` on.
fn law_terms(fit: &FittedModel, first: usize) -> Vec<LawTerm> {
    let (numbers, _) = fit.layout.values_by_term(&fit.state.values, 0);
    let of = |t: usize| {
        let effect = fit.layout.terms[t].effect;
        let interval = |parameter: usize| {
            let ParameterKind::EffectParameter(_, p) = fit.layout.parameters[parameter].kind else {
                return None;
            };
            let (value, half) = (fit.state.values[parameter], fit.ci_half_width(parameter));
            let ci95 = [value - half, value + half].map(|v| v.is_finite().then_some(v));
            Some((effect.parameters[p].name.to_string(), ci95))
        };
        let ci95: BTreeMap<_, _> =
            fit.layout.parameters_of_term(t).into_iter().filter_map(interval).collect();
        LawTerm { term: effect.term_at_clock(&numbers[t], 0.0), ci95 }
    };
    (first..fit.layout.terms.len()).map(of).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::inference::testing::throws;

    const NOISE: Noise = Noise { sd: throws::NOISE, rho: 0.0, degrees_of_freedom: 1e3 };

    /// A law for a missing drag improves held-out predictions; with the drag in the model no law is offered.
    #[test]
    fn a_law_fits_a_missing_effect() {
        throws::with_fit(&[0.4; 10], &[], 4, |fitter, base| {
            let law =
                LawProblem { fitter, base, model: base, field: None }.law(&NOISE).unwrap().expect("a law");
            let scale = ErrorScale { noise: NOISE.sd, coordinates: 600.0, floor: 525.0, trials: 10 };
            let report = law.report(base, base, &scale);
            assert!(report.offered && report.terms.len() == law.fit.layout.terms.len(), "{report:?}");
            assert!(report.held_out.extended_rmse < 0.5 * report.held_out.base_rmse, "{report:?}");
        });
        throws::with_fit(&[0.4; 10], &["linear_drag"], 4, |fitter, model| {
            assert!(
                LawProblem { fitter, base: model, model, field: None }
                    .law(&NOISE)
                    .unwrap()
                    .is_none_or(|l| !l.offered)
            );
        });
    }

    /// A formula that is the missing law is preferred to a field that resembles it.
    #[test]
    fn the_missing_law_is_preferred_to_a_field() {
        throws::with_fit(&[0.4; 10], &[], 4, |fitter, base| {
            let field = field::fit(fitter, base).unwrap();
            assert!(field.is_some(), "there is a field to choose");
            let law = LawProblem { fitter, base, model: base, field: field.as_ref() }.law(&NOISE).unwrap();
            let law = law.expect("a law");
            let scale = ErrorScale { noise: NOISE.sd, coordinates: 600.0, floor: 525.0, trials: 10 };
            let report = law.report(base, base, &scale);
            assert!(report.offered && report.formula.starts_with("ax ="), "{}", report.formula);
        });
    }
}
