//! TuneNet: a network that compares observations with a simulation and predicts a parameter update, applied
//! iteratively.
//!
//! The network is trained in simulation alone. Parameters are drawn from the prior and all trials' actions are
//! simulated with each. Any two worlds form a training example, with one of them in the role of the real world.
//! So `n` worlds, `n` rollouts a trial, give `n^2` examples.
//!
//! z(k+1) = z(k) + f(o_real, o_sim(z(k))), with f the network, z the parameters and o the observations.
//!
//! Source: Allevato, Schaertl Short, Pryor and Thomaz, TuneNet: one-shot residual tuning for system
//! identification and sim-to-real robot task transfer, CoRL 2019 (the iterated step of its method section).
//!
//! Differences from the source: the network is trained for the given set of trials instead of once for a single
//! experiment. Half of the worlds are close to another one, because the last of several steps is small. The
//! simulated real worlds are observed with the noise of the real one. Observations are positions at a few
//! times, standardised by their variation between worlds. There is one more hidden layer.
//!
//! Range of validity: parameters that the prior supports, and a real world that the simulation can match;
//! otherwise the network extrapolates.

use rand::RngExt;
use rand_distr::{Distribution, StandardNormal};
use serde::{Deserialize, Serialize};

use super::loss::Simulation;
use super::segment::replay_scene;
use crate::error::{Error, Result, check_range};
use crate::neural::{Adam, DenseLayer, cosine_annealing, predict, regression_step, single_thread_pool};
use crate::progress::Progress;
use crate::reality::Trial;
use crate::residual::position_residuals;
use crate::rng::{self, Stream};
use crate::task::Scene;
use crate::trajectory::{Track, Trajectory};
use crate::world::{ParameterVector, Rollout, Simulator};

/// Parameters of the method.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TuneNetConfig {
    /// Number of training worlds; rounded up to an even number.
    pub worlds: usize,
    /// Units of each of the two hidden layers.
    pub hidden: usize,
    /// Gradient updates.
    pub batches: usize,
    pub batch_size: usize,
    /// Initial step size of Adam; decays to zero by a half cosine.
    pub learning_rate: f64,
    /// Number of observation times per trial, evenly spaced.
    pub times: usize,
    /// Parameter updates, starting from the prior mean.
    pub steps: usize,
    /// Standard deviation of the observation noise, m.
    pub noise: f64,
    pub seed: u64,
}

impl TuneNetConfig {
    /// Four thousand worlds, five steps.
    pub fn standard(noise: f64, seed: u64) -> TuneNetConfig {
        TuneNetConfig {
            worlds: 4000,
            hidden: 128,
            batches: 4000,
            batch_size: 128,
            learning_rate: 1e-3,
            times: 12,
            steps: 5,
            noise,
            seed,
        }
    }

    /// Errors name the parameter that is out of range.
    pub fn validate(&self) -> Result<()> {
        check_range("worlds", self.worlds as f64, 4.0, 1e6)?;
        check_range("hidden", self.hidden as f64, 1.0, 4096.0)?;
        check_range("batches", self.batches as f64, 1.0, 1e6)?;
        check_range("batch_size", self.batch_size as f64, 2.0, 4096.0)?;
        check_range("learning_rate", self.learning_rate, 1e-9, 1.0)?;
        check_range("times", self.times as f64, 1.0, 1000.0)?;
        check_range("steps", self.steps as f64, 1.0, 1000.0)?;
        check_range("noise", self.noise, 0.0, 1e3).map(drop)
    }
}

/// Result of the iteration.
#[derive(Clone, Debug, PartialEq)]
pub struct TuneNetResult {
    pub estimate: ParameterVector,
    /// Parameters before the first step and after each.
    pub path: Vec<ParameterVector>,
    /// Mean training loss over the last tenth of the updates: squared error in units of the prior variance.
    pub loss: f64,
    /// Number of simulated rollouts.
    pub rollouts: u64,
}

