//! Kills a server at random moments of a workload over both transports: acknowledged writes survive, and
//! the server restarts. A few kills in every test run, a hundred with `make kill`.

use std::collections::BTreeMap;
use std::io::{self, BufRead, BufReader};
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::sync::Mutex;
use std::time::Duration;

use iplw::rng;
use rand::RngExt;
use reqwest::blocking::Client;
use serde_json::{Value, json};

use crate::peer::Peer;

/// A server on a data directory, over both transports.
struct Server {
    child: Child,
    http: String,
    zmq: String,
}

impl Server {
    /// Fails with the server's output if it does not start.
    fn start(directory: &Path) -> Result<Server, String> {
        let mut child = Command::new(env!("CARGO_BIN_EXE_iplw"))
            .args(["serve", "--http", "127.0.0.1:0", "--zmq", "tcp://127.0.0.1:*", "--data-dir"])
            .arg(directory)
            .stdout(Stdio::piped())
            .stderr(Stdio::piped())
            .spawn()
            .unwrap();
        let mut lines = BufReader::new(child.stdout.take().unwrap()).lines();
        let mut address = || lines.next()?.ok()?.strip_prefix("listening on ").map(String::from);
        match (address(), address()) {
            (Some(http), Some(zmq)) => Ok(Server { child, http, zmq }),
            _ => {
                let said = child.wait_with_output().unwrap().stderr;
                Err(String::from_utf8_lossy(&said).into_owned())
            }
        }
    }

    /// SIGKILL.
    fn kill(&mut self) {
        let _ = self.child.kill();
        self.child.wait().unwrap();
    }
}

impl Drop for Server {
    fn drop(&mut self) {
        self.kill();
    }
}

/// Response to a request: status (200 for success over ZeroMQ) and JSON; `None` if the server is gone.
type Answer = Option<(u64, Value)>;

/// A client of one of the transports.
enum ClientKind {
    Http(Client, String),
    Zmq(Peer),
}

/// An operation: name for ZeroMQ, method and path for HTTP, arguments, and idempotency key.
struct OperationCall<'a> {
    op: &'a str,
    method: &'a str,
    path: String,
    args: Value,
    key: Option<&'a str>,
}

impl ClientKind {
    fn ask(&mut self, ask: &OperationCall) -> Answer {
        match self {
            ClientKind::Http(client, url) => {
                let mut request = client.request(ask.method.parse().unwrap(), format!("{url}{}", ask.path));
                if let Some(key) = ask.key {
                    request = request.header("Idempotency-Key", key);
                }
                if ask.method == "POST" {
                    let mut body = ask.args.clone();
                    body.as_object_mut().unwrap().remove("id");
                    request = request.body(body.to_string());
                }
                let response = request.send().ok()?;
                let status = u64::from(response.status().as_u16());
                let text = response.text().ok()?;
                Some((status, serde_json::from_str(&text).unwrap_or_default()))
            }
            ClientKind::Zmq(peer) => {
                let answer = peer.try_ask(ask.op, &ask.args, ask.key).ok()?;
                if answer["ok"] == true {
                    return Some((200, answer["result"].clone()));
                }
                Some((answer["problem"]["status"].as_u64().unwrap(), answer["problem"].clone()))
            }
        }
    }
}

/// State that the server has acknowledged.
#[derive(Default)]
struct Acknowledged {
    /// Worlds by id: kind, and answered and sent attempts in real ones.
    worlds: BTreeMap<String, (String, u64, u64)>,
    /// Friction of simulated worlds by id: the last that was acknowledged (NaN if none was), and those that were sent after it.
    friction: BTreeMap<String, Vec<f64>>,
    deleted: Vec<String>,
    /// Jobs by id.
    jobs: BTreeMap<String, Value>,
    /// Results of finished jobs.
    results: BTreeMap<String, Value>,
    /// Created resources by idempotency key.
    keys: BTreeMap<String, (Value, String)>,
    acknowledged: u64,
    /// An action that can be placed.
    action: Value,
}

