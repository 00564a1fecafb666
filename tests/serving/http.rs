//! The server over real sockets: every endpoint, every kind of bad input, restart, locking, expiry.

use std::io::{BufRead, BufReader};
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::thread::JoinHandle;
use std::time::Duration;

use iplw::serve::{Limits, ServeConfig, Server};
use reqwest::Method;
use reqwest::blocking::{Client, Response};
use serde_json::{Value, json};

use crate::worlds;

/// An in-process server, stopped on drop.
pub struct Running {
    pub url: String,
    /// ZeroMQ address, if enabled.
    pub zmq: Option<String>,
    pub client: Client,
    stop: Option<tokio::sync::oneshot::Sender<()>>,
    thread: Option<JoinHandle<()>>,
}

impl Running {
    pub fn start() -> Running {
        Running::with(ServeConfig::default()).unwrap()
    }

    fn on(directory: &Path) -> iplw::error::Result<Running> {
        Running::with(ServeConfig { data_dir: Some(directory.into()), ..ServeConfig::default() })
    }

    pub fn with(config: ServeConfig) -> iplw::error::Result<Running> {
        let config = ServeConfig { http: "127.0.0.1:0".parse().unwrap(), ..config };
        let (told, address) = std::sync::mpsc::channel();
        let (stop, stopped) = tokio::sync::oneshot::channel();
        let thread = std::thread::spawn(move || {
            let runtime = tokio::runtime::Runtime::new().unwrap();
            runtime.block_on(async {
                match Server::bind(config).await {
                    Ok(server) => {
                        told.send(Ok((server.address(), server.zmq_address().map(String::from)))).unwrap();
                        let stop = async move { drop(stopped.await) };
                        server.run(stop).await.unwrap();
                    }
                    Err(e) => told.send(Err(e)).unwrap(),
                }
            });
        });
        let (address, zmq) = address.recv().unwrap()?;
        let url = format!("http://{address}");
        let client = Client::builder().timeout(Duration::from_secs(120)).build().unwrap();
        Ok(Running { url, zmq, client, stop: Some(stop), thread: Some(thread) })
    }

    pub fn send(&self, method: Method, path: &str, body: impl Into<reqwest::blocking::Body>) -> Response {
        self.client.request(method, format!("{}{path}", self.url)).body(body).send().unwrap()
    }

    pub fn get(&self, path: &str) -> Value {
        ok(self.send(Method::GET, path, ""), 200)
    }

    pub fn post(&self, path: &str, body: &Value, status: u16) -> Value {
        ok(self.send(Method::POST, path, body.to_string()), status)
    }

    /// Waits for a job's end by its events and returns the job.
    pub fn finish(&self, job: &Value) -> Value {
        let events = self.events(job["id"].as_str().unwrap(), None);
        let (_, name, last) = events.last().unwrap();
        assert_eq!(name, "done");
        last.clone()
    }

    /// (id, event, data) of every event after `seen`.
    fn events(&self, job: &str, seen: Option<u64>) -> Vec<(u64, String, Value)> {
        let mut request = self.client.get(format!("{}/v1/jobs/{job}/events", self.url));
        if let Some(seen) = seen {
            request = request.header("Last-Event-ID", seen.to_string());
        }
        let response = request.send().unwrap();
        if response.status() == 204 {
            return Vec::new();
        }
        assert_eq!(response.headers()["content-type"], "text/event-stream");
        let (mut events, mut id, mut name) = (Vec::new(), 0, String::new());
        for line in BufReader::new(response).lines() {
            let line = line.unwrap();
            match line.split_once(": ") {
                Some(("id", v)) => id = v.parse().unwrap(),
                Some(("event", v)) => name = v.into(),
                Some(("data", v)) => events.push((id, name.clone(), serde_json::from_str(v).unwrap())),
                _ => {}
            }
        }
        events
    }
}

impl Drop for Running {
    fn drop(&mut self) {
        drop(self.stop.take());
        // Shutdown waits for idle connections.
        self.client = Client::new();
        if let Some(thread) = self.thread.take() {
            let ended = thread.join();
            assert!(ended.is_ok() || std::thread::panicking(), "the server panicked");
        }
    }
}

/// The JSON of a response, which must have this status.
pub fn ok(response: Response, status: u16) -> Value {
    let (got, url) = (response.status().as_u16(), response.url().clone());
    let text = response.text().unwrap();
    assert_eq!(got, status, "{url}: {text}");
    serde_json::from_str(&text).unwrap()
}

/// Checks that a response is a problem of this status and kind, and returns it.
pub fn problem(response: Response, status: u16, slug: &str) -> Value {
    let kind = response.headers().get("content-type").map(|v| v.to_str().unwrap().to_string());
    let value = ok(response, status);
    assert_eq!(kind.as_deref(), Some("application/problem+json"), "{value}");
    assert_eq!(value["status"], status);
    assert_eq!(value["type"], format!("https://iplw.dev/problems/{slug}"), "{value}");
    assert!(value["title"].is_string() && value["detail"].is_string(), "{value}");
    value
}

/// Index of a task's first discrete action that can (or cannot) be placed.
fn action(server: &Running, task: &str, valid: bool) -> u64 {
    let body = json!({"task": task, "actions": (0..64).collect::<Vec<_>>()});
    let results = server.post("/v1/worlds/bowling-sim/rollout", &body, 200)["results"].clone();
    results.as_array().unwrap().iter().position(|r| r["valid"] == valid).unwrap() as u64
}

