//! Entry points for fuzzing private parsers: bytes of a connection, msgpack, limits, and every operation without a connection
//! (`fuzz/`, `tests/fuzz/`). Not part of the library's public interface.
//!
//! Each function terminates on any input, panics only on a bug, and returns whether the input was accepted.

use std::pin::{Pin, pin};
use std::sync::Arc;
use std::task::{Context, Poll, Waker};
use std::time::Duration;

use serde_json::Value;
use tokio::io::{AsyncRead, ReadBuf};

use super::client::Client;
use super::config::ServeConfig;
use super::limits::Limits;
use super::operation::{HttpRequestParts, Operation, OperationRequest, OperationResponse, Payload};
use super::operations::{self, OPERATIONS};
use super::problem::Problem;
use super::request_context::RequestContext;
use super::state::AppState;
use super::wire::{MSGPACK, msgpack};
use super::zmq::{message, zmtp};
use crate::access::{Keyring, Principal};

/// Whether the input was accepted.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum FuzzOutcome {
    Rejected,
    Accepted,
}

/// Bytes of a ZeroMQ client, read at most `at_a_time` at once: the handshake, then messages, each parsed as a request.
/// Accepted if it contains a message.
pub fn zmq_connection(bytes: &[u8], at_a_time: usize) -> FuzzOutcome {
    let from = ChunkedReader { bytes, at_a_time: at_a_time.max(1) };
    now(async {
        let mut sent = Vec::new();
        let Ok((mut receiver, token)) = zmtp::handshake(from, &mut sent).await else {
            return FuzzOutcome::Rejected;
        };
        assert!(token.is_none_or(|token| token.len() <= 255), "a token is longer than its length says");
        let mut fate = FuzzOutcome::Rejected;
        while let Ok(Some(received)) = receiver.receive().await {
            match received {
                zmtp::Received::Message(frames) => {
                    fate = FuzzOutcome::Accepted;
                    again(&frames).await;
                    parse_frames(frames);
                }
                zmtp::Received::TooLarge(frames) => drop(message::read(frames)),
                zmtp::Received::Ping(context) => drop(zmtp::pong(&mut sent, &context).await),
            }
        }
        fate
    })
}

/// The received message is within the limits, and survives a round trip.
async fn again(frames: &[Vec<u8>]) {
    let bytes: usize = frames.iter().map(Vec::len).sum();
    assert!(bytes <= zmtp::MAX_MESSAGE_BYTES && frames.len() <= zmtp::MAX_FRAMES, "{bytes} bytes were taken");
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

/// Parses a message's frames as a request.
fn parse_frames(frames: Vec<Vec<u8>>) -> FuzzOutcome {
    let (id, request) = message::read(frames);
    assert!(!id.is_empty(), "an answer has no recipient");
    match request {
        Ok(_) => FuzzOutcome::Accepted,
        Err(error) => {
            check_problem(&Problem::malformed(error));
            FuzzOutcome::Rejected
        }
    }
}

/// Parses bytes as msgpack, and as the first frame of a message with two arrays. Both encoders must agree on the parsed value,
/// and it must survive a round trip.
pub fn msgpack(bytes: &[u8]) -> FuzzOutcome {
    let frames = [bytes, &[0; 8][..], &[1; 3]].map(Vec::from).to_vec();
    let whole = parse_frames(frames);
    match msgpack::unpack(bytes) {
        Err(error) => {
            check_problem(&Problem::malformed(error));
            whole
        }
        Ok(value) => {
            let written = msgpack::packed(&value).expect("what was read can be written");
            let by_json = serde_json::to_vec(&value).expect("it is JSON");
            assert_eq!(
                written,
                msgpack::from_json(&by_json).expect("it is JSON"),
                "two ways of writing {value}"
            );
            assert_eq!(msgpack::unpack(&written).expect("it can be read again"), value);
            FuzzOutcome::Accepted
        }
    }
}

/// A file of limits.
pub fn limits(text: &str) -> FuzzOutcome {
    match Limits::parse(text) {
        Ok(limits) => {
            let spans =
                [limits.request_seconds, limits.world_idle_seconds, limits.job_seconds.unwrap_or(1.0)];
            assert!(spans.iter().all(|s| Limits::duration(*s) > Duration::ZERO), "{limits:?}");
            FuzzOutcome::Accepted
        }
        Err(error) => {
            check_problem(&Problem::malformed(error));
            FuzzOutcome::Rejected
        }
    }
}

/// Transport and encoding of a request.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum RequestEncoding {
    /// HTTP with the body unchanged.
    Json,
    /// HTTP with the JSON body converted to msgpack.
    Msgpack,
    /// HTTP with the operation's other media type.
    OtherMediaType,
    /// ZeroMQ with all fields in one map; arrays separate.
    ZmqFields,
}

