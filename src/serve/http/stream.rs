//! Large answers, sent piece by piece while they are written: never in memory as a whole.

use std::io::{self, BufWriter, Write};
use std::time::Duration;

use axum::body::Body;
use axum::http::{HeaderValue, StatusCode, header};
use axum::response::{IntoResponse, Response};
use serde::Serialize;
use tokio::runtime::Handle;
use tokio::sync::{mpsc, oneshot};
use tokio_stream::wrappers::ReceiverStream;

use super::extract::Caller;
use crate::error::Result;
use crate::serve::app::App;
use crate::serve::problem::{Answer, Problem};

/// Size of a piece, bytes.
const PIECE: usize = 64 * 1024;
/// How long a client may take to read a piece.
const PATIENCE: Duration = Duration::from_secs(60);

/// Does `work` off the async threads; its answer goes out as JSON from there.
pub async fn answer_streamed<T: Serialize>(
    caller: &Caller,
    work: impl FnOnce(&App) -> Result<T> + Send + 'static,
) -> Answer<Response> {
    let (begun, beginning) = oneshot::channel::<Answer<()>>();
    let (sender, pieces) = mpsc::channel(4);
    let (app, handle) = (caller.app.clone(), Handle::current());
    let written = tokio::spawn(async move {
        app.run_streamed(move |app| {
            let value = match work(app) {
                Ok(value) => value,
                Err(e) => return Err(e.into()),
            };
            // A client that has hung up is noticed at the first piece.
            let _ = begun.send(Ok(()));
            let mut out = BufWriter::with_capacity(PIECE, Pieces { sender: sender.clone(), handle });
            let done =
                serde_json::to_writer(&mut out, &value).map_err(io::Error::from).and_then(|()| out.flush());
            if let Err(e) = done {
                // The client sees a body that ends before its end.
                let _ = sender.try_send(Err(e));
            }
            Ok(())
        })
        .await
    });
    if beginning.await.is_err() {
        let refused = written.await.unwrap_or_else(|_| Err(Problem::defect()));
        return Err(refused.err().unwrap_or_else(Problem::defect));
    }
    let kind = HeaderValue::from_static("application/json");
    let body = Body::from_stream(ReceiverStream::new(pieces));
    Ok((StatusCode::OK, [(header::CONTENT_TYPE, kind)], body).into_response())
}

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
