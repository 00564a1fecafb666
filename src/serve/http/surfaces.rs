//! `/v1/surfaces`

use axum::http::{HeaderValue, StatusCode, header};
use axum::response::{IntoResponse, Response};

use super::extract::{Caller, Pairs, Params, Sent};
use super::jobs::place;
use super::{Keep, answer, answer_once, answer_page};
use crate::serve::app::App;
use crate::serve::operations::surface;
use crate::serve::problem::{Answer, Problem};
use crate::serve::wire::{JobOut, SurfaceIn, SurfaceWhole, Surfaces};

/// Finds out which latents a family's performance depends on. A job; its result names the surface. What was found in
/// the same way before is not found again.
#[utoipa::path(post, path = "/v1/surfaces", tag = "workflow", operation_id = "find_surface",
    params(("Idempotency-Key" = Option<String>, Header, description = "Repeated under the same key, the request has no further effect and is answered the same")),
    request_body = SurfaceIn,
    responses(
        (status = 202, body = JobOut, headers(("Location" = String, description = "Where the job is"))),
        (status = 400, body = Problem, content_type = "application/problem+json"),
        (status = 404, body = Problem, content_type = "application/problem+json", description = "Unknown family"),
        (status = 422, body = Problem, content_type = "application/problem+json"),
        (status = 429, body = Problem, content_type = "application/problem+json", description = "Too many waiting jobs"),
    ))]
pub async fn find(app: Caller, sent: Sent) -> Answer<Response> {
    let (body, kept) = sent.json::<SurfaceIn>()?;
    let work = move |app: &App, keep: Keep<JobOut>| surface::begin(app, body, &kept, keep);
    answer_once(&app, sent.once, StatusCode::ACCEPTED, place, work).await
}

/// Surfaces, oldest first.
#[utoipa::path(get, path = "/v1/surfaces", tag = "workflow", operation_id = "list_surfaces",
    params(
        ("limit" = Option<u32>, Query, description = "Most items, 1 to 1000; default 100"),
        ("cursor" = Option<String>, Query, description = "`next` of the page before"),
    ),
    responses(
        (status = 200, body = Surfaces),
        (status = 422, body = Problem, content_type = "application/problem+json"),
    ))]
pub async fn list(app: Caller, Pairs(pairs): Pairs) -> Answer<Response> {
    answer_page(&app, pairs, surface::list).await
}

/// One surface with its points.
#[utoipa::path(get, path = "/v1/surfaces/{id}", tag = "workflow", operation_id = "get_surface",
    params(("id" = String, Path)),
    responses(
        (status = 200, body = SurfaceWhole),
        (status = 404, body = Problem, content_type = "application/problem+json"),
    ))]
pub async fn get(app: Caller, Params(id): Params<String>) -> Answer<Response> {
    answer(&app, StatusCode::OK, move |app| surface::get(app, &id)).await
}

/// A surface as a heat map.
#[utoipa::path(get, path = "/v1/surfaces/{id}/picture", tag = "workflow", operation_id = "draw_surface",
    params(("id" = String, Path)),
    responses(
        (status = 200, body = String, content_type = "image/svg+xml"),
        (status = 404, body = Problem, content_type = "application/problem+json"),
    ))]
pub async fn draw(app: Caller, Params(id): Params<String>) -> Answer<Response> {
    let svg = app.run(move |app| Ok(surface::drawn(app, &id)?)).await?;
    Ok(([(header::CONTENT_TYPE, HeaderValue::from_static("image/svg+xml"))], svg).into_response())
}

/// Forgets a surface.
#[utoipa::path(delete, path = "/v1/surfaces/{id}", tag = "workflow", operation_id = "delete_surface",
    params(("id" = String, Path)),
    responses(
        (status = 204, description = "Gone"),
        (status = 404, body = Problem, content_type = "application/problem+json"),
    ))]
pub async fn delete(app: Caller, Params(id): Params<String>) -> Answer<Response> {
    app.run(move |app| Ok(surface::delete(app, &id)?)).await?;
    Ok(StatusCode::NO_CONTENT.into_response())
}
