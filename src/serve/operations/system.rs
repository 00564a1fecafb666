//! Health, metrics, limits and the OpenAPI document.

use crate::error::Result;
use crate::serve::execution_class::ExecutionClass;
use crate::serve::metrics::Gauges;
use crate::serve::operation::{
    HandlerOutput, MediaBody, Operation, OperationDoc, OperationResponse, PUBLIC, Payload, READ, get,
};
use crate::serve::request_context::RequestContext;
use crate::serve::wire::Health;
use crate::session::WorldKind;

/// Operations on the server itself.
pub fn operations() -> Vec<Operation> {
    vec![
        get("healthz", "/healthz", "system", PUBLIC)
            .about("Liveness check.")
            .classified_handler(|_, ()| ExecutionClass::Inline, |_, ()| Ok(health("ok"))),
        get("readyz", "/readyz", "system", PUBLIC)
            .about("Readiness check.")
            .response::<Health>(200, "")
            .response::<Health>(503, "The server is stopping")
            .classified_handler(|_, ()| ExecutionClass::Inline, ready),
        get("metrics", "/metrics", "system", READ)
            .about("Metrics for Prometheus.")
            .media_response(200, "", &["text/plain"])
            .http_only()
            .handler(metrics),
        get("get_limits", "/v1/limits", "system", READ)
            .about("Returns the server's limits.")
            .classified_handler(|_, ()| ExecutionClass::Inline, |app, ()| Ok(app.shared().limits.clone())),
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
    Ok(if *app.shared().stopping.borrow() { (503, health("stopping")) } else { (200, health("ready")) })
}

fn metrics(app: &RequestContext, (): ()) -> Result<MediaBody> {
    let worlds = app.worlds().list_all()?;
    let of = |kind: WorldKind| worlds.iter().filter(|w| w.world.kind() == kind).count() as u64;
    let shared = app.shared();
    let gauges = Gauges {
        in_progress: shared.scheduler.admitted.total() as u64,
        waiting: shared.scheduler.waiting() as u64,
        connections: [shared.http_connections.total() as u64, shared.zmq_connections.total() as u64],
        worlds: [of(WorldKind::Sim), of(WorldKind::Real)],
        jobs: app.store().jobs_by_state()?,
    };
    let text = app.metrics.text(&gauges);
    Ok(MediaBody { kind: "text/plain; version=0.0.4; charset=utf-8", bytes: text.into_bytes() })
}
