//! Rollouts of one scene from arrays of initial states, latents and effect parameters, as arrays.

use std::collections::BTreeMap;
use std::path::Path;

use iplw::error::{Error, Result};
use iplw::task::Scene;
use iplw::task::scene::EffectTerm;
use iplw::trajectory::{Termination, Trajectory};
use iplw::world::effect::resolve;
use iplw::world::{Engine, Latents, Rollout, Simulator, select_engine};
use rayon::prelude::*;
use serde_json::json;

use super::arrays::npy::{I8, I32};
use super::arrays::npz::{self, ArchiveWriter, NumberArray, little_endian};
use super::output;

/// Upper bound of the samples of all rollouts together, bytes.
const MAX_SAMPLE_BYTES: usize = 8 << 30;
/// Rollouts simulated together: at the end of a batch some threads wait for others.
const BATCH: usize = 1 << 15;
/// Numbers of a body's state in a sample: x, y, angle, vx, vy, omega.
const STATE_NUMBERS: usize = 6;

/// A scene and how to simulate its rollouts.
pub struct ArrayRollouts<'a> {
    pub scene: &'a Scene,
    pub engine: Engine,
    /// Whether to write samples, and not only outcomes.
    pub samples: bool,
}

/// Reads arrays, simulates, and writes arrays.
pub fn run(config: &ArrayRollouts, input: &Path, out: &Path) -> Result<()> {
    let inputs = Inputs::new(config.scene, npz::read(input)?).map_err(|e| e.in_file(input.display()))?;
    output::prepare_file("--out", out)?;
    let engine = select_engine(config.engine, &Rollout::of(&inputs.scene(0)?))?;
    let mut results = Results::new(config, inputs.count)?;
    let progress = output::TerminalProgress::new();
    let size = config.engine.batch_size(BATCH);
    for start in (0..inputs.count).step_by(size) {
        iplw::progress::Progress::report(&progress, "rollouts", start as u64, inputs.count as u64)?;
        let batch: Vec<usize> = (start..(start + size).min(inputs.count)).collect();
        let scenes: Vec<Scene> = batch.par_iter().map(|i| inputs.scene(*i)).collect::<Result<_>>()?;
        let effects: Vec<Vec<EffectTerm>> = batch.iter().map(|i| inputs.effects(*i)).collect();
        let rollouts: Vec<Rollout> = batch
            .iter()
            .zip(scenes.iter().zip(&effects))
            .map(|(i, (scene, effects))| Rollout {
                latents: inputs.latents(*i),
                effects,
                ..Rollout::of(scene)
            })
            .collect();
        let mut simulator = Simulator::new(config.engine);
        if !config.samples {
            simulator = simulator.without_samples();
        }
        let trajectories = simulator.run(&rollouts)?;
        results.add(start, &trajectories)?;
        // On all threads: freeing a hundred thousand scenes and trajectories takes as long as some rollouts.
        drop(rollouts);
        rayon::join(|| trajectories.into_par_iter().for_each(drop), || scenes.into_par_iter().for_each(drop));
    }
    progress.clear();
    results.write(out, config.scene, engine)
}

/// The arrays of the input.
struct Inputs<'a> {
    base: &'a Scene,
    count: usize,
    arrays: BTreeMap<String, NumberArray>,
    /// Effect, its parameter, and the array's name.
    parameters: Vec<(String, String, String)>,
}

const LATENTS: [&str; 3] = ["density", "friction", "restitution"];

