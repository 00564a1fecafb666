//! One client: its concurrent requests, each answered once; requests that share a resource run in order.

use std::collections::HashMap;
use std::io;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

use serde_json::json;
use tokio::io::{AsyncRead, AsyncWrite};
use tokio::sync::{Semaphore, oneshot, watch};

use super::message::{self, NIL, ZmqRequest, ZmqResponse, serialize};
use super::zmtp::{self, MAX_FRAMES, MAX_MESSAGE_BYTES, Received, Receiver};
use crate::access::{Digest, Principal, Scope, now};
use crate::error::Error;
use crate::serve::client::Client;
use crate::serve::client_limiter::LimiterPermit;
use crate::serve::deadline::RequestDeadline;
use crate::serve::execution_class::{ExecutionClass, MAX_INLINE_BODY_BYTES};
use crate::serve::limits::Limits;
use crate::serve::log::{RequestLine, parse_traceparent, slug, valid_request_id};
use crate::serve::operation::Operation;
use crate::serve::operations::operation;
use crate::serve::problem::{HandlerResult, Problem};
use crate::serve::request_context::RequestContext;
use crate::serve::state::AppState;
use crate::sync::lock;
use crate::thread_priority::lower;

/// Maximum requests of one client in flight; more are answered with 429.
const MAX_IN_FLIGHT_REQUESTS: usize = 128;
/// Maximum message of an unauthenticated client, bytes: enough to answer it with 401.
const MAX_UNAUTHENTICATED_MESSAGE_BYTES: usize = 64 * 1024;
/// Time that a client has to read a response.
const WRITE_TIMEOUT: Duration = Duration::from_secs(60);

/// Serves a client until it disconnects or the server stops, then cancels its requests.
pub async fn serve(
    shared: Arc<AppState>,
    at: Client,
    token: Option<Digest>,
    mut receiver: Receiver<ReadHalf>,
    to: WriteHalf,
) {
    let mut stopping = shared.stopping.subscribe();
    let peer = Arc::new(Peer {
        shared,
        at,
        token,
        to: tokio::sync::Mutex::new(Some(to)),
        permits: Arc::new(Semaphore::new(MAX_IN_FLIGHT_REQUESTS)),
        in_flight: Mutex::default(),
        last: Mutex::default(),
    });
    let left = loop {
        // Large messages of unauthenticated clients are not buffered.
        receiver.set_max_bytes(if peer.who().is_ok() {
            MAX_MESSAGE_BYTES
        } else {
            MAX_UNAUTHENTICATED_MESSAGE_BYTES
        });
        receiver.set_permit(peer.byte_permit());
        let received = tokio::select! {
            received = peer.receive(&mut receiver) => received,
            _ = stopping.wait_for(|s| *s) => break false,
        };
        match received {
            Ok(Some(Received::Message(frames))) => peer.take(frames, receiver.take_permit()).await,
            Ok(Some(Received::TooLarge(frames))) => peer.refuse_large(frames).await,
            Ok(Some(Received::Ping(context))) => peer.pong(&context).await,
            Ok(None) => break true,
            Err(e) => {
                tracing::info!("a ZeroMQ connection was closed: {e}");
                break true;
            }
        }
    };
    if left {
        // Nobody receives the results.
        lock(&peer.in_flight).values().for_each(|flight| flight.deadline.cancel());
    }
    // Requests that were sent before the disconnect are completed.
    let _ = peer.permits.acquire_many(MAX_IN_FLIGHT_REQUESTS as u32).await;
}

/// Receiving half of a connection.
pub type ReadHalf = Box<dyn AsyncRead + Send + Unpin>;
/// Sending half of a connection.
pub type WriteHalf = Box<dyn AsyncWrite + Send + Unpin>;

struct Peer {
    shared: Arc<AppState>,
    /// Client at the peer address.
    at: Client,
    /// Digest of the token from the handshake.
    token: Option<Digest>,
    /// `None` after a write failed.
    to: tokio::sync::Mutex<Option<WriteHalf>>,
    permits: Arc<Semaphore>,
    /// By id.
    in_flight: Mutex<HashMap<Vec<u8>, InFlightRequest>>,
    /// The latest request of each resource; the next one waits for it.
    last: Mutex<HashMap<String, watch::Receiver<()>>>,
}

