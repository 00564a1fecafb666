//! What fuzzing reaches of what is otherwise this room's own: bytes of a connection, msgpack, limits, and every operation
//! without a connection (`fuzz/`, `tests/fuzz/`). It is no part of the library's interface.
//!
//! Whatever is given, a function here comes to an end, panics only where something is wrong, and says whether it was taken.

use std::pin::{Pin, pin};
use std::sync::Arc;
use std::task::{Context, Poll, Waker};
use std::time::Duration;

use serde_json::Value;
use tokio::io::{AsyncRead, ReadBuf};

use super::app::App;
use super::config::ServeConfig;
use super::limits::Limits;
use super::operation::{Asked, Content, Operation, Reply, Sent};
use super::operations::{self, OPERATIONS};
use super::problem::Problem;
use super::shared::Shared;
use super::wire::{MSGPACK, pack};
use super::zmq::{message, zmtp};
use crate::access::{Keyring, Who};

/// What became of what was given.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Fate {
    Refused,
    Taken,
}

/// A ZeroMQ client's bytes, read at most `at_a_time` at once: the handshake, then messages up to the end, each read as a request.
/// Taken is what holds a message.
pub fn connection(bytes: &[u8], at_a_time: usize) -> Fate {
    let from = Trickle { bytes, at_a_time: at_a_time.max(1) };
    now(async {
        let mut sent = Vec::new();
        let Ok((mut receiver, token)) = zmtp::handshake(from, &mut sent).await else { return Fate::Refused };
        assert!(token.is_none_or(|token| token.len() <= 255), "a token is longer than its length says");
        let mut fate = Fate::Refused;
        while let Ok(Some(received)) = receiver.receive().await {
            match received {
                zmtp::Received::Message(frames) => {
                    fate = Fate::Taken;
                    again(&frames).await;
                    asked(frames);
                }
                zmtp::Received::TooLarge(frames) => drop(message::read(frames)),
                zmtp::Received::Ping(context) => drop(zmtp::pong(&mut sent, &context).await),
            }
        }
        fate
    })
}

/// What was received is within the limits, and sent it is received again.
async fn again(frames: &[Vec<u8>]) {
    let bytes: usize = frames.iter().map(Vec::len).sum();
    assert!(bytes <= zmtp::MOST_BYTES && frames.len() <= zmtp::MOST_FRAMES, "{bytes} bytes were taken");
    let mut greeting = vec![0u8; 64];
    (greeting[0], greeting[9], greeting[10]) = (0xff, 0x7f, 3);
    greeting[12..16].copy_from_slice(b"NULL");
    greeting.extend_from_slice(b"\x04\x1c\x05READY\x0bSocket-Type\x00\x00\x00\x06DEALER");
    zmtp::send(&mut greeting, frames).await.expect("memory takes it");
    let opened = zmtp::handshake(&greeting[..], &mut tokio::io::sink()).await;
    let (mut receiver, _) = opened.expect("a client greets");
    let received = receiver.receive().await.expect("what was sent can be read");
    assert_eq!(received, Some(zmtp::Received::Message(frames.to_vec())), "sent and received again");
}

/// A message's frames as a request.
fn asked(frames: Vec<Vec<u8>>) -> Fate {
    let (id, request) = message::read(frames);
    assert!(!id.is_empty(), "an answer has nobody to go to");
    match request {
        Ok(_) => Fate::Taken,
        Err(error) => {
            answered(&Problem::malformed(error));
            Fate::Refused
        }
    }
}

/// Bytes as msgpack, and as the first frame of a message with two arrays. What is read says the same when it is written
/// again, by the short way and by way of JSON.
pub fn msgpack(bytes: &[u8]) -> Fate {
    let frames = [bytes, &[0; 8][..], &[1; 3]].map(Vec::from).to_vec();
    let whole = asked(frames);
    match pack::unpack(bytes) {
        Err(error) => {
            answered(&Problem::malformed(error));
            whole
        }
        Ok(value) => {
            let written = pack::packed(&value).expect("what was read can be written");
            let by_json = serde_json::to_vec(&value).expect("it is JSON");
            assert_eq!(
                written,
                pack::from_json(&by_json).expect("it is JSON"),
                "two ways of writing {value}"
            );
            assert_eq!(pack::unpack(&written).expect("it can be read again"), value);
            Fate::Taken
        }
    }
}

/// A file of limits.
pub fn limits(text: &str) -> Fate {
    match Limits::parse(text) {
        Ok(limits) => {
            let spans =
                [limits.request_seconds, limits.world_idle_seconds, limits.job_seconds.unwrap_or(1.0)];
            assert!(spans.iter().all(|s| Limits::span(*s) > Duration::ZERO), "{limits:?}");
            Fate::Taken
        }
        Err(error) => {
            answered(&Problem::malformed(error));
            Fate::Refused
        }
    }
}

/// How a request comes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Way {
    /// Over HTTP, its body as it is.
    Http,
    /// Over HTTP, its body (JSON) as msgpack.
    Msgpack,
    /// Over HTTP, its body of the other type that the operation declares.
    Other,
    /// Over ZeroMQ, all fields in one map; arrays apart.
    Fields,
}

/// A request to an operation.
pub struct Asking<'a> {
    /// Its place in the list of operations.
    pub operation: usize,
    pub way: Way,
    /// What stands for each parameter of the path.
    pub part: &'a str,
    /// `name=value&name=value`.
    pub query: &'a str,
    pub body: &'a [u8],
}

/// A server in memory that nobody can connect to. Jobs are queued and do not begin.
pub struct Bench(Arc<Shared>);

/// Names of all operations, in the order of their list.
pub fn operations() -> Vec<&'static str> {
    OPERATIONS.iter().map(|o| o.name).collect()
}

