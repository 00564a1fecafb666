//! Likelihoods for external samplers: equal to in-process results in any batch and after a restart; errors.

use std::path::Path;

use iplw::budget::Unlimited;
use iplw::commands::PosteriorRequest;
use iplw::inference::posterior::TrialLikelihood;
use iplw::progress::NoProgress;
use iplw::reality::{trials_from_csv, trials_to_csv};
use iplw::serve::ServeConfig;
use reqwest::Method;
use serde_json::{Value, json};

use crate::http::{Running, problem};
use crate::peer::Peer;
use crate::worlds;

fn serving(directory: Option<&Path>) -> Running {
    let zmq = Some("tcp://127.0.0.1:*".into());
    let data_dir = directory.map(Into::into);
    Running::with(ServeConfig { data_dir, zmq, ..ServeConfig::default() }).unwrap()
}

/// A request with throws in a world with drag.
fn likelihood_request() -> Value {
    let trials = worlds::trials(&worlds::single(1, 3), worlds::Noise::White, 8, 24, 8.0, 5);
    let scene: Value = serde_json::from_str(&worlds::scene().to_json()).unwrap();
    json!({"scene": scene, "trials": trials_to_csv(&trials), "effects": ["quadratic_drag"], "seed": 2})
}

/// Prepares a likelihood and returns its document.
fn prepare(server: &Running) -> Value {
    let done = server.finish(&server.post("/v1/likelihoods", &likelihood_request(), 202));
    assert_eq!(done["state"], "succeeded", "{done}");
    done
}

fn evaluate(server: &Running, job: &Value, columns: &Value) -> Value {
    let path = format!("/v1/likelihoods/{}/evaluate", job["id"].as_str().unwrap());
    server.post(&path, &json!({"columns": columns}), 200)
}

/// One point of the columns.
fn row(columns: &Value, i: usize) -> Value {
    columns.as_object().unwrap().iter().map(|(name, v)| (name.clone(), json!([v[i]]))).collect()
}

#[test]
fn matches_the_in_process_likelihood() {
    let server = serving(None);
    let job = prepare(&server);
    let document = &job["result"];
    assert_eq!(document["format"], "iplw.likelihood/1");
    let names: Vec<&str> =
        document["parameters"].as_array().unwrap().iter().map(|p| p["name"].as_str().unwrap()).collect();
    assert_eq!(names, ["quadratic_drag.k"]);
    let path = format!("/v1/likelihoods/{}/starts", job["id"].as_str().unwrap());
    let mut columns = server.post(&path, &json!({"count": 5, "seed": 4}), 200)["columns"].clone();

    let own = likelihood_request();
    let scene = worlds::scene();
    let trials = trials_from_csv(own["trials"].as_str().unwrap(), &scene).unwrap();
    let wanted = PosteriorRequest {
        sets: Some(vec![vec!["quadratic_drag".into()]]),
        seed: Some(2),
        ..PosteriorRequest::default()
    };
    let likelihood = TrialLikelihood::new(&scene, &trials, &wanted.config().unwrap(), &NoProgress).unwrap();
    let points = likelihood.initial_points(5, 4, &Unlimited).unwrap();
    assert_eq!(columns, json!({"quadratic_drag.k": points.concat()}));

    // The prior excludes the last point.
    columns["quadratic_drag.k"].as_array_mut().unwrap().push(json!(-1.0));
    let found = evaluate(&server, &job, &columns);
    assert_eq!(found["log_likelihood"][5], Value::Null);
    assert_eq!(found["log_prior"][5], Value::Null);
    let wanted = likelihood.log_likelihoods(&points, &Unlimited).unwrap();
    for (i, point) in points.iter().enumerate() {
        assert_eq!(found["log_likelihood"][i], wanted[i]);
        assert_eq!(found["log_prior"][i], likelihood.log_prior(point));
        let alone = evaluate(&server, &job, &row(&columns, i));
        assert_eq!(alone["log_likelihood"][0], wanted[i], "alone or in company");
    }
    let told = json!({"id": job["id"], "columns": columns, "prior_only": true});
    let mut peer = Peer::connect(server.zmq.as_ref().unwrap(), None);
    let prior = &peer.ask("evaluate_likelihood", &told)["result"];
    assert_eq!((&prior["log_prior"], prior.get("log_likelihood")), (&found["log_prior"], None));
    assert_eq!(evaluate(&server, &job, &json!({"quadratic_drag.k": []}))["log_prior"], json!([]));
    // A repeated request uses the cache and gives the same result.
    assert_eq!(prepare(&server)["result"], *document);
}

#[test]
fn likelihoods_survive_a_restart() {
    let place = tempfile::tempdir().unwrap();
    let columns = json!({"quadratic_drag.k": [0.02, 0.05, 0.4]});
    let (job, before) = {
        let server = serving(Some(place.path()));
        let job = prepare(&server);
        let found = evaluate(&server, &job, &columns);
        (job, found)
    };
    let server = serving(Some(place.path()));
    assert_eq!(evaluate(&server, &job, &columns), before);
    let id = job["id"].as_str().unwrap();
    assert_eq!(server.send(Method::DELETE, &format!("/v1/jobs/{id}"), "").status().as_u16(), 204);
    let gone = server.send(
        Method::POST,
        &format!("/v1/likelihoods/{id}/evaluate"),
        json!({"columns": columns}).to_string(),
    );
    problem(gone, 404, "not-found");
}

#[test]
fn rejects_invalid_points_by_name() {
    let server = serving(None);
    let job = prepare(&server);
    let path = |what: &str| format!("/v1/likelihoods/{}/{what}", job["id"].as_str().unwrap());
    let many = vec![0.1; 4097];
    for (what, body, status, slug, field) in [
        ("evaluate", json!({"columns": {}}), 422, "invalid-value", "columns.quadratic_drag.k"),
        ("evaluate", json!({"columns": {"grip": [1]}}), 422, "invalid-value", "columns.grip"),
        ("evaluate", json!({"columns": {"quadratic_drag.k": [null]}}), 400, "malformed", ""),
        ("evaluate", json!({"columns": {"quadratic_drag.k": 3}}), 400, "malformed", ""),
        ("evaluate", json!({"columns": {"quadratic_drag.k": many}}), 413, "too-large", ""),
        ("evaluate", json!({}), 400, "malformed", ""),
        ("starts", json!({"count": 0}), 422, "invalid-value", "count"),
        ("starts", json!({"count": 5000}), 422, "invalid-value", "count"),
        ("starts", json!({"count": -1}), 400, "malformed", "count"),
    ] {
        let told = problem(server.send(Method::POST, &path(what), body.to_string()), status, slug);
        assert!(field.is_empty() || told["field"] == field, "{body}: {told}");
    }
    let other = json!({"task": "basketball:003", "actions": 50, "draws": 4, "exact": 1});
    let other = server.finish(&server.post("/v1/plans", &other, 202));
    let of_other = format!("/v1/likelihoods/{}/starts", other["id"].as_str().unwrap());
    problem(server.send(Method::POST, &of_other, json!({"count": 1}).to_string()), 409, "refused");
    let metrics = server.send(Method::GET, "/metrics", "").text().unwrap();
    assert!(metrics.contains("iplw_errors_total{class=\"5xx\"} 0"), "{metrics}");
}
