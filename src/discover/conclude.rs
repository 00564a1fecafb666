//! Puts what was found into a report.

use super::decide::Compared;
use super::evidence::{self, Evidence};
use super::expected::Expected;
use super::extend::{extend, place};
use super::fit::{self, Fitted, Shown, held};
use super::leave_out::leave_out;
use super::model::{self, Data, Layout, Pass, State};
use super::noise::Noise;
use super::report::{
    self, Calibrated, Diagnosis, FoundEffect, FoundParameter, Gain, HeldOut, LawTerm, NextExperiment,
    Remainder, Residual, ResidualLaw, Score, Verdict,
};
use super::search::Found;
use super::stats::{inverse, mean_error, normal_above};
use super::verdict::Judged;
use super::window::{Kind, Window};
use super::{Config, Finding, advise, law};
use crate::error::Result;
use crate::reality::Trial;
use crate::task::Scene;
use crate::world::latent::FACTORS;
use nalgebra::DMatrix;

/// Excess over the noise floor, as a share of it, below which a share of the excess means nothing.
const SLIGHT: f64 = 0.02;
/// Error over the noise floor's up to which a model is said to reach it.
const FLOOR: f64 = 1.1;

/// What a report is made from, besides the search and its verdict.
pub struct Given<'a> {
    pub scene: &'a Scene,
    pub trials: &'a [Trial],
    pub data: &'a Data<'a>,
    /// Which of the trials the windows are of.
    pub kept: &'a [usize],
    /// Names of the settings.
    pub names: &'a [String],
    pub noise: &'a Noise,
    pub expected: &'a Expected,
}

/// The report of a search, the extended scene and what pictures show.
pub fn conclude(given: &Given, found: Found, judged: &Judged, config: &Config) -> Result<Finding> {
    let Given { scene, trials, data, kept, names, noise, expected } = *given;
    let (windows, settings, verdict) = (data.windows, data.settings, judged.verdict);
    let Found { base, fits, .. } = &found;
    let best = judged.champion.map(|c| &fits[c]);
    let model = best.unwrap_or(base);
    let law = if verdict == Verdict::Unknown { described(data, model, noise, names.len())? } else { None };
    let scale = Scale::new(expected, noise, kept.len());
    // What goes without a name is an extension all the same, if it holds on other trials.
    let helpful =
        law.as_ref().filter(|l| l.held.iter().sum::<f64>() < held(model) && better(&model.held, &l.held));
    let residual_law = law.as_ref().map(|l| ResidualLaw {
        formula: law::formula(&l.layout, &l.state.values, model.set.len()),
        terms: law_terms(l, model.set.len(), noise.unit()),
        held_out: scale.gain(held(base), l.held.iter().sum()),
        offered: helpful.is_some(),
    });
    let shown =
        helpful.map_or(model.shown(), |l| Shown { layout: &l.layout, state: &l.state, pass: &l.pass });
    let gain = Gain {
        held_out: best.map(|f| scale.gain(held(base), held(f))),
        extrapolation: best.and_then(|f| {
            let loss = |f: &Fitted| at_other_settings(f, settings, names.len());
            Some(scale.gain(loss(base)?, loss(f)?))
        }),
    };
    let (autocorrelation, whiteness_p) = whiteness(windows, base);
    let next = advise::next(scene, windows, fits, &judged.rivals, verdict, noise, config)?;
    let rival_names = |i: &usize| strings(&fits[*i].names());
    let remainder = remainder(base, model, judged, noise, &gain, &scale);
    let diagnosis = Diagnosis {
        format: report::FORMAT,
        verdict,
        reason: reason(&found, judged, &remainder, given),
        effects: effects(model, names),
        rivals: judged.rivals.iter().map(rival_names).collect(),
        calibrated: calibrated(model, base.layout.latents()),
        residual: Residual {
            base_rmse: root_mean_square(&base.pass.residuals),
            floor_rmse: scale.rmse(expected.total()),
            lack_of_fit_p: expected.misfit_of(base, windows).1,
            whiteness_p,
            autocorrelation,
            noise_correlation: noise.rho,
        },
        gain,
        unexplained_share: match verdict {
            Verdict::None => Some(0.0),
            _ => unexplained(base, model, expected, windows),
        },
        residual_law,
        next_experiment: next,
        scores: scores(&found, judged),
        remainder: Some(remainder),
        failed: found.failed.iter().map(|n| strings(n)).collect(),
        seed: config.seed,
    };
    let extended = extend(scene, trials, windows, kept, shown);
    let evidence = evidence::evidence(data, base.shown(), shown, names)?;
    Ok(Finding { diagnosis, extended, evidence })
}

