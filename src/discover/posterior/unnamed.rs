//! Force fields that nobody named, as parts of a model: what there may be of them, and how a model has one.
//!
//! A field is a sum of functions, each a pair of effects' amplitudes: Gaussian bumps (`field`), or powers of place, velocity and speed
//! (`law`). It is among the forces and not in what is seen, so that it goes on through contacts.

use std::ops::Range;

use nalgebra::DVector;

use super::discrepancy::{Discrepancy, Kinds};
use super::whitened::Whitened;
use crate::discover::field::{self, OVERS, Over};
use crate::discover::fit::Fitter;
use crate::discover::law::POWERS;
use crate::discover::model::{Extra, Layout, Slot, State, Term, paths};
use crate::error::Result;
use crate::task::scene::EffectTerm;
use crate::world::effect::{Effect, monomial};

/// Amplitude by which derivatives by a field's functions are taken, m/s^2.
const SLIGHT: f64 = 0.02;
/// Least size of a power where paths lead: of what is nothing there (x, where all falls straight down) a unit would be without end, and a
/// little of it more than its effect may have.
const LEAST: f64 = 1e-3;

/// A field in a model.
#[derive(Clone)]
pub struct Unnamed {
    pub over: Over,
    /// The effects that its functions are, two functions each: their first two parameters are the amplitudes.
    pub effects: Vec<(&'static Effect, Vec<f64>)>,
    /// Amplitude of each effect that pushes with 1 m/s^2 at most.
    units: Vec<f64>,
    /// Coefficients by function, m/s^2.
    pub amounts: Vec<f64>,
}

impl Unnamed {
    /// Nothing of a field of some effects.
    fn nothing(over: Over, effects: Vec<(&'static Effect, Vec<f64>)>) -> Unnamed {
        Unnamed { over, units: vec![1.0; effects.len()], amounts: vec![0.0; 2 * effects.len()], effects }
    }

    /// As much of the same functions.
    pub fn with(&self, amounts: Vec<f64>) -> Unnamed {
        Unnamed { amounts, ..self.clone() }
    }

    /// Directions in which a model would move with a little of each function.
    fn extras(&self) -> Vec<Extra> {
        let of = |((effect, values), unit): (&(&'static Effect, Vec<f64>), &f64)| {
            [0, 1].map(|k| {
                let mut values = values.clone();
                (values[0], values[1]) = (0.0, 0.0);
                values[k] = SLIGHT * unit;
                Extra { effect, values, unit: SLIGHT }
            })
        };
        self.effects.iter().zip(&self.units).flat_map(of).collect()
    }

    /// A layout that has this field in place of another of the same functions.
    pub fn instead(&self, layout: &Layout) -> Layout {
        let mut layout = layout.clone();
        layout.terms.truncate(layout.terms.len() - self.effects.len());
        layout.terms.extend(self.terms());
        layout
    }

    /// Its effects as terms of a model, none of whose numbers is fitted.
    fn terms(&self) -> impl Iterator<Item = Term> {
        let sized = self.effects.iter().zip(&self.units).zip(self.amounts.chunks_exact(2));
        sized.map(|(((effect, values), unit), amounts)| {
            let mut start = values.clone();
            for k in 0..2 {
                let [low, high] = effect.parameters[k].bounds;
                start[k] = (amounts[k] * unit).clamp(low, high);
            }
            Term { effect, per_setting: false, free: vec![false; start.len()], start, difference: None }
        })
    }

    /// Its effects with amplitudes by so much more than it has, two of each effect, in their own units.
    pub fn amplitudes(&self, more: &DVector<f64>) -> Vec<f64> {
        let amounts = self.amounts.iter().zip(more.iter()).map(|(own, more)| own + more).collect();
        self.with(amounts).terms().flat_map(|term| [term.start[0], term.start[1]]).collect()
    }

    /// Its effects without their amplitudes, which are the first two parameters of each.
    pub fn shapes(&self) -> Vec<EffectTerm> {
        let of = |(effect, values): &(&'static Effect, Vec<f64>)| {
            let rest = effect.parameters.iter().zip(values).skip(2);
            let parameters = rest.map(|(p, v)| (p.name.to_string(), *v)).collect();
            EffectTerm { name: effect.name.into(), parameters }
        };
        self.effects.iter().map(of).collect()
    }

    /// A layout with its terms after those that have names.
    pub fn beside(&self, named: &[Term], layout: &Layout, settings: usize) -> Layout {
        let latents: Vec<usize> = layout.slots.iter().filter_map(Slot::latent).collect();
        Layout::new(&latents, named.iter().cloned().chain(self.terms()).collect(), settings)
    }
}

/// What a model may lack.
pub enum Lacks<'a> {
    Nothing,
    /// A field of bumps of any kind.
    Any(Every),
    /// More or less of the field that it has, which is drawn along.
    Known(&'a Unnamed),
}

/// Every field that may be there, nothing of any yet, where windows lead.
pub struct Every {
    pub powers: Unnamed,
    bumps: Unnamed,
    /// Which of all bumps each kind of field has.
    kinds: Kinds,
}

impl Every {
    /// Where windows lead at a state.
    pub fn of(fitter: &Fitter, layout: &Layout, state: &State) -> Result<Every> {
        let paths = paths(fitter.data, layout, state)?;
        let functions = field::functions(fitter.data.windows, &paths);
        Ok(Every {
            powers: powers(&paths),
            bumps: Unnamed::nothing(Over::All, functions.effects()),
            kinds: OVERS.map(|over| (over, functions.range(over))).to_vec(),
        })
    }

    /// A field of a kind's bumps.
    fn of_bumps(&self, over: Over, range: &Range<usize>) -> Unnamed {
        Unnamed::nothing(over, self.bumps.effects[range.start / 2..range.end / 2].to_vec())
    }
}

/// Powers of place, velocity and speed, as large as they are where paths lead.
pub fn powers(paths: &[Vec<[f64; 4]>]) -> Unnamed {
    let largest = |powers: &[u8; 5]| {
        let of = |s: &[f64; 4]| {
            let all = [s[0], s[1], s[2], s[3], s[2].hypot(s[3])];
            all.iter().zip(powers).map(|(v, p)| v.abs().powi(i32::from(*p))).product::<f64>()
        };
        paths.iter().flatten().map(of).filter(|v| v.is_finite()).fold(0.0, f64::max).max(LEAST)
    };
    let effect = |powers: &[u8; 5]| {
        let values = [0.0; 2].into_iter().chain(powers.iter().map(|p| f64::from(*p)));
        (&monomial::EFFECT, values.collect())
    };
    let units = POWERS.iter().map(|p| 1.0 / largest(p)).collect();
    Unnamed { units, ..Unnamed::nothing(Over::Powers, POWERS.iter().map(effect).collect()) }
}

impl Lacks<'_> {
    /// Directions in which the model would move with a little of each function.
    pub fn extras(&self) -> Vec<Extra> {
        match self {
            Lacks::Nothing => Vec::new(),
            Lacks::Any(every) => every.bumps.extras(),
            Lacks::Known(unnamed) => unnamed.extras(),
        }
    }

    /// Nothing of each kind of field that may be there beside the model, in the order of [`Lacks::discrepancy`].
    pub fn kinds(&self) -> Vec<Unnamed> {
        match self {
            Lacks::Any(every) => {
                every.kinds.iter().map(|(over, range)| every.of_bumps(*over, range)).collect()
            }
            Lacks::Nothing | Lacks::Known(_) => Vec::new(),
        }
    }

    /// The fields that may be there beside it, from parts with derivatives by the functions.
    pub fn discrepancy(&self, parts: &[Whitened]) -> Discrepancy {
        match self {
            Lacks::Any(every) => Discrepancy::new(parts, &every.kinds),
            Lacks::Nothing | Lacks::Known(_) => Discrepancy::new(parts, &[]),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::discover::fixture::term;

    /// Two bodies' paths.
    fn field() -> Unnamed {
        powers(&[vec![[2.0, -1.0, 3.0, 4.0], [1.0, 0.5, 0.0, 0.0]], vec![[-1.0, 0.0, f64::NAN, 0.0]]])
    }

    /// A coefficient is the push where it is largest, whatever the power is of; what is nothing everywhere has a unit all the same.
    #[test]
    fn powers_push_by_as_much_as_their_coefficients_say() {
        let field = field();
        let place = |powers: [u8; 5]| POWERS.iter().position(|p| *p == powers).unwrap();
        assert_eq!(field.units[place([0; 5])], 1.0);
        assert_eq!(field.units[place([1, 0, 0, 0, 0])], 0.5);
        assert_eq!(field.units[place([0, 0, 0, 1, 1])], 1.0 / 20.0);
        assert_eq!((field.amounts.len(), field.effects.len()), (2 * POWERS.len(), POWERS.len()));
        let still = powers(&[vec![[0.0; 4]]]);
        assert!(still.units.iter().all(|u| u.is_finite()));
        let within = |e: &Extra| (0..2).all(|k| e.values[k].abs() < e.effect.parameters[k].bounds[1]);
        assert!(still.extras().iter().all(within), "what stands still is simulated all the same");
        let extra = &field.extras()[2 * place([0, 0, 0, 1, 1]) + 1];
        assert_eq!((extra.values[0], extra.values[1], extra.unit), (0.0, SLIGHT / 20.0, SLIGHT));
    }

    /// Its terms come after those that have names, none of their numbers is fitted, and the layout's values stay what they were.
    #[test]
    fn a_field_adds_no_numbers() {
        let named = Layout::new(&[1], vec![term("quadratic_drag")], 1);
        let amounts = vec![0.4; 2 * POWERS.len()];
        let layout = Unnamed { amounts, ..field() }.beside(&named.terms, &named, 1);
        assert_eq!((layout.slots.len(), layout.terms.len()), (named.slots.len(), 1 + POWERS.len()));
        assert_eq!(layout.terms[0].effect.name, "quadratic_drag");
        assert_eq!(layout.terms[2].start[..2], [0.2, 0.2], "x: 0.4 m/s^2 at 2 m");
    }
}
