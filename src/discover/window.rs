//! Cutting trials into windows, each simulated on its own from a start of its own.
//!
//! - *Flight*: one body between contacts. Its initial position and velocity are nuisances; nothing else is in the
//!   scene, so that no perturbed start can hit anything.
//! - *Contact*: a few observations before and after one bounce on a static. Nuisances: position, velocity, spin, and
//!   where along its normal the surface really is (tables are level to millimetres at best).
//! - *Roll*: a disc on a straight static. Nuisances: position and speed along it, its real height and slope.
//! - *Run*: the beginning of a trial whose start is known exactly; no nuisance, up to the time at which the start's
//!   smallest error would show.
//! - *Leap*: from one observation of everything, velocities and spins too, to the next; no nuisance.
//! - *Shot*: a few observations of all bodies of such a trial, simulated with everything that can touch; each body's
//!   position, velocity and spin are nuisances. Short enough that one collision does not hide what came before it.
//!
//! Source: multiple shooting (Bock, 1983), with starts taken as nuisances instead of being tied together: what happens
//! in a contact then cannot leak into what is said about the motion.

use nalgebra::{DMatrix, DVector};

use super::noise::{Smooth, smooth};
use super::stats::{median, slope};
use crate::reality::Trial;
use crate::task::Scene;
use crate::trajectory::{Track, Trajectory};
use crate::world::effect::{self, Active};

/// What a window is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    Flight,
    Contact,
    Roll,
    Run,
    Leap,
    Shot,
}

impl Kind {
    /// Whether a world's engine simulates it, with all that can touch.
    pub fn simulated(self) -> bool {
        matches!(self, Kind::Run | Kind::Leap | Kind::Shot)
    }

    /// Whether chance in a collision can take it another way than simulated, whatever the model.
    pub fn strays(self) -> bool {
        matches!(self, Kind::Leap | Kind::Shot)
    }
}

/// Whether there are stretches that start from what was seen whole.
pub fn leaping(windows: &[Window]) -> bool {
    windows.iter().any(|w| w.kind == Kind::Leap)
}

/// Whether there are stretches whose starts are found along: collisions can lead those astray, far above any floor.
pub fn shooting(windows: &[Window]) -> bool {
    windows.iter().any(|w| w.kind == Kind::Shot)
}

/// The straight piece of a static that a disc bounces off or rolls along.
#[derive(Clone, Debug)]
pub struct Surface {
    /// Away from the static.
    pub normal: [f64; 2],
    /// The disc's centre is at `normal . p = level` when it touches, m.
    pub level: f64,
    /// Coefficients of the body and of the static, and whether each carries the latents.
    pub friction: [f64; 2],
    pub restitution: [f64; 2],
    pub carries: [bool; 2],
    /// m
    pub radius: f64,
    /// Moment of inertia over mass and radius squared.
    pub inertia: f64,
    /// By how much the spin may differ from where it starts, rad/s: little where it was seen.
    pub spin: f64,
}

/// One observed position.
#[derive(Clone, Copy, Debug)]
pub struct Point {
    /// Index into the window's bodies.
    pub body: usize,
    /// s since the window's start
    pub time: f64,
    /// m
    pub seen: [f64; 2],
    /// 1, or 0 for an outlier.
    pub weight: f64,
}

/// A piece of a trial.
#[derive(Clone)]
pub struct Window {
    /// Index of the trial.
    pub trial: usize,
    /// Index of the setting.
    pub setting: usize,
    pub kind: Kind,
    /// What is simulated.
    pub scene: Scene,
    /// Clock time at the start, s.
    pub start: f64,
    /// In order of time.
    pub points: Vec<Point>,
    /// Initial values of the nuisances: none (run); x, y, vx, vy (flight), and omega and offset (contact); way, speed,
    /// height, slope (roll); x, y, vx, vy, omega of each body (shot).
    pub nuisances: Vec<f64>,
    /// What is touched in a contact or roll.
    pub surface: Option<Surface>,
    /// The scene's own effects.
    pub own: Vec<Active>,
    /// The data's own smooth, for the noise floor.
    pub smooth: Option<Smooth>,
}

