//! Snapshots and branches over HTTP and ZeroMQ, after a restart, and their errors.

use std::path::Path;

use iplw::serve::ServeConfig;
use reqwest::Method;
use serde_json::{Value, json};

use crate::http::{Running, problem};
use crate::peer::Peer;

const WORLD: &str = "/v1/worlds/bowling-sim";

fn serving(directory: Option<&Path>) -> Running {
    let zmq = Some("tcp://127.0.0.1:*".into());
    let data_dir = directory.map(Into::into);
    Running::with(ServeConfig { data_dir, zmq, ..ServeConfig::default() }).unwrap()
}

/// An action that can be placed, and its result.
fn placed(server: &Running) -> (u64, Value) {
    let ask = |actions: Value| {
        let body = json!({"task": "bowling:002", "actions": actions, "trajectories": true, "stop": false});
        server.post(&format!("{WORLD}/rollout"), &body, 200)["results"].clone()
    };
    let tried = ask(json!((0..32).collect::<Vec<_>>()));
    let action = tried.as_array().unwrap().iter().position(|r| r["valid"] == true).unwrap() as u64;
    (action, tried[action as usize].clone())
}

fn snapshot(server: &Running, action: u64, at: f64) -> Value {
    let body = json!({"task": "bowling:002", "action": action, "at": at, "stop": false});
    server.post(&format!("{WORLD}/snapshot"), &body, 200)
}

fn branch(server: &Running, snapshot: &Value, changes: &Value) -> Value {
    let body = json!({"snapshot": snapshot["snapshot"], "interventions": changes});
    server.post(&format!("{WORLD}/branch"), &body, 200)
}

#[test]
fn snapshots_survive_a_restart_and_unchanged_branches_equal_the_rollout() {
    let place = tempfile::tempdir().unwrap();
    let server = serving(Some(place.path()));
    let (action, plain) = placed(&server);
    let at = plain["t"][3].as_f64().unwrap();
    let taken = snapshot(&server, action, at);
    assert_eq!(taken["bodies"]["green"]["position"][0], plain["bodies"]["green"]["x"][3]);
    assert_eq!(taken["bodies"]["red"]["position"][1], plain["bodies"]["red"]["y"][3]);
    let same = |branched: &Value| {
        assert_eq!(branched["t"], plain["t"]);
        for body in ["red", "green", "blue"] {
            for column in ["x", "y", "angle"] {
                assert_eq!(
                    branched["bodies"][body][column], plain["bodies"][body][column],
                    "{body} {column}"
                );
            }
        }
        assert_eq!((&branched["steps"], &branched["solved"]), (&plain["steps"], &plain["solved"]));
    };
    same(&branch(&server, &taken, &json!([])));
    // Latents set later do not affect the snapshot.
    server.post(&format!("{WORLD}/set_latents"), &json!({"restitution": 0.01}), 200);
    same(&branch(&server, &taken, &json!([])));
    drop(server);
    let server = serving(Some(place.path()));
    same(&branch(&server, &taken, &json!([])));
    let mut peer = Peer::connect(server.zmq.as_ref().unwrap(), None);
    let asked = json!({"id": "bowling-sim", "snapshot": taken["snapshot"]});
    same(&peer.ask("branch_world", &asked)["result"]);
}

