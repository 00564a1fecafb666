//! Structural model discrepancy diagnosis: from measured trials to the named missing effect, the extended model
//! and its gain in predictive accuracy.
//!
//! 1. Data (`data`). Trials are cut into segments with unknown initial states (`segment`); the noise is
//!    estimated, velocity offsets are aligned, segments are truncated at the predictability horizon and
//!    cleaned of outliers, and surfaces are moved to where bodies bounce.
//! 2. Models. `dynamics` and the engines simulate segments; `model` computes residuals and Jacobians.
//!    `base_model`: fit of the latents without further effects.
//! 3. Evidence (`mixed_model`). Residuals of each trial as a mixed-effects model with variance components;
//!    fitted models with the conditional modes of their random effects and their log evidence. `kernels`:
//!    products with noise and discrepancy covariances in linear time.
//! 4. Search (`selection`). Candidates from the effect registry; sets of up to three effects; `global_search`
//!    where initial states are known; `field`: a shared force field without a named effect.
//! 5. Decision (`selection`). Shared discrepancy, posterior over sets, credible set, explained share,
//!    verdict.
//! 6. Report (`report`). `next_experiment`: the experiment that best discriminates tied models;
//!    `residual_law`: empirical law of unexplained discrepancy; `trial_checks`: per-trial estimates,
//!    between-trial variation, predictive checks and odd trials.
//!
//! Sources: multiple shooting (Bock 1983), variable projection (Golub and Pereyra 1973), model discrepancy as a
//! Gaussian process (Kennedy and O'Hagan 2001), mixed-effects models (Pinheiro and Bates 2000), Bayes factors (Kass
//! and Raftery 1995).
//!
//! Differences from the sources: positions are never differentiated; gains are measured on held-out trials;
//! the trial discrepancy is independent between trials, and a small discrepancy is shared by all.

mod base_model;
mod config;
mod data;
mod dynamics;
mod field;
mod fit_quality;
mod global_search;
mod kernels;
pub mod mechanism;
pub mod memory;
mod mixed_model;
mod model;
mod next_experiment;
pub mod posterior;
pub mod report;
mod residual_law;
mod segment;
mod selection;
mod statistics;
#[cfg(test)]
mod testing;
mod trial_checks;

use crate::error::{Error, Result};
use crate::progress::Progress;
use crate::reality::Trial;
use crate::task::Scene;
use crate::trajectory::Trajectory;
use crate::world::Engine;
use crate::world::latent::factor_index;
pub use config::{DiagnosisConfig, DiagnosisResult};
use data::discretisation::inflate_for_discretisation;
use data::noise::Noise;
use data::preprocessing::{InsufficientData, MAX_INITIAL_INTERVALS, PreprocessedData, preprocess};
use data::surface_offsets;
pub use fit_quality::{FitQuality, check_fit};
use mixed_model::model_fit::{ModelFitter, RecordingContext};
use model::{FitEvaluation, FitState, ParameterLayout, SegmentData};
pub use report::Diagnosis;
use report::build::{ReportInput, build_report, insufficient_data_report};
pub use report::evidence::{BounceRecord, Evidence, EvidencePoint, ImpactRecord, MissingAcceleration};
use report::few_trials;
use report::prediction_gain::ErrorScale;
use report::text::{self, unused_contacts_text};
use segment::Segment;
use selection::candidates::Candidate;
use selection::search::{ModelSearch, SearchResult};
use selection::{Decision, candidates, start_grid};
use trial_checks::odd_trials;

/// Appended to the reason of a verdict on data with another time step.
const OTHER_STEPS: &str = " (the measured system uses another time step than the simulation: velocities were shifted to the \
                           simulation's times, and the contact noise includes the discretisation error)";

/// Diagnoses a scene from measured trials.
pub fn diagnose(
    scene: &Scene,
    trials: &[Trial],
    config: &DiagnosisConfig,
    progress: &dyn Progress,
) -> Result<DiagnosisResult> {
    scene.validate()?;
    let found = diagnose_without(scene, trials, &[], config, progress)?;
    let suspects = odd_trials::suspects(&found.diagnosis);
    if suspects.is_empty() {
        return Ok(found);
    }
    progress.report("trying without trials that are unlike the others", 0, 1)?;
    let mut rest = diagnose_without(scene, trials, &suspects, config, progress)?;
    let odd = std::mem::take(&mut rest.diagnosis.odd_trials);
    if odd.len() < suspects.len() {
        return Ok(found);
    }
    rest.diagnosis.reason += &odd_trials::text(&odd);
    rest.diagnosis.odd_trials = odd;
    Ok(rest)
}

