//! Frames of a message: a msgpack header, then the bytes of each array that it lists.

use rmp::encode as put;
use rmpv::ValueRef as Packed;
use serde_json::{Map, Value};

use crate::error::{Error, Result};
use crate::serve::operation::{IdempotencyKey, OperationRequest, OperationResponse, Payload};
use crate::serve::problem::{HandlerResult, Problem};
use crate::serve::wire::msgpack::{self, ValuePath, name};
use crate::serve::wire::{Array, ArrayData, bounds, to_nested_lists};

/// A parsed request.
pub struct ZmqRequest {
    pub op: String,
    pub operation_request: OperationRequest,
    /// Timeout chosen by the client, s, unparsed.
    pub deadline: Option<String>,
    /// Request id chosen by the client, unvalidated.
    pub request_id: Option<String>,
    /// W3C trace context, unparsed.
    pub traceparent: Option<String>,
    /// `args.request` as msgpack: the request that `cancel` refers to.
    pub cancel_target: Option<Vec<u8>>,
}

/// Version of the protocol.
const PROTOCOL_VERSION: u64 = 1;

/// Parses a request. Returns its id as msgpack (nil if it cannot be read), and the request or the error.
pub fn read(frames: Vec<Vec<u8>>) -> (Vec<u8>, Result<ZmqRequest>) {
    let mut frames = frames.into_iter();
    let head = frames.next().unwrap_or_default();
    let mut id = None;
    let header = Header::read(&head, &mut id);
    let request = header.and_then(|header| header.request(id.is_some(), frames.collect()));
    (id.unwrap_or(NIL.to_vec()), request)
}

/// msgpack nil: no id.
pub const NIL: [u8; 1] = [0xc0];
/// Maximum size of an id, bytes.
const MAX_ID_BYTES: usize = 256;

/// Fields of the header without the id.
#[derive(Default)]
struct Header<'a> {
    v: Option<Packed<'a>>,
    op: Option<Packed<'a>>,
    args: Option<Packed<'a>>,
    arrays: Option<Packed<'a>>,
    key: Option<Packed<'a>>,
    raw: Option<Packed<'a>>,
    deadline: Option<Packed<'a>>,
    request_id: Option<Packed<'a>>,
    traceparent: Option<Packed<'a>>,
    /// An unknown field.
    unknown: Option<(Packed<'a>, Packed<'a>)>,
}

