//! Initial values for strong effects on a logarithmic grid of amplitudes.
//!
//! The linearisation at neutral values does not lead to a clock of half the rate or a drag of 60/s. Every
//! effect with a heavy-tailed prior is therefore tried at increasing amplitudes up to its bounds, with
//! initial states of a few trials refitted; the best amplitude becomes an initial value if it is better than
//! the optimum reached from neutral values.
//!
//! Source: numerical continuation (Allgower and Georg, Introduction to Numerical Continuation Methods, 2003, chapter 2).

use rayon::prelude::*;

use crate::error::Result;
use crate::inference::mixed_model::fitted_model::FittedModel;
use crate::inference::mixed_model::group_statistics::SCALE_DOF;
use crate::inference::mixed_model::model_fit::{ModelFitter, none_if_not_simulable, with_amplitudes};
use crate::inference::model::{self, Bracket, FitState, Parameter, ParameterLayout, SegmentData, Term};
use crate::inference::segment::Segment;
use crate::inference::selection::SETTINGS;
use crate::inference::selection::candidates::Candidate;
use crate::inference::statistics::EXCLUSION_NATS;
use crate::world::effect::{Effect, ParameterDeclaration, SearchStrategy};

/// Maximum number of trials used.
const MAX_TRIALS: usize = 12;
/// Grid points per decade.
const SIZES_PER_DECADE: f64 = 3.0;
/// Grid points per sign, up to 10^4 times the declared standard deviation.
const MAX_SIZES: u32 = 12;
/// Least-squares steps per grid point.
const STEPS: usize = 3;
/// Consecutive increases of the loss after which the scan ends.
const MAX_RISES: usize = 2;
/// Minimum excess of the base model over the noise, and minimum gain of a strong start, nats.
const MIN_GAIN: f64 = 3.0;

/// Adds strong starts to candidates for which they are better.
pub fn add_strong_starts(
    fitter: &ModelFitter,
    base: &FittedModel,
    candidates: &mut [Candidate],
) -> Result<()> {
    let Some(grid) = StartGrid::of(fitter, base) else { return Ok(()) };
    let Some((loss, _)) = grid.loss_at(None, None)? else { return Ok(()) };
    if loss - grid.noise_loss() < MIN_GAIN {
        return Ok(());
    }
    let may_be_strong = |c: &&mut Candidate| c.effect.parameters.iter().any(|p| p.heavy_tailed || p.stepwise);
    let strong = |c: &mut Candidate| {
        let found = grid.best_strong_start(c.effect, &c.starts)?;
        c.strong_start = found.map(|(term, with)| (term, loss - with));
        Ok(())
    };
    candidates.par_iter_mut().filter(may_be_strong).try_for_each(strong)
}

/// A subset of the trials, with the base model fitted.
struct StartGrid<'a> {
    fitter: &'a ModelFitter<'a, 'a>,
    segments: Vec<Segment>,
    sd: Vec<f64>,
    latents: Vec<usize>,
    start: FitState,
}