impl Window {
    /// Index of the observation that the window starts from, if it starts from one.
    pub fn first(&self, observed: &Trajectory) -> Option<usize> {
        observed.times.iter().position(|t| *t == self.start)
    }
}

/// Fewest observations of a flight: 4 nuisances for 2n coordinates must leave something to test.
pub const FLIGHT: usize = 7;
/// Intervals of a shot: each body's 5 unknowns against 2 coordinates at one observation more than that.
pub const SHOT: usize = 3;
/// Most shots of a trial.
const SHOTS: usize = 6;
/// Leaps of all trials together, more or less, and the fewest that a trial is given: without nuisances and noise a few
/// tell a lot.
const LEAPS: usize = 160;
const FEWEST: usize = 3;
/// m in a shot; less is rest.
const MOVES: f64 = 0.1;
/// rad/s: what a ball may spin at that nobody watched, and the error of a spin that was seen.
const UNSEEN_SPIN: f64 = 300.0;
const SEEN_SPIN: f64 = 0.5;
/// Rows on each side that tell whether a surface holds a body, and the share of gravity below which it does not fall.
const SUPPORTED: usize = 6;
const FALLING: f64 = 0.3;
/// Slope of a straight surface as it may be seen by a camera that is turned a little.
const TURNED: f64 = 0.02;
/// Observations on each side of a bounce.
const AROUND: usize = 8;
/// Longest gap between observations within a window, as a multiple of the usual one.
const GAP: f64 = 6.0;

/// All windows of all trials; `settings[i]` is the setting index of trial i.
pub fn cut(base: &Scene, trials: &[Trial], settings: &[usize]) -> Vec<Window> {
    let mut windows = Vec::new();
    for (i, trial) in trials.iter().enumerate() {
        let known = start_is_known(base, trial);
        let before = windows.len();
        if known {
            leaps(trial, i, settings[i], LEAPS.div_ceil(trials.len()).max(FEWEST), &mut windows);
            if windows.len() > before {
                continue;
            }
        }
        if !known || trial.scene.bodies.len() == 1 {
            for body in 0..trial.scene.bodies.len() {
                flights(trial, i, settings[i], body, &mut windows);
            }
        }
        if known && windows.len() == before {
            windows.extend(run(trial, i, settings[i]));
            shots(trial, i, settings[i], &mut windows);
        }
    }
    windows
}

/// m. What a start may be off by that was set rather than measured: single precision leaves some micrometres of it.
const EXACT: f64 = 1e-5;

/// Whether the scene says where everything starts and the first observation says the same.
fn start_is_known(base: &Scene, trial: &Trial) -> bool {
    let Ok(placed) = base.in_setting(trial.setting.as_deref().unwrap_or_default()) else { return false };
    let from_run = trial.setting.is_none() && base.action.is_some();
    trial.observed.bodies.iter().enumerate().all(|(k, track)| {
        let expected = if from_run { trial.scene.bodies[k].position } else { placed.bodies[k].position };
        match (expected, track.x.first(), track.y.first()) {
            (Some(p), Some(x), Some(y)) => (p[0] - x).abs() < EXACT && (p[1] - y).abs() < EXACT,
            _ => false,
        }
    })
}

fn run(trial: &Trial, index: usize, setting: usize) -> Option<Window> {
    let mut scene = trial.scene.clone();
    scene.stop = Some(false);
    let start = *trial.observed.times.first()?;
    let mut points = Vec::new();
    for (i, t) in trial.observed.times.iter().enumerate().skip(1).take(SHOT) {
        for (body, track) in trial.observed.bodies.iter().enumerate() {
            if let Some(seen) = seen(track, i) {
                points.push(Point { body, time: t - start, seen, weight: 1.0 });
            }
        }
    }
    let last = points.last()?.time;
    let every = scene.observe_every.max(1);
    let on_grid = points.iter().all(|p| {
        let steps = p.time / (scene.time_step * f64::from(every));
        (steps - steps.round()).abs() < 1e-6 || (p.time - last).abs() < 1e-9
    });
    if !on_grid {
        scene.observe_every = 1;
    }
    scene.steps = (last / scene.time_step).round().max(1.0) as u32 + u32::from(!on_grid);
    let (own, nuisances) = (own(&scene), Vec::new());
    Some(Window {
        trial: index,
        setting,
        kind: Kind::Run,
        scene,
        start,
        points,
        nuisances,
        surface: None,
        own,
        smooth: None,
    })
}

