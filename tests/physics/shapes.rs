//! Properties of every shape in the registry.

use iplw::task::Scene;
use iplw::task::scene::{Body, Goal, Shape, Static};
use iplw::task::shape::{Disc, Halfspace};
use iplw::trajectory::Trajectory;
use iplw::world::{Engine, Rollout, Simulator};

/// A ball falls on the shape in either engine; the goal detects the contact, and both engines record the same
/// one.
#[test]
fn every_shape_stops_a_ball() {
    for shape in Shape::samples() {
        let middle = shape.moments().centre;
        let ball = body("ball", Disc { radius: 0.2 }.into(), [middle[0] + 0.01, 3.0]);
        let scene = scene(ball, fixed("thing", shape.clone()), ["ball", "thing"]);
        let [lanes, rapier] = [Engine::Lanes, Engine::Rapier].map(|engine| run(&scene, engine));
        for t in [&lanes, &rapier] {
            assert!(t.solved(), "{shape:?}");
            assert_eq!(t.events[0].between, ["ball", "thing"], "{shape:?}");
        }
        let (a, b) = (&lanes.events[0], &rapier.events[0]);
        assert!((a.time - b.time).abs() < 0.01 && (a.speed - b.speed).abs() < 0.1, "{shape:?} {a:?} {b:?}");
    }
}

/// Bounded shapes fall to the ground and do not sink in.
#[test]
fn every_bounded_shape_falls_to_the_ground() {
    for shape in Shape::samples().into_iter().filter(|s| s.bounds().is_some()) {
        let mut thing = body("thing", shape.clone(), [0.0, 3.0]);
        thing.angle = 0.3;
        let ground = fixed("ground", Halfspace { normal: [0.0, 1.0], offset: 0.0 }.into());
        let scene = scene(thing, ground, ["thing", "ground"]);
        for engine in [Engine::Lanes, Engine::Rapier] {
            let t = run(&scene, engine);
            assert!(t.solved(), "{shape:?}");
            let (track, mut at_end) = (&t.bodies[0], scene.bodies[0].clone());
            let last = track.len() - 1;
            (at_end.position, at_end.angle) = (Some([track.x[last], track.y[last]]), track.angle[last]);
            let gap = scene.statics[0].placed().signed_distance_to(&at_end.placed().unwrap());
            // `lanes` leaves bodies within Chipmunk's slop of 0.1 m, by size.
            let slop = if engine == Engine::Lanes { 0.1 } else { 0.02 };
            assert!(gap.abs() < slop, "{shape:?} {engine:?}: {gap} m from the ground");
        }
    }
}

/// Distances are finite everywhere.
#[test]
fn distances_to_every_shape_are_finite() {
    for shape in Shape::samples() {
        let placed = fixed("thing", shape.clone()).placed();
        let point = Shape::from(Disc { radius: 0.1 }).pieces().unwrap();
        let middle = shape.moments().centre;
        assert!(
            placed.signed_distance_to(&point.placed([middle[0], middle[1] - 0.01], 0.0)) < 0.0,
            "{shape:?}"
        );
        assert!(placed.signed_distance_to(&point.placed([0.0, 5.0], 0.0)).is_finite(), "{shape:?}");
    }
}

fn scene(body: Body, fixed: Static, goal: [&str; 2]) -> Scene {
    let goal =
        Goal::Contact { bodies: goal.map(String::from), hold_s: 0.0, tolerance: 0.01, stop: Some(false) };
    Scene { bodies: vec![body], statics: vec![fixed], goal: Some(goal), steps: 720, ..Scene::empty() }
}

fn body(name: &str, shape: Shape, position: [f64; 2]) -> Body {
    Body {
        name: name.into(),
        shape,
        mass: None,
        density: None,
        friction: 0.5,
        restitution: 0.0,
        position: Some(position),
        angle: 0.0,
        velocity: [0.0; 2],
        angular_velocity: 0.0,
        inertia: None,
    }
}

fn fixed(name: &str, shape: Shape) -> Static {
    Static { name: name.into(), shape, friction: 1.0, restitution: 1.0, position: [0.0; 2], angle: 0.0 }
}

fn run(scene: &Scene, engine: Engine) -> Trajectory {
    scene.validate().unwrap();
    let rollout = Rollout::of(scene);
    Simulator::new(engine).run(&[rollout]).unwrap().remove(0)
}
