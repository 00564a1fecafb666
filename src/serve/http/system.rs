//! Health, metrics, the document.

use axum::http::{HeaderValue, StatusCode, header};
use axum::response::{IntoResponse, Response};

use super::extract::{Caller, Form};
use super::{answer_light, response};
use crate::serve::operations::system;
use crate::serve::problem::Answer;
use crate::serve::wire::Health;
use crate::serve::{metrics, openapi_document};

/// Whether the server lives.
#[utoipa::path(get, path = "/healthz", tag = "system", operation_id = "healthz",
    responses((status = 200, body = Health)))]
pub async fn healthz(app: Caller) -> Answer<Response> {
    answer_light(&app, true, StatusCode::OK, |_| Ok(system::health("ok"))).await
}

/// Whether the server takes work.
#[utoipa::path(get, path = "/readyz", tag = "system", operation_id = "readyz",
    responses((status = 200, body = Health), (status = 503, body = Health, description = "It is stopping")))]
pub async fn readyz(app: Caller) -> Answer<Response> {
    let (status, word) = match *app.stopping.borrow() {
        true => (StatusCode::SERVICE_UNAVAILABLE, "stopping"),
        false => (StatusCode::OK, "ready"),
    };
    answer_light(&app, true, status, move |_| Ok(system::health(word))).await
}

/// Counters for Prometheus.
#[utoipa::path(get, path = "/metrics", tag = "system", operation_id = "metrics",
    responses((status = 200, content_type = "text/plain", body = String)))]
pub async fn metrics(app: Caller) -> Answer<Response> {
    let text = app.run(|app| Ok(metrics::text(app)?)).await?;
    let kind = HeaderValue::from_static("text/plain; version=0.0.4; charset=utf-8");
    Ok(([(header::CONTENT_TYPE, kind)], text).into_response())
}

/// This document.
#[utoipa::path(get, path = "/openapi.json", tag = "system", operation_id = "openapi",
    responses((status = 200, content_type = "application/json", body = Object)))]
pub async fn openapi() -> Answer<Response> {
    Ok(response(StatusCode::OK, Form::Json, openapi_document().into_bytes()))
}
