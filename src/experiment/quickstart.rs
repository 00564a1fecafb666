//! End-to-end experiment: a hidden world, exploration, estimation, diagnosis, training of policies, plans, transfer, and a table of
//! results.
//!
//! Source: Semage et al., the jump-start comparison of their bowling experiment, with the baseline domain randomisation.
//!
//! Differences from the source: policies are evaluated on the test tasks right after transfer (the jump start) and not trained further.
//! Additional baselines are random actions, an uncalibrated simulation (latents at the prior's means) and a perfect one (the true
//! latents *and* the true unmodelled effect). Beyond the paper, informative actions are measured and fitted by multiple shooting; their
//! trials are diagnosed, the missing effect is added to the simulation, and test tasks are planned under the posterior in it.

use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use super::estimators::{Estimator, EstimatorInput};
use super::extension::{self, Extension, diagnose_trials};
use super::hidden_evaluation::evaluate_in_hidden_world;
use super::statistics::Summary;
use super::{EstimateConfig, EstimateReport, ResidualKind, Round, Workflow, run};
use crate::budget::Unlimited;
use crate::error::{Error, Result, check_range};
use crate::estimate::ParameterSamples;
use crate::inference::DiagnosisResult;
use crate::plan::{Plan, PlanConfig, PlanPolicy, plan};
use crate::policy::{
    EvaluateConfig, Evaluation, LabelConfig, Policy, RandomPolicy, TrainConfig, TrainingPhysics, label, train,
};
use crate::progress::{NoProgress, Progress};
use crate::reality::{HiddenConfig, HiddenWorld, Reality, Trial, Truth};
use crate::rng;
use crate::task::scene::EffectTerm;
use crate::task::{Family, LabelCounts, Learning, Scene, Split, Task, split};
use crate::world::Latents;

/// Labelled actions of a training task, updates and units per layer of a policy, and candidate actions of an evaluation. Fewer updates
/// leave the levels' policies untrained; units per layer are fewer than usual, so that all rows of three seeds take minutes.
const LABELS_PER_TASK: usize = 600;
const BATCHES: usize = 3000;
const UNITS: usize = 96;
const CANDIDATES: usize = 2000;
/// Posterior draws on which an action of a plan is evaluated, and draws of the posterior.
const PLAN_DRAWS: usize = 16;
const POSTERIOR_DRAWS: usize = 256;

/// Configuration of the experiment.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct QuickstartConfig {
    /// Name of the task family.
    pub family: String,
    /// Prior mean and standard deviation of density, friction and restitution.
    pub prior: [(f64, f64); 3],
    /// Seeds, one repetition of the experiment each.
    pub seeds: Vec<u64>,
    /// The estimation as in the paper; its seed is replaced by each of `seeds`.
    pub paper: EstimateConfig,
    /// The estimation with informative actions, whose trials are diagnosed.
    pub informative: EstimateConfig,
    /// Labelling of training actions.
    pub label: LabelConfig,
    /// Training of policies.
    pub train: TrainConfig,
    /// Evaluation of policies.
    pub evaluate: EvaluateConfig,
    /// Plans under the posterior.
    pub plan: PlanConfig,
}

impl QuickstartConfig {
    /// The usual configuration; `quick` for a smoke test with few labels and candidates.
    pub fn standard(family: &Family, seeds: Vec<u64>, quick: bool) -> QuickstartConfig {
        let usual = EstimateConfig::fast(family.prior);
        let labels =
            LabelCounts { per_task: if quick { 40 } else { LABELS_PER_TASK }, ..family.learning.labels };
        let learning = Learning { batches: if quick { BATCHES / 5 } else { BATCHES }, ..family.learning };
        let candidates = if quick { 500 } else { CANDIDATES };
        QuickstartConfig {
            family: family.name.into(),
            prior: family.prior,
            seeds,
            informative: EstimateConfig {
                strategy: "informative".into(),
                residual: ResidualKind::Shooting,
                actions: 5,
                ..usual.clone()
            },
            paper: usual,
            label: LabelConfig::preset(&labels, 0),
            train: TrainConfig { hidden: UNITS, ..TrainConfig::preset(&learning) },
            evaluate: EvaluateConfig { candidates, ..EvaluateConfig::phyre(0) },
            plan: PlanConfig { actions: candidates, draws: PLAN_DRAWS, ..PlanConfig::standard(0) },
        }
    }
}

