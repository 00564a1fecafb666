//! Designs as jobs: which experiment would tell the most about a question, under what is believed of the world.

use std::sync::Arc;

use serde::{Deserialize, Serialize};
use serde_json::{Value, json};

use super::text::json;
use crate::design::{DesignConfig, design, document, looks, parts};
use crate::error::Result;
use crate::estimate::Belief;
use crate::estimate::belief::PRIOR_DRAWS;
use crate::job::{New, Outcome, Work};
use crate::json::from_value;
use crate::serve::app::App;
use crate::serve::operation::{ACT, Body, Keep, Operation, post};
use crate::serve::shared::Base;
use crate::serve::wire::{DesignIn, JobOut};
use crate::task::family;

/// What can be designed.
pub fn operations() -> Vec<Operation> {
    vec![
        post("start_design", "/v1/designs", "workflow", ACT)
            .about(
                "Says which experiments would tell the most about a question under what is believed of the world, and why. \
                 A job; its\nresult is an `iplw.design/1` document: the batch in order, with expected information and its \
                 standard error.",
            )
            .refuses(&[(404, "Unknown task or effect")])
            .queues(KIND, begin, work),
    ]
}

const KIND: &str = "design";

/// A design with everything decided.
#[derive(Serialize, Deserialize)]
struct Wanted {
    task: String,
    /// A posterior's document; the prior where it is absent.
    belief: Option<Value>,
    sets: Vec<Vec<String>>,
    setup: DesignConfig,
}

/// Queues a design.
fn begin(app: &App, Body(body): Body<DesignIn>, keep: Keep<JobOut>) -> Result<JobOut> {
    app.catalogue.named(&body.task)?;
    let (setup, sets) = (body.config()?, body.sets()?);
    let wanted = Wanted { task: body.task, belief: body.belief.map(Value::Object), sets, setup };
    let belief = believed(&wanted)?;
    looks(&belief, &wanted.setup)?;
    // What was asked for, without the draws themselves.
    let about = json!({"source": belief.source(), "draws": belief.draws().len()});
    let config = json!({"task": wanted.task, "belief": about, "sets": wanted.belief.is_none().then_some(&wanted.sets), "config": json(&wanted.setup)?});
    let new = New { kind: KIND, config: &config, plan: &json(&wanted)?, seed: wanted.setup.seed };
    Ok(app.jobs().submit(new, &|job| keep(&job.into()))?.into())
}

fn believed(wanted: &Wanted) -> Result<Belief> {
    match &wanted.belief {
        Some(document) => Belief::from_value(document.clone()).map_err(|e| e.under("belief")),
        None => {
            let prior = family(wanted.task.split(':').next().unwrap_or_default())?.prior;
            Belief::of_sets(prior, &wanted.sets, PRIOR_DRAWS, wanted.setup.seed)
        }
    }
}

/// The work of a design: begun again, it does everything again, and finds the same.
fn work(base: &Arc<Base>, wanted: &Value) -> Result<Work> {
    let wanted: Wanted = from_value(wanted.clone())?;
    let base = base.clone();
    Ok(Box::new(move |context| {
        let (training, asked) = parts(&base.catalogue.named(&wanted.task)?.tasks);
        let found = design(&training, &asked, &believed(&wanted)?, &wanted.setup, context)?;
        base.metrics.simulated(found.rollouts as u64);
        Ok(Outcome::Done(json(&document(&found, &wanted.setup))?))
    }))
}
