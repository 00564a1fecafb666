//! Worlds as resources.

use std::fmt::{self, Display};
use std::str::FromStr;
use std::time::Duration;

use super::attempts::or_as_a_job;
use crate::error::{Error, Result};
use crate::serve::app::App;
use crate::serve::operation::{
    ACT, Asked, Body, Content, Described, Events, Id, Input, Keep, LastEvent, Next, Operation, Page, READ,
    Raw, Reply, Told, at, delete, get, post,
};
use crate::serve::problem::Answer;
use crate::serve::weight::Weight;
use crate::serve::wire::{
    BatchOut, CreateWorld, HappenedOut, LatentsIn, ResetIn, ResetOut, RolloutIn, StepIn, StepOut, WatchOut,
    WorldOut, Worlds, drawn,
};
use crate::session::{World, WorldList, WorldWatcher};

/// What can be asked of one world.
pub fn operations() -> Vec<Operation> {
    vec![
        get("list_worlds", "/v1/worlds", "worlds", READ)
            .about("Worlds in order of id unless asked otherwise.")
            .leads_to(200, "/v1/worlds/{id}", "/worlds/0/id")
            .does(list),
        post("create_world", "/v1/worlds", "worlds", ACT)
            .about("Makes a world; it outlives the server, and goes when nobody has used it for a while.")
            .refuses(&[(404, "Unknown task"), (413, ""), (429, "No room for more worlds")])
            .leads_to(201, "/v1/worlds/{id}", "/id")
            .makes(201, at("Where the world is", |w: &WorldOut| format!("/v1/worlds/{}", w.id)), create),
        get("get_world", "/v1/worlds/{id}", "worlds", READ)
            .about("One world.")
            .refuses(&[(404, "")])
            .weighed(|_, _| Weight::Light, one),
        delete("delete_world", "/v1/worlds/{id}", "worlds", ACT)
            .about("Forgets a world; the default ones come back when the server restarts.")
            .refuses(&[(404, "")])
            .does(|app, Id(id)| app.worlds().remove(&id)),
        get("watch_world", "/v1/worlds/{id}/events", "worlds", READ)
            .about(
                "Watches a world: server-sent events, first `world` with the world as it stands and its scene, then what \
                 happens in it,\n`reset`, `step`, `attempts`, `latents` and at the end `gone`, with what was observed. With \
                 `Last-Event-ID`, what came after\nand is still kept (`docs/limits.md`); who reads too slowly misses the \
                 oldest. Nothing that the world hides is told.",
            )
            .answers_media(200, "Events", &["text/event-stream"])
            .tells::<WatchOut>()
            .tells::<HappenedOut>()
            .refuses(&[(404, ""), (422, "")])
            .only_http()
            .does(watch),
        post("reset_world", "/v1/worlds/{id}/reset", "worlds", ACT)
            .about("Starts an episode. Without a seed, the world's own sequence of tasks goes on.")
            .refuses(&[(404, "Unknown world or task")])
            .weighed(|app, (Id(id), _)| weight(app, id), reset),
        post("step_world", "/v1/worlds/{id}/step", "worlds", ACT)
            .about(
                "Carries out an action. An action that cannot be placed is an outcome (`valid: false`), not an \
                 attempt.",
            )
            .refuses(&[(404, ""), (409, "Reset the world first"), (429, "The budget is spent")])
            .weighed(|app, (Id(id), _)| weight(app, id), step),
        post("set_latents", "/v1/worlds/{id}/set_latents", "worlds", ACT)
            .about("Sets those latent factors that are given.")
            .refuses(&[(403, "The world is real or sealed"), (404, "")])
            .does(set_latents),
        post("rollout_world", "/v1/worlds/{id}/rollout", "worlds", ACT)
            .about("Attempts many actions at once, leaving the episode as it is.")
            .refuses(&[
                (403, "Interventions in a real or sealed world"),
                (404, ""),
                (409, "No current task"),
                (413, "Too many actions"),
                (429, "The budget is spent"),
            ])
            .weighed(size, rollout),
    ]
}

/// In which order, and which part of them.
struct Listing(bool, Page);

impl Input for Listing {
    fn describe(to: &mut Described) {
        to.query::<String>("order", "`id` (default), or `used`: those used last first");
        Page::describe(to);
    }

    fn read(from: &mut Asked) -> Answer<Listing> {
        let mut query = from.query()?;
        let order = query.iter().position(|(name, _)| name == "order").map(|at| query.remove(at).1);
        let by_use = match order.as_deref() {
            None | Some("id") => false,
            Some("used") => true,
            Some(other) => return Err(Error::input("order", format!("{other:?}"), "id or used").into()),
        };
        Ok(Listing(by_use, Page::from_query(&query)?))
    }
}

/// Where a page of worlds by their use ends: when the last of them was used, ns, and its id.
struct Used(Duration, String);

impl Display for Used {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        write!(f, "{} {}", self.0.as_nanos(), self.1)
    }
}