impl<'a> Header<'a> {
    /// Parses field by field, so that errors after the id can be answered with the id.
    fn read(mut bytes: &'a [u8], id: &mut Option<Vec<u8>>) -> Result<Header<'a>> {
        bounds::msgpack(bytes)?;
        let Some(entries) = msgpack::map(&mut bytes) else {
            return Err(Error::input("", "not a map", "a msgpack map as the first frame"));
        };
        let mut header = Header::default();
        for _ in 0..entries {
            let key = msgpack::read(&mut bytes)?;
            let value = msgpack::read(&mut bytes)?;
            let field = match name(&key) {
                Some("id") => {
                    *id = Some(parse_id(&value)?);
                    continue;
                }
                Some("v") => &mut header.v,
                Some("op") => &mut header.op,
                Some("args") => &mut header.args,
                Some("arrays") => &mut header.arrays,
                Some("key") => &mut header.key,
                Some("raw") => &mut header.raw,
                Some("deadline") => &mut header.deadline,
                Some("request_id") => &mut header.request_id,
                Some("traceparent") => &mut header.traceparent,
                Some(_) => {
                    header.unknown = Some((key, value));
                    continue;
                }
                None => return Err(Error::input("", key, "a map with text as keys")),
            };
            *field = Some(value).filter(|v| *v != Packed::Nil);
        }
        msgpack::end(bytes)?;
        Ok(header)
    }

    fn request(self, named: bool, frames: Vec<Vec<u8>>) -> Result<ZmqRequest> {
        if !named {
            return Err(Error::input("id", "missing", ALLOWED_ID));
        }
        match self.v {
            Some(v) if v.as_u64() == Some(PROTOCOL_VERSION) => {}
            v => return Err(Error::input("v", v.unwrap_or(Packed::Nil), format!("{PROTOCOL_VERSION}"))),
        }
        if let Some((key, value)) = &self.unknown {
            let allowed =
                "the fields v, id, op, args, arrays, key, raw, deadline, request_id and traceparent";
            return Err(Error::input(name(key).unwrap_or_default(), value, allowed));
        }
        let op = match &self.op {
            Some(op) => name(op).map(String::from).ok_or_else(|| Error::input("op", op, ALLOWED_OP))?,
            None => return Err(Error::input("op", "missing", ALLOWED_OP)),
        };
        let (mut fields, mut cancel_target) = (Map::new(), None);
        match self.args {
            Some(Packed::Map(args)) if op == "cancel" => {
                cancel_target =
                    args.iter().find(|(key, _)| name(key) == Some("request")).map(|(_, id)| packed(id));
            }
            Some(args) => match msgpack::json(&args, &ValuePath::Top("args"))? {
                Value::Object(args) => fields = args,
                other => return Err(Error::input("args", other, "a map")),
            },
            None => {}
        }
        let raw = match self.raw {
            None => false,
            Some(Packed::Boolean(raw)) => raw,
            Some(other) => return Err(Error::input("raw", other, "true or false")),
        };
        let once = match &self.key {
            None => None,
            Some(key) => {
                let key = name(key).ok_or_else(|| Error::input("key", key, "text"))?;
                let args = serde_json::to_vec(&fields).unwrap_or_default();
                let parts = [op.as_bytes(), b"\n", &args].into_iter().chain(frames.iter().map(Vec::as_slice));
                let parts: Vec<&[u8]> = parts.collect();
                Some(IdempotencyKey::new(key.into(), &parts).map_err(|e| e.with_field("key"))?)
            }
        };
        let request_id = text("request_id", self.request_id)?;
        let traceparent = text("traceparent", self.traceparent)?;
        let arrays = self.arrays.map(|arrays| parse_array_specs(&arrays)).transpose()?.unwrap_or_default();
        let bytes = insert_arrays(&mut fields, arrays, frames)?;
        let deadline = self.deadline.map(|d| d.to_string());
        let operation_request = OperationRequest::from_fields(fields, bytes, once, raw);
        Ok(ZmqRequest { op, operation_request, deadline, request_id, traceparent, cancel_target })
    }
}

const ALLOWED_ID: &str = "a whole number from 0, text or bytes, up to 256 bytes";
const ALLOWED_OP: &str = "the name of an operation";

/// An optional text field.
fn text(field: &str, value: Option<Packed>) -> Result<Option<String>> {
    let one =
        |value: Packed| name(&value).map(String::from).ok_or_else(|| Error::input(field, &value, "text"));
    value.map(one).transpose()
}

/// A request's id, as msgpack.
fn parse_id(value: &Packed) -> Result<Vec<u8>> {
    let packed = packed(value);
    let is_valid = match value {
        Packed::Integer(n) => n.is_u64(),
        Packed::String(_) | Packed::Binary(_) => true,
        _ => false,
    };
    if is_valid && packed.len() <= MAX_ID_BYTES {
        Ok(packed)
    } else {
        Err(Error::input("id", value, ALLOWED_ID))
    }
}

fn packed(value: &Packed) -> Vec<u8> {
    let mut out = Vec::new();
    msgpack::write(&mut out, value);
    out
}

/// Name, dtype and shape of an array in a further frame.
type ArraySpec = (String, String, Vec<usize>);

fn parse_array_specs(value: &Packed) -> Result<Vec<ArraySpec>> {
    let Packed::Array(items) = value else {
        return Err(Error::input("arrays", value, "a list of maps with name, dtype and shape"));
    };
    let one = |(i, item): (usize, &Packed)| {
        let of = format!("arrays[{i}]");
        let field = |key: &str| match item {
            Packed::Map(entries) => entries.iter().find(|(k, _)| name(k) == Some(key)).map(|e| &e.1),
            _ => None,
        };
        let text = |key: &str| {
            let found = field(key).unwrap_or(&Packed::Nil);
            name(found).map(String::from).ok_or_else(|| Error::input(format!("{of}.{key}"), found, "text"))
        };
        Ok((text("name")?, text("dtype")?, msgpack::shape_of(field("shape").unwrap_or(&Packed::Nil), &of)?))
    };
    items.iter().enumerate().map(one).collect()
}

/// Inserts arrays at their names, as lists; returns the binary body, if there is one.
fn insert_arrays(
    fields: &mut Map<String, Value>,
    arrays: Vec<ArraySpec>,
    frames: Vec<Vec<u8>>,
) -> Result<Option<Vec<u8>>> {
    if arrays.len() != frames.len() {
        let value = format!("{} arrays", arrays.len());
        let allowed = format!("{}, as many as frames after the first", frames.len());
        return Err(Error::input("arrays", value, allowed));
    }
    let mut body = None;
    for (i, ((name, dtype, shape), bytes)) in arrays.into_iter().zip(frames).enumerate() {
        if name == "body" && dtype == "|u1" {
            body = Some(bytes);
            continue;
        }
        insert_at(fields, &name, to_nested_lists(&format!("arrays[{i}]"), &dtype, &shape, &bytes)?)?;
    }
    Ok(body)
}

/// Maximum segments of a dotted path. Fields are never deeper; nested values are also dropped recursively.
const MAX_PATH_SEGMENTS: usize = 16;

/// Inserts a value at a dotted path.
fn insert_at(mut fields: &mut Map<String, Value>, path: &str, value: Value) -> Result<()> {
    if path.split('.').count() > MAX_PATH_SEGMENTS {
        let shown: String = path.chars().take(64).collect();
        let allowed = format!("the path of a field in args, at most {MAX_PATH_SEGMENTS} names");
        return Err(Error::input("arrays.name", format!("{shown:?}.."), allowed));
    }
    let (above, last) = path.rsplit_once('.').unwrap_or(("", path));
    for name in above.split('.').filter(|_| path.contains('.')) {
        let below = fields.entry(name).or_insert_with(|| Value::Object(Map::new()));
        let Value::Object(below) = below else {
            return Err(Error::input(path, "below a value", "the path of a field in args"));
        };
        fields = below;
    }
    fields.insert(last.to_string(), value);
    Ok(())
}

/// A serialised response.
pub struct ZmqResponse {
    /// The result without its arrays, as msgpack; nil if it is empty.
    result: Vec<u8>,
    arrays: msgpack::Arrays,
}

/// Serialises a response, with separate arrays if `raw`. A binary body becomes one array, `body`.
pub fn serialize(reply: OperationResponse, raw: bool) -> HandlerResult<ZmqResponse> {
    let (result, arrays) = match reply.content {
        Payload::Nothing => (NIL.to_vec(), Vec::new()),
        Payload::Json(json) => (msgpack::from_json(&json).map_err(Problem::serialization)?, Vec::new()),
        Payload::Value(mut value) => {
            let arrays = if raw { value.take_arrays() } else { Vec::new() };
            (value.to_msgpack().map_err(Problem::serialization)?, arrays)
        }
        // An empty map.
        Payload::MediaBody(media) => (vec![0x80], vec![("body", Array::line(ArrayData::Bytes(media.bytes)))]),
        // Such operations are declared as HTTP only.
        Payload::EventStream(_) => return Err(Problem::internal()),
    };
    Ok(ZmqResponse { result, arrays })
}

impl ZmqResponse {
    /// A response of the protocol itself.
    pub fn plain(answer: &Value) -> HandlerResult<ZmqResponse> {
        let result = msgpack::packed(answer).map_err(Problem::serialization)?;
        Ok(ZmqResponse { result, arrays: Vec::new() })
    }

