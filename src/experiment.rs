//! The main path: explore -> measure -> estimate -> train -> transfer -> report.
//!
//! Source: Semage et al., algorithm 1 (Intuitive Physics Learning Workflow). [`estimate`] is its first half: in
//! each round the strategy ranks candidate actions on the simulation at the current estimate, the best are
//! spent on the real world, and the cross-entropy method moves the estimate.
//!
//! Differences from the source: [`EstimateConfig::memory`] decides whether a round's fit sees all trials so far
//! (default) or only its own; the loop also ends when the estimate has settled or the budget is spent.

pub mod quickstart;

use serde::{Deserialize, Serialize};

use crate::error::{Error, Result, within};
use crate::estimate::cem::Sample;
use crate::estimate::fitness::{Racing, Simulation, losses};
use crate::estimate::{Cem, CemConfig, LatentEstimate, intervals};
use crate::explore::{self, Candidate};
use crate::progress::Progress;
use crate::reality::{Reality, Trial};
use crate::rng;
use crate::task::scene::EffectTerm;
use crate::task::{Task, ValidAction};
use crate::world::effect::linear_drag;
use crate::world::{Engine, Latents};

/// How an estimation is run.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct EstimateConfig {
    /// Name of an exploration strategy.
    pub strategy: String,
    /// Most rounds of exploring, measuring and fitting.
    pub rounds: usize,
    /// Real interactions a round.
    pub actions: usize,
    /// Actions simulated a round for the strategy to choose from.
    pub candidates: usize,
    /// The search.
    pub cem: CemConfig,
    /// Which trials a round's fit sees.
    pub memory: Memory,
    /// Stop when no latent has moved by more than this share of its prior's deviation for two rounds; 0 never.
    pub settled: f64,
    /// Whether samples that cannot matter are dropped early; the result is the same.
    pub racing: bool,
    /// Engine of the simulation.
    pub engine: Engine,
    /// Seed of everything random.
    pub seed: u64,
}

/// Which trials a round's fit sees.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Memory {
    /// All trials so far.
    #[default]
    All,
    /// Those of the round.
    LastRound,
}

/// What an estimation found.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct EstimateReport {
    /// In the order of `world::latent::FACTORS`.
    pub latents: Vec<LatentEstimate>,
    /// Residual of the best sample of each round, m^2 per trajectory.
    pub residuals: Vec<f64>,
    /// Effects fitted along with the latents; empty unless asked for.
    pub effects: Vec<LatentEstimate>,
    /// Estimate after each round: density (kg/m^2), friction, restitution, c of `linear_drag` (1/s).
    pub estimates: Vec<Sample>,
    /// Valid attempts this estimation cost in the real world.
    pub real_interactions: u64,
    /// Rollouts simulated.
    pub rollouts: u64,
    /// Why it ended.
    pub stopped: Stopped,
    /// Wall-clock seconds; filled in by whoever has a clock.
    pub seconds: Option<f64>,
    pub strategy: String,
    pub seed: u64,
    pub config: EstimateConfig,
    /// Version of this program.
    pub version: String,
}

/// Why an estimation ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Stopped {
    /// All rounds were run.
    Rounds,
    /// The estimate no longer moved.
    Settled,
    /// The real world's budget was spent.
    Budget,
}

impl EstimateConfig {
    /// As in the paper: 10 rounds of 50 actions, each followed by one iteration of 1000 samples.
    pub fn paper(prior: [(f64, f64); 3]) -> EstimateConfig {
        EstimateConfig {
            rounds: 10,
            actions: 50,
            candidates: 500,
            cem: CemConfig::paper(prior),
            memory: Memory::LastRound,
            settled: 0.0,
            ..EstimateConfig::fast(prior)
        }
    }

    /// A tenth of the interactions, and a search that needs fewer samples.
    pub fn fast(prior: [(f64, f64); 3]) -> EstimateConfig {
        EstimateConfig {
            strategy: "mixed".into(),
            rounds: 5,
            actions: 10,
            candidates: 200,
            cem: CemConfig::fast(prior),
            memory: Memory::All,
            settled: 0.02,
            racing: true,
            engine: Engine::Auto,
            seed: 0,
        }
    }

    /// Errors name what is out of range.
    pub fn validate(&self) -> Result<()> {
        explore::strategy(&self.strategy)?;
        within("rounds", self.rounds as f64, 1.0, 1000.0)?;
        within("actions", self.actions as f64, 1.0, 10_000.0)?;
        within("candidates", self.candidates as f64, self.actions as f64, 100_000.0)?;
        within("settled", self.settled, 0.0, 1.0)?;
        self.cem.validate().map_err(|e| e.under("cem"))
    }
}