/// Sends requests until the server is gone and records every response.
fn work(mut transport: ClientKind, name: &str, draws: &mut impl rand::Rng, state: &Mutex<Acknowledged>) {
    let mut own = Vec::new();
    for turn in 0.. {
        let done = match draws.random_range(0..7) {
            0 | 1 => make_world(
                &mut transport,
                &format!("{name}-{turn}"),
                draws.random_range(0..2),
                &mut own,
                state,
            ),
            2 | 3 => attempt(&mut transport, &own, draws.random_range(0..1000), state),
            5 => set_latents(&mut transport, &own, draws.random_range(0..1000), state),
            4 => delete_world(&mut transport, &mut own, draws.random_range(0..1000), state),
            _ => make_job(&mut transport, draws.random_range(0..1000), state),
        };
        let Some(acknowledged) = done else { return };
        state.lock().unwrap().acknowledged += u64::from(acknowledged);
    }
}

fn make_world(
    transport: &mut ClientKind,
    key: &str,
    kind: usize,
    own: &mut Vec<String>,
    state: &Mutex<Acknowledged>,
) -> Option<bool> {
    let kind = ["sim", "real"][kind];
    let args = json!({"task": "bowling:003", "kind": kind, "seed": own.len()});
    let ask = OperationCall {
        op: "create_world",
        method: "POST",
        path: "/v1/worlds".into(),
        args: args.clone(),
        key: Some(key),
    };
    let (status, made) = transport.ask(&ask)?;
    if status == 429 {
        // Too many worlds.
        return Some(false);
    }
    assert!(status < 300, "{made}");
    let id = made["id"].as_str().unwrap().to_string();
    let mut state = state.lock().unwrap();
    state.worlds.insert(id.clone(), (kind.into(), 0, 0));
    state.keys.insert(key.into(), (args, id.clone()));
    own.push(id);
    Some(true)
}

/// One of the client's worlds.
fn pick(own: &[String], which: usize) -> Option<&String> {
    own.get(which.checked_rem(own.len())?)
}

fn attempt(
    transport: &mut ClientKind,
    own: &[String],
    which: usize,
    state: &Mutex<Acknowledged>,
) -> Option<bool> {
    let Some(id) = pick(own, which) else { return Some(false) };
    let action = {
        let mut state = state.lock().unwrap();
        state.worlds.get_mut(id).unwrap().2 += 1;
        state.action.clone()
    };
    let args = json!({"id": id, "task": "bowling:003", "actions": [action]});
    let path = format!("/v1/worlds/{id}/rollout");
    let (status, told) =
        transport.ask(&OperationCall { op: "rollout_world", method: "POST", path, args, key: None })?;
    assert!(status < 300, "{told}");
    state.lock().unwrap().worlds.get_mut(id).unwrap().1 += 1;
    Some(true)
}

fn set_latents(
    transport: &mut ClientKind,
    own: &[String],
    which: usize,
    state: &Mutex<Acknowledged>,
) -> Option<bool> {
    let Some(id) = pick(own, which) else { return Some(false) };
    let friction = 0.001 * (1 + which) as f64;
    {
        let mut state = state.lock().unwrap();
        if state.worlds[id].0 != "sim" {
            return Some(false);
        }
        state.friction.entry(id.clone()).or_insert_with(|| vec![f64::NAN]).push(friction);
    }
    let (args, path) = (json!({"id": id, "friction": friction}), format!("/v1/worlds/{id}/set_latents"));
    let (status, told) =
        transport.ask(&OperationCall { op: "set_latents", method: "POST", path, args, key: None })?;
    assert!(status < 300, "{told}");
    state.lock().unwrap().friction.insert(id.clone(), vec![friction]);
    Some(true)
}

