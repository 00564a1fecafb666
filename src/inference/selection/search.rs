//! Search over sets of effects: singles, then pairs and triples.
//!
//! Candidates are screened by a score test at the best smaller sets; the most promising are fitted. Larger
//! sets are tried while the best of a size is more probable than every smaller one.

use std::sync::{Mutex, PoisonError};

use rayon::prelude::*;

use crate::error::Result;
use crate::inference::global_search;
use crate::inference::mixed_model::fitted_model::FittedModel;
use crate::inference::mixed_model::model_fit::{ModelFitter, with_amplitudes};
use crate::inference::model::{FitState, ParameterLayout, Term};
use crate::inference::segment;
use crate::inference::selection::SETTINGS;
use crate::inference::selection::candidates::Candidate;
use crate::inference::selection::screening::{ScoreTest, screen};
use crate::progress::Progress;
use crate::world::effect::{Effect, EffectTarget, REGISTRY};

/// Number of smaller sets that are extended, and number of extended sets that are fitted, for pairs and
/// triples.
const BEAM: [(usize, usize); 2] = [(usize::MAX, 12), (3, 6)];
/// Minimum number of fitted pairs without shape parameters, since shapes adapt to any misfit.
const MIN_AMPLITUDE_ONLY_PAIRS: usize = 8;
/// Maximum number of initial values per effect.
const MAX_STARTS: usize = 2;
/// Least-squares steps before generalised least squares, and with cached Jacobians.
const LEAST_SQUARES_STEPS: usize = 12;
const LEAST_SQUARES_STEPS_CACHED: usize = 5;
/// Relative difference of parameters up to which two least-squares fits ended at the same optimum.
const SAME_OPTIMUM: f64 = 0.01;
/// Result of a search.
pub struct SearchResult {
    pub base: FittedModel,
    pub fits: Vec<FittedModel>,
    /// Log posterior (evidence times prior probability) of every fit, and of the base model.
    pub log_posterior: Vec<f64>,
    pub base_log_posterior: f64,
    /// Sets whose fit failed.
    pub failed: Vec<Vec<&'static str>>,
}

/// Search over sets of effects.
pub struct ModelSearch<'a, 'b, 'c> {
    pub fitter: &'c ModelFitter<'a, 'b>,
    /// Candidates with their initial values.
    pub library: Vec<Candidate>,
    latents: &'c [usize],
    seed: u64,
}

/// Log prior probability of a set of `size` effects, relative to the empty set.
pub fn log_prior(size: usize) -> f64 {
    size as f64 * (SETTINGS.inclusion / (1.0 - SETTINGS.inclusion)).ln()
}

/// Log prior probability of a fitted set; of a stepwise parameter every distinguishable value is as probable.
fn log_prior_of(fit: &FittedModel) -> f64 {
    let brackets = fit.layout.terms.iter().filter_map(|t| t.bracket);
    log_prior(fit.effects.len()) - brackets.map(|b| (b.count.max(1) as f64).ln()).sum::<f64>()
}

