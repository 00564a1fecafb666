//! Text of a file of unknown encoding.

use super::track_files::invalid_value;
use crate::error::Result;

/// Decodes UTF-8, UTF-16 (with a byte order mark, or recognised by its zero bytes), or Latin-1, which programs on Windows write.
/// Files that are not text are errors that say how to export them.
pub fn decode(bytes: Vec<u8>) -> Result<String> {
    let not_text =
        |what: &str| Err(invalid_value(1, "", what, "text, such as CSV: export the table as text"));
    match bytes.as_slice() {
        [0x89, b'H', b'D', b'F', ..] => {
            return Err(invalid_value(1, "", "HDF5", "text, such as CSV: in pandas, `DataFrame.to_csv`"));
        }
        [b'P', b'K', 3, 4, ..] => return not_text("a spreadsheet or another zip archive"),
        [0x1f, 0x8b, ..] => return not_text("compressed by gzip"),
        [0xff, 0xfe, rest @ ..] => return utf16(rest, u16::from_le_bytes),
        [0xfe, 0xff, rest @ ..] => return utf16(rest, u16::from_be_bytes),
        [first, 0, third, 0, ..] if *first != 0 && *third != 0 => return utf16(&bytes, u16::from_le_bytes),
        [0, second, 0, fourth, ..] if *second != 0 && *fourth != 0 => {
            return utf16(&bytes, u16::from_be_bytes);
        }
        _ => {}
    }
    if let Some(at) = bytes.iter().position(|b| *b == 0) {
        return Err(invalid_value(line_of(&bytes, at), "", "a zero byte", "text, such as CSV"));
    }
    // Every byte is a character of Latin-1.
    Ok(String::from_utf8(bytes).unwrap_or_else(|e| e.as_bytes().iter().map(|b| char::from(*b)).collect()))
}

fn utf16(bytes: &[u8], unit: fn([u8; 2]) -> u16) -> Result<String> {
    let units = bytes.chunks_exact(2).map(|pair| unit([pair[0], pair[1]]));
    let text: std::result::Result<String, _> = char::decode_utf16(units).collect();
    match text {
        Ok(text) if bytes.len().is_multiple_of(2) => Ok(text),
        _ => Err(invalid_value(1, "", "", "complete UTF-16 text; is the file cut off?")),
    }
}

/// Number, from 1, of the line that contains a byte.
fn line_of(bytes: &[u8], at: usize) -> usize {
    bytes[..at].iter().filter(|b| **b == b'\n').count() + 1
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn decodes_encodings_of_tracking_programs() {
        let text = "t,x (µm)\n0,1\n";
        let wide = |order: fn(u16) -> [u8; 2]| text.encode_utf16().flat_map(order).collect::<Vec<u8>>();
        let marked = |mark: [u8; 2], bytes: Vec<u8>| [mark.to_vec(), bytes].concat();
        let latin1: Vec<u8> = text.chars().map(|c| u8::try_from(u32::from(c)).unwrap()).collect();
        for bytes in [
            text.as_bytes().to_vec(),
            wide(u16::to_le_bytes),
            wide(u16::to_be_bytes),
            marked([0xff, 0xfe], wide(u16::to_le_bytes)),
            marked([0xfe, 0xff], wide(u16::to_be_bytes)),
            latin1,
        ] {
            assert_eq!(decode(bytes.clone()).unwrap(), text, "{bytes:?}");
        }
    }

    #[test]
    fn names_files_that_are_not_text() {
        for (bytes, wanted) in [
            (&b"\x89HDF\r\n\x1a\n\0\0"[..], "1: HDF5; allowed: text, such as CSV: in pandas"),
            (b"PK\x03\x04\x14\0", "a spreadsheet"),
            (b"\x1f\x8b\x08", "gzip"),
            (b"t,x,y\n0,1,\0\n", "2: a zero byte"),
            (b"\xff\xfet\0,\0x", "complete UTF-16"),
        ] {
            let error = decode(bytes.to_vec()).expect_err(wanted).to_string();
            assert!(error.contains(wanted), "{error}");
        }
    }
}