/// Results: one row per method.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct QuickstartReport {
    pub rows: Vec<QuickstartRow>,
    /// One estimation as in the paper per seed.
    pub paper_estimates: Vec<EstimateReport>,
    /// One estimation with informative actions per seed.
    pub estimates: Vec<EstimateReport>,
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
    /// Trained in the simulation with latents at the prior's means.
    Uncalibrated,
    /// Trained in simulations with random latents.
    DomainRandomisation,
    /// Trained in the simulation grounded by the paper's workflow.
    Iplw,
    /// Trained in the simulation grounded by informative actions and multiple shooting.
    Informative,
    /// The same, extended by a diagnosis of its trials. It is the same simulation if that reproduces the trials.
    Extended,
    /// Test tasks planned by rollouts in the extended simulation, under the posterior of its parameters.
    Planned,
    /// Trained in a simulation with the true latents and the true unmodelled effects.
    TruePhysics,
}

/// Artifacts of the first seed.
pub struct QuickstartArtifacts {
    /// Trials of the exploration.
    pub trials: Vec<Trial>,
    /// Scene common to all trials, and their diagnosis; `None` if the simulation reproduces the trials.
    pub diagnosed: Option<(Scene, DiagnosisResult)>,
    /// The rounds of the estimation.
    pub rounds: Vec<Round>,
    /// Policies of all methods, in the order of [`QuickstartReport::rows`].
    pub policies: Vec<TrainedPolicy>,
}

/// A policy with its training and evaluation.
#[derive(Clone)]
pub struct TrainedPolicy {
    pub method: Method,
    pub policy: Arc<dyn Policy>,
    /// Training record; `None` for random actions and plans.
    pub training: Option<TrainingRecord>,
    pub evaluation: Evaluation,
}

/// Training data and loss of a policy.
#[derive(Clone)]
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
    /// The policy trained in the extended simulation.
    pub fn policy(&self) -> &dyn Policy {
        let ours = self.policies.iter().find(|s| s.method == Method::Extended);
        ours.expect("one of the methods is ours").policy.as_ref()
    }
}

impl Method {
    /// All methods in the order of the table.
    pub const ALL: [Method; 8] = [
        Method::Random,
        Method::Uncalibrated,
        Method::DomainRandomisation,
        Method::Iplw,
        Method::Informative,
        Method::Extended,
        Method::Planned,
        Method::TruePhysics,
    ];

    /// Title in tables.
    pub fn title(self) -> &'static str {
        match self {
            Method::Random => "random actions",
            Method::Uncalibrated => "uncalibrated simulation",
            Method::DomainRandomisation => "domain randomisation",
            Method::Iplw => "IPLW as in the paper",
            Method::Informative => "IPLW, informative actions",
            Method::Extended => "  ... extended by diagnosis",
            Method::Planned => "  ... planned under the posterior",
            Method::TruePhysics => "true physics",
        }
    }
}

impl QuickstartRow {
    /// Summary of AUCCESS over seeds.
    pub fn summary(&self) -> Summary {
        Summary::of(&self.auccess)
    }
}