#[test]
fn branches_equal_batched_rollouts_with_interventions() {
    let server = serving(None);
    let (action, plain) = placed(&server);
    let at = plain["t"][1].as_f64().unwrap();
    let taken = snapshot(&server, action, at);
    let state = &taken["bodies"]["green"];
    let lists = json!([
        [],
        [{"type": "set", "at": at, "body": "green", "velocity": [2, 3]}],
        [{"type": "remove", "at": at, "body": "blue"}],
        [{"type": "add", "at": at, "body": {"name": "extra", "shape": {"type": "disc", "radius": 0.1}, "position": [1, 40]}}],
        [{"type": "add", "at": at, "body": {"name": "extra", "shape": {"type": "disc", "radius": 0.1},
            "position": state["position"]}}]
    ]);
    let body = json!({"task": "bowling:002", "actions": [action, action, action, action, action], "trajectories": true,
        "stop": false, "interventions": lists});
    let batch = server.post(&format!("{WORLD}/rollout"), &body, 200)["results"].clone();
    assert_eq!(batch[0]["bodies"], plain["bodies"]);
    assert_eq!((&batch[4]["valid"], &batch[4]["solved"]), (&json!(false), &Value::Null));
    assert!(
        batch[4]["reason"].as_str().unwrap().contains("extra overlaps green at"),
        "{}",
        batch[4]["reason"]
    );
    for k in 0..4 {
        let mut changes = lists[k].clone();
        // Interventions default to the time of the snapshot.
        changes
            .as_array_mut()
            .unwrap()
            .iter_mut()
            .for_each(|c| drop(c.as_object_mut().unwrap().remove("at")));
        let one = branch(&server, &taken, &changes);
        for (name, track) in batch[k]["bodies"].as_object().unwrap() {
            assert_eq!(one["bodies"][name]["x"], track["x"], "list {k}, {name}");
            assert_eq!(one["bodies"][name]["y"], track["y"], "list {k}, {name}");
        }
    }
    assert!(batch[2]["bodies"]["blue"]["x"][1].is_f64() && batch[2]["bodies"]["blue"]["x"][2].is_null());
    assert!(batch[3]["bodies"]["extra"]["x"][1].is_null() && batch[3]["bodies"]["extra"]["x"][2].is_f64());
    assert_ne!(batch[1]["bodies"]["green"]["x"][2], plain["bodies"]["green"]["x"][2]);
    // A snapshot of a branch, and its state.
    let later = json!({"task": "bowling:002", "action": action, "at": at + 1.0 / 240.0, "stop": false,
        "interventions": lists[1]});
    let pushed = server.post(&format!("{WORLD}/snapshot"), &later, 200);
    assert_eq!(pushed["bodies"]["green"]["velocity"][0], 2.0);
    let on = branch(&server, &pushed, &json!([]));
    assert_eq!(on["bodies"]["green"]["x"], batch[1]["bodies"]["green"]["x"]);
}

#[test]
fn branches_the_last_step() {
    let server = serving(None);
    let (action, _) = placed(&server);
    let world =
        server.post("/v1/worlds", &json!({"task": "bowling:002"}), 201)["id"].as_str().unwrap().to_string();
    let path = format!("/v1/worlds/{world}");
    problem(
        server.send(Method::POST, &format!("{path}/snapshot"), json!({"at": 0.1}).to_string()),
        409,
        "refused",
    );
    server.post(&format!("{path}/reset"), &json!({}), 200);
    let step = server.post(&format!("{path}/step"), &json!({"action": action}), 200);
    let start = server.post(&format!("{path}/snapshot"), &json!({"at": 0}), 200);
    assert_eq!((&start["step"], &start["bodies"]["green"]["velocity"]), (&json!(0), &json!([0.0, 0.0])));
    let other = json!({"at": 0.1, "task": "bowling:003"});
    let refused = problem(
        server.send(Method::POST, &format!("{path}/snapshot"), other.to_string()),
        422,
        "invalid-value",
    );
    assert_eq!(refused["field"], "task");
    let taken = server.post(&format!("{path}/snapshot"), &json!({"at": 0.1}), 200);
    assert_eq!((taken["step"].as_u64(), taken["snapshot"]["task"].as_str()), (Some(24), Some("bowling:002")));
    let on = server.post(&format!("{path}/branch"), &json!({"snapshot": taken["snapshot"]}), 200);
    assert_eq!((&on["steps"], &on["solved"]), (&step["info"]["steps"], &step["info"]["solved"]));
}

