//! Whether the server answers.

use serde::Serialize;
use utoipa::ToSchema;

use super::binary_arrays::BinaryArrays;

/// Whether the server answers.
#[derive(Serialize, ToSchema)]
pub struct Health {
    /// `ok`, `ready`, `stopping`, or `disk` if the disk takes no writes.
    pub status: &'static str,
    /// Version of the program.
    pub version: &'static str,
}

impl BinaryArrays for Health {}
