//! `/v1/iplw` and `/v1/jobs`

use axum::http::{HeaderMap, HeaderValue, StatusCode, header};
use axum::response::sse::{self, KeepAlive, Sse};
use axum::response::{IntoResponse, Response};
use std::convert::Infallible;
use tokio::sync::mpsc;
use tokio_stream::wrappers::ReceiverStream;

use super::extract::{Caller, Pairs, Params, Sent};
use super::{Keep, answer, answer_once, answer_page, body_of, response};
use crate::error::Error;
use crate::serve::app::App;
use crate::serve::operations::{diagnosis, estimation, job, trials};
use crate::serve::problem::{Answer, Problem};
use crate::serve::wire::{DiagnosisIn, Estimation, Event, JobOut, Jobs, Trials};

/// Estimates the latents of a real world: explore in simulation, measure, fit. A job.
#[utoipa::path(post, path = "/v1/iplw", tag = "workflow", operation_id = "start_iplw",
    params(("Idempotency-Key" = Option<String>, Header, description = "Repeated under the same key, the request has no further effect and is answered the same")),
    request_body = Estimation,
    responses(
        (status = 202, body = JobOut, headers(("Location" = String, description = "Where the job is"))),
        (status = 400, body = Problem, content_type = "application/problem+json"),
        (status = 404, body = Problem, content_type = "application/problem+json", description = "Unknown task or world"),
        (status = 422, body = Problem, content_type = "application/problem+json"),
        (status = 429, body = Problem, content_type = "application/problem+json", description = "Too many waiting jobs"),
    ))]
pub async fn iplw(app: Caller, sent: Sent) -> Answer<Response> {
    let (body, kept) = sent.json::<Estimation>()?;
    let work = move |app: &App, keep: Keep<JobOut>| estimation::begin(app, body, &kept, keep);
    answer_once(&app, sent.once, StatusCode::ACCEPTED, place, work).await
}

/// Diagnoses measured trials: what the simulation gets wrong, by name. A job; its result is an `iplw.diagnosis/1`
/// document with the `extended_scene`.
#[utoipa::path(post, path = "/v1/diagnoses", tag = "workflow", operation_id = "start_diagnosis",
    params(("Idempotency-Key" = Option<String>, Header, description = "Repeated under the same key, the request has no further effect and is answered the same")),
    request_body = DiagnosisIn,
    responses(
        (status = 202, body = JobOut, headers(("Location" = String, description = "Where the job is"))),
        (status = 400, body = Problem, content_type = "application/problem+json"),
        (status = 404, body = Problem, content_type = "application/problem+json", description = "Unknown job"),
        (status = 409, body = Problem, content_type = "application/problem+json", description = "A job without trials"),
        (status = 422, body = Problem, content_type = "application/problem+json"),
        (status = 429, body = Problem, content_type = "application/problem+json", description = "Too many waiting jobs"),
    ))]
pub async fn diagnose(app: Caller, sent: Sent) -> Answer<Response> {
    let (body, _) = sent.json::<DiagnosisIn>()?;
    let work = move |app: &App, keep: Keep<JobOut>| diagnosis::begin(app, body, keep);
    answer_once(&app, sent.once, StatusCode::ACCEPTED, place, work).await
}

/// Jobs, oldest first.
#[utoipa::path(get, path = "/v1/jobs", tag = "jobs", operation_id = "list_jobs",
    params(
        ("limit" = Option<u32>, Query, description = "Most items, 1 to 1000; default 100"),
        ("cursor" = Option<String>, Query, description = "`next` of the page before"),
    ),
    responses(
        (status = 200, body = Jobs),
        (status = 422, body = Problem, content_type = "application/problem+json"),
    ))]
pub async fn list(app: Caller, Pairs(pairs): Pairs) -> Answer<Response> {
    answer_page(&app, pairs, job::list).await
}

/// One job.
#[utoipa::path(get, path = "/v1/jobs/{id}", tag = "jobs", operation_id = "get_job",
    params(("id" = String, Path)),
    responses(
        (status = 200, body = JobOut),
        (status = 404, body = Problem, content_type = "application/problem+json"),
    ))]
pub async fn get(app: Caller, Params(id): Params<String>) -> Answer<Response> {
    answer(&app, StatusCode::OK, move |app| job::get(app, &id)).await
}

/// Cancels a job that has not ended (202); forgets one that has (204).
#[utoipa::path(delete, path = "/v1/jobs/{id}", tag = "jobs", operation_id = "delete_job",
    params(("id" = String, Path)),
    responses(
        (status = 202, body = JobOut, description = "It is told to stop"),
        (status = 204, description = "Forgotten"),
        (status = 404, body = Problem, content_type = "application/problem+json"),
    ))]
