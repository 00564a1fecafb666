//! A candidate model: latents to calibrate and effect terms with their parameters, laid out as one vector; and how
//! the windows' residuals depend on it, by simulation only.
//!
//! r = seen - simulated at the observation times, in units of the noise. Derivatives are differences of rollouts, all
//! of a pass in one batch. Every window's nuisances are projected out of its residual and its columns (variable
//! projection: Golub and Pereyra 1973, in Kaufman's form), and what remains is summed by trial: for each a Gram matrix
//! of the columns, their products with the residual, and the residual's square. Fits, tests and cross-validation need
//! nothing else.

use nalgebra::{DMatrix, DVector};

use super::library;
use super::path::{Impact, Physics};
use super::stats::{inverse, solve};
use super::window::{Kind, Window};
use crate::error::Result;
use crate::task::Scene;
use crate::task::scene::EffectTerm;
use crate::trajectory::{End, Trajectory};
use crate::world::effect::Effect;
use crate::world::latent::FACTORS;
use crate::world::{Engine, Latents, Rollout, simulate_map};

/// An effect in a candidate model.
#[derive(Clone)]
pub struct Term {
    pub effect: &'static Effect,
    /// Whether every setting has its own values.
    pub per_setting: bool,
    /// Starting values, in the registry's order.
    pub start: Vec<f64>,
    /// Which parameters are fitted.
    pub free: Vec<bool>,
    /// Difference for derivatives by what is fitted, where the library's usual one does not suit.
    pub difference: Option<f64>,
}

/// What one number of the parameter vector stands for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum What {
    /// Index into the latent factors.
    Latent(usize),
    /// Term and parameter.
    Parameter(usize, usize),
}

/// One number of the parameter vector.
#[derive(Clone, Copy, Debug)]
pub struct Slot {
    pub what: What,
    /// The setting it belongs to; all if none.
    pub setting: Option<usize>,
    pub bounds: [f64; 2],
    /// Difference for derivatives.
    pub step: f64,
}

/// Which numbers there are.
#[derive(Clone)]
pub struct Layout {
    pub terms: Vec<Term>,
    pub slots: Vec<Slot>,
}

/// Where a fit stands.
#[derive(Clone)]
pub struct State {
    /// One value a slot.
    pub values: Vec<f64>,
    /// Nuisances by window.
    pub nuisances: Vec<Vec<f64>>,
}

/// Sums over the windows of one trial, in units of the noise.
#[derive(Clone)]
pub struct Sums {
    pub gram: DMatrix<f64>,
    pub score: DVector<f64>,
    pub square: f64,
}

/// What one pass over all windows gives.
pub struct Pass {
    /// By trial.
    pub trials: Vec<Sums>,
    /// By window: residuals (m), two to a point, nuisances projected out.
    pub residuals: Vec<Vec<f64>>,
    /// By window: squares of the projected residual in units of the noise.
    pub squares: Vec<f64>,
    /// By window: what maps (residual, step of the slots) to the nuisances' step.
    corrections: Vec<(DVector<f64>, DMatrix<f64>)>,
}

/// Everything fixed during a diagnosis.
pub struct Data<'a> {
    pub windows: &'a [Window],
    pub trials: usize,
    /// Setting of each trial.
    pub settings: &'a [usize],
    /// Scale of the residuals by window, m.
    pub sd: Vec<f64>,
    /// Derivatives of shots by their nuisances and by the latents, found once: by window; empty for others.
    pub frozen: Vec<Frozen>,
    pub engine: Engine,
}

impl Data<'_> {
    /// How many settings there are.
    pub fn setting_count(&self) -> usize {
        self.settings.iter().max().map_or(1, |s| s + 1)
    }
}

/// Derivatives that change little with what a search tries.
#[derive(Clone, Default)]
pub struct Frozen {
    nuisances: Vec<Vec<f64>>,
    /// Of the first slots, which are the latents.
    latents: Vec<Vec<f64>>,
}

/// Residuals of runs count in full up to this many noise scales and by their size beyond (Huber 1964).
const HUBER: f64 = 3.0;

impl Slot {
    /// The index of the latent factor that it is, if it is one.
    pub fn latent(&self) -> Option<usize> {
        match self.what {
            What::Latent(l) => Some(l),
            What::Parameter(..) => None,
        }
    }

