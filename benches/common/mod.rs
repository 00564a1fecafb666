//! Scenes and clocks shared by the benchmarks.

use std::time::Instant;

use iplw::task::{Placement, Scene, family};
use iplw::world::{Rollout, SimdLevel};

/// Scenes from a file of JSON lines; without a file, scenes of the bowling family.
pub fn scenes(path: Option<&String>) -> Vec<Scene> {
    match path {
        Some(path) => {
            let text = std::fs::read_to_string(path).expect("the file of scenes can be read");
            text.lines().map(|line| Scene::from_json(line).expect("a legal scene")).collect()
        }
        None => bowling(200),
    }
}

/// Rollouts of the unmodified scenes, to the last step.
pub fn rollouts(scenes: &[Scene]) -> Vec<Rollout<'_>> {
    let rollout = |scene| Rollout { stop_at_goal: false, ..Rollout::of(scene) };
    scenes.iter().map(rollout).collect()
}

/// Name of the level in tables.
pub fn level_name(level: SimdLevel) -> String {
    format!("{level:?}").to_lowercase()
}

/// Processor time of all threads, s, on Linux, which is less sensitive to other work on the machine; wall-clock time elsewhere.
pub struct Clock(Instant);

impl Clock {
    pub fn start() -> Clock {
        Clock(Instant::now())
    }

    pub fn seconds(&self) -> f64 {
        let own = |entry: std::io::Result<std::fs::DirEntry>| {
            let text = std::fs::read_to_string(entry.ok()?.path().join("schedstat")).ok()?;
            text.split(' ').next()?.parse::<f64>().ok()
        };
        match std::fs::read_dir("/proc/self/task") {
            Ok(threads) => threads.filter_map(own).sum::<f64>() / 1e9,
            Err(_) => self.0.elapsed().as_secs_f64(),
        }
    }
}

fn bowling(count: usize) -> Vec<Scene> {
    let scenes = family("bowling").expect("built in").candidates(0);
    let acted = |(i, scene): (usize, Scene)| {
        let space = scene.action.as_ref()?;
        match space.place(&scene, &space.at(i * 7919 % space.count()).ok()?) {
            Placement::Valid(placed) => Some(*placed),
            Placement::Invalid(_) => None,
        }
    };
    scenes.enumerate().filter_map(acted).take(count).collect()
}
