//! The engine `gpu` through a stand-in for NVIDIA's driver that runs the kernel on the processor: the program loads it
//! as it loads the driver.

use std::path::{Path, PathBuf};
use std::process::{Command, Output};

use serde_json::{Value, json};

/// The folder of the stand-in, built if necessary.
fn stand_in(folder: &Path) -> PathBuf {
    let project = Path::new(env!("CARGO_MANIFEST_DIR"));
    let target = project.join("target/stand_in");
    let done = Command::new(env!("CARGO"))
        .args(["build", "--quiet", "--locked", "--release", "--manifest-path"])
        .arg(project.join("gpu/stand_in/Cargo.toml"))
        .env("CARGO_TARGET_DIR", &target)
        .env_remove("RUSTFLAGS")
        .status()
        .unwrap();
    assert!(done.success());
    std::fs::copy(target.join("release/libiplw_gpu_stand_in.so"), folder.join("libcuda.so.1")).unwrap();
    folder.to_path_buf()
}

/// Index of the large scene.
const LARGE: usize = 7;

fn iplw(arguments: &[&str], driver: &Path) -> Output {
    Command::new(env!("CARGO_BIN_EXE_iplw")).args(arguments).env("LD_LIBRARY_PATH", driver).output().unwrap()
}

/// Two bodies, and many in one scene, which needs more memory than a thread has.
fn scenes() -> Vec<Value> {
    let body = |name: &str, shape: Value, x: f64, y: f64| json!({"name": name, "shape": shape, "position": [x, y], "friction": 0.4, "restitution": 0.5});
    let disc = json!({"type": "disc", "radius": 0.2});
    let block = json!({"type": "box", "half_width": 0.3, "half_height": 0.2});
    let floor = json!({"name": "floor", "shape": {"type": "box", "half_width": 9.0, "half_height": 0.5}, "position": [0.0, -0.5]});
    let scene = |i: usize, second: &Value| {
        let x = 0.03 * i as f64;
        json!({
            "format": "iplw.scene/1", "gravity": [0.0, -9.8], "time_step": 0.005, "steps": 400, "observe_every": 20,
            "bodies": [body("a", disc.clone(), x, 1.0), body("b", second.clone(), 0.1 - x, 1.7)], "statics": [floor],
            "effects": [{"name": "linear_drag", "parameters": {"c": 0.1 * (i % 4) as f64}}],
        })
    };
    let mut scenes: Vec<Value> = (0..40).map(|i| scene(i, if i % 2 == 0 { &disc } else { &block })).collect();
    let more = (0..24)
        .map(|k| body(&format!("c{k}"), block.clone(), f64::from(k % 8) - 4.0, 3.0 + f64::from(k / 8)));
    scenes[LARGE]["bodies"].as_array_mut().unwrap().extend(more);
    scenes
}

#[test]
fn rollouts_through_the_driver_have_the_same_bits() {
    let folder = tempfile::tempdir().unwrap();
    let driver = stand_in(folder.path());
    let input = folder.path().join("scenes.jsonl");
    let text: String = scenes().iter().map(|scene| format!("{scene}\n")).collect();
    std::fs::write(&input, text).unwrap();
    let lines = |engine: &str| -> Vec<Value> {
        let out = iplw(&["rollout", "--engine", engine, "--in", input.to_str().unwrap()], &driver);
        assert!(out.status.success(), "{}", String::from_utf8_lossy(&out.stderr));
        String::from_utf8(out.stdout)
            .unwrap()
            .lines()
            .map(|line| serde_json::from_str(line).unwrap())
            .collect()
    };
    let (mut ours, wanted) = (lines("gpu"), lines("lanes"));
    let engines: Vec<String> = ours.iter().map(|line| line["engine"].as_str().unwrap().to_string()).collect();
    // The large scene runs on the processor, and the output says so.
    assert_eq!(engines.iter().filter(|e| *e == "gpu").count(), 39);
    assert_eq!(engines[LARGE], "lanes");
    ours.iter_mut().for_each(|line| line["engine"] = "lanes".into());
    assert_eq!(ours, wanted);
}

#[test]
fn a_broken_driver_is_an_error_that_says_so() {
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("libcuda.so.1"), "no library").unwrap();
    let out = iplw(&["rollout", "--engine", "gpu"], folder.path());
    let error = String::from_utf8_lossy(&out.stderr);
    assert_eq!(out.status.code(), Some(2), "{error}");
    assert!(error.contains("graphics processor") && error.contains("\"lanes\""), "{error}");
}