impl EstimateReport {
    /// The point estimate of the latents.
    pub fn values(&self) -> [f64; 3] {
        std::array::from_fn(|i| self.latents[i].value)
    }

    /// The effects that were fitted along, as a simulation takes them.
    pub fn extension(&self) -> Vec<EffectTerm> {
        self.effects.iter().map(|e| linear_drag(e.value)).collect()
    }
}

/// Estimates the latents of `reality` over `tasks`; returns the report and the trials it was made from.
pub fn estimate(
    tasks: &[Task],
    reality: &mut dyn Reality,
    config: &EstimateConfig,
    progress: &dyn Progress,
) -> Result<(EstimateReport, Vec<Trial>)> {
    config.validate()?;
    let simulation = Simulation { engine: config.engine, effects: &[] };
    let mut cem = Cem::new(config.cem.clone())?;
    let mut search = rng::stream(config.seed, "cem");
    let mut trials: Vec<Trial> = Vec::new();
    let (mut residuals, mut estimates) = (Vec::new(), Vec::new());
    let (mut rollouts, before) = (0, reality.interactions());
    let mut stopped = Stopped::Rounds;
    for round in 0..config.rounds {
        let staged = Staged { inner: progress, round, rounds: config.rounds };
        let left = reality.budget().map_or(u64::MAX, |b| b.saturating_sub(reality.interactions()));
        if left == 0 {
            stopped = Stopped::Budget;
            break;
        }
        let wanted = (config.actions as u64).min(left) as usize;
        let chosen = explore_round(tasks, &cem, config, round, wanted, &staged)?;
        rollouts += config.candidates as u64;
        let fresh = measure(tasks, reality, &chosen, trials.len(), &staged)?;
        trials.extend(fresh);
        let seen = match config.memory {
            Memory::All => &trials[..],
            Memory::LastRound => &trials[trials.len() - chosen.len()..],
        };
        let (best, cost) = fit_round(&mut cem, seen, config, simulation, &mut search, &staged)?;
        rollouts += cost;
        residuals.push(best);
        estimates.push(cem.estimate());
        if has_settled(&estimates, config) {
            stopped = Stopped::Settled;
            break;
        }
    }
    if trials.is_empty() {
        return Err(Error::Budget {
            limit: reality.budget().unwrap_or(0),
            spent: reality.interactions(),
            asked: 1,
        });
    }
    let real_interactions = reality.interactions() - before;
    let found = Found { residuals, estimates, rollouts, real_interactions, stopped };
    let report = report_on(&cem, &trials, config, simulation, found, progress)?;
    Ok((report, trials))
}

/// Fits given trials without measuring anything: as many iterations as an estimation of all rounds makes.
pub fn refit(trials: &[Trial], config: &EstimateConfig, progress: &dyn Progress) -> Result<EstimateReport> {
    config.validate()?;
    let simulation = Simulation { engine: config.engine, effects: &[] };
    let mut cem = Cem::new(config.cem.clone())?;
    let mut search = rng::stream(config.seed, "cem");
    let (mut residuals, mut estimates, mut rollouts) = (Vec::new(), Vec::new(), 0);
    for round in 0..config.rounds {
        let staged = Staged { inner: progress, round, rounds: config.rounds };
        let (best, cost) = fit_round(&mut cem, trials, config, simulation, &mut search, &staged)?;
        residuals.push(best);
        rollouts += cost;
        estimates.push(cem.estimate());
    }
    let found = Found { residuals, estimates, rollouts, real_interactions: 0, stopped: Stopped::Rounds };
    report_on(&cem, trials, config, simulation, found, progress)
}

/// `count` trials of random placeable actions over `tasks`, in a seed's order.
pub fn random_trials(
    tasks: &[Task],
    reality: &mut dyn Reality,
    count: usize,
    seed: u64,
    progress: &dyn Progress,
) -> Result<Vec<Trial>> {
    let drawn = explore::draw(tasks, count, &mut rng::stream(seed, "random trials"))?;
    let mut trials = Vec::with_capacity(count);
    for (task, action, _) in drawn {
        progress.report("measuring the real world", trials.len() as u64, count as u64)?;
        let name = format!("{}/{}", tasks[task].id, trials.len());
        let attempts = reality.measure(&tasks[task], &[action])?;
        trials.extend(attempts.into_iter().filter_map(|a| a.into_trial(name.clone())));
    }
    Ok(trials)
}

