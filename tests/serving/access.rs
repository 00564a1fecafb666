//! Authorisation of every operation over both transports, driven by the list of operations so that new ones are covered.

use std::path::Path;

use iplw::access::{Scope, TokenFile};
use iplw::serve::ServeConfig;
use reqwest::Method;
use reqwest::blocking::Response;
use serde_json::{Value, json};

use crate::http::{Running, ok, problem};
use crate::peer::Peer;
use crate::tokens::{self, stored_token, token};

/// An operation of the OpenAPI document.
struct Operation {
    name: String,
    method: Method,
    path: String,
    /// Required scope; none for public operations.
    needs: Option<Scope>,
}

fn operations() -> Vec<Operation> {
    let document: Value = serde_json::from_str(&iplw::serve::openapi()).unwrap();
    let mut all = Vec::new();
    for (path, methods) in document["paths"].as_object().unwrap() {
        for (method, operation) in methods.as_object().unwrap() {
            let needs = operation["security"].as_array().expect("every operation says what it needs");
            // Apart from no security, for servers without authentication.
            let scope = needs.iter().find_map(|n| n.get("token")).map(|t| t[0].as_str().unwrap());
            all.push(Operation {
                name: operation["operationId"].as_str().unwrap().into(),
                method: method.to_uppercase().parse().unwrap(),
                path: path.replace("{id}", "x").replace("{family}", "bowling").replace("{number}", "1"),
                needs: scope.map(|s| Scope::from_name("scope", s).unwrap()),
            });
        }
    }
    all
}

/// Operations that are not available over ZeroMQ.
const ONLY_HTTP: [&str; 3] = ["metrics", "follow_job", "watch_world"];

/// Tokens: ann and bob have `act`, eve `read`, root `admin`; old's has expired.
fn start_with_tokens(directory: &Path) -> Running {
    let all = [
        stored_token("ann", Scope::Act, None),
        stored_token("bob", Scope::Act, None),
        stored_token("eve", Scope::Read, None),
        stored_token("root", Scope::Admin, None),
        stored_token("old", Scope::Admin, Some(1)),
    ];
    tokens::start_with(directory, all.into(), ServeConfig::default())
}

impl Running {
    fn of(&self, name: Option<&str>, method: Method, path: &str, body: &Value) -> Response {
        let request = self.client.request(method, format!("{}{path}", self.url));
        let request = match name {
            Some(name) => request.bearer_auth(token(name)),
            None => request,
        };
        request.body(body.to_string()).send().unwrap()
    }

    fn get_of(&self, name: &str, path: &str) -> Value {
        ok(self.of(Some(name), Method::GET, path, &json!({})), 200)
    }

    fn post_of(&self, name: &str, path: &str, body: &Value, status: u16) -> Value {
        ok(self.of(Some(name), Method::POST, path, body), status)
    }
}

/// Expected status of an operation per token: 401, 403, or other (`None`).
fn expected(presented: Option<&str>, needs: Option<Scope>) -> Option<(u16, &'static str)> {
    let has = match presented {
        None | Some("nobody" | "old") => None,
        Some("eve") => Some(Scope::Read),
        Some("ann") => Some(Scope::Act),
        _ => Some(Scope::Admin),
    };
    match (needs, has) {
        (None, _) => None,
        (Some(_), None) => Some((401, "unauthorized")),
        (Some(needs), Some(has)) if has < needs => Some((403, "forbidden")),
        _ => None,
    }
}

const PRESENTED: [Option<&str>; 6] =
    [None, Some("nobody"), Some("old"), Some("eve"), Some("ann"), Some("root")];

