//! JSON input: one parser whose errors name the field's path.

use std::fmt;
use std::marker::PhantomData;

use serde::de::value::MapAccessDeserializer;
use serde::de::{Deserialize, DeserializeOwned, Deserializer, MapAccess, Visitor};
use serde_json::Value;

use crate::error::{Error, InvalidInput, Result, abbreviate};

/// Parses `text` as `T`; an error names the path (`bodies[2].shape.radius`), the line and the cause.
///
/// An integer may be written as `3.0`, as JSON Schema allows and some languages write it.
pub fn parse<T: DeserializeOwned>(text: &str) -> Result<T> {
    parse_strict(text).or_else(|error| {
        let Ok(mut value) = serde_json::from_str::<Value>(text) else { return Err(error) };
        if !convert_whole_floats(&mut value) {
            return Err(error);
        }
        // If it fails again, the first error, which names the line, is returned.
        from_value(value).map_err(|_| error)
    })
}

/// [`parse`] for a value that is already JSON.
pub fn from_value<T: DeserializeOwned>(value: Value) -> Result<T> {
    // Tracking the path costs more than parsing: it is repeated with path tracking only after an error.
    T::deserialize(&value).or_else(|_| {
        serde_path_to_error::deserialize(value).map_err(|e| {
            let path = e.path().to_string();
            invalid_json(if path == "." { "" } else { &path }, e.inner())
        })
    })
}

/// Reads and parses a file.
pub fn read<T: DeserializeOwned>(path: &std::path::Path) -> Result<T> {
    let text = std::fs::read_to_string(path).map_err(|e| Error::io(path, e))?;
    parse(&text).map_err(|e| e.in_file(path.display()))
}

fn parse_strict<T: DeserializeOwned>(text: &str) -> Result<T> {
    // The path is tracked only after an error, as in `from_value`.
    if let Ok(value) = serde_json::from_str(text) {
        return Ok(value);
    }
    let mut deserializer = serde_json::Deserializer::from_str(text);
    let value = serde_path_to_error::deserialize(&mut deserializer).map_err(|e| {
        let path = e.path().to_string();
        invalid_json(if path == "." { "" } else { &path }, e.inner())
    })?;
    deserializer.end().map_err(|e| invalid_json("", &e))?;
    Ok(value)
}

/// Converts floats without fractional part to integers; whether there were any.
fn convert_whole_floats(value: &mut Value) -> bool {
    match value {
        Value::Number(number) => {
            // Above 2^53 a float may stand for several integers.
            let exact = number.as_f64().filter(|x| number.is_f64() && x.fract() == 0.0 && x.abs() <= 9e15);
            if let Some(x) = exact {
                *number = if x < 0.0 { (x as i64).into() } else { (x as u64).into() };
            }
            exact.is_some()
        }
        Value::Array(items) => items.iter_mut().fold(false, |found, item| convert_whole_floats(item) | found),
        Value::Object(fields) => {
            fields.values_mut().fold(false, |found, item| convert_whole_floats(item) | found)
        }
        _ => false,
    }
}

fn invalid_json(path: &str, error: &serde_json::Error) -> Error {
    let message = error.to_string();
    // The message contains the name of an unknown field, which may be long.
    let reason = abbreviate(message.split(" at line ").next().unwrap_or(&message));
    let place = if error.line() > 0 { format!("line {}", error.line()) } else { String::new() };
    Error::Input(InvalidInput {
        place,
        field: abbreviate(path),
        value: String::new(),
        allowed: format!("valid JSON of this format ({reason})"),
    })
}

/// A `T` deserialised from a JSON object only: serde's derived structs would also accept an array of their fields.
#[derive(Clone, Debug)]
pub struct JsonObject<T>(pub T);

impl<'de, T: Deserialize<'de>> Deserialize<'de> for JsonObject<T> {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> std::result::Result<Self, D::Error> {
        deserializer.deserialize_map(ObjectVisitor(PhantomData)).map(JsonObject)
    }
}

struct ObjectVisitor<T>(PhantomData<T>);

impl<'de, T: Deserialize<'de>> Visitor<'de> for ObjectVisitor<T> {
    type Value = T;

    fn expecting(&self, f: &mut fmt::Formatter) -> fmt::Result {
        f.write_str("a JSON object")
    }

    fn visit_map<A: MapAccess<'de>>(self, map: A) -> std::result::Result<T, A::Error> {
        T::deserialize(MapAccessDeserializer::new(map))
    }
}

#[cfg(test)]
mod tests {
    use super::parse;

    #[test]
    fn truncates_long_names() {
        #[derive(Debug, serde::Deserialize)]
        #[serde(deny_unknown_fields)]
        struct EmptyObject {}
        let error = parse::<EmptyObject>(&format!("{{\"{}\": 1}}", "a".repeat(100_000))).unwrap_err();
        assert!(error.to_string().len() < 2500, "{error}");
    }

    #[test]
    fn accepts_integers_written_as_floats() {
        assert_eq!(parse::<(u64, i32, f64)>("[3.0, -2.0, 3.0]").unwrap(), (3, -2, 3.0));
        for no in ["[3.5]", "[-1.0]", "[1e300]", "[\"3\"]"] {
            let error = parse::<Vec<u64>>(no).unwrap_err().to_string();
            assert!(error.contains("line 1: `[0]`"), "{error}");
        }
    }
}
