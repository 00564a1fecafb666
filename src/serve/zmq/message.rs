//! A message's frames: a msgpack header, then the bytes of each array it lists.

use rmp::encode as put;
use rmpv::ValueRef as Packed;
use serde_json::{Map, Value};

use crate::error::{Error, Result};
use crate::serve::operation::{Asked, Content, Once, Reply};
use crate::serve::problem::{Answer, Problem};
use crate::serve::wire::pack::{self, Path, name};
use crate::serve::wire::{Array, Data, bounds, lists};

/// A request as it was sent.
pub struct Request {
    pub op: String,
    pub asked: Asked,
    /// How long it may take, s, as it was sent.
    pub deadline: Option<String>,
    /// What it is called in the log, as it was sent.
    pub request_id: Option<String>,
    /// W3C's, as it was sent.
    pub traceparent: Option<String>,
    /// The id in `args.request`, as msgpack: what `cancel` is about.
    pub about: Option<Vec<u8>>,
}

/// The version of the protocol.
const VERSION: u64 = 1;

/// Reads a request: its id as msgpack (nil if even that cannot be read), and the request or what is wrong with it.
pub fn read(frames: Vec<Vec<u8>>) -> (Vec<u8>, Result<Request>) {
    let mut frames = frames.into_iter();
    let head = frames.next().unwrap_or_default();
    let mut id = None;
    let header = Header::read(&head, &mut id);
    let request = header.and_then(|header| header.request(id.is_some(), frames.collect()));
    (id.unwrap_or(NIL.to_vec()), request)
}

/// An id that is none.
pub const NIL: [u8; 1] = [0xc0];
/// Longest id, bytes.
const MOST_ID: usize = 256;

/// The fields of the first frame but the id.
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
    /// One that there is not.
    unknown: Option<(Packed<'a>, Packed<'a>)>,
}

