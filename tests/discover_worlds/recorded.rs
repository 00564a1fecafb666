//! Hidden worlds like real recordings, with between-trial variation and several error sources.
//!
//! Drawn for each trial: the size of the hidden effect, a small lift of either sign (for each flight of a
//! bouncing ball: a bounce changes the spin), the camera tilt; then correlated noise, outliers and missing
//! points. None of it is shared between trials; worlds with shared dirt add errors that are alike in all trials. Each world
//! has a clean twin with the same initial states and effect and without any of this: an effect that cannot be identified there is
//! unidentifiable.

use super::camera::Camera;
use super::hidden_effects::{HiddenEffect, hidden};
pub use super::hidden_effects::{Kind, Size, kinds};
use super::law::{Law, Motion, RADIUS, State, distinguishable_shift};
use super::shared::{RATIO, SharedDirt};
use super::{GRAVITY_TWINS, Launch, floor, launches, normal, scene, with_twins};
use iplw::reality::Trial;
use iplw::rng;
use iplw::task::Scene;
use rand::RngExt;

/// Relative standard deviation of an effect's size between trials.
pub const SIZE_SPREAD: f64 = 0.15;
/// Standard deviation of a trial's lift, 1/s.
pub const LIFT_SPREAD: f64 = 0.06;
/// Standard deviation of the camera tilt, rad.
pub const TURN_SPREAD: f64 = 0.2 * std::f64::consts::PI / 180.0;
/// Range of the noise's standard deviation, m.
const NOISE: [f64; 2] = [5e-4, 3e-3];
/// Range of the path shift by a hidden effect (`distinguishable_shift`), in standard deviations of the noise.
const SHIFT: [f64; 2] = [5.0, 20.0];
/// Minimum ratio of that shift to the uncertainty of its mean by between-trial lifts and tilts. An effect below
/// it would be unidentifiable: noise and shift are redrawn.
const MARGIN: f64 = 4.0;
/// Observations per second.
const RATE: f64 = 50.0;
/// Range of the number of trials.
const LAUNCHES: [f64; 2] = [14.0, 80.0];

/// A world: hidden effects and the data for a diagnosis.
#[derive(Clone)]
pub struct World {
    pub kind: Kind,
    /// Correct sets, with sorted names: the hidden one first, then indistinguishable ones. Empty if nothing, or
    /// nothing from the library, is hidden.
    pub right: Vec<Vec<&'static str>>,
    pub sizes: Vec<Size>,
    /// Whether all launches have the same speed and angle within 5 %.
    pub alike: bool,
    pub scene: Scene,
    /// Standard deviation of the noise, m.
    pub noise: f64,
    /// Path shift by the effect (`distinguishable_shift`) in standard deviations of the noise; the fainter of two.
    pub shift: f64,
    /// Its ratio to the uncertainty by between-trial lifts and tilts.
    pub margin: f64,
    /// The law of each trial.
    pub laws: Vec<Law>,
    pub trials: Vec<Trial>,
    /// The clean twin's trials.
    pub clean: Vec<Trial>,
}

/// World `i`: kinds in turn, with similar and different launches alternating; `shared`: with shared dirt.
pub fn world(i: u64, seed: u64, shared: bool) -> World {
    let (kinds, own) = (kinds(), rng::derive_seed(seed, "recorded world", i));
    let (round, k) = (i as usize / kinds.len(), i as usize % kinds.len());
    with_dirt(kinds[k], (round + k) % 2 == 1, own, shared.then(|| SharedDirt::draw(own)))
}

/// A world of a kind without shared dirt.
pub fn of_kind(kind: Kind, alike: bool, seed: u64) -> World {
    with_dirt(kind, alike, seed, None)
}

