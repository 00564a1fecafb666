//! Bodies that are not discs in the batched engine, against analytic solutions.

use iplw::task::Scene;
use iplw::task::scene::{Body, Goal, Shape, Static};
use iplw::task::shape::{Compound, CompoundPiece, Disc, Halfspace, Polygon, Rectangle, SegmentShape};
use iplw::trajectory::Trajectory;
use iplw::world::{Engine, Rollout, Simulator};

const G: f64 = 9.8;

/// A block slides down a slope at g (sin - mu cos), or stays if friction holds it.
#[test]
fn block_slides_down_a_slope_by_friction() {
    for (mu, angle) in [(0.2, 0.5), (0.5, 0.7), (0.9, 0.5)] {
        let t = run(&scene(vec![on_slope(block(0.5, 0.25), angle, mu)], vec![slope(angle)], 1.0));
        let moved = f64::hypot(last(&t, 0).0 - t.bodies[0].x[0], last(&t, 0).1 - t.bodies[0].y[0]);
        let wanted = (0.5 * G * (angle.sin() - mu * angle.cos())).max(0.0);
        assert!((moved - wanted).abs() < 0.01 * wanted.max(0.1), "mu {mu}: {moved} m for {wanted} m");
    }
}

/// A block tips over if the slope is steeper than its width-to-height ratio.
#[test]
fn block_tips_if_its_centre_is_beyond_its_edge() {
    for (half_width, tips) in [(0.25, true), (0.36, false)] {
        // tan(angle) times the half height is 0.3.
        let tall = block(half_width, 0.6);
        let angle = 0.5f64.atan();
        let t = run(&scene(vec![on_slope(tall, angle, 5.0)], vec![slope(angle)], 2.0));
        let turned = (t.bodies[0].angle.last().unwrap() + angle).abs() > 0.5;
        assert_eq!(turned, tips, "half width {half_width}");
    }
}

/// Housner (1963): a block released at an angle rocks like an inverted pendulum about its corner until it is
/// flat; then it continues about the other corner with 1 - 3/2 sin^2(alpha) of its spin.
#[test]
fn block_rocks_by_housners_model() {
    let (b, h, start) = (0.2, 1.0, 0.08);
    let (radius, alpha) = (f64::hypot(b, h), f64::atan2(b, h));
    // About the corner: 4/3 m R^2 * angle'' = -m g R sin(alpha - angle).
    let (mut angle, mut spin, mut time, dt) = (start, 0.0, 0.0, 1e-5);
    while angle > 0.0 {
        spin -= 0.75 * G / radius * (alpha - angle).sin() * dt;
        angle += spin * dt;
        time += dt;
    }
    let mut own = block(b, h);
    own.friction = 10.0;
    // On its right corner, rotated clockwise by the angle.
    own.angle = -start;
    own.position = Some([-radius * (alpha - start).sin(), radius * (alpha - start).cos()]);
    let mut scene = scene(vec![own], vec![ground()], time + 0.25);
    (scene.time_step, scene.steps) = (1e-3, ((time + 0.25) * 1e3) as u32);
    let t = run(&scene);
    let at = |t_wanted: f64| (t_wanted / scene.time_step).round() as usize;
    let (before, wanted) =
        (t.bodies[0].omega[at(time - 0.01)], -spin - 0.01 * 0.75 * G / radius * alpha.sin());
    assert!((before - wanted).abs() < 0.02 * spin.abs(), "{before} rad/s for {wanted}");
    let after = t.bodies[0].omega[at(time + 0.03)];
    // From then on the other corner decelerates it.
    let wanted = -spin * (1.0 - 1.5 * alpha.sin().powi(2)) - 0.03 * 0.75 * G / radius * alpha.sin();
    assert!((after - wanted).abs() < 0.03 * wanted.abs(), "{after} rad/s for {wanted}");
}

