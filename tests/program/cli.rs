//! Commands as a user runs them: formats, exit codes, and that invalid input writes nothing.

use std::io::Write;
use std::path::Path;
use std::process::{Command, Output, Stdio};

use serde_json::{Value, json};

fn iplw(args: &[&str], input: &str) -> Output {
    let mut child = Command::new(env!("CARGO_BIN_EXE_iplw"))
        .args(args)
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    // A command that rejects its arguments may exit before it reads.
    let _ = child.stdin.take().unwrap().write_all(input.as_bytes());
    child.wait_with_output().unwrap()
}

fn good(args: &[&str], input: &str) -> String {
    let out = iplw(args, input);
    assert!(out.status.success(), "{args:?}: {}", String::from_utf8_lossy(&out.stderr));
    String::from_utf8(out.stdout).unwrap()
}

/// Expects exit code 2, one line on stderr that contains `wanted`, and nothing on stdout.
fn refused(args: &[&str], input: &str, wanted: &str) {
    let out = iplw(args, input);
    let error = String::from_utf8_lossy(&out.stderr);
    assert_eq!(out.status.code(), Some(2), "{args:?}: {error}");
    assert!(error.contains(wanted), "{args:?}: {error:?} does not say {wanted:?}");
    assert_eq!(error.trim_end().lines().count(), 1, "{args:?}: {error}");
    assert!(out.stdout.is_empty(), "{args:?} wrote to stdout");
}

const FALL: &str = r#"{"format":"iplw.scene/1","bodies":[{"name":"ball","shape":{"type":"disc","radius":0.5},"position":[0,100]}],"gravity":[0,-9.8],"time_step":0.001,"steps":1000,"observe_every":500}"#;

#[test]
fn rollout_writes_a_line_per_scene_on_every_engine() {
    let two = format!("{FALL}\n\n{FALL}\n");
    for engine in ["auto", "rapier", "lanes"] {
        let out = good(&["rollout", "--engine", engine], &two);
        let lines: Vec<Value> = out.lines().map(|l| serde_json::from_str(l).unwrap()).collect();
        assert_eq!(lines.len(), 2);
        let line = &lines[0];
        assert_eq!(line["solved"], Value::Null);
        assert_eq!(line["steps"], 1000);
        assert_eq!(line["t"].as_array().unwrap().len(), 3);
        assert_eq!(line["contacts"]["collisions"], 0);
        let y = line["bodies"]["ball"]["y"][2].as_f64().unwrap();
        assert!((y - (100.0 - 4.9)).abs() < 0.01, "{engine}: {y}");
    }
}

#[test]
fn rollout_rejects_invalid_scenes_by_line_and_field() {
    let swap = |from: &str, to: &str| format!("{FALL}\n{}\n", FALL.replace(from, to));
    for (input, wanted) in [
        (swap("\"radius\":0.5", "\"radius\":-1"), "standard input:2: `bodies[0].shape.radius` is -1"),
        (swap("\"radius\":0.5", "\"radius\":1e999"), "standard input:2"),
        (swap("\"radius\":0.5", "\"radius\":\"big\""), "bodies[0].shape"),
        (swap("\"radius\"", "\"raduis\""), "raduis"),
        (swap("iplw.scene/1", "iplw.scene/9"), "iplw.scene/9"),
        (swap("\"steps\":1000", "\"steps\":0"), "`steps` is 0"),
        (swap("\"steps\":1000", "\"steps\":-4"), "steps"),
        (swap("\"time_step\":0.001", "\"time_step\":0"), "time_step"),
        (swap("\"position\":[0,100]", "\"position\":[0]"), "position"),
        (swap(",\"position\":[0,100]", ""), "`bodies[0].position` is missing"),
        (swap("\"gravity\"", "\"effects\":[{\"name\":\"magic\"}],\"gravity\""), "magic"),
        (
            swap(
                "\"gravity\"",
                "\"effects\":[{\"name\":\"linear_drag\",\"parameters\":{\"k\":1}}],\"gravity\"",
            ),
            "parameters.k",
        ),
        (
            swap("\"gravity\"", "\"goal\":{\"type\":\"contact\",\"bodies\":[\"ball\",\"cube\"]},\"gravity\""),
            "cube",
        ),
        (format!("{FALL}\n{{\"format\""), "standard input:2"),
        (
            swap(
                "}]",
                "},{\"name\":\"ball\",\"shape\":{\"type\":\"disc\",\"radius\":0.5},\"position\":[9,9]}]",
            ),
            "`bodies[1].name`",
        ),
        (
            swap(
                "}]",
                "},{\"name\":\"b\",\"shape\":{\"type\":\"disc\",\"radius\":0.5},\"position\":[0.1,100]}]",
            ),
            "overlaps",
        ),
        (
            swap(
                "}]",
                "}],\"statics\":[{\"name\":\"s\",\"shape\":{\"type\":\"polygon\",\"vertices\":[[0,0],[1,0],[2,0]]}}]",
            ),
            "convex",
        ),
    ] {
        refused(&["rollout"], &input, wanted);
    }
    refused(&["rollout", "--engine", "warp"], FALL, "rapier");
}

