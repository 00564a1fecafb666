//! The work of a vector environment without a server: batches of actions on individual tasks, through the library. Baseline
//! for the vector environment in `benches/wire.py`.
//!
//! Reads `{"batches": [[[task, [x, y, radius]], ...], ...]}` from a file; prints `{"seconds": s, "valid": n,
//! "solved": n}`, where `seconds` is the duration of the fastest of REPEATS passes over all batches.
//!
//! `cargo run --release --example in_process -- actions.json 3`

use std::time::Instant;

use iplw::error::{Error, Result};
use iplw::session::observation::{ObservationLayout, object_names};
use iplw::session::{Action, Catalogue};
use iplw::task::{Placement, Task};
use iplw::trajectory::Trajectory;
use iplw::world::{Engine, Latents, Rollout, Simulator};
use serde::Deserialize;

#[derive(Deserialize)]
struct Work {
    batches: Vec<Vec<(String, Vec<f64>)>>,
}

fn main() -> Result<()> {
    let mut arguments = std::env::args().skip(1);
    let file = arguments.next().unwrap_or_default();
    let repeats: usize = arguments.next().and_then(|n| n.parse().ok()).unwrap_or(1);
    let text = std::fs::read_to_string(&file)
        .map_err(|e| Error::Io { path: file.clone(), message: format!("cannot be read: {e}") })?;
    let work: Work = serde_json::from_str(&text).map_err(|e| Error::Failed(format!("{file}: {e}")))?;
    let catalogue = Catalogue::new();
    // Tasks are resolved in advance, as in the server's worlds.
    let found = |(id, action): &(String, Vec<f64>)| Ok((catalogue.task(id)?, Action::Vector(action.clone())));
    let batches: Vec<Vec<(Task, Action)>> =
        work.batches.iter().map(|b| b.iter().map(found).collect()).collect::<Result<_>>()?;
    let mut best = f64::INFINITY;
    let (mut valid, mut solved) = (0, 0);
    for _ in 0..repeats.max(1) {
        let start = Instant::now();
        (valid, solved) = (0, 0);
        for batch in &batches {
            let (v, s) = step(&catalogue, batch)?;
            (valid, solved) = (valid + v, solved + s);
        }
        best = best.min(start.elapsed().as_secs_f64());
    }
    println!("{}", serde_json::json!({"seconds": best, "valid": valid, "solved": solved}));
    Ok(())
}

/// Places every action, simulates the valid ones, and returns the numbers of valid and solving actions.
fn step(catalogue: &Catalogue, batch: &[(Task, Action)]) -> Result<(usize, usize)> {
    let placed: Vec<Placement> = batch
        .iter()
        .map(|(task, action)| Ok(task.place(&action.resolve(task.actions(), "action")?)))
        .collect::<Result<_>>()?;
    let prior = |task: &Task| {
        let family = catalogue.family(&task.family).ok().and_then(|f| f.family);
        family.map(|f| Latents::of(f.prior.map(|p| p.0))).unwrap_or_default()
    };
    let (tasks, rollouts): (Vec<&Task>, Vec<Rollout>) = batch
        .iter()
        .zip(&placed)
        .filter_map(|((task, _), placement)| match placement {
            Placement::Valid(scene) => Some((task, Rollout { latents: prior(task), ..Rollout::of(scene) })),
            Placement::Invalid(_) => None,
        })
        .unzip();
    let observe = |task: &Task, t: &Trajectory| {
        let objects = object_names([&task.scene].into_iter());
        ObservationLayout::of(&task.scene, &objects).observe(Some(t))
    };
    let observed = Simulator::new(Engine::Auto).map(&rollouts, |i, t| (t.solved(), observe(tasks[i], &t)))?;
    Ok((rollouts.len(), observed.iter().filter(|(solved, _)| *solved).count()))
}
