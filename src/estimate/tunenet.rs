//! A learned step of the latents: a network looks at what was seen beside what the simulation makes of it, and says how the
//! simulation's numbers should change; simulate again, look again.
//!
//! The network learns in simulation alone. Worlds are drawn from the prior and all trials' actions carried out in each; any two worlds
//! then are an example, one of them played as the real one, whose answer is known. So `n` worlds, `n` rollouts a trial, are `n^2`
//! examples.
//!
//! z(k+1) = z(k) + f(o_real, o_sim(z(k))), f the network, z what is to be found, o what is seen.
//!
//! Source: Allevato, Schaertl Short, Pryor and Thomaz, TuneNet: one-shot residual tuning for system identification and sim-to-real
//! robot task transfer, CoRL 2019 (the iterated step of its method section).
//!
//! Differences from the source: a network is trained for the experiments at hand, however many, rather than once for one experiment;
//! half of the worlds lie near another, since the last of several steps is a small one; the played real worlds are seen with the noise
//! of the real one; what is seen is positions at a few times, standardised by how worlds differ; a hidden layer more.
//!
//! Range of validity: of numbers that the prior finds unlikely, and of a real world that the simulation cannot be, no example was seen.

use rand::RngExt;
use rand_distr::{Distribution, StandardNormal};
use serde::{Deserialize, Serialize};

use super::fitness::Simulation;
use super::piece::replay;
use crate::error::{Error, Result, within};
use crate::neural::{Adam, Layer, answered, half_cosine, one_thread, regress};
use crate::progress::Progress;
use crate::reality::Trial;
use crate::residual::differences;
use crate::rng::{self, Stream};
use crate::task::Scene;
use crate::trajectory::{Track, Trajectory};
use crate::world::{Rollout, Sample, simulate_map};

/// Knobs of the method.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TuneNetConfig {
    /// Worlds that examples are pairs of; made even.
    pub worlds: usize,
    /// Hidden units of each of two layers.
    pub hidden: usize,
    /// Updates, and examples of each.
    pub batches: usize,
    pub batch_size: usize,
    /// Adam's step size at the start; it falls by a half cosine to zero.
    pub learning_rate: f64,
    /// Times at which a trial is looked at, evenly spread.
    pub times: usize,
    /// Steps from the prior's mean on.
    pub steps: usize,
    /// Standard deviation of what is seen, m.
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

    /// Errors name what is out of range.
    pub fn validate(&self) -> Result<()> {
        within("worlds", self.worlds as f64, 4.0, 1e6)?;
        within("hidden", self.hidden as f64, 1.0, 4096.0)?;
        within("batches", self.batches as f64, 1.0, 1e6)?;
        within("batch_size", self.batch_size as f64, 2.0, 4096.0)?;
        within("learning_rate", self.learning_rate, 1e-9, 1.0)?;
        within("times", self.times as f64, 1.0, 1000.0)?;
        within("steps", self.steps as f64, 1.0, 1000.0)?;
        within("noise", self.noise, 0.0, 1e3).map(drop)
    }
}

/// Where the steps led.
#[derive(Clone, Debug, PartialEq)]
pub struct Tuned {
    pub estimate: Sample,
    /// Before the first step and after each.
    pub path: Vec<Sample>,
    /// Mean loss of the last tenth of the updates: squares of what an example's answer is off by, in the prior's variances.
    pub loss: f64,
    /// Rollouts of the simulation.
    pub rollouts: u64,
}

