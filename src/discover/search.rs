//! Which sets of effects are fitted: singles, then pairs and triples of what looks best.
//!
//! Candidates are screened by a score test at the best smaller sets; the most promising are fitted in full. Larger sets are
//! tried while the best of a size is more probable than every smaller one.

use std::cmp::Ordering;

use nalgebra::{DMatrix, DVector};
use rayon::prelude::*;

use super::fit::{FittedModel, ModelFitter, with_amplitudes};
use super::gaussian::{self, SCALE_DOF};
use super::library::Candidate;
use super::model::{FitState, ParameterLayout, Perturbation, Term};
use super::selection::SETTINGS;
use super::survey;
use super::window;
use crate::error::Result;
use crate::progress::Progress;
use crate::world::effect::{Effect, EffectTarget, REGISTRY};

/// Sets of the size before from which larger ones are made, and how many of those are fitted.
const BEAM: [(usize, usize); 2] = [(usize::MAX, 12), (3, 6)];
/// How many pairs without a shape are fitted at least: a shape bends to anything that is far off. (On ping-pong the true pair
/// was 11th of 60 pairs and first of those without a shape.)
const MIN_AMPLITUDE_ONLY_PAIRS: usize = 8;
/// Starts of an effect from which it is fitted.
const MAX_STARTS: usize = 2;
/// Steps of least squares before generalised least squares takes over.
const LEAST_SQUARES_STEPS: usize = 12;
/// Square, in units of the noise, that a plausible size must move launches by to be told at all.
const MIN_SCREENING_INFORMATION: f64 = 1.0;
/// Largest slow misfit, in units of the noise, and largest pushes, in what effects declare, under which effects are told by
/// derivatives: what a missing effect does looks like them until the effect is there.
const MAX_SCREENING_SD: f64 = 1.0;

/// The result of a search.
pub struct SearchResult {
    pub base: FittedModel,
    pub fits: Vec<FittedModel>,
    /// Log of evidence times prior probability of every fit, and of the base model.
    pub log_posterior: Vec<f64>,
    pub base_log_posterior: f64,
    /// Sets that could not be fitted.
    pub failed: Vec<Vec<&'static str>>,
}

/// A search among the sets of the library's effects.
pub struct ModelSearch<'a, 'b, 'c> {
    pub fitter: &'c ModelFitter<'a, 'b>,
    /// Candidates with their starts.
    library: Vec<Candidate>,
    latents: &'c [usize],
    seed: u64,
}

/// Log prior probability of a set of so many effects, relative to the empty set.
pub fn log_prior(size: usize) -> f64 {
    size as f64 * (SETTINGS.inclusion / (1.0 - SETTINGS.inclusion)).ln()
}

/// Log density that a candidate promises beside a fit from one of its starts, and sizes of its amplitudes there.
type ScoreTest = (f64, usize, Vec<f64>);

/// A set to be fitted.
struct CandidateSet {
    names: Vec<&'static str>,
    /// Total score that it promises.
    expected_gain: f64,
    starts: Vec<(ParameterLayout, FitState)>,
}

impl<'a, 'b, 'c> ModelSearch<'a, 'b, 'c> {
    pub fn new(
        fitter: &'c ModelFitter<'a, 'b>,
        library: Vec<Candidate>,
        latents: &'c [usize],
        seed: u64,
    ) -> Self {
        ModelSearch { fitter, library, latents, seed }
    }

