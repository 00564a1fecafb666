//! The committed OpenAPI document matches the routes.

use serde_json::Value;

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
