//! JSON from outside: one parser whose errors name the field's path.

use serde::de::DeserializeOwned;
use serde_json::Value;

use crate::error::{Error, Input, Result, shown};

/// Parses `text` as `T`; the error names the path (`bodies[2].shape.radius`), line and what was wrong.
///
/// A whole number may be written `3.0`, as JSON Schema has it and some languages write it.
pub fn parse<T: DeserializeOwned>(text: &str) -> Result<T> {
    parse_strictly(text).or_else(|error| {
        let Ok(mut value) = serde_json::from_str::<Value>(text) else { return Err(error) };
        if !whole(&mut value) {
            return Err(error);
        }
        // If that was not it, the first error names the line.
        from_value(value).map_err(|_| error)
    })
}

/// [`parse`] for a value that is JSON already.
pub fn from_value<T: DeserializeOwned>(value: Value) -> Result<T> {
    // To know where one is costs more than to read: that is found out only once something is wrong.
    T::deserialize(&value).or_else(|_| {
        serde_path_to_error::deserialize(value).map_err(|e| {
            let path = e.path().to_string();
            refuse(if path == "." { "" } else { &path }, e.inner())
        })
    })
}

/// Reads and parses a file.
pub fn read<T: DeserializeOwned>(path: &std::path::Path) -> Result<T> {
    let text = std::fs::read_to_string(path).map_err(|e| Error::io(path, e))?;
    parse(&text).map_err(|e| e.at(path.display()))
}

fn parse_strictly<T: DeserializeOwned>(text: &str) -> Result<T> {
    // As in `from_value`.
    if let Ok(value) = serde_json::from_str(text) {
        return Ok(value);
    }
    let mut deserializer = serde_json::Deserializer::from_str(text);
    let value = serde_path_to_error::deserialize(&mut deserializer).map_err(|e| {
        let path = e.path().to_string();
        refuse(if path == "." { "" } else { &path }, e.inner())
    })?;
    deserializer.end().map_err(|e| refuse("", &e))?;
    Ok(value)
}

/// Writes numbers like `3.0` as `3`; whether there were any.
fn whole(value: &mut Value) -> bool {
    match value {
        Value::Number(number) => {
            // Beyond 2^53 a float may stand for several whole numbers.
            let exact = number.as_f64().filter(|x| number.is_f64() && x.fract() == 0.0 && x.abs() <= 9e15);
            if let Some(x) = exact {
                *number = if x < 0.0 { (x as i64).into() } else { (x as u64).into() };
            }
            exact.is_some()
        }
        Value::Array(items) => items.iter_mut().fold(false, |found, item| whole(item) | found),
        Value::Object(fields) => fields.values_mut().fold(false, |found, item| whole(item) | found),
        _ => false,
    }
}

fn refuse(path: &str, error: &serde_json::Error) -> Error {
    let message = error.to_string();
    // A field that is not known is named in it, however long it is.
    let reason = shown(message.split(" at line ").next().unwrap_or(&message));
    let place = if error.line() > 0 { format!("line {}", error.line()) } else { String::new() };
    Error::Input(Input {
        place,
        field: shown(path),
        value: String::new(),
        allowed: format!("valid JSON of this format ({reason})"),
    })
}

#[cfg(test)]
mod tests {
    use super::parse;

    #[test]
    fn long_names_are_cut() {
        #[derive(Debug, serde::Deserialize)]
        #[serde(deny_unknown_fields)]
        struct Nothing {}
        let error = parse::<Nothing>(&format!("{{\"{}\": 1}}", "a".repeat(100_000))).unwrap_err();
        assert!(error.to_string().len() < 2500, "{error}");
    }

    #[test]
    fn whole_numbers_may_have_a_point() {
        assert_eq!(parse::<(u64, i32, f64)>("[3.0, -2.0, 3.0]").unwrap(), (3, -2, 3.0));
        for no in ["[3.5]", "[-1.0]", "[1e300]", "[\"3\"]"] {
            let error = parse::<Vec<u64>>(no).unwrap_err().to_string();
            assert!(error.contains("line 1: `[0]`"), "{error}");
        }
    }
}
