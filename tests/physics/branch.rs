//! Interventions: neutral ones change no bit, and others match analytic solutions, in both engines.

use iplw::error::Error;
use iplw::task::{Intervention, Scene};
use iplw::trajectory::{Termination, Track, Trajectory};
use iplw::world::{Engine, Rollout, Simulator};
use serde_json::{Value, json};

const G: f64 = 9.8;
const ENGINES: [Engine; 2] = [Engine::Lanes, Engine::Rapier];

/// Discs and boxes that fall on each other and on a floor; with effects of motion, contact and sensors.
fn busy(polygons: bool, effects: bool) -> Scene {
    let disc = |r: f64| json!({"type": "disc", "radius": r});
    let second =
        if polygons { json!({"type": "box", "half_width": 0.5, "half_height": 0.3}) } else { disc(0.5) };
    let effects = if effects {
        json!([
            {"name": "quadratic_drag", "parameters": {"k": 0.02}},
            {"name": "gust", "parameters": {"ax": 1.0, "period": 0.7}},
            {"name": "rolling_resistance", "parameters": {"crr": 0.02}},
            {"name": "lag", "parameters": {"dt": 0.013}}
        ])
    } else {
        json!([])
    };
    scene(&json!({"format": "iplw.scene/1", "steps": 480, "observe_every": 7, "effects": effects,
        "bodies": [
            {"name": "ball", "shape": disc(0.4), "position": [0, 2], "velocity": [1, 0]},
            {"name": "thing", "shape": second, "position": [0.3, 4], "angular_velocity": 1},
            {"name": "third", "shape": disc(0.3), "position": [0.1, 5.5]}],
        "statics": [
            {"name": "floor", "shape": {"type": "halfspace", "normal": [0, 1], "offset": 0}},
            {"name": "step", "shape": {"type": "box", "half_width": 1, "half_height": 0.2}, "position": [2, 0.2]}]}))
}

/// Interventions without consequences: of size zero, or to the current values.
fn nothing(scene: &Scene, plain: &Trajectory) -> Vec<Intervention> {
    let latents = scene.bodies[0].restitution;
    let ball = &plain.bodies[0];
    let at = |k: usize| plain.times[k];
    let list = json!([
        {"type": "impulse", "at": 0, "body": "thing", "impulse": [0, 0]},
        {"type": "impulse", "at": at(10), "body": "ball", "impulse": [0, 0]},
        {"type": "set", "at": at(20), "body": "ball", "position": [ball.x[20], ball.y[20]], "angle": ball.angle[20]},
        {"type": "set", "at": at(20), "body": "ball", "velocity": [ball.vx[20], ball.vy[20]]},
        {"type": "latents", "at": at(30), "restitution": latents},
        {"type": "latents", "at": 1.001, "friction": 0.5, "density": 1.0}
    ]);
    serde_json::from_value(list).unwrap()
}

#[test]
fn neutral_interventions_keep_all_bits() {
    for (polygons, effects) in [(false, false), (true, false), (false, true), (true, true)] {
        let scene = busy(polygons, effects);
        for engine in ENGINES {
            let plain = run(&scene, engine);
            let mut list = nothing(&scene, &plain);
            if effects {
                // Measured positions are not the true ones.
                list.retain(|own| !matches!(own, Intervention::Set { .. }));
            }
            let branch = run(&with(&scene, list), engine);
            assert!(bits(&branch) == bits(&plain), "{engine:?}, polygons {polygons}, effects {effects}");
        }
    }
}

