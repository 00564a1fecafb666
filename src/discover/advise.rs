//! What to measure next: the simple experiment that would part the rivals.
//!
//! For every launch of a small choice and every two rivals: how much worse would one explain what the other predicts
//! there, once it has taken up what it can by its start and by its parameters, as far as the trials so far leave them
//! free? That difference of squares is what a test of the two would see (Atkinson and Fedorov, Biometrika 62 (1975) 57).

use nalgebra::{DMatrix, DVector};

use super::Config;
use super::fit::Fitted;
use super::noise::Noise;
use super::path::Physics;
use super::report::{NextExperiment, Verdict};
use super::stats::{inverse, median};
use super::window::{Kind, Point, Window};
use crate::error::Result;
use crate::task::{Placement, Scene};
use crate::trajectory::Trajectory;
use crate::world::effect::{Effect, REGISTRY};
use crate::world::{Rollout, simulate};

/// Number of actions of a task that are compared.
const ACTIONS: usize = 24;
/// Times that a launch is to be made, and observations each that are counted on.
const REPEATS: f64 = 6.0;
const OBSERVED: usize = 40;
/// Rivals that are compared.
const RIVALS: usize = 6;
/// Difference of squares that parts two rivals: likelihoods a thousand to one.
const CLEAR: f64 = 14.0;

/// The next experiment; `None` where nothing is left to separate.
pub fn next(
    scene: &Scene,
    windows: &[Window],
    fits: &[Fitted],
    rivals: &[usize],
    verdict: Verdict,
    noise: &Noise,
    config: &Config,
) -> Result<Option<NextExperiment>> {
    if verdict == Verdict::Unknown {
        return Ok(Some(NextExperiment {
            why: "no set in the library explains what is left".into(),
            action:
                "repeat one launch exactly, at another hour and with the body turned: what stays the same is \
                     physics of the scene, what changes is of the day or the body"
                    .into(),
            separates: Vec::new(),
            scene: None,
        }));
    }
    if rivals.len() < 2 {
        return Ok(None);
    }
    let own: Vec<&Fitted> = rivals.iter().take(RIVALS).map(|i| &fits[*i]).collect();
    match windows.iter().position(|w| w.kind != Kind::Contact) {
        Some(w) if matches!(windows[w].kind, Kind::Run | Kind::Leap) => {
            act(scene, &windows[w], [own[0], own[1]], noise, config)
        }
        _ => Ok(fly(windows, &own, noise)),
    }
}

fn label(fit: &Fitted) -> String {
    fit.names().join(" + ")
}

fn separates(fits: &[&Fitted]) -> Vec<String> {
    let mut names: Vec<String> = fits.iter().flat_map(|f| f.names()).map(|n| n.to_string()).collect();
    names.sort();
    names.dedup();
    names
}

/// A launch, and a look at the instruments where no launch can tell.
fn fly(windows: &[Window], rivals: &[&Fitted], noise: &Noise) -> Option<NextExperiment> {
    let found = best_launch(windows, rivals, noise);
    let apart = |i: usize, j: usize| {
        found.as_ref().is_some_and(|(_, _, clear)| clear.contains(&[i, j]) || clear.contains(&[j, i]))
    };
    let mut twins: Vec<usize> = Vec::new();
    for j in 0..rivals.len() {
        for i in (0..rivals.len()).filter(|i| *i != j && !apart(*i, j)) {
            twins.extend([i, j]);
        }
    }
    // Each once, in the registry's order.
    let shown = |e: &&&Effect| twins.iter().any(|i| rivals[*i].names().contains(&e.name));
    let checks: Vec<&str> = REGISTRY.iter().filter(shown).filter_map(|e| e.check).collect();
    let sets = rivals.iter().map(|f| label(f)).collect::<Vec<_>>().join(", ");
    let (mut actions, mut why, mut scene) = (Vec::new(), format!("{sets} tie"), None);
    if let Some((launch, least, clear)) = &found
        && !clear.is_empty()
    {
        actions.push(format!("{}; {REPEATS:.0} times", launch.words));
        why += &format!(
            "; this should part {} by {:.0} or more (square of what the wrong one leaves over the noise's)",
            if twins.is_empty() { "all of them" } else { "those that a flight can part" },
            least
        );
        scene = Some(launch.window.scene.clone());
    }
    if !checks.is_empty() {
        actions.push(checks.join("; "));
        why += "; no launch tells an instrument's error from physics that looks the same";
    }
    if actions.is_empty() {
        actions.push("measure more trials, over as wide a range of speeds and places as can be".into());
    }
    Some(NextExperiment { why, action: actions.join("; and "), separates: separates(rivals), scene })
}

