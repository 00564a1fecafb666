//! Health, metrics, the document.

use std::sync::Arc;

use axum::extract::State;
use axum::http::{HeaderValue, StatusCode, header};
use axum::response::{IntoResponse, Response};

use super::{json_bytes, json_response};
use crate::serve::app::App;
use crate::serve::problem::Answer;
use crate::serve::wire::Health;
use crate::serve::{metrics, openapi_document};

/// Whether the server lives.
#[utoipa::path(get, path = "/healthz", tag = "system", operation_id = "healthz",
    responses((status = 200, body = Health)))]
pub async fn healthz() -> Answer<Response> {
    health(StatusCode::OK, "ok")
}

/// Whether the server takes work.
#[utoipa::path(get, path = "/readyz", tag = "system", operation_id = "readyz",
    responses((status = 200, body = Health), (status = 503, body = Health, description = "It is stopping")))]
pub async fn readyz(State(app): State<Arc<App>>) -> Answer<Response> {
    if *app.stopping.borrow() {
        return health(StatusCode::SERVICE_UNAVAILABLE, "stopping");
    }
    health(StatusCode::OK, "ready")
}

/// Counters for Prometheus.
#[utoipa::path(get, path = "/metrics", tag = "system", operation_id = "metrics",
    responses((status = 200, content_type = "text/plain", body = String)))]
pub async fn metrics(State(app): State<Arc<App>>) -> Answer<Response> {
    let text = app.run(|app| Ok(metrics::text(app)?)).await?;
    let kind = HeaderValue::from_static("text/plain; version=0.0.4; charset=utf-8");
    Ok(([(header::CONTENT_TYPE, kind)], text).into_response())
}

/// This document.
#[utoipa::path(get, path = "/openapi.json", tag = "system", operation_id = "openapi",
    responses((status = 200, content_type = "application/json", body = Object)))]
pub async fn openapi() -> Answer<Response> {
    Ok(json_response(StatusCode::OK, openapi_document().into_bytes()))
}

fn health(status: StatusCode, word: &'static str) -> Answer<Response> {
    let health = Health { status: word, version: env!("CARGO_PKG_VERSION") };
    Ok(json_response(status, json_bytes(&health)?))
}