/// Runs the experiment in hidden worlds with configuration `hidden`, seeds side by side. `clock` returns seconds from an arbitrary
/// origin. The artifacts are those of the first seed.
pub fn quickstart(
    tasks: &[Task],
    hidden: &HiddenConfig,
    config: &QuickstartConfig,
    clock: &(dyn Fn() -> f64 + Sync),
    progress: &dyn Progress,
) -> Result<(QuickstartReport, QuickstartArtifacts)> {
    check_range("seeds", config.seeds.len() as f64, 1.0, 1000.0)?;
    config.paper.validate()?;
    config.informative.validate()?;
    let total = (config.seeds.len() * STEPS_PER_SEED) as u64;
    let experiment = QuickstartRun {
        training: split(tasks, Split::Train),
        test: split(tasks, Split::Test),
        hidden,
        truth: HiddenWorld::new(hidden.clone())?.reveal(),
        config,
        clock,
        steps: StepCounter { inner: progress, name: &config.family, done: AtomicU64::new(0), total },
    };
    let results: Vec<SeedResult> =
        config.seeds.par_iter().map(|seed| experiment.run_seed(*seed)).collect::<Result<_>>()?;
    let rows = (0..Method::ALL.len()).map(|k| row(&results, k)).collect();
    let mut seconds: Vec<(String, f64)> = Vec::new();
    let (mut paper_estimates, mut estimates, mut diagnoses, mut artifacts) = (vec![], vec![], vec![], None);
    for result in results {
        for (stage, took) in result.seconds {
            match seconds.iter_mut().find(|(name, _)| *name == stage) {
                Some((_, sum)) => *sum += took,
                None => seconds.push((stage, took)),
            }
        }
        paper_estimates.push(result.paper);
        estimates.push(result.informative);
        diagnoses.push(result.extension);
        artifacts = artifacts.or(Some(result.artifacts));
    }
    let report = QuickstartReport {
        rows,
        paper_estimates,
        estimates,
        diagnoses,
        truth: experiment.truth,
        seconds,
        config: config.clone(),
        version: env!("CARGO_PKG_VERSION").into(),
    };
    Ok((report, artifacts.expect("at least one seed was run")))
}

/// One method over all seeds; `k` is its place in [`Method::ALL`].
fn row(results: &[SeedResult], k: usize) -> QuickstartRow {
    let of: Vec<&Evaluation> = results.iter().map(|r| &r.artifacts.policies[k].evaluation).collect();
    let n = of.len() as f64;
    QuickstartRow {
        method: Method::ALL[k],
        auccess: of.iter().map(|e| e.auccess).collect(),
        curve: (0..of[0].curve.len()).map(|a| of.iter().map(|e| e.curve[a]).sum::<f64>() / n).collect(),
        real_interactions: results.iter().map(|r| r.interactions_of(Method::ALL[k])).collect(),
    }
}

/// Reported steps of a seed: two estimations, diagnosis, posterior, and one for each method.
const STEPS_PER_SEED: usize = 4 + Method::ALL.len();

/// Reports the finished steps of all seeds.
struct StepCounter<'a> {
    inner: &'a dyn Progress,
    name: &'a str,
    done: AtomicU64,
    total: u64,
}

impl Progress for StepCounter<'_> {
    fn report(&self, _: &str, _: u64, _: u64) -> Result<()> {
        self.inner.report(self.name, self.done.load(Ordering::Relaxed), self.total)
    }

    fn check_stop(&self) -> Result<()> {
        self.inner.check_stop()
    }
}

/// Data shared by all seeds.
struct QuickstartRun<'a> {
    training: Vec<Task>,
    test: Vec<Task>,
    hidden: &'a HiddenConfig,
    truth: Truth,
    config: &'a QuickstartConfig,
    clock: &'a (dyn Fn() -> f64 + Sync),
    steps: StepCounter<'a>,
}

/// Result of one seed.
struct SeedResult {
    paper: EstimateReport,
    informative: EstimateReport,
    extension: Extension,
    artifacts: QuickstartArtifacts,
    seconds: Vec<(String, f64)>,
}

impl SeedResult {
    /// Real interactions that a method has used.
    fn interactions_of(&self, method: Method) -> u64 {
        match method {
            Method::Random | Method::Uncalibrated | Method::DomainRandomisation | Method::TruePhysics => 0,
            Method::Iplw => self.paper.real_interactions,
            Method::Informative | Method::Extended | Method::Planned => self.informative.real_interactions,
        }
    }
}

