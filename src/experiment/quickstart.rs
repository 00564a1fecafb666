//! End-to-end experiment: a hidden world, exploration, estimation, training of policies, transfer, and a table of results.
//!
//! Source: Semage et al., the jump-start comparison of their bowling experiment, with the baselines domain
//! randomisation and true latents.
//!
//! Differences from the source: policies are evaluated on the test tasks right after transfer (the jump start) and not trained further.
//! Additional rows are a random baseline and a perfect simulation (the true latents *and* the true unmodelled effect). Beyond the paper,
//! the trials are diagnosed: the missing effect is named and added to the simulation, and its benefit in transfer is measured.

use serde::{Deserialize, Serialize};

use super::extension::{self, Extension, diagnose_trials};
use super::hidden_evaluation::evaluate_in_hidden_world;
use super::progress_prefix::PrefixedProgress;
use super::statistics::Summary;
use super::study::with_drag;
use super::{EstimateConfig, EstimateReport, Round, Workflow, refit, run};
use crate::error::{Result, check_range};
use crate::inference::DiagnosisResult;
use crate::policy::{
    EvaluateConfig, Evaluation, LabelConfig, Policy, RandomPolicy, TrainConfig, TrainingPhysics, label, train,
};
use crate::progress::Progress;
use crate::reality::{HiddenConfig, HiddenWorld, Reality, Trial, Truth};
use crate::rng;
use crate::task::scene::EffectTerm;
use crate::task::{Scene, Split, Task, split};
use crate::world::Latents;

/// Configuration of the experiment.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct QuickstartConfig {
    /// Name of the task family.
    pub family: String,
    /// Seeds, one repetition of the experiment each.
    pub seeds: Vec<u64>,
    /// The estimation; its seed is replaced by each of `seeds`.
    pub estimate: EstimateConfig,
    /// Labelling of training actions.
    pub label: LabelConfig,
    /// Training of policies.
    pub train: TrainConfig,
    /// Evaluation of policies.
    pub evaluate: EvaluateConfig,
}

/// Results: one row per method.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct QuickstartReport {
    pub rows: Vec<QuickstartRow>,
    /// One estimation per seed.
    pub estimates: Vec<EstimateReport>,
    /// The same trials fitted again with linear drag in the simulation, per seed.
    pub extensions: Vec<EstimateReport>,
    /// Extension by a diagnosis of the same trials, per seed.
    pub diagnoses: Vec<Extension>,
    /// True parameters, revealed at the end.
    pub truth: Truth,
    /// (stage, seconds), summed over seeds.
    pub seconds: Vec<(String, f64)>,
    pub config: QuickstartConfig,
    pub version: String,
}

/// Performance of one method on the test tasks of the real world.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct QuickstartRow {
    /// Method.
    pub method: Method,
    /// AUCCESS for each seed, [0, 1].
    pub auccess: Vec<f64>,
    /// (100,) share of test tasks solved within k attempts, averaged over seeds.
    pub curve: Vec<f64>,
    /// Real interactions before the evaluation of the policy, for each seed.
    pub real_interactions: Vec<u64>,
}

/// Method to obtain a policy.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Method {
    /// Actions in random order.
    Random,
    /// Trained in simulations with random latents.
    DomainRandomisation,
    /// Trained in the simulation grounded by the workflow.
    Iplw,
    /// Beyond the paper: trained in a simulation grounded by the workflow with linear drag fitted.
    IplwWithDrag,
    /// Beyond the paper: trained in a simulation grounded by the workflow and extended by a diagnosis of its trials. Without a
    /// diagnosed effect it is the workflow's simulation.
    IplwDiagnosed,
    /// Trained in a simulation with the true latents.
    TrueLatents,
    /// Trained in a simulation with the true latents and the true unmodelled effects.
    TruePhysics,
}

/// Artifacts of the first seed.
pub struct QuickstartArtifacts {
    /// Trials of the exploration.
    pub trials: Vec<Trial>,
    /// Scene common to all trials, and their diagnosis.
    pub diagnosed: (Scene, DiagnosisResult),
    /// The rounds of the estimation.
    pub rounds: Vec<Round>,
    /// Policies of all methods, in the order of [`QuickstartReport::rows`].
    pub policies: Vec<TrainedPolicy>,
}

/// A policy with its training and evaluation.
pub struct TrainedPolicy {
    pub method: Method,
    pub policy: Box<dyn Policy>,
    /// Training record; `None` for the random baseline.
    pub training: Option<TrainingRecord>,
    pub evaluation: Evaluation,
}

