//! Which actions to spend on the real world.
//!
//! Source: Semage et al., section on action selection: candidate actions are tried on the simulation at the
//! current estimate and ranked by what they would tell. A strategy is one file and one row in [`REGISTRY`].

mod collisions;
mod mixed;
mod random;
mod rolling;

use rand::RngExt;

use crate::error::{Error, Result};
use crate::progress::Progress;
use crate::rng::Stream;
use crate::task::scene::EffectTerm;
use crate::task::{Placement, Scene, Task, ValidAction};
use crate::world::{Engine, Latents, Rollout, simulate_map};

/// Every known strategy.
pub static REGISTRY: [&dyn Strategy; 4] =
    [&collisions::Collisions, &rolling::Rolling, &random::Random, &mixed::Mixed];

/// A way to choose actions from simulated candidates.
pub trait Strategy: Sync {
    /// Name on the command line and in reports.
    fn name(&self) -> &'static str;

    /// Indices of `n` distinct candidates (fewer if there are fewer), most wanted first.
    fn choose(&self, candidates: &[Candidate], n: usize) -> Vec<usize>;
}

/// An action that can be placed, with what the simulation says it would do.
#[derive(Clone, Debug)]
pub struct Candidate {
    /// Index into the tasks the candidates were drawn for.
    pub task: usize,
    /// The action.
    pub action: ValidAction,
    /// Contacts begun between movable bodies.
    pub collisions: u32,
    /// Body time steps on a carrying surface.
    pub rolling_steps: u32,
}

/// The simulation that candidates are tried in.
#[derive(Clone, Debug)]
pub struct World {
    /// The current estimate.
    pub latents: Latents,
    /// Effects of the simulation.
    pub effects: Vec<EffectTerm>,
    /// Integrating engine.
    pub engine: Engine,
}

/// The strategy named `name`.
pub fn strategy(name: &str) -> Result<&'static dyn Strategy> {
    REGISTRY.iter().copied().find(|s| s.name() == name).ok_or_else(|| Error::NotFound {
        kind: "strategy",
        id: name.to_string(),
        known: REGISTRY.iter().map(|s| s.name().to_string()).collect(),
    })
}

/// Draws `count` placeable actions over `tasks` and simulates each in `world`, goals ignored so that every
/// candidate is seen to its end.
pub fn candidates(
    tasks: &[Task],
    count: usize,
    world: &World,
    stream: &mut Stream,
    progress: &dyn Progress,
) -> Result<Vec<Candidate>> {
    let drawn = draw(tasks, count, stream)?;
    let mut found = Vec::with_capacity(drawn.len());
    // Chunks bound the memory held in scenes and let progress and cancellation through.
    for chunk in drawn.chunks(256) {
        progress.report("exploring in simulation", found.len() as u64, drawn.len() as u64)?;
        let rollouts: Vec<Rollout> = chunk
            .iter()
            .map(|(_, _, scene)| Rollout {
                scene,
                latents: world.latents,
                effects: &world.effects,
                stop: false,
            })
            .collect();
        let counts = simulate_map(&rollouts, world.engine, |_, t| (t.collisions, t.rolling_steps))?;
        found.extend(chunk.iter().zip(counts).map(|((task, action, _), (collisions, rolling_steps))| {
            Candidate { task: *task, action: action.clone(), collisions, rolling_steps }
        }));
    }
    progress.report("exploring in simulation", drawn.len() as u64, drawn.len() as u64)?;
    Ok(found)
}

/// Random (task, discrete action) pairs that can be placed; an error if next to none can.
pub(crate) fn draw(
    tasks: &[Task],
    count: usize,
    stream: &mut Stream,
) -> Result<Vec<(usize, ValidAction, Box<Scene>)>> {
    if tasks.is_empty() {
        return Err(Error::Failed("no task to draw actions for".into()));
    }
    let mut drawn = Vec::with_capacity(count);
    let tries = 1000 + 200 * count;
    for _ in 0..tries {
        if drawn.len() == count {
            return Ok(drawn);
        }
        let task = stream.random_range(0..tasks.len());
        let space = tasks[task].actions();
        let action = space.at(stream.random_range(0..space.count()))?;
        if let Placement::Valid(scene) = tasks[task].place(&action) {
            drawn.push((task, action, scene));
        }
    }
    Err(Error::Failed(format!(
        "only {} of {tries} random actions of {:?} could be placed; {count} wanted",
        drawn.len(),
        tasks[0].family
    )))
}

/// Indices ordered by descending score; ties keep the order of the candidates, which is random.
fn ranked(candidates: &[Candidate], score: impl Fn(&Candidate) -> f64) -> Vec<usize> {
    let mut order: Vec<usize> = (0..candidates.len()).collect();
    order.sort_by(|a, b| score(&candidates[*b]).total_cmp(&score(&candidates[*a])));
    order
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::task::ActionSpace;
    use crate::task::action::Discrete;

    fn some() -> Vec<Candidate> {
        let space =
            ActionSpace { components: vec![], bounds: None, discrete: Discrete::Grid { counts: vec![100] } };
        (0..100)
            .map(|i| Candidate {
                task: 0,
                action: space.at(i).unwrap(),
                collisions: (i as u32 * 7) % 13,
                rolling_steps: (i as u32 * 31) % 97,
            })
            .collect()
    }

    /// Contract of every strategy: n distinct indices, fewer only if there are fewer, always the same ones.
    #[test]
    fn every_strategy_keeps_its_contract() {
        let candidates = some();
        for strategy in REGISTRY {
            for n in [0, 1, 7, 50, 100, 200] {
                let chosen = strategy.choose(&candidates, n);
                assert_eq!(chosen, strategy.choose(&candidates, n), "{}", strategy.name());
                let mut distinct = chosen.clone();
                distinct.sort_unstable();
                distinct.dedup();
                assert_eq!(distinct.len(), n.min(100), "{} for {n}", strategy.name());
                assert!(distinct.iter().all(|i| *i < 100));
            }
            assert!(strategy.choose(&[], 5).is_empty());
        }
    }

    #[test]
    fn groups_are_rich_in_what_they_are_named_for() {
        let candidates = some();
        let mean = |name: &str, of: fn(&Candidate) -> u32| {
            let chosen = super::strategy(name).unwrap().choose(&candidates, 10);
            chosen.iter().map(|i| f64::from(of(&candidates[*i]))).sum::<f64>() / 10.0
        };
        assert!(mean("collisions", |c| c.collisions) > 11.0 && mean("rolling", |c| c.rolling_steps) > 85.0);
        assert!(mean("mixed", |c| c.collisions) > mean("random", |c| c.collisions));
        assert!(mean("mixed", |c| c.rolling_steps) > mean("random", |c| c.rolling_steps));
    }
}
