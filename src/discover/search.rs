//! Which set of effects: singles first, then pairs and triples while misfit remains.
//!
//! A set is accepted if every one of its terms passes: p, corrected for the size of the library and the number of
//! places its search started from, below 0.01; leaving the term out costs more than one standard error of held-out
//! loss; and at least a tenth of the base's excess error. Of the accepted sets those that no other beats (paired by
//! trial, one-sided p < 0.01) tie. Occam: a tied set with more parameters than the simplest is a rival only if it is
//! better by more than a standard error; a set within an accepted larger one gives way to it.
//!
//! Larger sets are tried only while the best smaller one does not reach the noise floor: a set at the floor cannot be
//! beaten by more than chance.

use super::judge::{Fitted, paired};
use super::library;
use super::model::{self, Data, Layout, Pass, State, Term};
use super::noise::Noise;
use super::report::Considered;
use super::stats::t_quantile;
use super::window::Kind;
use super::{Config, Expected};
use crate::error::Result;
use crate::progress::Progress;
use crate::task::Scene;

/// What the search brings home.
pub struct Found<'a> {
    pub base: Fitted,
    pub fits: Vec<Fitted>,
    /// Index of the simplest of the best sets.
    pub champion: Option<usize>,
    /// Indices of all sets that tie, the champion first.
    pub rivals: Vec<usize>,
    pub considered: Vec<Considered>,
    pub data: Data<'a>,
}

/// What judging needs besides the fits.
pub struct Judged<'a> {
    pub names: &'a [String],
    pub settings: &'a [usize],
    pub noise: &'a Noise,
    pub expected: &'a Expected,
}

/// Corrected p below which a term is accepted.
const ACCEPT: f64 = 0.01;
/// Share of the base's excess that a term must remove.
const TENTH: f64 = 0.1;
/// Pairs are built from this many of the best singles with every other effect.
const BEST_SINGLES: usize = 4;
/// Triples are built from this many of the best pairs.
const BEST_PAIRS: usize = 2;

/// Fits a layout, runs from their beginnings to their ends little by little: far from the right model a late
/// collision says nothing.
pub fn settle(data: &mut Data, layout: &Layout, start: State) -> Result<(State, Pass)> {
    let mut state = start;
    if data.windows.iter().any(|w| w.kind == Kind::Run) {
        for horizon in [0.12, 0.3, 0.6] {
            data.horizon = horizon;
            state = model::fit(data, layout, state, 3)?.0;
        }
        data.horizon = 1.0;
    }
    model::fit(data, layout, state, 10)
}