fn delete_world(
    transport: &mut ClientKind,
    own: &mut Vec<String>,
    which: usize,
    state: &Mutex<Acknowledged>,
) -> Option<bool> {
    if own.len() < 3 {
        return Some(false);
    }
    let id = own.swap_remove(which % own.len());
    // Without a response, it may or may not exist.
    state.lock().unwrap().worlds.remove(&id);
    state.lock().unwrap().friction.remove(&id);
    state.lock().unwrap().keys.retain(|_, (_, made)| *made != id);
    let (args, path) = (json!({"id": id}), format!("/v1/worlds/{id}"));
    let (status, told) =
        transport.ask(&OperationCall { op: "delete_world", method: "DELETE", path, args, key: None })?;
    assert!(status < 300, "{told}");
    state.lock().unwrap().deleted.push(id);
    Some(true)
}

fn make_job(transport: &mut ClientKind, seed: usize, state: &Mutex<Acknowledged>) -> Option<bool> {
    let args = json!({"task": "basketball", "rounds": 1, "actions": 2, "samples": 4, "seed": seed});
    let ask = OperationCall { op: "start_iplw", method: "POST", path: "/v1/iplw".into(), args, key: None };
    let (status, made) = transport.ask(&ask)?;
    if status == 429 {
        // Too many jobs.
        std::thread::sleep(Duration::from_millis(5));
        return Some(false);
    }
    assert!(status < 300, "{made}");
    state.lock().unwrap().jobs.insert(made["id"].as_str().unwrap().into(), made["config"].clone());
    Some(true)
}

/// Checks that everything acknowledged is there.
fn check_state(server: &Server, state: &mut Acknowledged) {
    let mut transports =
        [ClientKind::Http(client(), server.http.clone()), ClientKind::Zmq(Peer::connect(&server.zmq, None))];
    let mut get = |turn: usize, op: &str, kind: &str, id: &str| {
        let (args, path) = (json!({"id": id}), format!("/v1/{kind}/{id}"));
        transports[turn % 2]
            .ask(&OperationCall { op, method: "GET", path, args, key: None })
            .expect("it answers")
    };
    for (turn, (id, (kind, answered, sent))) in state.worlds.iter().enumerate() {
        let (status, world) = get(turn, "get_world", "worlds", id);
        assert_eq!((status, world["kind"].as_str()), (200, Some(kind.as_str())), "{id}: {world}");
        if let Some(sent) = state.friction.get(id) {
            let friction = world["latents"]["friction"].as_f64().unwrap();
            let never_acknowledged = sent[0].is_nan();
            assert!(
                never_acknowledged || sent.contains(&friction),
                "{id}: friction is {friction}, sent were {sent:?}"
            );
        }
        // Counters of simulated worlds are written once per second.
        if kind == "real" {
            let counted = world["interactions"].as_u64().unwrap();
            assert!((*answered..=*sent).contains(&counted), "{id}: {counted} of {answered} to {sent}");
        }
    }
    for (turn, id) in state.deleted.iter().enumerate() {
        assert_eq!(get(turn, "get_world", "worlds", id).0, 404, "{id}");
    }
    for (turn, (id, config)) in state.jobs.iter().enumerate() {
        let (status, job) = get(turn, "get_job", "jobs", id);
        assert_eq!((status, &job["config"]), (200, config), "{id}: {job}");
        // A job that seems to crash the server every time fails with an explanation.
        let given_up = job["error"]["detail"].as_str().unwrap_or_default().contains("the server ended");
        assert!(job["state"] != "failed" || given_up, "{job}");
        if let Some(result) = state.results.get(id) {
            assert_eq!(&job["result"], result, "{id}: what was seen stays");
        } else if job["state"] == "succeeded" {
            state.results.insert(id.clone(), job["result"].clone());
        }
    }
    for (key, (args, made)) in &state.keys {
        // Idempotency keys are per transport client.
        let transport = usize::from(key.starts_with("zmq"));
        let path = "/v1/worlds".into();
        let ask =
            OperationCall { op: "create_world", method: "POST", path, args: args.clone(), key: Some(key) };
        let (status, again) = transports[transport].ask(&ask).expect("it answers");
        assert!(status < 300 && again["id"] == made.as_str(), "{key}: {made} {again}");
    }
}

