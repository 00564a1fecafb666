//! `/v1/batch`

use axum::http::StatusCode;
use axum::response::{IntoResponse, Response};

use super::extract::{Caller, JsonBody, Sent};
use super::{Keep, answer_light, answer_once};
use crate::serve::app::App;
use crate::serve::operations::batch;
use crate::serve::problem::{Answer, Problem};
use crate::serve::wire::{
    CreateWorlds, ResetWorlds, StepWorlds, WorldIds, WorldsMade, WorldsReset, WorldsStepped,
};

/// Makes many worlds that differ in their seeds; all of them or none.
#[utoipa::path(post, path = "/v1/batch/worlds", tag = "batch", operation_id = "create_worlds",
    params(("Idempotency-Key" = Option<String>, Header, description = "Repeated under the same key, the request has no further effect and is answered the same")),
    request_body = CreateWorlds,
    responses(
        (status = 201, body = WorldsMade),
        (status = 400, body = Problem, content_type = "application/problem+json"),
        (status = 404, body = Problem, content_type = "application/problem+json", description = "Unknown task"),
        (status = 413, body = Problem, content_type = "application/problem+json"),
        (status = 422, body = Problem, content_type = "application/problem+json"),
        (status = 429, body = Problem, content_type = "application/problem+json", description = "No room for more worlds"),
    ))]
pub async fn create(app: Caller, sent: Sent) -> Answer<Response> {
    let (body, _) = sent.json::<CreateWorlds>()?;
    let work = move |app: &App, keep: Keep<WorldsMade>| batch::create(app, body, keep);
    answer_once(&app, sent.once, StatusCode::CREATED, |_| None, work).await
}

/// Forgets many worlds; all of them or none.
#[utoipa::path(delete, path = "/v1/batch/worlds", tag = "batch", operation_id = "delete_worlds",
    request_body = WorldIds,
    responses(
        (status = 204, description = "Gone"),
        (status = 400, body = Problem, content_type = "application/problem+json"),
        (status = 404, body = Problem, content_type = "application/problem+json"),
        (status = 413, body = Problem, content_type = "application/problem+json"),
        (status = 422, body = Problem, content_type = "application/problem+json"),
    ))]
pub async fn delete(app: Caller, JsonBody(body): JsonBody<WorldIds>) -> Answer<Response> {
    app.run(move |app| Ok(batch::delete(app, body)?)).await?;
    Ok(StatusCode::NO_CONTENT.into_response())
}

/// Starts an episode in each of many worlds (those of the mask); in all of them or none.
#[utoipa::path(post, path = "/v1/batch/reset", tag = "batch", operation_id = "reset_worlds",
    request_body = ResetWorlds,
    responses(
        (status = 200, body = WorldsReset),
        (status = 400, body = Problem, content_type = "application/problem+json"),
        (status = 404, body = Problem, content_type = "application/problem+json", description = "Unknown world or task"),
        (status = 413, body = Problem, content_type = "application/problem+json"),
        (status = 422, body = Problem, content_type = "application/problem+json"),
    ))]
pub async fn reset(app: Caller, JsonBody(body): JsonBody<ResetWorlds>) -> Answer<Response> {
    let light = batch::is_light(&app, &body.worlds);
    answer_light(&app, light, StatusCode::OK, move |app| batch::reset(app, body)).await
}

/// Carries out one action in each of many worlds, simulated as one batch. An error in any entry names it, and then
/// nothing was done.
#[utoipa::path(post, path = "/v1/batch/step", tag = "batch", operation_id = "step_worlds",
    request_body = StepWorlds,
    responses(
        (status = 200, body = WorldsStepped),
        (status = 400, body = Problem, content_type = "application/problem+json"),
        (status = 404, body = Problem, content_type = "application/problem+json", description = "Unknown world"),
        (status = 409, body = Problem, content_type = "application/problem+json", description = "Reset that world first"),
        (status = 413, body = Problem, content_type = "application/problem+json"),
        (status = 422, body = Problem, content_type = "application/problem+json"),
        (status = 429, body = Problem, content_type = "application/problem+json", description = "The budget is spent"),
    ))]
pub async fn step(app: Caller, JsonBody(body): JsonBody<StepWorlds>) -> Answer<Response> {
    let light = batch::is_light(&app, &body.worlds);
    answer_light(&app, light, StatusCode::OK, move |app| batch::step(app, body)).await
}
