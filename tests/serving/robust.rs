//! Faults that an attack on the server found, as classes: each test goes through all cases of its class.

use std::io::{BufRead, BufReader, Read, Write};
use std::net::TcpStream;
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

use iplw::access::{Scope, TokenFile};
use iplw::serve::{Limits, ServeConfig};
use iplw::task::families;
use reqwest::Method;
use reqwest::blocking::Response;
use serde_json::{Value, json};

use crate::http::{Running, ok, problem};
use crate::tokens::{self, stored_token, token};

/// ann and bob may act, eve may read, root is admin.
fn start(directory: &Path, limits: Limits) -> Running {
    let all = [("ann", Scope::Act), ("bob", Scope::Act), ("eve", Scope::Read), ("root", Scope::Admin)];
    let all = all.map(|(name, scope)| stored_token(name, scope, None));
    tokens::start_with(directory, all.into(), ServeConfig { limits, ..ServeConfig::default() })
}

fn send(server: &Running, who: &str, method: Method, path: &str, body: &Value) -> Response {
    let request = server.client.request(method, format!("{}{path}", server.url)).bearer_auth(token(who));
    request.body(body.to_string()).send().unwrap()
}

fn post(server: &Running, who: &str, path: &str, body: &Value) -> Value {
    let response = send(server, who, Method::POST, path, body);
    let status = response.status().as_u16();
    assert!([200, 201, 202].contains(&status), "{path}: {}", response.text().unwrap());
    ok(response, status)
}

fn get(server: &Running, who: &str, path: &str) -> Value {
    ok(send(server, who, Method::GET, path, &json!({})), 200)
}

fn interactions(server: &Running, world: &str) -> u64 {
    get(server, "root", &format!("/v1/worlds/{world}"))["interactions"].as_u64().unwrap()
}

/// Makes one valid attempt in a world.
fn attempt(server: &Running, who: &str, world: &str) {
    let body = json!({"task": null, "actions": (0..64).collect::<Vec<u32>>(), "trajectories": false});
    post(server, who, &format!("/v1/worlds/{world}/reset"), &json!({}));
    let results = post(server, who, &format!("/v1/worlds/{world}/rollout"), &body);
    assert!(results["results"].as_array().unwrap().iter().any(|r| r["valid"] == true));
}

#[test]
fn attempts_in_a_copy_of_a_shared_real_world_count_there() {
    let place = tempfile::tempdir().unwrap();
    let server = start(place.path(), Limits::default());
    for family in families().iter().map(|f| f.name) {
        let shared = format!("{family}-real");
        let refused = json!({"task": family, "kind": "real", "sealed": false});
        let response = send(&server, "ann", Method::POST, "/v1/worlds", &refused);
        assert_eq!(response.status(), 422, "{family}: physics of the family is hidden");
        // Complete, or with a part of its own: neither learns about the hidden rest for nothing.
        for own in [json!({}), json!({"noise": 0.001, "budget": 1000}), json!({"latents": {"friction": 0.3}})]
        {
            let mut body = json!({"task": family, "kind": "real"});
            own.as_object().unwrap().iter().for_each(|(k, v)| body[k] = v.clone());
            let copy = post(&server, "ann", "/v1/worlds", &body)["id"].as_str().unwrap().to_string();
            let before = interactions(&server, &shared);
            attempt(&server, "ann", &copy);
            let made = interactions(&server, &copy);
            assert!(made > 0 && interactions(&server, &shared) == before + made, "{family}: {body}");
        }
        let own = json!({"task": family, "kind": "real", "sealed": false, "effects": [],
            "latents": {"mass": 1.0, "friction": 0.3, "restitution": 0.4}});
        let own = post(&server, "ann", "/v1/worlds", &own)["id"].as_str().unwrap().to_string();
        let before = interactions(&server, &shared);
        attempt(&server, "ann", &own);
        assert_eq!(interactions(&server, &shared), before, "{family}: another world");
    }
    // Also over a restart, and in worlds that one request makes.
    let many = json!({"task": "bowling", "kind": "real", "count": 2, "seed": 5});
    let copy = post(&server, "ann", "/v1/batch/worlds", &many)["worlds"][0].as_str().unwrap().to_string();
    let before = interactions(&server, "bowling-real");
    attempt(&server, "ann", &copy);
    let made = interactions(&server, &copy);
    drop(server);
    let server = Running::with(ServeConfig { data_dir: Some(place.path().into()), ..ServeConfig::default() });
    let server = server.unwrap();
    assert_eq!(interactions(&server, "bowling-real"), before + made);
    attempt(&server, "ann", &copy);
    assert_eq!(interactions(&server, "bowling-real"), before + made + interactions(&server, &copy) - made);
}

