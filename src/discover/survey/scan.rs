//! Numbers tried on grids, ever closer: one after the other, and two together that make up for each other.

use crate::discover::model::{self, FitState, ParameterKind, ParameterLayout, SegmentData};
use crate::error::Result;
use crate::world::effect::{EffectTarget, ParameterDeclaration};
use crate::world::latent::FACTORS;

/// How often every number gets its turn, and the share of the loss that a turn must leave to be the last.
const MAX_TURNS: usize = 3;
const CONVERGENCE_RATIO: f64 = 0.999;
/// Widths of a grid over two numbers at once, and the values of each tried on each side.
const PAIR_GRIDS: [(f64, i32); 3] = [(2.0, 20), (0.2, 10), (0.03, 10)];

/// What values are judged over: stretches whose starts are known, by their places among the windows.
#[derive(Clone, Copy)]
pub struct SearchProblem<'a> {
    pub data: &'a SegmentData<'a>,
    pub layout: &'a ParameterLayout,
    pub segments: &'a [usize],
}

impl SearchProblem<'_> {
    /// What each of some values loses.
    pub fn losses(&self, values: &[Vec<f64>]) -> Result<Vec<f64>> {
        model::robust_losses(self.data, self.layout, values, self.segments)
    }

    /// One number after the other is tried over its whole reach (`spread`) and ever closer, by shares of that and so many
    /// values on each side (`widths`), amplitudes first. Stretches that lie within the edges tell an amplitude sharply
    /// whatever the edges are, and a draw of all numbers at once hardly ever meets so narrow a place. What has no reach stays.
    pub fn scan(&self, start: FitState, spread: &[f64], widths: &[(f64, i32)]) -> Result<FitState> {
        let mut best = self.score(start.values)?;
        let amplitude =
            |i: &usize| self.layout.declaration(*i).is_some_and(ParameterDeclaration::is_amplitude);
        let (first, then): (Vec<usize>, Vec<usize>) = (0..self.layout.parameters.len()).partition(amplitude);
        for _ in 0..MAX_TURNS {
            let before = best.0;
            for i in first.iter().chain(&then).copied().filter(|i| spread[*i] > 0.0) {
                for (width, side) in widths.iter().copied() {
                    let to = self.grid_values(&best.1, spread, i, width, side);
                    let tried = to.into_iter().map(|to| replaced(&best.1, &[(i, to)])).collect();
                    best = self.better(best, tried)?;
                }
            }
            if best.0 > CONVERGENCE_RATIO * before {
                break;
            }
        }
        Ok(FitState::new(best.1, start.nuisances))
    }

    /// Restitution together with what else contacts do is tried on grids, each about the best of the one before. The two make
    /// up for each other along a valley across both, too narrow to be drawn, and no way of one of them alone leads along it.
    pub fn pair_scan(&self, start: FitState, spread: &[f64]) -> Result<FitState> {
        let contact = |i: &usize| match self.layout.parameters[*i].kind {
            ParameterKind::EffectParameter(t, _) => {
                self.layout.terms[t].effect.target() == EffectTarget::Contact
            }
            ParameterKind::Latent(l) => FACTORS[l].name == "restitution",
        };
        let (latents, effects): (Vec<usize>, Vec<usize>) = (0..self.layout.parameters.len())
            .filter(contact)
            .partition(|i| self.layout.parameters[*i].latent().is_some());
        if effects.is_empty() {
            return Ok(start);
        }
        let mut best = self.score(start.values)?;
        for (l, e) in latents.iter().flat_map(|l| effects.iter().map(|e| (*l, *e))) {
            for (width, side) in PAIR_GRIDS {
                let [rows, columns] = [l, e].map(|i| self.grid_values(&best.1, spread, i, width, side));
                let pairs = rows.iter().flat_map(|r| columns.iter().map(|c| (*r, *c)));
                let tried = pairs.map(|(r, c)| replaced(&best.1, &[(l, r), (e, c)])).collect();
                best = self.better(best, tried)?;
            }
        }
        Ok(FitState::new(best.1, start.nuisances))
    }

    fn score(&self, values: Vec<f64>) -> Result<ScoredValues> {
        Ok((self.losses(std::slice::from_ref(&values))?[0], values))
    }

    /// The best of all, the one that is known if none is better.
    fn better(&self, known: ScoredValues, tried: Vec<Vec<f64>>) -> Result<ScoredValues> {
        let losses = self.losses(&tried)?;
        Ok(losses.into_iter().zip(tried).fold(known, |best, new| if new.0 < best.0 { new } else { best }))
    }

    /// Values of a slot about where it stands, `side` of them on each side up to `width` of its deviation, as far as allowed.
    fn grid_values(&self, values: &[f64], spread: &[f64], slot: usize, width: f64, side: i32) -> Vec<f64> {
        let [low, high] = self.layout.parameters[slot].bounds;
        let at = |k: i32| values[slot] + width * spread[slot] * f64::from(k) / f64::from(side);
        (-side..=side).map(|k| at(k).clamp(low, high)).collect()
    }
}

/// Values with the loss that they have.
type ScoredValues = (f64, Vec<f64>);

fn replaced(values: &[f64], by: &[(usize, f64)]) -> Vec<f64> {
    let mut out = values.to_vec();
    by.iter().for_each(|(i, value)| out[*i] = *value);
    out
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::discover::fixture::{one_step_segments, term};
    use crate::world::Engine;

    /// On a grid that holds the true wind it is found, the other number stays, and nothing goes beyond what is allowed.
    #[test]
    fn a_number_is_found_where_the_grid_holds_it() {
        let (windows, settings) = one_step_segments(0.75);
        let data = SegmentData::new(&windows, &settings, vec![1e-3; windows.len()], Engine::Lanes);
        let mut layout = ParameterLayout::new(&[], vec![term("wind")], 1);
        let start = || FitState::new(vec![0.0, 0.0], vec![Vec::new(); windows.len()]);
        let over = |layout: &ParameterLayout| {
            let over = SearchProblem { data: &data, layout, segments: &[0, 3, 5] };
            over.scan(start(), &[1.0, 1.0], &[(1.0, 4), (0.1, 4)]).unwrap().values
        };
        let found = over(&layout);
        assert!((found[0] - 0.75).abs() < 1e-12 && found[1].abs() < 1e-12, "{found:?}");
        layout.parameters[0].bounds = [-0.5, 0.5];
        assert_eq!(over(&layout)[0], 0.5);
    }
}
