//! Which set of effects: singles first, then pairs and triples while misfit remains.
//!
//! First the base model is asked whether it lacks anything at all (`signs`). Then sets are fitted, those whose linear
//! estimate promises most, and each is asked what it lacks. A set is accepted if every one of its terms passes: the set
//! without it lacks it (p < 0.01); leaving it out costs more than one standard error of held-out loss, and at least a
//! tenth of the excess error that the set without it leaves. Larger sets are tried until one is accepted that lacks
//! nothing, and then only those that need no more parameters.
//!
//! Of the accepted sets those that no other beats tie: one is beaten if the best has what it lacks, or if its held-out
//! loss is larger by more than chance makes it. Occam: a tied set with more effects or parameters than the simplest is a
//! rival only if it is better by more than what they would take up of noise; a set that holds an accepted smaller one
//! gives way to it.

use rayon::prelude::*;

use super::judge::{Fitted, held, paired, ranked};
use super::library;
use super::model::{self, Data, Extra, Layout, Pass, State, Term};
use super::noise::Noise;
use super::report::Considered;
use super::signs::{self, Group, Tested};
use super::stats::t_quantile;
use super::survey;
use super::window;
use super::{Config, Expected};
use crate::error::{Error, Result};
use crate::progress::Progress;
use crate::task::Scene;
use crate::world::effect::{ActsOn, Effect, Parameter, REGISTRY};

/// What the search brings home.
pub struct Found<'a> {
    pub base: Fitted,
    pub base_lack: Lack,
    pub fits: Vec<Fitted>,
    /// What each fit lacks, where that was asked.
    pub lacks: Vec<Option<Lack>>,
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

/// p of all trials' signs below which there is anything to look for.
const ANYTHING: f64 = 0.01;
/// The same where neither the noise floor nor what could be added says that there is much.
const INVISIBLE: f64 = 0.002;
/// Share of the floor that the excess must be, or that what could be added must take away, to be much.
const VISIBLE: [f64; 2] = [0.15, 0.05];
/// The same where what could be added takes away more than this share of what noise leaves: several times what it does
/// by chance, even of correlated noise.
const LIKELY_MUCH: [f64; 2] = [0.05, 0.15];
/// The same where it would take away as much as all noise leaves: few trials that say anything draw few signs.
const CLEARLY_MUCH: [f64; 2] = [0.2, 1.0];
/// The same by the noise floor: excess as a share of it, standard deviations above it, p by trial.
const FAR: [f64; 3] = [0.4, 6.0, 0.1];
/// p of flights' slow residuals below which a fit lacks something, whatever trials have in common.
pub const PLAIN: f64 = 5e-4;
/// The same where a set with an effect more has nothing left.
const SPEAKS: f64 = 0.02;
/// p below which a term is accepted beside the others of its set.
const ACCEPT: f64 = 0.01;
/// p (of two tests) below which what the best set has and another has not would help the other.
const BEATEN: f64 = 0.015;
/// Share that a term must remove of the excess that the set without it leaves.
const TENTH: f64 = 0.1;
/// Share that a term must remove of the base's excess: real recordings have errors of their own, and some effect always
/// helps against them a little.
const HUNDREDTH: f64 = 0.01;
/// Share of the base's excess from which what a set lacks speaks against it at [`ANYTHING`] already.
const MATTERS: f64 = 0.05;
/// Share of the base's excess below which what a set lacks does not speak against it.
const NEGLIGIBLE: f64 = 0.01;
/// Difference of held-out losses, units of the noise's variance, that is worth looking at; so much again for every
/// parameter more. Many effects hold simpler ones within them (a gust of long period is wind): chance alone makes
/// those a little better.
const HAIR: f64 = 2.0;
/// Difference that decides: likelihoods a thousand to one.
const LIKELY: f64 = 14.0;
/// Trials in which leaps must say something for it to count: nothing errs in them but what restarts cold.
pub const SEVERAL: usize = 4;
/// Excess of the middle trial (share of the floor) from which the best set is known to be wrong itself, where the trials'
/// signs say so too and where they do not; and how many
/// times as much another set may leave then: twice the error is four times the square.
const WRONG: [f64; 2] = [0.1, 0.3];
const AGAIN: f64 = 4.0;
/// Best starts of an effect from which it is fitted.
const STARTS: usize = 2;
/// Pairs, and triples, that are fitted: those whose linear estimate is best.
const FITTED: usize = 8;
/// Most steps that the best fits are given beyond the first few.
const POLISH: usize = 24;
/// Fits of a size that are tested for what they lack.
const TESTED: usize = 6;
/// Sets of the size before from which larger ones are made: none, singles, pairs.
const PARENTS: [usize; 3] = [0, 5, 3];

