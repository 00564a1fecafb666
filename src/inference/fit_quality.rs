//! Lack of fit: whether a simulation can reproduce measured trials at any values of its latents, within the noise.
//!
//! `F = (RSS / d) / s^2`: the mean residual square of the base model, fitted to segments of the trials with unknown initial states,
//! over the noise variance estimated from the trials themselves.
//!
//! Source: the F test for lack of fit (Draper and Smith 1998, section 2.1), with the noise estimate of `data` in place of replicates.
//!
//! Differences from the source: the numerator's variance includes the correlation of the noise; the distribution of the relative excess
//! is approximated by Student's t with the degrees of freedom of the noise estimate. Contacts are not counted.

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use super::data::preprocessing::{MAX_INITIAL_INTERVALS, PreprocessedData, preprocess};
use super::statistics::t_survival;
use super::{BaseFit, DiagnosisConfig, fit_base};
use crate::error::{Error, Result};
use crate::progress::Progress;
use crate::reality::{Trial, with_trial_settings};
use crate::task::Scene;
use crate::task::scene::EffectTerm;
use crate::world::latent::factor_index;

/// Significance below which a fit is bad.
const MAX_SIGNIFICANCE: f64 = 0.01;

/// Quality of a fit: the error of the best simulation beside the measurement noise.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct FitQuality {
    /// Whether the simulation can reproduce the trials; `null` if they are too few or too short to tell.
    pub adequate: Option<bool>,
    /// Root mean square error of the best simulation, m.
    pub error_m: Option<f64>,
    /// Root mean square error expected from the measurement noise alone, m.
    pub noise_m: Option<f64>,
    /// Probability of a misfit at least this large if the simulation were right.
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
    let first = trials.first().ok_or_else(|| Error::input("trials", "none", "at least one"))?;
    let (mut scene, trials) = with_trial_settings(&first.scene.clone(), trials.to_vec())?;
    scene.effects.extend_from_slice(effects);
    let trials: Vec<Trial> = trials
        .into_iter()
        .map(|mut trial| {
            trial.scene.effects.extend_from_slice(effects);
            trial
        })
        .collect();
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
    let expected = &ready.expected_rss;
    let excess = expected.relative_excess(&evaluation.squares, &ready.segments);
    let Some((excess, standard_error)) = excess else {
        return Ok(undetermined("no trial has a segment of free motion"));
    };
    let noise = ready.noise.sd * (expected.mean.iter().sum::<f64>() / expected.coordinate_count()).sqrt();
    let error = noise * (1.0 + excess).max(0.0).sqrt();
    let p = t_survival(excess / standard_error, ready.noise.degrees_of_freedom);
    let bad = p < MAX_SIGNIFICANCE;
    let figures = format!("error {} beside {} of noise, p = {p:.1e}", length(error), length(noise));
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
