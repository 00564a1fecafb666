//! Fair queueing: flooding clients do not delay others.

use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};

use iplw::access::{Scope, digest};
use iplw::serve::ServeConfig;
use reqwest::Method;
use serde_json::{Value, json};

use crate::http::{Running, ok};
use crate::peer::Peer;
use crate::tokens::{self, stored_token, token};

/// Tokens: ann and bob have `act`, root `admin`.
fn start_with_tokens(directory: &Path) -> Running {
    let all = [("ann", Scope::Act), ("bob", Scope::Act), ("root", Scope::Admin)];
    let all = all.map(|(name, scope)| stored_token(name, scope, None));
    tokens::start_with(directory, all.into(), ServeConfig::default())
}

/// Work of at least a fraction of a second.
fn heavy_request() -> Value {
    let actions: Vec<u64> = (0..600).map(|i| i * 7).collect();
    json!({"task": "bowling:001", "actions": actions})
}

fn metric(server: &Running, name: &str) -> u64 {
    let asked = server.client.get(format!("{}/metrics", server.url)).bearer_auth(token("root"));
    let text = asked.send().unwrap().text().unwrap();
    let line = text
        .lines()
        .find(|l| l.starts_with(&format!("{name} ")))
        .unwrap_or_else(|| panic!("{name} in {text}"));
    line.rsplit(' ').next().unwrap().parse().unwrap()
}

const FLOOD: usize = 16;

/// While ann's requests are queued, one of bob's finishes before most of hers.
fn check(bob: impl FnOnce(&Running)) {
    let place = tempfile::tempdir().unwrap();
    let server = start_with_tokens(place.path());
    let (answered, url) =
        (Arc::new(AtomicUsize::new(0)), format!("{}/v1/worlds/bowling-sim/rollout", server.url));
    let flood: Vec<_> = (0..FLOOD)
        .map(|_| {
            let (answered, url) = (answered.clone(), url.clone());
            std::thread::spawn(move || {
                let client = reqwest::blocking::Client::builder().timeout(None).build().unwrap();
                let asked = client.post(url).bearer_auth(token("ann")).body(heavy_request().to_string());
                assert_eq!(asked.send().unwrap().status(), 200);
                answered.fetch_add(1, Ordering::SeqCst);
            })
        })
        .collect();
    while metric(&server, "iplw_requests_waiting") < 8 {
        std::thread::yield_now();
    }
    let before = answered.load(Ordering::SeqCst);
    bob(&server);
    let meanwhile = answered.load(Ordering::SeqCst) - before;
    flood.into_iter().for_each(|f| f.join().unwrap());
    // Two of hers run when his arrives: fair queueing makes it third, arrival order ninth or later.
    assert!(meanwhile <= 6, "{meanwhile} of ann's {FLOOD} before one of bob's");
    assert_eq!(metric(&server, "iplw_requests_waiting"), 0);
}

#[test]
fn flooding_client_does_not_delay_others_over_http() {
    check(|server| {
        let url = format!("{}/v1/worlds/bowling-sim/rollout", server.url);
        let asked = server.client.post(url).bearer_auth(token("bob")).body(heavy_request().to_string());
        ok(asked.send().unwrap(), 200);
    });
}

#[test]
fn flooding_client_does_not_delay_others_over_zeromq() {
    check(|server| {
        let mut args = heavy_request();
        args["id"] = "bowling-sim".into();
        let answer =
            Peer::connect(server.zmq.as_ref().unwrap(), Some(&token("bob"))).ask("rollout_world", &args);
        assert_eq!(answer["ok"], true);
    });
}

/// `admin` creates and revokes tokens over HTTP; hashes are never shown.
#[test]
fn tokens_managed_over_http_take_effect_immediately() {
    let place = tempfile::tempdir().unwrap();
    let server = start_with_tokens(place.path());
    let of = |token: &str, method: Method, path: &str, body: &Value| {
        let asked = server.client.request(method, format!("{}{path}", server.url)).bearer_auth(token);
        asked.body(body.to_string()).send().unwrap()
    };
    let root = token("root");
    let new = json!({"name": "eve", "scope": "read", "expires": "1d"});
    let made = ok(of(&root, Method::POST, "/v1/tokens", &new), 201);
    let eve = made["token"].as_str().unwrap().to_string();
    assert_eq!(
        (&made["name"], &made["scope"], &made["expired"]),
        (&json!("eve"), &json!("read"), &json!(false))
    );
    assert_eq!(of(&eve, Method::GET, "/v1/worlds", &json!({})).status(), 200);
    assert_eq!(of(&eve, Method::GET, "/v1/tokens", &json!({})).status(), 403);
    assert_eq!(of(&root, Method::POST, "/v1/tokens", &new).status(), 422, "the name has one");
    for bad in [
        json!({"name": "x y", "scope": "act"}),
        json!({"name": "x", "scope": "god"}),
        json!({"name": "x", "scope": "act", "expires": "1"}),
    ] {
        assert_eq!(of(&root, Method::POST, "/v1/tokens", &bad).status(), 422, "{bad}");
    }
    let listed = of(&root, Method::GET, "/v1/tokens?limit=3", &json!({})).text().unwrap();
    assert!(!listed.contains(&eve) && !listed.contains(&digest(eve.as_bytes()).hex()), "{listed}");
    let listed: Value = serde_json::from_str(&listed).unwrap();
    let names: Vec<&str> =
        listed["tokens"].as_array().unwrap().iter().map(|t| t["name"].as_str().unwrap()).collect();
    assert_eq!(names, ["ann", "bob", "eve"]);
    let next = listed["next"].as_str().unwrap();
    let rest = ok(of(&root, Method::GET, &format!("/v1/tokens?cursor={next}"), &json!({})), 200);
    assert_eq!((&rest["tokens"][0]["name"], &rest["next"]), (&json!("root"), &Value::Null));
    assert_eq!(of(&root, Method::DELETE, "/v1/tokens/eve", &json!({})).status(), 204);
    assert_eq!(of(&eve, Method::GET, "/v1/worlds", &json!({})).status(), 401, "at once");
    assert_eq!(of(&root, Method::DELETE, "/v1/tokens/eve", &json!({})).status(), 404);
    // A server without authentication accepts no tokens to be created.
    let open = Running::with(ServeConfig::default()).unwrap();
    assert_eq!(open.get("/v1/tokens")["tokens"], json!([]));
    assert_eq!(open.send(Method::POST, "/v1/tokens", new.to_string()).status(), 409);
}
