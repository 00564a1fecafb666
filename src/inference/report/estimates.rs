//! Estimates of effects and latents with intervals, and scores of models.

use crate::error::Result;
use crate::inference::mixed_model::fitted_model::FittedModel;
use crate::inference::mixed_model::model_fit::ModelFitter;
use crate::inference::model;
use crate::inference::report::{CalibratedLatent, EffectEstimate, ModelScore, ParameterEstimate};
use crate::inference::selection::Decision;
use crate::inference::selection::search::SearchResult;
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

/// Decrease of the profile log density that excludes a value, nats: half the 95 % quantile of chi-squared
/// with one degree of freedom.
const EXCLUSION_NATS: f64 = 1.92;
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
        let half = f.ci_half_width(i);
        let information: f64 = f.evaluation.normal_equations.iter().map(|t| t.gram[(i, i)]).sum();
        let width = parameter.bounds[1] - parameter.bounds[0];
        let value = f.state.values[i];
        let excludes = |bound: &f64| -> Result<bool> {
            let at = if (bound - value).abs() > half { fitter.log_joint_with(f, i, *bound)? } else { None };
            Ok(at.is_none_or(|at| at < f.log_joint - EXCLUSION_NATS))
        };
        let is_short = half.is_finite()
            && half < 0.25 * width.min(4.0)
            && information > 10.0 * parameter.min_information();
        let identifiable = is_short && excludes(&parameter.bounds[0])? && excludes(&parameter.bounds[1])?;
        let at_bound = parameter.bounds.iter().any(|bound| (value - bound).abs() < AT_BOUND * width);
        let (identifiable, [low, high]) = match at_bound {
            true => one_sided_interval(fitter, f, i)?.map_or((false, [value; 2]), |ends| (true, ends)),
            false => (identifiable, [value - half, value + half]),
        };
        let end = |v: f64| identifiable.then(|| v.clamp(parameter.bounds[0], parameter.bounds[1]));
        let ci95 = [end(low), end(high)];
        Ok(CalibratedLatent { name: FACTORS[latent].name.into(), value, ci95, identifiable })
    };
    (0..count).map(of).collect()
}

/// Interval of a parameter at one of its bounds, by the profile log density; `None` if a quarter of its range is not excluded.
fn one_sided_interval(fitter: &ModelFitter, f: &FittedModel, slot: usize) -> Result<Option<[f64; 2]>> {
    let parameter = &f.layout.parameters[slot];
    let [low, high] = parameter.bounds;
    let (value, range) = (f.state.values[slot], (high - low).min(4.0));
    let inwards = if value == low { 1.0 } else { -1.0 };
    let excluded = |distance: f64| -> Result<bool> {
        let at = fitter.log_joint_with(f, slot, value + inwards * distance)?;
        Ok(at.is_none_or(|at| at < f.log_joint - EXCLUSION_NATS))
    };
    let (mut inside, mut outside) = (0.0, 0.25 * range);
    if !excluded(outside)? {
        return Ok(None);
    }
    for _ in 0..BISECTIONS {
        let middle = 0.5 * (inside + outside);
        if excluded(middle)? { outside = middle } else { inside = middle }
    }
    let end = value + inwards * outside;
    Ok(Some([value.min(end), value.max(end)]))
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
