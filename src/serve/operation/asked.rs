//! What was asked, over whatever transport: HTTP has a path, a query and a body; ZeroMQ one map of all their fields.

use serde::de::DeserializeOwned;
use serde_json::{Map, Value};

use super::once::Once;
use crate::error::Error;
use crate::json;
use crate::serve::problem::{Answer, Problem};
use crate::serve::wire::{MSGPACK, Object, bounds, pack};

/// What is asked of an operation.
pub struct Asked {
    from: From,
    /// So that it may be repeated.
    pub once: Option<Once>,
    /// Whether arrays are wanted apart from the rest.
    pub raw: bool,
}

/// A request over HTTP.
pub struct Sent {
    /// Parameters of the path by name.
    pub path: Vec<(String, String)>,
    /// Parameters of the query in order, if it can be read.
    pub query: Result<Vec<(String, String)>, String>,
    /// Number of the last event seen, as it was sent.
    pub last_event: Option<String>,
    pub body: Vec<u8>,
    /// The body's media type, lower case and without parameters; empty if not said.
    pub kind: String,
}

enum From {
    Http(Sent),
    Fields(Fields),
}

/// One map, from which what is read is taken; and a body of bytes, where there is one.
struct Fields {
    fields: Map<String, Value>,
    bytes: Option<Vec<u8>>,
}

impl Asked {
    /// Over HTTP.
    pub fn sent(sent: Sent, once: Option<Once>, raw: bool) -> Asked {
        Asked { from: From::Http(sent), once, raw }
    }

    /// In one map.
    pub fn fields(
        fields: Map<String, Value>,
        bytes: Option<Vec<u8>>,
        once: Option<Once>,
        raw: bool,
    ) -> Asked {
        Asked { from: From::Fields(Fields { fields, bytes }), once, raw }
    }

    /// Ids of what is worked on: requests of one client that share any are carried out in order.
    pub fn names(&self) -> Vec<String> {
        let From::Fields(Fields { fields, .. }) = &self.from else { return Vec::new() };
        let one = ["id", "world"].into_iter().filter_map(|f| fields.get(f)?.as_str());
        let many = fields.get("worlds").and_then(Value::as_array).into_iter().flatten();
        one.chain(many.filter_map(Value::as_str)).map(String::from).collect()
    }

    /// A part of the path, by name: text, or a number (tasks have them).
    pub fn part(&mut self, name: &str) -> Answer<String> {
        match &mut self.from {
            From::Http(sent) => {
                let at = sent.path.iter().position(|(n, _)| n == name).ok_or_else(Problem::defect)?;
                Ok(sent.path.swap_remove(at).1)
            }
            From::Fields(all) => match all.fields.remove(name) {
                Some(Value::String(text)) => Ok(text),
                Some(Value::Number(n)) => Ok(n.to_string()),
                Some(other) => Err(Problem::malformed(Error::input(name, other, "text"))),
                None => Err(Problem::malformed(Error::input(name, "missing", "text"))),
            },
        }
    }

    /// The query, whose names the caller checks.
    pub fn query(&mut self) -> Answer<Vec<(String, String)>> {
        match &mut self.from {
            From::Http(sent) => std::mem::replace(&mut sent.query, Ok(Vec::new()))
                .map_err(|e| Problem::malformed(Error::input("query", e, "name=value pairs"))),
            From::Fields(all) => {
                let fields = std::mem::take(&mut all.fields).into_iter().filter(|(_, v)| !v.is_null());
                let pair = |(name, value): (String, Value)| match written(&value) {
                    Some(text) => Ok((name, text)),
                    None => {
                        let allowed = "text, a number, true or false, or numbers";
                        Err(Problem::malformed(Error::input(&name, &value, allowed)))
                    }
                };
                fields.map(pair).collect()
            }
        }
    }

    /// The body.
    pub fn body<T: DeserializeOwned>(&mut self) -> Answer<T> {
        match &mut self.from {
            From::Http(sent) => parse(&sent.body, &sent.kind).map(|Object(value)| value),
            From::Fields(all) => {
                json::from_value(Value::Object(std::mem::take(&mut all.fields))).map_err(Problem::malformed)
            }
        }
    }

