//! Limits of requests: cost, deadlines, and slow clients.

use std::io::{Read, Write};
use std::net::TcpStream;
use std::time::{Duration, Instant};

use iplw::serve::{Limits, ServeConfig};
use reqwest::Method;
use serde_json::{Value, json};

use crate::http::{Running, ok, problem};
use crate::peer::Peer;

fn limited(limits: Limits) -> Running {
    let zmq = Some("tcp://127.0.0.1:*".into());
    Running::with(ServeConfig { limits, zmq, ..ServeConfig::default() }).unwrap()
}

/// Boxes on a floor, beside a ball that bounces for ever: with sixty boxes and a million steps about a minute of CPU time.
fn long(bodies: usize, steps: u32) -> Value {
    let pile = (0..bodies).map(|i| {
        json!({
            "name": format!("b{i}"),
            "shape": {"type": "box", "half_width": 0.2, "half_height": 0.2},
            "position": [0.45 * (i % 10) as f64, 0.3 + 0.45 * (i / 10) as f64],
        })
    });
    let mut pile: Vec<Value> = pile.collect();
    pile.push(json!({"name": "ball", "shape": {"type": "disc", "radius": 0.1}, "restitution": 1.0}));
    json!({
        "format": "iplw.scene/1",
        "bodies": pile,
        "statics": [{"name": "floor", "shape": {"type": "halfspace", "normal": [0, 1], "offset": 0}, "restitution": 1.0}],
        "goal": {"type": "contact", "bodies": ["ball", "b0"], "hold_s": 3.0},
        "gravity": [0, -9.8],
        "time_step": 0.01,
        "steps": steps,
        "observe_every": 10_000,
        "action": {"components": [{"target": "ball", "set": "x", "low": 8.0, "high": 9.0}, {"target": "ball", "set": "y", "low": 1.0, "high": 2.0}]},
    })
}

/// A world with such a scene, reset.
fn world(server: &Running, kind: &str) -> String {
    let made = server.post("/v1/worlds", &json!({"scene": long(60, 800_000), "kind": kind}), 201);
    let id = made["id"].as_str().unwrap().to_string();
    server.post(&format!("/v1/worlds/{id}/reset"), &json!({}), 200);
    id
}

const STEP: &str = "{\"action\": [0.5, 0.5]}";

fn interactions(server: &Running, world: &str) -> u64 {
    server.get(&format!("/v1/worlds/{world}"))["interactions"].as_u64().unwrap()
}

/// Waits until the world's attempt is counted and returns the time it took.
fn wait_for_attempt(server: &Running, world: &str) -> Duration {
    let begun = Instant::now();
    while interactions(server, world) == 0 {
        assert!(begun.elapsed().as_secs() < 20, "it goes on though nobody waits for it");
        std::thread::sleep(Duration::from_millis(5));
    }
    begun.elapsed()
}

/// About 0.1 s on an idle machine (see benches/hold.py); longer here, since tests run in parallel.
const SOON: Duration = Duration::from_millis(1500);

#[test]
fn steps_stop_at_their_deadline_over_both_transports() {
    let server = limited(Limits { request_seconds: 5.0, ..Limits::default() });
    let id = world(&server, "sim");
    let step = |deadline: &str| {
        let request = server.client.post(format!("{}/v1/worlds/{id}/step", server.url));
        request.header("X-Deadline", deadline).body(STEP).send().unwrap()
    };
    let begun = Instant::now();
    let refused = problem(step("0.3"), 503, "deadline");
    let took = begun.elapsed();
    assert!(took >= Duration::from_millis(300) && took < Duration::from_millis(300) + SOON, "{took:?}");
    assert!(refused["detail"].as_str().unwrap().contains("0.3 s"), "{refused}");
    assert_eq!(interactions(&server, &id), 0, "nothing was done in the simulation");
    for bad in ["0", "-1", "6", "soon", "NaN"] {
        let refused = problem(step(bad), 422, "invalid-value");
        assert_eq!(refused["field"], "X-Deadline");
        assert!(refused["allowed"].as_str().unwrap().contains("to 5"), "{refused}");
    }
    let mut peer = Peer::connect(server.zmq.as_ref().unwrap(), None);
    let begun = Instant::now();
    let answer = peer.ask_within("step_world", &json!({"id": id, "action": [0.5, 0.5]}), Some(0.3));
    assert_eq!(answer["problem"]["status"], 503, "{answer}");
    assert!(begun.elapsed() < Duration::from_millis(300) + SOON);
    let many = json!({"worlds": [id], "actions": [[0.5, 0.5]]});
    assert_eq!(peer.ask_within("step_worlds", &many, Some(0.3))["problem"]["status"], 503);
    let answer = peer.ask_within("step_world", &json!({"id": id, "action": [0.5, 0.5]}), Some(99.0));
    assert_eq!(answer["problem"]["field"], "deadline", "{answer}");
    let batch = json!({"actions": [[0.5, 0.5]]}).to_string();
    let request = server.client.post(format!("{}/v1/worlds/{id}/rollout", server.url));
    problem(request.header("X-Deadline", "0.2").body(batch).send().unwrap(), 503, "deadline");
}