#[test]
fn attempts_of_an_estimation_count_in_the_shared_real_world() {
    let place = tempfile::tempdir().unwrap();
    let server = start(place.path(), Limits::default());
    let body = json!({"task": "bowling", "rounds": 1, "actions": 4, "strategy": "random"});
    let job = post(&server, "ann", "/v1/iplw", &body);
    let end = wait(&server, "ann", &job);
    assert_eq!(end["state"], "succeeded", "{end}");
    assert!(interactions(&server, "bowling-real") > 0);
}

/// Waits for the end of a job.
fn wait(server: &Running, who: &str, job: &Value) -> Value {
    let path = format!("/v1/jobs/{}", job["id"].as_str().unwrap());
    let deadline = Instant::now() + Duration::from_secs(60);
    loop {
        let job = get(server, who, &path);
        if ["succeeded", "failed", "cancelled"].contains(&job["state"].as_str().unwrap()) {
            return job;
        }
        assert!(Instant::now() < deadline, "{job}");
        std::thread::sleep(Duration::from_millis(20));
    }
}

#[test]
fn physics_of_a_clients_own_real_world_is_its_owners() {
    let place = tempfile::tempdir().unwrap();
    let server = start(place.path(), Limits::default());
    let number = 0.731_264_981;
    let own = json!({"task": "bowling", "kind": "real", "sealed": false, "effects": [],
        "latents": {"mass": 1.0, "friction": number, "restitution": 0.4}});
    let world = post(&server, "ann", "/v1/worlds", &own)["id"].as_str().unwrap().to_string();
    let body = json!({"task": "bowling", "rounds": 1, "actions": 1, "strategy": "random",
        "real": {"latents": {"friction": number}, "damping": 0.123_456_789}});
    let job = post(&server, "ann", "/v1/iplw", &body);
    wait(&server, "ann", &job);
    let id = job["id"].as_str().unwrap();
    let paths = [
        format!("/v1/worlds/{world}"),
        "/v1/worlds?limit=1000".into(),
        format!("/v1/jobs/{id}"),
        "/v1/jobs".into(),
    ];
    for path in &paths {
        let shown = |who: &str| get(&server, who, path).to_string();
        assert!(!shown("eve").contains("731264981") && !shown("eve").contains("123456789"), "{path}");
        assert!(shown("ann").contains("731264981") && shown("root").contains("731264981"), "{path}");
    }
    for path in [format!("/v1/worlds/{world}/events"), format!("/v1/jobs/{id}/events")] {
        let mut events = String::new();
        let response = send(&server, "eve", Method::GET, &path, &json!({}));
        let mut lines = BufReader::new(response).lines();
        while !events.contains("data:") {
            events += &lines.next().unwrap().unwrap();
        }
        assert!(!events.contains("731264981"), "{path}: {events}");
    }
}

#[test]
fn head_is_no_operation() {
    let place = tempfile::tempdir().unwrap();
    let server = start(place.path(), Limits::default());
    let document: Value = serde_json::from_str(&iplw::serve::openapi()).unwrap();
    for path in document["paths"].as_object().unwrap().keys() {
        let address = path.replace("{id}", "bowling-real").replace("{number}", "1").replace("{index}", "0");
        let response = send(&server, "root", Method::HEAD, &format!("{address}?action=3"), &json!({}));
        assert_eq!(response.status(), 405, "{path}");
    }
    assert_eq!(interactions(&server, "bowling-real"), 0);
}

#[test]
fn streams_end_with_their_token() {
    let place = tempfile::tempdir().unwrap();
    let server = start(place.path(), Limits::default());
    let streams: Vec<_> = [("ann", true), ("bob", false)]
        .into_iter()
        .map(|(who, over_http)| {
            let response = send(&server, who, Method::GET, "/v1/worlds/bowling-sim/events", &json!({}));
            let mut reader = BufReader::new(response);
            let mut first = String::new();
            reader.read_line(&mut first).unwrap();
            if over_http {
                send(&server, "root", Method::DELETE, &format!("/v1/tokens/{who}"), &json!({}));
            } else {
                TokenFile::of_directory(place.path()).revoke(who).unwrap();
            }
            let revoked = Instant::now();
            let end = std::thread::spawn(move || {
                let mut rest = Vec::new();
                let _ = reader.read_to_end(&mut rest);
                revoked.elapsed()
            });
            (who, end)
        })
        .collect();
    for (who, end) in streams {
        let lived = end.join().unwrap();
        assert!(lived < Duration::from_secs(1), "{who}'s stream lived for {lived:?}");
    }
}

