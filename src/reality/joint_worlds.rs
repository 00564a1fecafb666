//! Generated recordings of mechanisms with a hidden effect, as dirty as real ones.
//!
//! Besides noise, every world has an error that all trials share: a smooth torque field over position and velocity of 3 to 6 % of
//! the torque that the simulation lacks plus half a per cent of the typical one, an eccentric encoder of 0.1 % of the range, and
//! effects that differ between trials by 3 %.

use rand::RngExt;
use rand_distr::{Distribution, StandardNormal};

use super::joint_trials::JointTrial;
use crate::error::{Error, Result};
use crate::names::names;
use crate::rng::{self, Stream};
use crate::task::Scene;
use crate::task::body::Body;
use crate::task::joint::{Control, Joint, JointKind, Motor};
use crate::task::scene::JOINT_FORMAT;
use crate::task::shape::{Rectangle, Shape};
use crate::world::mechanism::effect::{JointEffect, JointScale, REGISTRY};
use crate::world::mechanism::{
    Commands, FieldShape, JointMotion, JointRollout, JointTerm, TorqueField, TorqueFunction, Tree,
    required_torques, rounded_position, simulate,
};

/// A kind of mechanism.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Mechanism {
    /// A rod on a driven hinge.
    Pendulum,
    /// A driven cart with a free pole.
    CartPole,
    /// Two links with driven joints.
    Arm,
}

names!(Mechanism: Pendulum = "pendulum", CartPole = "cart_pole", Arm = "arm");

/// A recording: trials, their duration (s) and rate (1/s), and noise (rad or m).
#[derive(Clone, Copy, Debug)]
pub struct RecordingPlan {
    pub trials: usize,
    pub duration: f64,
    pub rate: f64,
    pub noise: f64,
}

/// A generated world.
pub struct JointWorld {
    /// Without the hidden effect.
    pub scene: Scene,
    /// The hidden effect, if there is one.
    pub truth: Option<JointTerm>,
    pub trials: Vec<JointTrial>,
}

/// Sizes of what no effect of the library explains.
const FIELD_OF_MISSING: [f64; 2] = [0.03, 0.06];
const FIELD_OF_TORQUE: f64 = 0.005;
const ECCENTRICITY: f64 = 0.001;
const SIZE_SD: f64 = 0.03;
const FIELD_FUNCTIONS: usize = 12;
/// Fastest motion of a joint, rad/s or m/s, and number of worlds that are drawn until one is slow enough.
const MAX_SPEED: f64 = 60.0;
const MAX_ATTEMPTS: usize = 100;
/// Range of an effect's size in plausible ones.
const SIZES: [f64; 2] = [0.5, 1.5];

impl Mechanism {
    /// The scene without hidden effects.
    pub fn scene(self) -> Scene {
        let rod = |name: &str, from: [f64; 2], length: f64, mass: f64| Body {
            mass: Some(mass),
            position: Some([from[0], from[1] - 0.5 * length]),
            ..body(name, Shape::Box(Rectangle { half_width: 0.02, half_height: 0.5 * length }))
        };
        let hinge = |name: &str, body: &str, parent: Option<&str>, anchor: [f64; 2]| Joint {
            name: name.into(),
            kind: JointKind::Revolute,
            body: body.into(),
            parent: parent.map(String::from),
            anchor,
            axis: None,
            position: 0.0,
            velocity: 0.0,
            armature: 0.0,
            spring: None,
            limits: None,
            effects: Vec::new(),
        };
        let motor = |joint: &str, max_torque: f64| Motor {
            joint: joint.into(),
            control: Control::Torque,
            stiffness: 0.0,
            damping: 0.0,
            max_torque,
        };
        let (bodies, joints, motors) = match self {
            Mechanism::Pendulum => (
                vec![rod("rod", [0.0; 2], 0.5, 0.4)],
                vec![hinge("hinge", "rod", None, [0.0; 2])],
                vec![motor("hinge", 1.0)],
            ),
            Mechanism::CartPole => {
                let cart = Body {
                    mass: Some(1.0),
                    position: Some([0.0; 2]),
                    ..body("cart", Shape::Box(Rectangle { half_width: 0.2, half_height: 0.1 }))
                };
                let slide = Joint {
                    kind: JointKind::Prismatic,
                    axis: Some([1.0, 0.0]),
                    ..hinge("slide", "cart", None, [0.0; 2])
                };
                (
                    vec![cart, rod("pole", [0.0; 2], 0.6, 0.2)],
                    vec![slide, hinge("pivot", "pole", Some("cart"), [0.0; 2])],
                    vec![motor("slide", 8.0)],
                )
            }
            Mechanism::Arm => (
                vec![rod("upper", [0.0; 2], 0.4, 0.6), rod("lower", [0.0, -0.4], 0.35, 0.4)],
                vec![
                    hinge("shoulder", "upper", None, [0.0; 2]),
                    hinge("elbow", "lower", Some("upper"), [0.0, -0.4]),
                ],
                vec![motor("shoulder", 1.0), motor("elbow", 0.2)],
            ),
        };
        Scene {
            format: JOINT_FORMAT.into(),
            name: self.name().into(),
            gravity: [0.0, -9.81],
            bodies,
            joints,
            motors,
            time_step: 0.002,
            ..Scene::empty()
        }
    }

