//! `iplw design`, and `iplw measure --design`.

use serde_json::{Value, json};

use crate::families_cli::{iplw, told};

const SMALL: [&str; 10] =
    ["--task", "basketball", "--candidates", "24", "--shortlist", "6", "--worlds", "24", "--copies", "2"];

#[test]
fn designs_and_measures_a_batch() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("next");
    let run = |more: &[&str]| iplw(&[&["design"], &SMALL[..], more].concat(), None);
    let to = ["--set", "linear_drag", "--batch", "2", "--seed", "3", "--out", out.to_str().unwrap()];
    told(&run(&to), 0, &["24 candidates", "1. basketball:", "2. basketball:", "together", "narrows", "nats"]);
    let path = out.join("design.json");
    let design: Value = serde_json::from_str(&std::fs::read_to_string(&path).unwrap()).unwrap();
    assert_eq!(design["format"], json!("iplw.design/1"));
    let batch = design["experiments"].as_array().unwrap();
    assert_eq!((batch.len(), design["others"].as_array().unwrap().len()), (2, 4));
    // The gains of the batch add up, and the first experiment is informative about unknown latents.
    assert!(batch[0]["information"].as_f64().unwrap() > 1.0, "{}", batch[0]);
    let adds: f64 = batch.iter().map(|e| e["adds"].as_f64().unwrap()).sum();
    assert!((adds - design["together"]["information"].as_f64().unwrap()).abs() < 1e-9);
    let names: Vec<&str> =
        batch[0]["expected"].as_array().unwrap().iter().map(|n| n["name"].as_str().unwrap()).collect();
    assert_eq!(names, ["density", "friction", "restitution", "linear_drag.c"]);
    // The same bits on one thread.
    let again = run(&[&to[..], &["--threads", "1", "--json"]].concat());
    assert_eq!(serde_json::from_slice::<Value>(&again.stdout).unwrap(), design);

    let measured = folder.path().join("measured");
    let measure = |design: &str, task: &str| {
        let to = measured.to_str().unwrap();
        iplw(&["measure", "--task", task, "--design", design, "--noise", "0.005", "--out", to], None)
    };
    told(&measure(path.to_str().unwrap(), "basketball"), 0, &["2 trials (2 real interactions)"]);
    let scene: Value =
        serde_json::from_str(&std::fs::read_to_string(measured.join("scene.json")).unwrap()).unwrap();
    for (i, e) in batch.iter().enumerate() {
        let name = format!("{}/{i}", e["task"].as_str().unwrap());
        assert!(scene["settings"][&name].is_object(), "{name}");
    }
    told(&measure(path.to_str().unwrap(), "bowling"), 2, &["experiments[0].task"]);
    let odd = folder.path().join("odd.json");
    let mut other = design.clone();
    other["experiments"][0]["action"] = json!([0.5, 2.0, 0.5, 0.5]);
    std::fs::write(&odd, other.to_string()).unwrap();
    told(&measure(odd.to_str().unwrap(), "basketball"), 2, &["odd.json", "experiments[0].action"]);
    // A document of a version without costs.
    let mut earlier = design.clone();
    let document = earlier.as_object_mut().unwrap();
    document.remove("cost");
    document["config"].as_object_mut().unwrap().remove("costs");
    for row in document["experiments"].as_array_mut().unwrap() {
        row.as_object_mut().unwrap().remove("cost");
    }
    document["others"] = json!([]);
    std::fs::write(&odd, earlier.to_string()).unwrap();
    told(&measure(odd.to_str().unwrap(), "basketball"), 0, &["2 trials"]);
    other["experiments"] = json!([]);
    std::fs::write(&odd, other.to_string()).unwrap();
    told(&measure(odd.to_str().unwrap(), "basketball"), 2, &["experiments", "none"]);
    other["format"] = json!("iplw.design/9");
    std::fs::write(&odd, other.to_string()).unwrap();
    told(&measure(odd.to_str().unwrap(), "basketball"), 2, &["iplw.design/1"]);
}