#[test]
fn every_operation_requires_its_scope_over_http() {
    let place = tempfile::tempdir().unwrap();
    let server = start_with_tokens(place.path());
    let mut refused = 0;
    for operation in operations() {
        for presented in PRESENTED {
            let response =
                server.of(presented, operation.method.clone(), &operation.path, &json!({"not": "taken"}));
            match expected(presented, operation.needs) {
                Some((status, slug)) => {
                    let challenge = response.headers().get("www-authenticate").cloned();
                    assert_eq!(challenge.is_some(), status == 401, "{}", operation.name);
                    let told = problem(response, status, slug);
                    let why = told["detail"].as_str().unwrap();
                    assert_eq!(
                        presented == Some("old"),
                        why.contains("expired"),
                        "{}: {why}",
                        operation.name
                    );
                    refused += 1;
                }
                None => {
                    let status = response.status().as_u16();
                    assert!(status != 401 && status != 403, "{} {presented:?}: {status}", operation.name);
                }
            }
        }
    }
    let open: Vec<String> = operations().into_iter().filter(|o| o.needs.is_none()).map(|o| o.name).collect();
    assert_eq!(open, ["healthz", "readyz"]);
    assert!(refused > 3 * (operations().len() - 2), "{refused}");
    // Unknown operations are rejected, too.
    for path in ["/docs/", "/docs/index.html", "/nowhere", "/v1/worlds/"] {
        problem(server.of(None, Method::GET, path, &json!({})), 401, "unauthorized");
    }
    let basic =
        server.client.get(format!("{}/v1/worlds", server.url)).basic_auth("root", Some(token("root")));
    problem(basic.send().unwrap(), 401, "unauthorized");
}

#[test]
fn every_operation_requires_its_scope_over_zeromq() {
    let place = tempfile::tempdir().unwrap();
    let server = start_with_tokens(place.path());
    let address = server.zmq.clone().unwrap();
    for presented in PRESENTED {
        let token = presented.map(token);
        let mut peer = Peer::connect(&address, token.as_deref());
        for operation in operations().iter().filter(|o| !ONLY_HTTP.contains(&o.name.as_str())) {
            let answer = peer.ask(&operation.name, &json!({"id": "x", "not": "taken"}));
            let status = answer["problem"]["status"].as_u64();
            match expected(presented, operation.needs) {
                Some((status, slug)) => {
                    assert_eq!(
                        answer["problem"]["status"], status,
                        "{} {presented:?}: {answer}",
                        operation.name
                    );
                    let kind = answer["problem"]["type"].as_str().unwrap();
                    assert!(kind.ends_with(slug), "{kind}");
                }
                None => assert!(status != Some(401) && status != Some(403), "{}: {answer}", operation.name),
            }
        }
        assert_eq!(peer.ask("ping", &json!({}))["result"]["pong"], true, "needs no token");
        if expected(presented, Some(Scope::Read)).is_some() {
            // Large bodies are discarded while reading and get the same status.
            peer.send(&vec![0; 1 << 20]);
            assert_eq!(peer.answer()["problem"]["status"], 401);
        }
    }
}

