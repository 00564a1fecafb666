//! What physics does: scene, latents and effects in, trajectory out.
//!
//! Semantics, the same for every engine:
//! - SI units; gravity is the scene's.
//! - Friction and restitution of a contact are the products of the two surfaces' coefficients (as in Pymunk).
//! - Once per time step, in this order: effects act on velocities, gravity acts, contacts are resolved,
//!   positions advance. With the effect `linear_drag` this is Pymunk's damping.
//! - Where sensor effects are at work, samples are what the sensors show; contacts, goals and outcomes are the
//!   truth's (see [`observe`]).
//! - A latent factor sets the coefficient of every carrier and the density of every carrying body.

mod change;
pub mod coordinates;
pub mod effect;
pub mod goal;
mod intervene;
mod lanes;
pub mod latent;
mod observe;
pub mod prepare;
mod prepared;
mod rapier;
mod record;
mod rollout;
mod state;

use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use crate::budget::{Budget, Endless};
use crate::error::{Error, Result};
use crate::trajectory::Trajectory;
pub use coordinates::{Coordinates, DRAG, EffectParameter, Sample};
use lanes::Topology;
pub use lanes::{Level, Settings};
#[cfg(feature = "levels")]
pub use lanes::{Operations, operations};
pub use latent::Latents;
use observe::View;
pub use observe::observe;
use prepare::{Prepared, prepare};
pub use rollout::Rollout;

/// Which engine integrates.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Engine {
    /// The fastest engine that takes the scene.
    #[default]
    Auto,
    /// The general engine: rapier2d.
    Rapier,
    /// The batched engine: discs, and bodies of any shape with up to 20,000 pairs of pieces.
    Lanes,
}

/// Simulates a batch, in parallel on rayon's pool; results in the order of the rollouts, and the same bits
/// for any number of threads.
pub fn simulate(rollouts: &[Rollout], engine: Engine) -> Result<Vec<Trajectory>> {
    simulate_map(rollouts, engine, |_, trajectory| trajectory)
}

/// [`simulate`], keeping only what `keep(index, trajectory)` returns, so that memory does not grow with the
/// length of trajectories.
pub fn simulate_map<T: Send>(
    rollouts: &[Rollout],
    engine: Engine,
    keep: impl Fn(usize, Trajectory) -> T + Sync,
) -> Result<Vec<T>> {
    simulate_map_at(Level::best(), rollouts, engine, keep)
}

/// [`simulate_map`] within a budget, at which it looks about every millisecond; an error of the budget ends it.
pub fn simulate_within<T: Send>(
    budget: &dyn Budget,
    rollouts: &[Rollout],
    engine: Engine,
    keep: impl Fn(usize, Trajectory) -> T + Sync,
) -> Result<Vec<T>> {
    run_all(Settings { level: Level::best(), end_at_rest: true }, budget, rollouts, engine, keep)
}

/// [`simulate_map`] with the batched engine held to a set of instructions; the results are the same for each.
pub fn simulate_map_at<T: Send>(
    level: Level,
    rollouts: &[Rollout],
    engine: Engine,
    keep: impl Fn(usize, Trajectory) -> T + Sync,
) -> Result<Vec<T>> {
    simulate_map_set(Settings { level, end_at_rest: true }, rollouts, engine, keep)
}

/// [`simulate_map`] with every choice that changes only the time it takes made by the caller: for benchmarks.
pub fn simulate_map_set<T: Send>(
    settings: Settings,
    rollouts: &[Rollout],
    engine: Engine,
    keep: impl Fn(usize, Trajectory) -> T + Sync,
) -> Result<Vec<T>> {
    run_all(settings, &Endless, rollouts, engine, keep)
}

fn run_all<T: Send>(
    settings: Settings,
    budget: &dyn Budget,
    rollouts: &[Rollout],
    engine: Engine,
    keep: impl Fn(usize, Trajectory) -> T + Sync,
) -> Result<Vec<T>> {
    let work = divide(rollouts, engine, budget)?;
    let run = |part: Part| -> Result<Vec<(usize, T)>> {
        budget.look()?;
        match part {
            Part::Rapier(index) => {
                let prepared = prepare(&rollouts[index])?;
                let truth = rapier::run(&prepared, budget)?;
                Ok(vec![(index, keep(index, seen(prepared.view.as_ref(), truth)))])
            }
            Part::Lanes(indices) => {
                let kept = Vec::with_capacity(indices.len());
                let indices = indices.into_iter();
                let views = Vec::new();
                let mut feed = Chunk { rollouts, indices, keep: &keep, kept, views, budget, ended: None };
                lanes::run(&mut feed, settings);
                feed.ended.map_or(Ok(feed.kept), Err)
            }
        }
    };
    // A single part is worth no trip to another thread.
    let finished: Vec<Result<Vec<(usize, T)>>> = match work.len() {
        0 | 1 => work.into_iter().map(run).collect(),
        _ => work.into_par_iter().map(run).collect(),
    };
    let mut results: Vec<Option<T>> = rollouts.iter().map(|_| None).collect();
    for part in finished {
        for (index, kept) in part? {
            results[index] = Some(kept);
        }
    }
    results.into_iter().map(|r| r.ok_or_else(|| Error::Failed("a rollout was lost".into()))).collect()
}