/// Diagnoses a scene from all trials but those at some indices.
fn diagnose_without(
    scene: &Scene,
    trials: &[Trial],
    left_out: &[usize],
    config: &DiagnosisConfig,
    progress: &dyn Progress,
) -> Result<DiagnosisResult> {
    let latents = scene.calibrate.iter().map(|n| factor_index(n)).collect::<Result<Vec<_>>>()?;
    let ready = match preprocess(scene, trials, config.engine, MAX_INITIAL_INTERVALS, left_out, progress)? {
        Ok(ready) => ready,
        Err(lack) => return Ok(insufficient_data_report(scene, trials, &lack, config)),
    };
    progress.note(&text::recording_text(&ready.segments, &ready.noise, ready.trial_indices.len()));
    let expected = &ready.expected_rss;
    let scale = ErrorScale::new(expected, &ready.noise, ready.trial_indices.len());
    progress.report("fitting the base model", 0, 1)?;
    let base = (config.engine, config.seed, progress);
    let opened = fit_base(scene, trials, &ready, &ready.segments, &latents, base)?;
    let offsets = surface_offsets::offsets(&ready.segments, &opened.state);
    let moved = surface_offsets::shifted(&ready.segments, &offsets);
    let opened = match &moved {
        Some(segments) => fit_base(scene, trials, &ready, segments, &latents, base)?,
        None => opened,
    };
    if let Some(lack) = &ready.few_trials {
        return few_trials_result((scene, trials, config), &latents, (&ready, lack), opened, progress);
    }
    let BaseFit { mut data, layout, state, observed, .. } = opened;
    let PreprocessedData { trial_indices: used, setting_names: names, noise, sd, mismatch: stepping, .. } =
        &ready;
    let select = |data: &SegmentData, layout: &ParameterLayout, state: FitState| {
        select_model(scene, noise, &latents, config, progress, (data, layout, state))
    };
    let (mut context, mut found, mut decision) = select(&data, &layout, state)?;
    if let Some(stepping) = *stepping {
        // The discretisation error of contacts can be evaluated once the trajectories are fitted.
        let best = decision.selected.map_or(&found.base, |c| &found.fits[c]);
        data.sd.clone_from(sd);
        inflate_for_discretisation(&mut data, &observed, &best.layout, &best.state, stepping)?;
        let state = found.base.state;
        (context, found, decision) = select(&data, &layout, state)?;
    }
    let given = ReportInput {
        scene,
        trials,
        data: &data,
        trial_indices: used,
        setting_names: names,
        noise,
        expected,
        scale: &scale,
        context,
    };
    let model = decision.selected.map_or(&found.base, |c| &found.fits[c]);
    let odd = odd_trials::odd_trials(scene, trials, left_out, model, (noise, config.engine), progress)?;
    progress.report("writing the report", 0, 1)?;
    let mut finding = build_report(&given, found, &decision, config)?;
    finding.diagnosis.odd_trials = odd;
    finding.diagnosis.surface_offsets = surface_offsets::report(scene, &offsets);
    finding.diagnosis.unused_contacts.clone_from(&ready.unused_contacts);
    finding.diagnosis.reason += &unused_contacts_text(&ready.unused_contacts);
    finding.diagnosis.reason += &surface_offsets::text(&finding.diagnosis.surface_offsets);
    if stepping.is_some() {
        finding.diagnosis.reason += OTHER_STEPS;
    }
    Ok(finding)
}