    /// Information below which the data say nothing of the slot's value: one noise scale over all that is allowed.
    pub fn ridge(&self) -> f64 {
        let most = if matches!(self.what, What::Latent(_)) { 2.0 } else { 1e3 };
        (self.bounds[1] - self.bounds[0]).min(most).powi(-2)
    }
}

impl Layout {
    /// Latents (indices of factors) and terms; `settings` is the number of settings.
    pub fn new(latents: &[usize], terms: Vec<Term>, settings: usize) -> Layout {
        let mut slots = Vec::new();
        for l in latents {
            slots.push(Slot {
                what: What::Latent(*l),
                setting: None,
                bounds: FACTORS[*l].bounds,
                step: 2e-3,
            });
        }
        for (t, term) in terms.iter().enumerate() {
            for (p, parameter) in term.effect.parameters.iter().enumerate().filter(|(p, _)| term.free[*p]) {
                let owners: Vec<Option<usize>> =
                    if term.per_setting { (0..settings).map(Some).collect() } else { vec![None] };
                for setting in owners {
                    let step = term.difference.unwrap_or(parameter.step);
                    let bounds = library::bounds(term.effect, parameter);
                    slots.push(Slot { what: What::Parameter(t, p), setting, bounds, step });
                }
            }
        }
        Layout { terms, slots }
    }

    /// Values to start from: the scene's latents, the terms' own.
    pub fn start(&self, latents: &[f64; 3]) -> Vec<f64> {
        let value = |s: &Slot| match s.what {
            What::Latent(l) => latents[l],
            What::Parameter(t, p) => self.terms[t].start[p],
        };
        self.slots.iter().map(value).collect()
    }

    /// Number of latent slots; they come first.
    pub fn latents(&self) -> usize {
        self.slots.iter().filter(|s| matches!(s.what, What::Latent(_))).count()
    }

    /// Whether a slot only shapes its effect.
    pub fn shapes(&self, slot: usize) -> bool {
        match self.slots[slot].what {
            What::Parameter(t, p) => !self.terms[t].effect.parameters[p].is_amplitude(),
            What::Latent(_) => false,
        }
    }

    /// Slots of a term.
    pub fn of_term(&self, term: usize) -> Vec<usize> {
        (0..self.slots.len())
            .filter(|i| matches!(self.slots[*i].what, What::Parameter(t, _) if t == term))
            .collect()
    }

    /// Values of every term, and latents, for a setting.
    pub fn numbers(&self, values: &[f64], setting: usize) -> (Vec<Vec<f64>>, Latents) {
        let mut latents = [None; 3];
        let mut numbers: Vec<Vec<f64>> = self.terms.iter().map(|t| t.start.clone()).collect();
        for (slot, value) in self.slots.iter().zip(values) {
            if slot.setting.is_some_and(|s| s != setting) {
                continue;
            }
            match slot.what {
                What::Latent(l) => latents[l] = Some(*value),
                What::Parameter(t, p) => numbers[t][p] = *value,
            }
        }
        (numbers, Latents { density: latents[0], friction: latents[1], restitution: latents[2] })
    }

    /// Effects and latents for a setting, the clock shifted to a window's start.
    pub fn physics(&self, values: &[f64], setting: usize, clock: f64) -> (Vec<EffectTerm>, Latents) {
        let (numbers, latents) = self.numbers(values, setting);
        let of = |(term, numbers): (&Term, &Vec<f64>)| term.effect.at_clock(numbers, clock);
        (self.terms.iter().zip(&numbers).map(of).collect(), latents)
    }

    /// Whether any slot moves an edge in space.
    pub fn has_edges(&self) -> bool {
        (0..self.slots.len()).any(|i| self.edged(i))
    }

    /// Whether a slot moves an edge in space, which a path feels only where it crosses it.
    pub fn edged(&self, slot: usize) -> bool {
        match self.slots[slot].what {
            What::Parameter(t, p) => self.terms[t].effect.parameters[p].is_edge(),
            What::Latent(_) => false,
        }
    }
}

/// A term to be added to a model, at values near which it vanishes: the direction that it would move paths in.
#[derive(Clone)]
pub struct Extra {
    pub effect: &'static Effect,
    pub values: Vec<f64>,
    /// By what the difference that it makes is divided.
    pub unit: f64,
}