/// The action of a task about which two rivals disagree most.
fn act(
    scene: &Scene,
    window: &Window,
    rivals: [&Fitted; 2],
    noise: &Noise,
    config: &Config,
) -> Result<Option<NextExperiment>> {
    let trials = actions(scene, window);
    let physics = rivals.map(|f| f.layout.physics(&f.state.values, 0, 0.0));
    let mut rollouts = Vec::new();
    for (_, scene) in &trials {
        for (effects, latents) in &physics {
            rollouts.push(Rollout { scene, latents: *latents, effects, stop: false });
        }
    }
    let paths = simulate(&rollouts, config.engine)?;
    let apart = |i: usize| furthest(&paths[2 * i], &paths[2 * i + 1]);
    let Some(best) = (0..trials.len()).max_by(|i, j| apart(*i).total_cmp(&apart(*j))) else {
        return Ok(None);
    };
    Ok(Some(NextExperiment {
        why: format!(
            "{} and {} tie; here their predictions part by {:.3} m, {:.0} times the noise",
            label(rivals[0]),
            label(rivals[1]),
            apart(best),
            apart(best) / noise.sd
        ),
        action: trials[best].0.clone(),
        separates: separates(&rivals),
        scene: Some(trials[best].1.clone()),
    }))
}

/// A launch that could be made: in words, and the window it would give.
struct Launch {
    words: String,
    window: Window,
    nuisances: [f64; 4],
}

/// Simple variations of a typical launch, each flown for as long as the longest flight.
fn launches(windows: &[Window], fit: &Fitted) -> Vec<Launch> {
    let flights: Vec<usize> = (0..windows.len()).filter(|w| windows[*w].kind == Kind::Flight).collect();
    let length = |w: usize| windows[w].points.last().map_or(0.0, |p| p.time);
    let Some(typical) = flights.iter().copied().max_by(|a, b| length(*a).total_cmp(&length(*b))) else {
        return Vec::new();
    };
    let [x, y, ..] = fit.state.nuisances[typical][..] else { return Vec::new() };
    let speeds: Vec<f64> = flights
        .iter()
        .filter_map(|w| match fit.state.nuisances[*w][..] {
            [_, _, vx, vy, ..] => Some(vx.hypot(vy)),
            _ => None,
        })
        .collect();
    let [_, _, vx, _, ..] = fit.state.nuisances[typical][..] else { return Vec::new() };
    let (speed, side) = (median(&speeds).max(0.5), if vx < 0.0 { -1.0 } else { 1.0 });
    let mut out = Vec::new();
    for (share, how) in
        [(0.0, "drop it from rest"), (1.0 / 3.0, "a third of the usual speed"), (1.0, "the usual speed")]
            .into_iter()
            .chain([(2.0, "twice the usual speed"), (3.0, "three times the usual speed")])
    {
        for degrees in [10.0f64, 45.0, 70.0, 110.0, 170.0] {
            let (v, angle) = (share * speed, degrees.to_radians());
            let words = match share {
                0.0 => how.to_string(),
                _ => format!(
                    "launch at {how}, {v:.1} m/s, {:.0} degrees above the horizontal{}, from ({x:.2}, {y:.2}) m",
                    degrees.min(180.0 - degrees),
                    if degrees > 90.0 { " the other way" } else { "" }
                ),
            };
            let start = [x, y, side * v * libm::cos(angle), v * libm::sin(angle)];
            out.push(Launch { words, window: watched(&windows[typical], start), nuisances: start });
            if share == 0.0 {
                break;
            }
        }
    }
    out
}

/// A flight's window with another start, observed at even times.
fn watched(typical: &Window, start: [f64; 4]) -> Window {
    let mut window = typical.clone();
    let body = &mut window.scene.bodies[0];
    (body.position, body.velocity) = (Some([start[0], start[1]]), [start[2], start[3]]);
    let duration = typical.points.last().map_or(0.0, |p| p.time);
    window.start = 0.0;
    window.points = (0..OBSERVED)
        .map(|i| Point {
            body: 0,
            time: duration * i as f64 / (OBSERVED - 1) as f64,
            seen: [0.0; 2],
            weight: 1.0,
        })
        .collect();
    window
}

