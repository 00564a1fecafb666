//! `/v1/tasks`

use axum::http::StatusCode;
use axum::response::Response;

use super::extract::{Caller, Pairs, Params};
use super::{answer, answer_page};
use crate::serve::operations::task;
use crate::serve::problem::{Answer, Problem};
use crate::serve::wire::{Families, FamilyTasks, TaskOut};

/// Families of tasks.
#[utoipa::path(get, path = "/v1/tasks", tag = "tasks", operation_id = "list_families",
    params(
        ("limit" = Option<u32>, Query, description = "Most items, 1 to 1000; default 100"),
        ("cursor" = Option<String>, Query, description = "`next` of the page before"),
    ),
    responses(
        (status = 200, body = Families),
        (status = 422, body = Problem, content_type = "application/problem+json"),
    ))]
pub async fn families(app: Caller, Pairs(pairs): Pairs) -> Answer<Response> {
    answer_page(&app, pairs, task::families).await
}

/// Tasks of a family.
#[utoipa::path(get, path = "/v1/tasks/{family}", tag = "tasks", operation_id = "list_tasks",
    params(
        ("family" = String, Path, example = "bowling"),
        ("limit" = Option<u32>, Query, description = "Most items, 1 to 1000; default 100"),
        ("cursor" = Option<String>, Query, description = "`next` of the page before"),
    ),
    responses(
        (status = 200, body = FamilyTasks),
        (status = 404, body = Problem, content_type = "application/problem+json"),
        (status = 422, body = Problem, content_type = "application/problem+json"),
    ))]
pub async fn family(app: Caller, Params(family): Params<String>, Pairs(pairs): Pairs) -> Answer<Response> {
    answer_page(&app, pairs, move |app, page| task::family(app, &family, page)).await
}

/// One task with its scene.
#[utoipa::path(get, path = "/v1/tasks/{family}/{number}", tag = "tasks", operation_id = "get_task",
    params(("family" = String, Path, example = "bowling"), ("number" = String, Path, example = "017")),
    responses(
        (status = 200, body = TaskOut),
        (status = 404, body = Problem, content_type = "application/problem+json"),
    ))]
pub async fn task(app: Caller, Params((family, number)): Params<(String, String)>) -> Answer<Response> {
    answer(&app, StatusCode::OK, move |app| task::task(app, &family, &number)).await
}