/// Lanes of one batch with interventions at different steps equal single rollouts; lanes without
/// interventions are unaffected.
#[test]
fn lanes_with_changes_at_different_steps_do_not_disturb_each_other() {
    for polygons in [false, true] {
        let scene = busy(polygons, false);
        let changed = |k: usize| {
            let list = match k % 5 {
                0 => json!([]),
                1 => json!([{"type": "impulse", "at": 0.05 * k as f64, "body": "ball", "impulse": [1, 1]}]),
                2 => json!([{"type": "remove", "at": 0.03 * k as f64, "body": "floor"}]),
                3 => json!([{"type": "remove", "at": 0, "body": "thing"},
                    {"type": "latents", "at": 0.7, "friction": 0.1}]),
                _ => json!([{"type": "set", "at": 0.02 * k as f64, "body": "third", "position": [-4, 3]}]),
            };
            with(&scene, serde_json::from_value(list).unwrap())
        };
        let scenes: Vec<Scene> = (0..40).map(changed).collect();
        let rollouts: Vec<Rollout> = scenes.iter().map(Rollout::of).collect();
        let together = Simulator::new(Engine::Lanes).run(&rollouts).unwrap();
        for (k, scene) in scenes.iter().enumerate() {
            let alone = run(scene, Engine::Lanes);
            assert!(bits(&together[k]) == bits(&alone), "rollout {k}, polygons {polygons}");
        }
        let plain = run(&scene, Engine::Lanes);
        let floorless = &together[12];
        let until = floorless.times.iter().filter(|t| **t <= 0.36).count();
        assert!(until > 3 && until < plain.times.len() - 10);
        assert_eq!(floorless.bodies[0].x[..until], plain.bodies[0].x[..until], "the same up to the change");
        assert!(floorless.bodies[0].y.last().unwrap() < &-5.0, "and then it falls");
    }
}

/// The velocity changes by impulse / mass, in addition to gravity; the spin by (r x J) / I off the centre of
/// mass.
#[test]
fn an_impulse_changes_the_velocity_by_impulse_over_mass() {
    for shape in [
        json!({"type": "disc", "radius": 0.5}),
        json!({"type": "box", "half_width": 0.4, "half_height": 0.2}),
        json!({"type": "compound", "pieces": [
            {"type": "disc", "radius": 0.2}, {"type": "disc", "radius": 0.3, "position": [0.6, 0]}]}),
    ] {
        let text = json!({"format": "iplw.scene/1", "steps": 240, "observe_every": 1, "gravity": [0, -G],
            "bodies": [{"name": "ball", "shape": shape, "mass": 2.5, "position": [0, 50]}]});
        let Ok(scene) = Scene::from_json(&text.to_string()) else { panic!("{text}") };
        let blow = |point: Value| {
            serde_json::from_value(json!([
                {"type": "impulse", "at": 0.5, "body": "ball", "impulse": [1.0, 0.5], "point": point}]))
            .unwrap()
        };
        for (engine, exact) in [(Engine::Lanes, 1e-12), (Engine::Rapier, 2e-4)] {
            let plain = run(&scene, engine);
            let hit = run(&with(&scene, blow(Value::Null)), engine);
            let (a, b) = (&plain.bodies[0], &hit.bodies[0]);
            assert_eq!((a.vx[120], a.vy[120], a.x[120]), (b.vx[120], b.vy[120], b.x[120]), "before it");
            for k in [121, 240] {
                assert!((b.vx[k] - a.vx[k] - 1.0 / 2.5).abs() < exact, "{engine:?}: {}", b.vx[k]);
                assert!((b.vy[k] - a.vy[k] - 0.5 / 2.5).abs() < exact, "{engine:?}: {}", b.vy[k]);
                assert_eq!(b.omega[k], 0.0);
            }
            // At 0.3 m from the centre of mass: spin, and the same velocity of the centre of
            // mass.
            let (_, inertia) = scene.bodies[0].mass_properties(None);
            let centre = scene.bodies[0].shape.moments().centre;
            let point = json!([a.x[120] + centre[0] + 0.3, a.y[120] + centre[1]]);
            let turned = &run(&with(&scene, blow(point)), engine).bodies[0];
            let spin = 0.3 * 0.5 / inertia;
            assert!(
                (turned.omega[121] - spin).abs() < 1e-4 * spin,
                "{engine:?}: {} for {spin}",
                turned.omega[121]
            );
            let dt = scene.time_step;
            let went =
                |t: &Track, k: usize| t.x[k] + centre[0] * t.angle[k].cos() - centre[1] * t.angle[k].sin();
            let speed = (went(turned, 240) - went(turned, 130)) / (110.0 * dt);
            assert!((speed - 1.0 / 2.5).abs() < 1e-3, "{engine:?}: the centre of mass goes at {speed}");
        }
    }
}

