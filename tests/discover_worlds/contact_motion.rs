//! Motions with contacts, simulated by the program's own engine: sliding that turns into rolling, slipping down a slope,
//! blocks, tossed boxes, colliding discs, balls, blocks and gliders on a track. The scene may have a wrong friction, mass ratio, restitution, threshold or
//! moment of inertia.

use std::f64::consts::PI;
use std::fmt::Write as _;

use iplw::reality::{Trial, trials_from_csv};
use iplw::rng;
use iplw::task::Scene;
use iplw::task::scene::{Body, EffectTerm, Inertia, RoundBody};
use iplw::world::{Engine, Rollout, Simulator};
use rand::{Rng, RngExt};
use rand_distr::{Distribution, StandardNormal};

/// Standard deviation of an observed position, m, and of an angle, rad.
const NOISE_M: f64 = 5e-4;
const NOISE_RAD: f64 = 0.01;
/// Steps a second; every eighth is observed.
const STEPS_PER_SECOND: f64 = 960.0;
/// Trials of a recording.
const TRIALS: usize = 12;

/// Kinds of motion.
pub const KINDS: [&str; 12] = [
    "slide_to_roll",
    "slip_on_incline",
    "roll_on_incline",
    "block_to_rest",
    "block_on_incline",
    "tossed_box",
    "bouncing_ball",
    "two_discs",
    "two_balls",
    "three_discs",
    "two_gliders",
    "two_blocks",
];

/// What is wrong in the scene.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Wrong {
    Nothing,
    Friction,
    MassRatio,
    Restitution,
    Threshold,
    Inertia,
}

pub const WRONGS: [Wrong; 6] =
    [Wrong::Nothing, Wrong::Friction, Wrong::MassRatio, Wrong::Restitution, Wrong::Threshold, Wrong::Inertia];

