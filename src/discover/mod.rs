//! What the simulation gets wrong: measured trials in, the named cause, the extended model and its gain out.
//!
//! 1. `window`: trials are cut into windows whose starts are nuisances; `noise`: what no smooth motion explains.
//! 2. `path` and the engines simulate windows; `model`: residuals and their derivatives; latents are fitted with every
//!    candidate.
//! 3. `signs`: whether what is left acts in the same way in trial after trial; `library`: the effect registry as
//!    candidates; `search`: sets of up to three of them, judged by trial (`judge`); `survey`: where starts are known the
//!    whole range of values is searched, since collisions leave no way downhill.
//! 4. Sets that the data cannot tell apart are reported together (`advise`: what would separate them); what no set
//!    explains is said to be unknown, with a law for it that can be simulated (`law`). `evidence`: what pictures show.
//!
//! Sources: multiple shooting (Bock 1983), variable projection (Golub and Pereyra 1973), cluster-robust covariance by the
//! jackknife (Bell and McCaffrey 2002), Holm's correction (1979), sparse regression of dynamics in integral form
//! (Schaeffer and McCalla, Phys. Rev. E 96 (2017) 023302).
//!
//! Differences from the sources: positions are never differentiated; the cluster is the trial; a set must explain the
//! data on trials that it was not fitted to before it is named.

mod advise;
mod evidence;
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
mod survey;
mod window;

use crate::error::Result;
use crate::progress::Progress;
use crate::reality::Trial;
use crate::task::Scene;
use crate::task::scene::EffectTerm;
use crate::trajectory::Track;
use crate::world::Engine;
use crate::world::latent::{FACTORS, factor_index};
pub use evidence::{Bounce, Evidence, EvidencePoint, Met, Push};
use judge::Fitted;
use model::{Data, Layout, State};
use noise::{Noise, Slow, expected_squares};
pub use report::Diagnosis;
use report::{
    Calibrated, FoundEffect, FoundParameter, Gain, HeldOut, LawTerm, NextExperiment, Residual, ResidualLaw,
    Verdict,
};
use stats::{f_above, mean_error, median, normal_above, t_above};
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
/// p below which a lack of fit counts.
const MISFIT: f64 = 0.01;
/// The same where no effect was found: to call physics unknown takes more than one odd trial.
const UNKNOWN: f64 = 0.002;
/// Share of the base's excess that may remain under a named set, and the same where slow residuals are sure of it.
const REMAINS: f64 = 0.05;
const REMAINS_SURELY: f64 = 0.02;
/// p below which slow residuals say that a set leaves something (it is ten times smaller than it says, since the trials
/// that are furthest off are left out of account), and the share of trials, the furthest off, that have no
/// say in it.
const SLOW: f64 = 0.04;
const ODD: f64 = 0.1;
/// Effects that push against the velocity.
const DRAGS: [&str; 3] = ["linear_drag", "quadratic_drag", "moving_air"];
/// Excess of the middle trial, as a share of the floor, below which the excess of all is that of a few.
const USUAL: f64 = 0.15;
/// Excess below this share of the noise floor (mean square) is too small to speak of.
const SLIGHT: f64 = 0.03;

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
    phase::align(&mut windows, trials, config.engine)?;
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
    let base_latents = nominal(scene);
    trust(&mut windows, config.engine)?;
    let sd: Vec<f64> = windows
        .iter()
        .map(|w| if w.kind.simulated() { runs.unwrap_or(noise.sd) } else { noise.sd })
        .collect();
    weed(&mut windows, &sd, kept.len(), &settings, config)?;
    let mut data = Data {
        windows: &windows,
        trials: kept.len(),
        settings: &settings,
        sd,
        frozen: Vec::new(),
        engine: config.engine,
    };
    let layout = Layout::new(&latents, Vec::new(), names.len());
    let start = State {
        values: layout.start(&base_latents),
        nuisances: windows.iter().map(|w| w.nuisances.clone()).collect(),
    };
    progress.report("fitting the base model", 0, 1)?;
    let (mut state, mut first) = begin(&mut data, trials, &kept, &layout, start, config.seed)?;
    for start in rougher(&layout, &state, &windows) {
        // A contact that grips as simulated says nothing of a friction at which it would slide.
        let (other, pass) = model::fit(&data, &layout, start, 8)?;
        if model::total(&pass) < model::total(&first) {
            (state, first) = (other, pass);
        }
    }
    let blur = blur(scene, &data, &latents, names.len(), &state, &first)?;
    for (w, window) in windows.iter().enumerate() {
        if window.kind == Kind::Contact {
            data.sd[w] *= blur;
        }
    }
    let (state, first) = model::fit(&data, &layout, state, 6)?;
    let expected = expected(&windows, &data.sd, kept.len(), &noise);
    let base = Fitted::new(layout, state, first, &settings);
    let given = search::Given { expected: &expected, noise: &noise, latents: &latents };
    let found = search::search(scene, data, base, &given, config, progress)?;
    let judged = search::Judged { names: &names, settings: &settings, noise: &noise, expected: &expected };
    conclude(scene, trials, &windows, &kept, found, &judged, config)
}

