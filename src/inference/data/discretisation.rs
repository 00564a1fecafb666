//! Noise inflation for discretisation errors at contacts.
//!
//! Two engines with the same physics differ at every contact: each bounces within one step of the exact
//! position. This is an error of discretisation, not a missing effect. Its size is estimated from the change
//! of the simulation under a smaller time step (Richardson extrapolation) and from the distance covered in
//! one step at impact.

use crate::error::Result;
use crate::inference::data::time_alignment::{IntegratorMismatch, VelocityLag};
use crate::inference::model::{FitState, ParameterLayout, SegmentData};
use crate::inference::segment::{Segment, SegmentKind};
use crate::task::Scene;
use crate::trajectory::{Track, Trajectory};
use crate::world::{Rollout, Simulator};

/// Minimum standard deviation of a one-step segment, m: forces of contacts that exist at its start are not
/// observed.
pub const COLD_START_SD: f64 = 1e-3;
/// Number of halvings of the time step.
const STEP_HALVINGS: i32 = 2;
/// Difference between two engines, as a multiple of the change of one under halved steps.
const RICHARDSON_FACTOR: f64 = 2.0;
/// The same, as a share of the distance that the fastest impact covers in a step: with a halved step an
/// impact may happen at the same place.
const IMPACT_POSITION_SHARE: f64 = 0.1;
/// The same from the first impact on, in velocity changes by gravity per step: an engine may take the rebound
/// speed before or after it.
const REBOUND_SPEED_SHARE: f64 = 1.0;
/// The same, as a share of the lag correction: the order in which an engine applies forces is unknown.
const LAG_CORRECTION_SHARE: f64 = 0.1;

/// Sets the standard deviation of every one-step segment to the expected difference between two engines.
/// `observed`: observations by trial.
pub fn inflate_for_discretisation(
    data: &mut SegmentData,
    observed: &[&Trajectory],
    layout: &ParameterLayout,
    state: &FitState,
    stepping: IntegratorMismatch,
) -> Result<()> {
    let one_step: Vec<usize> =
        (0..data.segments.len()).filter(|w| data.segments[*w].kind == SegmentKind::OneStep).collect();
    let mut scenes: Vec<Scene> = Vec::new();
    for w in &one_step {
        scenes.extend(
            (0..=STEP_HALVINGS).map(|k| halve_time_step(&data.segments[*w].scene, k, stepping.simulated)),
        );
    }
    let physics: Vec<_> = one_step
        .iter()
        .map(|w| {
            layout.effects_and_latents(&state.values, data.segments[*w].setting, data.segments[*w].start)
        })
        .collect();
    let each = 1 + STEP_HALVINGS as usize;
    let rollouts: Vec<Rollout> = scenes
        .iter()
        .enumerate()
        .map(|(i, scene)| data.segments[one_step[i / each]].rollout(scene, &physics[i / each]))
        .collect();
    let paths = Simulator::new(data.engine).budget(&data.progress).run(&rollouts)?;
    for (w, paths) in one_step.into_iter().zip(paths.chunks(each)) {
        let by_step: f64 = paths.windows(2).map(|p| end_point_mean_square(&p[0], &p[1])).sum::<f64>()
            / f64::from(STEP_HALVINGS);
        let segment = &data.segments[w];
        let fastest =
            paths[0].events.iter().map(|e| e.speed).fold(max_velocity_change(segment, observed), f64::max);
        let met = IMPACT_POSITION_SHARE * fastest * segment.scene.time_step;
        let time = segment.observations.last().map_or(0.0, |p| p.time);
        let gravity = segment.scene.gravity[0].hypot(segment.scene.gravity[1]);
        let lagged = LAG_CORRECTION_SHARE * stepping.excess.gravity * gravity * time;
        let fallen = gravity * segment.scene.time_step;
        // Slower impacts belong to bodies at rest.
        let bounces = paths[0].events.iter().filter(|e| e.speed > fallen);
        let bounced = REBOUND_SPEED_SHARE * fallen * (time - bounces.map(|e| e.time).fold(time, f64::min));
        let squares = [COLD_START_SD, met, bounced, lagged].map(|a| a * a).iter().sum::<f64>();
        let sd = (squares + RICHARDSON_FACTOR.powi(2) * by_step).sqrt();
        data.sd[w] = if sd.is_finite() { sd } else { COLD_START_SD };
    }
    Ok(())
}

