//! Worlds as resources.

use std::fmt::{self, Display};
use std::slice::from_ref;
use std::str::FromStr;
use std::time::Duration;

use super::batch::execution_class;
use super::rollouts::suggest_job;
use crate::commands::LatentsIn;
use crate::error::{Error, Result};
use crate::serve::execution_class::ExecutionClass;
use crate::serve::operation::{
    ACT, AcceptsBinaryArrays, EventStream, Extractor, JsonBody, LastEventId, NextEvent, Operation,
    OperationDoc, OperationRequest, OperationResponse, Pagination, PathId, Payload, READ, RecordResponse,
    ServerEvent, delete, get, location, post,
};
use crate::serve::problem::HandlerResult;
use crate::serve::request_context::RequestContext;
use crate::serve::wire::{
    CreateWorld, ResetOut, RolloutIn, RolloutOut, StepIn, StepOut, WatchStart, WorldEventOut, WorldOut,
    WorldsPage, drawable_scene,
};
use crate::session::{ListedWorld, Reset, World, WorldList, WorldWatcher};

/// Operations on one world.
pub fn operations() -> Vec<Operation> {
    vec![
        get("list_worlds", "/v1/worlds", "worlds", READ)
            .about("Lists worlds, by default in order of id.")
            .links(200, "/v1/worlds/{id}", "/worlds/0/id")
            .handler(list),
        post("create_world", "/v1/worlds", "worlds", ACT)
            .about("Creates a world. It survives restarts and expires when idle.")
            .errors(&[(404, "Unknown task"), (413, ""), (429, "Too many worlds")])
            .links(201, "/v1/worlds/{id}", "/id")
            .create_handler(201, location("URL of the world", |w: &WorldOut| format!("/v1/worlds/{}", w.id)), create),
        get("get_world", "/v1/worlds/{id}", "worlds", READ)
            .about("Returns a world.")
            .errors(&[(404, "")])
            .classified_handler(|_, _| ExecutionClass::Inline, one),
        delete("delete_world", "/v1/worlds/{id}", "worlds", ACT)
            .about("Deletes a world; default worlds are created again when the server restarts.")
            .errors(&[(404, "")])
            .handler(|app, PathId(id)| app.worlds().remove(&id)),
        get("watch_world", "/v1/worlds/{id}/events", "worlds", READ)
            .about(
                "Streams a world's events as server-sent events: first `world` with the world and its scene, then `reset`, \
                 `step`,\n`attempts` and `latents`, with observations, and finally `gone`. With `Last-Event-ID`, later events \
                 that are still buffered\n(`docs/reference/limits.md`); slow clients miss the oldest. Hidden properties are not \
                 included.",
            )
            .media_response(200, "Events", &["text/event-stream"])
            .event_schema::<WatchStart>()
            .event_schema::<WorldEventOut>()
            .errors(&[(404, ""), (422, "")])
            .http_only()
            .handler(watch),
        post("reset_world", "/v1/worlds/{id}/reset", "worlds", ACT)
            .about("Starts an episode. Without a seed, the world's task sequence continues.")
            .errors(&[(404, "Unknown world or task")])
            .classified_handler(|app, (PathId(id), _)| execution_class(app, from_ref(id)), reset),
        post("step_world", "/v1/worlds/{id}/step", "worlds", ACT)
            .about(
                "Attempts an action. An action that cannot be placed returns `valid: false` and is not counted.",
            )
            .errors(&[(404, ""), (409, "Reset the world first"), (429, "The budget is exhausted")])
            .classified_handler(|app, (PathId(id), _)| execution_class(app, from_ref(id)), step),
        post("set_latents", "/v1/worlds/{id}/set_latents", "worlds", ACT)
            .about("Sets the given latent factors.")
            .errors(&[(403, "The world is real or sealed"), (404, "")])
            .handler(set_latents),
        post("rollout_world", "/v1/worlds/{id}/rollout", "worlds", ACT)
            .about("Attempts many actions at once, without changing the current episode.")
            .errors(&[
                (403, "Interventions in a real or sealed world"),
                (404, ""),
                (409, "No current task"),
                (413, "Too many actions"),
                (429, "The budget is spent"),
            ])
            .classified_handler(rollout_class, rollout),
    ]
}

/// Query parameters of a list of worlds.
struct WorldsQuery(bool, Pagination);

impl Extractor for WorldsQuery {
    fn describe(to: &mut OperationDoc) {
        to.query::<String>("order", "`id` (default), or `used`: most recently used first");
        Pagination::describe(to);
    }

    fn extract(from: &mut OperationRequest) -> HandlerResult<WorldsQuery> {
        let mut query = from.query()?;
        let order = query.iter().position(|(name, _)| name == "order").map(|at| query.remove(at).1);
        let by_use = match order.as_deref() {
            None | Some("id") => false,
            Some("used") => true,
            Some(other) => return Err(Error::input("order", format!("{other:?}"), "id or used").into()),
        };
        Ok(WorldsQuery(by_use, Pagination::from_query(&query)?))
    }
}

/// Cursor of worlds ordered by use: last use, ns, and id of the last world on a page.
struct LastUseCursor(Duration, String);

impl Display for LastUseCursor {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        write!(f, "{} {}", self.0.as_nanos(), self.1)
    }
}

impl FromStr for LastUseCursor {
    type Err = ();