/// One round's iterations of the search: the least loss seen (m^2 per trajectory) and the rollouts spent.
fn fit_round(
    cem: &mut Cem,
    trials: &[Trial],
    config: &EstimateConfig,
    simulation: Simulation,
    stream: &mut rng::Stream,
    progress: &dyn Progress,
) -> Result<(f64, u64)> {
    let (mut best, mut rollouts) = (f64::INFINITY, 0);
    for _ in 0..config.cem.iterations {
        let samples = cem.ask(stream);
        let racing = if config.racing { Racing::On { elites: cem.elites() } } else { Racing::Off };
        let scored = losses(&samples, trials, simulation, racing, progress)?;
        rollouts += scored.rollouts;
        best = scored.values.iter().copied().fold(best, f64::min);
        cem.tell(&samples, &scored.values);
    }
    Ok((best, rollouts))
}

/// What a search has gathered when it ends.
struct Found {
    residuals: Vec<f64>,
    estimates: Vec<Sample>,
    rollouts: u64,
    real_interactions: u64,
    stopped: Stopped,
}

/// Adds intervals to what was found.
fn report_on(
    cem: &Cem,
    trials: &[Trial],
    config: &EstimateConfig,
    simulation: Simulation,
    found: Found,
    progress: &dyn Progress,
) -> Result<EstimateReport> {
    let prior = config.cem.start().map(|p| p.1);
    let mut latents =
        intervals(cem.estimate(), cem.deviations(), prior, trials, simulation, config.seed, progress)?;
    let effects = latents.split_off(3);
    Ok(EstimateReport {
        latents,
        effects,
        residuals: found.residuals,
        estimates: found.estimates,
        real_interactions: found.real_interactions,
        rollouts: found.rollouts,
        stopped: found.stopped,
        seconds: None,
        strategy: config.strategy.clone(),
        seed: config.seed,
        config: config.clone(),
        version: env!("CARGO_PKG_VERSION").into(),
    })
}

/// The actions a round spends on the real world.
fn explore_round(
    tasks: &[Task],
    cem: &Cem,
    config: &EstimateConfig,
    round: usize,
    wanted: usize,
    progress: &dyn Progress,
) -> Result<Vec<Candidate>> {
    let mut stream = rng::stream(rng::derive(config.seed, "explore", round as u64), "candidates");
    let [density, friction, restitution, drag] = cem.estimate();
    let world = explore::World {
        latents: Latents::of([density, friction, restitution]),
        effects: if drag > 0.0 { vec![linear_drag(drag)] } else { Vec::new() },
        engine: config.engine,
    };
    let found = explore::candidates(tasks, config.candidates, &world, &mut stream, progress)?;
    let picked = explore::strategy(&config.strategy)?.choose(&found, wanted);
    Ok(picked.into_iter().map(|i| found[i].clone()).collect())
}

/// Spends the chosen actions; every one was placeable in simulation, so every one becomes a trial.
fn measure(
    tasks: &[Task],
    reality: &mut dyn Reality,
    chosen: &[Candidate],
    already: usize,
    progress: &dyn Progress,
) -> Result<Vec<Trial>> {
    progress.report("measuring the real world", 0, chosen.len() as u64)?;
    let mut slots: Vec<Option<Trial>> = chosen.iter().map(|_| None).collect();
    for (t, task) in tasks.iter().enumerate() {
        let mine: Vec<usize> = (0..chosen.len()).filter(|i| chosen[*i].task == t).collect();
        if mine.is_empty() {
            continue;
        }
        let actions: Vec<ValidAction> = mine.iter().map(|i| chosen[*i].action.clone()).collect();
        for (slot, attempt) in mine.iter().zip(reality.measure(task, &actions)?) {
            slots[*slot] = attempt.into_trial(format!("{}/{}", task.id, already + slot));
        }
    }
    Ok(slots.into_iter().flatten().collect())
}

/// Whether the last two rounds moved neither friction nor restitution noticeably. Density is left out: in
/// tasks of one composition it cancels, and would wander for ever.
fn has_settled(estimates: &[Sample], config: &EstimateConfig) -> bool {
    let [.., a, b, c] = estimates else { return false };
    let moved = |from: &Sample, to: &Sample| {
        (1..3).map(|i| (to[i] - from[i]).abs() / config.cem.prior[i].1).fold(0.0, f64::max)
    };
    config.settled > 0.0 && moved(a, b) < config.settled && moved(b, c) < config.settled
}

/// Adds the round to the stage's name.
struct Staged<'a> {
    inner: &'a dyn Progress,
    round: usize,
    rounds: usize,
}

impl Progress for Staged<'_> {
    fn report(&self, stage: &str, done: u64, total: u64) -> Result<()> {
        self.inner.report(&format!("round {} of {}: {stage}", self.round + 1, self.rounds), done, total)
    }
}
