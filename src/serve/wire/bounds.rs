//! Limits the number of values in a document before parsing it: a value of two bytes takes dozens of bytes in memory and an
//! object of seven takes hundreds, so 16 MiB of input could take gigabytes.

use rmp::Marker;

use crate::error::{Error, Result};

/// Maximum number of values in a document or array: tens of megabytes in memory.
pub const MAX_VALUES: usize = 1 << 20;
/// An object counts as this many values: serde_json reserves space for eleven fields at once.
const VALUES_PER_OBJECT: usize = 16;
/// Bytes of a binary array in msgpack that count as one value.
const PACKED_BYTES_PER_VALUE: usize = 4;

/// Fails if a JSON text holds too many values.
pub fn json(text: &str) -> Result<()> {
    // Each value takes at least one byte and a separator.
    if text.len() <= 2 * MAX_VALUES / VALUES_PER_OBJECT {
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
            b'{' => values += VALUES_PER_OBJECT,
            _ => {}
        }
    }
    check_value_count(values)
}

/// Fails if a msgpack document holds too many values; truncated input is counted up to its end.
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
        values += if is_map { 1 + VALUES_PER_OBJECT } else { 1 };
        let skipped = match marker {
            Marker::FixStr(n) => usize::from(n),
            Marker::Str8 | Marker::Bin8 => number(1),
            Marker::Str16 | Marker::Bin16 => number(2),
            Marker::Str32 | Marker::Bin32 => number(4),
            Marker::U8 | Marker::I8 => 1,
            Marker::U16 | Marker::I16 => 2,
            Marker::U32 | Marker::I32 | Marker::F32 => 4,
            Marker::U64 | Marker::I64 | Marker::F64 => 8,
            // For containers skip only the header; the items are counted next.
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
                values = values.saturating_add(length / PACKED_BYTES_PER_VALUE);
                length.saturating_add(1)
            }
            _ => 0,
        };
        bytes = bytes.get(skipped..).unwrap_or_default();
    }
    check_value_count(values)
}

/// Fails if there are too many values.
pub fn check_value_count(values: usize) -> Result<()> {
    if values <= MAX_VALUES {
        return Ok(());
    }
    let advice = "split the request (an object counts as 16 values)";
    Err(Error::TooLarge { what: "values", asked: values as u64, limit: MAX_VALUES as u64, advice })
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::{Value, json};

    fn refused(result: Result<()>) -> bool {
        matches!(result, Err(Error::TooLarge { .. }))
    }

    /// Regression: megabytes of small values took gigabytes of memory.
    #[test]
    fn rejects_many_small_values_but_accepts_long_text() {
        let json_of = |item: &str, n: usize| format!("[{}]", vec![item; n].join(","));
        assert!(refused(json(&json_of("0", MAX_VALUES + 1))));
        assert!(refused(json(&json_of("{\"a\":0}", MAX_VALUES / 16))));
        assert!(refused(json(&json_of("[]", MAX_VALUES / 4))));
        assert!(json(&json_of("0", MAX_VALUES - 10)).is_ok());
        let quoted = json!({"csv": "0,[{\"\\,".repeat(500_000)}).to_string();
        assert!(quoted.len() > 4 * MAX_VALUES && json(&quoted).is_ok());
        let packed = |value: &Value| rmp_serde::to_vec(value).unwrap();
        assert!(refused(msgpack(&packed(&json!(vec![0; MAX_VALUES + 1])))));
        assert!(refused(msgpack(&packed(&json!(vec![json!({"a": 0}); MAX_VALUES / 18 + 1])))));
        assert!(msgpack(&packed(&json!(vec![0.5; MAX_VALUES - 1]))).is_ok());
        assert!(msgpack(&packed(&json!({"csv": "\u{1}".repeat(4 * MAX_VALUES)}))).is_ok());
        let raw = [&[0xc9][..], &(8 * MAX_VALUES as u32).to_be_bytes(), &[78]].concat();
        assert!(refused(msgpack(&raw)), "a nested binary array");
    }

    /// Skips exactly the bytes of each kind of value.
    #[test]
    fn counts_every_kind_of_msgpack_value() {
        let count = |bytes: &[u8]| {
            let mut with = bytes.to_vec();
            with.extend(std::iter::repeat_n(0xc0, MAX_VALUES));
            match msgpack(&with) {
                Err(Error::TooLarge { asked, .. }) => asked as usize - MAX_VALUES,
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
