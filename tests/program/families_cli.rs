//! User-defined families: from a file to a served world.

use std::io::{BufRead, BufReader};
use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};

use serde_json::Value;

/// A ball to drop onto a plate: a fifth of all positions solve it, robustly.
pub(super) const DROP: &str = r#"
format = "iplw.family/1"
name = "drop"
about = "drop the ball onto the plate"

[candidates]
count = 12

[candidates.parameters]
middle = { low = -3, high = 3 }
half = [0.6, 0.8, 3]

[scene]
time_step = "= 1 / 120"
steps = 150
observe_every = 30
bodies = [{ name = "red", shape = { type = "disc", radius = 0.2 } }]

[[scene.statics]]
name = "plate"
shape = { type = "box", half_width = "= half", half_height = 0.1 }
position = ["= middle", 0]

[scene.goal]
type = "contact"
bodies = ["red", "plate"]

[scene.action]
components = [
  { target = "red", set = "x", low = -4, high = 4 },
  { target = "red", set = "y", low = 1, high = 2 },
]
discrete = { type = "sequence", count = 500 }

[real]
density = 1.0
friction = 0.5
restitution = 0.4
damping = 0.8

[tasks]
train = 2
validation = 1
test = 1
sample = 100
bins = [{ from = 0.05, to = 0.5, tasks = 4 }]
"#;

pub fn iplw(args: &[&str], own: Option<&Path>) -> Output {
    let mut command = Command::new(env!("CARGO_BIN_EXE_iplw"));
    if let Some(folder) = own {
        command.env("IPLW_TASKS", folder);
    }
    command.args(args).output().unwrap()
}

/// Expects the exit code, and all of `wanted` in standard output or error; returns both.
pub fn told(out: &Output, code: i32, wanted: &[&str]) -> String {
    let said = [&out.stdout, &out.stderr].map(|s| String::from_utf8_lossy(s)).join("\n");
    assert_eq!(out.status.code(), Some(code), "{said}");
    for text in wanted {
        assert!(said.contains(text), "{text:?} is not in {said}");
    }
    said
}

fn family(folder: &Path, text: &str) -> PathBuf {
    let path = folder.join("drop.toml");
    std::fs::write(&path, text).unwrap();
    path
}

#[test]
fn certifies_and_uses_a_family() {
    let folder = tempfile::tempdir().unwrap();
    let (path, out) = (family(folder.path(), DROP), folder.path().join("out"));
    let (file, out) = (path.to_str().unwrap(), out.to_str().unwrap());
    let beside = folder.path().join("drop.certified.json");
    // An interrupted search keeps its results.
    told(&iplw(&["tasks", "check", file, "--candidates", "2"], None), 1, &["too few tasks", "of 4 tasks"]);
    let journal = folder.path().join("drop.search.jsonl");
    assert!(journal.is_file() && !beside.exists());
    // A preview changes neither file.
    let args = ["tasks", "check", file, "--tasks", "1", "--out", out];
    told(&iplw(&args, None), 0, &["1 of 1 tasks", "contact sheet"]);
    for ending in ["svg", "png", "csv", "certified.json"] {
        assert!(Path::new(out).join(format!("drop.{ending}")).is_file(), "{ending}");
    }
    assert!(journal.is_file() && !beside.exists());
    let args = ["tasks", "check", file];
    told(&iplw(&args, None), 0, &["resumes after 2 candidates", "4 of 4 tasks", "certified tasks"]);
    let found = std::fs::read_to_string(&beside).unwrap();
    assert!(!journal.exists());
    // The same as without interruption.
    told(&iplw(&args, None), 0, &["4 of 4 tasks"]);
    assert_eq!(std::fs::read_to_string(&beside).unwrap(), found);

    let own = Some(folder.path());
    let listed = told(
        &iplw(&["tasks"], own),
        0,
        &["bowling:", "drop: drop the ball", "2 train, 1 validation, 1 test"],
    );
    assert_eq!(listed.matches("\ndrop:").count(), 1);
    let whole = iplw(&["tasks", "drop", "--json", "--tasks", folder.path().to_str().unwrap()], None);
    let whole: Value = serde_json::from_slice(&whole.stdout).unwrap();
    assert_eq!(whole["tasks"].as_array().unwrap().len(), 4);
    let measured = folder.path().join("measured");
    let args = ["measure", "--task", "drop:002", "--trials", "1", "--out", measured.to_str().unwrap()];
    told(&iplw(&args, own), 0, &[]);
    assert!(measured.join("trials.csv").is_file());
    served(folder.path());
    told(&iplw(&["tasks", "drop"], None), 2, &["no task family named `drop`"]);
}