/// A request to an operation.
pub struct FuzzRequest<'a> {
    /// Index of the operation.
    pub operation: usize,
    pub encoding: RequestEncoding,
    /// Value of each path parameter.
    pub path_parameter: &'a str,
    /// `name=value&name=value`.
    pub query: &'a str,
    pub body: &'a [u8],
}

/// An in-memory server without connections. Jobs are queued and do not start.
pub struct InMemoryServer(Arc<AppState>);

/// Names of all operations, in order.
pub fn operations() -> Vec<&'static str> {
    OPERATIONS.iter().map(|o| o.name).collect()
}

impl Default for InMemoryServer {
    fn default() -> InMemoryServer {
        let few =
            Limits { body_steps: 50_000, actions: 32, samples: 20_000, worlds: 64, ..Limits::default() };
        let limits = Limits { jobs_running: 0, ..few };
        let config = ServeConfig { limits, ..ServeConfig::default() };
        let keyring = Keyring::new(None, None).expect("there is no file to be read");
        let shared = AppState::new(&config, keyring, operations::work_factories, "{}")
            .expect("memory is all it needs");
        InMemoryServer(Arc::new(shared))
    }
}

impl InMemoryServer {
    /// Parses a request without running it.
    pub fn read(&self, fuzz_request: &FuzzRequest) -> FuzzOutcome {
        let Some((operation, request)) = parse_fuzz_request(fuzz_request) else {
            return FuzzOutcome::Rejected;
        };
        let app = self.app();
        match operation.authorize(&app).and_then(|allowed| allowed.prepare(&app, request)) {
            Ok(_) => FuzzOutcome::Accepted,
            Err(problem) => check_rejection(operation, fuzz_request.encoding, &problem),
        }
    }

    /// Runs a request, and serialises the response in every format.
    pub fn answer(&self, fuzz_request: &FuzzRequest) -> FuzzOutcome {
        let Some((operation, request)) = parse_fuzz_request(fuzz_request) else {
            return FuzzOutcome::Rejected;
        };
        let (app, raw) = (self.app(), request.raw);
        let done = operation
            .authorize(&app)
            .and_then(|allowed| allowed.prepare(&app, request))
            .and_then(|call| (call.work)(&app));
        match done {
            Ok(reply) => {
                written(operation, reply, raw);
                FuzzOutcome::Accepted
            }
            Err(problem) => check_rejection(operation, fuzz_request.encoding, &problem),
        }
    }

    fn app(&self) -> RequestContext {
        RequestContext::new(&self.0, Principal::anonymous(), &Client::local(), Duration::from_secs(86_400))
    }
}

