//! From the posterior over sets of effects in joints to a verdict: the rules of `selection::decide`.

use nalgebra::DVector;
use rand_distr::{Distribution, Exp1};

use super::model_fit::{JointContext, JointFit};
use super::search::JointSearch;
use crate::error::Result;
use crate::estimate::sampler::log_sum_exp;
use crate::inference::mixed_model::group_statistics::{GroupStatistics, gls};
use crate::inference::report::Verdict;
use crate::inference::selection::search::log_prior;
use crate::inference::selection::{SETTINGS, at_scale};
use crate::rng;
use crate::world::mechanism::JointTerm;

/// Size of an effect in standard deviations of the largest plausible discrepancy from which it is named.
const MIN_DISCREPANCY_SD: f64 = 2.0;
/// Draws of the Bayesian bootstrap over trials, and number of held-out parts.
const DRAWS: usize = 1000;
const FOLDS: usize = 5;
/// Least excess of the base model over the noise, as a share of it, for shares to be defined.
const MIN_EXCESS: f64 = 0.2;

/// A verdict with its reasons.
pub struct JointDecision {
    pub verdict: Verdict,
    /// Indices of the credible sets, most probable first; the first is reported.
    pub rivals: Vec<usize>,
    /// Posterior probability by fit, and of the base model.
    pub probabilities: Vec<f64>,
    pub base_probability: f64,
    /// Share of the predictable misfit that the reported set explains, with its 90 % interval.
    pub explained: Option<(f64, [f64; 2])>,
    /// Share of the excess squared error on held-out trials that it removes.
    pub gain: Option<f64>,
}

/// Decides from the result of a search.
pub fn decide(context: &JointContext, found: &JointSearch, seed: u64) -> Result<JointDecision> {
    let all = log_sum_exp(found.log_posterior.iter().chain([&found.base.log_evidence]).copied());
    let probabilities: Vec<f64> = found.log_posterior.iter().map(|l| libm::exp(l - all)).collect();
    let base_probability = libm::exp(found.base.log_evidence - all);
    let mut out = JointDecision {
        verdict: Verdict::None,
        rivals: Vec::new(),
        probabilities,
        base_probability,
        explained: None,
        gain: None,
    };
    if base_probability >= 1.0 - SETTINGS.credible_mass {
        if field_is_certain(context, &found.base) {
            out.verdict = Verdict::Unknown;
        }
        return Ok(out);
    }
    let Some(rivals) =
        beyond_discrepancy(context, found, &credible_set(&out.probabilities, base_probability))
    else {
        return Ok(out);
    };
    out.rivals = simplest(found, &rivals);
    let best = &found.fits[out.rivals[0]];
    out.explained = explained_share(context, &found.base, best, seed);
    out.gain = held_out_gain(context, &found.base, best);
    let explains = !best.is_at_bound
        && out.explained.is_none_or(|(_, interval)| interval[1] >= SETTINGS.explained_share);
    let gains = out.gain.is_none_or(|gain| gain >= SETTINGS.least_gain);
    out.verdict = match out.rivals.len() {
        _ if !(explains && gains) => Verdict::Unknown,
        1 => Verdict::Named,
        _ => Verdict::Ambiguous,
    };
    if !gains {
        out.rivals.clear();
    }
    Ok(out)
}

/// Sets without the effects that are no larger than two standard deviations of the largest plausible discrepancy, each once;
/// `None` if nothing remains of the most probable one. Such effects may stand for a discrepancy, whose response is linearised.
fn beyond_discrepancy(context: &JointContext, found: &JointSearch, sets: &[usize]) -> Option<Vec<usize>> {
    let mut out = Vec::new();
    for (k, set) in sets.iter().enumerate() {
        let fit = &found.fits[*set];
        let kept: Vec<&JointTerm> =
            (0..fit.terms.len()).filter(|t| is_beyond(context, fit, *t)).map(|t| &fit.terms[t]).collect();
        if kept.is_empty() {
            if k == 0 {
                return None;
            }
            continue;
        }
        let is_kept =
            |t: &JointTerm| kept.iter().any(|k| k.joint == t.joint && k.effect.name == t.effect.name);
        let is_same = |f: &JointFit| f.terms.len() == kept.len() && f.terms.iter().all(is_kept);
        // A smaller set that was not fitted stands for itself with the effect.
        let reduced = found.ranked(is_same).first().copied().unwrap_or(*set);
        if !out.contains(&reduced) {
            out.push(reduced);
        }
    }
    Some(out)
}