/// At most so many intervals of a trial in which something moves, evenly spread, if everything is seen of what moves.
fn leaps(trial: &Trial, index: usize, setting: usize, most: usize, out: &mut Vec<Window>) {
    let observed = &trial.observed;
    let whole = |i: usize| {
        let known = |b: &Track| [b.vx[i], b.vy[i], b.omega[i], b.angle[i]].iter().all(|v| v.is_finite());
        observed.bodies.iter().all(|b| seen(b, i).is_some() && known(b))
    };
    let last = observed.times.len().saturating_sub(1);
    if !(0..=last).all(whole) {
        return;
    }
    let moves = |from: &usize| {
        let moved = |b: &Track| (b.x[from + 1] - b.x[*from]).hypot(b.y[from + 1] - b.y[*from]) > MOVES;
        observed.bodies.iter().any(moved)
    };
    let froms: Vec<usize> = (0..last).filter(moves).collect();
    let stride = froms.len().div_ceil(most).max(1);
    for from in froms.into_iter().step_by(stride) {
        let (start, time) = (observed.times[from], observed.times[from + 1] - observed.times[from]);
        let mut scene = trial.scene.clone();
        scene.stop = Some(false);
        (scene.goal, scene.action) = (None, None);
        for (body, track) in scene.bodies.iter_mut().zip(&observed.bodies) {
            body.position = Some([track.x[from], track.y[from]]);
            body.angle = track.angle[from];
            body.velocity = [track.vx[from], track.vy[from]];
            body.angular_velocity = track.omega[from];
        }
        let steps = time / scene.time_step;
        scene.steps = (steps - 1e-6).ceil().max(1.0) as u32;
        scene.observe_every = if (steps - steps.round()).abs() < 1e-6 { scene.steps } else { 1 };
        let point = |(body, track): (usize, &Track)| Point {
            body,
            time,
            seen: [track.x[from + 1], track.y[from + 1]],
            weight: 1.0,
        };
        let points = observed.bodies.iter().enumerate().map(point).collect();
        let (own, nuisances) = (own(&scene), Vec::new());
        let (kind, surface, smooth) = (Kind::Leap, None, None);
        out.push(Window {
            trial: index,
            setting,
            kind,
            scene,
            start,
            points,
            nuisances,
            surface,
            own,
            smooth,
        });
    }
}