/// The operation and its request; `None` where a transport would reject it earlier.
fn parse_fuzz_request(fuzz_request: &FuzzRequest) -> Option<(&'static Operation, OperationRequest)> {
    let operation = OPERATIONS.get(fuzz_request.operation % OPERATIONS.len())?;
    let parts = operation.path.split('/').filter_map(|p| p.strip_prefix('{')?.strip_suffix('}'));
    let path: Vec<(String, String)> =
        parts.map(|name| (name.into(), fuzz_request.path_parameter.into())).collect();
    let raw = fuzz_request.query.len() % 2 == 1;
    if fuzz_request.encoding == RequestEncoding::ZmqFields {
        let Ok(Value::Object(mut fields)) = serde_json::from_slice(fuzz_request.body) else { return None };
        fields.extend(path.into_iter().map(|(name, part)| (name, part.into())));
        let bytes = Some(fuzz_request.body.to_vec()).filter(|_| !raw);
        return (!operation.http_only)
            .then(|| (operation, OperationRequest::from_fields(fields, bytes, None, raw)));
    }
    let pair = |pair: &str| {
        let (name, value) = pair.split_once('=').unwrap_or((pair, ""));
        (name.to_string(), value.to_string())
    };
    let query = fuzz_request.query.split('&').filter(|p| !p.is_empty()).map(pair).collect();
    let other = || operation.doc.body_types().into_iter().find(|k| k != MSGPACK && !k.ends_with("json"));
    let packed = || msgpack::from_json(fuzz_request.body).ok();
    let (kind, body) = match fuzz_request.encoding {
        RequestEncoding::Msgpack => (MSGPACK.into(), packed().unwrap_or(fuzz_request.body.to_vec())),
        RequestEncoding::OtherMediaType => (other().unwrap_or_default(), fuzz_request.body.to_vec()),
        _ => ("application/json".into(), fuzz_request.body.to_vec()),
    };
    let body = if operation.has_body { body } else { Vec::new() };
    Some((
        operation,
        OperationRequest::from_http(
            HttpRequestParts { path, query: Ok(query), last_event: None, body, media_type: kind },
            None,
            raw,
        ),
    ))
}

/// A rejection is a 4xx that the OpenAPI document lists, and has a detail.
fn check_rejection(operation: &Operation, encoding: RequestEncoding, problem: &Problem) -> FuzzOutcome {
    check_problem(problem);
    if encoding != RequestEncoding::ZmqFields {
        check_documented(operation, problem.status, &problem.detail);
    }
    FuzzOutcome::Rejected
}

fn check_documented(operation: &Operation, status: u16, reason: &str) {
    let check_documented = operation.doc.operation().responses.responses;
    let there = check_documented.contains_key(&status.to_string());
    assert!(there, "{} does not say that it answers {status}: {reason}", operation.name);
}

fn check_problem(problem: &Problem) {
    assert!((400..500).contains(&problem.status), "{}: {}", problem.status, problem.detail);
    assert!(!problem.detail.is_empty());
    drop(message::error_frames(&message::NIL, "", problem));
}

fn written(operation: &Operation, mut reply: OperationResponse, raw: bool) {
    if let Payload::Value(value) = &mut reply.content {
        let json = value.to_json().expect("an answer can be written as JSON");
        let packed = value.to_msgpack().expect("an answer can be written as msgpack");
        let (json, packed): (Value, _) =
            (serde_json::from_slice(&json).expect("it is JSON"), msgpack::unpack(&packed));
        assert_eq!(packed.expect("it is msgpack"), json, "{} in two forms", operation.name);
    }
    check_documented(operation, reply.status, "done");
    if !matches!(reply.content, Payload::EventStream(_)) {
        let written = message::serialize(reply, raw).expect("an answer can be written");
        assert!(!written.frames(&message::NIL, "").is_empty());
    }
}

/// A reader that returns a few bytes at a time.
struct ChunkedReader<'a> {
    bytes: &'a [u8],
    at_a_time: usize,
}

impl AsyncRead for ChunkedReader<'_> {
    fn poll_read(mut self: Pin<&mut Self>, _: &mut Context, to: &mut ReadBuf) -> Poll<std::io::Result<()>> {
        let n = self.at_a_time.min(to.remaining()).min(self.bytes.len());
        let (now, later) = self.bytes.split_at(n);
        to.put_slice(now);
        self.bytes = later;
        Poll::Ready(Ok(()))
    }
}

/// Runs a future that never waits, since all its bytes are available.
fn now<T>(work: impl Future<Output = T>) -> T {
    match pin!(work).poll(&mut Context::from_waker(Waker::noop())) {
        Poll::Ready(done) => done,
        Poll::Pending => panic!("it waits for bytes, and all of them are there"),
    }
}
