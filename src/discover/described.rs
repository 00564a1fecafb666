//! What no set explains, as a law without a name beside the reported model.

use nalgebra::DMatrix;

use super::fit::{self, Fitted, Shown, held};
use super::gain::{Scale, better};
use super::law;
use super::leave_out::leave_out;
use super::model::{self, Data, Layout, Pass, State};
use super::noise::Noise;
use super::report::{LawTerm, ResidualLaw};
use super::stats::inverse;
use crate::error::Result;

/// A model with a law for what it leaves, by least squares: no candidate, so it is not scored.
pub struct Law {
    pub layout: Layout,
    pub state: State,
    pub pass: Pass,
    /// Held-out squares by trial.
    pub held: Vec<f64>,
}

/// A model with a law for what it leaves (`law`), fitted; `None` where nothing simple describes that.
pub fn described(data: &Data, model: &Fitted, noise: &Noise, settings: usize) -> Result<Option<Law>> {
    let found = law::law(data, model, noise)?;
    if found.is_empty() {
        return Ok(None);
    }
    let (layout, start) = model.joined(found, settings);
    let Some((state, pass)) = fit::simulated(model::fit(data, &layout, start, 8))? else {
        return Ok(None);
    };
    let groups: Vec<usize> = (0..pass.trials.len()).collect();
    let (held, _) = leave_out(&layout, &state.values, &pass.trials, data.settings, &groups, &[]);
    Ok(Some(Law { layout, state, pass, held }))
}

impl Law {
    /// Whether it is better than `model` on other trials: then it is part of the extended scene, without a name as it is.
    pub fn helps(&self, model: &Fitted) -> bool {
        self.held.iter().sum::<f64>() < held(model) && better(&model.held, &self.held)
    }

    /// What there is to show of the model with it.
    pub fn shown(&self) -> Shown<'_> {
        Shown { layout: &self.layout, state: &self.state, pass: &self.pass }
    }

    /// For the report.
    pub fn told(&self, base: &Fitted, model: &Fitted, noise: &Noise, scale: &Scale) -> ResidualLaw {
        let first = model.set.len();
        ResidualLaw {
            formula: law::formula(&self.layout, &self.state.values, first),
            terms: law_terms(self, first, noise.unit()),
            held_out: scale.gain(held(base), self.held.iter().sum()),
            offered: self.helps(model),
        }
    }
}

/// The terms of a law, those of a model from `first` on. Intervals are by the noise's own size.
fn law_terms(law: &Law, first: usize, unit: f64) -> Vec<LawTerm> {
    let q = law.layout.slots.len();
    let mut gram = law.pass.trials.iter().fold(DMatrix::zeros(q, q), |sum, t| sum + &t.gram);
    (0..q).for_each(|k| gram[(k, k)] += law.layout.slots[k].ridge());
    let covariance = inverse(&gram) * unit;
    let of = |(t, term): (usize, &model::Term)| {
        let slot = *law.layout.of_term(t).first()?;
        let (value, half) = (law.state.values[slot], 1.96 * covariance[(slot, slot)].max(0.0).sqrt());
        let mut values = term.start.clone();
        let axis = term.free.iter().position(|f| *f)?;
        values[axis] = value;
        Some(LawTerm {
            term: term.effect.at_clock(&values, 0.0),
            amplitude: term.effect.parameters[axis].name.into(),
            ci95: [Some(value - half), Some(value + half)],
        })
    };
    law.layout.terms.iter().enumerate().skip(first).filter_map(of).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::discover::thrown;

    /// A drag that no model has is described by a law that helps on other launches; what has it leaves nothing to describe
    /// that does.
    #[test]
    fn a_law_stands_for_what_a_model_lacks() {
        let noise = Noise { sd: thrown::NOISE, rho: 0.0, freedom: 1e3 };
        thrown::fitted(&[0.4; 8], &[], 4, |fitter, base| {
            let law = described(fitter.data, base, &noise, 1).unwrap().expect("a law");
            assert!(law.helps(base));
            let scale = Scale { noise: noise.sd, coordinates: 480.0, floor: 420.0, trials: 8 };
            let told = law.told(base, base, &noise, &scale);
            assert!(told.offered && told.terms.len() == law.layout.terms.len(), "{told:?}");
            assert!(told.held_out.extended_rmse < 0.5 * told.held_out.base_rmse, "{told:?}");
        });
        thrown::fitted(&[0.4; 8], &["linear_drag"], 4, |fitter, with| {
            let law = described(fitter.data, with, &noise, 1).unwrap();
            assert!(law.is_none_or(|l| !l.helps(with)));
        });
    }
}