/// Stretches of a trial of [`SHOT`] intervals in which something moves, evenly spread.
fn shots(trial: &Trial, index: usize, setting: usize, out: &mut Vec<Window>) {
    let observed = &trial.observed;
    let bodies = observed.bodies.len();
    let whole = |i: usize| observed.bodies.iter().all(|b| seen(b, i).is_some());
    let moves = |i: usize| {
        observed.bodies.iter().any(|b| (b.x[i + SHOT] - b.x[i]).hypot(b.y[i + SHOT] - b.y[i]) > MOVES)
    };
    let last = observed.times.len().saturating_sub(SHOT);
    let froms: Vec<usize> =
        (1..last).step_by(SHOT).filter(|i| (*i..=i + SHOT).all(whole) && moves(*i)).collect();
    let stride = froms.len().div_ceil(SHOTS).max(1);
    for from in froms.into_iter().step_by(stride) {
        let start = observed.times[from];
        let mut scene = trial.scene.clone();
        scene.stop = Some(false);
        (scene.goal, scene.action) = (None, None);
        let mut points = Vec::new();
        for i in from..=from + SHOT {
            for (body, track) in observed.bodies.iter().enumerate() {
                points.push(Point {
                    body,
                    time: observed.times[i] - start,
                    seen: [track.x[i], track.y[i]],
                    weight: 1.0,
                });
            }
        }
        let time = observed.times[from + SHOT] - start;
        let gap = time / SHOT as f64 / scene.time_step;
        let even = (1..=SHOT).all(|k| {
            let steps = (observed.times[from + k] - start) / scene.time_step;
            (steps - gap * k as f64).abs() < 1e-6
        });
        scene.observe_every = if even && (gap - gap.round()).abs() < 1e-6 { gap.round() as u32 } else { 1 };
        scene.steps = (time / scene.time_step - 1e-6).ceil() as u32;
        let mut nuisances = Vec::new();
        for (b, track) in observed.bodies.iter().enumerate() {
            scene.bodies[b].angle = if track.angle[from].is_finite() { track.angle[from] } else { 0.0 };
            nuisances.extend(launch(track, &observed.times, from, scene.gravity, 0));
        }
        debug_assert_eq!(nuisances.len(), 5 * bodies);
        let own = own(&scene);
        out.push(Window {
            trial: index,
            setting,
            kind: Kind::Shot,
            scene,
            start,
            points,
            nuisances,
            surface: None,
            own,
            smooth: None,
        });
    }
}

/// Guesses of a body's position, velocity and spin at an observation: as in flight to the next (0), as if nothing
/// pulled (1), as in flight from the one before (2).
pub fn launch(track: &Track, times: &[f64], at: usize, gravity: [f64; 2], way: usize) -> [f64; 5] {
    let (i, j) = if way == 2 && at > 0 { (at - 1, at) } else { (at, at + 1) };
    let dt = times[j] - times[i];
    let pull = [-0.5, 0.0, 0.5][way] * dt;
    let known = |v: f64| if v.is_finite() { v } else { 0.0 };
    [
        track.x[at],
        track.y[at],
        known((track.x[j] - track.x[i]) / dt + pull * gravity[0]),
        known((track.y[j] - track.y[i]) / dt + pull * gravity[1]),
        known((track.angle[j] - track.angle[i]) / dt),
    ]
}

