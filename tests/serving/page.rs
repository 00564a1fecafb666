//! The page at `/`, and ad-hoc simulations.

use iplw::serve::ServeConfig;
use reqwest::Method;
use serde_json::json;

use crate::http::{Running, ok, problem};

fn running() -> Running {
    Running::with(ServeConfig::default()).unwrap()
}

#[test]
fn browsers_get_the_page_and_other_clients_links() {
    let server = running();
    let get = |path: &str, headers: &[(&str, &str)]| {
        let request = server.client.get(format!("{}{path}", server.url));
        headers.iter().fold(request, |r, (k, v)| r.header(*k, *v)).send().unwrap()
    };
    let page = get("/", &[("accept", "text/html,*/*;q=0.8")]);
    let told = |name: &str| page.headers()[name].to_str().unwrap().to_string();
    assert_eq!((page.status().as_u16(), told("content-type")), (200, "text/html; charset=utf-8".into()));
    assert_eq!((told("cache-control"), told("vary")), ("no-cache".into(), "Accept".into()));
    let policy = told("content-security-policy");
    assert!(
        policy.starts_with("default-src 'none'; script-src 'self'") && !policy.contains("unsafe"),
        "{policy}"
    );
    let text = page.text().unwrap();
    for (path, kind) in [
        ("/assets/app.js", "text/javascript"),
        ("/assets/app.css", "text/css"),
        ("/assets/icon.svg", "image/svg+xml"),
    ] {
        assert!(text.contains(path), "{path}");
        let file = get(path, &[]);
        assert!(file.headers()["content-type"].to_str().unwrap().starts_with(kind), "{path}");
        let tag = file.headers()["etag"].to_str().unwrap().to_string();
        assert_eq!(get(path, &[("if-none-match", &tag)]).status(), 304, "{path}");
        assert_eq!(get(path, &[("if-none-match", &format!("\"x\", W/{tag}"))]).status(), 304, "{path}");
        assert_eq!(get(path, &[("if-none-match", "\"x\"")]).status(), 200, "{path}");
    }
    let plain = get("/", &[("accept", "*/*")]);
    assert!(plain.headers()["content-type"].to_str().unwrap().starts_with("text/plain"));
    assert!(plain.text().unwrap().contains("/docs/"));
    problem(server.send(Method::GET, "/assets/nope.js", ""), 404, "not-found");
    problem(server.send(Method::POST, "/", ""), 405, "method-not-allowed");
}

#[test]
fn adhoc_simulations_have_no_side_effects() {
    let server = running();
    let task = server.get("/v1/tasks/bowling/0");
    let action = &task["certificate"]["action"];
    let latents = json!({"density": 1.0, "friction": 0.7, "restitution": 0.4});
    let asked = json!({"task": "bowling:000", "action": action, "latents": latents, "observe_every": 4});
    let fine = server.post("/v1/simulate", &asked, 200);
    assert_eq!(
        (&fine["valid"], fine["t"][1].as_f64().map(|t| (t * 60.0).round())),
        (&json!(true), Some(1.0))
    );
    assert!(fine["contacts"].as_array().is_some_and(|c| !c.is_empty()), "{}", fine["contacts"]);

    // The same result as in a world.
    let made = server.post("/v1/worlds", &json!({"task": "bowling:000", "latents": latents}), 201);
    let path = format!("/v1/worlds/{}/rollout", made["id"].as_str().unwrap());
    let rolled = server.post(&path, &json!({"actions": [action], "trajectories": true}), 200);
    let coarse = server.post(
        "/v1/simulate",
        &json!({"task": "bowling:000", "action": action, "latents": latents}),
        200,
    );
    for key in ["t", "bodies", "solved", "steps"] {
        assert_eq!(coarse[key], rolled["results"][0][key], "{key}");
    }
    let worlds = server.get("/v1/worlds");
    let spent = worlds["worlds"].as_array().unwrap().iter().map(|w| w["interactions"].as_u64().unwrap());
    assert_eq!(spent.sum::<u64>(), 1, "only the world's own rollout counts");

    // A scene without action and goal.
    let scene = json!({"format": "iplw.scene/1", "steps": 240, "bodies": [
        {"name": "ball", "shape": {"type": "disc", "radius": 0.1}, "position": [0, 2]}]});
    let fall = server.post("/v1/simulate", &json!({"scene": scene}), 200);
    assert_eq!((&fall["solved"], &fall["end"]), (&json!(null), &json!("horizon")));
}

