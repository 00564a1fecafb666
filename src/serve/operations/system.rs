//! Health, metrics, limits and the OpenAPI document.

use prometheus_client::encoding::prometheus_text;

use crate::error::Result;
use crate::serve::execution_class::ExecutionClass;
use crate::serve::limits::Limits;
use crate::serve::operation::{
    HandlerOutput, MediaBody, Operation, OperationDoc, OperationResponse, PUBLIC, Payload, READ, get,
};
use crate::serve::request_context::RequestContext;
use crate::serve::wire::Health;
use crate::session::WorldKind;
use crate::store::JobState;

/// Operations on the server itself.
pub fn operations() -> Vec<Operation> {
    vec![
        get("healthz", "/healthz", "system", PUBLIC)
            .about("Liveness check.")
            .classified_handler(|_, ()| ExecutionClass::Inline, |_, ()| Ok(health("ok"))),
        get("readyz", "/readyz", "system", PUBLIC)
            .about("Readiness check.")
            .response::<Health>(200, "")
            .response::<Health>(503, "The server is stopping, or its disk takes no writes")
            .classified_handler(ready_class, ready),
        get("metrics", "/metrics", "system", READ)
            .about("Metrics for Prometheus.")
            .media_response(200, "", &["text/plain"])
            .http_only()
            .handler(metrics),
        get("get_limits", "/v1/limits", "system", READ)
            .about("Returns the server's limits.")
            .classified_handler(
                |_, ()| ExecutionClass::Inline,
                |app, ()| Ok(Limits::clone(&app.shared().limits())),
            ),
        get("openapi", "/openapi.json", "system", READ)
            .about("Returns this OpenAPI document.")
            .handler(|app, ()| Ok(OpenApiDocument(app.shared().document))),
    ]
}

/// The OpenAPI document as JSON.
struct OpenApiDocument(&'static str);

impl HandlerOutput for OpenApiDocument {
    fn describe(to: &mut OperationDoc) {
        to.any_json(200);
    }

    fn into_response(self) -> OperationResponse {
        OperationResponse::ok(Payload::Json(self.0.as_bytes().to_vec()))
    }
}

fn health(status: &'static str) -> Health {
    Health { status, version: env!("CARGO_PKG_VERSION") }
}

fn ready(app: &RequestContext, (): ()) -> Result<(u16, Health)> {
    let shared = app.shared();
    if *shared.stopping.borrow() {
        return Ok((503, health("stopping")));
    }
    Ok(if shared.disk.check(app.store()) { (200, health("ready")) } else { (503, health("disk")) })
}

/// A probe of the disk waits for it.
fn ready_class(app: &RequestContext, (): &()) -> ExecutionClass {
    if app.shared().disk.recent().is_some() { ExecutionClass::Inline } else { ExecutionClass::Blocking }
}

fn metrics(app: &RequestContext, (): ()) -> Result<MediaBody> {
    let (shared, worlds, jobs) = (app.shared(), app.worlds().list_all()?, app.store().jobs_by_state()?);
    let of = |kind: WorldKind| worlds.iter().filter(|w| w.world.kind() == kind).count();
    let kinds = [WorldKind::Sim, WorldKind::Real].map(|kind| (vec![("kind", kind.name())], of(kind)));
    let connections = [("http", shared.http_connections.total()), ("zmq", shared.zmq_connections.total())];
    let states =
        JobState::ALL.map(|s| (vec![("state", s.name())], jobs.get(s.name()).copied().unwrap_or(0) as usize));
    let (admitted, waiting) = (shared.scheduler.admitted.total(), shared.scheduler.waiting());
    let text = app.metrics.text(vec![
        ("iplw_requests_under_way", "Requests in progress or waiting", vec![(Vec::new(), admitted)]),
        ("iplw_requests_waiting", "Requests that wait for a permit", vec![(Vec::new(), waiting)]),
        (
            "iplw_connections",
            "Open connections",
            connections.map(|(t, n)| (vec![("transport", t)], n)).into(),
        ),
        ("iplw_worlds", "Worlds by kind", kinds.into()),
        ("iplw_jobs", "Jobs by state", states.into()),
    ]);
    Ok(MediaBody { kind: prometheus_text::CONTENT_TYPE, bytes: text.into_bytes() })
}
