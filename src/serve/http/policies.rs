//! `/v1/policies`

use axum::http::{HeaderValue, StatusCode, header};
use axum::response::{IntoResponse, Response};

use super::extract::{Caller, JsonBody, Pairs, Params, RawBody, Sent};
use super::jobs::place;
use super::{Keep, answer, answer_once, answer_page, body_of, response};
use crate::serve::app::App;
use crate::serve::operations::{evaluation, learning, policy};
use crate::serve::problem::{Answer, Problem};
use crate::serve::wire::{ActIn, Acted, EvaluateIn, JobOut, LearnIn, Policies, PolicyOut, TrainIn};

/// Trains a policy in simulation. A job; its result names the policy.
#[utoipa::path(post, path = "/v1/policies", tag = "policies", operation_id = "train_policy",
    params(("Idempotency-Key" = Option<String>, Header, description = "Repeated under the same key, the request has no further effect and is answered the same")),
    request_body = TrainIn,
    responses(
        (status = 202, body = JobOut, headers(("Location" = String, description = "Where the job is"))),
        (status = 400, body = Problem, content_type = "application/problem+json"),
        (status = 404, body = Problem, content_type = "application/problem+json", description = "Unknown task"),
        (status = 422, body = Problem, content_type = "application/problem+json"),
        (status = 429, body = Problem, content_type = "application/problem+json", description = "Too many waiting jobs"),
    ))]
pub async fn train(app: Caller, sent: Sent) -> Answer<Response> {
    let (body, kept) = sent.json::<TrainIn>()?;
    let work = move |app: &App, keep: Keep<JobOut>| policy::training(app, body, &kept, keep);
    answer_once(&app, sent.once, StatusCode::ACCEPTED, place, work).await
}

/// Policies, oldest first; replacing its weights makes a policy young again.
#[utoipa::path(get, path = "/v1/policies", tag = "policies", operation_id = "list_policies",
    params(
        ("limit" = Option<u32>, Query, description = "Most items, 1 to 1000; default 100"),
        ("cursor" = Option<String>, Query, description = "`next` of the page before"),
    ),
    responses(
        (status = 200, body = Policies),
        (status = 422, body = Problem, content_type = "application/problem+json"),
    ))]
pub async fn list(app: Caller, Pairs(pairs): Pairs) -> Answer<Response> {
    answer_page(&app, pairs, policy::list).await
}

/// One policy.
#[utoipa::path(get, path = "/v1/policies/{id}", tag = "policies", operation_id = "get_policy",
    params(("id" = String, Path)),
    responses(
        (status = 200, body = PolicyOut),
        (status = 404, body = Problem, content_type = "application/problem+json"),
    ))]
pub async fn get(app: Caller, Params(id): Params<String>) -> Answer<Response> {
    answer(&app, StatusCode::OK, move |app| policy::get(app, &id)).await
}

/// Forgets a policy and its weights.
#[utoipa::path(delete, path = "/v1/policies/{id}", tag = "policies", operation_id = "delete_policy",
    params(("id" = String, Path)),
    responses(
        (status = 204, description = "Gone"),
        (status = 404, body = Problem, content_type = "application/problem+json"),
        (status = 409, body = Problem, content_type = "application/problem+json", description = "A policy that is always there"),
    ))]
pub async fn delete(app: Caller, Params(id): Params<String>) -> Answer<Response> {
    app.run(move |app| Ok(policy::delete(app, &id)?)).await?;
    Ok(StatusCode::NO_CONTENT.into_response())
}

/// A policy's weights, as safetensors.
#[utoipa::path(get, path = "/v1/policies/{id}/weights", tag = "policies", operation_id = "download_weights",
    params(("id" = String, Path)),
    responses(
        (status = 200, content_type = "application/octet-stream", body = Vec<u8>),
        (status = 404, body = Problem, content_type = "application/problem+json"),
        (status = 409, body = Problem, content_type = "application/problem+json", description = "A policy that has none: `random`, `untrained`"),
    ))]
pub async fn weights(app: Caller, Params(id): Params<String>) -> Answer<Response> {
    let bytes = app.run(move |app| Ok(policy::weights(app, &id)?)).await?;
    let kind = HeaderValue::from_static("application/octet-stream");
    Ok(([(header::CONTENT_TYPE, kind)], bytes).into_response())
}

/// Stores weights: makes the policy, or replaces its weights.
#[utoipa::path(put, path = "/v1/policies/{id}/weights", tag = "policies", operation_id = "upload_weights",
    params(("id" = String, Path)),
    request_body(content = Vec<u8>, content_type = "application/octet-stream"),
    responses(
        (status = 200, body = PolicyOut, description = "Replaced"),
        (status = 201, body = PolicyOut, description = "Made"),
        (status = 413, body = Problem, content_type = "application/problem+json"),
        (status = 422, body = Problem, content_type = "application/problem+json", description = "Not the weights of a policy"),
    ))]
