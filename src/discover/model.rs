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
    /// Points of a run later than this share of its trusted time do not count.
    pub horizon: f64,
    pub engine: Engine,
}

/// Residuals of runs count in full up to this many noise scales and by their size beyond (Huber 1964).
const HUBER: f64 = 3.0;

impl Slot {
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
                    let step = library::difference(parameter);
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
            What::Parameter(t, p) => library::shapes(&self.terms[t].effect.parameters[p]),
            What::Latent(_) => false,
        }
    }

    /// Slots of a term.
    pub fn of_term(&self, term: usize) -> Vec<usize> {
        (0..self.slots.len())
            .filter(|i| matches!(self.slots[*i].what, What::Parameter(t, _) if t == term))
            .collect()
    }

    /// Effects and latents for a setting, the clock shifted to a window's start.
    pub fn physics(&self, values: &[f64], setting: usize, clock: f64) -> (Vec<EffectTerm>, Latents) {
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
        let terms = self
            .terms
            .iter()
            .zip(numbers)
            .map(|(term, numbers)| library::at_clock(term.effect, &numbers, clock))
            .collect();
        (terms, Latents { density: latents[0], friction: latents[1], restitution: latents[2] })
    }
}

/// The slots that concern a window, and for each of its columns how far down and up it is moved.
type Plan = (Vec<usize>, Vec<(f64, f64)>);

/// One rollout of a window.
struct Job {
    window: usize,
    scene: Scene,
    effects: Vec<EffectTerm>,
    latents: Latents,
}