impl<'a> Inputs<'a> {
    fn new(base: &'a Scene, arrays: BTreeMap<String, NumberArray>) -> Result<Inputs<'a>> {
        let bodies = base.bodies.len();
        let Some(count) = arrays.values().map(|array| array.shape.first().copied().unwrap_or(0)).max() else {
            return Err(Error::input(
                "arrays",
                "none",
                "at least one of position, angle, velocity, angular_velocity, density, friction, restitution or EFFECT.PARAMETER",
            ));
        };
        let mut parameters = Vec::new();
        for (name, array) in &arrays {
            let wanted: Vec<usize> = match name.as_str() {
                "position" | "velocity" => vec![count, bodies, 2],
                "angle" | "angular_velocity" => vec![count, bodies],
                latent if LATENTS.contains(&latent) => vec![count],
                other => {
                    let (effect, parameter) = other.split_once('.').ok_or_else(|| {
                        Error::input(other, "unknown", "position, angle, velocity, angular_velocity, density, friction, restitution or EFFECT.PARAMETER")
                    })?;
                    for (i, value) in array.values.iter().enumerate() {
                        let value = BTreeMap::from([(parameter.into(), *value)]);
                        let term = EffectTerm { name: effect.into(), parameters: value };
                        resolve(&term, other).map_err(|e| in_rollout(e, i))?;
                    }
                    parameters.push((effect.to_string(), parameter.to_string(), name.clone()));
                    vec![count]
                }
            };
            if array.shape != wanted || count == 0 {
                let value = format!("an array of shape {:?}", array.shape);
                return Err(Error::input(
                    name,
                    value,
                    format!("shape {wanted:?}: rollouts, then the scene's bodies"),
                ));
            }
        }
        let inputs = Inputs { base, count, arrays, parameters };
        (0..count).try_for_each(|i| inputs.latents(i).validate().map_err(|e| in_rollout(e, i)))?;
        Ok(inputs)
    }

    fn value(&self, name: &str, index: usize) -> Option<f64> {
        Some(self.arrays.get(name)?.values[index])
    }

    /// The scene of a rollout.
    fn scene(&self, rollout: usize) -> Result<Scene> {
        let mut scene = self.base.clone();
        let count = scene.bodies.len();
        for (i, body) in scene.bodies.iter_mut().enumerate() {
            let at = rollout * count + i;
            let pair = |name: &str| Some([self.value(name, 2 * at)?, self.value(name, 2 * at + 1)?]);
            body.position = pair("position").or(body.position);
            body.velocity = pair("velocity").unwrap_or(body.velocity);
            body.angle = self.value("angle", at).unwrap_or(body.angle);
            body.angular_velocity = self.value("angular_velocity", at).unwrap_or(body.angular_velocity);
        }
        scene.validate().map_err(|e| in_rollout(e, rollout))?;
        Ok(scene)
    }

    fn latents(&self, rollout: usize) -> Latents {
        let [density, friction, restitution] = LATENTS.map(|name| self.value(name, rollout));
        Latents { density, friction, restitution }
    }

    fn effects(&self, rollout: usize) -> Vec<EffectTerm> {
        let mut terms: Vec<EffectTerm> = Vec::new();
        for (effect, parameter, name) in &self.parameters {
            let value = self.value(name, rollout).unwrap_or_default();
            match terms.iter_mut().find(|term| term.name == *effect) {
                Some(term) => _ = term.parameters.insert(parameter.clone(), value),
                None => terms.push(EffectTerm {
                    name: effect.clone(),
                    parameters: BTreeMap::from([(parameter.clone(), value)]),
                }),
            }
        }
        terms
    }
}

/// Adds the rollout to an error.
fn in_rollout(error: Error, rollout: usize) -> Error {
    error.map_input(|input| input.place = format!("rollout {rollout}"))
}

/// The arrays of the output.
struct Results {
    times: Vec<f64>,
    /// Whether samples are kept, and not only outcomes.
    samples: bool,
    bodies: usize,
    /// By rollout, sample and body; NaN after the end of a rollout.
    position: Vec<f64>,
    angle: Vec<f64>,
    velocity: Vec<f64>,
    angular_velocity: Vec<f64>,
    outcomes: Vec<Outcome>,
}

/// The outcome of a rollout.
#[derive(Clone, Copy, Default)]
struct Outcome {
    /// 1 solved, 0 not, -1 without a goal.
    solved: i8,
    /// 0 all steps, 1 at the goal, 2 diverged, 3 blocked.
    end: i8,
    steps: i32,
    collisions: i32,
    rolling_steps: i32,
}

impl Outcome {
    fn of(trajectory: &Trajectory) -> Outcome {
        let end = match trajectory.outcome.end {
            Termination::Horizon => 0,
            Termination::Goal => 1,
            Termination::Diverged => 2,
            Termination::Blocked { .. } => 3,
        };
        Outcome {
            solved: trajectory.outcome.solved.map_or(-1, i8::from),
            end,
            steps: trajectory.outcome.steps as i32,
            collisions: trajectory.collisions as i32,
            rolling_steps: trajectory.rolling_steps as i32,
        }
    }
}

impl Results {
    fn new(config: &ArrayRollouts, count: usize) -> Result<Results> {
        let scene = config.scene;
        let bodies = scene.bodies.len();
        let times = if config.samples { scene.observation_times() } else { Vec::new() };
        let numbers = times.len() * bodies * count;
        let bytes = numbers.saturating_mul(8 * STATE_NUMBERS);
        if bytes > MAX_SAMPLE_BYTES {
            return Err(Error::input(
                "rollouts",
                format!("{count} with {} samples of {bodies} bodies: {} GB", times.len(), bytes >> 30),
                format!(
                    "at most {} GB of samples: take fewer rollouts, a larger `observe_every`, or --no-samples",
                    MAX_SAMPLE_BYTES >> 30
                ),
            ));
        }
        let missing = |width: usize| vec![f64::NAN; numbers * width];
        Ok(Results {
            times,
            samples: config.samples,
            bodies,
            position: missing(2),
            angle: missing(1),
            velocity: missing(2),
            angular_velocity: missing(1),
            outcomes: vec![Outcome::default(); count],
        })
    }

