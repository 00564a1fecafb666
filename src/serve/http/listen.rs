//! Accepts connections and serves them until the server stops, a timeout expires, or they are evicted.

use std::io::{self, ErrorKind};
use std::sync::Arc;
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

use super::connections::{ConnectionHandle, ConnectionRegistry};
use super::timeouts::{GuardedBody, TimeoutStream};
use super::tls::Tls;
use crate::serve::client::Client;
use crate::serve::state::AppState;

/// Serves until the server stops, then finishes the requests in flight.
pub async fn serve(listener: TcpListener, router: Router, shared: Arc<AppState>, tls: Option<Arc<Tls>>) {
    let registry = ConnectionRegistry::new(shared.http_connections.clone());
    let mut stopping = shared.stopping.subscribe();
    // Closed when the last connection has dropped its sender.
    let (alive, mut ended) = mpsc::channel::<()>(1);
    for number in 0u64.. {
        let (stream, from) = tokio::select! {
            _ = stopping.wait_for(|s| *s) => break,
            accepted = listener.accept() => match accepted {
                Ok((stream, from)) => (stream, Client::at(from.ip())),
                Err(e) => {
                    handle_accept_error(&registry, &e).await;
                    continue;
                }
            },
        };
        // The end of a response must not wait for a delayed acknowledgement (Nagle's algorithm).
        let _ = stream.set_nodelay(true);
        let Some(connection_handle) = registry.register(number, from, &shared.limits()) else { continue };
        let timed = TimeoutStream::new(stream, connection_handle.timer().clone());
        let (registry, router, shared, alive) =
            (registry.clone(), router.clone(), shared.clone(), alive.clone());
        let acceptor = tls.as_ref().map(|tls| tls.acceptor());
        tokio::spawn(async move {
            match acceptor {
                None => serve_connection(timed, router, &shared, connection_handle).await,
                // A slow handshake is ended by the timeout of the stream.
                Some(acceptor) => match acceptor.accept(timed).await {
                    Ok(stream) => serve_connection(stream, router, &shared, connection_handle).await,
                    Err(e) => tracing::info!("TLS handshake failed: {e}"),
                },
            }
            registry.remove(number);
            drop(alive);
        });
    }
    drop(alive);
    let _ = ended.recv().await;
}

/// Maximum size of a request's head, bytes: unfinished heads take at most this times the number of connections.
const MAX_HEAD_BYTES: usize = 32 * 1024;

/// Serves one connection to its end.
async fn serve_connection<S>(
    stream: S,
    router: Router,
    shared: &AppState,
    connection_handle: Arc<ConnectionHandle>,
) where
    S: AsyncRead + AsyncWrite + Unpin + Send + 'static,
{
    let timer = connection_handle.timer();
    let service = service_fn(|mut request: Request<Incoming>| {
        let busy = timer.start_request();
        request.extensions_mut().insert(connection_handle.clone());
        let mut router = router.clone();
        async move {
            let response: Result<Response, std::convert::Infallible> = router.call(request).await;
            response.map(|r| r.map(|body: Body| GuardedBody { body, _guard: busy }))
        }
    });
    let connection =
        http1::Builder::new().max_buf_size(MAX_HEAD_BYTES).serve_connection(TokioIo::new(stream), service);
    let mut connection = std::pin::pin!(connection);
    let mut stopping = shared.stopping.subscribe();
    tokio::select! {
        // Errors of a connection concern only its client.
        _ = connection.as_mut() => return,
        () = timer.evicted() => return,
        _ = stopping.wait_for(|s| *s) => connection.as_mut().graceful_shutdown(),
    }
    tokio::select! {
        _ = connection => {}
        () = timer.evicted() => {}
    }
}

/// Handles an error of `accept`: of that connection, or because descriptors are exhausted.
async fn handle_accept_error(registry: &ConnectionRegistry, error: &io::Error) {
    let its_own = [ErrorKind::ConnectionRefused, ErrorKind::ConnectionAborted, ErrorKind::ConnectionReset];
    if its_own.contains(&error.kind()) {
        return;
    }
    tracing::warn!("a connection could not be accepted: {error}");
    registry.evict(None);
    tokio::time::sleep(Duration::from_millis(100)).await;
}
