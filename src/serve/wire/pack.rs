//! msgpack: the same maps as JSON, with arrays as extension 78, `[dtype, shape, bytes]`.

use std::fmt;

use rmp::encode as put;
use rmpv::Value as Packed;
use serde::Serialize;
use serde_json::{Map, Value};

use super::array::{Array, lists};
use super::packed::packed;
use crate::error::{Error, Result};

/// Extension type of an array.
pub const ARRAY: i8 = 78;
/// Deepest nesting that is read.
const DEEPEST: usize = 64;

/// Reads msgpack; nothing may follow. What it says comes as JSON, arrays as nested lists.
pub fn unpack(mut bytes: &[u8]) -> Result<Value> {
    let value = value(&mut bytes, &Path::Top(""))?;
    end(bytes).map(|()| value)
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

/// Takes one value, of any kind.
pub fn read(bytes: &mut &[u8]) -> Result<Packed> {
    rmpv::decode::read_value_with_max_depth(bytes, DEEPEST).map_err(unreadable)
}

/// Errors if anything follows.
pub fn end(bytes: &[u8]) -> Result<()> {
    match bytes.len() {
        0 => Ok(()),
        n => Err(Error::input("", format!("{n} bytes after the value"), "one msgpack value")),
    }
}

/// Takes the head of a map, if that is what comes.
pub fn map(bytes: &mut &[u8]) -> Option<usize> {
    let mut rest = *bytes;
    let length = match take::<1>(&mut rest).ok()? {
        [head @ 0x80..=0x8f] => usize::from(head & 0x0f),
        [0xde] => u16::from_be_bytes(take(&mut rest).ok()?).into(),
        [0xdf] => u32::from_be_bytes(take(&mut rest).ok()?) as usize,
        _ => return None,
    };
    *bytes = rest;
    Some(length)
}

/// Takes a map's key.
pub fn key<'a>(bytes: &mut &'a [u8], at: &Path) -> Result<&'a str> {
    let [head] = take(bytes)?;
    let length = match head {
        0xa0..=0xbf => usize::from(head & 0x1f),
        0xd9 => usize::from(u8::from_be_bytes(take(bytes)?)),
        0xda => u16::from_be_bytes(take(bytes)?).into(),
        0xdb => u32::from_be_bytes(take(bytes)?) as usize,
        _ => return Err(refuse(at, "a map with other keys than text")),
    };
    std::str::from_utf8(piece(bytes, length)?).map_err(|_| refuse(at, "a key that is not UTF-8"))
}

/// Takes one value, as JSON.
pub fn value(bytes: &mut &[u8], at: &Path) -> Result<Value> {
    nested(bytes, at, 0)
}

fn nested(bytes: &mut &[u8], at: &Path, depth: usize) -> Result<Value> {
    if depth >= DEEPEST {
        return Err(unreadable("it is nested too deep"));
    }
    let [head] = take(bytes)?;
    Ok(match head {
        0x00..=0x7f => head.into(),
        0xe0..=0xff => (head as i8).into(),
        0x80..=0x8f => object(bytes, usize::from(head & 0x0f), at, depth)?,
        0x90..=0x9f => list(bytes, usize::from(head & 0x0f), at, depth)?,
        0xa0..=0xbf => text_of(bytes, usize::from(head & 0x1f), at)?,
        0xc0 => Value::Null,
        0xc2 => false.into(),
        0xc3 => true.into(),
        0xc4..=0xc6 => return Err(refuse(at, "bytes")),
        0xca => f64::from(f32::from_be_bytes(take(bytes)?)).into(),
        0xcb => f64::from_be_bytes(take(bytes)?).into(),
        0xcc => u8::from_be_bytes(take(bytes)?).into(),
        0xcd => u16::from_be_bytes(take(bytes)?).into(),
        0xce => u32::from_be_bytes(take(bytes)?).into(),
        0xcf => u64::from_be_bytes(take(bytes)?).into(),
        0xd0 => i8::from_be_bytes(take(bytes)?).into(),
        0xd1 => i16::from_be_bytes(take(bytes)?).into(),
        0xd2 => i32::from_be_bytes(take(bytes)?).into(),
        0xd3 => i64::from_be_bytes(take(bytes)?).into(),
        0xd4 => extension_of(bytes, 1, at)?,
        0xd5 => extension_of(bytes, 2, at)?,
        0xd6 => extension_of(bytes, 4, at)?,
        0xd7 => extension_of(bytes, 8, at)?,
        0xd8 => extension_of(bytes, 16, at)?,
        0xc7 => take(bytes).and_then(|n| extension_of(bytes, u8::from_be_bytes(n).into(), at))?,
        0xc8 => take(bytes).and_then(|n| extension_of(bytes, u16::from_be_bytes(n).into(), at))?,
        0xc9 => take(bytes).and_then(|n| extension_of(bytes, u32::from_be_bytes(n) as usize, at))?,
        0xd9 => take(bytes).and_then(|n| text_of(bytes, u8::from_be_bytes(n).into(), at))?,
        0xda => take(bytes).and_then(|n| text_of(bytes, u16::from_be_bytes(n).into(), at))?,
        0xdb => take(bytes).and_then(|n| text_of(bytes, u32::from_be_bytes(n) as usize, at))?,
        0xdc => take(bytes).and_then(|n| list(bytes, u16::from_be_bytes(n).into(), at, depth))?,
        0xdd => take(bytes).and_then(|n| list(bytes, u32::from_be_bytes(n) as usize, at, depth))?,
        0xde => take(bytes).and_then(|n| object(bytes, u16::from_be_bytes(n).into(), at, depth))?,
        0xdf => take(bytes).and_then(|n| object(bytes, u32::from_be_bytes(n) as usize, at, depth))?,
        0xc1 => return Err(unreadable("byte 0xc1 means nothing")),
    })
}