/// A world of a kind, its effect at least [`RATIO`] times as strong as the dirt.
pub fn with_dirt(kind: Kind, alike: bool, seed: u64, dirt: Option<SharedDirt>) -> World {
    let mut r = rng::stream(seed, "recorded");
    let (motion, mut hidden_effects) = hidden(kind, seed);
    let drawn = LAUNCHES[0] * (LAUNCHES[1] / LAUNCHES[0]).powf(r.random_range(0.0..1.0));
    let count = if kind == Kind::Spin { 80 } else { drawn.round() as usize };
    let (starts, times) = thrown(motion, alike, count, seed);
    let base = Law::plain(r.random_range(0.7..0.85), r.random_range(0.2..0.4));
    let apart = |law: &Law| {
        // A subset of trials represents all.
        let some = starts.len().min(14);
        distinguishable_shift(motion, &starts[..some], &times[..some], &base, law)
    };
    let variation = apart(&Law { lifts: vec![LIFT_SPREAD], turn: TURN_SPREAD, ..base.clone() });
    let variation = variation / (count as f64).sqrt();
    let fixed = matches!(kind, Kind::Spin | Kind::Nothing(_));
    let shared = dirt.as_ref().map_or(0.0, |dirt| {
        let mut law = base.clone();
        dirt.act(&mut law, false);
        apart(&law)
    });
    let least = (MARGIN * variation).max(RATIO * shared);
    let (noise, shift) = strength(if fixed { 0.0 } else { least }, seed);
    let mut shift_m = f64::INFINITY;
    for part in &mut hidden_effects {
        shift_m = shift_m.min(part.fit((!fixed).then_some(noise * shift), &base, &apart));
    }
    let shift_m = if hidden_effects.is_empty() { 0.0 } else { shift_m };
    // An effect of limited strength is observed with a better camera.
    let noise = if fixed { noise } else { noise.min(shift_m / SHIFT[0]).max(NOISE[0]) };
    let spin = (kind == Kind::Spin).then(|| [0.05 * normal(&mut r), 0.3]);
    let mut laws = drawn_laws(&base, &hidden_effects, count, spin, seed);
    if let Some(dirt) = &dirt {
        // An effect of limited strength is beside less dirt.
        let share = if hidden_effects.is_empty() { 1.0 } else { (shift_m / (RATIO * shared)).min(1.0) };
        let dirt = dirt.scaled(share);
        let is_drag = hidden_effects.iter().all(|e| e.name.ends_with("drag"));
        laws.iter_mut().for_each(|law| dirt.act(law, is_drag));
    }
    let mut even = base.clone();
    hidden_effects.iter().for_each(|p| p.act(&mut even, p.size));
    let scene = if motion == Motion::Flies { scene() } else { floor() };
    // Not every ball has its angle observed.
    let marked = motion != Motion::Flies && r.random::<bool>();
    let camera = Camera { motion, scene: &scene, starts: &starts, times: &times, marked, seed };
    World {
        right: right(kind, &hidden_effects),
        sizes: hidden_effects.iter().flat_map(HiddenEffect::size).collect(),
        trials: camera.recorded(&laws, noise),
        clean: camera.clean(&vec![even; count]),
        shift: shift_m / noise,
        margin: shift_m / variation,
        kind,
        alike,
        scene: scene.clone(),
        noise,
        laws,
    }
}

/// Noise (m) and shift (standard deviations) of an effect that shifts paths by at least `least` m; the maximum
/// if that is less.
fn strength(least: f64, seed: u64) -> (f64, f64) {
    let mut r = rng::stream(seed, "strength");
    let mut draw = || {
        let noise = NOISE[0] * (NOISE[1] / NOISE[0]).powf(r.random_range(0.0..1.0));
        (noise, r.random_range(SHIFT[0]..SHIFT[1]))
    };
    let fits = |(noise, shift): &(f64, f64)| noise * shift >= least;
    (0..1000).map(|_| draw()).find(fits).unwrap_or((NOISE[1], SHIFT[1]))
}

