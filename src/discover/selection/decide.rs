//! From the posterior over sets of effects to a verdict.
//!
//! The posterior probability of a set is its evidence times its prior probability (every effect acts with the same
//! probability), normalised over the sets that were fitted. The credible set holds 95 % of it, without sets that contain
//! another of them as a special case. The empty set in it: `none`. One set: `named`. Several: `ambiguous`. Sets that explain too
//! little of the predictable misfit, or beside which a force field without a name or an effect less than nothing is certain, or which are less probable than that
//! field alone, or of which a strength is at an end of its range: `unknown`. So are sets that do not for certain remove half of
//! the error, and of those none is reported.
//!
//! Source: Kass and Raftery, J. Am. Stat. Assoc. 90 (1995) 773; Madigan and Raftery, J. Am. Stat. Assoc. 89 (1994) 1535, for
//! models that are set aside because a simpler one is as probable.

use super::explained::{Explained, Explanation, explanation};
use super::settings::SETTINGS;
use crate::discover::field::{self, FieldFit};
use crate::discover::fit::{Fitted, Fitter};
use crate::discover::report::Verdict;
use crate::discover::search::{Found, log_prior};
use crate::error::Result;
use crate::estimate::sampler::log_sum_exp;
use crate::world::effect::Effect;

/// Steps of least squares to a model whose effects may have either sign.
const STEPS: usize = 12;

/// A verdict with what it follows from.
pub struct Decision {
    pub verdict: Verdict,
    /// Index of the set that is reported; none if no set is.
    pub champion: Option<usize>,
    /// Indices of the sets in the credible set, most probable first.
    pub rivals: Vec<usize>,
    /// Posterior probability by fit, and of the base model.
    pub probabilities: Vec<f64>,
    pub base_probability: f64,
    pub explained: Option<Explained>,
    /// Share of the excess error on held-out trials that the reported model removes; `None` without excess or model.
    pub gain: Option<f64>,
    /// The most probable field beside the reported model.
    pub field: Option<FieldFit>,
    /// Log evidence of that field beside the reported model, relative to the model alone, nats.
    pub unnamed: Option<f64>,
}

impl Decision {
    /// Posterior probability of all sets that hold a fit's effects.
    pub fn with_all_of(&self, found: &Found, fit: usize) -> f64 {
        let sets = found.fits.iter().zip(&self.probabilities).filter(|(f, _)| f.holds(&found.fits[fit]));
        sets.map(|(_, p)| p).sum()
    }

    /// Posterior probability that an effect acts.
    pub fn inclusion(&self, found: &Found, name: &str) -> f64 {
        let holds = |fit: &Fitted| fit.set.iter().any(|e| e.name == name);
        let sets = found.fits.iter().zip(&self.probabilities).filter(|(fit, _)| holds(fit));
        sets.map(|(_, p)| p).sum()
    }
}

