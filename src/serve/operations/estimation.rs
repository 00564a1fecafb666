//! Estimation as a resumable job.
//!
//! Stored in this order: the proposed round; each measurement, in one transaction with the counter of its world; the finished
//! round. A restarted job resumes after the finished rounds, takes the open round as proposed, and measures only what is
//! missing. So no interaction is made or counted twice. The result is bit-identical unless others act in the same world
//! meanwhile, since noise depends on the number of the interaction.

use std::sync::Arc;
use std::time::Instant;

use serde::{Deserialize, Serialize};
use serde_json::Value;

use super::finished_round::FinishedRound;
use super::job::submit;
use super::json::{to_json, to_value};
use super::surface;
use crate::budget::Unlimited;
use crate::commands::{EstimationRequest, RealChoice, RealIn, effects};
use crate::error::{Error, Result};
use crate::estimate::{LatentEstimate, PerformanceSurface};
use crate::experiment::{
    EstimateConfig, PendingRound, Proposal, ProposalResult, Round, StopReason, Workflow, acquisition,
};
use crate::explore::Importance;
use crate::job::{JobContext, Work, WorkOutcome};
use crate::json::{JsonObject, from_value, parse};
use crate::progress::Progress;
use crate::serve::operation::{ACT, BodyWithJson, Operation, RecordResponse, post};
use crate::serve::request_context::RequestContext;
use crate::serve::state::CoreState;
use crate::serve::wire::JobOut;
use crate::session::{AttemptResult, Catalogue, SavedWorld, TaskSet, World, WorldConfig, WorldKind};
use crate::store::{MeasuredOutcomes, Store};
use crate::task::{DEFAULT_PRIOR, Scene, Split, Task, split};
use crate::trajectory::Trajectory;
use crate::world::Engine;

/// Operations on estimations.
pub fn operations() -> Vec<Operation> {
    vec![
        post("start_iplw", "/v1/iplw", "workflow", ACT)
            .about("Estimates the latents of a real world in rounds of exploring in simulation, measuring and fitting. A job.")
            .errors(&[(404, "Unknown task or world")])
            .links(202, "/v1/iplw/{id}", "/id")
            .job(KIND, begin, work),
    ]
}

/// Kind of an estimation's job.
pub const KIND: &str = "iplw";

/// A fully specified estimation.
#[derive(Serialize, Deserialize)]
pub struct EstimationJob {
    /// A family or one task; empty with a scene.
    pub task: String,
    /// The user's scene, instead of a task.
    #[serde(default)]
    pub scene: Option<Scene>,
    pub setup: EstimateConfig,
    pub real: RealitySource,
    /// Id of the performance surface, which weights the latents.
    #[serde(default)]
    pub surface: Option<String>,
    /// Maximum number of real interactions.
    pub budget: Option<u64>,
}

impl EstimationJob {
    /// The tasks of the job's family, task or scene.
    pub fn tasks(&self, catalogue: &Catalogue) -> Result<TaskSet> {
        match &self.scene {
            Some(scene) => TaskSet::explorable(scene.clone()),
            None => catalogue.named(&self.task),
        }
    }
}

/// Source of measurements.
#[derive(Serialize, Deserialize, PartialEq)]
#[serde(rename_all = "snake_case")]
pub enum RealitySource {
    /// A world of the registry, by id.
    World(String),
    /// A world created for this job.
    #[serde(rename = "own")]
    Dedicated(Box<SavedWorld>),
    /// The client's own world, by ask and tell.
    #[serde(rename = "asked")]
    AskTell,
}

