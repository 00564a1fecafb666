//! Lack of fit: whether a simulation can reproduce measured trials at any values of its latents, within the noise.
//!
//! `F = (RSS / d) / s^2` for each trial: the mean residual square of the base model, fitted to segments of all trials with unknown initial
//! states, over the noise variance estimated from the trials themselves. Trials with a significant excess are counted, and the count is
//! compared with the binomial distribution of a share that chaotic contacts and outliers spoil in a right model.
//!
//! Source: the F test for lack of fit (Draper and Smith 1998, section 2.1), with the noise estimate of `data` in place of replicates.
//!
//! Differences from the source: the test is made for each trial, since one trial with a misjudged contact would decide a common one; the
//! variance of a trial's sum includes the correlation of the noise and the error of its estimate. Contacts are not counted.

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use super::data::preprocessing::{MAX_INITIAL_INTERVALS, PreprocessedData, preprocess};
use super::statistics::binomial_survival;
use super::{BaseFit, DiagnosisConfig, fit_base};
use crate::error::{Error, Result};
use crate::progress::Progress;
use crate::reality::{Trial, with_trial_settings};
use crate::task::Scene;
use crate::task::scene::EffectTerm;
use crate::world::latent::factor_index;

/// Significance below which a fit is bad.
const MAX_SIGNIFICANCE: f64 = 0.01;
/// Excess of a trial's residual square, in standard deviations, above which the simulation does not reproduce the trial.
const MAX_TRIAL_EXCESS_SD: f64 = 3.0;
/// Share of trials that may be spoilt although the simulation is right.
const SPOILT_SHARE: f64 = 0.2;

/// Quality of a fit: the error of the best simulation beside the measurement noise.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct FitQuality {
    /// Whether the simulation can reproduce the trials; `null` if they are too few or too short to tell.
    pub adequate: Option<bool>,
    /// Root mean square error of the best simulation in the median trial, m.
    pub error_m: Option<f64>,
    /// Standard deviation of the measurement noise, m.
    pub noise_m: Option<f64>,
    /// Probability of at least as many trials with a misfit if the simulation were right.
    pub lack_of_fit_p: Option<f64>,
    /// A sentence for people.
    pub text: String,
}

/// Checks whether the scene of these trials, with `effects` added, can reproduce them at any values of the latents that the scene
/// calibrates.
pub fn check_fit(
    trials: &[Trial],
    effects: &[EffectTerm],
    config: &DiagnosisConfig,
    progress: &dyn Progress,
) -> Result<FitQuality> {
    let mut trials = trials.to_vec();
    trials.iter_mut().for_each(|trial| trial.scene.effects.extend_from_slice(effects));
    let first = trials.first().ok_or_else(|| Error::input("trials", "none", "at least one"))?;
    let (scene, trials) = with_trial_settings(&first.scene.clone(), trials)?;
    progress.report("checking the fit", 0, 1)?;
    match preprocess(&scene, &trials, config.engine, MAX_INITIAL_INTERVALS, &[], progress)? {
        Err(lack) => Ok(undetermined(&lack.reason)),
        Ok(ready) => quality(&scene, &trials, &ready, config, progress),
    }
}

fn undetermined(reason: &str) -> FitQuality {
    let text = format!("the fit cannot be checked: {reason}");
    FitQuality { adequate: None, error_m: None, noise_m: None, lack_of_fit_p: None, text }
}

fn quality(
    scene: &Scene,
    trials: &[Trial],
    ready: &PreprocessedData,
    config: &DiagnosisConfig,
    progress: &dyn Progress,
) -> Result<FitQuality> {
    let latents = scene.calibrate.iter().map(|n| factor_index(n)).collect::<Result<Vec<_>>>()?;
    let stages = (config.engine, config.seed, progress);
    let BaseFit { evaluation, .. } = fit_base(scene, trials, ready, &ready.segments, &latents, stages)?;
    let excesses = ready.expected_rss.excess_by_trial(&evaluation.squares, &ready.segments);
    if excesses.is_empty() {
        return Ok(undetermined("no trial has a segment of free motion"));
    }
    let noise = ready.noise.sd;
    let mut ratios: Vec<f64> = excesses.iter().map(|e| e.ratio).collect();
    ratios.sort_by(f64::total_cmp);
    let error = noise * ratios[ratios.len() / 2].max(0.0).sqrt();
    let misfits = excesses.iter().filter(|e| e.ratio - 1.0 > MAX_TRIAL_EXCESS_SD * e.standard_error).count();
    let p = binomial_survival(misfits, excesses.len(), SPOILT_SHARE);
    let bad = p < MAX_SIGNIFICANCE;
    let figures = format!(
        "{misfits} of {} trials misfit; median error {} beside {} of noise; p = {p:.1e}",
        excesses.len(),
        length(error),
        length(noise)
    );
    let text = if bad {
        format!(
            "the simulation cannot reproduce these trials ({figures}): an effect is missing, and estimates and intervals ignore it; \
             diagnose them"
        )
    } else {
        format!("the simulation reproduces these trials ({figures})")
    };
    Ok(FitQuality {
        adequate: Some(!bad),
        error_m: Some(error),
        noise_m: Some(noise),
        lack_of_fit_p: Some(p),
        text,
    })
}

/// A length with a readable unit.
fn length(metres: f64) -> String {
    match metres {
        m if m >= 1.0 => format!("{m:.2} m"),
        m if m >= 1e-2 => format!("{:.1} cm", m * 1e2),
        m if m >= 1e-4 => format!("{:.2} mm", m * 1e3),
        m => format!("{:.2} µm", m * 1e6),
    }
}
