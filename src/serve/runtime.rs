//! The threads that a server runs on.

use std::future::Future;
use std::time::Duration;

use super::fair::Fair;
use super::memory;
use crate::error::{Error, Result};

/// Runs a server to its end on a runtime of its own; what has not noticed the end after `patience` goes with the process.
pub fn run_to_end(server: impl Future<Output = Result<()>>, patience: Duration) -> Result<()> {
    memory::set_up();
    let runtime = tokio::runtime::Builder::new_multi_thread()
        .enable_all()
        .max_blocking_threads(Fair::threads())
        .build()
        .map_err(|e| Error::Failed(format!("no threads to serve with: {e}")))?;
    let done = runtime.block_on(server);
    runtime.shutdown_timeout(patience);
    done
}
