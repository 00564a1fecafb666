//! Properties of both engines for random scenes: valid scenes of any size stay finite; the order of bodies
//! and statics does not matter where contacts are isolated.

use crate::fuzz_one::{Fate, check_scene};
use iplw::rng::stream;
use iplw::task::scene::{Body, Goal, Shape, Static};
use iplw::task::shape::{Disc, Halfspace, Polygon, Rectangle, SegmentShape};
use iplw::task::{Placement, Scene, family};
use iplw::trajectory::{Track, Trajectory};
use iplw::world::{Engine, Rollout, Simulator};
use proptest::prelude::*;
use rand::RngExt;
use rand::seq::SliceRandom;

const ENGINES: [Engine; 2] = [Engine::Lanes, Engine::Rapier];
/// Distance, m, between the final positions of two bodies that collide in rapier, 2 s later, for both orders
/// of the bodies, if they collide in the same time step. Rapier's positions are f32, so it grows with the
/// distance from the origin: the largest of 24,000 pairs each were 0.36 mm near the origin, 7 mm at 60 m and
/// 51 mm at 420 m.
const SWAPPED_TOLERANCE_M: f64 = 0.1;
/// The same near the origin.
const SWAPPED_TOLERANCE_NEAR_ORIGIN_M: f64 = 1e-3;

proptest! {
    #![proptest_config(ProptestConfig { cases: 300, ..ProptestConfig::default() })]

    /// Sizes from a micrometre to the largest valid one, masses, speeds, time steps and coefficients
    /// likewise: no NaN, no panic, and an implausible rollout ends as diverged.
    #[test]
    fn valid_scenes_give_finite_numbers(scene in any_scene()) {
        prop_assert!(scene.validate().is_ok(), "{}", scene.validate().unwrap_err());
        prop_assert_eq!(check_scene(&scene, 100), Fate::Simulated);
    }

    /// Objects collide in isolated pairs, several pairs at once. The order of the objects is the order in
    /// which contacts are visited, which matters only within a cluster of contacts; the remaining
    /// differences, the sign of normals and the order of two terms of a sum, change no bit. Rapier
    /// transforms the second of two bodies to the frame of the first in f32, so the order changes the
    /// last bits: see [`SWAPPED_TOLERANCE_M`]. Of 24,000 pairs at 420 m nine collided one time step later
    /// in one of the orders; their normals then differ, and 2 s later they are decimetres apart. This is
    /// inherent to the time step.
    #[test]
    fn order_does_not_matter_for_isolated_contacts(scene in islands(), seed in 0u64..1000) {
        for engine in ENGINES {
            let straight = run(&scene, engine);
            let turned = in_order_of(&scene, run(&shuffled(&scene, seed), engine));
            prop_assume!(!straight.events.is_empty());
            let mut all_met_alike = true;
            for (a, b) in straight.bodies.iter().zip(&turned.bodies) {
                let partner = scene.bodies.iter().any(|o| o.name[1..] == a.name[1..] && o.name != a.name);
                if !(engine == Engine::Rapier && partner) {
                    prop_assert_eq!(a, b, "{:?}", engine);
                    continue;
                }
                let (met, met_turned) = (contact_times(&straight, &a.name), contact_times(&turned, &a.name));
                all_met_alike &= met == met_turned;
                let late = met.len() == met_turned.len() && met != met_turned;
                let apart = met.iter().zip(&met_turned).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
                prop_assert!(apart < 1.5 * scene.time_step, "{} meets its partner {} s apart", a.name, apart);
                prop_assert!(late || max_distance(a, b) < SWAPPED_TOLERANCE_M, "{} is {} m off", a.name, max_distance(a, b));
            }
            if all_met_alike {
                prop_assert_eq!(straight.rolling_steps, turned.rolling_steps);
                prop_assert_eq!(straight.collisions, turned.collisions);
            }
        }
    }
}

