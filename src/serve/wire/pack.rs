//! msgpack: the same maps as JSON, with arrays as extension 78, `[dtype, shape, bytes]`.
//!
//! Answers go from JSON to msgpack without a tree in between, so that both say the same whatever the answer is: a number
//! that is none (NaN) is nil, and every key is text.

use std::fmt;

use rmp::decode::read_map_len;
use rmp::encode as put;
use rmpv::ValueRef as Packed;
use serde::Serialize;
use serde::ser::Error as _;
use serde_json::{Map, Value};

use super::array::{Array, lists};
use crate::error::{Error, Result};

/// Arrays by the name of their field.
pub type Arrays = Vec<(&'static str, Array)>;

/// What cannot be written.
type Unwritable = rmp_serde::encode::Error;

/// Extension type of an array.
pub const ARRAY: i8 = 78;
/// Deepest nesting that is read.
const DEEPEST: usize = 64;

/// Writes a value as msgpack.
pub fn packed<T: Serialize + ?Sized>(value: &T) -> std::result::Result<Vec<u8>, Unwritable> {
    from_json(&serde_json::to_vec(value).map_err(Unwritable::custom)?)
}

/// Writes JSON as msgpack.
pub fn from_json(json: &[u8]) -> std::result::Result<Vec<u8>, Unwritable> {
    let mut packed = Vec::with_capacity(json.len());
    let mut from = serde_json::Deserializer::from_slice(json);
    serde_transcode::transcode(&mut from, &mut rmp_serde::Serializer::new(&mut packed))?;
    Ok(packed)
}

/// The map with arrays as further fields; what is no map stays as it is.
pub fn with_arrays(plain: Vec<u8>, arrays: Arrays) -> std::result::Result<Vec<u8>, Unwritable> {
    let mut fields = plain.as_slice();
    let Some(length) = read_map_len(&mut fields).ok().filter(|_| !arrays.is_empty()) else {
        return Ok(plain);
    };
    let mut out = Vec::with_capacity(plain.len() + 1024);
    put::write_map_len(&mut out, length + arrays.len() as u32)?;
    out.extend_from_slice(fields);
    for (name, array) in arrays {
        put::write_str(&mut out, name)?;
        let (dtype, shape) = (array.dtype(), array.shape().iter().map(|n| Packed::from(*n as u64)).collect());
        let bytes = array.into_bytes();
        let parts = Packed::Array(vec![dtype.into(), Packed::Array(shape), Packed::Binary(&bytes)]);
        let mut body = Vec::with_capacity(bytes.len() + 64);
        write(&mut body, &parts);
        write(&mut out, &Packed::Ext(ARRAY, &body));
    }
    Ok(out)
}

/// Writes msgpack's own kind of value.
pub fn write(out: &mut Vec<u8>, value: &Packed) {
    // Writing to memory does not fail.
    let _ = rmpv::encode::write_value_ref(out, value);
}

/// Reads msgpack; nothing may follow. What it says comes as JSON, arrays as nested lists.
pub fn unpack(mut bytes: &[u8]) -> Result<Value> {
    let value = read(&mut bytes)?;
    end(bytes)?;
    json(&value, &Path::Top(""))
}

/// Takes one value, of any kind. Memory grows with what was sent, not with what was announced.
pub fn read<'a>(bytes: &mut &'a [u8]) -> Result<Packed<'a>> {
    rmpv::decode::read_value_ref_with_max_depth(bytes, DEEPEST).map_err(|e| match e.kind() {
        std::io::ErrorKind::UnexpectedEof => unreadable("it ends too soon"),
        _ => unreadable(e),
    })
}

/// Takes the head of a map, if that is what comes: its number of entries.
pub fn map(bytes: &mut &[u8]) -> Option<u32> {
    let mut rest = *bytes;
    let length = read_map_len(&mut rest).ok()?;
    *bytes = rest;
    Some(length)
}

/// Errors if anything follows.
pub fn end(bytes: &[u8]) -> Result<()> {
    match bytes.len() {
        0 => Ok(()),
        n => Err(Error::input("", format!("{n} bytes after the value"), "one msgpack value")),
    }
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

/// A value as JSON; `at` is where it stands.
pub fn json(value: &Packed, at: &Path) -> Result<Value> {
    Ok(match value {
        Packed::Nil => Value::Null,
        Packed::Boolean(truth) => (*truth).into(),
        Packed::Integer(n) => n.as_u64().map_or_else(|| n.as_i64().into(), Value::from),
        Packed::F32(x) => f64::from(*x).into(),
        Packed::F64(x) => (*x).into(),
        Packed::String(text) => text.as_str().ok_or_else(|| refuse(at, "text that is not UTF-8"))?.into(),
        Packed::Binary(_) => return Err(refuse(at, "bytes")),
        Packed::Ext(ARRAY, body) => array(body, at)?,
        Packed::Ext(..) => return Err(refuse(at, "an extension other than 78")),
        Packed::Array(items) => {
            let items = items.iter().enumerate().map(|(i, item)| json(item, &Path::Item(at, i)));
            Value::Array(items.collect::<Result<_>>()?)
        }
        Packed::Map(entries) => {
            let mut map = Map::new();
            for (key, value) in entries {
                let key = name(key).ok_or_else(|| refuse(at, "a map with other keys than text"))?;
                if map.insert(key.into(), json(value, &Path::Key(at, key))?).is_some() {
                    let twice = Path::Key(at, key).to_string();
                    return Err(Error::input(twice, "given twice", "each key once"));
                }
            }
            Value::Object(map)
        }
    })
}

/// Text, if that is what it is.
pub fn name<'a>(value: &'a Packed) -> Option<&'a str> {
    match value {
        Packed::String(text) => text.as_str(),
        _ => None,
    }
}

