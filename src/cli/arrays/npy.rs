//! Arrays in NumPy's format.
//!
//! Source: NumPy Enhancement Proposal 1, version 1.0 of the format.
//!
//! Differences from the source: C order only, and only the types that are written here.

use iplw::error::{Error, Result};

/// Start of a file of version 1.
const MAGIC: &[u8] = b"\x93NUMPY\x01";
/// Numbers of f64 and i32 in files.
pub const F64: &str = "<f8";
pub const I32: &str = "<i4";
pub const I8: &str = "|i1";

/// A file of one array in C order; `kind` is NumPy's name of the type.
pub fn npy(kind: &str, shape: &[usize], data: &[u8]) -> Vec<u8> {
    let mut bytes = header(kind, shape);
    bytes.extend(data);
    bytes
}

/// The bytes before the data of an array.
pub fn header(kind: &str, shape: &[usize]) -> Vec<u8> {
    let lengths: String = shape.iter().map(|n| format!("{n}, ")).collect();
    // A tuple of one number has a comma, others have none at the end.
    let lengths = if shape.len() == 1 { lengths.trim_end() } else { lengths.trim_end_matches(", ") };
    let mut header = format!("{{'descr': '{kind}', 'fortran_order': False, 'shape': ({lengths}), }}");
    // The header is padded so that the data start at a multiple of 64 bytes.
    let length = (10 + header.len() + 1).next_multiple_of(64) - 10;
    header += &" ".repeat(length - 1 - header.len());
    header.push('\n');
    let mut bytes = [MAGIC, &[0]].concat();
    bytes.extend((length as u16).to_le_bytes());
    bytes.extend(header.as_bytes());
    bytes
}

/// Shape and data of an array of type `kind`, whose values take `size` bytes; `file` is for errors.
pub fn parse<'a>(file: &str, bytes: &'a [u8], kind: &str, size: usize) -> Result<(Vec<usize>, &'a [u8])> {
    let allowed = format!(
        "a complete NumPy array of type {kind:?} in C order (`numpy.ascontiguousarray(array, {kind:?})`)"
    );
    let refused = |value: &str| Error::input(file, value, &allowed);
    let fixed = bytes.get(..10).filter(|b| b.starts_with(MAGIC)).ok_or_else(|| refused("no array"))?;
    let length = usize::from(u16::from_le_bytes([fixed[8], fixed[9]]));
    let header = bytes.get(10..10 + length).and_then(|b| std::str::from_utf8(b).ok());
    let header = header.ok_or_else(|| refused("an array whose header is cut short"))?;
    let has = |text: &str| header.contains(text);
    if !(has(&format!("'descr': '{kind}'")) && has("'fortran_order': False")) {
        return Err(refused("an array of another type or order"));
    }
    let inner = header.split_once("'shape': (").and_then(|(_, rest)| rest.split_once(')'));
    let lengths = inner.map(|(s, _)| s.split(',').map(str::trim).filter(|n| !n.is_empty()));
    let shape: Option<Vec<usize>> = lengths.and_then(|all| all.map(|n| n.parse().ok()).collect());
    let shape = shape.ok_or_else(|| refused("an array without shape"))?;
    let data = &bytes[10 + length..];
    let wanted = shape.iter().try_fold(size, |product, n| product.checked_mul(*n));
    match wanted == Some(data.len()) {
        true => Ok((shape, data)),
        false => Err(refused(&format!("an array of shape {shape:?} that holds {} bytes", data.len()))),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn follows_the_numpy_format() {
        for (shape, text) in [(&[2, 3][..], "(2, 3)"), (&[6], "(6,)"), (&[], "()"), (&[1, 2, 3], "(1, 2, 3)")]
        {
            let count = shape.iter().product();
            let data: Vec<u8> = (0..count).map(|i| i as u8).collect();
            let bytes = npy(I8, shape, &data);
            let length = usize::from(u16::from_le_bytes([bytes[8], bytes[9]]));
            let header = std::str::from_utf8(&bytes[10..10 + length]).unwrap();
            assert_eq!((10 + length) % 64, 0);
            assert_eq!(&bytes[..8], b"\x93NUMPY\x01\x00");
            assert!(
                header.starts_with(&format!("{{'descr': '|i1', 'fortran_order': False, 'shape': {text}, }}")),
                "{header}"
            );
            assert!(header.ends_with('\n'));
            assert_eq!(parse("a", &bytes, I8, 1).unwrap(), (shape.to_vec(), &data[..]));
        }
    }

    #[test]
    fn rejects_other_arrays() {
        let bytes = npy(I8, &[2, 3], &[1, 255, 0, 1, 1, 0]);
        let longer = [bytes.clone(), vec![0]].concat();
        let fortran = String::from_utf8_lossy(&bytes[10..]).replace("False", "True ");
        let turned = [&bytes[..10], fortran.as_bytes()].concat();
        for (broken, kind) in
            [(&bytes[..bytes.len() - 1], I8), (&bytes[..40], I8), (&bytes[..5], I8), (&bytes, F64)]
        {
            assert!(parse("a", broken, kind, 1).is_err(), "{} bytes as {kind}", broken.len());
        }
        assert!(parse("a", &longer, I8, 1).is_err() && parse("a", &turned, I8, 1).is_err());
        assert!(parse("a", &npy(I8, &[usize::MAX, 2], &[]), I8, 1).is_err());
    }
}
