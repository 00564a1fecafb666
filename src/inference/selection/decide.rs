//! From the posterior over sets of effects to a verdict.
//!
//! The posterior probability of a set is its evidence times its prior probability (every effect acts with the
//! same probability), normalised over the fitted sets. The credible set holds 95 % of it, without sets that
//! contain another one as a special case. If the empty set has the remaining 5 % or more the verdict is `none`; with one set
//! `named`, with several `ambiguous`. The verdict is `unknown` if the sets explain too little of the
//! predictable misfit, if a further effect of the opposite sign is certain in addition to the set, or an unnamed field that
//! is larger than a plausible discrepancy, if an unnamed field is more probable than the set, if an amplitude is at a bound, or if a set cancels gravity. It is also
//! `unknown`, without a reported set, if the sets do not certainly remove half of the error.
//!
//! Source: Kass and Raftery, J. Am. Stat. Assoc. 90 (1995) 773; Madigan and Raftery, J. Am. Stat. Assoc. 89
//! (1994) 1535, for the exclusion of models with an equally probable simpler one.

use super::explained::{ExplainedShare, Explanation, explanation};
use super::settings::SETTINGS;
use crate::error::Result;
use crate::estimate::sampler::log_sum_exp;
use crate::inference::field::{self, FieldFit};
use crate::inference::mixed_model::fitted_model::FittedModel;
use crate::inference::mixed_model::model_fit::ModelFitter;
use crate::inference::report::Verdict;
use crate::inference::selection::search::{SearchResult, log_prior};
use crate::world::effect::{Effect, PriorCoordinate};

/// Maximum number of least-squares steps to a model whose effects may have either sign.
const MAX_STEPS: usize = 12;

/// A verdict with its reasons.
pub struct Decision {
    pub verdict: Verdict,
    /// Index of the reported set; `None` if no set is reported.
    pub selected: Option<usize>,
    /// Indices of the credible sets, most probable first.
    pub rivals: Vec<usize>,
    /// Posterior probability by fit, and of the base model.
    pub probabilities: Vec<f64>,
    pub base_probability: f64,
    pub explained: Option<ExplainedShare>,
    /// Share of the excess error on held-out trials that the reported model removes; `None` without excess or model.
    pub gain: Option<f64>,
    /// The most probable field in addition to the reported model.
    pub field: Option<FieldFit>,
    /// Log Bayes factor of that field in addition to the reported model, nats.
    pub field_log_bayes_factor: Option<f64>,
    /// Whether a further effect beside the reported set would certainly have the opposite sign.
    pub is_law_open: bool,
    /// Whether a set cancels gravity: bodies keep their speed, and which forces balance is not identifiable.
    pub is_balance: bool,
}

impl Decision {
    /// Posterior probability of all sets that contain a fit's effects.
    pub fn superset_probability(&self, found: &SearchResult, fit: usize) -> f64 {
        let sets = found.fits.iter().zip(&self.probabilities).filter(|(f, _)| f.includes(&found.fits[fit]));
        sets.map(|(_, p)| p).sum()
    }

    /// Models that further data should discriminate: the rivals; if the empty set is credible, the base model and the sets whose
    /// probability exceeds the prior one of an effect, without those that contain another one.
    pub fn undecided<'f>(&self, found: &'f SearchResult) -> Vec<&'f FittedModel> {
        if self.verdict != Verdict::None {
            return self.rivals.iter().map(|i| &found.fits[*i]).collect();
        }
        let mut possible = found.ranked(|_| true);
        possible.retain(|i| self.probabilities[*i] > SETTINGS.inclusion);
        let sets = simplest(found, &possible).into_iter().map(|i| &found.fits[i]);
        [&found.base].into_iter().chain(sets).collect()
    }

    /// Whether a force without a name is certain in addition to the reported model.
    pub fn is_field_certain(&self) -> bool {
        self.field_log_bayes_factor.is_some_and(is_certain)
    }

    /// Posterior probability that an effect acts.
    pub fn inclusion_probability(&self, found: &SearchResult, name: &str) -> f64 {
        let holds = |fit: &FittedModel| fit.effects.iter().any(|e| e.name == name);
        let sets = found.fits.iter().zip(&self.probabilities).filter(|(fit, _)| holds(fit));
        sets.map(|(_, p)| p).sum()
    }
}