/// Residuals, derivatives and sums at a state.
pub fn pass(data: &Data, layout: &Layout, state: &State) -> Result<Pass> {
    let mut jobs = Vec::new();
    // For each window: the slots that concern it, and for each column its difference.
    let mut plans: Vec<Plan> = Vec::with_capacity(data.windows.len());
    for (w, window) in data.windows.iter().enumerate() {
        let nuisances = &state.nuisances[w];
        jobs.push(job(w, window, layout, &state.values, nuisances));
        let mut differences = Vec::new();
        for k in 0..nuisances.len().min(5) {
            let h = if k < 2 {
                1e-4
            } else if k < 4 {
                1e-3
            } else {
                1e-1
            };
            let mut moved = nuisances.clone();
            moved[k] += h;
            differences.push((0.0, h));
            jobs.push(job(w, window, layout, &state.values, &moved));
        }
        let relevant: Vec<usize> = (0..layout.slots.len())
            .filter(|i| layout.slots[*i].setting.is_none_or(|s| s == window.setting))
            .filter(|i| window.kind != Kind::Flight || !matches!(layout.slots[*i].what, What::Latent(_)))
            .collect();
        for i in &relevant {
            let slot = &layout.slots[*i];
            let value = state.values[*i];
            let wide = slot.step * if window.kind == Kind::Flight { 1.0 } else { 3.0 };
            let h = wide.max(1e-4 * value.abs());
            let (mut low, mut high) = ((value - h).max(slot.bounds[0]), (value + h).min(slot.bounds[1]));
            if window.kind != Kind::Run {
                // Paths through the air are smooth: one side is enough.
                if value + h <= slot.bounds[1] { low = value } else { high = value }
            }
            for end in [low, high].into_iter().filter(|e| *e != value) {
                let mut moved = state.values.clone();
                moved[*i] = end;
                jobs.push(job(w, window, layout, &moved, nuisances));
            }
            differences.push((low - value, high - value));
        }
        plans.push((relevant, differences));
    }
    let rollouts: Vec<Rollout> = jobs
        .iter()
        .map(|j| Rollout { scene: &j.scene, latents: j.latents, effects: &j.effects, stop: false })
        .collect();
    let seen = simulate_map(&rollouts, data.engine, |i, trajectory| {
        predicted(&data.windows[jobs[i].window], &trajectory)
    })?;
    let mut seen = seen.into_iter();
    let mut next = || seen.next().unwrap_or_default();
    let q = layout.slots.len();
    let empty = || Sums { gram: DMatrix::zeros(q, q), score: DVector::zeros(q), square: 0.0 };
    let mut out = Pass {
        trials: (0..data.trials).map(|_| empty()).collect(),
        residuals: Vec::new(),
        squares: Vec::new(),
        corrections: Vec::new(),
    };
    for (w, window) in data.windows.iter().enumerate() {
        let (relevant, differences) = &plans[w];
        let nuisances = &state.nuisances[w];
        let base = next();
        let n = base.len();
        let offset = nuisances.get(5).copied().unwrap_or(0.0);
        let mut residual = DVector::from_fn(n, |i, _| {
            window.points[i / 2].seen[i % 2] - base[i] - offset * window.normal[i % 2]
        });
        let weights = weights(data, w, window, &residual);
        let weighted = |i: usize| weights[i / 2] / data.sd[w];
        let moved = nuisances.len().min(5);
        let extra = nuisances.len().saturating_sub(5);
        let mut start = DMatrix::zeros(n, moved + extra);
        for (k, (_, h)) in differences.iter().enumerate().take(moved) {
            let other = next();
            for i in 0..n {
                start[(i, k)] = (other[i] - base[i]) / h * weighted(i);
            }
        }
        if extra == 1 {
            for i in 0..n {
                start[(i, 5)] = window.normal[i % 2] * weighted(i);
            }
        }
        let mut columns = DMatrix::zeros(n, q);
        for (slot, (down, up)) in relevant.iter().zip(&differences[moved..]) {
            let low = if *down == 0.0 { base.clone() } else { next() };
            let high = if *up == 0.0 { base.clone() } else { next() };
            for i in 0..n {
                columns[(i, *slot)] = (high[i] - low[i]) / (up - down) * weighted(i);
            }
        }
        for i in 0..n {
            residual[i] = if weights[i / 2] > 0.0 { residual[i] * weighted(i) } else { 0.0 };
        }
        let finite = residual.iter().chain(columns.iter()).chain(start.iter()).all(|v| v.is_finite());
        if !finite {
            // A diverged rollout: as bad as can be, and it says nothing of where to go.
            residual.fill(1e3);
            columns.fill(0.0);
            start.fill(0.0);
        }
        let mut correction = (DVector::zeros(nuisances.len()), DMatrix::zeros(nuisances.len(), q));
        if !nuisances.is_empty() {
            let mut gram = start.transpose() * &start;
            if nuisances.len() == 6 {
                // Spin and offset are held by what is plausible: 300 rad/s, 1 cm.
                gram[(4, 4)] += 1.0 / (300.0f64 * 300.0);
                gram[(5, 5)] += 1.0 / (0.01 * 0.01);
            }
            let project = inverse(&gram) * start.transpose();
            correction = (&project * &residual, &project * &columns);
            residual -= &start * &correction.0;
            columns -= &start * &correction.1;
        }
        let sums = &mut out.trials[window.trial];
        sums.gram += columns.transpose() * &columns;
        sums.score += columns.transpose() * &residual;
        sums.square += residual.norm_squared();
        out.squares.push(residual.norm_squared());
        out.residuals.push(
            (0..n).map(|i| if weights[i / 2] > 0.0 { residual[i] / weighted(i) } else { f64::NAN }).collect(),
        );
        out.corrections.push(correction);
    }
    Ok(out)
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

fn job(w: usize, window: &Window, layout: &Layout, values: &[f64], nuisances: &[f64]) -> Job {
    let (effects, latents) = layout.physics(values, window.setting, window.start);
    let mut scene = window.scene.clone();
    if let [x, y, vx, vy, rest @ ..] = nuisances {
        let body = &mut scene.bodies[0];
        body.position = Some([*x, *y]);
        body.velocity = [*vx, *vy];
        body.angular_velocity = rest.first().copied().unwrap_or(0.0);
    }
    Job { window: w, scene, effects, latents }
}

/// Square roots of the weights of a window's points.
fn weights(data: &Data, w: usize, window: &Window, residual: &DVector<f64>) -> Vec<f64> {
    let last = window.points.last().map_or(0.0, |p| p.time);
    window
        .points
        .iter()
        .enumerate()
        .map(|(i, p)| {
            if window.kind != Kind::Run {
                return p.weight.sqrt();
            }
            if p.time > data.horizon * last + 1e-9 {
                return 0.0;
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

/// A rollout of every window at a state, for pictures.
pub fn paths(data: &Data, layout: &Layout, state: &State) -> Result<Vec<Trajectory>> {
    let jobs: Vec<Job> = data
        .windows
        .iter()
        .enumerate()
        .map(|(w, window)| job(w, window, layout, &state.values, &state.nuisances[w]))
        .collect();
    let rollouts: Vec<Rollout> = jobs
        .iter()
        .map(|j| Rollout { scene: &j.scene, latents: j.latents, effects: &j.effects, stop: false })
        .collect();
    simulate_map(&rollouts, data.engine, |_, trajectory| trajectory)
}

/// A body's velocity at a point's time, m/s.
pub fn velocity_at(path: &Trajectory, point: &super::window::Point) -> [f64; 2] {
    let after = path.times.partition_point(|t| *t < point.time - 1e-9);
    match path.bodies.get(point.body) {
        Some(track) if !track.is_empty() => {
            let i = after.min(track.len() - 1);
            [track.vx[i], track.vy[i]]
        }
        _ => [0.0; 2],
    }
}

/// Speeds along a contact window's normal at its beginning and its end: (impact, rebound), m/s.
pub fn along_normal(path: &Trajectory, window: &Window) -> Option<(f64, f64)> {
    let track = path.bodies.first()?;
    let along = |i: usize| track.vx[i] * window.normal[0] + track.vy[i] * window.normal[1];
    let n = track.len();
    let turn = (1..n).find(|i| along(*i) > 0.0 && along(*i - 1) < 0.0)?;
    Some((-along(turn - 1), along(turn)))
}
