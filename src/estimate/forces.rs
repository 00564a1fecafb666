//! Forces that no effect accounts for, as draws of a posterior carry them: sums of effects whose amplitudes differ from draw to draw.

use serde::{Deserialize, Serialize};

use crate::error::{Error, Result, within};
use crate::task::scene::EffectTerm;
use crate::world::effect::{self, Act, Effect, Parameter};

/// Forces that no effect accounts for, in some draws: a sum of effects whose first two parameters are amplitudes.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct UnnamedForces {
    /// The effects without their amplitudes.
    pub effects: Vec<EffectTerm>,
    /// Draws that have the force, and its amplitudes in each: two for an effect.
    pub draws: Vec<usize>,
    pub amplitudes: Vec<Vec<f64>>,
}

/// Most effects of such forces that a posterior's document is written with, so that it can be sent and read.
pub const MOST_CARRIED: usize = 200_000;
/// Most effects whose sum a force is.
const MOST_UNNAMED: usize = 128;

impl UnnamedForces {
    /// Effects over all draws that have the force.
    pub fn terms(&self) -> usize {
        self.draws.len() * self.effects.len()
    }

    /// Every draw that has the force, with its effects. Errors name the field.
    pub fn by_draw(&self) -> Result<Vec<(usize, Vec<EffectTerm>)>> {
        let effects = self.sums()?;
        let terms = self.effects.len();
        if self.amplitudes.len() != self.draws.len() {
            let value = format!("{} draws' amplitudes", self.amplitudes.len());
            return Err(Error::input("amplitudes", value, format!("those of {} draws", self.draws.len())));
        }
        let of = |(i, (draw, amplitudes)): (usize, (&usize, &Vec<f64>))| {
            if amplitudes.len() != 2 * terms {
                let value = format!("{} numbers", amplitudes.len());
                return Err(Error::input(format!("amplitudes[{i}]"), value, format!("{}", 2 * terms)));
            }
            let pairs = self.effects.iter().zip(&effects).zip(amplitudes.chunks_exact(2)).enumerate();
            let sized = |(k, ((term, effect), pair)): (usize, ((&EffectTerm, &&Effect), &[f64]))| {
                let mut term = term.clone();
                for (place, (parameter, value)) in effect.parameters.iter().zip(pair).enumerate() {
                    let [low, high] = parameter.bounds;
                    let value = within("", *value, low, high)
                        .map_err(|e| e.under(&format!("amplitudes[{i}][{}]", 2 * k + place)))?;
                    term.parameters.insert(parameter.name.into(), value);
                }
                Ok(term)
            };
            Ok((*draw, pairs.map(sized).collect::<Result<_>>()?))
        };
        self.draws.iter().zip(&self.amplitudes).enumerate().map(of).collect()
    }

    /// The effects; errors unless each is a force whose first two parameters are amplitudes that are not given yet.
    fn sums(&self) -> Result<Vec<&'static Effect>> {
        effect::check(&self.effects)?;
        if self.effects.len() > MOST_UNNAMED {
            let value = format!("{} of them", self.effects.len());
            return Err(Error::input("effects", value, format!("at most {MOST_UNNAMED}")));
        }
        let of = |(k, term): (usize, &EffectTerm)| {
            let effect = effect::find(&term.name)?;
            let sized = |p: &Parameter| p.is_amplitude() && !term.parameters.contains_key(p.name);
            let force = matches!(effect.act, Act::Motion(_));
            let first = effect.parameters.iter().take(2);
            if force && first.clone().count() == 2 && first.clone().all(sized) {
                return Ok(effect);
            }
            let allowed =
                "forces whose first two parameters are amplitudes, without those: bumps and monomials";
            Err(Error::input(format!("effects[{k}]"), format!("{:?}", term.name), allowed))
        };
        self.effects.iter().enumerate().map(of).collect()
    }
}
