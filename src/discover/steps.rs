//! What another engine's steps make of contacts.
//!
//! Two engines that mean the same physics part at every contact: each bounces somewhere within a step of the true place,
//! and what follows starts from there. No law describes that, and left in the residuals it would be taken for one. Its size
//! is known: by how much the own engine's result changes with its time step (Richardson's argument), and by how far
//! things go within a step when they meet.

use super::model::{Data, Layout, State};
use super::phase::{Lag, Stepping};
use super::window::{Kind, Window};
use crate::error::Result;
use crate::task::Scene;
use crate::trajectory::{Track, Trajectory};
use crate::world::{Rollout, Simulator};

/// What a leap errs by at least, m: what contacts bear that go on at its start is not seen, and found only nearly.
pub const COLD: f64 = 1e-3;
/// Steps are halved so many times.
const HALVINGS: i32 = 2;
/// What two engines differ by, in what one changes by when its steps are halved: the rest of its own error is as large
/// again.
const RICHARDSON: f64 = 2.0;
/// The same in what the fastest meeting covers in a step: a halved step can happen to meet at the same place. Of 79 leaps
/// with a bounce, `rapier` for `lanes` with the same physics, two are further off than 2.5 times what is allowed.
const MEETING: f64 = 0.1;
/// The same in what gravity does in a step, from the first meeting on: an engine may take a bounce's speed before or after it.
/// (Bowling's balls rebound from `rapier` a little faster at 1 m/s than at 5, which was a law of restitution in 2 of 3 worlds.)
const BOUNCING: f64 = 1.0;
/// The same in what a lag was corrected by: the order in which an engine lets gravity, drag and wind act is not told.
const LAGGING: f64 = 0.1;

/// Gives every leap as much noise as two engines that mean the same may differ by in it. `observed`: what was seen, by
/// trial.
pub fn allow(
    data: &mut Data,
    observed: &[&Trajectory],
    layout: &Layout,
    state: &State,
    stepping: Stepping,
) -> Result<()> {
    let leaps: Vec<usize> = (0..data.windows.len()).filter(|w| data.windows[*w].kind == Kind::Leap).collect();
    let mut scenes: Vec<Scene> = Vec::new();
    for w in &leaps {
        scenes.extend((0..=HALVINGS).map(|k| halved(&data.windows[*w].scene, k, stepping.own)));
    }
    let physics: Vec<_> = leaps
        .iter()
        .map(|w| layout.physics(&state.values, data.windows[*w].setting, data.windows[*w].start))
        .collect();
    let each = 1 + HALVINGS as usize;
    let rollouts: Vec<Rollout> = scenes
        .iter()
        .enumerate()
        .map(|(i, scene)| data.windows[leaps[i / each]].rollout(scene, &physics[i / each]))
        .collect();
    let paths = Simulator::new(data.engine).budget(&data.progress).run(&rollouts)?;
    for (w, paths) in leaps.into_iter().zip(paths.chunks(each)) {
        let by_step: f64 =
            paths.windows(2).map(|p| mean_square(&p[0], &p[1])).sum::<f64>() / f64::from(HALVINGS);
        let window = &data.windows[w];
        let fastest = paths[0].events.iter().map(|e| e.speed).fold(pushed(window, observed), f64::max);
        let met = MEETING * fastest * window.scene.time_step;
        let time = window.points.last().map_or(0.0, |p| p.time);
        let gravity = window.scene.gravity[0].hypot(window.scene.gravity[1]);
        let lagged = LAGGING * stepping.later.gravity * gravity * time;
        let fallen = gravity * window.scene.time_step;
        // What approaches no faster rests.
        let bounces = paths[0].events.iter().filter(|e| e.speed > fallen);
        let bounced = BOUNCING * fallen * (time - bounces.map(|e| e.time).fold(time, f64::min));
        let squares = [COLD, met, bounced, lagged].map(|a| a * a).iter().sum::<f64>();
        let allowed = (squares + RICHARDSON.powi(2) * by_step).sqrt();
        data.sd[w] = if allowed.is_finite() { allowed } else { COLD };
    }
    Ok(())
}

