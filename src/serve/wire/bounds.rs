//! How much a document holds, counted before it is read: a value of two bytes takes dozens once it is, an object of seven takes
//! hundreds, so that 16 MiB of them would take gigabytes.

use rmp::Marker;

use crate::error::{Error, Result};

/// Most values of a document, and numbers of an array: tens of megabytes in memory.
pub const MOST_VALUES: usize = 1 << 20;
/// Values that an object is worth: room for eleven fields is made at once.
const OBJECT: usize = 16;
/// Bytes of an array within msgpack that are worth a value.
const PACKED: usize = 4;

/// Errors if JSON holds more values than are taken.
pub fn json(text: &str) -> Result<()> {
    // Each takes a byte at least, and one to tell it from the next.
    if text.len() <= 2 * MOST_VALUES / OBJECT {
        return Ok(());
    }
    let (mut values, mut quoted, mut escaped) = (1usize, false, false);
    for byte in text.bytes() {
        match byte {
            _ if escaped => escaped = false,
            b'\\' if quoted => escaped = true,
            b'"' => quoted = !quoted,
            _ if quoted => {}
            b',' => values += 1,
            b'[' => values += 4,
            b'{' => values += OBJECT,
            _ => {}
        }
    }
    few(values)
}

/// The same for msgpack; one that ends too soon is counted up to its end.
pub fn msgpack(mut bytes: &[u8]) -> Result<()> {
    let mut values = 0usize;
    while let Some((marker, rest)) = bytes.split_first() {
        bytes = rest;
        let mut number = |width: usize| {
            let (head, rest) = bytes.split_at_checked(width).unwrap_or((&[], &[]));
            bytes = rest;
            head.iter().fold(0usize, |n, b| n << 8 | usize::from(*b))
        };
        let marker = Marker::from_u8(*marker);
        let is_map = matches!(marker, Marker::FixMap(_) | Marker::Map16 | Marker::Map32);
        values += if is_map { 1 + OBJECT } else { 1 };
        let skipped = match marker {
            Marker::FixStr(n) => usize::from(n),
            Marker::Str8 | Marker::Bin8 => number(1),
            Marker::Str16 | Marker::Bin16 => number(2),
            Marker::Str32 | Marker::Bin32 => number(4),
            Marker::U8 | Marker::I8 => 1,
            Marker::U16 | Marker::I16 => 2,
            Marker::U32 | Marker::I32 | Marker::F32 => 4,
            Marker::U64 | Marker::I64 | Marker::F64 => 8,
            // Of what holds others, only the head is passed over.
            Marker::Array16 | Marker::Map16 => 2,
            Marker::Array32 | Marker::Map32 => 4,
            Marker::FixExt1 => 2,
            Marker::FixExt2 => 3,
            Marker::FixExt4 => 5,
            Marker::FixExt8 => 9,
            Marker::FixExt16 => 17,
            wide @ (Marker::Ext8 | Marker::Ext16 | Marker::Ext32) => {
                let length = number(if wide == Marker::Ext8 {
                    1
                } else if wide == Marker::Ext16 {
                    2
                } else {
                    4
                });
                values = values.saturating_add(length / PACKED);
                length.saturating_add(1)
            }
            _ => 0,
        };
        bytes = bytes.get(skipped..).unwrap_or_default();
    }
    few(values)
}

/// Errors if so many are more than are taken.
pub fn few(values: usize) -> Result<()> {
    if values <= MOST_VALUES {
        return Ok(());
    }
    let advice = "send them in parts (an object counts as 16)";
    Err(Error::TooLarge { what: "values", asked: values as u64, limit: MOST_VALUES as u64, advice })
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::{Value, json};

    fn refused(result: Result<()>) -> bool {
        matches!(result, Err(Error::TooLarge { .. }))
    }

    /// Megabytes of small values took gigabytes.
    #[test]
    fn many_small_values_are_refused_and_long_text_is_not() {
        let json_of = |item: &str, n: usize| format!("[{}]", vec![item; n].join(","));
        assert!(refused(json(&json_of("0", MOST_VALUES + 1))));
        assert!(refused(json(&json_of("{\"a\":0}", MOST_VALUES / 16))));
        assert!(refused(json(&json_of("[]", MOST_VALUES / 4))));
        assert!(json(&json_of("0", MOST_VALUES - 10)).is_ok());
        let quoted = json!({"csv": "0,[{\"\\,".repeat(500_000)}).to_string();
        assert!(quoted.len() > 4 * MOST_VALUES && json(&quoted).is_ok());
        let packed = |value: &Value| rmp_serde::to_vec(value).unwrap();
        assert!(refused(msgpack(&packed(&json!(vec![0; MOST_VALUES + 1])))));
        assert!(refused(msgpack(&packed(&json!(vec![json!({"a": 0}); MOST_VALUES / 18 + 1])))));
        assert!(msgpack(&packed(&json!(vec![0.5; MOST_VALUES - 1]))).is_ok());
        assert!(msgpack(&packed(&json!({"csv": "\u{1}".repeat(4 * MOST_VALUES)}))).is_ok());
        let raw = [&[0xc9][..], &(8 * MOST_VALUES as u32).to_be_bytes(), &[78]].concat();
        assert!(refused(msgpack(&raw)), "an array within");
    }

    /// Every kind of value is passed over as a whole: what follows it is counted.
    #[test]
    fn what_is_counted_is_what_there_is() {
        let count = |bytes: &[u8]| {
            let mut with = bytes.to_vec();
            with.extend(std::iter::repeat_n(0xc0, MOST_VALUES));
            match msgpack(&with) {
                Err(Error::TooLarge { asked, .. }) => asked as usize - MOST_VALUES,
                other => panic!("{other:?}"),
            }
        };
        for (bytes, values) in [
            (&b"\x01"[..], 1),
            (b"\xa3abc", 1),
            (b"\xd9\x02ab", 1),
            (b"\xda\x00\x02ab", 1),
            (b"\xc4\x01\xff", 1),
            (b"\xcb\x00\x00\x00\x00\x00\x00\x00\x00", 1),
            (b"\xce\xff\xff\xff\xff", 1),
            (b"\xd1\xff\xff", 1),
            (b"\x92\x01\x02", 3),
            (b"\xdc\x00\x02\x01\x02", 3),
            (b"\xdd\x00\x00\x00\x02\x01\x02", 3),
            (b"\x81\xa1a\x01", 19),
            (b"\xde\x00\x01\xa1a\x01", 19),
            (b"\xdf\x00\x00\x00\x01\xa1a\x01", 19),
            (b"\xd4\x4e\xff", 1),
            (b"\xd8\x4e0123456789abcdef", 1),
            (b"\xc7\x08\x4e01234567", 3),
            (b"\xc8\x00\x08\x4e01234567", 3),
        ] {
            assert_eq!(count(bytes), values, "{bytes:x?}");
        }
    }
}