/// Waits until every job has ended.
fn wait_for_jobs(server: &Server, state: &Acknowledged) {
    let client = client();
    for id in state.jobs.keys() {
        loop {
            let job = client.get(format!("{}/v1/jobs/{id}", server.http)).send().unwrap().text().unwrap();
            let job: Value = serde_json::from_str(&job).unwrap();
            if !["queued", "running"].contains(&job["state"].as_str().unwrap()) {
                break;
            }
            std::thread::sleep(Duration::from_millis(10));
        }
    }
}

fn client() -> Client {
    Client::builder().timeout(Duration::from_secs(120)).build().unwrap()
}

fn run_with_kills(kills: usize) {
    let directory = tempfile::tempdir().unwrap();
    let state = Mutex::new(Acknowledged::default());
    let mut draws = rng::stream(11, "kills");
    let mut failed = Vec::new();
    for kill in 0..kills {
        let mut server = match Server::start(directory.path()) {
            Ok(server) => server,
            Err(said) => {
                failed.push(said);
                continue;
            }
        };
        if kill == 0 {
            let task = client().get(format!("{}/v1/tasks/bowling/003", server.http)).send().unwrap();
            let task: Value = serde_json::from_str(&task.text().unwrap()).unwrap();
            state.lock().unwrap().action = task["certificate"]["action"].clone();
        }
        check_state(&server, &mut state.lock().unwrap());
        let pause = Duration::from_secs_f64(draws.random_range(0.005..0.8));
        std::thread::scope(|scope| {
            for i in 0..2 {
                for (name, transport) in [
                    ("http", ClientKind::Http(client(), server.http.clone())),
                    ("zmq", ClientKind::Zmq(Peer::connect(&server.zmq, None))),
                ] {
                    let (name, state) = (format!("{name}-{kill}-{i}"), &state);
                    scope.spawn(move || {
                        let mut draws = rng::stream(kill as u64, &name);
                        work(transport, &name, &mut draws, state);
                    });
                }
            }
            std::thread::sleep(pause);
            server.kill();
        });
    }
    let server = Server::start(directory.path()).unwrap();
    let mut state = state.into_inner().unwrap();
    check_state(&server, &mut state);
    wait_for_jobs(&server, &state);
    check_state(&server, &mut state);
    println!(
        "{kills} kills: {} acknowledged, of which there are {} worlds, {} deletions, {} jobs, {} results, {} keys; \
         lost 0; starts that failed {}",
        state.acknowledged,
        state.worlds.len(),
        state.deleted.len(),
        state.jobs.len(),
        state.results.len(),
        state.keys.len(),
        failed.len()
    );
    assert!(failed.is_empty(), "{failed:?}");
    assert!(state.acknowledged > 0 && !state.worlds.is_empty(), "nothing was asked for");
}

#[test]
fn acknowledged_writes_survive_a_kill() {
    run_with_kills(5);
}

#[test]
#[ignore = "long: `make kill`"]
fn acknowledged_writes_survive_a_hundred_kills() {
    run_with_kills(100);
}

impl Peer {
    /// As [`Peer::ask`], under a key; errors once the server is gone.
    fn try_ask(&mut self, op: &str, args: &Value, key: Option<&str>) -> io::Result<Value> {
        let mut head = json!({"v": 1, "id": 1, "op": op, "args": args});
        if let Some(key) = key {
            head["key"] = key.into();
        }
        self.try_send(&rmp_serde::to_vec_named(&head).unwrap())?;
        self.try_answer()
    }
}
