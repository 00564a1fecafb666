//! Events of the program as lines of JSON, beside the lines of requests and jobs.

use std::fmt::{self, Debug, Write};

use iplw::access::{format_time, now};
use serde_json::json;
use tracing::field::{Field, Visit};
use tracing::{Event, Subscriber};
use tracing_subscriber::fmt::format::Writer;
use tracing_subscriber::fmt::{FmtContext, FormatEvent, FormatFields};
use tracing_subscriber::registry::LookupSpan;

/// Formats an event as `{"time", "event": "log", "level", "message"}`, like the lines of requests and jobs.
pub struct JsonEvents;

impl<S: Subscriber + for<'a> LookupSpan<'a>, N: for<'a> FormatFields<'a> + 'static> FormatEvent<S, N>
    for JsonEvents
{
    fn format_event(&self, _: &FmtContext<S, N>, mut writer: Writer, event: &Event) -> fmt::Result {
        let mut message = EventMessage(String::new());
        event.record(&mut message);
        let level = event.metadata().level().as_str().to_ascii_lowercase();
        let line = json!({"time": format_time(now()), "event": "log", "level": level, "message": message.0});
        writeln!(writer, "{line}")
    }
}

/// The text of an event, with its other fields after it.
struct EventMessage(String);

impl Visit for EventMessage {
    fn record_debug(&mut self, field: &Field, value: &dyn Debug) {
        let _ = if field.name() == "message" {
            write!(self.0, "{value:?}")
        } else {
            write!(self.0, " {}={value:?}", field.name())
        };
    }
}
