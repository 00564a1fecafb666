//! Whether the disk takes writes, probed when a client asks whether the server is ready.

use std::sync::Mutex;
use std::time::{Duration, Instant};

use crate::error::Result;
use crate::store::Store;
use crate::sync::lock;

/// The result of the last probe.
#[derive(Default)]
pub struct DiskProbe {
    last: Mutex<Option<(Instant, bool)>>,
}

/// How long a result is used: anybody may ask, and a probe writes to the disk.
const RESULT_LIFETIME: Duration = Duration::from_secs(2);

impl DiskProbe {
    /// The last result, unless it is too old.
    pub fn recent(&self) -> Option<bool> {
        lock(&self.last).filter(|(at, _)| at.elapsed() < RESULT_LIFETIME).map(|(_, writable)| writable)
    }

    /// Probes the disk, unless that was done a moment ago; an error is logged.
    pub fn check(&self, store: &Store) -> bool {
        self.recent().unwrap_or_else(|| {
            let probed: Result<()> = store.probe_write();
            if let Err(e) = &probed {
                tracing::error!("not ready, since the disk takes no writes: {e}");
            }
            *lock(&self.last) = Some((Instant::now(), probed.is_ok()));
            probed.is_ok()
        })
    }
}