/// [`simulate_within`] for rollouts that engines of several names are to run: a batch for each.
pub fn simulate_mixed<T: Send>(
    budget: &dyn Budget,
    rollouts: &[(Engine, Rollout)],
    keep: impl Fn(usize, Trajectory) -> T + Sync,
) -> Result<Vec<T>> {
    let mut kept: Vec<Option<T>> = rollouts.iter().map(|_| None).collect();
    for engine in [Engine::Auto, Engine::Rapier, Engine::Lanes] {
        let here: Vec<usize> = (0..rollouts.len()).filter(|i| rollouts[*i].0 == engine).collect();
        let batch: Vec<Rollout> = here.iter().map(|i| rollouts[*i].1).collect();
        let done = simulate_within(budget, &batch, engine, |k, trajectory| keep(here[k], trajectory))?;
        for (i, value) in here.iter().zip(done) {
            kept[*i] = Some(value);
        }
    }
    kept.into_iter().map(|k| k.ok_or_else(|| Error::Failed("a rollout was lost".into()))).collect()
}

fn seen(view: Option<&View>, truth: Trajectory) -> Trajectory {
    match view {
        Some(view) => view.seen(truth),
        None => truth,
    }
}

/// The engine that [`simulate`] would use for a scene.
pub fn chosen(engine: Engine, rollout: &Rollout) -> Result<Engine> {
    engine_for(engine, &prepare(rollout)?)
}

fn engine_for(engine: Engine, prepared: &Prepared) -> Result<Engine> {
    match (engine, lanes::takes(prepared)) {
        (Engine::Rapier, _) | (Engine::Auto, false) => Ok(Engine::Rapier),
        (Engine::Auto | Engine::Lanes, true) => Ok(Engine::Lanes),
        (Engine::Lanes, false) => Err(Error::input(
            "engine",
            "\"lanes\"",
            format!("\"auto\" or \"rapier\" for a scene of more than {} pairs of pieces", lanes::MOST_PAIRS),
        )),
    }
}

/// Work for one thread at a time: numbers of rollouts.
enum Part {
    Rapier(usize),
    /// All of one topology.
    Lanes(Vec<usize>),
}

/// Rollouts of one topology, by number; `None` for the general engine's.
type Group = (Option<Topology>, Vec<usize>);

/// Fewest and most rollouts in a part: enough to keep all lanes busy until near the end, few enough to go round.
const PART: [usize; 2] = [2 * effect::LANES, 32 * effect::LANES];

/// So few rollouts are looked at where the caller is.
const FEW: usize = effect::LANES;

/// Checks every rollout, so that bad input is refused before any work is done, and divides the work. How it is
/// divided changes no result. Nothing prepared is kept: memory stays flat however many rollouts there are.
fn divide(rollouts: &[Rollout], engine: Engine, budget: &dyn Budget) -> Result<Vec<Part>> {
    let look = |(chunk, rollouts): (usize, &[Rollout])| -> Result<Vec<Group>> {
        let mut groups: Vec<Group> = Vec::new();
        // The group that the rollout before went to.
        let mut last = 0;
        budget.look()?;
        for (i, rollout) in rollouts.iter().enumerate() {
            if i > 0 && prepare::is_like(rollout, &rollouts[i - 1]) {
                groups[last].1.push(chunk * PART[1] + i);
                continue;
            }
            let prepared = prepare(rollout)?;
            let topology = match engine_for(engine, &prepared)? {
                Engine::Lanes => Some(Topology::of(&prepared)),
                Engine::Rapier | Engine::Auto => None,
            };
            last = group(&mut groups, topology);
            groups[last].1.push(chunk * PART[1] + i);
        }
        Ok(groups)
    };
    let looked_at: Vec<Result<Vec<Group>>> = match rollouts.len() {
        0..=FEW => rollouts.chunks(PART[1]).enumerate().map(look).collect(),
        _ => rollouts.par_chunks(PART[1]).enumerate().map(look).collect(),
    };
    let mut groups = Vec::new();
    for chunk in looked_at {
        for (topology, indices) in chunk? {
            let at = group(&mut groups, topology);
            groups[at].1.extend(indices);
        }
    }
    let share = rollouts.len().div_ceil(4 * rayon::current_num_threads());
    let size = share.clamp(PART[0], PART[1]);
    let parts = groups.into_iter().flat_map(|(topology, indices)| match topology {
        None => indices.into_iter().map(Part::Rapier).collect::<Vec<_>>(),
        Some(_) => indices.chunks(size).map(|c| Part::Lanes(c.to_vec())).collect(),
    });
    Ok(parts.collect())
}

