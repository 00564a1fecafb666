//! What another engine's steps make of contacts.
//!
//! Two engines that mean the same physics part at every contact: each bounces somewhere within a step of the true place,
//! and what follows starts from there. No law describes that, and left in the residuals it would be taken for one. Its size
//! is known: by how much the own engine's result changes with its time step (Richardson's argument), and by how far
//! things go within a step when they meet.

use super::COLD;
use super::model::{Data, Layout, State};
use super::phase::Lag;
use super::window::Kind;
use crate::error::Result;
use crate::task::Scene;
use crate::trajectory::{Track, Trajectory};
use crate::world::{Rollout, simulate};

/// Steps are halved so many times.
const HALVINGS: i32 = 2;
/// What two engines differ by, in what one changes by when its steps are halved: the rest of its own error is as large
/// again.
const RICHARDSON: f64 = 2.0;
/// The same in what the fastest meeting covers in a step: a halved step can happen to meet at the same place. Of 79 leaps
/// with a bounce, `rapier` for `lanes`, two are further off than 2.5 of the two together.
const MEETING: f64 = 0.1;

/// Gives every leap as much noise as two engines that mean the same may differ by in it. `own`: the lag of the engine's
/// velocities, which changes with the step and is not meant.
pub fn allow(data: &mut Data, layout: &Layout, state: &State, own: Lag) -> Result<()> {
    let leaps: Vec<usize> = (0..data.windows.len()).filter(|w| data.windows[*w].kind == Kind::Leap).collect();
    let mut scenes: Vec<Scene> = Vec::new();
    for w in &leaps {
        scenes.extend((0..=HALVINGS).map(|k| halved(&data.windows[*w].scene, k, own)));
    }
    let physics: Vec<_> = leaps
        .iter()
        .map(|w| layout.physics(&state.values, data.windows[*w].setting, data.windows[*w].start))
        .collect();
    let each = 1 + HALVINGS as usize;
    let rollouts: Vec<Rollout> = scenes
        .iter()
        .enumerate()
        .map(|(i, scene)| {
            let (effects, latents) = &physics[i / each];
            Rollout { scene, latents: *latents, effects, stop: false }
        })
        .collect();
    let paths = simulate(&rollouts, data.engine)?;
    for (w, paths) in leaps.into_iter().zip(paths.chunks(each)) {
        let by_step: f64 =
            paths.windows(2).map(|p| mean_square(&p[0], &p[1])).sum::<f64>() / f64::from(HALVINGS);
        let fastest = paths[0].events.iter().map(|e| e.speed).fold(0.0, f64::max);
        let met = MEETING * fastest * data.windows[w].scene.time_step;
        let allowed = (COLD.powi(2) + RICHARDSON.powi(2) * by_step + met.powi(2)).sqrt();
        data.sd[w] = if allowed.is_finite() { allowed } else { COLD };
    }
    Ok(())
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