    /// Its frames.
    pub fn frames(self, id: &[u8], request_id: &str) -> Vec<Vec<u8>> {
        let of = |array: &Array| array.shape().iter().map(|n| Packed::from(*n as u64)).collect();
        let specs = self.arrays.iter().map(|(name, array)| {
            Packed::Map(vec![
                ("name".into(), (*name).into()),
                ("dtype".into(), array.dtype().into()),
                ("shape".into(), Packed::Array(of(array))),
            ])
        });
        let specs = Packed::Array(specs.collect());
        let mut head = response_header(id, request_id, true, 6);
        field(&mut head, "result", &self.result);
        field(&mut head, "arrays", &packed(&specs));
        std::iter::once(head).chain(self.arrays.into_iter().map(|(_, array)| array.into_bytes())).collect()
    }
}

/// Frames of an error response.
pub fn error_frames(id: &[u8], request_id: &str, problem: &Problem) -> Vec<Vec<u8>> {
    let mut head = response_header(id, request_id, false, 5);
    // A problem has only text and numbers; tests cover its serialisation.
    field(&mut head, "problem", &msgpack::packed(problem).unwrap_or(NIL.to_vec()));
    vec![head]
}

fn response_header(id: &[u8], request_id: &str, ok: bool, fields: u32) -> Vec<u8> {
    let mut head = Vec::with_capacity(512);
    let _ = put::write_map_len(&mut head, fields);
    field(&mut head, "v", &[PROTOCOL_VERSION as u8]);
    field(&mut head, "id", id);
    field(&mut head, "ok", &[if ok { 0xc3 } else { 0xc2 }]);
    let _ = put::write_str(&mut head, "request_id");
    let _ = put::write_str(&mut head, request_id);
    head
}

/// Writes a map entry whose value is msgpack already.
fn field(head: &mut Vec<u8>, name: &str, packed: &[u8]) {
    let _ = put::write_str(head, name);
    head.extend_from_slice(packed);
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    fn placed_at(path: &str, fields: Value) -> Result<Value> {
        let Value::Object(mut fields) = fields else { unreachable!() };
        insert_at(&mut fields, path, json!([1]))?;
        Ok(fields.into())
    }

    #[test]
    fn inserts_arrays_at_dotted_paths() {
        assert_eq!(placed_at("a", json!({})).unwrap(), json!({"a": [1]}));
        assert_eq!(
            placed_at("a.b.c", json!({"a": {"x": 0}})).unwrap(),
            json!({"a": {"x": 0, "b": {"c": [1]}}})
        );
        assert_eq!(placed_at(".", json!({})).unwrap(), json!({"": {"": [1]}}));
        assert!(placed_at("a.b", json!({"a": 1})).unwrap_err().to_string().contains("`a.b`"));
    }

    /// Regression: a name of 65535 dots built a value as deep, and dropping it overflowed the stack.
    #[test]
    fn rejects_deeply_dotted_name() {
        let mut head =
            b"\x85\xa1v\x01\xa2id\x07\xa2op\xa4ping\xa4args\x80\xa6arrays\x91\x83\xa4name\xda\xff\xff"
                .to_vec();
        head.extend([b'.'; 0xffff]);
        head.extend(b"\xa5dtype\xa3|u1\xa5shape\x91\x01");
        let (id, request) = read(vec![head, vec![1]]);
        assert_eq!(id, [7]);
        let message = request.err().unwrap().to_string();
        assert!(
            message.contains("`arrays.name`") && message.contains("at most 16 names") && message.len() < 300,
            "{message}"
        );
    }
}