/// The coordinates of a simulation that trials ask for, from where it is believed to be. `prior`: mean and standard deviation by
/// coordinate; one without any stays at its mean.
pub fn tune(
    trials: &[Trial],
    prior: &[(f64, f64)],
    simulation: Simulation,
    config: &TuneNetConfig,
    progress: &dyn Progress,
) -> Result<Tuned> {
    config.validate()?;
    let open: Vec<usize> = (0..prior.len()).filter(|i| prior[*i].1 > 0.0).collect();
    if prior.len() != simulation.coordinates.len() || open.is_empty() {
        let allowed = format!("{} numbers, one of them not sure at least", simulation.coordinates.len());
        return Err(Error::input("prior", format!("{} numbers, {} open", prior.len(), open.len()), allowed));
    }
    if trials.is_empty() {
        return Err(Error::input("trials", "none", "one at least"));
    }
    let bench = Bench::new(trials, simulation, config.times);
    let worlds = worlds(prior, &open, simulation, config);
    let shown = bench.shown(&worlds, progress)?;
    let measured = bench.measured();
    let gauge = Gauge::of(&shown, &measured, config.noise);
    if gauge.kept.is_empty() {
        let allowed = "trials in which something that is seen depends on the numbers to be found";
        return Err(Error::input("trials", "nothing that differs between worlds", allowed));
    }
    let mut student = Student {
        gauge: &gauge,
        shown: &shown,
        answers: worlds.iter().map(|w| scaled(w, prior, &open)).collect(),
        config,
        layers: Student::layers(2 * gauge.kept.len(), open.len(), config),
    };
    let pool = one_thread()?;
    let loss = student.learn(&pool, progress)?;
    let mut path = vec![simulation.coordinates.clamp(&prior.iter().map(|p| p.0).collect::<Sample>())];
    for _ in 0..config.steps {
        let mut at = path[path.len() - 1].clone();
        let shown = bench.shown(std::slice::from_ref(&at), progress)?;
        let step = pool.install(|| answered(&student.layers, &gauge.row(&measured, &shown[0])));
        for (i, step) in open.iter().zip(step) {
            at[*i] += f64::from(step) * prior[*i].1;
        }
        path.push(simulation.coordinates.clamp(&at));
    }
    let rollouts = ((worlds.len() + config.steps) * trials.len()) as u64;
    Ok(Tuned { estimate: path[path.len() - 1].clone(), path, loss, rollouts })
}

/// Draws of a number beyond its bounds before it stays where it is.
const REDRAWN: usize = 100;

/// Worlds drawn from the prior, each followed by one near it.
fn worlds(
    prior: &[(f64, f64)],
    open: &[usize],
    simulation: Simulation,
    config: &TuneNetConfig,
) -> Vec<Sample> {
    let mut stream = rng::stream(config.seed, "tunenet worlds");
    let mut all = Vec::with_capacity(config.worlds);
    for _ in 0..config.worlds.div_ceil(2) {
        // From a standard deviation down to a hundredth.
        let near = libm::exp(-stream.random::<f64>() * libm::log(100.0));
        let mut moved = |at: &[f64], share: f64| -> Sample {
            let mut out = simulation.coordinates.clamp(at);
            for i in open {
                let [low, high] = simulation.coordinates.bounds(*i);
                let mut drawn = (0..REDRAWN).map(|_| {
                    let z: f64 = StandardNormal.sample(&mut stream);
                    at[*i] + z * share * prior[*i].1
                });
                // What is beyond a bound is drawn again, so that worlds do not pile up there.
                out[*i] = drawn.find(|v| (low..=high).contains(v)).unwrap_or(out[*i]);
            }
            out
        };
        let mean: Sample = prior.iter().map(|p| p.0).collect();
        let one = moved(&mean, 1.0);
        let other = moved(&one, near);
        all.extend([one, other]);
    }
    all
}

/// The open coordinates in the prior's standard deviations.
fn scaled(world: &[f64], prior: &[(f64, f64)], open: &[usize]) -> Vec<f32> {
    open.iter().map(|i| (world[*i] / prior[*i].1) as f32).collect()
}

/// What is simulated and looked at.
struct Bench<'a> {
    scenes: Vec<Scene>,
    /// What was seen of each trial at the times at which it is looked at.
    seen: Vec<Trajectory>,
    simulation: Simulation<'a>,
}

