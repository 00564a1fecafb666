//! Request ids, log lines and metrics, without secrets.

use std::sync::{Arc, Mutex};

use iplw::access::{HashedToken, Scope, TokenFile, digest};
use iplw::serve::{AccessLog, LogFormat, ServeConfig};
use reqwest::Method;
use reqwest::blocking::Response;
use serde_json::{Value, json};

use crate::http::{Running, ok, problem};
use crate::peer::Peer;

const TOKEN: &str = "iplw_secret-of-ann";

/// A server with ann's token, and its log lines.
fn start_logged(form: LogFormat) -> (Running, Arc<Mutex<Vec<String>>>, tempfile::TempDir) {
    let place = tempfile::tempdir().unwrap();
    let ann = HashedToken {
        name: "ann".into(),
        scope: Scope::Act,
        digest: digest(TOKEN.as_bytes()),
        made: 0,
        expires: None,
    };
    TokenFile::of_directory(place.path())
        .change(|all| {
            all.push(ann);
            Ok(())
        })
        .unwrap();
    let lines = Arc::new(Mutex::new(Vec::new()));
    let to = lines.clone();
    let log = AccessLog::new(form, Arc::new(move |line| to.lock().unwrap().push(line.to_string())));
    let zmq = Some("tcp://127.0.0.1:*".into());
    let config = ServeConfig { data_dir: Some(place.path().into()), zmq, log, ..ServeConfig::default() };
    (Running::with(config).unwrap(), lines, place)
}

fn send(server: &Running, method: Method, path: &str, headers: &[(&str, &str)], body: &Value) -> Response {
    let request = server.client.request(method, format!("{}{path}", server.url)).bearer_auth(TOKEN);
    headers.iter().fold(request, |r, (k, v)| r.header(*k, *v)).body(body.to_string()).send().unwrap()
}

#[test]
fn every_request_has_an_id_and_a_log_line() {
    let (server, lines, _place) = start_logged(LogFormat::Json);
    let id = |answer: &Response| answer.headers()["x-request-id"].to_str().unwrap().to_string();
    let parent = "00-0af7651916cd43dd8448eb211c80319c-b7ad6b7169203331-01";
    let given = [("X-Request-Id", "mine-7"), ("traceparent", parent)];
    let answer = send(&server, Method::GET, "/v1/worlds", &given, &json!({}));
    assert_eq!(id(&answer), "mine-7");
    let made: Vec<String> = (0..2)
        .map(|_| id(&send(&server, Method::GET, "/v1/worlds", &[("X-Request-Id", "a b")], &json!({}))))
        .collect();
    assert!(made[0] != made[1] && !made[0].is_empty(), "{made:?}");
    let refused = send(&server, Method::GET, "/v1/worlds/none", &[("X-Request-Id", "mine-8")], &json!({}));
    assert_eq!(id(&refused), "mine-8");
    problem(refused, 404, "not-found");
    let nowhere = server.client.get(format!("{}/nowhere", server.url)).send().unwrap();
    assert!(!id(&nowhere).is_empty());
    problem(nowhere, 401, "unauthorized");
    let mut peer = Peer::connect(server.zmq.as_ref().unwrap(), Some(TOKEN));
    assert_eq!(peer.ask("get_world", &json!({"id": "bowling-sim"}))["ok"], true);
    let all: Vec<Value> = lines.lock().unwrap().iter().map(|l| serde_json::from_str(l).unwrap()).collect();
    assert_eq!(all.len(), 6, "{all:#?}");
    let first = &all[0];
    assert_eq!((&first["request"], &first["operation"]), (&json!("mine-7"), &json!("list_worlds")));
    assert_eq!(
        (&first["who"], &first["status"], &first["transport"]),
        (&json!("ann"), &json!(200), &json!("http"))
    );
    assert_eq!(first["trace"]["trace_id"], "0af7651916cd43dd8448eb211c80319c");
    assert!(first["seconds"].as_f64().unwrap() < 10.0 && first["time"].as_str().unwrap().ends_with('Z'));
    assert_eq!((&all[3]["problem"], &all[3]["status"]), (&json!("not-found"), &json!(404)));
    assert_eq!((&all[4]["operation"], all[4].get("who")), (&json!("none"), None));
    assert_eq!((&all[5]["operation"], &all[5]["transport"]), (&json!("get_world"), &json!("zmq")));
    let metrics = send(&server, Method::GET, "/metrics", &[], &json!({})).text().unwrap();
    for wanted in [
        "iplw_request_seconds_count{transport=\"http\",operation=\"list_worlds\",outcome=\"ok\"} 3",
        "iplw_request_seconds_count{transport=\"http\",operation=\"get_world\",outcome=\"refused\"} 1",
        "iplw_request_seconds_bucket{transport=\"zmq\",operation=\"get_world\",outcome=\"ok\",le=\"+Inf\"} 1",
        "iplw_requests_under_way 1",
    ] {
        assert!(metrics.contains(wanted), "{wanted} in\n{metrics}");
    }
}

