//! Timeouts of a connection: to receive a request's head, idle between requests, and to send a response. An expired timeout is an
//! I/O error, which ends the connection.

use std::io;
use std::pin::Pin;
use std::sync::{Arc, Mutex, MutexGuard};
use std::task::{Context, Poll, Waker};
use std::time::{Duration, Instant};

use axum::body::{Body, Bytes};
use hyper::body::{Body as HttpBody, Frame, SizeHint};
use tokio::io::{AsyncRead, AsyncWrite, ReadBuf};
use tokio::sync::Notify;
use tokio::time::{Sleep, sleep_until};

use crate::serve::limits::Limits;
use crate::sync::lock;

/// Timers of a connection, shared with the registry.
pub struct ConnectionTimer {
    header: Duration,
    idle: Duration,
    write: Duration,
    now: Mutex<TimerState>,
    evicted: Notify,
}

struct TimerState {
    /// Whether a request is being answered.
    busy: bool,
    /// Whether part of a head has arrived; also true for a new connection, whose first head is due.
    receiving_head: bool,
    /// Start of the head or of the idle time.
    since: Instant,
    /// Reader to wake when the request has been answered and its timeout starts.
    reader: Option<Waker>,
}

/// Marks a request as being answered, until dropped.
pub struct RequestGuard(Arc<ConnectionTimer>);

impl ConnectionTimer {
    /// For a new connection.
    pub fn new(limits: &Limits) -> Arc<ConnectionTimer> {
        Arc::new(ConnectionTimer {
            header: Limits::duration(limits.header_seconds),
            idle: Limits::duration(limits.idle_seconds),
            write: Limits::duration(limits.write_seconds),
            now: Mutex::new(TimerState {
                busy: false,
                receiving_head: true,
                since: Instant::now(),
                reader: None,
            }),
            evicted: Notify::new(),
        })
    }

    /// A request has been received completely.
    pub fn start_request(self: &Arc<ConnectionTimer>) -> RequestGuard {
        self.now().busy = true;
        RequestGuard(self.clone())
    }

    /// Start of the idle time; `None` while a request is being answered.
    pub fn idle_since(&self) -> Option<Instant> {
        let now = self.now();
        (!now.busy).then_some(now.since)
    }

    /// Asks the connection to end.
    pub fn evict(&self) {
        self.evicted.notify_one();
    }

    /// Ready when the connection is to end.
    pub async fn evicted(&self) {
        self.evicted.notified().await;
    }

    /// Bytes have arrived.
    fn bytes_received(&self) {
        let mut now = self.now();
        if !now.busy && !now.receiving_head {
            (now.receiving_head, now.since) = (true, Instant::now());
        }
    }

    /// Deadline of the current read; `None` while a request is being answered, after which `reader` is woken.
    fn read_deadline(&self, reader: &Waker) -> Option<Instant> {
        let mut now = self.now();
        if now.busy {
            now.reader = Some(reader.clone());
            return None;
        }
        Some(now.since + if now.receiving_head { self.header } else { self.idle })
    }

    fn now(&self) -> MutexGuard<'_, TimerState> {
        lock(&self.now)
    }
}

impl Drop for RequestGuard {
    fn drop(&mut self) {
        let idle = TimerState { busy: false, receiving_head: false, since: Instant::now(), reader: None };
        let before = std::mem::replace(&mut *self.0.now(), idle);
        if let Some(reader) = before.reader {
            reader.wake();
        }
    }
}

/// A stream with read and write timeouts.
pub struct TimeoutStream<S> {
    inner: S,
    timer: Arc<ConnectionTimer>,
    reading: Pin<Box<Sleep>>,
    writing: Option<Pin<Box<Sleep>>>,
}

impl<S> TimeoutStream<S> {
    pub fn new(inner: S, timer: Arc<ConnectionTimer>) -> TimeoutStream<S> {
        let reading = Box::pin(sleep_until((Instant::now() + timer.header).into()));
        TimeoutStream { inner, timer, reading, writing: None }
    }
}

impl<S: AsyncRead + Unpin> AsyncRead for TimeoutStream<S> {
    fn poll_read(mut self: Pin<&mut Self>, cx: &mut Context, buf: &mut ReadBuf) -> Poll<io::Result<()>> {
        let before = buf.filled().len();
        if let Poll::Ready(read) = Pin::new(&mut self.inner).poll_read(cx, buf) {
            if buf.filled().len() > before {
                self.timer.bytes_received();
            }
            return Poll::Ready(read);
        }
        let Some(until) = self.timer.read_deadline(cx.waker()) else { return Poll::Pending };
        if self.reading.deadline() != until.into() {
            self.reading.as_mut().reset(until.into());
        }
        self.reading.as_mut().poll(cx).map(|()| Err(io::ErrorKind::TimedOut.into()))
    }
}

impl<S: AsyncWrite + Unpin> TimeoutStream<S> {
    /// The result of a write, or an error if it has been pending too long.
    fn with_write_timeout<T>(
        &mut self,
        cx: &mut Context,
        result: Poll<io::Result<T>>,
    ) -> Poll<io::Result<T>> {
        if result.is_ready() {
            self.writing = None;
            return result;
        }
        let until = Instant::now() + self.timer.write;
        let writing = self.writing.get_or_insert_with(|| Box::pin(sleep_until(until.into())));
        writing.as_mut().poll(cx).map(|()| Err(io::ErrorKind::TimedOut.into()))
    }
}

impl<S: AsyncWrite + Unpin> AsyncWrite for TimeoutStream<S> {
    fn poll_write(mut self: Pin<&mut Self>, cx: &mut Context, bytes: &[u8]) -> Poll<io::Result<usize>> {
        let result = Pin::new(&mut self.inner).poll_write(cx, bytes);
        self.with_write_timeout(cx, result)
    }

    fn poll_write_vectored(
        mut self: Pin<&mut Self>,
        cx: &mut Context,
        parts: &[io::IoSlice],
    ) -> Poll<io::Result<usize>> {
        let result = Pin::new(&mut self.inner).poll_write_vectored(cx, parts);
        self.with_write_timeout(cx, result)
    }

    fn is_write_vectored(&self) -> bool {
        self.inner.is_write_vectored()
    }

    fn poll_flush(mut self: Pin<&mut Self>, cx: &mut Context) -> Poll<io::Result<()>> {
        let result = Pin::new(&mut self.inner).poll_flush(cx);
        self.with_write_timeout(cx, result)
    }

    fn poll_shutdown(mut self: Pin<&mut Self>, cx: &mut Context) -> Poll<io::Result<()>> {
        let result = Pin::new(&mut self.inner).poll_shutdown(cx);
        self.with_write_timeout(cx, result)
    }
}

/// A response body that marks its request as being answered until it is sent.
pub struct GuardedBody {
    pub body: Body,
    pub _guard: RequestGuard,
}

impl HttpBody for GuardedBody {
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
