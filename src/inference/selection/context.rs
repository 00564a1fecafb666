//! Estimates that every set of effects shares: the responses to the shared discrepancy and the variance components, both
//! from the richest model.
//!
//! If every set estimated its variance components, a wrong set could attribute its misfit to them. They are
//! therefore estimated once, for the richest model: lift, quadratic drag, wind, ground friction, every contact law, and the
//! shared discrepancy or the most probable kind of force field (without flights, a discrepancy as large as the
//! acceleration beyond gravity), whichever is more probable. This is the pure error of the recording.
//!
//! Source: pattern search: Hooke and Jeeves, J. ACM 8 (1961) 212; pure error: Box and Draper, Empirical Model-Building and
//! Response Surfaces (1987), 3.4.

use std::collections::HashMap;
use std::collections::hash_map::Entry;

use super::discrepancy::SharedDiscrepancy;
use super::laplace::at_scale;
use super::prior::FixedEffectsPrior;
use super::settings::SETTINGS;
use crate::error::Result;
use crate::inference::field;
use crate::inference::mixed_model::fitted_model::FittedModel;
use crate::inference::mixed_model::group_statistics::{CrossProducts, VarianceComponents};
use crate::inference::mixed_model::groups::Group;
use crate::inference::mixed_model::model_fit::{ModelFitter, RecordingContext, acceleration_responses};
use crate::inference::mixed_model::random_design::nuisance_accelerations;
use crate::inference::model::{self, Term};
use crate::inference::selection::candidates::Candidate;
use crate::progress::Progress;
use crate::world::effect::EffectTarget;

/// Prior standard deviation of a field's coefficients, m/s^2.
const FIELD_SD: f64 = 2.0;
/// Least-squares steps to the richest model.
const STEPS: usize = 12;
/// First and smallest step of the components' logarithms; growth and shrinkage factors.
const FIRST_STEP: f64 = 0.8;
const SHORTEST_STEP: f64 = 0.1;
/// Largest decrease of a component's logarithm, at which it is practically zero.
const MAX_LOG_DECREASE: f64 = 5.0;
const STEP_GROWTH: f64 = 1.4;
const STEP_SHRINKAGE: f64 = 0.4;

/// Context of a recording; `candidates`: effects with initial values.
pub fn context(
    fitter: &ModelFitter,
    base: &FittedModel,
    candidates: &[Candidate],
) -> Result<RecordingContext> {
    let measured = fitter.data.segments.iter().any(|w| w.kind.has_free_initial_state());
    let richest = if measured { richest(fitter, base, candidates)? } else { None };
    let model = richest.as_ref().unwrap_or(base);
    let discrepancy = SharedDiscrepancy::from_model(fitter.data, &model.layout, &model.state, &SETTINGS)?;
    let linearizations =
        model::linearise(fitter.data, &model.layout, &model.state, &nuisance_accelerations())?;
    let responses =
        acceleration_responses(fitter.data.segments, &linearizations, model.layout.parameters.len());
    let whole = RecordingContext { discrepancy, components: model.components.clone(), responses };
    let own = fitter.clone().with_context(whole.clone());
    let Some(groups) = own.groups_with_discrepancy(&model.layout, &model.state, &linearizations)? else {
        return Ok(whole);
    };
    let discrepancy = whole.discrepancy.reduced(fitter.data, &groups, model.layout.parameters.len())?;
    let start = RecordingContext { discrepancy, ..whole };
    let own = own.with_context(start.clone());
    let groups = own.groups_with_discrepancy(&model.layout, &model.state, &linearizations)?;
    let components = components(&own, model, groups, start.discrepancy.broad_ratio)?;
    Ok(RecordingContext { components: components.unwrap_or_else(|| start.components.clone()), ..start })
}