/// Ten stacked boxes stand still; three come to rest to the last bit.
#[test]
fn stacks_are_stable() {
    for count in [3, 10] {
        let on = |i: u32| Body {
            position: Some([0.0, 0.5 + f64::from(i)]),
            name: format!("b{i}"),
            ..block(0.5, 0.5)
        };
        let t = run(&scene((0..count).map(on).collect(), vec![ground()], 60.0));
        for b in &t.bodies {
            let (early, late) = (5 * 240, b.len() - 1);
            let drift = f64::hypot(b.x[late] - b.x[early], b.y[late] - b.y[early]);
            assert!(
                drift < 1e-3 && b.angle[late].abs() < 0.02,
                "{}: {drift} m, {} rad",
                b.name,
                b.angle[late]
            );
            let now = |i: usize| [b.x[i], b.y[i], b.angle[i]].map(f64::to_bits);
            assert!(count == 10 || now(late) == now(10 * 240), "{} is not at rest", b.name);
        }
    }
}

/// A row of dominoes falls, one after the other.
#[test]
fn dominoes_fall_one_after_the_other() {
    let mut row: Vec<Body> = (0..8)
        .map(|i| Body {
            position: Some([0.5 * f64::from(i), 0.5]),
            name: format!("d{i}"),
            friction: 0.6,
            ..block(0.05, 0.5)
        })
        .collect();
    row[0].angular_velocity = -2.0;
    let t = run(&scene(row, vec![ground()], 6.0));
    let fell: Vec<usize> = t
        .bodies
        .iter()
        .map(|b| b.angle.iter().position(|a| *a < -0.5).unwrap_or_else(|| panic!("{} stands", b.name)))
        .collect();
    assert!(fell.is_sorted(), "{fell:?}");
}

/// A plank on an edge tips to the side of the larger moment.
#[test]
fn seesaw_tips_to_the_larger_moment() {
    for (arm, left_falls) in [(0.9, false), (1.1, true)] {
        let plank =
            Body { position: Some([0.0, 1.05]), name: "plank".into(), friction: 1.0, ..block(2.0, 0.05) };
        let weight = |name: &str, x: f64, mass: f64| Body {
            position: Some([x, 1.2]),
            name: name.into(),
            mass: Some(mass),
            density: None,
            ..block(0.1, 0.1)
        };
        // 2 kg at `arm` on the left against 1 kg at twice 1 m on the right, minus the widths of the
        // boxes.
        let bodies = vec![plank, weight("left", -arm, 20.0), weight("right", 1.9, 20.0 / 1.9)];
        let pivot = fixed("pivot", Polygon { vertices: vec![[-0.5, 0.0], [0.5, 0.0], [0.0, 1.0]] }.into());
        let t = run(&scene(bodies, vec![pivot], 1.0));
        let turned = *t.bodies[0].angle.last().unwrap();
        assert_eq!(turned > 0.0, left_falls, "arm {arm}: {turned} rad");
        assert!(turned.abs() > 0.03, "arm {arm}: {turned} rad");
    }
}

/// In free flight the centre of mass of an L moves on a parabola with constant spin, whatever the motion of
/// its frame's origin.
#[test]
fn compound_rotates_about_its_centre_of_mass() {
    let bar = |w: f64, h: f64, at: [f64; 2]| CompoundPiece {
        shape: Shape::Box(Rectangle { half_width: w, half_height: h }),
        position: at,
        angle: 0.0,
    };
    let shape: Shape = Compound { pieces: vec![bar(0.8, 0.2, [0.0, 0.0]), bar(0.2, 0.6, [0.6, 0.8])] }.into();
    let centre = shape.moments().centre;
    let own = Body {
        shape,
        angular_velocity: 3.0,
        inertia: None,
        velocity: [1.0, 4.0],
        position: Some([0.0, 5.0]),
        ..block(1.0, 1.0)
    };
    let t = run(&scene(vec![own.clone()], vec![], 1.0));
    let of = |x: f64, y: f64, angle: f64| {
        let (sin, cos) = angle.sin_cos();
        [x + cos * centre[0] - sin * centre[1], y + sin * centre[0] + cos * centre[1]]
    };
    let b = &t.bodies[0];
    let start = of(b.x[0], b.y[0], 0.0);
    // The centre's velocity from that of the origin.
    let v = [1.0 - 3.0 * centre[1], 4.0 + 3.0 * centre[0]];
    let at = of(last(&t, 0).0, last(&t, 0).1, *b.angle.last().unwrap());
    let wanted = [start[0] + v[0], start[1] + v[1] - 0.5 * G];
    assert!((at[0] - wanted[0]).abs() < 1e-9 && (at[1] - wanted[1]).abs() < 0.03, "{at:?} for {wanted:?}");
    assert!((b.angle.last().unwrap() - 3.0).abs() < 1e-9 && b.omega.iter().all(|w| *w == 3.0));
}

