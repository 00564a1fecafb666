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
use crate::reality::Trial;
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

    /// Whether [`Situation::importance`] must be there.
    fn needs_importance(&self) -> bool {
        false
    }

    /// `n` distinct candidates (fewer if there are fewer), most wanted first.
    fn choose(&self, situation: &Situation, n: usize) -> Result<Chosen>;
}

/// What a strategy may look at: nothing of it comes from the real world but the trials that were paid for.
pub struct Situation<'a> {
    /// The tasks the candidates were drawn for.
    pub tasks: &'a [Task],
    /// The actions to choose from.
    pub candidates: &'a [Candidate],
    /// The simulation they were tried in.
    pub world: &'a World,
    /// The current estimate: density (kg/m^2), friction, restitution, c of `linear_drag` (1/s).
    pub estimate: [f64; 4],
    /// How far the search still spreads around it, standard deviations.
    pub spread: [f64; 4],
    /// What was measured so far.
    pub trials: &'a [Trial],
    /// What the task's performance asks of the latents; present where the strategy needs it.
    pub importance: Option<&'a dyn Importance>,
    /// For those that simulate more.
    pub progress: &'a dyn Progress,
}

/// What was chosen.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Chosen {
    /// Indices of candidates.
    pub indices: Vec<usize>,
    /// Rollouts simulated to choose them.
    pub rollouts: u64,
}

/// How much the performance on a task depends on each latent factor.
pub trait Importance: Send + Sync {
    /// Partial derivatives of performance by density (per kg/m^2), friction and restitution at `latents`.
    fn gradient(&self, latents: [f64; 3]) -> [f64; 3];
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

impl Chosen {
    /// Chosen without simulating anything.
    fn free(mut indices: Vec<usize>, n: usize) -> Result<Chosen> {
        indices.truncate(n);
        Ok(Chosen { indices, rollouts: 0 })
    }
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

    /// What a strategy sees that looks at candidates alone.
    fn seen<'a>(candidates: &'a [Candidate], world: &'a World) -> Situation<'a> {
        Situation {
            tasks: &[],
            candidates,
            world,
            estimate: [1.0, 0.5, 0.5, 0.0],
            spread: [0.5, 0.2, 0.2, 0.0],
            trials: &[],
            importance: None,
            progress: &crate::progress::Silent,
        }
    }

    const WORLD: World = World {
        latents: Latents { density: None, friction: None, restitution: None },
        effects: vec![],
        engine: Engine::Auto,
    };

    fn choose(name: &str, candidates: &[Candidate], n: usize) -> Vec<usize> {
        strategy(name).unwrap().choose(&seen(candidates, &WORLD), n).unwrap().indices
    }

    /// Contract of every strategy: n distinct indices, fewer only if there are fewer, always the same ones.
    #[test]
    fn every_strategy_keeps_its_contract() {
        let candidates = some();
        for strategy in REGISTRY {
            for n in [0, 1, 7, 50, 100, 200] {
                let chosen = choose(strategy.name(), &candidates, n);
                assert_eq!(chosen, choose(strategy.name(), &candidates, n), "{}", strategy.name());
                let mut distinct = chosen.clone();
                distinct.sort_unstable();
                distinct.dedup();
                assert_eq!(distinct.len(), n.min(100), "{} for {n}", strategy.name());
                assert!(distinct.iter().all(|i| *i < 100));
            }
            assert!(choose(strategy.name(), &[], 5).is_empty());
        }
    }

    #[test]
    fn groups_are_rich_in_what_they_are_named_for() {
        let candidates = some();
        let mean = |name: &str, of: fn(&Candidate) -> u32| {
            let chosen = choose(name, &candidates, 10);
            chosen.iter().map(|i| f64::from(of(&candidates[*i]))).sum::<f64>() / 10.0
        };
        assert!(mean("collisions", |c| c.collisions) > 11.0 && mean("rolling", |c| c.rolling_steps) > 85.0);
        assert!(mean("mixed", |c| c.collisions) > mean("random", |c| c.collisions));
        assert!(mean("mixed", |c| c.rolling_steps) > mean("random", |c| c.rolling_steps));
    }
}
