//! Which set of effects: singles first, then pairs and triples while misfit remains.
//!
//! A set is accepted if every one of its terms passes: p, corrected for the size of the library and the number of
//! places its search started from, below 0.01; leaving the term out costs more than one standard error of held-out
//! loss; and at least a tenth of the excess error that the set without it leaves. Of the accepted sets those that no other beats (paired by
//! trial, one-sided p < 0.01) tie. Occam: a tied set with more parameters than the simplest is a rival only if it is
//! better by more than chance would make it; a set within an accepted larger one gives way to it.
//!
//! Pairs are tried wherever there is misfit (for whole runs, which cost more, while the best single does not reach the
//! noise floor), triples while the best pair does not reach it.

use super::judge::{Fitted, paired, ranked};
use super::library;
use super::model::{self, Data, Layout, Pass, State, Term};
use super::noise::Noise;
use super::report::Considered;
use super::stats::t_quantile;
use super::window::{Kind, Window};
use super::{Config, Expected};
use crate::error::{Error, Result};
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
/// The same where the base model is at the noise floor as far as a test without direction can see. Correlated noise can
/// hide a slow push from that test, but not from the push's own.
const ACCEPT_AT_FLOOR: f64 = 0.001;
/// The same there for effects whose shape was chosen by the data as well: the correction by the number of starts is
/// only a guess at how free that choice was.
const ACCEPT_SHAPED_AT_FLOOR: f64 = 1e-6;
/// Share that a term must remove of the excess that the set without it leaves.
const TENTH: f64 = 0.1;
/// Share that a term must remove of the base's excess: real recordings have errors of their own, and some effect always
/// helps against them a little.
const HUNDREDTH: f64 = 0.01;
/// Excess of the middle trial (share of the floor) from which the best set is known to be wrong itself: a set that
/// leaves no more than [`AGAIN`] times as much is then as good, whatever the statistics of the difference say.
const WRONG: f64 = 0.5;
/// Twice the error is four times the square.
const AGAIN: f64 = 4.0;
/// Pairs are built from this many of the best singles with every other effect.
const BEST_SINGLES: usize = 4;
/// Standard errors by which a set with more parameters than the simplest must be better to be a rival. Many effects
/// hold simpler ones within them (a gust of long period is wind): chance alone makes those a little better.
const OCCAM: f64 = 1.65;
/// Triples are built from this many of the best pairs.
const BEST_PAIRS: usize = 2;
/// Trials on which starts and larger sets are tried before the best are fitted to all.
const SCREEN: usize = 16;
/// Pairs, and triples, that are fitted to all trials.
const FITTED: usize = 6;
/// Share of the base's excess below which what is left is for no further effect to explain.
const NEGLIGIBLE: f64 = 0.02;

/// Some of the trials, evenly spread, for trying things out.
struct Screen {
    windows: Vec<Window>,
    settings: Vec<usize>,
    sd: Vec<f64>,
    /// Which of all windows these are.
    chosen: Vec<usize>,
}

impl Screen {
    fn of(data: &Data) -> Screen {
        let stride = data.trials.div_ceil(SCREEN);
        let trials: Vec<usize> = (0..data.trials).step_by(stride.max(1)).collect();
        let place = |t: usize| trials.iter().position(|k| *k == t);
        let chosen: Vec<usize> =
            (0..data.windows.len()).filter(|w| place(data.windows[*w].trial).is_some()).collect();
        let windows = chosen.iter().map(|w| {
            let window = &data.windows[*w];
            Window { trial: place(window.trial).unwrap_or(0), ..window.clone() }
        });
        Screen {
            windows: windows.collect(),
            settings: trials.iter().map(|t| data.settings[*t]).collect(),
            sd: chosen.iter().map(|w| data.sd[*w]).collect(),
            chosen,
        }
    }