    /// Searches sets of up to `most` effects.
    pub fn search(
        &mut self,
        base: FittedModel,
        most: usize,
        progress: &dyn Progress,
    ) -> Result<SearchResult> {
        let base_log_posterior = base.log_evidence;
        let mut found = SearchResult {
            base,
            fits: Vec::new(),
            log_posterior: Vec::new(),
            base_log_posterior,
            failed: Vec::new(),
        };
        self.drop_unidentifiable(&found.base)?;
        for size in 1..=most {
            let stage = ["trying single effects", "trying pairs of effects", "trying triples of effects"];
            let before = found.best_log_posterior();
            let parents: Vec<&FittedModel> = match size {
                1 => vec![&found.base],
                _ => found
                    .ranked(|f| f.effects.len() == size - 1)
                    .into_iter()
                    .take(BEAM[size.min(3) - 2].0)
                    .map(|i| &found.fits[i])
                    .collect(),
            };
            let unions =
                self.expand(&parents, &found, if size == 1 { usize::MAX } else { BEAM[size.min(3) - 2].1 })?;
            progress.report(stage[size.min(3) - 1], 0, unions.len() as u64)?;
            self.fit_sets(&mut found, unions)?;
            if size > 1 {
                let simple = self.special_cases(&found, size);
                self.fit_sets(&mut found, simple)?;
                self.refit_subsets(&mut found, size)?;
            }
            if found.best_log_posterior() <= before {
                break;
            }
        }
        Ok(found)
    }

    /// The model of a set of effects by name, fitted: one effect after the other joins, from where derivatives say it should start.
    /// `None` where one of them is no candidate, or the trials say nothing of it.
    pub fn fit_named(&self, base: &FittedModel, names: &[&str]) -> Result<Option<FittedModel>> {
        let layout = ParameterLayout::new(self.latents, Vec::new(), self.fitter.data.setting_count());
        let Some(mut fit) = self.fitter.run_gls(layout, base.state.clone())? else { return Ok(None) };
        for name in names {
            let Some(c) = self.library.iter().position(|c| c.effect.name == *name) else { return Ok(None) };
            let Some(told) = self.screen(&fit)? else { return Ok(None) };
            let union = CandidateSet {
                names: Vec::new(),
                expected_gain: 0.0,
                starts: self.initial_fits(&fit, c, &told[c], MAX_STARTS),
            };
            match self.fit_set(union)? {
                Some(found) => fit = found,
                None => return Ok(None),
            }
        }
        Ok(Some(fit))
    }

    /// A fit with a candidate beside it, at `most` of its starts with amplitudes as promised, and beside the base model where it
    /// is strong.
    fn initial_fits(
        &self,
        fit: &FittedModel,
        candidate: usize,
        promised: &[ScoreTest],
        most: usize,
    ) -> Vec<(ParameterLayout, FitState)> {
        let Candidate { starts, strong_start: strong, .. } = &self.library[candidate];
        let linear = promised.iter().take(most).map(|(_, start, sizes)| {
            let term = &starts[*start];
            Term { start: with_amplitudes(term, sizes), ..term.clone() }
        });
        let joined = |term: Term| fit.with_terms([term], self.fitter.data.setting_count());
        let strong = strong.iter().filter(|_| fit.effects.is_empty()).map(|(term, _)| {
            let (layout, state) = joined(term.clone());
            let windows = self.fitter.data.segments.iter().zip(state.nuisances);
            let nuisances = windows.map(|(w, n)| w.parabola_initial_state().unwrap_or(n)).collect();
            (layout, FitState::new(state.values, nuisances))
        });
        linear.map(joined).chain(strong).collect()
    }

    fn fit_sets(&self, found: &mut SearchResult, unions: Vec<CandidateSet>) -> Result<()> {
        let names: Vec<Vec<&'static str>> = unions.iter().map(|u| u.names.clone()).collect();
        let fitted: Vec<Result<Option<FittedModel>>> =
            unions.into_par_iter().map(|u| self.fit_set(u)).collect();
        for (fit, names) in fitted.into_iter().zip(names) {
            match fit? {
                Some(fit) => {
                    found.log_posterior.push(fit.log_evidence + log_prior(fit.effects.len()));
                    found.fits.push(fit);
                }
                None => found.failed.push(names),
            }
        }
        Ok(())
    }

