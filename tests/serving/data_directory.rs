//! The data directory as users see it: records damaged at run time, the commands that check, back up and restore it while
//! a server runs, and retention of jobs.

use std::path::Path;
use std::process::{Command, Output};

use iplw::serve::{Limits, ServeConfig};
use iplw::store::{PolicyRow, Store};
use reqwest::Method;
use rusqlite::Connection;
use serde_json::{Value, json};

use crate::http::{Running, problem};
use crate::peer::Peer;

fn serving(directory: &Path, limits: Limits) -> Running {
    let zmq = Some("tcp://127.0.0.1:*".into());
    let data_dir = Some(directory.into());
    Running::with(ServeConfig { data_dir, zmq, limits, ..ServeConfig::default() }).unwrap()
}

fn put_policies(directory: &Path, owner: Option<&str>) {
    let store = Store::open(directory).unwrap();
    for id in ["p", "q", "r"] {
        let policy = PolicyRow {
            id: id.into(),
            task: "bowling".into(),
            training: "fixed".into(),
            about: "of a test".into(),
            config: Value::Null,
            job: None,
            version: String::new(),
            bytes: 3,
            owner: owner.map(String::from),
        };
        store.put_policy(&policy, &[1, 2, 3], None).unwrap();
    }
}

fn iplw(args: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_iplw")).args(args).output().unwrap()
}

/// Exit code, standard output and standard error.
fn run_cli(args: &[&str]) -> (Option<i32>, String, String) {
    let out = iplw(args);
    let text = |bytes| String::from_utf8(bytes).unwrap();
    (out.status.code(), text(out.stdout), text(out.stderr))
}

#[test]
fn reports_and_withholds_records_damaged_at_runtime() {
    let place = tempfile::tempdir().unwrap();
    put_policies(place.path(), None);
    let server = serving(place.path(), Limits::default());
    // Damage the file directly, as a failing disk would.
    let c = Connection::open(place.path().join("iplw.sqlite")).unwrap();
    c.execute("UPDATE policy SET about = 'other' WHERE id = 'p'", []).unwrap();
    let weights = place.path().join("policies/q.2.safetensors");
    std::fs::write(&weights, [1, 2, 7]).unwrap();
    for (path, record) in [
        ("/v1/policies/p", "policy p"),
        ("/v1/policies/p/weights", "policy p"),
        ("/v1/policies", "policy p"),
        ("/v1/policies/q/weights", "weights q.2.safetensors"),
    ] {
        let told = problem(server.send(Method::GET, path, ""), 503, "damaged");
        assert_eq!(told["value"], record, "{path}: {told}");
        assert!(told["detail"].as_str().unwrap().contains("iplw check"), "{told}");
    }
    let mut peer = Peer::connect(server.zmq.as_ref().unwrap(), None);
    let answer = peer.ask("download_weights", &json!({"id": "q"}));
    assert_eq!(
        (&answer["problem"]["status"], &answer["problem"]["value"]),
        (&json!(503), &json!("weights q.2.safetensors"))
    );
    // Undamaged records are still served.
    assert_eq!(server.get("/v1/policies/r")["about"], "of a test");
    let directory = place.path().to_str().unwrap();
    let (code, found, way_out) = run_cli(&["check", directory]);
    assert_eq!(code, Some(1));
    assert!(
        found.contains("damaged: policy p:") && found.contains("damaged: weights of policy q"),
        "{found}"
    );
    assert!(way_out.contains("iplw restore BACKUP") && way_out.contains("--drop"), "{way_out}");
    let (code, _, refused) = run_cli(&["check", directory, "--drop"]);
    assert!(code == Some(2) && refused.contains("in use"), "{refused}");
    drop(server);
    let (code, dropped, _) = run_cli(&["check", directory, "--drop"]);
    assert_eq!(code, Some(0));
    assert!(
        dropped.contains("policy p")
            && dropped.contains("policy q")
            && dropped.contains("records dropped: 2"),
        "{dropped}"
    );
    assert_eq!(run_cli(&["check", directory]).0, Some(0));
    let server = serving(place.path(), Limits::default());
    let policies = server.get("/v1/policies")["policies"].clone();
    assert_eq!(policies.as_array().unwrap().len(), 1);
}