/// Size of a message, and its permit until it is answered.
struct ReceivedBytes {
    bytes: usize,
    byte_permit: Option<LimiterPermit>,
}

/// A request in flight.
struct InFlightRequest {
    cancel: Option<oneshot::Sender<()>>,
    /// Set when the request is cancelled.
    is_cancelled: Arc<AtomicBool>,
    /// Cancelled to stop a running simulation.
    deadline: Arc<RequestDeadline>,
}

impl Peer {
    /// Authenticates again for each request: a token may expire during a connection.
    fn who(&self) -> HandlerResult<Principal> {
        self.shared.keyring.authenticate(self.token.as_ref(), now()).map_err(Problem::unauthorized)
    }

    /// Reply address of a message received now.
    fn address(&self, id: Vec<u8>, delimited: bool) -> ReplyAddress {
        let (request_id, since) = (self.shared.request_id(), Instant::now());
        ReplyAddress { id, request_id, traceparent: None, delimited, since }
    }

    /// The next message, within HTTP's time limits of bodies and of silence; `None` at the end of the connection.
    async fn receive(&self, receiver: &mut Receiver<ReadHalf>) -> io::Result<Option<Received>> {
        let limits = self.shared.limits();
        let (idle, message) = (Limits::duration(limits.idle_seconds), Limits::duration(limits.body_seconds));
        loop {
            match tokio::time::timeout(idle, receiver.wait()).await {
                Ok(Ok(true)) => break,
                Ok(Ok(false)) => return Ok(None),
                Ok(Err(e)) => return Err(e),
                // A client that waits for an answer is not idle.
                Err(_) if self.permits.available_permits() < MAX_IN_FLIGHT_REQUESTS => {}
                Err(_) => return Ok(None),
            }
        }
        tokio::time::timeout(message, receiver.receive()).await.map_err(io::Error::from)?
    }

    /// The client of a request that arrives now.
    fn client(&self) -> Client {
        self.who().map_or_else(|_| self.at.clone(), |who| Client::identify(&who, &self.at))
    }

    fn byte_permit(&self) -> LimiterPermit {
        self.shared.body_bytes.empty_permit(&self.client())
    }