    /// Fits what the best sets of a size are without one of their effects again, from where those stand: with one more effect a
    /// fit may have found the way to a better place, and a set must not lose for having missed it.
    fn refit_subsets(&self, found: &mut SearchResult, size: usize) -> Result<()> {
        let best: Vec<usize> =
            found.ranked(|f| f.effects.len() == size).into_iter().take(BEAM[1].0).collect();
        let mut again: Vec<(usize, CandidateSet)> = Vec::new();
        for (i, t) in best.iter().flat_map(|i| (0..size).map(move |t| (*i, t))) {
            let large = &found.fits[i];
            let mut names: Vec<&'static str> = large.effects.iter().map(|e| e.name).collect();
            names.remove(t);
            names.sort_unstable();
            let Some(at) = found.fits.iter().position(|f| f.effect_names() == names) else { continue };
            let (layout, values) = large.without_term(t, self.fitter.data.setting_count());
            let start = FitState::new(values, found.fits[at].state.nuisances.clone());
            again.push((at, CandidateSet { names, expected_gain: 0.0, starts: vec![(layout, start)] }));
        }
        let fitted: Vec<Result<(usize, Option<FittedModel>)>> =
            again.into_par_iter().map(|(at, union)| Ok((at, self.fit_set(union)?))).collect();
        for refitted in fitted {
            let (at, Some(fit)) = refitted? else { continue };
            let log_posterior = fit.log_evidence + log_prior(fit.effects.len());
            if log_posterior > found.log_posterior[at] {
                (found.fits[at], found.log_posterior[at]) = (fit, log_posterior);
            }
        }
        Ok(())
    }

    /// The best fit of a set's starts.
    fn fit_set(&self, union: CandidateSet) -> Result<Option<FittedModel>> {
        let mut best: Option<FittedModel> = None;
        let surveyed = |layout: &ParameterLayout| {
            layout.terms.len() < 2 && survey::is_applicable(self.fitter.data, layout)
        };
        for (layout, start) in union.starts {
            let start = match surveyed(&layout) {
                true => {
                    match super::fit::none_if_not_simulable(survey::global_search(
                        self.fitter.data,
                        &layout,
                        &start,
                        self.seed,
                    ))? {
                        Some(found) => found,
                        None => continue,
                    }
                }
                false => start,
            };
            let rounds = if self.fitter.data.cached_jacobians.is_empty() { LEAST_SQUARES_STEPS } else { 5 };
            let Some(fit) = self.fitter.fit(layout, start, rounds)? else { continue };
            if best.as_ref().is_none_or(|b| fit.log_evidence > b.log_evidence) {
                best = Some(fit);
            }
        }
        Ok(best)
    }

    /// The most promising unions of some fits and a candidate.
    fn expand(
        &self,
        parents: &[&FittedModel],
        found: &SearchResult,
        most: usize,
    ) -> Result<Vec<CandidateSet>> {
        let mut all: Vec<CandidateSet> = Vec::new();
        for fit in parents {
            let Some(told) = self.screen(fit)? else { continue };
            for (c, Candidate { effect, .. }) in self.library.iter().enumerate() {
                let mut names = fit.effect_names();
                names.push(effect.name);
                names.sort_unstable();
                if told[c].is_empty() || found.fits.iter().any(|f| f.effect_names() == names) {
                    continue;
                }
                // What chance gives a parameter, and what the choice costs.
                let own = fit.effect_parameter_count() + effect.parameters.len();
                let promise = told[c][0].0 - own as f64 + log_prior(names.len());
                // A survey frames regions by itself.
                let framed = effect.target() == EffectTarget::Region
                    && window::any_one_step(self.fitter.data.segments);
                let starts = self.initial_fits(fit, c, &told[c], if framed { 1 } else { MAX_STARTS });
                let union = CandidateSet { names, expected_gain: promise, starts };
                match all.iter_mut().find(|u| u.names == union.names) {
                    Some(known) if known.expected_gain >= promise => {}
                    Some(known) => *known = union,
                    None => all.push(union),
                }
            }
        }
        all.sort_by(|a, b| b.expected_gain.total_cmp(&a.expected_gain));
        // No set stands where a plainer one was never tried.
        let shaped = |e: &Effect| e.parameters.iter().any(|p| !p.is_amplitude());
        let plain = |u: &CandidateSet| {
            u.names.len() == 2
                && !self.library.iter().any(|c| u.names.contains(&c.effect.name) && shaped(c.effect))
        };
        let (mut place, mut plainer) = (0, 0);
        all.retain(|u| {
            place += 1;
            plainer += usize::from(plain(u));
            place <= most || (plain(u) && plainer <= MIN_AMPLITUDE_ONLY_PAIRS)
        });
        Ok(all)
    }