/// Flights of one body, and the bounces between them.
fn flights(trial: &Trial, index: usize, setting: usize, body: usize, out: &mut Vec<Window>) {
    let track = &trial.observed.bodies[body];
    let rows: Vec<(f64, [f64; 2])> =
        trial.observed.times.iter().enumerate().filter_map(|(i, t)| Some((*t, seen(track, i)?))).collect();
    if rows.len() < 3 {
        return;
    }
    let touches = touches(trial, body, &rows);
    let usual = median(&rows.windows(2).map(|w| w[1].0 - w[0].0).collect::<Vec<_>>());
    // Pieces of flight: runs of rows without touch and without a long gap.
    let mut pieces: Vec<(usize, usize)> = Vec::new();
    let mut first = None;
    for i in 0..=rows.len() {
        let broken = i == rows.len()
            || touches[i].is_some()
            || (i > 0 && first.is_some() && rows[i].0 - rows[i - 1].0 > GAP * usual);
        if broken && let Some(from) = first.take() {
            pieces.push((from, i));
        }
        if i < rows.len() && touches[i].is_none() && first.is_none() {
            first = Some(i);
        }
    }
    let alone = |with: bool| {
        let mut scene = trial.scene.clone();
        scene.bodies = vec![trial.scene.bodies[body].clone()];
        if !with {
            scene.statics = Vec::new();
        }
        (scene.goal, scene.action, scene.carriers) = (None, None, scene.carriers.filter(|_| with));
        scene.settings.clear();
        scene.observe_every = 1;
        scene
    };
    for (from, to) in pieces.iter().filter(|(a, b)| b - a >= FLIGHT) {
        let rows = &rows[*from..*to];
        let smooth = smooth(rows);
        let mut window = shoot(rows, alone(false), Kind::Flight, &[]);
        for (point, kept) in window.points.iter_mut().zip(&smooth.kept) {
            point.weight = if *kept { 1.0 } else { 0.0 };
        }
        let n = rows.len().min(12);
        window.nuisances = start_of(&rows[..n], window.scene.gravity);
        window.smooth = Some(smooth);
        out.push(Window { trial: index, setting, ..window });
    }
    for pair in pieces.windows(2) {
        let ((a, b), (c, d)) = (pair[0], pair[1]);
        let touch = (b..c).find_map(|i| touches[i]);
        let single = c == b + 1 && rows[c].0 - rows[b - 1].0 < 3.0 * usual;
        let (Some(Touch { normal, level, fixed: Some(fixed) }), true) =
            (touch, single && b - a >= 5 && d - c >= 5)
        else {
            continue;
        };
        let Some(surface) = surface(trial, body, fixed, normal, level) else { continue };
        let (from, to) = (b - AROUND.min(b - a), c + AROUND.min(d - c));
        let mut chosen: Vec<(f64, [f64; 2])> = rows[from..b].to_vec();
        chosen.extend(&rows[c..to]);
        let mut window = shoot(&chosen, alone(true), Kind::Contact, &[]);
        window.nuisances = start_of(&rows[from..b], window.scene.gravity);
        let spin = spin(trial, body, &rows[from..b]);
        window.nuisances.extend([spin.unwrap_or(0.0), 0.0]);
        let held = if spin.is_some() { SEEN_SPIN } else { UNSEEN_SPIN };
        window.surface = Some(Surface { spin: held, ..surface });
        out.push(Window { trial: index, setting, ..window });
    }
    for (from, to, touch) in rolls(&touches, &rows) {
        let Some(surface) = touch.fixed.and_then(|f| surface(trial, body, f, touch.normal, touch.level))
        else {
            continue;
        };
        let rows = &rows[from..to];
        let smooth = smooth(rows);
        let mut window = shoot(rows, alone(true), Kind::Roll, &[]);
        for (point, kept) in window.points.iter_mut().zip(&smooth.kept) {
            point.weight = if *kept { 1.0 } else { 0.0 };
        }
        let [_, _, vx, vy] = start_of(&rows[..rows.len().min(12)], [0.0; 2])[..] else { continue };
        window.nuisances = vec![0.0, vx * touch.normal[1] - vy * touch.normal[0], 0.0, 0.0];
        window.surface = Some(surface);
        window.smooth = Some(smooth);
        out.push(Window { trial: index, setting, ..window });
    }
}

/// Spin before a bounce, from angles if they were seen, rad/s.
fn spin(trial: &Trial, body: usize, rows: &[(f64, [f64; 2])]) -> Option<f64> {
    let track = &trial.observed.bodies[body];
    let angle = |t: f64| {
        let at = trial.observed.times.iter().position(|s| *s == t)?;
        track.angle.get(at).copied().filter(|a| a.is_finite())
    };
    let seen: Vec<(f64, f64)> = rows.iter().filter_map(|(t, _)| Some((*t, angle(*t)?))).collect();
    if seen.len() < 4 { None } else { slope(&seen) }
}