/// A window at a state: what is left, how it depends on the slots, and on extras; in units of the noise, the window's
/// nuisances projected out.
pub struct Look {
    /// Square roots of weights over noise, by point and for each nuisance that is held; 0 for those that do not count.
    pub weights: Vec<f64>,
    pub residual: DVector<f64>,
    /// A column for every slot, then for every extra.
    pub columns: DMatrix<f64>,
    /// Columns of the nuisances.
    pub start: DMatrix<f64>,
    /// Square of the residual; of what went astray, only what grows with its logarithm.
    pub square: f64,
    /// What residual and columns were made smaller by for going astray.
    pub share: f64,
    correction: (DVector<f64>, DMatrix<f64>),
}

impl Look {
    /// The step of the window's start that goes with a step of the slots.
    pub fn start_step(&self, step: &DVector<f64>) -> DVector<f64> {
        let (own, by_step) = &self.correction;
        own - by_step * step
    }

    /// Adds columns, two rows a point, not yet weighed; nothing where there are none.
    pub fn append(&mut self, count: usize, columns: Option<DMatrix<f64>>) {
        let (rows, before) = self.columns.shape();
        let mut all = DMatrix::zeros(rows, before + count);
        all.columns_mut(0, before).copy_from(&self.columns);
        if let Some(columns) = columns {
            for (i, k) in (0..columns.nrows()).flat_map(|i| (0..count).map(move |k| (i, k))) {
                all[(i, before + k)] = columns[(i, k)] * self.weights[i / 2] * self.share;
            }
        }
        self.columns = all;
    }
}

/// Square of a shot's residual, over what noise leaves, from which it counts for less and less (as Cauchy's
/// distribution has it): some collisions go another way than simulated, whatever the model.
const TAME: f64 = 6.0;

/// Residuals, derivatives and sums at a state.
pub fn pass(data: &Data, layout: &Layout, state: &State) -> Result<Pass> {
    let q = layout.slots.len();
    let empty = || Sums { gram: DMatrix::zeros(q, q), score: DVector::zeros(q), square: 0.0 };
    let mut out = Pass {
        trials: (0..data.trials).map(|_| empty()).collect(),
        residuals: Vec::new(),
        squares: Vec::new(),
        corrections: Vec::new(),
    };
    for (window, look) in data.windows.iter().zip(looks(data, layout, state, &[])?) {
        let Look { weights, residual, columns, correction, square, share, .. } = look;
        let sums = &mut out.trials[window.trial];
        sums.gram += columns.tr_mul(&columns);
        sums.score += columns.tr_mul(&residual);
        sums.square += square;
        out.squares.push(square);
        let metres =
            |i: usize| if weights[i / 2] > 0.0 { residual[i] / (share * weights[i / 2]) } else { f64::NAN };
        out.residuals.push((0..2 * window.points.len()).map(metres).collect());
        out.corrections.push(correction);
    }
    Ok(out)
}

/// Every window at a state.
pub fn looks(data: &Data, layout: &Layout, state: &State, extras: &[Extra]) -> Result<Vec<Look>> {
    let runs = simulated(data, layout, state, extras)?;
    let mut runs = runs.into_iter();
    let mut out = Vec::with_capacity(data.windows.len());
    for (w, window) in data.windows.iter().enumerate() {
        let nuisances = &state.nuisances[w];
        let shared = shared(layout, state, window);
        let moved = if window.kind.simulated() {
            runs.next().unwrap_or_default()
        } else {
            integrated(window, layout, state, nuisances, &shared, extras)
        };
        out.push(look(data, w, layout.slots.len(), &shared, nuisances, moved));
    }
    Ok(out)
}

/// What a window's points are predicted to show: at the state, with each nuisance moved, each slot that concerns it
/// moved down and up, and each extra.
#[derive(Default)]
struct Moved {
    base: Vec<f64>,
    /// Derivatives.
    nuisances: Vec<Vec<f64>>,
    slots: Vec<Vec<f64>>,
    /// Differences over their units.
    extras: Vec<Vec<f64>>,
}

/// A slot that concerns a window, and its values below and above.
struct Shared {
    slot: usize,
    low: f64,
    high: f64,
}

fn shared(layout: &Layout, state: &State, window: &Window) -> Vec<Shared> {
    let concerns = |slot: &Slot| {
        let latent = matches!(slot.what, What::Latent(_));
        slot.setting.is_none_or(|s| s == window.setting)
            && !(latent && matches!(window.kind, Kind::Flight | Kind::Roll))
    };
    let slots = (0..layout.slots.len()).filter(|i| concerns(&layout.slots[*i]));
    slots
        .map(|i| {
            let (slot, value) = (&layout.slots[i], state.values[i]);
            let wide = slot.step * if window.kind.simulated() { 3.0 } else { 1.0 };
            let h = wide.max(1e-4 * value.abs());
            let (mut low, mut high) = ((value - h).max(slot.bounds[0]), (value + h).min(slot.bounds[1]));
            if !window.kind.simulated() && !layout.edged(i) {
                // Paths integrated here are smooth: one side is enough.
                if value + h <= slot.bounds[1] { low = value } else { high = value }
            }
            Shared { slot: i, low, high }
        })
        .collect()
}

