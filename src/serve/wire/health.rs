//! Whether the server answers.

use serde::Serialize;
use utoipa::ToSchema;

use super::bulk::Bulk;

/// Whether the server answers.
#[derive(Serialize, ToSchema)]
pub struct Health {
    /// `ok`, `ready` or `stopping`.
    pub status: &'static str,
    /// Version of the program.
    pub version: &'static str,
}

impl Bulk for Health {}
