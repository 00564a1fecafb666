//! Properties of the batched engine: results independent of threads, lanes and instruction set; symmetry; no
//! NaN; consistency with the general engine; agreement with Pymunk.

use iplw::task::scene::{Body, Goal, GoalPoint, Shape, Static};
use iplw::task::shape::{Compound, CompoundPiece, Disc, Halfspace, Polygon, Rectangle, SegmentShape};
use iplw::task::{Placement, Scene, families};
use iplw::trajectory::{Termination, Trajectory};
use iplw::world::{BatchSettings, Engine, Rollout, SimdLevel, Simulator, effect, select_engine};
use proptest::prelude::*;

#[test]
fn results_are_independent_of_instruction_set_threads_and_batch() {
    let scenes = mixed_scenes();
    let rollouts = rollouts(&scenes);
    let alone: Vec<Trajectory> =
        rollouts.iter().map(|r| Simulator::new(Engine::Lanes).run(&[*r]).unwrap().remove(0)).collect();
    let counted: &[SimdLevel] = &[
        #[cfg(feature = "levels")]
        SimdLevel::Counted,
    ];
    for level in SimdLevel::ALL.iter().chain(counted).copied().filter(|l| l.available()) {
        let together = Simulator::new(Engine::Lanes)
            .settings(BatchSettings { level, end_at_rest: true })
            .map(&rollouts, |_, t| t)
            .unwrap();
        same(&together, &alone, &format!("{level:?}"));
    }
    for threads in [1, 3] {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        let pooled = pool.install(|| Simulator::new(Engine::Lanes).run(&rollouts).unwrap());
        same(&pooled, &alone, &format!("{threads} threads"));
    }
    let backwards: Vec<Rollout> = rollouts.iter().rev().copied().collect();
    let mut turned = Simulator::new(Engine::Lanes).run(&backwards).unwrap();
    turned.reverse();
    same(&turned, &alone, "reversed order");
}

pub fn same(ours: &[Trajectory], wanted: &[Trajectory], what: &str) {
    assert_eq!(ours.len(), wanted.len());
    for (i, (a, b)) in ours.iter().zip(wanted).enumerate() {
        // Bits, not values: 0 and -0 differ.
        assert_eq!(bits(a), bits(b), "{what}: rollout {i} differs in its samples");
        assert_eq!(a, b, "{what}: rollout {i} differs");
    }
}

fn bits(t: &Trajectory) -> Vec<u64> {
    t.bodies
        .iter()
        .flat_map(|b| [&b.x, &b.y, &b.angle, &b.vx, &b.vy, &b.omega])
        .flatten()
        .map(|v| v.to_bits())
        .collect()
}

#[test]
fn auto_selects_lanes_up_to_its_pair_limit() {
    let mut scene = box_scene(vec![disc("a", 0.5, [0.0, 3.0], [0.0, 0.0])]);
    let engine = |scene: &Scene, engine| select_engine(engine, &rollouts(std::slice::from_ref(scene))[0]);
    assert_eq!(engine(&scene, Engine::Auto).unwrap(), Engine::Lanes);
    scene.bodies[0].shape = Shape::Box(Rectangle { half_width: 0.5, half_height: 0.5 });
    assert_eq!(engine(&scene, Engine::Auto).unwrap(), Engine::Lanes);
    assert_eq!(engine(&scene, Engine::Rapier).unwrap(), Engine::Rapier);
    // 40 bodies of six pieces have more than 20,000 pairs.
    let piece = |i: u32| CompoundPiece {
        shape: Shape::Box(Rectangle { half_width: 0.1, half_height: 0.1 }),
        position: [0.1 * f64::from(i), 0.0],
        angle: 0.0,
    };
    let row: Shape = Compound { pieces: (0..6).map(piece).collect() }.into();
    scene.bodies.extend((0..40).map(|i| Body {
        shape: row.clone(),
        ..disc(&format!("b{i}"), 0.1, [f64::from(i) - 20.0, 5.0], [0.0; 2])
    }));
    assert_eq!(engine(&scene, Engine::Auto).unwrap(), Engine::Rapier);
    assert!(engine(&scene, Engine::Lanes).is_err());
}

#[test]
fn rejects_invalid_rollouts_by_field() {
    let good = box_scene(vec![disc("a", 0.5, [0.0, 3.0], [0.0, 0.0])]);
    let mut bad = good.clone();
    bad.bodies[0].position = None;
    let scenes = [good.clone(), bad, good];
    let error = Simulator::new(Engine::Auto).run(&rollouts(&scenes)).unwrap_err();
    assert!(error.to_string().contains("bodies[0].position"), "{error}");
}