/// Largest observed velocity change in a one-step segment beyond gravity, m/s: the impact may differ from
/// that of an incomplete model.
fn max_velocity_change(segment: &Segment, observed: &[&Trajectory]) -> f64 {
    let seen = observed[segment.trial];
    let Some(at) = segment.start_index(seen) else { return 0.0 };
    let Some(time) = seen.times.get(at + 1).map(|t| t - seen.times[at]) else { return 0.0 };
    let change = |v: &[f64], k: usize| v[at + 1] - v[at] - segment.scene.gravity[k] * time;
    let of = |b: &Track| change(&b.vx, 0).hypot(change(&b.vy, 1));
    seen.bodies.iter().map(of).fold(0.0, f64::max)
}

/// A scene with its time step halved `times` times, and its initial velocities corrected for the smaller lag.
fn halve_time_step(scene: &Scene, times: i32, own: VelocityLag) -> Scene {
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

/// Mean squared distance between the end points of two trajectories, by coordinate, m^2.
fn end_point_mean_square(a: &Trajectory, b: &Trajectory) -> f64 {
    let apart = |a: &[f64], b: &[f64]| a.last().zip(b.last()).map_or(f64::NAN, |(a, b)| (a - b).powi(2));
    let of = |(a, b): (&Track, &Track)| apart(&a.x, &b.x) + apart(&a.y, &b.y);
    a.bodies.iter().zip(&b.bodies).map(of).sum::<f64>() / (2 * a.bodies.len()) as f64
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::world::Engine;

    /// Distance between the end points with a coarse and a fine step of a ball thrown down from `height`, m.
    fn apart(height: f64, floor: &str, own: VelocityLag) -> f64 {
        let text = format!(
            r#"{{"format": "iplw.scene/1", "gravity": [0, -9.8], "time_step": 0.01, "steps": 50, "observe_every": 50,
                "bodies": [{{"name": "ball", "shape": {{"type": "disc", "radius": 0.5}}, "position": [0, {height}],
                             "velocity": [1, -8], "restitution": 1.0}}], "statics": [{floor}]}}"#
        );
        let scene: Scene = serde_json::from_str(&text).unwrap();
        let [whole, fine] = [0, 2].map(|k| {
            let scene = &halve_time_step(&scene, k, own);
            let usual = Rollout { stop_at_goal: false, ..Rollout::of(scene) };
            Simulator::new(Engine::Lanes).run(&[usual]).unwrap().remove(0)
        });
        end_point_mean_square(&whole, &fine).sqrt()
    }

    #[test]
    fn smaller_steps_change_bounces_not_flights() {
        let floor = r#"{"name": "floor", "shape": {"type": "box", "half_width": 25, "half_height": 0.5},
                        "position": [0, -0.5], "restitution": 1.0}"#;
        // `lanes` updates positions first: its velocities lead by half a step.
        let own = VelocityLag { gravity: -0.005, other: -0.005 };
        let none = VelocityLag { gravity: 0.0, other: 0.0 };
        assert!(apart(3.0, "", own) < 1e-9, "{}", apart(3.0, "", own));
        assert!(apart(3.0, "", none) > 5e-3, "{}", apart(3.0, "", none));
        let bounces: Vec<f64> = (0..5).map(|i| apart(3.0 + 0.02 * f64::from(i), floor, own)).collect();
        assert!(bounces.iter().any(|b| *b > 5e-3), "{bounces:?}");
    }
}