/// The CPU is free soon after, and a started real interaction counts.
#[test]
fn cancels_simulations_of_disconnected_clients() {
    let server = limited(Limits::default());
    let id = world(&server, "real");
    let mut stream = TcpStream::connect(server.url.strip_prefix("http://").unwrap()).unwrap();
    let head = format!(
        "POST /v1/worlds/{id}/step HTTP/1.1\r\nHost: localhost\r\nContent-Length: {}\r\n\r\n",
        STEP.len()
    );
    stream.write_all(format!("{head}{STEP}").as_bytes()).unwrap();
    std::thread::sleep(Duration::from_millis(300));
    assert_eq!(interactions(&server, &id), 0, "it is under way");
    drop(stream);
    let took = wait_for_attempt(&server, &id);
    assert!(took < SOON, "{took:?}");

    let id = world(&server, "real");
    let mut peer = Peer::connect(server.zmq.as_ref().unwrap(), None);
    let head = json!({"v": 1, "id": 1, "op": "step_world", "args": {"id": id, "action": [0.5, 0.5]}});
    peer.send(&rmp_serde::to_vec_named(&head).unwrap());
    std::thread::sleep(Duration::from_millis(300));
    assert_eq!(interactions(&server, &id), 0, "it is under way");
    drop(peer);
    let took = wait_for_attempt(&server, &id);
    assert!(took < SOON, "{took:?}");

    // Pipelined requests without simulation are still handled.
    let id = world(&server, "sim");
    let mut peer = Peer::connect(server.zmq.as_ref().unwrap(), None);
    for (n, (op, args)) in
        [("step_world", json!({"id": id, "action": [0.5, 0.5]})), ("delete_world", json!({"id": id}))]
            .iter()
            .enumerate()
    {
        let head = json!({"v": 1, "id": n, "op": op, "args": args});
        peer.send(&rmp_serde::to_vec_named(&head).unwrap());
    }
    std::thread::sleep(Duration::from_millis(200));
    drop(peer);
    let begun = Instant::now();
    while server.send(Method::GET, &format!("/v1/worlds/{id}"), "").status() != 404 {
        assert!(begun.elapsed() < SOON, "the last wish of a client is carried out");
        std::thread::sleep(Duration::from_millis(5));
    }
}

#[test]
fn rejects_expensive_requests_stating_the_limit() {
    let server = limited(Limits { body_steps: 50_000, actions: 3, ..Limits::default() });
    let refused =
        server.send(Method::POST, "/v1/worlds", json!({"scene": long(60, 1_000), "kind": "sim"}).to_string());
    let refused = problem(refused, 413, "too-large");
    let detail = refused["detail"].as_str().unwrap();
    assert!(detail.contains("120000 requested, at most 50000"), "{detail}");
    let many = json!({"task": "bowling:000", "actions": [1, 2, 3, 4]}).to_string();
    let refused =
        problem(server.send(Method::POST, "/v1/worlds/bowling-sim/rollout", many), 413, "too-large");
    assert!(refused["detail"].as_str().unwrap().contains("at most 3"), "{refused}");
    // Work too large for a request can run as a job.
    let limits = Limits { body_steps: 50_000, ..Limits::default() };
    let small = limited(limits);
    let made = small.post("/v1/worlds", &json!({"scene": long(8, 5_000), "kind": "sim"}), 201);
    let world = made["id"].as_str().unwrap();
    let task = small.post(&format!("/v1/worlds/{world}/reset"), &json!({}), 200)["info"]["task"].clone();
    let two = json!({"actions": [[0.5, 0.5], [0.2, 0.5]]});
    let path = format!("/v1/worlds/{world}/rollout");
    let refused = problem(small.send(Method::POST, &path, two.to_string()), 413, "too-large");
    let how = refused["detail"].as_str().unwrap();
    assert!(how.contains("100000 requested, at most 50000") && how.contains("ranked/evaluate"), "{how}");
    let tried = json!({"world": world, "ranking": [{"task": task, "actions": two["actions"]}]});
    let job = small.finish(&small.post("/v1/policies/ranked/evaluate", &tried, 202));
    assert_eq!(job["state"], "succeeded", "{job}");
    let shown = server.get("/v1/limits");
    assert_eq!((&shown["body_steps"], &shown["actions"]), (&json!(50_000), &json!(3)));
    assert_eq!(
        shown.as_object().unwrap().len(),
        serde_json::to_value(Limits::default()).unwrap().as_object().unwrap().len()
    );
}