#[test]
fn designs_for_effects_and_success() {
    let run = |more: &[&str]| iplw(&[&["design"], &SMALL[..], more].concat(), None);
    let sets = ["--set", "none", "--set", "linear_drag", "--question", "effects", "--json"];
    let found: Value = serde_json::from_slice(&run(&sets).stdout).unwrap();
    let first = &found["experiments"][0];
    assert_eq!(found["sets"][1], json!({"effects": ["linear_drag"], "weight": 0.5}));
    let right = &first["right"];
    assert!(right[0] == json!(0.5) && right[1].as_f64().unwrap() > 0.7, "{first}");
    // Drag is identified by more than chance.
    assert!(first["information"].as_f64().unwrap() > 0.2, "{first}");
    told(&run(&["--question", "success"]), 0, &["predicts whether plans work"]);
}

#[test]
fn spends_the_budget_by_gain_per_cost() {
    let run = |task: &str, more: &[&str]| -> Value {
        let on = ["design", "--task", task, "--seed", "3", "--json"];
        let out = iplw(&[&on, &SMALL[2..], more].concat(), None);
        serde_json::from_slice(&out.stdout).unwrap()
    };
    let costs = |found: &Value| -> Vec<f64> {
        found["experiments"].as_array().unwrap().iter().map(|e| e["cost"].as_f64().unwrap()).collect()
    };
    // One task to set up, and trials until the budget is spent.
    let one = run("basketball:003", &["--setup-cost", "5", "--budget", "8.5"]);
    assert_eq!(costs(&one), [6.0, 1.0, 1.0]);
    assert_eq!(one["cost"], json!(8.0));
    assert!(one["experiments"][0]["reason"].as_str().unwrap().ends_with("costs 6 with setting up"));
    assert!(one["experiments"][1]["reason"].as_str().unwrap().ends_with("costs 1"));
    // With many tasks the batch stays on one, within the budget.
    let many = run("basketball", &["--setup-cost", "5", "--budget", "8"]);
    let tasks: std::collections::BTreeSet<&str> =
        many["experiments"].as_array().unwrap().iter().map(|e| e["task"].as_str().unwrap()).collect();
    assert!(tasks.len() == 1 && many["cost"].as_f64().unwrap() <= 8.0, "{many}");
    // A budget for two tasks is spent on both, and each is set up once.
    let two = run("basketball", &["--setup-cost", "5", "--budget", "14.5"]);
    let (spent, rows) = (two["cost"].as_f64().unwrap(), two["experiments"].as_array().unwrap());
    let tasks: std::collections::BTreeSet<&str> = rows.iter().map(|e| e["task"].as_str().unwrap()).collect();
    assert_eq!(spent, rows.len() as f64 + 5.0 * tasks.len() as f64, "{two}");
    assert!(rows.len() > 1 && spent > 8.0 && spent <= 14.5, "{two}");
    // Without costs the reasons don't mention any.
    let free = run("basketball", &["--batch", "2"]);
    assert_eq!((costs(&free), &free["cost"]), (vec![1.0, 1.0], &json!(2.0)));
    assert!(!free["experiments"][0]["reason"].as_str().unwrap().contains("cost"));
    let refused = iplw(&[&["design"], &SMALL[..], &["--setup-cost", "5", "--budget", "5.5"]].concat(), None);
    told(&refused, 2, &["costs.budget", "at least 6"]);
}

#[test]
fn rejects_invalid_designs() {
    let cases: [(&[&str], &str); 9] = [
        (&["--question", "weather"], "question"),
        (&["--question", "effects"], "draws of two sets of effects or more"),
        (&["--set", "ether"], "ether"),
        (&["--set", "sticky_patch"], "sticky_patch"),
        (&["--set", "linear_drag+linear_drag"], "linear_drag twice"),
        (&["--batch", "0"], "batch"),
        (&["--noise", "0"], "noise"),
        (&["--worlds", "1"], "worlds"),
        (&["--posterior", "/nowhere/posterior.json"], "/nowhere/posterior.json"),
    ];
    for (args, names) in cases {
        let done = iplw(&[&["design", "--task", "bowling"], args].concat(), None);
        let code = if args[0] == "--posterior" { 1 } else { 2 };
        told(&done, code, &[names]);
    }
}