/// The richest model, started from the base model, with the best strong start of all effects.
fn richest(
    fitter: &ModelFitter,
    base: &FittedModel,
    candidates: &[Candidate],
) -> Result<Option<FittedModel>> {
    let strong = |c: &&Candidate| c.strong_start.is_some();
    let gain = |c: &Candidate| c.strong_start.as_ref().map_or(0.0, |(_, gain)| *gain);
    let strongest =
        candidates.iter().filter(strong).max_by(|a, b| gain(a).total_cmp(&gain(b))).map(|c| c.effect.name);
    let start = |c: &Candidate| match &c.strong_start {
        Some((term, _)) if strongest == Some(c.effect.name) => Some(term.clone()),
        _ if c.effect.in_richest_model || c.effect.target() == EffectTarget::Contact => {
            c.starts.first().cloned()
        }
        _ => None,
    };
    let terms: Vec<Term> = candidates.iter().filter_map(start).collect();
    let (layout, start) = base.with_terms(terms, fitter.data.setting_count());
    fitter.fit(layout, start, STEPS)
}

/// Most probable components of a model with the most probable field: the shared discrepancy at its largest
/// plausible size, or a force field of any inputs if there are flights, otherwise the shared discrepancy at
/// `broad` times that size. `groups`: of the model, with the columns of the shared discrepancy.
fn components(
    fitter: &ModelFitter,
    model: &FittedModel,
    groups: Option<Vec<Group>>,
    broad: f64,
) -> Result<Option<VarianceComponents>> {
    let prior = fitter.prior(&model.layout, &model.state);
    let scales = ComponentScales::of(fitter);
    let start = scales.start();
    let best = |groups: &[Group], broad: f64| {
        let start = start.clone();
        let (cross_products, progress) = (HashMap::new(), fitter.data.progress);
        ComponentObjective { groups, prior: &prior, broad, start, scales, cross_products, progress }
            .maximise()
    };
    let mut all = field::for_each_inputs(fitter, model, |groups| best(groups, FIELD_SD))?;
    if let Some(groups) = groups {
        if all.is_empty() {
            all.push(best(&groups, broad)?);
        }
        all.push(best(&groups, 1.0)?);
    }
    let best = all.into_iter().max_by(|a, b| a.0.total_cmp(&b.0));
    Ok(best.map(|(_, components)| components))
}

/// Maximum of the log marginal likelihood of a model by its variance components, and the components. `broad`: scale of the shared
/// discrepancy whose columns the groups have after those of the parameters; `discrepancy`: plausible trial discrepancy, in units
/// of the noise.
pub fn maximise_components(
    groups: &[Group],
    prior: &FixedEffectsPrior,
    broad: f64,
    discrepancy: f64,
    progress: &dyn Progress,
) -> Result<(f64, VarianceComponents)> {
    let scales = ComponentScales { discrepancy };
    let (start, cross_products) = (scales.start(), HashMap::new());
    ComponentObjective { groups, prior, broad, start, scales, cross_products, progress }.maximise()
}

/// Plausible sizes of variance components: standard deviations of half-normal priors.
#[derive(Clone, Copy)]
struct ComponentScales {
    /// Trial discrepancy, in units of the noise.
    discrepancy: f64,
}

/// Trial discrepancy: as a share of the extent of the data, and in units of the noise.
const DISCREPANCY_OF_EXTENT: f64 = 0.002;
const DISCREPANCY_OF_NOISE: f64 = 0.5;
/// Random accelerations of a trial, in declared standard deviations.
const ACCELERATION: f64 = 1.0;
/// Scale of an effect between trials, relative.
const SCALE: f64 = 0.1;
/// Errors of impacts, as a share of the approach speed.
const IMPACT: f64 = 0.03;

impl ComponentScales {
    fn of(fitter: &ModelFitter) -> ComponentScales {
        let [x0, y0, x1, y1] = fitter.range.area;
        let noise = fitter.data.sd.iter().copied().filter(|s| s.is_finite()).fold(f64::INFINITY, f64::min);
        ComponentScales {
            discrepancy: (DISCREPANCY_OF_EXTENT * (x1 - x0).max(y1 - y0) / noise).hypot(DISCREPANCY_OF_NOISE),
        }
    }

    /// Initial values of the optimisation: the plausible sizes. From smaller ones it may end at zero, since a random effect that
    /// is much too small explains nothing.
    fn start(&self) -> VarianceComponents {
        VarianceComponents {
            discrepancy: self.discrepancy,
            impact: IMPACT,
            scale: SCALE,
            accelerations: vec![ACCELERATION; nuisance_accelerations().len()],
        }
    }