#[test]
fn serves_a_backup_of_a_running_server() {
    let place = tempfile::tempdir().unwrap();
    let at = |name: &str| place.path().join(name).to_str().unwrap().to_string();
    let (data, kept, other) = (at("data"), at("kept"), at("other"));
    put_policies(Path::new(&data), None);
    let server = serving(Path::new(&data), Limits::default());
    let world = server.post("/v1/worlds", &json!({"task": "bowling", "kind": "real"}), 201);
    let (code, told, error) = run_cli(&["backup", &data, "--to", &kept]);
    assert_eq!(code, Some(0), "{error}");
    assert!(told.contains("policy 3") && told.contains("saved to"), "{told}");
    let after = server.post("/v1/worlds", &json!({"task": "bowling"}), 201);
    let (code, _, refused) = run_cli(&["restore", &kept, "--to", &data]);
    assert!(code == Some(2) && refused.contains("in use"), "{refused}");
    assert_eq!(run_cli(&["restore", &kept, "--to", &other]).0, Some(0));
    let (code, _, refused) = run_cli(&["restore", &kept, "--to", &other]);
    assert!(code == Some(2) && refused.contains("--replace"), "{refused}");
    assert_eq!(run_cli(&["restore", &kept, "--to", &other, "--replace"]).0, Some(0));
    let there = serving(Path::new(&other), Limits::default());
    let path = |made: &Value| format!("/v1/worlds/{}", made["id"].as_str().unwrap());
    assert_eq!(there.get(&path(&world)), server.get(&path(&world)));
    problem(there.send(Method::GET, &path(&after), ""), 404, "not-found");
    assert_eq!(there.get("/v1/policies"), server.get("/v1/policies"));
}

#[test]
fn deletes_jobs_after_their_retention_time() {
    let place = tempfile::tempdir().unwrap();
    let weights = || place.path().join("policies/stray.9.safetensors");
    let ask = json!({"task": "basketball", "rounds": 1, "actions": 2, "samples": 4});
    let server = serving(place.path(), Limits::default());
    let job = server.finish(&server.post("/v1/iplw", &ask, 202));
    drop(server);
    let server = serving(place.path(), Limits { job_kept_seconds: Some(1.0), ..Limits::default() });
    std::fs::write(weights(), "of nobody").unwrap();
    let path = format!("/v1/jobs/{}", job["id"].as_str().unwrap());
    while server.send(Method::GET, &path, "").status() != 404 || weights().exists() {
        std::thread::sleep(std::time::Duration::from_millis(20));
    }
    let c = Connection::open(place.path().join("iplw.sqlite")).unwrap();
    for part in ["round", "measured", "artifact", "log", "metadata"] {
        let left: i64 = c.query_row(&format!("SELECT count(*) FROM {part}"), [], |r| r.get(0)).unwrap();
        assert_eq!(left, 0, "{part}");
    }
    // Running jobs are never deleted.
    let asked = json!({"task": "basketball", "rounds": 1, "actions": 2, "samples": 4, "real": "ask_tell"});
    let waiting = server.post("/v1/iplw", &asked, 202)["id"].as_str().unwrap().to_string();
    let later = server.finish(&server.post("/v1/iplw", &ask, 202))["id"].as_str().unwrap().to_string();
    while server.send(Method::GET, &format!("/v1/jobs/{later}"), "").status() != 404 {
        std::thread::sleep(std::time::Duration::from_millis(20));
    }
    assert_eq!(server.get(&format!("/v1/jobs/{waiting}"))["state"], "waiting");
}