/// Training data and loss of a policy.
pub struct TrainingRecord {
    pub training: TrainingPhysics,
    pub labels: LabelConfig,
    pub setup: TrainConfig,
    /// Numbers of labelled actions and of solving ones.
    pub examples: usize,
    pub solving: usize,
    /// (batches,) binary cross-entropy, nats.
    pub loss: Vec<f32>,
}

impl QuickstartArtifacts {
    /// The policy trained in the grounded simulation.
    pub fn policy(&self) -> &dyn Policy {
        let ours = self.policies.iter().find(|s| s.method == Method::Iplw);
        ours.expect("one of the methods is ours").policy.as_ref()
    }
}

impl Method {
    /// Title in tables.
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

impl QuickstartRow {
    /// Mean AUCCESS over seeds and its standard error (`None` for a single seed).
    pub fn mean(&self) -> (f64, Option<f64>) {
        let summary = Summary::of(&self.auccess);
        (summary.mean, summary.standard_error)
    }
}

/// Runs the experiment in hidden worlds with configuration `hidden`. `clock` returns seconds from an arbitrary origin.
pub fn quickstart(
    tasks: &[Task],
    hidden: &HiddenConfig,
    config: &QuickstartConfig,
    clock: &dyn Fn() -> f64,
    progress: &dyn Progress,
) -> Result<(QuickstartReport, QuickstartArtifacts)> {
    check_range("seeds", config.seeds.len() as f64, 1.0, 1000.0)?;
    config.estimate.validate()?;
    let mut experiment = QuickstartRun {
        training: split(tasks, Split::Train),
        test: split(tasks, Split::Test),
        hidden,
        truth: HiddenWorld::new(hidden.clone())?.reveal(),
        config,
        stopwatch: Stopwatch { clock, laps: Vec::new() },
    };
    let mut rows: Vec<(QuickstartRow, Vec<Evaluation>)> = Vec::new();
    let (mut estimates, mut extensions, mut diagnoses, mut artifacts) =
        (Vec::new(), Vec::new(), Vec::new(), None);
    for (n, seed) in config.seeds.iter().enumerate() {
        let seed_progress =
            PrefixedProgress { inner: progress, name: format!("seed {} of {}", n + 1, config.seeds.len()) };
        let result = experiment.run_seed(*seed, &seed_progress)?;
        for (method, evaluation, interactions) in result.policies {
            record_evaluation(&mut rows, method, evaluation, interactions);
        }
        estimates.push(result.estimate);
        extensions.push(result.with_drag);
        diagnoses.push(result.extension);
        artifacts = artifacts.or(Some(result.artifacts));
    }
    let rows = rows.into_iter().map(|(row, evaluations)| average_row(row, &evaluations)).collect();
    let report = QuickstartReport {
        rows,
        estimates,
        extensions,
        diagnoses,
        truth: experiment.truth,
        seconds: experiment.stopwatch.laps,
        config: config.clone(),
        version: env!("CARGO_PKG_VERSION").into(),
    };
    Ok((report, artifacts.expect("at least one seed was run")))
}

/// Data shared by all seeds.
struct QuickstartRun<'a> {
    training: Vec<Task>,
    test: Vec<Task>,
    hidden: &'a HiddenConfig,
    truth: Truth,
    config: &'a QuickstartConfig,
    stopwatch: Stopwatch<'a>,
}

/// Result of one seed.
struct SeedResult {
    estimate: EstimateReport,
    /// The same trials fitted again with linear drag in the simulation.
    with_drag: EstimateReport,
    extension: Extension,
    /// Method, evaluation and real interactions of each policy.
    policies: Vec<(Method, Evaluation, u64)>,
    artifacts: QuickstartArtifacts,
}