pub async fn put_weights(
    app: Caller,
    Params(id): Params<String>,
    RawBody(bytes): RawBody,
) -> Answer<Response> {
    let form = app.form;
    let (body, new) = app
        .run(move |app| {
            let (stored, new) = policy::put_weights(app, &id, &bytes)?;
            Ok((body_of(stored, form)?, new))
        })
        .await?;
    Ok(response(if new { StatusCode::CREATED } else { StatusCode::OK }, form, body))
}

/// The actions a policy likes best on a task, of those that can be placed.
///
/// The policy `random`, always there, likes them in an order drawn once.
#[utoipa::path(post, path = "/v1/policies/{id}/act", tag = "policies", operation_id = "act",
    params(("id" = String, Path)),
    request_body = ActIn,
    responses(
        (status = 200, body = Acted),
        (status = 400, body = Problem, content_type = "application/problem+json"),
        (status = 404, body = Problem, content_type = "application/problem+json", description = "Unknown policy or task"),
        (status = 409, body = Problem, content_type = "application/problem+json", description = "`untrained`, which knows nothing yet"),
        (status = 422, body = Problem, content_type = "application/problem+json"),
    ))]
pub async fn act(
    app: Caller,
    Params(id): Params<String>,
    JsonBody(body): JsonBody<ActIn>,
) -> Answer<Response> {
    answer(&app, StatusCode::OK, move |app| policy::act(app, &id, &body)).await
}

/// Lets a policy learn on in a world, from random attempts on its training tasks. A job; its result names the new
/// policy. From the policy `untrained`, which is always there, this is direct learning: no simulation.
#[utoipa::path(post, path = "/v1/policies/{id}/learn", tag = "policies", operation_id = "learn_policy",
    params(
        ("id" = String, Path),
        ("Idempotency-Key" = Option<String>, Header, description = "Repeated under the same key, the request has no further effect and is answered the same"),
    ),
    request_body = LearnIn,
    responses(
        (status = 202, body = JobOut, headers(("Location" = String, description = "Where the job is"))),
        (status = 400, body = Problem, content_type = "application/problem+json"),
        (status = 404, body = Problem, content_type = "application/problem+json", description = "Unknown policy or world"),
        (status = 409, body = Problem, content_type = "application/problem+json", description = "`random`, which cannot learn"),
        (status = 422, body = Problem, content_type = "application/problem+json"),
        (status = 429, body = Problem, content_type = "application/problem+json", description = "Too many waiting jobs"),
    ))]
pub async fn learn(app: Caller, Params(id): Params<String>, sent: Sent) -> Answer<Response> {
    let (body, mut kept) = sent.json::<LearnIn>()?;
    if let Some(fields) = kept.as_object_mut() {
        fields.insert("policy".into(), id.clone().into());
    }
    let work = move |app: &App, keep: Keep<JobOut>| learning::begin(app, &id, &body, &kept, keep);
    answer_once(&app, sent.once, StatusCode::ACCEPTED, place, work).await
}

/// Tries a policy's ranking in a world: AUCCESS. A job; its attempts are counted in the world. The policy `random`
/// is always there, and so is `ranked`, for policies outside the server: their ranking comes with the request.
#[utoipa::path(post, path = "/v1/policies/{id}/evaluate", tag = "policies", operation_id = "evaluate_policy",
    params(
        ("id" = String, Path),
        ("Idempotency-Key" = Option<String>, Header, description = "Repeated under the same key, the request has no further effect and is answered the same"),
    ),
    request_body = EvaluateIn,
    responses(
        (status = 202, body = JobOut, headers(("Location" = String, description = "Where the job is"))),
        (status = 400, body = Problem, content_type = "application/problem+json"),
        (status = 404, body = Problem, content_type = "application/problem+json", description = "Unknown policy or world"),
        (status = 409, body = Problem, content_type = "application/problem+json", description = "`untrained`, which knows nothing yet"),
        (status = 422, body = Problem, content_type = "application/problem+json"),
        (status = 429, body = Problem, content_type = "application/problem+json", description = "Too many waiting jobs"),
    ))]
pub async fn evaluate(app: Caller, Params(id): Params<String>, sent: Sent) -> Answer<Response> {
    let (body, mut kept) = sent.json::<EvaluateIn>()?;
    if let Some(fields) = kept.as_object_mut() {
        fields.insert("policy".into(), id.clone().into());
    }
    let work = move |app: &App, keep: Keep<JobOut>| evaluation::begin(app, &id, &body, &kept, keep);
    answer_once(&app, sent.once, StatusCode::ACCEPTED, place, work).await
}
