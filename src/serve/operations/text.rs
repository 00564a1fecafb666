//! Things of ours as JSON, to be stored.

use serde::Serialize;
use serde_json::Value;

use crate::error::{Error, Result};

/// As a value.
pub fn json<T: Serialize>(value: &T) -> Result<Value> {
    serde_json::to_value(value).map_err(unwritable)
}

/// As text, whose numbers keep all their digits.
pub fn text<T: Serialize>(value: &T) -> Result<String> {
    serde_json::to_string(value).map_err(unwritable)
}

fn unwritable(e: serde_json::Error) -> Error {
    Error::Failed(format!("this cannot be written as JSON: {e}"))
}
