//! What happened: one line for each request and for each job that ends.
//!
//! A line names the operation, who asked, how it ended and how long that took. It holds nothing that was sent or answered: no
//! token, no body, no hidden latent.

use std::sync::Arc;

use serde::Serialize;

use crate::access::{now, written};
use crate::error::{Error, Result};
use crate::store::JobRow;

/// How lines are written, and where to; nowhere, if there is no log.
#[derive(Clone, Default)]
pub struct Log(Option<(LogForm, Sink)>);

/// Takes a line, without its end.
pub type Sink = Arc<dyn Fn(&str) + Send + Sync>;

/// How lines are written.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum LogForm {
    /// `name=value` with spaces between.
    Text,
    /// An object.
    Json,
}

/// A request that was answered.
#[derive(Serialize)]
pub struct RequestLine<'a> {
    /// `X-Request-Id`, given or made.
    pub request: &'a str,
    /// `http`, `zmq` or `mcp`.
    pub transport: &'static str,
    /// Its `operationId`; `none` for what leads nowhere.
    pub operation: &'a str,
    /// Name of the token; none where nobody is known.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub who: Option<&'a str>,
    pub status: u16,
    /// The last part of the problem's type, if it is one.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub problem: Option<&'a str>,
    /// From when its head had come to when the answer was ready, s.
    pub seconds: f64,
    /// Of W3C's `traceparent`, as it was sent.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub trace: Option<Trace<'a>>,
}

/// Whose part the request is in a trace.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Trace<'a> {
    /// 32 hexadecimal digits.
    pub trace_id: &'a str,
    /// 16 hexadecimal digits.
    pub parent_id: &'a str,
}

/// What every line begins with.
#[derive(Serialize)]
struct Line<'a, T> {
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

impl LogForm {
    /// The form called `name`.
    pub fn from_name(field: &str, name: &str) -> Result<LogForm> {
        match name {
            "text" => Ok(LogForm::Text),
            "json" => Ok(LogForm::Json),
            _ => Err(Error::input(field, format!("{name:?}"), "json or text")),
        }
    }
}

impl Log {
    /// Lines of a form, to somewhere.
    pub fn new(form: LogForm, sink: Sink) -> Log {
        Log(Some((form, sink)))
    }

    /// A request was answered.
    pub fn request(&self, line: &RequestLine) {
        self.line("request", line);
    }

    /// A job ended.
    pub fn job(&self, row: &JobRow) {
        let problem = row.error.as_ref().and_then(|e| e["type"].as_str()).map(slug);
        let (job, state) = (crate::job::id(row.number), row.state.name());
        self.line("job", &JobLine { job, kind: &row.kind, state, who: row.owner.as_deref(), problem });
    }

    fn line(&self, event: &'static str, fields: &impl Serialize) {
        let Some((form, sink)) = &self.0 else { return };
        let time = written(now());
        match form {
            LogForm::Json => {
                if let Ok(text) = serde_json::to_string(&Line { time: &time, event, fields }) {
                    sink(&text);
                }
            }
            LogForm::Text => {
                let Ok(serde_json::Value::Object(fields)) = serde_json::to_value(fields) else { return };
                let mut text = format!("{time} {event}");
                for (name, value) in flat(fields) {
                    text += &format!(" {name}={value}");
                }
                sink(&text);
            }
        }
    }
}

/// Fields of fields beside the others; text as it is, since none of it has spaces.
fn flat(fields: serde_json::Map<String, serde_json::Value>) -> Vec<(String, String)> {
    let one = |(name, value)| match value {
        serde_json::Value::Object(inner) => flat(inner),
        serde_json::Value::String(text) => vec![(name, text)],
        other => vec![(name, other.to_string())],
    };
    fields.into_iter().flat_map(one).collect()
}

/// The last part of a problem's type.
pub fn slug(kind: &str) -> &str {
    kind.rsplit('/').next().unwrap_or_default()
}

/// A request's id as it was given, if it can be one.
pub fn given_id(given: &str) -> Option<&str> {
    let fine = !given.is_empty() && given.len() <= 128 && given.bytes().all(|b| b.is_ascii_graphic());
    fine.then_some(given)
}

/// What a `traceparent` says (W3C Trace Context, section 3.2); nothing, if it cannot be one.
pub fn trace(parent: &str) -> Option<Trace<'_>> {
    let mut parts = parent.split('-');
    let (version, trace_id, parent_id, flags) = (parts.next()?, parts.next()?, parts.next()?, parts.next()?);
    let hex = |text: &str, length| {
        text.len() == length && text.bytes().all(|b| matches!(b, b'0'..=b'9' | b'a'..=b'f'))
    };
    let some = |text: &str| text.bytes().any(|b| b != b'0');
    let known = hex(version, 2) && version != "ff" && (version != "00" || parts.next().is_none());
    let fine = known
        && hex(trace_id, 32)
        && some(trace_id)
        && hex(parent_id, 16)
        && some(parent_id)
        && hex(flags, 2);
    fine.then_some(Trace { trace_id, parent_id })
}

#[cfg(test)]
mod tests {
    use std::sync::Mutex;

    use super::*;

    #[test]
    fn lines_are_what_their_form_says() {
        let seen = Arc::new(Mutex::new(Vec::new()));
        let line = RequestLine {
            request: "r-1",
            transport: "http",
            operation: "list_worlds",
            who: Some("ann"),
            status: 200,
            problem: None,
            seconds: 0.25,
            trace: trace("00-0af7651916cd43dd8448eb211c80319c-b7ad6b7169203331-01"),
        };
        for form in [LogForm::Json, LogForm::Text] {
            let to = seen.clone();
            Log::new(form, Arc::new(move |line| to.lock().unwrap().push(line.to_string()))).request(&line);
        }
        let seen = seen.lock().unwrap();
        let json: serde_json::Value = serde_json::from_str(&seen[0]).unwrap();
        assert_eq!((&json["event"], &json["seconds"]), (&"request".into(), &0.25.into()));
        assert_eq!(json["trace"]["parent_id"], "b7ad6b7169203331");
        assert!(json.get("problem").is_none());
        assert!(seen[1].contains(" request ") && seen[1].ends_with(" who=ann"), "{}", seen[1]);
        assert!(seen[1].contains(" trace_id=0af7651916cd43dd8448eb211c80319c"), "{}", seen[1]);
    }

    #[test]
    fn only_what_can_be_an_id_or_a_trace_is_taken() {
        assert_eq!(given_id("abc-1"), Some("abc-1"));
        for bad in ["", "a b", "a\nb", "é", &"a".repeat(129)] {
            assert_eq!(given_id(bad), None, "{bad}");
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
            assert_eq!(trace(bad), None, "{bad}");
        }
        assert!(trace("01-0af7651916cd43dd8448eb211c80319c-b7ad6b7169203331-01-more").is_some());
    }
}