/// A candidate set with its initial states.
struct CandidateSet {
    names: Vec<&'static str>,
    /// Expected log posterior by the score test.
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
    pub fn search(&self, base: FittedModel, most: usize, progress: &dyn Progress) -> Result<SearchResult> {
        let base_log_posterior = base.log_evidence;
        let mut found = SearchResult {
            base,
            fits: Vec::new(),
            log_posterior: Vec::new(),
            base_log_posterior,
            failed: Vec::new(),
        };
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
            let candidate_sets =
                self.expand(&parents, &found, if size == 1 { usize::MAX } else { BEAM[size.min(3) - 2].1 })?;
            let stage = (progress, stage[size.min(3) - 1]);
            self.fit_sets(&mut found, candidate_sets, stage)?;
            if size == 1 {
                self.refit_base(&mut found)?;
            } else {
                let simple = self.special_cases(&found, size);
                self.fit_sets(&mut found, simple, stage)?;
                self.refit_subsets(&mut found, size)?;
            }
            if found.best_log_posterior() <= before {
                break;
            }
        }
        Ok(found)
    }

    /// Fits a set of effects by name, adding one effect after the other. `None` if an effect is no candidate,
    /// cannot be identified, or the fit fails.
    pub fn fit_named(&self, base: &FittedModel, names: &[&str]) -> Result<Option<FittedModel>> {
        let layout = ParameterLayout::new(self.latents, Vec::new(), self.fitter.data.setting_count());
        let Some(mut fit) = self.fitter.run_gls(layout, base.state.clone())? else { return Ok(None) };
        for name in names {
            let Some(c) = self.library.iter().position(|c| c.effect.name == *name) else { return Ok(None) };
            let Some(tests) = screen(self.fitter, &self.library, &fit)? else { return Ok(None) };
            let candidate_set = CandidateSet {
                names: Vec::new(),
                expected_gain: 0.0,
                starts: self.initial_fits(&fit, c, &tests[c], MAX_STARTS),
            };
            match self.fit_set(candidate_set)? {
                Some(found) => fit = found,
                None => return Ok(None),
            }
        }
        Ok(Some(fit))
    }

    /// Initial states of a fit extended by a candidate: at `most` of its initial values with amplitudes from
    /// the score test, and at its strong start if the fit is the base model.
    fn initial_fits(
        &self,
        fit: &FittedModel,
        candidate: usize,
        promised: &[ScoreTest],
        most: usize,
    ) -> Vec<(ParameterLayout, FitState)> {
        let Candidate { starts, strong_start: strong, .. } = &self.library[candidate];
        if let Some((term, _)) = strong.iter().find(|(term, _)| term.bracket.is_some()) {
            return vec![fit.with_terms([term.clone()], self.fitter.data.setting_count())];
        }
        let linear = promised.iter().take(most).map(|(_, start, sizes)| {
            let term = &starts[*start];
            Term { start: with_amplitudes(term, sizes), ..term.clone() }
        });
        let joined = |term: Term| fit.with_terms([term], self.fitter.data.setting_count());
        let strong = strong.iter().filter(|_| fit.effects.is_empty()).map(|(term, _)| {
            let (layout, state) = joined(term.clone());
            let segments = self.fitter.data.segments.iter().zip(state.nuisances);
            let nuisances = segments.map(|(w, n)| w.parabola_initial_state().unwrap_or(n)).collect();
            (layout, FitState::new(state.values, nuisances))
        });
        linear.map(joined).chain(strong).collect()
    }

    fn fit_sets(
        &self,
        found: &mut SearchResult,
        candidate_sets: Vec<CandidateSet>,
        (progress, stage): (&dyn Progress, &str),
    ) -> Result<()> {
        let names: Vec<Vec<&'static str>> = candidate_sets.iter().map(|u| u.names.clone()).collect();
        let (total, done) = (candidate_sets.len() as u64, Mutex::new(0));
        progress.report(stage, 0, total)?;
        let fit = |candidate_set: CandidateSet| {
            let fitted = self.fit_set(candidate_set)?;
            let mut done = done.lock().unwrap_or_else(PoisonError::into_inner);
            *done += 1;
            progress.report(stage, *done, total)?;
            Ok(fitted)
        };
        let fitted: Vec<Result<Option<FittedModel>>> = candidate_sets.into_par_iter().map(fit).collect();
        for (fit, names) in fitted.into_iter().zip(names) {
            match fit? {
                Some(fit) => {
                    found.log_posterior.push(fit.log_evidence + log_prior_of(&fit));
                    found.fits.push(fit);
                }
                None => found.failed.push(names),
            }
        }
        Ok(())
    }

    /// Refits the base model from the latents of the best single effects: these may have found a better optimum.
    fn refit_base(&self, found: &mut SearchResult) -> Result<()> {
        if self.latents.is_empty() {
            return Ok(());
        }
        let best: Vec<usize> = found.ranked(|f| f.effects.len() == 1).into_iter().take(BEAM[1].0).collect();
        let start = |i: usize| {
            let (layout, values) = found.fits[i].without_term(0, self.fitter.data.setting_count());
            (layout, FitState::new(values, found.base.state.nuisances.clone()))
        };
        let starts: Vec<(ParameterLayout, FitState)> = best.into_iter().map(start).collect();
        // Least squares, without the errors of impacts, may lead to another optimum.
        let near = starts.clone().into_iter().map(|(layout, start)| self.fitter.run_gls(layout, start));
        let mut fits: Vec<FittedModel> = near.collect::<Result<Vec<_>>>()?.into_iter().flatten().collect();
        fits.extend(self.fit_set(CandidateSet { names: Vec::new(), expected_gain: 0.0, starts })?);
        for fit in fits {
            if fit.log_evidence > found.base_log_posterior {
                found.base_log_posterior = fit.log_evidence;
                found.base = fit;
            }
        }
        Ok(())
    }

    /// Refits subsets of the best sets from the fitted values of those: a larger model may have found a
    /// better optimum.
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
            let start = (layout, FitState::new(values, found.fits[at].state.nuisances.clone()));
            match again.iter_mut().find(|(known, _)| *known == at) {
                Some((_, candidate_set)) => candidate_set.starts.push(start),
                None => again.push((at, CandidateSet { names, expected_gain: 0.0, starts: vec![start] })),
            }
        }
        let fitted: Vec<Result<(usize, Option<FittedModel>)>> =
            again.into_par_iter().map(|(at, candidate_set)| Ok((at, self.fit_set(candidate_set)?))).collect();
        for refitted in fitted {
            let (at, Some(fit)) = refitted? else { continue };
            let log_posterior = fit.log_evidence + log_prior_of(&fit);
            if log_posterior > found.log_posterior[at] {
                (found.fits[at], found.log_posterior[at]) = (fit, log_posterior);
            }
        }
        Ok(())
    }

    /// Best fit over the initial states of a set.
    fn fit_set(&self, candidate_set: CandidateSet) -> Result<Option<FittedModel>> {
        let mut best: Option<FittedModel> = None;
        // Order of the terms, and values of the parameters.
        let mut optima: Vec<(Vec<&'static str>, Vec<f64>)> = Vec::new();
        let steps = match self.fitter.data.cached_jacobians.is_empty() {
            true => LEAST_SQUARES_STEPS,
            false => LEAST_SQUARES_STEPS_CACHED,
        };
        let surveyed = |layout: &ParameterLayout| {
            layout.terms.len() < 2 && global_search::is_applicable(self.fitter.data, layout)
        };
        for (layout, start) in candidate_set.starts {
            let start = match surveyed(&layout) {
                true => {
                    match crate::inference::mixed_model::model_fit::none_if_not_simulable(
                        global_search::global_search(self.fitter.data, &layout, &start, self.seed),
                    )? {
                        Some(found) => found,
                        None => continue,
                    }
                }
                false => start,
            };
            let Some(start) = self.fitter.least_squares(&layout, start, steps)? else { continue };
            // Another start led to the same optimum.
            let names = layout.terms.iter().map(|t| t.effect.name).collect::<Vec<_>>();
            if optima.iter().any(|(order, values)| *order == names && are_close(values, &start.values)) {
                continue;
            }
            optima.push((names, start.values.clone()));
            let Some(fit) = self.fitter.run_gls(layout, start)? else { continue };
            if best.as_ref().is_none_or(|b| fit.log_evidence > b.log_evidence) {
                best = Some(fit);
            }
        }
        Ok(best)
    }

    /// Extensions of fits by one candidate, most promising first.
    fn expand(
        &self,
        parents: &[&FittedModel],
        found: &SearchResult,
        most: usize,
    ) -> Result<Vec<CandidateSet>> {
        let mut all: Vec<CandidateSet> = Vec::new();
        for fit in parents {
            let Some(tests) = screen(self.fitter, &self.library, fit)? else { continue };
            for (c, Candidate { effect, .. }) in self.library.iter().enumerate() {
                let mut names = fit.effect_names();
                names.push(effect.name);
                names.sort_unstable();
                if tests[c].is_empty() || found.fits.iter().any(|f| f.effect_names() == names) {
                    continue;
                }
                // Minus the expected gain by chance and the prior penalty.
                let own = fit.effect_parameter_count() + effect.parameters.len();
                let expected_gain = tests[c][0].0 - own as f64 + log_prior(names.len());
                // The global search initialises regions itself.
                let framed = effect.target() == EffectTarget::Region
                    && segment::any_one_step(self.fitter.data.segments);
                let starts = self.initial_fits(fit, c, &tests[c], if framed { 1 } else { MAX_STARTS });
                let candidate_set = CandidateSet { names, expected_gain, starts };
                match all.iter_mut().find(|u| u.names == candidate_set.names) {
                    Some(known) if known.expected_gain >= expected_gain => {}
                    Some(known) => *known = candidate_set,
                    None => all.push(candidate_set),
                }
            }
        }
        all.sort_by(|a, b| b.expected_gain.total_cmp(&a.expected_gain));
        // Pairs without shape parameters are always tried.
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

    /// Drops candidates that the data cannot identify: the nuisances absorb the response to a plausible amplitude.
    pub fn drop_unidentifiable(mut self, base: &FittedModel) -> Result<Self> {
        let Some(tests) = screen(self.fitter, &self.library, base)? else { return Ok(self) };
        let mut tests = tests.into_iter();
        self.library.retain(|_| tests.next().is_some_and(|tests| !tests.is_empty()));
        Ok(self)
    }

    /// Special cases of the best sets that were not tried.
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

/// Whether two parameter vectors differ by rounding and by the tolerance of least squares alone.
fn are_close(a: &[f64], b: &[f64]) -> bool {
    a.iter().zip(b).all(|(a, b)| (a - b).abs() <= SAME_OPTIMUM * a.abs().max(b.abs()))
}

impl SearchResult {
    /// Indices of fits, most probable first.
    pub fn ranked(&self, which: impl Fn(&FittedModel) -> bool) -> Vec<usize> {
        let mut order: Vec<usize> = (0..self.fits.len()).filter(|i| which(&self.fits[*i])).collect();
        order.sort_by(|a, b| self.log_posterior[*b].total_cmp(&self.log_posterior[*a]).then(a.cmp(b)));
        order
    }

    /// Largest log posterior, the base model included.
    pub fn best_log_posterior(&self) -> f64 {
        self.log_posterior.iter().copied().fold(self.base_log_posterior, f64::max)
    }
}
