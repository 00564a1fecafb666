//! Estimates of effects and latents with intervals, and scores of models.

use crate::error::Result;
use crate::inference::mixed_model::fitted_model::FittedModel;
use crate::inference::mixed_model::model_fit::ModelFitter;
use crate::inference::model;
use crate::inference::report::{CalibratedLatent, EffectEstimate, ModelScore, ParameterEstimate};
use crate::inference::selection::Decision;
use crate::inference::selection::search::SearchResult;
use crate::inference::statistics::EXCLUSION_NATS;
use crate::world::latent::FACTORS;

/// The effects of a fit; `probability`: the posterior probability that an effect acts, by name.
pub fn effect_estimates(
    f: &FittedModel,
    names: &[String],
    probability: impl Fn(&str) -> f64,
) -> Vec<EffectEstimate> {
    f.layout
        .terms
        .iter()
        .enumerate()
        .map(|(t, term)| {
            let fitted = f.layout.parameters_of_term(t).into_iter().filter_map(|i| {
                let parameter = &f.layout.parameters[i];
                let model::ParameterKind::EffectParameter(_, p) = parameter.kind else { return None };
                let half = f.ci_half_width(i);
                let value = f.state.values[i];
                let end =
                    |v: f64| half.is_finite().then(|| v.clamp(parameter.bounds[0], parameter.bounds[1]));
                Some(ParameterEstimate {
                    name: term.effect.parameters[p].name.into(),
                    value,
                    ci95: [end(value - half), end(value + half)],
                    unit: term.effect.parameters[p].unit.into(),
                    setting: parameter.setting.map(|s| names[s].clone()),
                    spread: f.between_trial_sd(i),
                })
            });
            let stepwise = term.bracket.iter().flat_map(|b| bracket_estimate(term, b));
            let parameters: Vec<ParameterEstimate> = stepwise.chain(fitted).collect();
            EffectEstimate {
                name: term.effect.name.into(),
                acts_on: term.effect.target().name().into(),
                probability: probability(term.effect.name),
                parameters,
            }
        })
        .collect()
}

/// Share of a bracket outside of the central interval, on each side.
const BRACKET_TAIL: f64 = 0.025;

/// Estimate of a stepwise parameter: uniform in its bracket.
fn bracket_estimate(term: &model::Term, bracket: &model::Bracket) -> Option<ParameterEstimate> {
    let p = term.effect.parameters.iter().position(|p| p.stepwise)?;
    let [low, high] = bracket.interval;
    let at = |share: f64| Some(low + share * (high - low));
    Some(ParameterEstimate {
        name: term.effect.parameters[p].name.into(),
        value: term.start[p],
        ci95: [at(BRACKET_TAIL), at(1.0 - BRACKET_TAIL)],
        unit: term.effect.parameters[p].unit.into(),
        setting: None,
        spread: None,
    })
}

/// Half the interval of a latent that is not identifiable, as a share of the latent's range, or of the largest range that counts.
const LONG_INTERVAL: f64 = 0.25;
const MAX_RANGE: f64 = 4.0;
/// Distance from a bound, as a share of the range, within which a value is at it.
const AT_BOUND: f64 = 1e-3;
/// Bisections of an interval at a bound: to a 250th of the searched range.
const BISECTIONS: usize = 8;

/// Calibrated latents, the first `count` parameters of a fit. A latent is identifiable if its interval is
/// short and the data exclude the bounds outside of it: a friction that grips at every impact has no upper
/// limit, whatever the curvature.
pub fn calibrated_latents(
    fitter: &ModelFitter,
    f: &FittedModel,
    count: usize,
) -> Result<Vec<CalibratedLatent>> {
    let of = |i: usize| {
        let parameter = &f.layout.parameters[i];
        let latent = parameter.latent().expect("latents come first in a layout");
        let (value, [low, high]) = (f.state.values[i], parameter.bounds);
        let at_bound = [low, high].into_iter().find(|bound| (value - bound).abs() < AT_BOUND * (high - low));
        let interval = match at_bound {
            Some(bound) => one_sided_interval(fitter, f, i, bound)?,
            None => two_sided_interval(fitter, f, i)?,
        };
        let ends = interval.map(|ends| ends.map(|v| v.clamp(low, high)));
        let ci95 = [0, 1].map(|k| ends.map(|ends| ends[k]));
        let (name, identifiable) = (FACTORS[latent].name.into(), ends.is_some());
        Ok(CalibratedLatent { name, value, ci95, identifiable })
    };
    (0..count).map(of).collect()
}