/// The status of a request written by hand.
fn raw_status(server: &Running, head: &str) -> String {
    let mut stream = TcpStream::connect(server.url.strip_prefix("http://").unwrap()).unwrap();
    stream.write_all(head.as_bytes()).unwrap();
    let mut answer = [0; 12];
    stream.read_exact(&mut answer).unwrap();
    String::from_utf8(answer.to_vec()).unwrap()
}

#[test]
fn ambiguous_heads_are_refused() {
    let place = tempfile::tempdir().unwrap();
    let server = start(place.path(), Limits::default());
    let host = "Host: localhost\r\n";
    let bearer = |who: &str| format!("Authorization: Bearer {}\r\n", token(who));
    let request = |headers: &str| raw_status(&server, &format!("GET /v1/limits HTTP/1.1\r\n{headers}\r\n"));
    assert_eq!(request(&format!("{host}{}", bearer("eve"))), "HTTP/1.1 200");
    assert_eq!(request(&bearer("eve")), "HTTP/1.1 400");
    assert_eq!(request(&format!("{host}{host}{}", bearer("eve"))), "HTTP/1.1 400");
    assert_eq!(request(&format!("{host}{}{}", bearer("eve"), bearer("root"))), "HTTP/1.1 400");
    let coding = "Transfer-Encoding: gzip, chunked\r\n";
    let post = format!("POST /v1/worlds HTTP/1.1\r\n{host}{}{coding}\r\n0\r\n\r\n", bearer("ann"));
    assert_eq!(raw_status(&server, &post), "HTTP/1.1 400");
    let endless = format!("GET /v1/limits HTTP/1.1\r\n{host}X-Long: {}\r\n\r\n", "x".repeat(64 * 1024));
    assert_eq!(raw_status(&server, &endless), "HTTP/1.1 431");
}

#[test]
fn quotas_of_one_owner_leave_room_for_others() {
    let place = tempfile::tempdir().unwrap();
    let limits = Limits { owner_worlds: 3, owner_jobs: 2, jobs_running: 1, ..Limits::default() };
    let server = start(place.path(), limits);
    let world = json!({"task": "bowling"});
    (0..3).for_each(|_| drop(post(&server, "ann", "/v1/worlds", &world)));
    problem(send(&server, "ann", Method::POST, "/v1/worlds", &world), 429, "capacity");
    let many = json!({"task": "bowling", "count": 4});
    problem(send(&server, "bob", Method::POST, "/v1/batch/worlds", &many), 429, "capacity");
    post(&server, "bob", "/v1/worlds", &world);
    // Jobs without end: one of ann's runs, two wait, and bob's first runs beside it.
    let endless = json!({"task": "bowling", "rounds": 100, "actions": 1000, "strategy": "random"});
    let state = |who: &str, job: &Value| {
        get(&server, who, &format!("/v1/jobs/{}", job["id"].as_str().unwrap()))["state"].clone()
    };
    let first = post(&server, "ann", "/v1/iplw", &endless);
    let reach = |who: &str, job: &Value| {
        let deadline = Instant::now() + Duration::from_secs(30);
        while state(who, job) != "running" {
            assert!(Instant::now() < deadline, "{}", state(who, job));
            std::thread::sleep(Duration::from_millis(10));
        }
    };
    reach("ann", &first);
    let second = post(&server, "ann", "/v1/iplw", &endless);
    post(&server, "ann", "/v1/iplw", &endless);
    problem(send(&server, "ann", Method::POST, "/v1/iplw", &endless), 429, "capacity");
    let other = post(&server, "bob", "/v1/iplw", &endless);
    reach("bob", &other);
    assert_eq!(state("ann", &second), "queued");
}