/// Stretches (first row, end, what is touched) along one straight static in which the height above it changes no more
/// than noise does.
fn rolls(touches: &[Option<Touch>], rows: &[(f64, [f64; 2])]) -> Vec<(usize, usize, Touch)> {
    let mut out = Vec::new();
    let mut i = 0;
    while i < rows.len() {
        let Some(touch) = touches[i] else {
            i += 1;
            continue;
        };
        let same = |k: usize| {
            touches[k].is_some_and(|t| {
                t.fixed.is_some()
                    && t.fixed == touch.fixed
                    && (t.normal[0] - touch.normal[0]).hypot(t.normal[1] - touch.normal[1]) < 1e-3
            })
        };
        let end = (i..rows.len()).find(|k| !same(*k)).unwrap_or(rows.len());
        // The first of a landing still slides or hops.
        let from = i + if i > 0 { 2 } else { 0 };
        if end >= from + FLIGHT {
            let n = touch.normal;
            let height = |k: usize| rows[k].1[0] * n[0] + rows[k].1[1] * n[1];
            let way = |k: usize| rows[k].1[0] * n[1] - rows[k].1[1] * n[0];
            let third = |f: &dyn Fn(usize) -> f64, k: usize| {
                (f(k + 3) - 3.0 * f(k + 2) + 3.0 * f(k + 1) - f(k)).abs() / 20f64.sqrt()
            };
            let noise: Vec<f64> = (from..end - 3).flat_map(|k| [third(&height, k), third(&way, k)]).collect();
            let noise = 1.4826 * median(&noise);
            let along: Vec<(f64, f64)> = (from..end).map(|k| (way(k), height(k))).collect();
            let tilt = slope(&along).unwrap_or(0.0).clamp(-TURNED, TURNED);
            let level = |k: usize| height(k) - tilt * way(k);
            let mean = (from..end).map(level).sum::<f64>() / (end - from) as f64;
            let spread = (from..end).map(|k| (level(k) - mean).powi(2)).sum::<f64>() / (end - from) as f64;
            if spread.sqrt() < 3.0 * noise + 1e-6 {
                out.push((from, end, touch));
            }
        }
        i = end.max(i + 1);
    }
    out
}

/// What a disc touches; `None` for other shapes, which turn as they touch.
fn surface(trial: &Trial, body: usize, fixed: usize, normal: [f64; 2], level: f64) -> Option<Surface> {
    let (own, other) = (&trial.scene.bodies[body], &trial.scene.statics[fixed]);
    let radius = own.shape.disc_radius()?;
    let (mass, inertia) = own.mass_properties(None);
    Some(Surface {
        normal,
        level,
        friction: [own.friction, other.friction],
        restitution: [own.restitution, other.restitution],
        carries: [trial.scene.carries_latents(&own.name), trial.scene.carries_latents(&other.name)],
        radius,
        inertia: inertia / (mass * radius * radius),
        spin: UNSEEN_SPIN,
    })
}

/// The scene's own effects; a scene was checked before it came here.
fn own(scene: &Scene) -> Vec<Active> {
    let damping = scene.damping.filter(|kept| *kept < 1.0).map(effect::damping);
    damping.iter().chain(&scene.effects).filter_map(|term| effect::resolve(term, "effects").ok()).collect()
}

fn shoot(rows: &[(f64, [f64; 2])], mut scene: Scene, kind: Kind, nuisances: &[f64]) -> Window {
    let start = rows[0].0;
    let points = rows
        .iter()
        .map(|(t, seen)| Point { body: 0, time: t - start, seen: *seen, weight: 1.0 })
        .collect::<Vec<_>>();
    scene.steps = steps(points[points.len() - 1].time, scene.time_step);
    let own = own(&scene);
    Window {
        trial: 0,
        setting: 0,
        kind,
        scene,
        start,
        points,
        nuisances: nuisances.to_vec(),
        surface: None,
        own,
        smooth: None,
    }
}

/// Steps that cover a time and a twentieth more: a sensor's clock may run ahead.
fn steps(time: f64, step: f64) -> u32 {
    (1.05 * time / step + 1e-9).ceil().max(1.0) as u32 + 1
}

/// Position and velocity at the first of some rows: least squares on a parabola with the scene's gravity.
fn start_of(rows: &[(f64, [f64; 2])], gravity: [f64; 2]) -> Vec<f64> {
    let n = rows.len() as f64;
    let t0 = rows[0].0;
    let mean_t = rows.iter().map(|r| r.0 - t0).sum::<f64>() / n;
    let mut out = vec![0.0; 4];
    for axis in 0..2 {
        let fallen = |t: f64| 0.5 * gravity[axis] * t * t;
        let mean = rows.iter().map(|r| r.1[axis] - fallen(r.0 - t0)).sum::<f64>() / n;
        let (mut up, mut down) = (0.0, 0.0);
        for (t, p) in rows {
            let t = t - t0;
            up += (t - mean_t) * (p[axis] - fallen(t) - mean);
            down += (t - mean_t).powi(2);
        }
        let slope = if down > 0.0 { up / down } else { 0.0 };
        (out[axis], out[2 + axis]) = (mean - slope * mean_t, slope);
    }
    out
}

