//! Connections: taken, timed, and let go when the server stops, when nothing comes of them, or when there are too many.

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

use super::seat::{Open, Seat};
use super::timed::{Held, Timed};
use super::tls::Tls;
use crate::serve::client::Client;
use crate::serve::shared::Shared;

/// Answers until the server stops; then ends what is under way.
pub async fn serve(listener: TcpListener, router: Router, shared: Arc<Shared>, tls: Option<Arc<Tls>>) {
    let open = Open::new(shared.http.clone(), &shared.limits);
    let mut stopping = shared.stopping.subscribe();
    // Closed once the last connection has let go of it.
    let (alive, mut ended) = mpsc::channel::<()>(1);
    for number in 0u64.. {
        let (stream, from) = tokio::select! {
            _ = stopping.wait_for(|s| *s) => break,
            accepted = listener.accept() => match accepted {
                Ok((stream, from)) => (stream, Client::at(from.ip())),
                Err(e) => {
                    refused(&open, &e).await;
                    continue;
                }
            },
        };
        // An answer's last bytes do not wait for the client's word on those before.
        let _ = stream.set_nodelay(true);
        let Some(seat) = open.take(number, from, &shared.limits) else { continue };
        let timed = Timed::new(stream, seat.watch().clone());
        let (open, router, shared, alive) = (open.clone(), router.clone(), shared.clone(), alive.clone());
        let acceptor = tls.as_ref().map(|tls| tls.acceptor());
        tokio::spawn(async move {
            match acceptor {
                None => converse(timed, router, &shared, seat).await,
                // Who takes too long over it is noticed by the stream below.
                Some(acceptor) => match acceptor.accept(timed).await {
                    Ok(stream) => converse(stream, router, &shared, seat).await,
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
async fn converse<S>(stream: S, router: Router, shared: &Shared, seat: Arc<Seat>)
where
    S: AsyncRead + AsyncWrite + Unpin + Send + 'static,
{
    let watch = seat.watch();
    let service = service_fn(|mut request: Request<Incoming>| {
        let busy = watch.begin();
        request.extensions_mut().insert(seat.clone());
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
    open.evict(None);
    tokio::time::sleep(Duration::from_millis(100)).await;
}
