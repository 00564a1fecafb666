//! Goals in both engines: each is reached in the step at which exact geometry of the observations gives it.

use iplw::task::Scene;
use iplw::task::geometry::polygon_contains;
use iplw::task::scene::{Goal, GoalPoint};
use iplw::task::solid::{ConvexPieces, Solid};
use iplw::trajectory::{Termination, Trajectory};
use iplw::world::{Engine, Rollout, Simulator};

/// A ball falls onto the floor, another onto it, a box and a jar are thrown upwards and rotate; observed in
/// every step.
const SCENE: &str = r#"{"format": "iplw.scene/1", "time_step": 0.005, "steps": 400, "observe_every": 1,
    "bodies": [
      {"name": "disc", "shape": {"type": "disc", "radius": 0.3}, "position": [-3, 0.8], "velocity": [0.2, 0]},
      {"name": "other", "shape": {"type": "disc", "radius": 0.25}, "position": [-2.9, 2]},
      {"name": "box", "shape": {"type": "box", "half_width": 0.4, "half_height": 0.2}, "position": [0, 0.6],
       "angle": 0.4, "velocity": [0.3, 6], "angular_velocity": 3},
      {"name": "jar", "shape": {"type": "compound", "pieces": [
        {"type": "box", "half_width": 0.4, "half_height": 0.1},
        {"type": "box", "half_width": 0.1, "half_height": 0.3, "position": [0.3, 0.4]}]},
       "position": [2, 0.5], "velocity": [0, 5], "angular_velocity": -2}],
    "statics": [{"name": "floor", "shape": {"type": "box", "half_width": 9, "half_height": 1}, "position": [0, -1]}]}"#;

#[test]
fn goals_are_reached_when_exact_geometry_gives_them() {
    let whole = Scene::from_json(SCENE).unwrap();
    // Scenes of discs alone use another path of the batched engine.
    let mut discs = whole.clone();
    discs.bodies.truncate(2);
    for goal in goals() {
        for scene in [&whole, &discs] {
            if goal.names().iter().any(|n| *n != "floor" && scene.body(n).is_none()) {
                continue;
            }
            for engine in [Engine::Lanes, Engine::Rapier] {
                let free = run(scene, engine);
                let wanted = reached(scene, &goal, &free);
                let found = run(&Scene { goal: Some(goal.clone()), ..scene.clone() }, engine);
                let steps = found.solved().then_some(found.outcome.steps as usize);
                assert_eq!(steps, wanted, "{engine:?}: {goal:?}");
                assert!(wanted.is_some_and(|s| s > 1), "{engine:?}: {goal:?} shows nothing: {wanted:?}");
                assert_eq!(found.outcome.end, Termination::Goal);
            }
        }
    }
}

/// The lane of a diverged rollout is refilled; the next rollout is evaluated from its first step.
#[test]
fn rollouts_after_a_diverged_one_are_unaffected() {
    let falling = Scene::from_json(
        r#"{"format": "iplw.scene/1", "gravity": [0, -9.8], "time_step": 0.1, "steps": 20000, "observe_every": 20000,
            "bodies": [{"name": "a", "shape": {"type": "disc", "radius": 0.5}, "position": [0, 0]},
                       {"name": "b", "shape": {"type": "disc", "radius": 0.5}, "position": [5, 0]}],
            "goal": {"type": "apart", "bodies": ["a", "b"], "tolerance": 9}}"#,
    )
    .unwrap();
    let apart = Goal::Apart {
        bodies: ["a".into(), "b".into()],
        after_touch: false,
        hold_s: 0.0,
        tolerance: 0.1,
        stop: None,
    };
    let calm = Scene { gravity: [0.0; 2], steps: 50, goal: Some(apart), ..falling.clone() };
    let scenes: Vec<&Scene> = [&falling; 40].into_iter().chain([&calm; 40]).collect();
    let all =
        Simulator::new(Engine::Lanes).run(&scenes.into_iter().map(Rollout::of).collect::<Vec<_>>()).unwrap();
    assert!(all[..40].iter().all(|t| t.outcome.end == Termination::Diverged));
    let alone = run(&calm, Engine::Lanes);
    assert_eq!((alone.outcome.end, alone.outcome.steps), (Termination::Goal, 1));
    assert!(all[40..].iter().all(|t| *t == alone), "{:?}", all[40].outcome);
}

