//! Mechanisms against analytic solutions, textbook equations integrated at high order, and invariants.

use std::f64::consts::PI;

use iplw::task::Scene;
use iplw::task::scene::Inertia;
use iplw::world::mechanism::{Commands, JointMotion, JointRollout, Tree, scene_terms, simulate};
use serde_json::{Value, json};

/// A scene with joints.
pub fn scene(bodies: Value, joints: Value, motors: Value) -> Scene {
    let scene = json!({
        "format": "iplw.scene/2", "gravity": [0.0, -9.81], "time_step": 0.001,
        "bodies": bodies, "joints": joints, "motors": motors,
    });
    Scene::from_json(&scene.to_string()).unwrap()
}

/// A rod of length 1 m and mass 1 kg that hangs on the origin.
fn pendulum(position: f64, effects: Value) -> Scene {
    scene(
        json!([rod("rod", -0.5)]),
        json!([{"name": "hinge", "kind": "revolute", "body": "rod", "anchor": [0.0, 0.0], "position": position, "effects": effects}]),
        json!([{"joint": "hinge", "control": "torque", "max_torque": 5.0}]),
    )
}

fn rod(name: &str, y: f64) -> Value {
    json!({"name": name, "shape": {"type": "box", "half_width": 0.02, "half_height": 0.5}, "mass": 1.0, "inertia": 1.0 / 12.0, "position": [0.0, y]})
}

/// Two point-like discs on rods without mass: the textbook's double pendulum, lengths 1 m, masses 1 kg.
fn double_pendulum(angles: [f64; 2]) -> Scene {
    let bob = |name: &str, y: f64| json!({"name": name, "shape": {"type": "disc", "radius": 0.01}, "mass": 1.0, "inertia": 1e-12, "position": [0.0, y]});
    scene(
        json!([bob("upper", -1.0), bob("lower", -2.0)]),
        json!([
            {"name": "shoulder", "kind": "revolute", "body": "upper", "anchor": [0.0, 0.0], "position": angles[0]},
            {"name": "elbow", "kind": "revolute", "body": "lower", "parent": "upper", "anchor": [0.0, -1.0], "position": angles[1] - angles[0]},
        ]),
        json!([]),
    )
}

fn cart_pole(position: f64) -> Scene {
    let cart = json!({"name": "cart", "shape": {"type": "box", "half_width": 0.2, "half_height": 0.1}, "mass": 2.0, "position": [0.0, 0.0]});
    let pole = json!({"name": "pole", "shape": {"type": "disc", "radius": 0.05}, "mass": 0.3, "inertia": 1e-12, "position": [0.0, -0.6]});
    scene(
        json!([cart, pole]),
        json!([
            {"name": "hinge", "kind": "revolute", "body": "pole", "parent": "cart", "anchor": [0.0, 0.0], "position": position},
            {"name": "slide", "kind": "prismatic", "body": "cart", "anchor": [0.0, 0.0], "axis": [2.0, 0.0]},
        ]),
        json!([{"joint": "slide", "control": "torque"}]),
    )
}

fn run(scene: &Scene, commands: &Commands, times: &[f64]) -> JointMotion {
    let tree = Tree::of(scene).unwrap();
    let rollout = JointRollout {
        terms: scene_terms(scene, &tree).unwrap(),
        position: tree.position.clone(),
        velocity: tree.velocity.clone(),
        tree: &tree,
        start: 0.0,
        commands,
        times,
        field: None,
    };
    simulate(&[rollout]).remove(0)
}

/// Time of the first change of sign of a joint's position, twice that is half a period from rest.
fn quarter_period(motion: &JointMotion, times: &[f64]) -> f64 {
    let q = &motion.positions[0];
    let k = (1..q.len()).find(|k| q[*k] <= 0.0).unwrap();
    times[k - 1] + (times[k] - times[k - 1]) * q[k - 1] / (q[k - 1] - q[k])
}