/// Resources are invisible to other `act` tokens; `read` and `admin` see them, and `admin` can delete them.
#[test]
fn worlds_jobs_and_policies_belong_to_their_creator() {
    let place = tempfile::tempdir().unwrap();
    let server = start_with_tokens(place.path());
    let make = json!({"task": "bowling", "kind": "sim"});
    let world = server.post_of("ann", "/v1/worlds", &make, 201)["id"].as_str().unwrap().to_string();
    let many = server.post_of(
        "ann",
        "/v1/batch/worlds",
        &json!({"task": "bowling", "kind": "sim", "count": 2}),
        201,
    );
    let second = many["worlds"][1].as_str().unwrap();
    let asking = json!({"task": "bowling", "real": "ask_tell", "rounds": 1, "actions": 1, "samples": 8});
    let job = server.post_of("ann", "/v1/iplw", &asking, 202)["id"].as_str().unwrap().to_string();
    let ask =
        |name, method: Method, path: &str| server.of(Some(name), method, path, &json!({})).status().as_u16();
    let theirs = [
        (Method::GET, format!("/v1/worlds/{world}")),
        (Method::GET, format!("/v1/worlds/{world}/render")),
        (Method::POST, format!("/v1/worlds/{world}/reset")),
        (Method::DELETE, format!("/v1/worlds/{second}")),
        (Method::GET, format!("/v1/jobs/{job}")),
        (Method::GET, format!("/v1/jobs/{job}/events")),
        (Method::GET, format!("/v1/jobs/{job}/trials")),
        (Method::GET, format!("/v1/iplw/{job}/proposals")),
        (Method::POST, format!("/v1/iplw/{job}/trials")),
        (Method::DELETE, format!("/v1/jobs/{job}")),
        (Method::GET, format!("/v1/jobs/{job}/log")),
        (Method::GET, format!("/v1/worlds/{world}/events")),
        (Method::PATCH, format!("/v1/jobs/{job}")),
    ];
    for (method, path) in &theirs {
        assert_eq!(ask("bob", method.clone(), path), 404, "{method} {path}");
    }
    let batch = json!({"worlds": [world, "bowling-sim"]});
    let refused = problem(server.of(Some("bob"), Method::POST, "/v1/batch/reset", &batch), 404, "not-found");
    assert_eq!(refused["field"], "worlds[0]");
    problem(server.of(Some("bob"), Method::DELETE, "/v1/batch/worlds", &batch), 403, "forbidden");
    let evaluate = json!({"world": world, "split": "test"});
    problem(
        server.of(Some("bob"), Method::POST, "/v1/policies/random/evaluate", &evaluate),
        404,
        "not-found",
    );
    let estimate = json!({"task": "bowling", "world": world});
    problem(server.of(Some("bob"), Method::POST, "/v1/iplw", &estimate), 404, "not-found");
    let listed = |name: &str, what: &str| -> Vec<String> {
        let page = server.get_of(name, &format!("/v1/{what}?limit=1000"));
        page[what].as_array().unwrap().iter().map(|r| r["id"].as_str().unwrap().to_string()).collect()
    };
    for (name, seen) in [("ann", true), ("bob", false), ("eve", true), ("root", true)] {
        assert_eq!(listed(name, "worlds").contains(&world), seen, "{name}");
        assert!(listed(name, "worlds").contains(&"bowling-sim".into()), "what all share");
        assert_eq!(listed(name, "jobs").contains(&job), seen, "{name}");
    }
    assert_eq!(ask("eve", Method::GET, &theirs[0].1), 200);
    assert_eq!(ask("eve", Method::POST, &theirs[2].1), 403);
    // Owners are listed; whoever sees a world can watch it.
    assert_eq!(server.get_of("eve", &theirs[0].1)["owner"], "ann");
    assert_eq!(ask("eve", Method::GET, &theirs[11].1), 200);
    assert_eq!(ask("eve", Method::GET, &theirs[10].1), 200);
    assert_eq!(server.get_of("eve", &theirs[12].1)["owner"], "ann");
    for (name, status) in [("ann", 200), ("eve", 403), ("root", 200)] {
        assert_eq!(ask(name, Method::PATCH, &theirs[12].1), status, "{name}");
    }
    // Anybody can act in default worlds, and only `admin` can delete them.
    assert_eq!(ask("bob", Method::POST, "/v1/worlds/bowling-sim/reset"), 200);
    assert_eq!(ask("ann", Method::DELETE, "/v1/worlds/bowling-sim"), 403);
    assert_eq!(ask("root", Method::DELETE, "/v1/worlds/basketball-sim"), 204);
    // A film counts as an attempt; with `read` only the scene can be rendered.
    assert_eq!(ask("eve", Method::GET, "/v1/worlds/bowling-sim/render"), 200);
    assert_eq!(
        ask("eve", Method::GET, "/v1/worlds/bowling-sim/render?view=filmstrip&action=0.5,0.8,0.3"),
        403
    );
    assert_eq!(ask("root", Method::DELETE, &theirs[9].1), 202);
    assert_eq!(ask("ann", Method::DELETE, &format!("/v1/worlds/{world}")), 204);
}