/// Singles of few parameters that always take part in pairs, and parameters an effect that are few (those of a pair
/// together at most 3).
const SIMPLE: usize = 3;
const FEW: usize = 2;
/// Difference of held-out losses below which effects are twins.
const ALIKE: f64 = 0.05;
/// What a search goes by.
#[derive(Clone, Copy)]
pub struct Given<'a> {
    pub expected: &'a Expected,
    pub noise: &'a Noise,
    /// Indices of the latents to calibrate.
    pub latents: &'a [usize],
}

/// Searches the library.
pub fn search<'a>(
    scene: &Scene,
    data: Data<'a>,
    base: Fitted,
    given: &Given,
    config: &Config,
    progress: &dyn Progress,
) -> Result<Found<'a>> {
    let ground = library::ground(data.windows);
    let library = Library { candidates: library::candidates(scene, &ground) };
    let Given { expected, noise, latents } = *given;
    let unit = noise.unit();
    let hunt = Hunt { data: &data, library: &library, latents, expected, unit, seed: config.seed };
    progress.report("looking for anything at all", 0, 1)?;
    let lack = hunt.test(&base)?;
    let mut found = Found {
        base,
        base_lack: lack,
        fits: Vec::new(),
        lacks: Vec::new(),
        champion: None,
        rivals: Vec::new(),
        considered: Vec::new(),
        data: Data { sd: data.sd.clone(), frozen: data.frozen.clone(), ..data },
    };
    if !hunt.lacks(&found.base, &found.base_lack) {
        return Ok(found);
    }
    let excess = (model::total(&found.base.pass) - expected.total()).max(0.0);
    let mut most_parameters = usize::MAX;
    for size in 1..=config.most_effects {
        let stage = ["trying single effects", "trying pairs of effects", "trying triples of effects"]
            [size.min(3) - 1];
        let first = found.fits.len();
        let parents: Vec<(&Fitted, &Lack)> = match size {
            1 => vec![(&found.base, &found.base_lack)],
            _ => {
                let own = (0..first).filter(|i| found.fits[*i].set.len() == size - 1);
                let mut known: Vec<usize> = own.filter(|i| found.lacks[*i].is_some()).collect();
                known.sort_by(|a, b| held(&found.fits[*a]).total_cmp(&held(&found.fits[*b])));
                let simple = plain(&found.fits, &known);
                let mut best: Vec<usize> = known.iter().copied().take(PARENTS[size.min(3) - 1]).collect();
                best.extend(simple);
                best.sort_unstable();
                best.dedup();
                best.into_iter().filter_map(|i| Some((&found.fits[i], found.lacks[i].as_ref()?))).collect()
            }
        };
        let unions = hunt.unions(&parents, if size == 1 { usize::MAX } else { FITTED }, most_parameters);
        progress.report(stage, 0, unions.len() as u64)?;
        let fitted: Vec<Result<Option<Fitted>>> = unions.into_par_iter().map(|u| hunt.fit(u)).collect();
        let mut fits = Vec::new();
        for fit in fitted {
            fits.extend(fit?);
        }
        fits.sort_by(|a, b| held(a).total_cmp(&held(b)));
        progress.report(stage, fits.len() as u64, fits.len() as u64 + 1)?;
        let base_held = held(&found.base);
        let last = fits.split_off(fits.len().min(TESTED));
        let polished: Vec<Result<Fitted>> = fits.into_par_iter().map(|f| hunt.polished(f)).collect();
        let mut fits = polished.into_iter().collect::<Result<Vec<_>>>()?;
        fits.extend(last);
        fits.sort_by(|a, b| held(a).total_cmp(&held(b)));
        let best = fits.first().map_or(0.0, held);
        let plain = plain(&fits, &(0..fits.len()).collect::<Vec<_>>());
        let worth = |(i, f): (usize, &Fitted)| {
            (i < TESTED && held(f) - best < 0.5 * (base_held - best).max(0.0))
                || (plain.contains(&i) && held(f) < base_held)
        };
        let lacks: Vec<Result<Option<Lack>>> = fits
            .par_iter()
            .enumerate()
            .map(|(i, f)| worth((i, f)).then(|| hunt.test(f)).transpose())
            .collect();
        for (fit, lack) in fits.into_iter().zip(lacks) {
            found.fits.push(fit);
            found.lacks.push(lack?);
        }
        if size > 1 {
            hunt.simplify(&mut found, first)?;
        }
        hunt.complete(&mut found, first)?;
        let enough = (first..found.fits.len())
            .filter(|i| hunt.adequate(&found, *i, excess) && hunt.accepted(&found, *i))
            .count()
            > 0;
        if most_parameters < usize::MAX {
            break;
        }
        if enough {
            // A set of more effects can still be as simple, by its parameters, and better.
            let accepted: Vec<usize> = (0..found.fits.len()).filter(|i| hunt.accepted(&found, *i)).collect();
            let (_, tied) = hunt.choose(&found, &accepted, excess)?;
            most_parameters = tied.iter().map(|i| found.fits[*i].parameters()).max().unwrap_or(0);
        }
    }
    for i in 0..found.fits.len() {
        for t in 0..found.fits[i].set.len() {
            let name = found.fits[i].set[t].name;
            let starts = library.candidates.iter().find(|c| c.0.name == name).map_or(1, |c| c.1.len());
            let p = found.fits[i].p_value(t, data.settings) * (library.candidates.len() * starts) as f64;
            found.fits[i].p_values[t] = p.min(1.0);
        }
    }
    let accepted: Vec<usize> = (0..found.fits.len()).filter(|i| hunt.accepted(&found, *i)).collect();
    let (champion, rivals) = hunt.choose(&found, &accepted, excess)?;
    (found.champion, found.rivals) = (champion, rivals);
    found.considered = considered(&found.fits, &accepted, expected);
    Ok(found)
}

