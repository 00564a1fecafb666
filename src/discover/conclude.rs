//! Puts what was found into a report.

use super::evidence::{self, Evidence};
use super::extend::{extend, place};
use super::judge::{self, Fitted, held};
use super::model::{self, Data};
use super::noise::Noise;
use super::report::{
    self, Calibrated, Diagnosis, FoundEffect, FoundParameter, Gain, HeldOut, LawTerm, NextExperiment,
    Residual, ResidualLaw, Verdict,
};
use super::search::{self, Judged};
use super::stats::normal_above;
use super::verdict::{SLIGHT, unexplained, verdict};
use super::window::{Kind, Window};
use super::{Config, Finding, advise, law};
use crate::error::Result;
use crate::reality::Trial;
use crate::task::Scene;
use crate::world::latent::FACTORS;

/// The report of a search, the extended scene and what pictures show. `kept`: which of `trials` the windows are of.
pub fn conclude(
    scene: &Scene,
    trials: &[Trial],
    windows: &[Window],
    kept: &[usize],
    found: search::Found,
    judged: &Judged,
    config: &Config,
) -> Result<Finding> {
    let (names, settings, noise, expected) = (judged.names, judged.settings, judged.noise, judged.expected);
    let (verdict, reason) = verdict(&found, judged, windows);
    let search::Found { base, fits, champion, rivals, considered, data, .. } = found;
    let best = champion.map(|c| &fits[c]);
    let model = best.unwrap_or(&base);
    let law = if verdict == Verdict::Unknown { described(&data, model, noise, names.len())? } else { None };
    // What goes without a name is an extension all the same, if it holds on other trials.
    let helps = |l: &&Fitted| judge::paired(&model.held, &l.held).1 > 1.0;
    let helpful = law.as_ref().filter(helps);
    let shown = helpful.unwrap_or(model);
    let scale = Scale::new(judged, kept.len());
    let residual_law = law.as_ref().map(|l| ResidualLaw {
        formula: law::formula(&l.layout, &l.state.values, model.set.len()),
        terms: law_terms(l, model.set.len(), settings, noise.unit()),
        held_out: scale.gain(held(&base), held(l)),
        offered: helpful.is_some(),
    });
    let gain = Gain {
        held_out: best.map(|f| scale.gain(held(&base), held(f))),
        extrapolation: best.and_then(|f| {
            let loss = |f: &Fitted| at_other_settings(f, settings, names.len());
            Some(scale.gain(loss(&base)?, loss(f)?))
        }),
    };
    let (autocorrelation, whiteness_p) = whiteness(windows, &base);
    let next = advise::next(scene, windows, &fits, &rivals, verdict, noise, config)?;
    let rival_names = |i: &usize| fits[*i].names().iter().map(|n| n.to_string()).collect::<Vec<_>>();
    let diagnosis = Diagnosis {
        format: report::FORMAT,
        verdict,
        reason,
        effects: effects(shown, model.set.len(), names, settings, noise.unit()),
        rivals: rivals.iter().map(rival_names).collect(),
        calibrated: calibrated(shown, base.layout.latents(), settings, noise.unit()),
        residual: Residual {
            base_rmse: root_mean_square(&base.pass.residuals),
            floor_rmse: scale.rmse(expected.total()),
            lack_of_fit_p: expected.misfit_of(&base, windows).1,
            whiteness_p,
            autocorrelation,
            noise_correlation: noise.rho,
        },
        gain,
        unexplained_share: match verdict {
            Verdict::None => Some(0.0),
            _ => unexplained(&base, model, judged, windows),
        },
        residual_law,
        next_experiment: next,
        considered,
        seed: config.seed,
    };
    let extended = extend(scene, trials, windows, kept, shown);
    Ok(Finding { diagnosis, extended, evidence: evidence::evidence(&data, &base, shown, names)? })
}