#[test]
fn refuses_to_start_on_damaged_data() {
    let place = tempfile::tempdir().unwrap();
    put_policies(place.path(), None);
    let directory = place.path().to_str().unwrap();
    let file = place.path().join("iplw.sqlite");
    let whole = std::fs::read(&file).unwrap();
    std::fs::write(&file, &whole[..whole.len() / 2]).unwrap();
    let (code, out, error) = run_cli(&["serve", "--http", "127.0.0.1:0", "--data-dir", directory]);
    assert!(code == Some(1) && out.is_empty(), "{out}");
    assert!(error.contains("iplw.sqlite: damaged") && error.contains("iplw check"), "{error}");
    assert_eq!(error.trim_end().lines().count(), 1, "{error}");
}

#[test]
fn lost_tokens_do_not_open_the_data_to_everybody() {
    let place = tempfile::tempdir().unwrap();
    let at = |name: &str| place.path().join(name).to_str().unwrap().to_string();
    let (data, kept, other) = (at("data"), at("kept"), at("other"));
    let token = ["token", "new", "root", "--scope", "admin", "--data-dir"];
    assert_eq!(run_cli(&[&token[..], &[&data]].concat()).0, Some(0));
    put_policies(Path::new(&data), Some("root"));
    assert_eq!(run_cli(&["check", &data]).0, Some(0));
    std::fs::remove_file(Path::new(&data).join("tokens.json")).unwrap();
    let config = ServeConfig { data_dir: Some(data.clone().into()), ..ServeConfig::default() };
    let refused = Running::with(config.clone()).err().unwrap().to_string();
    assert!(refused.contains("tokens.json is missing") && refused.contains("iplw token new"), "{refused}");
    let (code, found, _) = run_cli(&["check", &data]);
    assert!(code == Some(1) && found.contains("damaged: tokens.json: the file is missing"), "{found}");
    let (code, _, warning) = run_cli(&["backup", &data, "--to", &kept]);
    assert!(code == Some(0) && warning.contains("iplw token new"), "{warning}");
    let (code, _, warning) = run_cli(&["restore", &kept, "--to", &other]);
    assert!(code == Some(0) && warning.contains("other/tokens.json: the file is missing"), "{warning}");
    // With tokens of elsewhere, nothing is missing.
    let file = at("elsewhere.json");
    assert_eq!(run_cli(&["token", "new", "root", "--scope", "admin", "--token-file", &file]).0, Some(0));
    assert_eq!(run_cli(&["check", &data, "--token-file", &file]).0, Some(0));
    drop(Running::with(ServeConfig { token_file: Some(file.into()), ..config.clone() }).unwrap());
    assert_eq!(run_cli(&[&token[..], &[&data]].concat()).0, Some(0));
    drop(Running::with(config).unwrap());
}

#[test]
fn latents_are_on_disk_when_acknowledged() {
    let place = tempfile::tempdir().unwrap();
    let server = serving(place.path(), Limits::default());
    let world = server.post("/v1/worlds", &json!({"task": "bowling"}), 201);
    let path = format!("/v1/worlds/{}", world["id"].as_str().unwrap());
    let set = |friction: f64| {
        let body = json!({"friction": friction}).to_string();
        server.send(Method::POST, &format!("{path}/set_latents"), body).status()
    };
    let c = Connection::open(place.path().join("iplw.sqlite")).unwrap();
    let stored = || -> Value {
        let select = "SELECT latents FROM world WHERE id = ?1";
        let text: String = c.query_row(select, [world["id"].as_str().unwrap()], |r| r.get(0)).unwrap();
        serde_json::from_str(&text).unwrap()
    };
    assert_eq!(set(0.25), 200);
    assert_eq!(stored()["friction"], 0.25);
    // Another writer, as a full disk, makes the write fail.
    c.execute_batch("BEGIN IMMEDIATE").unwrap();
    assert!(set(0.75).is_server_error());
    c.execute_batch("ROLLBACK").unwrap();
    assert_eq!(server.get(&path)["latents"]["friction"], 0.25);
    drop(server);
    assert_eq!(stored()["friction"], 0.25, "also after the last flush");
}
