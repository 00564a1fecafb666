//! Event streams of worlds, and logs of jobs, over real sockets.

use std::io::{BufRead, BufReader, Lines};

use iplw::serve::ServeConfig;
use reqwest::Method;
use reqwest::blocking::Response;
use serde_json::{Value, json};

use crate::http::{Running, problem};

/// Server-sent events: number, name, data.
struct Events(Lines<BufReader<Response>>);

impl Events {
    fn of(server: &Running, world: &str, after: Option<u64>) -> Events {
        let request = server.client.get(format!("{}/v1/worlds/{world}/events", server.url));
        let request = match after {
            Some(after) => request.header("Last-Event-ID", after.to_string()),
            None => request,
        };
        let response = request.send().unwrap();
        assert_eq!(response.status().as_u16(), 200);
        assert_eq!(response.headers()["content-type"], "text/event-stream");
        Events(BufReader::new(response).lines())
    }
}

impl Iterator for Events {
    type Item = (Option<u64>, String, Value);

    fn next(&mut self) -> Option<(Option<u64>, String, Value)> {
        let (mut id, mut name, mut data) = (None, String::new(), None);
        for line in self.0.by_ref() {
            let line = line.unwrap();
            match line.split_once(": ") {
                Some(("id", v)) => id = Some(v.parse().unwrap()),
                Some(("event", v)) => name = v.into(),
                Some(("data", v)) => data = Some(serde_json::from_str(v).unwrap()),
                _ if line.is_empty() && data.is_some() => return Some((id, name, data?)),
                _ => {}
            }
        }
        None
    }
}

fn start() -> Running {
    Running::with(ServeConfig::default()).unwrap()
}

fn create(server: &Running, of: Value) -> String {
    server.post("/v1/worlds", &of, 201)["id"].as_str().unwrap().to_string()
}

#[test]
fn watchers_receive_clients_actions() {
    let server = start();
    let world = create(&server, json!({"task": "bowling", "kind": "real", "budget": 9}));
    let (action, path) =
        (server.get("/v1/tasks/bowling/0")["certificate"]["action"].clone(), format!("/v1/worlds/{world}"));
    let mut events = Events::of(&server, &world, None);
    let (id, name, first) = events.next().unwrap();
    assert_eq!((id, name.as_str(), &first["world"]["id"]), (None, "world", &json!(world)));
    assert_eq!(first["world"]["latents"], Value::Null);
    assert_eq!(first["scene"]["bodies"].as_array().unwrap().len(), 3);
    server.post(&format!("{path}/reset"), &json!({"task": "bowling:000"}), 200);
    server.post(&format!("{path}/step"), &json!({"action": [0.0, 0.0, 1.0]}), 200);
    let step = server.post(&format!("{path}/step"), &json!({"action": action}), 200);
    let rollout = json!({"actions": [action], "task": "bowling:000", "trajectories": true});
    let rolled = server.post(&format!("{path}/rollout"), &rollout, 200);
    let told: Vec<_> = events.by_ref().take(4).collect();
    assert_eq!(told.iter().map(|t| t.0.unwrap()).collect::<Vec<_>>(), [1, 2, 3, 4]);
    let names: Vec<&str> = told.iter().map(|t| t.1.as_str()).collect();
    assert_eq!(names, ["reset", "step", "step", "attempts"]);
    assert_eq!((&told[0].2["task"], &told[0].2["interactions"]), (&json!("bowling:000"), &json!(0)));
    let refused = &told[1].2;
    assert_eq!((&refused["valid"], refused.get("film")), (&json!(false), None));
    assert!(refused["reason"].as_str().unwrap().len() > 3);
    let done = &told[2].2;
    for field in ["valid", "solved", "steps", "end", "interactions"] {
        assert_eq!(done[field], step["info"][field], "{field}");
    }
    assert_eq!(done["action"], action);
    // The recording is the observed trajectory in single precision.
    let (film, whole) = (&told[3].2["film"], &rolled["results"][0]);
    assert_eq!(told[3].2["attempts"], json!({"tried": 1, "valid": 1, "solved": 1}));
    let numbers = |v: &Value| v.as_array().unwrap().iter().map(|x| x.as_f64().unwrap()).collect::<Vec<_>>();
    for (drawn, seen) in
        numbers(&film["bodies"]["red"]["x"]).iter().zip(numbers(&whole["bodies"]["red"]["x"]))
    {
        assert!((drawn - seen).abs() < 1e-5 * seen.abs().max(1.0));
    }
    assert_eq!(numbers(&film["t"]).len(), numbers(&whole["t"]).len());
    // A reconnecting watcher resumes; a new one gets all buffered events.
    let numbers =
        |after| -> Vec<u64> { Events::of(&server, &world, after).take(3).filter_map(|e| e.0).collect() };
    assert_eq!(numbers(Some(2)), [3, 4]);
    assert_eq!(numbers(None), [1, 2]);
    assert_eq!(server.send(Method::DELETE, &path, "").status(), 204);
    let last: Vec<_> = events.collect();
    assert_eq!((last.len(), last[0].1.as_str()), (1, "gone"));
    problem(server.send(Method::GET, &format!("{path}/events"), ""), 404, "not-found");
}