/// Whether the trials' signs say that something is lacking, which is `visible` or not. What leaps leave below their floor is
/// no noise but what restarts cold, and may well have the same sign in trial after trial.
fn signs_speak(lack: &Lack, visible: bool, windows: &[window::Window]) -> bool {
    match (visible, window::leaping(windows)) {
        (true, _) => lack.tested.p < ANYTHING,
        (false, true) => false,
        (false, false) => lack.tested.p < INVISIBLE,
    }
}

/// Whether a fit that is so far above the noise floor lacks something for that alone.
pub fn far((excess, height, p): (f64, f64, f64)) -> bool {
    excess > FAR[0] && height > FAR[1] && p < FAR[2]
}

/// The candidates with their starts.
struct Library {
    candidates: Vec<(&'static Effect, Vec<Term>)>,
}

/// What a fit lacks: by candidate the start at which adding it helps most.
pub struct Lack {
    pub tested: Tested,
    /// (candidate, start, squares it would take away, values to start from)
    best: Vec<(usize, usize, f64, Vec<f64>)>,
}

impl Lack {
    /// Whether something could take away much more than chance does, of the `expected` squares that noise leaves.
    pub fn is_much(&self, expected: f64) -> bool {
        (self.tested.p < LIKELY_MUCH[0] && self.sure() > LIKELY_MUCH[1] * expected)
            || (self.tested.p < CLEARLY_MUCH[0] && self.sure() > CLEARLY_MUCH[1] * expected)
    }

