//! SIGHUP: reads certificate, tokens and limits again. Also warns when the certificate has expired.

use std::sync::Arc;
use std::time::Duration;

use super::http::Tls;
use super::state::AppState;

/// How often the certificate's validity is checked.
const VALIDITY_CHECK_PERIOD: Duration = Duration::from_secs(3600);

/// Reloads at every SIGHUP, with or without TLS; what cannot be read stays as it was.
#[cfg(unix)]
pub async fn on_hangup(shared: Arc<AppState>, tls: Option<Arc<Tls>>) {
    use tokio::signal::unix::{SignalKind, signal};
    let Ok(mut hangup) = signal(SignalKind::hangup()) else { return };
    let mut validity = tokio::time::interval(VALIDITY_CHECK_PERIOD);
    loop {
        tokio::select! {
            Some(()) = hangup.recv() => {
                let (shared, tls) = (shared.clone(), tls.clone());
                let _ = tokio::task::spawn_blocking(move || reload(&shared, tls.as_deref())).await;
            }
            _ = validity.tick() => warn_of_invalid(tls.as_deref()),
        }
    }
}

/// SIGHUP does not exist on this platform.
#[cfg(not(unix))]
pub async fn on_hangup(_: Arc<AppState>, tls: Option<Arc<Tls>>) {
    let mut validity = tokio::time::interval(VALIDITY_CHECK_PERIOD);
    loop {
        validity.tick().await;
        warn_of_invalid(tls.as_deref());
    }
}

fn reload(shared: &AppState, tls: Option<&Tls>) {
    match shared.reload() {
        Ok(()) => tracing::info!("tokens and limits were reloaded"),
        Err(e) => tracing::error!("tokens and limits cannot be reloaded; the previous ones stay valid: {e}"),
    }
    let Some(tls) = tls else { return };
    match tls.reload() {
        Ok(()) => tracing::info!("the certificate was reloaded"),
        Err(e) => tracing::error!("the certificate cannot be reloaded; the previous one stays in use: {e}"),
    }
    warn_of_invalid(Some(tls));
}

fn warn_of_invalid(tls: Option<&Tls>) {
    if let Some(why) = tls.and_then(Tls::invalid_now) {
        tracing::error!("clients will refuse the certificate: {why}");
    }
}