/// T = 2 pi sqrt(2 L / 3 g) / agm(1, cos(q / 2)) for a rod.
#[test]
fn pendulum_has_the_analytic_period() {
    let times: Vec<f64> = (0..2000).map(|i| 1e-3 * f64::from(i)).collect();
    for amplitude in [0.05, 1.0, 2.5] {
        let motion = run(&pendulum(amplitude, json!([])), &Commands::default(), &times);
        let (mut a, mut g) = (1.0, (0.5f64 * amplitude).cos());
        for _ in 0..8 {
            (a, g) = (0.5 * (a + g), (a * g).sqrt());
        }
        let period = 2.0 * PI * (2.0 / (3.0 * 9.81f64)).sqrt() / a;
        let found = 4.0 * quarter_period(&motion, &times);
        assert!((found / period - 1.0).abs() < 1e-6, "amplitude {amplitude}: {found} s for {period} s");
    }
}

/// Viscous friction of a horizontal joint: v(t) = v0 exp(-b t / I).
#[test]
fn viscous_friction_decays_exponentially() {
    let mut scene = pendulum(0.0, json!([{"name": "viscous_friction", "parameters": {"b": 0.5}}]));
    scene.gravity = [0.0, 0.0];
    scene.joints[0].velocity = 2.0;
    let times = [0.0, 0.5, 1.0];
    let motion = run(&scene, &Commands::default(), &times);
    for (t, v) in times.iter().zip(&motion.velocities[0]) {
        let expected = 2.0 * (-0.5 * t * 3.0f64).exp();
        assert!((v - expected).abs() < 1e-9, "{v:?} for {expected} at {t} s");
    }
}

/// A constant torque turns a free rod by tau t^2 / 2 I; a delayed one later; a limited one less.
#[test]
fn commands_act_exactly() {
    let commands = Commands::new(vec![0.0, 0.3], vec![vec![2.0, 0.0]]);
    let angle = |effects: Value| {
        let mut scene = pendulum(0.0, effects);
        scene.gravity = [0.0, 0.0];
        run(&scene, &commands, &[0.4]).positions[0][0]
    };
    let turned = |torque: f64, from: f64, to: f64| {
        let v = 3.0 * torque * (to - from);
        0.5 * v * (to - from) + v * (0.4 - to)
    };
    let close = |a: f64, b: f64| assert!((a - b).abs() < 1e-9, "{a} for {b}");
    close(angle(json!([])), turned(2.0, 0.0, 0.3));
    close(angle(json!([{"name": "motor_gain", "parameters": {"s": 0.5}}])), turned(1.0, 0.0, 0.3));
    close(angle(json!([{"name": "torque_saturation", "parameters": {"s": 0.3}}])), turned(1.5, 0.0, 0.3));
    // Before its first time stamp a command has its first value.
    close(angle(json!([{"name": "command_delay", "parameters": {"delay": 0.05}}])), turned(2.0, 0.0, 0.35));
}

/// The accelerations of the textbook's double pendulum, angles from the vertical.
fn double_pendulum_rates([a, b, va, vb]: [f64; 4]) -> [f64; 4] {
    let (g, d) = (9.81, a - b);
    let denominator = 3.0 - (2.0 * d).cos();
    let first =
        (-3.0 * g * a.sin() - g * (a - 2.0 * b).sin() - 2.0 * d.sin() * (vb * vb + va * va * d.cos()))
            / denominator;
    let second = 2.0 * d.sin() * (2.0 * va * va + 2.0 * g * a.cos() + vb * vb * d.cos()) / denominator;
    [va, vb, first, second]
}

/// Gragg's method with Richardson extrapolation: order 12 in steps of `h`.
fn extrapolated<const D: usize>(
    rates: impl Fn([f64; D]) -> [f64; D],
    mut y: [f64; D],
    h: f64,
    steps: usize,
) -> [f64; D] {
    const ROUNDS: usize = 6;
    for _ in 0..steps {
        let mut table: Vec<[f64; D]> = Vec::new();
        for k in 0..ROUNDS {
            let n = 2 * (k + 1);
            let part = h / n as f64;
            let (mut before, mut now) = (y, y);
            let slope = rates(y);
            (0..D).for_each(|i| now[i] += part * slope[i]);
            for _ in 1..n {
                let slope = rates(now);
                let next: [f64; D] = std::array::from_fn(|i| before[i] + 2.0 * part * slope[i]);
                (before, now) = (now, next);
            }
            let slope = rates(now);
            table.push(std::array::from_fn(|i| 0.5 * (now[i] + before[i] + part * slope[i])));
            for j in (0..k).rev() {
                let ratio = ((k + 1) as f64 / (j + 1) as f64).powi(2) - 1.0;
                let next = table[j + 1];
                let refined: [f64; D] = std::array::from_fn(|i| next[i] + (next[i] - table[j][i]) / ratio);
                table[j] = refined;
            }
        }
        y = table[0];
    }
    y
}

