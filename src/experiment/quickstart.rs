//! The story in one run: a hidden world, exploration, estimate, policies, transfer, a table.
//!
//! Source: Semage et al., the jump-start comparison of their bowling experiment, with the baselines domain
//! randomisation and true latents.
//!
//! Differences from the source: policies rank the test tasks' actions right after transfer (the jump start)
//! and do not learn on; a row for random ranking shows the floor, and one for the true latents *and* the true
//! unmodelled effect shows what a perfect simulation would bring. Past the paper, the trials are diagnosed: what the
//! simulation lacks is named, added, and its worth in transfer shown.

use serde::{Deserialize, Serialize};

use super::extension::{self, Extension, diagnosed};
use super::stages::Named;
use super::tryout::try_out;
use super::{EstimateConfig, EstimateReport, Round, Workflow, refit, run};
use crate::discover::Finding;
use crate::error::{Result, within};
use crate::policy::{
    EvaluateConfig, Evaluation, LabelConfig, Policy, Random, TrainConfig, Training, label, train,
};
use crate::progress::Progress;
use crate::reality::{HiddenConfig, HiddenWorld, Reality, Trial, Truth};
use crate::rng;
use crate::task::scene::EffectTerm;
use crate::task::{Scene, Split, Task, split};
use crate::world::DRAG;
use crate::world::Latents;

/// What is run.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct QuickstartConfig {
    /// Name of the task family.
    pub family: String,
    /// One repetition of the whole story for each.
    pub seeds: Vec<u64>,
    /// The estimation; its seed is replaced by each of `seeds`.
    pub estimate: EstimateConfig,
    /// How training actions are labelled.
    pub label: LabelConfig,
    /// How policies are trained.
    pub train: TrainConfig,
    /// How they are tried out.
    pub evaluate: EvaluateConfig,
}

/// The result: one row per way of getting a policy.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct QuickstartReport {
    pub rows: Vec<Row>,
    /// One estimation per seed.
    pub estimates: Vec<EstimateReport>,
    /// The same trials fitted again with linear drag in the simulation, per seed.
    pub extensions: Vec<EstimateReport>,
    /// What the same trials' diagnosis says the simulation lacks, per seed.
    pub diagnoses: Vec<Extension>,
    /// What was hidden, revealed after everything else was done.
    pub truth: Truth,
    /// (stage, seconds), summed over seeds.
    pub seconds: Vec<(String, f64)>,
    pub config: QuickstartConfig,
    pub version: String,
}

/// One way of getting a policy, and how it did on the test tasks of the real world.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Row {
    /// Which way.
    pub method: Method,
    /// AUCCESS for each seed, [0, 1].
    pub auccess: Vec<f64>,
    /// (100,) share of test tasks solved within k attempts, averaged over seeds.
    pub curve: Vec<f64>,
    /// Real interactions spent before the policy was tried, for each seed.
    pub real_interactions: Vec<u64>,
}

/// A way of getting a policy.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Method {
    /// Actions in random order.
    Random,
    /// Trained in simulations with random latents.
    DomainRandomisation,
    /// Trained in the simulation grounded by the workflow.
    Iplw,
    /// Trained in a simulation grounded by the workflow with linear drag fitted along: past the paper.
    IplwWithDrag,
    /// Trained in a simulation grounded by the workflow and extended by what a diagnosis of its trials named: past the
    /// paper. Where nothing was named it is the workflow's simulation.
    IplwDiagnosed,
    /// Trained in a simulation with the true latents.
    TrueLatents,
    /// Trained in a simulation with the true latents and the true unmodelled effects.
    TruePhysics,
}

/// What the story leaves besides numbers, from the first seed.
pub struct Keepsakes {
    /// Trials of the exploration.
    pub trials: Vec<Trial>,
    /// The scene that goes with all of them, and what their diagnosis found.
    pub diagnosed: (Scene, Finding),
    /// The rounds of the estimation.
    pub rounds: Vec<Round>,
    /// Every way of getting a policy, in the order of [`QuickstartReport::rows`].
    pub schooled: Vec<Schooled>,
}

/// A policy, how it came about and how it did.
pub struct Schooled {
    pub method: Method,
    pub policy: Box<dyn Policy>,
    /// What it learned; `None` for one that ranks at random.
    pub lesson: Option<Lesson>,
    pub evaluation: Evaluation,
}

/// What a policy learned, and from what.
pub struct Lesson {
    pub training: Training,
    pub labels: LabelConfig,
    pub setup: TrainConfig,
    /// Labelled actions, and how many of them solve their task.
    pub examples: usize,
    pub solving: usize,
    /// (batches,) binary cross-entropy, nats.
    pub loss: Vec<f32>,
}

