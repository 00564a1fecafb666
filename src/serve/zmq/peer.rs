//! One client: its requests as they come, each answered once, those that share a world in their order.

use std::collections::HashMap;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use serde_json::json;
use tokio::io::{AsyncRead, AsyncWrite};
use tokio::sync::{Semaphore, oneshot, watch};

use super::message::{self, NIL, Request, Written, written};
use super::zmtp::{self, MOST_BYTES, MOST_FRAMES, Received, Receiver};
use crate::access::{Digest, Scope, Who, now};
use crate::serve::app::App;
use crate::serve::client::Client;
use crate::serve::leave::Leave;
use crate::serve::log::{RequestLine, given_id, slug, trace};
use crate::serve::operation::Operation;
use crate::serve::operations::operation;
use crate::serve::problem::{Answer, Problem};
use crate::serve::shared::Shared;
use crate::serve::weight::Weight;

/// Requests of one client under way at a time; more are told to come back.
const MOST_UNDER_WAY: usize = 128;
/// Largest message of a client that is not known, bytes: enough to tell it so.
const MOST_UNKNOWN: usize = 64 * 1024;
/// How long a client may take to read an answer.
const PATIENCE: Duration = Duration::from_secs(60);

/// Answers a client until it hangs up or the server stops, and ends what is under way.
pub async fn serve(
    shared: Arc<Shared>,
    at: Client,
    token: Option<Digest>,
    mut receiver: Receiver<Reading>,
    to: Writing,
) {
    let mut stopping = shared.stopping.subscribe();
    let peer = Arc::new(Peer {
        shared,
        at,
        token,
        to: tokio::sync::Mutex::new(Some(to)),
        places: Arc::new(Semaphore::new(MOST_UNDER_WAY)),
        under_way: Mutex::default(),
        last: Mutex::default(),
    });
    let left = loop {
        // Nothing large is kept for somebody who is not known.
        receiver.at_most(if peer.who().is_ok() { MOST_BYTES } else { MOST_UNKNOWN });
        let received = tokio::select! {
            received = receiver.receive() => received,
            _ = stopping.wait_for(|s| *s) => break false,
        };
        match received {
            Ok(Some(Received::Message(frames))) => peer.take(frames).await,
            Ok(Some(Received::TooLarge(frames))) => peer.refuse_large(frames).await,
            Ok(Some(Received::Ping(context))) => peer.pong(&context).await,
            Ok(None) => break true,
            Err(e) => {
                tracing::info!("a ZeroMQ client was hung up on: {e}");
                break true;
            }
        }
    };
    if left {
        // Nobody sees what would be simulated.
        lock(&peer.under_way).values().for_each(|flight| flight.leave.end());
    }
    // A client that sent its last wish and hung up has it carried out.
    let _ = peer.places.acquire_many(MOST_UNDER_WAY as u32).await;
}

/// The halves of a connection.
pub type Reading = Box<dyn AsyncRead + Send + Unpin>;
/// See [`Reading`].
pub type Writing = Box<dyn AsyncWrite + Send + Unpin>;

struct Peer {
    shared: Arc<Shared>,
    /// Where the client is.
    at: Client,
    /// What the client showed when it connected.
    token: Option<Digest>,
    /// `None` once the client did not read.
    to: tokio::sync::Mutex<Option<Writing>>,
    places: Arc<Semaphore>,
    /// By id.
    under_way: Mutex<HashMap<Vec<u8>, Flight>>,
    /// The latest request of each name, which the next of that name waits for.
    last: Mutex<HashMap<String, watch::Receiver<()>>>,
}

/// A request under way.
struct Flight {
    cancel: Option<oneshot::Sender<()>>,
    /// Set once nobody waits for it.
    dropped: Arc<AtomicBool>,
    /// Ended, so that a simulation stops in the middle.
    leave: Arc<Leave>,
}

impl Peer {
    /// Who asks, now: a token may end while its bearer is connected.
    fn who(&self) -> Answer<Who> {
        self.shared.keyring.who(self.token.as_ref(), now()).map_err(Problem::unauthorized)
    }

    /// Where the answer to a message that came now goes.
    fn address(&self, id: Vec<u8>, delimited: bool) -> Address {
        let (request_id, since) = (self.shared.request_id(), Instant::now());
        Address { id, request_id, traceparent: None, delimited, since }
    }

