//! Trials that are unlike the others: another object, a wrong scale, a file of another experiment.
//!
//! The predictive check says of every trial how probable it is to be as far from what the others predict of it. Trials that are
//! suspect by it are left out, and what the rest say, variance components included, judges them again. Odd trials are few:
//! many are a sign of a missing effect.
//!
//! Source: Bonferroni's inequality (Dunn, J. Am. Stat. Assoc. 56 (1961) 52).

use nalgebra::DVector;

use super::check::joined;
use super::fit::{Fitted, Fitter, simulated};
use super::gaussian::{self, FREEDOM, Pooled};
use super::model::{self, Data, State};
use super::noise::Noise;
use super::prepare::{RUN, prepare};
use super::report::{Diagnosis, OddTrial};
use super::selection::SETTINGS;
use super::window::Window;
use crate::distribution::f_survival;
use crate::error::Result;
use crate::progress::Progress;
use crate::reality::Trial;
use crate::task::Scene;
use crate::world::Engine;

/// Most odd trials, as a share of all: one in eight.
const MAX_SHARE: f64 = 0.125;
/// Expected number of trials that are as far off by chance, below which trials are suspect.
const SUSPECT: f64 = 0.1;
/// Steps of least squares to the initial states of trials that are judged.
const STEPS: usize = 6;

/// Indices of the trials that a diagnosis of all makes suspect; none where they are many.
pub fn suspects(diagnosis: &Diagnosis) -> Vec<usize> {
    let Some(check) = &diagnosis.predictive else { return Vec::new() };
    let count = check.launches.len() as f64;
    let mut found: Vec<usize> =
        check.launches.iter().filter(|l| l.p * count < SUSPECT).map(|l| l.trial).collect();
    found.truncate(if found.len() as f64 <= MAX_SHARE * count { found.len() } else { 0 });
    found
}

/// Those of the trials left out that the model of the rest makes improbable, with their probabilities.
pub fn odd(
    scene: &Scene,
    trials: &[Trial],
    left_out: &[usize],
    model: &Fitted,
    (noise, engine): (&Noise, Engine),
    progress: &dyn Progress,
) -> Result<Vec<OddTrial>> {
    let mut out = Vec::new();
    if left_out.is_empty() {
        return Ok(out);
    }
    let Ok(ready) = prepare(scene, trials, engine, RUN, &[], progress)? else { return Ok(out) };
    for trial in left_out {
        progress.check_stop()?;
        let Some(place) = ready.kept.iter().position(|k| k == trial) else { continue };
        let own = |w: &&Window| w.trial == place && !w.kind.simulated();
        let windows: Vec<Window> =
            ready.windows.iter().filter(own).map(|w| Window { trial: 0, ..w.clone() }).collect();
        let p = probability(&windows, ready.settings[place], model, noise, engine)?;
        if p * (ready.kept.len() as f64) < SETTINGS.odd_trial {
            out.push(OddTrial { trial: *trial, name: trials[*trial].name.clone(), p });
        }
    }
    Ok(out)
}

/// Probability that a trial is as far from what a model of other trials predicts of it; 1 where that cannot be told.
fn probability(
    windows: &[Window],
    setting: usize,
    model: &Fitted,
    noise: &Noise,
    engine: Engine,
) -> Result<f64> {
    let settings = [setting];
    let data = Data::new(windows, &settings, vec![noise.sd; windows.len()], engine);
    // Only initial states are fitted: bounds hold the parameters at the model's values.
    let mut layout = model.layout.clone();
    layout.slots.iter_mut().zip(&model.state.values).for_each(|(slot, v)| slot.bounds = [*v; 2]);
    let nuisances = windows.iter().map(|w| w.start_whatever_acts().unwrap_or_else(|| w.nuisances.clone()));
    let start = State::new(model.state.values.clone(), nuisances.collect());
    let Some((state, _)) = simulated(model::fit(&data, &layout, start, STEPS))? else { return Ok(1.0) };
    let fitter = Fitter::new(&data, noise);
    let Some((_, parts)) = fitter.parts(&model.layout, &state, &[])? else { return Ok(1.0) };
    let others =
        Pooled { step: DVector::zeros(model.layout.slots.len()), covariance: model.covariance.clone() };
    let told = gaussian::all_told(&parts, &model.components).unwrap_or_default();
    let survival = |t: &gaussian::Told| {
        let (square, _) = t.predictive(&others)?;
        Some(f_survival(square / t.count, t.count, FREEDOM))
    };
    let all: Vec<f64> = told.iter().filter_map(survival).collect();
    Ok(if all.is_empty() { 1.0 } else { joined(&all) })
}

/// Sentence about odd trials for the report's reason.
pub fn text(odd: &[OddTrial]) -> String {
    let names: Vec<String> = odd.iter().map(|o| format!("{:?} (p = {:.1e})", o.name, o.p)).collect();
    let (noun, are) = if odd.len() == 1 { ("trial", "is") } else { ("trials", "are") };
    format!("; left out: {noun} {}, which {are} unlike what the others predict", names.join(", "))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::discover::thrown;

    #[test]
    fn odd_trials_are_named() {
        let one = |p: f64| OddTrial { trial: 3, name: "throw 3".into(), p };
        let wanted = "; left out: trial \"throw 3\" (p = 2.0e-9), which is unlike what the others predict";
        assert_eq!(text(&[one(2e-9)]), wanted);
        assert!(text(&[one(1e-9), one(1e-5)]).contains("which are unlike"));
    }

    /// A throw of the same ball is probable; one that is seen half as large is not.
    #[test]
    fn a_trial_of_another_scale_is_improbable() {
        thrown::fitted(&[0.4; 8], &["linear_drag"], 11, |fitter, model| {
            let noise = Noise { sd: fitter.data.sd[0], rho: 0.0, freedom: 1e3 };
            let mut own: Vec<Window> = fitter.data.windows.iter().filter(|w| w.trial == 0).cloned().collect();
            let p = |windows: &[Window]| probability(windows, 0, model, &noise, Engine::Auto).unwrap();
            assert!(p(&own) > 0.01, "{}", p(&own));
            own.iter_mut().flat_map(|w| &mut w.points).for_each(|p| p.seen = p.seen.map(|v| 0.5 * v));
            assert!(p(&own) < 1e-4, "{}", p(&own));
        });
    }
}
