//! Plans as jobs: a task's actions ranked by rollouts under what is believed of the world.

use std::sync::Arc;
use std::time::Duration;

use serde::{Deserialize, Serialize};
use serde_json::{Value, json};

use super::text::json;
use crate::budget::Budget;
use crate::error::{Error, Result};
use crate::estimate::Belief;
use crate::estimate::belief::PRIOR_DRAWS;
use crate::job::{Context, New, Outcome, Work};
use crate::json::from_value;
use crate::plan::{PlanConfig, document, plan};
use crate::serve::app::App;
use crate::serve::leave::Leave;
use crate::serve::operation::{ACT, Body, Keep, Operation, post};
use crate::serve::shared::Base;
use crate::serve::wire::{Believing, JobOut, PlanIn};
use crate::task::family;

/// What can be planned.
pub fn operations() -> Vec<Operation> {
    vec![
        post("start_plan", "/v1/plans", "workflow", ACT)
            .about(
                "Ranks a task's actions by how likely they solve it under what is believed of the world. A job; its \
                 result is an\n`iplw.plan/1` document: actions best first, those of trying everything, with \
                 probabilities from fresh draws.",
            )
            .refuses(&[(404, "Unknown task")])
            .queues(KIND, begin, work),
    ]
}

const KIND: &str = "plan";

/// A plan with everything decided.
#[derive(Serialize, Deserialize)]
struct Wanted {
    task: String,
    believing: Believing,
    setup: PlanConfig,
    /// Of the race.
    seconds: Option<f64>,
}

/// Queues a plan.
fn begin(app: &App, Body(body): Body<PlanIn>, keep: Keep<JobOut>) -> Result<JobOut> {
    let task = app.catalogue.named(&body.task)?;
    if !body.task.contains(':') {
        let allowed = format!("one of its tasks, `{}` say", task.tasks[0].id);
        return Err(Error::input("task", format!("{:?}", body.task), allowed));
    }
    let (name, seconds, setup) = (body.task.clone(), body.seconds, body.config()?);
    let believing = body.believing()?;
    let belief = believed(&name, &believing, &setup)?;
    // What was asked for, without the draws themselves.
    let about = json!({"source": belief.source(), "draws": belief.draws().len()});
    let config = json!({"task": name, "belief": about, "seconds": seconds, "config": json(&setup)?});
    let (seed, wanted) = (setup.seed, Wanted { task: name, believing, setup, seconds });
    let new = New { kind: KIND, config: &config, plan: &json(&wanted)?, seed };
    Ok(app.jobs().submit(new, &|job| keep(&job.into()))?.into())
}

/// The draws of a belief.
fn believed(task: &str, believing: &Believing, setup: &PlanConfig) -> Result<Belief> {
    match believing {
        Believing::Prior { effects } => {
            let prior = family(task.split(':').next().unwrap_or_default())?.prior;
            Belief::prior(prior, effects.clone(), PRIOR_DRAWS.max(2 * setup.draws), setup.seed)
        }
        Believing::Point { latents, effects } => Belief::point(*latents, effects.clone()),
        Believing::Posterior { document } => {
            Belief::from_value(document.clone()).map_err(|e| e.under("belief"))
        }
    }
}

/// The work of a plan: begun again, it does everything again, and finds the same unless a clock ended it.
fn work(base: &Arc<Base>, wanted: &Value) -> Result<Work> {
    let wanted: Wanted = from_value(wanted.clone())?;
    let base = base.clone();
    Ok(Box::new(move |context| {
        let task = base.catalogue.task(&wanted.task)?;
        let belief = believed(&wanted.task, &wanted.believing, &wanted.setup)?;
        let clock = wanted.seconds.map(|s| Leave::of(Duration::from_secs_f64(s)));
        let time = Time { context, clock };
        let found = plan(&task, &belief, &wanted.setup, &time, context)?;
        base.metrics.simulated(found.rollouts as u64);
        Ok(Outcome::Done(json(&document(&found, &wanted.setup, &belief))?))
    }))
}

/// The job's own end, and that of the race.
struct Time<'a> {
    context: &'a Context<'a>,
    clock: Option<Arc<Leave>>,
}

impl Budget for Time<'_> {
    fn look(&self) -> Result<()> {
        self.context.look()?;
        self.clock.as_ref().map_or(Ok(()), |clock| clock.look())
    }
}
