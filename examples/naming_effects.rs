//! Sample efficiency of effect identification: number of interactions until the correct effect has 95 % posterior probability, with
//! optimal design and with random actions.
//!
//! `cargo run --release --example naming_effects -- --worlds 12 --out naming.md`. Every world has one effect, in turn, with a size
//! between 3 % and 100 % of its plausible standard deviation, and latents drawn from the family's prior. The candidate models are all
//! effects and the model without any. Both methods begin with the same random interactions; the posterior model probabilities are
//! updated after every further one. The effect counts as named if it has 95 % probability after two successive interactions. Each
//! result is appended to a CSV file next to the table, and an interrupted run resumes.

use std::collections::{BTreeMap, HashSet};
use std::io::Write as _;
use std::path::PathBuf;

use clap::Parser;
use iplw::design::{DesignConfig, Question, design, training_and_test_tasks};
use iplw::error::{Error, Result};
use iplw::estimate::ParameterSamples;
use iplw::estimate::sampler::smc::SmcConfig;
use iplw::experiment::random_trials;
use iplw::inference::posterior::{PosteriorConfig, PosteriorDocument, Sampler, posterior};
use iplw::progress::NoProgress;
use iplw::reality::{HiddenConfig, HiddenWorld, Reality, Trial, standard, with_trial_settings};
use iplw::rng;
use iplw::task::scene::EffectTerm;
use iplw::task::{Split, Task, family, split};
use iplw::world::effect;
use rand::RngExt as _;

/// Counts interactions until the correct effect is named, for two selection methods
#[derive(Parser)]
struct Run {
    /// Number of worlds
    #[arg(long, default_value_t = 12)]
    worlds: u64,
    /// First seed
    #[arg(long, default_value_t = 1)]
    first: u64,
    /// Task family
    #[arg(long, default_value = "bowling")]
    task: String,
    /// Candidate effects; every world has one of them
    #[arg(
        long,
        value_delimiter = ',',
        default_value = "linear_drag,rolling_resistance,restitution_speed,tangential_restitution"
    )]
    effects: Vec<String>,
    /// Standard deviation of the measurement noise, m; only positions are observed
    #[arg(long, default_value_t = 0.005)]
    noise: f64,
    /// Maximum number of interactions
    #[arg(long, default_value_t = 50)]
    cap: usize,
    /// Output file of the table
    #[arg(long, default_value = "naming.md")]
    out: PathBuf,
}

/// Random interactions at the start of both methods: the minimum for a posterior.
const INITIAL_INTERACTIONS: usize = 4;
/// Posterior probability at which the correct effect is named, and the number of successive interactions.
const NAMED_PROBABILITY: f64 = 0.95;
const NAMED_STREAK: usize = 2;
/// Range of effect sizes, relative to their plausible standard deviation.
const RELATIVE_SIZES: [f64; 2] = [0.03, 1.0];
/// Minimum number of draws of a candidate that the design considers: of 256 draws, 3 % probability.
const MIN_CANDIDATE_DRAWS: usize = 8;
const METHODS: [&str; 2] = ["random", "chosen"];

fn main() -> std::result::Result<(), Box<dyn std::error::Error>> {
    let run = Run::parse();
    let log = run.out.with_extension("csv");
    let text = std::fs::read_to_string(&log).unwrap_or_default();
    let done: HashSet<&str> =
        text.lines().filter_map(|l| l.rsplit_once(",end,").map(|(key, _)| key)).collect();
    let mut file = std::fs::OpenOptions::new().create(true).append(true).open(&log)?;
    for seed in run.first..run.first + run.worlds {
        for way in METHODS {
            let world = World::new(&run, seed)?;
            let key = format!(
                "{way},{seed},{},{:.3},{} {} {} {}",
                world.right,
                world.share,
                run.task,
                run.noise,
                run.cap,
                run.effects.join("+")
            );
            if !done.contains(key.as_str()) {
                let (spent, weights) = world.named(way)?;
                let weights: Vec<String> = weights.iter().map(|w| format!("{w:.3}")).collect();
                file.write_all(format!("{key},end,{spent},{}\n", weights.join(" ")).as_bytes())?;
            }
        }
    }
    drop(file);
    let table = table(&std::fs::read_to_string(&log)?, run.cap);
    print!("{table}");
    std::fs::write(&run.out, table)?;
    Ok(())
}

