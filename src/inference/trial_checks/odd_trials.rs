//! Odd trials: another object, a wrong scale, a file of another experiment.
//!
//! Trials with a small p-value in the predictive check are left out, and tested again by the model of the
//! rest, variance components included. Odd trials are few: many are evidence of a missing effect.
//!
//! Source: Bonferroni's inequality (Dunn, J. Am. Stat. Assoc. 56 (1961) 52).

use nalgebra::DVector;

use crate::distribution::f_survival;
use crate::error::Result;
use crate::inference::data::noise::Noise;
use crate::inference::data::preprocessing::{MAX_INITIAL_INTERVALS, preprocess};
use crate::inference::mixed_model::fitted_model::FittedModel;
use crate::inference::mixed_model::group_statistics::{self, GlsEstimate, SCALE_DOF};
use crate::inference::mixed_model::model_fit::{ModelFitter, none_if_not_simulable};
use crate::inference::model::{self, FitState, SegmentData};
use crate::inference::report::{Diagnosis, OddTrial};
use crate::inference::segment::Segment;
use crate::inference::selection::SETTINGS;
use crate::inference::trial_checks::predictive_check::fisher_combine;
use crate::progress::Progress;
use crate::reality::Trial;
use crate::task::Scene;
use crate::world::Engine;

/// Maximum share of odd trials.
const MAX_SHARE: f64 = 0.125;
/// Expected number of equally extreme trials by chance below which a trial is suspect.
const MAX_CHANCE_COUNT: f64 = 0.1;
/// Least-squares steps for the initial states of tested trials.
const LEAST_SQUARES_STEPS: usize = 6;

/// Indices of suspect trials; empty if there are many.
pub fn suspects(diagnosis: &Diagnosis) -> Vec<usize> {
    let Some(check) = &diagnosis.predictive else { return Vec::new() };
    let count = check.launches.len() as f64;
    let mut found: Vec<usize> =
        check.launches.iter().filter(|l| l.p * count < MAX_CHANCE_COUNT).map(|l| l.trial).collect();
    found.truncate(if found.len() as f64 <= MAX_SHARE * count { found.len() } else { 0 });
    found
}

/// Those of the left-out trials that are improbable under the model of the rest.
pub fn odd_trials(
    scene: &Scene,
    trials: &[Trial],
    left_out: &[usize],
    model: &FittedModel,
    (noise, engine): (&Noise, Engine),
    progress: &dyn Progress,
) -> Result<Vec<OddTrial>> {
    let mut out = Vec::new();
    if left_out.is_empty() {
        return Ok(out);
    }
    let Ok(ready) = preprocess(scene, trials, engine, MAX_INITIAL_INTERVALS, &[], progress)? else {
        return Ok(out);
    };
    for trial in left_out {
        progress.check_stop()?;
        let Some(place) = ready.trial_indices.iter().position(|k| k == trial) else { continue };
        let own = |w: &&Segment| w.trial == place && !w.kind.uses_engine();
        let segments: Vec<Segment> =
            ready.segments.iter().filter(own).map(|w| Segment { trial: 0, ..w.clone() }).collect();
        let p = probability(&segments, ready.settings[place], model, noise, engine)?;
        if p * (ready.trial_indices.len() as f64) < SETTINGS.odd_trial {
            out.push(OddTrial { trial: *trial, name: trials[*trial].name.clone(), p });
        }
    }
    Ok(out)
}

/// P-value of a trial under a model of other trials; 1 if it cannot be computed.
fn probability(
    segments: &[Segment],
    setting: usize,
    model: &FittedModel,
    noise: &Noise,
    engine: Engine,
) -> Result<f64> {
    let settings = [setting];
    let data = SegmentData::new(segments, &settings, vec![noise.sd; segments.len()], engine);
    // Only initial states are fitted: bounds hold the parameters at the model's values.
    let mut layout = model.layout.clone();
    layout
        .parameters
        .iter_mut()
        .zip(&model.state.values)
        .for_each(|(parameter, v)| parameter.bounds = [*v; 2]);
    let nuisances =
        segments.iter().map(|w| w.parabola_initial_state().unwrap_or_else(|| w.nuisances.clone()));
    let start = FitState::new(model.state.values.clone(), nuisances.collect());
    let Some((state, _)) = none_if_not_simulable(model::fit(&data, &layout, start, LEAST_SQUARES_STEPS))?
    else {
        return Ok(1.0);
    };
    let fitter = ModelFitter::new(&data, noise);
    let Some((_, groups)) = fitter.groups(&model.layout, &state, &[])? else { return Ok(1.0) };
    let others = GlsEstimate {
        step: DVector::zeros(model.layout.parameters.len()),
        covariance: model.covariance.clone(),
    };
    let statistics = group_statistics::group_statistics(&groups, &model.components, data.progress)?;
    let statistics = statistics.unwrap_or_default();
    let survival = |t: &group_statistics::GroupStatistics| {
        let (square, _) = t.predictive_distance(&others)?;
        Some(f_survival(square / t.count, t.count, SCALE_DOF))
    };
    let all: Vec<f64> = statistics.iter().filter_map(survival).collect();
    Ok(if all.is_empty() { 1.0 } else { fisher_combine(&all) })
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
    use crate::inference::testing::throws;

    #[test]
    fn odd_trials_are_named() {
        let one = |p: f64| OddTrial { trial: 3, name: "throw 3".into(), p };
        let expected = "; left out: trial \"throw 3\" (p = 2.0e-9), which is unlike what the others predict";
        assert_eq!(text(&[one(2e-9)]), expected);
        assert!(text(&[one(1e-9), one(1e-5)]).contains("which are unlike"));
    }

    /// A throw of the same ball is probable; one scaled by one half is not.
    #[test]
    fn a_trial_of_another_scale_is_improbable() {
        throws::with_fit(&[0.4; 8], &["linear_drag"], 11, |fitter, model| {
            let noise = Noise { sd: fitter.data.sd[0], rho: 0.0, degrees_of_freedom: 1e3 };
            let mut own: Vec<Segment> =
                fitter.data.segments.iter().filter(|w| w.trial == 0).cloned().collect();
            let p = |segments: &[Segment]| probability(segments, 0, model, &noise, Engine::Auto).unwrap();
            assert!(p(&own) > 0.01, "{}", p(&own));
            own.iter_mut()
                .flat_map(|w| &mut w.observations)
                .for_each(|p| p.position = p.position.map(|v| 0.5 * v));
            assert!(p(&own) < 1e-4, "{}", p(&own));
        });
    }
}