impl<'a> Bench<'a> {
    fn new(trials: &[Trial], simulation: Simulation<'a>, times: usize) -> Bench<'a> {
        let seen = trials.iter().map(|t| thinned(&t.observed, times)).collect();
        Bench { scenes: trials.iter().map(replay).collect(), seen, simulation }
    }

    /// Positions in every world, all trials behind each other, m: `[world][number]`. Not a number where nothing was seen, or a world
    /// diverged.
    fn shown(&self, worlds: &[Sample], progress: &dyn Progress) -> Result<Vec<Vec<f32>>> {
        let all = self.simulation.coordinates;
        let physics: Vec<_> =
            worlds.iter().map(|w| (all.latents(w), all.effects(w, self.simulation.effects))).collect();
        let mut out = vec![Vec::new(); worlds.len()];
        for (k, (seen, scene)) in self.seen.iter().zip(&self.scenes).enumerate() {
            progress.report("simulating trials", k as u64, self.seen.len() as u64)?;
            let rollout =
                |(latents, effects)| Rollout { latents, effects, stop: false, ..Rollout::of(scene) };
            let batch: Vec<Rollout> = physics.iter().map(|(l, e)| rollout((*l, e))).collect();
            let positions = positions(seen);
            let found = simulate_map(&batch, self.simulation.engine, |_, path| {
                let off = differences(seen, &path);
                positions.iter().zip(off).map(|(seen, off)| (seen - off) as f32).collect::<Vec<f32>>()
            })?;
            out.iter_mut().zip(found).for_each(|(out, own)| out.extend(own));
        }
        Ok(out)
    }

    /// What was measured, in the same order.
    fn measured(&self) -> Vec<f32> {
        self.seen.iter().flat_map(positions).map(|v| v as f32).collect()
    }
}

/// At most so many of the times, evenly spread, the last among them.
fn thinned(observed: &Trajectory, times: usize) -> Trajectory {
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

/// In the order of [`differences`].
fn positions(seen: &Trajectory) -> Vec<f64> {
    seen.bodies.iter().flat_map(|t| t.x.iter().zip(&t.y)).flat_map(|(x, y)| [*x, *y]).collect()
}

/// What of all that is seen a network looks at, and how large it is there.
struct Gauge {
    /// Index, mean over worlds and standard deviation, m.
    kept: Vec<(usize, f32, f32)>,
    /// Difference, m, up to which it counts in proportion; beyond it its logarithm does.
    fine: f32,
}

/// Standard deviation over worlds, m, below which nothing is told; least [`Gauge::fine`], m.
const STILL: f32 = 1e-6;
const FINE: f64 = 1e-3;

impl Gauge {
    /// Of what worlds show, where `measured` was seen.
    fn of(shown: &[Vec<f32>], measured: &[f32], noise: f64) -> Gauge {
        let moments = |i: usize| {
            let own = || shown.iter().map(|w| f64::from(w[i])).filter(|v| v.is_finite());
            let n = own().count().max(1) as f64;
            let mean = own().sum::<f64>() / n;
            (i, mean as f32, (own().map(|v| (v - mean).powi(2)).sum::<f64>() / n).sqrt() as f32)
        };
        let seen = (0..measured.len()).filter(|i| measured[*i].is_finite());
        Gauge { kept: seen.map(moments).filter(|k| k.2 > STILL).collect(), fine: noise.max(FINE) as f32 }
    }

    /// What is seen of one world beside what another shows.
    fn row(&self, seen: &[f32], shown: &[f32]) -> Vec<f32> {
        let number = |v: f32| if v.is_finite() { v } else { 0.0 };
        let off = |(i, _, _): &(usize, f32, f32)| number(libm::asinhf((seen[*i] - shown[*i]) / self.fine));
        let at = |(i, mean, sd): &(usize, f32, f32)| number((shown[*i] - mean) / sd);
        self.kept.iter().map(off).chain(self.kept.iter().map(at)).collect()
    }
}

/// A network that learns.
struct Student<'a> {
    gauge: &'a Gauge,
    /// By world: what it shows, and what its numbers are in the prior's standard deviations.
    shown: &'a [Vec<f32>],
    answers: Vec<Vec<f32>>,
    config: &'a TuneNetConfig,
    layers: Vec<Layer>,
}

impl Student<'_> {
    /// The layers as they begin.
    fn layers(inputs: usize, outputs: usize, config: &TuneNetConfig) -> Vec<Layer> {
        let mut stream = rng::stream(config.seed, "tunenet weights");
        let h = config.hidden;
        [("first", [h, inputs]), ("second", [h, h]), ("step", [outputs, h])]
            .into_iter()
            .map(|(name, shape)| Layer::drawn(name, shape, &mut stream))
            .collect()
    }

