//! Which sets of effects are fitted: singles, then pairs and triples of what looks best.
//!
//! Candidates are screened by a score test at the best smaller sets; the most promising are fitted in full. Larger sets are
//! tried while the best of a size is more probable than every smaller one.

use std::cmp::Ordering;
use std::sync::{Mutex, PoisonError};

use nalgebra::{DMatrix, DVector};
use rayon::prelude::*;

use super::fit::{Fitted, Fitter, sized};
use super::gaussian::{self, FREEDOM};
use super::library::Candidate;
use super::model::{Extra, Layout, State, Term};
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
const PLAIN: usize = 8;
/// Starts of an effect from which it is fitted.
const STARTS: usize = 2;
/// Steps of least squares before generalised least squares takes over.
const STEPS: usize = 12;
/// Square, in units of the noise, that a plausible size must move launches by to be told at all.
const TELLS: f64 = 1.0;
/// Largest slow misfit, in units of the noise, and largest pushes, in what effects declare, under which effects are told by
/// derivatives: what a missing effect does looks like them until the effect is there.
const SCREENED: f64 = 1.0;

/// The result of a search.
pub struct Found {
    pub base: Fitted,
    pub fits: Vec<Fitted>,
    /// Log of evidence times prior probability of every fit, and of the base model.
    pub log_posterior: Vec<f64>,
    pub base_log_posterior: f64,
    /// Sets that could not be fitted.
    pub failed: Vec<Vec<&'static str>>,
}

/// A search among the sets of the library's effects.
pub struct Hunt<'a, 'b, 'c> {
    pub fitter: &'c Fitter<'a, 'b>,
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
type Promise = (f64, usize, Vec<f64>);

/// A set to be fitted.
struct Union {
    names: Vec<&'static str>,
    /// Total score that it promises.
    promise: f64,
    starts: Vec<(Layout, State)>,
}

impl<'a, 'b, 'c> Hunt<'a, 'b, 'c> {
    pub fn new(fitter: &'c Fitter<'a, 'b>, library: Vec<Candidate>, latents: &'c [usize], seed: u64) -> Self {
        Hunt { fitter, library, latents, seed }
    }

    /// Searches sets of up to `most` effects.
    pub fn search(&self, base: Fitted, most: usize, progress: &dyn Progress) -> Result<Found> {
        let base_log_posterior = base.log_evidence;
        let mut found = Found {
            base,
            fits: Vec::new(),
            log_posterior: Vec::new(),
            base_log_posterior,
            failed: Vec::new(),
        };
        for size in 1..=most {
            let stage = ["trying single effects", "trying pairs of effects", "trying triples of effects"];
            let before = found.best_total();
            let parents: Vec<&Fitted> = match size {
                1 => vec![&found.base],
                _ => found
                    .ranked(|f| f.set.len() == size - 1)
                    .into_iter()
                    .take(BEAM[size.min(3) - 2].0)
                    .map(|i| &found.fits[i])
                    .collect(),
            };
            let unions =
                self.unions(&parents, &found, if size == 1 { usize::MAX } else { BEAM[size.min(3) - 2].1 })?;
            let stage = (progress, stage[size.min(3) - 1]);
            self.join(&mut found, unions, stage)?;
            if size > 1 {
                let simple = self.simpler(&found, size);
                self.join(&mut found, simple, stage)?;
                self.refit(&mut found, size)?;
            }
            if found.best_total() <= before {
                break;
            }
        }
        Ok(found)
    }

    /// The model of a set of effects by name, fitted: one effect after the other joins, from where derivatives say it should start.
    /// `None` where one of them is no candidate, or the trials say nothing of it.
    pub fn named(&self, base: &Fitted, names: &[&str]) -> Result<Option<Fitted>> {
        let layout = Layout::new(self.latents, Vec::new(), self.fitter.data.setting_count());
        let Some(mut fit) = self.fitter.refined(layout, base.state.clone())? else { return Ok(None) };
        for name in names {
            let Some(c) = self.library.iter().position(|c| c.effect.name == *name) else { return Ok(None) };
            let Some(told) = self.promises(&fit)? else { return Ok(None) };
            let union =
                Union { names: Vec::new(), promise: 0.0, starts: self.starts(&fit, c, &told[c], STARTS) };
            match self.fit(union)? {
                Some(found) => fit = found,
                None => return Ok(None),
            }
        }
        Ok(Some(fit))
    }