fn object(bytes: &mut &[u8], length: usize, at: &Path, depth: usize) -> Result<Value> {
    let mut map = Map::new();
    for _ in 0..length {
        let key = key(bytes, at)?;
        let value = nested(bytes, &Path::Key(at, key), depth + 1)?;
        if map.insert(key.into(), value).is_some() {
            return Err(Error::input(Path::Key(at, key).to_string(), "given twice", "each key once"));
        }
    }
    Ok(Value::Object(map))
}

fn list(bytes: &mut &[u8], length: usize, at: &Path, depth: usize) -> Result<Value> {
    // An item has a byte at least: memory grows with what was sent, not with what was announced.
    let mut items = Vec::with_capacity(length.min(bytes.len()));
    for i in 0..length {
        items.push(nested(bytes, &Path::Item(at, i), depth + 1)?);
    }
    Ok(Value::Array(items))
}

fn text_of(bytes: &mut &[u8], length: usize, at: &Path) -> Result<Value> {
    let text = std::str::from_utf8(piece(bytes, length)?);
    Ok(text.map_err(|_| refuse(at, "text that is not UTF-8"))?.into())
}

/// An array, the only extension there is.
fn extension_of(bytes: &mut &[u8], length: usize, at: &Path) -> Result<Value> {
    let [kind] = take(bytes)?;
    let mut body = piece(bytes, length)?;
    if kind as i8 != ARRAY {
        return Err(refuse(at, "an extension other than 78"));
    }
    let parts = match read(&mut body) {
        Ok(Packed::Array(parts)) if body.is_empty() => parts,
        _ => return Err(refuse(at, "an extension 78 that is no array")),
    };
    let [dtype, shape, Packed::Binary(bytes)] = parts.as_slice() else {
        return Err(refuse(at, "an extension 78 other than [dtype, shape, bytes]"));
    };
    let field = at.to_string();
    lists(&field, dtype.as_str().unwrap_or_default(), &shape_of(shape, &field)?, bytes)
}

fn take<const N: usize>(bytes: &mut &[u8]) -> Result<[u8; N]> {
    let (first, rest) = bytes.split_first_chunk::<N>().ok_or_else(|| unreadable("it ends too soon"))?;
    *bytes = rest;
    Ok(*first)
}

fn piece<'a>(bytes: &mut &'a [u8], length: usize) -> Result<&'a [u8]> {
    let (first, rest) = bytes.split_at_checked(length).ok_or_else(|| unreadable("it ends too soon"))?;
    *bytes = rest;
    Ok(first)
}

fn refuse(at: &Path, what: &str) -> Error {
    let allowed = "nil, true, false, numbers, text, arrays, maps with text as keys, and extension 78";
    Error::input(at.to_string(), what, allowed)
}

fn unreadable(e: impl fmt::Display) -> Error {
    Error::input("", "", format!("msgpack of this format ({e})"))
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
pub fn pack<T: Serialize + ?Sized>(
    value: &T,
    arrays: Vec<(&'static str, Array)>,
) -> std::result::Result<Vec<u8>, serde_json::Error> {
    let mut plain = Vec::with_capacity(256);
    packed(&mut plain, value)?;
    let mut fields = plain.as_slice();
    let Some(length) = map(&mut fields).filter(|_| !arrays.is_empty()) else { return Ok(plain) };
    let mut out = Vec::with_capacity(plain.len() + 1024);
    map_head(&mut out, length + arrays.len());
    out.extend_from_slice(fields);
    for (name, array) in arrays {
        text(&mut out, name);
        extension(&mut out, array);
    }
    Ok(out)
}

/// Writes the head of a map.
pub fn map_head(out: &mut Vec<u8>, entries: usize) {
    drop(put::write_map_len(out, u32::try_from(entries).unwrap_or(u32::MAX)));
}

/// Writes the head of a list.
pub fn list_head(out: &mut Vec<u8>, items: usize) {
    drop(put::write_array_len(out, u32::try_from(items).unwrap_or(u32::MAX)));
}

/// Writes a whole number.
pub fn number(out: &mut Vec<u8>, number: u64) {
    drop(put::write_uint(out, number));
}

/// Writes true or false.
pub fn truth(out: &mut Vec<u8>, truth: bool) {
    drop(put::write_bool(out, truth));
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
        let bytes = pack(&value, Vec::new()).unwrap();
        assert_eq!(unpack(&bytes).unwrap(), value);
        for cut in 0..bytes.len() {
            assert!(unpack(&bytes[..cut]).is_err(), "{cut}");
        }
        assert!(unpack(&[&bytes[..], &[0xc0]].concat()).is_err(), "nothing may follow");
        let array = Array::of(vec![2, 1], Data::U4(vec![7, 8]));
        assert_eq!(
            unpack(&pack(&json!({"b": 1}), vec![("a", array)]).unwrap()).unwrap(),
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
        assert!(named(&[0x82, 0xa1, b'k', 0x01, 0xa1, b'k', 0x02]).contains("given twice"));
        assert!(named(&[0xdd, 0xff, 0xff, 0xff, 0xff, 0xc0]).contains("too soon"), "memory is not reserved");
    }
}