/// One seed in progress.
struct SeedRun<'a> {
    run: &'a QuickstartRun<'a>,
    seed: u64,
    seconds: Vec<(String, f64)>,
}

impl QuickstartRun<'_> {
    fn run_seed(&self, seed: u64) -> Result<SeedResult> {
        let mut own = SeedRun { run: self, seed, seconds: Vec::new() };
        let (paper, _, _) = own.estimate(&self.config.paper)?;
        let (informative, trials, rounds) = own.estimate(&self.config.informative)?;
        let setup = EstimateConfig { seed, ..self.config.informative.clone() };
        let found = Latents::of(informative.values());
        let steps = &self.steps;
        let (diagnosed, extension) = own.step("diagnose and extend", |_| {
            if !informative.has_bad_fit() {
                return Ok((None, Extension::unnecessary(found)));
            }
            let diagnosed = diagnose_trials(&trials, &setup, steps)?;
            let extension = extension::extend_simulation(&diagnosed.1, &trials, &setup, found, steps)?;
            Ok((Some(diagnosed), extension))
        })?;
        let posterior = own.step("sample the posterior", |own| own.posterior(&trials, &extension))?;
        let policies = own.policies((&paper, found), &extension, &posterior)?;
        let artifacts = QuickstartArtifacts { trials, diagnosed, rounds, policies };
        Ok(SeedResult { paper, informative, extension, artifacts, seconds: own.seconds })
    }
}

