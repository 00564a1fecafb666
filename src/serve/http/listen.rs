//! Connections: taken, timed, and let go when the server stops, when nothing comes of them, or when there are too many.

use std::collections::HashMap;
use std::io::{self, ErrorKind};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

use axum::Router;
use axum::body::Body;
use axum::http::Request;
use axum::response::Response;
use hyper::body::Incoming;
use hyper::server::conn::http1;
use hyper::service::service_fn;
use hyper_util::rt::TokioIo;
use tokio::io::{AsyncRead, AsyncWrite};
use tokio::net::TcpListener;
use tokio::sync::mpsc;
use tower_service::Service;

use super::timed::{Held, Timed, Watch};
use super::tls::Tls;
use crate::serve::limits::Limits;
use crate::serve::shared::Shared;

/// Answers until the server stops; then ends what is under way.
pub async fn serve(listener: TcpListener, router: Router, shared: Arc<Shared>, tls: Option<Arc<Tls>>) {
    let open = Arc::new(Open { most: shared.limits.connections, connections: Mutex::default() });
    let mut stopping = shared.stopping.subscribe();
    // Closed once the last connection has let go of it.
    let (alive, mut ended) = mpsc::channel::<()>(1);
    for number in 0u64.. {
        let stream = tokio::select! {
            _ = stopping.wait_for(|s| *s) => break,
            accepted = listener.accept() => match accepted {
                Ok((stream, _)) => stream,
                Err(e) => {
                    refused(&open, &e).await;
                    continue;
                }
            },
        };
        // An answer's last bytes do not wait for the client's word on those before.
        let _ = stream.set_nodelay(true);
        let Some(watch) = open.take(number, &shared.limits) else { continue };
        let timed = Timed::new(stream, watch.clone());
        let (open, router, shared, alive) = (open.clone(), router.clone(), shared.clone(), alive.clone());
        let acceptor = tls.as_ref().map(|tls| tls.acceptor());
        tokio::spawn(async move {
            match acceptor {
                None => converse(timed, router, &shared, watch).await,
                // Who takes too long over it is noticed by the stream below.
                Some(acceptor) => match acceptor.accept(timed).await {
                    Ok(stream) => converse(stream, router, &shared, watch).await,
                    Err(e) => tracing::info!("a connection that does not speak TLS: {e}"),
                },
            }
            open.leave(number);
            drop(alive);
        });
    }
    drop(alive);
    let _ = ended.recv().await;
}

/// One connection, to its end.
async fn converse<S>(stream: S, router: Router, shared: &Shared, watch: Arc<Watch>)
where
    S: AsyncRead + AsyncWrite + Unpin + Send + 'static,
{
    let service = service_fn(|request: Request<Incoming>| {
        let busy = watch.begin();
        let mut router = router.clone();
        async move {
            let response: Result<Response, std::convert::Infallible> = router.call(request).await;
            response.map(|r| r.map(|body: Body| Held { body, _busy: busy }))
        }
    });
    let connection = http1::Builder::new().serve_connection(TokioIo::new(stream), service);
    let mut connection = std::pin::pin!(connection);
    let mut stopping = shared.stopping.subscribe();
    tokio::select! {
        // What a client breaks off is its own affair.
        _ = connection.as_mut() => return,
        () = watch.evicted() => return,
        _ = stopping.wait_for(|s| *s) => connection.as_mut().graceful_shutdown(),
    }
    tokio::select! {
        _ = connection => {}
        () = watch.evicted() => {}
    }
}

/// A connection that could not be taken: its own fault, or there are no more descriptors.
async fn refused(open: &Open, error: &io::Error) {
    let its_own = [ErrorKind::ConnectionRefused, ErrorKind::ConnectionAborted, ErrorKind::ConnectionReset];
    if its_own.contains(&error.kind()) {
        return;
    }
    tracing::warn!("a connection could not be taken: {error}");
    open.evict();
    tokio::time::sleep(Duration::from_millis(100)).await;
}

/// Connections there are, by number.
struct Open {
    most: usize,
    connections: Mutex<HashMap<u64, Arc<Watch>>>,
}

impl Open {
    /// Takes a new connection in, in place of one that waits if need be; none if all are busy.
    fn take(&self, number: u64, limits: &Limits) -> Option<Arc<Watch>> {
        let full = self.connections.lock().unwrap_or_else(PoisonError::into_inner).len() >= self.most;
        if full && !self.evict() {
            return None;
        }
        let watch = Watch::new(limits);
        self.connections.lock().unwrap_or_else(PoisonError::into_inner).insert(number, watch.clone());
        Some(watch)
    }

    /// Hangs up on whoever has waited longest without asking for anything; whether there was one.
    fn evict(&self) -> bool {
        let mut connections = self.connections.lock().unwrap_or_else(PoisonError::into_inner);
        let waiting = connections.iter().filter_map(|(number, watch)| Some((watch.waits_since()?, *number)));
        let Some((_, number)) = waiting.min() else { return false };
        connections.remove(&number).is_some_and(|watch| {
            watch.evict();
            true
        })
    }

    fn leave(&self, number: u64) {
        self.connections.lock().unwrap_or_else(PoisonError::into_inner).remove(&number);
    }
}