    /// Runs the parsing of a message: of a large one on a blocking thread, with a permit.
    async fn parse<T: Send + 'static>(
        &self,
        bytes: usize,
        work: impl FnOnce() -> T + Send + 'static,
    ) -> Option<T> {
        let work = || catch_unwind(AssertUnwindSafe(work)).ok();
        if bytes <= MAX_INLINE_BODY_BYTES {
            return work();
        }
        let _permit = self.shared.scheduler.compute.acquire(&self.client()).await;
        let work = || {
            lower();
            work()
        };
        tokio::task::spawn_blocking(work).await.ok().flatten()
    }

    /// Handles a message: answers it at once, or starts a task that does. The permit for its bytes is dropped with the answer.
    async fn take(self: &Arc<Self>, mut frames: Vec<Vec<u8>>, byte_permit: Option<LimiterPermit>) {
        let delimited = frames.len() > 1 && frames[0].is_empty();
        if delimited {
            frames.remove(0);
        }
        let bytes = frames.iter().map(Vec::len).sum();
        let unread =
            || (NIL.to_vec(), Err(Error::Failed("a bug in the program: a message was not parsed".into())));
        let (id, mut request) = self.parse(bytes, || message::read(frames)).await.unwrap_or_else(unread);
        let mut to = self.address(id, delimited);
        if let Ok(request) = &mut request {
            to.set_request_id(request);
        }
        match request {
            Err(e) => self.answer(&to, "none", Err(Problem::malformed(e))).await,
            Ok(request) => match request.op.as_str() {
                "ping" => self.answer(&to, "ping", ZmqResponse::plain(&json!({"pong": true}))).await,
                "cancel" => {
                    let cancelled = self.cancel(&request);
                    self.answer(&to, "cancel", cancelled).await;
                }
                name => match operation(name) {
                    Err(problem) => self.answer(&to, "none", Err(problem)).await,
                    Ok(operation) => {
                        self.start(operation, request, ReceivedBytes { bytes, byte_permit }, to).await
                    }
                },
            },
        }
    }

    /// The request context.
    fn app(&self, operation: &Operation, request: &ZmqRequest) -> HandlerResult<RequestContext> {
        let who = match self.who() {
            Ok(who) => who,
            Err(_) if operation.required_scope.is_none() => Principal { name: None, scope: Scope::Read },
            Err(problem) => return Err(problem),
        };
        let span = self.shared.request_timeout("deadline", request.deadline.as_deref())?;
        Ok(RequestContext::new(&self.shared, who, &self.at, span))
    }

    async fn start(
        self: &Arc<Self>,
        operation: &'static Operation,
        request: ZmqRequest,
        received: ReceivedBytes,
        to: ReplyAddress,
    ) {
        let app = match self.app(operation, &request) {
            Ok(app) => Arc::new(app),
            Err(problem) => return self.answer(&to, operation.name, Err(problem)).await,
        };
        let Ok(permit) = self.permits.clone().try_acquire_owned() else {
            return self.answer(&to, operation.name, Err(Problem::busy(MAX_IN_FLIGHT_REQUESTS))).await;
        };
        let alone = self.permits.available_permits() == MAX_IN_FLIGHT_REQUESTS - 1;
        let (raw, names) = (request.operation_request.raw, request.operation_request.resource_ids());
        let context = app.clone();
        let prepare = move || operation.authorize(&context)?.prepare(&context, request.operation_request);
        let ready = self.parse(received.bytes, prepare).await;
        let call = match ready.unwrap_or_else(|| Err(Problem::internal())) {
            Ok(call) => call,
            Err(problem) => return self.answer(&to, operation.name, Err(problem)).await,
        };
        let weight = call.class;
        let work = move |app: &RequestContext| serialize((call.work)(app)?, raw);
        if alone && weight == ExecutionClass::Inline {
            let guarded = |app: &RequestContext| {
                catch_unwind(AssertUnwindSafe(|| work(app))).unwrap_or_else(|_| Err(Problem::internal()))
            };
            let answer = app.run_inline(guarded).await;
            return self.answer(&to, operation.name, answer).await;
        }
        let Some((cancelled, is_cancelled)) = self.register(&to.id, app.deadline()) else {
            return self.answer(&to, operation.name, Err(repeated_id())).await;
        };
        let (before, turn) = self.queue(names);
        let peer = self.clone();
        tokio::spawn(async move {
            let _byte_permit = received.byte_permit;
            let work = async {
                for mut earlier in before {
                    // An error means that the sender was dropped: the earlier request has ended.
                    while earlier.changed().await.is_ok() {}
                }
                let alive = move |app: &RequestContext| {
                    // Held until the work ends, even after cancellation: the next request of the resource waits for it.
                    let _turn = turn;
                    if is_cancelled.load(Ordering::SeqCst) {
                        return Err(Problem::cancelled());
                    }
                    work(app)
                };
                app.run(weight, alive).await
            };
            let answer = tokio::select! {
                biased;
                Ok(()) = cancelled => Err(Problem::cancelled()),
                answer = work => answer,
            };
            lock(&peer.in_flight).remove(&to.id);
            peer.answer(&to, operation.name, answer).await;
            drop(permit);
        });
    }

    /// Registers a request in flight: the signal and the flag of its cancellation; `None` if the id is in use.
    fn register(
        &self,
        id: &[u8],
        deadline: &Arc<RequestDeadline>,
    ) -> Option<(oneshot::Receiver<()>, Arc<AtomicBool>)> {
        let mut in_flight = lock(&self.in_flight);
        if in_flight.contains_key(id) {
            return None;
        }
        let ((cancel, cancelled), is_cancelled) = (oneshot::channel(), Arc::new(AtomicBool::new(false)));
        let (flag, deadline) = (is_cancelled.clone(), deadline.clone());
        in_flight.insert(id.to_vec(), InFlightRequest { cancel: Some(cancel), is_cancelled: flag, deadline });
        Some((cancelled, is_cancelled))
    }

    /// Queues a request behind those of the same resources: receivers to wait for, and the sender to drop when it ends.
    fn queue(&self, names: Vec<String>) -> (Vec<watch::Receiver<()>>, watch::Sender<()>) {
        let (turn, over) = watch::channel(());
        let mut last = lock(&self.last);
        if last.len() > 16_384 {
            last.retain(|_, earlier| earlier.has_changed().is_ok());
        }
        let before = names
            .into_iter()
            .filter_map(|name| last.insert(name, over.clone()))
            // A request that names a resource twice does not wait for itself.
            .filter(|earlier| earlier.has_changed().is_ok() && !earlier.same_channel(&over))
            .collect();
        (before, turn)
    }

    fn cancel(&self, request: &ZmqRequest) -> HandlerResult<ZmqResponse> {
        let id = request.cancel_target.as_ref().filter(|id| **id != NIL).ok_or_else(|| {
            let e = Error::input("args.request", "missing", "the id of a request in progress");
            Problem::malformed(e)
        })?;
        let cancelled = lock(&self.in_flight).get_mut(id).and_then(|flight| {
            flight.is_cancelled.store(true, Ordering::SeqCst);
            flight.cancel.take()?.send(()).ok()
        });
        ZmqResponse::plain(&json!({"cancelled": cancelled.is_some()}))
    }

    async fn refuse_large(&self, mut frames: Vec<Vec<u8>>) {
        let authenticated = self.who();
        let delimited = frames.first().is_some_and(Vec::is_empty);
        if delimited {
            frames.remove(0);
        }
        frames.truncate(1);
        let id = frames.pop().map_or(NIL.to_vec(), |head| message::read(vec![head]).0);
        let detail = format!(
            "a message may have at most {MAX_MESSAGE_BYTES} bytes in at most {MAX_FRAMES} frames; split it"
        );
        let refused = authenticated.err().unwrap_or_else(|| Problem::too_large(detail));
        self.answer(&self.address(id, delimited), "none", Err(refused)).await;
    }

    async fn pong(&self, context: &[u8]) {
        if let Some(to) = self.to.lock().await.as_mut() {
            let _ = tokio::time::timeout(WRITE_TIMEOUT, zmtp::pong(to, context)).await;
        }
    }

    /// Logs a request and updates the metrics.
    fn note(&self, to: &ReplyAddress, name: &'static str, status: u16, refused: Option<&Problem>) {
        let seconds = to.since.elapsed().as_secs_f64();
        let who = self.who().ok();
        self.shared.log.request(&RequestLine {
            request: &to.request_id,
            transport: "zmq",
            operation: name,
            who: who.as_ref().and_then(Principal::owner),
            status,
            problem: refused.map(|p| slug(&p.kind)),
            seconds,
            trace: to.traceparent.as_deref().and_then(parse_traceparent),
        });
        self.shared.core.metrics.observe_duration("zmq", name, status, seconds);
    }

    async fn answer(&self, to: &ReplyAddress, name: &'static str, answer: HandlerResult<ZmqResponse>) {
        let status = answer.as_ref().map_or_else(|problem| problem.status, |_| 200);
        self.shared.core.metrics.count_response("ZMQ", name, status);
        self.note(to, name, status, answer.as_ref().err());
        let mut frames = match answer {
            Ok(response) => response.frames(&to.id, &to.request_id),
            Err(problem) => message::error_frames(&to.id, &to.request_id, &problem),
        };
        if to.delimited {
            frames.insert(0, Vec::new());
        }
        let mut writing = self.to.lock().await;
        if let Some(open) = writing.as_mut() {
            let sent = tokio::time::timeout(WRITE_TIMEOUT, zmtp::send(open, &frames)).await;
            if !matches!(sent, Ok(Ok(()))) {
                // Part of a message may have been sent: the connection cannot be used any more.
                *writing = None;
            }
        }
    }
}

/// Where a response goes.
struct ReplyAddress {
    /// As msgpack.
    id: Vec<u8>,
    /// From the client or generated.
    request_id: String,
    /// W3C trace context.
    traceparent: Option<String>,
    /// Time of receipt.
    since: Instant,
    /// Whether the client is a REQ socket, which sends an empty delimiter frame first.
    delimited: bool,
}

impl ReplyAddress {
    /// Takes over the client's request id, if valid, and its trace context.
    fn set_request_id(&mut self, request: &mut ZmqRequest) {
        if let Some(request_id) = request.request_id.take().filter(|id| valid_request_id(id).is_some()) {
            self.request_id = request_id;
        }
        self.traceparent = request.traceparent.take();
    }
}

/// The problem of a request whose id is that of a request in progress.
fn repeated_id() -> Problem {
    let allowed = "an id that is not in use";
    Problem::malformed(Error::input("id", "the id of a request in progress", allowed))
}
