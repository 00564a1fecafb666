//! Bowling: place a red ball so that the green and the blue ball touch for 3 s.
//!
//! Source: Semage et al., "Intuitive Physics Guided Exploration for Sample Efficient Sim2real Transfer",
//! experiment on bowling; PHYRE (Bakhtin et al. 2019), template 00000, whose grid of sizes and places is used.
//!
//! Differences from the source:
//! - 100 tasks are drawn from the whole grid by a seed; PHYRE draws others. Both balls hang at the same height.
//! - A ball's radius is half the template's diameter; PHYRE's rasteriser takes up to 0.2 px off.
//! - Actions are 50,000 points of an evenly filling sequence in (x, y, radius).
//! - The walls' coefficients are known: the square roots of PHYRE's friction 0.5 and restitution 0.2, so that
//!   products of two surfaces give PHYRE's values.

use rand::seq::SliceRandom;

use super::certified::Selection;
use super::claims::{Claims, STRATEGIES_BY_JUMP_START, nearer};
use super::family::{Family, assemble, walls};
use super::presets::Learning;
use super::real::RealPhysics;
use crate::task::action::{ActionSpace, Component, Discrete, Quantity};
use crate::task::scene::{Body, FORMAT, Goal, Scene};
use crate::task::shape::Disc;

/// The family's row in the registry.
pub static FAMILY: Family = Family {
    name: "bowling",
    about: "place a red ball so that the green and the blue ball touch for 3 s",
    gymnasium: "iplw/Bowling-v0",
    tasks: || assemble(&FAMILY, include_str!("bowling.certified.json"), 0),
    candidates,
    split: [60, 20, 20],
    real_physics: RealPhysics::new(0.25, WALL_FRICTION, WALL_RESTITUTION, 0.8),
    // PHYRE's own hundred tasks of the template: 0.1 to 23 % solve, mean 9.1, median 8.9.
    selection: Selection {
        bins: &[(0.001, 0.03, 20), (0.03, 0.07, 20), (0.07, 0.11, 20), (0.11, 0.15, 20), (0.15, 0.23, 20)],
        in_real_world: false,
        sample: 1000,
    },
    prior: [(1.0, 0.5), (1.0, 0.5), (0.5, 0.25)],
    learning: Learning::STANDARD,
    surface_actions: 600,
    claims: Claims {
        estimates: &[
            nearer("gradient is nearer than collisions alone", "gradient", "collisions", BOTH),
            nearer("mixed is nearer than collisions alone", "mixed", "collisions", BOTH),
            nearer("gradient is nearer than rolling alone", "gradient", "rolling", BOTH),
            nearer("mixed is nearer than rolling alone", "mixed", "rolling", BOTH),
            nearer(
                "collisions tell restitution better than rolling",
                "collisions",
                "rolling",
                &["restitution"],
            ),
            nearer("rolling tells friction better than collisions", "rolling", "collisions", &["friction"]),
        ],
        jump_starts: STRATEGIES_BY_JUMP_START,
        all_trials: false,
    },
};

/// What its trials can tell.
const BOTH: &[&str] = &["friction", "restitution"];

/// Pixels per metre in PHYRE.
const PIXELS_PER_METRE: f64 = 6.0;
/// Width and height of a scene, m.
const SIDE: f64 = 256.0 / PIXELS_PER_METRE;
/// Thickness of the walls around it, m.
const WALL: f64 = 5.0 / PIXELS_PER_METRE;
/// sqrt(0.5)
const WALL_FRICTION: f64 = std::f64::consts::FRAC_1_SQRT_2;
/// sqrt(0.2)
const WALL_RESTITUTION: f64 = 0.447_213_595_499_957_9;

/// Every scene of the template's grid, shuffled by `seed`.
fn candidates(seed: u64) -> Vec<Scene> {
    let diameters = [0.06, 0.09, 0.12];
    let heights = [0.2, 0.35, 0.5, 0.65, 0.8];
    let mut scenes = Vec::new();
    for left in 1..=19 {
        for right in left + 1..=19 {
            for d1 in diameters {
                for d2 in diameters {
                    let (x1, x2) = (f64::from(left) * 0.05, f64::from(right) * 0.05);
                    let apart = (x2 - d2 / 2.0) - (x1 + d1 / 2.0) >= f64::max(d1, d2);
                    let within = x1 - d1 / 2.0 > 0.0 && x2 + d2 / 2.0 < 255.0 / 256.0;
                    if apart && within {
                        scenes.extend(heights.map(|h| scene([x1, x2], [d1, d2], h)));
                    }
                }
            }
        }
    }
    scenes.shuffle(&mut crate::rng::stream(seed, "bowling candidates"));
    scenes
}

/// One scene; all arguments as shares of the width.
fn scene(x: [f64; 2], diameter: [f64; 2], bottom: f64) -> Scene {
    let ball = |name: &str, i: usize| {
        let radius = diameter[i] / 2.0 * SIDE;
        movable(name, radius, Some([x[i] * SIDE, bottom * SIDE + radius]))
    };
    let set = |set, low, high| Component { target: "red".into(), set, low, high };
    Scene {
        format: FORMAT.into(),
        name: "bowling".into(),
        gravity: [0.0, -9.8],
        bodies: vec![ball("green", 0), ball("blue", 1), movable("red", 2.0 / PIXELS_PER_METRE, None)],
        statics: walls(SIDE, WALL, WALL_FRICTION, WALL_RESTITUTION),
        time_step: 1.0 / 240.0,
        steps: 4000,
        observe_every: 60,
        goal: Some(Goal::Contact {
            bodies: ["green".into(), "blue".into()],
            hold_s: 3.0,
            tolerance: 0.1 / PIXELS_PER_METRE,
            stop: None,
        }),
        action: Some(ActionSpace {
            components: vec![
                set(Quantity::X, 0.0, SIDE),
                set(Quantity::Y, 0.0, SIDE),
                set(Quantity::Radius, 2.0 / PIXELS_PER_METRE, 32.0 / PIXELS_PER_METRE),
            ],
            bounds: Some([0.0, 0.0, SIDE, SIDE]),
            discrete: Discrete::Sequence { count: 50_000 },
        }),
        calibrate: ["density", "friction", "restitution"].map(String::from).to_vec(),
        ..Scene::empty()
    }
}

fn movable(name: &str, radius: f64, position: Option<[f64; 2]>) -> Body {
    Body {
        name: name.into(),
        shape: Disc { radius }.into(),
        mass: None,
        density: Some(1.0),
        friction: 1.0,
        restitution: 0.5,
        position,
        angle: 0.0,
        velocity: [0.0, 0.0],
        angular_velocity: 0.0,
    }
}
