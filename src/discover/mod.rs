//! What the simulation gets wrong: measured trials in, the named cause, the extended model and its gain out.
//!
//! 1. `window`: trials are cut into windows whose starts are nuisances; `noise`: what no smooth motion explains.
//!    `phase`: which moment velocities seen are of; `trust`: what of the windows can be foreseen and is no outlier.
//! 2. `path` and the engines simulate windows; `model`: residuals and their derivatives; latents are fitted with every
//!    candidate. `base`: the scene as it is, fitted; `expected`: what would be left if only noise were; `steps`: the same
//!    where another engine plays nature.
//! 3. `signs`: whether what is left acts in the same way in trial after trial; `library`: the effect registry as
//!    candidates; `search`: sets of up to three of them, judged by trial (`judge`); `survey`: where starts are known the
//!    whole range of values is searched, since collisions leave no way downhill.
//! 4. `verdict`: what that amounts to. Sets that the data cannot tell apart are reported together (`advise`: what would
//!    separate them); what no set explains is said to be unknown, with a law for it that can be simulated (`law`).
//!    `conclude`: the report; `extend`: the scene with what was found; `evidence`: what pictures show.
//!
//! Sources: multiple shooting (Bock 1983), variable projection (Golub and Pereyra 1973), cluster-robust covariance by the
//! jackknife (Bell and McCaffrey 2002), Holm's correction (1979), sparse regression of dynamics in integral form
//! (Schaeffer and McCalla, Phys. Rev. E 96 (2017) 023302).
//!
//! Differences from the sources: positions are never differentiated; the cluster is the trial; a set must explain the
//! data on trials that it was not fitted to before it is named.

mod advise;
mod base;
mod conclude;
mod evidence;
mod expected;
mod extend;
mod judge;
mod law;
mod library;
mod model;
mod noise;
mod path;
mod phase;
pub mod report;
mod search;
mod signs;
mod stats;
mod steps;
mod survey;
mod trust;
mod verdict;
mod window;

use crate::error::Result;
use crate::progress::Progress;
use crate::reality::Trial;
use crate::task::Scene;
use crate::trajectory::Trajectory;
use crate::world::Engine;
use crate::world::latent::factor_index;
use conclude::{conclude, insufficient};
pub use evidence::{Bounce, Evidence, EvidencePoint, Met, Push};
use expected::{Expected, expected};
use judge::Fitted;
use model::{Data, Layout, State};
use noise::Noise;
pub use report::Diagnosis;
use stats::median;
use window::{Kind, Window};

/// Knobs of a diagnosis.
#[derive(Clone, Debug)]
pub struct Config {
    /// Seed of the draws of signs that say what chance does (`signs`).
    pub seed: u64,
    /// Most effects in a set.
    pub most_effects: usize,
    /// Engine that simulates.
    pub engine: Engine,
}

/// A diagnosis with what it was made from.
pub struct Finding {
    pub diagnosis: Diagnosis,
    /// The scene with the found effects and latents; it rolls out.
    pub extended: Scene,
    pub evidence: Evidence,
}

/// Fewest trials that can be judged at all.
const FEWEST_TRIALS: usize = 4;

/// Added to the reason of a verdict on such data.
const OTHER_STEPS: &str = " (what was measured moves in other time steps than the simulation: velocities were shifted to the \
                           simulation's moments, and contacts are allowed what such steps make of them)";
/// What a contact that restarts cold errs by, m.
const COLD: f64 = 1e-3;

impl Config {
    /// What `iplw diagnose` uses.
    pub fn standard(seed: u64) -> Config {
        Config { seed, most_effects: 3, engine: Engine::Auto }
    }
}

