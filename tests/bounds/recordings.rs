//! Recorded throws of balls.

use iplw::reality::Trial;
use iplw::task::Scene;
use iplw::trajectory::{Track, Trajectory};

/// Trials of balls that fly with a drag of 0.4 1/s for a second, with a noise of 2 mm, and their scene without drag.
pub fn throws(trials: usize, frames: usize, bodies: usize) -> (Scene, Vec<Trial>) {
    let body = |b: usize| {
        format!(r#"{{"name": "ball{b}", "shape": {{"type": "disc", "radius": 0.05}}, "position": [0, {b}]}}"#)
    };
    let all = (0..bodies).map(body).collect::<Vec<_>>().join(", ");
    let text = format!(
        r#"{{"format": "iplw.scene/1", "bodies": [{all}], "gravity": [0, -9.81], "time_step": 0.002}}"#
    );
    let scene = Scene::from_json(&text).unwrap();
    let trial = |k: usize| {
        let times: Vec<f64> = (0..frames).map(|i| i as f64 / (frames - 1) as f64).collect();
        let tracks = (0..bodies).map(|b| track(k, b, &times)).collect();
        let observed = Trajectory { times, bodies: tracks, ..Trajectory::default() };
        let mut scene = scene.clone();
        for (body, track) in scene.bodies.iter_mut().zip(&observed.bodies) {
            body.position = Some([track.x[0], track.y[0]]);
        }
        Trial { name: k.to_string(), setting: None, scene, observed }
    };
    (scene.clone(), (0..trials).map(trial).collect())
}

fn track(k: usize, b: usize, times: &[f64]) -> Track {
    let mut track = Track { name: format!("ball{b}"), ..Track::default() };
    for (i, t) in times.iter().enumerate() {
        let n = (i * i + 31 * i * k + 7 * b) as f64;
        let noise = |phase: f64| 2.8e-3 * (n * phase + phase + k as f64).sin();
        let along = (1.0 - (-0.4 * t).exp()) / 0.4;
        let fallen = 9.81 * (t - along) / 0.4;
        track.x.push((4.0 + 0.01 * k as f64) * along + noise(1.3));
        track.y.push(b as f64 + 4.0 * along - fallen + noise(2.7));
        for column in [&mut track.angle, &mut track.vx, &mut track.vy, &mut track.omega] {
            column.push(f64::NAN);
        }
    }
    track
}
