//! Rollouts from the middle of an observed trajectory: contact impulses are warm-started although they are
//! not observed.

use iplw::task::Scene;
use iplw::trajectory::Trajectory;
use iplw::world::{Engine, Rollout, Simulator};

/// A heavy ball on an upright pole, a stack of three boxes and a falling ball, simulated by the engine and
/// observed every half second.
fn stacked(engine: Engine) -> (Scene, Trajectory) {
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
    let seen = Simulator::new(engine).run(&[Rollout::of(&scene)]).unwrap().remove(0);
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

/// Root mean square distance of the final positions from the next observation, m.
fn rms_error(path: &Trajectory, seen: &Trajectory, i: usize) -> f64 {
    let of = path.bodies.iter().zip(&seen.bodies).map(|(a, b)| {
        let last = a.len() - 1;
        (a.x[last] - b.x[i + 1]).powi(2) + (a.y[last] - b.y[i + 1]).powi(2)
    });
    (of.sum::<f64>() / seen.bodies.len() as f64).sqrt()
}

/// Without a warm start stacks sway by millimetres; with it they continue as observed.
#[test]
fn warm_start_keeps_stacks_at_rest() {
    for (engine, share) in [(Engine::Lanes, 0.1), (Engine::Rapier, 0.001)] {
        let (scene, seen) = stacked(engine);
        let scenes: Vec<Scene> = (4..9).map(|i| from(&scene, &seen, i)).collect();
        let errors = |settled| {
            let rollouts: Vec<Rollout> = scenes
                .iter()
                .map(|scene| Rollout { contacts_established: settled, ..Rollout::of(scene) })
                .collect();
            let paths = Simulator::new(engine).run(&rollouts).unwrap();
            paths.iter().enumerate().map(|(k, p)| rms_error(p, &seen, 4 + k)).collect::<Vec<f64>>()
        };
        let (cold, settled) = (errors(false), errors(true));
        println!("{engine:?}: cold {cold:?}, settled {settled:?}");
        let mean = |e: &[f64]| e.iter().sum::<f64>() / e.len() as f64;
        assert!(mean(&settled) < share * mean(&cold), "{engine:?}: {settled:?} after {cold:?}");
    }
}

/// A warm start does not affect other rollouts of the batch.
#[test]
fn warm_start_does_not_affect_other_lanes() {
    let (scene, seen) = stacked(Engine::Lanes);
    let stands: Vec<Scene> = (1..9).map(|i| from(&scene, &seen, i)).collect();
    let alone = |scene: &Scene, settled| {
        Simulator::new(Engine::Lanes)
            .run(&[Rollout { contacts_established: settled, ..Rollout::of(scene) }])
            .unwrap()
            .remove(0)
    };
    let long = Scene { steps: 45, ..stands[2].clone() };
    let mut mixed: Vec<Rollout> = Vec::new();
    for scene in &stands {
        mixed.push(Rollout { contacts_established: true, ..Rollout::of(scene) });
        mixed.push(Rollout::of(&long));
        mixed.push(Rollout::of(scene));
    }
    let together = Simulator::new(Engine::Lanes).run(&mixed).unwrap();
    for (rollout, path) in mixed.iter().zip(&together) {
        assert_eq!(
            *path,
            alone(rollout.scene, rollout.contacts_established),
            "{} steps",
            rollout.scene.steps
        );
    }
}

/// Bodies without contacts at the start are unaffected, to the bit.
#[test]
fn warm_start_without_contacts_changes_nothing() {
    let text = r#"{"format": "iplw.scene/1", "gravity": [0, -9.8], "time_step": 0.01, "steps": 200, "observe_every": 10,
        "bodies": [{"name": "ball", "shape": {"type": "disc", "radius": 0.5}, "position": [0, 3], "velocity": [1, 0],
                    "restitution": 0.8},
                   {"name": "brick", "shape": {"type": "box", "half_width": 0.4, "half_height": 0.2}, "position": [3, 3],
                    "angular_velocity": 1}],
        "statics": [{"name": "floor", "shape": {"type": "halfspace", "normal": [0, 1], "offset": 0}, "restitution": 0.8}]}"#;
    let scene = Scene::from_json(text).unwrap();
    let usual = Rollout::of(&scene);
    let paths =
        Simulator::new(Engine::Lanes).run(&[usual, Rollout { contacts_established: true, ..usual }]).unwrap();
    assert_eq!(paths[0], paths[1]);
}