/// The report where too little can be told from the trials to judge anything.
pub fn insufficient(scene: &Scene, trials: &[Trial], reason: &str, config: &Config) -> Finding {
    let diagnosis = Diagnosis {
        format: report::FORMAT,
        verdict: Verdict::InsufficientData,
        reason: reason.to_string(),
        effects: Vec::new(),
        rivals: Vec::new(),
        calibrated: Vec::new(),
        residual: Residual {
            base_rmse: 0.0,
            floor_rmse: 0.0,
            lack_of_fit_p: 1.0,
            whiteness_p: 1.0,
            autocorrelation: 0.0,
            noise_correlation: 0.0,
        },
        gain: Gain::default(),
        unexplained_share: None,
        residual_law: None,
        next_experiment: Some(NextExperiment {
            why: reason.to_string(),
            action: "measure more trials, each with ten or more observations between contacts".into(),
            separates: Vec::new(),
            scene: None,
        }),
        considered: Vec::new(),
        seed: config.seed,
    };
    let mut extended = scene.clone();
    if let Some(trial) = trials.first() {
        place(&mut extended, &trial.scene, None);
    }
    Finding { diagnosis, extended, evidence: Evidence::default() }
}

/// Squares in units of the noise, told in metres.
struct Scale {
    /// m
    noise: f64,
    coordinates: f64,
    floor: f64,
    trials: usize,
}

impl Scale {
    fn new(judged: &Judged, trials: usize) -> Scale {
        let coordinates = judged.expected.coordinates.iter().sum();
        Scale { noise: judged.noise.sd, coordinates, floor: judged.expected.total(), trials }
    }

    /// Root of the mean of squares that sum to `squares`, m.
    fn rmse(&self, squares: f64) -> f64 {
        self.noise * (squares.max(0.0) / self.coordinates.max(1.0)).sqrt()
    }

    /// What an extension makes of the base's held-out loss.
    fn gain(&self, base: f64, extended: f64) -> HeldOut {
        let rmse = |squares: f64| self.noise * (squares / self.coordinates).sqrt();
        let excess = base - self.floor;
        HeldOut {
            trials: self.trials,
            base_rmse: rmse(base),
            extended_rmse: rmse(extended),
            floor_rmse: rmse(self.floor),
            excess_removed: (excess > SLIGHT * self.floor).then(|| 1.0 - (extended - self.floor) / excess),
        }
    }
}

/// Loss at each setting of a fit to the others; `None` without two settings of three trials or more.
fn at_other_settings(f: &Fitted, settings: &[usize], count: usize) -> Option<f64> {
    let sizes: Vec<usize> = (0..count).map(|s| settings.iter().filter(|g| **g == s).count()).collect();
    let enough = sizes.iter().filter(|s| **s >= 3).count() >= 2 && sizes.iter().all(|s| *s > 0);
    let of = || judge::leave_out(&f.layout, &f.state.values, &f.pass.trials, settings, settings, &[]).0;
    enough.then(|| of().iter().sum())
}

/// The first `count` slots of a fit: its latents.
fn calibrated(f: &Fitted, count: usize, settings: &[usize], unit: f64) -> Vec<Calibrated> {
    let of = |i: usize| {
        let slot = &f.layout.slots[i];
        let latent = slot.latent().expect("latents come first in a layout");
        let half = f.half_width(i, settings, unit);
        let told: f64 = f.pass.trials.iter().map(|t| t.gram[(i, i)]).sum();
        let width = slot.bounds[1] - slot.bounds[0];
        let identifiable = half.is_finite() && half < 0.25 * width.min(4.0) && told > 10.0 * slot.ridge();
        let value = f.state.values[i];
        let end = |v: f64| identifiable.then(|| v.clamp(slot.bounds[0], slot.bounds[1]));
        let ci95 = [end(value - half), end(value + half)];
        Calibrated { name: FACTORS[latent].name.into(), value, ci95, identifiable }
    };
    (0..count).map(of).collect()
}

