//! `/v1/tasks`

use std::sync::Arc;

use axum::extract::State;
use axum::http::StatusCode;
use axum::response::Response;

use super::answer;
use super::extract::Params;
use crate::serve::app::App;
use crate::serve::operations::task;
use crate::serve::problem::{Answer, Problem};
use crate::serve::wire::{Families, FamilyTasks, TaskOut};

/// All families of tasks.
#[utoipa::path(get, path = "/v1/tasks", tag = "tasks", operation_id = "list_families",
    responses((status = 200, body = Families)))]
pub async fn families(State(app): State<Arc<App>>) -> Answer<Response> {
    answer(&app, StatusCode::OK, |app| Ok(task::families(app))).await
}

/// The tasks of a family.
#[utoipa::path(get, path = "/v1/tasks/{family}", tag = "tasks", operation_id = "list_tasks",
    params(("family" = String, Path, example = "bowling")),
    responses(
        (status = 200, body = FamilyTasks),
        (status = 404, body = Problem, content_type = "application/problem+json"),
    ))]
pub async fn family(State(app): State<Arc<App>>, Params(family): Params<String>) -> Answer<Response> {
    answer(&app, StatusCode::OK, move |app| task::family(app, &family)).await
}

/// One task with its scene.
#[utoipa::path(get, path = "/v1/tasks/{family}/{number}", tag = "tasks", operation_id = "get_task",
    params(("family" = String, Path, example = "bowling"), ("number" = String, Path, example = "017")),
    responses(
        (status = 200, body = TaskOut),
        (status = 404, body = Problem, content_type = "application/problem+json"),
    ))]
pub async fn task(
    State(app): State<Arc<App>>,
    Params((family, number)): Params<(String, String)>,
) -> Answer<Response> {
    answer(&app, StatusCode::OK, move |app| task::task(app, &family, &number)).await
}
