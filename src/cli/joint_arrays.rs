//! Rollouts of one scene with joints from arrays of initial states and commands, as arrays.

use std::collections::BTreeMap;
use std::path::Path;

use iplw::error::{Error, Result};
use iplw::progress::Progress;
use iplw::task::Scene;
use iplw::world::mechanism::{Commands, JointMotion, JointRollout, Tree, scene_terms, simulate};
use rayon::prelude::*;
use serde_json::json;

use super::arrays::npz::{self, ArchiveWriter, NumberArray};
use super::output;

/// Upper bound of the samples of all rollouts together, bytes.
const MAX_SAMPLE_BYTES: usize = 8 << 30;
/// Rollouts simulated together.
const BATCH: usize = 1 << 14;

/// Reads arrays, simulates, and writes arrays; without `samples` the final states alone.
pub fn run(scene: &Scene, samples: bool, input: &Path, out: &Path) -> Result<()> {
    let tree = Tree::of(scene)?;
    let inputs = JointInputs::new(&tree, npz::read(input)?).map_err(|e| e.in_file(input.display()))?;
    output::prepare_file("--out", out)?;
    let terms = scene_terms(scene, &tree)?;
    let duration = f64::from(scene.steps) * scene.time_step;
    let times = if samples { scene.observation_times() } else { vec![duration] };
    let width = times.len() * tree.links.len();
    let bytes = inputs.count.saturating_mul(16 * width);
    if bytes > MAX_SAMPLE_BYTES {
        let value = format!("{} with {} samples: {} GB", inputs.count, times.len(), bytes >> 30);
        let allowed =
            "at most 8 GB of samples: take fewer rollouts, a larger `observe_every`, or --no-samples";
        return Err(Error::input("rollouts", value, allowed));
    }
    let (mut position, mut velocity) = (vec![0.0; inputs.count * width], vec![0.0; inputs.count * width]);
    let progress = output::TerminalProgress::new();
    for start in (0..inputs.count).step_by(BATCH) {
        progress.report("rollouts", start as u64, inputs.count as u64)?;
        let batch: Vec<usize> = (start..(start + BATCH).min(inputs.count)).collect();
        let commands: Vec<Commands> = batch.par_iter().map(|i| inputs.commands(*i, duration)).collect();
        let rollouts: Vec<JointRollout> = batch
            .iter()
            .zip(&commands)
            .map(|(i, commands)| JointRollout {
                tree: &tree,
                terms: terms.clone(),
                position: inputs.row("position", *i).unwrap_or(&tree.position).to_vec(),
                velocity: inputs.row("velocity", *i).unwrap_or(&tree.velocity).to_vec(),
                start: 0.0,
                commands,
                times: &times,
                field: None,
            })
            .collect();
        let mut motions = simulate(&rollouts);
        motions.iter_mut().for_each(|motion| motion.round_positions(&terms));
        let range = start * width..start * width + motions.len() * width;
        fill(&mut position[range.clone()], width, &motions, |motion| &motion.positions);
        fill(&mut velocity[range], width, &motions, |motion| &motion.velocities);
    }
    progress.clear();
    let shape = [inputs.count, times.len(), tree.links.len()];
    let mut file = ArchiveWriter::new();
    file.add_f64("t", &[times.len()], &times)?;
    file.add_f64("position", &shape, &position)?;
    file.add_f64("velocity", &shape, &velocity)?;
    let names: Vec<&str> = tree.names.iter().map(String::as_str).collect();
    file.add_texts("joints", &[names.len()], &names)?;
    let about =
        json!({"version": env!("CARGO_PKG_VERSION"), "engine": "mechanism", "scene": scene}).to_string();
    file.add_texts("about", &[], &[&about])?;
    output::write_whole(out, &file.finish()?)
}

/// Rows of samples, by time and joint.
fn fill(to: &mut [f64], width: usize, motions: &[JointMotion], of: fn(&JointMotion) -> &Vec<Vec<f64>>) {
    to.par_chunks_mut(width).zip(motions).for_each(|(row, motion)| {
        let joints = of(motion);
        for (j, numbers) in joints.iter().enumerate() {
            for (k, number) in numbers.iter().enumerate() {
                row[k * joints.len() + j] = *number;
            }
        }
    });
}

/// The arrays of the input.
struct JointInputs<'a> {
    tree: &'a Tree,
    count: usize,
    arrays: BTreeMap<String, NumberArray>,
}

impl<'a> JointInputs<'a> {
    fn new(tree: &'a Tree, arrays: BTreeMap<String, NumberArray>) -> Result<JointInputs<'a>> {
        let known = "position, velocity (rollouts, joints) or command (rollouts, commands, motors)";
        let count = arrays.values().map(|array| array.shape.first().copied().unwrap_or(0)).max().unwrap_or(0);
        if count == 0 {
            return Err(Error::input(
                "arrays",
                "none, or without rollouts",
                format!("at least one of {known}"),
            ));
        }
        let motors = tree.motors.iter().flatten().count();
        for (name, array) in &arrays {
            let fits = match (name.as_str(), array.shape.as_slice()) {
                ("position" | "velocity", [n, joints]) => *n == count && *joints == tree.links.len(),
                ("command", [n, commands, m]) => *n == count && *commands > 0 && *m == motors,
                _ => false,
            };
            if !fits {
                let value = format!("an array of shape {:?}", array.shape);
                let allowed =
                    format!("{known}; {count} rollouts, {} joints, {motors} motors", tree.links.len());
                return Err(Error::input(name, value, allowed));
            }
            if let Some(at) = array.values.iter().position(|value| !value.is_finite()) {
                return Err(Error::input(format!("{name}[{at}]"), array.values[at], "finite numbers"));
            }
        }
        Ok(JointInputs { tree, count, arrays })
    }

    /// The numbers of a rollout.
    fn row(&self, name: &str, rollout: usize) -> Option<&[f64]> {
        let array = self.arrays.get(name)?;
        let width = array.values.len() / self.count;
        Some(&array.values[rollout * width..(rollout + 1) * width])
    }

    /// Commands of a rollout: equal parts of its duration, s.
    fn commands(&self, rollout: usize, duration: f64) -> Commands {
        let Some(row) = self.row("command", rollout) else { return Commands::default() };
        let motors: Vec<usize> =
            (0..self.tree.links.len()).filter(|j| self.tree.motors[*j].is_some()).collect();
        let count = row.len() / motors.len();
        let times = (0..count).map(|k| k as f64 * duration / count as f64).collect();
        let mut values = vec![Vec::new(); self.tree.links.len()];
        for (m, joint) in motors.iter().enumerate() {
            values[*joint] = (0..count).map(|k| row[k * motors.len() + m]).collect();
        }
        Commands::new(times, values)
    }
}
