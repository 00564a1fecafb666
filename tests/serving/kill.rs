//! A server that is killed at random moments of a workload over both transports: what it acknowledged is there afterwards, and
//! it starts again. A few kills in every run of the tests, a hundred by `make kill`.

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
    /// Errors by what it said, if it does not start.
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

/// What answers a request: its status (200 for whatever went well over ZeroMQ) and JSON; `None` if the server is gone.
type Answer = Option<(u64, Value)>;

/// A client of one of the transports.
enum Way {
    Http(Client, String),
    Zmq(Peer),
}

/// An operation: its name over ZeroMQ, method and path over HTTP, what it is given, and the key of its request.
struct Ask<'a> {
    op: &'a str,
    method: &'a str,
    path: String,
    args: Value,
    key: Option<&'a str>,
}

impl Way {
    fn ask(&mut self, ask: &Ask) -> Answer {
        match self {
            Way::Http(client, url) => {
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
            Way::Zmq(peer) => {
                let answer = peer.try_ask(ask.op, &ask.args, ask.key).ok()?;
                if answer["ok"] == true {
                    return Some((200, answer["result"].clone()));
                }
                Some((answer["problem"]["status"].as_u64().unwrap(), answer["problem"].clone()))
            }
        }
    }
}

/// What was acknowledged so far.
#[derive(Default)]
struct Kept {
    /// Worlds by id: kind, and attempts in a real one that were answered, and that were sent.
    worlds: BTreeMap<String, (String, u64, u64)>,
    deleted: Vec<String>,
    /// Jobs by id.
    jobs: BTreeMap<String, Value>,
    /// Results of jobs that were seen to have ended.
    results: BTreeMap<String, Value>,
    /// What a request with a key made, by key.
    keys: BTreeMap<String, (Value, String)>,
    acknowledged: u64,
    /// One that can be carried out, and counts.
    action: Value,
}

/// Works until the server is gone. Everything that is answered is written down.
fn work(mut way: Way, name: &str, draws: &mut impl rand::Rng, kept: &Mutex<Kept>) {
    let mut own = Vec::new();
    for turn in 0.. {
        let done = match draws.random_range(0..6) {
            0 | 1 => {
                make_world(&mut way, &format!("{name}-{turn}"), draws.random_range(0..2), &mut own, kept)
            }
            2 | 3 => attempt(&mut way, &own, draws.random_range(0..1000), kept),
            4 => delete_world(&mut way, &mut own, draws.random_range(0..1000), kept),
            _ => make_job(&mut way, draws.random_range(0..1000), kept),
        };
        let Some(acknowledged) = done else { return };
        kept.lock().unwrap().acknowledged += u64::from(acknowledged);
    }
}

fn make_world(
    way: &mut Way,
    key: &str,
    kind: usize,
    own: &mut Vec<String>,
    kept: &Mutex<Kept>,
) -> Option<bool> {
    let kind = ["sim", "real"][kind];
    let args = json!({"task": "bowling:003", "kind": kind, "seed": own.len()});
    let ask = Ask {
        op: "create_world",
        method: "POST",
        path: "/v1/worlds".into(),
        args: args.clone(),
        key: Some(key),
    };
    let (status, made) = way.ask(&ask)?;
    if status == 429 {
        // No room for more worlds.
        return Some(false);
    }
    assert!(status < 300, "{made}");
    let id = made["id"].as_str().unwrap().to_string();
    let mut kept = kept.lock().unwrap();
    kept.worlds.insert(id.clone(), (kind.into(), 0, 0));
    kept.keys.insert(key.into(), (args, id.clone()));
    own.push(id);
    Some(true)
}

fn attempt(way: &mut Way, own: &[String], which: usize, kept: &Mutex<Kept>) -> Option<bool> {
    if own.is_empty() {
        return Some(false);
    }
    let id = &own[which % own.len()];
    let action = {
        let mut kept = kept.lock().unwrap();
        kept.worlds.get_mut(id).unwrap().2 += 1;
        kept.action.clone()
    };
    let args = json!({"id": id, "task": "bowling:003", "actions": [action]});
    let path = format!("/v1/worlds/{id}/rollout");
    let (status, told) = way.ask(&Ask { op: "rollout_world", method: "POST", path, args, key: None })?;
    assert!(status < 300, "{told}");
    kept.lock().unwrap().worlds.get_mut(id).unwrap().1 += 1;
    Some(true)
}

fn delete_world(way: &mut Way, own: &mut Vec<String>, which: usize, kept: &Mutex<Kept>) -> Option<bool> {
    if own.len() < 3 {
        return Some(false);
    }
    let id = own.swap_remove(which % own.len());
    // Until it is answered, it may be there or not.
    kept.lock().unwrap().worlds.remove(&id);
    kept.lock().unwrap().keys.retain(|_, (_, made)| *made != id);
    let (args, path) = (json!({"id": id}), format!("/v1/worlds/{id}"));
    let (status, told) = way.ask(&Ask { op: "delete_world", method: "DELETE", path, args, key: None })?;
    assert!(status < 300, "{told}");
    kept.lock().unwrap().deleted.push(id);
    Some(true)
}

fn make_job(way: &mut Way, seed: usize, kept: &Mutex<Kept>) -> Option<bool> {
    let args = json!({"task": "basketball", "rounds": 1, "actions": 2, "samples": 4, "seed": seed});
    let ask = Ask { op: "start_iplw", method: "POST", path: "/v1/iplw".into(), args, key: None };
    let (status, made) = way.ask(&ask)?;
    if status == 429 {
        // No room for more jobs.
        std::thread::sleep(Duration::from_millis(5));
        return Some(false);
    }
    assert!(status < 300, "{made}");
    kept.lock().unwrap().jobs.insert(made["id"].as_str().unwrap().into(), made["config"].clone());
    Some(true)
}

/// Errors unless all that was acknowledged is there.
fn look(server: &Server, kept: &mut Kept) {
    let mut ways = [Way::Http(client(), server.http.clone()), Way::Zmq(Peer::connect(&server.zmq, None))];
    let mut get = |turn: usize, op: &str, kind: &str, id: &str| {
        let (args, path) = (json!({"id": id}), format!("/v1/{kind}/{id}"));
        ways[turn % 2].ask(&Ask { op, method: "GET", path, args, key: None }).expect("it answers")
    };
    for (turn, (id, (kind, answered, sent))) in kept.worlds.iter().enumerate() {
        let (status, world) = get(turn, "get_world", "worlds", id);
        assert_eq!((status, world["kind"].as_str()), (200, Some(kind.as_str())), "{id}: {world}");
        // What a simulated world has seen is written down every second.
        if kind == "real" {
            let counted = world["interactions"].as_u64().unwrap();
            assert!((*answered..=*sent).contains(&counted), "{id}: {counted} of {answered} to {sent}");
        }
    }
    for (turn, id) in kept.deleted.iter().enumerate() {
        assert_eq!(get(turn, "get_world", "worlds", id).0, 404, "{id}");
    }
    for (turn, (id, config)) in kept.jobs.iter().enumerate() {
        let (status, job) = get(turn, "get_job", "jobs", id);
        assert_eq!((status, &job["config"]), (200, config), "{id}: {job}");
        // A job that ends every server, as far as the server can tell, says so.
        let given_up = job["error"]["detail"].as_str().unwrap_or_default().contains("the server ended");
        assert!(job["state"] != "failed" || given_up, "{job}");
        if let Some(result) = kept.results.get(id) {
            assert_eq!(&job["result"], result, "{id}: what was seen stays");
        } else if job["state"] == "succeeded" {
            kept.results.insert(id.clone(), job["result"].clone());
        }
    }
    for (key, (args, made)) in &kept.keys {
        // A key is known where it was given.
        let way = usize::from(key.starts_with("zmq"));
        let path = "/v1/worlds".into();
        let ask = Ask { op: "create_world", method: "POST", path, args: args.clone(), key: Some(key) };
        let (status, again) = ways[way].ask(&ask).expect("it answers");
        assert!(status < 300 && again["id"] == made.as_str(), "{key}: {made} {again}");
    }
}

/// Waits until every job has ended.
fn ended(server: &Server, kept: &Kept) {
    let client = client();
    for id in kept.jobs.keys() {
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

fn killed(kills: usize) {
    let directory = tempfile::tempdir().unwrap();
    let kept = Mutex::new(Kept::default());
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
            kept.lock().unwrap().action = task["certificate"]["action"].clone();
        }
        look(&server, &mut kept.lock().unwrap());
        let pause = Duration::from_secs_f64(draws.random_range(0.005..0.8));
        std::thread::scope(|scope| {
            for i in 0..2 {
                for (name, way) in [
                    ("http", Way::Http(client(), server.http.clone())),
                    ("zmq", Way::Zmq(Peer::connect(&server.zmq, None))),
                ] {
                    let (name, kept) = (format!("{name}-{kill}-{i}"), &kept);
                    scope.spawn(move || {
                        let mut draws = rng::stream(kill as u64, &name);
                        work(way, &name, &mut draws, kept);
                    });
                }
            }
            std::thread::sleep(pause);
            server.kill();
        });
    }
    let server = Server::start(directory.path()).unwrap();
    let mut kept = kept.into_inner().unwrap();
    look(&server, &mut kept);
    ended(&server, &kept);
    look(&server, &mut kept);
    println!(
        "{kills} kills: {} acknowledged, of which there are {} worlds, {} deletions, {} jobs, {} results, {} keys; \
         lost 0; starts that failed {}",
        kept.acknowledged,
        kept.worlds.len(),
        kept.deleted.len(),
        kept.jobs.len(),
        kept.results.len(),
        kept.keys.len(),
        failed.len()
    );
    assert!(failed.is_empty(), "{failed:?}");
    assert!(kept.acknowledged > 0 && !kept.worlds.is_empty(), "nothing was asked for");
}

#[test]
fn what_was_acknowledged_is_there_after_a_kill() {
    killed(5);
}

#[test]
#[ignore = "long: `make kill`"]
fn what_was_acknowledged_is_there_after_a_hundred_kills() {
    killed(100);
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
