//! Control worlds: environments of control tasks that are driven in many steps.

use std::sync::{Arc, Mutex};

use crate::control::{ControlModel, ControlPhysics, ControlWorld, ControlWorldConfig};
use crate::error::{Error, Result};
use crate::json::JsonObject;
use crate::picture::{Style, scene_svg_within, svg_to_png_within};
use crate::serve::operation::{
    ACT, Extractor, JsonBody, MediaBody, Operation, OperationDoc, OperationRequest, PathId, READ, delete,
    get, post,
};
use crate::serve::problem::HandlerResult;
use crate::serve::request_context::RequestContext;
use crate::serve::wire::{
    ControlResetIn, ControlResetOut, ControlRolloutIn, ControlRolloutOut, ControlStepIn, ControlStepOut,
    ControlTaskOut, ControlTasksOut, ControlWorldOut, CreateControlWorld, PhysicsIn,
};
use crate::session::WorldKind;
use crate::sync::lock;
use crate::task::control::control_tasks;

/// Most simulation steps in one request.
const MAX_SIMULATION_STEPS: u64 = 10_000_000;

/// Operations on control worlds.
pub fn operations() -> Vec<Operation> {
    vec![
        get("list_control_tasks", "/v1/control/tasks", "control", READ)
            .about("Lists the built-in control tasks: pendulum, cart-pole, acrobot, arm and ball on a beam.")
            .handler(|_, ()| Ok(ControlTasksOut { tasks: control_tasks().iter().map(ControlTaskOut::from).collect() })),
        post("create_control_world", "/v1/control/worlds", "control", ACT)
            .about(
                "Creates environments of a control task, simulated or with the task's hidden physics. They are in memory: they \
                 expire when idle,\nand end with the server.",
            )
            .response::<ControlWorldOut>(201, "")
            .errors(&[(404, "Unknown task"), (429, "Too many worlds")])
            .links(201, "/v1/control/worlds/{id}", "/id")
            .handler(create),
        get("get_control_world", "/v1/control/worlds/{id}", "control", READ)
            .about("Returns a control world.")
            .errors(&[(404, "")])
            .handler(|app, PathId(id)| Ok(ControlWorldOut::new(&id, &lock(&*world(app, &id)?)))),
        delete("delete_control_world", "/v1/control/worlds/{id}", "control", ACT)
            .about("Deletes a control world.")
            .errors(&[(404, "")])
            .handler(|app, PathId(id)| app.shared().core.control_worlds.remove(&id, app.visible_owner())),
        post("reset_control_world", "/v1/control/worlds/{id}/reset", "control", ACT)
            .about("Starts episodes in all environments, or in those that a mask selects.")
            .errors(&[(404, "")])
            .handler(reset),
        post("step_control_world", "/v1/control/worlds/{id}/step", "control", ACT)
            .about("Steps every environment once: commands hold for the task's interval.")
            .errors(&[(404, ""), (409, "An environment must be reset first"), (413, "")])
            .compute_handler(step),
        post("rollout_control_world", "/v1/control/worlds/{id}/rollout", "control", ACT)
            .about("Simulates many sequences of actions from an environment's state, which does not change.")
            .errors(&[(404, ""), (409, "The world is real, or must be reset first"), (413, "")])
            .compute_handler(rollout),
        get("render_control_world", "/v1/control/worlds/{id}/render", "control", READ)
            .about("Draws the current state of an environment, as PNG.")
            .media_response(200, "The image", &["image/png"])
            .errors(&[(404, ""), (409, "The environment must be reset first"), (422, "")])
            .compute_handler(render),
        post("set_control_physics", "/v1/control/worlds/{id}/set_physics", "control", ACT)
            .about(
                "Replaces the effects of a simulated world, from the next resets on, and its noise at once. Parameters with ranges \
                 are\ndrawn at each reset.",
            )
            .errors(&[(404, ""), (409, "The world is real")])
            .handler(set_physics),
    ]
}

fn world(app: &RequestContext, id: &str) -> Result<Arc<Mutex<ControlWorld>>> {
    app.shared().core.control_worlds.get(id, app.visible_owner(), app.now())
}

fn create(
    app: &RequestContext,
    JsonBody(mut body): JsonBody<CreateControlWorld>,
) -> Result<(u16, ControlWorldOut)> {
    let model = body.model()?;
    let kind = body.kind.unwrap_or(WorldKind::Sim);
    let physics = match (kind, body.physics) {
        (WorldKind::Real, None) => ControlPhysics::new(&model.task.real, &model.tree, "real.")?,
        (WorldKind::Sim, physics) => physics_of(&model, physics.map(|JsonObject(physics)| physics))?,
        (WorldKind::Real, Some(_)) => {
            let allowed = "absent: a real world has the physics of its task";
            return Err(Error::input("physics", "given for a real world", allowed));
        }
    };
    let world = ControlWorld::new(ControlWorldConfig {
        model: Arc::new(model),
        kind,
        physics,
        count: body.count.unwrap_or(1),
        reward: body.reward.unwrap_or_default(),
        seed: body.seed.unwrap_or(0),
    })?;
    let id = app.worlds().new_id();
    let out = ControlWorldOut::new(&id, &world);
    let shared = app.shared();
    shared.core.control_worlds.add(&id, world, app.owner(), app.now(), &shared.registry_config())?;
    Ok((201, out))
}