/// The array of an extension.
fn array(mut body: &[u8], at: &Path) -> Result<Value> {
    let parts = match read(&mut body) {
        Ok(Packed::Array(parts)) if body.is_empty() => parts,
        _ => return Err(refuse(at, "an extension 78 that is no array")),
    };
    let [dtype, shape, Packed::Binary(bytes)] = parts.as_slice() else {
        return Err(refuse(at, "an extension 78 other than [dtype, shape, bytes]"));
    };
    let field = at.to_string();
    lists(&field, name(dtype).unwrap_or_default(), &shape_of(shape, &field)?, bytes)
}

/// A list of sizes.
pub fn shape_of(shape: &Packed, field: &str) -> Result<Vec<usize>> {
    let size = |n: &Packed| n.as_u64().and_then(|n| usize::try_from(n).ok());
    let sizes = match shape {
        Packed::Array(sizes) => sizes.iter().map(size).collect::<Option<Vec<_>>>(),
        _ => None,
    };
    let allowed = "an array of whole numbers";
    sizes.ok_or_else(|| Error::input(format!("{field}.shape"), shape, allowed))
}

fn refuse(at: &Path, what: &str) -> Error {
    let allowed = "nil, true, false, numbers, text, arrays, maps with text as keys, and extension 78";
    Error::input(at.to_string(), what, allowed)
}

fn unreadable(e: impl fmt::Display) -> Error {
    Error::input("", "", format!("msgpack of this format ({e})"))
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeMap;

    use super::*;
    use crate::serve::wire::array::Data;
    use serde_json::json;

    #[derive(Serialize)]
    #[serde(rename_all = "snake_case")]
    enum Kind {
        Plain,
        Of(u8),
        Pair(i8, f64),
        With { x: f32, y: Option<()> },
    }

    #[derive(Serialize)]
    struct Inner {
        a: i64,
        #[serde(skip_serializing_if = "Option::is_none")]
        left_out: Option<u8>,
    }

    #[derive(Serialize)]
    struct Everything<'a> {
        #[serde(flatten)]
        inner: Inner,
        kinds: Vec<Kind>,
        text: &'a str,
        letter: char,
        none: Option<u8>,
        numbered: BTreeMap<u16, [u64; 2]>,
        floats: Vec<f64>,
        rest: Value,
    }

    #[test]
    fn what_json_says_is_what_msgpack_says() {
        let all = Everything {
            inner: Inner { a: i64::MIN, left_out: None },
            kinds: vec![Kind::Plain, Kind::Of(200), Kind::Pair(-1, 0.1), Kind::With { x: 0.5, y: None }],
            text: &"ä".repeat(300),
            letter: 'ß',
            none: None,
            numbered: (0..20).map(|i| (i, [u64::from(i), u64::MAX])).collect(),
            floats: vec![f64::NAN, f64::INFINITY, -0.0, 1e300, f64::MIN_POSITIVE, 3.0],
            rest: json!({"deep": [[{}, [], null, true, "", -129, 65536]], "0": 1.5}),
        };
        assert_eq!(unpack(&packed(&all).unwrap()).unwrap(), serde_json::to_value(&all).unwrap());
        let long = packed(&vec![0u32; 70_000]).unwrap();
        assert_eq!(unpack(&long).unwrap().as_array().map(Vec::len), Some(70_000));
        assert!(packed(&BTreeMap::from([((1, 2), 3)])).is_err(), "no text");
    }

    #[test]
    fn a_number_that_is_none_is_nil() {
        assert_eq!(packed(&[f64::NAN, f64::NEG_INFINITY]).unwrap(), [0x92, 0xc0, 0xc0]);
        assert_eq!(packed(&3.0).unwrap()[0], 0xcb, "and a whole one stays a float");
    }

    #[test]
    fn what_is_packed_is_unpacked() {
        let value =
            json!({"a": [1, -2, 0.1, null, true, "text"], "big": u64::MAX, "small": i64::MIN, "m": {"": []}});
        let bytes = packed(&value).unwrap();
        assert_eq!(unpack(&bytes).unwrap(), value);
        for cut in 0..bytes.len() {
            assert!(unpack(&bytes[..cut]).is_err(), "{cut}");
        }
        assert!(unpack(&[&bytes[..], &[0xc0]].concat()).is_err(), "nothing may follow");
        let array = Array::of(vec![2, 1], Data::U4(vec![7, 8]));
        assert_eq!(
            unpack(&with_arrays(packed(&json!({"b": 1})).unwrap(), vec![("a", array)]).unwrap()).unwrap(),
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