    /// A fit with a candidate beside it, at `most` of its starts with amplitudes as promised, and beside the base model where it
    /// is strong.
    fn starts(
        &self,
        fit: &Fitted,
        candidate: usize,
        promised: &[Promise],
        most: usize,
    ) -> Vec<(Layout, State)> {
        let Candidate { starts, strong, .. } = &self.library[candidate];
        let linear = promised.iter().take(most).map(|(_, start, sizes)| {
            let term = &starts[*start];
            Term { start: sized(term, sizes), ..term.clone() }
        });
        let joined = |term: Term| fit.joined([term], self.fitter.data.setting_count());
        let strong = strong.iter().filter(|_| fit.set.is_empty()).map(|(term, _)| {
            let (layout, state) = joined(term.clone());
            let windows = self.fitter.data.windows.iter().zip(state.nuisances);
            let nuisances = windows.map(|(w, n)| w.start_whatever_acts().unwrap_or(n)).collect();
            (layout, State::new(state.values, nuisances))
        });
        linear.map(joined).chain(strong).collect()
    }

    fn join(
        &self,
        found: &mut Found,
        unions: Vec<Union>,
        (progress, stage): (&dyn Progress, &str),
    ) -> Result<()> {
        let names: Vec<Vec<&'static str>> = unions.iter().map(|u| u.names.clone()).collect();
        let (total, done) = (unions.len() as u64, Mutex::new(0));
        progress.report(stage, 0, total)?;
        let fit = |union: Union| {
            let fitted = self.fit(union)?;
            let mut done = done.lock().unwrap_or_else(PoisonError::into_inner);
            *done += 1;
            progress.report(stage, *done, total)?;
            Ok(fitted)
        };
        let fitted: Vec<Result<Option<Fitted>>> = unions.into_par_iter().map(fit).collect();
        for (fit, names) in fitted.into_iter().zip(names) {
            match fit? {
                Some(fit) => {
                    found.log_posterior.push(fit.log_evidence + log_prior(fit.set.len()));
                    found.fits.push(fit);
                }
                None => found.failed.push(names),
            }
        }
        Ok(())
    }

    /// Fits what the best sets of a size are without one of their effects again, from where those stand: with one more effect a
    /// fit may have found the way to a better place, and a set must not lose for having missed it.
    fn refit(&self, found: &mut Found, size: usize) -> Result<()> {
        let best: Vec<usize> = found.ranked(|f| f.set.len() == size).into_iter().take(BEAM[1].0).collect();
        let mut again: Vec<(usize, Union)> = Vec::new();
        for (i, t) in best.iter().flat_map(|i| (0..size).map(move |t| (*i, t))) {
            let large = &found.fits[i];
            let mut names: Vec<&'static str> = large.set.iter().map(|e| e.name).collect();
            names.remove(t);
            names.sort_unstable();
            let Some(at) = found.fits.iter().position(|f| f.names() == names) else { continue };
            let (layout, values) = large.without(t, self.fitter.data.setting_count());
            let start = State::new(values, found.fits[at].state.nuisances.clone());
            again.push((at, Union { names, promise: 0.0, starts: vec![(layout, start)] }));
        }
        let fitted: Vec<Result<(usize, Option<Fitted>)>> =
            again.into_par_iter().map(|(at, union)| Ok((at, self.fit(union)?))).collect();
        for refitted in fitted {
            let (at, Some(fit)) = refitted? else { continue };
            let log_posterior = fit.log_evidence + log_prior(fit.set.len());
            if log_posterior > found.log_posterior[at] {
                (found.fits[at], found.log_posterior[at]) = (fit, log_posterior);
            }
        }
        Ok(())
    }

