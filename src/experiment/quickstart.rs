//! End-to-end experiment: a hidden world, exploration, estimation, diagnosis, training of policies, plans, transfer, and a table of
//! results.
//!
//! Source: Semage et al., the jump-start comparison of their bowling experiment, with the baseline domain randomisation.
//!
//! Differences from the source: policies are evaluated on the test tasks right after transfer (the jump start) and not trained further.
//! Additional baselines are random actions, an uncalibrated simulation (latents at the prior's means) and a perfect one (the true
//! latents *and* the true unmodelled effect). Beyond the paper, informative actions are measured and fitted by multiple shooting; their
//! trials are diagnosed, the missing effect is added to the simulation, and test tasks are planned under the posterior in it.

use std::sync::atomic::AtomicU64;

use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use super::EstimateReport;
use super::extension::Extension;
pub use super::quickstart_config::QuickstartConfig;
pub use super::quickstart_seed::{Method, QuickstartArtifacts, TrainedPolicy, TrainingRecord};
use super::quickstart_seed::{QuickstartRun, STEPS_PER_SEED, SeedResult, StepCounter};
use super::statistics::Summary;
use crate::error::{Result, check_range};
use crate::policy::Evaluation;
use crate::progress::Progress;
use crate::reality::{HiddenConfig, HiddenWorld, Truth};
use crate::task::{Split, Task, split};

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