#[test]
fn rollout_writes_its_file_atomically() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("out.jsonl");
    let out = path.to_str().unwrap();
    refused(&["rollout", "--out", out], "{\"format\":1}", "format");
    assert!(!path.exists());
    good(&["rollout", "--out", out], FALL);
    assert_eq!(std::fs::read_to_string(&path).unwrap().lines().count(), 1);
    assert_eq!(files(dir.path()), ["out.jsonl"]);
}

/// Errors of output paths are reported before the computation.
#[test]
fn rejects_output_paths_before_computing() {
    let dir = tempfile::tempdir().unwrap();
    let (folder, file) = (dir.path().to_str().unwrap(), dir.path().join("taken"));
    std::fs::write(&file, "mine").unwrap();
    let (taken, below) = (file.to_str().unwrap(), file.join("x"));
    let below = below.to_str().unwrap();
    let (measured, trials) = (dir.path().join("m"), dir.path().join("m/trials.csv"));
    let scene = measured.join("scene.json");
    let (scene, trials) = (scene.to_str().unwrap(), trials.to_str().unwrap());
    good(&["measure", "--task", "basketball", "--trials", "2", "--out", measured.to_str().unwrap()], "");
    let diagnose = ["diagnose", "--scene", scene, "--trials", trials, "--out"];
    for (command, place, wanted) in [
        (&["rollout", "--out"][..], folder, "--out"),
        (&["rollout", "--out"], below, "--out"),
        (&["surface", "--task", "basketball", "--out"], folder, "--out"),
        (&["surface", "--task", "basketball", "--out", below, "--svg"], folder, "--out"),
        (&["surface", "--task", "basketball", "--svg"], folder, "--svg"),
        (&["train", "--task", "basketball", "--out"], folder, "directory"),
        (&["measure", "--task", "basketball", "--out"], taken, "file"),
        (&diagnose, taken, "file"),
        (&["run", "--out"], taken, "file"),
        (&["experiment", "basketball", "--out"], taken, "file"),
        (&["experiment", "strategies", "--out"], below, "taken"),
    ] {
        refused(&[command, &[place]].concat(), FALL, wanted);
    }
    assert_eq!(std::fs::read_to_string(&file).unwrap(), "mine");
    assert_eq!(files(dir.path()).len(), 2, "{:?}", files(dir.path()));
}

#[test]
fn lists_tasks() {
    let all: Value = serde_json::from_str(&good(&["tasks", "--json"], "")).unwrap();
    assert_eq!(all["families"].as_array().unwrap().len(), 2);
    let bowling: Value = serde_json::from_str(&good(&["tasks", "bowling", "--json"], "")).unwrap();
    assert_eq!(bowling["tasks"].as_array().unwrap().len(), 100);
    assert_eq!(bowling["splits"]["test"].as_array().unwrap().len(), 20);
    assert_eq!(bowling["action_space"]["count"], 50_000);
    assert!(good(&["tasks"], "").contains("basketball"));
    refused(&["tasks", "curling"], "", "bowling, basketball");
}