/// A ball on a plank, static or movable, falls freely once the plank is removed.
#[test]
fn objects_fall_after_their_support_is_removed() {
    let text = |polygons: bool| {
        let ball = if polygons {
            json!({"type": "box", "half_width": 0.5, "half_height": 0.5})
        } else {
            json!({"type": "disc", "radius": 0.5})
        };
        json!({"format": "iplw.scene/1", "steps": 480, "observe_every": 1, "gravity": [0, -G],
            "bodies": [{"name": "ball", "shape": ball, "position": [0, 10.7], "restitution": 0},
                {"name": "post", "shape": {"type": "disc", "radius": 0.4}, "position": [20, 0.4]}],
            "statics": [
                {"name": "plank", "shape": {"type": "box", "half_width": 3, "half_height": 0.2}, "position": [0, 10]},
                {"name": "ground", "shape": {"type": "halfspace", "normal": [0, 1], "offset": -100}}]})
    };
    for polygons in [false, true] {
        let scene = scene(&text(polygons));
        let list: Vec<Intervention> =
            serde_json::from_value(json!([{"type": "remove", "at": 1.0, "body": "plank"},
            {"type": "remove", "at": 1.5, "body": "post"}]))
            .unwrap();
        for engine in ENGINES {
            let t = run(&with(&scene, list.clone()), engine);
            let ball = &t.bodies[0];
            assert!((ball.y[240] - 10.7).abs() < 0.11, "{engine:?}: it lies on the plank at {}", ball.y[240]);
            for k in [250, 300, 480] {
                let s = f64::from(k - 240) * scene.time_step;
                let fallen = ball.y[240] - ball.y[k as usize];
                // Of first order in the time step, plus the velocity of the overlap
                // correction.
                let wanted = 0.5 * G * s * s;
                assert!(
                    (fallen - wanted).abs() < 0.03 + G * s * scene.time_step,
                    "{engine:?}: {fallen} for {wanted}"
                );
                assert!((ball.vy[k as usize] + G * s).abs() < 0.05, "{engine:?}: {}", ball.vy[k as usize]);
            }
            let post = &t.bodies[1];
            assert!(post.x[360].is_finite() && post.x[361].is_nan() && post.omega[480].is_nan());
            assert_eq!(t.outcome.end, Termination::Horizon);
        }
    }
}

/// An added object falls like an original one; before its addition it has no influence, also if it has
/// another kind of shape.
#[test]
fn added_objects_act_only_after_their_addition() {
    for (polygons, shape) in [
        (false, json!({"type": "disc", "radius": 0.2})),
        (true, json!({"type": "disc", "radius": 0.2})),
        (false, json!({"type": "box", "half_width": 0.2, "half_height": 0.2})),
        (true, json!({"type": "box", "half_width": 0.2, "half_height": 0.2})),
    ] {
        let scene = busy(polygons, false);
        let list: Vec<Intervention> = serde_json::from_value(json!([
            {"type": "add", "at": 0.7, "body": {"name": "new", "shape": shape, "position": [-5, 8], "restitution": 0}},
            {"type": "add_static", "at": 0.7, "static": {"name": "shelf",
                "shape": {"type": "box", "half_width": 1, "half_height": 0.2}, "position": [-5, 5]}},
            {"type": "remove", "at": 1.5, "body": "shelf"}]))
        .unwrap();
        for engine in ENGINES {
            let (plain, t) = (run(&scene, engine), run(&with(&scene, list.clone()), engine));
            let (own, new) = (&plain.bodies, &t.bodies[3]);
            let before = t.times.iter().filter(|t| **t <= 0.7).count();
            for (a, b) in own.iter().zip(&t.bodies) {
                assert_eq!(
                    (&a.x[..before], &a.angle[..before]),
                    (&b.x[..before], &b.angle[..before]),
                    "{engine:?}"
                );
            }
            assert_eq!((new.name.as_str(), new.x.len()), ("new", t.times.len()));
            assert!(new.x[before - 1].is_nan() && new.y[before].is_finite());
            let at = |time: f64| t.times.iter().position(|t| *t >= time).unwrap();
            let s = t.times[at(1.0)] - 0.7;
            assert!((8.0 - new.y[at(1.0)] - 0.5 * G * s * s).abs() < 0.03, "{engine:?}: free fall");
            assert!((new.y[at(1.5)] - 5.4).abs() < 0.1, "{engine:?}: on the shelf, at {}", new.y[at(1.5)]);
            assert!(new.y.last().unwrap() < &4.9, "{engine:?}: and off it: {}", new.y.last().unwrap());
        }
        // Other objects are unaffected: discs, none of which is smaller than the added one.
        let far = serde_json::from_value(json!([{"type": "add", "at": 0.7,
            "body": {"name": "new", "shape": {"type": "disc", "radius": 2}, "position": [-50, 8]}}]))
        .unwrap();
        let (plain, t) = (run(&scene, Engine::Lanes), run(&with(&scene, far), Engine::Lanes));
        assert_eq!(plain.bodies[..], t.bodies[..3]);
    }
}