/// Queues an estimation.
fn begin(
    app: &RequestContext,
    BodyWithJson(body, config): BodyWithJson<EstimationRequest>,
    keep: RecordResponse<JobOut>,
) -> Result<JobOut> {
    let scene = body.scene.clone().map(|JsonObject(scene)| scene);
    let tasks = match (&scene, body.task.is_empty()) {
        (None, false) => app.catalogue.named(&body.task)?,
        (Some(scene), true) => TaskSet::explorable(scene.clone()).map_err(|e| e.in_field("scene"))?,
        (None, true) => return Err(Error::input("task", "missing", "one of task and scene")),
        (Some(_), false) => {
            return Err(Error::input("scene", "given together with `task`", "one of task and scene"));
        }
    };
    let setup = body.config(EstimateConfig::fast(tasks.family.map_or(DEFAULT_PRIOR, |f| f.prior)))?;
    // Validate everything now, rather than fail later in the job.
    match (&body.surface, tasks.family) {
        (Some(id), Some(family)) => drop(surface::of_family(app.store(), family, id)?),
        (Some(id), None) => return Err(Error::input("surface", format!("{id:?}"), "none with a scene")),
        (None, None) if acquisition::needs_importance(&setup.strategy)? => {
            let allowed = "a strategy that needs no performance surface, such as informative or mixed";
            return Err(Error::input("strategy", format!("{:?}", setup.strategy), allowed));
        }
        (None, _) => {}
    }
    Workflow::new(&exploration_tasks(&tasks), &setup, Some(Arc::new(PlaceholderImportance)))?;
    let seed = setup.seed;
    let real = match (body.world, body.real) {
        (Some(_), Some(_)) => {
            return Err(Error::input("real", "given together with `world`", "one of world and real"));
        }
        (Some(id), None) => {
            let world = app.worlds().get(&id)?.world;
            if world.kind() != WorldKind::Real {
                return Err(Error::input("world", format!("{id:?}"), "a world of kind real"));
            }
            check_same_family(&tasks, world.tasks(), "world", &id)?;
            RealitySource::World(id)
        }
        (None, Some(RealChoice::AskTell)) => RealitySource::AskTell,
        (None, Some(RealChoice::World(real))) => {
            RealitySource::Dedicated(Box::new(dedicated_world(tasks, *real, seed)?))
        }
        (None, None) => RealitySource::Dedicated(Box::new(dedicated_world(tasks, RealIn::default(), seed)?)),
    };
    let plan =
        EstimationJob { task: body.task, scene, setup, real, surface: body.surface, budget: body.budget };
    submit(app, KIND, &config, &plan, seed, keep)
}

/// The work of an estimation.
fn work(base: &Arc<CoreState>, plan: &Value) -> Result<Work> {
    let plan: EstimationJob = from_value(plan.clone())?;
    let base = base.clone();
    // The reference keeps the world from expiring.
    let world = match &plan.real {
        RealitySource::World(id) => Some(base.worlds.get(id, base.now())?),
        RealitySource::Dedicated(_) | RealitySource::AskTell => None,
    };
    Ok(Box::new(move |context| run(&base, context, &plan, world.as_deref())))
}

/// The tasks that an estimation explores.
pub fn exploration_tasks(tasks: &TaskSet) -> Vec<Task> {
    if tasks.tasks.len() > 1 { split(&tasks.tasks, Split::Train) } else { tasks.tasks.to_vec() }
}

/// Parses a stored proposed round.
pub fn parse_pending_round(text: &str) -> Result<PendingRound> {
    parse(text)
}

/// Fails unless both task sets belong to one family.
pub fn check_same_family(tasks: &TaskSet, other: &TaskSet, field: &str, id: &str) -> Result<()> {
    let name = |t: &TaskSet| t.family.map_or_else(|| t.name.clone(), |f| f.name.to_string());
    if name(tasks) == name(other) {
        return Ok(());
    }
    let value = format!("{id:?} of {}", name(other));
    Err(Error::input(field, value, format!("a world of {}", name(tasks))))
}