/// Near the origin f32 is accurate enough: rapier's pairs collide in the same step and move alike, in either
/// order.
#[test]
fn order_does_not_matter_for_pairs_near_the_origin() {
    let mut draw = stream(7, "pairs");
    let pairs: Vec<Scene> = (0..1000)
        .map(|_| {
            let u: [f64; 8] = std::array::from_fn(|_| 2.0 * draw.random::<f64>() - 1.0);
            let mut scene = Scene { steps: 480, observe_every: 5, ..Scene::empty() };
            scene.bodies = [slow_disc("b0", 0.0, u), fast_disc("o0", 0.0, u)].into();
            scene
        })
        .collect();
    let other: Vec<Scene> = pairs
        .iter()
        .map(|s| {
            let bodies = s.bodies.iter().rev().cloned().collect();
            Scene { bodies, ..s.clone() }
        })
        .collect();
    let of = |scenes: &[Scene]| Simulator::new(Engine::Rapier).run(&rollouts(scenes)).unwrap();
    let mut met = 0;
    for ((scene, straight), turned) in pairs.iter().zip(of(&pairs)).zip(of(&other)) {
        let turned = in_order_of(scene, turned);
        assert_eq!(times(&straight), times(&turned));
        met += usize::from(!straight.events.is_empty());
        for (a, b) in straight.bodies.iter().zip(&turned.bodies) {
            assert!(
                max_distance(a, b) < SWAPPED_TOLERANCE_NEAR_ORIGIN_M,
                "{} is {} m off",
                a.name,
                max_distance(a, b)
            );
        }
    }
    assert!(met >= 500, "{met} pairs met");
}

/// Within clusters the result depends on the order of iterations, but no order is better: bowling scenes in
/// another order are solved as often, and few outcomes change.
#[test]
fn order_keeps_statistics_of_bowling() {
    let scenes = bowling(250);
    let other: Vec<Scene> = (0..).zip(&scenes).map(|(i, s)| shuffled(s, i)).collect();
    for engine in ENGINES {
        let solved = |scenes: &[Scene]| -> Vec<bool> {
            Simulator::new(engine).run(&rollouts(scenes)).unwrap().iter().map(Trajectory::solved).collect()
        };
        let (straight, turned) = (solved(&scenes), solved(&other));
        let count = |solved: &[bool]| solved.iter().filter(|s| **s).count();
        let differ = straight.iter().zip(&turned).filter(|(a, b)| a != b).count();
        println!("{engine:?}: {} and {} solved, {differ} differ", count(&straight), count(&turned));
        assert!(count(&straight) >= 10, "{engine:?}: too few solved to compare");
        // In lanes only clusters depend on the order; in rapier the last bits of every collision of
        // two balls do, and rolling and wall contacts amplify them.
        let most = if engine == Engine::Lanes { 2 } else { 10 };
        assert!(differ <= most, "{engine:?}: {differ} of {} fare differently", scenes.len());
    }
}

/// Largest distance between two tracks of a body, m.
fn max_distance(a: &Track, b: &Track) -> f64 {
    (0..a.len()).map(|i| (a.x[i] - b.x[i]).hypot(a.y[i] - b.y[i])).fold(0.0, f64::max)
}

/// Times at which the body's contacts begin, s.
fn contact_times(t: &Trajectory, name: &str) -> Vec<f64> {
    t.events.iter().filter(|e| e.between.iter().any(|n| n == name)).map(|e| e.time).collect()
}

/// Times at which any contact begins, s.
fn times(t: &Trajectory) -> Vec<f64> {
    t.events.iter().map(|e| e.time).collect()
}

/// The scene with bodies and statics in random order.
fn shuffled(scene: &Scene, seed: u64) -> Scene {
    let mut draw = stream(seed, "order");
    let mut out = scene.clone();
    out.bodies.shuffle(&mut draw);
    out.statics.shuffle(&mut draw);
    out
}

/// The trajectory with tracks in the order of the scene's bodies.
fn in_order_of(scene: &Scene, mut t: Trajectory) -> Trajectory {
    t.bodies.sort_by_key(|track| scene.bodies.iter().position(|b| b.name == track.name));
    t
}

fn bowling(count: usize) -> Vec<Scene> {
    let scenes = family("bowling").unwrap().candidates(0);
    let placed = (0..).zip(scenes).filter_map(|(i, scene)| {
        let space = scene.action.as_ref()?;
        match space.place(&scene, &space.at(i * 7919 % space.count()).ok()?) {
            Placement::Valid(placed) => Some(*placed),
            Placement::Invalid(_) => None,
        }
    });
    placed.take(count).collect()
}

fn run(scene: &Scene, engine: Engine) -> Trajectory {
    Simulator::new(engine).run(&rollouts(std::slice::from_ref(scene))).expect("it simulates").remove(0)
}

fn rollouts(scenes: &[Scene]) -> Vec<Rollout<'_>> {
    scenes.iter().map(Rollout::of).collect()
}

