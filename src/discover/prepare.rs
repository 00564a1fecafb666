//! Trials made ready: cut into windows, with their noise, without those that tell nothing and what cannot be trusted.

use nalgebra::DMatrix;

use super::expected::{Expected, expected};
use super::library;
use super::noise::{self, Noise};
use super::phase::{self, Stepping};
use super::smooth::Smooth;
use super::steps::COLD;
use super::trust;
use super::window::{self, FLIGHT, Kind, Window};
use crate::error::Result;
use crate::progress::Progress;
use crate::reality::Trial;
use crate::task::Scene;
use crate::world::Engine;

/// Fewest trials that can be judged at all.
const FEWEST_TRIALS: usize = 4;
/// What paths of flights are integrated to, as a share of their extent: less is no noise.
const INTEGRATED: f64 = 1e-5;
/// What two engines that mean the same can differ by in the beginning of a trial, m.
const ENGINES: f64 = 5e-4;
/// What noise told by whole trials counts for, as if so many observations had told it.
const KNOWN: f64 = 1e3;

/// What can be diagnosed.
pub struct Ready {
    /// Of the trials kept, by their place among those.
    pub windows: Vec<Window>,
    /// Indices of the trials that the windows are of.
    pub kept: Vec<usize>,
    /// Names of the settings.
    pub names: Vec<String>,
    /// Setting of each trial kept.
    pub settings: Vec<usize>,
    pub noise: Noise,
    /// Scale of the residuals by window, m.
    pub sd: Vec<f64>,
    /// The same of what an engine simulates, m.
    pub simulated: f64,
    /// The windows and besides them the stretches that beginnings of trials show, too; empty where there are no such beginnings.
    pub whole: Vec<Window>,
    /// How what was seen steps, where that is not as the simulation does.
    pub stepping: Option<Stepping>,
    /// What noise alone would leave of the observations.
    pub expected: Expected,
}

impl Ready {
    /// Scale of a window's residuals, m.
    pub fn scale(&self, window: &Window) -> f64 {
        if window.kind.simulated() { self.simulated } else { self.noise.sd }
    }
}

/// Why trials tell nothing, and what to do.
#[derive(Debug)]
pub struct Lack {
    pub reason: String,
    pub action: &'static str,
}

/// Most intervals of a trial's beginning where a law is looked for.
pub const RUN: usize = 8;

/// Trials of a scene made ready, but for those at indices `left_out`, beginnings of `run` intervals at most; or what they lack.
pub fn prepare(
    scene: &Scene,
    trials: &[Trial],
    engine: Engine,
    run: usize,
    left_out: &[usize],
    progress: &dyn Progress,
) -> Result<std::result::Result<Ready, Lack>> {
    let (names, settings) = settings_of(trials);
    let mut windows = window::cut(scene, trials, &settings, run, progress)?;
    windows.retain(|w| !left_out.contains(&w.trial));
    progress.report("estimating the noise", 0, 1)?;
    let stepping = phase::align(&mut windows, trials, engine, progress)?;
    let tells = |i: &usize| windows.iter().any(|w| w.trial == *i && w.kind != Kind::Contact);
    let telling = (0..trials.len()).filter(tells).count();
    if telling < FEWEST_TRIALS {
        return Ok(Err(too_few(telling, trials.len())));
    }
    // Trials without a window would count as clusters that know nothing.
    let kept: Vec<usize> = (0..trials.len()).filter(|i| windows.iter().any(|w| w.trial == *i)).collect();
    windows.iter_mut().for_each(|w| w.trial = kept.iter().position(|k| *k == w.trial).unwrap_or(0));
    let settings: Vec<usize> = kept.iter().map(|i| settings[*i]).collect();
    let runs = run_noise(&windows);
    let Some(noise) = noise_of(&windows, runs, progress)? else { return Ok(Err(no_noise(trials))) };
    // The largest part of a long recording, which nothing needs any more.
    windows.iter_mut().flat_map(|w| &mut w.smooth).for_each(|s| s.basis = DMatrix::zeros(0, 0));
    progress.report("rejecting outliers", 0, 1)?;
    trust::shorten(&mut windows, engine, progress)?;
    let known = windows.iter().any(|w| w.kind == Kind::Run);
    let mut whole = if known { windows.clone() } else { Vec::new() };
    window::leave_runs(&mut windows);
    let simulated = runs.unwrap_or(noise.sd);
    let scale = |w: &Window| if w.kind.simulated() { simulated } else { noise.sd };
    let sd: Vec<f64> = windows.iter().map(scale).collect();
    trust::reject_onset(&mut windows, &sd);
    trust::weed(&mut windows, &sd, &settings, engine, progress)?;
    let expected = expected(&windows, &sd, kept.len(), &noise);
    windows.iter_mut().chain(&mut whole).for_each(window::average);
    Ok(Ok(Ready { windows, kept, names, settings, noise, sd, simulated, whole, stepping, expected }))
}