    /// The best fit of a set's starts.
    fn fit(&self, union: Union) -> Result<Option<Fitted>> {
        let mut best: Option<Fitted> = None;
        let surveyed = |layout: &Layout| layout.terms.len() < 2 && survey::possible(self.fitter.data, layout);
        for (layout, start) in union.starts {
            let start = match surveyed(&layout) {
                true => {
                    match super::fit::simulated(survey::survey(self.fitter.data, &layout, &start, self.seed))?
                    {
                        Some(found) => found,
                        None => continue,
                    }
                }
                false => start,
            };
            let rounds = if self.fitter.data.frozen.is_empty() { STEPS } else { 5 };
            let Some(fit) = self.fitter.fit(layout, start, rounds)? else { continue };
            if best.as_ref().is_none_or(|b| fit.log_evidence > b.log_evidence) {
                best = Some(fit);
            }
        }
        Ok(best)
    }

    /// The most promising unions of some fits and a candidate.
    fn unions(&self, parents: &[&Fitted], found: &Found, most: usize) -> Result<Vec<Union>> {
        let mut all: Vec<Union> = Vec::new();
        for fit in parents {
            let Some(told) = self.promises(fit)? else { continue };
            for (c, Candidate { effect, .. }) in self.library.iter().enumerate() {
                let mut names = fit.names();
                names.push(effect.name);
                names.sort_unstable();
                if told[c].is_empty() || found.fits.iter().any(|f| f.names() == names) {
                    continue;
                }
                // What chance gives a parameter, and what the choice costs.
                let own = fit.parameters() + effect.parameters.len();
                let promise = told[c][0].0 - own as f64 + log_prior(names.len());
                // A survey frames regions by itself.
                let framed =
                    effect.target() == EffectTarget::Region && window::leaping(self.fitter.data.windows);
                let starts = self.starts(fit, c, &told[c], if framed { 1 } else { STARTS });
                let union = Union { names, promise, starts };
                match all.iter_mut().find(|u| u.names == union.names) {
                    Some(known) if known.promise >= promise => {}
                    Some(known) => *known = union,
                    None => all.push(union),
                }
            }
        }
        all.sort_by(|a, b| b.promise.total_cmp(&a.promise));
        // No set stands where a plainer one was never tried.
        let shaped = |e: &Effect| e.parameters.iter().any(|p| !p.is_amplitude());
        let plain = |u: &Union| {
            u.names.len() == 2
                && !self.library.iter().any(|c| u.names.contains(&c.effect.name) && shaped(c.effect))
        };
        let (mut place, mut plainer) = (0, 0);
        all.retain(|u| {
            place += 1;
            plainer += usize::from(plain(u));
            place <= most || (plain(u) && plainer <= PLAIN)
        });
        Ok(all)
    }

    /// The candidates that the data say something of: what a plausible size does, the starts do not take up.
    pub fn identifiable(self, base: &Fitted) -> Result<Vec<Candidate>> {
        let Some(scores) = self.promises(base)? else { return Ok(self.library) };
        Ok(self
            .library
            .into_iter()
            .zip(scores)
            .filter(|(_, scores)| !scores.is_empty())
            .map(|c| c.0)
            .collect())
    }