/// The result of trials that are too few for a verdict: the size of each effect alone.
fn few_trials_result(
    (scene, trials, config): (&Scene, &[Trial], &DiagnosisConfig),
    latents: &[usize],
    (ready, lack): (&PreprocessedData, &InsufficientData),
    BaseFit { data, layout, state, .. }: BaseFit,
    progress: &dyn Progress,
) -> Result<DiagnosisResult> {
    let mut finding = insufficient_data_report(scene, trials, lack, config);
    let single = DiagnosisConfig { max_effects: 1, ..*config };
    let selected = select_model(scene, &ready.noise, latents, &single, progress, (&data, &layout, state));
    if let Some((_, found, decision)) = ok_unless_failed(selected)? {
        let count = ready.trial_indices.len();
        let (scores, text) = few_trials::single_effects(&found, &decision, &ready.setting_names, count);
        finding.diagnosis.scores = scores;
        finding.diagnosis.reason += &text;
    }
    finding.diagnosis.unused_contacts.clone_from(&ready.unused_contacts);
    finding.diagnosis.reason += &unused_contacts_text(&ready.unused_contacts);
    Ok(finding)
}

/// A result; `None` if the model could not be evaluated.
fn ok_unless_failed<T>(result: Result<T>) -> Result<Option<T>> {
    match result {
        Err(Error::Failed(_)) => Ok(None),
        result => result.map(Some),
    }
}

/// Estimates the recording's context, searches sets of effects, and decides.
fn select_model(
    scene: &Scene,
    noise: &Noise,
    latents: &[usize],
    config: &DiagnosisConfig,
    progress: &dyn Progress,
    (data, layout, state): (&SegmentData, &ParameterLayout, FitState),
) -> Result<(RecordingContext, SearchResult, Decision)> {
    let fitter = ModelFitter::new(data, noise);
    let failed = || Error::Failed("the log likelihood of the base model could not be evaluated".into());
    let first = fitter.run_gls(layout.clone(), state)?.ok_or_else(failed)?;
    progress.report("trying strong effects", 0, 1)?;
    let mut candidates = candidates::candidates(scene, &candidates::summarise(data.segments));
    start_grid::add_strong_starts(&fitter, &first, &mut candidates)?;
    progress.report("estimating variance components", 0, 1)?;
    // The base model is no place to judge strong effects: they are left to the search.
    let (strong, weak) = candidates.iter().cloned().partition(|c| c.strong_start.is_some());
    let weak: Vec<Candidate> = weak;
    let search = ModelSearch::new(&fitter, weak, latents, config.seed).drop_unidentifiable(&first)?;
    let richest = [strong, search.library].concat();
    let context = selection::context(&fitter, &first, &richest)?;
    let fitter = fitter.with_context(context.clone());
    let base = fitter.run_gls(layout.clone(), first.state)?.ok_or_else(failed)?;
    let search = ModelSearch::new(&fitter, candidates, latents, config.seed).drop_unidentifiable(&base)?;
    let found = search.search(base, config.max_effects, progress)?;
    progress.report("comparing sets of effects", 0, 1)?;
    if let Some(text) = text::search_text(&found) {
        progress.note(&text);
    }
    let decision = selection::decide(&fitter, &found, config.seed)?;
    Ok((context, found, decision))
}

/// Segments with the fitted base model.
struct BaseFit<'a> {
    data: SegmentData<'a>,
    layout: ParameterLayout,
    state: FitState,
    evaluation: FitEvaluation,
    /// Observations by used trial.
    observed: Vec<&'a Trajectory>,
}

