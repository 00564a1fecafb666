//! Designs to make.

use serde::Deserialize;
use serde_json::{Map, Value};
use utoipa::ToSchema;

use super::world::engine;
use crate::design::{Costs, DesignConfig, Question};
use crate::error::{Error, Result};

/// Tasks on which experiments are looked for, what is asked, and what is believed of the world: the `belief` of a posterior or, if it is
/// not given, the family's prior with one of the `sets` of effects each.
#[derive(Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct DesignIn {
    /// A family, of which the training tasks are meant, or one task, `bowling:017`.
    pub task: String,
    /// `latents` (how large they are, and effects' parameters; the default), `effects` (which of the belief's sets the world has) or
    /// `success` (whether what is planned for the test tasks solves them).
    pub question: Option<String>,
    /// An `iplw.posterior/1` document: equally likely draws as `columns`, of which only those, `effects` and `unnamed` are read.
    #[schema(value_type = Option<Object>)]
    pub belief: Option<Map<String, Value>>,
    /// Of the prior: sets of effects that the world may have, as large as they usually are; equally likely, up to 20. Default: one
    /// that is empty.
    pub sets: Option<Vec<Vec<String>>>,
    /// Standard deviation with which a position is seen, m; default 0.005.
    pub noise: Option<f64>,
    /// Experiments to choose, together, up to 20; default 1.
    pub batch: Option<u64>,
    /// What they cost: those are chosen that tell most for it. With a budget and without `batch`, as many as it pays for, up to 20.
    pub costs: Option<CostsIn>,
    /// Random actions that are looked at, up to 2000; default 400.
    pub candidates: Option<u64>,
    /// So many of the best are looked at closely, up to 100; default 24.
    pub shortlist: Option<u64>,
    /// Worlds in which the best are looked at, 8 to 256; default 128.
    pub worlds: Option<u64>,
    /// Copies of an action whose spread counts as noise, 2 to 8; default 4.
    pub copies: Option<u64>,
    /// Most that a component of an action is moved in a copy, up to 1; default 0.002.
    pub perturb: Option<f64>,
    /// `auto`, or the name of an engine.
    pub engine: Option<String>,
    pub seed: Option<u64>,
}

/// What experiments cost, in the unit of the budget: minutes, say.
#[derive(Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct CostsIn {
    /// Every experiment; default 1.
    pub trial: Option<f64>,
    /// What it costs more to set a task up, once for every task of the batch; default 0.
    pub setup: Option<f64>,
    /// Most that the batch may cost; default: as much as its size asks for.
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
    /// How the design is searched for.
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

    /// Sets of effects of the prior; an error where a belief says which there are.
    pub fn sets(&self) -> Result<Vec<Vec<String>>> {
        match (&self.belief, &self.sets) {
            (Some(_), Some(_)) => Err(Error::input("sets", "given beside belief", "one or the other")),
            (_, Some(sets)) if sets.is_empty() || sets.len() > 20 => {
                Err(Error::input("sets", format!("{} sets", sets.len()), "1 to 20 sets of effects"))
            }
            (_, sets) => Ok(sets.clone().unwrap_or_else(|| vec![Vec::new()])),
        }
    }
}