    /// Takes candidates away of which the data cannot tell anything: what a plausible size does, the starts take up.
    fn drop_unidentifiable(&mut self, base: &FittedModel) -> Result<()> {
        let Some(told) = self.screen(base)? else { return Ok(()) };
        let mut told = told.into_iter();
        self.library.retain(|_| told.next().is_some_and(|t| !t.is_empty()));
        Ok(())
    }

    /// By candidate: what its starts promise (log density, start, sizes of amplitudes), best first; empty for what is in the set.
    fn screen(&self, fit: &FittedModel) -> Result<Option<Vec<Vec<ScoreTest>>>> {
        let mut extras = Vec::new();
        let mut of = Vec::new();
        for (c, Candidate { effect, starts: terms, .. }) in self.library.iter().enumerate() {
            if fit.effects.iter().any(|e| e.name == effect.name) {
                continue;
            }
            for (s, term) in terms.iter().enumerate() {
                let own = amplitude_perturbations(term);
                of.push((c, s, extras.len(), own.len()));
                extras.extend(own);
            }
        }
        let Some((_, parts)) = self.fitter.groups(&fit.layout, &fit.state, &extras)? else {
            return Ok(None);
        };
        let q = fit.layout.parameters.len();
        let mut components = fit.components.clone();
        components.discrepancy = components.discrepancy.min(MAX_SCREENING_SD);
        components.accelerations.iter_mut().for_each(|p| *p = p.min(MAX_SCREENING_SD));
        let Some(told) = gaussian::group_statistics(&parts, &components) else { return Ok(None) };
        let (own, here) = (self.fitter.prior(&fit.layout, &fit.state), DVector::zeros(q + extras.len()));
        let before: f64 = told.iter().map(|t| t.log_density_after(&here)).sum();
        let settings = self.fitter.data.settings;
        let mut out: Vec<Vec<ScoreTest>> = self.library.iter().map(|_| Vec::new()).collect();
        for (c, s, from, count) in of {
            let term = &self.library[c].starts[s];
            let chosen: Vec<usize> = (0..q).chain(q + from..q + from + count).collect();
            let weak = amplitude_precisions(term);
            let tells = |k: usize| {
                told.iter().map(|t| t.gram[(q + from + k, q + from + k)]).sum::<f64>()
                    > MIN_SCREENING_INFORMATION * weak[k]
            };
            if !(0..count).any(tells) {
                continue;
            }
            let gain = |setting: Option<usize>| {
                let n = chosen.len();
                let (mut gram, mut score) = (DMatrix::zeros(n, n), DVector::zeros(n));
                for t in told.iter().filter(|t| setting.is_none_or(|s| settings[t.trial] == s)) {
                    // Each launch has a scale of its own.
                    let weight = (SCALE_DOF + t.count) / (SCALE_DOF + t.square.max(0.0));
                    for (i, a) in chosen.iter().enumerate() {
                        score[i] += weight * t.score[*a];
                        for (j, b) in chosen.iter().enumerate() {
                            gram[(i, j)] += weight * t.gram[(*a, *b)];
                        }
                    }
                }
                (0..q).for_each(|i| (0..q).for_each(|j| gram[(i, j)] += own.precision[(i, j)]));
                (q..n).for_each(|k| gram[(k, k)] += weak[k - q]);
                let step = gram.cholesky()?.solve(&score);
                Some((0.5 * score.dot(&step), step.rows(q, count).iter().copied().collect::<Vec<f64>>()))
            };
            let told: Vec<(f64, Vec<f64>)> = match term.per_setting {
                true => (0..self.fitter.data.setting_count()).filter_map(|s| gain(Some(s))).collect(),
                false => gain(None).into_iter().collect(),
            };
            if told.is_empty() {
                continue;
            }
            let sizes = (0..count).map(|k| told.iter().map(|t| t.1[k]).sum::<f64>() / told.len() as f64);
            out[c].push((before + told.iter().map(|t| t.0).sum::<f64>(), s, sizes.collect()));
        }
        out.iter_mut().for_each(|o| o.sort_by(|a, b| b.0.partial_cmp(&a.0).unwrap_or(Ordering::Equal)));
        Ok(Some(out))
    }