#[test]
fn map_keeps_order() {
    let scenes = mixed_scenes();
    let kept = Simulator::new(Engine::Auto).map(&rollouts(&scenes), |i, t| (i, t.bodies.len())).unwrap();
    assert!(kept.iter().enumerate().all(|(i, (k, n))| i == *k && *n == scenes[i].bodies.len()));
}

/// Both engines record the same events for a ball that drops, bounces, rolls and stops at a wall.
#[test]
fn both_engines_record_the_same_events() {
    let mut scene =
        box_scene(vec![disc("a", 0.5, [-3.0, 4.0], [2.0, 0.0]), disc("b", 0.5, [2.0, 0.5], [0.0, 0.0])]);
    scene.steps = 1200;
    let by = |engine| Simulator::new(engine).run(&rollouts(std::slice::from_ref(&scene))).unwrap().remove(0);
    let (lanes, rapier) = (by(Engine::Lanes), by(Engine::Rapier));
    assert_eq!(lanes.times, rapier.times);
    assert_eq!(lanes.events[0].between, rapier.events[0].between);
    let first = |t: &Trajectory, b: &str| {
        let event = t.events.iter().find(|e| e.between == ["a".to_string(), b.to_string()]);
        event.map(|e| (e.time, e.speed)).expect("the contact is recorded")
    };
    for other in ["floor", "b"] {
        let (ours, theirs) = (first(&lanes, other), first(&rapier, other));
        assert!((ours.0 - theirs.0).abs() < 0.05, "a meets {other}: {ours:?}, {theirs:?}");
        assert!((ours.1 - theirs.1).abs() < 0.1 * theirs.1 + 0.05, "a meets {other}: {ours:?}, {theirs:?}");
    }
    assert_eq!(lanes.collisions, rapier.collisions);
    let (ours, theirs) = (f64::from(lanes.rolling_steps), f64::from(rapier.rolling_steps));
    assert!((ours - theirs).abs() < 0.1 * theirs, "carried for {ours} steps, {theirs} steps");
}

#[test]
fn both_engines_reach_the_same_goals() {
    let mut scene = box_scene(vec![disc("a", 0.5, [0.0, 2.0], [0.0, 0.0])]);
    scene.goal = Some(Goal::Contact {
        bodies: ["a".into(), "floor".into()],
        hold_s: 1.0,
        tolerance: 0.02,
        stop: None,
    });
    let inside = Scene {
        goal: Some(Goal::Inside {
            body: "a".into(),
            region: vec![[-1.0, 0.0], [1.0, 0.0], [1.0, 1.0], [-1.0, 1.0]],
            hold_s: 0.25,
            stop: None,
        }),
        ..scene.clone()
    };
    for scene in [scene, inside] {
        let by = |engine, stop| {
            let rollout = Rollout { stop_at_goal: stop, ..rollouts(std::slice::from_ref(&scene))[0] };
            Simulator::new(engine).run(&[rollout]).unwrap().remove(0)
        };
        let (lanes, rapier) = (by(Engine::Lanes, true), by(Engine::Rapier, true));
        assert!(lanes.solved() && rapier.solved());
        assert_eq!(lanes.outcome.end, Termination::Goal);
        let (ours, theirs) = (lanes.outcome.steps, rapier.outcome.steps);
        assert!(ours.abs_diff(theirs) < 40, "solved after {ours} steps, {theirs} steps");
        let on = by(Engine::Lanes, false);
        assert!(on.solved() && on.outcome.end == Termination::Horizon && on.outcome.steps == scene.steps);
        let shared = lanes.times.len() - 1;
        assert_eq!(lanes.bodies[0].y[..shared], on.bodies[0].y[..shared]);
    }
}

