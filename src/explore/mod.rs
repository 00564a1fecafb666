//! Which actions to spend on the real world.
//!
//! Source: Semage et al., section on action selection: candidate actions are tried on the simulation at the
//! current estimate and ranked by what they would tell. A strategy is one file and one row in [`REGISTRY`].

mod collisions;
mod gradient;
mod informative;
mod mixed;
mod random;
mod rolling;

use rand::RngExt;
use serde::{Deserialize, Serialize};

use crate::error::{Error, Result};
use crate::progress::Progress;
use crate::reality::Trial;
use crate::rng::Stream;
use crate::task::scene::EffectTerm;
use crate::task::{Placement, Scene, Task, ValidAction};
use crate::trajectory::{Contact, Trajectory};
use crate::world::{Coordinates, Engine, Latents, Rollout, simulate_map};

/// Every known strategy.
pub static REGISTRY: &[&dyn Strategy] = &[
    &collisions::Collisions,
    &rolling::Rolling,
    &random::Random,
    &mixed::Mixed,
    &gradient::Gradient,
    &informative::Informative,
];

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
    /// What is estimated.
    pub coordinates: &'a Coordinates,
    /// The current estimate, one value a coordinate.
    pub estimate: &'a [f64],
    /// How far the search still spreads around it, standard deviations.
    pub spread: &'a [f64],
    /// How far it spread before anything was measured, standard deviations; 0 for what is not searched.
    pub prior: &'a [f64],
    /// What was measured so far.
    pub trials: &'a [Trial],
    /// What the task's performance asks of the latents; there where the strategy needs it, and used where there.
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
    /// How many come from which group, where the strategy deals them out.
    pub groups: Option<Groups>,
}

/// How many actions are chosen from each group.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Groups {
    /// For their collisions, which tell restitution.
    pub collisions: usize,
    /// For their rolling, which tells friction.
    pub rolling: usize,
}

/// How much the performance on a task depends on each latent factor.
pub trait Importance: Send + Sync {
    /// Partial derivatives of performance by density (per kg/m^2), friction and restitution at `latents`; NaN
    /// where they are not known.
    fn gradient(&self, latents: [f64; 3]) -> [f64; 3];
}

/// An action that can be placed, with what the simulation says it would do.
#[derive(Clone, Debug)]
pub struct Candidate {
    /// Index into the tasks the candidates were drawn for.
    pub task: usize,
    /// The action.
    pub action: ValidAction,
    /// Contacts begun between things that both carry the latent factors; see [`collisions_of`].
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
        let counts = simulate_map(&rollouts, world.engine, |i, t| {
            (collisions_of(rollouts[i].scene, &t), t.rolling_steps)
        })?;
        found.extend(chunk.iter().zip(counts).map(|((task, action, _), (collisions, rolling_steps))| {
            Candidate { task: *task, action: action.clone(), collisions, rolling_steps }
        }));
    }
    progress.report("exploring in simulation", drawn.len() as u64, drawn.len() as u64)?;
    Ok(found)
}