    /// Takes a message: answers it at once, or sees to it that it is answered.
    async fn take(self: &Arc<Self>, mut frames: Vec<Vec<u8>>) {
        let delimited = frames.len() > 1 && frames[0].is_empty();
        if delimited {
            frames.remove(0);
        }
        let (id, mut request) = message::read(frames);
        let mut to = self.address(id, delimited);
        if let Ok(request) = &mut request {
            to.is_called(request);
        }
        match request {
            Err(e) => self.answer(&to, "none", Err(Problem::malformed(e))).await,
            Ok(request) => match request.op.as_str() {
                "ping" => self.answer(&to, "ping", Written::plain(&json!({"pong": true}))).await,
                "cancel" => {
                    let cancelled = self.cancel(&request);
                    self.answer(&to, "cancel", cancelled).await;
                }
                name => match operation(name) {
                    Err(problem) => self.answer(&to, "none", Err(problem)).await,
                    Ok(operation) => self.start(operation, request, to).await,
                },
            },
        }
    }

    /// The server as this client sees it, for one request.
    fn app(&self, operation: &Operation, request: &Request) -> Answer<App> {
        let who = match self.who() {
            Ok(who) => who,
            Err(_) if operation.needs.is_none() => Who { name: None, scope: Scope::Read },
            Err(problem) => return Err(problem),
        };
        let span = self.shared.span("deadline", request.deadline.as_deref())?;
        Ok(App::new(&self.shared, who, &self.at, span))
    }