/// The place of the group with the topology, made if there is none.
fn group(groups: &mut Vec<Group>, topology: Option<Topology>) -> usize {
    groups.iter().rposition(|(t, _)| *t == topology).unwrap_or_else(|| {
        groups.push((topology, Vec::new()));
        groups.len() - 1
    })
}

/// Feeds a part of the rollouts to the batched engine.
struct Chunk<'a, K, T> {
    rollouts: &'a [Rollout<'a>],
    indices: std::vec::IntoIter<usize>,
    keep: &'a K,
    kept: Vec<(usize, T)>,
    /// The sensors of the rollouts at work that have any, by number.
    views: Vec<(usize, View)>,
    budget: &'a dyn Budget,
    /// Why it was not finished.
    ended: Option<Error>,
}

impl<T, K: Fn(usize, Trajectory) -> T> lanes::Feed for Chunk<'_, K, T> {
    fn next(&mut self) -> Option<(usize, Prepared)> {
        let index = self.indices.next()?;
        // Prepared once before without error, in `divide`; a rollout that fails now is reported as lost.
        let mut prepared = prepare(&self.rollouts[index]).ok()?;
        self.views.extend(prepared.view.take().map(|view| (index, view)));
        Some((index, prepared))
    }

    fn goes_on(&mut self) -> bool {
        self.ended = self.budget.look().err();
        self.ended.is_none()
    }

    fn done(&mut self, index: usize, truth: Trajectory) {
        let view = self.views.iter().position(|(i, _)| *i == index).map(|at| self.views.swap_remove(at).1);
        let trajectory = seen(view.as_ref(), truth);
        self.kept.push((index, (self.keep)(index, trajectory)));
    }
}

impl Engine {
    /// The name used on the wire and the command line.
    pub fn name(self) -> &'static str {
        match self {
            Engine::Auto => "auto",
            Engine::Rapier => "rapier",
            Engine::Lanes => "lanes",
        }
    }

    /// The engine named `name`.
    pub fn from_name(name: &str) -> Result<Engine> {
        let all = [Engine::Auto, Engine::Rapier, Engine::Lanes];
        all.into_iter().find(|e| e.name() == name).ok_or_else(|| Error::NotFound {
            kind: "engine",
            id: name.to_string(),
            known: all.map(|e| e.name().to_string()).to_vec(),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::task::scene::Goal;
    use crate::task::{Placement, family};

    /// Random bowling scenes with much drag and friction come to rest early; ending them there must not show.
    #[test]
    fn ending_lanes_at_rest_changes_no_bit() {
        let mut scenes = Vec::new();
        for (i, scene) in family("bowling").unwrap().candidates(0).enumerate().take(60) {
            let space = scene.action.as_ref().unwrap();
            let action = space.at(i * 7919 % space.count()).unwrap();
            if let Placement::Valid(mut placed) = space.place(&scene, &action) {
                placed.damping = Some(0.01);
                placed.goal = Some(Goal::Contact {
                    bodies: ["green".into(), "floor".into()],
                    hold_s: f64::from(i as u32 % 12),
                    tolerance: 0.02,
                    stop: (i % 3 == 0).then_some(false),
                });
                scenes.push(*placed);
            }
        }
        let rollouts: Vec<Rollout> = scenes.iter().map(Rollout::of).collect();
        let run = |end_at_rest| {
            let settings = Settings { level: Level::best(), end_at_rest };
            simulate_map_set(settings, &rollouts, Engine::Lanes, |_, t| t).unwrap()
        };
        let (quick, slow) = (run(true), run(false));
        assert_eq!(quick, slow);
        let solved = slow.iter().filter(|t| t.solved()).count();
        let rests = |t: &Trajectory| {
            t.bodies
                .iter()
                .all(|b| b.x.iter().rev().zip(b.x.iter().rev().skip(1)).take(3).all(|(p, q)| p == q))
        };
        let resting = slow.iter().filter(|t| rests(t)).count();
        assert!(
            solved > 5 && resting > 5,
            "{solved} solved and {resting} at rest: the test shows too little"
        );
    }
}