/// Whether the response to an effect is larger than two standard deviations of the largest plausible discrepancy along it.
fn is_beyond(context: &JointContext, fit: &JointFit, term: usize) -> bool {
    let Some(discrepancy) = &context.discrepancy else { return true };
    let first = fit.prior.mean_offset.len();
    let mut square = 0.0;
    let mut along = DVector::zeros(fit.laplace.step.len() - first);
    for block in fit.groups.iter().flat_map(|group| &group.blocks) {
        // Columns of the effects' sizes follow those of the torques that differ by trial.
        let response = block.z_group.column(discrepancy.constant[0].ncols() + term);
        square += response.norm_squared();
        along += block.jacobian.columns(first, along.len()).tr_mul(&response);
    }
    square * square > MIN_DISCREPANCY_SD.powi(2) * along.norm_squared()
}

/// Whether a broad torque field is certain beside a model.
fn field_is_certain(context: &JointContext, fit: &JointFit) -> bool {
    let Some(discrepancy) = &context.discrepancy else { return false };
    let broad = at_scale(&fit.statistics, &fit.prior, discrepancy.broad_ratio);
    broad.is_some_and(|l| l.log_evidence - fit.log_evidence + log_prior(1) > SETTINGS.log_odds_of_certainty())
}

/// The smallest set of fits that together with the base model holds the credible mass, most probable first.
fn credible_set(probabilities: &[f64], base: f64) -> Vec<usize> {
    let mut order: Vec<usize> = (0..probabilities.len()).collect();
    order.sort_by(|a, b| probabilities[*b].total_cmp(&probabilities[*a]).then(a.cmp(b)));
    let (mut mass, mut out) = (base, Vec::new());
    for i in order {
        out.push(i);
        mass += probabilities[i];
        if mass >= SETTINGS.credible_mass {
            break;
        }
    }
    out
}

/// The sets that contain no other one, unless they are certainly more probable than it.
fn simplest(found: &JointSearch, sets: &[usize]) -> Vec<usize> {
    let certain = |i: usize, j: usize| {
        found.log_posterior[i] - found.log_posterior[j] > SETTINGS.log_odds_of_certainty()
    };
    let covers = |i: usize, j: usize| found.fits[i].contains(&found.fits[j]) && !certain(i, j);
    sets.iter().copied().filter(|i| !sets.iter().any(|j| j != i && covers(*i, *j))).collect()
}

/// Squared residuals by trial at parameter and discrepancy steps.
fn squares(fit: &JointFit, step: impl Fn(usize) -> DVector<f64>) -> Vec<f64> {
    fit.groups.iter().enumerate().map(|(k, group)| group.square_at(&step(k))).collect()
}

/// Expected squares of noise and trial discrepancy, by trial.
fn noise_floor(context: &JointContext, fit: &JointFit) -> Vec<f64> {
    let of = |block: &crate::inference::mixed_model::groups::SegmentBlock| {
        let variances = block.variances(context.components.discrepancy);
        variances
            .iter()
            .enumerate()
            .map(|(i, v)| (1.0 - block.nuisances.row(i).norm_squared()) * v)
            .sum::<f64>()
    };
    fit.groups.iter().map(|group| group.blocks.iter().map(of).sum()).collect()
}