#[test]
fn double_pendulum_agrees_with_the_textbook() {
    let start = [2.0, 2.5];
    let motion = run(&double_pendulum(start), &Commands::default(), &[2.0]);
    let [a, b, ..] = extrapolated(double_pendulum_rates, [start[0], start[1], 0.0, 0.0], 0.02, 100);
    let [again, ..] = extrapolated(double_pendulum_rates, [start[0], start[1], 0.0, 0.0], 0.01, 200);
    assert!((a - again).abs() < 1e-10, "the reference itself: {a} and {again}");
    let q = [motion.positions[0][0], motion.positions[1][0]];
    let error = (q[0] - a).abs().max((q[0] + q[1] - b).abs());
    println!("double pendulum at 2 s: {error:.1e} rad from the reference");
    assert!(error <= 1e-6, "{error} rad");
}

#[test]
fn double_pendulum_keeps_its_energy() {
    let times: Vec<f64> = (0..=100).map(|i| 0.1 * f64::from(i)).collect();
    let motion = run(&double_pendulum([2.0, 2.5]), &Commands::default(), &times);
    let energy = |i: usize| {
        let (q, v) = ([0, 1].map(|j| motion.positions[j][i]), [0, 1].map(|j| motion.velocities[j][i]));
        let (a, b, va, vb) = (q[0], q[0] + q[1], v[0], v[0] + v[1]);
        va * va + 0.5 * vb * vb + va * vb * (a - b).cos() - 9.81 * (2.0 * a.cos() + b.cos())
    };
    let all: Vec<f64> = (0..times.len()).map(energy).collect();
    let drift = all.iter().map(|e| ((e - all[0]) / all[0]).abs()).fold(0.0, f64::max);
    println!("energy of the double pendulum over 10 s: {drift:.1e}");
    assert!(drift <= 1e-6, "{drift}");
}

/// (M + m) x'' + m l (q'' cos q - q'^2 sin q) = F and l q'' + x'' cos q + g sin q = 0.
#[test]
fn cart_pole_agrees_with_the_textbook() {
    let (cart, pole, length, force, g) = (2.0, 0.3, 0.6, 1.5, 9.81);
    let rates = |[_, q, vx, v]: [f64; 4]| {
        let (s, c) = (q.sin(), q.cos());
        let x = (force + pole * s * (length * v * v + g * c)) / (cart + pole * s * s);
        [vx, v, x, -(x * c + g * s) / length]
    };
    let commands = Commands::new(vec![0.0], vec![vec![force], Vec::new()]);
    let scene = cart_pole(1.2);
    let tree = Tree::of(&scene).unwrap();
    assert_eq!(tree.names, ["slide", "hinge"]);
    let motion = run(&scene, &commands, &[2.0]);
    let expected = extrapolated(rates, [0.0, 1.2, 0.0, 0.0], 0.02, 100);
    let q = [motion.positions[0][0], motion.positions[1][0]];
    assert!((q[0] - expected[0]).abs() < 1e-8 && (q[1] - expected[1]).abs() < 1e-8, "{q:?} for {expected:?}");
}

/// The same bits alone, in a batch and on any number of threads.
#[test]
fn mechanisms_have_the_same_bits_in_any_batch() {
    let scenes: Vec<Scene> = (0..21).map(|i| double_pendulum([0.1 * f64::from(i), 1.0])).collect();
    let trees: Vec<Tree> = scenes.iter().map(|scene| Tree::of(scene).unwrap()).collect();
    let commands = Commands::default();
    let rollouts: Vec<JointRollout> = trees
        .iter()
        .map(|tree| JointRollout {
            tree,
            terms: Vec::new(),
            position: tree.position.clone(),
            velocity: tree.velocity.clone(),
            start: 0.0,
            commands: &commands,
            times: &[0.25, 1.0],
            field: None,
        })
        .collect();
    let alone: Vec<JointMotion> = rollouts.iter().flat_map(|r| simulate(std::slice::from_ref(r))).collect();
    for threads in [1, 3] {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        assert_eq!(pool.install(|| simulate(&rollouts)), alone);
    }
}