#[test]
fn measured_files_can_be_read_and_hide_the_truth() {
    let dir = tempfile::tempdir().unwrap();
    let out = dir.path().join("m");
    let args =
        ["--task", "basketball", "--effect", "linear_drag:c=0.223", "--trials", "6", "--noise", "0.002"];
    let run = |to: &Path, seed: &str| {
        let mut all = vec!["measure"];
        all.extend(args);
        all.extend(["--seed", seed, "--out", to.to_str().unwrap()]);
        good(&all, "")
    };
    run(&out, "1");
    let text = std::fs::read_to_string(out.join("scene.json")).unwrap();
    let scene = iplw::task::Scene::from_json(&text).unwrap();
    assert!(scene.effects.is_empty() && scene.damping.is_none(), "the hidden effect is not written");
    let trials = read_trials(&out.join("trials.csv"), &scene);
    assert_eq!(trials.len(), 6);
    let plank =
        |t: &iplw::reality::Trial| t.scene.statics.iter().find(|s| s.name == "plank").unwrap().position;
    assert_ne!(plank(&trials[0]), plank(&trials[1]), "each trial's plank stands where its action put it");
    let again = dir.path().join("again");
    run(&again, "1");
    assert_eq!(
        std::fs::read(out.join("trials.csv")).unwrap(),
        std::fs::read(again.join("trials.csv")).unwrap()
    );
    run(&again, "2");
    assert_ne!(
        std::fs::read(out.join("trials.csv")).unwrap(),
        std::fs::read(again.join("trials.csv")).unwrap()
    );
}

#[test]
fn lists_effects_and_measures_every_one() {
    let listed: Value = serde_json::from_str(&good(&["effects", "--json"], "")).unwrap();
    let all = listed["effects"].as_array().unwrap();
    assert_eq!(all.len(), iplw::world::effect::REGISTRY.len());
    assert!(good(&["effects"], "").contains("wind (motion): a = (ax, ay)"));
    let one: Value = serde_json::from_str(&good(&["effects", "lag", "--json"], "")).unwrap();
    assert_eq!(one["parameters"][0]["unit"], "s");
    refused(&["effects", "ether"], "", "linear_drag");
    let dir = tempfile::tempdir().unwrap();
    for e in all {
        let first = &e["parameters"][0];
        let value = first["neutral"].as_f64().unwrap() + 0.1;
        let term = format!("{}:{}={value}", e["name"].as_str().unwrap(), first["name"].as_str().unwrap());
        let out = dir.path().join(e["name"].as_str().unwrap());
        let to = out.to_str().unwrap();
        good(&["measure", "--task", "basketball", "--effect", &term, "--trials", "2", "--out", to], "");
        let scene = iplw::task::Scene::from_json(&std::fs::read_to_string(out.join("scene.json")).unwrap());
        let trials = read_trials(&out.join("trials.csv"), &scene.unwrap());
        assert_eq!(trials.len(), 2, "{term}");
        let parameters = format!("{{{}: {value}}}", first["name"]);
        let effects = format!(r#""effects":[{{"name":{},"parameters":{parameters}}}],"gravity""#, e["name"]);
        let line = FALL.replace("\"gravity\"", &effects);
        for engine in ["lanes", "rapier"] {
            let rolled: Value =
                serde_json::from_str(&good(&["rollout", "--engine", engine], &(line.clone() + "\n")))
                    .unwrap();
            assert!(rolled["t"].as_array().unwrap().len() >= 3, "{term}");
        }
    }
}

#[test]
fn measure_rejects_invalid_options_before_writing() {
    let dir = tempfile::tempdir().unwrap();
    let out = dir.path().join("m");
    for (args, wanted) in [
        (vec!["--task", "curling"], "curling"),
        (vec!["--task", "bowling:999"], "bowling:999"),
        (vec!["--task", "bowling", "--effect", "magic"], "magic"),
        (vec!["--task", "bowling", "--effect", "linear_drag:c=-1"], "-1"),
        (vec!["--task", "bowling", "--noise", "-1"], "noise"),
        (vec!["--task", "bowling", "--noise", "NaN"], "noise"),
        (vec!["--task", "bowling", "--trials", "0"], "--trials"),
        (vec!["--task", "bowling", "--real", "damping=2"], "damping"),
    ] {
        let mut all = vec!["measure"];
        all.extend(args);
        all.extend(["--out", out.to_str().unwrap()]);
        refused(&all, "", wanted);
        assert!(!out.exists());
    }
}

#[test]
fn estimate_prints_the_documented_json() {
    let args = ["estimate", "--task", "basketball", "--real", "damping=0.8", "--strategy", "mixed"];
    let mut all = args.to_vec();
    all.extend(["--rounds", "2", "--actions", "5", "--samples", "24", "--seed", "1", "--json"]);
    let report: Value = serde_json::from_str(&good(&all, "")).unwrap();
    assert_eq!(report["latents"].as_array().unwrap().len(), 3);
    for latent in report["latents"].as_array().unwrap() {
        assert!(
            latent["name"].is_string() && latent["value"].is_number() && latent["identifiable"].is_boolean()
        );
        assert_eq!(latent["ci95"].as_array().unwrap().len(), 2);
    }
    assert_eq!(report["residuals"].as_array().unwrap().len(), 2);
    assert_eq!(report["real_interactions"], 10);
    assert_eq!((&report["strategy"], &report["seed"]), (&Value::from("mixed"), &Value::from(1)));
    assert!(report["seconds"].as_f64().unwrap() > 0.0 && report["config"].is_object());
    refused(&["estimate", "--strategy", "psychic"], "", "collisions, rolling, random, mixed");
    refused(&["estimate", "--preset", "slow"], "", "fast or paper");
    refused(&["estimate", "--rounds", "0"], "", "rounds");
    let nowhere = std::env::temp_dir().join("iplw-refused");
    let experiment = |name| ["experiment", name, "--worlds", "windy", "--out", nowhere.to_str().unwrap()];
    refused(&experiment("harder"), "", "wind, quadratic_drag");
    refused(&experiment("bowling"), "", "--worlds");
    for (option, value) in [("--effect", "wind:ax=1"), ("--estimators", "iplw")] {
        let unheeded = ["experiment", "harder", option, value, "--out", nowhere.to_str().unwrap()];
        refused(&unheeded, "", "applies to grounding");
    }
    for (option, value, allowed) in [
        ("--strategies", "psychic", "collisions, rolling"),
        ("--real", "damping=2", "damping"),
        ("--real", "grip=1", "friction, restitution"),
    ] {
        refused(&["experiment", "bowling", option, value, "--out", nowhere.to_str().unwrap()], "", allowed);
    }
    refused(&["experiment", "latents", "--with-drag", "--out", nowhere.to_str().unwrap()], "", "applies to");
    refused(&["estimate", "--real", "grip=1"], "", "grip");
}

#[test]
fn trains_saves_and_evaluates_a_policy() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("p.safetensors");
    let file = path.to_str().unwrap();
    let latents = ["--latents", "friction=0.2,restitution=0.7"];
    let mut all = vec!["train", "--task", "basketball", "--per-task", "40", "--batches", "60", "--out", file];
    all.extend(latents);
    good(&all, "");
    let tried: Value = serde_json::from_str(&good(
        &["evaluate", "--task", "basketball", "--policy", file, "--candidates", "500", "--json"],
        "",
    ))
    .unwrap();
    assert_eq!(tried["tasks"].as_array().unwrap().len(), 5);
    assert!((0.0..=1.0).contains(&tried["auccess"].as_f64().unwrap()));
    refused(&["evaluate", "--task", "bowling", "--policy", file], "", "basketball");
    std::fs::write(&path, b"not weights").unwrap();
    refused(&["evaluate", "--task", "basketball", "--policy", file], "", "p.safetensors");
}

