//! Rollouts from the middle of what was seen: what contacts bear there is found, where nothing of it was.

use iplw::task::Scene;
use iplw::trajectory::Trajectory;
use iplw::world::{Engine, Rollout, simulate};

/// A heavy ball on a pole that stands on end, a stack of three boxes and a ball that falls, as the engine has them, seen every half
/// second.
fn stood(engine: Engine) -> (Scene, Trajectory) {
    let boxed = |name: &str, half: [f64; 2], at: [f64; 2]| {
        let ([w, h], [x, y]) = (half, at);
        format!(
            r#"{{"name": "{name}", "shape": {{"type": "box", "half_width": {w}, "half_height": {h}}}, "density": 0.25,
                "friction": 0.8, "position": [{x}, {y}]}}"#
        )
    };
    let ball = |name: &str, radius: f64, at: [f64; 2]| {
        let [x, y] = at;
        format!(
            r#"{{"name": "{name}", "shape": {{"type": "disc", "radius": {radius}}}, "density": 0.25, "friction": 0.8,
                "position": [{x}, {y}]}}"#
        )
    };
    let bodies = [
        boxed("pole", [0.43, 4.5], [0.0, 4.5]),
        ball("on_top", 3.0, [0.0, 12.0]),
        boxed("low", [1.0, 0.5], [10.0, 0.5]),
        boxed("middle", [1.0, 0.5], [10.1, 1.5]),
        boxed("high", [1.0, 0.5], [10.0, 2.5]),
        ball("falls", 0.5, [20.0, 100.0]),
    ];
    let text = format!(
        r#"{{"format": "iplw.scene/1", "gravity": [0, -9.8], "time_step": 0.016666666666666666, "steps": 270, "observe_every": 30,
            "bodies": [{}], "statics": [{{"name": "floor", "shape": {{"type": "halfspace", "normal": [0, 1], "offset": 0}},
            "friction": 0.8}}]}}"#,
        bodies.join(", ")
    );
    let scene = Scene::from_json(&text).unwrap();
    let seen = simulate(&[Rollout::of(&scene)], engine).unwrap().remove(0);
    (scene, seen)
}

/// The scene from observation `i` on, for one interval.
fn from(scene: &Scene, seen: &Trajectory, i: usize) -> Scene {
    let mut scene = Scene { steps: 30, ..scene.clone() };
    for (body, track) in scene.bodies.iter_mut().zip(&seen.bodies) {
        body.position = Some([track.x[i], track.y[i]]);
        body.angle = track.angle[i];
        body.velocity = [track.vx[i], track.vy[i]];
        body.angular_velocity = track.omega[i];
    }
    scene
}

/// How far everything ends from where it was seen next, m: root mean square.
fn off(path: &Trajectory, seen: &Trajectory, i: usize) -> f64 {
    let of = path.bodies.iter().zip(&seen.bodies).map(|(a, b)| {
        let last = a.len() - 1;
        (a.x[last] - b.x[i + 1]).powi(2) + (a.y[last] - b.y[i + 1]).powi(2)
    });
    (of.sum::<f64>() / seen.bodies.len() as f64).sqrt()
}

/// Begun anew, what stands on others sways by millimetres; where contacts bear what they did it goes on as it was.
#[test]
fn what_rests_goes_on_resting() {
    for (engine, share) in [(Engine::Lanes, 0.1), (Engine::Rapier, 0.001)] {
        let (scene, seen) = stood(engine);
        let scenes: Vec<Scene> = (4..9).map(|i| from(&scene, &seen, i)).collect();
        let errors = |settled| {
            let rollouts: Vec<Rollout> =
                scenes.iter().map(|scene| Rollout { settled, ..Rollout::of(scene) }).collect();
            let paths = simulate(&rollouts, engine).unwrap();
            paths.iter().enumerate().map(|(k, p)| off(p, &seen, 4 + k)).collect::<Vec<f64>>()
        };
        let (cold, settled) = (errors(false), errors(true));
        println!("{engine:?}: cold {cold:?}, settled {settled:?}");
        let mean = |e: &[f64]| e.iter().sum::<f64>() / e.len() as f64;
        assert!(mean(&settled) < share * mean(&cold), "{engine:?}: {settled:?} after {cold:?}");
    }
}

/// Whatever else is in the batch, and however far that has come.
#[test]
fn settling_disturbs_nobody() {
    let (scene, seen) = stood(Engine::Lanes);
    let stands: Vec<Scene> = (1..9).map(|i| from(&scene, &seen, i)).collect();
    let alone = |scene: &Scene, settled| {
        simulate(&[Rollout { settled, ..Rollout::of(scene) }], Engine::Lanes).unwrap().remove(0)
    };
    let long = Scene { steps: 45, ..stands[2].clone() };
    let mut mixed: Vec<Rollout> = Vec::new();
    for scene in &stands {
        mixed.push(Rollout { settled: true, ..Rollout::of(scene) });
        mixed.push(Rollout::of(&long));
        mixed.push(Rollout::of(scene));
    }
    let together = simulate(&mixed, Engine::Lanes).unwrap();
    for (rollout, path) in mixed.iter().zip(&together) {
        assert_eq!(*path, alone(rollout.scene, rollout.settled), "{} steps", rollout.scene.steps);
    }
}

/// What touches nothing at the start is rolled out as ever, to the bit.
#[test]
fn what_flies_needs_no_settling() {
    let text = r#"{"format": "iplw.scene/1", "gravity": [0, -9.8], "time_step": 0.01, "steps": 200, "observe_every": 10,
        "bodies": [{"name": "ball", "shape": {"type": "disc", "radius": 0.5}, "position": [0, 3], "velocity": [1, 0],
                    "restitution": 0.8},
                   {"name": "brick", "shape": {"type": "box", "half_width": 0.4, "half_height": 0.2}, "position": [3, 3],
                    "angular_velocity": 1}],
        "statics": [{"name": "floor", "shape": {"type": "halfspace", "normal": [0, 1], "offset": 0}, "restitution": 0.8}]}"#;
    let scene = Scene::from_json(text).unwrap();
    let usual = Rollout::of(&scene);
    let paths = simulate(&[usual, Rollout { settled: true, ..usual }], Engine::Lanes).unwrap();
    assert_eq!(paths[0], paths[1]);
}