    /// The mean loss of the last tenth of the updates.
    fn learn(&mut self, pool: &rayon::ThreadPool, progress: &dyn Progress) -> Result<f64> {
        let mut stream = rng::stream(self.config.seed, "tunenet batches");
        let (mut adam, batches) = (Adam::new(&self.layers), self.config.batches);
        let (mut loss, last) = (0.0, batches.div_ceil(10));
        for batch in 0..batches {
            if batch.is_multiple_of(50) {
                progress.report("learning to tune", batch as u64, batches as u64)?;
            }
            let own = pool.install(|| self.update(batch, &mut adam, &mut stream));
            if !(own.is_finite() && self.layers.iter().all(Layer::is_finite)) {
                let why = format!("training diverged after batch {batch}: a smaller learning_rate may help");
                return Err(Error::Failed(why));
            }
            if batch + last >= batches {
                loss += own / last as f64;
            }
        }
        Ok(loss)
    }

    /// One update; its loss.
    fn update(&mut self, batch: usize, adam: &mut Adam, stream: &mut Stream) -> f64 {
        let (rows, answers): (Vec<_>, Vec<_>) =
            (0..self.config.batch_size).map(|k| self.example(k, stream)).unzip();
        let rate = half_cosine(self.config.learning_rate, batch, self.config.batches);
        regress(&mut self.layers, adam, &rows, &answers, rate)
    }

