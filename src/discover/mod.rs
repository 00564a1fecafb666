//! What the simulation gets wrong: measured trials in, the named cause, the extended model and its gain out.
//!
//! 1. Data. `window`: trials are cut into windows whose starts are nuisances; `noise`: what no smooth motion explains.
//!    `phase`: which moment velocities seen are of; `trust`: what of the windows can be foreseen and is no outlier.
//! 2. Models. `path` and the engines simulate windows; `model`: residuals and their derivatives; latents are fitted with every
//!    candidate. `base`: the scene as it is, fitted; `steps`: what another engine's steps make of contacts.
//! 3. Scores. `launch`: what a model leaves of each launch, as a Gaussian of known components; `score`: its predictive
//!    density, told from the other launches; `fit`: a model fitted and scored.
//! 4. Search. `library`: the effect registry as candidates; `search`: sets of up to three of them; `survey`: where starts are
//!    known the whole range of values is searched, since collisions leave no way downhill. `field`: something nobody named.
//! 5. `decide`: which of two models is better, the one place where it is decided; `reason`: what launches may differ by;
//!    `verdict`: what that amounts to.
//! 6. `advise`: what would separate those that tie; `law` and `described`: what no set explains, as terms that can be
//!    simulated; `conclude`: the report, of `sizes`, of `gain` by `expected` and `leave_out`, and in `words`; `by_launch`: what
//!    each launch says; `check`: whether it is as predicted; `band` and `paths`: how far off its path it may be seen;
//!    `picture`: the field of what is left; `extend`: the scene with what was found; `evidence`: what pictures show.
//!
//! Sources: multiple shooting (Bock 1983), variable projection (Golub and Pereyra 1973), model discrepancy as a Gaussian
//! process (Kennedy and O'Hagan 2001), mixed-effects models (Pinheiro and Bates 2000), pseudo-BMA+ (Yao et al. 2018).
//!
//! Differences from the sources: positions are never differentiated; the launch is what is left out, never the sample; the
//! discrepancy is drawn anew for every launch, and what launches share is a rival of its own (`field`).

mod advise;
mod band;
mod base;
mod by_launch;
mod check;
mod conclude;
mod decide;
mod described;
mod evidence;
mod expected;
mod extend;
mod field;
mod fit;
#[cfg(test)]
mod fixture;
mod gain;
mod launch;
mod law;
mod leave_out;
mod library;
mod model;
mod noise;
mod path;
mod paths;
mod phase;
mod picture;
mod reason;
pub mod report;
mod score;
mod search;
mod sizes;
mod stats;
mod steps;
mod survey;
#[cfg(test)]
mod thrown;
mod trust;
mod verdict;
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
pub use evidence::{Bounce, Evidence, EvidencePoint, Met, Push};
use expected::expected;
use fit::Fitter;
use model::{Data, Layout, State};
use noise::Noise;
pub use report::Diagnosis;
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
    let noise = Noise { sd: noise.sd.max(finest(&windows)), ..noise };
    trust::shorten(&mut windows, config.engine)?;
    let sd: Vec<f64> = windows
        .iter()
        .map(|w| if w.kind.simulated() { runs.unwrap_or(noise.sd) } else { noise.sd })
        .collect();
    trust::weed(&mut windows, &sd, &settings, config.engine)?;
    let layout = Layout::new(&latents, Vec::new(), names.len());
    let start = State {
        values: layout.start(&nominal(scene)),
        nuisances: windows.iter().map(|w| w.nuisances.clone()).collect(),
    };
    let observed: Vec<&Trajectory> = kept.iter().map(|i| &trials[*i].observed).collect();
    let expected = expected(&windows, &sd, kept.len(), &noise);
    let mut data = Data::new(&windows, &settings, sd.clone(), config.engine);
    if let Some(stepping) = stepping {
        steps::allow(&mut data, &observed, &layout, &start, stepping)?;
    }
    progress.report("fitting the base model", 0, 1)?;
    let (state, _) = base::fit(scene, &mut data, &observed, &layout, start, config.seed)?;
    let seek = |data: &Data, layout: &Layout, state: State| -> Result<_> {
        let fitter = Fitter::new(data, &noise);
        let base = fitter.refined(layout.clone(), state)?;
        let base = base.ok_or_else(|| Error::Failed("the base model could not be scored".into()))?;
        let hunt = search::Hunt::new(scene, &fitter, &latents, config.seed);
        let found = hunt.search(base, config.most_effects, progress)?;
        let judged = verdict::judge(&fitter, &found)?;
        Ok((found, judged))
    };
    let (mut found, mut judged) = seek(&data, &layout, state)?;
    if let Some(stepping) = stepping {
        // What the other engine's steps make of contacts is known once it is known where things go.
        let best = judged.champion.map_or(&found.base, |c| &found.fits[c]);
        data.sd.clone_from(&sd);
        steps::allow(&mut data, &observed, &best.layout, &best.state, stepping)?;
        let state = found.base.state;
        (found, judged) = seek(&data, &layout, state)?;
    }
    let given =
        Given { scene, trials, data: &data, kept: &kept, names: &names, noise: &noise, expected: &expected };
    let mut finding = conclude(&given, found, &judged, config)?;
    if stepping.is_some() {
        finding.diagnosis.reason += OTHER_STEPS;
    }
    Ok(finding)
}

/// What paths of flights are integrated to, as a share of their extent: less is no noise.
const INTEGRATED: f64 = 1e-5;

/// The least that a flight's positions err by, m.
fn finest(windows: &[Window]) -> f64 {
    let [x0, y0, x1, y1] = library::span(windows).area;
    let extent = (x1 - x0).max(y1 - y0);
    if extent.is_finite() && !window::leaping(windows) { INTEGRATED * extent } else { 0.0 }
}

/// Noise of runs from third differences, which smooth motion and rest leave at nothing; m.
fn run_noise(windows: &[Window]) -> Option<f64> {
    if window::leaping(windows) {
        // Whole states are seen where nothing errs; a contact that goes on at an observation restarts cold.
        return Some(COLD);
    }
    let of = |w: &Window, body: usize, axis: usize| -> Vec<f64> {
        w.points.iter().filter(|p| p.body == body).map(|p| p.seen[axis]).collect()
    };
    let bodies = |w: &&Window| (0..w.scene.bodies.len()).flat_map(|b| [(b, 0), (b, 1)]).collect::<Vec<_>>();
    let runs = windows.iter().filter(|w| w.kind.simulated());
    let series = runs.flat_map(|w| bodies(&w).into_iter().map(move |(b, axis)| of(w, b, axis)));
    // Half a millimetre: what two engines that mean the same can differ by.
    noise::by_thirds(&series.collect::<Vec<_>>()).map(|sd| sd.max(5e-4))
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