fn run(
    base: &CoreState,
    context: &JobContext,
    plan: &EstimationJob,
    shared: Option<&World>,
) -> Result<WorkOutcome> {
    let started = Instant::now();
    let (store, job) = (&*base.store, context.number);
    let named = plan.tasks(&base.catalogue)?;
    let tasks = exploration_tasks(&named);
    let importance = importance(store, job, &named, plan, context)?;
    let mut workflow = resume_workflow(store, job, &tasks, &plan.setup, importance)?;
    let spent = || Ok(store.measured(job, 0)?.values().filter(|m| m.is_some()).count() as u64);
    let dedicated_world = open_dedicated_world(base, plan, spent)?;
    let world = shared.or(dedicated_world.as_ref());
    let id = match &plan.real {
        RealitySource::World(id) => Some(id.as_str()),
        RealitySource::Dedicated(_) | RealitySource::AskTell => None,
    };
    loop {
        let number = workflow.rounds().len() as u64;
        context.round(number, plan.setup.rounds as u64);
        if workflow.pending_round().is_none() {
            let left = [
                world.and_then(World::remaining),
                plan.budget.map(|b| b.saturating_sub(spent().unwrap_or(b))),
            ];
            if workflow.propose(left.into_iter().flatten().min(), context)?.is_none() {
                warn_of_budget(&workflow, context);
                break;
            }
            if let Some(asked) = workflow.pending_round() {
                store.open_round(job, number, &to_json(asked)?)?;
            }
        }
        let Some(asked) = workflow.pending_round().cloned() else { break };
        let first = asked.proposals.first().map_or(0, |p| p.number);
        if let Some(world) = world {
            let keep = |rows: &MeasuredOutcomes, interactions: u64| {
                store.put_measured(job, rows, id.map(|id| (id, interactions)), None)?;
                let valid = rows.values().filter(|m| m.is_some()).count() as u64;
                base.metrics.count_attempts(WorldKind::Real, valid, 0);
                Ok(())
            };
            measure(&workflow, world, &asked.proposals, &store.measured(job, first)?, &keep, context)?;
        }
        let measured = store.measured(job, first)?;
        let total = asked.proposals.len() as u64;
        if (measured.len() as u64) < total {
            let stage = format!("round {} of {}: waiting for trials", number + 1, plan.setup.rounds);
            context.report(&stage, measured.len() as u64, total)?;
            return Ok(WorkOutcome::Waiting);
        }
        warn_of_failed(&measured, context);
        let round = workflow.tell(&answers(&asked.proposals, &measured)?, context)?.clone();
        let (known, rollouts) = workflow.latent_estimates(context)?;
        base.metrics.count_rollouts(rollouts);
        store.close_round(job, number, &to_json(&finished_round(round, known))?)?;
    }
    if workflow.trials().is_empty() {
        return Err(nothing_measured(plan, world));
    }
    context.round(plan.setup.rounds as u64, plan.setup.rounds as u64);
    let mut report = workflow.report(context)?;
    report.check_fit(workflow.trials(), context)?;
    report.seconds = Some(started.elapsed().as_secs_f64());
    base.metrics.count_rollouts(report.rollouts);
    Ok(WorkOutcome::Done(to_value(&report)?))
}

/// The real world of this estimation alone, with the interactions already spent; `None` if it has another source.
fn open_dedicated_world(
    base: &CoreState,
    plan: &EstimationJob,
    spent: impl Fn() -> Result<u64>,
) -> Result<Option<World>> {
    let RealitySource::Dedicated(saved) = &plan.real else { return Ok(None) };
    let world = World::new(SavedWorld::clone(saved).config(&base.catalogue)?)?;
    Ok(Some(base.worlds.count_copies(world.with_past(spent()?, None))))
}

/// A round for storage, without its measurements, which have their own table.
fn finished_round(round: Round, known: Vec<LatentEstimate>) -> FinishedRound {
    let answered = Some(round.answers.iter().map(|a| a.number).collect());
    FinishedRound { round: Round { answers: Vec::new(), ..round }, known, answered }
}

/// Warns in the job's log that the budget is exhausted.
fn warn_of_budget(workflow: &Workflow, context: &JobContext) {
    if workflow.ended() == Some(StopReason::Budget) {
        context.warn("the budget of real interactions is exhausted: no more rounds");
    }
}

/// Warns in the job's log about proposals that could not be carried out.
fn warn_of_failed(measured: &MeasuredOutcomes, context: &JobContext) {
    let failed = measured.values().filter(|m| m.is_none()).count();
    if failed > 0 {
        context.warn(&format!("{failed} of {} proposals could not be carried out", measured.len()));
    }
}