    fn data(&self, of: &Data) -> Data<'_> {
        Data {
            windows: &self.windows,
            trials: self.settings.len(),
            settings: &self.settings,
            sd: self.sd.clone(),
            horizon: 1.0,
            engine: of.engine,
        }
    }

    /// A state of all windows, for these.
    fn state(&self, full: &State) -> State {
        State {
            values: full.values.clone(),
            nuisances: self.chosen.iter().map(|w| full.nuisances[*w].clone()).collect(),
        }
    }
}

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
    let screen = Screen::of(&data);
    let mut fits: Vec<Fitted> = Vec::new();
    let mut starts_of: Vec<(&'static str, usize)> = Vec::new();
    for (i, (effect, terms)) in candidates.iter().enumerate() {
        progress.report("trying single effects", i as u64, library_size as u64)?;
        starts_of.push((effect.name, terms.len()));
        let mut tried: Vec<(f64, Layout, Vec<f64>)> = Vec::new();
        for term in terms {
            let layout = Layout::new(latents, vec![term.clone()], count);
            let start = extended(&base, &layout);
            if terms.len() == 1 {
                tried.push((0.0, layout, start.values));
                continue;
            }
            let fitted = model::fit(&screen.data(&data), &layout, screen.state(&start), 3);
            let Some((state, pass)) = simulated(fitted)? else { continue };
            tried.push((model::total(&pass), layout, state.values));
        }
        tried.sort_by(|a, b| a.0.total_cmp(&b.0));
        let mut best: Option<(Layout, State, Pass)> = None;
        for (_, layout, values) in tried.into_iter().take(2) {
            let start = State { values, nuisances: base.state.nuisances.clone() };
            let fitted = if terms.len() == 1 {
                settle(&mut data, &layout, start)
            } else {
                model::fit(&data, &layout, start, 8)
            };
            data.horizon = 1.0;
            let Some((state, pass)) = simulated(fitted)? else { continue };
            if best.as_ref().is_none_or(|b| model::total(&pass) < model::total(&b.2)) {
                best = Some((layout, state, pass));
            }
        }
        if let Some((layout, state, pass)) = best {
            fits.push(Fitted::new(layout, state, pass, &settings));
        }
    }
    let singles = fits.len();
    let windows = data.windows;
    let misfit = |f: &Fitted| expected.misfit_of(f, windows);
    let enough = NEGLIGIBLE * misfit(&base).0;
    let at_floor = |f: &Fitted| {
        let (excess, p) = misfit(f);
        p > 0.05 || excess < super::SLIGHT.max(enough)
    };
    let floor_of_base = at_floor(&base);
    let mut order: Vec<usize> = (0..singles).collect();
    order.sort_by(|a, b| held(&fits[*a]).total_cmp(&held(&fits[*b])));
    let reached = floor_of_base || order.first().is_some_and(|b| at_floor(&fits[*b]));
    let runs = windows.iter().any(|w| w.kind == Kind::Run);
    if config.most_effects >= 2 && !floor_of_base && !(reached && runs) {
        let mut pairs = Vec::new();
        for (rank, a) in order.iter().enumerate().take(BEST_SINGLES) {
            pairs.extend(order.iter().skip(rank + 1).map(|b| (*a, *b)));
        }
        let joined =
            best_joined(&mut data, &screen, &fits, &pairs, latents, "trying pairs of effects", progress)?;
        fits.extend(joined);
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
            let joined = best_joined(
                &mut data,
                &screen,
                &fits,
                &triples,
                latents,
                "trying triples of effects",
                progress,
            )?;
            fits.extend(joined);
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
                    let fitted = settle(&mut data, &layout, start);
                    data.horizon = 1.0;
                    let Some((state, pass)) = simulated(fitted)? else { continue };
                    fits.push(Fitted::new(layout, state, pass, &settings));
                }
            }
        }
        i += 1;
    }
    let accept = |f: &Fitted, t: usize| match (floor_of_base, f.set[t].parameters.iter().any(library::shapes))
    {
        (true, true) => ACCEPT_SHAPED_AT_FLOOR,
        (true, false) => ACCEPT_AT_FLOOR,
        (false, _) => ACCEPT,
    };
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
                let gain = gain * other.held.len() as f64;
                let left = (held(other) - expected.total()).max(0.0);
                f.p_values[t] < accept(f, t)
                    && t_value > 1.0
                    && gain >= (TENTH * left).max(HUNDREDTH * excess)
            })
        })
        .collect();
    let (champion, rivals) = choose(&fits, &accepted, |f| expected.middle_excess(f, windows));
    let considered = considered(&fits, &accepted, expected);
    Ok(Found { base, fits, champion, rivals, considered, data })
}