/// Fits the base model, the scene with its `latents`, to segments.
fn fit_base<'a>(
    scene: &Scene,
    trials: &'a [Trial],
    ready: &'a PreprocessedData,
    segments: &'a [Segment],
    latents: &[usize],
    (engine, seed, progress): (Engine, u64, &'a dyn Progress),
) -> Result<BaseFit<'a>> {
    let layout = ParameterLayout::new(latents, Vec::new(), ready.setting_names.len());
    let start = base_model::initial_fit_state(scene, &layout, segments);
    let observed: Vec<&Trajectory> = ready.trial_indices.iter().map(|i| &trials[*i].observed).collect();
    let sd = segments.iter().map(|w| ready.residual_sd(w)).collect();
    let mut data = SegmentData::new(segments, &ready.settings, sd, engine).until_stopped(progress);
    if let Some(stepping) = ready.mismatch {
        inflate_for_discretisation(&mut data, &observed, &layout, &start, stepping)?;
    }
    let (state, evaluation) = base_model::fit_base_model(scene, &mut data, &observed, &layout, start, seed)?;
    Ok(BaseFit { data, layout, state, evaluation, observed })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::inference::testing::segments::ball;
    use crate::reality::trials_from_csv;
    use std::fmt::Write as _;
    use std::sync::Mutex;
    use std::sync::atomic::{AtomicU64, Ordering};

    /// Cancels at a check; counts the checks and records the stages.
    struct CancelAtCheck {
        check: u64,
        checks: AtomicU64,
        stages: Mutex<Vec<String>>,
    }

    impl CancelAtCheck {
        fn new(check: u64) -> CancelAtCheck {
            CancelAtCheck { check, checks: AtomicU64::new(0), stages: Mutex::default() }
        }
    }

    impl Progress for CancelAtCheck {
        fn report(&self, stage: &str, _done: u64, _total: u64) -> Result<()> {
            let mut stages = self.stages.lock().unwrap();
            if stages.last().is_none_or(|last| last != stage) {
                stages.push(stage.into());
            }
            self.check_stop()
        }

        fn check_stop(&self) -> Result<()> {
            let before = self.checks.fetch_add(1, Ordering::Relaxed);
            if before + 1 >= self.check { Err(Error::Cancelled) } else { Ok(()) }
        }
    }

    /// Upper bound of the number of sets with one effect.
    const MAX_SETS: u64 = 40;

    /// Throws of a ball with a drag of 0.4 1/s and a noise of 2 mm.
    fn noisy_trials(trials: u32, points: u32) -> Vec<Trial> {
        let mut csv = String::from("trial,t,body,x,y\n");
        for (k, i) in (0..trials).flat_map(|k| (0..points).map(move |i| (k, i))) {
            let (rate, t) = (0.4, f64::from(i) / f64::from(points - 1));
            let noise = |n: u32| 2e-3 * 1.4 * libm::sin(f64::from(i * i + 31 * i * k + n * k + n));
            let along = (1.0 - libm::exp(-rate * t)) / rate;
            let fallen = 9.81 * (t - along) / rate;
            let (x, y) = ((4.0 + f64::from(k)) * along, 2.0 + 4.0 * along - fallen);
            let _ = writeln!(csv, "{k},{t},ball,{},{}", x + noise(3), y + noise(17));
        }
        trials_from_csv(&csv, &ball()).unwrap()
    }

    fn diagnose_single_effects(trials: &[Trial], progress: &CancelAtCheck) -> Result<DiagnosisResult> {
        let config = DiagnosisConfig { max_effects: 1, ..DiagnosisConfig::standard(0) };
        diagnose(&ball(), trials, &config, progress)
    }

    /// A cancelled diagnosis ends in every stage; sets that are still to be fitted end at their first check each.
    #[test]
    fn a_diagnosis_ends_at_the_check_that_cancels_it() {
        let trials = noisy_trials(6, 25);
        let whole = CancelAtCheck::new(u64::MAX);
        diagnose_single_effects(&trials, &whole).unwrap();
        let checks = whole.checks.into_inner();
        for at in (0..8).map(|k| 1 + k * (checks - 2) / 7) {
            let progress = CancelAtCheck::new(at);
            assert_eq!(
                diagnose_single_effects(&trials, &progress).err(),
                Some(Error::Cancelled),
                "check {at} of {checks}"
            );
            let more = progress.checks.into_inner() - at;
            assert!(more <= MAX_SETS, "{more} checks after the one that cancels, {at} of {checks}");
        }
        let stages = whole.stages.into_inner().unwrap();
        assert_eq!(stages[..3], ["segmenting trials", "estimating the noise", "rejecting outliers"]);
        assert_eq!(stages.last().map(String::as_str), Some("writing the report"));
    }

    /// Every pass checks at every segment, so that more trials mean more checks.
    #[test]
    fn checks_grow_with_the_trials() {
        let checks = |trials: u32| {
            let progress = CancelAtCheck::new(u64::MAX);
            diagnose_single_effects(&noisy_trials(trials, 25), &progress).unwrap();
            progress.checks.into_inner()
        };
        let (few, many) = (checks(6), checks(12));
        assert!(2 * many > 3 * few, "{few} checks of 6 trials and {many} of 12");
    }
}