#[test]
fn overlapping_addition_ends_rollout_and_names_obstacle() {
    let scene = busy(true, false);
    let new = |x: f64| {
        json!([{"type": "impulse", "at": 0.3, "body": "ball", "impulse": [0, 0]},
            {"type": "add", "at": 1.99, "body": {"name": "new", "shape": {"type": "disc", "radius": 0.3}, "position": [x, 0.1]}}])
    };
    for engine in ENGINES {
        let t = run(&with(&scene, serde_json::from_value(new(-30.0)).unwrap()), engine);
        // Indices: bodies, added bodies, then the floor.
        assert_eq!(t.outcome.end, Termination::Blocked { intervention: 1, by: 4 }, "{engine:?}");
        assert_eq!(t.outcome.steps, 478);
        let put = json!([{"type": "set", "at": 0.5, "body": "third", "position": [2, 0.2]}]);
        let t = run(&with(&scene, serde_json::from_value(put).unwrap()), engine);
        assert_eq!(t.outcome.end, Termination::Blocked { intervention: 0, by: 4 }, "{engine:?}: in the step");
        let within_steps = json!([{"type": "set", "at": 0, "body": "third", "position": [0, 2]}]);
        let t = run(&with(&scene, serde_json::from_value(within_steps).unwrap()), engine);
        assert_eq!(
            (t.outcome.end, t.times.len()),
            (Termination::Blocked { intervention: 0, by: 0 }, 1),
            "{engine:?}"
        );
    }
}

#[test]
fn latents_and_velocities_change_at_once() {
    let text = json!({"format": "iplw.scene/1", "steps": 480, "observe_every": 1, "gravity": [0, -G],
        "bodies": [{"name": "puck", "shape": {"type": "box", "half_width": 0.5, "half_height": 0.25},
            "position": [0, 0.25], "friction": 0, "restitution": 0}],
        "statics": [{"name": "ice", "shape": {"type": "halfspace", "normal": [0, 1], "offset": 0}}],
        "carriers": ["puck"]});
    let list: Vec<Intervention> = serde_json::from_value(json!([
        {"type": "set", "at": 0.5, "body": "puck", "velocity": [3, 0]},
        {"type": "latents", "at": 1.0, "friction": 0.5, "density": 3}]))
    .unwrap();
    for engine in ENGINES {
        let t = run(&with(&scene(&text), list.clone()), engine);
        let puck = &t.bodies[0];
        assert!(puck.x[120].abs() < 1e-6, "{engine:?}: it lies still");
        assert!((puck.vx[240] - 3.0).abs() < 1e-3, "{engine:?}: no friction: {}", puck.vx[240]);
        // v - mu g t after 0.4 s.
        assert!((puck.vx[336] - (3.0 - 0.5 * G * 0.4)).abs() < 0.05, "{engine:?}: {}", puck.vx[336]);
    }
}

