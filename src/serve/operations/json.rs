//! Serialisation of our own types as JSON, for storage.

use serde::Serialize;
use serde_json::Value;

use crate::error::{Error, Result};

/// Serialises as a JSON value.
pub fn to_value<T: Serialize>(value: &T) -> Result<Value> {
    serde_json::to_value(value).map_err(unwritable)
}

/// Serialises as JSON text, with all digits of numbers.
pub fn to_json<T: Serialize>(value: &T) -> Result<String> {
    serde_json::to_string(value).map_err(unwritable)
}

fn unwritable(e: serde_json::Error) -> Error {
    Error::Failed(format!("cannot serialise as JSON: {e}"))
}