/// The same state at other frictions, where friction is to be found from contacts of one disc.
fn rougher(layout: &Layout, state: &State, windows: &[Window]) -> Vec<State> {
    let wanted = |l: usize| FACTORS[l].name == "friction";
    let slot = layout.slots.iter().position(|s| matches!(s.what, model::What::Latent(l) if wanted(l)));
    let Some(slot) = slot.filter(|_| windows.iter().any(|w| w.kind == Kind::Contact)) else {
        return Vec::new();
    };
    let at = |friction: f64| {
        let mut other = state.clone();
        other.values[slot] = friction;
        other
    };
    vec![at(0.1), at(0.25)]
}

/// Expected sum of squares by trial, and its variance, if only noise were left; units of the noise.
pub(crate) struct Expected {
    pub mean: Vec<f64>,
    /// Sum of squares that contact windows leave in all trials, if contacts are as good as the usual one.
    pub contacts: f64,
    pub variance: Vec<f64>,
    /// Number of coordinates by trial.
    pub coordinates: Vec<f64>,
    /// Relative error of the noise's own variance.
    pub floor_error: f64,
    /// Slow parts of flights' residuals, by window, and the scale of those, m.
    slow: Vec<Option<(Slow, f64)>>,
}

impl Expected {
    /// Sum over trials, contacts and all.
    pub fn total(&self) -> f64 {
        self.mean.iter().sum::<f64>() + self.contacts
    }

    /// [`Expected::misfit`] of a fit, by its flights and runs: what a contact leaves is not what noise leaves.
    pub fn misfit_of(&self, fit: &Fitted, windows: &[Window]) -> (f64, f64) {
        let mut squares = vec![0.0; self.mean.len()];
        for (w, window) in windows.iter().enumerate().filter(|(_, w)| w.kind != Kind::Contact) {
            squares[window.trial] += fit.pass.squares[w];
        }
        self.misfit(&squares)
    }

    /// How far the middle trial's flights and runs are above the floor, as a share of it.
    pub fn middle_excess(&self, fit: &Fitted, windows: &[Window]) -> f64 {
        let mut squares = vec![0.0; self.mean.len()];
        for (w, window) in windows.iter().enumerate().filter(|(_, w)| w.kind != Kind::Contact) {
            squares[window.trial] += fit.pass.squares[w];
        }
        let shares: Vec<f64> = squares.iter().zip(&self.mean).map(|(s, m)| (s - m) / m.max(1.0)).collect();
        median(&shares).max(0.0)
    }

    /// Excess over the floor as a share of it; the same in its standard deviations if the noise is what it is taken for;
    /// p by trial.
    pub fn above(&self, fit: &Fitted, windows: &[Window]) -> (f64, f64, f64) {
        let (excess, p) = self.misfit_of(fit, windows);
        let all: f64 = self.mean.iter().sum();
        let deviation = (self.variance.iter().sum::<f64>() + (all * self.floor_error).powi(2)).sqrt();
        // One trial with a missed outlier must not speak for all, unless nothing can be an outlier.
        let usual =
            if window::leaping(windows) || self.middle_excess(fit, windows) > USUAL { excess } else { 0.0 };
        (usual, usual * all / deviation.max(1e-9), p)
    }

