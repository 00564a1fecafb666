//! Preprocessing of trials: segmentation, noise estimate, time alignment, truncation and outlier rejection.

use nalgebra::DMatrix;

use crate::error::Result;
use crate::inference::data::cleaning;
use crate::inference::data::discretisation::COLD_START_SD;
use crate::inference::data::noise::{self, Noise};
use crate::inference::data::smoothing::PolynomialSmooth;
use crate::inference::data::time_alignment::{self, IntegratorMismatch};
use crate::inference::report::UnusedContacts;
use crate::inference::report::expected_rss::{ExpectedRss, expected_rss};
use crate::inference::segment::{self, MIN_FLIGHT_OBSERVATIONS, Segment, SegmentKind, Segmentation};
use crate::inference::selection::candidates;
use crate::progress::Progress;
use crate::reality::Trial;
use crate::task::Scene;
use crate::world::Engine;

/// Minimum number of trials of a diagnosis.
const MIN_TRIALS: usize = 4;
/// Integration error of flights, as a share of their extent; a lower bound of the noise.
const REL_INTEGRATION_ERROR: f64 = 1e-5;
/// Difference between two engines with the same physics at the beginning of a trial, m.
const ENGINE_DIFFERENCE: f64 = 5e-4;
/// Degrees of freedom assigned to a noise estimate from initial segments.
const NOISE_PSEUDO_DOF: f64 = 1e3;

/// Preprocessed data of a diagnosis.
pub struct PreprocessedData {
    /// Segments of the used trials; `trial` is an index into `trial_indices`.
    pub segments: Vec<Segment>,
    /// Indices of the used trials.
    pub trial_indices: Vec<usize>,
    /// Names of the settings.
    pub setting_names: Vec<String>,
    /// Setting of each used trial.
    pub settings: Vec<usize>,
    pub noise: Noise,
    /// Standard deviation of the residuals by segment, m.
    pub sd: Vec<f64>,
    /// Standard deviation for segments that an engine simulates, m.
    pub engine_sd: f64,
    /// Segments before overlap removal and outlier rejection; empty if no trial has an initial segment.
    pub untrimmed: Vec<Segment>,
    /// Integrator mismatch, if there is one.
    pub mismatch: Option<IntegratorMismatch>,
    /// Contacts in no segment.
    pub unused_contacts: Vec<UnusedContacts>,
    /// Why the trials are too few for a verdict, if they are.
    pub few_trials: Option<InsufficientData>,
    /// Expected residual sum of squares of the segments, before averaging.
    pub expected_rss: ExpectedRss,
}

impl PreprocessedData {
    /// The data, if the trials are enough for a verdict.
    pub fn with_enough_trials(mut self) -> std::result::Result<PreprocessedData, InsufficientData> {
        self.few_trials.take().map_or(Ok(self), Err)
    }

    /// Standard deviation of a segment's residuals, m.
    pub fn residual_sd(&self, segment: &Segment) -> f64 {
        if segment.kind.uses_engine() { self.engine_sd } else { self.noise.sd }
    }
}

/// Why the data are insufficient, and the recommended action.
#[derive(Debug)]
pub struct InsufficientData {
    pub reason: String,
    pub action: &'static str,
}

/// Maximum number of intervals of an initial segment in a diagnosis.
pub const MAX_INITIAL_INTERVALS: usize = 8;

