//! Requests for experimental designs.

use serde::Deserialize;
use serde_json::{Map, Value};
use utoipa::ToSchema;

use super::world::engine;
use crate::design::{Costs, DesignConfig, Question};
use crate::error::{Error, Result};

/// An experimental design to compute: the tasks, the question, and the distribution of worlds, either a posterior (`posterior`) or
/// the family's prior with `sets` of effects.
#[derive(Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct DesignIn {
    /// A family (its training tasks are used) or one task, `bowling:017`.
    pub task: String,
    /// `latents` (default: values of latents and effect parameters), `effects` (which set of effects the world has) or `success`
    /// (whether plans solve the test tasks).
    pub question: Option<String>,
    /// An `iplw.posterior/2` document of equally weighted draws; only `columns`, `effects` and `discrepancy` are read.
    #[schema(value_type = Option<Object>)]
    pub posterior: Option<Map<String, Value>>,
    /// With the prior: up to 20 equally likely sets of effects of typical size. Default: one empty set.
    pub sets: Option<Vec<Vec<String>>>,
    /// Standard deviation of observed positions, m. Default: 0.005.
    pub noise: Option<f64>,
    /// Number of experiments to choose jointly, up to 20. Default: 1.
    pub batch: Option<u64>,
    /// Costs, to maximise information per cost. With a budget but no `batch`: as many experiments as it pays for, up to 20.
    pub costs: Option<CostsIn>,
    /// Number of random candidate actions, up to 2000. Default: 400.
    pub candidates: Option<u64>,
    /// Number of best candidates to evaluate precisely, up to 100. Default: 24.
    pub shortlist: Option<u64>,
    /// Number of sampled worlds for the precise evaluation, 8 to 256. Default: 128.
    pub worlds: Option<u64>,
    /// Number of perturbed copies per action, whose spread counts as noise, 2 to 8. Default: 4.
    pub copies: Option<u64>,
    /// Maximum perturbation of an action component, up to 1. Default: 0.002.
    pub perturb: Option<f64>,
    /// `auto`, or the name of an engine.
    pub engine: Option<String>,
    pub seed: Option<u64>,
}

/// Costs of experiments, in any unit, such as minutes.
#[derive(Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct CostsIn {
    /// Cost of an experiment. Default: 1.
    pub trial: Option<f64>,
    /// Additional cost of setting up a task, once per task of the batch. Default: 0.
    pub setup: Option<f64>,
    /// Maximum cost of the batch. Default: unlimited.
    pub budget: Option<f64>,
}

impl CostsIn {
    fn costs(&self) -> Costs {
        let usual = Costs::default();
        let (trial, setup) = (self.trial.unwrap_or(usual.trial), self.setup.unwrap_or(usual.setup));
        Costs { trial, setup, budget: self.budget }
    }
}

impl DesignIn {
    /// The configuration of the search.
    pub fn config(&self) -> Result<DesignConfig> {
        let question = Question::from_name(self.question.as_deref().unwrap_or("latents"))?;
        let usual = DesignConfig::standard(question, self.seed.unwrap_or(0));
        let whole = |field: &str, value: Option<u64>, default: usize, [least, most]: [u64; 2]| match value {
            None => Ok(default),
            Some(v) if (least..=most).contains(&v) => Ok(v as usize),
            Some(v) => Err(Error::input(field, v, format!("a whole number from {least} to {most}"))),
        };
        let costs = self.costs.as_ref().map_or(usual.costs, CostsIn::costs);
        let candidates = whole("candidates", self.candidates, usual.candidates, [1, 2000])?;
        let asked = whole("batch", self.batch, usual.batch, [1, 20])?;
        let shortlist = whole("shortlist", self.shortlist, usual.shortlist.max(asked), [1, 100])?;
        let paid = self.batch.is_none() && costs.budget.is_some();
        let batch = if paid { shortlist.min(candidates).min(20) } else { asked };
        let config = DesignConfig {
            candidates,
            shortlist,
            worlds: [usual.worlds[0], whole("worlds", self.worlds, usual.worlds[1], [8, 256])?],
            copies: whole("copies", self.copies, usual.copies, [2, 8])?,
            perturb: self.perturb.unwrap_or(usual.perturb),
            noise: self.noise.unwrap_or(usual.noise),
            batch,
            costs,
            engine: engine(self.engine.as_deref())?,
            ..usual
        };
        config.validate()?;
        Ok(config)
    }

    /// Sets of effects of the prior; an error together with a posterior, which has its own.
    pub fn sets(&self) -> Result<Vec<Vec<String>>> {
        match (&self.posterior, &self.sets) {
            (Some(_), Some(_)) => {
                Err(Error::input("sets", "given together with posterior", "one or the other"))
            }
            (_, Some(sets)) if sets.is_empty() || sets.len() > 20 => {
                Err(Error::input("sets", format!("{} sets", sets.len()), "1 to 20 sets of effects"))
            }
            (_, sets) => Ok(sets.clone().unwrap_or_else(|| vec![Vec::new()])),
        }
    }
}
