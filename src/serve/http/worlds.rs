//! `/v1/worlds`

use axum::http::{HeaderValue, StatusCode, header};
use axum::response::{IntoResponse, Response};

use super::extract::{Caller, Form, JsonBody, Pairs, Params, Sent};
use super::stream::answer_streamed;
use super::{Keep, answer, answer_light, answer_once, answer_page};
use crate::serve::app::App;
use crate::serve::operations::render::{self, Picture};
use crate::serve::operations::world;
use crate::serve::problem::{Answer, Problem};
use crate::serve::wire::{
    BatchOut, CreateWorld, LatentsIn, ResetIn, ResetOut, RolloutIn, StepIn, StepOut, WorldOut, Worlds,
};

/// Worlds in order of id.
#[utoipa::path(get, path = "/v1/worlds", tag = "worlds", operation_id = "list_worlds",
    params(
        ("limit" = Option<u32>, Query, description = "Most items, 1 to 1000; default 100"),
        ("cursor" = Option<String>, Query, description = "`next` of the page before"),
    ),
    responses(
        (status = 200, body = Worlds),
        (status = 422, body = Problem, content_type = "application/problem+json"),
    ))]
pub async fn list(app: Caller, Pairs(pairs): Pairs) -> Answer<Response> {
    answer_page(&app, pairs, world::list).await
}

/// Makes a world; it outlives the server, and goes when nobody has used it for a while.
#[utoipa::path(post, path = "/v1/worlds", tag = "worlds", operation_id = "create_world",
    params(("Idempotency-Key" = Option<String>, Header, description = "Repeated under the same key, the request has no further effect and is answered the same")),
    request_body = CreateWorld,
    responses(
        (status = 201, body = WorldOut, headers(("Location" = String, description = "Where the world is"))),
        (status = 400, body = Problem, content_type = "application/problem+json"),
        (status = 404, body = Problem, content_type = "application/problem+json", description = "Unknown task"),
        (status = 413, body = Problem, content_type = "application/problem+json"),
        (status = 422, body = Problem, content_type = "application/problem+json"),
        (status = 429, body = Problem, content_type = "application/problem+json", description = "No room for more worlds"),
    ))]
pub async fn create(app: Caller, sent: Sent) -> Answer<Response> {
    let (body, _) = sent.json::<CreateWorld>()?;
    let place = |w: &WorldOut| Some(format!("/v1/worlds/{}", w.id));
    let work = move |app: &App, keep: Keep<WorldOut>| world::create(app, body, keep);
    answer_once(&app, sent.once, StatusCode::CREATED, place, work).await
}

/// One world.
#[utoipa::path(get, path = "/v1/worlds/{id}", tag = "worlds", operation_id = "get_world",
    params(("id" = String, Path)),
    responses(
        (status = 200, body = WorldOut),
        (status = 404, body = Problem, content_type = "application/problem+json"),
    ))]
pub async fn get(app: Caller, Params(id): Params<String>) -> Answer<Response> {
    answer_light(&app, true, StatusCode::OK, move |app| world::get(app, &id)).await
}

/// Forgets a world; the default ones come back when the server restarts.
#[utoipa::path(delete, path = "/v1/worlds/{id}", tag = "worlds", operation_id = "delete_world",
    params(("id" = String, Path)),
    responses(
        (status = 204, description = "Gone"),
        (status = 404, body = Problem, content_type = "application/problem+json"),
    ))]
pub async fn delete(app: Caller, Params(id): Params<String>) -> Answer<Response> {
    app.run(move |app| Ok(world::delete(app, &id)?)).await?;
    Ok(StatusCode::NO_CONTENT.into_response())
}

/// Starts an episode. Without a seed, the world's own sequence of tasks goes on.
#[utoipa::path(post, path = "/v1/worlds/{id}/reset", tag = "worlds", operation_id = "reset_world",
    params(("id" = String, Path)),
    request_body = ResetIn,
    responses(
        (status = 200, body = ResetOut),
        (status = 400, body = Problem, content_type = "application/problem+json"),
        (status = 404, body = Problem, content_type = "application/problem+json", description = "Unknown world or task"),
        (status = 422, body = Problem, content_type = "application/problem+json"),
    ))]
pub async fn reset(
    app: Caller,
    Params(id): Params<String>,
    JsonBody(body): JsonBody<ResetIn>,
) -> Answer<Response> {
    let light = world::is_light(&app, [id.as_str()].into_iter());
    answer_light(&app, light, StatusCode::OK, move |app| world::reset(app, &id, body)).await
}

