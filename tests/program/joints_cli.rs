//! Scenes with joints on the command line.

use std::fmt::Write as _;
use std::path::Path;
use std::process::{Command, Output};

use iplw::inference::mechanism::diagnose_joints;
use iplw::progress::NoProgress;
use iplw::reality::joint_worlds::{Mechanism, RecordingPlan};
use iplw::world::mechanism::effect::find;
use serde_json::{Value, json};

fn iplw(arguments: &[&str], folder: &Path) -> Output {
    Command::new(env!("CARGO_BIN_EXE_iplw")).args(arguments).current_dir(folder).output().unwrap()
}

/// A rod in a horizontal plane on a driven hinge, and free to turn.
fn scene() -> Value {
    json!({
        "format": "iplw.scene/2", "gravity": [0.0, 0.0], "time_step": 0.002, "steps": 200, "observe_every": 50,
        "bodies": [{"name": "rod", "shape": {"type": "box", "half_width": 0.02, "half_height": 0.5}, "mass": 1.0, "inertia": 1.0 / 12.0, "position": [0.0, -0.5]}],
        "joints": [{"name": "hinge", "kind": "revolute", "body": "rod", "anchor": [0.0, 0.0]}],
        "motors": [{"joint": "hinge", "control": "torque", "max_torque": 5.0}],
    })
}

#[test]
fn rollouts_follow_commands() {
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("scene.jsonl"), scene().to_string()).unwrap();
    std::fs::write(folder.path().join("commands.csv"), "t,hinge.command\n0,2.0\n").unwrap();
    let out = iplw(&["rollout", "--in", "scene.jsonl", "--commands", "commands.csv"], folder.path());
    assert!(out.status.success(), "{}", String::from_utf8_lossy(&out.stderr));
    let record: Value = serde_json::from_slice(&out.stdout).unwrap();
    assert_eq!(record["t"], json!([0.0, 0.1, 0.2, 0.3, 0.4]));
    // tau t^2 / 2 I with I = 1/3 kg m^2.
    let last = record["joints"]["hinge"]["position"][4].as_f64().unwrap();
    assert!((last - 0.5 * 2.0 * 3.0 * 0.16).abs() < 1e-9, "{last}");
}

#[test]
fn invalid_joints_are_named() {
    let folder = tempfile::tempdir().unwrap();
    let refused = |change: &dyn Fn(&mut Value), reason: &str| {
        let mut scene = scene();
        change(&mut scene);
        std::fs::write(folder.path().join("scene.jsonl"), scene.to_string()).unwrap();
        let out = iplw(&["rollout", "--in", "scene.jsonl"], folder.path());
        let error = String::from_utf8_lossy(&out.stderr);
        assert_eq!(out.status.code(), Some(2), "{error}");
        assert!(error.contains(reason), "{error} lacks {reason}");
    };
    refused(&|s| s["joints"][0]["body"] = "arm".into(), "joints[0].body");
    refused(&|s| s["joints"][0]["parent"] = "rod".into(), "joints[0].parent");
    refused(&|s| s["joints"][0]["kind"] = "prismatic".into(), "joints[0].axis");
    refused(&|s| s["joints"][0]["effects"] = json!([{"name": "magic"}]), "joints[0].effects[0].name");
    refused(&|s| s["motors"][0]["joint"] = "knee".into(), "motors[0].joint");
    refused(&|s| s["motors"][0]["control"] = "velocity".into(), "motors[0].damping");
    refused(&|s| s["format"] = "iplw.scene/1 for iplw.scene/2".into(), "format");
}