/// A recording, the scene that is diagnosed, and the quantity that is wrong in it: a latent or `effect.parameter`.
pub struct ContactWorld {
    pub scene: Scene,
    pub trials: Vec<Trial>,
    pub wrong: Option<(&'static str, f64)>,
}

/// Whether a recording of this kind depends on what is wrong.
pub fn shows(kind: &str, wrong: Wrong) -> bool {
    match wrong {
        Wrong::Nothing => true,
        // The corners of boxes stick at most impacts.
        Wrong::Friction => {
            matches!(kind, "slide_to_roll" | "slip_on_incline" | "block_to_rest" | "block_on_incline")
        }
        Wrong::MassRatio => matches!(kind, "two_discs" | "two_balls" | "two_gliders" | "two_blocks"),
        Wrong::Restitution => {
            matches!(
                kind,
                "bouncing_ball"
                    | "two_discs"
                    | "two_balls"
                    | "three_discs"
                    | "two_gliders"
                    | "tossed_box"
                    | "two_blocks"
            )
        }
        Wrong::Threshold => kind == "bouncing_ball",
        Wrong::Inertia => kind == "roll_on_incline",
    }
}

/// A recording of a kind of motion.
pub fn contact_world(kind: &str, wrong: Wrong, seed: u64) -> ContactWorld {
    let mut random = rng::stream(seed, &format!("contact motion {kind} {wrong:?}"));
    let scene = scene(kind);
    let mut nature = scene.clone();
    let quantity = mislead(&mut nature, wrong, &mut random);
    let mut csv = String::from("trial,t,body,x,y,angle\n");
    for trial in 0..TRIALS {
        let mut launched = nature.clone();
        launch(kind, &mut launched.bodies, &mut random);
        let rollout = Rollout { stop_at_goal: false, ..Rollout::of(&launched) };
        let path = Simulator::new(Engine::Lanes).run(&[rollout]).expect("a valid scene").remove(0);
        let mut draw = || -> f64 { StandardNormal.sample(&mut random) };
        for (i, time) in path.times.iter().enumerate() {
            for (body, track) in launched.bodies.iter().zip(&path.bodies) {
                let [x, mut y] = [track.x[i], track.y[i]].map(|v| v + NOISE_M * draw());
                if kind == "two_gliders" {
                    // A track is one coordinate.
                    y = 0.0;
                }
                let turned = track.angle[i] + NOISE_RAD * draw();
                let angle =
                    if body.shape.disc_radius().is_none() { format!("{turned}") } else { String::new() };
                let _ = writeln!(csv, "t{trial},{time},{},{x},{y},{angle}", body.name);
            }
        }
    }
    let trials = trials_from_csv(&csv, &scene).expect("a valid recording");
    ContactWorld { scene, trials, wrong: quantity }
}

/// The scene of a kind, at 120 observations a second.
fn scene(kind: &str) -> Scene {
    let slope = |degrees: f64| {
        let a = degrees * PI / 180.0;
        format!(r#"{{"type": "halfspace", "normal": [{}, {}], "offset": 0}}"#, libm::sin(a), libm::cos(a))
    };
    let disc = |name: &str, radius: f64, friction: f64, e: f64| {
        format!(
            r#"{{"name": "{name}", "shape": {{"type": "disc", "radius": {radius}}}, "mass": 0.1, "friction": {friction}, "restitution": {e}}}"#
        )
    };
    let block_named = |name: &str, friction: f64, e: f64| {
        format!(
            r#"{{"name": "{name}", "shape": {{"type": "box", "half_width": 0.04, "half_height": 0.025}}, "mass": 0.1, "friction": {friction}, "restitution": {e}}}"#
        )
    };
    let block = |friction: f64, e: f64| block_named("block", friction, e);
    let (gravity, bodies, ground, seconds) = match kind {
        "slide_to_roll" => (9.81, disc("ball", 0.03, 0.2, 0.5), Some(slope(0.0)), 1.2),
        "slip_on_incline" => (9.81, disc("ball", 0.03, 0.15, 0.5), Some(slope(40.0)), 0.7),
        "roll_on_incline" => (9.81, disc("ball", 0.03, 0.5, 0.5), Some(slope(15.0)), 1.0),
        "block_to_rest" => (9.81, block(0.3, 0.2), Some(slope(0.0)), 1.2),
        "block_on_incline" => (9.81, block(0.3, 0.2), Some(slope(30.0)), 0.7),
        "tossed_box" => (9.81, block(0.4, 0.4), Some(slope(0.0)), 1.0),
        "bouncing_ball" => (9.81, disc("ball", 0.03, 0.3, 0.75), Some(slope(0.0)), 1.6),
        "two_discs" | "two_gliders" => {
            (0.0, [disc("red", 0.03, 0.2, 0.8), disc("blue", 0.03, 0.2, 0.8)].join(","), None, 1.0)
        }
        "two_blocks" => {
            (0.0, [block_named("red", 0.2, 0.8), block_named("blue", 0.2, 0.8)].join(","), None, 1.0)
        }
        "two_balls" => {
            (9.81, [disc("red", 0.03, 0.2, 0.8), disc("blue", 0.03, 0.2, 0.8)].join(","), None, 0.6)
        }
        _ => {
            let three = ["red", "blue", "green"].map(|name| disc(name, 0.03, 0.2, 0.8));
            (0.0, three.join(","), None, 1.0)
        }
    };
    let ground = ground.map_or(String::new(), |shape| {
        format!(r#"{{"name": "ground", "shape": {shape}, "friction": 1, "restitution": 1}}"#)
    });
    let steps = (STEPS_PER_SECOND * seconds) as u32;
    let text = format!(
        r#"{{"format": "iplw.scene/1", "gravity": [0, {}], "time_step": {}, "steps": {steps}, "observe_every": 8,
            "calibrate": ["friction", "restitution"], "bodies": [{bodies}], "statics": [{ground}]}}"#,
        -gravity,
        1.0 / STEPS_PER_SECOND
    );
    Scene::from_json(&text).expect("a valid scene")
}

/// Changes nature, so that the scene is wrong.
fn mislead(nature: &mut Scene, wrong: Wrong, random: &mut impl Rng) -> Option<(&'static str, f64)> {
    let factor = random.random_range(1.3..2.0f64).powi(if random.random::<bool>() { 1 } else { -1 });
    let body = &mut nature.bodies[0];
    match wrong {
        Wrong::Nothing => None,
        Wrong::Friction => {
            let friction = body.friction * factor;
            nature.bodies.iter_mut().for_each(|b| b.friction = friction);
            Some(("friction", friction))
        }
        Wrong::MassRatio => {
            body.mass = body.mass.map(|mass| mass * factor);
            Some(("mass_ratio.s", factor))
        }
        Wrong::Restitution => {
            let restitution = random.random_range(0.4..0.95);
            nature.bodies.iter_mut().for_each(|b| b.restitution = restitution);
            Some(("restitution", restitution))
        }
        Wrong::Threshold => {
            let speed = random.random_range(0.8..1.4);
            nature.effects.push(EffectTerm::new("restitution_threshold", &[("speed", speed)]));
            Some(("restitution_threshold.speed", speed))
        }
        Wrong::Inertia => {
            let (kind, s) =
                [(RoundBody::SolidSphere, 0.8), (RoundBody::HollowSphere, 4.0 / 3.0), (RoundBody::Hoop, 2.0)]
                    [random.random_range(0..3)];
            body.inertia = Some(Inertia::Of(kind));
            Some(("inertia_error.s", s))
        }
    }
}

/// Draws the initial states.
fn launch(kind: &str, bodies: &mut [Body], random: &mut impl Rng) {
    let mut draw = |low: f64, high: f64| random.random_range(low..high);
    let on_slope = |degrees: f64, way: f64, height: f64| {
        let a = degrees * PI / 180.0;
        let (s, c) = (libm::sin(a), libm::cos(a));
        Some([way * c + height * s, -way * s + height * c])
    };
    let down = |degrees: f64, speed: f64| {
        let a = degrees * PI / 180.0;
        [speed * libm::cos(a), -speed * libm::sin(a)]
    };
    match kind {
        "slide_to_roll" => {
            bodies[0].position = Some([draw(-0.5, 0.5), 0.03]);
            bodies[0].velocity = [draw(0.8, 2.0), 0.0];
        }
        "slip_on_incline" => {
            bodies[0].position = on_slope(40.0, draw(-0.1, 0.1), 0.03);
            bodies[0].velocity = down(40.0, draw(0.0, 0.5));
        }
        "roll_on_incline" => {
            bodies[0].position = on_slope(15.0, draw(-0.1, 0.1), 0.03);
            let speed = draw(-0.8, 0.5);
            bodies[0].velocity = down(15.0, speed);
            bodies[0].angular_velocity = -speed / 0.03;
        }
        "block_to_rest" => {
            bodies[0].position = Some([draw(-0.5, 0.5), 0.025]);
            bodies[0].velocity = [draw(0.8, 2.0), 0.0];
        }
        "block_on_incline" => {
            bodies[0].position = on_slope(30.0, draw(-0.1, 0.1), 0.025);
            (bodies[0].velocity, bodies[0].angle) = (down(30.0, draw(0.0, 0.5)), -PI / 6.0);
        }
        "tossed_box" => {
            bodies[0].position = Some([draw(-0.2, 0.2), draw(0.3, 0.6)]);
            bodies[0].velocity = [draw(0.5, 1.5), draw(0.0, 1.5)];
            (bodies[0].angle, bodies[0].angular_velocity) = (draw(-PI, PI), draw(-8.0, 8.0));
        }
        "bouncing_ball" => {
            bodies[0].position = Some([draw(-0.2, 0.2), draw(0.3, 0.7)]);
            bodies[0].velocity = [draw(0.3, 1.5), draw(-1.0, 1.0)];
            bodies[0].angular_velocity = draw(-20.0, 20.0);
        }
        "two_balls" => {
            // They meet in the air after 0.25 to 0.35 s.
            let (time, speed, offset) = (draw(0.25, 0.35), draw(0.7, 1.6), draw(-0.03, 0.03));
            (bodies[0].position, bodies[0].velocity) = (Some([-speed * time, 1.0 + offset]), [speed, 2.0]);
            (bodies[1].position, bodies[1].velocity) = (Some([0.06, 1.0]), [draw(-0.5, 0.0), 2.0]);
        }
        "two_blocks" => {
            (bodies[0].position, bodies[0].velocity) =
                (Some([-0.3, draw(-0.03, 0.03)]), [draw(0.6, 1.5), 0.0]);
            (bodies[1].position, bodies[1].velocity) = (Some([0.0, 0.0]), [draw(-0.3, 0.1), draw(-0.1, 0.1)]);
            for body in bodies {
                (body.angle, body.angular_velocity) = (draw(-PI, PI), draw(-6.0, 6.0));
            }
        }
        "two_gliders" => {
            (bodies[0].position, bodies[0].velocity) = (Some([-0.3, 0.0]), [draw(0.6, 1.5), 0.0]);
            (bodies[1].position, bodies[1].velocity) = (Some([0.0, 0.0]), [draw(-0.3, 0.1), 0.0]);
        }
        _ => {
            let (speed, offset) = (draw(0.6, 1.5), draw(-0.04, 0.04));
            (bodies[0].position, bodies[0].velocity) = (Some([-0.3, offset]), [speed, 0.0]);
            (bodies[1].position, bodies[1].velocity) = (Some([0.0, 0.0]), [draw(-0.3, 0.1), draw(-0.1, 0.1)]);
            if let Some(third) = bodies.get_mut(2) {
                (third.position, third.velocity) = (Some([0.25, draw(-0.03, 0.03)]), [draw(-0.3, 0.0), 0.0]);
            }
        }
    }
}