    async fn start(self: &Arc<Self>, operation: &'static Operation, request: Request, to: Address) {
        let app = match self.app(operation, &request) {
            Ok(app) => Arc::new(app),
            Err(problem) => return self.answer(&to, operation.name, Err(problem)).await,
        };
        let Ok(place) = self.places.clone().try_acquire_owned() else {
            return self.answer(&to, operation.name, Err(Problem::busy(MOST_UNDER_WAY))).await;
        };
        let alone = self.places.available_permits() == MOST_UNDER_WAY - 1;
        let (raw, names) = (request.asked.raw, request.asked.names());
        let ready = catch_unwind(AssertUnwindSafe(|| operation.ready(&app, request.asked)));
        let call = match ready.unwrap_or_else(|_| Err(Problem::defect())) {
            Ok(call) => call,
            Err(problem) => return self.answer(&to, operation.name, Err(problem)).await,
        };
        let weight = call.weight;
        let work = move |app: &App| written((call.work)(app)?, raw);
        if alone && weight == Weight::Light {
            let guarded = |app: &App| {
                catch_unwind(AssertUnwindSafe(|| work(app))).unwrap_or_else(|_| Err(Problem::defect()))
            };
            let answer = app.run_light(guarded).await;
            return self.answer(&to, operation.name, answer).await;
        }
        let (cancel, cancelled) = oneshot::channel();
        let dropped = Arc::new(AtomicBool::new(false));
        let twice = {
            let mut under_way = lock(&self.under_way);
            let twice = under_way.contains_key(&to.id);
            if !twice {
                let (dropped, leave) = (dropped.clone(), app.leave().clone());
                let flight = Flight { cancel: Some(cancel), dropped, leave };
                under_way.insert(to.id.clone(), flight);
            }
            twice
        };
        if twice {
            let e = crate::error::Error::input("id", "of a request under way", "an id of its own");
            return self.answer(&to, operation.name, Err(Problem::malformed(e))).await;
        }
        let (before, turn) = self.queue(names);
        let peer = self.clone();
        tokio::spawn(async move {
            let work = async {
                for mut earlier in before {
                    // An error says that it is over.
                    while earlier.changed().await.is_ok() {}
                }
                let alive = move |app: &App| {
                    // Those that wait for this one wait for the work, also if nobody wants its answer any more.
                    let _turn = turn;
                    if dropped.load(Ordering::SeqCst) {
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
            lock(&peer.under_way).remove(&to.id);
            peer.answer(&to, operation.name, answer).await;
            drop(place);
        });
    }

    /// Puts a request in line behind those of the same names: what to wait for, and what to drop when done.
    fn queue(&self, names: Vec<String>) -> (Vec<watch::Receiver<()>>, watch::Sender<()>) {
        let (turn, over) = watch::channel(());
        let mut last = lock(&self.last);
        if last.len() > 16_384 {
            last.retain(|_, earlier| earlier.has_changed().is_ok());
        }
        let before = names
            .into_iter()
            .filter_map(|name| last.insert(name, over.clone()))
            // One that names the same twice does not wait for itself.
            .filter(|earlier| earlier.has_changed().is_ok() && !earlier.same_channel(&over))
            .collect();
        (before, turn)
    }

    fn cancel(&self, request: &Request) -> Answer<Written> {
        let id = request.about.as_ref().filter(|id| **id != NIL).ok_or_else(|| {
            let e = crate::error::Error::input("args.request", "missing", "the id of a request under way");
            Problem::malformed(e)
        })?;
        let cancelled = lock(&self.under_way).get_mut(id).and_then(|flight| {
            flight.dropped.store(true, Ordering::SeqCst);
            flight.cancel.take()?.send(()).ok()
        });
        Written::plain(&json!({"cancelled": cancelled.is_some()}))
    }

    async fn refuse_large(&self, mut frames: Vec<Vec<u8>>) {
        let known = self.who();
        let delimited = frames.first().is_some_and(Vec::is_empty);
        if delimited {
            frames.remove(0);
        }
        frames.truncate(1);
        let id = frames.pop().map_or(NIL.to_vec(), |head| message::read(vec![head]).0);
        let detail = format!(
            "a message has at most {MOST_BYTES} bytes in at most {MOST_FRAMES} frames; send it in parts"
        );
        let refused = known.err().unwrap_or_else(|| Problem::too_large(detail));
        self.answer(&self.address(id, delimited), "none", Err(refused)).await;
    }

    async fn pong(&self, context: &[u8]) {
        if let Some(to) = self.to.lock().await.as_mut() {
            let _ = tokio::time::timeout(PATIENCE, zmtp::pong(to, context)).await;
        }
    }

    /// Takes a request down in the log and in the metrics.
    fn note(&self, to: &Address, name: &'static str, status: u16, refused: Option<&Problem>) {
        let seconds = to.since.elapsed().as_secs_f64();
        let who = self.who().ok();
        self.shared.log.request(&RequestLine {
            request: &to.request_id,
            transport: "zmq",
            operation: name,
            who: who.as_ref().and_then(Who::owner),
            status,
            problem: refused.map(|p| slug(&p.kind)),
            seconds,
            trace: to.traceparent.as_deref().and_then(trace),
        });
        self.shared.base.metrics.took("zmq", name, status, seconds);
    }

    async fn answer(&self, to: &Address, name: &'static str, answer: Answer<Written>) {
        let status = answer.as_ref().map_or_else(|problem| problem.status, |_| 200);
        self.shared.base.metrics.answered("ZMQ", name, status);
        self.note(to, name, status, answer.as_ref().err());
        let mut frames = match answer {
            Ok(written) => written.frames(&to.id, &to.request_id),
            Err(problem) => message::refusal(&to.id, &to.request_id, &problem),
        };
        if to.delimited {
            frames.insert(0, Vec::new());
        }
        let mut writing = self.to.lock().await;
        if let Some(open) = writing.as_mut() {
            let sent = tokio::time::timeout(PATIENCE, zmtp::send(open, &frames)).await;
            if !matches!(sent, Ok(Ok(()))) {
                // Half a message may have gone out: nothing after it would be understood.
                *writing = None;
            }
        }
    }
}

/// Where an answer goes.
struct Address {
    /// As msgpack.
    id: Vec<u8>,
    /// Given or made.
    request_id: String,
    /// W3C's, as it was sent.
    traceparent: Option<String>,
    /// When its request came.
    since: Instant,
    /// Whether the client puts an empty frame in front, as a REQ does.
    delimited: bool,
}

impl Address {
    /// What the request calls itself, if it can be called so, and what it is a part of.
    fn is_called(&mut self, request: &mut Request) {
        if let Some(given) = request.request_id.take().filter(|id| given_id(id).is_some()) {
            self.request_id = given;
        }
        self.traceparent = request.traceparent.take();
    }
}

fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}