    /// Adds the results of the rollouts from `start` on.
    fn add(&mut self, start: usize, trajectories: &[Trajectory]) -> Result<()> {
        let range = start..start + trajectories.len();
        self.outcomes[range.clone()]
            .par_iter_mut()
            .zip(trajectories)
            .for_each(|(to, t)| *to = Outcome::of(t));
        if !self.samples {
            return Ok(());
        }
        let (bodies, width) = (self.bodies, self.times.len() * self.bodies);
        if let Some(other) = trajectories.iter().find(|t| t.times.len() > self.times.len()) {
            let value = format!("{} samples in a rollout", other.times.len());
            return Err(Error::input("effects", value, "effects that keep the clock, or --no-samples"));
        }
        let fill = |to: &mut [f64], parts: usize, of: fn(&iplw::trajectory::Track, usize, usize) -> f64| {
            let rows = &mut to[parts * width * range.start..parts * width * range.end];
            rows.par_chunks_mut(parts * width).zip(trajectories).for_each(|(row, trajectory)| {
                for (b, track) in trajectory.bodies.iter().enumerate() {
                    for k in 0..track.len() {
                        for part in 0..parts {
                            row[(k * bodies + b) * parts + part] = of(track, k, part);
                        }
                    }
                }
            });
        };
        fill(&mut self.position, 2, |track, k, part| [track.x[k], track.y[k]][part]);
        fill(&mut self.angle, 1, |track, k, _| track.angle[k]);
        fill(&mut self.velocity, 2, |track, k, part| [track.vx[k], track.vy[k]][part]);
        fill(&mut self.angular_velocity, 1, |track, k, _| track.omega[k]);
        Ok(())
    }

    /// Writes the archive; arrays are freed as soon as they are in it.
    fn write(mut self, out: &Path, scene: &Scene, engine: Engine) -> Result<()> {
        let mut file = ArchiveWriter::new();
        let (count, samples, bodies) = (self.outcomes.len(), self.times.len(), self.bodies);
        if self.samples {
            file.add_f64("t", &[samples], &self.times)?;
            file.add_f64("position", &[count, samples, bodies, 2], &std::mem::take(&mut self.position))?;
            file.add_f64("angle", &[count, samples, bodies], &std::mem::take(&mut self.angle))?;
            file.add_f64("velocity", &[count, samples, bodies, 2], &std::mem::take(&mut self.velocity))?;
            file.add_f64(
                "angular_velocity",
                &[count, samples, bodies],
                &std::mem::take(&mut self.angular_velocity),
            )?;
        }
        let bytes =
            |of: fn(&Outcome) -> i8| -> Vec<u8> { self.outcomes.iter().map(|o| of(o) as u8).collect() };
        let numbers = |of: fn(&Outcome) -> i32| -> Vec<u8> {
            little_endian(&self.outcomes.iter().map(of).collect::<Vec<i32>>(), i32::to_le_bytes)
        };
        file.add("solved", I8, &[count], &bytes(|o| o.solved))?;
        file.add("end", I8, &[count], &bytes(|o| o.end))?;
        file.add("steps", I32, &[count], &numbers(|o| o.steps))?;
        file.add("collisions", I32, &[count], &numbers(|o| o.collisions))?;
        file.add("rolling_steps", I32, &[count], &numbers(|o| o.rolling_steps))?;
        let names: Vec<&str> = scene.bodies.iter().map(|b| b.name.as_str()).collect();
        file.add_texts("bodies", &[bodies], &names)?;
        let about = json!({"version": env!("CARGO_PKG_VERSION"), "engine": engine.name(), "scene": scene})
            .to_string();
        file.add_texts("about", &[], &[&about])?;
        output::write_whole(out, &file.finish()?)
    }
}