/// A world with one effect.
struct World<'a> {
    run: &'a Run,
    seed: u64,
    /// The effect, and its size relative to the plausible standard deviation.
    right: String,
    share: f64,
    hidden: HiddenConfig,
}

impl World<'_> {
    fn new(run: &Run, seed: u64) -> Result<World<'_>> {
        let family = family(&run.task)?;
        let right = run.effects[seed as usize % run.effects.len()].clone();
        let mut stream = rng::stream(seed, "naming effects");
        let u: f64 = stream.random();
        let share = RELATIVE_SIZES[0] * (RELATIVE_SIZES[1] / RELATIVE_SIZES[0]).powf(u);
        let parameters = effect::find(&right)?.parameters;
        let sized = parameters.iter().map(|p| (p.name.to_string(), p.neutral + share * p.weak_prior().1));
        let term = EffectTerm { name: right.clone(), parameters: sized.collect() };
        let latents = ParameterSamples::prior(family.prior, Vec::new(), 1, seed)?.draws()[0].latents;
        let hidden =
            HiddenConfig { latents, effects: vec![term], noise: run.noise, seed, ..standard(family) };
        Ok(World { run, seed, right, share, hidden })
    }

    /// Number of interactions until the correct effect is named (at most the cap), and its probability after each.
    fn named(&self, way: &str) -> Result<(usize, Vec<f64>)> {
        let family = family(&self.run.task)?;
        let tasks = split(&family.fold(0), Split::Train);
        let (training, _) = training_and_test_tasks(&tasks);
        let mut world = HiddenWorld::new(self.hidden.clone())?;
        let mut trials = random_trials(&training, &mut world, INITIAL_INTERACTIONS, self.seed, &NoProgress)?;
        let (mut weights, mut row) = (Vec::new(), 0);
        loop {
            let document = self.known(&training, &trials)?;
            let own = document.sets.iter().find(|s| s.effects == [self.right.clone()]);
            let weight = own.map_or(0.0, |s| s.weight);
            weights.push(weight);
            row = if weight >= NAMED_PROBABILITY { row + 1 } else { 0 };
            if row == NAMED_STREAK {
                return Ok((trials.len() + 1 - NAMED_STREAK, weights));
            }
            if trials.len() >= self.run.cap {
                return Ok((self.run.cap, weights));
            }
            let spent = trials.len();
            let chosen = if way == "chosen" { self.chosen(&training, &document, spent)? } else { None };
            match chosen {
                Some((task, action)) => {
                    for attempt in world.measure(&training[task], &[action])? {
                        trials.extend(attempt.into_trial(format!("chosen/{spent}")));
                    }
                }
                None => {
                    let seed = rng::derive_seed(self.seed, "further", spent as u64);
                    let further = random_trials(&training, &mut world, 1, seed, &NoProgress)?;
                    // Trials need unique names.
                    trials
                        .extend(further.into_iter().map(|t| Trial { name: format!("further/{spent}"), ..t }));
                }
            }
            if trials.len() == spent {
                return Err(Error::Failed(format!("nothing was measured in interaction {spent}")));
            }
        }
    }

    /// Posterior over the identifiable candidates, including the model without effects.
    fn known(&self, tasks: &[Task], trials: &[Trial]) -> Result<PosteriorDocument> {
        let (mut scene, trials) = with_trial_settings(&tasks[0].scene, trials.to_vec())?;
        scene.calibrate = ["friction", "restitution"].map(String::from).to_vec();
        let rivals = self.run.effects.iter().map(|name| vec![name.clone()]);
        let mut config = PosteriorConfig {
            sets: std::iter::once(Vec::new()).chain(rivals).collect(),
            sampler: Sampler::Smc(SmcConfig { particles: 64, ..SmcConfig::standard(self.seed) }),
            ..PosteriorConfig::standard(self.seed)
        };
        loop {
            match posterior(&scene, &trials, &config, &NoProgress) {
                Ok(found) => return Ok(PosteriorDocument::new(&found, &config)),
                Err(Error::Input(input)) if config.sets.len() > 1 && input.field.starts_with("sets[") => {
                    let untold = config.sets.iter().position(|set| input.value == set.join("+"));
                    config.sets.remove(untold.ok_or(Error::Input(input))?);
                }
                Err(error) => return Err(error),
            }
        }
    }

    /// The experiment with the highest expected information about which candidate is correct, among those that are not practically
    /// excluded; `None` if only one is left.
    fn chosen(
        &self,
        tasks: &[Task],
        document: &PosteriorDocument,
        spent: usize,
    ) -> Result<Option<(usize, iplw::task::ValidAction)>> {
        let value = serde_json::to_value(document).map_err(|e| Error::Failed(e.to_string()))?;
        let all = ParameterSamples::from_value(value)?;
        let count = |set: usize| document.set.iter().filter(|s| **s == set).count();
        let left: Vec<usize> =
            (0..document.sets.len()).filter(|s| count(*s) >= MIN_CANDIDATE_DRAWS).collect();
        if left.len() < 2 {
            return Ok(None);
        }
        let own = all.draws().iter().zip(&document.set).filter(|(_, set)| left.contains(set));
        let belief = ParameterSamples::from_draws(own.map(|(draw, _)| draw.clone()).collect())?;
        let usual =
            DesignConfig::standard(Question::Effects, rng::derive_seed(self.seed, "design", spent as u64));
        let config = DesignConfig { noise: self.run.noise, ..usual };
        let found = design(tasks, &[], &belief, &config, &NoProgress)?;
        Ok(found.experiments.into_iter().next().and_then(|e| {
            let task = tasks.iter().position(|t| t.id == e.task)?;
            Some((task, e.action))
        }))
    }
}

