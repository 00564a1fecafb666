//! Numeric arrays: nested lists in JSON, or binary in msgpack for clients that accept it.

use serde::ser::{Serialize, SerializeSeq, Serializer};
use serde_json::Value;

use super::bounds::check_value_count;
use crate::error::{Error, Result};

/// An array in C order.
#[derive(Clone, Debug, PartialEq)]
pub struct Array {
    shape: Vec<usize>,
    data: ArrayData,
}

/// The numbers of an array.
#[derive(Clone, Debug, PartialEq)]
pub enum ArrayData {
    F8(Vec<f64>),
    U4(Vec<u32>),
    U8(Vec<u64>),
    Bool(Vec<bool>),
    Bytes(Vec<u8>),
}

/// Accepted array types, by NumPy's names; little endian.
pub const DTYPES: [&str; 8] = ["<f4", "<f8", "<i4", "<i8", "<u4", "<u8", "|u1", "|b1"];

impl Array {
    /// A one-dimensional array.
    pub fn line(data: ArrayData) -> Array {
        Array { shape: vec![data.len()], data }
    }

    /// An array of any shape, whose product must equal the length of `data`.
    pub fn of(shape: Vec<usize>, data: ArrayData) -> Array {
        debug_assert_eq!(shape.iter().product::<usize>(), data.len());
        Array { shape, data }
    }

    /// A matrix from rows of equal length.
    pub fn rows(rows: Vec<Vec<f64>>) -> Array {
        let shape = vec![rows.len(), rows.first().map_or(0, Vec::len)];
        Array::of(shape, ArrayData::F8(rows.concat()))
    }

    pub fn shape(&self) -> &[usize] {
        &self.shape
    }

    /// One of [`DTYPES`].
    pub fn dtype(&self) -> &'static str {
        match self.data {
            ArrayData::F8(_) => "<f8",
            ArrayData::U4(_) => "<u4",
            ArrayData::U8(_) => "<u8",
            ArrayData::Bool(_) => "|b1",
            ArrayData::Bytes(_) => "|u1",
        }
    }

    /// Little endian, C order.
    pub fn into_bytes(self) -> Vec<u8> {
        match self.data {
            ArrayData::F8(v) => v.iter().flat_map(|x| x.to_le_bytes()).collect(),
            ArrayData::U4(v) => v.iter().flat_map(|x| x.to_le_bytes()).collect(),
            ArrayData::U8(v) => v.iter().flat_map(|x| x.to_le_bytes()).collect(),
            ArrayData::Bool(v) => v.into_iter().map(u8::from).collect(),
            ArrayData::Bytes(v) => v,
        }
    }
}

/// Decodes a binary array as nested lists, with NaN as `null`. Errors name `field`.
pub fn to_nested_lists(field: &str, dtype: &str, shape: &[usize], bytes: &[u8]) -> Result<Value> {
    let size = match dtype {
        "|u1" | "|b1" => 1,
        "<f4" | "<i4" | "<u4" => 4,
        "<f8" | "<i8" | "<u8" => 8,
        _ => {
            let allowed = format!("one of {}", DTYPES.join(", "));
            return Err(Error::input(format!("{field}.dtype"), format!("{dtype:?}"), allowed));
        }
    };
    let count = shape.iter().try_fold(1usize, |n, d| n.checked_mul(*d));
    if shape.len() > MAX_DIMENSIONS || count.and_then(|n| n.checked_mul(size)) != Some(bytes.len()) {
        let allowed = format!(
            "up to {MAX_DIMENSIONS} dimensions whose product times {size} equals the {} bytes sent",
            bytes.len()
        );
        return Err(Error::input(format!("{field}.shape"), format!("{shape:?}"), allowed));
    }
    check_value_count(bytes.len() / size)?;
    let number: fn(&[u8]) -> Value = match dtype {
        "|u1" => |b| b[0].into(),
        "|b1" => |b| (b[0] != 0).into(),
        "<f4" => |b| f64::from(f32::from_le_bytes(fixed(b))).into(),
        "<f8" => |b| f64::from_le_bytes(fixed(b)).into(),
        "<i4" => |b| i32::from_le_bytes(fixed(b)).into(),
        "<i8" => |b| i64::from_le_bytes(fixed(b)).into(),
        "<u4" => |b| u32::from_le_bytes(fixed(b)).into(),
        _ => |b| u64::from_le_bytes(fixed(b)).into(),
    };
    let mut numbers = bytes.chunks_exact(size).map(number);
    Ok(nest(shape, &mut numbers))
}

