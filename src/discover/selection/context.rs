//! Estimates that every set of effects shares: the responses to the shared discrepancy and the variance components, both
//! from the richest model.
//!
//! Variance components that every set estimates anew would let a wrong set call its misfit noise. They are those at which the
//! richest model is most probable: lift, quadratic drag, wind, every contact law, and the shared discrepancy or the most probable
//! kind of force field (without flights, a discrepancy as broad as the acceleration beyond gravity), whichever is more probable. This is the pure error of the recording.
//!
//! Source: pattern search: Hooke and Jeeves, J. ACM 8 (1961) 212; pure error: Box and Draper, Empirical Model-Building and
//! Response Surfaces (1987), 3.4.

use std::collections::HashMap;
use std::collections::hash_map::Entry;

use super::discrepancy::SharedDiscrepancy;
use super::laplace::at_scale;
use super::prior::Prior;
use super::settings::SETTINGS;
use crate::discover::columns::pushes;
use crate::discover::field;
use crate::discover::fit::{Context, Fitted, Fitter, responses};
use crate::discover::gaussian::{Components, Told, Weighed};
use crate::discover::launch::Part;
use crate::discover::library::Candidate;
use crate::discover::model::{self, Term};
use crate::discover::window::Kind;
use crate::error::Result;
use crate::progress::Progress;
use crate::world::effect::EffectTarget;

/// Standard deviation of a field's coefficients, m/s^2.
const FIELD_SD: f64 = 2.0;
/// Steps of least squares to the richest model.
const STEPS: usize = 12;
/// First and shortest steps of the components' logarithms; what a successful step is lengthened and a failed one shortened by.
const FIRST_STEP: f64 = 0.8;
const SHORTEST_STEP: f64 = 0.1;
/// How far below its start a component's logarithm may end: nothing.
const SMALLEST: f64 = 4.0;
const LONGER: f64 = 1.4;
const SHORTER: f64 = 0.4;

/// The context of a recording whose base model is fitted; `candidates`: every effect with its starts.
pub fn context(fitter: &Fitter, base: &Fitted, candidates: &[Candidate]) -> Result<Context> {
    let measured =
        fitter.data.windows.iter().any(|w| matches!(w.kind, Kind::Flight | Kind::Contact | Kind::Roll));
    let richest = if measured { richest(fitter, base, candidates)? } else { None };
    let model = richest.as_ref().unwrap_or(base);
    let discrepancy = SharedDiscrepancy::from_model(fitter.data, &model.layout, &model.state, &SETTINGS)?;
    let looks = model::looks(fitter.data, &model.layout, &model.state, &pushes())?;
    let responses = responses(&looks, model.layout.slots.len());
    let whole = Context { discrepancy, components: model.components.clone(), responses };
    let own = Fitter { context: Some(whole.clone()), ..fitter.clone() };
    let Some(parts) = own.with_discrepancy(&model.layout, &model.state, &looks)? else { return Ok(whole) };
    let discrepancy = whole.discrepancy.reduced(fitter.data, &parts, model.layout.slots.len())?;
    let start = Context { discrepancy, ..whole };
    let own = Fitter { context: Some(start.clone()), ..own };
    let components = components(&own, model, start.discrepancy.broad)?;
    Ok(Context { components: components.unwrap_or_else(|| start.components.clone()), ..start })
}

/// The richest model, fitted from the base model, with the strongest effect that a linearisation does not lead to.
fn richest(fitter: &Fitter, base: &Fitted, candidates: &[Candidate]) -> Result<Option<Fitted>> {
    let strong = |c: &&Candidate| c.strong.is_some();
    let gain = |c: &Candidate| c.strong.as_ref().map_or(0.0, |(_, gain)| *gain);
    let strongest =
        candidates.iter().filter(strong).max_by(|a, b| gain(a).total_cmp(&gain(b))).map(|c| c.effect.name);
    let start = |c: &Candidate| match &c.strong {
        Some((term, _)) if strongest == Some(c.effect.name) => Some(term.clone()),
        _ if c.effect.in_richest_model || c.effect.target() == EffectTarget::Contact => {
            c.starts.first().cloned()
        }
        _ => None,
    };
    let terms: Vec<Term> = candidates.iter().filter_map(start).collect();
    let (layout, start) = base.joined(terms, fitter.data.setting_count());
    fitter.fit(layout, start, STEPS)
}

fn parts(fitter: &Fitter, model: &Fitted) -> Result<Option<Vec<Part>>> {
    let looks = model::looks(fitter.data, &model.layout, &model.state, &pushes())?;
    fitter.with_discrepancy(&model.layout, &model.state, &looks)
}

