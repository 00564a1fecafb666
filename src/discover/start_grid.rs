//! Starts for strong effects: sizes on a logarithmic grid over an effect's bounds.
//!
//! A linearisation at nothing finds no clock that runs at half the rate and no drag of 60 per second. Every effect whose
//! prior is heavy-tailed is therefore tried at sizes up to its bounds, from small to large, the initial states of a few trials following;
//! the size that leaves least is a start, where it leaves less than what the linearisation leads to.
//!
//! Source: numerical continuation (Allgower and Georg, Introduction to Numerical Continuation Methods, 2003, chapter 2).

use rayon::prelude::*;

use super::fit::{Fitted, Fitter, simulated, sized};
use super::gaussian::FREEDOM;
use super::library::Candidate;
use super::model::{self, Data, Layout, Slot, State, Term};
use super::window::{Kind, Window};
use crate::error::Result;
use crate::world::effect::{Effect, ParameterDeclaration, SearchStrategy};

/// Trials that sizes are tried on.
const TRIALS: usize = 12;
/// Sizes per factor of ten.
const PER_DECADE: f64 = 3.0;
/// Sizes on one side, up to ten thousand times the declared standard deviation.
const MOST_SIZES: u32 = 12;
/// Steps of least squares at every size.
const STEPS: usize = 3;
/// Sizes in a row that leave more than the one before, after which larger ones are not tried.
const MOST_RISES: usize = 2;
/// Nats by which the base model must be worse than noise for a scan, and a size better than the linearisation's to be a start.
const MIN_GAIN: f64 = 3.0;

/// Adds a start from the grid to candidates where it is better than what the linearisation leads to.
pub fn add_strong_starts(fitter: &Fitter, base: &Fitted, candidates: &mut [Candidate]) -> Result<()> {
    let Some(grid) = Grid::of(fitter, base) else { return Ok(()) };
    let Some((loss, _)) = grid.loss_from(None, None)? else { return Ok(()) };
    if loss - grid.expected() < MIN_GAIN {
        return Ok(());
    }
    let may_be_strong = |c: &&mut Candidate| c.effect.parameters.iter().any(|p| p.heavy_tailed);
    let strong = |c: &mut Candidate| {
        let found = grid.strongest(c.effect, &c.starts)?;
        c.strong = found.map(|(term, with)| (term, loss - with));
        Ok(())
    };
    candidates.par_iter_mut().filter(may_be_strong).try_for_each(strong)
}

/// A few trials, with the base model fitted to them.
struct Grid<'a> {
    fitter: &'a Fitter<'a, 'a>,
    windows: Vec<Window>,
    sd: Vec<f64>,
    latents: Vec<usize>,
    start: State,
}

