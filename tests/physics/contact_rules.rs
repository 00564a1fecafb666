//! Mixing rules and the restitution threshold in both engines.

use iplw::task::Scene;
use iplw::task::scene::{Body, ContactRules, FrictionRule, RestitutionRule, Shape, Static};
use iplw::task::shape::{Disc, Halfspace, Rectangle};
use iplw::trajectory::Trajectory;
use iplw::world::{Engine, Rollout, Simulator};

const ENGINES: [Engine; 2] = [Engine::Lanes, Engine::Rapier];
const G: f64 = 9.8;

/// A ball of restitution 0.8 on a floor of 0.5 rebounds with the product or with the larger.
#[test]
fn mixes_restitution_by_the_scenes_rule() {
    for (restitution, e) in [(RestitutionRule::Product, 0.4), (RestitutionRule::Max, 0.8)] {
        let rules = ContactRules { restitution, ..ContactRules::default() };
        for engine in ENGINES {
            let t = run(&scene(vec![ball(2.0)], 1.2, rules), engine);
            let top = t.bodies[0].y[apex(&t)] - 0.5;
            assert!((top - e * e * 2.0).abs() < 0.03, "{engine:?}, {restitution:?}: {top} m");
        }
    }
}

/// A block of friction 0.9 on a floor of 0.4 is decelerated by the product or by the geometric mean.
#[test]
fn mixes_friction_by_the_scenes_rule() {
    for (friction, mu) in [(FrictionRule::Product, 0.36), (FrictionRule::GeometricMean, 0.6)] {
        let rules = ContactRules { friction, ..ContactRules::default() };
        let shape = Rectangle { half_width: 1.0, half_height: 0.25 };
        let sliding = Body { velocity: [4.0, 0.0], position: Some([0.0, 0.2499]), ..body(shape.into()) };
        for engine in ENGINES {
            let t = run(&scene(vec![sliding.clone()], 0.5, rules), engine);
            let lost = 4.0 - t.bodies[0].vx.last().unwrap();
            assert!((lost - mu * G * 0.5).abs() < 0.05, "{engine:?}, {friction:?}: {lost} m/s");
        }
    }
}

/// Impacts above the threshold are unchanged, to the bit in the batched engine; the first one below it is the
/// last.
#[test]
fn nothing_bounces_below_the_threshold() {
    let at = |restitution_threshold| ContactRules {
        restitution: RestitutionRule::Max,
        restitution_threshold,
        ..ContactRules::default()
    };
    // Impacts at 4.43, 3.54, 2.83, 2.27, 1.81 ... m/s.
    for engine in ENGINES {
        let free = run(&scene(vec![ball(1.0)], 4.0, at(0.0)), engine);
        let held = run(&scene(vec![ball(1.0)], 4.0, at(2.5)), engine);
        let top = |t: &Trajectory, after: f64| {
            let from = t.times.iter().position(|s| *s >= after).unwrap();
            t.bodies[0].y[from..].iter().fold(0.0, |a: f64, y| a.max(*y)) - 0.5
        };
        // The third impact, at 2.83 m/s, is 0.45 + 0.72 + 0.58 s after the start; the fourth 0.46 s later.
        if engine == Engine::Lanes {
            let third = free.times.iter().position(|s| *s >= 2.0).unwrap();
            assert_eq!(held.bodies[0].y[..third], free.bodies[0].y[..third]);
        }
        assert!(top(&free, 2.3) > 0.1, "{engine:?}: {}", top(&free, 2.3));
        assert!(top(&held, 1.8) > 0.2 && top(&held, 2.35) < 0.01, "{engine:?}: {}", top(&held, 2.35));
    }
}

/// Missing, explicit and neutral rules give the same bits.
#[test]
fn default_rules_keep_all_bits() {
    let plain = scene(vec![ball(2.0)], 3.0, ContactRules::default());
    for engine in ENGINES {
        let absent = Scene { contact_rules: None, ..plain.clone() };
        assert_eq!(run(&plain, engine), run(&absent, engine), "{engine:?}");
    }
    let json = plain.to_json();
    assert_eq!(Scene::from_json(&json).unwrap(), plain);
    let odd = json.replace("\"restitution_threshold\": 0.0", "\"restitution_threshold\": -1.0");
    let error = Scene::from_json(&odd).unwrap_err().to_string();
    assert!(error.contains("contact_rules.restitution_threshold"), "{error}");
}

/// Index of the first apex after the first bounce.
fn apex(t: &Trajectory) -> usize {
    let vy = &t.bodies[0].vy;
    let up = vy.iter().position(|v| *v > 0.0).expect("it bounces");
    up + vy[up..].iter().position(|v| *v < 0.0).expect("it comes down again")
}

fn ball(height: f64) -> Body {
    Body { position: Some([0.0, 0.5 + height]), restitution: 0.8, ..body(Disc { radius: 0.5 }.into()) }
}

fn body(shape: Shape) -> Body {
    Body {
        name: "b".into(),
        shape,
        mass: None,
        density: Some(1.0),
        friction: 0.9,
        restitution: 0.0,
        position: None,
        angle: 0.0,
        velocity: [0.0; 2],
        angular_velocity: 0.0,
        inertia: None,
    }
}

fn scene(bodies: Vec<Body>, seconds: f64, rules: ContactRules) -> Scene {
    let ground = Static {
        name: "ground".into(),
        shape: Halfspace { normal: [0.0, 1.0], offset: 0.0 }.into(),
        friction: 0.4,
        restitution: 0.5,
        position: [0.0; 2],
        angle: 0.0,
    };
    Scene {
        name: "contact rules".into(),
        gravity: [0.0, -G],
        bodies,
        statics: vec![ground],
        contact_rules: Some(rules),
        time_step: 1.0 / 480.0,
        steps: (seconds * 480.0).round() as u32,
        observe_every: 1,
        ..Scene::empty()
    }
}

fn run(scene: &Scene, engine: Engine) -> Trajectory {
    scene.validate().unwrap();
    let rollout = Rollout::of(scene);
    Simulator::new(engine).run(&[rollout]).unwrap().remove(0)
}
