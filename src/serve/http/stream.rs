//! Answers that go out while they are made: large ones piece by piece, never in memory as a whole, and events.

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

use crate::serve::app::App;
use crate::serve::operation::{Events, Whole};
use crate::serve::problem::{Answer, Problem};
use crate::serve::shared::Shared;

/// Size of a piece, bytes.
const PIECE: usize = 64 * 1024;
/// How long a client may take to read a piece.
const PATIENCE: Duration = Duration::from_secs(60);

/// Does `work` off the async threads; its answer goes out as JSON from there.
pub async fn answered(
    app: &Arc<App>,
    work: impl FnOnce(&App) -> Answer<Box<dyn Whole>> + Send + 'static,
) -> Answer<Response> {
    // A client that hangs up before the first piece drops this.
    let waiting = app.leave().waiting();
    let (begun, beginning) = oneshot::channel::<()>();
    let (sender, pieces) = mpsc::channel(4);
    let (app, handle) = (app.clone(), Handle::current());
    let written = tokio::spawn(async move {
        app.run_streamed(move |app, computing| {
            let value = work(app)?;
            drop(computing);
            // A client that has hung up is noticed at the first piece.
            let _ = begun.send(());
            let mut out = BufWriter::with_capacity(PIECE, Pieces { sender: sender.clone(), handle });
            let done = value.write(&mut out).map_err(io::Error::from).and_then(|()| out.flush());
            if let Err(e) = done {
                // The client sees a body that ends before its end.
                let _ = sender.try_send(Err(e));
            }
            Ok(())
        })
        .await
    });
    let begins = beginning.await;
    waiting.answered();
    if begins.is_err() {
        let refused = written.await.unwrap_or_else(|_| Err(Problem::defect()));
        return Err(refused.err().unwrap_or_else(Problem::defect));
    }
    let kind = HeaderValue::from_static("application/json");
    let body = Body::from_stream(ReceiverStream::new(pieces));
    Ok((StatusCode::OK, [(header::CONTENT_TYPE, kind)], body).into_response())
}

/// Server-sent events, until the last or until the client hangs up.
pub fn events(shared: &Shared, mut watcher: Box<dyn Events>) -> Response {
    let (sender, receiver) = mpsc::channel::<Result<sse::Event, Infallible>>(AHEAD);
    let mut stopping = shared.stopping.subscribe();
    tokio::spawn(async move {
        loop {
            let next = tokio::select! {
                next = watcher.next() => next,
                // A client that hung up must not be waited for until the next event.
                () = sender.closed() => return,
                () = async { let _ = stopping.wait_for(|s| *s).await; } => {
                    if !watcher.has_last_word() {
                        return;
                    }
                    // The runner ends its jobs when the server stops; its last word is worth a moment.
                    tokio::time::timeout(LAST_WORD, watcher.next()).await.unwrap_or(None)
                }
            };
            let Some(told) = next else { return };
            let message = match told.id {
                Some(id) => sse::Event::default().id(id.to_string()),
                None => sse::Event::default(),
            };
            if sender.send(Ok(message.event(told.name).data(told.data))).await.is_err() {
                return;
            }
        }
    });
    Sse::new(ReceiverStream::new(receiver)).keep_alive(KeepAlive::default()).into_response()
}

/// Events written ahead of a client that reads slowly; it misses what its source no longer keeps.
const AHEAD: usize = 2;
/// How long an event is waited for once the server is told to stop.
const LAST_WORD: Duration = Duration::from_secs(2);

/// Hands on what is written; waits for the client to take it, but not for ever.
struct Pieces {
    sender: mpsc::Sender<io::Result<Vec<u8>>>,
    handle: Handle,
}

impl Write for Pieces {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        let sent = self.handle.block_on(tokio::time::timeout(PATIENCE, self.sender.send(Ok(bytes.to_vec()))));
        match sent {
            Ok(Ok(())) => Ok(bytes.len()),
            _ => Err(io::ErrorKind::BrokenPipe.into()),
        }
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}
