//! A request to an operation, independent of the transport: HTTP has a path, a query and a body; ZeroMQ has one map of fields.

use serde::de::DeserializeOwned;
use serde_json::{Map, Value};

use super::idempotency::IdempotencyKey;
use crate::error::Error;
use crate::json::{self, JsonObject};
use crate::serve::problem::{HandlerResult, Problem};
use crate::serve::wire::{MSGPACK, bounds, msgpack};

/// A request to an operation.
pub struct OperationRequest {
    source: RequestSource,
    /// `Idempotency-Key`, if the client sent one.
    pub idempotency_key: Option<IdempotencyKey>,
    /// Whether the client wants arrays in binary form, apart from the other fields.
    pub raw: bool,
}

/// The parts of an HTTP request.
pub struct HttpRequestParts {
    /// Path parameters by name.
    pub path: Vec<(String, String)>,
    /// Query parameters in order, or the reason why the query cannot be parsed.
    pub query: Result<Vec<(String, String)>, String>,
    /// The `Last-Event-ID` header.
    pub last_event: Option<String>,
    pub body: Vec<u8>,
    /// Media type of the body, lower case and without parameters; empty if absent.
    pub media_type: String,
}

enum RequestSource {
    Http(HttpRequestParts),
    Fields(RequestFields),
}

/// One map of fields, consumed as they are read, and a binary body if there is one.
struct RequestFields {
    fields: Map<String, Value>,
    bytes: Option<Vec<u8>>,
}

impl OperationRequest {
    /// From HTTP.
    pub fn from_http(
        sent: HttpRequestParts,
        idempotency_key: Option<IdempotencyKey>,
        raw: bool,
    ) -> OperationRequest {
        OperationRequest { source: RequestSource::Http(sent), idempotency_key, raw }
    }

    /// From one map of fields.
    pub fn from_fields(
        fields: Map<String, Value>,
        bytes: Option<Vec<u8>>,
        idempotency_key: Option<IdempotencyKey>,
        raw: bool,
    ) -> OperationRequest {
        OperationRequest {
            source: RequestSource::Fields(RequestFields { fields, bytes }),
            idempotency_key,
            raw,
        }
    }

    /// Ids of the resources that the request works on. Requests of one client that share an id are processed in order.
    pub fn resource_ids(&self) -> Vec<String> {
        let RequestSource::Fields(RequestFields { fields, .. }) = &self.source else { return Vec::new() };
        let one = ["id", "world"].into_iter().filter_map(|f| fields.get(f)?.as_str());
        let many = fields.get("worlds").and_then(Value::as_array).into_iter().flatten();
        one.chain(many.filter_map(Value::as_str)).map(String::from).collect()
    }

    /// A path parameter: text, or a number (task numbers).
    pub fn path_parameter(&mut self, name: &str) -> HandlerResult<String> {
        match &mut self.source {
            RequestSource::Http(sent) => {
                let at = sent.path.iter().position(|(n, _)| n == name).ok_or_else(Problem::internal)?;
                Ok(sent.path.swap_remove(at).1)
            }
            RequestSource::Fields(all) => match all.fields.remove(name) {
                Some(Value::String(text)) => Ok(text),
                Some(Value::Number(n)) => Ok(n.to_string()),
                Some(other) => Err(Problem::malformed(Error::input(name, other, "text"))),
                None => Err(Problem::malformed(Error::input(name, "missing", "text"))),
            },
        }
    }

