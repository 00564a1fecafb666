//! Hidden worlds for tests of the diagnosis: thrown balls with a force that the scene lacks.
//!
//! The integrator is independent: fourth-order Runge-Kutta at 1/2000 s with forces written here, so that the
//! code under test does not generate its own data. Noise is white, autoregressive (0.6), rounded, or white with
//! 3 % outliers.

#[allow(dead_code, reason = "not every program uses recorded worlds")]
pub mod camera;
mod contact;
#[allow(dead_code, reason = "not every program uses motions with contacts")]
pub mod contact_motion;
#[allow(dead_code, reason = "not every program uses recorded worlds")]
mod hidden_effects;
#[allow(dead_code, reason = "not every program uses recorded worlds")]
pub mod law;
#[allow(dead_code, reason = "not every program uses recorded worlds")]
pub mod recorded;
#[allow(dead_code, reason = "not every program uses recorded worlds")]
pub mod shared;
#[allow(dead_code, reason = "not every program studies worlds")]
pub mod study;

use std::sync::Arc;

use iplw::reality::{Trial, trials_from_csv};
use iplw::rng;
use iplw::task::Scene;
use rand::RngExt;
use rand_distr::{Distribution, StandardNormal};

pub use contact::*;

/// A force per mass of the hidden world: (t, x, y, vx, vy) -> (ax, ay), m/s^2.
pub type Force = Arc<dyn Fn(f64, [f64; 4]) -> [f64; 2] + Send + Sync>;

/// Kind of observation noise.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Noise {
    White,
    Correlated,
    Rounded,
    Outliers,
}

pub const NOISES: [Noise; 4] = [Noise::White, Noise::Correlated, Noise::Rounded, Noise::Outliers];

/// A hidden force.
#[derive(Clone)]
pub struct HiddenForce {
    /// Names of the effects; empty for none.
    pub names: Vec<&'static str>,
    /// A parameter to compare: effect, name, true value.
    pub parameter: Option<(&'static str, &'static str, f64)>,
    pub force: Force,
    /// The force that the noise is scaled by; the complete force if `None`.
    pub measure: Option<Force>,
}

/// Single library effects with strengths drawn from `seed`.
pub fn single(kind: usize, seed: u64) -> HiddenForce {
    let mut r = rng::stream(seed, "hidden effect");
    let share: f64 = r.random_range(0.7..1.4);
    let sign = if r.random::<bool>() { 1.0 } else { -1.0 };
    let make = |name, parameter: &'static str, value: f64, force: Force| HiddenForce {
        names: vec![name],
        parameter: Some((name, parameter, value)),
        force,
        measure: None,
    };
    match kind {
        0 => {
            let c = 0.4 * share;
            make("linear_drag", "c", c, Arc::new(move |_, s| [-c * s[2], -c * s[3]]))
        }
        1 => {
            let k = 0.08 * share;
            make(
                "quadratic_drag",
                "k",
                k,
                Arc::new(move |_, s| {
                    let v = s[2].hypot(s[3]);
                    [-k * v * s[2], -k * v * s[3]]
                }),
            )
        }
        2 => {
            let a = [0.6 * share * sign, 0.3 * share];
            make("wind", "ax", a[0], Arc::new(move |_, _| a))
        }
        3 => {
            let (u, k) = ([3.0 * sign, 0.5], 0.1 * share);
            make(
                "moving_air",
                "k",
                k,
                Arc::new(move |_, s| {
                    let w = [s[2] - u[0], s[3] - u[1]];
                    let v = w[0].hypot(w[1]);
                    [-k * v * w[0], -k * v * w[1]]
                }),
            )
        }
        4 => {
            let dg = 0.5 * share * sign;
            make("gravity_error", "dg", dg, Arc::new(move |_, _| [0.0, -dg]))
        }
        5 => {
            let l = 0.3 * share * sign;
            make("lift", "s", l, Arc::new(move |_, s| [-l * s[3], l * s[2]]))
        }
        6 => {
            let (a, period, phase) = ([1.5 * share, 0.8 * share * sign], 0.7 * share, 1.0);
            make(
                "gust",
                "period",
                period,
                Arc::new(move |t, _| {
                    let swing = (std::f64::consts::TAU * t / period + phase).sin();
                    [a[0] * swing, a[1] * swing]
                }),
            )
        }
        7 => {
            let k = [1.2 * share, 0.8 * share * sign];
            make(
                "position_field",
                "kx",
                k[0],
                Arc::new(move |_, s| [k[0] * (2.0 - s[0]), k[1] * (2.0 - s[1])]),
            )
        }
        _ => {
            let (c, at) = (1.2 * share, 1.0 + 0.5 * share);
            make(
                "sticky_patch",
                "c",
                c,
                Arc::new(
                    move |_, s| {
                        if s[0] >= at && s[0] <= at + 1.5 { [-c * s[2], -c * s[3]] } else { [0.0, 0.0] }
                    },
                ),
            )
        }
    }
}