#[test]
fn policies_keep_their_owner() {
    let place = tempfile::tempdir().unwrap();
    let server = start_with_tokens(place.path());
    let learn = json!({"world": "bowling-sim", "attempts": 200, "batches": 1});
    let job = server.post_of("ann", "/v1/policies/untrained/learn", &learn, 202)["id"]
        .as_str()
        .unwrap()
        .to_string();
    let events = server.of(Some("ann"), Method::GET, &format!("/v1/jobs/{job}/events"), &json!({}));
    assert!(events.text().unwrap().contains("event: done"));
    let done = server.get_of("ann", &format!("/v1/jobs/{job}"));
    let id = done["result"]["policy"].as_str().unwrap_or_else(|| panic!("{done}")).to_string();
    let path = format!("/v1/policies/{id}");
    let weights =
        server.of(Some("ann"), Method::GET, &format!("{path}/weights"), &json!({})).bytes().unwrap();
    let put = |name: &str, path: &str| {
        let request = server.client.put(format!("{}{path}", server.url)).bearer_auth(token(name));
        request.body(weights.to_vec()).send().unwrap().status().as_u16()
    };
    let status = |name: &str, method: Method, path: &str| {
        server.of(Some(name), method, path, &json!({"task": "bowling:000"})).status().as_u16()
    };
    for path in [path.clone(), format!("{path}/weights")] {
        assert_eq!((status("bob", Method::GET, &path), status("eve", Method::GET, &path)), (404, 200));
    }
    assert_eq!(status("bob", Method::POST, &format!("{path}/act")), 404);
    assert_eq!(status("bob", Method::DELETE, &path), 404);
    assert_eq!(put("bob", &format!("{path}/weights")), 409, "a name that is taken");
    assert_eq!(put("bob", "/v1/policies/bobs/weights"), 201);
    assert_eq!(put("root", "/v1/policies/bobs/weights"), 200);
    assert_eq!(status("bob", Method::GET, "/v1/policies/bobs"), 200, "it stays its owner's");
    assert_eq!(status("ann", Method::GET, "/v1/policies/bobs"), 404);
    let seen = |name: &str| server.get_of(name, "/v1/policies")["policies"].as_array().unwrap().len();
    assert_eq!((seen("ann"), seen("bob"), seen("eve")), (1, 1, 2));
}

#[test]
fn idempotency_keys_are_separate_per_client() {
    let place = tempfile::tempdir().unwrap();
    let server = start_with_tokens(place.path());
    let make = |name: &str| {
        let request = server.client.post(format!("{}/v1/worlds", server.url)).bearer_auth(token(name));
        let body = json!({"task": "bowling", "kind": "sim"}).to_string();
        ok(request.header("Idempotency-Key", "k").body(body).send().unwrap(), 201)["id"].clone()
    };
    assert_eq!(make("ann"), make("ann"));
    assert_ne!(make("ann"), make("bob"));
}

#[test]
fn tokens_take_effect_and_are_revoked_immediately() {
    let place = tempfile::tempdir().unwrap();
    let server = start_with_tokens(place.path());
    let mut peer = Peer::connect(server.zmq.as_ref().unwrap(), Some(&token("ann")));
    assert_eq!(peer.ask("list_worlds", &json!({}))["ok"], true);
    let file = TokenFile::of_directory(place.path());
    file.change(|all| {
        all.retain(|k| k.name != "ann");
        all.push(stored_token("new", Scope::Read, None));
        Ok(())
    })
    .unwrap();
    let status = |name: &str| server.of(Some(name), Method::GET, "/v1/worlds", &json!({})).status().as_u16();
    let begun = std::time::Instant::now();
    while (status("ann"), status("new")) != (401, 200) {
        assert!(begun.elapsed().as_secs() < 10, "a changed file is seen within seconds");
        std::thread::sleep(std::time::Duration::from_millis(50));
    }
    assert_eq!(peer.ask("list_worlds", &json!({}))["problem"]["status"], 401, "on an open connection too");
}

/// Resources keep their owners after a restart.
#[test]
fn owners_survive_a_restart() {
    let place = tempfile::tempdir().unwrap();
    let make = json!({"task": "bowling", "kind": "sim"});
    let world = {
        let server = start_with_tokens(place.path());
        server.post_of("ann", "/v1/worlds", &make, 201)["id"].as_str().unwrap().to_string()
    };
    let config = ServeConfig { data_dir: Some(place.path().into()), ..ServeConfig::default() };
    let server = Running::with(config).unwrap();
    let status = |name: &str| {
        server.of(Some(name), Method::GET, &format!("/v1/worlds/{world}"), &json!({})).status().as_u16()
    };
    assert_eq!((status("ann"), status("bob"), status("eve")), (200, 404, 200));
}