/// Preprocesses the trials except those at indices `left_out`, with initial segments of at most `run`
/// intervals; or the reason why they are insufficient even for estimates without a verdict.
pub fn preprocess(
    scene: &Scene,
    trials: &[Trial],
    engine: Engine,
    run: usize,
    left_out: &[usize],
    progress: &dyn Progress,
) -> Result<std::result::Result<PreprocessedData, InsufficientData>> {
    scene.check_without_joints()?;
    let (names, settings) = index_settings(trials);
    let Segmentation { mut segments, unused_contacts } =
        segment::segment_trials(scene, trials, &settings, run, progress)?;
    let unused = unused_contacts.iter().filter(|(trial, _)| !left_out.contains(trial));
    let unused_contacts = segment::counted(unused.map(|(_, reason)| reason.as_str()));
    segments.retain(|w| !left_out.contains(&w.trial));
    progress.report("estimating the noise", 0, 1)?;
    let stepping = time_alignment::align_velocities(&mut segments, trials, engine, progress)?;
    let is_informative = |i: &usize| segments.iter().any(|w| w.trial == *i && !w.kind.is_impact());
    let informative = (0..trials.len()).filter(is_informative).count();
    let few_trials = (informative < MIN_TRIALS).then(|| too_few_trials(informative, trials.len()));
    if informative == 0 {
        return Ok(Err(too_few_trials(informative, trials.len())));
    }
    // Trials without segments are dropped: they would count as uninformative clusters.
    let used: Vec<usize> = (0..trials.len()).filter(|i| segments.iter().any(|w| w.trial == *i)).collect();
    segments.iter_mut().for_each(|w| w.trial = used.iter().position(|k| *k == w.trial).unwrap_or(0));
    let settings: Vec<usize> = used.iter().map(|i| settings[*i]).collect();
    let runs = engine_noise(&segments);
    let Some(noise) = recording_noise(&segments, runs, progress)? else {
        return Ok(Err(noise_not_identifiable(trials)));
    };
    // Polynomials do not describe how sliding ends.
    segments.iter_mut().filter(|w| w.kind == SegmentKind::Sliding).for_each(|w| w.smooth = None);
    // The bases take most of the memory of a long recording and are not used below.
    segments.iter_mut().flat_map(|w| &mut w.smooth).for_each(|s| s.basis = DMatrix::zeros(0, 0));
    progress.report("rejecting outliers", 0, 1)?;
    cleaning::truncate_at_horizon(&mut segments, engine, progress)?;
    let known = segments.iter().any(|w| w.kind == SegmentKind::FromInitialState);
    let mut whole = if known { segments.clone() } else { Vec::new() };
    segment::remove_overlaps(&mut segments);
    let simulated = runs.unwrap_or(noise.sd);
    let scale = |w: &Segment| if w.kind.uses_engine() { simulated } else { noise.sd };
    let sd: Vec<f64> = segments.iter().map(scale).collect();
    cleaning::reject_onset(&mut segments, &sd);
    cleaning::reject_outliers(&mut segments, &sd, &settings, engine, progress)?;
    let expected_rss = expected_rss(&segments, &sd, used.len(), &noise, progress)?;
    for segment in segments.iter_mut().chain(&mut whole) {
        progress.check_stop()?;
        segment::average_blocks(segment);
    }
    Ok(Ok(PreprocessedData {
        segments,
        trial_indices: used,
        setting_names: names,
        settings,
        noise,
        sd,
        engine_sd: simulated,
        untrimmed: whole,
        mismatch: stepping,
        unused_contacts,
        few_trials,
        expected_rss,
    }))
}

/// Names of the settings in order of appearance, and the index of each trial's setting.
pub fn index_settings(trials: &[Trial]) -> (Vec<String>, Vec<usize>) {
    let mut names: Vec<String> = Vec::new();
    let place = |t: &Trial| {
        let name = t.setting.clone().unwrap_or_default();
        names.iter().position(|n| *n == name).unwrap_or_else(|| {
            names.push(name);
            names.len() - 1
        })
    };
    let settings = trials.iter().map(place).collect();
    (names, settings)
}

/// Noise of flights, otherwise of initial segments; `None` if neither can be estimated.
fn recording_noise(
    segments: &[Segment],
    runs: Option<f64>,
    progress: &dyn Progress,
) -> Result<Option<Noise>> {
    let smooths: Vec<&PolynomialSmooth> = segments.iter().filter_map(|w| w.smooth.as_ref()).collect();
    let known = || runs.map(|sd| Noise { sd, rho: 0.0, degrees_of_freedom: NOISE_PSEUDO_DOF });
    let own = noise::estimate_noise(&smooths, progress)?.or_else(known);
    Ok(own.map(|own| Noise { sd: own.sd.max(integration_noise_floor(segments)), ..own }))
}

/// Lower bound of the noise from the integration error, m.
fn integration_noise_floor(segments: &[Segment]) -> f64 {
    let [x0, y0, x1, y1] = candidates::data_range(segments).area;
    let extent = (x1 - x0).max(y1 - y0);
    if extent.is_finite() && !segment::any_one_step(segments) { REL_INTEGRATION_ERROR * extent } else { 0.0 }
}

/// Noise of segments that an engine simulates, m.
fn engine_noise(segments: &[Segment]) -> Option<f64> {
    if segment::any_one_step(segments) {
        // Fully observed states have no measurement noise, but contact forces at an observation are unknown.
        return Some(COLD_START_SD);
    }
    let mut series: Vec<Vec<f64>> = Vec::new();
    for w in segments.iter().filter(|w| w.kind.uses_engine()) {
        for (body, axis) in (0..w.scene.bodies.len()).flat_map(|body| [(body, 0), (body, 1)]) {
            series.push(w.observations.iter().filter(|p| p.body == body).map(|p| p.position[axis]).collect());
        }
    }
    noise::third_difference_noise(&series).map(|sd| sd.max(ENGINE_DIFFERENCE))
}

