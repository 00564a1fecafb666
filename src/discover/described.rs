//! What no set explains, as a law without a name beside the reported model: a formula (`law`), or the field that launches share
//! (`bumps`).
//!
//! Either is fitted by least squares and then judged as models are, by the log predictive density of each launch told from the
//! other folds, less what choosing its terms costs.

use std::collections::BTreeMap;

use nalgebra::DMatrix;

use super::components::{Likelihood, WIDE};
use super::decide::{Bootstrap, TIED, charge, compared};
use super::field::{self, Shared};
use super::fit::{self, Fitted, Fitter, Shown, held, prior};
use super::gain::Scale;
use super::model::{self, Layout, Pass, State, Term, What};
use super::noise::Noise;
use super::report::{LawTerm, ResidualLaw};
use super::score::{each_held_out, spared};
use super::stats::inverse;
use super::{bumps, law};
use crate::distribution::NORMAL_95;
use crate::error::Result;

/// Steps of least squares.
const STEPS: usize = 12;

/// A model with a law for what it leaves.
pub struct Law {
    pub layout: Layout,
    pub state: State,
    pub pass: Pass,
    /// Log predictive density by launch, spoilt ones spared and the charge for its terms taken off.
    score: Vec<f64>,
    /// Held-out squares by trial, units of the noise.
    held: Vec<f64>,
    /// Whether the model with it is likely to predict other launches better than alone: then it is part of the extended scene,
    /// without a name as it is.
    pub offered: bool,
    form: Form,
}

/// A form that laws have.
#[derive(Clone, Copy)]
struct Form {
    /// The terms of a layout from one on in words and symbols.
    text: fn(&Layout, &[f64], usize) -> String,
    /// How many terms there were to choose from.
    among: usize,
    /// Precision by which their amplitudes are believed to be about nothing; 0 where nothing is believed.
    belief: f64,
}

/// What a model leaves, and what laws for it are judged by.
pub struct Rest<'a, 'b, 'c> {
    pub fitter: &'c Fitter<'a, 'b>,
    pub base: &'c Fitted,
    pub model: &'c Fitted,
    pub bootstrap: &'c Bootstrap,
}

impl Rest<'_, '_, '_> {
    /// A law for it, where launches `shared` something also as the field that this is; `None` where nothing describes it.
    pub fn law(&self, noise: &Noise, shared: Option<&Shared>) -> Result<Option<Law>> {
        let form = Form { text: law::formula, among: law::FUNCTIONS, belief: 0.0 };
        let formula = self.fitted(law::law(self.fitter.data, self.model, noise)?, form)?;
        let field = match shared {
            Some(s) => self.field(s.whole)?,
            None => None,
        };
        Ok(self.plainer(formula, field))
    }

    fn field(&self, of: field::Form) -> Result<Option<Law>> {
        let form = Form { text: bumps::words, among: field::BUMPS, belief: of.strength.powi(-2) };
        self.fitted(bumps::bumps(self.fitter, self.model, of)?, form)
    }

    /// Which of the two is told, the one place where that is decided: the formula, which people can read, unless it is not worth
    /// offering and the field is, or the field predicts other launches better for certain. (On swirls the field was, by 60 to 480
    /// nats, and rollouts missed new launches by 0.14 to 0.20 m with it, by 0.31 to 0.59 m with the formula.)
    fn plainer(&self, formula: Option<Law>, field: Option<Law>) -> Option<Law> {
        match (formula, field) {
            (Some(formula), Some(field)) => {
                let tied = compared(&field.score, &formula.score, self.bootstrap).is_tied();
                Some(if tied && formula.offered >= field.offered { formula } else { field })
            }
            (formula, field) => formula.or(field),
        }
    }

    /// The model with some terms more, fitted; `None` without any, and where they cannot be.
    fn fitted(&self, terms: Vec<Term>, form: Form) -> Result<Option<Law>> {
        if terms.is_empty() {
            return Ok(None);
        }
        let (data, model) = (self.fitter.data, self.model);
        let charge = charge(terms.len(), form.among);
        let (mut layout, start) = model.joined(terms, data.setting_count());
        layout.slots.iter_mut().skip(model.layout.slots.len()).for_each(|s| s.belief = form.belief);
        let Some((state, pass)) = fit::simulated(model::fit(data, &layout, start, STEPS))? else {
            return Ok(None);
        };
        // Launches are as unlike as the model has them.
        let state = State { modes: model.state.modes.clone(), ..state };
        let Some((score, held)) = self.held_out(&layout, &state, &pass)? else { return Ok(None) };
        let share = charge / score.len() as f64;
        let score: Vec<f64> = spared(&score, &self.base.score).into_iter().map(|s| s - share).collect();
        let alone = spared(&model.score, &self.base.score);
        // In nats and in metres. That something is left is known, so it need not be certain which is better: of fourteen launches
        // with a chequered push none of the laws was, and yet with one rollouts missed new launches by half.
        let offered = compared(&score, &alone, self.bootstrap).worse > TIED[0]
            && held.iter().sum::<f64>() < fit::held(model);
        Ok(Some(Law { layout, state, pass, score, held, offered, form }))
    }

    /// Log densities and squares (units of the noise) by launch, each told from the other folds.
    fn held_out(&self, layout: &Layout, state: &State, pass: &Pass) -> Result<Option<(Vec<f64>, Vec<f64>)>> {
        let Some((_, parts)) = self.fitter.parts(layout, &self.model.set, state, &[])? else {
            return Ok(None);
        };
        let (mut prior, own) = (prior(layout, state), self.model.layout.slots.len());
        let mut components = self.model.components.clone();
        components.spread.resize(layout.slots.len(), 0.0);
        // The law is what launches share: its amplitudes do not differ among them.
        for (k, slot) in layout.slots.iter().enumerate().skip(own) {
            prior.precision[(k, k)] = slot.belief + slot.ridge();
            prior.off[k] = -state.values[k] * slot.belief / prior.precision[(k, k)];
            prior.plausible[k] = 0.0;
        }
        let components = Likelihood::new(&parts, &components).most(&prior, WIDE, |_| true);
        let mut score = vec![0.0; pass.trials.len()];
        // A launch of which nothing is scored stays as far off as it is.
        let mut held: Vec<f64> = pass.trials.iter().map(|t| t.square).collect();
        let told = each_held_out(&parts, &prior, &components, &self.fitter.folds, |t, others| {
            score[t.launch] += t.predicted(others);
            held[t.launch] = pass.trials[t.launch].after(&others.step).max(0.0);
        });
        Ok(told.map(|()| (score, held)).filter(|(score, _)| score.iter().all(|s| s.is_finite())))
    }
}