/// The importance of latents for strategies that need it: from the named surface or a default one.
fn importance(
    store: &Store,
    job: i64,
    tasks: &TaskSet,
    plan: &EstimationJob,
    progress: &dyn Progress,
) -> Result<Option<Arc<dyn Importance>>> {
    let Some(family) = tasks.family else { return Ok(None) };
    if plan.surface.is_none() && !acquisition::needs_importance(&plan.setup.strategy)? {
        return Ok(None);
    }
    // Stored with the job, since the surface can be deleted meanwhile.
    if let Some(kept) = store.artifact(job, SURFACE_ARTIFACT)? {
        let kept = String::from_utf8(kept).map_err(|e| Error::Failed(format!("a stored surface: {e}")))?;
        return Ok(Some(Arc::new(PerformanceSurface::from_json(&kept)?)));
    }
    let found = surface::importance(store, family, plan.surface.as_deref(), progress)?;
    store.put_artifact(job, SURFACE_ARTIFACT, found.to_json().as_bytes())?;
    Ok(Some(Arc::new(found)))
}

/// Name of the job artifact with its performance surface.
const SURFACE_ARTIFACT: &str = "surface";

/// Placeholder for a surface while a request is validated.
struct PlaceholderImportance;

impl Importance for PlaceholderImportance {
    fn gradient(&self, _: [f64; 3]) -> [f64; 3] {
        [f64::NAN; 3]
    }
}

/// Restores the workflow from the store.
fn resume_workflow(
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
                let FinishedRound { round: bare, .. } = parse(&done)?;
                rounds.push(Round { answers: answers(&bare.proposals, &measured)?, ..bare });
            }
            None => open = Some(parse_pending_round(&row.asked)?),
        }
    }
    let workflow = Workflow::new(tasks, setup, importance)?.resume(rounds)?;
    Ok(match open {
        Some(asked) => workflow.reopen(asked),
        None => workflow,
    })
}

/// The measurements of these proposals, without failed ones.
fn answers(proposals: &[Proposal], measured: &MeasuredOutcomes) -> Result<Vec<ProposalResult>> {
    let found = proposals.iter().filter_map(|p| Some((p.number, measured.get(&p.number)?.as_ref()?)));
    found.map(|(number, text)| Ok(ProposalResult { number, observed: parse::<Trajectory>(text)? })).collect()
}

/// Measures the proposals that are not `done`, task by task, storing the results after each task.
fn measure(
    workflow: &Workflow,
    world: &World,
    proposals: &[Proposal],
    done: &MeasuredOutcomes,
    keep: &dyn Fn(&MeasuredOutcomes, u64) -> Result<()>,
    progress: &dyn Progress,
) -> Result<()> {
    let (mut made, total) = (done.len() as u64, proposals.len() as u64);
    let open = proposals.iter().filter(|p| !done.contains_key(&p.number));
    for (task, of_it, actions) in workflow.by_task(open)? {
        progress.report("measuring the real world", made, total)?;
        let rows = |results: &[AttemptResult], interactions: u64| {
            let row = |(p, r): (&&Proposal, &AttemptResult)| {
                Ok((p.number, r.as_ref().ok().map(to_json).transpose()?))
            };
            keep(&of_it.iter().zip(results).map(row).collect::<Result<MeasuredOutcomes>>()?, interactions)
        };
        world.attempts(task, &actions, Some(&rows), &Unlimited)?;
        made += of_it.len() as u64;
    }
    Ok(())
}

fn nothing_measured(plan: &EstimationJob, world: Option<&World>) -> Error {
    match world {
        Some(world) => Error::Budget {
            limit: [world.budget(), plan.budget].into_iter().flatten().min().unwrap_or(0),
            spent: world.interactions(),
            asked: 1,
        },
        None => Error::Failed("no proposal could be carried out: nothing was measured".into()),
    }
}

/// The family's standard real world with the given changes.
fn dedicated_world(tasks: TaskSet, real: RealIn, seed: u64) -> Result<SavedWorld> {
    let latents = real.latents.map(|JsonObject(l)| l.checked("real.latents.")).transpose()?;
    let config = WorldConfig {
        tasks,
        kind: WorldKind::Real,
        engine: Engine::Auto,
        latents: latents.unwrap_or_default(),
        effects: effects(real.damping, real.effects, "real.")?,
        noise: crate::error::check_range("real.noise", real.noise.unwrap_or(0.0), 0.0, 1e3)?,
        budget: None,
        max_attempts: 1,
        sealed: None,
        seed,
    };
    Ok(SavedWorld::of(&config))
}