impl Keepsakes {
    /// The policy trained in the grounded simulation.
    pub fn policy(&self) -> &dyn Policy {
        let ours = self.schooled.iter().find(|s| s.method == Method::Iplw);
        ours.expect("one of the methods is ours").policy.as_ref()
    }
}

impl Method {
    /// For tables.
    pub fn title(self) -> &'static str {
        match self {
            Method::Random => "random ranking",
            Method::DomainRandomisation => "domain randomisation",
            Method::Iplw => "IPLW",
            Method::IplwWithDrag => "IPLW, drag fitted along",
            Method::IplwDiagnosed => "IPLW, extended by diagnosis",
            Method::TrueLatents => "true latents",
            Method::TruePhysics => "true latents and effects",
        }
    }
}

impl Row {
    /// Mean AUCCESS over seeds and its standard error (`None` for a single seed).
    pub fn mean(&self) -> (f64, Option<f64>) {
        let n = self.auccess.len() as f64;
        let mean = self.auccess.iter().sum::<f64>() / n;
        let variance = self.auccess.iter().map(|a| (a - mean).powi(2)).sum::<f64>() / (n - 1.0);
        (mean, (n > 1.0).then(|| (variance / n).sqrt()))
    }
}

/// Runs the story against hidden worlds made from `hidden`. `clock` gives seconds from any origin.
pub fn quickstart(
    tasks: &[Task],
    hidden: &HiddenConfig,
    config: &QuickstartConfig,
    clock: &dyn Fn() -> f64,
    progress: &dyn Progress,
) -> Result<(QuickstartReport, Keepsakes)> {
    within("seeds", config.seeds.len() as f64, 1.0, 1000.0)?;
    config.estimate.validate()?;
    let mut story = Story {
        training: split(tasks, Split::Train),
        test: split(tasks, Split::Test),
        hidden,
        truth: HiddenWorld::new(hidden.clone())?.reveal(),
        config,
        stopwatch: Stopwatch { clock, laps: Vec::new() },
    };
    let mut rows: Vec<(Row, Vec<Evaluation>)> = Vec::new();
    let (mut estimates, mut extensions, mut diagnoses, mut keepsakes) =
        (Vec::new(), Vec::new(), Vec::new(), None);
    for (n, seed) in config.seeds.iter().enumerate() {
        let staged = Named { inner: progress, name: format!("seed {} of {}", n + 1, config.seeds.len()) };
        let told = story.told(*seed, &staged)?;
        for (method, evaluation, interactions) in told.tried {
            take_down(&mut rows, method, evaluation, interactions);
        }
        estimates.push(told.estimate);
        extensions.push(told.with_drag);
        diagnoses.push(told.extension);
        keepsakes = keepsakes.or(Some(told.keepsakes));
    }
    let rows = rows.into_iter().map(|(row, evaluations)| averaged(row, &evaluations)).collect();
    let report = QuickstartReport {
        rows,
        estimates,
        extensions,
        diagnoses,
        truth: story.truth,
        seconds: story.stopwatch.laps,
        config: config.clone(),
        version: env!("CARGO_PKG_VERSION").into(),
    };
    Ok((report, keepsakes.expect("at least one seed was run")))
}

/// What is the same for every seed.
struct Story<'a> {
    training: Vec<Task>,
    test: Vec<Task>,
    hidden: &'a HiddenConfig,
    truth: Truth,
    config: &'a QuickstartConfig,
    stopwatch: Stopwatch<'a>,
}

/// The story of one seed.
struct Told {
    estimate: EstimateReport,
    /// The same trials fitted again with linear drag in the simulation.
    with_drag: EstimateReport,
    extension: Extension,
    /// Every way of getting a policy, how it did, and the real interactions it cost.
    tried: Vec<(Method, Evaluation, u64)>,
    keepsakes: Keepsakes,
}