/// Decides from the result of a search.
pub fn decide(fitter: &ModelFitter, found: &SearchResult, seed: u64) -> Result<Decision> {
    let all = log_sum_exp(found.log_posterior.iter().chain([&found.base_log_posterior]).copied());
    let probability = |l: f64| libm::exp(l - all);
    let probabilities: Vec<f64> = found.log_posterior.iter().map(|l| probability(*l)).collect();
    let base_probability = probability(found.base_log_posterior);
    let decision =
        |verdict, rivals: Vec<usize>, (explained, gain), field: Option<FieldFit>, field_log_bayes_factor| {
            Decision {
                verdict,
                selected: rivals.first().copied(),
                rivals,
                probabilities: probabilities.clone(),
                base_probability,
                explained,
                gain,
                field,
                field_log_bayes_factor,
                is_law_open: false,
                is_balance: false,
            }
        };
    if base_probability >= 1.0 - SETTINGS.credible_mass {
        let field = field::fit(fitter, &found.base)?;
        let field_log_bayes_factor = field.as_ref().map(|f| f.log_evidence - found.base.log_evidence);
        let verdict =
            if field_log_bayes_factor.is_some_and(is_certain) { Verdict::Unknown } else { Verdict::None };
        return Ok(decision(verdict, Vec::new(), (None, None), field, field_log_bayes_factor));
    }
    let sets = credible_set(&probabilities, base_probability);
    let (rivals, field) = beside_field(fitter, found, simplest(found, &sets))?;
    let (rivals, Explanation { shares, gain }, earned) = check_necessity(fitter, found, rivals, seed)?;
    let champion = &found.fits[rivals[0]];
    let field_log_bayes_factor = field.as_ref().map(|f| f.log_evidence - champion.log_evidence);
    let reversed = reversed_effect_log_bayes_factor(fitter, found, rivals[0])?;
    let unnamed = field_log_bayes_factor.into_iter().chain(reversed).max_by(f64::total_cmp);
    let explained = shares.first().copied().flatten();
    // Beside every smaller set as well: the scene alone may be far off, compared with which anything is small.
    let is_small = |e: &ExplainedShare| e.interval[0] >= 1.0 - SETTINGS.small_misfit();
    let is_field_small = explained.is_some() && shares.iter().flatten().all(is_small);
    let alone = field::fit(fitter, &found.base)?;
    let named = found.log_posterior[rivals[0]] + unnamed.map_or(0.0, |nats| (nats + log_prior(1)).max(0.0));
    let is_likelier = alone.as_ref().is_none_or(|alone| alone.log_evidence + log_prior(1) <= named);
    let is_balance = rivals.iter().any(|rival| cancels_gravity(&found.fits[*rival]));
    let explains = !is_balance
        && explained.is_none_or(|e| e.explains_enough())
        && !reversed.is_some_and(is_certain)
        && (!field_log_bayes_factor.is_some_and(is_certain) || is_field_small)
        && earned
        && is_likelier
        && !champion.is_at_bound();
    let gains = gain.is_none_or(|g| g >= SETTINGS.least_gain)
        && (explains || explained.is_none_or(|e| e.interval[0] >= SETTINGS.least_gain));
    if !gains {
        let field_log_bayes_factor = alone.as_ref().map(|f| f.log_evidence - found.base.log_evidence);
        return Ok(decision(Verdict::Unknown, Vec::new(), (None, None), alone, field_log_bayes_factor));
    }
    let verdict = match rivals.len() {
        _ if !explains => Verdict::Unknown,
        1 => Verdict::Named,
        _ => Verdict::Ambiguous,
    };
    let decision = decision(verdict, rivals, (explained, gain), field, field_log_bayes_factor);
    Ok(Decision { is_law_open: reversed.is_some_and(is_certain), is_balance, ..decision })
}

/// Whether an error of gravity leaves nothing that pulls.
fn cancels_gravity(fit: &FittedModel) -> bool {
    let cancels = |i: usize| {
        let is_error =
            fit.layout.declaration(i).is_some_and(|p| p.prior_coordinate == PriorCoordinate::LogGravity);
        is_error && (fit.gravity + fit.state.values[i]).abs() < SETTINGS.balance * fit.gravity
    };
    (0..fit.layout.parameters.len()).any(cancels)
}

/// Indices of the fits with one effect of a set removed or replaced by a special case.
fn immediate_submodels(found: &SearchResult, fit: usize) -> Vec<usize> {
    let all = &found.fits[fit];
    let is_next = |f: &&FittedModel| {
        let used = f.effects.iter().filter(|e| all.effects.iter().any(|own| own.name == e.name)).count();
        contains(all, f) && used + 1 == all.effects.len()
    };
    (0..found.fits.len()).filter(|f| is_next(&&found.fits[*f])).collect()
}