/// Paths of a window that is integrated here.
fn integrated(
    window: &Window,
    layout: &Layout,
    state: &State,
    nuisances: &[f64],
    shared: &[Shared],
    extras: &[Extra],
) -> Moved {
    let physics = |values: &[f64], extra: Option<&Extra>| {
        let (numbers, latents) = layout.numbers(values, window.setting);
        let own = layout.terms.iter().zip(&numbers).map(|(t, n)| (t.effect, n.as_slice()));
        let terms: Vec<_> = own.chain(extra.map(|e| (e.effect, e.values.as_slice()))).collect();
        Physics::new(window, &terms, &latents)
    };
    let here = physics(&state.values, None);
    let base = here.seen(nuisances, |_, _| ());
    let slope = |high: Vec<f64>, low: &[f64], by: f64| -> Vec<f64> {
        high.iter().zip(low).map(|(a, b)| (a - b) / by).collect()
    };
    let steps: &[f64] = match window.kind {
        Kind::Roll => &[1e-4, 1e-3, 1e-4, 1e-4],
        _ => &[1e-4, 1e-4, 1e-3, 1e-3, 1e-1, 1e-4],
    };
    let moved_nuisance = |(k, h): (usize, &f64)| {
        let mut moved = nuisances.to_vec();
        moved[k] += h;
        slope(here.seen(&moved, |_, _| ()), &base, *h)
    };
    let moved_slot = |s: &Shared| {
        let end = |value: f64| {
            let mut values = state.values.clone();
            values[s.slot] = value;
            physics(&values, None).seen(nuisances, |_, _| ())
        };
        let own = state.values[s.slot];
        let low = if s.low == own { base.clone() } else { end(s.low) };
        let high = if s.high == own { base.clone() } else { end(s.high) };
        slope(high, &low, s.high - s.low)
    };
    Moved {
        nuisances: steps.iter().enumerate().take(nuisances.len()).map(moved_nuisance).collect(),
        slots: shared.iter().map(moved_slot).collect(),
        extras: extras
            .iter()
            .map(|e| slope(physics(&state.values, Some(e)).seen(nuisances, |_, _| ()), &base, e.unit))
            .collect(),
        base,
    }
}

/// Losses of many values over some of the windows that start from what was seen.
pub fn losses(data: &Data, layout: &Layout, all: &[Vec<f64>], windows: &[usize]) -> Result<Vec<f64>> {
    let mut physics = Vec::with_capacity(all.len() * windows.len());
    for w in windows {
        for values in all {
            let window = &data.windows[*w];
            physics.push((*w, layout.physics(values, window.setting, window.start)));
        }
    }
    let rollouts: Vec<Rollout> = physics
        .iter()
        .map(|(w, (effects, latents))| Rollout {
            scene: &data.windows[*w].scene,
            latents: *latents,
            effects,
            stop: false,
        })
        .collect();
    let squares = simulate_map(&rollouts, data.engine, |i, path| {
        let w = physics[i].0;
        let window = &data.windows[w];
        let off = |(i, v): (usize, &f64)| (window.points[i / 2].seen[i % 2] - v) / data.sd[w];
        let square: f64 = predicted(window, &path).iter().enumerate().map(|v| off(v).powi(2)).sum();
        tamed(if square.is_finite() { square } else { 1e12 }, 2.0 * window.points.len() as f64)
    })?;
    let of = |k: usize| squares.iter().skip(k).step_by(all.len()).sum();
    Ok((0..all.len()).map(of).collect())
}

/// A square as it counts for a window that can go astray, of which noise would leave `left`.
fn tamed(square: f64, left: f64) -> f64 {
    if square > TAME * left { TAME * left * (1.0 + (square / (TAME * left)).ln()) } else { square }
}