/// Bodies of any shape rebound to e^2 h.
#[test]
fn every_shape_rebounds_by_restitution() {
    let e = 0.6;
    let capsule = SegmentShape { from: [-0.4, 0.0], to: [0.4, 0.0], radius: 0.2 };
    let shapes: [(Shape, f64); 3] = [
        (Rectangle { half_width: 0.5, half_height: 0.3 }.into(), 0.3),
        (capsule.into(), 0.2),
        (Polygon { vertices: vec![[-0.5, -0.2], [0.5, -0.2], [0.0, 0.5]] }.into(), 0.2),
    ];
    for (shape, low) in shapes {
        let mut own = Body { shape: shape.clone(), position: Some([0.0, 2.0 + low]), ..block(1.0, 1.0) };
        own.restitution = e;
        let mut scene = scene(vec![own], vec![ground()], 1.25);
        (scene.time_step, scene.steps) = (1.0 / 960.0, 1200);
        let t = run(&scene);
        let landed = t.bodies[0].vy.iter().position(|v| *v > 0.0).expect("it bounces");
        let top = t.bodies[0].y[landed..].iter().copied().fold(0.0, f64::max) - low;
        assert!((top - e * e * 2.0).abs() < 0.03, "{shape:?}: {top} m");
        // Ten iterations over two points leave a small rotation: Pymunk's triangle has 0.019 rad/s.
        assert!(t.bodies[0].omega.iter().all(|w| w.abs() < 0.03), "{shape:?} turns");
    }
}

/// A goal between corners uses their true distance.
#[test]
fn goal_distance_is_exact_between_corners() {
    // Two squares, corner to corner: 0.3 m and 0.4 m apart, so 0.5 m.
    for (tolerance, holds) in [(0.499, false), (0.501, true)] {
        let mut own = block(0.5, 0.5);
        own.position = Some([0.0, 0.0]);
        let mut other = Body { name: "other".into(), ..block(0.5, 0.5) };
        other.position = Some([1.3, 1.4]);
        let mut scene = scene(vec![own, other], vec![], 0.01);
        scene.gravity = [0.0, 0.0];
        scene.goal =
            Some(Goal::Contact { bodies: ["b".into(), "other".into()], hold_s: 0.0, tolerance, stop: None });
        assert_eq!(run(&scene).solved(), holds, "{tolerance}");
    }
}

/// A fast plate does not pass a thin wall.
#[test]
fn fast_plate_does_not_tunnel() {
    let mut plate = Body { position: Some([0.0, 1.0]), velocity: [60.0, 0.0], ..block(0.05, 0.4) };
    plate.restitution = 0.3;
    let wall = fixed("wall", SegmentShape { from: [5.0, -3.0], to: [5.0, 5.0], radius: 0.0 }.into());
    let t = run(&scene(vec![plate], vec![wall], 0.5));
    assert!(t.bodies[0].x.iter().all(|x| *x < 5.2), "{:?}", last(&t, 0));
    assert!(!t.events.is_empty());
}

