//! JSON from outside: one parser whose errors name the field's path.

use serde::de::DeserializeOwned;

use crate::error::{Error, Input, Result};

/// Parses `text` as `T`; the error names the path (`bodies[2].shape.radius`), line and what was wrong.
pub fn parse<T: DeserializeOwned>(text: &str) -> Result<T> {
    let mut deserializer = serde_json::Deserializer::from_str(text);
    let value = serde_path_to_error::deserialize(&mut deserializer).map_err(|e| {
        let path = e.path().to_string();
        refuse(if path == "." { "" } else { &path }, e.inner())
    })?;
    deserializer.end().map_err(|e| refuse("", &e))?;
    Ok(value)
}

/// [`parse`] for a value that is JSON already.
pub fn from_value<T: DeserializeOwned>(value: serde_json::Value) -> Result<T> {
    serde_path_to_error::deserialize(value).map_err(|e| {
        let path = e.path().to_string();
        refuse(if path == "." { "" } else { &path }, e.inner())
    })
}

/// Reads and parses a file.
pub fn read<T: DeserializeOwned>(path: &std::path::Path) -> Result<T> {
    let text = std::fs::read_to_string(path).map_err(|e| Error::io(path, e))?;
    parse(&text).map_err(|e| e.at(path.display()))
}

fn refuse(path: &str, error: &serde_json::Error) -> Error {
    let message = error.to_string();
    let reason = message.split(" at line ").next().unwrap_or(&message).to_string();
    let place = if error.line() > 0 { format!("line {}", error.line()) } else { String::new() };
    Error::Input(Input {
        place,
        field: path.to_string(),
        value: String::new(),
        allowed: format!("valid JSON of this format ({reason})"),
    })
}
