//! What to measure next: the simple experiment whose outcome the rivals disagree about most.

use super::Config;
use super::judge::Fitted;
use super::noise::Noise;
use super::report::{NextExperiment, Verdict};
use super::window::{Kind, Window};
use crate::error::Result;
use crate::task::{Placement, Scene};
use crate::trajectory::Trajectory;
use crate::world::{Rollout, simulate};

/// Number of actions of a task that are compared.
const ACTIONS: usize = 24;

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
        }));
    }
    let [first, second, ..] = rivals else { return Ok(None) };
    let (a, b) = (&fits[*first], &fits[*second]);
    let trials = match windows.iter().position(|w| w.kind != Kind::Contact) {
        Some(w) if windows[w].kind == Kind::Run => actions(scene, &windows[w]),
        Some(_) => launches(windows, a),
        None => Vec::new(),
    };
    let mut rollouts = Vec::new();
    let physics: Vec<_> = [a, b].iter().map(|f| f.layout.physics(&f.state.values, 0, 0.0)).collect();
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
    let label = |f: &Fitted| f.names().join(" + ");
    let mut separates: Vec<String> = a.names().iter().chain(&b.names()).map(|n| n.to_string()).collect();
    separates.sort();
    separates.dedup();
    Ok(Some(NextExperiment {
        why: format!(
            "{} and {} tie; here their predictions part by {:.3} m, {:.0} times the noise",
            label(a),
            label(b),
            apart(best),
            apart(best) / noise.sd
        ),
        action: trials[best].0.clone(),
        separates,
    }))
}

/// Simple variations of a typical launch, each flown for as long as the longest flight.
fn launches(windows: &[Window], fit: &Fitted) -> Vec<(String, Scene)> {
    let flights: Vec<usize> = (0..windows.len()).filter(|w| windows[*w].kind == Kind::Flight).collect();
    let length = |w: usize| windows[w].points.last().map_or(0.0, |p| p.time);
    let Some(typical) = flights.iter().copied().max_by(|a, b| length(*a).total_cmp(&length(*b))) else {
        return Vec::new();
    };
    let [x, y, vx, vy, ..] = fit.state.nuisances[typical][..] else { return Vec::new() };
    let speed = vx.hypot(vy).max(0.5);
    let side = if vx < 0.0 { -1.0 } else { 1.0 };
    let steep = |degrees: f64, share: f64| {
        let angle = degrees.to_radians();
        [side * share * speed * libm::cos(angle), share * speed * libm::sin(angle)]
    };
    let choices = [
        ("launch at three times the speed, same direction", [3.0 * vx, 3.0 * vy]),
        ("launch at a third of the speed, same direction", [vx / 3.0, vy / 3.0]),
        ("launch at 70 degrees, same speed", steep(70.0, 1.0)),
        ("launch at 70 degrees, twice the speed", steep(70.0, 2.0)),
        ("launch the other way, same speed", [-vx, vy]),
        ("drop it from rest", [0.0, 0.0]),
    ];
    choices
        .iter()
        .map(|(name, v)| {
            let mut scene = windows[typical].scene.clone();
            (scene.bodies[0].position, scene.bodies[0].velocity) = (Some([x, y]), *v);
            (name.to_string(), scene)
        })
        .collect()
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
