//! The committed OpenAPI document matches the routes.

use std::collections::BTreeMap;

use reqwest::Method;
use serde_json::Value;

use super::http::Running;

#[test]
fn committed_document_is_current() {
    let committed = std::fs::read_to_string("openapi/openapi.json").unwrap_or_default();
    assert!(
        committed == iplw::serve::openapi(),
        "openapi/openapi.json is not what the routes say; if that is meant: iplw openapi > openapi/openapi.json"
    );
}

#[test]
fn operations_are_named_and_references_resolve() {
    let document: Value = serde_json::from_str(&iplw::serve::openapi()).unwrap();
    assert_eq!(document["openapi"], "3.1.0");
    let mut ids = Vec::new();
    for (path, operations) in document["paths"].as_object().unwrap() {
        for (method, operation) in operations.as_object().unwrap() {
            let id = operation["operationId"].as_str().unwrap_or_default();
            assert!(!id.is_empty() && !operation["summary"].is_null(), "{method} {path}");
            for (status, response) in operation["responses"].as_object().unwrap() {
                assert!(response["description"].is_string(), "{id} {status}: OpenAPI wants a description");
            }
            ids.push(id.to_string());
        }
    }
    let count = ids.len();
    ids.sort();
    ids.dedup();
    assert_eq!(ids.len(), count, "operation ids are unique");
    assert!(count >= 28, "{count} operations");
    check_references(&document, &document);
}

fn check_references(document: &Value, node: &Value) {
    match node {
        Value::Object(fields) => {
            if let Some(Value::String(reference)) = fields.get("$ref") {
                let pointer = reference.strip_prefix('#').unwrap();
                assert!(document.pointer(pointer).is_some(), "{reference} leads nowhere");
            }
            fields.values().for_each(|v| check_references(document, v));
        }
        Value::Array(items) => items.iter().for_each(|v| check_references(document, v)),
        _ => {}
    }
}

/// Links follow from the paths: created resources are fetched, used and deleted by id.
#[test]
fn responses_with_ids_have_links() {
    let document: Value = serde_json::from_str(&iplw::serve::openapi()).unwrap();
    let at = |path: &str| format!("/paths/{}", path.replace('/', "~1"));
    let links = |method: &str, path: &str, status: u16| -> Vec<String> {
        let links = document.pointer(&format!("{}/{method}/responses/{status}/links", at(path)));
        links.and_then(Value::as_object).unwrap().keys().cloned().collect()
    };
    let of_a_world = [
        "branch_world",
        "delete_world",
        "get_world",
        "render_world",
        "reset_world",
        "rollout_world",
        "set_latents",
        "snapshot_world",
        "step_world",
        "watch_world",
    ];
    assert_eq!(links("post", "/v1/worlds", 201), of_a_world);
    assert!(links("post", "/v1/surfaces", 202).contains(&"delete_job".to_string()));
    assert!(links("post", "/v1/iplw", 202).contains(&"list_proposals".to_string()));
    // Some response links to every operation with an id in its path, and every link has a target.
    let (mut wanted, mut led) = (Vec::new(), Vec::new());
    for (path, operations) in document["paths"].as_object().unwrap() {
        for operation in operations.as_object().unwrap().values() {
            let id = operation["operationId"].as_str().unwrap().to_string();
            let responses = operation["responses"].as_object().unwrap().values();
            for link in responses.filter_map(|r| r["links"].as_object()).flat_map(|l| l.values()) {
                assert!(link["parameters"]["id"].as_str().unwrap().starts_with("$response.body#/"), "{id}");
                led.push(link["operationId"].as_str().unwrap().to_string());
            }
            if path.contains("{id}") {
                wanted.push(id);
            }
        }
    }
    for list in [&mut wanted, &mut led] {
        list.sort();
        list.dedup();
    }
    assert_eq!(wanted, led);
}

/// The example of every JSON body is accepted by a server. Ids of resources that a client creates first are replaced.
#[test]
fn examples_of_bodies_are_accepted() {
    let document: Value = serde_json::from_str(&iplw::serve::openapi()).unwrap();
    let server = Running::start();
    let mut examples = BTreeMap::new();
    for (path, operations) in document["paths"].as_object().unwrap() {
        for (method, operation) in operations.as_object().unwrap() {
            let body = &operation["requestBody"]["content"]["application/json"];
            if body.is_object() {
                let id = operation["operationId"].as_str().unwrap().to_string();
                assert!(body["example"].is_object(), "{id} has no example");
                examples.insert(id, (method.to_uppercase(), path.clone(), body["example"].clone()));
            }
        }
    }
    let mut send = |operation: &str, id: &str, change: &dyn Fn(&mut Value)| -> Value {
        let (method, path, mut body) = examples.remove(operation).unwrap_or_else(|| panic!("{operation}"));
        change(&mut body);
        let method = Method::from_bytes(method.as_bytes()).unwrap();
        let response = server.send(method, &path.replace("{id}", id), body.to_string());
        let status = response.status().as_u16();
        let text = response.text().unwrap();
        assert!(status < 300, "{operation}: {status} {text}");
        serde_json::from_str(&text).unwrap_or(Value::Null)
    };
    let same = |_: &mut Value| {};
    send("create_world", "", &same);
    for operation in
        ["reset_world", "step_world", "set_latents", "rollout_world", "snapshot_world", "branch_world"]
    {
        send(operation, "bowling-sim", &same);
    }
    let made = send("create_worlds", "", &same)["worlds"].clone();
    for operation in ["reset_worlds", "step_worlds", "place", "simulate", "start_plan", "start_design"] {
        send(operation, "", &same);
    }
    send("delete_worlds", "", &|body| body["worlds"] = made.clone());
    let control = send("create_control_world", "", &same)["id"].as_str().unwrap().to_string();
    for operation in
        ["reset_control_world", "step_control_world", "rollout_control_world", "set_control_physics"]
    {
        send(operation, &control, &same);
    }
    let estimation = send("start_iplw", "", &same);
    let id = estimation["id"].as_str().unwrap().to_string();
    let proposals = || server.get(&format!("/v1/iplw/{id}/proposals"));
    while proposals()["proposals"].as_array().is_none_or(Vec::is_empty) {
        std::thread::sleep(std::time::Duration::from_millis(20));
    }
    send("submit_trials", &id, &same);
    send("update_job", &id, &same);
    for operation in ["start_diagnosis", "start_posterior", "find_surface"] {
        send(operation, "", &same);
    }
    let likelihood = server.finish(&send("start_likelihood", "", &same));
    for operation in ["evaluate_likelihood", "draw_starts"] {
        send(operation, likelihood["id"].as_str().unwrap(), &same);
    }
    let trained = server.finish(&send("train_policy", "", &same));
    let policy = trained["result"]["policy"].as_str().unwrap().to_string();
    for operation in ["act", "evaluate_policy", "learn_policy"] {
        send(operation, &policy, &same);
    }
    examples.remove("make_token").expect("needs a server with tokens: tests of access send such bodies");
    assert!(examples.is_empty(), "not sent: {:?}", examples.keys());
}
