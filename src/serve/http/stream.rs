//! Streamed responses: large JSON in chunks, never whole in memory, and server-sent events.

use std::convert::Infallible;
use std::io::{self, BufWriter, Write};
use std::sync::Arc;
use std::time::Duration;

use axum::body::Body;
use axum::http::{HeaderValue, StatusCode, header};
use axum::response::sse::{self, KeepAlive, Sse};
use axum::response::{IntoResponse, Response};
use tokio::runtime::Handle;
use tokio::sync::{mpsc, oneshot};
use tokio_stream::wrappers::ReceiverStream;

use crate::access::{Digest, Principal, now};
use crate::serve::operation::{EventStream, SerializableValue, ServerEvent};
use crate::serve::problem::{HandlerResult, Problem};
use crate::serve::request_context::RequestContext;
use crate::serve::state::AppState;

/// Size of a chunk, bytes.
const CHUNK_BYTES: usize = 64 * 1024;
/// Time that a client has to read a chunk.
const CHUNK_TIMEOUT: Duration = Duration::from_secs(60);

/// Runs `work` on a blocking thread, which streams its result as JSON.
pub async fn stream_json(
    app: &Arc<RequestContext>,
    work: impl FnOnce(&RequestContext) -> HandlerResult<Box<dyn SerializableValue>> + Send + 'static,
) -> HandlerResult<Response> {
    // Dropped if the client disconnects before the first chunk.
    let guard = app.deadline().cancel_on_drop();
    let (begun, beginning) = oneshot::channel::<()>();
    let (sender, pieces) = mpsc::channel(4);
    let (app, handle) = (app.clone(), Handle::current());
    let written = tokio::spawn(async move {
        app.run_streaming(move |app, computing| {
            let value = work(app)?;
            drop(computing);
            // A disconnected client is noticed at the first chunk.
            let _ = begun.send(());
            let mut out =
                BufWriter::with_capacity(CHUNK_BYTES, ChunkSender { sender: sender.clone(), handle });
            let done = value.write_json(&mut out).map_err(io::Error::from).and_then(|()| out.flush());
            if let Err(e) = done {
                // The client sees a truncated body.
                let _ = sender.try_send(Err(e));
            }
            Ok(())
        })
        .await
    });
    let begins = beginning.await;
    guard.disarm();
    if begins.is_err() {
        let refused = written.await.unwrap_or_else(|_| Err(Problem::internal()));
        return Err(refused.err().unwrap_or_else(Problem::internal));
    }
    let kind = HeaderValue::from_static("application/json");
    let body = Body::from_stream(ReceiverStream::new(pieces));
    Ok((StatusCode::OK, [(header::CONTENT_TYPE, kind)], body).into_response())
}

/// Server-sent events, until the last one, until the client disconnects, or until its token is no longer valid.
pub fn events(app: &RequestContext, token: Option<Digest>, mut watcher: Box<dyn EventStream>) -> Response {
    let shared = app.shared().clone();
    let (sender, receiver) = mpsc::channel::<Result<sse::Event, Infallible>>(EVENT_BUFFER_LENGTH);
    let disconnected = sender.clone();
    let send_events = async move {
        while let Some(event) = next_event(&shared, watcher.as_mut()).await {
            let message = match event.id {
                Some(id) => sse::Event::default().id(id.to_string()),
                None => sse::Event::default(),
            };
            if sender.send(Ok(message.event(event.name).data(event.data))).await.is_err() {
                return;
            }
        }
    };
    let authorized = app.shared().clone();
    let principal = app.principal().clone();
    tokio::spawn(async move {
        tokio::select! {
            () = send_events => {}
            // A disconnected client is noticed at once, not at the next event.
            () = disconnected.closed() => {}
            () = authorization_end(&authorized, &principal, token) => {}
        }
    });
    Sse::new(ReceiverStream::new(receiver)).keep_alive(KeepAlive::default()).into_response()
}

/// The next event; at the end of the server only the final one, briefly.
async fn next_event(shared: &AppState, watcher: &mut dyn EventStream) -> Option<ServerEvent> {
    let mut stopping = shared.stopping.subscribe();
    tokio::select! {
        next = watcher.next() => return next,
        () = async { let _ = stopping.wait_for(|s| *s).await; } => {}
    }
    if !watcher.has_last_word() {
        return None;
    }
    // Jobs end when the server stops; their final event is awaited briefly.
    tokio::time::timeout(FINAL_EVENT_TIMEOUT, watcher.next()).await.unwrap_or(None)
}

/// Ready when the token has expired, was revoked or has another scope.
async fn authorization_end(shared: &AppState, principal: &Principal, token: Option<Digest>) {
    let mut period = tokio::time::interval(TOKEN_CHECK_PERIOD);
    while shared.keyring.authenticate(token.as_ref(), now()).as_ref() == Ok(principal) {
        period.tick().await;
    }
}

/// How often the token of an open stream is checked.
const TOKEN_CHECK_PERIOD: Duration = Duration::from_millis(250);
/// Events buffered for a slow client; it misses events that their source has discarded.
const EVENT_BUFFER_LENGTH: usize = 2;
/// Time to wait for the final event when the server stops.
const FINAL_EVENT_TIMEOUT: Duration = Duration::from_secs(2);

/// Sends written bytes as chunks; blocks until the client reads them or the timeout expires.
struct ChunkSender {
    sender: mpsc::Sender<io::Result<Vec<u8>>>,
    handle: Handle,
}

impl Write for ChunkSender {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        let sent =
            self.handle.block_on(tokio::time::timeout(CHUNK_TIMEOUT, self.sender.send(Ok(bytes.to_vec()))));
        match sent {
            Ok(Ok(())) => Ok(bytes.len()),
            _ => Err(io::ErrorKind::BrokenPipe.into()),
        }
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}
