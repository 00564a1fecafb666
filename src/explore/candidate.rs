//! Candidate actions, tried on the simulation.

use rand::RngExt;

use crate::error::{Error, Result};
use crate::progress::Progress;
use crate::rng::Stream;
use crate::task::scene::EffectTerm;
use crate::task::{Placement, Scene, Task, ValidAction};
use crate::trajectory::{Contact, Trajectory};
use crate::world::{Engine, Latents, Rollout, simulate_map};

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
                latents: world.latents,
                effects: &world.effects,
                stop: false,
                ..Rollout::of(scene)
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