/// Worlds of the family are served.
fn served(folder: &Path) {
    let mut server = Command::new(env!("CARGO_BIN_EXE_iplw"))
        .args(["serve", "--http", "127.0.0.1:0", "--exit-with-stdin", "--tasks", folder.to_str().unwrap()])
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .spawn()
        .unwrap();
    let mut lines = BufReader::new(server.stdout.take().unwrap()).lines();
    let first = lines.next().unwrap().unwrap();
    let base = &first[first.find("http://").unwrap()..];
    let client = reqwest::blocking::Client::new();
    let get = |path: &str| -> Value {
        let text =
            client.get(format!("{}{path}", base.trim_end_matches('/'))).send().unwrap().text().unwrap();
        serde_json::from_str(&text).unwrap()
    };
    let families = get("/v1/tasks");
    let names: Vec<&str> =
        families["families"].as_array().unwrap().iter().map(|f| f["name"].as_str().unwrap()).collect();
    assert!(names.contains(&"drop") && names.contains(&"bowling"), "{names:?}");
    assert_eq!(get("/v1/tasks/drop")["tasks"].as_array().unwrap().len(), 4);
    assert_eq!(get("/v1/worlds/drop-real")["id"], "drop-real");
    drop(server.stdin.take());
    assert!(server.wait().unwrap().success());
}

#[test]
fn rejects_invalid_families() {
    let folder = tempfile::tempdir().unwrap();
    let check = |text: &str, code: i32, wanted: &[&str]| {
        let path = family(folder.path(), text);
        told(&iplw(&["tasks", "check", path.to_str().unwrap()], None), code, wanted);
        let _ = std::fs::remove_file(folder.path().join("drop.search.jsonl"));
        assert!(!folder.path().join("drop.certified.json").exists());
    };
    check(&DROP.replace("count = 12", "cuont = 12"), 2, &["drop.toml:line 7: `candidates.cuont`"]);
    check(&DROP.replace("\"= half\"", "\"= hlaf\""), 2, &["drop.toml: `scene.statics[0].shape.half_width`"]);
    check(&DROP.replace("to = 0.5", "to = 0.06"), 1, &["too easy", "try a harder goal or higher ranges"]);
    let never = DROP.replace("position = [\"= middle\", 0]", "position = [\"= middle\", 9]");
    check(&never, 1, &["unsolvable", "try an easier goal"]);

    // A directory is loaded as a whole or rejected with the reason, by every command.
    family(folder.path(), DROP);
    let own = Some(folder.path());
    for args in [&["tasks"][..], &["measure", "--task", "bowling", "--out", "never"], &["serve"], &["mcp"]] {
        told(&iplw(args, own), 2, &["drop.toml", "`iplw tasks check"]);
    }
    std::fs::write(folder.path().join("drop.certified.json"), "[]").unwrap();
    told(&iplw(&["tasks"], own), 2, &["drop.certified.json"]);
    told(
        &iplw(&["tasks"], Some(Path::new("/nowhere"))),
        2,
        &["/nowhere", "a collection (levels, phyre) or a directory"],
    );
    std::fs::remove_file(folder.path().join("drop.toml")).unwrap();
    told(&iplw(&["tasks"], own), 0, &["no families in", "bowling:"]);
    let both = std::env::join_paths(["levels", "phyre"]).unwrap();
    told(&iplw(&["tasks", "seesaw"], Some(Path::new(&both))), 0, &["seesaw"]);
}
