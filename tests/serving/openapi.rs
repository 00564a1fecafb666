//! The committed OpenAPI document is the one the routes make.

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
fn every_operation_is_named_and_every_reference_leads_somewhere() {
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
