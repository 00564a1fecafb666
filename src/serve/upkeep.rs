//! What goes on beside requests, over whatever transport they come: a server is opened, kept, and brought to its end.

use std::sync::Arc;
use std::time::Duration;

use tokio::task::JoinHandle;

use super::app::App;
use super::client::Client;
use super::config::ServeConfig;
use super::limits::Limits;
use super::memory;
use super::operations;
use super::shared::Shared;
use crate::access::{Keyring, Who, now};
use crate::error::Result;

/// The work under way; ended by [`Upkeep::end`].
pub struct Upkeep {
    shared: Arc<Shared>,
    tasks: Vec<JoinHandle<()>>,
}

/// Opens the store, makes the default worlds and queues the jobs whose answers are all there.
pub fn open(config: &ServeConfig, keyring: Keyring, document: &'static str) -> Result<Arc<Shared>> {
    let shared = Arc::new(Shared::new(config, keyring, operations::recipes, document)?);
    let day = Duration::from_secs(86_400);
    operations::asked::catch_up(&App::new(&shared, Who::anybody(), &Client::local(), day))?;
    Ok(shared)
}

impl Upkeep {
    /// Begins it, on the async threads.
    pub fn start(shared: &Arc<Shared>) -> Upkeep {
        let idle = Limits::span(shared.limits.world_idle_seconds);
        let mut tasks = vec![tokio::spawn(sweep(shared.clone(), idle)), tokio::spawn(write(shared.clone()))];
        let kept = shared.limits.job_kept_seconds.map(Limits::span);
        tasks.extend(kept.map(|kept| tokio::spawn(forget(shared.clone(), kept))));
        Upkeep { shared: shared.clone(), tasks }
    }

    /// Ends it, and jobs with it, which may take so long to notice: those not finished are left to the next server on the
    /// same directory.
    pub async fn end(self, grace: Duration) {
        self.tasks.iter().for_each(JoinHandle::abort);
        let shared = self.shared;
        let last = move || {
            shared.jobs.stop(grace);
            flush(&shared);
        };
        // Off the async threads: waits for jobs to notice.
        let _ = tokio::task::spawn_blocking(last).await;
    }
}

/// Forgets idle worlds from time to time, also when nobody asks, and gives back the memory that lies free.
async fn sweep(shared: Arc<Shared>, idle: Duration) {
    let pause = (idle / 4).clamp(Duration::from_millis(100), Duration::from_secs(10));
    loop {
        tokio::time::sleep(pause).await;
        let base = shared.base.clone();
        let sweep = move || {
            let swept = base.worlds.sweep(base.now());
            memory::give_back();
            swept
        };
        let swept = tokio::task::spawn_blocking(sweep).await;
        if let Ok(Err(e)) = swept {
            tracing::error!("idle worlds could not be forgotten: {e}");
        }
    }
}

/// Forgets jobs that ended long ago, and weights that no policy names any more.
async fn forget(shared: Arc<Shared>, kept: Duration) {
    let pause = (kept / 10).clamp(Duration::from_millis(200), Duration::from_secs(600));
    loop {
        let shared = shared.clone();
        let before = now().saturating_sub(kept.as_secs());
        let forget = move || {
            let forgotten = shared.jobs.forget_ended(before)?;
            shared.base.store.sweep_blobs().map(|()| forgotten)
        };
        match tokio::task::spawn_blocking(forget).await {
            Ok(Ok(forgotten)) if forgotten > 0 => {
                tracing::info!("{forgotten} jobs that ended long ago are forgotten")
            }
            Ok(Err(e)) => tracing::error!("jobs that ended long ago could not be forgotten: {e}"),
            _ => {}
        }
        tokio::time::sleep(pause).await;
    }
}

/// Every second writes down what need not last at once (counters of simulated worlds), and looks at the tokens.
async fn write(shared: Arc<Shared>) {
    loop {
        tokio::time::sleep(Duration::from_secs(1)).await;
        let shared = shared.clone();
        let now_and_then = move || {
            flush(&shared);
            if let Err(e) = shared.keyring.refresh() {
                tracing::error!("tokens cannot be read, those read before stay: {e}");
            }
        };
        let _ = tokio::task::spawn_blocking(now_and_then).await;
    }
}

fn flush(shared: &Shared) {
    if let Err(e) = shared.base.store.flush_worlds() {
        tracing::error!("counters of worlds could not be stored: {e}");
    }
    if let Err(e) = shared.base.store.flush_log() {
        tracing::error!("logs of jobs could not be stored: {e}");
    }
}
