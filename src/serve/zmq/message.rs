//! A message's frames: a msgpack header, then the bytes of each array it lists.

use rmpv::Value as Packed;
use serde_json::{Map, Value};

use crate::error::{Error, Result};
use crate::serve::operations::dispatch::{Asked, Reply};
use crate::serve::operations::once::Once;
use crate::serve::problem::Problem;
use crate::serve::wire::pack::{self, Path};
use crate::serve::wire::{self, lists};

/// A request as it was sent.
pub struct Request {
    pub op: String,
    pub asked: Asked,
    /// The id in `args.request`, as msgpack: what `cancel` is about.
    pub about: Option<Vec<u8>>,
}

/// The version of the protocol.
const VERSION: u64 = 1;

/// Reads a request: its id as msgpack (nil if even that cannot be read), and the request or what is wrong with it.
pub fn read(frames: Vec<Vec<u8>>) -> (Vec<u8>, Result<Request>) {
    let mut id = NIL.to_vec();
    let request = parts(frames, &mut id);
    (id, request)
}

/// An id that is none.
pub const NIL: [u8; 1] = [0xc0];
/// Longest id, bytes.
const MOST_ID: usize = 256;

fn parts(frames: Vec<Vec<u8>>, id: &mut Vec<u8>) -> Result<Request> {
    let mut frames = frames.into_iter();
    let head = frames.next().unwrap_or_default();
    let mut rest = head.as_slice();
    let Some(entries) = pack::map(&mut rest) else {
        return Err(Error::input("", "no map", "a msgpack map as the first frame"));
    };
    let (mut header, mut about, mut args) = (Map::new(), None, None);
    let (mut named, mut shapes) = (false, Vec::new());
    for _ in 0..entries {
        match pack::key(&mut rest, &Path::Top(""))? {
            "id" => {
                *id = identity(&pack::read(&mut rest)?)?;
                named = true;
            }
            // What these are depends on the operation, which may come later.
            "args" if !header.contains_key("op") => {
                args = Some(rest);
                pack::read(&mut rest)?;
            }
            "args" if header.get("op").is_some_and(|op| op == "cancel") => {
                about = Some(packed(&pack::read(&mut rest)?["request"]));
            }
            "arrays" => shapes = described(pack::read(&mut rest)?)?,
            key => drop(header.insert(key.to_string(), pack::value(&mut rest, &Path::Top(key))?)),
        }
    }
    pack::end(rest)?;
    if let Some(mut args) = args {
        if header.get("op").is_some_and(|op| op == "cancel") {
            about = Some(packed(&pack::read(&mut args)?["request"]));
        } else {
            header.insert("args".into(), pack::value(&mut args, &Path::Top("args"))?);
        }
    }
    if !named {
        return Err(Error::input("id", "missing", ID));
    }
    match header.remove("v") {
        Some(v) if v == VERSION => {}
        v => return Err(Error::input("v", v.unwrap_or_default(), format!("{VERSION}"))),
    }
    let op = match header.remove("op") {
        Some(Value::String(op)) => op,
        op => return Err(Error::input("op", op.unwrap_or_default(), "the name of an operation")),
    };
    let mut asked = Asked::default();
    match header.remove("args") {
        None | Some(Value::Null) => {}
        Some(Value::Object(args)) => asked.fields = args,
        Some(other) => return Err(Error::input("args", other, "a map")),
    }
    match header.remove("raw") {
        None | Some(Value::Null) => {}
        Some(Value::Bool(raw)) => asked.raw = raw,
        Some(other) => return Err(Error::input("raw", other, "true or false")),
    }
    match header.remove("key") {
        None | Some(Value::Null) => {}
        Some(Value::String(key)) => {
            let bodies: Vec<&[u8]> = frames.as_slice().iter().map(Vec::as_slice).collect();
            let args = serde_json::to_vec(&asked.fields).unwrap_or_default();
            let mut all: Vec<&[u8]> = vec![op.as_bytes(), b"\n", &args];
            all.extend(bodies);
            asked.once = Some(Once::new(key, &all).map_err(|e| e.named("key"))?);
        }
        Some(other) => return Err(Error::input("key", other, "text")),
    }
    if let Some((name, value)) = header.iter().next() {
        return Err(Error::input(name, value, "the fields v, id, op, args, arrays, key and raw"));
    }
    if shapes.len() != frames.len() {
        let (value, allowed) = (
            format!("{} arrays", shapes.len()),
            format!("{}, as many as frames after the first", frames.len()),
        );
        return Err(Error::input("arrays", value, allowed));
    }
    for (i, ((name, dtype, shape), bytes)) in shapes.into_iter().zip(frames).enumerate() {
        if name == "body" && dtype == "|u1" {
            asked.bytes = Some(bytes);
            continue;
        }
        let value = lists(&format!("arrays[{i}]"), &dtype, &shape, &bytes)?;
        place(&mut asked.fields, &name, value)?;
    }
    Ok(Request { op, asked, about })
}

