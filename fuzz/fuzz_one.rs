//! Invariants of scenes from arbitrary bytes: they are rejected with a named field, or simulated to finite numbers.
//!
//! Used by the bounded fuzzer in the test suite (`tests/physics/fuzz_scene.rs`), by `tests/physics/properties.rs`, and by the
//! libFuzzer target of this directory. A violation panics.

use iplw::error::Error;
use iplw::task::{Placement, Scene};
use iplw::trajectory::Trajectory;
use iplw::world::{Engine, Rollout, Simulator};

/// Outcome of an input.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Fate {
    /// Not a valid scene.
    Refused,
    /// Valid, but nothing to simulate (for example, a position is missing).
    Idle,
    /// Simulated by at least one engine.
    Simulated,
}

/// Simulated steps of a scene: enough for contacts, few enough for scenes of 64 bodies and 256 statics.
const STEPS: u32 = 60;

/// Parses `bytes` as a scene and simulates it in both engines.
pub fn fuzz_one(bytes: &[u8]) -> Fate {
    let Ok(text) = std::str::from_utf8(bytes) else { return Fate::Refused };
    match Scene::from_json(text) {
        Ok(scene) => check_scene(&scene, STEPS),
        Err(error) => {
            check_error(&error);
            Fate::Refused
        }
    }
}

/// Checks a valid scene over its first `steps` steps.
pub fn check_scene(scene: &Scene, steps: u32) -> Fate {
    let again = Scene::from_json(&scene.to_json()).expect("a legal scene is read back");
    assert_eq!(again, *scene, "written and read back");
    assert!(scene.extent().iter().all(|v| v.is_finite()), "extent {:?}", scene.extent());
    let mut fate = roll(scene, steps);
    if let Some(space) = &scene.action {
        for index in [0, space.count() / 2] {
            let action = match space.at(index) {
                Ok(action) => action,
                Err(error) => {
                    check_error(&error);
                    continue;
                }
            };
            if let Placement::Valid(placed) = space.place(scene, &action) {
                fate = fate.max_of(roll(&placed, steps));
            }
        }
    }
    fate
}

fn roll(scene: &Scene, steps: u32) -> Fate {
    let short = Scene { steps: scene.steps.min(steps), ..scene.clone() };
    let mut fate = Fate::Idle;
    for engine in [Engine::Lanes, Engine::Rapier] {
        let rollout = Rollout::of(&short);
        match Simulator::new(engine).run(&[rollout]) {
            Ok(trajectories) => {
                check_trajectory(&trajectories[0], &short, engine);
                fate = Fate::Simulated;
            }
            Err(error) => check_error(&error),
        }
    }
    fate
}

/// Everything recorded is finite and complete; divergence is reported.
fn check_trajectory(t: &Trajectory, scene: &Scene, engine: Engine) {
    let context = || format!("{engine:?}: {:?}", t.outcome);
    assert_eq!(t.outcome.solved.is_some(), scene.goal.is_some(), "{}", context());
    assert!(t.outcome.steps <= scene.steps, "{}", context());
    assert!(t.times.windows(2).all(|w| w[0] < w[1]), "{}: times {:?}", context(), t.times);
    assert_eq!(t.bodies.len(), scene.bodies.len(), "{}", context());
    for b in &t.bodies {
        for (what, column) in
            [("x", &b.x), ("y", &b.y), ("angle", &b.angle), ("vx", &b.vx), ("vy", &b.vy), ("omega", &b.omega)]
        {
            assert_eq!(column.len(), t.times.len(), "{}: {what} of {}", context(), b.name);
            assert!(column.iter().all(|v| v.is_finite()), "{}: {what} of {}: {column:?}", context(), b.name);
        }
    }
    assert!(
        t.events.iter().all(|e| e.time.is_finite() && e.speed.is_finite()),
        "{}: {:?}",
        context(),
        t.events
    );
}

/// An error names the field and the allowed values.
fn check_error(error: &Error) {
    match error {
        Error::Input(input) => {
            assert!(!input.allowed.is_empty(), "nothing is said to be allowed: {error}");
            // A JSON syntax error has a line instead of a field.
            assert!(!input.field.is_empty() || !input.place.is_empty(), "no field, no line: {error}");
        }
        other => panic!("not a refusal of input: {other:?}"),
    }
}

impl Fate {
    fn max_of(self, other: Fate) -> Fate {
        if other == Fate::Simulated { other } else { self }
    }
}