/// Regression: a ball that moves farther than its radius in a step must not pass a thin table, post or wall,
/// as in Chipmunk's scheme.
#[test]
fn fast_discs_do_not_tunnel() {
    let table = |shape| Static {
        name: "table".into(),
        shape,
        friction: 1.0,
        restitution: 1.0,
        position: [0.0, 0.0],
        angle: 0.0,
    };
    let shapes = [
        Shape::Segment(SegmentShape { from: [-5.0, 0.0], to: [5.0, 0.0], radius: 0.0 }),
        Shape::Box(Rectangle { half_width: 5.0, half_height: 0.005 }),
        Shape::Disc(Disc { radius: 0.01 }),
    ];
    for shape in shapes {
        for k in 0..40 {
            let height = 0.5 + 0.01 * f64::from(k);
            let mut ball = disc("ball", 0.02, [0.0, height], [0.0, -30.0]);
            ball.restitution = 0.9;
            let mut scene = box_scene(vec![ball]);
            scene.statics = vec![table(shape.clone())];
            scene.steps = 100;
            scene.observe_every = 1;
            let t = Simulator::new(Engine::Lanes).run(&rollouts(&[scene])).unwrap().remove(0);
            let track = &t.bodies[0];
            assert!(track.y.iter().all(|y| *y > 0.0), "{shape:?} from {height} m: passed through");
            let after = track.vy.iter().copied().fold(f64::MIN, f64::max);
            assert!((25.0..28.0).contains(&after), "{shape:?} from {height} m: rebounds at {after} m/s");
        }
    }
}

/// After a stop at a wall, a fast disc that slides must not be stopped in every step.
#[test]
fn fast_discs_slide_along_walls() {
    for k in 0..20 {
        let mut ball = disc("ball", 0.1, [0.0, 2.0 + 0.013 * f64::from(k)], [18.0, -12.0]);
        (ball.friction, ball.restitution) = (0.0, 0.3);
        let mut scene = box_scene(vec![ball]);
        scene.statics.truncate(1);
        scene.statics[0].shape = Shape::Box(Rectangle { half_width: 100.0, half_height: 0.5 });
        scene.steps = 480;
        let t = Simulator::new(Engine::Lanes).run(&rollouts(&[scene])).unwrap().remove(0);
        let way = t.bodies[0].x.last().unwrap();
        // At most one step's distance is lost at the first, hard bounce.
        assert!((36.0 - 18.0 / 240.0..=36.0 + 1e-9).contains(way), "slid {way} m of 36 m");
    }
}

/// Golden trajectories made by benches/pymunk_golden.py, Pymunk at its defaults.
#[test]
fn agrees_with_pymunk() {
    let golden = [
        (include_str!("../golden/bowling.json"), 0.95),
        (include_str!("../golden/bowling_damped.json"), 0.95),
        (include_str!("../golden/basketball.json"), 0.9),
        (include_str!("../golden/basketball_damped.json"), 0.9),
        // Boxes, polygons, capsules, Ls and discs for 2 s.
        (include_str!("../golden/polygons.json"), 0.9),
    ];
    for (text, wanted) in golden {
        let golden: serde_json::Value = serde_json::from_str(text).unwrap();
        let rows = golden["rollouts"].as_array().unwrap();
        let agreeing = rows.iter().filter(|row| worst_distance_to(row) < 0.01).count();
        let share = agreeing as f64 / rows.len() as f64;
        assert!(share >= wanted, "{agreeing} of {} within 1 cm", rows.len());
    }
}

/// Largest distance of any body from its golden position, at all golden times, m.
fn worst_distance_to(row: &serde_json::Value) -> f64 {
    let mut scene = Scene::from_json(&row["scene"].to_string()).unwrap();
    scene.observe_every = 1;
    let t = Simulator::new(Engine::Lanes).run(&rollouts(&[scene])).unwrap().remove(0);
    let positions: Vec<Vec<[f64; 2]>> = serde_json::from_value(row["positions"].clone()).unwrap();
    let steps: Vec<usize> = serde_json::from_value(row["steps"].clone()).unwrap();
    let mut worst = 0.0f64;
    for (step, places) in steps.into_iter().zip(positions) {
        for (body, [x, y]) in t.bodies.iter().zip(places) {
            worst = worst.max((body.x[step] - x).hypot(body.y[step] - y));
        }
    }
    worst
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 40, ..ProptestConfig::default() })]

    #[test]
    fn mirrored_scenes_give_mirrored_trajectories(scene in disc_scenes()) {
        let mirrored = mirror(&scene);
        let pair = [scene, mirrored];
        let out = Simulator::new(Engine::Lanes).run(&rollouts(&pair)).unwrap();
        for (a, b) in out[0].bodies.iter().zip(&out[1].bodies) {
            // Rounding differs (polygons are reversed), and collisions amplify it: only the first
            // second is compared.
            for i in 0..a.len().min(5) {
                prop_assert!((a.x[i] + b.x[i]).abs() < 1e-6 && (a.y[i] - b.y[i]).abs() < 1e-6);
                prop_assert!((a.omega[i] + b.omega[i]).abs() < 1e-6);
            }
        }
    }

    #[test]
    fn valid_scenes_stay_finite_and_complete(scene in disc_scenes()) {
        let t = Simulator::new(Engine::Lanes).run(&rollouts(std::slice::from_ref(&scene))).unwrap().remove(0);
        prop_assert_eq!(t.outcome.end, Termination::Horizon);
        prop_assert_eq!(t.times.len(), 1 + scene.steps.div_ceil(scene.observe_every) as usize);
        for b in &t.bodies {
            let all = [&b.x, &b.y, &b.angle, &b.vx, &b.vy, &b.omega];
            prop_assert!(all.iter().all(|c| c.len() == t.times.len() && c.iter().all(|v| v.is_finite())));
        }
    }

    #[test]
    fn results_are_independent_of_order(scenes in prop::collection::vec(disc_scenes(), 3..20), turn in 1usize..19) {
        let straight = Simulator::new(Engine::Lanes).run(&rollouts(&scenes)).unwrap();
        let mut turned = scenes.clone();
        let turn = turn % scenes.len();
        turned.rotate_left(turn);
        let mut out = Simulator::new(Engine::Lanes).run(&rollouts(&turned)).unwrap();
        out.rotate_right(turn);
        prop_assert_eq!(straight, out);
    }
}

