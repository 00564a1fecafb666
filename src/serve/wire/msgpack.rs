//! msgpack: the same documents as JSON, with arrays as extension 78, `[dtype, shape, bytes]`.
//!
//! Both encode the same values: NaN is nil, single precision has the digits that JSON prints, and every key is text. Values
//! that need no such conversion are written directly, others via JSON.

use std::fmt;

use rmp::Marker;
use rmp::decode::read_map_len;
use rmp::encode as put;
use rmpv::ValueRef as Packed;
use serde::Serialize;
use serde::ser::Error as _;
use serde_json::{Map, Value};

use super::array::{Array, to_nested_lists};
use crate::error::{Error, Result};

/// Arrays by the name of their field.
pub type Arrays = Vec<(&'static str, Array)>;

/// Serialisation error.
pub type EncodeError = rmp_serde::encode::Error;

/// msgpack extension type of an array.
pub const ARRAY_EXTENSION: i8 = 78;
/// Maximum nesting depth of input.
const MAX_DEPTH: usize = 64;

/// Serialises a value as msgpack.
pub fn packed<T: Serialize + ?Sized>(value: &T) -> std::result::Result<Vec<u8>, EncodeError> {
    let mut direct = Vec::with_capacity(256);
    let written =
        value.serialize(&mut rmp_serde::Serializer::new(&mut direct).with_struct_map().with_human_readable());
    if written.is_ok() && is_as_json(&direct).is_some_and(|same| same) {
        return Ok(direct);
    }
    from_json(&serde_json::to_vec(value).map_err(EncodeError::custom)?)
}

/// Whether a msgpack document encodes what JSON would: no NaN, infinity, single precision or bytes, and text keys. `None` if
/// truncated.
fn is_as_json(mut bytes: &[u8]) -> Option<bool> {
    /// An unfinished array or map: remaining values, or keys and values.
    struct OpenContainer {
        left: u64,
        map: bool,
    }
    let mut open: Vec<OpenContainer> = Vec::new();
    while !bytes.is_empty() {
        let marker = Marker::from_u8(bytes[0]);
        bytes = &bytes[1..];
        let mut is_key = false;
        while let Some(last) = open.last_mut() {
            if last.left > 0 {
                is_key = last.map && last.left % 2 == 0;
                last.left -= 1;
                break;
            }
            open.pop();
        }
        let mut number = |width: usize| -> Option<u64> {
            let (head, rest) = bytes.split_at_checked(width)?;
            bytes = rest;
            Some(head.iter().fold(0, |n, b| n << 8 | u64::from(*b)))
        };
        let text = match marker {
            Marker::FixStr(n) => Some(u64::from(n)),
            Marker::Str8 => Some(number(1)?),
            Marker::Str16 => Some(number(2)?),
            Marker::Str32 => Some(number(4)?),
            _ => None,
        };
        if is_key && text.is_none() {
            return Some(false);
        }
        match marker {
            Marker::FixPos(_) | Marker::FixNeg(_) | Marker::Null | Marker::True | Marker::False => {}
            Marker::U8 | Marker::I8 => drop(number(1)?),
            Marker::U16 | Marker::I16 => drop(number(2)?),
            Marker::U32 | Marker::I32 => drop(number(4)?),
            Marker::U64 | Marker::I64 => drop(number(8)?),
            Marker::F64 if f64::from_bits(number(8)?).is_finite() => {}
            Marker::FixArray(n) => open.push(OpenContainer { left: u64::from(n), map: false }),
            Marker::Array16 => open.push(OpenContainer { left: number(2)?, map: false }),
            Marker::Array32 => open.push(OpenContainer { left: number(4)?, map: false }),
            Marker::FixMap(n) => open.push(OpenContainer { left: 2 * u64::from(n), map: true }),
            Marker::Map16 => open.push(OpenContainer { left: 2 * number(2)?, map: true }),
            Marker::Map32 => open.push(OpenContainer { left: 2 * number(4)?, map: true }),
            _ => match text {
                Some(length) => bytes = bytes.get(usize::try_from(length).ok()?..)?,
                None => return Some(false),
            },
        }
    }
    Some(true)
}

/// Converts JSON to msgpack.
pub fn from_json(json: &[u8]) -> std::result::Result<Vec<u8>, EncodeError> {
    let mut packed = Vec::with_capacity(json.len());
    let mut from = serde_json::Deserializer::from_slice(json);
    serde_transcode::transcode(&mut from, &mut rmp_serde::Serializer::new(&mut packed))?;
    Ok(packed)
}

/// Adds arrays as fields to an encoded map; other values stay unchanged.
pub fn with_arrays(plain: Vec<u8>, arrays: Arrays) -> std::result::Result<Vec<u8>, EncodeError> {
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
        write(&mut out, &Packed::Ext(ARRAY_EXTENSION, &body));
    }
    Ok(out)
}