impl<'a> Header<'a> {
    /// Field by field, so that whoever is at fault after the id is answered under it.
    fn read(mut bytes: &'a [u8], id: &mut Option<Vec<u8>>) -> Result<Header<'a>> {
        bounds::msgpack(bytes)?;
        let Some(entries) = pack::map(&mut bytes) else {
            return Err(Error::input("", "no map", "a msgpack map as the first frame"));
        };
        let mut header = Header::default();
        for _ in 0..entries {
            let key = pack::read(&mut bytes)?;
            let value = pack::read(&mut bytes)?;
            let field = match name(&key) {
                Some("id") => {
                    *id = Some(identity(&value)?);
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
        pack::end(bytes)?;
        Ok(header)
    }

    fn request(self, named: bool, frames: Vec<Vec<u8>>) -> Result<Request> {
        if !named {
            return Err(Error::input("id", "missing", ID));
        }
        match self.v {
            Some(v) if v.as_u64() == Some(VERSION) => {}
            v => return Err(Error::input("v", v.unwrap_or(Packed::Nil), format!("{VERSION}"))),
        }
        if let Some((key, value)) = &self.unknown {
            let allowed =
                "the fields v, id, op, args, arrays, key, raw, deadline, request_id and traceparent";
            return Err(Error::input(name(key).unwrap_or_default(), value, allowed));
        }
        let op = match &self.op {
            Some(op) => name(op).map(String::from).ok_or_else(|| Error::input("op", op, OP))?,
            None => return Err(Error::input("op", "missing", OP)),
        };
        let (mut fields, mut about) = (Map::new(), None);
        match self.args {
            Some(Packed::Map(args)) if op == "cancel" => {
                about = args.iter().find(|(key, _)| name(key) == Some("request")).map(|(_, id)| packed(id));
            }
            Some(args) => match pack::json(&args, &Path::Top("args"))? {
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
                let asked = [op.as_bytes(), b"\n", &args].into_iter().chain(frames.iter().map(Vec::as_slice));
                let asked: Vec<&[u8]> = asked.collect();
                Some(Once::new(key.into(), &asked).map_err(|e| e.named("key"))?)
            }
        };
        let request_id = text("request_id", self.request_id)?;
        let traceparent = text("traceparent", self.traceparent)?;
        let arrays = self.arrays.map(|arrays| described(&arrays)).transpose()?.unwrap_or_default();
        let bytes = placed(&mut fields, arrays, frames)?;
        let deadline = self.deadline.map(|d| d.to_string());
        let asked = Asked::fields(fields, bytes, once, raw);
        Ok(Request { op, asked, deadline, request_id, traceparent, about })
    }
}

const ID: &str = "a whole number from 0, text or bytes, up to 256 bytes";
const OP: &str = "the name of an operation";

/// A field that is text, if it is there.
fn text(field: &str, given: Option<Packed>) -> Result<Option<String>> {
    let one =
        |given: Packed| name(&given).map(String::from).ok_or_else(|| Error::input(field, &given, "text"));
    given.map(one).transpose()
}

/// A request's id, as msgpack.
fn identity(given: &Packed) -> Result<Vec<u8>> {
    let packed = packed(given);
    let known = match given {
        Packed::Integer(n) => n.is_u64(),
        Packed::String(_) | Packed::Binary(_) => true,
        _ => false,
    };
    if known && packed.len() <= MOST_ID { Ok(packed) } else { Err(Error::input("id", given, ID)) }
}

fn packed(value: &Packed) -> Vec<u8> {
    let mut out = Vec::new();
    pack::write(&mut out, value);
    out
}

/// Name, dtype and shape of an array that follows.
type Described = (String, String, Vec<usize>);

fn described(value: &Packed) -> Result<Vec<Described>> {
    let Packed::Array(items) = value else {
        return Err(Error::input("arrays", value, "a list of maps with name, dtype and shape"));
    };
    let one = |(i, item): (usize, &Packed)| {
        let of = format!("arrays[{i}]");
        let field = |wanted: &str| match item {
            Packed::Map(entries) => entries.iter().find(|(key, _)| name(key) == Some(wanted)).map(|e| &e.1),
            _ => None,
        };
        let text = |wanted: &str| {
            let found = field(wanted).unwrap_or(&Packed::Nil);
            name(found).map(String::from).ok_or_else(|| Error::input(format!("{of}.{wanted}"), found, "text"))
        };
        Ok((text("name")?, text("dtype")?, pack::shape_of(field("shape").unwrap_or(&Packed::Nil), &of)?))
    };
    items.iter().enumerate().map(one).collect()
}

/// Puts arrays where their names say, as the lists they stand for; what is left is a body of bytes.
fn placed(
    fields: &mut Map<String, Value>,
    arrays: Vec<Described>,
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
        place(fields, &name, lists(&format!("arrays[{i}]"), &dtype, &shape, &bytes)?)?;
    }
    Ok(body)
}

/// Most names of a dotted path: no field is so deep, and what is built from one is also dropped level by level.
const MOST_NAMES: usize = 16;

/// Puts a value at a dotted path.
fn place(mut fields: &mut Map<String, Value>, path: &str, value: Value) -> Result<()> {
    if path.split('.').count() > MOST_NAMES {
        let shown: String = path.chars().take(64).collect();
        let allowed = format!("the path of a field in args, at most {MOST_NAMES} names");
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

/// An answer, written.
pub struct Written {
    /// What HTTP's body would be, but for the arrays, as msgpack; nil if it has none.
    result: Vec<u8>,
    arrays: pack::Arrays,
}

/// Writes an answer, arrays apart if `raw`. Bytes are one array, `body`.
pub fn written(reply: Reply, raw: bool) -> Answer<Written> {
    let (result, arrays) = match reply.content {
        Content::Nothing => (NIL.to_vec(), Vec::new()),
        Content::Json(json) => (pack::from_json(&json).map_err(Problem::unwritable)?, Vec::new()),
        Content::Value(mut value) => {
            let arrays = if raw { value.bulk() } else { Vec::new() };
            (value.packed().map_err(Problem::unwritable)?, arrays)
        }
        // An empty map.
        Content::Media(media) => (vec![0x80], vec![("body", Array::line(Data::Bytes(media.bytes)))]),
        // Declared as something that only HTTP has.
        Content::Events(_) => return Err(Problem::defect()),
    };
    Ok(Written { result, arrays })
}

impl Written {
    /// A plain answer of this protocol's own.
    pub fn plain(answer: &Value) -> Answer<Written> {
        let result = pack::packed(answer).map_err(Problem::unwritable)?;
        Ok(Written { result, arrays: Vec::new() })
    }

    /// Its frames.
    pub fn frames(self, id: &[u8], request_id: &str) -> Vec<Vec<u8>> {
        let of = |array: &Array| array.shape().iter().map(|n| Packed::from(*n as u64)).collect();
        let told = self.arrays.iter().map(|(name, array)| {
            Packed::Map(vec![
                ("name".into(), (*name).into()),
                ("dtype".into(), array.dtype().into()),
                ("shape".into(), Packed::Array(of(array))),
            ])
        });
        let told = Packed::Array(told.collect());
        let mut head = opening(id, request_id, true, 6);
        field(&mut head, "result", &self.result);
        field(&mut head, "arrays", &packed(&told));
        std::iter::once(head).chain(self.arrays.into_iter().map(|(_, array)| array.into_bytes())).collect()
    }
}

/// The frame of a refusal.
pub fn refusal(id: &[u8], request_id: &str, problem: &Problem) -> Vec<Vec<u8>> {
    let mut head = opening(id, request_id, false, 5);
    // Plain fields of text and numbers: that they can be written is tested.
    field(&mut head, "problem", &pack::packed(problem).unwrap_or(NIL.to_vec()));
    vec![head]
}

fn opening(id: &[u8], request_id: &str, ok: bool, fields: u32) -> Vec<u8> {
    let mut head = Vec::with_capacity(512);
    let _ = put::write_map_len(&mut head, fields);
    field(&mut head, "v", &[VERSION as u8]);
    field(&mut head, "id", id);
    field(&mut head, "ok", &[if ok { 0xc3 } else { 0xc2 }]);
    let _ = put::write_str(&mut head, "request_id");
    let _ = put::write_str(&mut head, request_id);
    head
}

/// A field of a map, whose value is msgpack already.
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
        place(&mut fields, path, json!([1]))?;
        Ok(fields.into())
    }

    #[test]
    fn arrays_stand_where_their_names_say() {
        assert_eq!(placed_at("a", json!({})).unwrap(), json!({"a": [1]}));
        assert_eq!(
            placed_at("a.b.c", json!({"a": {"x": 0}})).unwrap(),
            json!({"a": {"x": 0, "b": {"c": [1]}}})
        );
        assert_eq!(placed_at(".", json!({})).unwrap(), json!({"": {"": [1]}}));
        assert!(placed_at("a.b", json!({"a": 1})).unwrap_err().to_string().contains("`a.b`"));
    }

    /// A name of nothing but dots went as deep as it was long, and took the process down.
    #[test]
    fn a_name_of_many_dots_is_refused() {
        let mut head =
            b"\x85\xa1v\x01\xa2id\x07\xa2op\xa4ping\xa4args\x80\xa6arrays\x91\x83\xa4name\xda\xff\xff"
                .to_vec();
        head.extend([b'.'; 0xffff]);
        head.extend(b"\xa5dtype\xa3|u1\xa5shape\x91\x01");
        let (id, request) = read(vec![head, vec![1]]);
        assert_eq!(id, [7]);
        let told = request.err().unwrap().to_string();
        assert!(
            told.contains("`arrays.name`") && told.contains("at most 16 names") && told.len() < 300,
            "{told}"
        );
    }
}
