//! `iplw diagnose`: files in, files out, exit codes.

use std::path::Path;
use std::process::{Command, Output};

use iplw::reality::trials_to_csv;

use crate::worlds;

fn diagnose(scene: &Path, trials: &Path, out: &Path) -> Output {
    Command::new(env!("CARGO_BIN_EXE_iplw"))
        .arg("diagnose")
        .args(["--scene".as_ref(), scene.as_os_str(), "--trials".as_ref(), trials.as_os_str()])
        .args(["--out".as_ref(), out.as_os_str()])
        .output()
        .unwrap()
}

#[test]
fn diagnose_writes_its_files() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    let trials = worlds::trials(&worlds::single(2, 1), worlds::Noise::White, 8, 30, 8.0, 1);
    std::fs::write(at("scene.json"), worlds::scene().to_json()).unwrap();
    std::fs::write(at("trials.csv"), trials_to_csv(&trials)).unwrap();
    let done = diagnose(&at("scene.json"), &at("trials.csv"), &at("out"));
    assert!(done.status.success(), "{}", String::from_utf8_lossy(&done.stderr));
    let text = String::from_utf8(done.stdout).unwrap();
    assert!(text.starts_with("verdict: "), "{text}");
    for name in ["report.json", "report.html", "extended_scene.json", "residuals.svg", "predictive_check.svg"]
    {
        assert!(at("out").join(name).is_file(), "{name} is missing");
    }
    let report = std::fs::read_to_string(at("out").join("report.json")).unwrap();
    let json: serde_json::Value = serde_json::from_str(&report).unwrap();
    for (part, list) in
        [("launches", ""), ("predictive", "/launches"), ("paths", "/launches"), ("scores", "")]
    {
        let known = json[part].pointer(list).and_then(|v| v.as_array());
        assert!(known.is_some_and(|v| v.len() >= 8), "{part}: {known:?}");
    }
    assert!(report.len() < 100_000, "{} bytes for 8 launches", report.len());
    let html = std::fs::read_to_string(at("out").join("report.html")).unwrap();
    assert!(!html.contains("src=") && html.contains("<svg") && html.contains("<main class=\"report\">"));
    assert!(
        html.matches("<figure>\n<div class=\"picture\"").count() <= 6,
        "a report has at most six figures"
    );
    let rolled = Command::new(env!("CARGO_BIN_EXE_iplw"))
        .args(["rollout", "--in"])
        .arg(flat(&at("out").join("extended_scene.json"), &at("line.jsonl")))
        .output()
        .unwrap();
    assert!(rolled.status.success(), "{}", String::from_utf8_lossy(&rolled.stderr));
}

#[test]
fn invalid_input_has_exit_code_2_and_writes_nothing() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    std::fs::write(at("scene.json"), worlds::scene().to_json()).unwrap();
    std::fs::write(at("bad.json"), "{\"format\": \"iplw.scene/1\", \"bodes\": []}").unwrap();
    std::fs::write(at("bad.csv"), "trial,t,body,x,y\na,0,bal,1,1\n").unwrap();
    std::fs::write(at("good.csv"), "trial,t,body,x,y\na,0,ball,1,1\n").unwrap();
    for (scene, trials, wanted) in [
        ("bad.json", "good.csv", "bodes"),
        ("scene.json", "bad.csv", "bad.csv:2"),
        ("scene.json", "missing.csv", "missing.csv"),
        ("missing.json", "good.csv", "missing.json"),
    ] {
        let done = diagnose(&at(scene), &at(trials), &at("out"));
        let error = String::from_utf8_lossy(&done.stderr).to_string();
        assert_eq!(done.status.code(), Some(2), "{scene} {trials}: {error}");
        assert!(error.contains(wanted), "{error}");
        assert!(!at("out").exists());
    }
}

/// A file's JSON on one line.
fn flat(from: &Path, to: &Path) -> std::path::PathBuf {
    let value: serde_json::Value = serde_json::from_str(&std::fs::read_to_string(from).unwrap()).unwrap();
    std::fs::write(to, value.to_string() + "\n").unwrap();
    to.to_path_buf()
}