prop_compose! {
    /// Three to eight distant positions, at each of which one disc collides with one object: a disc, or a
    /// static of any kind.
    pub fn islands()(
        meetings in prop::collection::vec(
            (0usize..5, prop::array::uniform8(-1.0f64..1.0)), 3..8),
    ) -> Scene {
        let mut scene = Scene { steps: 480, observe_every: 5, ..Scene::empty() };
        for (i, (kind, u)) in meetings.into_iter().enumerate() {
            let x = 60.0 * i as f64;
            let own = slow_disc(&format!("b{i}"), x, u);
            let post = Shape::Disc(Disc { radius: 0.3 });
            let shape = match kind {
                0 => {
                    scene.bodies.push(fast_disc(&format!("o{i}"), x, u));
                    post.clone()
                }
                1 => Shape::Box(Rectangle { half_width: 20.0, half_height: 0.5 }),
                2 => Shape::Segment(SegmentShape { from: [-20.0, 0.2 * u[7]], to: [20.0, 0.0], radius: 0.1 }),
                3 => Shape::Polygon(Polygon { vertices: vec![[-20.0, -1.0], [20.0, -1.0], [0.0, u[7].abs()]] }),
                _ => post.clone(),
            };
            // A colliding pair has no static within reach.
            let depth = if kind == 0 { -500.0 } else { 0.0 };
            scene.bodies.push(own);
            scene.statics.push(Static {
                name: format!("s{i}"), shape, friction: 0.8, restitution: 0.9, position: [x, depth], angle: 0.0,
            });
        }
        scene
    }
}

prop_compose! {
    /// Up to 12 bodies and 12 statics of any shape, sizes over eleven orders of magnitude, without
    /// overlaps.
    pub fn any_scene()(
        bodies in prop::collection::vec((any_shape(), any_state()), 1..12),
        statics in prop::collection::vec((any_shape(), any_state(), any::<bool>()), 0..12),
        // Half the scenes have one size, so that objects collide; half mix all sizes.
        size in prop::option::of(log(-5.0, 3.0)),
        gap in log(-8.0, 0.5),
        gravity in prop::array::uniform2(prop_oneof![Just(0.0), -1e4f64..1e4, -10.0f64..10.0]),
        time_step in prop_oneof![Just(1e-6), Just(0.1), log(-6.0, -1.0)],
        damping in prop::option::of(log(-20.0, 0.0)),
        hold in prop::option::of(0.0f64..1e-4),
    ) -> Scene {
        let mut scene = Scene {
            gravity, time_step, steps: 100, observe_every: 3, damping, ..Scene::empty()
        };
        let sized = |(shape, extent): (Shape, f64)| {
            let (shape, scale) = match size {
                Some(size) => (scaled(&shape, size / extent), size),
                None => (shape, extent),
            };
            (shape, scale)
        };
        let mut x = 0.0;
        for (i, (shape, state)) in bodies.into_iter().enumerate() {
            let (shape, extent) = sized(shape);
            let mut body = disc(&format!("b{i}"), 1.0, [x + 2.0 * extent, 0.0], state.velocity);
            x += 4.0 * extent * (1.0 + gap);
            body.shape = shape;
            (body.mass, body.density) = (state.mass, state.density);
            (body.friction, body.restitution) = (state.friction, state.restitution);
            (body.angle, body.angular_velocity) = (state.angle, state.spin);
            scene.bodies.push(body);
        }
        for (i, (shape, state, below)) in statics.into_iter().enumerate() {
            let (shape, extent) = sized(shape);
            let at = scene.bodies[i % scene.bodies.len()].position.unwrap_or_default();
            let side = if below { -1.0 } else { 1.0 };
            let fixed = Static {
                name: format!("s{i}"), shape, friction: state.friction, restitution: state.restitution,
                position: [at[0], side * 4.0 * extent], angle: state.angle,
            };
            scene.statics.push(fixed);
            // Statics that overlap a body or are out of range are dropped.
            if scene.validate().is_err() {
                scene.statics.pop();
            }
        }
        let normal = [0.6, 0.8];
        scene.statics.push(Static {
            name: "slope".into(), shape: Shape::Halfspace(Halfspace { normal, offset: -1.0 }), friction: 100.0,
            restitution: 1.0, position: [0.0, 0.0], angle: 0.0,
        });
        if scene.validate().is_err() {
            scene.statics.pop();
        }
        while scene.validate().is_err() && scene.bodies.len() > 1 {
            scene.bodies.pop();
        }
        if let (Some(hold), true) = (hold, scene.bodies.len() > 1) {
            let bodies = [scene.bodies[0].name.clone(), scene.bodies[1].name.clone()];
            scene.goal = Some(Goal::Contact {
                bodies, hold_s: hold.min(100.0 * time_step), tolerance: 0.0, stop: Some(false),
            });
        }
        scene
    }
}

