//! Discrepancy forces of posterior draws: sums of basis effects whose amplitudes differ between draws.

use serde::{Deserialize, Serialize};

use crate::error::{Error, Result, check_range};
use crate::task::scene::EffectTerm;
use crate::world::effect::{self, Effect, EffectKind, ParameterDeclaration};

/// A force without a named effect in some draws: a sum of effects whose first two parameters are amplitudes.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct DiscrepancyForces {
    /// The basis effects without their amplitudes.
    pub effects: Vec<EffectTerm>,
    /// Indices of the draws that have the force.
    pub draws: Vec<usize>,
    pub amplitudes: Vec<Vec<f64>>,
}

/// Maximum number of effect terms over all draws in a written posterior document; limits its size.
pub const MAX_WRITTEN_TERMS: usize = 200_000;
/// Maximum number of basis effects of one force.
const MAX_TERMS_PER_FORCE: usize = 128;

impl DiscrepancyForces {
    /// Number of effect terms over all draws.
    pub fn term_count(&self) -> usize {
        self.draws.len() * self.effects.len()
    }

    /// Pairs of draw index and effects, for every draw that has the force. Errors name the field.
    pub fn by_draw(&self) -> Result<Vec<(usize, Vec<EffectTerm>)>> {
        let effects = self.resolve_effects()?;
        let terms = self.effects.len();
        if self.amplitudes.len() != self.draws.len() {
            let value = format!("amplitudes of {} draws", self.amplitudes.len());
            let allowed = format!("amplitudes of {} draws, one row each", self.draws.len());
            return Err(Error::input("amplitudes", value, allowed));
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
                    let value = check_range("", *value, low, high)
                        .map_err(|e| e.in_field(&format!("amplitudes[{i}][{}]", 2 * k + place)))?;
                    term.parameters.insert(parameter.name.into(), value);
                }
                Ok(term)
            };
            Ok((*draw, pairs.map(sized).collect::<Result<_>>()?))
        };
        self.draws.iter().zip(&self.amplitudes).enumerate().map(of).collect()
    }

    /// Looks up the basis effects. Fails unless each is a force whose first two parameters are amplitudes
    /// without a value.
    fn resolve_effects(&self) -> Result<Vec<&'static Effect>> {
        effect::validate_terms(&self.effects)?;
        if self.effects.len() > MAX_TERMS_PER_FORCE {
            let value = format!("{} effects", self.effects.len());
            return Err(Error::input("effects", value, format!("at most {MAX_TERMS_PER_FORCE}")));
        }
        let of = |(k, term): (usize, &EffectTerm)| {
            let effect = effect::find(&term.name)?;
            let sized = |p: &ParameterDeclaration| p.is_amplitude() && !term.parameters.contains_key(p.name);
            let force = matches!(effect.kind, EffectKind::Motion(_));
            let first = effect.parameters.iter().take(2);
            if force && first.clone().count() == 2 && first.clone().all(sized) {
                return Ok(effect);
            }
            let allowed = "a bump or a monomial without its amplitudes";
            Err(Error::input(format!("effects[{k}]"), format!("{:?}", term.name), allowed))
        };
        self.effects.iter().enumerate().map(of).collect()
    }
}
