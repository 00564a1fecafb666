//! Seconds that a plan of 10,000 actions under 64 draws takes, by what is believed, beside as many rollouts in bare batches of
//! the same run. `cargo bench --bench planning [-- TASKS]`

use std::time::Instant;

use iplw::budget::Unlimited;
use iplw::error::Error;
use iplw::estimate::ParameterSamples;
use iplw::plan::{PlanConfig, plan};
use iplw::progress::NoProgress;
use iplw::reality::{HiddenWorld, standard};
use iplw::task::{Placement, Scene, Split, Task, families, split};
use iplw::world::{Engine, Rollout, Simulator};

/// Rollouts of a bare batch.
const BATCH: usize = 2048;

fn main() -> Result<(), Error> {
    let given = std::env::args().skip(1).find_map(|a| a.parse().ok());
    for family in families() {
        let tasks: Vec<Task> =
            split(&family.tasks(), Split::Test).into_iter().take(given.unwrap_or(5)).collect();
        let truth = HiddenWorld::new(standard(family))?.reveal();
        let beliefs = [
            ("prior", ParameterSamples::prior(family.prior, Vec::new(), 1024, 0)?),
            ("truth", ParameterSamples::point(truth.latents, truth.effects)?),
        ];
        for (name, belief) in &beliefs {
            let (mut seconds, mut ratios, mut rollouts) = (Vec::new(), Vec::new(), Vec::new());
            for task in &tasks {
                let start = Instant::now();
                let found = plan(task, belief, &PlanConfig::standard(0), &Unlimited, &NoProgress)?;
                let planned = start.elapsed().as_secs_f64();
                seconds.push(planned);
                ratios.push(planned / bare(task, belief, found.rollouts)?);
                rollouts.push(found.rollouts as f64);
            }
            let [s, r, n] = [&mut seconds, &mut ratios, &mut rollouts].map(|v| {
                v.sort_by(f64::total_cmp);
                (v[v.len() / 2], v[v.len() - 1])
            });
            println!(
                "{} under the {name}, {} tasks: median {:.1} s, worst {:.1} s; {:.0} rollouts (worst {:.0}); {:.2} of bare batches (worst {:.2})",
                family.name,
                tasks.len(),
                s.0,
                s.1,
                n.0,
                n.1,
                r.0,
                r.1
            );
        }
    }
    Ok(())
}

/// Seconds of so many rollouts of random actions in drawn worlds, placed before the clock runs.
fn bare(task: &Task, belief: &ParameterSamples, count: usize) -> Result<f64, Error> {
    let space = task.actions();
    let valid =
        (0..).map(|i| space.at(i * 7919 % space.count())).filter_map(|a| match task.place(&a.ok()?) {
            Placement::Valid(scene) => Some(scene),
            Placement::Invalid(_) => None,
        });
    let scenes: Vec<Box<Scene>> = valid.take(BATCH).collect();
    let rollouts: Vec<Rollout> = scenes
        .iter()
        .zip(belief.draws().iter().cycle())
        .map(|(scene, w)| Rollout { latents: w.latents, effects: &w.effects, ..Rollout::of(scene) })
        .collect();
    let start = Instant::now();
    let mut left = count;
    while left > 0 {
        let now = left.min(BATCH);
        Simulator::new(Engine::Auto).map(&rollouts[..now], |_, t| t.solved())?;
        left -= now;
    }
    Ok(start.elapsed().as_secs_f64())
}