/// A capsule lands on its end and bounces off a wall with it, for either order of its ends; so does a box on
/// a post.
#[test]
fn segments_collide_with_their_ends() {
    let swapped = |from: [f64; 2], to: [f64; 2]| [(from, to), (to, from)];
    for (from, to) in swapped([0.0, -0.4], [0.0, 0.4]) {
        let standing = Body { position: Some([0.0, 1.5]), ..capsule(from, to) };
        for floor in [ground(), fixed("floor", block_shape(5.0, 0.5))] {
            let top = if matches!(floor.shape, Shape::Halfspace(_)) { 0.0 } else { 0.5 };
            let t = run(&scene(vec![standing.clone()], vec![floor], 0.6));
            let low = t.bodies[0].y.iter().copied().fold(f64::INFINITY, f64::min);
            assert!((low - top - 0.5).abs() < 0.1, "{from:?} to {to:?}: {low} over {top}");
        }
        let post = fixed("post", SegmentShape { from, to, radius: 0.0 }.into());
        let t = run(&scene(vec![Body { position: Some([0.0, 1.5]), ..block(0.5, 0.5) }], vec![post], 0.5));
        assert!((last(&t, 0).1 - 0.9).abs() < 0.1, "{from:?} to {to:?}: {:?}", last(&t, 0));
    }
    for (from, to) in swapped([-0.4, 0.0], [0.4, 0.0]) {
        for way in [-1.0, 1.0] {
            let mut flies = capsule(from, to);
            (flies.position, flies.velocity, flies.restitution) = (Some([0.0; 2]), [2.0 * way, 0.0], 1.0);
            let wall = Static { position: [2.0 * way, 0.0], ..fixed("wall", block_shape(0.5, 3.0)) };
            let mut scene = scene(vec![flies], vec![wall], 1.0);
            scene.gravity = [0.0; 2];
            let t = run(&scene);
            assert!((t.bodies[0].vx.last().unwrap() + 2.0 * way).abs() < 1e-6, "{from:?} to {to:?} {way}");
        }
    }
}

/// The distance of collinear cores is that of their ends.
#[test]
fn collinear_bodies_do_not_touch_at_a_distance() {
    for turn in 0..16 {
        let angle = 0.37 * f64::from(turn);
        let (sin, cos) = angle.sin_cos();
        let at = |r: f64| Some([r * cos, r * sin]);
        let own = Body { position: at(-3.0), angle, ..capsule([-0.4, 0.0], [0.4, 0.0]) };
        let others: [Body; 2] = [
            Body { angle, ..capsule([-0.4, 0.0], [0.4, 0.0]) },
            Body { shape: Disc { radius: 0.3 }.into(), ..block(1.0, 1.0) },
        ];
        for other in others {
            let other = Body { name: "other".into(), position: at(3.0), ..other };
            let mut scene = scene(vec![own.clone(), other], vec![], 0.2);
            scene.gravity = [0.0; 2];
            scene.goal = Some(Goal::Contact {
                bodies: ["b".into(), "other".into()],
                hold_s: 0.0,
                tolerance: 0.1,
                stop: None,
            });
            let t = run(&scene);
            assert!(t.events.is_empty() && !t.solved(), "turned by {angle}: {:?}", t.events);
            assert!(t.bodies.iter().all(|b| b.vx.iter().chain(&b.omega).all(|v| *v == 0.0)));
        }
    }
}

/// The choice of a body's frame does not matter: a plank along x, and one at 45 degrees rotated back.
#[test]
fn results_are_independent_of_the_body_frame() {
    let (half, slant) = (1.0, std::f64::consts::FRAC_PI_4);
    let end = half * slant.cos();
    let drawn = [
        (capsule_of([-half, 0.0], [half, 0.0], 0.03), 0.0),
        (capsule_of([-end, -end], [end, end], 0.03), -slant),
    ];
    let heights = drawn.map(|(own, angle)| {
        let own = Body { position: Some([0.0, 0.5]), angle, ..own };
        last(&run(&scene(vec![own], vec![ground()], 3.0)), 0).1
    });
    assert!((heights[0] - heights[1]).abs() < 1e-6, "{heights:?}");
}