const ID: &str = "a whole number from 0, text or bytes, up to 256 bytes";

/// A request's id, as msgpack.
fn identity(given: &Packed) -> Result<Vec<u8>> {
    let packed = packed(given);
    let kind = matches!(given, Packed::Integer(_) | Packed::String(_) | Packed::Binary(_));
    if !kind || packed.len() > MOST_ID || given.as_i64().is_some_and(|n| n < 0) {
        return Err(Error::input("id", given, ID));
    }
    Ok(packed)
}

fn packed(value: &Packed) -> Vec<u8> {
    let mut out = Vec::new();
    // Writing to memory does not fail.
    let _ = rmpv::encode::write_value(&mut out, value);
    out
}

/// Name, dtype and shape of the arrays that follow.
fn described(value: Packed) -> Result<Vec<(String, String, Vec<usize>)>> {
    let allowed = "a list of maps with name, dtype and shape";
    let Packed::Array(items) = value else { return Err(Error::input("arrays", value, allowed)) };
    let one = |(i, item): (usize, Packed)| {
        let field = format!("arrays[{i}]");
        let text = |name: &str| {
            let refuse = || Error::input(format!("{field}.{name}"), &item[name], "text");
            item[name].as_str().map(String::from).ok_or_else(refuse)
        };
        Ok((text("name")?, text("dtype")?, pack::shape_of(&item["shape"], &field)?))
    };
    items.into_iter().enumerate().map(one).collect()
}

/// Puts a value at a dotted path.
fn place(fields: &mut Map<String, Value>, path: &str, value: Value) -> Result<()> {
    match path.split_once('.') {
        None => drop(fields.insert(path.to_string(), value)),
        Some((first, rest)) => {
            let below = fields.entry(first).or_insert_with(|| Value::Object(Map::new()));
            let Value::Object(below) = below else {
                return Err(Error::input(path, "below a value", "the path of a field in args"));
            };
            place(below, rest, value)?;
        }
    }
    Ok(())
}

/// The frames of an answer.
pub fn reply(id: &[u8], reply: Reply) -> Vec<Vec<u8>> {
    let mut head = opening(id, true, 5);
    pack::text(&mut head, "result");
    head.extend_from_slice(&reply.result);
    pack::text(&mut head, "arrays");
    pack::list_head(&mut head, reply.arrays.len());
    let mut frames = Vec::with_capacity(1 + reply.arrays.len());
    for (name, array) in reply.arrays {
        pack::map_head(&mut head, 3);
        pack::text(&mut head, "name");
        pack::text(&mut head, name);
        pack::text(&mut head, "dtype");
        pack::text(&mut head, array.dtype());
        pack::text(&mut head, "shape");
        pack::shape(&mut head, array.shape());
        frames.push(array.into_bytes());
    }
    frames.insert(0, head);
    frames
}

/// The frame of a refusal.
pub fn refusal(id: &[u8], problem: &Problem) -> Vec<Vec<u8>> {
    let mut head = opening(id, false, 4);
    pack::text(&mut head, "problem");
    // Plain fields of text and numbers: that they can be written is tested.
    let _ = wire::packed(&mut head, problem);
    vec![head]
}

fn opening(id: &[u8], ok: bool, fields: usize) -> Vec<u8> {
    let mut head = Vec::with_capacity(512);
    pack::map_head(&mut head, fields);
    pack::text(&mut head, "v");
    pack::number(&mut head, VERSION);
    pack::text(&mut head, "id");
    head.extend_from_slice(id);
    pack::text(&mut head, "ok");
    pack::truth(&mut head, ok);
    head
}