/// A ZeroMQ client's request id appears in the log and the response.
#[test]
fn zeromq_requests_have_the_assigned_id() {
    let (server, lines, _place) = start_logged(LogFormat::Json);
    let mut peer = Peer::connect(server.zmq.as_ref().unwrap(), Some(TOKEN));
    let parent = "00-0af7651916cd43dd8448eb211c80319c-b7ad6b7169203331-01";
    let mut ask = |request_id: Value, traceparent: Value| {
        let args = json!({"id": "bowling-sim"});
        let head = json!({"v": 1, "id": 1, "op": "get_world", "args": args, "request_id": request_id, "traceparent": traceparent});
        peer.send(&rmp_serde::to_vec_named(&head).unwrap());
        peer.answer()
    };
    assert_eq!(ask(json!("mine-9"), json!(parent))["request_id"], "mine-9");
    let made = ask(json!("not one"), json!("00-0-0-0"));
    assert!(made["ok"] == true && made["request_id"].as_str().unwrap().len() > 8, "{made}");
    let refused = ask(json!(7), Value::Null);
    assert_eq!(
        (&refused["problem"]["field"], refused["request_id"].is_string()),
        (&json!("request_id"), true)
    );
    let all: Vec<Value> = lines.lock().unwrap().iter().map(|l| serde_json::from_str(l).unwrap()).collect();
    assert_eq!(
        (&all[0]["request"], &all[0]["trace"]["parent_id"]),
        (&json!("mine-9"), &json!("b7ad6b7169203331"))
    );
    assert_eq!((all[1].get("trace"), &all[1]["request"]), (None, &made["request_id"]));
    let metrics = send(&server, Method::GET, "/metrics", &[], &json!({})).text().unwrap();
    for wanted in ["iplw_connections{transport=\"zmq\"} 1", "iplw_requests_waiting 0", "iplw_steps_total 0"] {
        assert!(metrics.contains(wanted), "{wanted} in\n{metrics}");
    }
}

/// No log line contains the token or a hidden latent of the world in use.
#[test]
fn logs_contain_no_tokens_or_hidden_latents() {
    for form in [LogFormat::Json, LogFormat::Text] {
        let (server, lines, _place) = start_logged(form);
        let hidden = json!({"task": "bowling", "kind": "real", "latents": {"friction": 0.31415926, "restitution": 0.27182818}});
        let made = ok(send(&server, Method::POST, "/v1/worlds", &[("Idempotency-Key", "k1")], &hidden), 201);
        let id = made["id"].as_str().unwrap();
        send(&server, Method::POST, &format!("/v1/worlds/{id}/reset"), &[], &json!({}));
        send(
            &server,
            Method::POST,
            &format!("/v1/worlds/{id}/step"),
            &[],
            &json!({"action": [0.5, 0.8, 0.3]}),
        );
        send(
            &server,
            Method::POST,
            &format!("/v1/worlds/{id}/set_latents"),
            &[],
            &json!({"friction": 0.31415926}),
        );
        send(&server, Method::POST, &format!("/v1/worlds/{id}/step"), &[], &json!({"friction": 0.31415926}));
        let wrong = server.client.get(format!("{}/v1/worlds", server.url)).bearer_auth("iplw_wrong-one");
        problem(wrong.send().unwrap(), 401, "unauthorized");
        let real = json!({"task": "bowling", "rounds": 1, "actions": 1, "samples": 8,
            "real": {"latents": {"friction": 0.31415926, "restitution": 0.27182818}}});
        let job = ok(send(&server, Method::POST, "/v1/iplw", &[], &real), 202);
        let job = job["id"].as_str().unwrap();
        let events = send(&server, Method::GET, &format!("/v1/jobs/{job}/events"), &[], &json!({}));
        assert!(events.text().unwrap().contains("event: done"));
        Peer::connect(server.zmq.as_ref().unwrap(), Some(TOKEN)).ask("get_world", &json!({"id": id}));
        let all = lines.lock().unwrap().clone();
        let ended = all.iter().filter(|l| l.contains("job") && l.contains(job) && l.contains("iplw")).count();
        assert_eq!(ended, 1, "a line for the job: {all:#?}");
        for line in &all {
            for secret in [TOKEN, "secret-of", "wrong-one", "31415", "27182"] {
                assert!(!line.contains(secret), "{line}");
            }
        }
        assert!(all.len() >= 9, "{all:#?}");
    }
}