/// The simplest of the best sets, and all that tie.
fn choose(
    fits: &[Fitted],
    accepted: &[usize],
    excess: impl Fn(&Fitted) -> f64,
) -> (Option<usize>, Vec<usize>) {
    let Some(best) = accepted.iter().copied().min_by(|a, b| held(&fits[*a]).total_cmp(&held(&fits[*b])))
    else {
        return (None, Vec::new());
    };
    // Two tests, each at one-sided 0.5 %: the mean, and the ranks.
    let beats = t_quantile(0.01, fits[best].held.len() as f64 - 1.0);
    let beaten = |i: usize| {
        let (gain, t) = paired(&fits[i].held, &fits[best].held);
        gain > 0.0 && (t > beats || ranked(&fits[i].held, &fits[best].held) > 2.576)
    };
    let wrong = excess(&fits[best]);
    let no_worse = |i: usize| {
        let simple = fits[i].parameters() <= fits[best].parameters();
        wrong > WRONG && simple && excess(&fits[i]) < AGAIN * wrong
    };
    let mut tied: Vec<usize> =
        accepted.iter().copied().filter(|i| *i == best || !beaten(*i) || no_worse(*i)).collect();
    let within = |small: usize, large: usize| {
        let large = fits[large].names();
        fits[small].names().iter().all(|n| large.contains(n))
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
            || paired(&fits[champion].held, &fits[*i].held).1 > OCCAM
    });
    (Some(champion), tied)
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

/// A candidate that a world refuses to simulate is no candidate; any other error ends the search.
fn simulated(fitted: Result<(State, Pass)>) -> Result<Option<(State, Pass)>> {
    match fitted {
        Ok(found) => Ok(Some(found)),
        Err(Error::Input(_) | Error::Failed(_)) => Ok(None),
        Err(other) => Err(other),
    }
}

/// Unions of two fits each, tried on some trials; the best of them fitted to all.
fn best_joined(
    data: &mut Data,
    screen: &Screen,
    fits: &[Fitted],
    unions: &[(usize, usize)],
    latents: &[usize],
    stage: &str,
    progress: &dyn Progress,
) -> Result<Vec<Fitted>> {
    let total = (unions.len() + FITTED) as u64;
    let mut tried = Vec::new();
    for (i, (a, b)) in unions.iter().enumerate() {
        progress.report(stage, i as u64, total)?;
        let (layout, start) = joined(&fits[*a], &fits[*b], latents, data);
        let fitted = model::fit(&screen.data(data), &layout, screen.state(&start), 4);
        let Some((state, pass)) = simulated(fitted)? else { continue };
        tried.push((model::total(&pass), layout, State { values: state.values, ..start }));
    }
    tried.sort_by(|a, b| a.0.total_cmp(&b.0));
    let mut out = Vec::new();
    for (i, (_, layout, start)) in tried.into_iter().take(FITTED).enumerate() {
        progress.report(stage, (unions.len() + i) as u64, total)?;
        let Some((state, pass)) = simulated(model::fit(data, &layout, start, 8))? else { continue };
        out.push(Fitted::new(layout, state, pass, data.settings));
    }
    Ok(out)
}

/// Two fits as one model that starts where the first stands, the second's effects weak.
fn joined(strong: &Fitted, weak: &Fitted, latents: &[usize], data: &Data) -> (Layout, State) {
    let mut terms: Vec<Term> = strong.layout.terms.clone();
    terms.extend(weak.layout.terms.iter().cloned());
    let layout = Layout::new(latents, terms, data.settings.iter().max().map_or(1, |m| m + 1));
    let mut values = strong.state.values.clone();
    for (slot, value) in weak.layout.slots.iter().zip(&weak.state.values).skip(weak.layout.latents()) {
        let model::What::Parameter(t, p) = slot.what else { continue };
        let parameter = &weak.layout.terms[t].effect.parameters[p];
        let amplitude = !library::shapes(parameter);
        values.push(if amplitude { parameter.neutral + 0.1 * (value - parameter.neutral) } else { *value });
    }
    (layout, State { values, nuisances: strong.state.nuisances.clone() })
}
