//! `iplw plan` for a task and for a family.

use std::path::Path;

use serde_json::{Value, json};

use crate::families_cli::{iplw, told};

fn read(path: &Path) -> Value {
    serde_json::from_str(&std::fs::read_to_string(path).unwrap()).unwrap()
}

const SMALL: [&str; 6] = ["--actions", "200", "--draws", "6", "--exact", "3"];

#[test]
fn plans_a_task_with_posterior_samples() {
    let folder = tempfile::tempdir().unwrap();
    let posterior = folder.path().join("posterior.json");
    let document = json!({"format": "iplw.posterior/2", "effective": 12,
        "columns": {"friction": [0.2, 0.22, 0.25, 0.2], "linear_drag.c": [0.2, null, 0.25, 0.22]}});
    std::fs::write(&posterior, document.to_string()).unwrap();
    let out = folder.path().join("out");
    let run = |more: &[&str]| {
        let args = ["plan", "--task", "basketball:003", "--seed", "4"];
        iplw(&[&args[..], &SMALL[..], more].concat(), None)
    };
    let to = ["--posterior", posterior.to_str().unwrap(), "--out", out.to_str().unwrap()];
    let said = told(&run(&to), 0, &["200 actions", "probability", "ball.x"]);
    assert!(!said.contains("not complete"), "{said}");
    let plan = read(&out.join("plan.json"));
    assert_eq!((&plan["format"], &plan["task"]), (&json!("iplw.plan/1"), &json!("basketball:003")));
    assert_eq!(plan["posterior"], json!({"source": "posterior", "draws": 4}));
    let best = &plan["actions"][0];
    assert_eq!((&best["draws"], best["action"].as_array().unwrap().len()), (&json!(6), 4));
    for map in ["map.svg", "map_2.svg"] {
        assert!(std::fs::read_to_string(out.join(map)).unwrap().starts_with("<svg"));
    }
    // The same bits on one thread, and as JSON.
    let again = run(&[&to[..], &["--threads", "1", "--json"]].concat());
    assert_eq!(serde_json::from_slice::<Value>(&again.stdout).unwrap(), plan);
    let one = ["--latents", "friction=0.2,restitution=0.7", "--effect", "linear_drag:c=0.223", "--json"];
    assert!(told(&run(&one), 0, &[]).contains("\"point\""));
    told(&run(&["--rollouts", "20"]), 0, &["not complete"]);
    told(&run(&["--seconds", "0"]), 0, &["not complete"]);
}

#[test]
fn evaluates_plans_of_a_family_and_resumes() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().to_str().unwrap();
    let run = |rows: &str| {
        let args =
            ["plan", "--task", "basketball", "--real", "damping=0.8", "--predictions", "2", "--out", out];
        iplw(&[&args[..], &SMALL[..], &["--rows", rows]].concat(), None)
    };
    told(&run("truth"), 0, &["5 test tasks", "truth"]);
    let cells = || std::fs::read_dir(folder.path().join("cells")).unwrap().count();
    assert_eq!(cells(), 5);
    let kept: Vec<_> = std::fs::read_dir(folder.path().join("cells"))
        .unwrap()
        .map(|f| f.unwrap().path())
        .map(|f| (f.clone(), std::fs::metadata(&f).unwrap().modified().unwrap()))
        .collect();
    told(&run("random,uncalibrated"), 0, &["random", "uncalibrated"]);
    let score = |name: &str| {
        let found = read(&folder.path().join("planning.json"));
        let row = found["rows"].as_array().unwrap().iter().find(|r| r["name"] == name).cloned().unwrap();
        row["score"]["auccess"].as_f64().unwrap()
    };
    let random = score("random");
    told(&run("prior,truth"), 0, &["prior", "truth", "calibration error"]);
    assert!(random < score("truth"), "{random}");
    assert_eq!(cells(), 20);
    for (path, at) in kept {
        assert_eq!(std::fs::metadata(&path).unwrap().modified().unwrap(), at, "{path:?} is not made anew");
    }
    let found = read(&folder.path().join("planning.json"));
    let truth = &found["rows"][1];
    assert_eq!((&found["format"], &truth["name"]), (&json!("iplw.planning/1"), &json!("truth")));
    assert_eq!(truth["tasks"].as_array().unwrap().len(), 5);
    let calibration = &truth["score"]["calibration"];
    assert!((0.0..=1.0).contains(&calibration["error"].as_f64().unwrap()));
    assert!(!calibration["bins"].as_array().unwrap().is_empty());
    assert!(truth["score"]["auccess"].as_f64().unwrap() > 0.5, "{truth}");
}

#[test]
fn rejects_invalid_plans() {
    let folder = tempfile::tempdir().unwrap();
    let odd = folder.path().join("odd.json");
    std::fs::write(&odd, r#"{"format": "iplw.posterior/2", "columns": {"friction": [0.5, -2]}}"#).unwrap();
    let odd = odd.to_str().unwrap();
    let cases: [(&[&str], &str); 12] = [
        (&["--task", "curling"], "curling"),
        (&["--task", "bowling:999"], "bowling:999"),
        (&["--task", "bowling:000", "--draws", "0"], "draws"),
        (&["--task", "bowling:000", "--perturb", "2"], "perturb"),
        (&["--task", "bowling:000", "--seconds=-1"], "--seconds"),
        (&["--task", "bowling:000", "--posterior", "nowhere.json"], "nowhere.json"),
        (&["--task", "bowling:000", "--posterior", odd], "columns.friction[1]"),
        (&["--task", "bowling:000", "--posterior", odd, "--prior"], "--prior"),
        (&["--task", "bowling:000", "--latents", "grip=1"], "grip"),
        (&["--task", "bowling:000", "--real", "damping=0.8"], "--real"),
        (&["--task", "bowling", "--rows", "posterior"], "--rows"),
        (&["--task", "bowling", "--real", "damping=2"], "damping"),
    ];
    for (args, wanted) in cases {
        let done = iplw(&[&["plan"], args].concat(), Some(folder.path()));
        let code = if wanted == "nowhere.json" { 1 } else { 2 };
        told(&done, code, &[wanted]);
    }
}
