//! A connection's times: how long a head may take to come, how long there may be silence between requests, how long a client
//! may take nothing of its answer. What it is too late for is an error, which ends the connection.

use std::io;
use std::pin::Pin;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::task::{Context, Poll, Waker};
use std::time::{Duration, Instant};

use axum::body::{Body, Bytes};
use hyper::body::{Body as HttpBody, Frame, SizeHint};
use tokio::io::{AsyncRead, AsyncWrite, ReadBuf};
use tokio::sync::Notify;
use tokio::time::{Sleep, sleep_until};

use crate::serve::limits::Limits;

/// What is known of a connection, to it and to who counts connections.
pub struct Watch {
    header: Duration,
    idle: Duration,
    write: Duration,
    now: Mutex<Now>,
    evicted: Notify,
}

struct Now {
    /// Whether a request is being answered.
    busy: bool,
    /// Whether some of a head has come, or is overdue since the connection was made.
    begun: bool,
    /// Since when a head has been coming, or the connection has been idle.
    since: Instant,
    /// Whoever waits for more while a request is being answered: its patience begins when that is over.
    reader: Option<Waker>,
}

/// A request being answered; it ends when this is dropped.
pub struct Busy(Arc<Watch>);

impl Watch {
    /// Of a connection that is made now.
    pub fn new(limits: &Limits) -> Arc<Watch> {
        Arc::new(Watch {
            header: Limits::span(limits.header_seconds),
            idle: Limits::span(limits.idle_seconds),
            write: Limits::span(limits.write_seconds),
            now: Mutex::new(Now { busy: false, begun: true, since: Instant::now(), reader: None }),
            evicted: Notify::new(),
        })
    }

    /// A request has come whole.
    pub fn begin(self: &Arc<Watch>) -> Busy {
        self.now().busy = true;
        Busy(self.clone())
    }

    /// Since when it has waited for a request; none while one is being answered.
    pub fn waits_since(&self) -> Option<Instant> {
        let now = self.now();
        (!now.busy).then_some(now.since)
    }

    /// It is to end.
    pub fn evict(&self) {
        self.evicted.notify_one();
    }

    /// Ready once it is to end.
    pub async fn evicted(&self) {
        self.evicted.notified().await;
    }

    /// Bytes have come.
    fn heard(&self) {
        let mut now = self.now();
        if !now.busy && !now.begun {
            (now.begun, now.since) = (true, Instant::now());
        }
    }

    /// When waiting for more is over; not while a request is being answered, after which `reader` is woken.
    fn patience(&self, reader: &Waker) -> Option<Instant> {
        let mut now = self.now();
        if now.busy {
            now.reader = Some(reader.clone());
            return None;
        }
        Some(now.since + if now.begun { self.header } else { self.idle })
    }

    fn now(&self) -> MutexGuard<'_, Now> {
        self.now.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Drop for Busy {
    fn drop(&mut self) {
        let idle = Now { busy: false, begun: false, since: Instant::now(), reader: None };
        let before = std::mem::replace(&mut *self.0.now(), idle);
        if let Some(reader) = before.reader {
            reader.wake();
        }
    }
}

/// A stream that is not waited for without end.
pub struct Timed<S> {
    inner: S,
    watch: Arc<Watch>,
    reading: Pin<Box<Sleep>>,
    writing: Option<Pin<Box<Sleep>>>,
}

impl<S> Timed<S> {
    pub fn new(inner: S, watch: Arc<Watch>) -> Timed<S> {
        let reading = Box::pin(sleep_until((Instant::now() + watch.header).into()));
        Timed { inner, watch, reading, writing: None }
    }
}

impl<S: AsyncRead + Unpin> AsyncRead for Timed<S> {
    fn poll_read(mut self: Pin<&mut Self>, cx: &mut Context, buf: &mut ReadBuf) -> Poll<io::Result<()>> {
        let before = buf.filled().len();
        if let Poll::Ready(read) = Pin::new(&mut self.inner).poll_read(cx, buf) {
            if buf.filled().len() > before {
                self.watch.heard();
            }
            return Poll::Ready(read);
        }
        let Some(until) = self.watch.patience(cx.waker()) else { return Poll::Pending };
        if self.reading.deadline() != until.into() {
            self.reading.as_mut().reset(until.into());
        }
        self.reading.as_mut().poll(cx).map(|()| Err(io::ErrorKind::TimedOut.into()))
    }
}

impl<S: AsyncWrite + Unpin> Timed<S> {
    /// What writing gave; if it has to wait, not for ever.
    fn wrote<T>(&mut self, cx: &mut Context, given: Poll<io::Result<T>>) -> Poll<io::Result<T>> {
        if given.is_ready() {
            self.writing = None;
            return given;
        }
        let until = Instant::now() + self.watch.write;
        let writing = self.writing.get_or_insert_with(|| Box::pin(sleep_until(until.into())));
        writing.as_mut().poll(cx).map(|()| Err(io::ErrorKind::TimedOut.into()))
    }
}

impl<S: AsyncWrite + Unpin> AsyncWrite for Timed<S> {
    fn poll_write(mut self: Pin<&mut Self>, cx: &mut Context, bytes: &[u8]) -> Poll<io::Result<usize>> {
        let given = Pin::new(&mut self.inner).poll_write(cx, bytes);
        self.wrote(cx, given)
    }

    fn poll_write_vectored(
        mut self: Pin<&mut Self>,
        cx: &mut Context,
        parts: &[io::IoSlice],
    ) -> Poll<io::Result<usize>> {
        let given = Pin::new(&mut self.inner).poll_write_vectored(cx, parts);
        self.wrote(cx, given)
    }

    fn is_write_vectored(&self) -> bool {
        self.inner.is_write_vectored()
    }

    fn poll_flush(mut self: Pin<&mut Self>, cx: &mut Context) -> Poll<io::Result<()>> {
        let given = Pin::new(&mut self.inner).poll_flush(cx);
        self.wrote(cx, given)
    }

    fn poll_shutdown(mut self: Pin<&mut Self>, cx: &mut Context) -> Poll<io::Result<()>> {
        let given = Pin::new(&mut self.inner).poll_shutdown(cx);
        self.wrote(cx, given)
    }
}

/// A body whose request is being answered until it has gone out.
pub struct Held {
    pub body: Body,
    pub _busy: Busy,
}

impl HttpBody for Held {
    type Data = Bytes;
    type Error = axum::Error;

    fn poll_frame(
        mut self: Pin<&mut Self>,
        cx: &mut Context,
    ) -> Poll<Option<Result<Frame<Bytes>, axum::Error>>> {
        Pin::new(&mut self.body).poll_frame(cx)
    }

    fn is_end_stream(&self) -> bool {
        self.body.is_end_stream()
    }

    fn size_hint(&self) -> SizeHint {
        self.body.size_hint()
    }
}