/// Decides what a search found.
pub fn decide(fitter: &Fitter, found: &Found, seed: u64) -> Result<Decision> {
    let all = log_sum_exp(found.log_posterior.iter().chain([&found.base_log_posterior]).copied());
    let probability = |l: f64| libm::exp(l - all);
    let probabilities: Vec<f64> = found.log_posterior.iter().map(|l| probability(*l)).collect();
    let base_probability = probability(found.base_log_posterior);
    let credible = credible(&probabilities, base_probability);
    let decision =
        |verdict, rivals: Vec<usize>, (explained, gain), field: Option<FieldFit>, unnamed| Decision {
            verdict,
            champion: rivals.first().copied(),
            rivals,
            probabilities: probabilities.clone(),
            base_probability,
            explained,
            gain,
            field,
            unnamed,
        };
    if credible.contains(&None) {
        let field = field::fit(fitter, &found.base)?;
        let unnamed = field.as_ref().map(|f| f.log_evidence - found.base.log_evidence);
        let verdict = if unnamed.is_some_and(is_certain) { Verdict::Unknown } else { Verdict::None };
        return Ok(decision(verdict, Vec::new(), (None, None), field, unnamed));
    }
    let sets: Vec<usize> = credible.into_iter().flatten().collect();
    let (rivals, Explanation { shares, gain }, earned) = earned(fitter, found, simplest(found, &sets), seed)?;
    let champion = &found.fits[rivals[0]];
    let field = field::fit(fitter, champion)?;
    let by_field = field.as_ref().map(|f| f.log_evidence - champion.log_evidence);
    let by_law = reversed(fitter, found, rivals[0])?;
    let unnamed = by_field.into_iter().chain(by_law).max_by(f64::total_cmp);
    let alone = field::fit(fitter, &found.base)?;
    let named = found.log_posterior[rivals[0]] + unnamed.map_or(0.0, |nats| (nats + log_prior(1)).max(0.0));
    let is_likelier = alone.as_ref().is_none_or(|alone| alone.log_evidence + log_prior(1) <= named);
    let explained = shares.first().copied().flatten();
    let explains = explained.is_none_or(|e| e.explains_enough())
        && !unnamed.is_some_and(is_certain)
        && earned
        && is_likelier
        && !champion.stands_at_bound();
    let gains = gain.is_none_or(|g| g >= SETTINGS.least_gain)
        && (explains || explained.is_none_or(|e| e.interval[0] >= SETTINGS.least_gain));
    if !gains {
        let unnamed = alone.as_ref().map(|f| f.log_evidence - found.base.log_evidence);
        return Ok(decision(Verdict::Unknown, Vec::new(), (None, None), alone, unnamed));
    }
    let verdict = match rivals.len() {
        _ if !explains => Verdict::Unknown,
        1 => Verdict::Named,
        _ => Verdict::Ambiguous,
    };
    Ok(decision(verdict, rivals, (explained, gain), field, unnamed))
}

/// Indices of the fits of a set's effects but one, or with a special case of one in its place.
fn simpler(found: &Found, fit: usize) -> Vec<usize> {
    let all = &found.fits[fit];
    let is_next = |f: &&Fitted| {
        let kept = f.set.iter().filter(|e| all.set.iter().any(|own| own.name == e.name)).count();
        contains(all, f) && kept + 1 == all.set.len()
    };
    (0..found.fits.len()).filter(|f| is_next(&&found.fits[*f])).collect()
}

/// Rivals with what the first of them explains, and whether each of its effects is needed: explains its share of what the set without
/// it, or with a special case in its place, leaves. A small or flexible effect may stand for what trials share of no law. Where
/// the smaller set explains enough it becomes a rival: the data do not tell which of the two it is.
fn earned(
    fitter: &Fitter,
    found: &Found,
    mut rivals: Vec<usize>,
    seed: u64,
) -> Result<(Vec<usize>, Explanation, bool)> {
    let explain = |fit: usize| -> Result<(Vec<usize>, Explanation)> {
        let smaller = simpler(found, fit);
        let fewer: Vec<&Fitted> =
            [&found.base].into_iter().chain(smaller.iter().map(|s| &found.fits[*s])).collect();
        Ok((smaller, explanation(fitter, &fewer, &found.fits[fit], seed)?))
    };
    // The most probable of the smaller sets that leave little more than the larger one.
    let sufficient = |smaller: &[usize], of: &Explanation| {
        let shares = smaller.iter().zip(of.shares.iter().skip(1));
        let suffices = shares.filter(|(_, e)| e.is_some_and(|e| e.interval[1] < SETTINGS.least_gain));
        let posterior = |s: &usize| found.log_posterior[*s];
        suffices.map(|(s, _)| *s).max_by(|a, b| posterior(a).total_cmp(&posterior(b)))
    };
    let (smaller, first) = explain(rivals[0])?;
    let mut next = sufficient(&smaller, &first);
    while let Some(enough) = next {
        let (smaller, other) = explain(enough)?;
        if !other.shares.first().copied().flatten().is_none_or(|e| e.explains_enough()) {
            return Ok((rivals, first, false));
        }
        if !rivals.contains(&enough) {
            rivals.push(enough);
        }
        next = sufficient(&smaller, &other);
    }
    Ok((rivals, first, true))
}

