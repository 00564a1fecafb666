//! Requests for experimental designs.

use serde::Deserialize;
use serde_json::{Map, Value};
use utoipa::ToSchema;

use super::physics::engine;
use super::posterior::{EffectSet, effect_set, exclude_with_posterior};
use crate::design::{
    Costs, DesignConfig, DesignDocument, Question, design, document, training_and_test_tasks,
};
use crate::error::{Error, Result, check_count};
use crate::estimate::ParameterSamples;
use crate::progress::Progress;
use crate::task::{DEFAULT_FAMILY, Task};

/// An experimental design to compute: the tasks, the question, and the distribution of worlds, either a posterior (`posterior`) or
/// the family's prior with `sets` of effects.
#[derive(Clone, Deserialize, ToSchema, clap::Args)]
#[serde(deny_unknown_fields)]
#[schema(as = DesignIn)]
pub struct DesignRequest {
    /// A family (its training tasks are used) or one task, `bowling:017`.
    #[arg(long, default_value = DEFAULT_FAMILY)]
    #[arg(help = "Family, whose training tasks are used, or a task such as bowling:017")]
    pub task: String,
    /// `latents` (default: values of latents and effect parameters), `effects` (which set of effects the world has) or `success`
    /// (whether plans solve the test tasks).
    #[arg(long)]
    #[arg(
        help = "Question: latents (and effect parameters), effects (which set), or success (of plans) [default: latents]"
    )]
    pub question: Option<String>,
    /// An `iplw.posterior/2` document of equally weighted draws; only `columns`, `effects` and `discrepancy` are read.
    #[arg(skip)]
    #[schema(value_type = Option<Object>)]
    pub posterior: Option<Map<String, Value>>,
    /// With the prior: up to 20 equally likely sets of effects of typical size. Default: one empty set.
    #[arg(long = "set", value_name = "EFFECTS", value_parser = |text: &str| Ok::<_, Error>(effect_set(text)))]
    #[arg(help = "Effects of the prior, joined by +; may be repeated: equally likely sets [default: none]")]
    #[schema(value_type = Option<Vec<Vec<String>>>)]
    pub sets: Option<Vec<EffectSet>>,
    /// Standard deviation of observed positions, m. Default: 0.005.
    #[arg(long)]
    pub noise: Option<f64>,
    /// Number of experiments to choose jointly, up to 20. Default: 1.
    #[arg(long, help = "Number of experiments [default: 1; with --budget, as many as it allows]")]
    pub batch: Option<u64>,
    /// Costs, to maximise information per cost. With a budget but no `batch`: as many experiments as it pays for, up to 20.
    #[command(flatten)]
    pub costs: Option<CostOptions>,
    /// Number of random candidate actions, up to 2000. Default: 400.
    #[arg(long, help = "Number of random candidate actions [default: 400]")]
    pub candidates: Option<u64>,
    /// Number of best candidates to evaluate precisely, up to 100. Default: 24.
    #[arg(long, help = "Number of best candidates to evaluate precisely [default: 24]")]
    pub shortlist: Option<u64>,
    /// Number of sampled worlds for the precise evaluation, 8 to 256. Default: 128.
    #[arg(long, help = "Number of sampled worlds for the precise evaluation [default: 128]")]
    pub worlds: Option<u64>,
    /// Number of perturbed copies per action, whose spread counts as noise, 2 to 8. Default: 4.
    #[arg(long, help = "Perturbed copies of an action, whose spread counts as noise [default: 4]")]
    pub copies: Option<u64>,
    /// Maximum perturbation of an action component, up to 1. Default: 0.002.
    #[arg(long)]
    pub perturb: Option<f64>,
    /// `auto`, or the name of an engine.
    #[arg(long, help = "Physics engine: auto, rapier, lanes or gpu [default: auto]")]
    pub engine: Option<String>,
    #[arg(long, help = "Random seed [default: 0]")]
    pub seed: Option<u64>,
}

/// Costs of experiments, in any unit, such as minutes.
#[derive(Clone, Deserialize, ToSchema, clap::Args)]
#[serde(deny_unknown_fields)]
#[schema(as = CostsIn)]
pub struct CostOptions {
    /// Cost of an experiment. Default: 1.
    #[arg(long = "trial-cost", value_name = "COST")]
    pub trial: Option<f64>,
    /// Additional cost of setting up a task, once per task of the batch. Default: 0.
    #[arg(long = "setup-cost", value_name = "COST")]
    pub setup: Option<f64>,
    /// Maximum cost of the batch. Default: unlimited.
    #[arg(long, value_name = "COST")]
    pub budget: Option<f64>,
}

/// Maximum number of experiments of a batch that a server accepts.
const MAX_BATCH: u64 = 20;

impl DesignRequest {
    /// The configuration of the search.
    pub fn config(&self) -> Result<DesignConfig> {
        let question = Question::from_name(self.question.as_deref().unwrap_or("latents"))?;
        let usual = DesignConfig::standard(question, self.seed.unwrap_or(0));
        let or = |value: Option<u64>, default: usize| value.map_or(default, |v| v as usize);
        let candidates = or(self.candidates, usual.candidates);
        let shortlist = or(self.shortlist, usual.shortlist.max(or(self.batch, 1)));
        let costs = self.costs.as_ref().map_or(usual.costs, |costs| Costs {
            trial: costs.trial.unwrap_or(usual.costs.trial),
            setup: costs.setup.unwrap_or(usual.costs.setup),
            budget: costs.budget,
        });
        // With a budget, as many as it allows.
        let most = if costs.budget.is_some() { shortlist.min(candidates) } else { usual.batch };
        let config = DesignConfig {
            candidates,
            shortlist,
            worlds: [usual.worlds[0], or(self.worlds, usual.worlds[1])],
            copies: or(self.copies, usual.copies),
            perturb: self.perturb.unwrap_or(usual.perturb),
            noise: self.noise.unwrap_or(usual.noise),
            batch: or(self.batch, most),
            costs,
            engine: engine(self.engine.as_deref())?,
            ..usual
        };
        config.validate()?;
        Ok(config)
    }

    /// [`DesignRequest::config`], with an error for more work than a server accepts.
    pub fn limited_config(&self) -> Result<DesignConfig> {
        check_count("candidates", self.candidates, 1, 2000)?;
        check_count("batch", self.batch, 1, MAX_BATCH)?;
        check_count("shortlist", self.shortlist, 1, 100)?;
        check_count("worlds", self.worlds, 8, 256)?;
        check_count("copies", self.copies, 2, 8)?;
        let config = self.config()?;
        Ok(DesignConfig { batch: config.batch.min(MAX_BATCH as usize), ..config })
    }

    /// Sets of effects of the prior; an error together with a posterior, which has its own.
    pub fn sets(&self) -> Result<Vec<Vec<String>>> {
        if self.posterior.is_some() {
            exclude_with_posterior(&[("sets", self.sets.is_some())])?;
        }
        match &self.sets {
            Some(sets) if sets.is_empty() || sets.len() > 20 => {
                Err(Error::input("sets", format!("{} sets", sets.len()), "1 to 20 sets of effects"))
            }
            sets => Ok(sets.clone().unwrap_or_else(|| vec![Vec::new()])),
        }
    }
}

/// Designs experiments on `tasks`, or on the training tasks of a family.
pub fn design_experiments(
    tasks: &[Task],
    samples: &ParameterSamples,
    config: &DesignConfig,
    progress: &dyn Progress,
) -> Result<DesignDocument> {
    let (training, test) = training_and_test_tasks(tasks);
    Ok(document(&design(&training, &test, samples, config, progress)?, config))
}