/// Requests of a malicious page: every operation with a wrong host, a foreign origin and a wrong content type.
#[test]
fn rejects_requests_from_foreign_origins() {
    let config = ServeConfig { allow_origin: vec!["https://lab.example".into()], ..ServeConfig::default() };
    let server = Running::with(config).unwrap();
    let document: Value = serde_json::from_str(&iplw::serve::openapi()).unwrap();
    let bodies = |name: &str| {
        let all =
            document["paths"].as_object().unwrap().values().flat_map(|m| m.as_object().unwrap().values());
        all.filter(|o| o["operationId"] == name).any(|o| !o["requestBody"].is_null())
    };
    let (mut taken, own) = (0, server.url.clone());
    for operation in operations() {
        let request =
            || server.client.request(operation.method.clone(), format!("{}{}", server.url, operation.path));
        let wrong = request().header("Host", "evil.example").body("{}").send().unwrap();
        assert_eq!(problem(wrong, 421, "misdirected")["value"], "evil.example", "{}", operation.name);
        for (header, value) in
            [("Origin", "http://evil.example"), ("Origin", "null"), ("Sec-Fetch-Site", "cross-site")]
        {
            let refused = request().header(header, value).header("Content-Type", "text/plain").body("{}");
            problem(refused.send().unwrap(), 403, "foreign-page");
        }
        if bodies(&operation.name) {
            for kind in ["text/plain", "application/x-www-form-urlencoded", "multipart/form-data"] {
                let plain = request().header("Origin", &own).header("Content-Type", kind).body("{}");
                problem(plain.send().unwrap(), 415, "media-type");
            }
            taken += 1;
        }
        for origin in [own.as_str(), "https://lab.example"] {
            let good = request().header("Origin", origin).header("Content-Type", "application/json");
            let status = good.body("{}").send().unwrap().status().as_u16();
            let media = operation.name == "upload_weights";
            assert!(
                ![401, 403, 421].contains(&status) && (status == 415) == media,
                "{}: {status}",
                operation.name
            );
        }
    }
    assert!(taken > 15, "{taken}");
}

#[test]
fn allowed_origins_get_cors_headers_on_every_response() {
    let config = ServeConfig { allow_origin: vec!["https://lab.example".into()], ..ServeConfig::default() };
    let server = Running::with(config).unwrap();
    let of = |origin: &str, method: Method, path: &str| {
        let request = server.client.request(method, format!("{}{path}", server.url));
        request.header("Origin", origin).header("Access-Control-Request-Method", "POST").send().unwrap()
    };
    let asked = of("https://lab.example", Method::OPTIONS, "/v1/worlds");
    assert_eq!(asked.status(), 204);
    assert_eq!(asked.headers()["access-control-allow-origin"], "https://lab.example");
    assert!(asked.headers()["access-control-allow-methods"].to_str().unwrap().contains("PATCH"));
    assert!(asked.headers()["access-control-allow-headers"].to_str().unwrap().contains("Authorization"));
    problem(of("https://evil.example", Method::OPTIONS, "/v1/worlds"), 403, "foreign-page");
    let own = of(&server.url, Method::GET, "/v1/worlds");
    assert!(own.headers().get("access-control-allow-origin").is_none());
    for path in ["/v1/worlds", "/nowhere", "/docs/index.html", "/v1/worlds/bowling-sim/render?format=svg"] {
        let answer = server.client.get(format!("{}{path}", server.url)).send().unwrap();
        let told = |name: &str| answer.headers()[name].to_str().unwrap().to_string();
        assert_eq!(
            (told("x-content-type-options"), told("x-frame-options")),
            ("nosniff".into(), "DENY".into())
        );
        assert_eq!(told("cross-origin-resource-policy"), "same-origin");
        assert!(told("content-security-policy").contains("frame-ancestors 'none'"), "{path}");
    }
}
