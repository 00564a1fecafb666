//! msgpack: the same maps as JSON, with arrays as extension 78, `[dtype, shape, bytes]`.

use std::fmt;

use rmp::encode as put;
use rmpv::Value as Packed;
use serde_json::{Map, Value};

use super::array::{Array, lists};
use crate::error::{Error, Result};

/// Extension type of an array.
pub const ARRAY: i8 = 78;
/// Deepest nesting that is read.
const DEEPEST: usize = 64;

/// Reads msgpack; nothing may follow. What it says comes as JSON, arrays as nested lists.
pub fn unpack(bytes: &[u8]) -> Result<Value> {
    plain(read(bytes)?, &Path::Top(""))
}

/// Where a value stands; written out only for an error.
pub enum Path<'a> {
    /// A field by name, or all there is (empty).
    Top(&'a str),
    Key(&'a Path<'a>, &'a str),
    Item(&'a Path<'a>, usize),
}

impl fmt::Display for Path<'_> {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        match self {
            Path::Top(name) | Path::Key(Path::Top(""), name) => f.write_str(name),
            Path::Key(up, name) => write!(f, "{up}.{name}"),
            Path::Item(up, i) => write!(f, "{up}[{i}]"),
        }
    }
}

/// Reads msgpack; nothing may follow.
pub fn read(mut bytes: &[u8]) -> Result<Packed> {
    let value = rmpv::decode::read_value_with_max_depth(&mut bytes, DEEPEST)
        .map_err(|e| Error::input("", "", format!("msgpack of this format ({e})")))?;
    match bytes.len() {
        0 => Ok(value),
        n => Err(Error::input("", format!("{n} bytes after the value"), "one msgpack value")),
    }
}

/// The same as JSON.
pub fn plain(value: Packed, at: &Path) -> Result<Value> {
    let refuse = |what: &str| {
        let allowed = "nil, true, false, numbers, text, arrays, maps with text as keys, and extension 78";
        Err(Error::input(at.to_string(), what, allowed))
    };
    Ok(match value {
        Packed::Nil => Value::Null,
        Packed::Boolean(b) => b.into(),
        Packed::Integer(n) => match (n.as_u64(), n.as_i64()) {
            (Some(n), _) => n.into(),
            (None, Some(n)) => n.into(),
            (None, None) => return refuse("a number that is none"),
        },
        Packed::F32(x) => f64::from(x).into(),
        Packed::F64(x) => x.into(),
        Packed::String(text) => match text.into_str() {
            Some(text) => text.into(),
            None => return refuse("text that is not UTF-8"),
        },
        Packed::Binary(_) => return refuse("bytes"),
        Packed::Array(items) => {
            let item = |(i, item)| plain(item, &Path::Item(at, i));
            Value::Array(items.into_iter().enumerate().map(item).collect::<Result<_>>()?)
        }
        Packed::Map(entries) => {
            let mut map = Map::new();
            for (key, value) in entries {
                let Packed::String(key) = key else { return refuse("a map with other keys than text") };
                let Some(key) = key.into_str() else { return refuse("a key that is not UTF-8") };
                let value = plain(value, &Path::Key(at, &key))?;
                if map.contains_key(&key) {
                    let path = Path::Key(at, &key).to_string();
                    return Err(Error::input(path, "given twice", "each key once"));
                }
                map.insert(key, value);
            }
            Value::Object(map)
        }
        Packed::Ext(ARRAY, body) => {
            let parts = match read(&body) {
                Ok(Packed::Array(parts)) => parts,
                _ => return refuse("an extension 78 that is no array"),
            };
            let [dtype, shape, Packed::Binary(bytes)] = parts.as_slice() else {
                return refuse("an extension 78 other than [dtype, shape, bytes]");
            };
            let field = at.to_string();
            lists(&field, dtype.as_str().unwrap_or_default(), &shape_of(shape, &field)?, bytes)?
        }
        Packed::Ext(..) => return refuse("an extension other than 78"),
    })
}

/// A list of sizes.
pub fn shape_of(shape: &Packed, field: &str) -> Result<Vec<usize>> {
    let sizes = shape.as_array().map(|sizes| {
        sizes.iter().map(|n| n.as_u64().and_then(|n| usize::try_from(n).ok())).collect::<Option<Vec<_>>>()
    });
    let allowed = "an array of whole numbers";
    sizes.flatten().ok_or_else(|| Error::input(format!("{field}.shape"), shape, allowed))
}