pub async fn delete(app: Caller, Params(id): Params<String>) -> Answer<Response> {
    let form = app.form;
    let cancelled = app
        .run(move |app| match job::delete(app, &id)? {
            Some(job) => body_of(job, form).map(Some),
            None => Ok(None),
        })
        .await?;
    Ok(match cancelled {
        Some(body) => response(StatusCode::ACCEPTED, form, body),
        None => StatusCode::NO_CONTENT.into_response(),
    })
}

/// Follows a job: server-sent events `progress`, and `done` at the end, each with the job as data. With
/// `Last-Event-ID`, only what came after; 204 if nothing ever will.
#[utoipa::path(get, path = "/v1/jobs/{id}/events", tag = "jobs", operation_id = "follow_job",
    params(
        ("id" = String, Path),
        ("Last-Event-ID" = Option<u64>, Header, description = "Number of the last event seen"),
    ),
    responses(
        (status = 200, description = "Events", content_type = "text/event-stream", body = String),
        (status = 204, description = "The job has ended and its last event was seen"),
        (status = 404, body = Problem, content_type = "application/problem+json"),
        (status = 422, body = Problem, content_type = "application/problem+json"),
    ))]
pub async fn events(app: Caller, Params(id): Params<String>, headers: HeaderMap) -> Answer<Response> {
    let seen =
        match headers.get("last-event-id") {
            None => 0,
            Some(value) => value.to_str().ok().and_then(|v| v.trim().parse().ok()).ok_or_else(|| {
                Error::input("Last-Event-ID", format!("{value:?}"), "the number of an event")
            })?,
        };
    let mut watcher = app.run(move |app| Ok(app.jobs.watch(&id, seen)?)).await?;
    if watcher.exhausted() {
        return Ok(StatusCode::NO_CONTENT.into_response());
    }
    let (sender, receiver) = mpsc::channel::<Result<sse::Event, Infallible>>(16);
    let mut stopping = app.stopping.subscribe();
    tokio::spawn(async move {
        loop {
            let next = tokio::select! {
                next = watcher.next() => next,
                // A client that hung up must not be waited for until the next event.
                () = sender.closed() => return,
                () = async { let _ = stopping.wait_for(|s| *s).await; } => {
                    // The runner ends its jobs when the server stops; its last word is worth a moment.
                    tokio::time::timeout(std::time::Duration::from_secs(2), watcher.next()).await.unwrap_or(None)
                }
            };
            let Some((id, job)) = next else { return };
            let event = Event::new(id, job);
            let Ok(message) =
                sse::Event::default().id(event.id.to_string()).event(event.name).json_data(&event.data)
            else {
                return;
            };
            if sender.send(Ok(message)).await.is_err() {
                return;
            }
        }
    });
    Ok(Sse::new(ReceiverStream::new(receiver)).keep_alive(KeepAlive::default()).into_response())
}

/// The trials that an estimation measured, or was told. As JSON in pages with the scene they go with; as the files
/// of `iplw measure` with `format=csv` (trials.csv) and `format=scene` (scene.json), whole.
#[utoipa::path(get, path = "/v1/jobs/{id}/trials", tag = "jobs", operation_id = "list_trials",
    params(
        ("id" = String, Path),
        ("format" = Option<String>, Query, description = "`json` (default), `csv` or `scene`"),
        ("limit" = Option<u32>, Query, description = "Most items, 1 to 1000; default 100"),
        ("cursor" = Option<String>, Query, description = "`next` of the page before"),
    ),
    responses(
        (status = 200, content((Trials = "application/json"), (String = "text/csv"))),
        (status = 404, body = Problem, content_type = "application/problem+json"),
        (status = 409, body = Problem, content_type = "application/problem+json", description = "The job is no estimation"),
        (status = 422, body = Problem, content_type = "application/problem+json"),
    ))]
pub async fn trials(app: Caller, Params(id): Params<String>, Pairs(mut pairs): Pairs) -> Answer<Response> {
    let at = pairs.iter().position(|(name, _)| name == "format");
    let format = at.map(|i| pairs.remove(i).1);
    match format.as_deref() {
        None | Some("json") => answer_page(&app, pairs, move |app, page| trials::page(app, &id, page)).await,
        Some(format @ ("csv" | "scene")) => {
            if let Some((name, value)) = pairs.first() {
                return Err(Error::input(
                    name,
                    format!("{value:?}"),
                    format!("absent: {format} comes whole"),
                )
                .into());
            }
            if format == "scene" {
                return answer(&app, StatusCode::OK, move |app| trials::scene(app, &id)).await;
            }
            let text = app.run(move |app| Ok(trials::csv(app, &id)?)).await?;
            let kind = HeaderValue::from_static("text/csv; charset=utf-8");
            Ok(([(header::CONTENT_TYPE, kind)], text).into_response())
        }
        Some(other) => Err(Error::input("format", format!("{other:?}"), "json, csv or scene").into()),
    }
}

/// Where a job is.
pub fn place(job: &JobOut) -> Option<String> {
    Some(format!("/v1/jobs/{}", job.id))
}