/// Names of settings in the order in which they come, and the place among them of each trial's.
fn settings_of(trials: &[Trial]) -> (Vec<String>, Vec<usize>) {
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

/// Noise of flights, else that of runs; `None` where neither can be told.
fn noise_of(windows: &[Window], runs: Option<f64>, progress: &dyn Progress) -> Result<Option<Noise>> {
    let smooths: Vec<&Smooth> = windows.iter().filter_map(|w| w.smooth.as_ref()).collect();
    let known = || runs.map(|sd| Noise { sd, rho: 0.0, freedom: KNOWN });
    let own = noise::noise(&smooths, progress)?.or_else(known);
    Ok(own.map(|own| Noise { sd: own.sd.max(finest(windows)), ..own }))
}

/// The least that a flight's positions err by, m.
fn finest(windows: &[Window]) -> f64 {
    let [x0, y0, x1, y1] = library::span(windows).area;
    let extent = (x1 - x0).max(y1 - y0);
    if extent.is_finite() && !window::leaping(windows) { INTEGRATED * extent } else { 0.0 }
}

/// Noise of what an engine simulates, m.
fn run_noise(windows: &[Window]) -> Option<f64> {
    if window::leaping(windows) {
        // Whole states are seen where nothing errs; what a contact bears at an observation is not.
        return Some(COLD);
    }
    let mut series: Vec<Vec<f64>> = Vec::new();
    for w in windows.iter().filter(|w| w.kind.simulated()) {
        for (body, axis) in (0..w.scene.bodies.len()).flat_map(|body| [(body, 0), (body, 1)]) {
            series.push(w.points.iter().filter(|p| p.body == body).map(|p| p.seen[axis]).collect());
        }
    }
    noise::by_thirds(&series).map(|sd| sd.max(ENGINES))
}

fn too_few(telling: usize, trials: usize) -> Lack {
    Lack {
        reason: format!(
            "{telling} of {trials} trials have a stretch of flight with {FLIGHT} or more observations or a start that is known \
             exactly; at least {FEWEST_TRIALS} are needed to tell an effect from chance"
        ),
        action: "measure more trials, each with ten or more observations between contacts",
    }
}

/// What trials lack of which noise cannot be told.
fn no_noise(trials: &[Trial]) -> Lack {
    let still = |values: &[f64]| {
        let mut seen = values.iter().filter(|v| v.is_finite());
        seen.next().is_none_or(|first| seen.all(|v| v == first))
    };
    if trials.iter().flat_map(|t| &t.observed.bodies).all(|b| still(&b.x) && still(&b.y)) {
        return Lack {
            reason: "nothing that was seen ever moves: in every trial each body stays at the place where it was first seen, \
                     which tells nothing of what moves it"
                .into(),
            action: "record bodies as they fly, fall, roll or bounce; if these did, look at which columns were read as positions",
        };
    }
    Lack {
        reason: "too few observations in any stretch to tell noise from motion".into(),
        action: "measure more trials, each with ten or more observations between contacts",
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::discover::fixture::{ball, seen};
    use crate::progress::NoProgress;

    /// A throw with noise of a millimetre, which no smooth motion explains.
    fn throw(rows: u32, number: u32) -> Vec<[f64; 3]> {
        let noise = |k: u32| 1e-3 * 1.414 * libm::sin(f64::from(k * k + 7 * number * k + number));
        let at = |i: u32| {
            let t = 0.02 * f64::from(i);
            [t, 2.0 * t + noise(3 * i), 1.0 + 4.0 * t - 4.905 * t * t + noise(3 * i + 1)]
        };
        (0..rows).map(at).collect()
    }

    fn made(trials: &[Vec<[f64; 3]>]) -> std::result::Result<Ready, Lack> {
        prepare(&ball(), &seen(trials), Engine::Auto, RUN, &[], &NoProgress).unwrap()
    }

    #[test]
    fn trials_that_tell_nothing_are_left_out_and_the_noise_is_told() {
        let mut trials: Vec<_> = (0..6).map(|k| throw(30, k)).collect();
        trials.insert(2, throw(4, 9));
        let ready = made(&trials).unwrap_or_else(|l| panic!("{l:?}"));
        assert_eq!(ready.kept, [0, 1, 3, 4, 5, 6]);
        assert_eq!(ready.windows.iter().map(|w| w.trial).collect::<Vec<_>>(), [0, 1, 2, 3, 4, 5]);
        assert!((0.7e-3..1.4e-3).contains(&ready.noise.sd), "{:?}", ready.noise);
        let few = made(&trials[..4]).err().expect("three throws are too few");
        assert!(few.reason.starts_with("3 of 4 trials"), "{}", few.reason);
    }

    #[test]
    fn what_is_seen_to_less_than_is_integrated_has_no_noise_of_its_own() {
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

    /// Such trials were said to have too few observations, however many they had.
    #[test]
    fn what_never_moves_is_said_to_be_still() {
        for height in [0.05, 1.5] {
            let still: Vec<Vec<[f64; 3]>> = (0..6)
                .map(|k| (0..40).map(|i| [0.02 * f64::from(i), 0.1 * f64::from(k), height]).collect())
                .collect();
            let lack = made(&still).err().expect("nothing moves");
            assert!(lack.reason.starts_with("nothing that was seen ever moves"), "{}", lack.reason);
        }
    }

    #[test]
    fn settings_are_counted_in_the_order_in_which_they_come() {
        let mut trials = seen(&[throw(8, 0), throw(8, 1), throw(8, 2), throw(8, 3)]);
        for (trial, name) in trials.iter_mut().zip(["slow", "fast", "slow"]) {
            trial.setting = Some(name.into());
        }
        let (names, settings) = settings_of(&trials);
        assert_eq!((names.join(","), settings), ("slow,fast,".to_string(), vec![0, 1, 0, 2]));
    }
}
