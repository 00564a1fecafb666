//! Health, counters, the document.

use crate::error::Result;
use crate::serve::app::App;
use crate::serve::metrics::Gauges;
use crate::serve::operation::{Content, Described, Media, OPEN, Operation, Output, READ, Reply, get};
use crate::serve::weight::Weight;
use crate::serve::wire::Health;
use crate::session::Kind;

/// What can be asked of the server itself.
pub fn operations() -> Vec<Operation> {
    vec![
        get("healthz", "/healthz", "system", OPEN)
            .about("Whether the server lives.")
            .weighed(|_, ()| Weight::Light, |_, ()| Ok(health("ok"))),
        get("readyz", "/readyz", "system", OPEN)
            .about("Whether the server takes work.")
            .answers::<Health>(200, "")
            .answers::<Health>(503, "It is stopping")
            .weighed(|_, ()| Weight::Light, ready),
        get("metrics", "/metrics", "system", READ)
            .about("Counters for Prometheus.")
            .answers_media(200, "", &["text/plain"])
            .only_http()
            .does(metrics),
        get("get_limits", "/v1/limits", "system", READ)
            .about("What the server takes, and for how long.")
            .weighed(|_, ()| Weight::Light, |app, ()| Ok(app.shared().limits.clone())),
        get("openapi", "/openapi.json", "system", READ)
            .about("This document.")
            .does(|app, ()| Ok(Document(app.shared().document))),
    ]
}

/// The OpenAPI document, JSON.
struct Document(&'static str);

impl Output for Document {
    fn describe(to: &mut Described) {
        to.any_json(200);
    }

    fn reply(self) -> Reply {
        Reply::of(Content::Json(self.0.as_bytes().to_vec()))
    }
}

fn health(status: &'static str) -> Health {
    Health { status, version: env!("CARGO_PKG_VERSION") }
}

fn ready(app: &App, (): ()) -> Result<(u16, Health)> {
    Ok(if *app.shared().stopping.borrow() { (503, health("stopping")) } else { (200, health("ready")) })
}

fn metrics(app: &App, (): ()) -> Result<Media> {
    let worlds = app.worlds().everybodys()?;
    let of = |kind: Kind| worlds.iter().filter(|w| w.world.kind() == kind).count() as u64;
    let shared = app.shared();
    let gauges = Gauges {
        under_way: shared.fair.taken.all() as u64,
        waiting: shared.fair.waiting() as u64,
        connections: [shared.http.all() as u64, shared.zmq.all() as u64],
        worlds: [of(Kind::Sim), of(Kind::Real)],
        jobs: app.store().jobs_by_state()?,
    };
    let text = app.metrics.text(&gauges);
    Ok(Media { kind: "text/plain; version=0.0.4; charset=utf-8", bytes: text.into_bytes() })
}