/// Correct sets: in free flight gravity, a length scale and a clock rate are equivalent, and a camera tilt
/// resembles wind along x.
fn right(kind: Kind, hidden_effects: &[HiddenEffect]) -> Vec<Vec<&'static str>> {
    let truth: Vec<&str> = hidden_effects.iter().map(|p| p.name).collect();
    let mut sets = match kind {
        Kind::Nothing(_) | Kind::Outside(_) => Vec::new(),
        Kind::Spin => vec![truth.clone(), vec!["lift", "quadratic_drag"]],
        _ => vec![truth.clone()],
    };
    let flies = matches!(kind, Kind::Single(_) | Kind::Pair(_));
    let across = hidden_effects.len() == 1
        && flies
        && matches!(hidden_effects[0].name, "wind" | "camera_tilt")
        && hidden_effects[0].across();
    if across {
        sets = vec![truth.clone(), vec![if truth[0] == "wind" { "camera_tilt" } else { "wind" }]];
    }
    if flies && truth.iter().any(|n| GRAVITY_TWINS.contains(n)) {
        sets = with_twins(&truth);
    }
    sets.iter_mut().for_each(|s| s.sort_unstable());
    sets
}

/// Draws the law of each trial.
fn drawn_laws(
    base: &Law,
    hidden_effects: &[HiddenEffect],
    count: usize,
    spin: Option<[f64; 2]>,
    seed: u64,
) -> Vec<Law> {
    /// More flights than any trial has.
    const FLIGHTS: usize = 16;
    let mut r = rng::stream(seed, "launches' own");
    let mut own = || {
        let mut law = base.clone();
        for part in hidden_effects {
            part.act(&mut law, part.size * (1.0 + SIZE_SPREAD * normal(&mut r)));
        }
        let [mean, spread] = spin.unwrap_or([0.0, LIFT_SPREAD]);
        law.lifts = (0..FLIGHTS).map(|_| mean + spread * normal(&mut r)).collect();
        law.turn += TURN_SPREAD * normal(&mut r);
        law
    };
    (0..count).map(|_| own()).collect()
}

/// Initial states and observation times (s).
fn thrown(motion: Motion, alike: bool, count: usize, seed: u64) -> (Vec<State>, Vec<Vec<f64>>) {
    let mut r = rng::stream(seed, "recorded launches");
    let mut within = |a: f64, b: f64| r.random_range(a..b);
    let base = match motion {
        Motion::Flies => [within(4.0, 7.5), within(0.5, 1.1), within(0.7, 1.3)],
        Motion::Bounces => [within(0.8, 3.0), within(0.6, 1.2), within(-20.0, 20.0)],
        Motion::Rolls => [within(1.4, 2.8), 0.0, 0.0],
    };
    let wide: Vec<Launch> = launches(count, seed);
    let mut launch = |i: usize| -> (State, f64) {
        let mut near = |value: f64| value * within(0.95, 1.05);
        match motion {
            Motion::Flies if alike => {
                let (speed, angle) = (near(base[0]), near(base[1]));
                let start = [0.0, 1.0, speed * angle.cos(), speed * angle.sin(), 0.0, 0.0];
                (start, base[2])
            }
            Motion::Flies => {
                let ([x, y, vx, vy], duration) = wide[i];
                ([x, y, vx, vy, 0.0, 0.0], duration)
            }
            Motion::Bounces if alike => {
                ([0.0, near(base[1]), near(base[0]), 0.0, base[2] + within(-5.0, 5.0), 0.0], 1.5)
            }
            Motion::Bounces => {
                let (v, spin) = (within(-3.0, 3.0), within(-20.0, 20.0));
                ([0.0, within(0.6, 2.5), v, within(-1.0, 1.0), spin, 0.0], 1.5)
            }
            Motion::Rolls => {
                let v = if alike { near(base[0]) } else { within(0.8, 3.0) };
                let v = if !alike && i % 3 == 2 { -v } else { v };
                ([if v > 0.0 { 0.0 } else { 3.0 }, RADIUS, v, 0.0, -v / RADIUS, 0.0], 1.5)
            }
        }
    };
    let all: Vec<(State, f64)> = (0..count).map(&mut launch).collect();
    let times = |duration: f64| (0..=(duration * RATE) as usize).map(|k| k as f64 / RATE).collect();
    let mut starts: Vec<State> = all.iter().map(|(start, _)| *start).collect();
    // Positions of release vary.
    for start in starts.iter_mut().filter(|_| alike) {
        start[0] += within(-0.05, 0.05);
        start[1] += if motion == Motion::Flies { within(-0.05, 0.05) } else { 0.0 };
    }
    (starts, all.iter().map(|(_, duration)| times(*duration)).collect())
}