/// A row at which the body touches something.
#[derive(Clone, Copy, Debug)]
struct Touch {
    /// Away from the surface.
    normal: [f64; 2],
    /// Where along the normal the body's centre touches, m.
    level: f64,
    /// The static, if the other is one.
    fixed: Option<usize>,
}

/// For each row whether the body touches something about then: the gap to it has a low minimum where approach turns
/// into departure, or stays low.
fn touches(trial: &Trial, body: usize, rows: &[(f64, [f64; 2])]) -> Vec<Option<Touch>> {
    let mut out = vec![None; rows.len()];
    let scene = &trial.scene;
    let Some(shape) = scene.bodies[body].shape.pieces() else { return out };
    let extent = shape.disc_radius().unwrap_or_else(|| shape.half_size());
    let near = 0.15 * extent;
    for (f, fixed) in scene.statics.iter().enumerate() {
        let solid = fixed.placed();
        let gap = |p: [f64; 2]| solid.gap_to(&shape.placed(p, 0.0));
        let gaps: Vec<f64> = rows.iter().map(|(_, p)| gap(*p)).collect();
        let h = 1e-3 * extent;
        let normal = |p: [f64; 2]| {
            let n = [
                gap([p[0] + h, p[1]]) - gap([p[0] - h, p[1]]),
                gap([p[0], p[1] + h]) - gap([p[0], p[1] - h]),
            ];
            let length = n[0].hypot(n[1]);
            if length > 0.0 { [n[0] / length, n[1] / length] } else { [0.0, 1.0] }
        };
        let supported = supported(rows, &gaps, extent, |i| {
            let n = normal(rows[i].1);
            [n[0], n[1], n[0] * scene.gravity[0] + n[1] * scene.gravity[1]]
        });
        let held = supported.iter().zip(&gaps).map(|(held, gap)| if *held { gap.min(0.0) } else { *gap });
        let gaps_held: Vec<f64> = held.collect();
        mark(&gaps_held, near, |i| {
            let (p, normal) = (rows[i].1, normal(rows[i].1));
            let level = p[0] * normal[0] + p[1] * normal[1] - gaps[i];
            out[i] = Some(Touch { normal, level, fixed: Some(f) });
        });
    }
    for (k, other) in trial.observed.bodies.iter().enumerate().filter(|(k, _)| *k != body) {
        let Some(theirs) = scene.bodies[k].shape.pieces() else { continue };
        let at = |t: f64| trial.observed.times.iter().position(|s| *s == t);
        let gaps: Vec<f64> = rows
            .iter()
            .map(|(t, p)| match at(*t).and_then(|i| seen(other, i)) {
                Some(q) => shape.placed(*p, 0.0).gap_to(&theirs.placed(q, 0.0)),
                None => f64::INFINITY,
            })
            .collect();
        mark(&gaps, near, |i| out[i] = Some(Touch { normal: [0.0, 1.0], level: 0.0, fixed: None }));
    }
    out
}

/// Rows that a surface holds, seen as far off it as a camera that is turned a little shows it: within a radius of it, and not
/// falling towards it over some rows about them. `normal`: a surface's normal at a row, and gravity along it.
fn supported(
    rows: &[(f64, [f64; 2])],
    gaps: &[f64],
    extent: f64,
    normal: impl Fn(usize) -> [f64; 3],
) -> Vec<bool> {
    let n = rows.len();
    (0..n)
        .map(|i| {
            let about = i.saturating_sub(SUPPORTED)..(i + SUPPORTED + 1).min(n);
            if gaps[i] > extent || about.len() <= SUPPORTED || !about.clone().all(|k| gaps[k] <= extent) {
                return false;
            }
            let [nx, ny, pull] = normal(i);
            let heights = about.map(|k| (rows[k].0 - rows[i].0, rows[k].1[0] * nx + rows[k].1[1] * ny));
            pull < 0.0 && bend(&heights.collect::<Vec<_>>()).is_some_and(|a| a.abs() < FALLING * pull.abs())
        })
        .collect()
}