/// The largest change of velocity that was seen in a leap and gravity does not explain, m/s: what meets in it may be
/// something else than the model, which may yet lack much, would have.
fn pushed(window: &Window, observed: &[&Trajectory]) -> f64 {
    let seen = observed[window.trial];
    let Some(at) = window.first(seen) else { return 0.0 };
    let Some(time) = seen.times.get(at + 1).map(|t| t - seen.times[at]) else { return 0.0 };
    let change = |v: &[f64], k: usize| v[at + 1] - v[at] - window.scene.gravity[k] * time;
    let of = |b: &Track| change(&b.vx, 0).hypot(change(&b.vy, 1));
    seen.bodies.iter().map(of).fold(0.0, f64::max)
}

/// A scene with its step halved `times` times, and the start that its velocities then lag behind.
fn halved(scene: &Scene, times: i32, own: Lag) -> Scene {
    let mut scene = scene.clone();
    let finer = 1 << times;
    scene.time_step /= f64::from(finer);
    scene.steps *= finer as u32;
    scene.observe_every *= finer as u32;
    let lag = own.gravity * (1.0 - 1.0 / f64::from(finer));
    for body in &mut scene.bodies {
        (0..2).for_each(|k| body.velocity[k] += scene.gravity[k] * lag);
    }
    scene
}

/// Mean square of how far two paths end apart, by coordinate, m^2.
fn mean_square(a: &Trajectory, b: &Trajectory) -> f64 {
    let apart = |a: &[f64], b: &[f64]| a.last().zip(b.last()).map_or(f64::NAN, |(a, b)| (a - b).powi(2));
    let of = |(a, b): (&Track, &Track)| apart(&a.x, &b.x) + apart(&a.y, &b.y);
    a.bodies.iter().zip(&b.bodies).map(of).sum::<f64>() / (2 * a.bodies.len()) as f64
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::world::Engine;

    /// How far a ball that is thrown down from `height` ends from where finer steps let it end, m.
    fn apart(height: f64, floor: &str, own: Lag) -> f64 {
        let text = format!(
            r#"{{"format": "iplw.scene/1", "gravity": [0, -9.8], "time_step": 0.01, "steps": 50, "observe_every": 50,
                "bodies": [{{"name": "ball", "shape": {{"type": "disc", "radius": 0.5}}, "position": [0, {height}],
                             "velocity": [1, -8], "restitution": 1.0}}], "statics": [{floor}]}}"#
        );
        let scene: Scene = serde_json::from_str(&text).unwrap();
        let [whole, fine] = [0, 2].map(|k| {
            let scene = &halved(&scene, k, own);
            let usual = Rollout { stop_at_goal: false, ..Rollout::of(scene) };
            Simulator::new(Engine::Lanes).run(&[usual]).unwrap().remove(0)
        });
        mean_square(&whole, &fine).sqrt()
    }

    #[test]
    fn finer_steps_change_bounces_and_not_flights() {
        let floor = r#"{"name": "floor", "shape": {"type": "box", "half_width": 25, "half_height": 0.5},
                        "position": [0, -0.5], "restitution": 1.0}"#;
        // `lanes` moves bodies first: its velocities lead by half a step.
        let own = Lag { gravity: -0.005, rest: -0.005 };
        let none = Lag { gravity: 0.0, rest: 0.0 };
        assert!(apart(3.0, "", own) < 1e-9, "{}", apart(3.0, "", own));
        assert!(apart(3.0, "", none) > 5e-3, "{}", apart(3.0, "", none));
        let bounces: Vec<f64> = (0..5).map(|i| apart(3.0 + 0.02 * f64::from(i), floor, own)).collect();
        assert!(bounces.iter().any(|b| *b > 5e-3), "{bounces:?}");
    }
}