impl Law {
    /// What there is to show of the model with it.
    pub fn shown(&self) -> Shown<'_> {
        Shown { layout: &self.layout, state: &self.state, pass: &self.pass }
    }

    /// For the report.
    pub fn told(&self, base: &Fitted, model: &Fitted, noise: &Noise, scale: &Scale) -> ResidualLaw {
        let first = model.set.len();
        ResidualLaw {
            formula: (self.form.text)(&self.layout, &self.state.values, first),
            terms: law_terms(self, first, noise.unit()),
            held_out: scale.gain(held(base), self.held.iter().sum()),
            offered: self.offered,
        }
    }
}

/// The terms of a law, those of a model from `first` on. Intervals are by the noise's own size.
fn law_terms(law: &Law, first: usize, unit: f64) -> Vec<LawTerm> {
    let (layout, values) = (&law.layout, &law.state.values);
    let q = layout.slots.len();
    let mut gram = law.pass.trials.iter().fold(DMatrix::zeros(q, q), |sum, t| sum + &t.gram);
    (0..q).for_each(|k| gram[(k, k)] += layout.slots[k].ridge() + layout.slots[k].belief);
    let covariance = inverse(&gram) * unit;
    let (numbers, _) = layout.numbers(values, 0);
    let of = |t: usize| {
        let effect = layout.terms[t].effect;
        let interval = |slot: usize| {
            let What::Parameter(_, p) = layout.slots[slot].what else { return None };
            let half = NORMAL_95 * covariance[(slot, slot)].max(0.0).sqrt();
            let ci95 = [values[slot] - half, values[slot] + half].map(Some);
            Some((effect.parameters[p].name.to_string(), ci95))
        };
        let ci95: BTreeMap<_, _> = layout.of_term(t).into_iter().filter_map(interval).collect();
        LawTerm { term: effect.term_at_clock(&numbers[t], 0.0), ci95 }
    };
    (first..layout.terms.len()).map(of).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::discover::thrown;

    const NOISE: Noise = Noise { sd: thrown::NOISE, rho: 0.0, freedom: 1e3 };

    /// What is made of the rest that a set leaves of launches with a drag.
    fn rest<T>(set: &[&str], of: impl FnOnce(&Rest) -> T) -> T {
        thrown::fitted(&[0.4; 10], &[], 4, |_, base| {
            thrown::fitted(&[0.4; 10], set, 4, |fitter, model| {
                of(&Rest { fitter, base, model, bootstrap: &Bootstrap::new(10, 1) })
            })
        })
    }

    /// A drag that no model has is described by a law that helps on other launches; what has it leaves nothing to describe
    /// that does.
    #[test]
    fn a_law_stands_for_what_a_model_lacks() {
        rest(&[], |rest| {
            let law = rest.law(&NOISE, None).unwrap().expect("a law");
            let scale = Scale { noise: NOISE.sd, coordinates: 600.0, floor: 525.0, trials: 10 };
            let told = law.told(rest.base, rest.base, &NOISE, &scale);
            assert!(told.offered && told.terms.len() == law.layout.terms.len(), "{told:?}");
            assert!(told.held_out.extended_rmse < 0.5 * told.held_out.base_rmse, "{told:?}");
        });
        rest(&["linear_drag"], |rest| {
            assert!(rest.law(&NOISE, None).unwrap().is_none_or(|l| !l.offered));
        });
    }

    const FIELD: field::Form = field::Form { over: field::Over::All, strength: 2.0 };

    /// A drag is a field of velocity, too, which helps on other launches; and yet the formula is told, which is no worse. Where
    /// there is none, the field is.
    #[test]
    fn a_formula_is_told_where_a_field_is_no_better() {
        rest(&[], |rest| {
            let shared = Shared {
                gain: 9.0,
                probability: 1.0,
                explained: 0.0,
                squares: Vec::new(),
                scores: Vec::new(),
                form: FIELD,
                whole: FIELD,
            };
            let law = rest.law(&NOISE, Some(&shared)).unwrap().expect("a law");
            assert!((law.form.text)(&law.layout, &law.state.values, 0).contains("ax ="));
            let field = rest.plainer(None, rest.field(FIELD).unwrap()).expect("bumps");
            let scale = Scale { noise: NOISE.sd, coordinates: 600.0, floor: 525.0, trials: 10 };
            let told = field.told(rest.base, rest.base, &NOISE, &scale);
            assert!(told.offered && told.terms.iter().all(|t| t.ci95.len() == 2), "{told:?}");
            assert!(told.held_out.extended_rmse < 0.5 * told.held_out.base_rmse, "{told:?}");
        });
        rest(&["linear_drag"], |rest| assert!(rest.field(FIELD).unwrap().is_none_or(|f| !f.offered)));
    }
}