/// Second derivative of the parabola through points (t, y) by least squares.
fn bend(points: &[(f64, f64)]) -> Option<f64> {
    let basis = DMatrix::from_fn(points.len(), 3, |i, k| points[i].0.powi(k as i32));
    let y = DVector::from_fn(points.len(), |i, _| points[i].1);
    let beta = basis.svd(true, true).solve(&y, 1e-12).ok()?;
    Some(2.0 * beta[2])
}

/// Calls `touch` for every row about which a series of gaps shows contact.
fn mark(gaps: &[f64], near: f64, mut touch: impl FnMut(usize)) {
    let n = gaps.len();
    for i in 0..n {
        if !gaps[i].is_finite() {
            continue;
        }
        let before = gaps[i.saturating_sub(1)];
        let after = gaps[(i + 1).min(n - 1)];
        // How far the gap changes from one row to the next: a bounce can hide in as much.
        let far = gaps[i.saturating_sub(2)].max(before);
        let reach =
            if i >= 2 && far.is_finite() { (far - gaps[i]).max(0.0) } else { (after - gaps[i]).abs() };
        let turns = i > 0 && i + 1 < n && gaps[i] <= before && gaps[i] <= after;
        let low = gaps[i] < near;
        if low || (turns && gaps[i] < near + 0.8 * reach) {
            touch(i);
        }
    }
}

fn seen(track: &Track, i: usize) -> Option<[f64; 2]> {
    (track.x[i].is_finite() && track.y[i].is_finite()).then(|| [track.x[i], track.y[i]])
}

#[cfg(test)]
mod tests {
    use std::fmt::Write as _;

    use super::*;
    use crate::reality::trials_from_csv;

    /// A ball on a floor, at heights by the way it has gone (m), at 1 m/s.
    fn rolled(height: impl Fn(f64) -> f64) -> Vec<Window> {
        let scene = Scene::from_json(
            r#"{"format": "iplw.scene/1", "gravity": [0, -9.81], "time_step": 0.005,
                "bodies": [{"name": "ball", "shape": {"type": "disc", "radius": 0.05}, "mass": 0.1}],
                "statics": [{"name": "floor", "shape": {"type": "halfspace", "normal": [0, 1], "offset": 0}}]}"#,
        )
        .unwrap();
        let mut csv = String::from("trial,t,body,x,y\n");
        for i in 0..100 {
            let x = 0.03 * f64::from(i);
            let noise = |k: i32| 1e-4 * libm::sin(f64::from(k + i * i));
            let _ = writeln!(csv, "a,{x},ball,{},{}", x + noise(0), height(x) + noise(7));
        }
        cut(&scene, &trials_from_csv(&csv, &scene).unwrap(), &[0])
    }

    /// A camera turned by a fifth of a degree shows a ball up to a centimetre off the floor that it rolls on.
    #[test]
    fn a_rolling_ball_seen_askew_does_not_fly() {
        for tilt in [0.0, 0.0035, -0.0035] {
            let windows = rolled(|x| 0.05 + tilt * x);
            assert!(!windows.is_empty(), "{tilt}");
            assert!(windows.iter().all(|w| w.kind == Kind::Roll), "{tilt}");
        }
    }

    #[test]
    fn a_ball_that_falls_flies() {
        let windows = rolled(|x| 3.0 + x - 0.5 * 9.81 * x * x / 4.0);
        assert!(windows.iter().any(|w| w.kind == Kind::Flight));
    }
}
