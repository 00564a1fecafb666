//! Health.

use crate::serve::wire::Health;

/// How the server is, in a word.
pub fn health(status: &'static str) -> Health {
    Health { status, version: env!("CARGO_PKG_VERSION") }
}
