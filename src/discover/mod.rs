//! Structural model discrepancy diagnosis: from measured trials to the named missing effect, the extended model
//! and its gain in predictive accuracy.
//!
//! 1. Data. Trials are cut into segments with unknown initial states (`window`); the noise is estimated
//!    (`smooth`, `noise`), velocity offsets are aligned (`phase`), and segments are truncated at the
//!    predictability horizon and cleaned of outliers (`trust`); surfaces are moved to where bodies bounce (`geometry`).
//! 2. Models. `path` and the engines simulate segments; `model` computes residuals and Jacobians; latents are
//!    fitted with every candidate. `base`: fit of the base model; `steps`: noise inflation for the
//!    discretisation of another engine.
//! 3. Evidence. `launch`: residuals of each trial as a mixed-effects model with variance components; `fit`: fitted
//!    models with the conditional modes of their random effects (`modes`) and their log evidence; `selection`: shared
//!    discrepancy, Laplace evidence, variance components from the richest model.
//! 4. Search. `library`: the effect registry as candidates; `search`: sets of up to three effects; `survey`:
//!    global search where initial states are known; `field`: a shared force field without a named effect.
//! 5. Decision. `selection`: posterior over sets, credible set, explained share, verdict.
//! 6. Report. `advise`, `parting`: the experiment that best discriminates tied models; `described`, `law`,
//!    `bumps`: empirical force law for unexplained discrepancy; `conclude`, `sizes`, `gain`, `expected`,
//!    `leave_out`, `words`: report; `by_launch`: per-trial estimates; `unlike`: between-trial variation;
//!    `check`: predictive checks; `band`, `paths`: trajectory residuals; `picture`: residual field; `extend`:
//!    extended scene; `evidence`, `plot_tables`: data for plots.
//!
//! Sources: multiple shooting (Bock 1983), variable projection (Golub and Pereyra 1973), model discrepancy as a
//! Gaussian process (Kennedy and O'Hagan 2001), mixed-effects models (Pinheiro and Bates 2000), Bayes factors (Kass
//! and Raftery 1995).
//!
//! Differences from the sources: positions are never differentiated; gains are measured on held-out trials; the slow misfit is
//! independent between trials, and a small discrepancy is shared by all.

mod advise;
mod band;
mod base;
mod bumps;
mod by_launch;
mod check;
mod columns;
mod components;
mod conclude;
mod config;
mod described;
mod evidence;
mod expected;
mod extend;
mod field;
mod fit;
#[cfg(test)]
mod fixture;
mod gain;
mod gaussian;
mod geometry;
mod kernels;
mod launch;
mod law;
mod leave_out;
mod library;
mod model;
mod modes;
mod noise;
mod odd;
mod parting;
mod path;
mod paths;
mod phase;
mod picture;
pub mod plot_tables;
pub mod posterior;
mod prepare;
pub mod report;
mod score;
mod search;
mod selection;
mod sizes;
mod smooth;
mod start_grid;
mod stats;
mod steps;
mod survey;
#[cfg(test)]
mod thrown;
mod trust;
mod unlike;
mod window;
mod words;

use crate::error::{Error, Result};
use crate::progress::Progress;
use crate::reality::Trial;
use crate::task::Scene;
use crate::trajectory::Trajectory;
use crate::world::Engine;
use crate::world::latent::factor_index;
use conclude::{Given, conclude, insufficient};
pub use config::{DiagnosisConfig, DiagnosisResult};
pub use evidence::{BounceRecord, Evidence, EvidencePoint, ImpactRecord, MissingAcceleration};
use fit::Fitter;
use gain::Scale;
use model::{Data, Layout, State};
use prepare::{RUN, Ready, prepare};
pub use report::Diagnosis;
use window::Window;

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
    let suspects = odd::suspects(&found.diagnosis);
    if suspects.is_empty() {
        return Ok(found);
    }
    progress.report("trying without trials that are unlike the others", 0, 1)?;
    let mut rest = diagnose_without(scene, trials, &suspects, config, progress)?;
    let odd = std::mem::take(&mut rest.diagnosis.odd_trials);
    if odd.len() < suspects.len() {
        return Ok(found);
    }
    rest.diagnosis.reason += &odd::text(&odd);
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
    let ready = match prepare(scene, trials, config.engine, RUN, left_out, progress)? {
        Ok(ready) => ready,
        Err(lack) => {
            let mut finding = insufficient(scene, trials, &lack.reason, config);
            let next = finding.diagnosis.next_experiment.iter_mut();
            next.for_each(|n| n.action = lack.action.into());
            return Ok(finding);
        }
    };
    let expected = &ready.expected;
    let scale = Scale::new(expected, &ready.noise, ready.kept.len());
    progress.report("fitting the base model", 0, 1)?;
    let base = (config.engine, config.seed, progress);
    let opened = open(scene, trials, &ready, &ready.windows, &latents, base)?;
    let offsets = geometry::offsets(&ready.windows, &opened.state);
    let moved = geometry::shifted(&ready.windows, &offsets);
    let opened = match &moved {
        Some(windows) => open(scene, trials, &ready, windows, &latents, base)?,
        None => opened,
    };
    let Opened { mut data, layout, state, observed } = opened;
    let Ready { kept, names, noise, sd, stepping, .. } = &ready;
    let seek = |data: &Data, layout: &Layout, state: State| -> Result<_> {
        let mut fitter = Fitter::new(data, noise);
        let failed = || Error::Failed("the log likelihood of the base model could not be evaluated".into());
        let first = fitter.refined(layout.clone(), state)?.ok_or_else(failed)?;
        progress.report("trying strong effects", 0, 1)?;
        let mut candidates = library::candidates(scene, &library::ground(data.windows));
        start_grid::add_strong_starts(&fitter, &first, &mut candidates)?;
        let candidates =
            search::Hunt::new(&fitter, candidates, &latents, config.seed).identifiable(&first)?;
        progress.report("estimating variance components", 0, 1)?;
        fitter.context = Some(selection::context(&fitter, &first, &candidates)?);
        let base = fitter.refined(layout.clone(), first.state)?.ok_or_else(failed)?;
        let hunt = search::Hunt::new(&fitter, candidates, &latents, config.seed);
        let found = hunt.search(base, config.max_effects, progress)?;
        progress.report("comparing sets of effects", 0, 1)?;
        let decision = selection::decide(&fitter, &found, config.seed)?;
        Ok((fitter.context, found, decision))
    };
    let (mut context, mut found, mut decision) = seek(&data, &layout, state)?;
    if let Some(stepping) = *stepping {
        // The discretisation error of contacts can be evaluated once the trajectories are fitted.
        let best = decision.champion.map_or(&found.base, |c| &found.fits[c]);
        data.sd.clone_from(sd);
        steps::allow(&mut data, &observed, &best.layout, &best.state, stepping)?;
        let state = found.base.state;
        (context, found, decision) = seek(&data, &layout, state)?;
    }
    let given = Given { scene, trials, data: &data, kept, names, noise, expected, scale: &scale, context };
    let model = decision.champion.map_or(&found.base, |c| &found.fits[c]);
    let odd = odd::odd(scene, trials, left_out, model, (noise, config.engine), progress)?;
    progress.report("writing the report", 0, 1)?;
    let mut finding = conclude(&given, found, &decision, config)?;
    finding.diagnosis.odd_trials = odd;
    finding.diagnosis.surface_offsets = geometry::report(scene, &offsets);
    finding.diagnosis.reason += &geometry::text(&finding.diagnosis.surface_offsets);
    if stepping.is_some() {
        finding.diagnosis.reason += OTHER_STEPS;
    }
    Ok(finding)
}