/// Estimates the coordinates of a simulation from trials. `prior`: mean and standard deviation per coordinate;
/// a coordinate with standard deviation 0 is fixed at its mean.
pub fn tune(
    trials: &[Trial],
    prior: &[(f64, f64)],
    simulation: Simulation,
    config: &TuneNetConfig,
    progress: &dyn Progress,
) -> Result<TuneNetResult> {
    config.validate()?;
    let searched: Vec<usize> = (0..prior.len()).filter(|i| prior[*i].1 > 0.0).collect();
    if prior.len() != simulation.coordinates.len() || searched.is_empty() {
        let allowed = format!(
            "{} coordinates, at least one with a positive standard deviation",
            simulation.coordinates.len()
        );
        return Err(Error::input(
            "prior",
            format!("{} numbers, {} open", prior.len(), searched.len()),
            allowed,
        ));
    }
    if trials.is_empty() {
        return Err(Error::input("trials", "none", "at least one"));
    }
    let simulator = TrainingSimulator::new(trials, simulation, config.times);
    let worlds = sample_worlds(prior, &searched, simulation, config);
    let simulated = simulator.simulate_worlds(&worlds, progress)?;
    let measured = simulator.observations();
    let scaler = FeatureScaler::fit(&simulated, &measured, config.noise);
    if scaler.features.is_empty() {
        let allowed = "trials in which an observation depends on the estimated parameters";
        return Err(Error::input("trials", "nothing that differs between worlds", allowed));
    }
    let mut network = StepNetwork {
        scaler: &scaler,
        simulated: &simulated,
        targets: worlds.iter().map(|w| standardise(w, prior, &searched)).collect(),
        config,
        layers: StepNetwork::initial_layers(2 * scaler.features.len(), searched.len(), config),
    };
    let pool = single_thread_pool()?;
    let loss = network.train(&pool, progress)?;
    let mut path =
        vec![simulation.coordinates.clamp(&prior.iter().map(|p| p.0).collect::<ParameterVector>())];
    for _ in 0..config.steps {
        let mut at = path[path.len() - 1].clone();
        let simulated = simulator.simulate_worlds(std::slice::from_ref(&at), progress)?;
        let step = pool.install(|| predict(&network.layers, &scaler.features_of(&measured, &simulated[0])));
        for (i, step) in searched.iter().zip(step) {
            at[*i] += f64::from(step) * prior[*i].1;
        }
        path.push(simulation.coordinates.clamp(&at));
    }
    let rollouts = ((worlds.len() + config.steps) * trials.len()) as u64;
    Ok(TuneNetResult { estimate: path[path.len() - 1].clone(), path, loss, rollouts })
}

/// Rejected draws of a coordinate before the current value is kept.
const MAX_REDRAWS: usize = 100;

/// Draws worlds from the prior, each followed by one close to it.
fn sample_worlds(
    prior: &[(f64, f64)],
    searched: &[usize],
    simulation: Simulation,
    config: &TuneNetConfig,
) -> Vec<ParameterVector> {
    let mut stream = rng::stream(config.seed, "tunenet worlds");
    let mut all = Vec::with_capacity(config.worlds);
    for _ in 0..config.worlds.div_ceil(2) {
        // Log-uniform from one standard deviation down to a hundredth.
        let near = libm::exp(-stream.random::<f64>() * libm::log(100.0));
        let mut moved = |at: &[f64], share: f64| -> ParameterVector {
            let mut out = simulation.coordinates.clamp(at);
            for i in searched {
                let [low, high] = simulation.coordinates.bounds(*i);
                let mut drawn = (0..MAX_REDRAWS).map(|_| {
                    let z: f64 = StandardNormal.sample(&mut stream);
                    at[*i] + z * share * prior[*i].1
                });
                // Rejection at the bounds, so that worlds do not accumulate there.
                out[*i] = drawn.find(|v| (low..=high).contains(v)).unwrap_or(out[*i]);
            }
            out
        };
        let mean: ParameterVector = prior.iter().map(|p| p.0).collect();
        let one = moved(&mean, 1.0);
        let other = moved(&one, near);
        all.extend([one, other]);
    }
    all
}