const MAX_DIMENSIONS: usize = 8;

fn fixed<const N: usize>(bytes: &[u8]) -> [u8; N] {
    let mut out = [0; N];
    out.copy_from_slice(&bytes[..N]);
    out
}

fn nest(shape: &[usize], numbers: &mut dyn Iterator<Item = Value>) -> Value {
    match shape.split_first() {
        None => numbers.next().unwrap_or_default(),
        Some((_, rest)) if rest.contains(&0) => Value::Array(Vec::new()),
        Some((n, rest)) => Value::Array((0..*n).map(|_| nest(rest, numbers)).collect()),
    }
}

impl ArrayData {
    fn len(&self) -> usize {
        match self {
            ArrayData::F8(v) => v.len(),
            ArrayData::U4(v) => v.len(),
            ArrayData::U8(v) => v.len(),
            ArrayData::Bool(v) => v.len(),
            ArrayData::Bytes(v) => v.len(),
        }
    }
}

impl Serialize for Array {
    fn serialize<S: Serializer>(&self, to: S) -> std::result::Result<S::Ok, S::Error> {
        ArraySlice { array: self, axis: 0, from: 0, to: self.data.len() }.serialize(to)
    }
}

/// The sub-array at fixed indices of the first axes.
struct ArraySlice<'a> {
    array: &'a Array,
    axis: usize,
    from: usize,
    to: usize,
}

impl Serialize for ArraySlice<'_> {
    fn serialize<S: Serializer>(&self, to: S) -> std::result::Result<S::Ok, S::Error> {
        let Some(n) = self.array.shape.get(self.axis) else {
            return match &self.array.data {
                ArrayData::F8(v) => to.serialize_f64(v[self.from]),
                ArrayData::U4(v) => to.serialize_u32(v[self.from]),
                ArrayData::U8(v) => to.serialize_u64(v[self.from]),
                ArrayData::Bool(v) => to.serialize_bool(v[self.from]),
                ArrayData::Bytes(v) => to.serialize_u8(v[self.from]),
            };
        };
        let each = (self.to - self.from) / (*n).max(1);
        let mut list = to.serialize_seq(Some(*n))?;
        for i in 0..*n {
            let from = self.from + i * each;
            list.serialize_element(&ArraySlice {
                array: self.array,
                axis: self.axis + 1,
                from,
                to: from + each,
            })?;
        }
        list.end()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    #[test]
    fn round_trips_through_nested_lists() {
        let array = Array::rows(vec![vec![0.1, 2.0, f64::NAN], vec![-0.0, 1e300, 5.0]]);
        let nested = json!([[0.1, 2.0, null], [-0.0, 1e300, 5.0]]);
        assert_eq!(serde_json::to_value(&array).unwrap(), nested);
        let (dtype, shape) = (array.dtype(), array.shape().to_vec());
        assert_eq!(to_nested_lists("a", dtype, &shape, &array.into_bytes()).unwrap(), nested);
        assert_eq!(to_nested_lists("a", "|b1", &[2], &[0, 7]).unwrap(), json!([false, true]));
        assert_eq!(to_nested_lists("a", "<i4", &[], &[255, 255, 255, 255]).unwrap(), json!(-1));
        assert_eq!(to_nested_lists("a", "<f4", &[1, 1], &0.5f32.to_le_bytes()).unwrap(), json!([[0.5]]));
    }

    #[test]
    fn rejects_invalid_dtype_shape_and_size() {
        for (dtype, shape, bytes) in [
            (">f8", vec![1], 8),
            ("<f8", vec![2], 8),
            ("<f8", vec![usize::MAX, 2], 16),
            ("|u1", vec![1; 9], 1),
        ] {
            let error = to_nested_lists("a", dtype, &shape, &vec![0; bytes]).unwrap_err();
            assert!(error.to_string().starts_with("`a."), "{error}");
        }
        // An empty array may have a huge shape.
        assert_eq!(to_nested_lists("a", "<f8", &[usize::MAX, 0], &[]).unwrap(), json!([]));
    }
}