/// Two statics are neither touching nor apart, and objects that never touch never separate.
#[test]
fn impossible_goals_are_not_reached() {
    let mut scene = Scene::from_json(SCENE).unwrap();
    scene.statics.push(iplw::task::scene::Static {
        name: "far".into(),
        position: [0.0, 90.0],
        ..scene.statics[0].clone()
    });
    for bodies in [["floor", "far"], ["far", "disc"]] {
        let after_touch = bodies[1] == "disc";
        let goal = Goal::Apart {
            bodies: bodies.map(String::from),
            after_touch,
            hold_s: 0.0,
            tolerance: 0.01,
            stop: None,
        };
        scene.goal = Some(goal);
        for engine in [Engine::Lanes, Engine::Rapier] {
            assert!(!run(&scene, engine).solved(), "{engine:?}: {bodies:?}");
        }
    }
}

#[test]
fn rejects_invalid_goals_by_field() {
    let check = |goal: &str, wanted: &[&str]| {
        let text = SCENE.replace("\"statics\"", &format!("\"goal\": {goal}, \"statics\""));
        let error = Scene::from_json(&text).unwrap_err().to_string();
        assert!(wanted.iter().all(|w| error.contains(w)), "{goal}: {error}");
    };
    check(r#"{"type": "apart", "bodies": ["disc", "disk"]}"#, &["goal.bodies[1]", "disk"]);
    check(r#"{"type": "apart", "bodies": ["disc", "disc"]}"#, &["goal.bodies", "two different names"]);
    check(r#"{"type": "above", "body": "floor", "height": 1}"#, &["goal.body", "floor"]);
    check(r#"{"type": "above", "body": "disc"}"#, &["goal.height", "either a height, or a line"]);
    check(
        r#"{"type": "above", "body": "disc", "height": 1, "line": [[0, 0], [1, 1]]}"#,
        &["goal.height", "either"],
    );
    check(r#"{"type": "above", "body": "disc", "line": [[1, 0], [1, 5]]}"#, &["goal.line", "different x"]);
    check(r#"{"type": "above", "body": "disc", "height": 1e9}"#, &["goal.height", "1000000000"]);
    check(r#"{"type": "above", "body": "disc", "height": 1, "point": "top"}"#, &["goal", "top"]);
    check(r#"{"type": "above", "body": "disc", "height": 1, "hold_s": 99}"#, &["goal.hold_s", "99"]);
}

/// Default values are not serialised, and a round trip preserves the goal.
#[test]
fn goals_survive_a_round_trip() {
    for goal in goals() {
        let text = serde_json::to_string(&goal).unwrap();
        assert_eq!(serde_json::from_str::<Goal>(&text).unwrap(), goal);
    }
    let text = r#"{"type":"above","body":"disc","height":1.5,"hold_s":0.0}"#;
    assert_eq!(serde_json::to_string(&serde_json::from_str::<Goal>(text).unwrap()).unwrap(), text);
}

fn goals() -> Vec<Goal> {
    let apart = |a: &str, b: &str, after_touch, hold_s| Goal::Apart {
        bodies: [a.into(), b.into()],
        after_touch,
        hold_s,
        tolerance: 0.01,
        stop: None,
    };
    let above = |body: &str, height, line, point, hold_s| Goal::Above {
        body: body.into(),
        height,
        line,
        point,
        hold_s,
        stop: None,
    };
    let slope =
        |turned: bool| Some(if turned { [[3.0, 2.2], [-1.0, 1.2]] } else { [[-1.0, 1.2], [3.0, 2.2]] });
    vec![
        apart("disc", "floor", true, 0.05),
        apart("disc", "floor", false, 0.1),
        apart("floor", "disc", true, 0.0),
        apart("disc", "other", true, 0.05),
        apart("other", "disc", false, 0.3),
        apart("box", "floor", true, 0.03),
        apart("box", "jar", false, 0.2),
        apart("other", "jar", false, 0.2),
        above("other", Some(0.9), None, GoalPoint::Lowest, 0.2),
        above("disc", Some(0.75), None, GoalPoint::Centre, 0.02),
        above("box", Some(1.3), None, GoalPoint::Lowest, 0.1),
        above("box", Some(1.3), None, GoalPoint::Centre, 0.1),
        above("box", None, slope(false), GoalPoint::Lowest, 0.05),
        above("box", None, slope(true), GoalPoint::Centre, 0.05),
        above("jar", Some(0.9), None, GoalPoint::Lowest, 0.0),
        above("jar", Some(1.0), None, GoalPoint::Centre, 0.05),
    ]
}

fn run(scene: &Scene, engine: Engine) -> Trajectory {
    let rollout = Rollout::of(scene);
    Simulator::new(engine).run(&[rollout]).unwrap().remove(0)
}

/// The step in which a goal has held for its duration, from observations of every step.
fn reached(scene: &Scene, goal: &Goal, seen: &Trajectory) -> Option<usize> {
    let (mut held, mut failed) = (0, false);
    (1..seen.times.len()).find(|step| {
        let holds = holds(scene, goal, seen, *step);
        failed |= !holds;
        let counts = failed || !matches!(goal, Goal::Apart { after_touch: true, .. });
        held = if holds && counts { held + 1 } else { 0 };
        f64::from(held) >= (hold(goal) / scene.time_step - 1e-9).max(1.0)
    })
}

fn hold(goal: &Goal) -> f64 {
    match goal {
        Goal::Contact { hold_s, .. }
        | Goal::Apart { hold_s, .. }
        | Goal::Inside { hold_s, .. }
        | Goal::Above { hold_s, .. } => *hold_s,
    }
}

fn holds(scene: &Scene, goal: &Goal, seen: &Trajectory, step: usize) -> bool {
    let at = |name: &str| {
        let i = scene.bodies.iter().position(|b| b.name == name)?;
        Some(([seen.bodies[i].x[step], seen.bodies[i].y[step]], seen.bodies[i].angle[step]))
    };
    let placed = |name: &str| -> Solid {
        match at(name) {
            Some((position, angle)) => scene.body(name).unwrap().shape.solid().placed(position, angle),
            None => scene.statics.iter().find(|s| s.name == name).unwrap().placed(),
        }
    };
    match goal {
        Goal::Contact { bodies, tolerance, .. } => {
            placed(&bodies[0]).signed_distance(&placed(&bodies[1])) <= *tolerance
        }
        Goal::Apart { bodies, tolerance, .. } => {
            placed(&bodies[0]).signed_distance(&placed(&bodies[1])) > *tolerance
        }
        Goal::Inside { body, region, .. } => polygon_contains(region, at(body).unwrap().0),
        Goal::Above { body, height, line, point, .. } => {
            let over = |[x, y]: [f64; 2]| match (height, line) {
                (Some(height), _) => y - height,
                (_, Some([[ax, ay], [bx, by]])) => y - (ay + (x - ax) / (bx - ax) * (by - ay)),
                _ => f64::NAN,
            };
            match (point, placed(body)) {
                (GoalPoint::Centre, _) => over(at(body).unwrap().0) >= 0.0,
                (_, Solid::Bounded(ConvexPieces(pieces))) => {
                    // The lowest point of a disc is below its centre where the line is
                    // horizontal; no disc here is above a slope.
                    let low = |radius: f64, p: &[f64; 2]| over([p[0], p[1] - radius]);
                    pieces.iter().all(|c| c.points.iter().all(|p| low(c.radius, p) >= 0.0))
                }
                _ => false,
            }
        }
    }
}
