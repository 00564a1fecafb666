//! Hidden worlds as recordings are: launches differ, and what is seen of them errs in more than one way.
//!
//! Drawn anew for each launch: the size of what is hidden, a small lift of either sign (of each flight, where the ball
//! bounces: a bounce changes the spin), the turn of the camera; then noise that is correlated, outliers, and points that
//! are missing. Nothing of it is common to all launches. Each world has a clean twin, whose launches and effect are the
//! same and in which none of this is: what cannot be told there can be told nowhere.

use super::camera::Camera;
use super::law::{Law, Motion, RADIUS, State, told_apart};
pub use super::parts::{Kind, Size, kinds};
use super::parts::{Part, hidden};
use super::{Launch, floor, launches, normal, scene};
use iplw::reality::Trial;
use iplw::rng;
use iplw::task::Scene;
use rand::RngExt;

/// Standard deviation of an effect's size by launch, relative.
pub const SIZE_SPREAD: f64 = 0.15;
/// Standard deviation of the lift that a launch has of its own, 1/s.
pub const LIFT_SPREAD: f64 = 0.06;
/// Standard deviation of the camera's turn, rad.
pub const TURN_SPREAD: f64 = 0.2 * std::f64::consts::PI / 180.0;
/// Standard deviation of the noise, m: from, to.
const NOISE: [f64; 2] = [5e-4, 3e-3];
/// What a hidden effect changes, in deviations of the noise (`told_apart`): from, to.
const SHIFT: [f64; 2] = [5.0, 20.0];
/// Least share of that over what one deviation of the launches' own lifts and turns changes in their mean. An effect below
/// it would be hidden in how launches differ, where nobody can find it: such draws of noise and shift are drawn again.
const MARGIN: f64 = 4.0;
/// Observations per second.
const RATE: f64 = 50.0;
/// Launches: from, to.
const LAUNCHES: [f64; 2] = [14.0, 80.0];

/// One world: what is hidden in it and what a diagnosis is given.
#[derive(Clone)]
pub struct World {
    pub kind: Kind,
    /// Sets that are right, sorted names each: what was hidden first, then what no such data can tell from it. Empty for
    /// nothing and for what no library holds.
    pub right: Vec<Vec<&'static str>>,
    pub sizes: Vec<Size>,
    /// Whether all launches have the same speed and angle within 5 %.
    pub alike: bool,
    pub scene: Scene,
    /// Standard deviation of the noise, m.
    pub noise: f64,
    /// What the effect changes (`told_apart`), in deviations of the noise; of two the fainter.
    pub shift: f64,
    /// The same over what one deviation of the launches' own lifts and turns changes in their mean.
    pub margin: f64,
    /// The law of each launch.
    pub laws: Vec<Law>,
    pub trials: Vec<Trial>,
    /// Without noise and dirt.
    pub clean: Vec<Trial>,
}

/// World number `i`, kind after kind; launches are alike and unlike by turns.
pub fn world(i: u64, seed: u64) -> World {
    let (kinds, own) = (kinds(), rng::derive(seed, "recorded world", i));
    let (round, k) = (i as usize / kinds.len(), i as usize % kinds.len());
    of_kind(kinds[k], (round + k) % 2 == 1, own)
}

/// A world of a kind.
pub fn of_kind(kind: Kind, alike: bool, seed: u64) -> World {
    let mut r = rng::stream(seed, "recorded");
    let (motion, mut parts) = hidden(kind, seed);
    let drawn = LAUNCHES[0] * (LAUNCHES[1] / LAUNCHES[0]).powf(r.random_range(0.0..1.0));
    let count = if kind == Kind::Spin { 80 } else { drawn.round() as usize };
    let (starts, times) = thrown(motion, alike, count, seed);
    let base = Law::plain(r.random_range(0.7..0.85), r.random_range(0.2..0.4));
    let apart = |law: &Law| {
        // Some launches stand for all.
        let some = starts.len().min(14);
        told_apart(motion, &starts[..some], &times[..some], &base, law)
    };
    let dirt = apart(&Law { lifts: vec![LIFT_SPREAD], turn: TURN_SPREAD, ..base.clone() });
    let dirt = dirt / (count as f64).sqrt();
    let fixed = matches!(kind, Kind::Spin | Kind::Nothing(_));
    let (noise, shift) = strength(if fixed { 0.0 } else { MARGIN * dirt }, seed);
    let mut moved = f64::INFINITY;
    for part in &mut parts {
        moved = moved.min(part.fit((!fixed).then_some(noise * shift), &base, &apart));
    }
    let moved = if parts.is_empty() { 0.0 } else { moved };
    // An effect that may not be stronger is seen by a better camera.
    let noise = if fixed { noise } else { noise.min(moved / SHIFT[0]).max(NOISE[0]) };
    let spin = (kind == Kind::Spin).then(|| [0.05 * normal(&mut r), 0.3]);
    let laws = drawn_laws(&base, &parts, count, spin, seed);
    let mut even = base.clone();
    parts.iter().for_each(|p| p.act(&mut even, p.size));
    let scene = if motion == Motion::Flies { scene() } else { floor() };
    // A mark that shows how the ball turns is not on every ball.
    let marked = motion != Motion::Flies && r.random::<bool>();
    let camera = Camera { motion, scene: &scene, starts: &starts, times: &times, marked, seed };
    World {
        right: right(kind, &parts),
        sizes: parts.iter().flat_map(Part::size).collect(),
        trials: camera.recorded(&laws, noise),
        clean: camera.clean(&vec![even; count]),
        shift: moved / noise,
        margin: moved / dirt,
        kind,
        alike,
        scene: scene.clone(),
        noise,
        laws,
    }
}

