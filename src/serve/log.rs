//! Access log: one line for each request and for each job that ends.
//!
//! A line names the operation, the caller, the outcome and the duration. It contains no request or response data: no token, no
//! body, no hidden latent.

use std::sync::Arc;

use serde::Serialize;

use crate::access::{format_time, now};
use crate::error::{Error, Result};
use crate::store::JobRow;

/// Format and sink of the log; empty if there is no log.
#[derive(Clone, Default)]
pub struct AccessLog(Option<(LogFormat, LogSink)>);

/// Receives a line, without the line end.
pub type LogSink = Arc<dyn Fn(&str) + Send + Sync>;

/// Format of a line.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum LogFormat {
    /// `name=value`, separated by spaces.
    Text,
    /// A JSON object.
    Json,
}

/// A request that was answered.
#[derive(Serialize)]
pub struct RequestLine<'a> {
    /// `X-Request-Id`, from the client or generated.
    pub request: &'a str,
    /// `http`, `zmq` or `mcp`.
    pub transport: &'static str,
    /// Its `operationId`; `none` if no operation matched.
    pub operation: &'a str,
    /// Name of the token; absent for anonymous callers.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub who: Option<&'a str>,
    pub status: u16,
    /// Last part of the problem's type, if the response is a problem.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub problem: Option<&'a str>,
    /// From the end of the request's head to the response, s.
    pub seconds: f64,
    /// From the W3C `traceparent` header.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub trace: Option<TraceContext<'a>>,
}

/// W3C trace context of a request.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct TraceContext<'a> {
    /// 32 hexadecimal digits.
    pub trace_id: &'a str,
    /// 16 hexadecimal digits.
    pub parent_id: &'a str,
}

/// Fields common to all lines.
#[derive(Serialize)]
struct LogLine<'a, T> {
    time: &'a str,
    event: &'static str,
    #[serde(flatten)]
    fields: &'a T,
}

#[derive(Serialize)]
struct JobLine<'a> {
    job: String,
    kind: &'a str,
    state: &'static str,
    #[serde(skip_serializing_if = "Option::is_none")]
    who: Option<&'a str>,
    #[serde(skip_serializing_if = "Option::is_none")]
    problem: Option<&'a str>,
}

impl LogFormat {
    /// The format called `name`.
    pub fn from_name(field: &str, name: &str) -> Result<LogFormat> {
        match name {
            "text" => Ok(LogFormat::Text),
            "json" => Ok(LogFormat::Json),
            _ => Err(Error::input(field, format!("{name:?}"), "json or text")),
        }
    }
}

impl AccessLog {
    /// A log of this format.
    pub fn new(form: LogFormat, sink: LogSink) -> AccessLog {
        AccessLog(Some((form, sink)))
    }

    /// Logs a request.
    pub fn request(&self, line: &RequestLine) {
        self.line("request", line);
    }

    /// Logs the end of a job.
    pub fn job(&self, row: &JobRow) {
        let problem = row.error.as_ref().and_then(|e| e["type"].as_str()).map(slug);
        let (job, state) = (crate::job::id(row.number), row.state.name());
        self.line("job", &JobLine { job, kind: &row.kind, state, who: row.owner.as_deref(), problem });
    }

    fn line(&self, event: &'static str, fields: &impl Serialize) {
        let Some((form, sink)) = &self.0 else { return };
        let time = format_time(now());
        match form {
            LogFormat::Json => {
                if let Ok(text) = serde_json::to_string(&LogLine { time: &time, event, fields }) {
                    sink(&text);
                }
            }
            LogFormat::Text => {
                let Ok(serde_json::Value::Object(fields)) = serde_json::to_value(fields) else { return };
                let mut text = format!("{time} {event}");
                for (name, value) in flatten(fields) {
                    text += &format!(" {name}={value}");
                }
                sink(&text);
            }
        }
    }
}

