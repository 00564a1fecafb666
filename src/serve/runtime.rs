//! The server's tokio runtime.

use std::future::Future;
use std::time::Duration;

use super::memory;
use super::scheduler::FairScheduler;
use crate::error::{Error, Result};

/// Runs a server to completion on its own runtime; blocking work that outlasts `patience` is abandoned.
pub fn run_to_completion(server: impl Future<Output = Result<()>>, patience: Duration) -> Result<()> {
    memory::configure();
    let runtime = tokio::runtime::Builder::new_multi_thread()
        .enable_all()
        .max_blocking_threads(FairScheduler::max_blocking_threads())
        .build()
        .map_err(|e| Error::Failed(format!("the server's threads cannot be started: {e}")))?;
    let done = runtime.block_on(server);
    runtime.shutdown_timeout(patience);
    done
}