    fn from_str(text: &str) -> std::result::Result<LastUseCursor, ()> {
        let (used, id) = text.split_once(' ').ok_or(())?;
        Ok(LastUseCursor(Duration::from_nanos(used.parse().map_err(drop)?), id.into()))
    }
}

fn list(app: &RequestContext, WorldsQuery(by_use, page): WorldsQuery) -> Result<WorldsPage> {
    // A cursor is only valid for the list it came from.
    let (mut all, next);
    if by_use {
        let after = page.after("worlds-used")?.map(|LastUseCursor(used, id)| (used, id));
        all = app.worlds().list(&WorldList::ByUse { after }, page.fetch_limit())?;
        next = page.truncate("worlds-used", &mut all, |w| LastUseCursor(w.used, w.id.clone()));
    } else {
        let after = page.after("worlds")?.unwrap_or_default();
        all = app.worlds().list(&WorldList::ById { after }, page.fetch_limit())?;
        next = page.truncate("worlds", &mut all, |w| w.id.clone());
    }
    let now = app.now();
    Ok(WorldsPage { worlds: all.iter().map(|w| WorldOut::of(w, app.describe(w), now)).collect(), next })
}

fn create(
    app: &RequestContext,
    JsonBody(body): JsonBody<CreateWorld>,
    keep: RecordResponse<WorldOut>,
) -> Result<WorldOut> {
    let id = app.worlds().new_id();
    let config = body.config(&app.catalogue)?;
    let out = |w: &World| WorldOut::new(&id, app.owner(), w.describe());
    let world = app.worlds().make(&id, config, &|w| keep(&out(w)))?;
    Ok(out(&world))
}

fn one(app: &RequestContext, PathId(id): PathId) -> Result<WorldOut> {
    Ok(described(app, &app.worlds().get(&id)?))
}

fn watch(
    app: &RequestContext,
    (PathId(id), LastEventId(seen)): (PathId, LastEventId),
) -> Result<OperationResponse> {
    let listed = app.worlds().listed_world(&id)?;
    // Subscribe before reading the state, so that no event is missed.
    let watcher = listed.world.watch(seen);
    let tasks = &listed.world.tasks().tasks;
    let first = WatchStart {
        task: listed.world.describe().current.unwrap_or_else(|| tasks[0].id.clone()),
        scene: drawable_scene(&listed.world.scene(None, None)?),
        world: described(app, &listed),
    };
    let data =
        serde_json::to_string(&first).map_err(|e| Error::Failed(format!("cannot serialise a world: {e}")))?;
    let first = Some(ServerEvent { id: None, name: "world", data });
    Ok(OperationResponse::ok(Payload::EventStream(Box::new(WorldEventStream { first, watcher }))))
}

/// The state of a world, followed by its events.
struct WorldEventStream {
    first: Option<ServerEvent>,
    watcher: WorldWatcher,
}

impl EventStream for WorldEventStream {
    fn next(&mut self) -> NextEvent<'_> {
        Box::pin(async {
            if let Some(first) = self.first.take() {
                return Some(first);
            }
            let event = WorldEventOut::from(self.watcher.next().await?);
            let data = serde_json::to_string(&event).ok()?;
            Some(ServerEvent { id: Some(event.number), name: event.what, data })
        })
    }

    fn has_last_word(&self) -> bool {
        false
    }
}

fn reset(app: &RequestContext, (PathId(id), JsonBody(body)): (PathId, JsonBody<Reset>)) -> Result<ResetOut> {
    let world = app.worlds().get(&id)?.world;
    Ok(world.reset(&body)?.into())
}

fn step(app: &RequestContext, (PathId(id), JsonBody(body)): (PathId, JsonBody<StepIn>)) -> Result<StepOut> {
    let world = app.worlds().get(&id)?.world;
    let step = world.step(&body.action, body.episode, app.budget()).map_err(suggest_job)?;
    app.metrics.count_attempts(world.kind(), u64::from(step.invalid.is_none()), u64::from(step.steps));
    Ok(step.into())
}

fn set_latents(
    app: &RequestContext,
    (PathId(id), JsonBody(body)): (PathId, JsonBody<LatentsIn>),
) -> Result<WorldOut> {
    let listed = app.worlds().get(&id)?;
    listed.world.set_latents(body.checked("")?)?;
    Ok(described(app, &listed))
}

fn described(app: &RequestContext, listed: &ListedWorld) -> WorldOut {
    WorldOut::of(listed, app.describe(listed), app.now())
}

/// Attempts many actions; trajectories are binary arrays if the client accepts them.
fn rollout(
    app: &RequestContext,
    (PathId(id), JsonBody(body), AcceptsBinaryArrays(raw)): (
        PathId,
        JsonBody<RolloutIn>,
        AcceptsBinaryArrays,
    ),
) -> Result<RolloutOut> {
    let world = app.worlds().get(&id)?.world;
    let batch = body.batch()?;
    let rolled = world.rollout(&batch, app.budget()).map_err(suggest_job)?;
    app.metrics.count_attempts(world.kind(), rolled.valid, rolled.steps());
    Ok(RolloutOut::new(rolled, batch.trajectories, raw))
}

fn rollout_class(
    _: &RequestContext,
    (_, JsonBody(body), _): &(PathId, JsonBody<RolloutIn>, AcceptsBinaryArrays),
) -> ExecutionClass {
    if body.trajectories == Some(true) { ExecutionClass::Streaming } else { ExecutionClass::Compute }
}