#[test]
fn watching_does_not_count_as_use_and_jobs_appear_as_counts() {
    let server = start();
    let mut events = Events::of(&server, "bowling-real", None);
    events.next().unwrap();
    let asked = json!({"task": "bowling", "world": "bowling-real", "rounds": 1, "actions": 2, "samples": 8});
    server.finish(&server.post("/v1/iplw", &asked, 202));
    let (_, name, told) = events.next().unwrap();
    assert_eq!(name, "attempts");
    assert!(
        told["attempts"]["tried"].as_u64() >= Some(1)
            && told.get("film").is_none()
            && told.get("action").is_none()
    );
    let sim = create(&server, json!({"task": "bowling"}));
    let mut events = Events::of(&server, &sim, None);
    events.next().unwrap();
    server.post(&format!("/v1/worlds/{sim}/set_latents"), &json!({"friction": 0.25}), 200);
    assert_eq!(events.next().unwrap().2["latents"]["friction"], 0.25);
    problem(
        server
            .client
            .get(format!("{}/v1/worlds/{sim}/events", server.url))
            .header("Last-Event-ID", "x")
            .send()
            .unwrap(),
        422,
        "invalid-value",
    );
}

#[test]
fn lists_worlds_by_last_use() {
    let server = start();
    let body = json!({"task": "bowling", "count": 30});
    let create: Vec<String> =
        serde_json::from_value(server.post("/v1/batch/worlds", &body, 201)["worlds"].clone()).unwrap();
    server.get(&format!("/v1/worlds/{}", create[7]));
    let page = server.get("/v1/worlds?order=used&limit=10");
    assert_eq!(page["worlds"][0]["id"], create[7].as_str());
    assert_eq!((&page["worlds"][0]["owner"], &page["worlds"][0]["idle_s"]), (&Value::Null, &json!(0)));
    let mut all: Vec<String> = Vec::new();
    let mut cursor = String::new();
    loop {
        let page = server.get(&format!("/v1/worlds?order=used&limit=7{cursor}"));
        all.extend(page["worlds"].as_array().unwrap().iter().map(|w| w["id"].as_str().unwrap().to_string()));
        let Some(next) = page["next"].as_str() else { break };
        cursor = format!("&cursor={next}");
    }
    let distinct: std::collections::BTreeSet<&String> = all.iter().collect();
    assert_eq!((all.len(), distinct.len()), (34, 34));
    for bad in ["order=new", "order=used&order=id", "order=id&cursor=bjo"] {
        assert_eq!(server.send(Method::GET, &format!("/v1/worlds?{bad}"), "").status(), 422, "{bad}");
    }
}

#[test]
fn job_logs_are_paged_and_survive_a_restart() {
    let place = tempfile::tempdir().unwrap();
    let config = || ServeConfig { data_dir: Some(place.path().into()), ..ServeConfig::default() };
    let server = Running::with(config()).unwrap();
    let asked = json!({"task": "bowling", "rounds": 1, "actions": 2, "samples": 8});
    let job = server.finish(&server.post("/v1/iplw", &asked, 202))["id"].as_str().unwrap().to_string();
    let path = format!("/v1/jobs/{job}/log");
    let whole = server.get(&path);
    let lines = whole["lines"].as_array().unwrap().clone();
    let text = |line: &Value| line["text"].as_str().unwrap().to_string();
    assert_eq!((text(&lines[0]), text(&lines[1])), ("queued".into(), "started".into()));
    assert_eq!(text(lines.last().unwrap()), "succeeded");
    assert!(lines.iter().any(|l| text(l).contains("measuring the real world")), "{whole}");
    assert!(lines.iter().all(|l| l["at"].as_f64() > Some(1.6e9) && l["level"] == "info"));
    let page = server.get(&format!("{path}?limit=2&after=1"));
    assert_eq!((page["lines"].as_array().unwrap(), page["next"].is_string()), (&lines[1..3].to_vec(), true));
    let next = page["next"].as_str().unwrap();
    assert_eq!(server.get(&format!("{path}?limit=2&after=1&cursor={next}"))["lines"][0], lines[3]);
    assert_eq!(server.get(&format!("{path}?after={}", lines.len()))["lines"], json!([]));
    for bad in ["after=-1", "after=x", "after=18446744073709551615", "tail=3"] {
        assert_eq!(server.send(Method::GET, &format!("{path}?{bad}"), "").status(), 422, "{bad}");
    }
    problem(server.send(Method::GET, "/v1/jobs/job-99/log", ""), 404, "not-found");
    drop(server);
    let server = Running::with(config()).unwrap();
    assert_eq!(server.get(&path), whole);
}