/// Writes a msgpack value.
pub fn write(out: &mut Vec<u8>, value: &Packed) {
    // Writing to memory does not fail.
    let _ = rmpv::encode::write_value_ref(out, value);
}

/// Parses a whole msgpack document into JSON, with arrays as nested lists.
pub fn unpack(mut bytes: &[u8]) -> Result<Value> {
    let value = read(&mut bytes)?;
    end(bytes)?;
    json(&value, &ValuePath::Top(""))
}

/// Reads one value of any kind. Memory is bounded by the bytes received, not by announced lengths.
pub fn read<'a>(bytes: &mut &'a [u8]) -> Result<Packed<'a>> {
    rmpv::decode::read_value_ref_with_max_depth(bytes, MAX_DEPTH).map_err(|e| match e.kind() {
        std::io::ErrorKind::UnexpectedEof => unreadable("it ends too soon"),
        _ => unreadable(e),
    })
}

/// Reads the header of a map if one follows, and returns its number of entries.
pub fn map(bytes: &mut &[u8]) -> Option<u32> {
    let mut rest = *bytes;
    let length = read_map_len(&mut rest).ok()?;
    *bytes = rest;
    Some(length)
}

/// Fails if any bytes follow.
pub fn end(bytes: &[u8]) -> Result<()> {
    match bytes.len() {
        0 => Ok(()),
        n => Err(Error::input("", format!("{n} bytes after the value"), "one msgpack value")),
    }
}

/// Path of a value in a document, formatted only for errors.
pub enum ValuePath<'a> {
    /// A field by name, or the whole document (empty).
    Top(&'a str),
    Key(&'a ValuePath<'a>, &'a str),
    Item(&'a ValuePath<'a>, usize),
}

impl fmt::Display for ValuePath<'_> {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        match self {
            ValuePath::Top(name) | ValuePath::Key(ValuePath::Top(""), name) => f.write_str(name),
            ValuePath::Key(up, name) => write!(f, "{up}.{name}"),
            ValuePath::Item(up, i) => write!(f, "{up}[{i}]"),
        }
    }
}

/// Converts a value to JSON; `at` is its path.
pub fn json(value: &Packed, at: &ValuePath) -> Result<Value> {
    Ok(match value {
        Packed::Nil => Value::Null,
        Packed::Boolean(truth) => (*truth).into(),
        Packed::Integer(n) => n.as_u64().map_or_else(|| n.as_i64().into(), Value::from),
        Packed::F32(x) => f64::from(*x).into(),
        Packed::F64(x) => (*x).into(),
        Packed::String(text) => text.as_str().ok_or_else(|| refuse(at, "text that is not UTF-8"))?.into(),
        Packed::Binary(_) => return Err(refuse(at, "bytes")),
        Packed::Ext(ARRAY_EXTENSION, body) => array(body, at)?,
        Packed::Ext(..) => return Err(refuse(at, "an extension other than 78")),
        Packed::Array(items) => {
            let items = items.iter().enumerate().map(|(i, item)| json(item, &ValuePath::Item(at, i)));
            Value::Array(items.collect::<Result<_>>()?)
        }
        Packed::Map(entries) => {
            let mut map = Map::new();
            for (key, value) in entries {
                let key = name(key).ok_or_else(|| refuse(at, "a map with other keys than text"))?;
                if map.insert(key.into(), json(value, &ValuePath::Key(at, key))?).is_some() {
                    let twice = ValuePath::Key(at, key).to_string();
                    return Err(Error::input(twice, "given twice", "each key once"));
                }
            }
            Value::Object(map)
        }
    })
}

/// The text of a value, if it is one.
pub fn name<'a>(value: &'a Packed) -> Option<&'a str> {
    match value {
        Packed::String(text) => text.as_str(),
        _ => None,
    }
}

/// Decodes an array extension.
fn array(mut body: &[u8], at: &ValuePath) -> Result<Value> {
    let parts = match read(&mut body) {
        Ok(Packed::Array(parts)) if body.is_empty() => parts,
        _ => return Err(refuse(at, "an extension 78 that is no array")),
    };
    let [dtype, shape, Packed::Binary(bytes)] = parts.as_slice() else {
        return Err(refuse(at, "an extension 78 other than [dtype, shape, bytes]"));
    };
    let field = at.to_string();
    to_nested_lists(&field, name(dtype).unwrap_or_default(), &shape_of(shape, &field)?, bytes)
}