/// Squares (units of the noise) by which [`REPEATS`] launches would be worse explained by `other` than by `own`, if
/// `own` is the truth and `other` may take up what it can by its starts and by its parameters, which the trials so far
/// hold.
fn parted(launch: &Launch, own: &Fitted, other: &Fitted, noise: &Noise) -> f64 {
    let seen = |fit: &Fitted, values: &[f64], start: &[f64]| {
        let (numbers, latents) = fit.layout.numbers(values, 0);
        let terms: Vec<_> =
            fit.layout.terms.iter().zip(&numbers).map(|(t, n)| (t.effect, n.as_slice())).collect();
        DVector::from_vec(Physics::new(&launch.window, &terms, &latents).seen(start, |_, _| ()))
    };
    let (values, slots) = (&other.state.values, &other.layout.slots);
    let truth = seen(own, &own.state.values, &launch.nuisances);
    let mut start = launch.nuisances;
    let mut left = 0.0;
    // A start far off is met in two steps.
    for _ in 0..2 {
        let base = seen(other, values, &start);
        let mut residual = &truth - &base;
        let from = DMatrix::from_columns(
            &(0..4)
                .map(|k| {
                    let mut moved = start;
                    moved[k] += 1e-4;
                    (seen(other, values, &moved) - &base) / 1e-4
                })
                .collect::<Vec<_>>(),
        );
        let mut columns = DMatrix::zeros(residual.len(), slots.len());
        for (k, slot) in slots.iter().enumerate().filter(|(_, s)| s.setting.is_none_or(|s| s == 0)) {
            let mut moved = values.clone();
            let by = if values[k] + slot.step > slot.bounds[1] { -slot.step } else { slot.step };
            moved[k] += by;
            columns.set_column(k, &((seen(other, &moved, &start) - &base) / by));
        }
        if !residual.iter().chain(columns.iter()).chain(from.iter()).all(|v| v.is_finite()) {
            return 0.0;
        }
        let project = inverse(&from.tr_mul(&from)) * from.transpose();
        let moved = &project * &residual;
        start.iter_mut().zip(moved.iter()).for_each(|(s, m)| *s += m);
        residual -= &from * moved;
        columns -= &from * (&project * &columns);
        let unit = noise.sd * noise.sd * noise.unit();
        let mut known = columns.tr_mul(&columns) * (REPEATS / unit);
        let score = columns.tr_mul(&residual) * (REPEATS / unit);
        let square = residual.norm_squared() * REPEATS / unit;
        for t in &other.pass.trials {
            known += &t.gram / noise.unit();
        }
        for (k, slot) in slots.iter().enumerate() {
            known[(k, k)] += slot.ridge();
        }
        left = square - score.dot(&(inverse(&known) * &score));
    }
    left.max(0.0)
}

/// The launch that parts most of the pairs of rivals, and how far it parts the least parted of those.
fn best_launch(
    windows: &[Window],
    rivals: &[&Fitted],
    noise: &Noise,
) -> Option<(Launch, f64, Vec<[usize; 2]>)> {
    let pairs: Vec<[usize; 2]> = (0..rivals.len())
        .flat_map(|i| (0..rivals.len()).map(move |j| [i, j]))
        .filter(|[i, j]| i != j)
        .collect();
    let mut best: Option<(f64, Launch, Vec<f64>)> = None;
    for launch in launches(windows, rivals[0]) {
        let apart: Vec<f64> =
            pairs.iter().map(|[i, j]| parted(&launch, rivals[*i], rivals[*j], noise)).collect();
        // More than enough is no better than enough.
        let score =
            apart.iter().map(|a| a.min(4.0 * CLEAR)).sum::<f64>() + 1e-3 * apart.iter().sum::<f64>().min(1e3);
        if best.as_ref().is_none_or(|b| score > b.0) {
            best = Some((score, launch, apart));
        }
    }
    let (_, launch, apart) = best?;
    let clear: Vec<usize> = (0..pairs.len()).filter(|k| apart[*k] >= CLEAR).collect();
    let least = clear.iter().map(|k| apart[*k]).fold(f64::INFINITY, f64::min);
    Some((launch, least, clear.into_iter().map(|k| pairs[k]).collect()))
}

/// Actions of a task, spread over its action space, on the scene of a run.
fn actions(scene: &Scene, window: &Window) -> Vec<(String, Scene)> {
    let Some(space) = &scene.action else {
        return vec![("repeat the trial for twice as long".into(), {
            let mut scene = window.scene.clone();
            scene.steps *= 2;
            scene
        })];
    };
    let count = space.count();
    let mut out = Vec::new();
    for k in 0..40 * ACTIONS {
        let Ok(action) = space.at(k * 7919 % count) else { continue };
        if let Placement::Valid(placed) = space.place(&window.scene, &action) {
            let mut placed = *placed;
            placed.steps = placed.steps.max(scene.steps);
            placed.observe_every = scene.observe_every;
            out.push((format!("action {:?}", action.values()), placed));
        }
        if out.len() == ACTIONS {
            break;
        }
    }
    out
}

/// Largest distance between two paths, m.
fn furthest(a: &Trajectory, b: &Trajectory) -> f64 {
    let mut most = 0.0f64;
    for (p, q) in a.bodies.iter().zip(&b.bodies) {
        for i in 0..p.len().min(q.len()) {
            let d = (p.x[i] - q.x[i]).hypot(p.y[i] - q.y[i]);
            most = if d.is_finite() { most.max(d) } else { most };
        }
    }
    most
}