/// The searched coordinates in units of the prior's standard deviation.
fn standardise(world: &[f64], prior: &[(f64, f64)], searched: &[usize]) -> Vec<f32> {
    searched.iter().map(|i| (world[*i] / prior[*i].1) as f32).collect()
}

/// Simulates trials in given worlds.
struct TrainingSimulator<'a> {
    scenes: Vec<Scene>,
    /// Observations of each trial at the selected times.
    observed: Vec<Trajectory>,
    simulation: Simulation<'a>,
}

impl<'a> TrainingSimulator<'a> {
    fn new(trials: &[Trial], simulation: Simulation<'a>, times: usize) -> TrainingSimulator<'a> {
        let observed = trials.iter().map(|t| subsample(&t.observed, times)).collect();
        TrainingSimulator { scenes: trials.iter().map(replay_scene).collect(), observed, simulation }
    }

    /// Positions in every world, trials concatenated, m: `[world][coordinate]`. NaN where not observed or where
    /// the world diverged.
    fn simulate_worlds(&self, worlds: &[ParameterVector], progress: &dyn Progress) -> Result<Vec<Vec<f32>>> {
        let all = self.simulation.coordinates;
        let physics: Vec<_> =
            worlds.iter().map(|w| (all.latents(w), all.effects(w, self.simulation.effects))).collect();
        let mut out = vec![Vec::new(); worlds.len()];
        for (k, (observed, scene)) in self.observed.iter().zip(&self.scenes).enumerate() {
            progress.report("simulating trials", k as u64, self.observed.len() as u64)?;
            let rollout =
                |(latents, effects)| Rollout { latents, effects, stop_at_goal: false, ..Rollout::of(scene) };
            let batch: Vec<Rollout> = physics.iter().map(|(l, e)| rollout((*l, e))).collect();
            let positions = flatten_positions(observed);
            let found = Simulator::new(self.simulation.engine).budget(&progress).map(&batch, |_, path| {
                let off = position_residuals(observed, &path);
                positions.iter().zip(off).map(|(observed, off)| (observed - off) as f32).collect::<Vec<f32>>()
            })?;
            out.iter_mut().zip(found).for_each(|(out, loss_of_batch)| out.extend(loss_of_batch));
        }
        Ok(out)
    }

    /// Measured positions in the same order.
    fn observations(&self) -> Vec<f32> {
        self.observed.iter().flat_map(flatten_positions).map(|v| v as f32).collect()
    }
}

/// At most `times` observation times, evenly spaced, including the last.
fn subsample(observed: &Trajectory, times: usize) -> Trajectory {
    let n = observed.times.len();
    let mut kept: Vec<usize> = (1..=times).map(|k| k * n.saturating_sub(1) / times).collect();
    kept.dedup();
    kept.retain(|i| *i < n);
    let of = |column: &[f64]| kept.iter().map(|i| column[*i]).collect::<Vec<f64>>();
    let track = |t: &Track| Track { name: t.name.clone(), x: of(&t.x), y: of(&t.y), ..Track::default() };
    Trajectory {
        times: of(&observed.times),
        bodies: observed.bodies.iter().map(track).collect(),
        ..Trajectory::default()
    }
}

/// Positions in the order of [`differences`].
fn flatten_positions(observed: &Trajectory) -> Vec<f64> {
    observed.bodies.iter().flat_map(|t| t.x.iter().zip(&t.y)).flat_map(|(x, y)| [*x, *y]).collect()
}

/// Selects and scales the network's inputs.
struct FeatureScaler {
    /// Index, mean and standard deviation over worlds, m.
    features: Vec<(usize, f32, f32)>,
    /// Residual, m, up to which the input is about linear; logarithmic beyond.
    linear_range: f32,
}

/// Minimum standard deviation over worlds of an input, m; minimum of [`FeatureScaler::linear_range`], m.
const MIN_SD_M: f32 = 1e-6;
const MIN_LINEAR_RANGE_M: f64 = 1e-3;

impl FeatureScaler {
    /// Fits the scaling to simulated worlds, for coordinates that were measured.
    fn fit(simulated: &[Vec<f32>], measured: &[f32], noise: f64) -> FeatureScaler {
        let moments = |i: usize| {
            let loss_of_batch = || simulated.iter().map(|w| f64::from(w[i])).filter(|v| v.is_finite());
            let n = loss_of_batch().count().max(1) as f64;
            let mean = loss_of_batch().sum::<f64>() / n;
            (i, mean as f32, (loss_of_batch().map(|v| (v - mean).powi(2)).sum::<f64>() / n).sqrt() as f32)
        };
        let observed = (0..measured.len()).filter(|i| measured[*i].is_finite());
        FeatureScaler {
            features: observed.map(moments).filter(|k| k.2 > MIN_SD_M).collect(),
            linear_range: noise.max(MIN_LINEAR_RANGE_M) as f32,
        }
    }