/// Searches the library.
pub fn search<'a>(
    scene: &Scene,
    mut data: Data<'a>,
    base: Fitted,
    expected: &Expected,
    latents: &[usize],
    config: &Config,
    progress: &dyn Progress,
) -> Result<Found<'a>> {
    let span = library::span(data.windows);
    let candidates = library::candidates(scene, &span);
    let count = data.settings.iter().max().map_or(1, |m| m + 1);
    let settings = data.settings.to_vec();
    let library_size = candidates.len();
    let mut fits: Vec<Fitted> = Vec::new();
    let mut starts_of: Vec<(&'static str, usize)> = Vec::new();
    for (i, (effect, terms)) in candidates.iter().enumerate() {
        progress.report("trying single effects", i as u64, library_size as u64)?;
        starts_of.push((effect.name, terms.len()));
        let mut tried: Vec<(f64, Layout, State)> = Vec::new();
        for term in terms {
            let layout = Layout::new(latents, vec![term.clone()], count);
            let start = extended(&base, &layout);
            let (state, pass) = if terms.len() == 1 {
                settle(&mut data, &layout, start)?
            } else {
                model::fit(&data, &layout, start, 2)?
            };
            tried.push((model::total(&pass), layout, state));
        }
        tried.sort_by(|a, b| a.0.total_cmp(&b.0));
        let mut best: Option<(Layout, State, Pass)> = None;
        for (_, layout, state) in tried.into_iter().take(2) {
            let (state, pass) = model::fit(&data, &layout, state, 12)?;
            if best.as_ref().is_none_or(|b| model::total(&pass) < model::total(&b.2)) {
                best = Some((layout, state, pass));
            }
        }
        if let Some((layout, state, pass)) = best {
            fits.push(Fitted::new(layout, state, pass, &settings));
        }
    }
    let singles = fits.len();
    let at_floor = |f: &Fitted| {
        let squares: Vec<f64> = f.pass.trials.iter().map(|t| t.square).collect();
        let (excess, p) = expected.misfit(&squares);
        p > 0.05 || excess < super::SLIGHT
    };
    let floor_of_base = at_floor(&base);
    let mut order: Vec<usize> = (0..singles).collect();
    order.sort_by(|a, b| held(&fits[*a]).total_cmp(&held(&fits[*b])));
    let reached = floor_of_base || order.first().is_some_and(|b| at_floor(&fits[*b]));
    if config.most_effects >= 2 && !reached {
        let mut pairs = Vec::new();
        for (rank, a) in order.iter().enumerate().take(BEST_SINGLES) {
            pairs.extend(order.iter().skip(rank + 1).map(|b| (*a, *b)));
        }
        for (i, (a, b)) in pairs.iter().enumerate() {
            progress.report("trying pairs of effects", i as u64, pairs.len() as u64)?;
            let joined = join(&mut data, &fits[*a], &fits[*b], latents, count, &settings)?;
            fits.push(joined);
        }
        let mut order: Vec<usize> = (singles..fits.len()).collect();
        order.sort_by(|a, b| held(&fits[*a]).total_cmp(&held(&fits[*b])));
        let reached = order.first().is_some_and(|b| at_floor(&fits[*b]));
        if config.most_effects >= 3 && !reached {
            let mut triples: Vec<(usize, usize)> = Vec::new();
            let mut named: Vec<Vec<&str>> = Vec::new();
            for pair in order.iter().take(BEST_PAIRS) {
                for single in 0..singles {
                    let mut names = fits[*pair].names();
                    if names.contains(&fits[single].set[0].name) {
                        continue;
                    }
                    names.push(fits[single].set[0].name);
                    names.sort_unstable();
                    if !named.contains(&names) {
                        named.push(names);
                        triples.push((*pair, single));
                    }
                }
            }
            for (i, (pair, single)) in triples.iter().enumerate() {
                progress.report("trying triples of effects", i as u64, triples.len() as u64)?;
                let joined = join(&mut data, &fits[*pair], &fits[*single], latents, count, &settings)?;
                fits.push(joined);
            }
        }
    }
    for fit in &mut fits {
        for t in 0..fit.set.len() {
            let starts = starts_of.iter().find(|s| s.0 == fit.set[t].name).map_or(1, |s| s.1);
            let p = fit.p_value(t, &settings) * library_size as f64 * starts as f64;
            fit.p_values[t] = p.min(1.0);
        }
    }
    // What a set loses by a term is judged against the set without it, which must have been fitted.
    let mut i = 0;
    while i < fits.len() {
        if fits[i].set.len() > 1 && fits[i].p_values.iter().all(|p| *p < ACCEPT) {
            for t in 0..fits[i].set.len() {
                let names = without(&fits[i], t);
                if find(&fits, &names).is_none() {
                    let terms: Vec<Term> = fits[i]
                        .layout
                        .terms
                        .iter()
                        .enumerate()
                        .filter(|(k, _)| *k != t)
                        .map(|(_, term)| term.clone())
                        .collect();
                    let layout = Layout::new(latents, terms, count);
                    let start = extended(&base, &layout);
                    let (state, pass) = settle(&mut data, &layout, start)?;
                    fits.push(Fitted::new(layout, state, pass, &settings));
                }
            }
        }
        i += 1;
    }
    let excess = (held(&base) - expected.total()).max(0.0);
    let accepted: Vec<usize> = (0..fits.len())
        .filter(|i| {
            let f = &fits[*i];
            (0..f.set.len()).all(|t| {
                let names = without(f, t);
                let other =
                    if names.is_empty() { Some(&base) } else { find(&fits, &names).map(|k| &fits[k]) };
                let Some(other) = other else { return false };
                let (gain, t_value) = paired(&other.held, &f.held);
                f.p_values[t] < ACCEPT && t_value > 1.0 && gain * other.held.len() as f64 >= TENTH * excess
            })
        })
        .filter(|_| !floor_of_base)
        .collect();
    let (champion, rivals) = choose(&fits, &accepted);
    let considered = considered(&fits, &accepted, expected);
    Ok(Found { base, fits, champion, rivals, considered, data })
}