    /// Effects that can be hidden, with the indices of their joints.
    pub fn effects(self) -> Result<Vec<(&'static JointEffect, usize)>> {
        let tree = Tree::of(&self.scene())?;
        let fits = |effect: &JointEffect, j: usize| {
            effect.fits(tree.kinds[j], tree.motors[j].is_some(), tree.parents[j].is_none(), true)
        };
        let joints = 0..tree.links.len();
        let of = |effect: &'static JointEffect| {
            joints.clone().filter(move |j| fits(effect, *j)).map(move |j| (effect, j)).collect::<Vec<_>>()
        };
        Ok(REGISTRY.iter().copied().flat_map(of).collect())
    }

    /// A recording with a hidden effect of a random size in a joint, or with none; no joint turns faster than [`MAX_SPEED`].
    pub fn world(
        self,
        hidden: Option<(&'static JointEffect, usize)>,
        plan: &RecordingPlan,
        seed: u64,
    ) -> Result<JointWorld> {
        self.world_under(hidden, plan, None, seed)
    }

    /// The same under given commands, one for each trial, instead of random ones.
    pub fn world_under(
        self,
        hidden: Option<(&'static JointEffect, usize)>,
        plan: &RecordingPlan,
        commands: Option<&[Commands]>,
        seed: u64,
    ) -> Result<JointWorld> {
        if let Some(wrong) = commands.map(<[Commands]>::len).filter(|count| *count != plan.trials) {
            return Err(Error::input("commands", wrong, format!("{}: one for each trial", plan.trials)));
        }
        let mut stream = rng::stream(seed, "joint world");
        for _ in 0..MAX_ATTEMPTS {
            if let Some(found) = self.attempt(hidden, plan, commands, &mut stream)? {
                return Ok(found);
            }
        }
        Err(Error::Failed(format!("{} moves too fast in all of {MAX_ATTEMPTS} worlds", self.name())))
    }

    /// A world, unless a joint is too fast.
    fn attempt(
        self,
        hidden: Option<(&'static JointEffect, usize)>,
        plan: &RecordingPlan,
        given: Option<&[Commands]>,
        stream: &mut Stream,
    ) -> Result<Option<JointWorld>> {
        let scene = self.scene();
        let tree = Tree::of(&scene)?;
        let times: Vec<f64> =
            (0..=(plan.duration * plan.rate) as usize).map(|i| i as f64 / plan.rate).collect();
        let starts: Vec<Vec<f64>> = (0..plan.trials)
            .map(|_| {
                (0..tree.links.len()).map(|j| amplitude(&tree, j) * stream.random_range(-1.0..1.0)).collect()
            })
            .collect();
        // Random ones are drawn all the same, so that the rest of the world is.
        let drawn: Vec<Commands> = (0..plan.trials).map(|_| commands(&tree, plan, stream)).collect();
        let commands = given.map_or(drawn, <[Commands]>::to_vec);
        let run = |terms: &[Vec<JointTerm>], field: Option<(&TorqueField, &[(usize, f64)])>| {
            let rollouts: Vec<JointRollout> = (0..plan.trials)
                .map(|k| JointRollout {
                    tree: &tree,
                    terms: terms[k].clone(),
                    position: starts[k].clone(),
                    velocity: vec![0.0; tree.links.len()],
                    start: 0.0,
                    commands: &commands[k],
                    times: &times,
                    field: field.map(|(field, coefficients)| (field, coefficients.to_vec())),
                })
                .collect();
            simulate(&rollouts)
        };
        let plain = run(&vec![Vec::new(); plan.trials], None);
        let [velocity, torque, _] = sizes(&tree, &plain, &times, &commands)?;
        let truth = hidden.map(|(effect, joint)| {
            random_term(&tree, effect, joint, [velocity[joint], torque[joint]], stream)
        });
        let terms: Vec<Vec<JointTerm>> =
            (0..plan.trials).map(|_| truth.iter().map(|t| varied(t, stream)).collect()).collect();
        let clean = run(&terms, None);
        let [velocity, torque, missing] = sizes(&tree, &clean, &times, &commands)?;
        let (field, coefficients) = dirt(&tree, &velocity, &torque, &missing, stream);
        let motions = run(&terms, Some((&field, &coefficients)));
        let is_fast = |v: &f64| !v.is_finite() || v.abs() > MAX_SPEED;
        if motions.iter().any(|m| m.velocities.iter().flatten().any(is_fast)) {
            return Ok(None);
        }
        let eccentric: Vec<f64> = (0..tree.links.len()).map(|_| stream.random_range(-3.0..3.0)).collect();
        let trials = motions.into_iter().zip(commands).enumerate().map(|(k, (motion, commands))| {
            let mut measured = |i: usize| {
                let mut own = |j: usize| {
                    let (q, noise): (f64, f64) = (motion.positions[j][i], StandardNormal.sample(stream));
                    let eccentricity = ECCENTRICITY * amplitude(&tree, j) * libm::sin(q + eccentric[j]);
                    rounded_position(&terms[k], j, q + eccentricity + plan.noise * noise)
                };
                (0..eccentric.len()).map(&mut own).collect()
            };
            JointTrial {
                id: k.to_string(),
                times: times.clone(),
                positions: (0..times.len()).map(&mut measured).collect(),
                commands,
            }
        });
        let trials: Vec<JointTrial> = trials.collect();
        Ok(Some(JointWorld { scene, truth, trials }))
    }
}

/// A body with a shape and default surfaces.
fn body(name: &str, shape: Shape) -> Body {
    Body {
        name: name.into(),
        shape,
        mass: None,
        density: None,
        inertia: None,
        friction: 0.5,
        restitution: 0.5,
        position: None,
        angle: 0.0,
        velocity: [0.0; 2],
        angular_velocity: 0.0,
    }
}

/// Range of initial positions: rad or m.
fn amplitude(tree: &Tree, joint: usize) -> f64 {
    match tree.kinds[joint] {
        JointKind::Revolute => 1.0,
        JointKind::Prismatic => 0.3,
    }
}

/// Random steps, and in every other trial a sweep of frequencies beside them.
fn commands(tree: &Tree, plan: &RecordingPlan, stream: &mut Stream) -> Commands {
    let count = (plan.duration * plan.rate) as usize;
    let times: Vec<f64> = (0..=count).map(|i| i as f64 / plan.rate).collect();
    let values = tree.motors.iter().map(|motor| {
        let Some(motor) = motor else { return Vec::new() };
        let sweep = f64::from(u8::from(stream.random_bool(0.5)));
        let (mut level, mut until) = (0.0, 0.0);
        let mut value = |t: f64| {
            if t >= until {
                level = stream.random_range(-0.7..0.7);
                until = t + stream.random_range(0.1..0.6);
            }
            let phase = std::f64::consts::TAU * (0.3 * t + 0.5 * (3.0 - 0.3) * t * t / plan.duration);
            motor.max_torque * (level + sweep * 0.4 * libm::sin(phase)).clamp(-1.0, 1.0)
        };
        times.iter().map(|t| value(*t)).collect()
    });
    let values = values.collect();
    Commands::new(times, values)
}

/// By joint: root mean squares of velocity, of the torque that motion and gravity need, and of the part of it that the motor does
/// not give.
fn sizes(
    tree: &Tree,
    motions: &[JointMotion],
    times: &[f64],
    commands: &[Commands],
) -> Result<[Vec<f64>; 3]> {
    let joints = tree.links.len();
    let (mut sums, mut count) = (vec![[0.0; 3]; joints], 0.0);
    for (motion, commands) in motions.iter().zip(commands) {
        for i in 1..times.len() - 1 {
            let h = times[i + 1] - times[i - 1];
            let a: Vec<f64> = (0..joints)
                .map(|j| (motion.velocities[j][i + 1] - motion.velocities[j][i - 1]) / h)
                .collect();
            let at = |of: &[Vec<f64>]| of.iter().map(|own| own[i]).collect::<Vec<f64>>();
            let (q, v) = (at(&motion.positions), at(&motion.velocities));
            let needed =
                required_torques(tree, &q, &v, &a).ok_or_else(|| Error::Failed("singular masses".into()))?;
            count += 1.0;
            for j in 0..joints {
                let motor = tree.motors[j].as_ref();
                let motor = motor
                    .map_or(0.0, |m| m.torque(commands.mean(j, [times[i - 1], times[i + 1]]), q[j], v[j]));
                let own = [
                    v[j],
                    needed.total[j].abs().max(needed.gravity[j].abs()).max(motor.abs()),
                    needed.total[j] - motor,
                ];
                sums[j].iter_mut().zip(own).for_each(|(sum, v)| *sum += v * v);
            }
        }
    }
    Ok([0, 1, 2].map(|k| sums.iter().map(|s| (s[k] / count).sqrt()).collect()))
}

/// An effect of a random plausible size.
fn random_term(
    tree: &Tree,
    effect: &'static JointEffect,
    joint: usize,
    [velocity, torque]: [f64; 2],
    stream: &mut Stream,
) -> JointTerm {
    let link = &tree.links[joint];
    let value = |(k, p): (usize, &crate::world::mechanism::effect::JointParameter)| {
        if k > 0 && p.neutral != 0.0 {
            // The law's shape, not its size.
            let value = p.neutral * stream.random_range(SIZES[0]..SIZES[1]);
            return if p.is_whole { value.round() } else { value };
        }
        let scale = match p.scale {
            JointScale::Absolute => 1.0,
            JointScale::Torque => torque,
            JointScale::TorquePerVelocity => torque / velocity.max(1e-9),
            JointScale::PerTorque => 1.0 / torque.max(1e-9),
            JointScale::Velocity => velocity,
            JointScale::Mass => link.mass,
            JointScale::Length => link.tip[0].hypot(link.tip[1]),
        };
        let size = p.plausible * scale * stream.random_range(SIZES[0]..SIZES[1]);
        let up = p.bounds[0] >= p.neutral || p.bounds[1] > p.neutral && stream.random_bool(0.5);
        let value = if up { p.neutral + size } else { p.neutral - size };
        let value = if p.is_whole { value.round() } else { value };
        // A factor far below one half is no plausible error.
        value.clamp(p.bounds[0].max(if p.neutral == 1.0 { 0.3 } else { f64::NEG_INFINITY }), p.bounds[1])
    };
    JointTerm { effect, joint, values: effect.parameters.iter().enumerate().map(value).collect() }
}

/// The term with the size of one trial.
fn varied(term: &JointTerm, stream: &mut Stream) -> JointTerm {
    let z: f64 = StandardNormal.sample(stream);
    if term.effect.is_resolution() {
        // The encoder is the same in all trials.
        return term.clone();
    }
    let value = |(v, p): (&f64, &crate::world::mechanism::effect::JointParameter)| {
        let varied = p.neutral + (1.0 + SIZE_SD * z) * (v - p.neutral);
        if p.is_whole { *v } else { varied.clamp(p.bounds[0], p.bounds[1]) }
    };
    JointTerm { values: term.values.iter().zip(term.effect.parameters).map(value).collect(), ..*term }
}

/// A smooth random torque field.
fn dirt(
    tree: &Tree,
    velocity: &[f64],
    torque: &[f64],
    missing: &[f64],
    stream: &mut Stream,
) -> (TorqueField, Vec<(usize, f64)>) {
    let (mut field, mut coefficients) = (TorqueField::default(), Vec::new());
    for j in 0..tree.links.len() {
        field.centre.push([0.0; 3]);
        let is_periodic = tree.kinds[j] == JointKind::Revolute;
        let extent = if is_periodic { std::f64::consts::PI } else { 2.0 * amplitude(tree, j) };
        field.is_periodic.push(is_periodic);
        field.half_extent.push([extent, 2.0 * velocity[j].max(1e-6), 1.0]);
        let [low, high] = FIELD_OF_MISSING;
        let size = (stream.random_range(low..high) * missing[j]).hypot(FIELD_OF_TORQUE * torque[j]);
        for _ in 0..FIELD_FUNCTIONS {
            let centre = [stream.random_range(-1.0..1.0), stream.random_range(-1.0..1.0)];
            let width: f64 = stream.random_range(0.4..0.9);
            let shape = FieldShape::Bump { centre, inverse_square_width: [width.powi(-2); 2] };
            field.functions.push(TorqueFunction { joint: j, shape });
            let z: f64 = StandardNormal.sample(stream);
            // About a quarter of the bumps act at a state.
            coefficients.push((field.functions.len() - 1, size * z * 2.0 / (FIELD_FUNCTIONS as f64).sqrt()));
        }
    }
    (field, coefficients)
}