/// Rivals, with the most probable field beside the first. If that field is certain, an effect of a set may stand for a part of it:
/// smaller sets that are as probable beside a field take the place of the first one.
fn beside_field(
    fitter: &ModelFitter,
    found: &SearchResult,
    mut rivals: Vec<usize>,
) -> Result<(Vec<usize>, Option<FieldFit>)> {
    let posterior = |fit: usize, field: &Option<FieldFit>| {
        let log_evidence = field.as_ref().map_or(f64::NEG_INFINITY, |f| f.log_evidence);
        log_evidence + log_prior(found.fits[fit].effects.len())
    };
    let mut field = field::fit(fitter, &found.fits[rivals[0]])?;
    while field.as_ref().is_some_and(|f| is_certain(f.log_evidence - found.fits[rivals[0]].log_evidence)) {
        let mut best: Option<(f64, usize, Option<FieldFit>)> = None;
        for smaller in immediate_submodels(found, rivals[0]) {
            let own = field::fit(fitter, &found.fits[smaller])?;
            let log_posterior = posterior(smaller, &own);
            if log_posterior >= best.as_ref().map_or(posterior(rivals[0], &field), |(most, ..)| *most) {
                best = Some((log_posterior, smaller, own));
            }
        }
        let Some((_, smaller, own)) = best else { break };
        rivals.retain(|r| *r != smaller && !contains(&found.fits[*r], &found.fits[smaller]));
        rivals.insert(0, smaller);
        field = own;
    }
    Ok((rivals, field))
}

/// Rivals with the explanation by the first, and whether each of its effects is needed: explains its share of
/// the misfit of the set without it or with a special case of it. A weak or flexible effect may fit a shared
/// discrepancy. A smaller set that explains enough becomes a rival.
fn check_necessity(
    fitter: &ModelFitter,
    found: &SearchResult,
    mut rivals: Vec<usize>,
    seed: u64,
) -> Result<(Vec<usize>, Explanation, bool)> {
    let explain = |fit: usize| -> Result<(Vec<usize>, Explanation)> {
        let smaller = immediate_submodels(found, fit);
        let fewer: Vec<&FittedModel> =
            [&found.base].into_iter().chain(smaller.iter().map(|s| &found.fits[*s])).collect();
        Ok((smaller, explanation(fitter, &fewer, &found.fits[fit], seed)?))
    };
    // Most probable smaller set that explains nearly as much.
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

/// Largest log Bayes factor over a model of sets with one more effect, the sign of which is free although its amplitude is
/// bounded by nothing. If quadratic drag beside linear drag is negative, the law is neither. `None` without such a set.
fn reversed_effect_log_bayes_factor(
    fitter: &ModelFitter,
    found: &SearchResult,
    fit: usize,
) -> Result<Option<f64>> {
    let model = &found.fits[fit];
    let is_next = |f: &&FittedModel| f.effects.len() == model.effects.len() + 1 && f.includes(model);
    let mut best = None;
    for larger in found.fits.iter().filter(is_next) {
        let Some((layout, state)) = larger.with_either_sign() else { continue };
        let free = fitter.fit(layout, state, MAX_STEPS)?.map(|free| free.log_evidence - model.log_evidence);
        best = best.into_iter().chain(free).max_by(f64::total_cmp);
    }
    Ok(best)
}

/// Whether an unnamed field is certain, given its log Bayes factor; its prior probability is that of an
/// effect.
fn is_certain(nats: f64) -> bool {
    nats + log_prior(1) > SETTINGS.log_odds_of_certainty()
}

/// The smallest set of fits that together with the base model holds the credible mass, most probable first.
fn credible_set(probabilities: &[f64], base: f64) -> Vec<usize> {
    let mut order: Vec<usize> = (0..probabilities.len()).collect();
    order.sort_by(|a, b| probabilities[*b].total_cmp(&probabilities[*a]).then(a.cmp(b)));
    let mut mass = base;
    let mut out = Vec::new();
    for i in order {
        out.push(i);
        mass += probabilities[i];
        if mass >= SETTINGS.credible_mass {
            break;
        }
    }
    out
}

/// The sets that contain no other one as a special case, unless they are certainly more probable than it.
fn simplest(found: &SearchResult, sets: &[usize]) -> Vec<usize> {
    let is_likelier = |i: usize, j: usize| {
        found.log_posterior[i] - found.log_posterior[j] > SETTINGS.log_odds_of_certainty()
    };
    let covers = |i: usize, j: usize| contains(&found.fits[i], &found.fits[j]) && !is_likelier(i, j);
    let used = |i: &usize| !sets.iter().any(|j| j != i && covers(*i, *j));
    sets.iter().copied().filter(used).collect()
}

/// Whether a set contains another one as a special case.
fn contains(large: &FittedModel, small: &FittedModel) -> bool {
    large.effect_parameter_count() > small.effect_parameter_count()
        && small.effects.iter().all(|s| large.effects.iter().any(|l| l.name == s.name || has_case(l, s)))
}

/// Whether an effect contains another one as a special case, also indirectly.
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
        assert_eq!(credible_set(&[0.03, 0.93, 0.02], 0.02), [1]);
        assert_eq!(credible_set(&[0.5, 0.46, 0.02], 0.02), [0, 1]);
    }
}