    fn log_prior(&self, c: &VarianceComponents) -> f64 {
        let pushes = c.accelerations.iter().map(|p| p / ACCELERATION);
        let all =
            [c.discrepancy / self.discrepancy, c.impact / IMPACT, c.scale / SCALE].into_iter().chain(pushes);
        -0.5 * all.map(|v| v * v).sum::<f64>()
    }
}

/// Log marginal likelihood of a model by the logarithms of its components.
struct ComponentObjective<'a> {
    groups: &'a [Group],
    prior: &'a FixedEffectsPrior,
    broad: f64,
    start: VarianceComponents,
    scales: ComponentScales,
    /// By the discrepancy component.
    cross_products: HashMap<u64, Vec<CrossProducts>>,
    progress: &'a dyn Progress,
}

impl ComponentObjective<'_> {
    /// Maximum and its components.
    fn maximise(&mut self) -> Result<(f64, VarianceComponents)> {
        let mut logs = self.start.log_values();
        let mut best = self.at(&logs)?;
        let mut steps = vec![-FIRST_STEP; logs.len()];
        let least: Vec<f64> = logs.iter().map(|l| l - MAX_LOG_DECREASE).collect();
        while steps.iter().any(|s| s.abs() >= SHORTEST_STEP) {
            for k in (0..logs.len()).filter(|k| steps[*k].abs() >= SHORTEST_STEP).collect::<Vec<_>>() {
                let mut moved = |way: f64| -> Result<Option<(f64, Vec<f64>, f64)>> {
                    let mut moved = logs.clone();
                    moved[k] = (moved[k] + way).max(least[k]);
                    let value = self.at(&moved)?;
                    Ok((value > best).then_some((value, moved, way)))
                };
                let onwards = moved(steps[k])?;
                let better = if onwards.is_some() { onwards } else { moved(-steps[k])? };
                match better {
                    Some((value, moved, way)) => {
                        (best, logs) = (value, moved);
                        steps[k] = (STEP_GROWTH * way).clamp(-2.0 * FIRST_STEP, 2.0 * FIRST_STEP);
                    }
                    None => steps[k] *= STEP_SHRINKAGE,
                }
            }
        }
        Ok((best, self.start.with_log_values(&logs)))
    }

    fn at(&mut self, logs: &[f64]) -> Result<f64> {
        let components = self.start.with_log_values(logs);
        let columns: Vec<usize> =
            (0..self.groups.first().map_or(0, |p| p.blocks[0].jacobian.ncols())).collect();
        let (groups, slow) = (self.groups, components.discrepancy);
        let products = match self.cross_products.entry(slow.to_bits()) {
            Entry::Occupied(known) => known.into_mut(),
            Entry::Vacant(free) => {
                let each = groups
                    .iter()
                    .map(|p| self.progress.check_stop().map(|()| CrossProducts::of(p, &columns, slow)));
                free.insert(each.collect::<Result<_>>()?)
            }
        };
        let progress = self.progress;
        let one = |(w, p): (&CrossProducts, &Group)| {
            progress.check_stop().map(|()| w.statistics(p, &columns, &components))
        };
        let statistics = products.iter().zip(groups).map(one).collect::<Result<Option<Vec<_>>>>()?;
        let evidence = statistics
            .and_then(|statistics| Some(at_scale(&statistics, self.prior, self.broad)?.log_evidence));
        Ok(evidence.map_or(f64::NEG_INFINITY, |e| e + self.scales.log_prior(&components)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::inference::testing::throws;

    /// A shared drag that the base model lacks is not attributed to variance components.
    #[test]
    fn a_missing_effect_is_no_variance_component() {
        throws::with_fit(&[0.4; 10], &[], 12, |fitter, base| {
            let found = context(fitter, base, &[]).unwrap();
            let c = &found.components;
            assert!(
                c.accelerations.iter().all(|p| *p < 1.0) && c.discrepancy < 1.0 && c.scale < 0.1,
                "{c:?}"
            );
            assert!(
                (0.09..0.5).contains(&found.discrepancy.acceleration),
                "{}",
                found.discrepancy.acceleration
            );
            assert!(found.discrepancy.count > 0);
        });
    }
}