impl<'a> Grid<'a> {
    /// `None` where no segment has an initial state of its own.
    fn of(fitter: &'a Fitter<'_, '_>, base: &Fitted) -> Option<Grid<'a>> {
        let data = fitter.data;
        let step = data.trials.div_ceil(TRIALS).max(1);
        let chosen = |w: &usize| {
            let window = &data.windows[*w];
            let measured = matches!(window.kind, Kind::Flight | Kind::Contact | Kind::Roll);
            measured && window.trial.is_multiple_of(step) && data.sd[*w].is_finite()
        };
        let chosen: Vec<usize> = (0..data.windows.len()).filter(chosen).collect();
        let of = |w: &usize| {
            data.windows[*w].start_whatever_acts().unwrap_or_else(|| base.state.nuisances[*w].clone())
        };
        (!chosen.is_empty()).then(|| Grid {
            fitter,
            windows: chosen.iter().map(|w| data.windows[*w].clone()).collect(),
            sd: chosen.iter().map(|w| data.sd[*w]).collect(),
            latents: base.layout.slots.iter().filter_map(Slot::latent).collect(),
            start: State::new(base.state.values.clone(), chosen.iter().map(of).collect()),
        })
    }

    /// The best start of the grid for an effect of one amplitude, if it is better than the linearisation's.
    fn strongest(&self, effect: &'static Effect, starts: &[Term]) -> Result<Option<(Term, f64)>> {
        let ([parameter], [term], SearchStrategy::FromNeutral) = (effect.parameters, starts, effect.search)
        else {
            return Ok(None);
        };
        let Some(linear) = self.linearised(term)? else { return Ok(None) };
        let mut best: Option<(f64, f64)> = None;
        for sign in [1.0, -1.0] {
            let (mut nuisances, mut last, mut rises) = (None, f64::INFINITY, 0);
            for value in sizes(parameter, sign, self.fitter.gravity) {
                let term = Term { start: vec![value], ..term.clone() };
                let Some((loss, state)) = self.loss_from(Some(&term), nuisances.take())? else { break };
                nuisances = Some(state.nuisances);
                rises = if loss > last { rises + 1 } else { 0 };
                last = loss;
                if rises == MOST_RISES {
                    break;
                }
                if best.is_none_or(|b| loss < b.0) {
                    best = Some((loss, value));
                }
            }
        }
        let better = best.filter(|(loss, _)| *loss < linear - MIN_GAIN);
        Ok(better.map(|(loss, value)| (Term { start: vec![value], ..term.clone() }, loss)))
    }

    /// Loss after steps of least squares from nothing.
    fn linearised(&self, term: &Term) -> Result<Option<f64>> {
        let free = Term { start: sized(term, &[0.0]), ..term.clone() };
        let layout = Layout::new(&self.latents, vec![free], self.settings());
        let mut start = self.start.clone();
        start.values = layout.start(&[0.0; 3]);
        start.values[..self.start.values.len()].copy_from_slice(&self.start.values);
        Ok(self.fitted(&layout, start)?.map(|(loss, _)| loss))
    }

    /// Loss with a term as it starts, or with none, from some initial states or those of the base model.
    fn loss_from(
        &self,
        term: Option<&Term>,
        nuisances: Option<Vec<Vec<f64>>>,
    ) -> Result<Option<(f64, State)>> {
        let fixed = term.map(|t| Term { free: vec![false; t.free.len()], ..t.clone() });
        let layout = Layout::new(&self.latents, fixed.into_iter().collect(), self.settings());
        let nuisances = nuisances.unwrap_or_else(|| self.start.nuisances.clone());
        self.fitted(&layout, State { nuisances, ..self.start.clone() })
    }

    fn settings(&self) -> usize {
        self.fitter.data.setting_count()
    }

    /// Negative log likelihood of the trials, each with a scale of its own, where a fit ends.
    fn fitted(&self, layout: &Layout, start: State) -> Result<Option<(f64, State)>> {
        let data = self.fitter.data;
        let data = Data::new(&self.windows, data.settings, self.sd.clone(), data.engine)
            .until_stopped(data.progress);
        let Some((state, pass)) = simulated(model::fit(&data, layout, start, STEPS))? else {
            return Ok(None);
        };
        let of = |(trial, count): (usize, f64)| {
            0.5 * (FREEDOM + count) * (pass.trials[trial].square.max(0.0) / FREEDOM).ln_1p()
        };
        let loss: f64 = self.counts().into_iter().map(of).sum();
        Ok(loss.is_finite().then_some((loss, state)))
    }

    /// The loss that noise alone would leave.
    fn expected(&self) -> f64 {
        self.counts().into_iter().map(|(_, n)| 0.5 * (FREEDOM + n) * (n / FREEDOM).ln_1p()).sum()
    }

    /// Trials with their numbers of coordinates beside initial states.
    fn counts(&self) -> Vec<(usize, f64)> {
        let mut out: Vec<(usize, f64)> = Vec::new();
        for window in &self.windows {
            let observations = (window.points.len() + window.averaged.count) as f64;
            let count = (2.0 * observations - window.nuisances.len() as f64).max(1.0);
            match out.last_mut().filter(|(trial, _)| *trial == window.trial) {
                Some((_, all)) => *all += count,
                None => out.push((window.trial, count)),
            }
        }
        out
    }
}

/// Values on one side of nothing, from the declared standard deviation to the bound, evenly spaced by the logarithm of their
/// deviation.
fn sizes(parameter: &'static ParameterDeclaration, sign: f64, gravity: f64) -> Vec<f64> {
    let [low, high] = parameter.bounds;
    let mut out = Vec::new();
    for k in 0..=MOST_SIZES {
        let deviation = sign * parameter.prior_sd * libm::pow(10.0, f64::from(k) / PER_DECADE);
        let value = parameter.at_prior_deviation(deviation, gravity);
        if !(low..=high).contains(&value) || value == parameter.neutral {
            break;
        }
        out.push(value);
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::world::effect::find;

    #[test]
    fn sizes_reach_the_bounds() {
        let of = |name: &str, sign: f64| sizes(&find(name).unwrap().parameters[0], sign, 9.81);
        let clock = of("time_scale", 1.0);
        assert!(clock[0] < 1.03 && (3.0..10.0).contains(clock.last().unwrap()), "{clock:?}");
        assert!((0.1..0.4).contains(of("time_scale", -1.0).last().unwrap()));
        assert!(*of("linear_drag", 1.0).last().unwrap() > 4000.0 && of("linear_drag", -1.0).is_empty());
        assert!(of("gravity_error", -1.0).last().unwrap() >= &-9.81);
    }
}