    /// By candidate: what its starts promise (log density, start, sizes of amplitudes), best first; empty for what is in the set.
    fn promises(&self, fit: &Fitted) -> Result<Option<Vec<Vec<Promise>>>> {
        let mut extras = Vec::new();
        let mut of = Vec::new();
        for (c, Candidate { effect, starts: terms, .. }) in self.library.iter().enumerate() {
            if fit.set.iter().any(|e| e.name == effect.name) {
                continue;
            }
            for (s, term) in terms.iter().enumerate() {
                let own = directions(term);
                of.push((c, s, extras.len(), own.len()));
                extras.extend(own);
            }
        }
        let Some((_, parts)) = self.fitter.parts(&fit.layout, &fit.state, &extras)? else {
            return Ok(None);
        };
        let q = fit.layout.slots.len();
        let mut components = fit.components.clone();
        components.slow = components.slow.min(SCREENED);
        components.push.iter_mut().for_each(|p| *p = p.min(SCREENED));
        let Some(told) = gaussian::all_told(&parts, &components) else { return Ok(None) };
        let (own, here) = (self.fitter.prior(&fit.layout, &fit.state), DVector::zeros(q + extras.len()));
        let before: f64 = told.iter().map(|t| t.density(&here)).sum();
        let settings = self.fitter.data.settings;
        let mut out: Vec<Vec<Promise>> = self.library.iter().map(|_| Vec::new()).collect();
        for (c, s, from, count) in of {
            self.fitter.data.progress.check_stop()?;
            let term = &self.library[c].starts[s];
            let chosen: Vec<usize> = (0..q).chain(q + from..q + from + count).collect();
            let weak = weak(term);
            let tells = |k: usize| {
                told.iter().map(|t| t.gram[(q + from + k, q + from + k)]).sum::<f64>() > TELLS * weak[k]
            };
            if !(0..count).any(tells) {
                continue;
            }
            let gain = |setting: Option<usize>| {
                let n = chosen.len();
                let (mut gram, mut score) = (DMatrix::zeros(n, n), DVector::zeros(n));
                for t in told.iter().filter(|t| setting.is_none_or(|s| settings[t.launch] == s)) {
                    // Each launch has a scale of its own.
                    let weight = (FREEDOM + t.count) / (FREEDOM + t.square.max(0.0));
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
    fn simpler(&self, found: &Found, size: usize) -> Vec<Union> {
        let mut out: Vec<Union> = Vec::new();
        for i in found.ranked(|f| f.set.len() == size).into_iter().take(3) {
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
                    found.fits.iter().any(|f| f.names() == *n) || out.iter().any(|u| u.names == *n)
                };
                if names.len() < terms.len() || known(&names) {
                    continue;
                }
                let layout = Layout::new(self.latents, terms, self.fitter.data.setting_count());
                let mut values = layout.start(&[0.0; 3]);
                let latents = found.base.layout.latents();
                values[..latents].copy_from_slice(&found.base.state.values[..latents]);
                let start = State::new(values, found.base.state.nuisances.clone());
                out.push(Union { names, promise: 0.0, starts: vec![(layout, start)] });
            }
        }
        out
    }
}

/// The directions of a term's amplitudes at its start.
fn directions(term: &Term) -> Vec<Extra> {
    let parameters = term.effect.parameters;
    let shapes = |p: usize| !parameters[p].is_amplitude();
    let direction = |p: usize| {
        let own = |k: usize| match k {
            _ if shapes(k) => term.start[k],
            _ if k == p => parameters[k].neutral + parameters[k].fd_step,
            _ => parameters[k].neutral,
        };
        Extra {
            effect: term.effect,
            values: (0..parameters.len()).map(own).collect(),
            unit: parameters[p].fd_step,
        }
    };
    (0..parameters.len()).filter(|p| !shapes(*p) && term.free[*p]).map(direction).collect()
}

/// Precisions of what is believed of a term's amplitudes.
fn weak(term: &Term) -> Vec<f64> {
    let parameters = term.effect.parameters.iter().zip(&term.free);
    parameters.filter(|(p, free)| p.is_amplitude() && **free).map(|(p, _)| p.prior_sd.powi(-2)).collect()
}

impl Found {
    /// Indices of fits, best first.
    pub fn ranked(&self, which: impl Fn(&Fitted) -> bool) -> Vec<usize> {
        let mut order: Vec<usize> = (0..self.fits.len()).filter(|i| which(&self.fits[*i])).collect();
        order.sort_by(|a, b| self.log_posterior[*b].total_cmp(&self.log_posterior[*a]).then(a.cmp(b)));
        order
    }

    /// The largest log posterior, the base model's among them.
    pub fn best_total(&self) -> f64 {
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
        let all = directions(&gust);
        assert_eq!(all.len(), 2);
        for (k, extra) in all.iter().enumerate() {
            assert!(extra.values[k] != gust.start[k] && extra.values[1 - k] == gust.start[1 - k]);
            assert_eq!(extra.values[2..], gust.start[2..]);
        }
    }
}