/// Designed commands stay within the motor's limit, drive a rollout, and are the same bits for the same seed.
#[test]
fn designs_excitations() {
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("scene.json"), scene().to_string()).unwrap();
    std::fs::write(folder.path().join("scene.jsonl"), scene().to_string()).unwrap();
    let report = json!({"rivals": [["viscous_friction (hinge)"], ["coulomb_friction (hinge)"]]}).to_string();
    std::fs::write(folder.path().join("report.json"), report).unwrap();
    let arguments = [
        "excite",
        "--scene",
        "scene.json",
        "--report",
        "report.json",
        "--trials",
        "2",
        "--duration",
        "1",
        "--out",
    ];
    let run = |more: &[&str]| iplw(&[&arguments, more].concat(), folder.path());
    for out in ["next", "again"] {
        let out = run(&[out]);
        assert!(out.status.success(), "{}", String::from_utf8_lossy(&out.stderr));
    }
    let read = |path: &str| std::fs::read_to_string(folder.path().join(path)).unwrap();
    assert_eq!(read("next/design.json"), read("again/design.json"));
    let design: Value = serde_json::from_str(&read("next/design.json")).unwrap();
    assert_eq!(design["excitations"].as_array().unwrap().len(), 2);
    assert!(design["excitations"][1]["score"].as_f64() >= design["excitations"][0]["score"].as_f64());
    let commands = read("next/commands-2.csv");
    let numbers =
        commands.lines().skip(1).map(|line| line.split_once(',').unwrap().1.parse::<f64>().unwrap());
    assert!(numbers.clone().count() == 101 && numbers.clone().all(|tau| tau.abs() <= 4.5));
    let out = iplw(&["rollout", "--in", "scene.jsonl", "--commands", "next/commands-1.csv"], folder.path());
    assert!(out.status.success(), "{}", String::from_utf8_lossy(&out.stderr));
    for (more, reason) in [
        (vec!["never", "--position", "knee=-1..1"], "knee"),
        (vec!["never", "--position", "hinge=1"], "hinge=-0.5..0.5"),
        (vec!["never", "--duration", "0"], "--duration"),
        (vec!["never", "--max-velocity", "0.000001"], "within"),
    ] {
        let out = run(&more);
        let error = String::from_utf8_lossy(&out.stderr);
        assert!(out.status.code() == Some(2) && error.contains(reason), "{error} lacks {reason}");
    }
}

/// A recording as a file gives the report of the library.
#[test]
fn diagnoses_a_recording_of_joints() {
    let folder = tempfile::tempdir().unwrap();
    let plan = RecordingPlan { trials: 6, duration: 2.0, rate: 50.0, noise: 1e-3 };
    let hidden = (find("viscous_friction").unwrap(), 0);
    let world = Mechanism::Pendulum.world(Some(hidden), &plan, 31).unwrap();
    let mut csv = String::from("trial,t,hinge,hinge.command\n");
    for trial in &world.trials {
        for (t, q) in trial.times.iter().zip(&trial.positions) {
            let _ = writeln!(csv, "{},{t},{},{}", trial.id, q[0], trial.commands.mean(0, [*t, *t]));
        }
    }
    std::fs::write(folder.path().join("scene.json"), world.scene.to_json()).unwrap();
    std::fs::write(folder.path().join("log.csv"), &csv).unwrap();
    let arguments = ["diagnose", "--scene", "scene.json", "--trials", "log.csv", "--out", "report"];
    let out = iplw(&arguments, folder.path());
    assert!(out.status.success(), "{}", String::from_utf8_lossy(&out.stderr));
    let text = std::fs::read_to_string(folder.path().join("report/report.json")).unwrap();
    let report: Value = serde_json::from_str(&text).unwrap();
    let wanted = diagnose_joints(&world.scene, &world.trials, 3, 0, &NoProgress).unwrap();
    assert_eq!(report, serde_json::to_value(&wanted).unwrap());
    assert_eq!(report["verdict"], "named", "{}", report["reason"]);
    assert_eq!(report["effects"][0]["name"], "viscous_friction");
    let page = std::fs::read_to_string(folder.path().join("report/report.html")).unwrap();
    for text in
        ["The simulation lacks viscous friction in hinge", "tau = -b v", "hinge: measured minus simulated"]
    {
        assert!(page.contains(text), "{text} is missing");
    }
    let extended = std::fs::read_to_string(folder.path().join("report/extended_scene.json")).unwrap();
    assert!(extended.contains("viscous_friction"));
    let last = world.trials[5].times.last().unwrap();
    for (wrong, reason) in [
        (csv.replace("hinge.command", "hinge.torque"), "hinge.torque"),
        (csv.replace(&format!("5,{last},"), "5,1e9,"), "trial 5, t"),
        (csv.replace("trial,t", "trial,time"), "column time"),
    ] {
        std::fs::write(folder.path().join("log.csv"), wrong).unwrap();
        let out = iplw(&arguments, folder.path());
        let error = String::from_utf8_lossy(&out.stderr);
        assert!(out.status.code() == Some(2) && error.contains(reason), "{error}");
    }
    let out = iplw(
        &["posterior", "--scene", "scene.json", "--trials", "log.csv", "--out", "p.json"],
        folder.path(),
    );
    assert_eq!(out.status.code(), Some(2));
}