#[test]
fn unfinished_messages_are_bounded_in_time_and_bytes() {
    let place = tempfile::tempdir().unwrap();
    let limits = Limits {
        body_seconds: 0.5,
        idle_seconds: 0.5,
        client_body_bytes: 16 << 20,
        body_bytes: 16 << 20,
        ..Limits::default()
    };
    let server = start(place.path(), limits);
    let address = server.zmq.clone().unwrap();
    let closed = |mut peer: crate::peer::Peer| {
        let begun = Instant::now();
        let mut rest = Vec::new();
        let _ = peer.0.read_to_end(&mut rest);
        begun.elapsed()
    };
    let connect = || crate::peer::Peer::connect(&address, Some(&token("eve")));
    let silent = closed(connect());
    assert!(silent < Duration::from_secs(5), "{silent:?}");
    let mut half = connect();
    half.0.write_all(&[&[2][..], &1000u64.to_be_bytes(), b"half"].concat()).unwrap();
    let half = closed(half);
    assert!(half < Duration::from_secs(5), "{half:?}");
    // Two messages of 12 MB do not fit into 16 MiB together.
    let part = vec![0; 10 << 20];
    let mut peers: Vec<_> = (0..2).map(|_| connect()).collect();
    let mut sent = 0;
    for peer in &mut peers {
        let head = [&[2][..], &(12u64 << 20).to_be_bytes()].concat();
        let whole = peer.0.write_all(&[&head, &part[..]].concat());
        sent += usize::from(whole.is_ok());
    }
    assert!(sent >= 1);
    let begun = Instant::now();
    assert!(
        peers.into_iter().map(closed).any(|lived| lived < Duration::from_secs(5)),
        "{:?}",
        begun.elapsed()
    );
    drop(server);
}

/// A server process, killed on drop.
struct Process(Child);

impl Drop for Process {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

#[test]
#[cfg(unix)]
fn hangup_reads_tokens_and_limits_anew() {
    let place = tempfile::tempdir().unwrap();
    let file = place.path().join("limits.json");
    std::fs::write(&file, "{\"worlds\": 100}").unwrap();
    let mut child = Command::new(env!("CARGO_BIN_EXE_iplw"))
        .args(["serve", "--http", "127.0.0.1:0", "--log", "json", "--limits"])
        .arg(&file)
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    let mut line = String::new();
    BufReader::new(child.stdout.take().unwrap()).read_line(&mut line).unwrap();
    let url = line.trim().strip_prefix("listening on ").unwrap().to_string();
    let mut log = BufReader::new(child.stderr.take().unwrap()).lines();
    let server = Process(child);
    let worlds = || -> Value {
        reqwest::blocking::get(format!("{url}/v1/limits")).unwrap().json::<Value>().unwrap()["worlds"].clone()
    };
    let mut hang_up = |limits: &str| -> String {
        std::fs::write(&file, limits).unwrap();
        let pid = server.0.id().to_string();
        assert!(Command::new("kill").args(["-HUP", &pid]).status().unwrap().success());
        let mut events = log.by_ref().map(|line| {
            // Every line is JSON, those of the program's events, too.
            serde_json::from_str::<Value>(&line.unwrap()).unwrap()
        });
        let event = events.find(|event| event["event"] == "log").unwrap();
        event["message"].as_str().unwrap().to_string()
    };
    assert_eq!(worlds(), 100);
    assert!(hang_up("{\"worlds\": 200}").contains("were reloaded"));
    assert_eq!(worlds(), 200);
    assert!(hang_up("{\"worlds\": 1}").contains("cannot be reloaded"));
    assert_eq!(worlds(), 200);
}

#[test]
fn stored_bytes_of_one_owner_are_bounded() {
    let place = tempfile::tempdir().unwrap();
    let server = start(place.path(), Limits { owner_bytes: 1 << 20, ..Limits::default() });
    let corners: Vec<[f64; 2]> = (0..32)
        .map(|k| {
            let angle = std::f64::consts::TAU * f64::from(k) / 32.0;
            [0.1 * angle.cos(), 0.1 * angle.sin()]
        })
        .collect();
    let fixed: Vec<Value> = (0..100)
        .map(|i| {
            let shape = json!({"type": "polygon", "vertices": corners});
            json!({"name": format!("s{i}"), "shape": shape, "position": [f64::from(i), 0.0]})
        })
        .collect();
    let scene = json!({"format": "iplw.scene/1", "statics": fixed, "time_step": 0.01, "steps": 10,
        "bodies": [{"name": "ball", "shape": {"type": "disc", "radius": 0.1}}],
        "goal": {"type": "above", "body": "ball", "height": 1.0},
        "action": {"components": [{"target": "ball", "set": "x", "low": 0.0, "high": 9.0},
            {"target": "ball", "set": "y", "low": 1.0, "high": 9.0}]}});
    let make = |who: &str| send(&server, who, Method::POST, "/v1/worlds", &json!({"scene": scene}));
    let first = make("ann");
    assert_eq!(first.status(), 201, "{}", first.text().unwrap());
    let refused = (0..100).map(|_| make("ann")).find(|made| made.status() != 201).expect("a quota");
    problem(refused, 429, "capacity");
    assert_eq!(make("bob").status(), 201);
}
