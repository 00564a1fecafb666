//! Candidate actions and their simulated outcomes.

use rand::RngExt;

use crate::error::{Error, Result};
use crate::progress::Progress;
use crate::rng::Stream;
use crate::task::scene::EffectTerm;
use crate::task::{Placement, Scene, Task, ValidAction};
use crate::trajectory::{Contact, Trajectory};
use crate::world::{Engine, Latents, Rollout, Simulator};

/// A valid action and its simulated outcome.
#[derive(Clone, Debug)]
pub struct ActionCandidate {
    /// Index into the tasks the candidates were drawn for.
    pub task: usize,
    /// The action.
    pub action: ValidAction,
    /// Collisions between two bodies that carry the latent factors; see [`informative_collisions`].
    pub collisions: u32,
    /// Body time steps on a surface that carries the latents.
    pub rolling_steps: u32,
}

/// The simulation in which candidates are evaluated.
#[derive(Clone, Debug)]
pub struct CandidateSimulation {
    /// The current estimate.
    pub latents: Latents,
    /// Effects of the simulation.
    pub effects: Vec<EffectTerm>,
    /// Physics engine.
    pub engine: Engine,
}

/// Draws `count` valid actions over `tasks` and simulates each in `world`, without goals so that every rollout
/// is complete.
pub fn simulate_candidates(
    tasks: &[Task],
    count: usize,
    world: &CandidateSimulation,
    stream: &mut Stream,
    progress: &dyn Progress,
) -> Result<Vec<ActionCandidate>> {
    let drawn = draw_placeable(tasks, count, stream, progress)?;
    let mut found = Vec::with_capacity(drawn.len());
    // Chunks bound memory and allow progress reports and cancellation.
    for chunk in drawn.chunks(256) {
        progress.report("exploring in simulation", found.len() as u64, drawn.len() as u64)?;
        let rollouts: Vec<Rollout> = chunk
            .iter()
            .map(|(_, _, scene)| Rollout {
                latents: world.latents,
                effects: &world.effects,
                stop_at_goal: false,
                ..Rollout::of(scene)
            })
            .collect();
        let counts = Simulator::new(world.engine)
            .budget(&progress)
            .map(&rollouts, |i, t| (informative_collisions(rollouts[i].scene, &t), t.rolling_steps))?;
        found.extend(chunk.iter().zip(counts).map(|((task, action, _), (collisions, rolling_steps))| {
            ActionCandidate { task: *task, action: action.clone(), collisions, rolling_steps }
        }));
    }
    progress.report("exploring in simulation", drawn.len() as u64, drawn.len() as u64)?;
    Ok(found)
}

/// Number of collisions that identify restitution: contact begins between two objects that both carry the
/// latent factors. Where all movable bodies carry them and nothing else does (bowling, and the default), these
/// are the paper's contacts between movable bodies. In basketball they are contacts of the ball with the plank;
/// contacts with floor, walls and basket have known, small coefficients. With a single carrier, its contacts
/// with anything count.
pub fn informative_collisions(scene: &Scene, trajectory: &Trajectory) -> u32 {
    let carries = |name: &str| match &scene.carriers {
        Some(carriers) => carriers.iter().any(|c| c == name),
        None => scene.body(name).is_some(),
    };
    let carriers = scene.carriers.as_ref().map_or(scene.bodies.len(), Vec::len);
    let wanted = if carriers > 1 { 2 } else { 1 };
    let counts = |c: &&Contact| c.between.iter().filter(|name| carries(name)).count() >= wanted;
    trajectory.events.iter().filter(counts).count() as u32
}

/// Random valid pairs of task and discrete action; fails if almost none is valid.
pub(crate) fn draw_placeable(
    tasks: &[Task],
    count: usize,
    stream: &mut Stream,
    progress: &dyn Progress,
) -> Result<Vec<(usize, ValidAction, Box<Scene>)>> {
    if tasks.is_empty() {
        return Err(Error::Failed("there are no tasks to draw actions for".into()));
    }
    let mut drawn = Vec::with_capacity(count);
    let tries = 1000 + 200 * count;
    for _ in 0..tries {
        if drawn.len() == count {
            return Ok(drawn);
        }
        progress.check_stop()?;
        let task = stream.random_range(0..tasks.len());
        let space = tasks[task].actions();
        let action = space.at(stream.random_range(0..space.count()))?;
        if let Placement::Valid(scene) = tasks[task].place(&action) {
            drawn.push((task, action, scene));
        }
    }
    Err(Error::Failed(format!(
        "only {} of {tries} random actions of {:?} were valid; {count} are needed",
        drawn.len(),
        tasks[0].family
    )))
}