/// Table by effect and in total: interactions until the effect is named by each method, and the number of worlds without a name.
fn table(log: &str, cap: usize) -> String {
    let mut by: BTreeMap<&str, BTreeMap<u64, [Option<f64>; 2]>> = BTreeMap::new();
    for line in log.lines() {
        let Some((key, rest)) = line.rsplit_once(",end,") else { continue };
        let key: Vec<&str> = key.split(',').collect();
        let Some(way) = METHODS.iter().position(|w| *w == key[0]) else { continue };
        let (Ok(seed), Some(spent)) = (key[1].parse(), rest.split(',').next()) else { continue };
        by.entry(key[2]).or_default().entry(seed).or_default()[way] = spent.parse().ok();
    }
    let mut out = String::from(
        "| effect | worlds | random: interactions | never | chosen: interactions | never | chosen over random |\n|---|---|---|---|---|---|---|\n",
    );
    let pairs = |own: &BTreeMap<u64, [Option<f64>; 2]>| -> Vec<[f64; 2]> {
        own.values().filter_map(|[a, b]| Some([(*a)?, (*b)?])).collect()
    };
    let mut row = |name: &str, pairs: &[[f64; 2]]| {
        let n = pairs.len() as f64;
        let mean = |k: usize| pairs.iter().map(|p| p[k]).sum::<f64>() / n;
        let never = |k: usize| pairs.iter().filter(|p| p[k] >= cap as f64).count();
        out += &format!(
            "| {name} | {n} | {:.1} | {} | {:.1} | {} | {:.2} |\n",
            mean(0),
            never(0),
            mean(1),
            never(1),
            mean(1) / mean(0)
        );
    };
    for (name, own) in &by {
        row(name, &pairs(own));
    }
    let all: Vec<[f64; 2]> = by.values().flat_map(pairs).collect();
    row("all", &all);
    out
}