/// A posterior with one sample gives the same weights, to the bit, as that world, with any number of threads.
#[test]
fn trains_a_policy_on_posterior_samples() {
    let dir = tempfile::tempdir().unwrap();
    let path = |name: &str| dir.path().join(name).to_str().unwrap().to_string();
    let posterior = |name: &str, columns: Value| {
        let document = json!({"format": "iplw.posterior/2", "converged": true, "columns": columns});
        std::fs::write(dir.path().join(name), document.to_string()).unwrap();
        path(name)
    };
    let one =
        posterior("one.json", json!({"friction": [0.2], "restitution": [0.7], "linear_drag.c": [0.223]}));
    let two = posterior("two.json", json!({"friction": [0.2, 0.2], "restitution": [0.7, 0.3]}));
    let bad = posterior("bad.json", json!({"friction": [0.2, -1.0]}));
    let train = ["train", "--task", "basketball", "--per-task", "40", "--batches", "20", "--seed", "4"];
    let weights = |more: &[&str]| {
        let out = path("p.safetensors");
        good(&[&train[..], more, &["--out", &out]].concat(), "");
        std::fs::read(out).unwrap()
    };
    let point = weights(&["--latents", "friction=0.2,restitution=0.7", "--effect", "linear_drag:c=0.223"]);
    assert!(weights(&["--posterior", &one]) == point);
    assert!(weights(&["--posterior", &one, "--threads", "1"]) == point);
    let both = weights(&["--posterior", &two]);
    assert!(both != point && both == weights(&["--posterior", &two, "--fold", "0"]));
    assert!(both != weights(&["--posterior", &two, "--fold", "1"]));
    let no = |more: &[&str], wanted: &str| refused(&[&train[..], more].concat(), "", wanted);
    no(&["--posterior", &bad], "columns.friction[1]");
    no(&["--posterior", &one, "--randomised"], "--randomised");
    no(&["--posterior", &one, "--latents", "friction=1"], "--latents");
    no(&["--preset", "saturating"], "--batches");
    refused(&["train", "--task", "basketball", "--preset", "quick"], "", "--preset");
    refused(&["train", "--task", "basketball:000", "--preset", "saturating"], "", "--preset saturating");
    refused(&["train", "--task", "basketball:000", "--fold", "1"], "", "--fold");
}