/// The simplest of the best sets, and all that tie.
fn choose(fits: &[Fitted], accepted: &[usize]) -> (Option<usize>, Vec<usize>) {
    let Some(best) = accepted.iter().copied().min_by(|a, b| held(&fits[*a]).total_cmp(&held(&fits[*b])))
    else {
        return (None, Vec::new());
    };
    // Two-sided 2 % is one-sided 1 %.
    let beats = t_quantile(0.02, fits[best].held.len() as f64 - 1.0);
    let mut tied: Vec<usize> = accepted
        .iter()
        .copied()
        .filter(|i| *i == best || paired(&fits[*i].held, &fits[best].held).1 < beats)
        .collect();
    let within = |small: usize, large: usize| {
        let large = fits[large].names();
        small_names(&fits[small]).iter().all(|n| large.contains(n))
    };
    let all = tied.clone();
    tied.retain(|i| !all.iter().any(|j| fits[*j].set.len() > fits[*i].set.len() && within(*i, *j)));
    tied.sort_by(|a, b| {
        let key = |i: usize| fits[i].parameters();
        key(*a).cmp(&key(*b)).then(held(&fits[*a]).total_cmp(&held(&fits[*b])))
    });
    let Some(champion) = tied.first().copied() else { return (None, Vec::new()) };
    tied.retain(|i| {
        fits[*i].parameters() <= fits[champion].parameters()
            || paired(&fits[champion].held, &fits[*i].held).1 > 1.0
    });
    (Some(champion), tied)
}

fn small_names(f: &Fitted) -> Vec<&'static str> {
    f.names()
}

fn considered(fits: &[Fitted], accepted: &[usize], expected: &Expected) -> Vec<Considered> {
    let mut out: Vec<Considered> = fits
        .iter()
        .enumerate()
        .map(|(i, f)| Considered {
            effects: f.names().iter().map(|n| n.to_string()).collect(),
            held_out: held(f) / expected.total().max(1e-9),
            p_value: f.p_values.iter().copied().fold(0.0, f64::max),
            accepted: accepted.contains(&i),
        })
        .collect();
    out.sort_by(|a, b| a.held_out.total_cmp(&b.held_out));
    out
}

fn held(f: &Fitted) -> f64 {
    f.held.iter().sum()
}

fn without(f: &Fitted, term: usize) -> Vec<&'static str> {
    let mut names: Vec<_> =
        f.set.iter().enumerate().filter(|(k, _)| *k != term).map(|(_, e)| e.name).collect();
    names.sort_unstable();
    names
}

fn find(fits: &[Fitted], names: &[&str]) -> Option<usize> {
    fits.iter().position(|f| f.names() == names)
}

/// A start for a layout: the base's latents and nuisances, the terms' own starts.
fn extended(base: &Fitted, layout: &Layout) -> State {
    let mut values = layout.start(&[0.0; 3]);
    let latents = base.layout.latents();
    values[..latents].copy_from_slice(&base.state.values[..latents]);
    State { values, nuisances: base.state.nuisances.clone() }
}

/// Two fits as one model, fitted from where the first stands.
fn join(
    data: &mut Data,
    first: &Fitted,
    second: &Fitted,
    latents: &[usize],
    count: usize,
    settings: &[usize],
) -> Result<Fitted> {
    let mut best: Option<Fitted> = None;
    // The second effect starts weak, and, where that ends badly, the other way about.
    for (strong, weak) in [(first, second), (second, first)] {
        let mut terms: Vec<Term> = strong.layout.terms.clone();
        terms.extend(weak.layout.terms.iter().cloned());
        let layout = Layout::new(latents, terms, count);
        let own = strong.layout.slots.len();
        let mut values = strong.state.values.clone();
        let skip = weak.layout.latents();
        for (slot, value) in weak.layout.slots.iter().zip(&weak.state.values).skip(skip) {
            let model::What::Parameter(t, p) = slot.what else { continue };
            let parameter = &weak.layout.terms[t].effect.parameters[p];
            let start = if library::shapes(parameter) {
                *value
            } else {
                parameter.neutral + 0.1 * (value - parameter.neutral)
            };
            values.push(start);
        }
        debug_assert_eq!(values.len(), own + weak.layout.slots.len() - skip);
        let start = State { values, nuisances: strong.state.nuisances.clone() };
        let (state, pass) = model::fit(data, &layout, start, 10)?;
        let fitted = Fitted::new(layout, state, pass, settings);
        if best.as_ref().is_none_or(|b| model::total(&fitted.pass) < model::total(&b.pass)) {
            best = Some(fitted);
        }
        // One way about is enough for effects that need no start.
        if strong.layout.terms.iter().chain(&weak.layout.terms).all(|t| t.free.len() <= 2) {
            break;
        }
    }
    Ok(best.expect("at least one of the two ways was fitted"))
}