/// Segments with the fitted base model.
struct Opened<'a> {
    data: Data<'a>,
    layout: Layout,
    state: State,
    /// Observations by used trial.
    observed: Vec<&'a Trajectory>,
}

/// Fits the base model, the scene with its `latents`, to segments.
fn open<'a>(
    scene: &Scene,
    trials: &'a [Trial],
    ready: &'a Ready,
    windows: &'a [Window],
    latents: &[usize],
    (engine, seed, progress): (Engine, u64, &'a dyn Progress),
) -> Result<Opened<'a>> {
    let layout = Layout::new(latents, Vec::new(), ready.names.len());
    let start = base::start(scene, &layout, windows);
    let observed: Vec<&Trajectory> = ready.kept.iter().map(|i| &trials[*i].observed).collect();
    let sd = windows.iter().map(|w| ready.scale(w)).collect();
    let mut data = Data::new(windows, &ready.settings, sd, engine).until_stopped(progress);
    if let Some(stepping) = ready.stepping {
        steps::allow(&mut data, &observed, &layout, &start, stepping)?;
    }
    let (state, _) = base::fit(scene, &mut data, &observed, &layout, start, seed)?;
    Ok(Opened { data, layout, state, observed })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::discover::fixture::ball;
    use crate::reality::trials_from_csv;
    use std::fmt::Write as _;
    use std::sync::Mutex;
    use std::sync::atomic::{AtomicU64, Ordering};

    /// Cancels at a check, counts checks, and remembers the stages.
    struct StopAt {
        check: u64,
        checks: AtomicU64,
        stages: Mutex<Vec<String>>,
    }

    impl StopAt {
        fn new(check: u64) -> StopAt {
            StopAt { check, checks: AtomicU64::new(0), stages: Mutex::default() }
        }
    }

    impl Progress for StopAt {
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

    /// More than there are sets of one effect.
    const MAX_SETS: u64 = 40;

    /// Throws of a ball with a drag of 0.4 per s and 2 mm of noise.
    fn throws(trials: u32, points: u32) -> Vec<Trial> {
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

    fn diagnosed(trials: &[Trial], progress: &StopAt) -> Result<DiagnosisResult> {
        let config = DiagnosisConfig { max_effects: 1, ..DiagnosisConfig::standard(0) };
        diagnose(&ball(), trials, &config, progress)
    }

    /// Whenever a diagnosis is cancelled it ends, in every stage: of the sets that are still to be fitted each at its first check.
    #[test]
    fn a_diagnosis_ends_at_the_check_that_cancels_it() {
        let trials = throws(6, 25);
        let whole = StopAt::new(u64::MAX);
        diagnosed(&trials, &whole).unwrap();
        let checks = whole.checks.into_inner();
        for at in (0..8).map(|k| 1 + k * (checks - 2) / 7) {
            let progress = StopAt::new(at);
            assert_eq!(diagnosed(&trials, &progress).err(), Some(Error::Cancelled), "check {at} of {checks}");
            let more = progress.checks.into_inner() - at;
            assert!(more <= MAX_SETS, "{more} checks after the one that cancels, {at} of {checks}");
        }
        let stages = whole.stages.into_inner().unwrap();
        assert_eq!(stages[..3], ["segmenting trials", "estimating the noise", "rejecting outliers"]);
        assert_eq!(stages.last().map(String::as_str), Some("writing the report"));
    }

    /// There is a check for every segment of every pass: more trials, more checks.
    #[test]
    fn checks_grow_with_the_trials() {
        let checks = |trials: u32| {
            let progress = StopAt::new(u64::MAX);
            diagnosed(&throws(trials, 25), &progress).unwrap();
            progress.checks.into_inner()
        };
        let (few, many) = (checks(6), checks(12));
        assert!(2 * many > 3 * few, "{few} checks of 6 trials and {many} of 12");
    }
}