/// Without a number of updates, validation tasks determine the length of training, and the program reports it.
#[test]
fn training_stops_at_saturation() {
    let dir = tempfile::tempdir().unwrap();
    let file = dir.path().join("p.safetensors");
    let latents = ["--latents", "friction=0.2,restitution=0.7", "--effect", "linear_drag:c=0.223"];
    let small = ["--per-task", "60", "--batch-size", "8"];
    let all = [&["train", "--task", "basketball", "--out", file.to_str().unwrap()], &small[..]].concat();
    let said = good(&[&all[..], &latents].concat(), "");
    assert!(said.contains("AUCCESS on the validation tasks") && said.contains("after 1000, "), "{said}");
    let paper = good(&[&all[..], &latents, &["--preset", "paper"]].concat(), "");
    assert!(paper.contains(", 1000 batches in") && !paper.contains("validation"), "{paper}");
}

#[test]
fn prints_help_and_rejects_unknown_commands() {
    assert!(good(&["--help"], "").contains("rollout"));
    assert_eq!(iplw(&["fly"], "").status.code(), Some(2));
}

/// All commands that compute have --threads, and results don't depend on it.
#[test]
fn results_do_not_depend_on_the_number_of_threads() {
    let estimate = ["estimate", "--task", "basketball", "--rounds", "1", "--actions", "4", "--samples", "24"];
    let with = |threads| {
        let all = [&estimate[..], &["--json", "--threads", threads]].concat();
        let mut report: Value = serde_json::from_str(&good(&all, "")).unwrap();
        report["seconds"] = Value::Null;
        report
    };
    assert_eq!(with("1"), with("3"));
    for wrong in ["0", "1025", "two"] {
        refused(&["measure", "--task", "bowling", "--out", "nowhere", "--threads", wrong], "", "--threads");
    }
    for command in [
        "run",
        "experiment",
        "rollout",
        "measure",
        "estimate",
        "surface",
        "diagnose",
        "train",
        "evaluate",
        "serve",
    ] {
        let help = good(&[command, "--help"], "");
        assert!(help.contains("--threads") && help.contains("--exit-with-stdin"), "{command}");
    }
}

/// A command with --exit-with-stdin ends with its parent process.
#[test]
fn commands_end_with_their_standard_input() {
    let minutes = ["estimate", "--preset", "paper", "--exit-with-stdin"];
    let mut child = Command::new(env!("CARGO_BIN_EXE_iplw"))
        .args(minutes)
        .stdin(Stdio::piped())
        .stderr(Stdio::null())
        .spawn()
        .unwrap();
    std::thread::sleep(std::time::Duration::from_millis(300));
    assert!(child.try_wait().unwrap().is_none(), "it computes while the pipe is open");
    drop(child.stdin.take());
    assert_eq!(child.wait().unwrap().code(), Some(1));
    refused(&["rollout", "--exit-with-stdin"], FALL, "--exit-with-stdin");
}

fn read_trials(path: &Path, scene: &iplw::task::Scene) -> Vec<iplw::reality::Trial> {
    iplw::reality::trials_from_csv(&std::fs::read_to_string(path).unwrap(), scene).unwrap()
}

fn files(dir: &Path) -> Vec<String> {
    std::fs::read_dir(dir).unwrap().map(|e| e.unwrap().file_name().to_string_lossy().into_owned()).collect()
}