fn connect(server: &Running) -> TcpStream {
    let stream = TcpStream::connect(server.url.strip_prefix("http://").unwrap()).unwrap();
    stream.set_read_timeout(Some(Duration::from_secs(20))).unwrap();
    stream
}

/// Everything received until the server disconnects.
fn read_to_end(stream: &mut TcpStream) -> String {
    let mut all = Vec::new();
    // A reset while sending counts as a disconnect.
    let _ = stream.read_to_end(&mut all);
    String::from_utf8_lossy(&all).into_owned()
}

#[test]
fn disconnects_slow_clients_and_serves_others() {
    let limits = Limits { header_seconds: 1.0, body_seconds: 1.0, idle_seconds: 2.0, ..Limits::default() };
    let server = limited(limits);
    let mut half: Vec<TcpStream> = (0..100).map(|_| connect(&server)).collect();
    for stream in &mut half {
        stream.write_all(b"GET /v1/worlds HTTP/1.1\r\nHost: local").unwrap();
    }
    let mut silent = connect(&server);
    let mut body = connect(&server);
    body.write_all(b"POST /v1/worlds HTTP/1.1\r\nHost: localhost\r\nContent-Length: 100\r\n\r\n{").unwrap();
    let mut kept = connect(&server);
    let ask = b"GET /healthz HTTP/1.1\r\nHost: localhost\r\n\r\n";
    let begun = Instant::now();
    for _ in 0..3 {
        kept.write_all(ask).unwrap();
        let mut answer = [0; 4096];
        let length = kept.read(&mut answer).unwrap();
        assert!(answer[..length].starts_with(b"HTTP/1.1 200 OK") && answer[..length].ends_with(b"}"));
        std::thread::sleep(Duration::from_millis(500));
    }
    for stream in &mut half {
        let said = read_to_end(stream);
        assert!(said.is_empty() || said.starts_with("HTTP/1.1 4"), "{said}");
    }
    assert_eq!(read_to_end(&mut silent), "");
    assert!(begun.elapsed() < Duration::from_secs(8), "{:?}", begun.elapsed());
    let said = read_to_end(&mut body);
    assert!(said.starts_with("HTTP/1.1 408") && said.contains("problems/slow"), "{said}");
    // Keep-alive after a request, with a time limit.
    let mut kept = connect(&server);
    let asked = Instant::now();
    kept.write_all(ask).unwrap();
    read_to_end(&mut kept);
    assert!(asked.elapsed() > Duration::from_millis(1900) && asked.elapsed() < Duration::from_secs(8));
}

#[test]
fn excess_connections_replace_idle_ones() {
    let server = limited(Limits { connections: 8, ..Limits::default() });
    let mut waiting: Vec<TcpStream> = (0..8).map(|_| connect(&server)).collect();
    std::thread::sleep(Duration::from_millis(200));
    for _ in 0..3 {
        let mut one = connect(&server);
        one.write_all(b"GET /healthz HTTP/1.1\r\nHost: localhost\r\nConnection: close\r\n\r\n").unwrap();
        assert!(read_to_end(&mut one).starts_with("HTTP/1.1 200"));
    }
    assert_eq!(read_to_end(&mut waiting[0]), "", "the one that waited longest");
    waiting[7].write_all(b"GET /healthz HTTP/1.1\r\nHost: localhost\r\nConnection: close\r\n\r\n").unwrap();
    assert!(read_to_end(&mut waiting[7]).starts_with("HTTP/1.1 200"), "the youngest is still there");
}

#[test]
fn stops_jobs_at_their_time_limit() {
    let server = limited(Limits { job_seconds: Some(1.0), ..Limits::default() });
    let much = json!({"task": "bowling", "rounds": 50, "actions": 50, "samples": 5000});
    let job = server.finish(&server.post("/v1/iplw", &much, 202));
    assert_eq!((&job["state"], &job["error"]["status"]), (&json!("failed"), &json!(503)), "{job}");
    assert!(job["error"]["type"].as_str().unwrap().ends_with("/deadline"));
    // Waiting for trials has no limit.
    let asks = json!({"task": "bowling", "real": "ask_tell", "rounds": 1, "actions": 2, "samples": 8});
    let id = server.post("/v1/iplw", &asks, 202)["id"].as_str().unwrap().to_string();
    std::thread::sleep(Duration::from_millis(2500));
    assert_eq!(server.get(&format!("/v1/jobs/{id}"))["state"], "waiting");
    ok(server.send(Method::DELETE, &format!("/v1/jobs/{id}"), ""), 202);
}
