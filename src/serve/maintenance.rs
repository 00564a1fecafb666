//! Startup, periodic maintenance and shutdown of a server.

use std::sync::Arc;
use std::time::Duration;

use tokio::task::JoinHandle;

use super::client::Client;
use super::config::ServeConfig;
use super::limits::Limits;
use super::memory;
use super::memory_pressure::{available_bytes, is_memory_scarce};
use super::operations;
use super::request_context::RequestContext;
use super::state::AppState;
use crate::access::{Keyring, Principal, now};
use crate::error::Result;

/// The maintenance tasks; ended by [`Maintenance::end`].
pub struct Maintenance {
    shared: Arc<AppState>,
    tasks: Vec<JoinHandle<()>>,
}

/// Opens the store, creates the default worlds and resumes the jobs whose results are complete.
pub fn open(config: &ServeConfig, keyring: Keyring, document: &'static str) -> Result<Arc<AppState>> {
    let shared = Arc::new(AppState::new(config, keyring, operations::work_factories, document)?);
    let day = Duration::from_secs(86_400);
    operations::ask_tell::resume_complete_rounds(&RequestContext::new(
        &shared,
        Principal::anonymous(),
        &Client::local(),
        day,
    ))?;
    Ok(shared)
}

impl Maintenance {
    /// Starts the tasks on the async runtime.
    pub fn start(shared: &Arc<AppState>) -> Maintenance {
        let tasks = vec![
            tokio::spawn(forget(shared.clone())),
            tokio::spawn(sweep(shared.clone())),
            tokio::spawn(write(shared.clone())),
            tokio::spawn(refresh_tokens(shared.clone())),
            tokio::spawn(watch_memory(shared.clone())),
        ];
        Maintenance { shared: shared.clone(), tasks }
    }

    /// Ends the tasks and the jobs; jobs have `grace` to notice, and unfinished ones are left to the next server on the same
    /// directory.
    pub async fn end(self, grace: Duration) {
        self.tasks.iter().for_each(JoinHandle::abort);
        let shared = self.shared;
        let last = move || {
            shared.jobs.stop(grace);
            flush(&shared);
        };
        // `stop` blocks until the jobs notice, so it runs off the async threads.
        let _ = tokio::task::spawn_blocking(last).await;
    }
}

/// Removes idle worlds periodically, and returns free memory to the system.
async fn sweep(shared: Arc<AppState>) {
    loop {
        let idle = Limits::duration(shared.limits().world_idle_seconds);
        tokio::time::sleep((idle / 4).clamp(Duration::from_millis(100), Duration::from_secs(10))).await;
        let base = shared.core.clone();
        let sweep = move || {
            let swept = base.worlds.sweep(base.now());
            memory::return_free_memory();
            swept
        };
        let swept = tokio::task::spawn_blocking(sweep).await;
        if let Ok(Err(e)) = swept {
            tracing::error!("idle worlds could not be removed: {e}");
        }
    }
}

/// Longest time between two removals of old jobs.
const LONGEST_RETENTION_PAUSE: Duration = Duration::from_secs(600);

/// Removes jobs that ended long ago, and weights that no policy refers to.
async fn forget(shared: Arc<AppState>) {
    loop {
        let Some(retention) = shared.limits().job_kept_seconds.map(Limits::duration) else {
            // The limit may be set when the limits are read again.
            tokio::time::sleep(LONGEST_RETENTION_PAUSE).await;
            continue;
        };
        let pause = (retention / 10).clamp(Duration::from_millis(200), LONGEST_RETENTION_PAUSE);
        let shared = shared.clone();
        let before = now().saturating_sub(retention.as_secs());
        let forget = move || {
            let forgotten = shared.jobs.remove_ended(before)?;
            shared.core.store.sweep_blobs().map(|()| forgotten)
        };
        match tokio::task::spawn_blocking(forget).await {
            Ok(Ok(forgotten)) if forgotten > 0 => {
                tracing::info!("{forgotten} old jobs were removed")
            }
            Ok(Err(e)) => tracing::error!("old jobs could not be removed: {e}"),
            _ => {}
        }
        tokio::time::sleep(pause).await;
    }
}

/// Every second: writes the counters of simulated worlds and the job logs.
async fn write(shared: Arc<AppState>) {
    loop {
        tokio::time::sleep(Duration::from_secs(1)).await;
        let shared = shared.clone();
        let _ = tokio::task::spawn_blocking(move || flush(&shared)).await;
    }
}

/// Four times a second: reloads the tokens if their file has changed.
async fn refresh_tokens(shared: Arc<AppState>) {
    let mut last_error = None;
    loop {
        tokio::time::sleep(Duration::from_millis(250)).await;
        let shared = shared.clone();
        let refreshed = tokio::task::spawn_blocking(move || shared.keyring.refresh()).await;
        let error = refreshed.ok().and_then(|refreshed| refreshed.err()).map(|e| e.to_string());
        if let Some(error) = error.as_ref().filter(|error| last_error.as_ref() != Some(*error)) {
            tracing::error!("tokens cannot be reloaded; the previous ones stay valid: {error}");
        }
        last_error = error;
    }
}

/// Ten times a second while jobs run: notes in the store which do while memory is scarce, before the system ends the process.
async fn watch_memory(shared: Arc<AppState>) {
    let Some(available) = available_bytes() else { return };
    loop {
        tokio::time::sleep(Duration::from_millis(100)).await;
        if !shared.jobs.is_running() {
            continue;
        }
        let shared = shared.clone();
        let watch = move || {
            if is_memory_scarce(available)
                && let Err(e) = shared.jobs.note_scarce_memory()
            {
                tracing::error!("the jobs that run while memory is scarce could not be noted: {e}");
            }
        };
        let _ = tokio::task::spawn_blocking(watch).await;
    }
}

fn flush(shared: &AppState) {
    if let Err(e) = shared.core.store.flush_worlds() {
        tracing::error!("counters of worlds could not be stored: {e}");
    }
    if let Err(e) = shared.core.store.flush_log() {
        tracing::error!("logs of jobs could not be stored: {e}");
    }
}