/// A surface is computed, drawn, read again and used for estimation; one of another family is rejected.
#[test]
fn estimation_uses_computed_surfaces() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name).to_string_lossy().into_owned();
    let (json, svg) = (at("surface.json"), at("surface.svg"));
    let find = ["surface", "--task", "basketball", "--points", "6", "--actions", "200", "--out", &json];
    let out = good(&[&find[..], &["--svg", &svg, "--mark", "here:friction=0.4"]].concat(), "");
    assert!(out.contains("restitution over friction") && out.contains("at here: AUCCESS"), "{out}");
    let found: Value = serde_json::from_str(&std::fs::read_to_string(&json).unwrap()).unwrap();
    assert_eq!(found["format"], "iplw.surface/1");
    assert_eq!(
        (found["points"].as_array().unwrap().len(), found["related"].as_array().unwrap().len()),
        (6, 2)
    );
    let drawn = std::fs::read_to_string(&svg).unwrap();
    assert!(drawn.contains("friction, 1") && drawn.contains("standard deviation") && drawn.contains("here"));
    // A second computation gives the same bits.
    let again = at("again.json");
    good(&[&find[..8], &[&again]].concat(), "");
    assert_eq!(std::fs::read(&json).unwrap(), std::fs::read(&again).unwrap());
    let small = ["--rounds", "1", "--actions", "4", "--samples", "16", "--json"];
    for strategy in ["gradient", "informative"] {
        let args = ["estimate", "--task", "basketball", "--strategy", strategy, "--surface", &json];
        let report: Value = serde_json::from_str(&good(&[&args[..], &small].concat(), "")).unwrap();
        let choice = &report["choices"][0];
        assert_eq!(choice["actions"], 4, "{strategy}");
        assert_eq!(choice["groups"].is_null(), strategy != "gradient");
        assert_eq!(choice["rollouts"].as_u64().unwrap() > 0, strategy == "informative");
    }
    let other = ["estimate", "--task", "bowling", "--strategy", "gradient", "--surface", &json];
    refused(&other, "", "family");
    refused(&["surface", "--route", "magic"], "", "ideal, dqn");
    refused(&["surface", "--related", "noise=0.1"], "", "--related");
    refused(&["surface", "--from", &json, "--points", "5"], "", "--from");
}

/// Listening on a public address needs tokens; tokens are created, listed and revoked.
#[test]
fn public_addresses_need_tokens() {
    let place = tempfile::tempdir().unwrap();
    let data = place.path().join("data").display().to_string();
    let run = |args: &[&str], input: &str| {
        let out = iplw(args, input);
        let text = |bytes: Vec<u8>| String::from_utf8(bytes).unwrap();
        (out.status.code().unwrap(), text(out.stdout), text(out.stderr))
    };
    let (code, _, said) = run(&["serve", "--http", "0.0.0.0:0"], "");
    assert_eq!(code, 2, "{said}");
    assert!(said.contains("`--http` is 0.0.0.0") && said.contains("iplw token new"), "{said}");
    let (code, _, said) = run(&["serve", "--http", "127.0.0.1:0", "--zmq", "tcp://*:*"], "");
    assert!(code == 2 && said.contains("`--zmq`"), "{code} {said}");
    let (code, token, said) =
        run(&["token", "new", "ann", "--scope", "act", "--expires", "30d", "--data-dir", &data], "");
    assert!(code == 0 && token.starts_with("iplw_") && token.trim().len() == 48, "{said}");
    assert!(said.contains("ann has scope act until 20") && !said.contains(token.trim()), "{said}");
    let (code, _, said) = run(&["token", "new", "ann", "--scope", "read", "--data-dir", &data], "");
    assert!(code == 2 && said.contains("ann"), "{said}");
    let (code, _, said) = run(&["token", "new", "bob", "--scope", "fly", "--data-dir", &data], "");
    assert!(code == 2 && said.contains("read, act or admin"), "{said}");
    let (code, listed, _) = run(&["token", "list", "--data-dir", &data], "");
    assert!(code == 0 && listed.starts_with("ann ") && listed.contains("expires 20"), "{listed}");
    assert!(!listed.contains(token.trim()));
    // With tokens, but without encryption.
    let (code, _, said) = run(&["serve", "--http", "0.0.0.0:0", "--data-dir", &data], "");
    assert!(code == 2 && said.contains("--plaintext"), "{said}");
    assert_eq!(run(&["token", "revoke", "ann", "--data-dir", &data], "").0, 0);
    let (code, _, said) = run(&["token", "revoke", "ann", "--data-dir", &data], "");
    assert!(code == 2 && said.contains("no token named `ann`"), "{said}");
    let (code, _, row) = run(&["token", "new", "ci", "--scope", "act"], "");
    assert!(code == 0 && row.starts_with("IPLW_TOKENS='[{"), "{row}");
}