    /// Squares that flights' slow parts hold above what noise leaves there, and p of there being none: against the noise
    /// that fast parts show, not against other trials. What acts at one place or time in few trials shows here and not in
    /// what trials have in common. The trials that are furthest off do not count: they may have something of their own.
    pub fn slow_misfit(&self, fit: &Fitted, windows: &[Window], unit: f64) -> (f64, f64) {
        let trials = self.mean.len();
        // squares, mean, variance by trial
        let mut sums = vec![[0.0; 3]; trials];
        for (w, window) in windows.iter().enumerate() {
            if let Some((slow, sd)) = &self.slow[w] {
                let own = &mut sums[window.trial];
                own[0] += slow.square(&fit.pass.residuals[w]) / (sd * sd);
                own[1] += slow.mean;
                own[2] += slow.variance;
            }
        }
        sums.retain(|s| s[1] > 0.0);
        sums.sort_by(|a, b| (a[0] / a[1]).total_cmp(&(b[0] / b[1])));
        let all: f64 = sums.iter().map(|s| s[1]).sum();
        sums.truncate(sums.len() - (sums.len() as f64 * ODD).ceil() as usize);
        let total = |k: usize| sums.iter().map(|s| s[k]).sum::<f64>();
        let taken = fit.layout.slots.len() as f64 * unit * total(1) / all.max(1e-9);
        let mean = total(1) - taken;
        if mean <= 0.0 {
            return (0.0, 1.0);
        }
        let freedom = 2.0 * total(1).powi(2) / total(2).max(1e-9);
        let p = f_above(total(0) / mean, freedom, 2.0 / self.floor_error.powi(2));
        ((total(0) - mean).max(0.0), p)
    }

    /// Excess over the floor as a share of it, and the one-sided p, by trial, of the hypothesis that there is none.
    fn misfit(&self, squares: &[f64]) -> (f64, f64) {
        let excess: Vec<f64> = squares.iter().zip(&self.mean).map(|(s, m)| s - m).collect();
        let g = excess.len() as f64;
        let (mean, error) = mean_error(&excess);
        let expected_error = self.variance.iter().sum::<f64>().sqrt() / g;
        let all = self.mean.iter().sum::<f64>();
        let floor = all / g * self.floor_error;
        let se = (error.max(expected_error).powi(2) + floor * floor).sqrt();
        (mean * g / all.max(1e-9), t_above(mean / se.max(1e-12), g - 1.0))
    }
}

fn slow(window: &Window, rho: f64) -> Option<Slow> {
    let smooth = window.smooth.as_ref().filter(|_| window.kind == Kind::Flight)?;
    let times: Vec<f64> = window.points.iter().map(|p| p.time).collect();
    let weights: Vec<f64> = window.points.iter().map(|p| p.weight).collect();
    Slow::new(&times, &weights, smooth.axes, rho.max(0.0))
}