fn too_few_trials(informative: usize, trials: usize) -> InsufficientData {
    InsufficientData {
        reason: format!(
            "{informative} of {trials} trials have a stretch of flight with {MIN_FLIGHT_OBSERVATIONS} or more observations or a start that is known \
             exactly; at least {MIN_TRIALS} are needed to tell an effect from chance"
        ),
        action: "measure more trials, each with ten or more observations between contacts",
    }
}

/// The reason why the noise cannot be estimated.
fn noise_not_identifiable(trials: &[Trial]) -> InsufficientData {
    let still = |values: &[f64]| {
        let mut seen = values.iter().filter(|v| v.is_finite());
        seen.next().is_none_or(|first| seen.all(|v| v == first))
    };
    if trials.iter().flat_map(|t| &t.observed.bodies).all(|b| still(&b.x) && still(&b.y)) {
        return InsufficientData {
            reason: "nothing that was seen ever moves: in every trial each body stays at the place where it was first seen, \
                     which tells nothing of what moves it"
                .into(),
            action: "record bodies as they fly, fall, roll or bounce; if these did, look at which columns were read as positions",
        };
    }
    InsufficientData {
        reason: "too few observations in any stretch to tell noise from motion".into(),
        action: "measure more trials, each with ten or more observations between contacts",
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::inference::testing::segments::{ball, observed_trials};
    use crate::progress::NoProgress;

    /// A throw with a noise of 1 mm.
    fn throw(rows: u32, number: u32) -> Vec<[f64; 3]> {
        let noise = |k: u32| 1e-3 * 1.414 * libm::sin(f64::from(k * k + 7 * number * k + number));
        let at = |i: u32| {
            let t = 0.02 * f64::from(i);
            [t, 2.0 * t + noise(3 * i), 1.0 + 4.0 * t - 4.905 * t * t + noise(3 * i + 1)]
        };
        (0..rows).map(at).collect()
    }

    fn made(trials: &[Vec<[f64; 3]>]) -> std::result::Result<PreprocessedData, InsufficientData> {
        preprocess(&ball(), &observed_trials(trials), Engine::Auto, MAX_INITIAL_INTERVALS, &[], &NoProgress)
            .unwrap()
    }

    #[test]
    fn uninformative_trials_are_dropped() {
        let mut trials: Vec<_> = (0..6).map(|k| throw(30, k)).collect();
        trials.insert(2, throw(4, 9));
        let ready = made(&trials).unwrap_or_else(|l| panic!("{l:?}"));
        assert_eq!(ready.trial_indices, [0, 1, 3, 4, 5, 6]);
        assert_eq!(ready.segments.iter().map(|w| w.trial).collect::<Vec<_>>(), [0, 1, 2, 3, 4, 5]);
        assert!((0.7e-3..1.4e-3).contains(&ready.noise.sd), "{:?}", ready.noise);
        let few = made(&trials[..4]).and_then(PreprocessedData::with_enough_trials);
        let few = few.err().expect("three throws are too few");
        assert!(few.reason.starts_with("3 of 4 trials"), "{}", few.reason);
    }

    #[test]
    fn integration_error_bounds_the_noise() {
        let exact = |k: u32| {
            let at = |i: u32| {
                let t = 0.02 * f64::from(i);
                [t, 2.0 * t, 1.0 + (3.0 + 0.1 * f64::from(k)) * t - 4.905 * t * t]
            };
            (0..30).map(at).collect::<Vec<_>>()
        };
        let ready = made(&(0..5).map(exact).collect::<Vec<_>>()).unwrap_or_else(|l| panic!("{l:?}"));
        assert!((1e-5..2e-5).contains(&ready.noise.sd), "{:?} where paths are 1.2 m long", ready.noise);
    }

    /// Regression test: immobile bodies were reported as having too few observations.
    #[test]
    fn immobile_bodies_are_reported() {
        for height in [0.05, 1.5] {
            let still: Vec<Vec<[f64; 3]>> = (0..6)
                .map(|k| (0..40).map(|i| [0.02 * f64::from(i), 0.1 * f64::from(k), height]).collect())
                .collect();
            let lack = made(&still).err().expect("nothing moves");
            assert!(lack.reason.starts_with("nothing that was seen ever moves"), "{}", lack.reason);
        }
    }

    #[test]
    fn settings_are_indexed_by_first_appearance() {
        let mut trials = observed_trials(&[throw(8, 0), throw(8, 1), throw(8, 2), throw(8, 3)]);
        for (trial, name) in trials.iter_mut().zip(["slow", "fast", "slow"]) {
            trial.setting = Some(name.into());
        }
        let (names, settings) = index_settings(&trials);
        assert_eq!((names.join(","), settings), ("slow,fast,".to_string(), vec![0, 1, 0, 2]));
    }
}