/// Paths of the runs and shots, simulated in one batch.
fn simulated(data: &Data, layout: &Layout, state: &State, extras: &[Extra]) -> Result<Vec<Moved>> {
    let chosen: Vec<usize> = (0..data.windows.len()).filter(|w| data.windows[*w].kind.simulated()).collect();
    if chosen.is_empty() {
        return Ok(Vec::new());
    }
    let plans: Vec<Vec<Shared>> = chosen.iter().map(|w| shared(layout, state, &data.windows[*w])).collect();
    let frozen = |w: usize| data.frozen.get(w).filter(|f| !f.nuisances.is_empty());
    let known = |w: usize, s: &Shared| frozen(w).and_then(|f| f.latents.get(s.slot));
    // Scenes first (by window: as it stands, then each nuisance moved), then what is simulated in them.
    let mut scenes: Vec<Scene> = Vec::new();
    let mut jobs: Vec<(usize, usize, Vec<EffectTerm>, Latents)> = Vec::new();
    for (w, plan) in chosen.iter().zip(&plans) {
        let window = &data.windows[*w];
        let physics = |values: &[f64]| layout.physics(values, window.setting, window.start);
        let (effects, latents) = physics(&state.values);
        let here = scenes.len();
        let nuisances = &state.nuisances[*w];
        scenes.push(placed(window, nuisances));
        jobs.push((*w, here, effects.clone(), latents));
        if frozen(*w).is_none() {
            for k in 0..nuisances.len() {
                for to in [-1.0, 1.0] {
                    let mut moved = nuisances.clone();
                    moved[k] += to * NUDGE[k % 5];
                    jobs.push((*w, scenes.len(), effects.clone(), latents));
                    scenes.push(placed(window, &moved));
                }
            }
        }
        for s in plan.iter().filter(|s| known(*w, s).is_none()) {
            for end in [s.low, s.high] {
                let mut moved = state.values.clone();
                moved[s.slot] = end;
                let (effects, latents) = physics(&moved);
                jobs.push((*w, here, effects, latents));
            }
        }
        for e in extras {
            let mut effects = effects.clone();
            effects.push(e.effect.at_clock(&e.values, window.start));
            jobs.push((*w, here, effects, latents));
        }
    }
    let rollouts: Vec<Rollout> = jobs
        .iter()
        .map(|(_, scene, effects, latents)| Rollout {
            scene: &scenes[*scene],
            latents: *latents,
            effects,
            stop: false,
        })
        .collect();
    let seen = simulate_map(&rollouts, data.engine, |i, path| predicted(&data.windows[jobs[i].0], &path))?;
    let mut seen = seen.into_iter();
    let mut next = || seen.next().unwrap_or_default();
    let slope = |high: &[f64], low: &[f64], by: f64| -> Vec<f64> {
        high.iter().zip(low).map(|(a, b)| (a - b) / by).collect()
    };
    let mut out = Vec::new();
    for (w, plan) in chosen.iter().zip(&plans) {
        let base = next();
        let nuisances = match frozen(*w) {
            Some(known) => known.nuisances.clone(),
            None => (0..state.nuisances[*w].len())
                .map(|k| {
                    let (low, high) = (next(), next());
                    slope(&high, &low, 2.0 * NUDGE[k % 5])
                })
                .collect(),
        };
        let mut slots = Vec::new();
        for s in plan {
            if let Some(known) = known(*w, s) {
                slots.push(known.clone());
                continue;
            }
            let (low, high) = (next(), next());
            slots.push(slope(&high, &low, s.high - s.low));
        }
        let extras = extras.iter().map(|e| slope(&next(), &base, e.unit)).collect();
        out.push(Moved { base, nuisances, slots, extras });
    }
    Ok(out)
}

/// Differences for derivatives by a body's x, y, vx, vy, omega in a shot.
const NUDGE: [f64; 5] = [1e-3, 1e-3, 1e-2, 1e-2, 5e-2];

/// A shot's scene with its bodies where the nuisances say; a run's as it is.
fn placed(window: &Window, nuisances: &[f64]) -> Scene {
    let mut scene = window.scene.clone();
    for (body, own) in scene.bodies.iter_mut().zip(nuisances.chunks_exact(5)) {
        body.position = Some([own[0], own[1]]);
        body.velocity = [own[2], own[3]];
        body.angular_velocity = own[4];
    }
    scene
}

