//! Compact readable JSON: one line for each field of an object, and one line for a list of plain values.

use std::io;

use iplw::error::{Error, Result};
use serde::Serialize;
use serde_json::Serializer;
use serde_json::ser::Formatter;

/// `value` as JSON text, without a final line break.
pub fn compact_json<T: Serialize>(value: &T) -> Result<String> {
    let mut out = Vec::new();
    let mut serializer = Serializer::with_formatter(&mut out, CompactFormatter::default());
    value.serialize(&mut serializer).map_err(|e| Error::Failed(e.to_string()))?;
    String::from_utf8(out).map_err(|e| Error::Failed(e.to_string()))
}

/// Breaks lines before fields, and before lists and objects within lists.
#[derive(Default)]
struct CompactFormatter {
    /// Open containers: whether it is a list, and whether it contains a line break.
    open: Vec<(bool, bool)>,
}

impl CompactFormatter {
    fn line<W: io::Write + ?Sized>(&mut self, writer: &mut W) -> io::Result<()> {
        if let Some(last) = self.open.last_mut() {
            last.1 = true;
        }
        writer.write_all(b"\n")?;
        (0..self.open.len()).try_for_each(|_| writer.write_all(b"  "))
    }

    fn begin<W: io::Write + ?Sized>(&mut self, writer: &mut W, list: bool) -> io::Result<()> {
        if self.open.last().is_some_and(|(list, _)| *list) {
            self.line(writer)?;
        }
        self.open.push((list, false));
        writer.write_all(if list { b"[" } else { b"{" })
    }

    fn end<W: io::Write + ?Sized>(&mut self, writer: &mut W) -> io::Result<()> {
        let (list, broken) = self.open.pop().unwrap_or_default();
        if broken {
            writer.write_all(b"\n")?;
            (0..self.open.len()).try_for_each(|_| writer.write_all(b"  "))?;
        }
        writer.write_all(if list { b"]" } else { b"}" })
    }
}

impl Formatter for CompactFormatter {
    fn begin_array<W: io::Write + ?Sized>(&mut self, writer: &mut W) -> io::Result<()> {
        self.begin(writer, true)
    }

    fn end_array<W: io::Write + ?Sized>(&mut self, writer: &mut W) -> io::Result<()> {
        self.end(writer)
    }

    fn begin_object<W: io::Write + ?Sized>(&mut self, writer: &mut W) -> io::Result<()> {
        self.begin(writer, false)
    }

    fn end_object<W: io::Write + ?Sized>(&mut self, writer: &mut W) -> io::Result<()> {
        self.end(writer)
    }

    fn begin_object_key<W: io::Write + ?Sized>(&mut self, writer: &mut W, first: bool) -> io::Result<()> {
        if !first {
            writer.write_all(b",")?;
        }
        self.line(writer)
    }

    fn begin_object_value<W: io::Write + ?Sized>(&mut self, writer: &mut W) -> io::Result<()> {
        writer.write_all(b": ")
    }
}

#[cfg(test)]
mod tests {
    use serde_json::{Value, json};

    use super::compact_json;

    #[test]
    fn keeps_lists_of_plain_values_on_one_line() {
        let value = json!({"a": [1.5, null, "x"], "b": [[1, 2], [3]], "c": [{"d": []}], "e": {}});
        let text = compact_json(&value).unwrap();
        let wanted = "{\n  \"a\": [1.5,null,\"x\"],\n  \"b\": [\n    [1,2],\n    [3]\n  ],\n  \"c\": [\n    {\n      \"d\": []\n    }\n  ],\n  \"e\": {}\n}";
        assert_eq!(text, wanted);
        assert_eq!(serde_json::from_str::<Value>(&text).unwrap(), value);
    }
}