impl Default for Bench {
    fn default() -> Bench {
        let few =
            Limits { body_steps: 50_000, actions: 32, samples: 20_000, worlds: 64, ..Limits::default() };
        let limits = Limits { jobs_running: 0, ..few };
        let config = ServeConfig { limits, ..ServeConfig::default() };
        let keyring = Keyring::new(None, None).expect("there is no file to be read");
        let shared =
            Shared::new(&config, keyring, operations::recipes, "{}").expect("memory is all it needs");
        Bench(Arc::new(shared))
    }
}

impl Bench {
    /// Reads a request to the end, and does nothing.
    pub fn read(&self, asking: &Asking) -> Fate {
        let Some((operation, asked)) = asked_of(asking) else { return Fate::Refused };
        match operation.ready(&self.app(), asked) {
            Ok(_) => Fate::Taken,
            Err(problem) => refused(operation, asking.way, &problem),
        }
    }

    /// Does what is asked, and writes the answer in every form.
    pub fn answer(&self, asking: &Asking) -> Fate {
        let Some((operation, asked)) = asked_of(asking) else { return Fate::Refused };
        let (app, raw) = (self.app(), asked.raw);
        let done = operation.ready(&app, asked).and_then(|call| (call.work)(&app));
        match done {
            Ok(reply) => {
                written(operation, reply, raw);
                Fate::Taken
            }
            Err(problem) => refused(operation, asking.way, &problem),
        }
    }

    fn app(&self) -> App {
        App::new(&self.0, Who::anybody(), Duration::from_secs(86_400))
    }
}

/// The operation and what is asked of it; `None` where a transport would not come so far.
fn asked_of(asking: &Asking) -> Option<(&'static Operation, Asked)> {
    let operation = OPERATIONS.get(asking.operation % OPERATIONS.len())?;
    let parts = operation.path.split('/').filter_map(|p| p.strip_prefix('{')?.strip_suffix('}'));
    let path: Vec<(String, String)> = parts.map(|name| (name.into(), asking.part.into())).collect();
    let raw = asking.query.len() % 2 == 1;
    if asking.way == Way::Fields {
        let Ok(Value::Object(mut fields)) = serde_json::from_slice(asking.body) else { return None };
        fields.extend(path.into_iter().map(|(name, part)| (name, part.into())));
        let bytes = Some(asking.body.to_vec()).filter(|_| !raw);
        return (!operation.only_http).then(|| (operation, Asked::fields(fields, bytes, None, raw)));
    }
    let pair = |pair: &str| {
        let (name, value) = pair.split_once('=').unwrap_or((pair, ""));
        (name.to_string(), value.to_string())
    };
    let query = asking.query.split('&').filter(|p| !p.is_empty()).map(pair).collect();
    let other =
        || operation.described.body_types().into_iter().find(|k| k != MSGPACK && !k.ends_with("json"));
    let packed = || pack::from_json(asking.body).ok();
    let (kind, body) = match asking.way {
        Way::Msgpack => (MSGPACK.into(), packed().unwrap_or(asking.body.to_vec())),
        Way::Other => (other().unwrap_or_default(), asking.body.to_vec()),
        _ => ("application/json".into(), asking.body.to_vec()),
    };
    let body = if operation.takes_body { body } else { Vec::new() };
    Some((operation, Asked::sent(Sent { path, query: Ok(query), last_event: None, body, kind }, None, raw)))
}

/// A refusal is the client's fault, is one that the document promises of HTTP, and says what to do.
fn refused(operation: &Operation, way: Way, problem: &Problem) -> Fate {
    answered(problem);
    if way != Way::Fields {
        promised(operation, problem.status, &problem.detail);
    }
    Fate::Refused
}

fn promised(operation: &Operation, status: u16, told: &str) {
    let promised = operation.described.operation().responses.responses;
    let there = promised.contains_key(&status.to_string());
    assert!(there, "{} does not say that it answers {status}: {told}", operation.name);
}

fn answered(problem: &Problem) {
    assert!((400..500).contains(&problem.status), "{}: {}", problem.status, problem.detail);
    assert!(!problem.detail.is_empty());
    drop(message::refusal(&message::NIL, problem));
}

fn written(operation: &Operation, mut reply: Reply, raw: bool) {
    if let Content::Value(value) = &mut reply.content {
        let json = value.json().expect("an answer can be written as JSON");
        let packed = value.packed().expect("an answer can be written as msgpack");
        let (json, packed): (Value, _) =
            (serde_json::from_slice(&json).expect("it is JSON"), pack::unpack(&packed));
        assert_eq!(packed.expect("it is msgpack"), json, "{} in two forms", operation.name);
    }
    promised(operation, reply.status, "done");
    if !matches!(reply.content, Content::Events(_)) {
        let written = message::written(reply, raw).expect("an answer can be written");
        assert!(!written.frames(&message::NIL).is_empty());
    }
}

/// Bytes that come a few at a time.
struct Trickle<'a> {
    bytes: &'a [u8],
    at_a_time: usize,
}

impl AsyncRead for Trickle<'_> {
    fn poll_read(mut self: Pin<&mut Self>, _: &mut Context, to: &mut ReadBuf) -> Poll<std::io::Result<()>> {
        let n = self.at_a_time.min(to.remaining()).min(self.bytes.len());
        let (now, later) = self.bytes.split_at(n);
        to.put_slice(now);
        self.bytes = later;
        Poll::Ready(Ok(()))
    }
}

/// What never has to wait, as its bytes are all there.
fn now<T>(work: impl Future<Output = T>) -> T {
    match pin!(work).poll(&mut Context::from_waker(Waker::noop())) {
        Poll::Ready(done) => done,
        Poll::Pending => panic!("it waits for bytes, and all of them are there"),
    }
}
