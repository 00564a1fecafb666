//! Grid scans with successive refinement: of one parameter after the other, and of correlated pairs.

use crate::error::Result;
use crate::inference::model::{self, FitState, ParameterKind, ParameterLayout, SegmentData};
use crate::world::effect::{EffectTarget, ParameterDeclaration};
use crate::world::latent::FACTORS;

/// Maximum number of rounds, and the ratio of losses above which the scan ends.
const MAX_TURNS: usize = 3;
const CONVERGENCE_RATIO: f64 = 0.999;
/// Widths of grids over pairs, and grid points per side.
const PAIR_GRIDS: [(f64, i32); 3] = [(2.0, 20), (0.2, 10), (0.03, 10)];

/// The segments with known initial states over which losses are computed.
#[derive(Clone, Copy)]
pub struct SearchProblem<'a> {
    pub data: &'a SegmentData<'a>,
    pub layout: &'a ParameterLayout,
    pub segments: &'a [usize],
}

impl SearchProblem<'_> {
    /// Loss of each parameter vector.
    pub fn losses(&self, values: &[Vec<f64>]) -> Result<Vec<f64>> {
        model::robust_losses(self.data, self.layout, values, self.segments)
    }

    /// Scans one parameter after the other over its width (`spread`) with successive refinement (`widths`:
    /// shares of it, with grid points per side), amplitudes first: segments inside of the edges determine
    /// amplitudes sharply, in an optimum too narrow for sampling. Parameters of width zero are not scanned.
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
                    let proposed = to.into_iter().map(|to| replaced(&best.1, &[(i, to)])).collect();
                    best = self.better(best, proposed)?;
                }
            }
            if best.0 > CONVERGENCE_RATIO * before {
                break;
            }
        }
        Ok(FitState::new(best.1, start.nuisances))
    }

    /// Scans restitution jointly with every contact parameter: they compensate each other along a narrow
    /// curved valley.
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
                let proposed = pairs.map(|(r, c)| replaced(&best.1, &[(l, r), (e, c)])).collect();
                best = self.better(best, proposed)?;
            }
        }
        Ok(FitState::new(best.1, start.nuisances))
    }

    fn score(&self, values: Vec<f64>) -> Result<ScoredValues> {
        Ok((self.losses(std::slice::from_ref(&values))?[0], values))
    }

    /// The best of all; the known one on ties.
    fn better(&self, known: ScoredValues, proposed: Vec<Vec<f64>>) -> Result<ScoredValues> {
        let losses = self.losses(&proposed)?;
        Ok(losses.into_iter().zip(proposed).fold(known, |best, new| if new.0 < best.0 { new } else { best }))
    }

    /// Grid of a parameter about its value, `side` points on each side up to `width` standard deviations,
    /// clamped to the bounds.
    fn grid_values(
        &self,
        values: &[f64],
        spread: &[f64],
        parameter: usize,
        width: f64,
        side: i32,
    ) -> Vec<f64> {
        let [low, high] = self.layout.parameters[parameter].bounds;
        let at = |k: i32| values[parameter] + width * spread[parameter] * f64::from(k) / f64::from(side);
        (-side..=side).map(|k| at(k).clamp(low, high)).collect()
    }
}

/// Loss and parameter vector.
type ScoredValues = (f64, Vec<f64>);

fn replaced(values: &[f64], by: &[(usize, f64)]) -> Vec<f64> {
    let mut out = values.to_vec();
    by.iter().for_each(|(i, value)| out[*i] = *value);
    out
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::inference::testing::segments::{one_step_segments, term};
    use crate::world::Engine;

    /// Finds the true wind on the grid, without moving the other parameter or leaving the bounds.
    #[test]
    fn grid_scan_finds_grid_points() {
        let (segments, settings) = one_step_segments(0.75);
        let data = SegmentData::new(&segments, &settings, vec![1e-3; segments.len()], Engine::Lanes);
        let mut layout = ParameterLayout::new(&[], vec![term("wind")], 1);
        let start = || FitState::new(vec![0.0, 0.0], vec![Vec::new(); segments.len()]);
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