fn strings(names: &[&str]) -> Vec<String> {
    names.iter().map(|n| n.to_string()).collect()
}

/// Share of the base's excess over the noise floor that a model leaves; `None` where there is none to speak of.
fn unexplained(base: &Fitted, model: &Fitted, expected: &Expected, windows: &[Window]) -> Option<f64> {
    let (excess, _) = expected.misfit_of(base, windows);
    let (left, _) = expected.misfit_of(model, windows);
    (excess > SLIGHT).then(|| (left / excess).clamp(0.0, 1.0))
}

/// Whether losses by trial are smaller by more than one standard error.
fn better(worse: &[f64], better: &[f64]) -> bool {
    let gains: Vec<f64> = worse.iter().zip(better).map(|(a, b)| a - b).collect();
    let (mean, error) = mean_error(&gains);
    mean > error
}

/// Every model that was fitted beside the best.
fn scores(found: &Found, judged: &Judged) -> Vec<Score> {
    let of = |effects: Vec<String>, c: &Compared| Score {
        effects,
        score: -c.worse,
        probability_worse: c.probability,
    };
    let fits = found.fits.iter().zip(&judged.compared).map(|(f, c)| of(strings(&f.names()), c));
    let mut out: Vec<Score> = fits.chain([of(Vec::new(), &judged.base)]).collect();
    out.sort_by(|a, b| b.score.total_cmp(&a.score));
    out
}

/// What is left, in figures and words.
fn remainder(
    base: &Fitted,
    model: &Fitted,
    judged: &Judged,
    noise: &Noise,
    gain: &Gain,
    scale: &Scale,
) -> Remainder {
    let [before, after] = [base, model].map(|f| f.slow() * noise.sd);
    let error = gain.held_out.as_ref().map_or(scale.rmse(held(base)), |g| g.extended_rmse);
    let floor = scale.rmse(scale.floor);
    let shared = judged.shared.as_ref();
    let mut text = format!(
        "misfit that changes slowly along paths: {:.2} mm before, {:.2} mm after; noise {:.2} mm",
        1e3 * before,
        1e3 * after,
        1e3 * noise.sd
    );
    text += &match error <= FLOOR * floor {
        true => "; on held-out trials nothing is left above the noise".to_string(),
        false => format!(
            "; on held-out trials the error is {:.1} times what noise leaves",
            error / floor.max(1e-12)
        ),
    };
    if let Some(s) = shared.filter(|s| s.is_left()) {
        text += &format!(
            "; launches share something more, of whose predictable part {:.0} % is explained",
            100.0 * s.explained
        );
    }
    Remainder {
        slow_before_m: before,
        slow_after_m: after,
        noise_m: noise.sd,
        explained_share: shared.map(|s| s.explained),
        field: shared.map(|s| [s.gain, s.probability]),
        text,
    }
}