fn physics_of(model: &ControlModel, physics: Option<PhysicsIn>) -> Result<ControlPhysics> {
    let reality = physics.map(PhysicsIn::reality).unwrap_or_default();
    ControlPhysics::new(&reality, &model.tree, "physics.")
}

fn reset(
    app: &RequestContext,
    (PathId(id), JsonBody(body)): (PathId, JsonBody<ControlResetIn>),
) -> Result<ControlResetOut> {
    let world = world(app, &id)?;
    let mut world = lock(&*world);
    let outcomes = world.reset(body.seed, body.mask.as_deref())?;
    Ok(ControlResetOut::new(outcomes, &world.config.model))
}

fn step(
    app: &RequestContext,
    (PathId(id), JsonBody(body)): (PathId, JsonBody<ControlStepIn>),
) -> Result<ControlStepOut> {
    let world = world(app, &id)?;
    let mut world = lock(&*world);
    check_work(&world.config.model, world.config.count, 1)?;
    let autoreset = body.autoreset.unwrap_or_default();
    let steps = world.step(&body.actions, autoreset)?;
    Ok(ControlStepOut::new(steps, autoreset, world.usage.motion_seconds))
}

fn rollout(
    app: &RequestContext,
    (PathId(id), JsonBody(body)): (PathId, JsonBody<ControlRolloutIn>),
) -> Result<ControlRolloutOut> {
    let longest = body.actions.iter().map(Vec::len).max().unwrap_or(0);
    if let Some(empty) = body.actions.iter().position(Vec::is_empty) {
        return Err(Error::input(format!("actions[{empty}]"), "empty", "at least one step"));
    }
    if body.actions.is_empty() {
        return Err(Error::input("actions", "empty", "at least one sequence"));
    }
    let world = world(app, &id)?;
    let world = lock(&*world);
    check_work(&world.config.model, body.actions.len(), longest)?;
    let rolled = world.rollouts(body.environment.unwrap_or(0), &body.actions)?;
    Ok(ControlRolloutOut::new(&rolled, longest))
}

/// Query parameters of a picture: an environment, and the width, px.
struct ControlRenderQuery(usize, u32);

impl Extractor for ControlRenderQuery {
    fn describe(to: &mut OperationDoc) {
        to.query::<u32>("environment", "Number of the environment. Default: 0");
        to.query::<u32>("width", "Width in pixels, 16 to 4096. Default: 512");
    }

    fn extract(from: &mut OperationRequest) -> HandlerResult<ControlRenderQuery> {
        let mut out = ControlRenderQuery(0, 512);
        for (key, value) in from.query()? {
            let refuse = |allowed: &str| Error::input(key.as_str(), format!("{value:?}"), allowed);
            match key.as_str() {
                "environment" => out.0 = value.parse().map_err(|_| refuse("the number of an environment"))?,
                "width" => {
                    let width = value.parse().ok().filter(|width| (16..=4096).contains(width));
                    out.1 = width.ok_or_else(|| refuse("a whole number of pixels from 16 to 4096"))?;
                }
                _ => return Err(refuse("a parameter environment or width").into()),
            }
        }
        Ok(out)
    }
}

fn render(
    app: &RequestContext,
    (PathId(id), ControlRenderQuery(environment, width)): (PathId, ControlRenderQuery),
) -> Result<MediaBody> {
    let world = world(app, &id)?;
    let (scene, [left, bottom, right, top]) = {
        let world = lock(&*world);
        let model = &world.config.model;
        let state = world.state(environment)?;
        (model.tree.posed(&model.task.scene, &state.position), model.tree.reach())
    };
    // Square, as frames of films are.
    let half = 0.55 * (right - left).max(top - bottom);
    let [x, y] = [0.5 * (left + right), 0.5 * (bottom + top)];
    let svg = scene_svg_within(
        &scene,
        [x - half, y - half, x + half, y + half],
        &Style { width, ..Style::default() },
    );
    Ok(MediaBody { kind: "image/png", bytes: svg_to_png_within(app.budget(), &svg, width)? })
}

fn set_physics(
    app: &RequestContext,
    (PathId(id), JsonBody(body)): (PathId, JsonBody<PhysicsIn>),
) -> Result<ControlWorldOut> {
    let world = world(app, &id)?;
    let mut world = lock(&*world);
    let physics = physics_of(&world.config.model, Some(body))?;
    world.set_physics(physics)?;
    Ok(ControlWorldOut::new(&id, &world))
}

/// An error if a request asks for too many simulation steps.
fn check_work(model: &ControlModel, sequences: usize, steps: usize) -> Result<()> {
    let per_step = (model.task.interval / model.task.scene.time_step).round() as u64;
    let asked = (sequences as u64).saturating_mul(steps as u64).saturating_mul(per_step);
    if asked <= MAX_SIMULATION_STEPS {
        return Ok(());
    }
    let advice = "send several requests, or use a longer time_step";
    Err(Error::TooLarge { what: "simulation steps", asked, limit: MAX_SIMULATION_STEPS, advice })
}