impl FromStr for Used {
    type Err = ();

    fn from_str(text: &str) -> std::result::Result<Used, ()> {
        let (used, id) = text.split_once(' ').ok_or(())?;
        Ok(Used(Duration::from_nanos(used.parse().map_err(drop)?), id.into()))
    }
}

fn list(app: &App, Listing(by_use, page): Listing) -> Result<Worlds> {
    // A cursor goes on with the list it came from.
    let (mut all, next);
    if by_use {
        let after = page.after("worlds-used")?.map(|Used(used, id)| (used, id));
        all = app.worlds().list(&WorldList::ByUse { after }, page.fetch())?;
        next = page.cut("worlds-used", &mut all, |w| Used(w.used, w.id.clone()));
    } else {
        let after = page.after("worlds")?.unwrap_or_default();
        all = app.worlds().list(&WorldList::ById { after }, page.fetch())?;
        next = page.cut("worlds", &mut all, |w| w.id.clone());
    }
    let now = app.now();
    Ok(Worlds { worlds: all.iter().map(|w| WorldOut::of(w, now)).collect(), next })
}

fn create(app: &App, Body(body): Body<CreateWorld>, keep: Keep<WorldOut>) -> Result<WorldOut> {
    let id = app.worlds().fresh_id();
    let config = body.config(&app.catalogue)?;
    let out = |w: &World| WorldOut::new(&id, app.owner(), w.describe());
    let world = app.worlds().make(&id, config, &|w| keep(&out(w)))?;
    Ok(out(&world))
}

fn one(app: &App, Id(id): Id) -> Result<WorldOut> {
    app.worlds().get(&id)?;
    Ok(WorldOut::of(&app.worlds().look(&id)?, app.now()))
}

fn watch(app: &App, (Id(id), LastEvent(seen)): (Id, LastEvent)) -> Result<Reply> {
    let listed = app.worlds().look(&id)?;
    // From before the look, so that nothing is missed.
    let watcher = listed.world.watch(seen);
    let tasks = &listed.world.tasks().tasks;
    let first = WatchOut {
        task: listed.world.describe().current.unwrap_or_else(|| tasks[0].id.clone()),
        scene: drawn(&listed.world.scene(None, None)?),
        world: WorldOut::of(&listed, app.now()),
    };
    let data =
        serde_json::to_string(&first).map_err(|e| Error::Failed(format!("a world cannot be told: {e}")))?;
    let first = Some(Told { id: None, name: "world", data });
    Ok(Reply::of(Content::Events(Box::new(Watch { first, watcher }))))
}

/// A world as it stands, and then what happens in it.
struct Watch {
    first: Option<Told>,
    watcher: WorldWatcher,
}

impl Events for Watch {
    fn next(&mut self) -> Next<'_> {
        Box::pin(async {
            if let Some(first) = self.first.take() {
                return Some(first);
            }
            let event = HappenedOut::from(self.watcher.next().await?);
            let data = serde_json::to_string(&event).ok()?;
            Some(Told { id: Some(event.number), name: event.what, data })
        })
    }

    fn has_last_word(&self) -> bool {
        false
    }
}

fn reset(app: &App, (Id(id), Body(body)): (Id, Body<ResetIn>)) -> Result<ResetOut> {
    let world = app.worlds().get(&id)?;
    Ok(world.reset(&body.into())?.into())
}

fn step(app: &App, (Id(id), Body(body)): (Id, Body<StepIn>)) -> Result<StepOut> {
    let world = app.worlds().get(&id)?;
    let step = world.step(&body.action.into(), app.budget()).map_err(or_as_a_job)?;
    app.metrics.attempted(world.kind(), u64::from(step.invalid.is_none()), u64::from(step.steps));
    Ok(step.into())
}

fn set_latents(app: &App, (Id(id), Body(body)): (Id, Body<LatentsIn>)) -> Result<WorldOut> {
    let world = app.worlds().get(&id)?;
    world.set_latents(body.checked("")?)?;
    Ok(WorldOut::of(&app.worlds().look(&id)?, app.now()))
}

/// Trajectories come as arrays where those are wanted apart.
fn rollout(app: &App, (Id(id), Body(body), Raw(raw)): (Id, Body<RolloutIn>, Raw)) -> Result<BatchOut> {
    let world = app.worlds().get(&id)?;
    let batch = body.batch()?;
    let rolled = world.rollout(&batch, app.budget()).map_err(or_as_a_job)?;
    app.metrics.attempted(world.kind(), rolled.valid, rolled.steps());
    Ok(BatchOut::new(rolled, batch.trajectories, raw))
}

fn size(_: &App, (_, Body(body), _): &(Id, Body<RolloutIn>, Raw)) -> Weight {
    if body.trajectories == Some(true) { Weight::Large } else { Weight::Heavy }
}

fn weight(app: &App, id: &str) -> Weight {
    if app.worlds().get(id).is_ok_and(|w| w.is_light()) { Weight::Light } else { Weight::Heavy }
}
