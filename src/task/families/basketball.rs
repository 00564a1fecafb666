//! Basketball: place a ball and a 45-degree plank so that the ball drops, bounces off the plank and lands in
//! the basket.
//!
//! Source: Semage et al., experiment on basketball: 25 tasks with different basket places, 200 ball places x
//! 200 plank places, plank below a horizontal and left of a vertical line, 500 steps observed every 50.
//!
//! Differences from the source: the paper gives neither sizes nor the time step. Here the scene is as wide as
//! PHYRE's, the step is 1/120 s (so 500 steps last 4.2 s, the time a ball needs to fall, bounce and land), the
//! initial state is observed beside the paper's ten, and each set of 200 places is a 20 x 10 grid.

use rand::seq::SliceRandom;

use super::certified::Selection;
use super::claims::{Claims, STRATEGIES_BY_JUMP_START, nearer};
use super::family::{Family, assemble, walls};
use super::presets::Learning;
use super::real::RealPhysics;
use crate::task::action::{ActionSpace, Component, Discrete, Quantity};
use crate::task::scene::{Body, FORMAT, Goal, Scene, Static};
use crate::task::shape::{Disc, Rectangle};

/// The family's row in the registry.
pub static FAMILY: Family = Family {
    name: "basketball",
    about: "place a ball and a 45-degree plank so that the ball drops, bounces and lands in the basket",
    gymnasium: "iplw/Basketball-v0",
    tasks: || assemble(&FAMILY, include_str!("basketball.certified.json"), 0),
    candidates,
    split: [15, 5, 5],
    real_physics: RealPhysics::new(1.0, 0.2, 0.7, 0.8),
    selection: Selection { bins: &[(0.002, 0.10, 25)], in_real_world: true, sample: 4000 },
    prior: [(1.0, 0.5), (0.5, 0.25), (0.5, 0.25)],
    // The paper's batches for this family.
    learning: Learning { batch_size: 32, ..Learning::STANDARD },
    // More than bowling's: its tasks are harder, and its rollouts eight times shorter.
    surface_actions: 2000,
    claims: Claims {
        estimates: &[
            nearer(
                "rolling alone tells restitution worse than collisions",
                "collisions",
                "rolling",
                &["restitution"],
            ),
            nearer("rolling alone tells restitution worse than mixed", "mixed", "rolling", &["restitution"]),
        ],
        jump_starts: STRATEGIES_BY_JUMP_START,
        all_trials: true,
    },
};

/// Width and height of a scene, m.
const SIDE: f64 = 256.0 / 6.0;
/// Thickness of the walls around it, m.
const WALL: f64 = 5.0 / 6.0;
/// Ball radius, m.
const BALL: f64 = 1.0;
/// Half length and half thickness of the plank, m.
const PLANK: [f64; 2] = [3.5, 0.25];
/// The plank's centre stays below this height and left of this place, m.
const LINES: [f64; 2] = [18.0, 20.0];
/// Half the basket's opening, its depth and the thickness of its sides, m.
const BASKET: [f64; 3] = [3.2, 3.0, 0.25];

/// Every basket place of an 11 x 6 grid, shuffled by `seed`.
fn candidates(seed: u64) -> Vec<Scene> {
    let mut scenes = Vec::new();
    for column in 0..11 {
        for row in 0..6 {
            scenes.push(scene(23.5 + f64::from(column), 0.3 + 1.25 * f64::from(row)));
        }
    }
    scenes.shuffle(&mut crate::rng::stream(seed, "basketball candidates"));
    scenes
}

/// The scene whose basket has its centre line at `x` and stands at height `bottom`, m.
fn scene(x: f64, bottom: f64) -> Scene {
    let mut statics = walls(SIDE, WALL, 0.5, 0.2);
    statics.extend(basket(x, bottom));
    statics.push(Static {
        name: "plank".into(),
        shape: Rectangle { half_width: PLANK[0], half_height: PLANK[1] }.into(),
        friction: 0.5,
        restitution: 0.5,
        position: [LINES[0] / 2.0, LINES[1] / 2.0],
        angle: -std::f64::consts::FRAC_PI_4,
    });
    let [half, depth, side] = BASKET;
    Scene {
        format: FORMAT.into(),
        name: "basketball".into(),
        gravity: [0.0, -9.8],
        bodies: vec![ball()],
        statics,
        time_step: 1.0 / 120.0,
        steps: 500,
        observe_every: 50,
        goal: Some(Goal::Inside {
            body: "ball".into(),
            region: vec![
                [x - half, bottom + 2.0 * side],
                [x + half, bottom + 2.0 * side],
                [x + half, bottom + 2.0 * side + depth - BALL],
                [x - half, bottom + 2.0 * side + depth - BALL],
            ],
            hold_s: 0.0,
            stop: None,
        }),
        action: Some(actions()),
        carriers: Some(vec!["ball".into(), "plank".into()]),
        calibrate: ["density", "friction", "restitution"].map(String::from).to_vec(),
        ..Scene::empty()
    }
}

fn ball() -> Body {
    Body {
        name: "ball".into(),
        shape: Disc { radius: BALL }.into(),
        mass: None,
        density: Some(1.0),
        friction: 0.5,
        restitution: 0.5,
        position: None,
        angle: 0.0,
        velocity: [0.0, 0.0],
        angular_velocity: 0.0,
    }
}

/// Bottom and sides of the basket.
fn basket(x: f64, bottom: f64) -> Vec<Static> {
    let [half, depth, side] = BASKET;
    let part = |name: &str, position: [f64; 2], half_width: f64, half_height: f64| Static {
        name: name.into(),
        shape: Rectangle { half_width, half_height }.into(),
        friction: 0.5,
        restitution: 0.2,
        position,
        angle: 0.0,
    };
    let middle = bottom + 2.0 * side + depth / 2.0;
    vec![
        part("basket_bottom", [x, bottom + side], half + 2.0 * side, side),
        part("basket_left", [x - (half + side), middle], side, depth / 2.0),
        part("basket_right", [x + (half + side), middle], side, depth / 2.0),
    ]
}

/// Ball above the lines, plank below the one and left of the other.
fn actions() -> ActionSpace {
    let reach = PLANK[0] * std::f64::consts::FRAC_1_SQRT_2 + PLANK[1];
    let set = |target: &str, set, low, high| Component { target: target.into(), set, low, high };
    ActionSpace {
        components: vec![
            set("ball", Quantity::X, BALL, LINES[0]),
            set("ball", Quantity::Y, LINES[1] + 3.0, SIDE - BALL),
            set("plank", Quantity::X, reach, LINES[0]),
            set("plank", Quantity::Y, reach, LINES[1]),
        ],
        bounds: Some([0.0, 0.0, SIDE, SIDE]),
        discrete: Discrete::Grid { counts: vec![20, 10, 20, 10] },
    }
}