/// The discrepancy's mode alone.
fn discrepancy_step(fit: &JointFit) -> DVector<f64> {
    let mut step = fit.laplace.step.clone();
    step.rows_mut(0, fit.prior.mean_offset.len()).fill(0.0);
    step
}

/// Share of the predictable misfit that a model explains: (m0 - m1) / (m0 - m2).
fn explained_share(
    context: &JointContext,
    base: &JointFit,
    model: &JointFit,
    seed: u64,
) -> Option<(f64, [f64; 2])> {
    let own_step = discrepancy_step(model);
    let own = squares(model, |_| own_step.clone());
    let q = model.prior.mean_offset.len();
    // The same discrepancy beside the simpler model.
    let mut shared = DVector::zeros(base.prior.mean_offset.len() + own_step.len() - q);
    let first = base.prior.mean_offset.len();
    shared.rows_mut(first, own_step.len() - q).copy_from(&own_step.rows(q, own_step.len() - q));
    let none = squares(base, |_| shared.clone());
    let broad =
        context.discrepancy.as_ref().and_then(|d| at_scale(&model.statistics, &model.prior, d.broad_ratio));
    let least = match broad {
        Some(broad) => squares(model, |_| broad.step.clone()),
        None => own.clone(),
    };
    let floor = noise_floor(context, model);
    if none.iter().sum::<f64>() < (1.0 + MIN_EXCESS) * floor.iter().sum::<f64>() {
        return None;
    }
    let share = |weights: &[f64]| {
        let sum = |of: &dyn Fn(usize) -> f64| weights.iter().enumerate().map(|(i, w)| w * of(i)).sum::<f64>();
        let gone = sum(&|i| none[i] - own[i]);
        let all = sum(&|i| none[i] - own[i].min(least[i]).max(floor[i].min(none[i])));
        if all > 0.0 { (gone / all).clamp(0.0, 1.0) } else { 1.0 }
    };
    let mut stream = rng::stream(seed, "explained share");
    let mut draws: Vec<f64> = (0..DRAWS)
        .map(|_| share(&none.iter().map(|_| Exp1.sample(&mut stream)).collect::<Vec<f64>>()))
        .collect();
    draws.sort_by(f64::total_cmp);
    let at = |p: f64| draws[(p * (DRAWS - 1) as f64) as usize];
    Some((share(&vec![1.0; none.len()]), [at(1.0 - SETTINGS.confidence), at(SETTINGS.confidence)]))
}

/// Share of the excess squared error on held-out trials that a model removes: its parameters are estimated from the other trials,
/// with the shared discrepancy at its mode subtracted from both models.
fn held_out_gain(context: &JointContext, base: &JointFit, model: &JointFit) -> Option<f64> {
    let q = model.prior.mean_offset.len();
    let own = discrepancy_step(model);
    let shared = own.rows(q, own.len() - q).into_owned();
    let fixed = |s: &GroupStatistics| {
        let mut out = s.first_parameters(q);
        out.square = s.square_after(&own);
        out.score -= s.gram.view((0, q), (q, own.len() - q)) * &shared;
        out
    };
    let statistics: Vec<GroupStatistics> = model.statistics.iter().map(fixed).collect();
    let folds = FOLDS.min(statistics.len());
    let steps: Vec<DVector<f64>> = (0..folds)
        .map(|fold| {
            let others = statistics.iter().enumerate().filter(|(k, _)| k % folds != fold).map(|(_, s)| s);
            gls(others, &model.prior).map(|estimate| estimate.step)
        })
        .collect::<Option<_>>()?;
    let held_out = |k: usize| {
        let mut step = own.clone();
        step.rows_mut(0, q).copy_from(&steps[k % folds]);
        step
    };
    let after: f64 = squares(model, held_out).iter().sum();
    let before: f64 = squares(base, |_| shared.clone()).iter().sum();
    let floor: f64 = noise_floor(context, base).iter().sum();
    (before > (1.0 + MIN_EXCESS) * floor).then(|| (before - after) / (before - floor))
}