/// Carries out an action. An action that cannot be placed is an outcome (`valid: false`), not an attempt.
#[utoipa::path(post, path = "/v1/worlds/{id}/step", tag = "worlds", operation_id = "step_world",
    params(("id" = String, Path)),
    request_body = StepIn,
    responses(
        (status = 200, body = StepOut),
        (status = 400, body = Problem, content_type = "application/problem+json"),
        (status = 404, body = Problem, content_type = "application/problem+json"),
        (status = 409, body = Problem, content_type = "application/problem+json", description = "Reset the world first"),
        (status = 422, body = Problem, content_type = "application/problem+json"),
        (status = 429, body = Problem, content_type = "application/problem+json", description = "The budget is spent"),
    ))]
pub async fn step(
    app: Caller,
    Params(id): Params<String>,
    JsonBody(body): JsonBody<StepIn>,
) -> Answer<Response> {
    let light = world::is_light(&app, [id.as_str()].into_iter());
    answer_light(&app, light, StatusCode::OK, move |app| world::step(app, &id, body)).await
}

/// Sets those latent factors that are given.
#[utoipa::path(post, path = "/v1/worlds/{id}/set_latents", tag = "worlds", operation_id = "set_latents",
    params(("id" = String, Path)),
    request_body = LatentsIn,
    responses(
        (status = 200, body = WorldOut),
        (status = 400, body = Problem, content_type = "application/problem+json"),
        (status = 403, body = Problem, content_type = "application/problem+json", description = "The world is real or sealed"),
        (status = 404, body = Problem, content_type = "application/problem+json"),
        (status = 422, body = Problem, content_type = "application/problem+json"),
    ))]
pub async fn set_latents(
    app: Caller,
    Params(id): Params<String>,
    JsonBody(body): JsonBody<LatentsIn>,
) -> Answer<Response> {
    answer(&app, StatusCode::OK, move |app| world::set_latents(app, &id, body)).await
}

/// Attempts many actions at once, leaving the episode as it is.
#[utoipa::path(post, path = "/v1/worlds/{id}/rollout", tag = "worlds", operation_id = "rollout_world",
    params(("id" = String, Path)),
    request_body = RolloutIn,
    responses(
        (status = 200, body = BatchOut),
        (status = 400, body = Problem, content_type = "application/problem+json"),
        (status = 404, body = Problem, content_type = "application/problem+json"),
        (status = 409, body = Problem, content_type = "application/problem+json", description = "No current task"),
        (status = 413, body = Problem, content_type = "application/problem+json", description = "Too many actions"),
        (status = 422, body = Problem, content_type = "application/problem+json"),
        (status = 429, body = Problem, content_type = "application/problem+json", description = "The budget is spent"),
    ))]
pub async fn rollout(
    app: Caller,
    Params(id): Params<String>,
    JsonBody(body): JsonBody<RolloutIn>,
) -> Answer<Response> {
    if app.form == Form::Json && body.trajectories == Some(true) {
        return answer_streamed(&app, move |app| world::rollout(app, &id, body, false)).await;
    }
    let raw = app.form.raw();
    answer(&app, StatusCode::OK, move |app| world::rollout(app, &id, body, raw)).await
}

/// Draws the scene, or films an action. A film in a real world is an interaction.
#[utoipa::path(get, path = "/v1/worlds/{id}/render", tag = "worlds", operation_id = "render_world",
    params(
        ("id" = String, Path),
        ("format" = Option<String>, Query, description = "`png` (default) or `svg`; an animation is SVG"),
        ("view" = Option<String>, Query, description = "`scene` (default), `filmstrip` or `animation`"),
        ("action" = Option<String>, Query, description = "`0.5,0.5,0.2`, or the number of a discrete action"),
        ("task" = Option<String>, Query, description = "Id of the task; the current one if absent"),
        ("width" = Option<u32>, Query, description = "Pixels, 16 to 4096; default 512"),
    ),
    responses(
        (status = 200, description = "The picture", content((Vec<u8> = "image/png"), (String = "image/svg+xml"))),
        (status = 400, body = Problem, content_type = "application/problem+json"),
        (status = 404, body = Problem, content_type = "application/problem+json"),
        (status = 409, body = Problem, content_type = "application/problem+json", description = "No current task"),
        (status = 422, body = Problem, content_type = "application/problem+json", description = "Also an action that cannot be placed"),
        (status = 429, body = Problem, content_type = "application/problem+json", description = "The budget is spent"),
    ))]
pub async fn render(app: Caller, Params(id): Params<String>, Pairs(pairs): Pairs) -> Answer<Response> {
    let drawn = app
        .run(move |app| {
            let picture = Picture::from_query(&pairs)?;
            Ok(render::render(app, &id, &picture)?)
        })
        .await?;
    let kind = HeaderValue::from_static(drawn.kind);
    Ok(([(header::CONTENT_TYPE, kind)], drawn.bytes).into_response())
}