/// Derivatives by the nuisances of every shot at a state, to be kept: they change little with what a search tries.
pub fn freeze(data: &mut Data, layout: &Layout, state: &State) -> Result<()> {
    data.frozen.clear();
    let mut found = simulated(data, layout, state, &[])?.into_iter();
    let known = |w: &Window| match w.kind {
        Kind::Run | Kind::Leap | Kind::Shot => {
            let moved = found.next().unwrap_or_default();
            Frozen { nuisances: moved.nuisances, latents: moved.slots }
        }
        _ => Frozen::default(),
    };
    data.frozen = data.windows.iter().map(known).collect();
    Ok(())
}

/// What bounces and rolls need beyond a state, and by how much it may plausibly differ from where it starts: spin, 1 cm;
/// 1 cm, 5 mm a metre. A shot's spins are held where they stand.
fn held(window: &Window) -> Vec<(usize, f64)> {
    let spin = window.surface.as_ref().map_or(3.0, |s| s.spin);
    let count = window.nuisances.len();
    let all: Vec<(usize, f64)> = match window.kind {
        Kind::Contact => vec![(4, spin), (5, 0.01)],
        Kind::Roll => vec![(2, 0.01), (3, 0.005)],
        // Every body's fifth nuisance.
        Kind::Shot => (4..count).step_by(NUDGE.len()).map(|k| (k, 3.0)).collect(),
        Kind::Flight | Kind::Run | Kind::Leap => Vec::new(),
    };
    all.into_iter().filter(|(k, _)| *k < count).collect()
}

/// Weighs, and projects the nuisances out. What is held of them is observed, as it were: two more rows each, of which
/// the second is empty.
fn look(data: &Data, w: usize, slots: usize, shared: &[Shared], nuisances: &[f64], moved: Moved) -> Look {
    let window = &data.windows[w];
    let held = held(window);
    let seen = moved.base.len();
    let n = seen + 2 * held.len();
    let mut residual =
        DVector::from_fn(
            n,
            |i, _| {
                if i < seen { window.points[i / 2].seen[i % 2] - moved.base[i] } else { 0.0 }
            },
        );
    let mut weights: Vec<f64> =
        weights(data, w, window, &residual).into_iter().map(|v| v / data.sd[w]).collect();
    weights.extend(held.iter().map(|(_, plausible)| 1.0 / plausible));
    let count = moved.nuisances.len();
    let mut start = DMatrix::zeros(n, count);
    let mut columns = DMatrix::zeros(n, slots + moved.extras.len());
    for i in 0..seen {
        for k in 0..count {
            start[(i, k)] = moved.nuisances[k][i] * weights[i / 2];
        }
        for (s, slope) in shared.iter().zip(&moved.slots) {
            columns[(i, s.slot)] = slope[i] * weights[i / 2];
        }
        for (k, difference) in moved.extras.iter().enumerate() {
            let d = difference[i] * weights[i / 2];
            columns[(i, slots + k)] = if d.is_finite() { d } else { 0.0 };
        }
    }
    for (h, (k, _)) in held.iter().enumerate().filter(|(_, (k, _))| *k < count) {
        let row = seen + 2 * h;
        start[(row, *k)] = weights[row / 2];
        residual[row] = if window.kind == Kind::Shot { 0.0 } else { window.nuisances[*k] - nuisances[*k] };
    }
    for i in 0..n {
        residual[i] = if weights[i / 2] > 0.0 { residual[i] * weights[i / 2] } else { 0.0 };
    }
    let finite = residual.iter().chain(columns.iter()).chain(start.iter()).all(|v| v.is_finite());
    if !finite {
        // A diverged path: as bad as can be, and it says nothing of where to go.
        residual.fill(1e3);
        columns.fill(0.0);
        start.fill(0.0);
    }
    let mut correction = (DVector::zeros(count), DMatrix::zeros(count, slots));
    if count > 0 {
        let project = inverse(&start.tr_mul(&start)) * start.transpose();
        let by_column = &project * &columns;
        correction = (&project * &residual, by_column.columns(0, slots).into_owned());
        residual -= &start * &correction.0;
        columns -= &start * by_column;
    }
    let mut square = residual.norm_squared();
    let left = seen as f64 - count as f64;
    let mut share = 1.0;
    if window.kind.strays() && square > TAME * left {
        share = (TAME * left / square).sqrt();
        residual *= share;
        columns *= share;
        start *= share;
        square = tamed(square, left);
    }
    Look { weights, residual, columns, start, square, share, correction }
}

/// Steps at the beginning of a fit that leave the shapes of effects alone: while an effect is weak its shape is told by
/// nothing, and a step in it would be wild.
const HELD: usize = 2;