/// A model with a law for what it leaves (`law`), fitted; `None` where nothing simple describes that.
fn described(data: &Data, model: &Fitted, noise: &Noise, settings: usize) -> Result<Option<Fitted>> {
    let found = law::law(data, model, noise)?;
    if found.is_empty() {
        return Ok(None);
    }
    let (layout, start) = model.joined(found, settings);
    let Some((state, pass)) = search::simulated(model::fit(data, &layout, start, 8))? else {
        return Ok(None);
    };
    let mut law = Fitted::new(layout, state, pass, data.settings);
    law.p_values[..model.p_values.len()].copy_from_slice(&model.p_values);
    Ok(Some(law))
}

/// The terms of a law, those of a model from `first` on.
fn law_terms(law: &Fitted, first: usize, settings: &[usize], unit: f64) -> Vec<LawTerm> {
    let of = |(t, term): (usize, &model::Term)| {
        let slot = *law.layout.of_term(t).first()?;
        let (value, half) = (law.state.values[slot], law.half_width(slot, settings, unit));
        let end = |v: f64| half.is_finite().then_some(v);
        let mut values = term.start.clone();
        let axis = term.free.iter().position(|f| *f)?;
        values[axis] = value;
        Some(LawTerm {
            term: term.effect.at_clock(&values, 0.0),
            amplitude: term.effect.parameters[axis].name.into(),
            ci95: [end(value - half), end(value + half)],
        })
    };
    law.layout.terms.iter().enumerate().skip(first).filter_map(of).collect()
}

/// Root of the mean square of all coordinates that count, m.
fn root_mean_square(residuals: &[Vec<f64>]) -> f64 {
    let known = || residuals.iter().flatten().filter(|r| r.is_finite());
    (known().map(|r| r * r).sum::<f64>() / known().count().max(1) as f64).sqrt()
}

/// The first `count` terms of a fit.
fn effects(f: &Fitted, count: usize, names: &[String], settings: &[usize], unit: f64) -> Vec<FoundEffect> {
    f.layout
        .terms
        .iter()
        .enumerate()
        .take(count)
        .map(|(t, term)| {
            let parameters = f
                .layout
                .of_term(t)
                .into_iter()
                .filter_map(|i| {
                    let slot = &f.layout.slots[i];
                    let model::What::Parameter(_, p) = slot.what else { return None };
                    let half = f.half_width(i, settings, unit);
                    let value = f.state.values[i];
                    let end = |v: f64| half.is_finite().then(|| v.clamp(slot.bounds[0], slot.bounds[1]));
                    Some(FoundParameter {
                        name: term.effect.parameters[p].name.into(),
                        value,
                        ci95: [end(value - half), end(value + half)],
                        unit: term.effect.parameters[p].unit.into(),
                        setting: slot.setting.map(|s| names[s].clone()),
                    })
                })
                .collect();
            FoundEffect {
                name: term.effect.name.into(),
                acts_on: term.effect.acts_on().name().into(),
                p_value: f.p_values[t],
                parameters,
            }
        })
        .collect()
}

/// Lag-1 correlation of the base model's residuals, and p of its being nothing.
fn whiteness(windows: &[Window], base: &Fitted) -> (f64, f64) {
    let (mut squares, mut products, mut count) = (0.0, 0.0, 0.0);
    for (window, r) in windows.iter().zip(&base.pass.residuals).filter(|(w, _)| w.kind != Kind::Contact) {
        let bodies = window.scene.bodies.len();
        for i in 0..r.len() {
            let j = i + 2 * bodies;
            if r[i].is_finite() {
                squares += r[i] * r[i];
                if j < r.len() && r[j].is_finite() {
                    products += r[i] * r[j];
                    count += 1.0;
                }
            }
        }
    }
    let rho = if squares > 0.0 { products / squares } else { 0.0 };
    (rho, (2.0 * normal_above(rho.abs() * f64::sqrt(count))).min(1.0))
}