/// A rod that falls on a stop: energy never grows beyond what the method loses, and it comes to rest where the stop carries its weight.
#[test]
fn a_stop_holds_a_pendulum_where_statics_says() {
    let mut scene = pendulum(1.2, json!([]));
    let limits = json!({"low": 0.5, "high": 2.0});
    scene.joints[0].limits = Some(serde_json::from_value(limits).unwrap());
    let times: Vec<f64> = (0..=30_000).map(|i| f64::from(i) * 1e-3).collect();
    let motion = run(&scene, &Commands::default(), &times);
    let stop = Tree::of(&scene).unwrap().stops[0].unwrap();
    let energy = |i: usize| {
        let (q, v) = (motion.positions[0][i], motion.velocities[0][i]);
        let depth = (stop.low - q).max(0.0);
        v * v / 6.0 - 9.81 * 0.5 * q.cos() + 0.5 * stop.stiffness * depth * depth
    };
    let mut most = energy(0);
    for (i, t) in times.iter().enumerate() {
        // The method loses its order where the rod meets the stop.
        assert!(energy(i) <= most + 5e-5, "{t} s: {} after {most}", energy(i));
        most = most.min(energy(i));
    }
    assert!(motion.positions[0].iter().all(|q| *q > 0.47), "it goes through the stop");
    let q = *motion.positions[0].last().unwrap();
    // stiffness (low - q) = m g L / 2 sin q
    let off = stop.stiffness * (stop.low - q) - 9.81 * 0.5 * q.sin();
    assert!(off.abs() < 1e-3 * 9.81 * 0.5, "{q}: {off} N m are missing");
}

/// Encoders on the motor's side: elastic joints and gaps shift positions by the motor's torque of before, with its gain and delay.
#[test]
fn encoders_on_the_side_of_the_motor_show_its_torque() {
    let commands = Commands::new(vec![0.0, 0.5], vec![vec![2.0, -1.0]]);
    let times: Vec<f64> = (0..=100).map(|i| 0.01 * f64::from(i)).collect();
    let with = |effects: Value| run(&pendulum(0.3, effects), &commands, &times).positions.remove(0);
    let driven = json!([{"name": "motor_gain", "parameters": {"s": 0.5}}, {"name": "command_delay", "parameters": {"delay": 0.1}}]);
    let plain = with(driven.clone());
    let shift = |name: &str, parameter: &str, value: f64| -> Vec<f64> {
        let mut effects = driven.clone();
        effects.as_array_mut().unwrap().push(json!({"name": name, "parameters": {parameter: value}}));
        with(effects).iter().zip(&plain).map(|(q, plain)| q - plain).collect()
    };
    // The second command acts from 0.6 s on; a row at that time is measured before it acts.
    let (twist, gap) = (shift("joint_compliance", "compliance", 0.01), shift("backlash", "gap", 0.02));
    for (k, t) in times.iter().enumerate() {
        let torque = if *t < 0.605 { 1.0 } else { -0.5 };
        assert!((twist[k] - 0.01 * torque).abs() < 1e-12, "{t}: {}", twist[k]);
        assert!((gap[k] - 0.01 * torque.signum()).abs() < 1e-6, "{t}: {}", gap[k]);
    }
}

/// A link of a millionth of the mass on a stop carries what hangs on it.
#[test]
fn a_stop_is_as_stiff_as_what_hangs_on_its_joint_needs() {
    let mut scene = cart_pole(0.1);
    let carriage = scene.bodies.iter_mut().find(|body| body.name == "cart").unwrap();
    carriage.mass = Some(1e-6);
    let pole = scene.bodies.iter_mut().find(|body| body.name == "pole").unwrap();
    pole.inertia = Some(Inertia::Value(0.036));
    let slide = scene.joints.iter_mut().find(|joint| joint.name == "slide").unwrap();
    slide.limits = Some(serde_json::from_value(json!({"low": -0.5, "high": 0.5})).unwrap());
    let times: Vec<f64> = (0..=3000).map(|i| f64::from(i) * 1e-3).collect();
    let motion = run(&scene, &Commands::new(vec![0.0], vec![vec![3.0], Vec::new()]), &times);
    let tree = Tree::of(&scene).unwrap();
    let x = &motion.positions[tree.joint("slide").unwrap()];
    assert!(x.iter().all(|x| x.is_finite() && *x < 0.52), "{:?}", x.iter().copied().fold(0.0, f64::max));
}