    /// Squares that something could take away beyond chance.
    pub fn sure(&self) -> f64 {
        self.tested.groups.iter().chain(&self.tested.fields).map(|t| t.sure).fold(0.0, f64::max)
    }
}

/// Where a fit is to start: several places, of which the best counts.
struct Union {
    starts: Vec<(Layout, State)>,
}

/// What does not change during a search.
struct Hunt<'a, 'b> {
    data: &'b Data<'a>,
    library: &'b Library,
    latents: &'b [usize],
    expected: &'b Expected,
    /// Variance of smooth things under the noise, in its own variance: correlated noise counts for less.
    unit: f64,
    seed: u64,
}

impl Hunt<'_, '_> {
    /// Whether a fit is known to lack something: by the trials' signs, or by standing far above the noise floor. Few
    /// trials that differ much can hold strong evidence that their signs alone do not show.
    fn lacks(&self, fit: &Fitted, lack: &Lack) -> bool {
        let shots = !self.data.frozen.is_empty();
        let (excess, ..) = self.expected.above(fit, self.data.windows);
        let visible = excess > VISIBLE[0] || lack.sure() > VISIBLE[1] * self.expected.total();
        model::astray(self.data.windows, &fit.pass) >= SEVERAL
            || signs_speak(lack, visible || shots, self.data.windows)
            || lack.is_much(self.expected.total())
            || (!shots && far(self.expected.above(fit, self.data.windows)))
            || (!shots && self.expected.slow_misfit(fit, self.data.windows, self.unit).1 < PLAIN)
    }

    /// Whether flights' slow residuals hold more than noise.
    fn speaks(&self, fit: &Fitted) -> bool {
        self.expected.slow_misfit(fit, self.data.windows, self.unit).1 < SPEAKS
    }

    /// Whether a fit is known to lack nothing that matters.
    fn adequate(&self, found: &Found, i: usize, excess: f64) -> bool {
        let lack = found.lacks[i].as_ref();
        let fit = &found.fits[i];
        let clean = self.expected.middle_excess(fit, self.data.windows) < WRONG[0] && self.speaks(fit);
        lack.is_some_and(|l| {
            let much = l.tested.p < ANYTHING && l.sure() > MATTERS * excess;
            (!clean && l.sure() < NEGLIGIBLE * excess) || !(much || self.lacks(fit, l))
        })
    }

    /// Whether what a fit leaves is no more than other time steps make of the same physics: they do the same in every trial,
    /// so that what is better still may be theirs.
    fn as_steps_go(&self, fit: &Fitted) -> bool {
        self.data.other_steps && held(fit) < self.expected.total()
    }

    /// Whether one fit's held-out losses are smaller than another's by far more than chance makes them.
    fn beats(&self, better: &Fitted, worse: &Fitted) -> Result<bool> {
        let more = better.parameters().saturating_sub(worse.parameters()) as f64;
        let gain = (held(worse) - held(better)) / self.unit;
        if self.as_steps_go(worse) {
            return Ok(false);
        }
        if gain < HAIR * (1.0 + more) {
            return Ok(false);
        }
        let enough = LIKELY + HAIR * more;
        // One trial may hold most of what there is to tell; then the others must say as much.
        let most = worse.held.iter().zip(&better.held).map(|(w, b)| w - b).fold(0.0, f64::max) / self.unit;
        let likely = gain > enough && (paired(&worse.held, &better.held).1 > 1.0 || gain - most > enough);
        // Of many sets of more parameters one is better by chance more easily.
        Ok(likely || beaten(worse, better) || self.adds(worse, better, BEATEN / (1.0 + more))?)
    }

    /// What a fit lacks.
    fn test(&self, fit: &Fitted) -> Result<Lack> {
        let (mut groups, mut of) = (Vec::new(), Vec::new());
        for (c, (effect, terms)) in self.library.candidates.iter().enumerate() {
            if fit.set.iter().any(|e| e.name == effect.name) {
                continue;
            }
            for (s, term) in terms.iter().enumerate() {
                of.push((c, s));
                groups.push(directions(term, &term.start));
            }
        }
        let tested = signs::test(self.data, fit, groups, true, self.seed)?;
        let mut best: Vec<(usize, usize, f64, Vec<f64>)> = Vec::new();
        for ((c, s), told) in of.into_iter().zip(&tested.groups) {
            let term = &self.library.candidates[c].1[s];
            best.push((c, s, told.drop, sized(term, &told.sizes)));
        }
        best.sort_by(|a, b| b.2.total_cmp(&a.2));
        Ok(Lack { tested, best })
    }