fn rollouts(scenes: &[Scene]) -> Vec<Rollout<'_>> {
    scenes.iter().map(Rollout::of).collect()
}

/// Scenes of every family and others, damped and not, some with goals reached early.
pub fn mixed_scenes() -> Vec<Scene> {
    let mut scenes = Vec::new();
    for family in families() {
        for (i, scene) in family.candidates(0).enumerate().take(40) {
            let space = scene.action.as_ref().unwrap();
            if let Placement::Valid(mut placed) =
                space.place(&scene, &space.at(i * 4099 % space.count()).unwrap())
            {
                placed.steps = 900 + 37 * (i as u32 % 5);
                placed.damping = (i % 3 == 0).then_some(0.8);
                placed.effects =
                    if i % 3 == 1 { vec![effect::damping(0.5 + 0.01 * i as f64)] } else { vec![] };
                scenes.push(*placed);
            }
        }
    }
    scenes.push(box_scene(vec![disc("a", 0.5, [0.0, 3.0], [1.0, 0.0])]));
    scenes.extend((0..24).map(tumbling));
    scenes
}

/// Boxes, a triangle, a capsule, an L and a disc in a box, with different numbers in each scene.
fn tumbling(i: u32) -> Scene {
    let share = |k: u32| f64::from((i * 7 + k * 13) % 24) / 24.0;
    let bar = |w: f64, h: f64, position: [f64; 2]| CompoundPiece {
        shape: Shape::Box(Rectangle { half_width: w, half_height: h }),
        position,
        angle: 0.0,
    };
    let shapes: [Shape; 5] = [
        Rectangle { half_width: 0.4, half_height: 0.3 }.into(),
        Polygon { vertices: vec![[-0.5, -0.3], [0.5, -0.2], [0.0, 0.5]] }.into(),
        SegmentShape { from: [-0.4, 0.0], to: [0.4, 0.1], radius: 0.15 }.into(),
        Compound { pieces: vec![bar(0.5, 0.15, [0.0, 0.0]), bar(0.15, 0.4, [0.35, 0.4])] }.into(),
        Disc { radius: 0.35 }.into(),
    ];
    let bodies = shapes.into_iter().enumerate().map(|(k, shape)| {
        let (k, at) = (k as u32, k as f64);
        let mut body =
            disc(&format!("b{k}"), 0.1, [-4.0 + 2.0 * at, 2.0 + share(k)], [share(k + 5) * 4.0 - 2.0, 1.0]);
        (body.shape, body.angle, body.angular_velocity) =
            (shape, share(k + 1) * 3.0, share(k + 2) * 6.0 - 3.0);
        body.friction = 0.2 + 0.6 * share(k + 3);
        body
    });
    let mut scene = box_scene(bodies.collect());
    scene.steps = 700 + 31 * (i % 4);
    scene.effects = if i.is_multiple_of(2) { vec![effect::damping(0.7)] } else { vec![] };
    let bodies = [["b0", "b1"], ["b3", "floor"], ["b2", "b4"]][i as usize % 3].map(String::from);
    let (hold_s, tolerance, stop) = (0.1, 0.05, None);
    scene.goal = Some(match i % 5 {
        3 => Goal::Apart { bodies, after_touch: i.is_multiple_of(2), hold_s, tolerance, stop },
        4 => {
            let [body, _] = bodies;
            let line = Some([[-4.0, 2.0 + 0.1 * f64::from(i % 7)], [4.0, 2.5]]);
            Goal::Above { body, height: None, line, point: GoalPoint::Lowest, hold_s, stop }
        }
        _ => Goal::Contact { bodies, hold_s, tolerance, stop },
    });
    scene
}