/// Largest log evidence of a set with one more effect than a fit, if that could be less than nothing, relative to the fit, nats:
/// where a drag of one law seems negative beside another, the law is neither. `None` where no effect ends at nothing.
fn reversed(fitter: &Fitter, found: &Found, fit: usize) -> Result<Option<f64>> {
    let model = &found.fits[fit];
    let mut best = None;
    for larger in found.fits.iter().filter(|f| f.set.len() == model.set.len() + 1 && f.holds(model)) {
        let Some((layout, state)) = larger.with_either_sign() else { continue };
        let free = fitter.fit(layout, state, STEPS)?.map(|free| free.log_evidence - model.log_evidence);
        best = best.into_iter().chain(free).max_by(f64::total_cmp);
    }
    Ok(best)
}

/// Whether log odds for an unnamed field are beyond doubt, its prior probability that of an effect.
fn is_certain(nats: f64) -> bool {
    nats + log_prior(1) > certain()
}

/// Log odds that are beyond doubt.
fn certain() -> f64 {
    (SETTINGS.confidence / (1.0 - SETTINGS.confidence)).ln()
}

/// The smallest set of models (`None`: the base model) that holds the credible mass, most probable first.
fn credible(probabilities: &[f64], base: f64) -> Vec<Option<usize>> {
    let mut order: Vec<(f64, Option<usize>)> =
        probabilities.iter().enumerate().map(|(i, p)| (*p, Some(i))).collect();
    order.push((base, None));
    order.sort_by(|a, b| b.0.total_cmp(&a.0).then(a.1.cmp(&b.1)));
    let mut mass = 0.0;
    let mut out = Vec::new();
    for (p, model) in order {
        out.push(model);
        mass += p;
        if mass >= SETTINGS.credible_mass {
            break;
        }
    }
    out
}

/// Those of some sets that contain no other of them as a special case, unless they are certainly more probable, in their order.
fn simplest(found: &Found, sets: &[usize]) -> Vec<usize> {
    let is_likelier = |i: usize, j: usize| found.log_posterior[i] - found.log_posterior[j] > certain();
    let covers = |i: usize, j: usize| contains(&found.fits[i], &found.fits[j]) && !is_likelier(i, j);
    let kept = |i: &usize| !sets.iter().any(|j| j != i && covers(*i, *j));
    sets.iter().copied().filter(kept).collect()
}

/// Whether a set is another, or more than it, for some of its values.
fn contains(large: &Fitted, small: &Fitted) -> bool {
    large.parameters() > small.parameters()
        && small.set.iter().all(|s| large.set.iter().any(|l| l.name == s.name || has_case(l, s)))
}

/// Whether an effect is another for some of its values, or by way of one that is.
fn has_case(large: &Effect, small: &Effect) -> bool {
    large.special_cases.iter().any(|h| h.name == small.name || has_case(h, small))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::world::effect::find;

    #[test]
    fn special_cases_are_transitive() {
        let case = |l: &str, s: &str| has_case(find(l).unwrap(), find(s).unwrap());
        assert!(case("gust", "wind") && case("moving_air", "quadratic_drag"));
        assert!(!case("wind", "gust") && !case("lift", "linear_drag"));
    }

    #[test]
    fn the_credible_set_holds_its_mass() {
        assert_eq!(credible(&[0.9, 0.03, 0.02], 0.05), [Some(0), None]);
        assert_eq!(credible(&[0.5, 0.47, 0.01], 0.02), [Some(0), Some(1)]);
    }
}