    /// A row and its answer: two worlds near each other, or any two, in turn.
    fn example(&self, k: usize, stream: &mut Stream) -> (Vec<f32>, Vec<f32>) {
        let n = self.shown.len();
        let real = stream.random_range(0..n);
        let simulated = if k.is_multiple_of(2) { real ^ 1 } else { stream.random_range(0..n) };
        let noise = self.config.noise as f32;
        let noisy = |v: &f32| {
            let z: f32 = StandardNormal.sample(stream);
            v + noise * z
        };
        let seen: Vec<f32> = self.shown[real].iter().map(noisy).collect();
        let answer = self.answers[real].iter().zip(&self.answers[simulated]).map(|(r, s)| r - s).collect();
        (self.gauge.row(&seen, &self.shown[simulated]), answer)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::progress::Silent;
    use crate::task::{Split, family, split};
    use crate::trajectory::Outcome;
    use crate::world::{Coordinates, DRAG, Engine, simulate};

    const PRIOR: [(f64, f64); 4] = [(1.0, 0.0), (1.0, 0.5), (0.5, 0.25), (0.2, 0.1)];

    /// Scenes of tasks as they fall by themselves in a world.
    fn measured(world: &[f64], coordinates: &Coordinates) -> Vec<Trial> {
        let tasks = split(&family("bowling").unwrap().fold(0), Split::Train);
        let mut scenes: Vec<Scene> = tasks.iter().take(3).map(|t| t.scene.clone()).collect();
        // Without what an action would place.
        scenes.iter_mut().for_each(|s| s.bodies.retain(|b| b.position.is_some()));
        let effects = coordinates.effects(world, &[]);
        let rollouts: Vec<Rollout> = scenes
            .iter()
            .map(|s| Rollout { latents: coordinates.latents(world), effects: &effects, ..Rollout::of(s) })
            .collect();
        let observed = simulate(&rollouts, Engine::Auto).unwrap();
        scenes
            .into_iter()
            .zip(observed)
            .map(|(scene, observed)| Trial { name: String::new(), setting: None, scene, observed })
            .collect()
    }

    fn small(seed: u64) -> TuneNetConfig {
        TuneNetConfig { worlds: 400, hidden: 32, batches: 400, ..TuneNetConfig::standard(0.0, seed) }
    }

    /// Balls that fall tell how they bounce and what slows them: the steps lead to less than a quarter of the way that was to go, and to the
    /// same bits on any number of threads.
    #[test]
    fn steps_lead_to_a_world_that_shows_the_same() {
        let coordinates = Coordinates::new(&[DRAG]);
        let simulation = Simulation { engine: Engine::Auto, effects: &[], coordinates: &coordinates };
        let truth = [1.0, 1.0, 0.7, 0.3];
        let trials = measured(&truth, &coordinates);
        let of = |seed| tune(&trials, &PRIOR, simulation, &small(seed), &Silent).unwrap();
        let found = of(1);
        let off = |at: &[f64]| (2..4).map(|i| ((at[i] - truth[i]) / PRIOR[i].1).powi(2)).sum::<f64>().sqrt();
        assert_eq!(found.path.len(), 6);
        assert!(off(&found.estimate) < 0.25 * off(&found.path[0]), "{:?}", found.path);
        assert_eq!(found.estimate[0], 1.0, "what is sure stays");
        let pool = rayon::ThreadPoolBuilder::new().num_threads(3).build().unwrap();
        assert_eq!(found, pool.install(|| of(1)), "a seed decides every bit");
        assert_ne!(found.estimate, of(2).estimate);
        assert_eq!(found.rollouts, 3 * 405);
    }

    #[test]
    fn what_cannot_be_learned_from_is_refused() {
        let coordinates = Coordinates::new(&[]);
        let simulation = Simulation { engine: Engine::Auto, effects: &[], coordinates: &coordinates };
        let ask = |trials: &[Trial], prior: &[(f64, f64)], config: TuneNetConfig| {
            tune(trials, prior, simulation, &config, &Silent).unwrap_err().to_string()
        };
        let trials = measured(&[1.0, 1.0, 0.5, 0.0], &coordinates);
        assert!(ask(&[], &PRIOR, small(1)).contains("trials"));
        assert!(ask(&trials, &[(1.0, 0.0); 4], small(1)).contains("prior"));
        assert!(ask(&trials, &PRIOR[..3], small(1)).contains("prior"));
        assert!(ask(&trials, &PRIOR, TuneNetConfig { steps: 0, ..small(1) }).contains("steps"));
        // Nothing that is seen moves differently.
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
        assert!(ask(&still, &PRIOR, small(1)).contains("differs"));
    }

    #[test]
    fn the_last_observation_is_looked_at() {
        let track = Track {
            name: "a".into(),
            x: (0..8).map(f64::from).collect(),
            y: vec![0.0; 8],
            ..Track::default()
        };
        let path = Trajectory {
            times: (0..8).map(f64::from).collect(),
            bodies: vec![track],
            outcome: Outcome::default(),
            ..Trajectory::default()
        };
        let of = |times| thinned(&path, times).times;
        assert_eq!(of(3), [2.0, 4.0, 7.0]);
        assert_eq!(of(100).last(), Some(&7.0));
        assert_eq!(of(100).len(), 8);
        assert!(thinned(&Trajectory::default(), 3).times.is_empty());
    }

    /// What is alike in all worlds, or was not seen, is not looked at; what diverged counts as nothing.
    #[test]
    fn a_gauge_keeps_what_tells_worlds_apart() {
        let worlds = [vec![1.0, 0.0, 5.0], vec![1.0, 2.0, 5.5], vec![1.0, f32::NAN, 6.0]];
        let gauge = Gauge::of(&worlds, &[1.0, 1.0, f32::NAN], 0.0);
        assert_eq!(gauge.kept, [(1, 1.0, 1.0)]);
        assert_eq!(gauge.row(&[1.0, 1.0, 0.0], &worlds[1]), [libm::asinhf(-1000.0), 1.0]);
        assert_eq!(gauge.row(&[1.0, 1.0, 0.0], &worlds[2]), [0.0, 0.0]);
    }

    /// Every other world is near the one before it, none is out of bounds, and few stand at one.
    #[test]
    fn worlds_are_drawn_in_pairs() {
        let coordinates = Coordinates::new(&[DRAG]);
        let simulation = Simulation { engine: Engine::Auto, effects: &[], coordinates: &coordinates };
        let all = worlds(&PRIOR, &[1, 2, 3], simulation, &small(4));
        assert_eq!(all.len(), 400);
        let apart = |pair: &[Sample]| ((pair[0][2] - pair[1][2]) / PRIOR[2].1).abs();
        let near = all.chunks(2).filter(|pair| apart(pair) < 0.3).count();
        let strange = all[1..399].chunks(2).filter(|pair| apart(pair) < 0.3).count();
        assert!(near > 130 && strange < 60, "{near} {strange}");
        assert!(all.iter().all(|w| coordinates.clamp(w) == *w && w[0] == 1.0));
        assert!(all.iter().filter(|w| w[3] == 0.0).count() < 4);
    }
}