/// The collisions of a trajectory that tell restitution: contacts begun between two things that both carry the
/// latent factors. Where all movable bodies carry them and nothing else does (bowling, and every scene that does
/// not say), these are the paper's: contacts between movable bodies. In basketball they are the ball's on the plank;
/// its contacts with floor, walls and basket, whose known coefficients are small, tell little. A scene with a single
/// carrier has no such pair: then its contacts with anything count.
pub fn collisions_of(scene: &Scene, trajectory: &Trajectory) -> u32 {
    let carries = |name: &str| match &scene.carriers {
        Some(carriers) => carriers.iter().any(|c| c == name),
        None => scene.body(name).is_some(),
    };
    let carriers = scene.carriers.as_ref().map_or(scene.bodies.len(), Vec::len);
    let wanted = if carriers > 1 { 2 } else { 1 };
    let counts = |c: &&Contact| c.between.iter().filter(|name| carries(name)).count() >= wanted;
    trajectory.events.iter().filter(counts).count() as u32
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
        Ok(Chosen { indices, rollouts: 0, groups: None })
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
    use crate::progress::Silent;
    use crate::task::action::Discrete;
    use crate::task::{ActionSpace, family};

    pub(super) fn some() -> Vec<Candidate> {
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

    /// The same slope everywhere.
    pub(super) struct Slope(pub [f64; 3]);
    impl Importance for Slope {
        fn gradient(&self, _: [f64; 3]) -> [f64; 3] {
            self.0
        }
    }

    /// What a strategy sees that looks at candidates alone.
    pub(super) fn seen<'a>(
        candidates: &'a [Candidate],
        world: &'a World,
        importance: Option<&'a dyn Importance>,
    ) -> Situation<'a> {
        Situation {
            tasks: &[],
            candidates,
            world,
            coordinates: &LATENTS,
            estimate: &[1.0, 0.5, 0.5, 0.0],
            spread: &[0.5, 0.2, 0.2, 0.0],
            prior: &[0.5, 0.25, 0.25, 0.0],
            trials: &[],
            importance,
            progress: &Silent,
        }
    }

    /// Nothing is fitted along.
    static LATENTS: std::sync::LazyLock<Coordinates> = std::sync::LazyLock::new(|| Coordinates::new(&[]));

    pub(super) static WORLD: World = World {
        latents: Latents { density: Some(1.0), friction: Some(0.5), restitution: Some(0.5) },
        effects: vec![],
        engine: Engine::Auto,
    };

    pub(super) fn chosen_with(
        name: &str,
        candidates: &[Candidate],
        n: usize,
        importance: Option<&dyn Importance>,
    ) -> Chosen {
        strategy(name).unwrap().choose(&seen(candidates, &WORLD, importance), n).unwrap()
    }

    fn choose(name: &str, candidates: &[Candidate], n: usize) -> Vec<usize> {
        chosen_with(name, candidates, n, None).indices
    }

    /// Contract of every strategy, on real candidates: n distinct indices, fewer only if there are fewer, always
    /// the same ones, with a surface beside it or, where none is needed, without; and as many as the groups say.
    #[test]
    fn every_strategy_keeps_its_contract() {
        let tasks = (family("basketball").unwrap().tasks)();
        let candidates =
            candidates(&tasks, 40, &WORLD, &mut crate::rng::stream(1, "candidates"), &Silent).unwrap();
        let slope = Slope([0.0, 0.4, -2.0]);
        for strategy in REGISTRY {
            let name = strategy.name();
            for importance in [Some(&slope as &dyn Importance), None] {
                if strategy.needs_importance() && importance.is_none() {
                    continue;
                }
                for n in [0, 1, 7, 40, 100] {
                    let situation = Situation { tasks: &tasks, ..seen(&candidates, &WORLD, importance) };
                    let chosen = strategy.choose(&situation, n).unwrap();
                    assert_eq!(chosen, strategy.choose(&situation, n).unwrap(), "{name}");
                    let mut distinct = chosen.indices.clone();
                    distinct.sort_unstable();
                    distinct.dedup();
                    assert_eq!(distinct.len(), n.min(40), "{name} for {n}");
                    assert!(
                        chosen.indices.len() == distinct.len() && distinct.iter().all(|i| *i < 40),
                        "{name}"
                    );
                    if let Some(groups) = chosen.groups {
                        assert_eq!(groups.collisions + groups.rolling, chosen.indices.len(), "{name}");
                    }
                }
                let nothing = seen(&[], &WORLD, importance);
                assert!(strategy.choose(&nothing, 5).unwrap().indices.is_empty(), "{name}");
            }
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

    /// In bowling the paper's count; in basketball, where only one body moves, the ball's contacts with the plank;
    /// with a single carrier, contacts with anything.
    #[test]
    fn collisions_are_contacts_of_what_carries_the_latents() {
        let simulated = |name: &str, carriers: Option<&[&str]>| {
            let tasks = (family(name).unwrap().tasks)();
            let drawn = draw(&tasks[..5], 60, &mut crate::rng::stream(2, "candidates")).unwrap();
            let mut scenes: Vec<Scene> = drawn.into_iter().map(|(_, _, scene)| *scene).collect();
            for scene in &mut scenes {
                let named = |c: &[&str]| c.iter().map(|c| c.to_string()).collect();
                scene.carriers = carriers.map(named).or(scene.carriers.take());
            }
            let rollout = |scene| Rollout { scene, latents: WORLD.latents, effects: &[], stop: false };
            let rollouts: Vec<Rollout> = scenes.iter().map(rollout).collect();
            let found = crate::world::simulate(&rollouts, Engine::Auto).unwrap();
            scenes.into_iter().zip(found).collect::<Vec<_>>()
        };
        let total = |found: &[(Scene, Trajectory)]| -> u32 {
            found.iter().map(|(scene, t)| collisions_of(scene, t)).sum()
        };
        let bowling = simulated("bowling", None);
        assert!(
            bowling.iter().all(|(scene, t)| collisions_of(scene, t) == t.collisions) && total(&bowling) > 20
        );
        let basketball = simulated("basketball", None);
        for (scene, t) in &basketball {
            let on_plank = t.events.iter().filter(|e| e.between.iter().any(|name| name == "plank")).count();
            assert_eq!((collisions_of(scene, t) as usize, t.collisions), (on_plank, 0));
        }
        assert!(total(&basketball) > 10);
        let alone = simulated("basketball", Some(&["ball"]));
        assert!(alone.iter().all(|(scene, t)| collisions_of(scene, t) as usize == t.events.len()));
        assert!(total(&alone) > total(&basketball));
    }
}