/// The verdict in a sentence or two.
fn reason(found: &Found, judged: &Judged, remainder: &Remainder, given: &Given) -> String {
    let names = |i: usize| found.fits[i].names().join(" + ");
    let left = &remainder.text;
    let nats = |i: usize| judged.base.worse - judged.compared[i].worse;
    match (judged.verdict, judged.champion) {
        (Verdict::Named, Some(c)) => format!(
            "{} predicts launches that it was not fitted to better than the base model by {:.0} nats, and no other set ties \
             with it; {left}",
            names(c),
            nats(c)
        ),
        (Verdict::Ambiguous, Some(c)) => {
            let drags = |i: &usize| found.fits[*i].set.iter().any(|e| e.opposes_motion);
            let against = match judged.rivals.iter().all(drags) {
                true => "a force against the velocity, its law not identified: ",
                false => "",
            };
            let count = judged.rivals.len();
            format!(
                "{against}{count} sets predict the data equally well; {} is the simplest; {left}",
                names(c)
            )
        }
        (Verdict::Unknown, Some(c)) => {
            format!(
                "no set in the library explains what launches share; the best, {}, leaves much of it; {left}",
                names(c)
            )
        }
        (Verdict::Unknown, None) => {
            format!("launches share something that no set in the library explains; {left}")
        }
        _ => format!(
            "no set of effects predicts launches better than the base model ({} trials, {} sets tried)",
            given.kept.len(),
            found.fits.len()
        ),
    }
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
        remainder: None,
        failed: Vec::new(),
        next_experiment: Some(NextExperiment {
            why: reason.to_string(),
            action: "measure more trials, each with ten or more observations between contacts".into(),
            separates: Vec::new(),
            scene: None,
        }),
        scores: Vec::new(),
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
    fn new(expected: &Expected, noise: &Noise, trials: usize) -> Scale {
        let coordinates = expected.coordinates.iter().sum();
        Scale { noise: noise.sd, coordinates, floor: expected.total(), trials }
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
    let of = || leave_out(&f.layout, &f.state.values, &f.pass.trials, settings, settings, &[]).0;
    enough.then(|| of().iter().sum())
}

/// The first `count` slots of a fit: its latents.
fn calibrated(f: &Fitted, count: usize) -> Vec<Calibrated> {
    let of = |i: usize| {
        let slot = &f.layout.slots[i];
        let latent = slot.latent().expect("latents come first in a layout");
        let half = f.half_width(i);
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

/// A model with a law for what it leaves, by least squares: no candidate, so it is not scored.
struct Law {
    layout: Layout,
    state: State,
    pass: Pass,
    /// Held-out squares by trial.
    held: Vec<f64>,
}

/// A model with a law for what it leaves (`law`), fitted; `None` where nothing simple describes that.
fn described(data: &Data, model: &Fitted, noise: &Noise, settings: usize) -> Result<Option<Law>> {
    let found = law::law(data, model, noise)?;
    if found.is_empty() {
        return Ok(None);
    }
    let (layout, start) = model.joined(found, settings);
    let Some((state, pass)) = fit::simulated(model::fit(data, &layout, start, 8))? else {
        return Ok(None);
    };
    let groups: Vec<usize> = (0..pass.trials.len()).collect();
    let (held, _) = leave_out(&layout, &state.values, &pass.trials, data.settings, &groups, &[]);
    Ok(Some(Law { layout, state, pass, held }))
}

/// The terms of a law, those of a model from `first` on. Intervals are by the noise's own size.
fn law_terms(law: &Law, first: usize, unit: f64) -> Vec<LawTerm> {
    let q = law.layout.slots.len();
    let mut gram = law.pass.trials.iter().fold(DMatrix::zeros(q, q), |sum, t| sum + &t.gram);
    (0..q).for_each(|k| gram[(k, k)] += law.layout.slots[k].ridge());
    let covariance = inverse(&gram) * unit;
    let of = |(t, term): (usize, &model::Term)| {
        let slot = *law.layout.of_term(t).first()?;
        let (value, half) = (law.state.values[slot], 1.96 * covariance[(slot, slot)].max(0.0).sqrt());
        let mut values = term.start.clone();
        let axis = term.free.iter().position(|f| *f)?;
        values[axis] = value;
        Some(LawTerm {
            term: term.effect.at_clock(&values, 0.0),
            amplitude: term.effect.parameters[axis].name.into(),
            ci95: [Some(value - half), Some(value + half)],
        })
    };
    law.layout.terms.iter().enumerate().skip(first).filter_map(of).collect()
}

/// Root of the mean square of all coordinates that count, m.
fn root_mean_square(residuals: &[Vec<f64>]) -> f64 {
    let known = || residuals.iter().flatten().filter(|r| r.is_finite());
    (known().map(|r| r * r).sum::<f64>() / known().count().max(1) as f64).sqrt()
}

/// The effects of a fit.
fn effects(f: &Fitted, names: &[String]) -> Vec<FoundEffect> {
    f.layout
        .terms
        .iter()
        .enumerate()
        .map(|(t, term)| {
            let parameters = f
                .layout
                .of_term(t)
                .into_iter()
                .filter_map(|i| {
                    let slot = &f.layout.slots[i];
                    let model::What::Parameter(_, p) = slot.what else { return None };
                    let half = f.half_width(i);
                    let value = f.state.values[i];
                    let end = |v: f64| half.is_finite().then(|| v.clamp(slot.bounds[0], slot.bounds[1]));
                    Some(FoundParameter {
                        name: term.effect.parameters[p].name.into(),
                        value,
                        ci95: [end(value - half), end(value + half)],
                        unit: term.effect.parameters[p].unit.into(),
                        setting: slot.setting.map(|s| names[s].clone()),
                        spread: f.spread(i),
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