/// Writes a value as msgpack, with the arrays as further fields of its map.
pub fn pack(value: &Value, arrays: Vec<(&'static str, Array)>) -> Vec<u8> {
    let mut out = Vec::new();
    match value {
        Value::Object(map) => {
            map_head(&mut out, map.len() + arrays.len());
            for (key, value) in map {
                text(&mut out, key);
                write(&mut out, value);
            }
            for (name, array) in arrays {
                text(&mut out, name);
                extension(&mut out, array);
            }
        }
        other => write(&mut out, other),
    }
    out
}

/// Writes a value.
pub fn write(out: &mut Vec<u8>, value: &Value) {
    // Writing to memory does not fail.
    match value {
        Value::Null => drop(put::write_nil(out)),
        Value::Bool(b) => drop(put::write_bool(out, *b)),
        Value::Number(n) => match (n.as_u64(), n.as_i64(), n.as_f64()) {
            (Some(n), _, _) => drop(put::write_uint(out, n)),
            (None, Some(n), _) => drop(put::write_sint(out, n)),
            (None, None, x) => drop(put::write_f64(out, x.unwrap_or(f64::NAN))),
        },
        Value::String(s) => text(out, s),
        Value::Array(items) => {
            list_head(out, items.len());
            items.iter().for_each(|item| write(out, item));
        }
        Value::Object(map) => {
            map_head(out, map.len());
            for (key, value) in map {
                text(out, key);
                write(out, value);
            }
        }
    }
}

/// Writes the head of a map.
pub fn map_head(out: &mut Vec<u8>, entries: usize) {
    drop(put::write_map_len(out, u32::try_from(entries).unwrap_or(u32::MAX)));
}

/// Writes the head of a list.
pub fn list_head(out: &mut Vec<u8>, items: usize) {
    drop(put::write_array_len(out, u32::try_from(items).unwrap_or(u32::MAX)));
}

/// Writes text.
pub fn text(out: &mut Vec<u8>, text: &str) {
    drop(put::write_str(out, text));
}

/// Writes what tells an array: its name if it has one here, type and shape.
pub fn shape(out: &mut Vec<u8>, shape: &[usize]) {
    list_head(out, shape.len());
    for n in shape {
        drop(put::write_uint(out, *n as u64));
    }
}

fn extension(out: &mut Vec<u8>, array: Array) {
    let mut body = Vec::new();
    list_head(&mut body, 3);
    text(&mut body, array.dtype());
    shape(&mut body, array.shape());
    let bytes = array.into_bytes();
    drop(put::write_bin_len(&mut body, bytes.len() as u32));
    drop(put::write_ext_meta(out, (body.len() + bytes.len()) as u32, ARRAY));
    out.extend_from_slice(&body);
    out.extend_from_slice(&bytes);
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::serve::wire::array::Data;
    use serde_json::json;

    #[test]
    fn what_is_packed_is_unpacked() {
        let value =
            json!({"a": [1, -2, 0.1, null, true, "text"], "big": u64::MAX, "small": i64::MIN, "m": {"": []}});
        let bytes = pack(&value, Vec::new());
        assert_eq!(unpack(&bytes).unwrap(), value);
        for cut in 0..bytes.len() {
            assert!(unpack(&bytes[..cut]).is_err(), "{cut}");
        }
        assert!(unpack(&[&bytes[..], &[0xc0]].concat()).is_err(), "nothing may follow");
        let array = Array::of(vec![2, 1], Data::U4(vec![7, 8]));
        assert_eq!(
            unpack(&pack(&json!({"b": 1}), vec![("a", array)])).unwrap(),
            json!({"b": 1, "a": [[7], [8]]})
        );
    }

    #[test]
    fn what_json_does_not_have_is_refused_with_its_place() {
        let named = |bytes: &[u8]| unpack(bytes).unwrap_err().to_string();
        assert!(named(&[0x81, 0xa1, b'k', 0xc4, 0x01, 0x00]).contains("`k`"), "bytes");
        assert!(named(&[0x81, 0xa1, b'k', 0x91, 0xd4, 0x05, 0x00]).contains("`k[0]`"), "extension 5");
        assert!(named(&[0x81, 0x01, 0x02]).contains("other keys"));
        assert!(named(&[0x81, 0xa1, b'k', 0xd4, 0x4e, 0xc0]).contains("`k`"), "no array");
        assert!(named(&[0x91; 100]).contains("msgpack"), "too deep");
    }
}