pub fn box_scene(bodies: Vec<Body>) -> Scene {
    let wall = |name: &str, x: f64, y: f64, half_width: f64, half_height: f64| Static {
        name: name.into(),
        shape: Shape::Box(Rectangle { half_width, half_height }),
        friction: 0.8,
        restitution: 0.8,
        position: [x, y],
        angle: 0.0,
    };
    Scene {
        name: "box".into(),
        bodies,
        statics: vec![
            wall("floor", 0.0, -0.5, 7.0, 0.5),
            wall("left", -6.5, 5.0, 0.5, 5.5),
            wall("right", 6.5, 5.0, 0.5, 5.5),
        ],
        steps: 1000,
        ..Scene::empty()
    }
}

pub fn disc(name: &str, radius: f64, position: [f64; 2], velocity: [f64; 2]) -> Body {
    Body {
        name: name.into(),
        shape: Shape::Disc(Disc { radius }),
        mass: None,
        density: Some(1.0),
        friction: 0.5,
        restitution: 0.5,
        position: Some(position),
        angle: 0.0,
        velocity,
        angular_velocity: 0.0,
        inertia: None,
    }
}

prop_compose! {
    /// Three discs in a box with a turned polygon, a segment, a post and a sloping half plane.
    pub fn disc_scenes()(
        radii in prop::array::uniform3(0.05f64..0.8),
        velocities in prop::array::uniform6(-15.0f64..15.0),
        heights in prop::array::uniform3(2.5f64..8.0),
        spins in prop::array::uniform3(-20.0f64..20.0),
        surfaces in prop::array::uniform2(0.0f64..1.0),
        density in 0.05f64..20.0,
        angle in -1.5f64..1.5,
        damping in 0.3f64..1.0,
    ) -> Scene {
        let bodies = (0..3).map(|i| {
            let mut body = disc(
                &format!("b{i}"),
                radii[i],
                [-4.0 + 3.9 * i as f64, heights[i]],
                [velocities[2 * i], velocities[2 * i + 1]],
            );
            body.angular_velocity = spins[i];
            (body.friction, body.restitution) = (surfaces[0], surfaces[1]);
            body.density = Some(density);
            body
        });
        let mut scene = box_scene(bodies.collect());
        let fixed = |name: &str, shape, position, angle| Static {
            name: name.into(), shape, position, angle, friction: 0.9, restitution: 0.7,
        };
        let triangle = Shape::Polygon(Polygon { vertices: vec![[-0.5, -0.3], [0.6, -0.2], [0.1, 0.5]] });
        scene.statics.push(fixed("triangle", triangle, [-2.0, 0.8], angle));
        let bar = Shape::Segment(SegmentShape { from: [-0.7, 0.0], to: [0.7, 0.1], radius: 0.05 });
        scene.statics.push(fixed("bar", bar, [0.7, 1.1], -angle / 3.0));
        scene.statics.push(fixed("post", Shape::Disc(Disc { radius: 0.3 }), [3.0, 0.7], 0.0));
        let slope = Shape::Halfspace(Halfspace { normal: [-0.6, 0.8], offset: -3.0 });
        scene.statics.push(fixed("slope", slope, [0.0, 0.0], 0.0));
        scene.damping = Some(damping);
        scene
    }
}

/// The scene mirrored at the y axis.
fn mirror(scene: &Scene) -> Scene {
    let flip = |p: [f64; 2]| [-p[0], p[1]];
    let mut out = scene.clone();
    for b in &mut out.bodies {
        b.position = b.position.map(flip);
        b.velocity = flip(b.velocity);
        b.angular_velocity = -b.angular_velocity;
    }
    for s in &mut out.statics {
        s.position = flip(s.position);
        s.angle = -s.angle;
        match &mut s.shape {
            Shape::Polygon(Polygon { vertices }) => {
                *vertices = vertices.iter().rev().map(|p| flip(*p)).collect();
            }
            Shape::Segment(SegmentShape { from, to, .. }) => (*from, *to) = (flip(*from), flip(*to)),
            Shape::Halfspace(Halfspace { normal, .. }) => *normal = flip(*normal),
            symmetric => assert!(matches!(symmetric, Shape::Disc(_) | Shape::Box(_)), "{symmetric:?}"),
        }
    }
    out
}