/// Interval of a parameter between its bounds; `None` if it is long or does not exclude a bound outside of it.
fn two_sided_interval(fitter: &ModelFitter, f: &FittedModel, slot: usize) -> Result<Option<[f64; 2]>> {
    let (parameter, value, half) = (&f.layout.parameters[slot], f.state.values[slot], f.ci_half_width(slot));
    let information: f64 = f.evaluation.normal_equations.iter().map(|t| t.gram[(slot, slot)]).sum();
    let width = parameter.bounds[1] - parameter.bounds[0];
    if !half.is_finite()
        || half >= LONG_INTERVAL * width.min(MAX_RANGE)
        || information <= 10.0 * parameter.min_information()
    {
        return Ok(None);
    }
    for bound in parameter.bounds.into_iter().filter(|bound| (bound - value).abs() > half) {
        if !is_excluded(fitter, f, slot, bound)? {
            return Ok(None);
        }
    }
    Ok(Some([value - half, value + half]))
}

/// Interval of a parameter at one of its bounds, by the profile log density; `None` if it is long.
fn one_sided_interval(
    fitter: &ModelFitter,
    f: &FittedModel,
    slot: usize,
    bound: f64,
) -> Result<Option<[f64; 2]>> {
    let [low, high] = f.layout.parameters[slot].bounds;
    let inwards = if bound == low { 1.0 } else { -1.0 };
    let (mut inside, mut outside) = (0.0, LONG_INTERVAL * (high - low).min(MAX_RANGE));
    if !is_excluded(fitter, f, slot, bound + inwards * outside)? {
        return Ok(None);
    }
    for _ in 0..BISECTIONS {
        let middle = 0.5 * (inside + outside);
        match is_excluded(fitter, f, slot, bound + inwards * middle)? {
            true => outside = middle,
            false => inside = middle,
        }
    }
    let end = bound + inwards * outside;
    Ok(Some([bound.min(end), bound.max(end)]))
}

/// Whether the data exclude a value of a parameter.
fn is_excluded(fitter: &ModelFitter, f: &FittedModel, slot: usize, value: f64) -> Result<bool> {
    let at = fitter.log_joint_with(f, slot, value)?;
    Ok(at.is_none_or(|at| at < f.log_joint - EXCLUSION_NATS))
}

/// All fitted models, most probable first; `names`: of the settings.
pub fn model_scores(found: &SearchResult, decision: &Decision, names: &[String]) -> Vec<ModelScore> {
    let best = found.best_log_posterior();
    let of = |effects: Vec<String>, log_posterior: f64, probability: f64, sizes| ModelScore {
        effects,
        score: log_posterior - best,
        probability,
        sizes,
    };
    let fit = |(i, f): (usize, &FittedModel)| {
        let sizes = if decision.rivals.contains(&i) {
            effect_estimates(f, names, |name| decision.inclusion_probability(found, name))
        } else {
            Vec::new()
        };
        of(strings(&f.effect_names()), found.log_posterior[i], decision.probabilities[i], sizes)
    };
    let base = of(Vec::new(), found.base_log_posterior, decision.base_probability, Vec::new());
    let mut out: Vec<ModelScore> = found.fits.iter().enumerate().map(fit).chain([base]).collect();
    out.sort_by(|a, b| b.score.total_cmp(&a.score));
    out
}

/// Owned strings.
pub fn strings(names: &[&str]) -> Vec<String> {
    names.iter().map(|n| n.to_string()).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::inference::testing::throws;

    #[test]
    fn effects_have_intervals_and_units() {
        throws::with_fit(&[0.4; 8], &["linear_drag"], 3, |fitter, f| {
            let found = effect_estimates(f, &[String::new()], |_| 1.0);
            assert_eq!(
                (found.len(), found[0].name.as_str(), found[0].acts_on.as_str()),
                (1, "linear_drag", "motion")
            );
            let c = &found[0].parameters[0];
            let [Some(low), Some(high)] = c.ci95 else { panic!("{c:?}") };
            assert!(low < 0.4 && 0.4 < high && low < c.value && c.value < high, "{c:?}");
            assert_eq!((c.unit.as_str(), &c.setting), ("1/s", &None));
            assert!(calibrated_latents(fitter, f, 0).unwrap().is_empty());
        });
    }
}