    /// The body as it was sent, to be kept; it can still be read.
    pub fn whole(&self) -> Answer<Value> {
        match &self.from {
            From::Http(sent) => parse(&sent.body, &sent.kind),
            From::Fields(all) => Ok(Value::Object(all.fields.clone())),
        }
    }

    /// A body of bytes; `what` they are, for a client that sends none.
    pub fn bytes(&mut self, what: &str) -> Answer<Vec<u8>> {
        match &mut self.from {
            From::Http(sent) => Ok(std::mem::take(&mut sent.body)),
            From::Fields(all) => {
                let allowed = format!("an array of type |u1: {what}");
                all.bytes.take().ok_or_else(|| Error::input("body", "missing", allowed).into())
            }
        }
    }

    /// A body of this media type as text, or the field that stands for it; `None` if something else was sent.
    pub fn text(&mut self, kind: &str, field: &str) -> Answer<Option<String>> {
        match &mut self.from {
            From::Http(sent) if sent.kind == kind => text(&sent.body).map(|t| Some(t.into())),
            From::Http(_) => Ok(None),
            From::Fields(all) if all.fields.contains_key(field) => self.part(field).map(Some),
            From::Fields(_) => Ok(None),
        }
    }

    /// Errors if HTTP's request has a query, where its body says everything.
    pub fn without_query(&mut self) -> Answer<()> {
        let From::Http(_) = &self.from else { return Ok(()) };
        match self.query()?.first() {
            None => Ok(()),
            Some((name, value)) => {
                let allowed = "no parameters: JSON has them in its body";
                Err(Error::input(name, format!("{value:?}"), allowed).into())
            }
        }
    }

    /// The number of the last event seen; 0 if nothing was.
    pub fn last_event(&self) -> Answer<u64> {
        let From::Http(Sent { last_event: Some(value), .. }) = &self.from else { return Ok(0) };
        let refuse = || Error::input("Last-Event-ID", format!("{value:?}"), "the number of an event").into();
        value.trim().parse().map_err(|_| refuse())
    }

    /// Errors if the map has a field that was not read.
    pub fn nothing_more(&self) -> Answer<()> {
        let From::Fields(all) = &self.from else { return Ok(()) };
        match all.fields.iter().next() {
            None => Ok(()),
            Some((name, value)) => {
                Err(Error::input(name, value, "absent: the operation does not take it").into())
            }
        }
    }
}

/// A value as a query parameter would have it: numbers of a list with commas between.
fn written(value: &Value) -> Option<String> {
    match value {
        Value::String(text) => Some(text.clone()),
        Value::Number(n) => Some(n.to_string()),
        Value::Bool(b) => Some(b.to_string()),
        Value::Array(items) => {
            let items = items.iter().map(|i| i.is_number().then(|| i.to_string()));
            Some(items.collect::<Option<Vec<_>>>()?.join(","))
        }
        Value::Null | Value::Object(_) => None,
    }
}

/// JSON, whatever the media type says unless that is msgpack; an empty body is `{}`.
fn parse<T: DeserializeOwned>(bytes: &[u8], kind: &str) -> Answer<T> {
    if kind == MSGPACK {
        bounds::msgpack(bytes)?;
        let value =
            if bytes.is_empty() { Ok(Value::Object(Default::default())) } else { pack::unpack(bytes) };
        return value.and_then(json::from_value).map_err(Problem::malformed);
    }
    let text = text(bytes)?;
    bounds::json(text)?;
    let text = if text.trim().is_empty() { "{}" } else { text };
    json::parse(text).map_err(Problem::malformed)
}

fn text(bytes: &[u8]) -> Answer<&str> {
    let text = std::str::from_utf8(bytes).map_err(|e| {
        let value = format!("not UTF-8 from byte {}", e.valid_up_to());
        Problem::malformed(Error::input("body", value, "text in UTF-8"))
    })?;
    Ok(text.strip_prefix('\u{feff}').unwrap_or(text))
}