/// A shape and its largest extent from its origin, m.
fn any_shape() -> impl Strategy<Value = (Shape, f64)> {
    let ratio = || prop_oneof![Just(1.0), log(-3.0, 0.0)];
    prop_oneof![
        // Discs are more frequent, because only some of the code paths accept scenes of discs alone.
        4 => log(-6.0, 4.0).prop_map(|radius| (Shape::Disc(Disc { radius }), radius)),
        1 => (log(-3.0, 4.0), ratio()).prop_map(|(w, r)| {
            (Shape::Box(Rectangle { half_width: w, half_height: w * r }), 1.5 * w)
        }),
        1 => (log(-3.0, 4.0), ratio()).prop_map(|(w, r)| {
            let radius = (w * r).max(1e-6);
            (Shape::Segment(SegmentShape { from: [-w, 0.0], to: [w, 0.3 * w], radius }), 2.5 * w)
        }),
        1 => (log(-3.0, 4.0), 3usize..32, ratio()).prop_map(|(w, n, r)| {
            let corner = |k: usize| {
                let (sin, cos) = (std::f64::consts::TAU * k as f64 / n as f64).sin_cos();
                [w * cos, w * r.max(0.03) * sin]
            };
            (Shape::Polygon(Polygon { vertices: (0..n).map(corner).collect() }), w)
        }),
    ]
}

/// The shape scaled by `by`, with lengths at least the smallest valid one.
fn scaled(shape: &Shape, by: f64) -> Shape {
    let length = |v: f64| (v * by).max(1e-6);
    let point = |p: &[f64; 2]| [p[0] * by, p[1] * by];
    match shape {
        Shape::Disc(Disc { radius }) => Shape::Disc(Disc { radius: length(*radius) }),
        Shape::Box(Rectangle { half_width, half_height }) => {
            Shape::Box(Rectangle { half_width: length(*half_width), half_height: length(*half_height) })
        }
        Shape::Segment(SegmentShape { from, to, radius }) => {
            Shape::Segment(SegmentShape { from: point(from), to: point(to), radius: length(*radius) })
        }
        // Polygons below a millimetre may have triangles of invalid area.
        Shape::Polygon(Polygon { vertices }) => {
            let extent = vertices.iter().map(|v| v[0]).fold(0.0, f64::max);
            match extent * by < 1e-3 {
                true => Shape::Disc(Disc { radius: length(extent) }),
                false => Shape::Polygon(Polygon { vertices: vertices.iter().map(point).collect() }),
            }
        }
        other => other.clone(),
    }
}

/// Initial state and material of a body.
#[derive(Clone, Debug)]
struct BodyParameters {
    mass: Option<f64>,
    density: Option<f64>,
    friction: f64,
    restitution: f64,
    velocity: [f64; 2],
    spin: f64,
    angle: f64,
}

prop_compose! {
    fn any_state()(
        by_mass in any::<bool>(),
        mass in prop_oneof![Just(1e-12), Just(1e9), log(-12.0, 9.0)],
        density in prop_oneof![Just(1e-6), Just(1e9), log(-6.0, 9.0)],
        friction in prop_oneof![Just(0.0), Just(100.0), 0.0f64..2.0],
        restitution in prop_oneof![Just(0.0), Just(1.0), 0.0f64..1.0],
        velocity in prop::array::uniform2(prop_oneof![Just(0.0), -400.0f64..400.0, -3.0f64..3.0]),
        spin in prop_oneof![Just(0.0), -1e4f64..1e4],
        angle in prop_oneof![Just(0.0), -1e6f64..1e6, -4.0f64..4.0],
    ) -> BodyParameters {
        let (mass, density) = if by_mass { (Some(mass), None) } else { (None, Some(density)) };
        BodyParameters { mass, density, friction, restitution, velocity, spin, angle }
    }
}

/// Log-uniform.
fn log(low: f64, high: f64) -> impl Strategy<Value = f64> {
    (low..high).prop_map(|e| 10f64.powf(e))
}

/// A disc at about (x, 2) m; `u` in [-1, 1] parametrises it.
fn slow_disc(name: &str, x: f64, u: [f64; 8]) -> Body {
    let mut own = disc(name, 0.5 + 0.2 * u[0], [x, 2.0 + 0.5 * u[1]], [2.0 * u[2], 2.0 * u[3]]);
    own.angular_velocity = 5.0 * u[4];
    (own.friction, own.restitution) = (0.5 + 0.5 * u[5], 0.5 + 0.5 * u[6]);
    own
}

/// A disc thrown at the object at x while both fall.
fn fast_disc(name: &str, x: f64, u: [f64; 8]) -> Body {
    let mut other = disc(name, 0.4, [x + 3.0, 2.0], [-6.0, 0.5 * u[7]]);
    other.density = Some(2.0);
    other
}

fn disc(name: &str, radius: f64, position: [f64; 2], velocity: [f64; 2]) -> Body {
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