impl<'a> StartGrid<'a> {
    /// `None` if no segment has a free initial state.
    fn of(fitter: &'a ModelFitter<'_, '_>, base: &FittedModel) -> Option<StartGrid<'a>> {
        let data = fitter.data;
        let step = data.trial_count.div_ceil(MAX_TRIALS).max(1);
        let chosen = |w: &usize| {
            let segment = &data.segments[*w];
            segment.kind.has_free_initial_state()
                && segment.trial.is_multiple_of(step)
                && data.sd[*w].is_finite()
        };
        let chosen: Vec<usize> = (0..data.segments.len()).filter(chosen).collect();
        let of = |w: &usize| {
            data.segments[*w].parabola_initial_state().unwrap_or_else(|| base.state.nuisances[*w].clone())
        };
        (!chosen.is_empty()).then(|| StartGrid {
            fitter,
            segments: chosen.iter().map(|w| data.segments[*w].clone()).collect(),
            sd: chosen.iter().map(|w| data.sd[*w]).collect(),
            latents: base.layout.parameters.iter().filter_map(Parameter::latent).collect(),
            start: FitState::new(base.state.values.clone(), chosen.iter().map(of).collect()),
        })
    }

    /// Best strong start of an effect with one amplitude, with its loss; `None` if it is not better than the
    /// neutral start.
    fn best_strong_start(&self, effect: &'static Effect, starts: &[Term]) -> Result<Option<(Term, f64)>> {
        if effect.parameters.len() == 1 && effect.parameters[0].stepwise {
            return self.best_step(&starts[0]);
        }
        let ([parameter], [term], SearchStrategy::FromNeutral) = (effect.parameters, starts, effect.search)
        else {
            return Ok(None);
        };
        let Some(linear) = self.neutral_start_loss(term)? else { return Ok(None) };
        let mut best: Option<(f64, f64)> = None;
        for sign in [1.0, -1.0] {
            let (mut nuisances, mut last, mut rises) = (None, f64::INFINITY, 0);
            for value in amplitude_grid(parameter, sign, self.fitter.gravity) {
                let term = Term { start: vec![value], ..term.clone() };
                let Some((loss, state)) = self.loss_at(Some(&term), nuisances.take())? else { break };
                nuisances = Some(state.nuisances);
                rises = if loss > last { rises + 1 } else { 0 };
                last = loss;
                if rises == MAX_RISES {
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

    /// Best value of a threshold for the approach speed of impacts: between two neighbouring speeds of the data.
    fn best_step(&self, term: &Term) -> Result<Option<(Term, f64)>> {
        let Some((neutral, _)) = self.loss_at(None, None)? else { return Ok(None) };
        let Some((first, loss)) = self.scan_steps(term, &self.impact_speeds(None, &self.start))? else {
            return Ok(None);
        };
        if loss >= neutral - MIN_GAIN {
            return Ok(None);
        }
        // Impacts that the base model fits badly have other speeds under the threshold.
        let Some((_, state)) = self.loss_at(Some(&first), None)? else { return Ok(None) };
        Ok(self.scan_steps(term, &self.impact_speeds(Some(&first), &state))?.or(Some((first, loss))))
    }

    /// Approach speeds of all impacts under a fixed term or none, sorted, m/s.
    fn impact_speeds(&self, term: Option<&Term>, state: &FitState) -> Vec<f64> {
        let layout =
            ParameterLayout::new(&self.latents, term.cloned().into_iter().collect(), self.settings());
        let approach = |(w, segment): (usize, &Segment)| {
            segment.kind.is_impact().then(|| model::impact(segment, w, &layout, state)).flatten()
        };
        let impacts = self.segments.iter().enumerate().filter_map(approach);
        let mut speeds: Vec<f64> = impacts.map(|impact| impact.approach).collect();
        speeds.sort_by(f64::total_cmp);
        speeds.dedup();
        speeds
    }

    /// The threshold between two of some speeds with the smallest loss.
    fn scan_steps(&self, term: &Term, speeds: &[f64]) -> Result<Option<(Term, f64)>> {
        let between = |low: f64, high: f64, bracket| Term {
            start: vec![0.5 * (low + high)],
            free: vec![false],
            bracket,
            ..term.clone()
        };
        let loss = |pair: &[f64]| -> Result<f64> {
            let found = self.loss_at(Some(&between(pair[0], pair[1], None)), None)?;
            Ok(found.map_or(f64::INFINITY, |(loss, _)| loss))
        };
        let losses = speeds.windows(2).map(loss).collect::<Result<Vec<f64>>>()?;
        let Some(best) = (0..losses.len()).min_by(|a, b| losses[*a].total_cmp(&losses[*b])) else {
            return Ok(None);
        };
        // Impacts that bounce too low to be seen do not tell neighbouring values apart.
        let equal = |i: &usize| losses[*i] < losses[best] + EXCLUSION_NATS;
        let first = (0..=best).rev().take_while(equal).last().unwrap_or(best);
        let last = (best..losses.len()).take_while(equal).last().unwrap_or(best);
        // Approach speeds are known as well as impacts follow any law.
        let error = SETTINGS.discrepancy_of_impact[0];
        let interval = [(1.0 - error) * speeds[first], (1.0 + error) * speeds[last + 1]];
        let bracket = Some(Bracket { interval, count: speeds.len() / (last + 1 - first) });
        Ok(Some((between(interval[0], interval[1], bracket), losses[best])))
    }

    /// Loss after a fit from neutral values.
    fn neutral_start_loss(&self, term: &Term) -> Result<Option<f64>> {
        let free = Term { start: with_amplitudes(term, &[0.0]), ..term.clone() };
        let layout = ParameterLayout::new(&self.latents, vec![free], self.settings());
        let mut start = self.start.clone();
        start.values = layout.initial_values(&[0.0; 3]);
        start.values[..self.start.values.len()].copy_from_slice(&self.start.values);
        Ok(self.fitted(&layout, start)?.map(|(loss, _)| loss))
    }

    /// Loss with a fixed term or none, from given initial states or those of the base model.
    fn loss_at(
        &self,
        term: Option<&Term>,
        nuisances: Option<Vec<Vec<f64>>>,
    ) -> Result<Option<(f64, FitState)>> {
        let fixed = term.map(|t| Term { free: vec![false; t.free.len()], ..t.clone() });
        let layout = ParameterLayout::new(&self.latents, fixed.into_iter().collect(), self.settings());
        let nuisances = nuisances.unwrap_or_else(|| self.start.nuisances.clone());
        self.fitted(&layout, FitState { nuisances, ..self.start.clone() })
    }

    fn settings(&self) -> usize {
        self.fitter.data.setting_count()
    }

    /// Negative log likelihood of the trials, each with its scale integrated out, and the fitted state.
    fn fitted(&self, layout: &ParameterLayout, start: FitState) -> Result<Option<(f64, FitState)>> {
        let data = self.fitter.data;
        let data = SegmentData::new(&self.segments, data.settings, self.sd.clone(), data.engine)
            .until_stopped(data.progress);
        let Some((state, pass)) = none_if_not_simulable(model::fit(&data, layout, start, STEPS))? else {
            return Ok(None);
        };
        let of = |(trial, count): (usize, f64)| {
            0.5 * (SCALE_DOF + count) * (pass.normal_equations[trial].square.max(0.0) / SCALE_DOF).ln_1p()
        };
        let loss: f64 = self.residual_dof().into_iter().map(of).sum();
        Ok(loss.is_finite().then_some((loss, state)))
    }

    /// Expected loss of noise alone.
    fn noise_loss(&self) -> f64 {
        self.residual_dof().into_iter().map(|(_, n)| 0.5 * (SCALE_DOF + n) * (n / SCALE_DOF).ln_1p()).sum()
    }

    /// Trials with their residual degrees of freedom.
    fn residual_dof(&self) -> Vec<(usize, f64)> {
        let mut out: Vec<(usize, f64)> = Vec::new();
        for segment in &self.segments {
            let observations = (segment.observations.len() + segment.within_blocks.merged_count) as f64;
            let count = (2.0 * observations - segment.nuisances.len() as f64).max(1.0);
            match out.last_mut().filter(|(trial, _)| *trial == segment.trial) {
                Some((_, all)) => *all += count,
                None => out.push((segment.trial, count)),
            }
        }
        out
    }
}

/// Amplitudes of one sign from the declared standard deviation to the bound, evenly spaced in the logarithm
/// of their deviation.
fn amplitude_grid(parameter: &'static ParameterDeclaration, sign: f64, gravity: f64) -> Vec<f64> {
    let [low, high] = parameter.bounds;
    let mut out = Vec::new();
    for k in 0..=MAX_SIZES {
        let deviation = sign * parameter.prior_sd * libm::pow(10.0, f64::from(k) / SIZES_PER_DECADE);
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
        let of = |name: &str, sign: f64| amplitude_grid(&find(name).unwrap().parameters[0], sign, 9.81);
        let clock = of("time_scale", 1.0);
        assert!(clock[0] < 1.03 && (3.0..10.0).contains(clock.last().unwrap()), "{clock:?}");
        assert!((0.1..0.4).contains(of("time_scale", -1.0).last().unwrap()));
        assert!(*of("linear_drag", 1.0).last().unwrap() > 4000.0 && of("linear_drag", -1.0).is_empty());
        assert!(of("gravity_error", -1.0).last().unwrap() >= &-9.81);
    }
}