/// Diagnoses a scene from measured trials.
pub fn diagnose(
    scene: &Scene,
    trials: &[Trial],
    config: &Config,
    progress: &dyn Progress,
) -> Result<Finding> {
    scene.validate()?;
    let (names, settings) = settings_of(trials);
    let latents = scene.calibrate.iter().map(|n| factor_index(n)).collect::<Result<Vec<_>>>()?;
    let mut windows = window::cut(scene, trials, &settings);
    let stepping = phase::align(&mut windows, trials, config.engine)?;
    let usable = |windows: &[Window]| {
        (0..trials.len()).filter(|i| windows.iter().any(|w| w.trial == *i && w.kind != Kind::Contact)).count()
    };
    if usable(&windows) < FEWEST_TRIALS {
        let reason = format!(
            "{} of {} trials have a stretch of flight with {} or more observations or a start that is known exactly; at \
             least {FEWEST_TRIALS} are needed to tell an effect from chance",
            usable(&windows),
            trials.len(),
            window::FLIGHT
        );
        return Ok(insufficient(scene, trials, &reason, config));
    }
    // Trials without a window would count as clusters that know nothing.
    let kept: Vec<usize> = (0..trials.len()).filter(|i| windows.iter().any(|w| w.trial == *i)).collect();
    windows.iter_mut().for_each(|w| w.trial = kept.iter().position(|k| *k == w.trial).unwrap_or(0));
    let settings: Vec<usize> = kept.iter().map(|i| settings[*i]).collect();
    let smooths: Vec<&noise::Smooth> = windows.iter().filter_map(|w| w.smooth.as_ref()).collect();
    let flights = noise::noise(&smooths);
    let runs = run_noise(&windows);
    let noise = match (flights, runs) {
        (Some(n), _) => n,
        (None, Some(sd)) => Noise { sd, rho: 0.0, freedom: 1e3 },
        (None, None) => {
            let reason = "too few observations in any stretch to tell noise from motion";
            return Ok(insufficient(scene, trials, reason, config));
        }
    };
    trust::shorten(&mut windows, config.engine)?;
    let sd: Vec<f64> = windows
        .iter()
        .map(|w| if w.kind.simulated() { runs.unwrap_or(noise.sd) } else { noise.sd })
        .collect();
    trust::weed(&mut windows, &sd, kept.len(), &settings, config.engine)?;
    let layout = Layout::new(&latents, Vec::new(), names.len());
    let start = State {
        values: layout.start(&nominal(scene)),
        nuisances: windows.iter().map(|w| w.nuisances.clone()).collect(),
    };
    let observed: Vec<&Trajectory> = kept.iter().map(|i| &trials[*i].observed).collect();
    let seek = |known: Option<(&Layout, &State)>| {
        let (trials, frozen) = (kept.len(), Vec::new());
        let mut data = Data {
            windows: &windows,
            trials,
            settings: &settings,
            sd: sd.clone(),
            frozen,
            engine: config.engine,
            other_steps: stepping.is_some(),
        };
        if let Some(stepping) = stepping {
            let (layout, state) = known.unwrap_or((&layout, &start));
            steps::allow(&mut data, &observed, layout, state, stepping)?;
        }
        progress.report("fitting the base model", 0, 1)?;
        let (state, first) = base::fit(scene, &mut data, &observed, &layout, start.clone(), config.seed)?;
        let expected = expected(&windows, &data.sd, kept.len(), &noise);
        let base = Fitted::new(layout.clone(), state, first, &settings);
        let given = search::Given { expected: &expected, noise: &noise, latents: &latents };
        let found = search::search(scene, data, base, &given, config, progress)?;
        Ok((found, expected))
    };
    let (mut found, mut expected) = seek(None)?;
    if stepping.is_some() {
        // What the other engine's steps make of contacts is known once it is known where things go.
        let best = found.champion.map_or(&found.base, |c| &found.fits[c]);
        (found, expected) = seek(Some((&best.layout, &best.state)))?;
    }
    let judged = search::Judged { names: &names, settings: &settings, noise: &noise, expected: &expected };
    let mut finding = conclude(scene, trials, &windows, &kept, found, &judged, config)?;
    if stepping.is_some() {
        finding.diagnosis.reason += OTHER_STEPS;
    }
    Ok(finding)
}

/// Noise of runs from third differences, which smooth motion and rest leave at nothing; m.
fn run_noise(windows: &[Window]) -> Option<f64> {
    if window::leaping(windows) {
        // Whole states are seen where nothing errs; a contact that goes on at an observation restarts cold.
        return Some(COLD);
    }
    let mut thirds = Vec::new();
    for w in windows.iter().filter(|w| w.kind.simulated()) {
        for body in 0..w.scene.bodies.len() {
            let own: Vec<[f64; 2]> = w.points.iter().filter(|p| p.body == body).map(|p| p.seen).collect();
            for k in own.windows(4) {
                let third =
                    |axis: usize| (k[3][axis] - 3.0 * k[2][axis] + 3.0 * k[1][axis] - k[0][axis]).abs();
                thirds.extend([third(0), third(1)]);
            }
        }
    }
    // Half a millimetre: what two engines that mean the same can differ by.
    (!thirds.is_empty()).then(|| (1.4826 * median(&thirds) / 20f64.sqrt()).max(5e-4))
}

/// The scene's own latents: what its first carrier has.
fn nominal(scene: &Scene) -> [f64; 3] {
    let carrier = scene.bodies.iter().find(|b| scene.carries_latents(&b.name)).unwrap_or(&scene.bodies[0]);
    [carrier.density.unwrap_or(1.0), carrier.friction, carrier.restitution]
}

fn settings_of(trials: &[Trial]) -> (Vec<String>, Vec<usize>) {
    let mut names: Vec<String> = Vec::new();
    let indices = trials
        .iter()
        .map(|t| {
            let name = t.setting.clone().unwrap_or_default();
            names.iter().position(|n| *n == name).unwrap_or_else(|| {
                names.push(name);
                names.len() - 1
            })
        })
        .collect();
    (names, indices)
}