    /// The most promising unions of a fit and a candidate.
    fn unions(&self, parents: &[(&Fitted, &Lack)], most: usize, parameters: usize) -> Vec<Union> {
        let mut all: Vec<(f64, Vec<&'static str>, Union, usize)> = Vec::new();
        for (fit, lack) in parents {
            for (c, (effect, terms)) in self.library.candidates.iter().enumerate() {
                let mut names = fit.names();
                if names.contains(&effect.name) || fit.parameters() + effect.parameters.len() > parameters {
                    continue;
                }
                names.push(effect.name);
                names.sort_unstable();
                // A survey frames regions by itself.
                let framed = effect.acts_on() == ActsOn::Region && window::leaping(self.data.windows);
                let most = if framed { 1 } else { STARTS.min(terms.len()) };
                let starts = lack.best.iter().filter(|b| b.0 == c).take(most);
                let starts: Vec<_> = starts.collect();
                let Some(drop) = starts.first().map(|b| b.2) else { continue };
                let left = model::total(&fit.pass) - drop;
                let start = |b: &&(usize, usize, f64, Vec<f64>)| {
                    fit.joined([Term { start: b.3.clone(), ..terms[b.1].clone() }], self.data.setting_count())
                };
                let union = Union { starts: starts.iter().map(start).collect() };
                let count = fit.parameters() + effect.parameters.len();
                match all.iter_mut().find(|u| u.1 == names) {
                    Some(known) if known.0 <= left => {}
                    Some(known) => *known = (left, names, union, count),
                    None => all.push((left, names, union, count)),
                }
            }
        }
        all.sort_by(|a, b| a.0.total_cmp(&b.0));
        // The best, and the best of the simple ones, which those of many parameters would crowd out.
        let (mut taken, mut plain, mut last) = (0, 0, f64::NEG_INFINITY);
        all.retain(|u| {
            let few = u.3 <= 1 + parents.first().map_or(0, |p| p.0.set.len()) * FEW;
            let keep = taken < most || (few && plain < most);
            taken += 1;
            // Twins count once.
            plain += usize::from(few && u.0 - last > ALIKE);
            last = if few { u.0 } else { last };
            keep
        });
        all.into_iter().map(|u| u.2).collect()
    }

    fn fit(&self, union: Union) -> Result<Option<Fitted>> {
        let mut best: Option<(Layout, State, Pass)> = None;
        // What is joined to a set that was surveyed starts from what was found there.
        let surveyed = |layout: &Layout| layout.terms.len() < 2 && survey::possible(self.data, layout);
        for (layout, start) in union.starts {
            let start = match surveyed(&layout) {
                true => match simulated(survey::survey(self.data, &layout, &start, self.seed))? {
                    Some(found) => found,
                    None => continue,
                },
                false => start,
            };
            let Some((state, pass)) = simulated(model::fit(
                self.data,
                &layout,
                start,
                if self.data.frozen.is_empty() { 8 } else { 5 },
            ))?
            else {
                continue;
            };
            if best.as_ref().is_none_or(|b| model::total(&pass) < model::total(&b.2)) {
                best = Some((layout, state, pass));
            }
        }
        Ok(best.map(|(layout, state, pass)| Fitted::new(layout, state, pass, self.data.settings)))
    }

    /// A fit brought to its end: valleys along which a shape and an amplitude make up for each other take many steps.
    fn polished(&self, fit: Fitted) -> Result<Fitted> {
        if !self.data.frozen.is_empty() {
            return Ok(fit);
        }
        let (state, pass) = model::fit(self.data, &fit.layout, fit.state, POLISH)?;
        Ok(Fitted::new(fit.layout, state, pass, self.data.settings))
    }

    /// Fits what the best sets from `first` on hold in a limit: no effect of many parameters stands where a simple one was
    /// never tried.
    fn simplify(&self, found: &mut Found, first: usize) -> Result<()> {
        let best: Vec<usize> = (first..found.fits.len()).filter(|i| found.lacks[*i].is_some()).collect();
        for i in best {
            for (large, small) in REGISTRY.iter().flat_map(|e| e.holds.iter().map(move |h| (e.name, h.name)))
            {
                let own = &found.fits[i].layout.terms;
                let candidate = self.library.candidates.iter().find(|c| c.0.name == small);
                let (Some(at), Some(term)) =
                    (own.iter().position(|t| t.effect.name == large), candidate.and_then(|c| c.1.first()))
                else {
                    continue;
                };
                let mut terms = own.clone();
                terms[at] = term.clone();
                let mut names: Vec<&str> = terms.iter().map(|t| t.effect.name).collect();
                names.sort_unstable();
                names.dedup();
                if names.len() < terms.len() || find(&found.fits, &names).is_some() {
                    continue;
                }
                let layout = Layout::new(self.latents, terms, self.data.setting_count());
                let start = extended(&found.base, &layout);
                let Some(fit) = self.fit(Union { starts: vec![(layout, start)] })? else { continue };
                let fit = self.polished(fit)?;
                let lack = self.test(&fit)?;
                found.fits.push(fit);
                found.lacks.push(Some(lack));
            }
        }
        Ok(())
    }

    /// Fits what the sets from `first` on are judged against: each without one of its terms.
    fn complete(&self, found: &mut Found, first: usize) -> Result<()> {
        let mut i = first;
        while i < found.fits.len() {
            for t in 0..found.fits[i].set.len() {
                let names = without(&found.fits[i], t);
                if names.is_empty() || find(&found.fits, &names).is_some() {
                    continue;
                }
                let own = &found.fits[i].layout.terms;
                let terms: Vec<Term> =
                    own.iter().enumerate().filter(|(k, _)| *k != t).map(|(_, t)| t.clone()).collect();
                let layout = Layout::new(self.latents, terms, self.data.setting_count());
                let start = extended(&found.base, &layout);
                if let Some(fit) = self.fit(Union { starts: vec![(layout, start)] })? {
                    found.fits.push(fit);
                    found.lacks.push(None);
                }
            }
            i += 1;
        }
        Ok(())
    }

    /// Whether each term of a set earns its place.
    fn accepted(&self, found: &Found, i: usize) -> bool {
        let expected = self.expected;
        let f = &found.fits[i];
        let excess = (held(&found.base) - expected.total()).max(0.0);
        // Where a set explains the data to their noise, and without one of its effects does not, a small effect is no error
        // of the recording.
        let clean = self.expected.middle_excess(f, self.data.windows) < WRONG[0];
        (0..f.set.len()).all(|t| {
            let names = without(f, t);
            let other = match names.is_empty() {
                true => Some(&found.base),
                false => find(&found.fits, &names).map(|k| &found.fits[k]),
            };
            let Some(other) = other else { return false };
            let (gain, t_value) = paired(&other.held, &f.held);
            let gain = gain * other.held.len() as f64;
            let left = (held(other) - expected.total()).max(0.0);
            let hundredth = if clean && self.speaks(other) { 0.0 } else { HUNDREDTH };
            let helps = t_value > 1.0 && gain >= (TENTH * left).max(hundredth * excess);
            helps && (self.shown(other, f) || self.adds(other, f, ACCEPT).unwrap_or(false))
        })
    }

    /// Whether leaps say by themselves that `better` is: where nothing errs every trial's loss is a likelihood, and the way
    /// downhill, which [`Hunt::adds`] looks at, ends where a collision goes another way.
    fn shown(&self, fit: &Fitted, better: &Fitted) -> bool {
        let gains = fit.held.iter().zip(&better.held).map(|(a, b)| a - b);
        let helped = gains.clone().filter(|g| *g > HAIR).count();
        let more = better.parameters().saturating_sub(fit.parameters()) as f64;
        window::leaping(self.data.windows) && helped >= SEVERAL && gains.sum::<f64>() > LIKELY + HAIR * more
    }

    /// Whether what `better` has and `fit` has not would help `fit` in trial after trial.
    fn adds(&self, fit: &Fitted, better: &Fitted, level: f64) -> Result<bool> {
        let mut groups = Vec::new();
        for (t, term) in better.layout.terms.iter().enumerate() {
            if fit.set.iter().any(|e| e.name == term.effect.name) {
                continue;
            }
            let mut values = term.start.clone();
            for i in better.layout.of_term(t) {
                if let model::What::Parameter(_, p) = better.layout.slots[i].what {
                    values[p] = better.state.values[i];
                }
            }
            groups.push(directions(term, &values));
        }
        let per_setting = groups.iter().any(|g| g.per_setting);
        let extras: Vec<Extra> = groups.into_iter().flat_map(|g| g.extras).collect();
        if extras.is_empty() {
            return Ok(false);
        }
        let tested = signs::test(self.data, fit, vec![Group { extras, per_setting }], false, self.seed)?;
        let told = &tested.groups[0];
        Ok(told.p.min(told.normal_p) < level)
    }

    /// The simplest of the best sets, and all that tie.
    fn choose(&self, found: &Found, accepted: &[usize], excess: f64) -> Result<(Option<usize>, Vec<usize>)> {
        let fits = &found.fits;
        let adequate = |i: usize| self.adequate(found, i, excess);
        let any = accepted.iter().any(|i| adequate(*i));
        let pool: Vec<usize> = accepted.iter().copied().filter(|i| !any || adequate(*i)).collect();
        let Some(best) = pool.iter().copied().min_by(|a, b| held(&fits[*a]).total_cmp(&held(&fits[*b])))
        else {
            return Ok((None, Vec::new()));
        };
        // Where the best is known to be wrong itself, statistics of differences mean little: what is not much further
        // from the data is as good.
        let middle = |i: usize| self.expected.middle_excess(&fits[i], self.data.windows);
        let wrong = middle(best);
        let spoken = found.lacks[best].as_ref().is_none_or(|l| self.lacks(&fits[best], l));
        let known = if spoken { WRONG[0] } else { WRONG[1] } + 2.0 * self.expected.floor_error;
        let above = |i: usize| (held(&fits[i]) - self.expected.total()).max(0.0);
        let no_worse = |i: usize| {
            wrong > known
                && fits[i].parameters() <= fits[best].parameters()
                && middle(i) < AGAIN * wrong
                && above(i) < AGAIN * above(best)
        };
        let mut tied = Vec::new();
        for i in accepted.iter().copied() {
            if !pool.contains(&i) && !no_worse(i) {
                continue;
            }
            if no_worse(i) {
                tied.push(i);
                continue;
            }
            if i == best || !self.beats(&fits[best], &fits[i])? {
                tied.push(i);
            }
        }
        let within = |small: usize, large: usize| {
            let large = fits[large].names();
            fits[small].names().iter().all(|n| large.contains(n))
        };
        // A set within a larger one that is no better than chance makes it stands for it.
        let all = tied.clone();
        tied.retain(|i| {
            !all.iter().any(|j| fits[*j].set.len() < fits[*i].set.len() && within(*j, *i) && adequate(*j))
        });
        tied.sort_by(|a, b| {
            let key = |i: usize| (fits[i].set.len(), fits[i].parameters());
            key(*a).cmp(&key(*b)).then(held(&fits[*a]).total_cmp(&held(&fits[*b])))
        });
        let Some(champion) = tied.first().copied() else { return Ok((None, Vec::new())) };
        tied.retain(|i| {
            let (own, simplest) = (&fits[*i], &fits[champion]);
            let more = own.parameters().saturating_sub(simplest.parameters()) as f64;
            let gain = (held(simplest) - held(own)) / self.unit;
            // What holds the simplest within it is never worse; what does not must be no worse for its parameters.
            let least = match own.set.len() > simplest.set.len() {
                _ if holds(own, simplest) => 1.0 + more,
                // Errors of several instruments that look like one push are less likely than the push; two pushes are not.
                true if own.set.iter().any(|e| e.acts_on() == ActsOn::Sensor) => more.max(0.5),
                true if more == 0.0 => -1.0,
                true => more,
                false => more - 1.0,
            };
            (gain > HAIR * least && !self.as_steps_go(simplest))
                || (own.set.len() <= simplest.set.len() && more == 0.0)
        });
        Ok((Some(champion), tied))
    }
}

/// The directions of a term's amplitudes at some values.
fn directions(term: &Term, values: &[f64]) -> Group {
    let parameters = term.effect.parameters;
    let shapes = |p: usize| !parameters[p].is_amplitude();
    let extras = (0..parameters.len())
        .filter(|p| !shapes(*p) && term.free[*p])
        .map(|p| {
            let own = |k: usize| match k {
                _ if shapes(k) => values[k],
                _ if k == p => parameters[k].neutral + parameters[k].step,
                _ => parameters[k].neutral,
            };
            Extra { effect: term.effect, values: (0..parameters.len()).map(own).collect() }
        })
        .collect();
    Group { extras, per_setting: term.per_setting }
}

/// A term's values with amplitudes of the sizes found along its directions.
fn sized(term: &Term, sizes: &[f64]) -> Vec<f64> {
    let mut sizes = sizes.iter();
    let value = |(p, parameter): (usize, &Parameter)| {
        if !parameter.is_amplitude() || !term.free[p] {
            return term.start[p];
        }
        let size = sizes.next().copied().unwrap_or(0.0);
        let value = parameter.neutral + size * parameter.step;
        let [low, high] = library::bounds(term.effect, parameter);
        // Off the bound, where nothing could be told.
        let hair = 1e-3 * parameter.step;
        value.clamp(low, high).max(if low == parameter.neutral { low + hair } else { low })
    };
    term.effect.parameters.iter().enumerate().map(value).collect()
}

/// Whether one fit's held-out losses are smaller than another's by more than chance makes them: the mean, or the ranks.
/// Twins differ by rounding alone, always to the same side: less than [`HAIR`] is no difference.
fn beaten(worse: &Fitted, better: &Fitted) -> bool {
    let least = t_quantile(0.01, better.held.len() as f64 - 1.0);
    let (gain, t) = paired(&worse.held, &better.held);
    gain * better.held.len() as f64 > HAIR && (t > least || ranked(&worse.held, &better.held) > 2.576)
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

fn without(f: &Fitted, term: usize) -> Vec<&'static str> {
    let mut names: Vec<_> =
        f.set.iter().enumerate().filter(|(k, _)| *k != term).map(|(_, e)| e.name).collect();
    names.sort_unstable();
    names
}

/// Whether every effect of `small` is in `large` or held by another effect there.
fn holds(large: &Fitted, small: &Fitted) -> bool {
    let within = |small: &Effect| large.set.iter().any(|l| l.name == small.name || l.holds(small));
    large.parameters() > small.parameters() && small.set.iter().all(|s| within(s))
}

/// The best single effects of few parameters among `order`, one of those that look exactly alike.
fn plain(fits: &[Fitted], order: &[usize]) -> Vec<usize> {
    let mut out: Vec<usize> = Vec::new();
    for i in order.iter().copied().filter(|i| simple(&fits[*i])) {
        if out.len() < SIMPLE && out.iter().all(|o| (held(&fits[*o]) - held(&fits[i])).abs() > ALIKE) {
            out.push(i);
        }
    }
    out
}

/// Whether a single effect has few parameters.
fn simple(fit: &Fitted) -> bool {
    fit.set.len() == 1 && fit.parameters() <= FEW
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
pub fn simulated<T>(fitted: Result<T>) -> Result<Option<T>> {
    match fitted {
        Ok(found) => Ok(Some(found)),
        Err(Error::Input(_) | Error::Failed(_)) => Ok(None),
        Err(other) => Err(other),
    }
}
