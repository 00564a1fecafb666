//! `iplw outcomes` and `iplw agents`: computing tables, comparing agents, resuming, training on tables, and rejecting bad tables.

use std::path::Path;

use serde_json::Value;

use crate::families_cli::{DROP, iplw, told};

/// Two certified families of one kind, with tables of their real and simulated worlds.
fn tables(folder: &Path) -> [String; 4] {
    for name in ["drop", "fall"] {
        let path = folder.join(format!("{name}.toml"));
        std::fs::write(&path, DROP.replace("name = \"drop\"", &format!("name = \"{name}\""))).unwrap();
        told(&iplw(&["tasks", "check", path.to_str().unwrap()], None), 0, &["4 of 4 tasks"]);
    }
    [("drop", "real"), ("fall", "real"), ("drop", "sim"), ("fall", "sim")].map(|(name, world)| {
        let out = folder.join(format!("{name}-{world}")).to_str().unwrap().to_string();
        let args = ["outcomes", "--task", name, "--actions", "200", "--world", world, "--out", &out];
        told(&iplw(&args, Some(folder)), 0, &["4 tasks, 200 actions each"]);
        out
    })
}

fn json(path: &Path) -> Value {
    serde_json::from_str(&std::fs::read_to_string(path).unwrap()).unwrap()
}

#[test]
fn compares_agents_from_tables_and_resumes() {
    let folder = tempfile::tempdir().unwrap();
    let own = Some(folder.path());
    let [drop, fall, drop_sim, fall_sim] = tables(folder.path());
    let about = json(&Path::new(&drop).join("outcomes.json"));
    assert_eq!(
        (&about["world"], about["latents"]["friction"].as_f64()),
        (&"real".into(), None),
        "the hidden physics is not written"
    );
    let run = |out: &Path, more: &[&str]| {
        let tables = ["agents", "--tables", &drop, &fall, "--posteriors", &fall_sim, &drop_sim];
        let how = ["--batches", "40", "--folds", "3", "--out", out.to_str().unwrap()];
        iplw(&[&tables[..], &how[..], more].concat(), own)
    };
    let (one, other) = (folder.path().join("one"), folder.path().join("other"));
    let said =
        told(&run(&one, &["--threads", "1"]), 0, &["over 3 folds; 2 families, 8 tasks", "are not the same"]);
    for wanted in ["random", "memory", "dqn", "simulate", "best", "Dec[Joint]"] {
        assert!(said.contains(wanted), "{wanted} is not in {said}");
    }
    let found = json(&one.join("agents.json"));
    assert_eq!((&found["format"], &found["seed"]), (&"iplw.agents/1".into(), &0.into()));
    for setting in ["within", "across"] {
        let of = |agent: &str| &found["settings"][setting][agent];
        assert_eq!(of("random")["folds"].as_array().unwrap().len(), 3);
        assert!(of("dqn")["auccess"]["standard_error"].is_number());
        let mean = |agent: &str| of(agent)["auccess"]["mean"].as_f64().unwrap();
        // A ball that falls straight down moves alike in both worlds.
        assert!(mean("simulate") > mean("random") && mean("simulate") > 0.9, "{setting}: {said}");
    }
    // A part first, then the rest on more threads, gives the same bits.
    told(&run(&other, &["--agents", "dqn", "--setting", "within"]), 0, &[]);
    let cell = other.join("cells/within-dqn-001.json");
    let before = std::fs::metadata(&cell).unwrap().modified().unwrap();
    told(&run(&other, &["--threads", "3"]), 0, &[]);
    assert_eq!(std::fs::metadata(&cell).unwrap().modified().unwrap(), before, "computed again");
    assert_eq!(json(&other.join("agents.json")), found);

    // A policy for both families, trained without a simulator.
    let weights = folder.path().join("policy.safetensors");
    let weights = weights.to_str().unwrap();
    let args = ["train", "--outcomes", &drop, &fall, "--batches", "40", "--out", weights];
    told(&iplw(&args, own), 0, &["actions labelled", "40 batches"]);
    let args = ["evaluate", "--policy", weights, "--outcomes", &drop, &fall, "--split", "test"];
    told(&iplw(&args, own), 0, &["on 2 tasks", "drop:", "fall:"]);
}

#[test]
fn rejects_unsuitable_tables() {
    let folder = tempfile::tempdir().unwrap();
    let [drop, fall, drop_sim, _] = tables(folder.path());
    let out = folder.path().join("never");
    let refused = |args: &[&str], wanted: &[&str]| {
        let args = [&["agents", "--out", out.to_str().unwrap()], args].concat();
        told(&iplw(&args, Some(folder.path())), 2, wanted);
        assert!(!out.exists());
    };
    refused(&["--tables", &drop, "--setting", "across"], &["`families for across` is 1", "at least 2"]);
    refused(&["--tables", &drop, &drop], &["one table of drop"]);
    refused(&["--tables", &drop, "--agents", "simulate"], &["--posteriors", "none"]);
    refused(&["--tables", &drop, "--agents", "oracle"], &["no agent named `oracle`", "memory"]);
    refused(&["--tables", &drop, &fall, "--posteriors", &drop_sim], &["none of fall"]);
    refused(&["--tables", &drop, "--posteriors", &drop], &["--posteriors", "the outcomes of the real world"]);
    refused(&["--tables", &drop, "--setting", "beyond"], &["within, across"]);
    refused(&["--tables", folder.path().to_str().unwrap()], &["outcomes.json", "finished table"]);
    let bowling = folder.path().join("bowling");
    let args = ["outcomes", "--split", "test", "--actions", "20", "--out", bowling.to_str().unwrap()];
    told(&iplw(&args, None), 0, &["20 tasks"]);
    refused(&["--tables", &drop, bowling.to_str().unwrap()], &["actions of 3 components", "fit each other"]);

    // Damaged files, and a changed family.
    let broken = |file: &str, change: &dyn Fn(Vec<u8>) -> Vec<u8>, wanted: &[&str]| {
        let path = Path::new(&fall).join(file);
        let before = std::fs::read(&path).unwrap();
        std::fs::write(&path, change(before.clone())).unwrap();
        refused(&["--tables", &drop, &fall], wanted);
        std::fs::write(&path, before).unwrap();
    };
    broken("outcomes.npy", &|b| b[..b.len() - 1].to_vec(), &["fall-real", "outcomes.npy", "799 bytes"]);
    broken("outcomes.npy", &|b| [&b[..b.len() - 1], &[5]].concat(), &["outcomes[3][199]` is 5"]);
    broken("actions.npy", &|b| b[..30].to_vec(), &["actions.npy", "cut short"]);
    broken(
        "actions.npy",
        &|b| [&b[..b.len() - 8], &2f64.to_le_bytes()].concat(),
        &["actions.npy.action[1]` is 2"],
    );
    let swap = |from: &'static str, to: &'static str| {
        move |b: Vec<u8>| String::from_utf8(b).unwrap().replacen(from, to, 1).into_bytes()
    };
    broken("outcomes.json", &swap("iplw.outcomes/1", "iplw.outcomes/9"), &["format", "iplw.outcomes/1"]);
    broken("outcomes.json", &swap("\"digest\": \"", "\"digest\": \"0"), &["digest", "fall was changed"]);
    broken("outcomes.json", &swap("fall:000", "fall:777"), &["fall:777"]);
    broken("outcomes.json", &|b| b[..b.len() / 2].to_vec(), &["outcomes.json", "what `iplw outcomes` wrote"]);
}
