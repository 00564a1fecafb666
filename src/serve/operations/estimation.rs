//! Estimations as jobs that survive: the workflow, its real world, and what of both is on the disk.
//!
//! What is kept, in this order: the round as proposed; every measurement, in one transaction with the counter of
//! the world it was made in; the round as finished. A job that is begun again resumes from the finished rounds,
//! takes up the open one as it was proposed, and measures only what is not measured yet. So no interaction is
//! ever made twice or counted twice: those that the killed process made and kept are used, and those it did not
//! keep were not counted either, in a world whose counter was not moved on. The result is the same bits, as long as
//! nobody else acts in the world meanwhile (noise is drawn by the number of the interaction).

use std::sync::Arc;
use std::time::Instant;

use serde::{Deserialize, Serialize};
use serde_json::Value;

use super::closed::Closed;
use super::surface;
use super::text::{json, text};
use crate::budget::Endless;
use crate::error::{Error, Result};
use crate::estimate::{LatentEstimate, Surface};
use crate::experiment::{
    Answer, Asked, EstimateConfig, Proposal, ResidualKind, Round, Stopped, Workflow, ways,
};
use crate::explore::Importance;
use crate::job::{Context, New, Outcome, Work};
use crate::json::{from_value, parse};
use crate::progress::Progress;
use crate::serve::app::App;
use crate::serve::operation::{ACT, Keep, Kept, Operation, post};
use crate::serve::shared::Base;
use crate::serve::wire::{Estimation, JobOut, Object, RealChoice, RealIn, effects};
use crate::session::{Kind, SavedWorld, TaskSet, Tried, World, WorldConfig};
use crate::store::{Measured, Store};
use crate::task::{Split, Task, ValidAction, split};
use crate::trajectory::Trajectory;
use crate::world::{EffectParameter, Engine};

/// What can be asked about the latents of a real world.
pub fn operations() -> Vec<Operation> {
    vec![
        post("start_iplw", "/v1/iplw", "workflow", ACT)
            .about("Estimates the latents of a real world: explore in simulation, measure, fit. A job.")
            .refuses(&[(404, "Unknown task or world")])
            .leads_to(202, "/v1/iplw/{id}", "/id")
            .queues(KIND, begin, work),
    ]
}

/// The kind of job.
pub const KIND: &str = "iplw";

/// An estimation with everything decided.
#[derive(Serialize, Deserialize)]
pub struct Plan {
    /// A family or one task.
    pub task: String,
    pub setup: EstimateConfig,
    pub real: Real,
    /// Id of the surface that says which latents matter.
    #[serde(default)]
    pub surface: Option<String>,
    /// Most real interactions of this job.
    pub budget: Option<u64>,
}

/// Where measurements come from.
#[derive(Serialize, Deserialize, PartialEq)]
#[serde(rename_all = "snake_case")]
pub enum Real {
    /// A world of the server, by id.
    World(String),
    /// A world of this job alone.
    Own(Box<SavedWorld>),
    /// Whoever asks for proposals and tells answers.
    Asked,
}