#[test]
fn checks_placement_without_simulation() {
    let server = running();
    let free = server.get("/v1/tasks/bowling/0")["certificate"]["action"].clone();
    let asked = json!({"task": "bowling:000", "actions": [free, [0.25, 0.56, 0.5], [0.0, 0.0, 1.0]]});
    let reasons = server.post("/v1/place", &asked, 200)["reasons"].clone();
    assert_eq!(reasons, json!([null, "red overlaps green", "red leaves the scene"]));
    let refused = |path: &str, body: serde_json::Value, field: &str| {
        let told = problem(server.send(Method::POST, path, body.to_string()), 422, "invalid-value");
        assert_eq!(told["field"], field, "{told}");
    };
    refused("/v1/place", json!({"task": "bowling:000", "actions": [[0.5, 2.0, 0.5]]}), "actions[0][1]");
    refused("/v1/place", json!({"actions": []}), "task");
    refused("/v1/simulate", json!({"task": "bowling:000"}), "scene.bodies[2].position");
    refused(
        "/v1/simulate",
        json!({"task": "bowling:000", "action": [0.5, 0.5, 0.5], "observe_every": 0}),
        "observe_every",
    );
    // Errors about a scene's effect name it within the scene.
    let mut scene = server.get("/v1/tasks/bowling/0")["scene"].clone();
    scene["effects"] = json!([{"name": "wind"}, {"name": "wind", "parameters": {"speed": 1.0}}]);
    let field = "scene.effects[1].parameters.speed";
    refused("/v1/simulate", json!({"scene": scene, "action": [0.5, 0.5, 0.5]}), field);
    refused("/v1/place", json!({"scene": scene, "actions": []}), field);
    refused("/v1/worlds", json!({"scene": scene}), field);
    refused("/v1/diagnoses", json!({"scene": scene, "trials": "trial,t,body,x,y\n"}), field);
    let many = json!({"task": "bowling:000", "actions": vec![[0.5, 0.5, 0.5]; 4097]});
    problem(server.send(Method::POST, "/v1/place", many.to_string()), 413, "too-large");
}

#[test]
fn lists_jobs_by_order_state_and_kind() {
    let server = running();
    for seed in 1..=3 {
        let asked = json!({"task": "bowling", "rounds": 1, "actions": 1, "samples": 10, "seed": seed});
        let job = server.post("/v1/iplw", &asked, 202);
        server.finish(&job);
    }
    let ids = |query: &str| -> Vec<String> {
        let found = server.get(&format!("/v1/jobs?{query}"));
        found["jobs"].as_array().unwrap().iter().map(|j| j["id"].as_str().unwrap().to_string()).collect()
    };
    assert_eq!(ids("order=newest"), ["job-3", "job-2", "job-1"]);
    assert_eq!(ids("order=oldest&state=succeeded"), ["job-1", "job-2", "job-3"]);
    assert!(ids("state=failed").is_empty());
    assert_eq!((ids("kind=iplw&state=succeeded").len(), ids("kind=train").len()), (3, 0));
    let first = server.get("/v1/jobs?order=newest&limit=2");
    let next = first["next"].as_str().unwrap();
    assert_eq!(ids(&format!("order=newest&cursor={next}")), ["job-1"]);
    // A cursor is only valid for its own list.
    problem(server.send(Method::GET, &format!("/v1/jobs?cursor={next}"), ""), 422, "invalid-value");
    let results = |query: &str| -> Vec<bool> {
        let found = server.get(&format!("/v1/jobs?{query}"));
        found["jobs"].as_array().unwrap().iter().map(|j| j["result"].is_object()).collect()
    };
    assert_eq!((results(""), results("results=true")), (vec![true; 3], vec![true; 3]));
    assert_eq!(results("results=false"), [false; 3]);
    for query in ["order=up", "results=no", "state=done", "kind=training", "order=newest&order=oldest"] {
        problem(server.send(Method::GET, &format!("/v1/jobs?{query}"), ""), 422, "invalid-value");
    }
    ok(server.send(Method::GET, "/v1/jobs", ""), 200);
}