/// Fits a layout: damped Gauss-Newton steps from `state` (Levenberg's damping grows when a step fails).
pub fn fit(data: &Data, layout: &Layout, start: State, most: usize) -> Result<(State, Pass)> {
    let mut state = start;
    let mut here = pass(data, layout, &state)?;
    let mut damping = 1e-4;
    let mut settled = 0;
    let shaped = (0..layout.slots.len()).any(|i| layout.shapes(i));
    let held = if shaped { HELD } else { 0 };
    for round in 0..most + held {
        let step = step(layout, &state.values, &here, damping, round < held);
        let mut tried = state.clone();
        let mut taken = DVector::zeros(step.len());
        for (i, slot) in layout.slots.iter().enumerate() {
            tried.values[i] = (state.values[i] + step[i]).clamp(slot.bounds[0], slot.bounds[1]);
            taken[i] = tried.values[i] - state.values[i];
        }
        for (nuisances, (own, by_step)) in tried.nuisances.iter_mut().zip(&here.corrections) {
            let moved = own - by_step * &taken;
            nuisances.iter_mut().zip(moved.iter()).for_each(|(n, m)| *n += m.clamp(-50.0, 50.0));
        }
        let there = pass(data, layout, &tried)?;
        let (old, new) = (total(&here), total(&there));
        if new <= old * (1.0 + 1e-9) {
            settled =
                if old - new < 1e-4 * old.min(50.0 * data.trials as f64) + 1e-6 { settled + 1 } else { 0 };
            (state, here) = (tried, there);
            damping = (damping * 0.1).max(1e-8);
            if settled >= 1 && round >= held {
                break;
            }
        } else {
            damping = (damping * 30.0).max(1e-3);
            if damping > 1e5 {
                break;
            }
        }
    }
    Ok((state, here))
}

/// Sum of squares of all trials.
pub fn total(pass: &Pass) -> f64 {
    pass.trials.iter().map(|t| t.square).sum()
}

fn step(layout: &Layout, values: &[f64], pass: &Pass, damping: f64, hold_shapes: bool) -> DVector<f64> {
    let q = layout.slots.len();
    let (mut gram, mut score) = (DMatrix::zeros(q, q), DVector::zeros(q));
    for t in &pass.trials {
        gram += &t.gram;
        score += &t.score;
    }
    // A value at its bound that is pushed outwards stays there, and the others step without it.
    for i in 0..q {
        let [low, high] = layout.slots[i].bounds;
        let stuck = (values[i] <= low && score[i] < 0.0) || (values[i] >= high && score[i] > 0.0);
        if stuck || (hold_shapes && layout.shapes(i)) {
            gram.row_mut(i).fill(0.0);
            gram.column_mut(i).fill(0.0);
            score[i] = 0.0;
        }
    }
    for i in 0..q {
        gram[(i, i)] = gram[(i, i)] * (1.0 + damping) + layout.slots[i].ridge();
    }
    solve(&gram, &score)
}

/// Square roots of the weights of a window's points.
fn weights(data: &Data, w: usize, window: &Window, residual: &DVector<f64>) -> Vec<f64> {
    window
        .points
        .iter()
        .enumerate()
        .map(|(i, p)| {
            if window.kind != Kind::Run {
                return p.weight.sqrt();
            }
            let size = residual[2 * i].hypot(residual[2 * i + 1]) / data.sd[w];
            (p.weight * (HUBER / size.max(HUBER))).sqrt()
        })
        .collect()
}

/// Positions at a window's points, two numbers each.
fn predicted(window: &Window, trajectory: &Trajectory) -> Vec<f64> {
    let mut out = Vec::with_capacity(2 * window.points.len());
    if trajectory.outcome.end == End::Diverged || trajectory.times.is_empty() {
        out.resize(2 * window.points.len(), f64::NAN);
        return out;
    }
    let times = &trajectory.times;
    let last = times.len() - 1;
    let mut at = 0;
    for point in &window.points {
        while at + 1 < last && times[at + 1] < point.time - 1e-12 {
            at += 1;
        }
        let (i, j) = (at, (at + 1).min(last));
        let track = &trajectory.bodies[point.body];
        let span = times[j] - times[i];
        let s = if span > 0.0 { ((point.time - times[i]) / span).clamp(0.0, 1.0) } else { 0.0 };
        if s >= 1.0 - 1e-9 || s <= 1e-9 {
            let k = if s > 0.5 { j } else { i };
            out.extend([track.x[k], track.y[k]]);
            continue;
        }
        // Cubic Hermite; straight across a bounce, whose kink a cubic would overshoot.
        for (x, v) in [(&track.x, &track.vx), (&track.y, &track.vy)] {
            let kink = (v[j] - v[i]).abs() > 0.5 * (v[i].abs() + v[j].abs()) && v[i] * v[j] < 0.0;
            let (s2, s3) = (s * s, s * s * s);
            out.push(if kink {
                x[i] + s * (x[j] - x[i])
            } else {
                (2.0 * s3 - 3.0 * s2 + 1.0) * x[i]
                    + (s3 - 2.0 * s2 + s) * span * v[i]
                    + (3.0 * s2 - 2.0 * s3) * x[j]
                    + (s3 - s2) * span * v[j]
            });
        }
    }
    out
}