/// Queues an estimation.
fn begin(app: &App, Kept(body, config): Kept<Estimation>, keep: Keep<JobOut>) -> Result<JobOut> {
    let tasks = app.catalogue.named(&body.task)?;
    let family = tasks.family.ok_or_else(|| Error::Failed("a built-in task without a family".into()))?;
    let mut setup = EstimateConfig::fast(family.prior);
    let whole = |field: &str, value: Option<u64>, default: usize| match value {
        None => Ok(default),
        Some(v) => usize::try_from(v).map_err(|_| Error::input(field, v, "a smaller whole number")),
    };
    setup.strategy = body.strategy.unwrap_or(setup.strategy);
    if let Some(name) = &body.residual {
        setup.residual = ResidualKind::from_name(name).map_err(named)?;
    }
    for name in body.fit.iter().flatten() {
        setup.cem.fit_along(EffectParameter::parse(name).map_err(named)?);
    }
    setup.rounds = whole("rounds", body.rounds, setup.rounds)?;
    setup.actions = whole("actions", body.actions, setup.actions)?;
    setup.candidates = setup.candidates.max(setup.actions.saturating_mul(10));
    if let Some(samples) = body.samples {
        if !(4..=100_000).contains(&samples) {
            return Err(Error::input("samples", samples, "a whole number from 4 to 100000"));
        }
        let samples = samples as usize;
        setup.cem.elites = (samples * setup.cem.elites / setup.cem.samples).max(2);
        setup.cem.samples = samples;
    }
    setup.seed = body.seed.unwrap_or(0);
    setup.validate().map_err(named)?;
    // What cannot be begun is better refused now than failed later.
    if let Some(id) = &body.surface {
        surface::of_family(app.store(), family, id)?;
    }
    Workflow::new(&explored(&tasks), &setup, Some(Arc::new(Unfound))).map_err(named)?;
    let seed = setup.seed;
    let real = match (body.world, body.real) {
        (Some(_), Some(_)) => {
            return Err(Error::input("real", "given beside `world`", "one of world and real"));
        }
        (Some(id), None) => {
            let world = app.worlds().get(&id)?;
            if world.kind() != Kind::Real {
                return Err(Error::input("world", format!("{id:?}"), "a world of kind real"));
            }
            same_family(&tasks, world.tasks(), "world", &id)?;
            Real::World(id)
        }
        (None, Some(RealChoice::AskTell)) => Real::Asked,
        (None, Some(RealChoice::World(real))) => Real::Own(Box::new(own(tasks, *real, seed)?)),
        (None, None) => Real::Own(Box::new(own(tasks, RealIn::default(), seed)?)),
    };
    let plan = json(&Plan { task: body.task, setup, real, surface: body.surface, budget: body.budget })?;
    let new = New { kind: KIND, config: &config, plan: &plan, seed };
    Ok(app.jobs().submit(new, &|job| keep(&job.into()))?.into())
}

/// The work of a plan.
fn work(base: &Arc<Base>, plan: &Value) -> Result<Work> {
    let plan: Plan = from_value(plan.clone())?;
    let base = base.clone();
    // Held from now on, so that it does not idle out.
    let world = match &plan.real {
        Real::World(id) => Some(base.worlds.get(id, base.now())?),
        Real::Own(_) | Real::Asked => None,
    };
    Ok(Box::new(move |context| run(&base, context, &plan, world.as_deref())))
}

/// The tasks that an estimation explores.
pub fn explored(tasks: &TaskSet) -> Vec<Task> {
    if tasks.tasks.len() > 1 { split(&tasks.tasks, Split::Train) } else { tasks.tasks.to_vec() }
}

/// A round as it was proposed.
pub fn asked(text: &str) -> Result<Asked> {
    parse(text)
}

/// Errors unless both are tasks of one family.
pub fn same_family(tasks: &TaskSet, other: &TaskSet, field: &str, id: &str) -> Result<()> {
    let name = |t: &TaskSet| t.family.map_or_else(|| t.name.clone(), |f| f.name.to_string());
    if name(tasks) == name(other) {
        return Ok(());
    }
    let value = format!("{id:?} of {}", name(other));
    Err(Error::input(field, value, format!("a world of {}", name(tasks))))
}