impl QuickstartRun<'_> {
    fn run_seed(&mut self, seed: u64, progress: &dyn Progress) -> Result<SeedResult> {
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
        let interactions_used = world.interactions();
        let with_drag = refit_with_drag(&trials, &setup, &mut self.stopwatch, progress)?;
        let found = Latents::of(report.values());
        let stage_progress = PrefixedProgress { inner: progress, name: "diagnosis".into() };
        let (scene, finding) =
            self.stopwatch.time("diagnose", || diagnose_trials(&trials, &setup, &stage_progress))?;
        let extension = self.stopwatch.time("fit in the extended simulation", || {
            extension::extend_simulation(&finding, &trials, &setup, found, &stage_progress)
        })?;
        let (mut tried, mut all) = (Vec::new(), Vec::new());
        for (method, physics) in [
            (Method::Random, None),
            (Method::DomainRandomisation, Some(TrainingPhysics::paper_randomised(Vec::new()))),
            (Method::Iplw, Some(fixed_physics(found, &[]))),
            (
                Method::IplwWithDrag,
                Some(fixed_physics(Latents::of(with_drag.values()), &with_drag.extension())),
            ),
            (Method::IplwDiagnosed, Some(fixed_physics(extension.latents, &extension.effects))),
            (Method::TrueLatents, Some(fixed_physics(self.truth.latents, &[]))),
            (Method::TruePhysics, Some(fixed_physics(self.truth.latents, &self.truth.effects))),
        ] {
            let stage_progress = PrefixedProgress { inner: progress, name: method.title().into() };
            let (policy, lesson) = self.train_policy(physics, seed, &stage_progress)?;
            let evaluation = self.stopwatch.time("transfer and evaluate", || {
                evaluate_in_hidden_world(
                    policy.as_ref(),
                    &self.test,
                    self.hidden,
                    &self.config.evaluate,
                    &stage_progress,
                )
            })?;
            let from_trials = [Method::Iplw, Method::IplwWithDrag, Method::IplwDiagnosed].contains(&method);
            tried.push((method, evaluation.clone(), if from_trials { interactions_used } else { 0 }));
            all.push(TrainedPolicy { method, policy, training: lesson, evaluation });
        }
        let artifacts = QuickstartArtifacts { trials, diagnosed: (scene, finding), rounds, policies: all };
        Ok(SeedResult { estimate: report, with_drag, extension, policies: tried, artifacts })
    }

    /// A policy trained in simulation, or the random baseline.
    fn train_policy(
        &mut self,
        physics: Option<TrainingPhysics>,
        seed: u64,
        progress: &dyn Progress,
    ) -> Result<(Box<dyn Policy>, Option<TrainingRecord>)> {
        let Some(training) = physics else { return Ok((Box::new(RandomPolicy { seed }), None)) };
        let labels = LabelConfig { seed: rng::derive_seed(seed, "label", 0), ..self.config.label.clone() };
        let data =
            self.stopwatch.time("label actions", || label(&self.training, &training, &labels, progress))?;
        let setup = TrainConfig { seed, ..self.config.train.clone() };
        let (dqn, log) = self.stopwatch.time("train policies", || train(&data, &setup, progress))?;
        let (examples, solving) = (data.rows.len(), data.solving());
        let lesson = TrainingRecord { training, labels, setup, examples, solving, loss: log.loss };
        Ok((Box::new(dqn), Some(lesson)))
    }
}

/// Refits the workflow's trials with linear drag in the simulation, without further real interactions.
fn refit_with_drag(
    trials: &[Trial],
    config: &EstimateConfig,
    stopwatch: &mut Stopwatch,
    progress: &dyn Progress,
) -> Result<EstimateReport> {
    let config = with_drag(config.clone());
    let stage_progress = PrefixedProgress { inner: progress, name: "with drag".into() };
    stopwatch.time("fit again with drag", || refit(trials, &config, &stage_progress))
}

fn fixed_physics(latents: Latents, effects: &[EffectTerm]) -> TrainingPhysics {
    TrainingPhysics::Fixed { latents, effects: effects.to_vec() }
}

fn record_evaluation(
    rows: &mut Vec<(QuickstartRow, Vec<Evaluation>)>,
    method: Method,
    evaluation: Evaluation,
    interactions: u64,
) {
    let at = rows.iter().position(|(r, _)| r.method == method).unwrap_or_else(|| {
        let row =
            QuickstartRow { method, auccess: Vec::new(), curve: Vec::new(), real_interactions: Vec::new() };
        rows.push((row, Vec::new()));
        rows.len() - 1
    });
    rows[at].0.auccess.push(evaluation.auccess);
    rows[at].0.real_interactions.push(interactions);
    rows[at].1.push(evaluation);
}

fn average_row(mut row: QuickstartRow, evaluations: &[Evaluation]) -> QuickstartRow {
    let n = evaluations.len() as f64;
    let attempts = evaluations[0].curve.len();
    row.curve = (0..attempts).map(|k| evaluations.iter().map(|e| e.curve[k]).sum::<f64>() / n).collect();
    row
}

/// Accumulates seconds per stage.
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