fn expected(windows: &[Window], sd: &[f64], trials: usize, noise: &Noise) -> Expected {
    let mut out = Expected {
        mean: vec![0.0; trials],
        contacts: 0.0,
        variance: vec![0.0; trials],
        coordinates: vec![0.0; trials],
        floor_error: noise.floor_error(),
        slow: windows.iter().zip(sd).map(|(w, sd)| Some((slow(w, noise.rho)?, *sd))).collect(),
    };
    for (w, _) in windows.iter().zip(sd).filter(|(_, sd)| sd.is_finite()) {
        let n = w.points.iter().filter(|p| p.weight > 0.0).count() as f64;
        let axes = w.smooth.as_ref().map_or(2.0, |s| s.axes);
        let (mean, variance) = match w.kind {
            Kind::Flight | Kind::Roll => {
                let times: Vec<f64> = w.points.iter().map(|p| p.time).collect();
                let weights: Vec<f64> = w.points.iter().map(|p| p.weight).collect();
                expected_squares(&times, &weights, axes, noise.rho)
            }
            Kind::Contact => {
                out.contacts += 2.0 * n - 5.0;
                out.coordinates[w.trial] += 2.0 * n;
                continue;
            }
            Kind::Run | Kind::Leap | Kind::Shot => {
                let left = (2.0 * n - w.nuisances.len() as f64).max(1.0);
                (left, 2.0 * left)
            }
        };
        out.mean[w.trial] += mean.max(0.0);
        out.variance[w.trial] += variance;
        out.coordinates[w.trial] += axes * n;
    }
    out
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

/// How far contacts repeat, in units of the noise: what the usual bounce leaves when every law of contact helps.
fn blur(
    scene: &Scene,
    data: &Data,
    latents: &[usize],
    settings: usize,
    state: &State,
    base: &model::Pass,
) -> Result<f64> {
    let contact = |w: &Window| w.kind == Kind::Contact;
    if !data.windows.iter().any(contact) {
        return Ok(1.0);
    }
    let laws = library::candidates(scene, &library::span(data.windows)).into_iter();
    let terms: Vec<model::Term> = laws
        .filter(|(e, _)| e.acts_on == "contact")
        .filter_map(|(_, starts)| starts.into_iter().next())
        .collect();
    let layout = Layout::new(latents, terms, settings);
    let mut values = layout.start(&[0.0; 3]);
    values[..state.values.len()].copy_from_slice(&state.values);
    let start = State { values, nuisances: state.nuisances.clone() };
    let (_, helped) = model::fit(data, &layout, start, 8)?;
    let usual = |pass: &model::Pass| {
        let contacts = (0..data.windows.len()).filter(|w| contact(&data.windows[*w]));
        let left = |w: usize| (2.0 * data.windows[w].points.len() as f64 - 5.0).max(1.0);
        median(&contacts.map(|w| pass.squares[w] / left(w)).collect::<Vec<_>>())
    };
    Ok(usual(&helped).min(usual(base)).max(1.0).sqrt())
}

/// What a contact that restarts cold errs by, m.
const COLD: f64 = 1e-3;
/// Square of a shot's residual, over what noise leaves, beyond which its collisions went another way than simulated.
const ASTRAY: f64 = 30.0;

/// Fits the base model. Shots try several guesses of their starts first; those that stay far off are left out for good.
fn begin(
    data: &mut Data,
    trials: &[Trial],
    kept: &[usize],
    layout: &Layout,
    start: State,
    seed: u64,
) -> Result<(State, model::Pass)> {
    let mut state = start;
    if data.windows.iter().any(|w| w.kind == Kind::Shot) {
        let mut best: Vec<f64> = vec![f64::INFINITY; data.windows.len()];
        let mut chosen = state.clone();
        for way in 0..3 {
            let mut tried = state.clone();
            for (w, window) in data.windows.iter().enumerate().filter(|(_, w)| w.kind == Kind::Shot) {
                let observed = &trials[kept[window.trial]].observed;
                let Some(at) = observed.times.iter().position(|t| *t == window.start) else { continue };
                let of = |b| window::launch(b, &observed.times, at, window.scene.gravity, way);
                tried.nuisances[w] = observed.bodies.iter().flat_map(of).collect();
            }
            // One step shows how near each guess comes.
            let (tried, pass) = model::fit(data, layout, tried, 1)?;
            for (w, square) in pass.squares.iter().enumerate() {
                if *square < best[w] {
                    best[w] = *square;
                    chosen.nuisances[w].clone_from(&tried.nuisances[w]);
                }
            }
        }
        state.nuisances = chosen.nuisances;
    }
    if survey::possible(data, layout) {
        state = survey::survey(data, layout, &state, seed)?;
    }
    let (state, pass) = model::fit(data, layout, state, 8)?;
    if data.windows.iter().any(|w| w.kind == Kind::Shot) {
        for (w, window) in data.windows.iter().enumerate().filter(|(_, w)| w.kind == Kind::Shot) {
            let left = (2.0 * window.points.len() as f64 - window.nuisances.len() as f64).max(1.0);
            if pass.squares[w] > ASTRAY * left {
                data.sd[w] = f64::INFINITY;
            }
        }
        model::freeze(data, layout, &state)?;
        return model::fit(data, layout, state, 4);
    }
    Ok((state, pass))
}

/// Takes outliers at the ends of flights out, by what nothing but gravity leaves.
fn weed(
    windows: &mut [Window],
    sd: &[f64],
    trials: usize,
    settings: &[usize],
    config: &Config,
) -> Result<()> {
    let flights: Vec<usize> = (0..windows.len()).filter(|w| windows[*w].kind == Kind::Flight).collect();
    let own: Vec<Window> = flights.iter().map(|w| windows[*w].clone()).collect();
    let data = Data {
        windows: &own,
        trials,
        settings,
        sd: flights.iter().map(|w| sd[*w]).collect(),
        frozen: Vec::new(),
        engine: config.engine,
    };
    let layout = Layout::new(&[], Vec::new(), 1);
    let start = State { values: Vec::new(), nuisances: own.iter().map(|w| w.nuisances.clone()).collect() };
    let (_, left) = model::fit(&data, &layout, start, 3)?;
    for (k, w) in flights.into_iter().enumerate() {
        let times: Vec<f64> = own[k].points.iter().map(|p| p.time).collect();
        for i in noise::spikes(&times, &left.residuals[k], sd[w]) {
            windows[w].points[i].weight = 0.0;
        }
    }
    Ok(())
}

/// Growth of a start's error beyond which a run is no longer trusted.
const GROWTH: f64 = 100.0;

/// Ends runs where the start's smallest error would show.
fn trust(windows: &mut [Window], engine: Engine) -> Result<()> {
    for window in windows.iter_mut().filter(|w| w.kind == Kind::Run) {
        let mut scenes = vec![window.scene.clone()];
        for body in 0..window.scene.bodies.len() {
            let mut moved = window.scene.clone();
            if let Some(p) = &mut moved.bodies[body].position {
                p[0] += 1e-7;
            }
            scenes.push(moved);
        }
        let rollouts: Vec<crate::world::Rollout> = scenes
            .iter()
            .map(|scene| crate::world::Rollout {
                scene,
                latents: Default::default(),
                effects: &[],
                stop: false,
            })
            .collect();
        let paths = crate::world::simulate(&rollouts, engine)?;
        let off = |a: &Track, b: &Track, i: usize| (a.x[i] - b.x[i]).hypot(a.y[i] - b.y[i]);
        let times = &paths[0].times;
        let until = (0..times.len())
            .find(|i| {
                paths[1..].iter().any(|p| {
                    p.bodies
                        .iter()
                        .zip(&paths[0].bodies)
                        .any(|(a, b)| *i < a.len() && off(a, b, *i) > GROWTH * 1e-7)
                })
            })
            .map_or(f64::INFINITY, |i| times[i]);
        let least = window.points.get(window.scene.bodies.len()).map_or(0.0, |p| p.time);
        window.points.retain(|p| p.time < until.max(least + 1e-9));
        let last = window.points.last().map_or(0.0, |p| p.time);
        let steps =
            (last / window.scene.time_step).round() as u32 + u32::from(window.scene.observe_every == 1);
        window.scene.steps = steps.clamp(1, window.scene.steps);
    }
    Ok(())
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

fn insufficient(scene: &Scene, trials: &[Trial], reason: &str, config: &Config) -> Finding {
    let diagnosis = Diagnosis {
        format: report::FORMAT,
        verdict: Verdict::InsufficientData,
        reason: reason.to_string(),
        effects: Vec::new(),
        rivals: Vec::new(),
        calibrated: Vec::new(),
        residual: Residual {
            base_rmse: 0.0,
            floor_rmse: 0.0,
            lack_of_fit_p: 1.0,
            whiteness_p: 1.0,
            autocorrelation: 0.0,
            noise_correlation: 0.0,
        },
        gain: Gain::default(),
        unexplained_share: None,
        residual_law: None,
        next_experiment: Some(NextExperiment {
            why: reason.to_string(),
            action: "measure more trials, each with ten or more observations between contacts".into(),
            separates: Vec::new(),
            scene: None,
        }),
        considered: Vec::new(),
        seed: config.seed,
    };
    let mut extended = scene.clone();
    if let Some(trial) = trials.first() {
        place(&mut extended, &trial.scene, None);
    }
    Finding { diagnosis, extended, evidence: Evidence::default() }
}

/// Gives every body of `scene` a start: `from`'s, and for the only body of a window its fitted one.
fn place(scene: &mut Scene, from: &Scene, fitted: Option<(&str, &[f64])>) {
    for body in &mut scene.bodies {
        if let Some(start) = from.body(&body.name) {
            body.position = body.position.or(start.position).or(Some([0.0, 0.0]));
            if body.velocity == [0.0, 0.0] {
                body.velocity = start.velocity;
            }
        }
        if let Some((name, [x, y, vx, vy, ..])) = fitted
            && body.name == name
        {
            (body.position, body.velocity) = (Some([*x, *y]), [*vx, *vy]);
        }
    }
}

/// Turns what was found into a report.
fn conclude(
    scene: &Scene,
    trials: &[Trial],
    windows: &[Window],
    kept: &[usize],
    found: search::Found,
    judged: &search::Judged,
    config: &Config,
) -> Result<Finding> {
    let search::Found { base, base_lack, fits, lacks, champion, rivals, considered, data } = found;
    let (names, settings, noise, expected) = (judged.names, judged.settings, judged.noise, judged.expected);
    let (base_excess, base_p) = expected.misfit_of(&base, windows);
    let best = champion.map(|c| &fits[c]);
    let model = best.unwrap_or(&base);
    let (left_excess, left_p) = expected.misfit_of(model, windows);
    let base_lack_p = base_lack.tested.p;
    let lack = champion.and_then(|c| lacks[c].as_ref()).unwrap_or(&base_lack);
    let sure_of_base = base_lack.sure().max(base_excess * expected.total());
    // What is left: by the noise floor, or by what could be added in trial after trial.
    // Shots that went astray lie far above any floor, whatever the model.
    let shots = windows.iter().any(|w| w.kind == Kind::Shot);
    let by_floor = if !shots && left_p < MISFIT && left_excess > SLIGHT {
        left_excess / base_excess.max(1e-9)
    } else {
        0.0
    };
    let by_signs = if lack.tested.p < MISFIT || lack.is_much(expected.total()) {
        lack.sure() / sure_of_base.max(1e-9)
    } else {
        0.0
    };
    let unexplained = (base_excess > SLIGHT).then(|| (left_excess / base_excess).clamp(0.0, 1.0));
    let far = |f: &Fitted| !shots && search::far(expected.above(f, windows));
    let much = |l: &search::Lack| l.is_much(expected.total());

    let (slow, slow_p) = expected.slow_misfit(model, windows, noise.unit());
    let (base_slow, base_slow_p) = expected.slow_misfit(&base, windows, noise.unit());
    let (astray, base_astray) = (model::astray(windows, &model.pass), model::astray(windows, &base.pass));
    let misfit = base_astray >= search::SEVERAL
        || (base_lack_p < UNKNOWN && (base_excess > SLIGHT || !window::leaping(windows)))
        || far(&base)
        || much(&base_lack)
        || (!shots && base_slow_p < search::PLAIN);
    let by_slow = slow / base_slow.max(sure_of_base).max(1e-9);
    let remains = ((lack.tested.p < MISFIT || far(model) || much(lack)) && by_floor.max(by_signs) > REMAINS)
        || (astray >= search::SEVERAL && astray as f64 > REMAINS * base_astray as f64)
        || (!shots && slow_p < SLOW && by_slow > REMAINS)
        || (!shots && slow_p < search::PLAIN && by_slow > REMAINS_SURELY);
    let (verdict, reason) = match best {
        None if !misfit => (Verdict::None, "the base model explains the data to its noise floor".to_string()),
        None => (
            Verdict::Unknown,
            "there is misfit, and no set in the library explains it on held-out trials".into(),
        ),
        Some(_) if remains => (
            Verdict::Unknown,
            format!(
                "the best set in the library leaves {:.0} % of the excess error",
                100.0 * unexplained.unwrap_or(0.0)
            ),
        ),
        Some(f) if rivals.len() > 1 => {
            let drags = |i: &usize| fits[*i].names().iter().any(|n| DRAGS.contains(n));
            let against = match rivals.iter().all(drags) {
                true => "a force against the velocity, its law not identified: ",
                false => "",
            };
            let reason = format!(
                "{against}{} sets explain the data equally well; {} is the simplest",
                rivals.len(),
                f.names().join(" + ")
            );
            (Verdict::Ambiguous, reason)
        }
        Some(f) => {
            (Verdict::Named, format!("{} explains the data to its noise floor", f.names().join(" + ")))
        }
    };
    let coordinates: f64 = expected.coordinates.iter().sum();
    let rmse = |squares: f64| noise.sd * (squares.max(0.0) / coordinates.max(1.0)).sqrt();
    let held = |f: &Fitted| f.held.iter().sum::<f64>();
    let (autocorrelation, whiteness_p) = whiteness(windows, &base);
    let law = if verdict == Verdict::Unknown { described(&data, model, noise, names.len())? } else { None };
    // What goes without a name is an extension all the same, if it holds on other trials.
    let helps = |l: &&Fitted| judge::paired(&model.held, &l.held).1 > 1.0;
    let helpful = law.as_ref().filter(helps);
    let shown = helpful.unwrap_or(model);
    let evidence = evidence::evidence(&data, &base, shown, names)?;
    let extended = extend(scene, trials, windows, kept, shown);
    let rival_names = |i: &usize| fits[*i].names().iter().map(|n| n.to_string()).collect::<Vec<_>>();
    let next = advise::next(scene, windows, &fits, &rivals, verdict, noise, config)?;
    let latents = base.layout.latents();
    let calibrated = (0..latents)
        .map(|i| {
            let slot = &shown.layout.slots[i];
            let factor = match slot.what {
                model::What::Latent(l) => &FACTORS[l],
                model::What::Parameter(..) => unreachable!("latents come first in a layout"),
            };
            let half = shown.half_width(i, settings, noise.unit());
            let told: f64 = shown.pass.trials.iter().map(|t| t.gram[(i, i)]).sum();
            let width = slot.bounds[1] - slot.bounds[0];
            let identifiable = half.is_finite() && half < 0.25 * width.min(4.0) && told > 10.0 * slot.ridge();
            let value = shown.state.values[i];
            let end = |v: f64| identifiable.then(|| v.clamp(slot.bounds[0], slot.bounds[1]));
            Calibrated {
                name: factor.name.into(),
                value,
                ci95: [end(value - half), end(value + half)],
                identifiable,
            }
        })
        .collect();
    let gain_of = |b: f64, e: f64, floor: f64, count: f64, trials: usize| HeldOut {
        trials,
        base_rmse: noise.sd * (b / count).sqrt(),
        extended_rmse: noise.sd * (e / count).sqrt(),
        floor_rmse: noise.sd * (floor / count).sqrt(),
        excess_removed: (b - floor > SLIGHT * floor).then(|| 1.0 - (e - floor) / (b - floor)),
    };
    let by_trial = |f: &Fitted| gain_of(held(&base), held(f), expected.total(), coordinates, kept.len());
    let held_out = best.map(by_trial);
    let residual_law = law.as_ref().map(|l| ResidualLaw {
        formula: law::formula(&l.layout, &l.state.values, model.set.len()),
        terms: law_terms(l, model.set.len(), settings, noise.unit()),
        held_out: by_trial(l),
        offered: helpful.is_some(),
    });
    let extrapolation = best.and_then(|f| {
        let groups = settings.to_vec();
        let sizes: Vec<usize> =
            (0..names.len()).map(|s| groups.iter().filter(|g| **g == s).count()).collect();
        let enough = sizes.iter().filter(|s| **s >= 3).count() >= 2 && sizes.iter().all(|s| *s > 0);
        enough.then(|| {
            let loss = |f: &Fitted| {
                let (held, _) =
                    judge::leave_out(&f.layout, &f.state.values, &f.pass.trials, settings, &groups, &[]);
                held.iter().sum::<f64>()
            };
            gain_of(loss(&base), loss(f), expected.total(), coordinates, kept.len())
        })
    });
    let diagnosis = Diagnosis {
        format: report::FORMAT,
        verdict,
        reason,
        effects: effects(shown, model.set.len(), names, settings, noise.unit()),
        rivals: rivals.iter().map(rival_names).collect(),
        calibrated,
        residual: Residual {
            base_rmse: root_mean_square(&base.pass.residuals),
            floor_rmse: rmse(expected.total()),
            lack_of_fit_p: base_p,
            whiteness_p,
            autocorrelation,
            noise_correlation: noise.rho,
        },
        gain: Gain { held_out, extrapolation },
        unexplained_share: match verdict {
            Verdict::None => Some(0.0),
            _ => unexplained,
        },
        residual_law,
        next_experiment: next,
        considered,
        seed: config.seed,
    };
    Ok(Finding { diagnosis, extended, evidence })
}

/// A model with a law for what it leaves (`law`), fitted; `None` where nothing simple describes that.
fn described(data: &Data, model: &Fitted, noise: &Noise, settings: usize) -> Result<Option<Fitted>> {
    let found = law::law(data, model, noise)?;
    if found.is_empty() {
        return Ok(None);
    }
    let (layout, start) = model.joined(found, settings);
    let Some((state, pass)) = search::simulated(model::fit(data, &layout, start, 8))? else {
        return Ok(None);
    };
    let mut law = Fitted::new(layout, state, pass, data.settings);
    law.p_values[..model.p_values.len()].copy_from_slice(&model.p_values);
    Ok(Some(law))
}

/// The terms of a law, those of a model from `first` on.
fn law_terms(law: &Fitted, first: usize, settings: &[usize], unit: f64) -> Vec<LawTerm> {
    let of = |(t, term): (usize, &model::Term)| {
        let slot = *law.layout.of_term(t).first()?;
        let (value, half) = (law.state.values[slot], law.half_width(slot, settings, unit));
        let end = |v: f64| half.is_finite().then_some(v);
        let mut values = term.start.clone();
        let axis = term.free.iter().position(|f| *f)?;
        values[axis] = value;
        Some(LawTerm {
            term: library::at_clock(term.effect, &values, 0.0),
            amplitude: term.effect.parameters[axis].name.into(),
            ci95: [end(value - half), end(value + half)],
        })
    };
    law.layout.terms.iter().enumerate().skip(first).filter_map(of).collect()
}

/// Root of the mean square of all coordinates that count, m.
fn root_mean_square(residuals: &[Vec<f64>]) -> f64 {
    let known = || residuals.iter().flatten().filter(|r| r.is_finite());
    (known().map(|r| r * r).sum::<f64>() / known().count().max(1) as f64).sqrt()
}

/// The first `count` terms of a fit.
fn effects(f: &Fitted, count: usize, names: &[String], settings: &[usize], unit: f64) -> Vec<FoundEffect> {
    f.layout
        .terms
        .iter()
        .enumerate()
        .take(count)
        .map(|(t, term)| {
            let parameters = f
                .layout
                .of_term(t)
                .into_iter()
                .filter_map(|i| {
                    let slot = &f.layout.slots[i];
                    let model::What::Parameter(_, p) = slot.what else { return None };
                    let half = f.half_width(i, settings, unit);
                    let value = f.state.values[i];
                    let end = |v: f64| half.is_finite().then(|| v.clamp(slot.bounds[0], slot.bounds[1]));
                    Some(FoundParameter {
                        name: term.effect.parameters[p].name.into(),
                        value,
                        ci95: [end(value - half), end(value + half)],
                        unit: term.effect.parameters[p].unit.into(),
                        setting: slot.setting.map(|s| names[s].clone()),
                    })
                })
                .collect();
            FoundEffect {
                name: term.effect.name.into(),
                acts_on: term.effect.acts_on.into(),
                p_value: f.p_values[t],
                parameters,
            }
        })
        .collect()
}

/// Lag-1 correlation of the base model's residuals, and p of its being nothing.
fn whiteness(windows: &[Window], base: &Fitted) -> (f64, f64) {
    let (mut squares, mut products, mut count) = (0.0, 0.0, 0.0);
    for (window, r) in windows.iter().zip(&base.pass.residuals).filter(|(w, _)| w.kind != Kind::Contact) {
        let bodies = window.scene.bodies.len();
        for i in 0..r.len() {
            let j = i + 2 * bodies;
            if r[i].is_finite() {
                squares += r[i] * r[i];
                if j < r.len() && r[j].is_finite() {
                    products += r[i] * r[j];
                    count += 1.0;
                }
            }
        }
    }
    let rho = if squares > 0.0 { products / squares } else { 0.0 };
    (rho, (2.0 * normal_above(rho.abs() * f64::sqrt(count))).min(1.0))
}

/// The scene with the found effects, the calibrated latents and a start, so that it rolls out. Where settings differ,
/// it is the first trial's setting.
fn extend(scene: &Scene, trials: &[Trial], windows: &[Window], kept: &[usize], model: &Fitted) -> Scene {
    let mut out = scene.clone();
    let first = windows.iter().position(|w| w.kind != Kind::Contact).unwrap_or(0);
    let setting = windows[first].setting;
    let (terms, latents): (Vec<EffectTerm>, _) = model.layout.physics(&model.state.values, setting, 0.0);
    out.effects.extend(terms);
    let carriers: Vec<String> =
        out.bodies.iter().map(|b| b.name.clone()).chain(out.statics.iter().map(|s| s.name.clone())).collect();
    let carries: Vec<bool> = carriers.iter().map(|n| out.carries_latents(n)).collect();
    for (body, _) in out.bodies.iter_mut().zip(&carries).filter(|(_, c)| **c) {
        body.friction = latents.friction.unwrap_or(body.friction);
        body.restitution = latents.restitution.unwrap_or(body.restitution);
        if latents.density.is_some() && body.mass.is_none() {
            body.density = latents.density;
        }
    }
    let bodies = out.bodies.len();
    for (fixed, _) in out.statics.iter_mut().zip(&carries[bodies..]).filter(|(_, c)| **c) {
        fixed.friction = latents.friction.unwrap_or(fixed.friction);
        fixed.restitution = latents.restitution.unwrap_or(fixed.restitution);
    }
    let trial = &trials[kept[windows[first].trial]];
    let window = &windows[first];
    let fitted = (window.kind == Kind::Flight)
        .then(|| (window.scene.bodies[0].name.as_str(), model.state.nuisances[first].as_slice()));
    if out.action.is_none() || window.kind == Kind::Flight {
        place(&mut out, &trial.scene, fitted);
    } else {
        // A task's scene rolls out once an action has placed what it places: here, the first trial's.
        place(&mut out, &trial.scene, None);
    }
    out
}