fn run(base: &Base, context: &Context, plan: &Plan, shared: Option<&World>) -> Result<Outcome> {
    let started = Instant::now();
    let (store, job) = (&*base.store, context.number);
    let named = base.catalogue.named(&plan.task)?;
    let tasks = explored(&named);
    let importance = importance(store, job, &named, plan, context)?;
    let mut workflow = resumed(store, job, &tasks, &plan.setup, importance)?;
    let spent = || Ok(store.measured(job, 0)?.values().filter(|m| m.is_some()).count() as u64);
    let own = match &plan.real {
        Real::Own(saved) => {
            let world = World::new(SavedWorld::clone(saved).config(&base.catalogue)?)?;
            Some(world.with_past(spent()?, None))
        }
        Real::World(_) | Real::Asked => None,
    };
    let world = shared.or(own.as_ref());
    let id = match &plan.real {
        Real::World(id) => Some(id.as_str()),
        Real::Own(_) | Real::Asked => None,
    };
    loop {
        let number = workflow.rounds().len() as u64;
        context.round(number, plan.setup.rounds as u64);
        if workflow.asked().is_none() {
            let left = [
                world.and_then(World::remaining),
                plan.budget.map(|b| b.saturating_sub(spent().unwrap_or(b))),
            ];
            if workflow.propose(left.into_iter().flatten().min(), context)?.is_none() {
                warn_of_budget(&workflow, context);
                break;
            }
            if let Some(asked) = workflow.asked() {
                store.open_round(job, number, &text(asked)?)?;
            }
        }
        let Some(asked) = workflow.asked().cloned() else { break };
        let first = asked.proposals.first().map_or(0, |p| p.number);
        if let Some(world) = world {
            let keep = |rows: &Measured, interactions: u64| {
                store.put_measured(job, rows, id.map(|id| (id, interactions)), None)?;
                base.metrics.attempted(Kind::Real, rows.values().filter(|m| m.is_some()).count() as u64, 0);
                Ok(())
            };
            measure(&workflow, world, &asked.proposals, &store.measured(job, first)?, &keep, context)?;
        }
        let measured = store.measured(job, first)?;
        let total = asked.proposals.len() as u64;
        if (measured.len() as u64) < total {
            let stage = format!("round {} of {}: waiting for answers", number + 1, plan.setup.rounds);
            context.report(&stage, measured.len() as u64, total)?;
            return Ok(Outcome::Waiting);
        }
        warn_of_failed(&measured, context);
        let round = workflow.tell(&answers(&asked.proposals, &measured)?, context)?.clone();
        let (known, rollouts) = workflow.known(context)?;
        base.metrics.simulated(rollouts);
        store.close_round(job, number, &text(&closed(round, known))?)?;
    }
    if workflow.trials().is_empty() {
        return Err(nothing_measured(plan, world));
    }
    context.round(plan.setup.rounds as u64, plan.setup.rounds as u64);
    let mut report = workflow.report(context)?;
    report.seconds = Some(started.elapsed().as_secs_f64());
    base.metrics.simulated(report.rollouts);
    Ok(Outcome::Done(json(&report)?))
}

/// A round as it is kept: its measurements have a table of their own.
fn closed(round: Round, known: Vec<LatentEstimate>) -> Closed {
    let answered = Some(round.answers.iter().map(|a| a.number).collect());
    Closed { round: Round { answers: Vec::new(), ..round }, known, answered }
}

/// Tells the job's owner that nothing is left to measure with.
fn warn_of_budget(workflow: &Workflow, context: &Context) {
    if workflow.ended() == Some(Stopped::Budget) {
        context.warn("the budget of real interactions is spent: no more rounds");
    }
}

/// Tells the job's owner of proposals that could not be carried out.
fn warn_of_failed(measured: &Measured, context: &Context) {
    let failed = measured.values().filter(|m| m.is_none()).count();
    if failed > 0 {
        context.warn(&format!("{failed} of {} proposals could not be carried out", measured.len()));
    }
}

/// What the strategy is told of what matters: nothing, unless it asks or a surface is named.
fn importance(
    store: &Store,
    job: i64,
    tasks: &TaskSet,
    plan: &Plan,
    progress: &dyn Progress,
) -> Result<Option<Arc<dyn Importance>>> {
    let Some(family) = tasks.family else { return Ok(None) };
    if plan.surface.is_none() && !ways::needs_importance(&plan.setup.strategy)? {
        return Ok(None);
    }
    // The job's own from then on: a surface may be forgotten meanwhile.
    if let Some(kept) = store.artifact(job, SURFACE)? {
        let kept = String::from_utf8(kept).map_err(|e| Error::Failed(format!("a stored surface: {e}")))?;
        return Ok(Some(Arc::new(Surface::from_json(&kept)?)));
    }
    let found = surface::importance(store, family, plan.surface.as_deref(), progress)?;
    store.put_artifact(job, SURFACE, found.to_json().as_bytes())?;
    Ok(Some(Arc::new(found)))
}

/// The artifact that holds the surface an estimation began with.
const SURFACE: &str = "surface";

/// Stands in for a surface while a request is checked.
struct Unfound;

impl Importance for Unfound {
    fn gradient(&self, _: [f64; 3]) -> [f64; 3] {
        [f64::NAN; 3]
    }
}