/// Fast bodies collide with a thin static: triangles, rotated planks, a jar; they do not pass it if they move
/// at most their width in a step. No body stays suspended without support.
#[test]
fn fast_bodies_do_not_tunnel() {
    let wall = || fixed("wall", SegmentShape { from: [-5.0, 0.0], to: [5.0, 0.0], radius: 0.0 }.into());
    let piece = |w: f64, h: f64, at: [f64; 2]| CompoundPiece {
        shape: Rectangle { half_width: w, half_height: h }.into(),
        position: at,
        angle: 0.0,
    };
    let jar = Compound {
        pieces: vec![
            piece(0.5, 0.05, [0.0, 0.0]),
            piece(0.05, 0.4, [-0.45, 0.35]),
            piece(0.05, 0.4, [0.45, 0.35]),
        ],
    };
    let slant = 0.7f64.sqrt();
    let askew = capsule_of([-slant, -slant], [slant, slant], 0.03);
    let mut bodies = vec![
        (Body { angle: -std::f64::consts::FRAC_PI_4, ..askew }, 0.0, 1.0),
        (Body { shape: jar.into(), ..block(1.0, 1.0) }, 0.0, 1.0),
    ];
    for i in 0..40 {
        let (size, turn) = (0.1 + 0.01 * f64::from(i), 0.41 * f64::from(i));
        let corner = |k: u32| {
            let angle = 2.1 * f64::from(k) + 0.2;
            [size * angle.cos(), size * angle.sin()]
        };
        let shape = Polygon { vertices: (0..3).map(corner).collect() }.into();
        bodies.push((Body { shape, angle: turn, ..block(1.0, 1.0) }, 3.0, 2.0 * size));
    }
    for (i, (own, spin, width)) in bodies.into_iter().enumerate() {
        for speed in [20.0, 40.0, 80.0, 200.0] {
            let own = Body {
                position: Some([0.0, 3.0]),
                velocity: [0.0, -speed],
                angular_velocity: spin,
                restitution: 0.2,
                ..own.clone()
            };
            let t = run(&scene(vec![own], vec![wall()], 0.5));
            let b = &t.bodies[0];
            assert!(!t.events.is_empty(), "{i} at {speed}: {:?}", last(&t, 0));
            // A body may be below the wall only if it passed one of its ends.
            let passes = b.y.iter().position(|y| *y < -0.3).is_some_and(|k| b.x[k].abs() < 4.5);
            assert!(!passes || speed / 240.0 > width, "{i} at {speed}: {:?}", last(&t, 0));
            let hangs = (60..b.len()).all(|k| b.y[k] == b.y[k - 1] && b.vy[k].abs() > 0.5);
            assert!(!hangs, "{i} at {speed} hangs");
        }
    }
}

fn on_slope(own: Body, angle: f64, mu: f64) -> Body {
    let Shape::Box(Rectangle { half_height, .. }) = own.shape else { unreachable!("blocks are boxes") };
    // A tiny overlap makes the contact active from the start.
    let off = half_height - 1e-9;
    Body { position: Some([off * angle.sin(), off * angle.cos()]), angle: -angle, friction: mu, ..own }
}

/// Descends to the right.
fn slope(angle: f64) -> Static {
    fixed("slope", Halfspace { normal: [angle.sin(), angle.cos()], offset: 0.0 }.into())
}

fn ground() -> Static {
    fixed("ground", Halfspace { normal: [0.0, 1.0], offset: 0.0 }.into())
}

fn fixed(name: &str, shape: Shape) -> Static {
    Static { name: name.into(), shape, friction: 1.0, restitution: 1.0, position: [0.0; 2], angle: 0.0 }
}

fn block_shape(half_width: f64, half_height: f64) -> Shape {
    Rectangle { half_width, half_height }.into()
}

fn capsule(from: [f64; 2], to: [f64; 2]) -> Body {
    capsule_of(from, to, 0.1)
}

fn capsule_of(from: [f64; 2], to: [f64; 2], radius: f64) -> Body {
    Body { shape: SegmentShape { from, to, radius }.into(), ..block(1.0, 1.0) }
}

fn block(half_width: f64, half_height: f64) -> Body {
    Body {
        name: "b".into(),
        shape: Rectangle { half_width, half_height }.into(),
        mass: None,
        density: Some(1.0),
        friction: 0.7,
        restitution: 0.0,
        position: None,
        angle: 0.0,
        velocity: [0.0; 2],
        angular_velocity: 0.0,
        inertia: None,
    }
}

fn scene(bodies: Vec<Body>, statics: Vec<Static>, seconds: f64) -> Scene {
    Scene {
        name: "polygons".into(),
        gravity: [0.0, -G],
        bodies,
        statics,
        time_step: 1.0 / 240.0,
        steps: (seconds * 240.0).round().max(1.0) as u32,
        observe_every: 1,
        ..Scene::empty()
    }
}

fn run(scene: &Scene) -> Trajectory {
    scene.validate().unwrap();
    let rollout = Rollout::of(scene);
    Simulator::new(Engine::Lanes).run(&[rollout]).unwrap().remove(0)
}

fn last(t: &Trajectory, body: usize) -> (f64, f64) {
    let b = &t.bodies[body];
    (*b.x.last().unwrap(), *b.y.last().unwrap())
}