impl SeedRun<'_> {
    /// Does one step, timed and counted.
    fn step<T>(&mut self, stage: &str, work: impl FnOnce(&mut Self) -> Result<T>) -> Result<T> {
        self.run.steps.report(stage, 0, 0)?;
        let start = (self.run.clock)();
        let result = work(self)?;
        self.seconds.push((stage.into(), (self.run.clock)() - start));
        self.run.steps.done.fetch_add(1, Ordering::Relaxed);
        Ok(result)
    }

    /// An estimation in a fresh hidden world.
    fn estimate(&mut self, config: &EstimateConfig) -> Result<(EstimateReport, Vec<Trial>, Vec<Round>)> {
        let setup = EstimateConfig { seed: self.seed, ..config.clone() };
        let stage = format!("explore and estimate, {}", setup.strategy);
        self.step(&stage, |own| {
            let (steps, mut rounds) = (&own.run.steps, Vec::new());
            let mut world = HiddenWorld::new(HiddenConfig { seed: own.seed, ..own.run.hidden.clone() })?;
            let mut workflow = Workflow::new(&own.run.training, &setup, None)?;
            run(&mut workflow, &mut world, steps, &mut |round| {
                rounds.push(round.clone());
                Ok(())
            })?;
            let mut report = workflow.report(steps)?;
            report.real_interactions = world.interactions();
            report.check_fit(workflow.trials(), steps)?;
            Ok((report, workflow.trials().to_vec(), rounds))
        })
    }

    /// Posterior samples in the extended simulation.
    fn posterior(&self, trials: &[Trial], extension: &Extension) -> Result<ParameterSamples> {
        let config = self.run.config;
        let set: Vec<String> = extension.effects.iter().map(|e| e.name.clone()).collect();
        let asked = EstimatorInput {
            prior: config.prior,
            base: &self.run.training[0].scene,
            set: &set,
            engine: config.informative.engine,
            draws: POSTERIOR_DRAWS,
            noise: self.run.hidden.noise,
            seed: self.seed,
        };
        match asked.estimate(Estimator::Posterior, trials, &self.run.steps) {
            Ok(found) => ParameterSamples::from_draws(found.draws),
            // An empirical law is no set of the library: the plans use the point estimate.
            Err(Error::Input(_)) => ParameterSamples::point(extension.latents, extension.effects.clone()),
            Err(error) => Err(error),
        }
    }

    /// Policies of all methods, and their evaluations. Methods with the same physics share a policy.
    fn policies(
        &mut self,
        (paper, found): (&EstimateReport, Latents),
        extension: &Extension,
        posterior: &ParameterSamples,
    ) -> Result<Vec<TrainedPolicy>> {
        let truth = &self.run.truth;
        let physics = |method| match method {
            Method::Random | Method::Planned => None,
            Method::Uncalibrated => {
                Some(fixed_physics(Latents::of(self.run.config.prior.map(|(mean, _)| mean)), &[]))
            }
            Method::DomainRandomisation => Some(TrainingPhysics::paper_randomised(Vec::new())),
            Method::Iplw => Some(fixed_physics(Latents::of(paper.values()), &[])),
            Method::Informative => Some(fixed_physics(found, &[])),
            Method::Extended => Some(fixed_physics(extension.latents, &extension.effects)),
            Method::TruePhysics => Some(fixed_physics(truth.latents, &truth.effects)),
        };
        let all = Method::ALL.map(|method| (method, physics(method)));
        let first = |k: usize| all[..k].iter().position(|(_, other)| other.is_some() && *other == all[k].1);
        let start = (self.run.clock)();
        let own: Vec<Option<TrainedPolicy>> = (0..all.len())
            .into_par_iter()
            .map(|k| {
                let trained = match first(k) {
                    Some(_) => None,
                    None => Some(self.policy(all[k].0, all[k].1.clone(), posterior)?),
                };
                self.run.steps.done.fetch_add(1, Ordering::Relaxed);
                Ok(trained)
            })
            .collect::<Result<_>>()?;
        self.seconds.push(("train, plan and evaluate".into(), (self.run.clock)() - start));
        let of = |k: usize| TrainedPolicy {
            method: all[k].0,
            ..own[first(k).unwrap_or(k)].clone().expect("the first with its physics")
        };
        Ok((0..all.len()).map(of).collect())
    }

    /// A method's policy, trained in its physics if it has one, and its evaluation.
    fn policy(
        &self,
        method: Method,
        physics: Option<TrainingPhysics>,
        posterior: &ParameterSamples,
    ) -> Result<TrainedPolicy> {
        let (policy, training): (Arc<dyn Policy>, _) = match (method, physics) {
            (_, Some(physics)) => self.train(physics).map(|(policy, record)| (policy, Some(record)))?,
            (Method::Planned, None) => (Arc::new(self.plan(posterior)?), None),
            (_, None) => (Arc::new(RandomPolicy { seed: self.seed }), None),
        };
        let QuickstartRun { test, hidden, config, steps, .. } = self.run;
        let evaluation = evaluate_in_hidden_world(policy.as_ref(), test, hidden, &config.evaluate, steps)?;
        Ok(TrainedPolicy { method, policy, training, evaluation })
    }

    /// A policy trained in simulation.
    fn train(&self, training: TrainingPhysics) -> Result<(Arc<dyn Policy>, TrainingRecord)> {
        let config = self.run.config;
        let labels = LabelConfig { seed: rng::derive_seed(self.seed, "label", 0), ..config.label.clone() };
        let data = label(&self.run.training, &training, &labels, &self.run.steps)?;
        let setup = TrainConfig { seed: self.seed, ..config.train.clone() };
        let (dqn, log) = train(&data, &setup, &self.run.steps)?;
        let (examples, solving) = (data.rows.len(), data.solving());
        Ok((Arc::new(dqn), TrainingRecord { training, labels, setup, examples, solving, loss: log.loss }))
    }

    /// Plans of all test tasks under the posterior.
    fn plan(&self, posterior: &ParameterSamples) -> Result<PlanPolicy> {
        let config = &self.run.config.plan;
        let plans: Vec<Plan> = self
            .run
            .test
            .par_iter()
            .map(|task| plan(task, posterior, config, &Unlimited, &NoProgress))
            .collect::<Result<_>>()?;
        Ok(PlanPolicy::new("the posterior", &plans))
    }
}

fn fixed_physics(latents: Latents, effects: &[EffectTerm]) -> TrainingPhysics {
    TrainingPhysics::Fixed { latents, effects: effects.to_vec() }
}