    /// Features of observations compared with a simulation.
    fn features_of(&self, observed: &[f32], simulated: &[f32]) -> Vec<f32> {
        let number = |v: f32| if v.is_finite() { v } else { 0.0 };
        let off = |(i, _, _): &(usize, f32, f32)| {
            number(libm::asinhf((observed[*i] - simulated[*i]) / self.linear_range))
        };
        let at = |(i, mean, sd): &(usize, f32, f32)| number((simulated[*i] - mean) / sd);
        self.features.iter().map(off).chain(self.features.iter().map(at)).collect()
    }
}

/// The network in training.
struct StepNetwork<'a> {
    scaler: &'a FeatureScaler,
    /// Simulated observations by world, and the worlds' parameters in units of the prior's standard deviation.
    simulated: &'a [Vec<f32>],
    targets: Vec<Vec<f32>>,
    config: &'a TuneNetConfig,
    layers: Vec<DenseLayer>,
}

impl StepNetwork<'_> {
    /// Randomly initialised layers.
    fn initial_layers(inputs: usize, outputs: usize, config: &TuneNetConfig) -> Vec<DenseLayer> {
        let mut stream = rng::stream(config.seed, "tunenet weights");
        let h = config.hidden;
        [("first", [h, inputs]), ("second", [h, h]), ("step", [outputs, h])]
            .into_iter()
            .map(|(name, shape)| DenseLayer::random(name, shape, &mut stream))
            .collect()
    }

    /// Trains; returns the mean loss of the last tenth of the updates.
    fn train(&mut self, pool: &rayon::ThreadPool, progress: &dyn Progress) -> Result<f64> {
        let mut stream = rng::stream(self.config.seed, "tunenet batches");
        let (mut adam, batches) = (Adam::new(&self.layers), self.config.batches);
        let (mut loss, last) = (0.0, batches.div_ceil(10));
        for batch in 0..batches {
            if batch.is_multiple_of(50) {
                progress.report("learning to tune", batch as u64, batches as u64)?;
            }
            let loss_of_batch = pool.install(|| self.update(batch, &mut adam, &mut stream));
            if !(loss_of_batch.is_finite() && self.layers.iter().all(DenseLayer::is_finite)) {
                let why = format!("training diverged after batch {batch}: a smaller learning_rate may help");
                return Err(Error::Failed(why));
            }
            if batch + last >= batches {
                loss += loss_of_batch / last as f64;
            }
        }
        Ok(loss)
    }

    /// One gradient update; returns its loss.
    fn update(&mut self, batch: usize, adam: &mut Adam, stream: &mut Stream) -> f64 {
        let (rows, targets): (Vec<_>, Vec<_>) =
            (0..self.config.batch_size).map(|k| self.example(k, stream)).unzip();
        let rate = cosine_annealing(self.config.learning_rate, batch, self.config.batches);
        regression_step(&mut self.layers, adam, &rows, &targets, rate)
    }

    /// A training example: alternately two close worlds and any two worlds.
    fn example(&self, k: usize, stream: &mut Stream) -> (Vec<f32>, Vec<f32>) {
        let n = self.simulated.len();
        let real = stream.random_range(0..n);
        let simulated = if k.is_multiple_of(2) { real ^ 1 } else { stream.random_range(0..n) };
        let noise = self.config.noise as f32;
        let noisy = |v: &f32| {
            let z: f32 = StandardNormal.sample(stream);
            v + noise * z
        };
        let observed: Vec<f32> = self.simulated[real].iter().map(noisy).collect();
        let answer = self.targets[real].iter().zip(&self.targets[simulated]).map(|(r, s)| r - s).collect();
        (self.scaler.features_of(&observed, &self.simulated[simulated]), answer)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::progress::NoProgress;
    use crate::task::{Split, family, split};
    use crate::trajectory::RolloutOutcome;
    use crate::world::{Engine, LINEAR_DRAG, ParameterSpace, Simulator};

    const PRIOR: [(f64, f64); 4] = [(1.0, 0.0), (1.0, 0.5), (0.5, 0.25), (0.2, 0.1)];

    /// Simulated trials of task scenes without an action.
    fn simulated_trials(world: &[f64], coordinates: &ParameterSpace) -> Vec<Trial> {
        let tasks = split(&family("bowling").unwrap().fold(0), Split::Train);
        let mut scenes: Vec<Scene> = tasks.iter().take(3).map(|t| t.scene.clone()).collect();
        // Without the bodies that an action would place.
        scenes.iter_mut().for_each(|s| s.bodies.retain(|b| b.position.is_some()));
        let effects = coordinates.effects(world, &[]);
        let rollouts: Vec<Rollout> = scenes
            .iter()
            .map(|s| Rollout { latents: coordinates.latents(world), effects: &effects, ..Rollout::of(s) })
            .collect();
        let observed = Simulator::new(Engine::Auto).run(&rollouts).unwrap();
        scenes
            .into_iter()
            .zip(observed)
            .map(|(scene, observed)| Trial { name: String::new(), setting: None, scene, observed })
            .collect()
    }

    fn small_config(seed: u64) -> TuneNetConfig {
        TuneNetConfig { worlds: 400, hidden: 32, batches: 400, ..TuneNetConfig::standard(0.0, seed) }
    }

    /// Falling balls identify restitution and drag: the steps reduce the error to less than a quarter, with the
    /// same bits on any number of threads.
    #[test]
    fn converges_to_the_true_parameters() {
        let coordinates = ParameterSpace::new(&[LINEAR_DRAG]);
        let simulation = Simulation { engine: Engine::Auto, effects: &[], coordinates: &coordinates };
        let truth = [1.0, 1.0, 0.7, 0.3];
        let trials = simulated_trials(&truth, &coordinates);
        let of = |seed| tune(&trials, &PRIOR, simulation, &small_config(seed), &NoProgress).unwrap();
        let found = of(1);
        let off = |at: &[f64]| (2..4).map(|i| ((at[i] - truth[i]) / PRIOR[i].1).powi(2)).sum::<f64>().sqrt();
        assert_eq!(found.path.len(), 6);
        assert!(off(&found.estimate) < 0.25 * off(&found.path[0]), "{:?}", found.path);
        assert_eq!(found.estimate[0], 1.0, "a fixed coordinate stays");
        let pool = rayon::ThreadPoolBuilder::new().num_threads(3).build().unwrap();
        assert_eq!(found, pool.install(|| of(1)), "a seed decides every bit");
        assert_ne!(found.estimate, of(2).estimate);
        assert_eq!(found.rollouts, 3 * 405);
    }

    #[test]
    fn rejects_uninformative_input() {
        let coordinates = ParameterSpace::new(&[]);
        let simulation = Simulation { engine: Engine::Auto, effects: &[], coordinates: &coordinates };
        let ask = |trials: &[Trial], prior: &[(f64, f64)], config: TuneNetConfig| {
            tune(trials, prior, simulation, &config, &NoProgress).unwrap_err().to_string()
        };
        let trials = simulated_trials(&[1.0, 1.0, 0.5, 0.0], &coordinates);
        assert!(ask(&[], &PRIOR, small_config(1)).contains("trials"));
        assert!(ask(&trials, &[(1.0, 0.0); 4], small_config(1)).contains("prior"));
        assert!(ask(&trials, &PRIOR[..3], small_config(1)).contains("prior"));
        assert!(ask(&trials, &PRIOR, TuneNetConfig { steps: 0, ..small_config(1) }).contains("steps"));
        // Observations that do not depend on the parameters.
        let mut still = trials;
        still.iter_mut().for_each(|t| t.observed.times.truncate(1));
        for track in still.iter_mut().flat_map(|t| &mut t.observed.bodies) {
            *track = Track {
                x: vec![track.x[0]],
                y: vec![track.y[0]],
                name: track.name.clone(),
                ..Track::default()
            };
        }
        assert!(ask(&still, &PRIOR, small_config(1)).contains("differs"));
    }

    #[test]
    fn subsample_includes_the_last_observation() {
        let track = Track {
            name: "a".into(),
            x: (0..8).map(f64::from).collect(),
            y: vec![0.0; 8],
            ..Track::default()
        };
        let path = Trajectory {
            times: (0..8).map(f64::from).collect(),
            bodies: vec![track],
            outcome: RolloutOutcome::default(),
            ..Trajectory::default()
        };
        let of = |times| subsample(&path, times).times;
        assert_eq!(of(3), [2.0, 4.0, 7.0]);
        assert_eq!(of(100).last(), Some(&7.0));
        assert_eq!(of(100).len(), 8);
        assert!(subsample(&Trajectory::default(), 3).times.is_empty());
    }

    /// Constant or unobserved coordinates are excluded; diverged ones become 0.
    #[test]
    fn scaler_keeps_informative_features() {
        let worlds = [vec![1.0, 0.0, 5.0], vec![1.0, 2.0, 5.5], vec![1.0, f32::NAN, 6.0]];
        let scaler = FeatureScaler::fit(&worlds, &[1.0, 1.0, f32::NAN], 0.0);
        assert_eq!(scaler.features, [(1, 1.0, 1.0)]);
        assert_eq!(scaler.features_of(&[1.0, 1.0, 0.0], &worlds[1]), [libm::asinhf(-1000.0), 1.0]);
        assert_eq!(scaler.features_of(&[1.0, 1.0, 0.0], &worlds[2]), [0.0, 0.0]);
    }

    /// Every other world is close to its predecessor, none is out of bounds, and few are at a bound.
    #[test]
    fn worlds_are_sampled_in_close_pairs() {
        let coordinates = ParameterSpace::new(&[LINEAR_DRAG]);
        let simulation = Simulation { engine: Engine::Auto, effects: &[], coordinates: &coordinates };
        let all = sample_worlds(&PRIOR, &[1, 2, 3], simulation, &small_config(4));
        assert_eq!(all.len(), 400);
        let apart = |pair: &[ParameterVector]| ((pair[0][2] - pair[1][2]) / PRIOR[2].1).abs();
        let near = all.chunks(2).filter(|pair| apart(pair) < 0.3).count();
        let strange = all[1..399].chunks(2).filter(|pair| apart(pair) < 0.3).count();
        assert!(near > 130 && strange < 60, "{near} {strange}");
        assert!(all.iter().all(|w| coordinates.clamp(w) == *w && w[0] == 1.0));
        assert!(all.iter().filter(|w| w[3] == 0.0).count() < 4);
    }
}