/// In free flight with unknown initial states, a gravity error, a wrong length scale and a wrong clock rate are
/// indistinguishable.
#[allow(dead_code, reason = "not every program scores a diagnosis")]
pub const GRAVITY_TWINS: [&str; 3] = ["gravity_error", "position_scale", "time_scale"];

/// A set of effects, and those that free flights cannot distinguish from it, with sorted names.
#[allow(dead_code, reason = "not every program scores a diagnosis")]
pub fn with_twins(set: &[&'static str]) -> Vec<Vec<&'static str>> {
    let mut sets = vec![set.to_vec()];
    if let Some(at) = set.iter().position(|n| GRAVITY_TWINS.contains(n)) {
        for twin in GRAVITY_TWINS.into_iter().filter(|t| *t != set[at]) {
            let mut other = set.to_vec();
            other[at] = twin;
            sets.push(other);
        }
    }
    sets.iter_mut().for_each(|s| s.sort_unstable());
    sets
}

/// Number of kinds of [`single`].
pub const SINGLES: usize = 9;

/// Two effects that shift paths equally: `shift` of [`trials`] holds for each of them.
pub fn double(kind: usize, seed: u64) -> HiddenForce {
    let (a, b, names) = two(kind, seed);
    let mut share = 1.0;
    for _ in 0..3 {
        let (own, force) = (share, b.force.clone());
        let scaled: Force = Arc::new(move |t, s| force(t, s).map(|v| own * v));
        share *= trajectory_shift(&a.force, seed) / trajectory_shift(&scaled, seed).max(1e-12);
    }
    HiddenForce {
        names,
        parameter: a.parameter,
        force: sum(&a.force, &b.force, share),
        measure: Some(a.force),
    }
}

/// Two effects without balancing; one may be much fainter.
pub fn unbalanced_double(kind: usize, seed: u64) -> HiddenForce {
    let (a, b, names) = two(kind, seed);
    HiddenForce { names, parameter: a.parameter, force: sum(&a.force, &b.force, 1.0), measure: None }
}

/// Number of kinds of [`double`].
pub const DOUBLES: usize = 5;

fn two(kind: usize, seed: u64) -> (HiddenForce, HiddenForce, Vec<&'static str>) {
    let pairs = [(0, 2), (1, 5), (4, 5), (1, 2), (5, 6)];
    let (a, b) = pairs[kind % DOUBLES];
    let (a, b) = (single(a, seed), single(b, seed + 1));
    let names = vec![a.names[0], b.names[0]];
    (a, b, names)
}

fn sum(a: &Force, b: &Force, share: f64) -> Force {
    let (a, b) = (a.clone(), b.clone());
    Arc::new(move |t, s| {
        let (p, q) = (a(t, s), b(t, s));
        [p[0] + share * q[0], p[1] + share * q[1]]
    })
}

/// Root-mean-square shift of paths, m.
fn trajectory_shift(force: &Force, seed: u64) -> f64 {
    let (mut square, mut number) = (0.0, 0.0);
    for (start, duration) in launches(14, seed) {
        let (path, plain) =
            (flight(start, duration, 20, force), flight(start, duration, 20, &no_effect().force));
        for (p, q) in path.iter().zip(&plain) {
            square += (p.1[0] - q.1[0]).powi(2) + (p.1[1] - q.1[1]).powi(2);
            number += 2.0;
        }
    }
    f64::sqrt(square / number)
}

/// Kinds of [`outside`]: position-dependent gravity, a chirped gust, a vortex, a chequered force pattern, a
/// ring-shaped patch.
pub const OUTSIDE: [&str; 5] = ["bumps", "chirp", "swirl", "chequer", "ring"];

/// A force that the library lacks.
pub fn outside(kind: usize, seed: u64) -> HiddenForce {
    let mut r = rng::stream(seed, "outside effect");
    let share: f64 = r.random_range(0.8..1.3);
    let force: Force = match kind % OUTSIDE.len() {
        // A spatially periodic force with a period of 1.6 m.
        0 => Arc::new(move |_, s| [0.0, 3.0 * share * (4.0 * s[0]).sin()]),
        // A chirped gust.
        1 => Arc::new(move |t, _| [2.0 * share * (9.0 * t * t + 2.0 * t).sin(), 0.0]),
        // A vortex that decays with distance.
        2 => Arc::new(move |_, s| {
            let d = [s[0] - 1.5, s[1] - 1.5];
            let f = 6.0 * share / (0.15 + d[0] * d[0] + d[1] * d[1]);
            [-f * d[1], f * d[0]]
        }),
        // A sticky ring, unlike any rectangle.
        4 => Arc::new(move |_, s| {
            let far = (s[0] - 1.5).hypot(s[1] - 1.5);
            let kept = if (0.5..1.1).contains(&far) { -3.0 * share } else { 0.0 };
            [kept * s[2], kept * s[3]]
        }),
        // A chequered force pattern.
        _ => Arc::new(move |_, s| {
            if (3.0 * s[0]).sin() * (3.0 * s[1]).sin() > 0.0 { [4.0 * share, 0.0] } else { [0.0; 2] }
        }),
    };
    HiddenForce { names: vec!["outside"], parameter: None, force, measure: None }
}

/// No hidden force.
pub fn no_effect() -> HiddenForce {
    HiddenForce { names: Vec::new(), parameter: None, force: Arc::new(|_, _| [0.0; 2]), measure: None }
}

/// An observed position.
fn noisy(noise: Noise, at: [f64; 2], sd: f64, carried: &mut [f64; 2], r: &mut rng::Stream) -> [f64; 2] {
    let mut seen = at;
    for axis in 0..2 {
        match noise {
            Noise::White => seen[axis] += sd * normal(r),
            Noise::Correlated => {
                carried[axis] = 0.6 * carried[axis] + 0.8 * normal(r);
                seen[axis] += sd * carried[axis];
            }
            Noise::Rounded => {
                // The grain that makes the total standard deviation equal to `sd`.
                let grain = sd * (12.0f64 * 0.75).sqrt();
                seen[axis] = ((seen[axis] + 0.5 * sd * normal(r)) / grain).round() * grain;
            }
            Noise::Outliers => {
                let wide = if r.random_range(0.0..1.0) < 0.03 { 15.0 } else { 1.0 };
                seen[axis] += sd * wide * normal(r);
            }
        }
    }
    seen
}

/// The scene for a diagnosis: a ball in the air.
pub fn scene() -> Scene {
    Scene::from_json(
        r#"{"format": "iplw.scene/1", "gravity": [0, -9.81], "time_step": 0.005,
            "bodies": [{"name": "ball", "shape": {"type": "disc", "radius": 0.05}, "mass": 0.1}]}"#,
    )
    .expect("the scene is valid")
}

/// Trials of a hidden world. The noise's standard deviation is `1 / shift` of the root-mean-square path shift that the
/// hidden effect causes (2 mm where there is none).
pub fn trials(
    hidden: &HiddenForce,
    noise: Noise,
    count: usize,
    rows: usize,
    shift: f64,
    seed: u64,
) -> Vec<Trial> {
    thrown(hidden, noise, &launches(count, seed), rows, noise_sd(hidden, count, rows, shift, seed), seed)
}

/// Standard deviation of the noise of [`trials`], m.
pub fn noise_sd(hidden: &HiddenForce, count: usize, rows: usize, shift: f64, seed: u64) -> f64 {
    let force = hidden.measure.as_ref().unwrap_or(&hidden.force);
    let (mut square, mut number) = (0.0, 0.0);
    for (start, duration) in launches(count, seed) {
        let path = flight(start, duration, rows, force);
        let plain = flight(start, duration, rows, &no_effect().force);
        for (p, q) in path.iter().zip(&plain) {
            square += (p.1[0] - q.1[0]).powi(2) + (p.1[1] - q.1[1]).powi(2);
            number += 2.0;
        }
    }
    if square > 0.0 { f64::sqrt(square / number) / shift } else { 0.002 }
}

/// x, y, vx, vy at the start (m, m/s) and duration, s.
pub type Launch = ([f64; 4], f64);

/// Random launches in all directions and at many speeds.
pub fn launches(count: usize, seed: u64) -> Vec<Launch> {
    let mut r = rng::stream(seed, "launches");
    (0..count)
        .map(|_| {
            let (speed, angle): (f64, f64) = (r.random_range(2.5..8.0), r.random_range(0.2..1.35));
            let side = if r.random_range(0.0..1.0) < 0.3 { -1.0 } else { 1.0 };
            let start: [f64; 4] = [
                if side > 0.0 { 0.0 } else { 4.0 },
                r.random_range(0.5..1.5),
                side * speed * angle.cos(),
                speed * angle.sin(),
            ];
            (start, r.random_range(0.7..1.3))
        })
        .collect()
}

/// Observed trials of launches in a hidden world; `sd`: standard deviation of the noise, m.
pub fn thrown(
    hidden: &HiddenForce,
    noise: Noise,
    launches: &[Launch],
    rows: usize,
    sd: f64,
    seed: u64,
) -> Vec<Trial> {
    let mut csv = String::from("trial,t,body,x,y\n");
    let mut r = rng::stream(seed, "noise");
    for (i, (start, duration)) in launches.iter().enumerate() {
        let mut carried: [f64; 2] = [normal(&mut r), normal(&mut r)];
        for (t, p) in flight(*start, *duration, rows, &hidden.force) {
            let seen = noisy(noise, p, sd, &mut carried, &mut r);
            csv += &format!("{i},{t},ball,{},{}\n", seen[0], seen[1]);
        }
    }
    trials_from_csv(&csv, &scene()).expect("generated trials are valid")
}

fn normal(r: &mut rng::Stream) -> f64 {
    StandardNormal.sample(r)
}

/// Positions at `rows` equal times.
pub fn flight(start: [f64; 4], duration: f64, rows: usize, force: &Force) -> Vec<(f64, [f64; 2])> {
    let slope = |t: f64, s: [f64; 4]| {
        let a = force(t, s);
        [s[2], s[3], a[0], a[1] - 9.81]
    };
    let add = |s: [f64; 4], k: [f64; 4], h: f64| -> [f64; 4] { std::array::from_fn(|i| s[i] + h * k[i]) };
    let (mut state, mut out) = (start, vec![(0.0, [start[0], start[1]])]);
    let gap = duration / (rows - 1) as f64;
    let steps = (gap / 5e-4).ceil() as usize;
    let h = gap / steps as f64;
    for row in 1..rows {
        for k in 0..steps {
            let t = gap * (row - 1) as f64 + h * k as f64;
            let k1 = slope(t, state);
            let k2 = slope(t + h / 2.0, add(state, k1, h / 2.0));
            let k3 = slope(t + h / 2.0, add(state, k2, h / 2.0));
            let k4 = slope(t + h, add(state, k3, h));
            state = std::array::from_fn(|i| state[i] + h / 6.0 * (k1[i] + 2.0 * k2[i] + 2.0 * k3[i] + k4[i]));
        }
        out.push((gap * row as f64, [state[0], state[1]]));
    }
    out
}