/// Deviation of the noise (m) and shift (deviations) of an effect that changes paths by no less than `least` m; the most
/// there is where that is less.
fn strength(least: f64, seed: u64) -> (f64, f64) {
    let mut r = rng::stream(seed, "strength");
    let mut draw = || {
        let noise = NOISE[0] * (NOISE[1] / NOISE[0]).powf(r.random_range(0.0..1.0));
        (noise, r.random_range(SHIFT[0]..SHIFT[1]))
    };
    let fits = |(noise, shift): &(f64, f64)| noise * shift >= least;
    (0..1000).map(|_| draw()).find(fits).unwrap_or((NOISE[1], SHIFT[1]))
}

/// Sets that are right: in free flight gravity, a scale and a clock look alike, and a tilted camera like wind along x.
fn right(kind: Kind, parts: &[Part]) -> Vec<Vec<&'static str>> {
    const GRAVITY: [&str; 3] = ["gravity_error", "position_scale", "time_scale"];
    let truth: Vec<&str> = parts.iter().map(|p| p.name).collect();
    let mut sets = match kind {
        Kind::Nothing(_) | Kind::Outside(_) => Vec::new(),
        Kind::Spin => vec![truth.clone(), vec!["lift", "quadratic_drag"]],
        _ => vec![truth.clone()],
    };
    let flies = matches!(kind, Kind::Single(_) | Kind::Pair(_));
    let across =
        parts.len() == 1 && flies && matches!(parts[0].name, "wind" | "camera_tilt") && parts[0].across();
    if across {
        sets = vec![truth.clone(), vec![if truth[0] == "wind" { "camera_tilt" } else { "wind" }]];
    }
    if flies && let Some(at) = truth.iter().position(|n| GRAVITY.contains(n)) {
        for twin in GRAVITY.into_iter().filter(|t| *t != truth[at]) {
            let mut set = truth.clone();
            set[at] = twin;
            sets.push(set);
        }
    }
    sets.iter_mut().for_each(|s| s.sort_unstable());
    sets
}

/// The law of each launch.
fn drawn_laws(base: &Law, parts: &[Part], count: usize, spin: Option<[f64; 2]>, seed: u64) -> Vec<Law> {
    /// More flights than a launch has.
    const FLIGHTS: usize = 16;
    let mut r = rng::stream(seed, "launches' own");
    let mut own = || {
        let mut law = base.clone();
        for part in parts {
            part.act(&mut law, part.size * (1.0 + SIZE_SPREAD * normal(&mut r)));
        }
        let [mean, spread] = spin.unwrap_or([0.0, LIFT_SPREAD]);
        law.lifts = (0..FLIGHTS).map(|_| mean + spread * normal(&mut r)).collect();
        law.turn += TURN_SPREAD * normal(&mut r);
        law
    };
    (0..count).map(|_| own()).collect()
}

/// Starts, and times of observations (s).
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
    // Nobody lets go at the same place twice.
    for start in starts.iter_mut().filter(|_| alike) {
        start[0] += within(-0.05, 0.05);
        start[1] += if motion == Motion::Flies { within(-0.05, 0.05) } else { 0.0 };
    }
    (starts, all.iter().map(|(_, duration)| times(*duration)).collect())
}