/// The most probable components of a model beside the field that makes it most probable: the shared discrepancy at its largest
/// plausible size, or a force field of any kind where there are flights, else the shared discrepancy `broad` times as large.
fn components(fitter: &Fitter, model: &Fitted, broad: f64) -> Result<Option<Components>> {
    let mut fields: Vec<(Vec<Part>, f64)> =
        field::kinds(fitter, model)?.into_iter().map(|parts| (parts, FIELD_SD)).collect();
    if let Some(parts) = parts(fitter, model)? {
        if fields.is_empty() {
            fields.push((parts.clone(), broad));
        }
        fields.push((parts, 1.0));
    }
    let prior = fitter.prior(&model.layout, &model.state);
    let scales = Scales::of(fitter);
    let start = scales.start();
    let best = |(parts, broad): &(Vec<Part>, f64)| {
        let start = start.clone();
        let (cross_products, progress) = (HashMap::new(), fitter.data.progress);
        Objective { parts, prior: &prior, broad: *broad, start, scales, cross_products, progress }.maximise()
    };
    let all = fields.iter().map(best).collect::<Result<Vec<_>>>()?;
    let best = all.into_iter().max_by(|a, b| a.0.total_cmp(&b.0));
    Ok(best.map(|(_, components)| components))
}

/// Plausible sizes of variance components: standard deviations of half-normal priors.
#[derive(Clone, Copy)]
struct Scales {
    /// Slow misfit of a trial, in units of the noise.
    slow: f64,
}

/// Slow misfit: as a share of the extent of the data, and in units of the noise.
const SLOW_OF_EXTENT: f64 = 0.002;
const SLOW_OF_NOISE: f64 = 0.5;
/// Random accelerations of a trial, in the sizes that effects declare.
const PUSH: f64 = 1.0;
/// Strength of an effect between trials, as a share of it.
const STRENGTH: f64 = 0.1;
/// Errors of impacts, as a share of the approach speed.
const LEAP: f64 = 0.03;

impl Scales {
    fn of(fitter: &Fitter) -> Scales {
        let [x0, y0, x1, y1] = fitter.range.area;
        let noise = fitter.data.sd.iter().copied().filter(|s| s.is_finite()).fold(f64::INFINITY, f64::min);
        Scales { slow: (SLOW_OF_EXTENT * (x1 - x0).max(y1 - y0) / noise).hypot(SLOW_OF_NOISE) }
    }

    /// Where a search starts.
    fn start(&self) -> Components {
        Components {
            slow: 0.3 * self.slow,
            leap: 0.3 * LEAP,
            strength: 0.3 * STRENGTH,
            push: vec![0.3 * PUSH; pushes().len()],
        }
    }

    fn log_prior(&self, c: &Components) -> f64 {
        let pushes = c.push.iter().map(|p| p / PUSH);
        let all = [c.slow / self.slow, c.leap / LEAP, c.strength / STRENGTH].into_iter().chain(pushes);
        -0.5 * all.map(|v| v * v).sum::<f64>()
    }
}

/// Log marginal likelihood of a model by the logarithms of its components.
struct Objective<'a> {
    parts: &'a [Part],
    prior: &'a Prior,
    broad: f64,
    start: Components,
    scales: Scales,
    /// By the slow misfit.
    cross_products: HashMap<u64, Vec<Weighed>>,
    progress: &'a dyn Progress,
}

impl Objective<'_> {
    /// The largest value and where it is.
    fn maximise(&mut self) -> Result<(f64, Components)> {
        let mut logs = self.start.logs();
        let mut best = self.at(&logs)?;
        let mut steps = vec![-FIRST_STEP; logs.len()];
        let least: Vec<f64> = logs.iter().map(|l| l - SMALLEST).collect();
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
                        steps[k] = (LONGER * way).clamp(-2.0 * FIRST_STEP, 2.0 * FIRST_STEP);
                    }
                    None => steps[k] *= SHORTER,
                }
            }
        }
        Ok((best, self.start.with(&logs)))
    }

    fn at(&mut self, logs: &[f64]) -> Result<f64> {
        let components = self.start.with(logs);
        let columns: Vec<usize> =
            (0..self.parts.first().map_or(0, |p| p.blocks[0].columns.ncols())).collect();
        let (parts, slow) = (self.parts, components.slow);
        let products = match self.cross_products.entry(slow.to_bits()) {
            Entry::Occupied(known) => known.into_mut(),
            Entry::Vacant(free) => {
                let each =
                    parts.iter().map(|p| self.progress.check_stop().map(|()| Weighed::of(p, &columns, slow)));
                free.insert(each.collect::<Result<_>>()?)
            }
        };
        self.progress.check_stop()?;
        let told = products.iter().zip(parts).map(|(w, p)| w.told(p, &columns, &components));
        let told: Option<Vec<Told>> = told.collect();
        let evidence = told.and_then(|told| Some(at_scale(&told, self.prior, self.broad)?.log_evidence));
        Ok(evidence.map_or(f64::NEG_INFINITY, |e| e + self.scales.log_prior(&components)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::discover::thrown;

    /// Of balls that all have one drag, which the base model lacks, none differs by more than effects declare for any trial.
    #[test]
    fn a_missing_effect_is_no_variance_component() {
        thrown::fitted(&[0.4; 10], &[], 12, |fitter, base| {
            let found = context(fitter, base, &[]).unwrap();
            let c = &found.components;
            assert!(c.push.iter().all(|p| *p < 1.0) && c.slow < 1.0 && c.strength < 0.1, "{c:?}");
            assert!(
                (0.09..0.5).contains(&found.discrepancy.acceleration),
                "{}",
                found.discrepancy.acceleration
            );
            assert!(found.discrepancy.count > 0);
        });
    }
}
