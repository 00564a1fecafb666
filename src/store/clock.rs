//! The time of records.

use std::time::{SystemTime, UNIX_EPOCH};

/// Current time, ms since 1970.
pub fn unix_ms() -> u64 {
    SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default().as_millis() as u64
}