    /// What the best sets of a size hold in a limit: no effect of many parameters stands where a simple one was never tried.
    fn special_cases(&self, found: &SearchResult, size: usize) -> Vec<CandidateSet> {
        let mut out: Vec<CandidateSet> = Vec::new();
        for i in found.ranked(|f| f.effects.len() == size).into_iter().take(3) {
            let own = &found.fits[i].layout.terms;
            for (large, small) in
                REGISTRY.iter().flat_map(|e| e.special_cases.iter().map(move |h| (e.name, h.name)))
            {
                let candidate = self.library.iter().find(|c| c.effect.name == small);
                let (Some(at), Some(term)) = (
                    own.iter().position(|t| t.effect.name == large),
                    candidate.and_then(|c| c.starts.first()),
                ) else {
                    continue;
                };
                let mut terms = own.clone();
                terms[at] = term.clone();
                let mut names: Vec<&'static str> = terms.iter().map(|t| t.effect.name).collect();
                names.sort_unstable();
                names.dedup();
                let known = |n: &Vec<&str>| {
                    found.fits.iter().any(|f| f.effect_names() == *n) || out.iter().any(|u| u.names == *n)
                };
                if names.len() < terms.len() || known(&names) {
                    continue;
                }
                let layout = ParameterLayout::new(self.latents, terms, self.fitter.data.setting_count());
                let mut values = layout.initial_values(&[0.0; 3]);
                let latents = found.base.layout.latent_count();
                values[..latents].copy_from_slice(&found.base.state.values[..latents]);
                let start = FitState::new(values, found.base.state.nuisances.clone());
                out.push(CandidateSet { names, expected_gain: 0.0, starts: vec![(layout, start)] });
            }
        }
        out
    }
}

/// The directions of a term's amplitudes at its start.
fn amplitude_perturbations(term: &Term) -> Vec<Perturbation> {
    let parameters = term.effect.parameters;
    let shapes = |p: usize| !parameters[p].is_amplitude();
    let direction = |p: usize| {
        let own = |k: usize| match k {
            _ if shapes(k) => term.start[k],
            _ if k == p => parameters[k].neutral + parameters[k].fd_step,
            _ => parameters[k].neutral,
        };
        Perturbation {
            effect: term.effect,
            values: (0..parameters.len()).map(own).collect(),
            unit: parameters[p].fd_step,
        }
    };
    (0..parameters.len()).filter(|p| !shapes(*p) && term.free[*p]).map(direction).collect()
}

/// Precisions of what is believed of a term's amplitudes.
fn amplitude_precisions(term: &Term) -> Vec<f64> {
    let parameters = term.effect.parameters.iter().zip(&term.free);
    parameters.filter(|(p, free)| p.is_amplitude() && **free).map(|(p, _)| p.prior_sd.powi(-2)).collect()
}

impl SearchResult {
    /// Indices of fits, best first.
    pub fn ranked(&self, which: impl Fn(&FittedModel) -> bool) -> Vec<usize> {
        let mut order: Vec<usize> = (0..self.fits.len()).filter(|i| which(&self.fits[*i])).collect();
        order.sort_by(|a, b| self.log_posterior[*b].total_cmp(&self.log_posterior[*a]).then(a.cmp(b)));
        order
    }

    /// The largest log posterior, the base model's among them.
    pub fn best_log_posterior(&self) -> f64 {
        self.log_posterior.iter().copied().fold(self.base_log_posterior, f64::max)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::discover::fixture::term;

    /// A gust is told by its push along x and along y, its period and phase being where its search starts.
    #[test]
    fn a_direction_moves_one_amplitude() {
        let mut gust = term("gust");
        gust.start[2] = 1.7;
        let all = amplitude_perturbations(&gust);
        assert_eq!(all.len(), 2);
        for (k, extra) in all.iter().enumerate() {
            assert!(extra.values[k] != gust.start[k] && extra.values[1 - k] == gust.start[1 - k]);
            assert_eq!(extra.values[2..], gust.start[2..]);
        }
    }
}