/// The workflow as it stands in the store.
fn resumed(
    store: &Store,
    job: i64,
    tasks: &[Task],
    setup: &EstimateConfig,
    importance: Option<Arc<dyn Importance>>,
) -> Result<Workflow> {
    let measured = store.measured(job, 0)?;
    let (mut rounds, mut open) = (Vec::new(), None);
    for row in store.rounds(job)? {
        match row.done {
            Some(done) => {
                let Closed { round: bare, .. } = parse(&done)?;
                rounds.push(Round { answers: answers(&bare.proposals, &measured)?, ..bare });
            }
            None => open = Some(asked(&row.asked)?),
        }
    }
    let workflow = Workflow::new(tasks, setup, importance)?.resume(rounds)?;
    Ok(match open {
        Some(asked) => workflow.reopen(asked),
        None => workflow,
    })
}

/// What was measured of these proposals; those that could not be carried out are left out.
fn answers(proposals: &[Proposal], measured: &Measured) -> Result<Vec<Answer>> {
    let found = proposals.iter().filter_map(|p| Some((p.number, measured.get(&p.number)?.as_ref()?)));
    found.map(|(number, text)| Ok(Answer { number, observed: parse::<Trajectory>(text)? })).collect()
}

/// Carries out those proposals that are not `done`, task by task, keeping what every task brings.
fn measure(
    workflow: &Workflow,
    world: &World,
    proposals: &[Proposal],
    done: &Measured,
    keep: &dyn Fn(&Measured, u64) -> Result<()>,
    progress: &dyn Progress,
) -> Result<()> {
    let mut by_task: Vec<(&str, Vec<&Proposal>)> = Vec::new();
    for proposal in proposals.iter().filter(|p| !done.contains_key(&p.number)) {
        match by_task.iter_mut().find(|(task, _)| *task == proposal.task) {
            Some((_, of_it)) => of_it.push(proposal),
            None => by_task.push((&proposal.task, vec![proposal])),
        }
    }
    let (mut made, total) = (done.len() as u64, proposals.len() as u64);
    for (id, of_it) in by_task {
        progress.report("measuring the real world", made, total)?;
        let task = workflow.task(id)?;
        let actions: Vec<ValidAction> = of_it.iter().map(|p| p.action_on(task)).collect::<Result<_>>()?;
        let rows = |results: &[Tried], interactions: u64| {
            let row = |(p, r): (&&Proposal, &Tried)| Ok((p.number, r.as_ref().ok().map(text).transpose()?));
            keep(&of_it.iter().zip(results).map(row).collect::<Result<Measured>>()?, interactions)
        };
        world.attempts(task, &actions, Some(&rows), &Endless)?;
        made += of_it.len() as u64;
    }
    Ok(())
}

fn nothing_measured(plan: &Plan, world: Option<&World>) -> Error {
    match world {
        Some(world) => Error::Budget {
            limit: [world.budget(), plan.budget].into_iter().flatten().min().unwrap_or(0),
            spent: world.interactions(),
            asked: 1,
        },
        None => Error::Failed("no proposal could be carried out: nothing was measured".into()),
    }
}

/// The standard real world of the family, but for what is given.
fn own(tasks: TaskSet, real: RealIn, seed: u64) -> Result<SavedWorld> {
    let latents = real.latents.map(|Object(l)| l.checked("real.latents.")).transpose()?;
    let config = WorldConfig {
        tasks,
        kind: Kind::Real,
        engine: Engine::Auto,
        latents: latents.unwrap_or_default(),
        effects: effects(real.damping, real.effects, "real.")?,
        noise: crate::error::within("real.noise", real.noise.unwrap_or(0.0), 0.0, 1e3)?,
        budget: None,
        sealed: None,
        seed,
    };
    Ok(SavedWorld::of(&config))
}

/// The core's errors with the request's names of fields.
fn named(error: Error) -> Error {
    match error {
        Error::NotFound { kind: kind @ ("strategy" | "residual"), id, known } => {
            Error::input(kind, format!("{id:?}"), format!("one of {}", known.join(", ")))
        }
        Error::NotFound { kind: "effect" | "effect parameter", id, known } => {
            Error::input("fit", format!("{id:?}"), format!("one of {}", known.join(", ")))
        }
        Error::Input(mut input) if input.field == "candidates" => {
            input.field = "actions".into();
            input.allowed = "a whole number from 1 to 10000".into();
            Error::Input(input)
        }
        other => other,
    }
}