/// Flattens nested fields; text needs no quotes because it contains no spaces.
fn flatten(fields: serde_json::Map<String, serde_json::Value>) -> Vec<(String, String)> {
    let one = |(name, value)| match value {
        serde_json::Value::Object(inner) => flatten(inner),
        serde_json::Value::String(text) => vec![(name, text)],
        other => vec![(name, other.to_string())],
    };
    fields.into_iter().flat_map(one).collect()
}

/// The last part of a problem's type.
pub fn slug(kind: &str) -> &str {
    kind.rsplit('/').next().unwrap_or_default()
}

/// The client's request id, if it is valid.
pub fn valid_request_id(id: &str) -> Option<&str> {
    let fine = !id.is_empty() && id.len() <= 128 && id.bytes().all(|b| b.is_ascii_graphic());
    fine.then_some(id)
}

/// Parses `traceparent` (W3C Trace Context, section 3.2); `None` if it is invalid.
pub fn parse_traceparent(parent: &str) -> Option<TraceContext<'_>> {
    let mut parts = parent.split('-');
    let (version, trace_id, parent_id, flags) = (parts.next()?, parts.next()?, parts.next()?, parts.next()?);
    let hex = |text: &str, length| {
        text.len() == length && text.bytes().all(|b| matches!(b, b'0'..=b'9' | b'a'..=b'f'))
    };
    let some = |text: &str| text.bytes().any(|b| b != b'0');
    let version_is_valid = hex(version, 2) && version != "ff" && (version != "00" || parts.next().is_none());
    let fine = version_is_valid
        && hex(trace_id, 32)
        && some(trace_id)
        && hex(parent_id, 16)
        && some(parent_id)
        && hex(flags, 2);
    fine.then_some(TraceContext { trace_id, parent_id })
}

#[cfg(test)]
mod tests {
    use std::sync::Mutex;

    use super::*;

    #[test]
    fn formats_lines() {
        let lines = Arc::new(Mutex::new(Vec::new()));
        let line = RequestLine {
            request: "r-1",
            transport: "http",
            operation: "list_worlds",
            who: Some("ann"),
            status: 200,
            problem: None,
            seconds: 0.25,
            trace: parse_traceparent("00-0af7651916cd43dd8448eb211c80319c-b7ad6b7169203331-01"),
        };
        for form in [LogFormat::Json, LogFormat::Text] {
            let to = lines.clone();
            AccessLog::new(form, Arc::new(move |line| to.lock().unwrap().push(line.to_string())))
                .request(&line);
        }
        let lines = lines.lock().unwrap();
        let json: serde_json::Value = serde_json::from_str(&lines[0]).unwrap();
        assert_eq!((&json["event"], &json["seconds"]), (&"request".into(), &0.25.into()));
        assert_eq!(json["trace"]["parent_id"], "b7ad6b7169203331");
        assert!(json.get("problem").is_none());
        assert!(lines[1].contains(" request ") && lines[1].ends_with(" who=ann"), "{}", lines[1]);
        assert!(lines[1].contains(" trace_id=0af7651916cd43dd8448eb211c80319c"), "{}", lines[1]);
    }

    #[test]
    fn validates_request_id_and_traceparent() {
        assert_eq!(valid_request_id("abc-1"), Some("abc-1"));
        for bad in ["", "a b", "a\nb", "é", &"a".repeat(129)] {
            assert_eq!(valid_request_id(bad), None, "{bad}");
        }
        for bad in [
            "",
            "00-0af7651916cd43dd8448eb211c80319c-b7ad6b7169203331",
            "00-0AF7651916CD43DD8448EB211C80319C-b7ad6b7169203331-01",
            "00-00000000000000000000000000000000-b7ad6b7169203331-01",
            "00-0af7651916cd43dd8448eb211c80319c-0000000000000000-01",
            "ff-0af7651916cd43dd8448eb211c80319c-b7ad6b7169203331-01",
            "00-0af7651916cd43dd8448eb211c80319c-b7ad6b7169203331-01-more",
        ] {
            assert_eq!(parse_traceparent(bad), None, "{bad}");
        }
        assert!(parse_traceparent("01-0af7651916cd43dd8448eb211c80319c-b7ad6b7169203331-01-more").is_some());
    }
}