#[test]
fn rejects_branching_real_worlds_and_invalid_interventions() {
    let server = serving(None);
    let (action, _) = placed(&server);
    let at = 0.5;
    let remove = json!([[{"type": "remove", "at": at, "body": "blue"}]]);
    let asked = json!({"task": "bowling:002", "action": action, "at": at});
    let batch = json!({"task": "bowling:002", "actions": [action], "interventions": remove});
    let taken = snapshot(&server, action, at);
    for (path, body) in
        [("snapshot", &asked), ("branch", &json!({"snapshot": taken["snapshot"]})), ("rollout", &batch)]
    {
        let refused = server.send(Method::POST, &format!("/v1/worlds/bowling-real/{path}"), body.to_string());
        problem(refused, 403, "sealed");
    }
    assert_eq!(server.get("/v1/worlds/bowling-real")["interactions"], 0);
    let sealed = server.post("/v1/worlds", &json!({"task": "bowling:002", "sealed": true}), 201);
    let path = format!("/v1/worlds/{}/rollout", sealed["id"].as_str().unwrap());
    problem(server.send(Method::POST, &path, batch.to_string()), 403, "sealed");

    let rollouts = |lists: Value, actions: usize| {
        let body = json!({"task": "bowling:002", "actions": vec![action; actions], "interventions": lists});
        problem(
            server.send(Method::POST, &format!("{WORLD}/rollout"), body.to_string()),
            422,
            "invalid-value",
        )
    };
    let impulse = |body: &str, at: f64| json!({"type": "impulse", "at": at, "body": body, "impulse": [1, 0]});
    assert_eq!(rollouts(json!([[], [impulse("ghost", 0.5)]]), 2)["field"], "interventions[1][0].body");
    assert_eq!(rollouts(json!([[impulse("green", 1e6)]]), 2)["field"], "interventions[0][0].at");
    assert_eq!(
        rollouts(json!([[{"type": "remove", "body": "green"}]]), 1)["field"],
        "interventions[0][0].at"
    );
    assert_eq!(rollouts(json!([[], []]), 3)["field"], "interventions");
    assert_eq!(rollouts(json!([vec![impulse("green", 0.5); 65]]), 1)["field"], "interventions[0]");

    let branches = |snapshot: &Value, changes: Value| {
        let body = json!({"snapshot": snapshot, "interventions": changes});
        problem(server.send(Method::POST, &format!("{WORLD}/branch"), body.to_string()), 422, "invalid-value")
    };
    let good = &taken["snapshot"];
    assert_eq!(branches(good, json!([impulse("green", 0.2)]))["field"], "interventions[0].at");
    let huge = json!([{"type": "impulse", "body": "green", "impulse": [1e9, 0]}]);
    assert_eq!(branches(good, huge)["field"], "interventions[0].impulse");
    let with = |field: &str, value: Value| {
        let mut other = good.clone();
        other[field] = value;
        other
    };
    for (field, value) in
        [("world", json!("other")), ("format", json!("iplw.snapshot/9")), ("at", json!(-1.0))]
    {
        assert_eq!(branches(&with(field, value), json!([]))["field"], format!("snapshot.{field}"));
    }
    // Results reserve space for every body that any list adds.
    let add = |i: usize| {
        let body =
            json!({"name": format!("x{i}"), "shape": {"type": "disc", "radius": 0.1}, "position": [1, 30]});
        json!([{"type": "add", "at": 0.5, "body": body}])
    };
    let many: Vec<Value> = (0..1000).map(add).collect();
    let body = json!({"task": "bowling:002", "actions": vec![action; 1000], "interventions": many, "trajectories": true});
    let large = server.send(Method::POST, &format!("{WORLD}/rollout"), body.to_string());
    assert_eq!(large.status(), 413, "{}", large.text().unwrap());

    let late = json!({"task": "bowling:002", "action": action, "at": 1e3});
    problem(server.send(Method::POST, &format!("{WORLD}/snapshot"), late.to_string()), 422, "invalid-value");
}