/// A tiny displacement does not create a new contact, in either engine.
#[test]
fn tiny_displacement_keeps_contact() {
    let disc = |r: f64| json!({"type": "disc", "radius": r});
    let square = json!({"type": "box", "half_width": 0.5, "half_height": 0.5});
    for shape in [disc(0.5), square] {
        let resting = scene(&json!({"format": "iplw.scene/1", "steps": 480, "observe_every": 48,
            "bodies": [{"name": "below", "shape": shape, "position": [0, 0.5]},
                       {"name": "upon", "shape": shape, "position": [0, 1.5]}],
            "statics": [{"name": "floor", "shape": {"type": "halfspace", "normal": [0, 1], "offset": 0}}]}));
        for engine in ENGINES {
            let plain = run(&resting, engine);
            let [x, y] = [plain.bodies[1].x[5], plain.bodies[1].y[5]];
            let moved =
                json!([{"type": "set", "at": plain.times[5], "body": "upon", "position": [x + 1e-9, y]}]);
            let after = run(&with(&resting, serde_json::from_value(moved).unwrap()), engine);
            assert_eq!(plain.collisions, 1, "{engine:?} {shape}");
            assert_eq!(after.collisions, plain.collisions, "{engine:?} {shape}");
        }
    }
}

#[test]
fn rejects_invalid_interventions_by_field() {
    let scene = busy(false, false);
    for (list, field) in [
        (json!([{"type": "impulse", "at": 2.0, "body": "ball", "impulse": [1, 0]}]), "interventions[0].at"),
        (json!([{"type": "impulse", "at": -0.1, "body": "ball", "impulse": [1, 0]}]), "interventions[0].at"),
        (json!([{"type": "impulse", "at": 1, "body": "floor", "impulse": [1, 0]}]), "interventions[0].body"),
        (
            json!([{"type": "impulse", "at": 1, "body": "ball", "impulse": [1e6, 0]}]),
            "interventions[0].impulse",
        ),
        (json!([{"type": "remove", "at": 1, "body": "ghost"}]), "interventions[0].body"),
        (
            json!([{"type": "impulse", "at": 1, "body": "ball", "impulse": [1, 0]},
            {"type": "remove", "at": 0.5, "body": "ball"}]),
            "interventions[0].body",
        ),
        (json!([{"type": "set", "at": 1, "body": "ball"}]), "interventions[0].set"),
        (
            json!([{"type": "set", "at": 1, "body": "ball", "velocity": [1e9, 0]}]),
            "interventions[0].velocity[0]",
        ),
        (json!([{"type": "latents", "at": 1, "friction": -1}]), "interventions[0].friction"),
        (json!([{"type": "latents", "at": 1}]), "interventions[0].latents"),
        (
            json!([{"type": "add", "at": 1, "body": {"name": "ball", "shape": {"type": "disc", "radius": 1},
            "position": [9, 9]}}]),
            "interventions[0].body.name",
        ),
        (
            json!([{"type": "add", "at": 1, "body": {"name": "new", "shape": {"type": "disc", "radius": 1}}}]),
            "interventions[0].body.position",
        ),
        (json!(vec![json!({"type": "remove", "at": 1, "body": "ball"}); 65]), "interventions"),
    ] {
        let wrong = with(&scene, serde_json::from_value(list.clone()).unwrap());
        let rollout = Rollout::of(&wrong);
        match Simulator::new(Engine::Auto).run(&[rollout]) {
            Err(Error::Input(input)) => assert_eq!(input.field, field, "{list}"),
            other => panic!("{list}: {other:?}"),
        }
    }
    let nan =
        vec![Intervention::Impulse { at: 1.0, body: "ball".into(), impulse: [f64::NAN, 0.0], point: None }];
    let wrong = with(&scene, nan);
    let rollout = Rollout::of(&wrong);
    assert!(
        Simulator::new(Engine::Auto).run(&[rollout]).is_err_and(|e| e.to_string().contains("impulse[0]"))
    );
}

fn scene(text: &Value) -> Scene {
    Scene::from_json(&text.to_string()).unwrap()
}

/// All fields to the last digit, with the sign of zeros.
fn bits(t: &Trajectory) -> String {
    format!("{t:?}")
}

fn with(scene: &Scene, interventions: Vec<Intervention>) -> Scene {
    Scene { interventions, ..scene.clone() }
}

fn run(scene: &Scene, engine: Engine) -> Trajectory {
    scene.validate().unwrap();
    let rollout = Rollout::of(scene);
    Simulator::new(engine).run(&[rollout]).unwrap().remove(0)
}