impl Story<'_> {
    fn told(&mut self, seed: u64, progress: &dyn Progress) -> Result<Told> {
        let mut world = HiddenWorld::new(HiddenConfig { seed, ..self.hidden.clone() })?;
        let setup = EstimateConfig { seed, ..self.config.estimate.clone() };
        let mut rounds = Vec::new();
        let (report, trials) = self.stopwatch.time("explore, measure, estimate", || {
            let mut workflow = Workflow::new(&self.training, &setup, None)?;
            run(&mut workflow, &mut world, progress, &mut |round| {
                rounds.push(round.clone());
                Ok(())
            })?;
            Ok((workflow.report(progress)?, workflow.trials().to_vec()))
        })?;
        let spent = world.interactions();
        let with_drag = extend(&trials, &setup, &mut self.stopwatch, progress)?;
        let found = Latents::of(report.values());
        let named = Named { inner: progress, name: "what the simulation lacks".into() };
        let (scene, finding) = self.stopwatch.time("diagnose", || diagnosed(&trials, &setup, &named))?;
        let extension = self.stopwatch.time("fit in the extended simulation", || {
            extension::extended(&finding, &trials, &setup, found, &named)
        })?;
        let (mut tried, mut all) = (Vec::new(), Vec::new());
        for (method, schooling) in [
            (Method::Random, None),
            (Method::DomainRandomisation, Some(Training::paper_randomised(Vec::new()))),
            (Method::Iplw, Some(fixed(found, &[]))),
            (Method::IplwWithDrag, Some(fixed(Latents::of(with_drag.values()), &with_drag.extension()))),
            (Method::IplwDiagnosed, Some(fixed(extension.latents, &extension.effects))),
            (Method::TrueLatents, Some(fixed(self.truth.latents, &[]))),
            (Method::TruePhysics, Some(fixed(self.truth.latents, &self.truth.effects))),
        ] {
            let named = Named { inner: progress, name: method.title().into() };
            let (policy, lesson) = self.schooled(schooling, seed, &named)?;
            let evaluation = self.stopwatch.time("transfer and evaluate", || {
                try_out(policy.as_ref(), &self.test, self.hidden, &self.config.evaluate, &named)
            })?;
            let from_trials = [Method::Iplw, Method::IplwWithDrag, Method::IplwDiagnosed].contains(&method);
            tried.push((method, evaluation.clone(), if from_trials { spent } else { 0 }));
            all.push(Schooled { method, policy, lesson, evaluation });
        }
        let keepsakes = Keepsakes { trials, diagnosed: (scene, finding), rounds, schooled: all };
        Ok(Told { estimate: report, with_drag, extension, tried, keepsakes })
    }

    /// A policy trained in a simulation, or one that ranks at random.
    fn schooled(
        &mut self,
        schooling: Option<Training>,
        seed: u64,
        progress: &dyn Progress,
    ) -> Result<(Box<dyn Policy>, Option<Lesson>)> {
        let Some(training) = schooling else { return Ok((Box::new(Random { seed }), None)) };
        let labels = LabelConfig { seed: rng::derive(seed, "label", 0), ..self.config.label.clone() };
        let data =
            self.stopwatch.time("label actions", || label(&self.training, &training, &labels, progress))?;
        let setup = TrainConfig { seed, ..self.config.train.clone() };
        let (dqn, log) = self.stopwatch.time("train policies", || train(&data, &setup, progress))?;
        let (examples, solving) = (data.rows.len(), data.solving());
        let lesson = Lesson { training, labels, setup, examples, solving, loss: log.loss };
        Ok((Box::new(dqn), Some(lesson)))
    }
}

/// Fits the trials that the workflow measured once more, with linear drag in the simulation; costs no further
/// real interaction.
fn extend(
    trials: &[Trial],
    config: &EstimateConfig,
    stopwatch: &mut Stopwatch,
    progress: &dyn Progress,
) -> Result<EstimateReport> {
    let mut config = config.clone();
    config.cem.fit_along(DRAG);
    let named = Named { inner: progress, name: "with drag".into() };
    stopwatch.time("fit again with drag", || refit(trials, &config, &named))
}

fn fixed(latents: Latents, effects: &[EffectTerm]) -> Training {
    Training::Fixed { latents, effects: effects.to_vec() }
}

fn take_down(
    rows: &mut Vec<(Row, Vec<Evaluation>)>,
    method: Method,
    evaluation: Evaluation,
    interactions: u64,
) {
    let at = rows.iter().position(|(r, _)| r.method == method).unwrap_or_else(|| {
        let row = Row { method, auccess: Vec::new(), curve: Vec::new(), real_interactions: Vec::new() };
        rows.push((row, Vec::new()));
        rows.len() - 1
    });
    rows[at].0.auccess.push(evaluation.auccess);
    rows[at].0.real_interactions.push(interactions);
    rows[at].1.push(evaluation);
}

fn averaged(mut row: Row, evaluations: &[Evaluation]) -> Row {
    let n = evaluations.len() as f64;
    let attempts = evaluations[0].curve.len();
    row.curve = (0..attempts).map(|k| evaluations.iter().map(|e| e.curve[k]).sum::<f64>() / n).collect();
    row
}

/// Sums seconds by stage.
struct Stopwatch<'a> {
    clock: &'a dyn Fn() -> f64,
    laps: Vec<(String, f64)>,
}

impl Stopwatch<'_> {
    fn time<T>(&mut self, stage: &str, work: impl FnOnce() -> T) -> T {
        let start = (self.clock)();
        let result = work();
        let took = (self.clock)() - start;
        match self.laps.iter_mut().find(|(name, _)| name == stage) {
            Some((_, sum)) => *sum += took,
            None => self.laps.push((stage.to_string(), took)),
        }
        result
    }
}
