//! Experimental designs over HTTP.

use iplw::serve::ServeConfig;
use serde_json::{Value, json};

use crate::http::Running;

#[test]
fn computes_a_design() {
    let server = Running::with(ServeConfig::default()).unwrap();
    let small = |more: Value| {
        let mut body =
            json!({"task": "basketball", "candidates": 16, "shortlist": 4, "worlds": 16, "copies": 2});
        body.as_object_mut().unwrap().extend(more.as_object().unwrap().clone());
        let done = server.finish(&server.post("/v1/designs", &body, 202));
        assert_eq!(done["state"], "succeeded", "{done}");
        done["result"].clone()
    };
    let found = small(json!({"sets": [[], ["linear_drag"]], "question": "effects", "batch": 2}));
    assert_eq!(found["format"], "iplw.design/1");
    assert_eq!(found["experiments"].as_array().unwrap().len(), 2);
    assert!(
        found["experiments"][0]["reason"].as_str().unwrap().contains("no effect, linear_drag"),
        "{found}"
    );
    assert!(found["experiments"][0]["right"][1].as_f64().unwrap() > 0.55, "{found}");
    assert_eq!(small(json!({"seed": 5})), small(json!({"seed": 5})), "a seed's design is one design");
    let costs = json!({"trial": 2.0, "setup": 3.0, "budget": 7.0});
    let paid = small(json!({"task": "basketball:003", "costs": costs}));
    assert_eq!((paid["experiments"].as_array().unwrap().len(), &paid["cost"]), (2, &json!(7.0)));
    let dear = json!({"task": "basketball", "costs": {"setup": 3.0, "budget": 3.5}});
    let refused = server.post("/v1/designs", &dear, 422);
    assert_eq!(refused["field"], "costs.budget", "{refused}");
    // Nearly identical draws leave little information to gain.
    let near = |spread: f64| {
        let friction: Vec<f64> = (0..40).map(|i| 0.3 + spread * f64::from(i)).collect();
        let belief = json!({"format": "iplw.posterior/2", "columns": {"friction": friction}});
        let found = small(json!({"posterior": belief, "noise": 0.05}));
        found["experiments"][0]["information"].as_f64().unwrap()
    };
    assert!(near(1e-2) > near(1e-7) + 0.2, "{} {}", near(1e-2), near(1e-7));
}