    /// The query parameters; the caller checks the names.
    pub fn query(&mut self) -> HandlerResult<Vec<(String, String)>> {
        match &mut self.source {
            RequestSource::Http(sent) => std::mem::replace(&mut sent.query, Ok(Vec::new()))
                .map_err(|e| Problem::malformed(Error::input("query", e, "name=value pairs"))),
            RequestSource::Fields(all) => {
                let fields = std::mem::take(&mut all.fields).into_iter().filter(|(_, v)| !v.is_null());
                let pair = |(name, value): (String, Value)| match query_text(&value) {
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

    /// The deserialised body.
    pub fn body<T: DeserializeOwned>(&mut self) -> HandlerResult<T> {
        match &mut self.source {
            RequestSource::Http(sent) => parse(&sent.body, &sent.media_type).map(|JsonObject(value)| value),
            RequestSource::Fields(all) => {
                json::from_value(Value::Object(std::mem::take(&mut all.fields))).map_err(Problem::malformed)
            }
        }
    }

    /// The deserialised body, and the body as JSON, to be stored.
    pub fn body_with_json<T: DeserializeOwned>(&mut self) -> HandlerResult<(T, Value)> {
        match &mut self.source {
            RequestSource::Http(sent) => {
                let (JsonObject(body), json) = parse_with_json(&sent.body, &sent.media_type)?;
                Ok((body, json))
            }
            RequestSource::Fields(all) => {
                let json = Value::Object(std::mem::take(&mut all.fields));
                Ok((json::from_value(json.clone()).map_err(Problem::malformed)?, json))
            }
        }
    }

    /// A binary body; `what` describes it in the error if it is missing.
    pub fn binary_body(&mut self, what: &str) -> HandlerResult<Vec<u8>> {
        match &mut self.source {
            RequestSource::Http(sent) => Ok(std::mem::take(&mut sent.body)),
            RequestSource::Fields(all) => {
                let allowed = format!("an array of type |u1: {what}");
                all.bytes.take().ok_or_else(|| Error::input("body", "missing", allowed).into())
            }
        }
    }

    /// A body of this media type as text, or the field that replaces it over ZeroMQ; `None` for other bodies.
    pub fn text_body(&mut self, kind: &str, field: &str) -> HandlerResult<Option<String>> {
        match &mut self.source {
            RequestSource::Http(sent) if sent.media_type == kind => text(&sent.body).map(|t| Some(t.into())),
            RequestSource::Http(_) => Ok(None),
            RequestSource::Fields(all) if all.fields.contains_key(field) => {
                self.path_parameter(field).map(Some)
            }
            RequestSource::Fields(_) => Ok(None),
        }
    }

    /// Errors if an HTTP request with a JSON body has a query.
    pub fn reject_query(&mut self) -> HandlerResult<()> {
        let RequestSource::Http(_) = &self.source else { return Ok(()) };
        match self.query()?.first() {
            None => Ok(()),
            Some((name, value)) => {
                let allowed = "no query parameters: put them into the JSON body";
                Err(Error::input(name, format!("{value:?}"), allowed).into())
            }
        }
    }

    /// `Last-Event-ID` as a number; 0 if absent.
    pub fn last_event(&self) -> HandlerResult<u64> {
        let RequestSource::Http(HttpRequestParts { last_event: Some(value), .. }) = &self.source else {
            return Ok(0);
        };
        let refuse = || Error::input("Last-Event-ID", format!("{value:?}"), "the number of an event").into();
        value.trim().parse().map_err(|_| refuse())
    }

    /// Errors if a field was not read.
    pub fn reject_unread_fields(&self) -> HandlerResult<()> {
        let RequestSource::Fields(all) = &self.source else { return Ok(()) };
        match all.fields.iter().next() {
            None => Ok(()),
            Some((name, value)) => {
                Err(Error::input(name, value, "absent: the operation does not take it").into())
            }
        }
    }
}

/// A value as a query parameter: numbers of a list are separated by commas.
fn query_text(value: &Value) -> Option<String> {
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

/// A body within the limits of depth and size.
enum BoundedBody<'a> {
    Msgpack(Value),
    Json(&'a str),
}

/// Checks the limits of a body. It is msgpack if the media type says so, else JSON; an empty body is `{}`.
fn check_bounds<'a>(bytes: &'a [u8], media_type: &str) -> HandlerResult<BoundedBody<'a>> {
    if media_type == MSGPACK {
        bounds::msgpack(bytes)?;
        let value =
            if bytes.is_empty() { Ok(Value::Object(Default::default())) } else { msgpack::unpack(bytes) };
        return value.map(BoundedBody::Msgpack).map_err(Problem::malformed);
    }
    let text = text(bytes)?;
    bounds::json(text)?;
    Ok(BoundedBody::Json(if text.trim().is_empty() { "{}" } else { text }))
}

fn parse<T: DeserializeOwned>(bytes: &[u8], media_type: &str) -> HandlerResult<T> {
    match check_bounds(bytes, media_type)? {
        BoundedBody::Msgpack(value) => json::from_value(value),
        BoundedBody::Json(text) => json::parse(text),
    }
    .map_err(Problem::malformed)
}

/// JSON text is parsed twice, since a struct rejects duplicate fields and a [`Value`] does not.
fn parse_with_json<T: DeserializeOwned>(bytes: &[u8], media_type: &str) -> HandlerResult<(T, Value)> {
    let parsed = match check_bounds(bytes, media_type)? {
        BoundedBody::Msgpack(value) => json::from_value(value.clone()).map(|body| (body, value)),
        BoundedBody::Json(text) => json::parse(text).and_then(|value| Ok((json::parse(text)?, value))),
    };
    parsed.map_err(Problem::malformed)
}

fn text(bytes: &[u8]) -> HandlerResult<&str> {
    let text = std::str::from_utf8(bytes).map_err(|e| {
        let value = format!("not UTF-8 from byte {}", e.valid_up_to());
        Problem::malformed(Error::input("body", value, "text in UTF-8"))
    })?;
    Ok(text.strip_prefix('\u{feff}').unwrap_or(text))
}