#[test]
fn default_worlds_play_whole_episodes() {
    let server = Running::start();
    let ready = |f: &&iplw::task::Family| ["sim", "real"].map(|kind| format!("{}-{kind}", f.name));
    for id in iplw::task::families().iter().flat_map(ready) {
        let world = server.get(&format!("/v1/worlds/{id}"));
        assert_eq!(world["id"], id);
        assert_eq!(world["state"], json!({"task": null, "phase": "new", "episodes": 0}));
        assert_eq!(world["sealed"], id.ends_with("real"));
        assert_eq!(world["latents"].is_null(), id.ends_with("real"));
        assert_eq!(world["effects"].is_null(), id.ends_with("real"));
        let names = world["observation_space"]["names"].as_array().unwrap().len();
        let start = server.post(&format!("/v1/worlds/{id}/reset"), &json!({"seed": 5}), 200);
        assert_eq!(start["observation"].as_array().unwrap().len(), names);
        assert_eq!(start["info"]["split"], "train");
        let task = &start["info"]["task"];
        let again = server.post(&format!("/v1/worlds/{id}/reset"), &json!({"seed": 5}), 200);
        let drawn = |v: &Value| (v["observation"].clone(), v["info"]["task"].clone());
        assert_eq!(drawn(&start), drawn(&again), "a seed decides the task");
        let ended = json!({"action": 0, "episode": start["info"]["episode"]});
        let conflict = server.post(&format!("/v1/worlds/{id}/step"), &ended, 409);
        assert!(conflict["detail"].as_str().unwrap().contains("began episode 2"), "{conflict}");
        let before = server.get(&format!("/v1/worlds/{id}"))["interactions"].as_u64().unwrap();
        let mut steps = 0;
        let last = loop {
            let step = server.post(&format!("/v1/worlds/{id}/step"), &json!({"action": 1009 * steps}), 200);
            assert_eq!(step["truncated"], false);
            assert_eq!(step["info"]["task"], *task);
            assert_eq!(step["observation"].as_array().unwrap().len(), names);
            if step["info"]["valid"] == true {
                break step;
            }
            assert_eq!((&step["terminated"], &step["reward"]), (&json!(false), &json!(0.0)));
            assert!(step["info"]["reason"].is_string());
            assert_eq!(step["observation"], start["observation"]);
            steps += 1;
        };
        assert_eq!(last["terminated"], true);
        assert_eq!(last["reward"], f64::from(u8::from(last["info"]["solved"] == true)));
        assert_eq!(last["info"]["interactions"], before + 1, "only the valid action was an attempt");
        let refused = server.send(Method::POST, &format!("/v1/worlds/{id}/step"), r#"{"action": 1}"#);
        problem(refused, 409, "refused");
    }
}

#[test]
fn unseeded_resets_continue_deterministically() {
    let server = Running::start();
    let sequence = |id: &str| -> Vec<Value> {
        server.post(&format!("/v1/worlds/{id}/reset"), &json!({"seed": 9}), 200);
        (0..5)
            .map(|_| server.post(&format!("/v1/worlds/{id}/reset"), &json!({}), 200)["info"]["task"].clone())
            .collect()
    };
    let (first, second) = (sequence("bowling-sim"), sequence("bowling-real"));
    assert_eq!(first, second);
    assert!(first.iter().any(|t| *t != first[0]), "{first:?}");
    let test = server.post("/v1/worlds/bowling-sim/reset", &json!({"split": "test"}), 200);
    assert_eq!(test["info"]["split"], "test");
}

#[test]
fn certified_actions_solve_their_tasks_in_the_real_world() {
    let server = Running::start();
    for family in iplw::task::families().iter().map(|f| f.name) {
        let tasks = server.get(&format!("/v1/tasks/{family}"));
        let row = &tasks["tasks"][0];
        let body = json!({"task": row["id"]});
        server.post(&format!("/v1/worlds/{family}-real/reset"), &body, 200);
        let body = json!({"action": row["certificate"]["action"]});
        let step = server.post(&format!("/v1/worlds/{family}-real/step"), &body, 200);
        assert_eq!(
            (&step["reward"], &step["info"]["solved"]),
            (&json!(1.0), &json!(true)),
            "{family} {step}"
        );
    }
}

#[test]
fn steps_and_rollouts_agree_and_depend_on_latents() {
    let server = Running::start();
    let task = "bowling:001";
    let valid = action(&server, task, true);
    let world = server.post("/v1/worlds", &json!({"task": task, "latents": {"friction": 0.1}}), 201);
    let path = format!("/v1/worlds/{}", world["id"].as_str().unwrap());
    assert_eq!(world["latents"], json!({"density": 1.0, "friction": 0.1, "restitution": 0.5}));
    server.post(&format!("{path}/reset"), &json!({}), 200);
    let body = json!({"actions": [valid, valid], "trajectories": true});
    let rolled = server.post(&format!("{path}/rollout"), &body, 200);
    assert_eq!(rolled["results"][0], rolled["results"][1]);
    assert_eq!((&rolled["task"], &rolled["interactions"]), (&json!(task), &json!(2)));
    let result = &rolled["results"][0];
    let samples = result["t"].as_array().unwrap().len();
    for body in ["green", "blue", "red"] {
        for axis in ["x", "y", "angle"] {
            assert_eq!(result["bodies"][body][axis].as_array().unwrap().len(), samples);
        }
    }
    let step = server.post(&format!("{path}/step"), &json!({"action": valid}), 200);
    assert_eq!(step["info"]["collisions"], result["contacts"]["collisions"]);
    assert_eq!(step["info"]["rolling_steps"], result["contacts"]["rolling_steps"]);
    assert_eq!(step["info"]["steps"], result["steps"]);
    let width = 256.0 / 6.0;
    let x = result["bodies"]["green"]["x"][samples - 1].as_f64().unwrap();
    assert!((step["observation"][0].as_f64().unwrap() - x / width).abs() < 1e-12);
    let set = server.post(&format!("{path}/set_latents"), &json!({"mass": 3.0, "restitution": 0.9}), 200);
    assert_eq!(set["latents"], json!({"density": 3.0, "friction": 0.1, "restitution": 0.9}));
    let other = server.post(&format!("{path}/rollout"), &body, 200);
    assert_ne!(other["results"][0]["bodies"], result["bodies"]);
    // Samples are only returned on request.
    let short = server.post(&format!("{path}/rollout"), &json!({"actions": [valid], "stop": false}), 200);
    assert_eq!(short["results"][0]["steps"], 4000);
    assert!(short["results"][0].get("t").is_none());
}

#[test]
fn real_worlds_hide_latents_and_enforce_budgets() {
    let server = Running::start();
    let valid = action(&server, "bowling:000", true);
    let invalid = action(&server, "bowling:000", false);
    let body = json!({"task": "bowling:000", "kind": "real", "damping": 0.5, "latents": {"friction": 0.123}, "budget": 3, "noise": 0.01});
    let world = server.post("/v1/worlds", &body, 201);
    let path = format!("/v1/worlds/{}", world["id"].as_str().unwrap());
    assert_eq!((&world["budget"], &world["remaining"]), (&json!(3), &json!(3)));
    assert!(!world.to_string().contains("0.123"), "{world}");
    let refused = server.send(Method::POST, &format!("{path}/set_latents"), r#"{"friction": 1}"#);
    problem(refused, 403, "sealed");
    let rollout = |actions: Value| {
        server.send(Method::POST, &format!("{path}/rollout"), json!({"actions": actions}).to_string())
    };
    assert_eq!(ok(rollout(json!([invalid, valid, invalid, valid])), 200)["interactions"], 2);
    problem(rollout(json!([valid, valid])), 429, "budget-spent");
    assert_eq!(ok(rollout(json!([invalid])), 200)["interactions"], 2, "an unplaceable action costs nothing");
    let placed = server.send(Method::GET, &format!("{path}/render?view=scene&action={valid}"), "");
    assert_eq!(placed.status(), 200);
    assert_eq!(server.get(&path)["remaining"], 1, "a picture of the scene costs nothing");
    let film = server.send(Method::GET, &format!("{path}/render?view=filmstrip&action={valid}"), "");
    assert_eq!(
        (film.status().as_u16(), film.headers()["content-type"].to_str().unwrap()),
        (200, "image/png")
    );
    assert_eq!(server.get(&path)["remaining"], 0);
    let film = server.send(Method::GET, &format!("{path}/render?view=animation&action={valid}"), "");
    problem(film, 429, "budget-spent");
    let scene = server.send(Method::GET, &format!("{path}/render"), "");
    assert_eq!(scene.status(), 200, "the scene costs nothing");
    problem(server.send(Method::GET, &format!("{path}/render?view=film"), ""), 409, "refused");
    server.post(&format!("{path}/reset"), &json!({}), 200);
    problem(
        server.send(Method::POST, &format!("{path}/step"), json!({"action": valid}).to_string()),
        429,
        "budget-spent",
    );
    // A real world shows its physics only if all of it is the client's.
    let body = |latents: Value, effects: Value| json!({"task": "bowling:000", "kind": "real", "sealed": false, "latents": latents, "effects": effects});
    let all = json!({"density": 1.0, "friction": 0.123, "restitution": 0.5});
    for (latents, effects) in
        [(Value::Null, json!([])), (json!({"friction": 0.123}), json!([])), (all.clone(), Value::Null)]
    {
        let refused = server.send(Method::POST, "/v1/worlds", body(latents, effects).to_string());
        problem(refused, 422, "invalid-value");
    }
    let open = server.post("/v1/worlds", &body(all, json!([])), 201);
    assert_eq!(open["latents"]["friction"], 0.123);
}

#[test]
fn renders_the_last_step_without_an_interaction() {
    let server = Running::start();
    let valid = action(&server, "bowling:000", true);
    let body = json!({"task": "bowling:000", "kind": "real", "noise": 0.01, "budget": 1});
    let world = server.post("/v1/worlds", &body, 201);
    let path = format!("/v1/worlds/{}", world["id"].as_str().unwrap());
    server.post(&format!("{path}/reset"), &json!({}), 200);
    server.post(&format!("{path}/step"), &json!({"action": valid}), 200);
    let picture = |query: &str| {
        let picture = server.send(Method::GET, &format!("{path}/render?{query}"), "");
        let kind = picture.headers()["content-type"].to_str().unwrap().to_string();
        (picture.status().as_u16(), kind, picture.bytes().unwrap())
    };
    for (query, kind) in [
        ("view=end", "image/png"),
        ("view=end&format=svg", "image/svg+xml"),
        ("view=filmstrip", "image/png"),
        ("view=animation", "image/svg+xml"),
        ("view=film&fps=20&width=64", "image/apng"),
    ] {
        let (status, seen, bytes) = picture(query);
        assert_eq!((status, seen.as_str()), (200, kind), "{query}");
        assert!(bytes == picture(query).2, "{query}: what was measured does not change");
    }
    assert_eq!(
        server.get(&path)["interactions"],
        1,
        "what was measured is shown, and nothing else is measured"
    );
    let frames = picture("view=film&fps=20&width=64").2;
    let twice = picture("view=film&fps=40&width=64").2;
    // The acTL chunk contains the number of frames.
    let count = |png: &[u8]| {
        let at = png.windows(4).position(|w| w == b"acTL").unwrap() + 4;
        u32::from_be_bytes(png[at..at + 4].try_into().unwrap())
    };
    assert!(count(&frames) >= 50 && count(&twice).abs_diff(2 * count(&frames)) <= 2);
}

#[test]
fn renders_valid_images() {
    let server = Running::start();
    let valid = action(&server, "bowling:002", true);
    for (query, kind, start) in [
        ("".to_string(), "image/png", b"\x89PNG".as_slice()),
        ("format=svg&width=100".into(), "image/svg+xml", b"<svg"),
        (format!("view=scene&action={valid}&task=bowling:002"), "image/png", b"\x89PNG"),
        (format!("view=filmstrip&action={valid}&task=bowling:002&format=svg"), "image/svg+xml", b"<svg"),
        (format!("view=animation&action={valid}&task=bowling:002"), "image/svg+xml", b"<svg"),
    ] {
        let picture = server.send(Method::GET, &format!("/v1/worlds/bowling-sim/render?{query}"), "");
        assert_eq!(
            (picture.status().as_u16(), picture.headers()["content-type"].to_str().unwrap()),
            (200, kind)
        );
        let bytes = picture.bytes().unwrap();
        assert!(bytes.starts_with(start), "{query}: {:?}", &bytes[..40]);
    }
}

#[test]
fn creates_worlds_from_custom_scenes() {
    let server = Running::start();
    let made = server.send(
        Method::POST,
        "/v1/worlds",
        json!({"scene": scene(), "effects": [{"name": "linear_drag", "parameters": {"c": 0.1}}]}).to_string(),
    );
    let place = made.headers()["location"].to_str().unwrap().to_string();
    let world = ok(made, 201);
    assert_eq!(place, format!("/v1/worlds/{}", world["id"].as_str().unwrap()));
    assert_eq!(world["task"], "custom:shot");
    let rolled = server.post(&format!("{place}/rollout"), &json!({"actions": [[0.5], [1.0], 3]}), 200);
    assert_eq!(rolled["results"].as_array().unwrap().len(), 3);
    server.post(&format!("{place}/reset"), &json!({}), 200);
    let step = server.post(&format!("{place}/step"), &json!({"action": [0.9]}), 200);
    assert_eq!(step["terminated"], true);
    assert_eq!(server.send(Method::DELETE, &place, "").status(), 204);
    problem(server.send(Method::GET, &place, ""), 404, "not-found");
}

#[test]
fn worlds_accept_every_effect() {
    let server = Running::start();
    // Long and slow enough for the ball to roll.
    let mut scene = scene();
    scene["steps"] = json!(960);
    let attempt = |kind: &str, effects: Value| {
        let body = json!({"scene": scene, "kind": kind, "effects": effects, "sealed": false});
        let world = server.post("/v1/worlds", &body, 201);
        assert_eq!(world["effects"], effects);
        let id = world["id"].as_str().unwrap();
        let rolled = server.post(
            &format!("/v1/worlds/{id}/rollout"),
            &json!({"actions": [[0.1]], "trajectories": true}),
            200,
        );
        server.send(Method::DELETE, &format!("/v1/worlds/{id}"), "");
        rolled["results"][0].clone()
    };
    for kind in ["sim", "real"] {
        for e in iplw::world::effect::REGISTRY {
            let parameters = e.parameters.iter().map(|p| (p.name.to_string(), json!(p.neutral)));
            let mut parameters: serde_json::Map<String, Value> = parameters.collect();
            let neutral = attempt(kind, json!([{"name": e.name, "parameters": parameters.clone()}]));
            for p in e.parameters {
                let value = match p.name {
                    "x_min" | "y_min" => -9.0,
                    "x_max" | "y_max" => 9.0,
                    _ => p.neutral + 0.2,
                };
                parameters.insert(p.name.into(), json!(value));
            }
            let strong = attempt(kind, json!([{"name": e.name, "parameters": parameters}]));
            assert_ne!(neutral, strong, "{kind} {}", e.name);
        }
    }
}

fn scene() -> Value {
    json!({
        "format": "iplw.scene/1", "name": "shot", "steps": 240,
        "bodies": [{"name": "ball", "shape": {"type": "disc", "radius": 0.1}, "position": [0, 1]}],
        "statics": [{"name": "ground", "shape": {"type": "halfspace", "normal": [0, 1], "offset": 0}}],
        "goal": {"type": "inside", "body": "ball", "region": [[2, 0], [3, 0], [3, 1], [2, 1]]},
        "action": {"components": [{"target": "ball", "set": "vx", "low": 0, "high": 5}],
                   "discrete": {"type": "grid", "counts": [10]}}
    })
}

#[test]
fn lists_tasks() {
    let server = Running::start();
    let families = server.get("/v1/tasks");
    assert_eq!(families["families"][0]["split"], json!({"train": 60, "validation": 20, "test": 20}));
    assert_eq!(families["families"][0]["action_space"]["count"], 50_000);
    let family = server.get("/v1/tasks/bowling");
    assert_eq!(family["tasks"].as_array().unwrap().len(), 100);
    let task = server.get("/v1/tasks/bowling/017");
    assert_eq!((&task["id"], &task["split"]), (&family["tasks"][17]["id"], &family["tasks"][17]["split"]));
    assert_eq!(task, server.get("/v1/tasks/bowling/17"));
    // A served scene is valid input.
    let made = server.post("/v1/worlds", &json!({"scene": task["scene"]}), 201);
    assert_eq!(made["action_space"], family["action_space"]);
}

/// Method, path, body, status, kind of problem, field (if any).
type Row = (&'static str, String, String, u16, &'static str, &'static str);

fn row(
    method: &'static str,
    path: impl Into<String>,
    body: impl Into<String>,
    status: u16,
    slug: &'static str,
    field: &'static str,
) -> Row {
    (method, path.into(), body.into(), status, slug, field)
}

#[test]
fn rejects_bad_input_naming_the_field() {
    let server = Running::start();
    server.post("/v1/worlds/bowling-sim/reset", &json!({"task": "bowling:000"}), 200);
    let overlap = {
        let mut s = scene();
        for name in ["b", "c"] {
            let body = json!({"name": name, "shape": {"type": "disc", "radius": 0.1}, "position": [1, 1]});
            s["bodies"].as_array_mut().unwrap().push(body);
        }
        json!({"scene": s}).to_string()
    };
    let with = |key: &str, value: Value| {
        let mut s = scene();
        s[key] = value;
        json!({"scene": s}).to_string()
    };
    let flat = with(
        "bodies",
        json!([{"name": "ball", "shape": {"type": "polygon", "vertices": [[0, 0], [1, 0], [2, 0]]}, "position": [0, 1]}]),
    );
    let tile = |i: usize| json!({"type": "box", "half_width": 0.05, "half_height": 0.05, "position": [0.0, 0.05 * i as f64]});
    let tower = json!({"type": "compound", "pieces": (0..8).map(tile).collect::<Vec<_>>()});
    let named = |i: usize| if i == 0 { "ball".to_string() } else { format!("b{i}") };
    let crowd: Vec<Value> =
        (0..30).map(|i| json!({"name": named(i), "shape": tower, "position": [i, 1]})).collect();
    let crowded = with("bodies", json!(crowd)).replace("{\"scene\"", "{\"engine\":\"lanes\",\"scene\"");
    let homeless = with("bodies", json!([{"name": "ball", "shape": {"type": "disc", "radius": 0.1}}]));
    let huge = with("steps", json!(1_000_000))
        .replace("\"scene\":{", "\"scene\":{\"observe_every\":1,\"time_step\":0.001,");
    let many = json!({"actions": vec![0; 4097]}).to_string();
    let invalid = action(&server, "bowling:000", false);
    let film = format!("/v1/worlds/bowling-sim/render?view=filmstrip&task=bowling:000&action={invalid}");
    let (step, reset, rollout) =
        ("/v1/worlds/bowling-sim/step", "/v1/worlds/bowling-sim/reset", "/v1/worlds/bowling-sim/rollout");
    let (set, worlds, iplw) = ("/v1/worlds/bowling-sim/set_latents", "/v1/worlds", "/v1/iplw");
    let (render, policies) = ("/v1/worlds/bowling-sim/render", "/v1/policies");
    let (bad, wrong, missing, refused) = ("malformed", "invalid-value", "not-found", "refused");
    let query = |q: &str| format!("{render}?{q}");
    let rows: Vec<Row> = vec![
        row("POST", step, "{", 400, bad, ""),
        row("POST", step, "[[0.5,0.5,0.5]]", 400, bad, ""),
        row("POST", step, "nonsense", 400, bad, ""),
        row("POST", step, "{\"action\": 1} x", 400, bad, ""),
        row("POST", step, "\u{1}", 400, bad, ""),
        row("POST", step, "", 400, bad, ""),
        row("POST", step, r#"{"action": [0.5, 0.5, 0.5], "acton": 1}"#, 400, bad, "acton"),
        row("POST", step, r#"{"action": [0.5, NaN, 0.5]}"#, 400, bad, "action[1]"),
        row("POST", step, r#"{"action": [0.5, Infinity, 0.5]}"#, 400, bad, "action[1]"),
        row("POST", step, r#"{"action": [0.5, 1e999, 0.5]}"#, 400, bad, "action[1]"),
        row("POST", step, r#"{"action": [0.5, null, 0.5]}"#, 400, bad, "action[1]"),
        row("POST", step, r#"{"action": [0.5, "x", 0.5]}"#, 400, bad, "action[1]"),
        row("POST", step, r#"{"action": "1"}"#, 400, bad, "action"),
        row("POST", step, r#"{"action": true}"#, 400, bad, "action"),
        row("POST", step, r#"{"action": {}}"#, 400, bad, "action"),
        row("POST", step, r#"{"action": 1.5}"#, 400, bad, "action"),
        row("POST", step, r#"{"action": -1}"#, 400, bad, "action"),
        row("POST", step, r#"{"action": 1, "action": 2}"#, 400, bad, ""),
        row("POST", step, r#"{"action": [0.5, 1.01, 0.5]}"#, 422, wrong, "action[1]"),
        row("POST", step, r#"{"action": [0.5, -1e-9, 0.5]}"#, 422, wrong, "action[1]"),
        row("POST", step, r#"{"action": [0.5, 0.5]}"#, 422, wrong, "action"),
        row("POST", step, r#"{"action": []}"#, 422, wrong, "action"),
        row("POST", step, r#"{"action": 50000}"#, 422, wrong, "action"),
        row("POST", step, r#"{"action": 18446744073709551615}"#, 422, wrong, "action"),
        row("POST", reset, r#"{"seed": -1}"#, 400, bad, "seed"),
        row("POST", reset, r#"{"seed": 1.5}"#, 400, bad, "seed"),
        row("POST", reset, r#"{"seed": "1"}"#, 400, bad, "seed"),
        row("POST", reset, r#"{"seed": 99999999999999999999}"#, 400, bad, "seed"),
        row("POST", reset, r#"{"split": "tset"}"#, 400, bad, "split"),
        row("POST", reset, r#"{"task": "bowling:100"}"#, 404, missing, ""),
        row("POST", reset, r#"{"task": "basketball:000"}"#, 404, missing, ""),
        row("POST", "/v1/worlds/nope/reset", "{}", 404, missing, ""),
        row("POST", rollout, r#"{"actions": 5}"#, 400, bad, "actions"),
        row("POST", rollout, r#"{}"#, 400, bad, ""),
        row("POST", rollout, r#"{"actions": [0, [0.5, 0.5, 7]]}"#, 422, wrong, "actions[1][2]"),
        row("POST", rollout, r#"{"actions": [0, 50000]}"#, 422, wrong, "actions[1]"),
        row("POST", rollout, many, 413, "too-large", ""),
        row("POST", "/v1/worlds/bowling-real/rollout", r#"{"actions": [0]}"#, 409, "refused", ""),
        row(
            "POST",
            "/v1/worlds/bowling-real/rollout",
            r#"{"task": "bowling:000", "actions": [0], "stop": false}"#,
            422,
            wrong,
            "stop",
        ),
        row("POST", set, r#"{"friction": -0.1}"#, 422, wrong, "friction"),
        row("POST", set, r#"{"restitution": 1.1}"#, 422, wrong, "restitution"),
        row("POST", set, r#"{"mass": 0}"#, 422, wrong, "mass"),
        row("POST", set, r#"{"mass": 1, "density": 1}"#, 422, wrong, "mass"),
        row("POST", set, r#"{"fricton": 1}"#, 400, bad, "fricton"),
        row("POST", set, "[1, 1]", 400, bad, ""),
        row("POST", "/v1/worlds/basketball-real/set_latents", r#"{"friction": 1}"#, 403, "sealed", ""),
        row("POST", worlds, "{}", 422, wrong, "task"),
        row("POST", worlds, r#"{"task": "curling"}"#, 404, missing, ""),
        row("POST", worlds, r#"{"task": "bowling:1000"}"#, 404, missing, ""),
        row("POST", worlds, r#"{"task": "bowling", "kind": "surreal"}"#, 400, bad, "kind"),
        row("POST", worlds, r#"{"task": "bowling", "engine": "warp"}"#, 422, wrong, "engine"),
        row("POST", worlds, r#"{"task": "bowling", "latents": [1, 1, 0.5]}"#, 400, bad, "latents"),
        row(
            "POST",
            worlds,
            r#"{"task": "bowling", "latents": {"friction": 11}}"#,
            422,
            wrong,
            "latents.friction",
        ),
        row("POST", worlds, r#"{"task": "bowling", "damping": 0}"#, 422, wrong, "damping"),
        row("POST", worlds, r#"{"task": "bowling", "damping": 1.5}"#, 422, wrong, "damping"),
        row(
            "POST",
            worlds,
            r#"{"task": "bowling", "effects": [{"name": "linear_drag", "parameters": {"c": 1e5}}]}"#,
            422,
            wrong,
            "effects[0].parameters.c",
        ),
        row(
            "POST",
            worlds,
            r#"{"task": "bowling", "effects": [{"name": "magic"}]}"#,
            422,
            wrong,
            "effects[0].name",
        ),
        row(
            "POST",
            worlds,
            r#"{"task": "bowling", "effects": [{"name": "linear_drag", "parameters": {"k": 1}}]}"#,
            422,
            wrong,
            "effects[0].parameters.k",
        ),
        row(
            "POST",
            worlds,
            r#"{"task": "bowling", "effects": [{"name": "linear_drag", "parameters": {"c": -1}}]}"#,
            422,
            wrong,
            "effects[0].parameters.c",
        ),
        row("POST", worlds, r#"{"task": "bowling", "budget": 5}"#, 422, wrong, "budget"),
        row("POST", worlds, r#"{"task": "bowling", "noise": 0.1}"#, 422, wrong, "noise"),
        row("POST", worlds, r#"{"task": "bowling", "kind": "real", "noise": -1}"#, 422, wrong, "noise"),
        row("POST", worlds, r#"{"task": "bowling", "kind": "real", "budget": -1}"#, 400, bad, "budget"),
        row("POST", worlds, r#"{"scene": [1]}"#, 400, bad, "scene"),
        row(
            "POST",
            worlds,
            r#"{"scene": {"format": "iplw.scene/1", "bodies": []}}"#,
            422,
            wrong,
            "scene.bodies",
        ),
        row(
            "POST",
            worlds,
            r#"{"scene": {"format": "iplw.scene/1", "bodies": [], "bodes": 1}}"#,
            400,
            bad,
            "scene.bodes",
        ),
        row("POST", worlds, with("action", Value::Null), 422, wrong, "scene.action"),
        row("POST", worlds, with("goal", Value::Null), 422, wrong, "scene.goal"),
        row("POST", worlds, with("format", json!("iplw.scene/3")), 422, wrong, "scene.format"),
        row("POST", worlds, with("time_step", json!(0)), 422, wrong, "scene.time_step"),
        row("POST", worlds, crowded, 422, wrong, "engine"),
        row("POST", worlds, homeless, 422, wrong, "scene.bodies[0].position"),
        row("POST", worlds, overlap, 422, wrong, "scene.bodies[2].position"),
        row("POST", worlds, flat, 422, wrong, "scene.bodies[0].shape.vertices[1]"),
        row("POST", worlds, huge, 201, "", ""),
        row("GET", "/v1/worlds/nope", "", 404, missing, ""),
        row("DELETE", "/v1/worlds/nope", "", 404, missing, ""),
        row("GET", "/v1/worlds/%ff", "", 400, bad, "path"),
        row("GET", "/v1/tasks/curling", "", 404, missing, ""),
        row("GET", "/v1/tasks/bowling/100", "", 404, missing, ""),
        row("GET", "/v1/tasks/bowling/x", "", 404, missing, ""),
        row("GET", query("format=gif"), "", 422, wrong, "format"),
        row("GET", query("view=side"), "", 422, wrong, "view"),
        row("GET", query("view=filmstrip"), "", 409, refused, ""),
        row("GET", query("view=end&task=bowling:000"), "", 422, wrong, "task"),
        row("GET", query("view=film&format=svg"), "", 422, wrong, "format"),
        row("GET", query("view=film&fps=0"), "", 422, wrong, "fps"),
        row("GET", query("view=filmstrip&fps=30"), "", 422, wrong, "fps"),
        row("GET", query("view=film&task=bowling:000&action=0&width=4096"), "", 413, "too-large", ""),
        row("GET", query("view=animation&format=png&action=1"), "", 422, wrong, "format"),
        row("GET", query("action=a,b"), "", 422, wrong, "action"),
        row("GET", query("action=nan,0.5,0.5"), "", 422, wrong, "action[0]"),
        row("GET", query("action=0.5,0.5"), "", 422, wrong, "action"),
        row("GET", query("width=15"), "", 422, wrong, "width"),
        row("GET", query("width=99999"), "", 422, wrong, "width"),
        row("GET", query("widht=99"), "", 422, wrong, "widht"),
        row("GET", query("width=99&width=99"), "", 422, wrong, "width"),
        row("GET", query("task=bowling:999"), "", 404, missing, ""),
        row("GET", film, "", 422, wrong, "action"),
        row("POST", iplw, "{}", 422, wrong, "task"),
        row("POST", iplw, r#"{"task": "curling"}"#, 404, missing, ""),
        row("POST", iplw, r#"{"task": "bowling", "strategy": "psychic"}"#, 422, wrong, "strategy"),
        row("POST", iplw, r#"{"task": "bowling", "residual": "x"}"#, 422, wrong, "residual"),
        row("POST", iplw, r#"{"task": "bowling", "fit": ["linear_drag.k"]}"#, 422, wrong, "fit"),
        row("POST", iplw, r#"{"task": "bowling", "fit": ["gust.phase"]}"#, 422, wrong, "fit"),
        row("POST", iplw, r#"{"task": "bowling", "surface": "surface-9"}"#, 404, missing, ""),
        row("POST", iplw, r#"{"task": "bowling", "surface": "hill"}"#, 404, missing, ""),
        row("POST", "/v1/surfaces", "{}", 400, bad, ""),
        row("POST", "/v1/surfaces", r#"{"task": "curling"}"#, 404, missing, ""),
        row("POST", "/v1/surfaces", r#"{"task": "bowling", "route": "scenic"}"#, 422, wrong, "route"),
        row("POST", "/v1/surfaces", r#"{"task": "bowling", "points": 2}"#, 422, wrong, "points"),
        row("POST", "/v1/surfaces", r#"{"task": "bowling", "actions": 0}"#, 422, wrong, "actions"),
        row("POST", "/v1/surfaces", r#"{"task": "bowling", "factors": ["grip"]}"#, 422, wrong, "factors"),
        row("POST", "/v1/surfaces", r#"{"task": "bowling", "factors": []}"#, 422, wrong, "factors"),
        row(
            "POST",
            "/v1/surfaces",
            r#"{"task": "bowling", "factors": ["friction", "friction"]}"#,
            422,
            wrong,
            "factors",
        ),
        row("GET", "/v1/surfaces/surface-1", "", 404, missing, ""),
        row("GET", "/v1/surfaces/surface--1/picture", "", 404, missing, ""),
        row("DELETE", "/v1/surfaces/1", "", 404, missing, ""),
        row("POST", "/v1/designs", "{}", 400, bad, ""),
        row("POST", "/v1/designs", r#"{"task": "curling"}"#, 404, missing, ""),
        row("POST", "/v1/designs", r#"{"task": "bowling", "question": "weather"}"#, 422, wrong, "question"),
        row(
            "POST",
            "/v1/designs",
            r#"{"task": "bowling", "question": "effects", "worlds": 7}"#,
            422,
            wrong,
            "worlds",
        ),
        row("POST", "/v1/designs", r#"{"task": "bowling", "sets": []}"#, 422, wrong, "sets"),
        row(
            "POST",
            "/v1/designs",
            r#"{"task": "bowling", "sets": [["sticky_patch"]]}"#,
            422,
            wrong,
            "sets[0][0]",
        ),
        row("POST", "/v1/designs", r#"{"task": "bowling", "batch": 21}"#, 422, wrong, "batch"),
        row("POST", "/v1/designs", r#"{"task": "bowling", "candidates": 1e6}"#, 422, wrong, "candidates"),
        row("POST", "/v1/designs", r#"{"task": "bowling", "noise": -1}"#, 422, wrong, "noise"),
        row("POST", "/v1/designs", r#"{"task": "bowling", "question": "effects"}"#, 422, wrong, "posterior"),
        row(
            "POST",
            "/v1/designs",
            plan_request(json!({"friction": [0.5, 0.4]}), "iplw.posterior/2").replace(":000", ""),
            422,
            wrong,
            "posterior",
        ),
        row("POST", "/v1/designs", r#"{"task": "bowling", "copies": 1}"#, 422, wrong, "copies"),
        row("POST", "/v1/plans", "{}", 400, bad, ""),
        row("POST", "/v1/plans", r#"{"task": "curling:000"}"#, 404, missing, ""),
        row("POST", "/v1/plans", r#"{"task": "bowling:999"}"#, 404, missing, ""),
        row("POST", "/v1/plans", r#"{"task": "bowling"}"#, 422, wrong, "task"),
        row("POST", "/v1/plans", r#"{"task": "bowling:000", "draws": 0}"#, 422, wrong, "draws"),
        row("POST", "/v1/plans", r#"{"task": "bowling:000", "actions": 1e9}"#, 422, wrong, "actions"),
        row("POST", "/v1/plans", r#"{"task": "bowling:000", "perturb": -1}"#, 422, wrong, "perturb"),
        row("POST", "/v1/plans", r#"{"task": "bowling:000", "seconds": -1}"#, 422, wrong, "seconds"),
        row("POST", "/v1/plans", r#"{"task": "bowling:000", "engine": "warp"}"#, 422, wrong, "engine"),
        row(
            "POST",
            "/v1/plans",
            r#"{"task": "bowling:000", "latents": {"friction": -1}}"#,
            422,
            wrong,
            "latents.friction",
        ),
        row(
            "POST",
            "/v1/plans",
            r#"{"task": "bowling:000", "effects": [{"name": "magic"}]}"#,
            422,
            wrong,
            "effects[0].name",
        ),
        row(
            "POST",
            "/v1/plans",
            plan_request(json!({"friction": [0.5]}), "iplw.posterior/9"),
            422,
            wrong,
            "posterior.format",
        ),
        row(
            "POST",
            "/v1/plans",
            plan_request(json!({"friction": [0.5, -1]}), "iplw.posterior/2"),
            422,
            wrong,
            "posterior.columns.friction[1]",
        ),
        row(
            "POST",
            "/v1/plans",
            plan_request(json!({"grip": [0.5]}), "iplw.posterior/2"),
            422,
            wrong,
            "posterior.columns.grip",
        ),
        row("POST", "/v1/posteriors", "{}", 422, wrong, "scene"),
        row("POST", "/v1/posteriors", r#"{"job": "job-99"}"#, 404, missing, ""),
        row("POST", "/v1/posteriors", r#"{"job": "job-99", "trials": ""}"#, 422, wrong, "job"),
        row("POST", "/v1/posteriors", r#"{"draws": 3}"#, 422, wrong, "draws"),
        row("POST", "/v1/posteriors", r#"{"method": "hmc"}"#, 422, wrong, "method"),
        row("POST", "/v1/posteriors", r#"{"sets": [["magic"]]}"#, 404, missing, ""),
        row("POST", "/v1/posteriors", r#"{"prior": {"grip": [1, 1]}}"#, 404, missing, ""),
        row("POST", "/v1/posteriors", r#"{"prior": {"friction": [1, 0]}}"#, 422, wrong, "prior[1][1]"),
        row("POST", "/v1/likelihoods", "{}", 422, wrong, "scene"),
        row("POST", "/v1/likelihoods", r#"{"job": "job-99"}"#, 404, missing, ""),
        row("POST", "/v1/likelihoods", r#"{"effects": ["magic"]}"#, 404, missing, ""),
        row("POST", "/v1/likelihoods", r#"{"effects": ["wind", "wind"]}"#, 422, wrong, "effects"),
        row("POST", "/v1/likelihoods", r#"{"prior": {"friction": [1, 0]}}"#, 422, wrong, "prior[1][1]"),
        row("POST", "/v1/likelihoods", r#"{"sets": [[]]}"#, 400, bad, ""),
        row("POST", "/v1/likelihoods/job-99/evaluate", r#"{"columns": {}}"#, 404, missing, ""),
        row("POST", "/v1/likelihoods/job-99/starts", r#"{"count": 1}"#, 404, missing, ""),
        row("POST", "/v1/diagnoses", "{}", 422, wrong, "scene"),
        row("POST", "/v1/diagnoses", r#"{"job": "job-99"}"#, 404, missing, ""),
        row("POST", "/v1/diagnoses", r#"{"job": "job-99", "trials": ""}"#, 422, wrong, "job"),
        row("POST", "/v1/diagnoses", json!({"scene": scene()}).to_string(), 422, wrong, "trials"),
        row(
            "POST",
            "/v1/diagnoses",
            json!({"scene": scene(), "trials": "trial,t,body,x,y\n1,0,moon,0,0\n"}).to_string(),
            422,
            wrong,
            "trials.body",
        ),
        row("POST", "/v1/policies/untrained/learn", "{}", 400, bad, ""),
        row("POST", "/v1/policies/untrained/learn", r#"{"world": "nope"}"#, 404, missing, ""),
        row("POST", "/v1/policies/nobody/learn", r#"{"world": "bowling-sim"}"#, 404, missing, ""),
        row(
            "POST",
            "/v1/policies/untrained/learn",
            r#"{"world": "bowling-sim", "attempts": 0}"#,
            422,
            wrong,
            "attempts",
        ),
        row(
            "POST",
            "/v1/policies/untrained/learn",
            r#"{"world": "bowling-sim", "learning_rate": 7}"#,
            422,
            wrong,
            "learning_rate",
        ),
        row("POST", "/v1/policies/random/learn", r#"{"world": "bowling-sim"}"#, 409, refused, ""),
        row("GET", "/v1/policies/random/weights", "", 409, refused, ""),
        row("GET", "/v1/policies/untrained/weights", "", 409, refused, ""),
        row("DELETE", "/v1/policies/random", "", 409, refused, ""),
        row("DELETE", "/v1/policies/untrained", "", 409, refused, ""),
        row("POST", "/v1/policies/untrained/act", r#"{"task": "bowling:000"}"#, 409, refused, ""),
        row("POST", "/v1/policies/untrained/evaluate", r#"{"world": "bowling-sim"}"#, 409, refused, ""),
        row("POST", "/v1/policies/nobody/act", r#"{"task": "bowling:000"}"#, 404, missing, ""),
        row("DELETE", "/v1/policies/nobody", "", 404, missing, ""),
        row("PUT", "/v1/policies/random/weights", "x", 422, wrong, "id"),
        row("PUT", "/v1/policies/untrained/weights", "x", 422, wrong, "id"),
        row("POST", iplw, r#"{"task": "bowling", "rounds": 0}"#, 422, wrong, "rounds"),
        row("POST", iplw, r#"{"task": "bowling", "actions": 0}"#, 422, wrong, "actions"),
        row("POST", iplw, r#"{"task": "bowling", "actions": 18446744073709551615}"#, 422, wrong, "actions"),
        row("POST", iplw, r#"{"task": "bowling", "samples": 1}"#, 422, wrong, "samples"),
        row("POST", iplw, r#"{"task": "bowling", "world": "nope"}"#, 404, missing, ""),
        row("POST", iplw, r#"{"task": "bowling", "world": "bowling-sim"}"#, 422, wrong, "world"),
        row("POST", iplw, r#"{"task": "bowling", "world": "basketball-real"}"#, 422, wrong, "world"),
        row("POST", iplw, r#"{"task": "bowling", "world": "bowling-real", "real": {}}"#, 422, wrong, "real"),
        row("POST", iplw, r#"{"task": "bowling", "real": {"damping": 2}}"#, 422, wrong, "real.damping"),
        row("POST", iplw, r#"{"task": "bowling", "real": "ask"}"#, 400, bad, "real"),
        row("POST", iplw, r#"{"task": "bowling", "real": 1}"#, 400, bad, "real"),
        row("POST", iplw, r#"{"task": "bowling", "real": {"dampign": 1}}"#, 400, bad, "real.dampign"),
        row("GET", "/v1/worlds?limit=0", "", 422, wrong, "limit"),
        row("GET", "/v1/worlds?limit=1001", "", 422, wrong, "limit"),
        row("GET", "/v1/jobs?limit=x", "", 422, wrong, "limit"),
        row("GET", "/v1/jobs?limit=1&limit=1", "", 422, wrong, "limit"),
        row("GET", "/v1/jobs?cursor=x", "", 422, wrong, "cursor"),
        row("GET", "/v1/policies?cursor=", "", 422, wrong, "cursor"),
        // A cursor of the list of worlds, `worlds:a`.
        row("GET", "/v1/jobs?cursor=d29ybGRzOmE", "", 422, wrong, "cursor"),
        row("GET", "/v1/tasks?cursor=d29ybGRzOmE", "", 422, wrong, "cursor"),
        row("GET", "/v1/tasks/bowling?page=2", "", 422, wrong, "page"),
        row("GET", "/v1/jobs/job-99/trials", "", 404, missing, ""),
        row("GET", "/v1/iplw/job-99/rounds", "", 404, missing, ""),
        row("GET", "/v1/diagnoses/job-99/trials", "", 404, missing, ""),
        row("GET", "/v1/iplw/job-99/proposals", "", 404, missing, ""),
        row("POST", "/v1/iplw/job-99/trials", "{}", 404, missing, ""),
        row(
            "POST",
            iplw,
            r#"{"task": "bowling", "real": {"latents": {"mass": -2}}}"#,
            422,
            wrong,
            "real.latents.mass",
        ),
        row("POST", iplw, r#"{"task": "bowling", "real": {"noise": -2}}"#, 422, wrong, "real.noise"),
        row(
            "POST",
            iplw,
            r#"{"task": "bowling", "real": {"effects": [{"name": "x"}]}}"#,
            422,
            wrong,
            "real.effects[0].name",
        ),
        row("POST", policies, r#"{"task": "bowling", "training": "hard"}"#, 400, bad, "training"),
        row("POST", policies, r#"{"task": "bowling", "batches": 0}"#, 422, wrong, "batches"),
        row("POST", policies, r#"{"task": "bowling", "batch_size": 1}"#, 422, wrong, "batch_size"),
        row(
            "POST",
            policies,
            r#"{"task": "bowling", "latents": {"friction": -1}}"#,
            422,
            wrong,
            "latents.friction",
        ),
        row(
            "POST",
            policies,
            r#"{"task": "bowling", "training": "randomised", "latents": {}}"#,
            422,
            wrong,
            "latents",
        ),
        row(
            "POST",
            policies,
            train_request(json!({"friction": [0.5, -1]}), json!({})),
            422,
            wrong,
            "posterior.columns.friction[1]",
        ),
        row(
            "POST",
            policies,
            train_request(json!({"grip": [1]}), json!({})),
            422,
            wrong,
            "posterior.columns.grip",
        ),
        row("POST", policies, train_request(json!({}), json!({"training": "fixed"})), 422, wrong, "training"),
        row("POST", policies, train_request(json!({}), json!({"latents": {}})), 422, wrong, "latents"),
        row("POST", policies, train_request(json!({}), json!({"effects": []})), 422, wrong, "effects"),
        row("POST", policies, r#"{"task": "bowling", "posterior": {"format": "x"}}"#, 422, wrong, ""),
        row("POST", policies, r#"{"task": "bowling", "preset": "quick"}"#, 400, bad, "preset"),
        row(
            "POST",
            policies,
            r#"{"task": "bowling", "preset": "saturating", "batches": 5}"#,
            422,
            wrong,
            "batches",
        ),
        row(
            "POST",
            policies,
            r#"{"task": "bowling", "preset": "saturating", "validations": 5}"#,
            422,
            wrong,
            "validations",
        ),
        row("POST", policies, r#"{"task": "bowling:000", "preset": "saturating"}"#, 422, wrong, "task"),
        row("GET", "/v1/policies/nope", "", 404, missing, ""),
        row("DELETE", "/v1/policies/nope", "", 404, missing, ""),
        row("GET", "/v1/policies/nope/weights", "", 404, missing, ""),
        row("POST", "/v1/policies/nope/act", r#"{"task": "bowling:000"}"#, 404, missing, ""),
        row("POST", "/v1/policies/nope/evaluate", r#"{"world": "bowling-real"}"#, 404, missing, ""),
        row("PUT", "/v1/policies/mine/weights", "not safetensors", 422, wrong, ""),
        row("PUT", "/v1/policies/mine/weights", "", 422, wrong, ""),
        row("PUT", "/v1/policies/.mine/weights", "x", 422, wrong, "id"),
        row("PUT", "/v1/policies/a%2Fb/weights", "x", 422, wrong, "id"),
        row("GET", "/v1/jobs/job-99", "", 404, missing, ""),
        row("GET", "/v1/jobs/99", "", 404, missing, ""),
        row("DELETE", "/v1/jobs/job-99", "", 404, missing, ""),
        row("PATCH", "/v1/jobs/job-99", r#"{"name": "a"}"#, 404, missing, ""),
        row("PATCH", "/v1/jobs/job-99", r#"{"title": "a"}"#, 400, "malformed", "title"),
        row("PATCH", "/v1/jobs/job-99", r#"{"name": 1}"#, 400, "malformed", "name"),
        row("PATCH", "/v1/jobs/job-99", r#"{"name": "a\nb"}"#, 422, wrong, "name"),
        row("GET", "/v1/jobs/job-99/events", "", 404, missing, ""),
        row("GET", "/v1/jobs/job-99/report", "", 404, missing, ""),
        row("GET", "/nowhere", "", 404, missing, ""),
        row("GET", "/docs/nope.js", "", 404, missing, ""),
        row("PATCH", worlds, "", 405, "method-not-allowed", ""),
        row("GET", step, "", 405, "method-not-allowed", ""),
    ];
    for (method, path, body, status, slug, field) in &rows {
        let response = server.send(method.parse().unwrap(), path, body.to_string());
        if *status < 300 {
            assert_eq!(response.status().as_u16(), *status, "{path} {body}: {}", response.text().unwrap());
            continue;
        }
        assert_eq!(
            response.status().as_u16(),
            *status,
            "{method} {path} {body}: {}",
            response.text().unwrap()
        );
        let told = problem(response, *status, slug);
        if !field.is_empty() {
            assert_eq!(told["field"], *field, "{method} {path} {body}: {told}");
            assert!(told["allowed"].is_string(), "{told}");
        }
    }
    let not_text = server.send(Method::POST, step, vec![b'{', 0xff, b'}']);
    problem(not_text, 400, bad);
    let long = format!("{{\"action\": [{}0]}}", " ".repeat(17 * 1024 * 1024));
    problem(server.send(Method::POST, step, long), 413, "too-large");
    let nested = format!("{{\"action\": {}", "[".repeat(100_000));
    problem(server.send(Method::POST, step, nested), 400, bad);
    // None of the requests above was counted, and the server still works.
    assert_eq!(server.get("/v1/worlds/bowling-real")["interactions"], 0);
    let metrics = server.send(Method::GET, "/metrics", "").text().unwrap();
    assert!(metrics.contains("iplw_errors_total{class=\"5xx\"} 0"), "{metrics}");
}

/// A job that has not succeeded has no report; the report of one that has loads and runs nothing.
#[test]
fn reports_are_pages_of_results() {
    let server = Running::start();
    let body =
        |rounds: u64| json!({"task": "bowling", "rounds": rounds, "actions": 2, "samples": 8, "seed": 1});
    let report =
        |id: &Value| server.send(Method::GET, &format!("/v1/jobs/{}/report", id.as_str().unwrap()), "");
    let long = server.post("/v1/iplw", &body(1000), 202)["id"].clone();
    problem(report(&long), 409, "refused");
    server.send(Method::DELETE, &format!("/v1/jobs/{}", long.as_str().unwrap()), "");
    let done = server.finish(&server.post("/v1/iplw", &body(1), 202));
    let page = report(&done["id"]);
    assert_eq!(page.status(), 200);
    assert_eq!(page.headers()["content-type"], "text/html; charset=utf-8");
    assert!(page.headers()["content-security-policy"].to_str().unwrap().contains("sandbox"));
    let html = page.text().unwrap();
    assert!(html.contains("<main class=\"report\">") && html.contains("Settings"), "{html}");
    assert!(!html.contains("<script") && !html.contains("src="));
}

#[test]
fn estimation_counts_interactions_and_reports_progress() {
    let server = Running::start();
    let body = json!({"task": "bowling", "world": "bowling-real", "rounds": 3, "actions": 3, "samples": 12, "budget": 4, "seed": 1});
    let sent = server.send(Method::POST, "/v1/iplw", body.to_string());
    let place = sent.headers()["location"].to_str().unwrap().to_string();
    let job = ok(sent, 202);
    assert_eq!(place, format!("/v1/jobs/{}", job["id"].as_str().unwrap()));
    assert_eq!(job["config"], body);
    let events = server.events(job["id"].as_str().unwrap(), None);
    let ids: Vec<u64> = events.iter().map(|e| e.0).collect();
    assert_eq!(ids, (1..=ids.len() as u64).collect::<Vec<_>>());
    assert!(events[..events.len() - 1].iter().all(|e| e.1 == "progress"));
    let left = |e: &(u64, String, Value)| e.2["progress"]["eta_s"].as_f64();
    assert!(
        events.iter().any(|e| left(e).is_some_and(|s| s >= 0.0)),
        "after a round, the time left is known"
    );
    assert_eq!(left(&events[0]), None);
    let done = server.get(&place);
    assert_eq!(done, events.last().unwrap().2);
    assert_eq!(done["state"], "succeeded", "{done}");
    let result = &done["result"];
    assert_eq!(result["real_interactions"], 4, "the budget holds");
    assert_eq!(result["stopped"], "budget");
    let names: Vec<&str> =
        result["latents"].as_array().unwrap().iter().map(|l| l["name"].as_str().unwrap()).collect();
    assert_eq!(names, ["density", "friction", "restitution"]);
    assert!(
        result["seconds"].as_f64().unwrap() > 0.0 && result["strategy"] == "mixed" && result["seed"] == 1
    );
    assert_eq!(server.get("/v1/worlds/bowling-real")["interactions"], 4);
    // A reconnecting watcher resumes, and gets 204 when there are no more events.
    let rest = server.events(job["id"].as_str().unwrap(), Some(ids[2]));
    assert_eq!(rest, events[3..]);
    assert!(server.events(job["id"].as_str().unwrap(), ids.last().copied()).is_empty());
    let request = server.client.get(format!("{}{place}/events", server.url)).header("Last-Event-ID", "x");
    problem(request.send().unwrap(), 422, "invalid-value");
    // The same seed in a dedicated world gives the same result.
    let own = json!({"task": "bowling", "rounds": 3, "actions": 3, "samples": 12, "budget": 4, "seed": 1});
    let own = server.finish(&server.post("/v1/iplw", &own, 202));
    assert_eq!(own["result"]["latents"], result["latents"]);
    assert_eq!(server.get("/v1/jobs")["jobs"].as_array().unwrap().len(), 2);
    assert_eq!(server.send(Method::DELETE, &place, "").status(), 204);
    problem(server.send(Method::GET, &place, ""), 404, "not-found");
}

#[test]
fn jobs_have_names_notes_times_and_summaries() {
    let server = Running::start();
    let ask = json!({"task": "bowling", "rounds": 1, "actions": 2, "samples": 8});
    let job = server.post("/v1/iplw", &ask, 202);
    assert_eq!((&job["name"], &job["note"], &job["owner"]), (&json!(""), &json!(""), &Value::Null));
    assert_eq!((&job["started"], &job["ended"], &job["summary"]), (&Value::Null, &Value::Null, &Value::Null));
    let path = format!("/v1/jobs/{}", job["id"].as_str().unwrap());
    let patch = |body: Value| ok(server.send(Method::PATCH, &path, body.to_string()), 200);
    assert_eq!(patch(json!({"name": "Bowling on felt"}))["name"], "Bowling on felt");
    let done = server.finish(&job);
    let at = |name: &str| done[name].as_f64().unwrap();
    assert!(
        at("created") > 1.7e9 && at("created") <= at("started") && at("started") <= at("ended"),
        "{done}"
    );
    let summary = done["summary"].as_str().unwrap();
    assert!(!summary.is_empty());
    let noted = patch(json!({"note": "two\nlines"}));
    assert_eq!((&noted["name"], &noted["note"]), (&json!("Bowling on felt"), &json!("two\nlines")));
    assert_eq!(patch(json!({"note": "two\nlines"})), noted, "a repetition changes nothing");
    assert_eq!(patch(json!({})), noted);
    let bare = &server.get("/v1/jobs?results=false")["jobs"][0];
    assert_eq!((&bare["result"], &bare["summary"]), (&Value::Null, &json!(summary)));
    assert_eq!(server.get(&path), noted);
    assert_eq!(patch(json!({"name": "", "note": ""}))["name"], "");
}

#[test]
fn cancels_jobs_and_bounds_their_queue() {
    let server = Running::with(ServeConfig {
        limits: Limits { jobs_running: 1, jobs_waiting: 1, ..Limits::default() },
        ..ServeConfig::default()
    })
    .unwrap();
    let endless = json!({"task": "bowling", "rounds": 1000, "actions": 50, "samples": 1000});
    let running = server.post("/v1/iplw", &endless, 202);
    let path = format!("/v1/jobs/{}", running["id"].as_str().unwrap());
    // The events show when it has started.
    let events = server.client.get(format!("{}{path}/events", server.url)).send().unwrap();
    let mut lines = BufReader::new(events).lines();
    assert!(lines.by_ref().any(|l| l.unwrap().contains("\"running\"")));
    let waiting = server.post("/v1/iplw", &endless, 202);
    assert_eq!(waiting["state"], "queued");
    problem(server.send(Method::POST, "/v1/iplw", endless.to_string()), 429, "capacity");
    let gone =
        ok(server.send(Method::DELETE, &format!("/v1/jobs/{}", waiting["id"].as_str().unwrap()), ""), 202);
    assert_eq!(gone["state"], "cancelled");
    ok(server.send(Method::DELETE, &path, ""), 202);
    assert!(lines.any(|l| l.unwrap() == "event: done"));
    let ended = server.get(&path);
    assert_eq!(
        (&ended["state"], &ended["result"], &ended["error"]),
        (&json!("cancelled"), &Value::Null, &Value::Null)
    );
    assert_eq!(server.send(Method::DELETE, &path, "").status(), 204);
}

/// Regression: every family was trained with bowling's batch size.
#[test]
fn trains_with_the_batch_size_of_the_family() {
    let server = Running::start();
    for family in iplw::task::families() {
        let body = json!({"task": format!("{}:000", family.name), "batches": 1});
        let trained = server.finish(&server.post("/v1/policies", &body, 202));
        assert_eq!(trained["result"]["config"]["batch_size"], family.learning.batch_size, "{trained}");
    }
}

#[test]
fn training_reports_loss_and_validation() {
    let server = Running::start();
    let body = json!({"task": "basketball:000", "batches": 12, "batch_size": 4, "validations": 3, "seed": 3});
    let job = server.post("/v1/policies", &body, 202);
    let events = server.events(job["id"].as_str().unwrap(), None);
    let done = &events.last().unwrap().2;
    assert_eq!(done["state"], "succeeded", "{done}");
    let told = |name: &str| -> Vec<(u64, f64)> {
        let all =
            events.iter().flat_map(|e| e.2["progress"]["figures"].as_array().cloned().unwrap_or_default());
        let of = all.filter(|f| f["name"] == name);
        of.map(|f| (f["at"].as_u64().unwrap(), f["value"].as_f64().unwrap())).collect()
    };
    let loss = done["result"]["loss"].as_array().unwrap();
    let losses: Vec<(u64, f64)> = (1..).zip(loss.iter().map(|v| v.as_f64().unwrap())).collect();
    assert!(told("loss").iter().zip(&losses).all(|(a, b)| a.0 == b.0 && (a.1 - b.1).abs() < 1e-6));
    assert_eq!((told("loss").len(), losses.len()), (12, 12));
    let checks = done["result"]["validation"].as_array().unwrap();
    let checks: Vec<(u64, f64)> =
        checks.iter().map(|c| (c["batches"].as_u64().unwrap(), c["auccess"].as_f64().unwrap())).collect();
    assert_eq!(checks.iter().map(|c| c.0).collect::<Vec<_>>(), [0, 4, 8, 12]);
    assert!(checks.iter().all(|c| (0.0..=1.0).contains(&c.1)), "{checks:?}");
    assert_eq!(told("validation"), checks);
    // Only in events; the finished job has them in its result.
    assert_eq!(
        server.get(&format!("/v1/jobs/{}", job["id"].as_str().unwrap()))["progress"].get("figures"),
        None
    );
    let many = json!({"task": "basketball:000", "validations": 101}).to_string();
    problem(server.send(Method::POST, "/v1/policies", many), 422, "invalid-value");
}

#[test]
fn trains_evaluates_and_transfers_policies() {
    let server = Running::start();
    let body = json!({"task": "bowling:000", "batches": 20, "latents": {"friction": 0.7}, "seed": 3});
    let trained = server.finish(&server.post("/v1/policies", &body, 202));
    assert_eq!(trained["state"], "succeeded", "{trained}");
    assert_eq!(trained["result"]["loss"].as_array().unwrap().len(), 20);
    let id = trained["result"]["policy"].as_str().unwrap();
    let policy = server.get(&format!("/v1/policies/{id}"));
    assert_eq!(
        (&policy["task"], &policy["training"], &policy["job"]),
        (&json!("bowling"), &json!("fixed"), &trained["id"])
    );
    let act = |id: &str| {
        server.post(&format!("/v1/policies/{id}/act"), &json!({"task": "bowling:017", "count": 10}), 200)
    };
    let acted = act(id);
    let scores: Vec<f64> =
        acted["actions"].as_array().unwrap().iter().map(|a| a["score"].as_f64().unwrap()).collect();
    assert!(scores.len() == 10 && scores.is_sorted_by(|a, b| a >= b), "{scores:?}");
    let indices: Vec<&Value> = acted["actions"].as_array().unwrap().iter().map(|a| &a["index"]).collect();
    let tried = server.post(
        "/v1/worlds/bowling-sim/rollout",
        &json!({"task": "bowling:017", "actions": indices}),
        200,
    );
    assert!(
        tried["results"].as_array().unwrap().iter().all(|r| r["valid"] == true),
        "what is proposed can be placed"
    );
    // Download, upload under another name: same actions; upload again: replaced.
    let weights = server.send(Method::GET, &format!("/v1/policies/{id}/weights"), "");
    assert_eq!(weights.headers()["content-type"], "application/octet-stream");
    let weights = weights.bytes().unwrap().to_vec();
    assert_eq!(policy["bytes"], weights.len());
    let put = |status| ok(server.send(Method::PUT, "/v1/policies/copy/weights", weights.clone()), status);
    assert_eq!(put(201)["training"], "uploaded");
    put(200);
    assert_eq!(act("copy"), acted);
    assert_eq!(server.get("/v1/policies")["policies"].as_array().unwrap().len(), 2);
    let cut = server.send(Method::PUT, "/v1/policies/copy/weights", weights[..weights.len() - 5].to_vec());
    problem(cut, 422, "invalid-value");
    assert_eq!(act("copy"), acted, "what was refused changed nothing");
    // A policy of another family is rejected.
    problem(
        server.send(Method::POST, "/v1/policies/copy/act", r#"{"task": "basketball:000"}"#),
        422,
        "invalid-value",
    );
    let other = server.send(Method::POST, "/v1/policies/copy/evaluate", r#"{"world": "basketball-real"}"#);
    assert_eq!(problem(other, 422, "invalid-value")["field"], "world");
    let body = json!({"world": "bowling-real", "attempts": 2});
    let evaluated = server.finish(&server.post("/v1/policies/copy/evaluate", &body, 202));
    let result = &evaluated["result"];
    assert_eq!(evaluated["config"]["policy"], "copy");
    assert_eq!(
        (result["tasks"].as_array().unwrap().len(), result["solved_within"].as_array().unwrap().len()),
        (20, 100)
    );
    let spent = result["interactions"].as_u64().unwrap();
    let needed: u64 =
        result["tasks"].as_array().unwrap().iter().map(|t| t["solved_at"].as_u64().unwrap_or(2)).sum();
    assert!((20..=40).contains(&spent) && needed <= spent, "{result}");
    assert_eq!(server.get("/v1/worlds/bowling-real")["interactions"], spent);
    assert_eq!(server.send(Method::DELETE, "/v1/policies/copy", "").status(), 204);
    problem(server.send(Method::GET, "/v1/policies/copy", ""), 404, "not-found");
}

/// The baselines without simulation: random actions, and direct learning in the real world.
#[test]
fn trains_and_evaluates_baselines_without_simulation() {
    let server = Running::start();
    let evaluate = |id: &str| {
        let body = json!({"world": "bowling-real", "attempts": 3});
        server.finish(&server.post(&format!("/v1/policies/{id}/evaluate"), &body, 202))["result"].clone()
    };
    let chance = evaluate("random");
    for always in ["random", "ranked", "untrained"] {
        assert_eq!(server.get(&format!("/v1/policies/{always}"))["training"], "none");
    }
    assert!(chance["auccess"].as_f64().unwrap() < 0.5, "{chance}");
    // Random actions: reproducible, unordered, and placeable.
    let act = || {
        server.post("/v1/policies/random/act", &json!({"task": "bowling:000", "count": 40}), 200)["actions"]
            .clone()
    };
    let (liked, again) = (act(), act());
    assert_eq!(liked, again);
    let indices: Vec<u64> = liked.as_array().unwrap().iter().map(|a| a["index"].as_u64().unwrap()).collect();
    assert!(indices.len() == 40 && !indices.is_sorted(), "{indices:?}");
    let tried = json!({"task": "bowling:000", "actions": indices});
    let tried = server.post("/v1/worlds/bowling-sim/rollout", &tried, 200);
    assert!(tried["results"].as_array().unwrap().iter().all(|r| r["valid"] == true), "{tried}");
    let before = server.get("/v1/worlds/bowling-real")["interactions"].as_u64().unwrap();
    assert_eq!(before, chance["interactions"].as_u64().unwrap());
    let before = before + evaluate_client_ranking(&server);
    let body = json!({"world": "bowling-real", "attempts": 120, "batches": 10, "seed": 2});
    let learned = server.finish(&server.post("/v1/policies/untrained/learn", &body, 202));
    assert_eq!(learned["state"], "succeeded", "{learned}");
    assert_eq!(learned["config"]["policy"], "untrained");
    let result = &learned["result"];
    assert_eq!((&result["interactions"], &result["world_kind"]), (&json!(120), &json!("real")));
    assert_eq!(server.get("/v1/worlds/bowling-real")["interactions"], before + 120);
    let id = result["policy"].as_str().unwrap();
    assert_eq!(server.get(&format!("/v1/policies/{id}"))["training"], "direct");
    // Fine-tuning creates another policy.
    let on = server.finish(&server.post(&format!("/v1/policies/{id}/learn"), &body, 202));
    let next = on["result"]["policy"].as_str().unwrap();
    assert_ne!(next, id);
    assert_eq!(server.get(&format!("/v1/policies/{next}"))["training"], "learned_on");
    let other =
        server.send(Method::POST, &format!("/v1/policies/{id}/learn"), r#"{"world": "basketball-sim"}"#);
    assert_eq!(problem(other, 422, "invalid-value")["field"], "world");
    let poor = server.post("/v1/worlds", &json!({"task": "bowling", "kind": "real", "budget": 5}), 201);
    let poor = json!({"world": poor["id"], "attempts": 6}).to_string();
    let refused = server.send(Method::POST, "/v1/policies/untrained/learn", poor);
    assert_eq!(problem(refused, 422, "invalid-value")["field"], "attempts");
}

/// Evaluates a client's ranking and returns the number of counted attempts.
fn evaluate_client_ranking(server: &Running) -> u64 {
    let tasks =
        ["bowling:000", "bowling:001"].map(|id| server.get(&format!("/v1/tasks/{}", id.replace(':', "/"))));
    let known = |i: usize| tasks[i]["certificate"]["action"].clone();
    // The first task is solved at once; the second after an unplaceable action (not counted) and a failure.
    let [nowhere, fails] = [json!([0.5, 0.0, 1.0]), json!([0.05, 0.9, 0.0])];
    let ranking = json!([
        {"task": "bowling:000", "actions": [known(0)]},
        {"task": "bowling:001", "actions": [nowhere, fails, known(1)]},
    ]);
    let send = |ranking: &Value| {
        let body = json!({"world": "bowling-real", "ranking": ranking}).to_string();
        server.send(Method::POST, "/v1/policies/ranked/evaluate", body)
    };
    let done = server.finish(&send(&ranking).json().unwrap());
    assert_eq!(done["state"], "succeeded", "{done}");
    let at: Vec<&Value> =
        done["result"]["tasks"].as_array().unwrap().iter().map(|t| &t["solved_at"]).collect();
    assert_eq!(at, [1, 2], "{done}");
    for (wrong, field) in [
        (json!([]), "ranking"),
        (json!([{"task": "basketball:000", "actions": []}]), "ranking[0].task"),
        (json!([{"task": "bowling:000", "actions": [[0.1, 2.0, 0.1]]}]), "ranking[0].actions[0]"),
    ] {
        let refused = problem(send(&wrong), 422, "invalid-value");
        assert!(refused["field"].as_str().unwrap().starts_with(field), "{refused}");
    }
    let other = json!({"world": "bowling-real", "ranking": ranking}).to_string();
    let refused = server.send(Method::POST, "/v1/policies/random/evaluate", other);
    assert_eq!(problem(refused, 422, "invalid-value")["field"], "ranking");
    let both = json!({"world": "bowling-real", "split": "test", "ranking": ranking}).to_string();
    let refused = server.send(Method::POST, "/v1/policies/ranked/evaluate", both);
    assert_eq!(problem(refused, 422, "invalid-value")["field"], "split");
    done["result"]["interactions"].as_u64().unwrap()
}

#[test]
fn computes_stores_and_uses_surfaces() {
    let directory = tempfile::tempdir().unwrap();
    let body = json!({"task": "basketball", "points": 4, "actions": 150, "seed": 5});
    let server = Running::on(directory.path()).unwrap();
    let find = |server: &Running| server.finish(&server.post("/v1/surfaces", &body, 202))["result"].clone();
    let found = find(&server);
    let id = found["surface"].as_str().unwrap().to_string();
    let whole = server.get(&format!("/v1/surfaces/{id}"));
    assert_eq!(whole["surface"]["points"].as_array().unwrap().len(), 4);
    assert_eq!((&whole["task"], &whole["route"]), (&json!("basketball"), &json!("ideal")));
    let drawn = server.send(Method::GET, &format!("/v1/surfaces/{id}/picture"), "");
    assert_eq!(drawn.headers()["content-type"], "image/svg+xml");
    assert!(drawn.text().unwrap().starts_with("<svg"));
    drop(server);
    // It survives a restart and is not computed twice.
    let server = Running::on(directory.path()).unwrap();
    assert_eq!(find(&server), found);
    assert_eq!(server.get("/v1/surfaces")["surfaces"].as_array().unwrap().len(), 1);
    let ask = |surface: &str| json!({"task": "basketball", "strategy": "gradient", "surface": surface, "rounds": 1, "actions": 4, "samples": 12});
    let done = server.finish(&server.post("/v1/iplw", &ask(&id), 202));
    assert_eq!(done["state"], "succeeded", "{done}");
    let groups = &done["result"]["choices"][0]["groups"];
    assert_eq!(groups["collisions"].as_u64().unwrap() + groups["rolling"].as_u64().unwrap(), 4, "{groups}");
    let other = json!({"task": "bowling", "strategy": "gradient", "surface": id});
    let refused = server.send(Method::POST, "/v1/iplw", other.to_string());
    assert_eq!(problem(refused, 422, "invalid-value")["field"], "surface");
    assert_eq!(server.send(Method::DELETE, &format!("/v1/surfaces/{id}"), "").status(), 204);
    problem(server.send(Method::POST, "/v1/iplw", ask(&id).to_string()), 404, "not-found");
    // Without a surface, the strategy computes a small one, which is stored.
    let mut unnamed = ask(&id);
    unnamed.as_object_mut().unwrap().remove("surface");
    let done = server.finish(&server.post("/v1/iplw", &unnamed, 202));
    assert_eq!(done["state"], "succeeded", "{done}");
    assert_eq!(server.get("/v1/surfaces")["surfaces"][0]["task"], "basketball");
}

/// A training request with a posterior of these columns, and further fields.
fn train_request(columns: Value, more: Value) -> String {
    let mut body =
        json!({"task": "bowling", "posterior": {"format": "iplw.posterior/2", "columns": columns}});
    body.as_object_mut().unwrap().extend(more.as_object().unwrap().clone());
    body.to_string()
}

/// One draw equals a fixed simulation; two draws give labels of both. Responses do not contain the draws.
#[test]
fn trains_policies_under_a_posterior() {
    let server = Running::start();
    let columns = |restitution: Value| {
        let n = restitution.as_array().unwrap().len();
        json!({"density": vec![1.0; n], "friction": vec![0.2; n], "restitution": restitution})
    };
    let under = |more: Value| {
        let mut body = json!({"task": "basketball", "batches": 3, "batch_size": 4, "seed": 3});
        body.as_object_mut().unwrap().extend(more.as_object().unwrap().clone());
        let done = server.finish(&server.post("/v1/policies", &body, 202));
        assert_eq!(done["state"], "succeeded", "{done}");
        done
    };
    let believed = |restitution: Value| {
        under(
            json!({"posterior": {"format": "iplw.posterior/2", "columns": columns(restitution), "seconds": 2}}),
        )
    };
    let point = under(json!({"latents": {"density": 1, "friction": 0.2, "restitution": 0.7}}));
    let (one, two) = (believed(json!([0.7])), believed(json!([0.7, 0.3])));
    let figures = |job: &Value| ["loss", "examples", "solving"].map(|f| job["result"][f].clone());
    assert_eq!(figures(&one), figures(&point));
    assert_ne!(figures(&two), figures(&point));
    assert_eq!(two["result"]["training"], json!({"type": "believed", "draws": 2}));
    assert_eq!(two["config"]["posterior"], json!({"type": "believed", "draws": 2}));
    let policy = server.get(&format!("/v1/policies/{}", two["result"]["policy"].as_str().unwrap()));
    assert_eq!((&policy["training"], &policy["config"]), (&json!("believed"), &two["config"]));
}

#[test]
fn saturating_training_stops_early() {
    let server = Running::start();
    let body = json!({"task": "basketball", "preset": "saturating", "batch_size": 8, "seed": 3});
    let done = server.finish(&server.post("/v1/policies", &body, 202));
    assert_eq!(done["state"], "succeeded", "{done}");
    let checks = done["result"]["validation"].as_array().unwrap();
    let all = checks.last().unwrap()["batches"].as_u64().unwrap();
    assert!((2..=16).contains(&checks.len()) && all == 1000 * checks.len() as u64, "{checks:?}");
    assert_eq!(done["result"]["loss"].as_array().unwrap().len() as u64, all);
    assert_eq!(done["result"]["config"]["batches"], 1000);
    assert_eq!(done["result"]["labels"]["per_task"], 1000);
    // The best weights are kept, the latest of equals.
    let best = checks.iter().map(|c| c["auccess"].as_f64().unwrap()).fold(0.0, f64::max);
    let kept = checks.iter().rfind(|c| c["auccess"] == best).unwrap();
    assert_eq!(done["result"]["batches"], kept["batches"]);
}

/// A plan request with a posterior of these columns.
fn plan_request(columns: Value, format: &str) -> String {
    let belief = json!({"format": format, "columns": columns, "effects": []});
    json!({"task": "bowling:000", "posterior": belief}).to_string()
}

/// Plans under the prior, one world and a posterior; one that runs out of rollouts reports it.
#[test]
fn computes_plans() {
    let server = Running::start();
    let small = |more: Value| {
        let mut body = json!({"task": "basketball:003", "actions": 200, "draws": 6, "exact": 3, "seed": 4});
        body.as_object_mut().unwrap().extend(more.as_object().unwrap().clone());
        let done = server.finish(&server.post("/v1/plans", &body, 202));
        assert_eq!(done["state"], "succeeded", "{done}");
        done["result"].clone()
    };
    let posterior = json!({"format": "iplw.posterior/2", "seconds": 3.5,
        "columns": {"friction": [0.2, 0.25, 0.2], "restitution": [0.7, 0.68, 0.71], "linear_drag.c": [0.22, null, 0.3]}});
    let beliefs = [
        (json!({}), "prior", 1024),
        (
            json!({"latents": {"friction": 0.2}, "effects": [{"name": "wind", "parameters": {"ax": 0.1}}]}),
            "point",
            1,
        ),
        (json!({"posterior": posterior}), "posterior", 3),
    ];
    for (belief, source, draws) in beliefs {
        let plan = small(belief);
        assert_eq!(plan["format"], "iplw.plan/1");
        assert_eq!(plan["posterior"], json!({"source": source, "draws": draws}));
        assert_eq!((&plan["complete"], &plan["candidates"]), (&json!(true), &json!(200)));
        let rows = plan["actions"].as_array().unwrap();
        assert_eq!(rows.len(), 100);
        for row in &rows[..3] {
            assert_eq!(row["draws"], 6);
            assert!((0.0..=1.0).contains(&row["probability"].as_f64().unwrap()), "{row}");
            assert!(row["standard_error"].as_f64().unwrap() > 0.0);
        }
        assert!(rows[3..].iter().all(|row| row["probability"].is_null()));
    }
    assert_eq!(small(json!({})), small(json!({})), "a seed's plan is one plan");
    let few = small(json!({"rollouts": 50}));
    assert_eq!((&few["complete"], &few["rollouts"]), (&json!(false), &json!(50 + 3 * 6)));
}

/// Diagnoses uploaded trials and those of an estimation.
#[test]
fn diagnoses_measured_trials() {
    let server = Running::start();
    let trials = worlds::trials(&worlds::single(1, 3), worlds::Noise::White, 10, 30, 8.0, 5);
    let scene: Value = serde_json::from_str(&worlds::scene().to_json()).unwrap();
    let body = json!({"scene": scene, "trials": iplw::reality::trials_to_csv(&trials)});
    let done = server.finish(&server.post("/v1/diagnoses", &body, 202));
    assert_eq!(done["state"], "succeeded", "{done}");
    assert_eq!(done["config"]["trials"], 10);
    let result = &done["result"];
    assert_eq!(result["format"], "iplw.diagnosis/2");
    let sets = result["rivals"].as_array().unwrap();
    assert!(sets.contains(&json!(["quadratic_drag"])), "{sets:?}");
    assert_eq!(result["extended_scene"]["format"], "iplw.scene/1");
    let next = &result["next_scene"];
    let launched = next["format"] == "iplw.scene/1" && next["bodies"][0]["position"].is_array();
    assert!(next.is_null() || launched && result["next_experiment"].is_object(), "{next}");
    let points = &result["evidence"]["points"];
    assert_eq!(points["columns"].as_array().unwrap().len(), points["rows"][0].as_array().unwrap().len());
    assert_eq!(result["evidence"]["autocorrelation"][0][0], 1.0);
    let run = json!({"task": "basketball", "rounds": 1, "actions": 4, "samples": 12});
    let run = server.finish(&server.post("/v1/iplw", &run, 202));
    let of_run = server.finish(&server.post("/v1/diagnoses", &json!({"job": run["id"]}), 202));
    assert_eq!((&of_run["state"], &of_run["config"]["trials"]), (&json!("succeeded"), &json!(4)), "{of_run}");
    let untrialled = server.send(Method::POST, "/v1/diagnoses", json!({"job": of_run["id"]}).to_string());
    problem(untrialled, 409, "refused");
    let roundless = format!("/v1/iplw/{}/rounds", of_run["id"].as_str().unwrap());
    problem(server.send(Method::GET, &roundless, String::new()), 409, "refused");
    // The trials of a diagnosis are listed in pages.
    let given = |job: &Value, query: &str| {
        let path = format!("/v1/diagnoses/{}/trials?{query}", job["id"].as_str().unwrap());
        server.send(Method::GET, &path, "")
    };
    problem(given(&run, ""), 409, "refused");
    let first = ok(given(&done, "limit=6"), 200);
    let last = ok(given(&done, &format!("limit=6&cursor={}", first["next"].as_str().unwrap())), 200);
    assert_eq!((&first["scene"], &last["next"]), (&scene, &Value::Null));
    let pages = [&first, &last].map(|page| page["trials"].as_array().unwrap());
    assert_eq!(pages.map(Vec::len), [6, 4]);
    for (told, trial) in pages.into_iter().flatten().zip(&trials) {
        assert_eq!((&told["trial"], &told["t"]), (&json!(trial.name), &json!(trial.observed.times)));
        let track = &trial.observed.bodies[0];
        assert_eq!(told["bodies"][&track.name]["x"], json!(track.x));
    }
    assert_eq!(ok(given(&of_run, ""), 200)["trials"].as_array().unwrap().len(), 4);
}

/// Tracks of one ball need no scene; errors name the field of the request.
#[test]
fn diagnoses_tracks_of_one_ball() {
    let server = Running::start();
    let films = worlds::trials(&worlds::single(1, 3), worlds::Noise::White, 6, 30, 8.0, 5);
    let text = |size: f64| {
        let film = |trial: &iplw::reality::Trial| {
            let (track, times) = (&trial.observed.bodies[0], trial.observed.times.iter().enumerate());
            let rows = times.map(|(k, t)| format!("{t};{};{}\n", track.x[k] / size, track.y[k] / size));
            (trial.name.clone(), Value::from(format!("time;pos_x;pos_y\n{}", rows.collect::<String>())))
        };
        films.iter().map(film).collect::<serde_json::Map<_, _>>()
    };
    let ball = json!({"radius": 0.02});
    let body = json!({"ball": ball, "trials": text(0.002), "reading": {"metres_per_pixel": 0.002}});
    let done = server.finish(&server.post("/v1/diagnoses", &body, 202));
    assert_eq!((&done["state"], &done["config"]["trials"]), (&json!("succeeded"), &json!(6)), "{done}");
    assert_eq!(done["result"]["extended_scene"]["gravity"], json!([0.0, -9.81]));
    for (body, field) in [
        (json!({"ball": ball, "trials": text(0.002)}), "trials.x, y"),
        (json!({"ball": {"radius": -1}, "trials": text(1.0)}), "ball.radius"),
        (json!({"ball": ball, "trials": text(1.0), "reading": {"fps": 0}}), "reading.fps"),
        (json!({"ball": ball, "trials": {"a": "t,x,y\n0,1,?\n"}}), "trials.y"),
        (json!({"ball": ball, "trials": {}}), "trials"),
        (json!({"ball": ball, "trials": 3}), "trials"),
        (json!({"ball": ball, "job": "job-1"}), "job"),
    ] {
        let answer = server.send(Method::POST, "/v1/diagnoses", body.to_string());
        let (status, problem): (_, Value) = (answer.status(), answer.json().unwrap());
        assert!([400, 422].contains(&status.as_u16()), "{problem}");
        assert_eq!(problem["field"], field, "{problem}");
    }
}

#[test]
fn jobs_and_policies_survive_a_restart_and_directories_are_locked() {
    let directory = tempfile::tempdir().unwrap();
    let (ended, running, policy, weights) = {
        let server = Running::on(directory.path()).unwrap();
        let refused = Running::on(directory.path()).err().unwrap();
        assert!(refused.to_string().contains("in use by another server"), "{refused}");
        let body = json!({"task": "bowling:000", "batches": 5, "training": "randomised"});
        let ended = server.finish(&server.post("/v1/policies", &body, 202));
        let id = ended["result"]["policy"].as_str().unwrap().to_string();
        let weights = server.send(Method::GET, &format!("/v1/policies/{id}/weights"), "").bytes().unwrap();
        let endless = json!({"task": "bowling", "rounds": 1000, "actions": 50, "samples": 1000});
        let running = server.post("/v1/iplw", &endless, 202);
        (ended, running, server.get(&format!("/v1/policies/{id}")), weights)
    };
    let server = Running::on(directory.path()).unwrap();
    assert_eq!(server.get(&format!("/v1/jobs/{}", ended["id"].as_str().unwrap())), ended);
    let again = server.get(&format!("/v1/jobs/{}", running["id"].as_str().unwrap()));
    assert!(["queued", "running"].contains(&again["state"].as_str().unwrap()), "{again}");
    ok(server.send(Method::DELETE, &format!("/v1/jobs/{}", running["id"].as_str().unwrap()), ""), 202);
    let id = policy["id"].as_str().unwrap();
    assert_eq!(server.get(&format!("/v1/policies/{id}")), policy);
    assert_eq!(server.send(Method::GET, &format!("/v1/policies/{id}/weights"), "").bytes().unwrap(), weights);
    // Job numbers continue.
    let next = server.post("/v1/policies", &json!({"task": "bowling:000", "batches": 1}), 202);
    assert_eq!(next["id"], "job-3");
    assert_eq!(
        server.events(ended["id"].as_str().unwrap(), None).len(),
        1,
        "of an old job only the end is known"
    );
}

#[test]
fn worlds_expire_and_are_limited() {
    let now = Arc::new(AtomicU64::new(0));
    let clock = now.clone();
    let server = Running::with(ServeConfig {
        limits: Limits { world_idle_seconds: 600.0, worlds: 6, ..Limits::default() },
        clock: Arc::new(move || Duration::from_secs(clock.load(Ordering::SeqCst))),
        ..ServeConfig::default()
    })
    .unwrap();
    let make = || server.send(Method::POST, "/v1/worlds", r#"{"task": "bowling"}"#);
    let id = |r: Response| format!("/v1/worlds/{}", ok(r, 201)["id"].as_str().unwrap());
    let (used, unused) = (id(make()), id(make()));
    assert!(problem(make(), 429, "capacity")["detail"].as_str().unwrap().contains("delete worlds"));
    now.store(500, Ordering::SeqCst);
    server.get(&used);
    now.store(700, Ordering::SeqCst);
    problem(server.send(Method::GET, &unused, ""), 404, "not-found");
    server.get(&used);
    now.store(100_000, Ordering::SeqCst);
    let left = server.get("/v1/worlds");
    let left: Vec<&str> =
        left["worlds"].as_array().unwrap().iter().map(|w| w["id"].as_str().unwrap()).collect();
    assert_eq!(left, ["basketball-real", "basketball-sim", "bowling-real", "bowling-sim"]);
    assert_ne!(id(make()), used, "ids are not used again");
    assert_eq!(server.send(Method::DELETE, "/v1/worlds/bowling-sim", "").status(), 204);
    problem(server.send(Method::POST, "/v1/worlds/bowling-sim/reset", ""), 404, "not-found");
}

#[test]
fn counts_concurrent_clients() {
    let server = Running::start();
    let valid = action(&server, "bowling:000", true);
    let before = server.get("/v1/worlds/bowling-sim")["interactions"].as_u64().unwrap();
    let body = json!({"task": "bowling:000", "actions": vec![valid; 8]});
    std::thread::scope(|scope| {
        for _ in 0..8 {
            scope.spawn(|| {
                for world in ["bowling-sim", "bowling-real"] {
                    server.post(&format!("/v1/worlds/{world}/rollout"), &body, 200);
                }
            });
        }
    });
    assert_eq!(server.get("/v1/worlds/bowling-sim")["interactions"], before + 64);
    assert_eq!(server.get("/v1/worlds/bowling-real")["interactions"], 64);
}

#[test]
fn lists_effects_as_worlds_accept_them() {
    let server = Running::start();
    let all = server.get("/v1/effects");
    let effects = all["effects"].as_array().unwrap();
    assert!(
        effects.iter().any(|e| e["name"] == "linear_drag" && e["parameters"][0]["unit"] == "1/s"),
        "{all}"
    );
    let first = server.get("/v1/effects?limit=1");
    assert_eq!(first["effects"], json!([effects[0]]));
    let rest = server.get(&format!("/v1/effects?cursor={}", first["next"].as_str().unwrap()));
    assert_eq!(rest["effects"].as_array().unwrap()[..], effects[1..]);
}

#[test]
fn other_endpoints_respond() {
    let server = Running::start();
    assert_eq!(server.get("/healthz")["status"], "ok");
    assert_eq!(server.get("/readyz")["status"], "ready");
    assert_eq!(server.get("/openapi.json")["openapi"], "3.1.0");
    let docs = server.send(Method::GET, "/docs", "");
    assert_eq!(docs.status(), 200);
    assert!(docs.text().unwrap().contains("swagger-ui.css"));
    assert_eq!(
        server.send(Method::GET, "/docs/swagger-ui-bundle.js", "").status(),
        200,
        "nothing is fetched from elsewhere"
    );
    let metrics = server.send(Method::GET, "/metrics", "").text().unwrap();
    for name in
        ["requests_total{", "errors_total{", "worlds{", "interactions_total{", "rollouts_total ", "jobs{"]
    {
        assert!(metrics.contains(&format!("iplw_{name}")), "{name} in {metrics}");
    }
    assert_eq!(server.get("/v1/policies"), json!({"policies": [], "next": null}));
    assert_eq!(server.get("/v1/jobs"), json!({"jobs": [], "next": null}));
    assert_eq!(server.send(Method::HEAD, "/healthz", "").status(), 405);
    let bound = ServeConfig {
        http: server.url.trim_start_matches("http://").parse().unwrap(),
        ..ServeConfig::default()
    };
    let runtime = tokio::runtime::Runtime::new().unwrap();
    let taken = runtime.block_on(Server::bind(bound)).err().unwrap();
    assert!(taken.to_string().contains("cannot listen"), "{taken}");
}
