//! One seed of the end-to-end experiment: estimations, diagnosis, posterior, and a policy for each method.

use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use super::estimators::{Estimator, EstimatorInput};
use super::extension::{self, Extension, diagnose_trials};
use super::hidden_evaluation::evaluate_in_hidden_world;
use super::quickstart_config::QuickstartConfig;
use super::{EstimateConfig, EstimateReport, Round, Workflow, run};
use crate::budget::Unlimited;
use crate::error::{Error, Result};
use crate::estimate::ParameterSamples;
use crate::inference::DiagnosisResult;
use crate::plan::{Plan, PlanPolicy, plan};
use crate::policy::{
    Evaluation, LabelConfig, Policy, RandomPolicy, TrainConfig, TrainingPhysics, label, train,
};
use crate::progress::{NoProgress, Progress};
use crate::reality::{HiddenConfig, HiddenWorld, Trial, Truth};
use crate::rng;
use crate::task::scene::EffectTerm;
use crate::task::{Scene, Task};
use crate::world::Latents;

/// Draws of the posterior.
const POSTERIOR_DRAWS: usize = 256;

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
    /// Policies of all methods, in the order of [`Method::ALL`].
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

/// Reported steps of a seed: two estimations, diagnosis, posterior, and one for each method.
pub(super) const STEPS_PER_SEED: usize = 4 + Method::ALL.len();

/// Reports the finished steps of all seeds.
pub(super) struct StepCounter<'a> {
    pub inner: &'a dyn Progress,
    pub name: &'a str,
    pub done: AtomicU64,
    pub total: u64,
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
pub(super) struct QuickstartRun<'a> {
    pub training: Vec<Task>,
    pub test: Vec<Task>,
    pub hidden: &'a HiddenConfig,
    pub truth: Truth,
    pub config: &'a QuickstartConfig,
    pub clock: &'a (dyn Fn() -> f64 + Sync),
    pub steps: StepCounter<'a>,
}

/// Result of one seed.
pub(super) struct SeedResult {
    pub paper: EstimateReport,
    pub informative: EstimateReport,
    pub extension: Extension,
    pub artifacts: QuickstartArtifacts,
    pub seconds: Vec<(String, f64)>,
}

impl SeedResult {
    /// Real interactions that a method has used.
    pub fn interactions_of(&self, method: Method) -> u64 {
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
    pub fn run_seed(&self, seed: u64) -> Result<SeedResult> {
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
            // An empirical law is no set of effects, and few usable trials give no posterior: the plans use the point estimate.
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