/// States (x, y, vx, vy) at every window's points, for pictures and for what acts along a path.
pub fn paths(data: &Data, layout: &Layout, state: &State) -> Result<Vec<Vec<[f64; 4]>>> {
    let mut runs = Vec::new();
    for (w, window) in data.windows.iter().enumerate().filter(|(_, w)| w.kind.simulated()) {
        let scene = placed(window, &state.nuisances[w]);
        runs.push((window, scene, layout.physics(&state.values, window.setting, window.start)));
    }
    let rollouts: Vec<Rollout> = runs
        .iter()
        .map(|(_, scene, (effects, latents))| Rollout { scene, latents: *latents, effects, stop: false })
        .collect();
    let mut simulated = simulate_map(&rollouts, data.engine, |i, path| {
        runs[i].0.points.iter().map(|p| state_at(&path, p)).collect::<Vec<_>>()
    })?
    .into_iter();
    let mut out = Vec::new();
    for (w, window) in data.windows.iter().enumerate() {
        out.push(match window.kind {
            Kind::Run | Kind::Leap | Kind::Shot => simulated.next().unwrap_or_default(),
            _ => {
                let mut states = vec![[f64::NAN; 4]; window.points.len()];
                with_physics(window, layout, &state.values, |p| {
                    p.seen(&state.nuisances[w], |i, s| states[i] = s);
                });
                states
            }
        });
    }
    Ok(out)
}

/// What happens in a contact window.
pub fn impact(window: &Window, w: usize, layout: &Layout, state: &State) -> Option<Impact> {
    with_physics(window, layout, &state.values, |p| p.impact(&state.nuisances[w]))
}

/// Accelerations at true states (x, y, vx, vy) of a window's points, m/s^2.
pub fn pushes(window: &Window, layout: &Layout, values: &[f64], states: &[[f64; 4]]) -> Vec<[f64; 2]> {
    let at =
        |p: &Physics| window.points.iter().zip(states).map(|(point, s)| p.push(point.time, *s)).collect();
    with_physics(window, layout, values, at)
}

fn with_physics<T>(window: &Window, layout: &Layout, values: &[f64], f: impl FnOnce(&Physics) -> T) -> T {
    let (numbers, latents) = layout.numbers(values, window.setting);
    let terms: Vec<_> = layout.terms.iter().zip(&numbers).map(|(t, n)| (t.effect, n.as_slice())).collect();
    f(&Physics::new(window, &terms, &latents))
}

fn state_at(path: &Trajectory, point: &super::window::Point) -> [f64; 4] {
    let after = path.times.partition_point(|t| *t < point.time - 1e-9);
    match path.bodies.get(point.body) {
        Some(track) if !track.is_empty() => {
            let i = after.min(track.len() - 1);
            [track.x[i], track.y[i], track.vx[i], track.vy[i]]
        }
        _ => [f64::NAN; 4],
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The spins of the first four bodies were once held, and those of further ones left to wander.
    #[test]
    fn the_spin_of_every_body_of_a_shot_is_held() {
        let shot = |bodies: usize| Window {
            trial: 0,
            setting: 0,
            kind: Kind::Shot,
            scene: Scene::empty(),
            start: 0.0,
            points: Vec::new(),
            nuisances: vec![0.0; 5 * bodies],
            surface: None,
            own: Vec::new(),
            smooth: None,
        };
        let spins = |bodies: usize| held(&shot(bodies)).iter().map(|(k, _)| *k).collect::<Vec<_>>();
        assert_eq!(spins(6), [4, 9, 14, 19, 24, 29]);
        assert_eq!(spins(2), [4, 9]);
    }
}