/// Reads a shape: an array of sizes.
pub fn shape_of(shape: &Packed, field: &str) -> Result<Vec<usize>> {
    let size = |n: &Packed| n.as_u64().and_then(|n| usize::try_from(n).ok());
    let sizes = match shape {
        Packed::Array(sizes) => sizes.iter().map(size).collect::<Option<Vec<_>>>(),
        _ => None,
    };
    let allowed = "an array of whole numbers";
    sizes.ok_or_else(|| Error::input(format!("{field}.shape"), shape, allowed))
}

fn refuse(at: &ValuePath, what: &str) -> Error {
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
    use crate::serve::wire::array::ArrayData;
    use serde_json::json;

    #[derive(Serialize)]
    #[serde(rename_all = "snake_case")]
    enum TestVariant {
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
    struct TestDocument<'a> {
        #[serde(flatten)]
        inner: Inner,
        kinds: Vec<TestVariant>,
        text: &'a str,
        letter: char,
        none: Option<u8>,
        numbered: BTreeMap<u16, [u64; 2]>,
        floats: Vec<f64>,
        rest: Value,
    }

    #[test]
    fn encodes_the_same_values_as_json() {
        let all = TestDocument {
            inner: Inner { a: i64::MIN, left_out: None },
            kinds: vec![
                TestVariant::Plain,
                TestVariant::Of(200),
                TestVariant::Pair(-1, 0.1),
                TestVariant::With { x: 0.5, y: None },
            ],
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

    /// Direct encoding equals encoding via JSON, to the byte, and unsuitable values are detected.
    #[test]
    fn direct_encoding_equals_encoding_via_json() {
        let plain = json!({"a": [1, -2, 300, -70_000, 0.1, null, true, "text"], "m": {"": [{}, []]}, "b": u64::MAX,
            "long": "x".repeat(70_000), "many": vec![7; 300]});
        for value in [plain, json!([]), json!("text"), json!(0.5), json!(null)] {
            let (short, text) =
                (rmp_serde::to_vec_named(&value).unwrap(), serde_json::to_vec(&value).unwrap());
            assert_eq!(is_as_json(&short), Some(true), "{value}");
            assert_eq!(short, from_json(&text).unwrap(), "{value}");
        }
        let inner = Inner { a: 5, left_out: None };
        assert_eq!(packed(&inner).unwrap(), from_json(&serde_json::to_vec(&inner).unwrap()).unwrap());
        let refused = |bytes: &[u8]| is_as_json(bytes) != Some(true);
        for value in [f64::NAN, f64::INFINITY] {
            assert!(refused(&rmp_serde::to_vec_named(&[1.0, value]).unwrap()));
        }
        assert!(refused(&rmp_serde::to_vec_named(&0.1f32).unwrap()));
        assert!(refused(&rmp_serde::to_vec_named(&BTreeMap::from([(1, 2)])).unwrap()));
        assert!(refused(&[0xc4, 0x01, 0x00]) && refused(&[0xd9]) && refused(&[0xa2, b'a']));
    }

    #[test]
    fn encodes_nan_as_nil() {
        assert_eq!(packed(&[f64::NAN, f64::NEG_INFINITY]).unwrap(), [0x92, 0xc0, 0xc0]);
        assert_eq!(packed(&3.0).unwrap()[0], 0xcb, "and a whole one stays a float");
    }

    #[test]
    fn round_trips() {
        let value =
            json!({"a": [1, -2, 0.1, null, true, "text"], "big": u64::MAX, "small": i64::MIN, "m": {"": []}});
        let bytes = packed(&value).unwrap();
        assert_eq!(unpack(&bytes).unwrap(), value);
        for cut in 0..bytes.len() {
            assert!(unpack(&bytes[..cut]).is_err(), "{cut}");
        }
        assert!(unpack(&[&bytes[..], &[0xc0]].concat()).is_err(), "nothing may follow");
        let array = Array::of(vec![2, 1], ArrayData::U4(vec![7, 8]));
        assert_eq!(
            unpack(&with_arrays(packed(&json!({"b": 1})).unwrap(), vec![("a", array)]).unwrap()).unwrap(),
            json!({"b": 1, "a": [[7], [8]]})
        );
    }

    #[test]
    fn rejects_values_outside_json_with_their_path() {
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
