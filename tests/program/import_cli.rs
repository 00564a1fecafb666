//! `iplw tasks import`.

use std::io::Write;
use std::path::Path;

use flate2::{Compression, write::GzEncoder};
use iplw::task::read_families;
use serde_json::{Value, json};

use crate::families_cli::{iplw, told};

/// A ball on a ledge to bring to the floor, in PHYRE's pixels.
fn task(x: f64, ball_y: f64, solutions: &[[f64; 3]]) -> Value {
    let rectangle = |w: f64, h: f64| json!([{"polygon": [[w, h], [-w, h], [-w, -h], [w, -h]]}]);
    let fixed = |x: f64, y: f64, w: f64, h: f64, kind: Option<&str>| json!({"x": x, "y": y, "angle": 0.0, "dynamic": false, "kind": kind, "shapes": rectangle(w, h)});
    json!({
        "bodies": [
            fixed(128.0, -2.5, 128.0, 2.5, None), fixed(-2.5, 128.0, 2.5, 128.0, None),
            fixed(258.5, 128.0, 2.5, 128.0, None), fixed(x, 60.0, 12.0, 3.0, Some("bar")),
            {"x": x, "y": ball_y, "angle": 0.0, "dynamic": true, "kind": "ball", "shapes": [{"circle": 8.0}]}],
        "goal": {"relation": ["touching"], "body1": 4, "body2": 0},
        "solutions": solutions, "tier": "BALL", "phantom": false, "random_actions": {"-1": 90, "2": 10},
    })
}

/// Two tasks, the first with a valid and the second with an invalid solution, and one with overlapping bodies.
fn tasks() -> Value {
    let knocks = [118.3 / 255.0, 120.6 / 255.0, 8.2 / 30.0];
    json!({
        "00007:000": task(128.0, 71.0, &[knocks]),
        "00007:001": task(90.0, 71.0, &[[0.9, 0.3, 0.2]]),
        "00007:002": task(90.0, 63.0, &[knocks]),
        "00008:000": task(90.0, 71.0, &[]),
    })
}

fn written(path: &Path, text: &str) -> String {
    std::fs::write(path, text).unwrap();
    path.to_str().unwrap().into()
}

#[test]
fn imports_phyre_tasks_with_their_solutions() {
    let folder = tempfile::tempdir().unwrap();
    let (out, gz) = (folder.path().join("out"), folder.path().join("tasks.json.gz"));
    let mut encoder = GzEncoder::new(std::fs::File::create(&gz).unwrap(), Compression::fast());
    encoder.write_all(tasks().to_string().as_bytes()).unwrap();
    encoder.finish().unwrap();
    let to = out.to_str().unwrap();
    let args = [
        "tasks",
        "import",
        "phyre",
        gz.to_str().unwrap(),
        "--template",
        "00007",
        "--sample",
        "60",
        "--out",
        to,
    ];
    let wanted = ["2 of 3 tasks imported; 1 of 2 solutions solve here", "00007:002", "overlaps"];
    let said = told(&iplw(&args, None), 0, &wanted);
    let row: Vec<&str> =
        said.lines().find(|l| l.starts_with("phyre_00007")).unwrap().split_whitespace().collect();
    // Tasks, valid; solutions, solving, invalid; tasks solved; imported, by their own solution.
    assert_eq!(row[1..11], ["3", "2", "|", "2", "1", "0", "1", "|", "2", "1"], "{said}");
    let names = |path: &Path| {
        let mut all: Vec<String> =
            std::fs::read_dir(path).unwrap().map(|e| e.unwrap().file_name().into_string().unwrap()).collect();
        all.sort();
        all
    };
    let all = ["phyre_00007.certified.json", "phyre_00007.scenes.jsonl", "phyre_00007.toml"];
    assert_eq!(names(&out), all);

    let family = read_families(&out).unwrap().remove(0);
    let (found, solution) = (family.tasks(), family.solutions(&[0.0])[0].clone());
    assert_eq!(found[0].certificate.as_ref().unwrap().action, solution.values());
    assert_eq!(found[1].scene.name, "00007:001");
    assert!(found[1].certificate.as_ref().unwrap().solving_share > 0.0);
    // It can be used like any other family.
    let before = std::fs::read_to_string(out.join(all[0])).unwrap();
    let own = Some(out.as_path());
    let path = out.join("phyre_00007.toml");
    told(&iplw(&["tasks", "check", path.to_str().unwrap()], None), 0, &["2 of 2 tasks"]);
    assert_eq!(std::fs::read_to_string(out.join(all[0])).unwrap(), before);
    told(
        &iplw(&["tasks"], own),
        0,
        &["phyre_00007: PHYRE's template 00007", "red.radius from 0.333 to 5.333"],
    );
    let table = folder.path().join("table");
    let args_of = ["outcomes", "--task", "phyre_00007", "--actions", "30", "--out", table.to_str().unwrap()];
    told(&iplw(&args_of, own), 0, &["2 tasks, 30 actions each"]);

    // A second import finds it complete; another family's files aren't overwritten.
    told(&iplw(&args, None), 0, &["already complete", "2 of 3 tasks imported"]);
    let other = written(&folder.path().join("other.json"), &tasks().to_string().replace("0.9", "0.8"));
    let mut args = args;
    args[3] = &other;
    told(&iplw(&args, None), 2, &["--out", "phyre_00007", "another directory"]);
    assert_eq!(std::fs::read_to_string(out.join(all[0])).unwrap(), before);
    from_scenes(folder.path(), &out.join(all[1]));
}

/// Imports the scenes of the family.
fn from_scenes(folder: &Path, scenes: &Path) {
    let out = folder.join("scenes");
    let (from, to) = (scenes.to_str().unwrap(), out.to_str().unwrap());
    let args = ["tasks", "import", "scenes", from, "--name", "mine", "--sample", "60", "--out", to];
    told(&iplw(&args, None), 0, &["2 of 2 tasks imported; 1 of 2 solutions solve here"]);
    let text = std::fs::read_to_string(out.join("mine.toml")).unwrap();
    assert!(text.contains("density = 0.25\nfriction = 0.5\nrestitution = 0.2\ndamping = 1.0\n"), "{text}");
    assert_eq!(read_families(&out).unwrap()[0].tasks().len(), 2);

    // Errors name the line, and nothing is written.
    let lines = std::fs::read_to_string(scenes).unwrap();
    let check = |second: &dyn Fn(&str) -> String, wanted: &[&str]| {
        let mut all: Vec<String> = lines.lines().map(String::from).collect();
        all[1] = second(&all[1]);
        let file = written(&folder.join("bad.jsonl"), &all.join("\n"));
        let never = folder.join("never");
        let args = ["tasks", "import", "scenes", &file, "--out", never.to_str().unwrap()];
        told(&iplw(&args, None), 2, wanted);
        assert!(!never.join("bad.toml").exists() && !never.join("bad.scenes.jsonl").exists());
    };
    check(&|line| line.replace("\"radius\":", "\"raduis\":"), &["bad.jsonl, line 2", "raduis"]);
    check(&|line| line.replace("\"density\":0.25", "\"density\":0.5"), &["line 2", "0.5", "--real"]);
    check(
        &|line| line.replace("\"count\":100000", "\"count\":5"),
        &["line 2", "action", "the same action space"],
    );
    check(
        &|line| line.replace("\"solutions\":[[0.", "\"solutions\":[[1."),
        &["line 2", "solutions[0].action[0]"],
    );
}

#[test]
fn rejects_invalid_phyre_tasks() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("out");
    let check = |text: &str, more: &[&str], wanted: &[&str]| {
        let file = written(&folder.path().join("bad.json"), text);
        let args = [&["tasks", "import", "phyre", &file, "--out", out.to_str().unwrap()], more].concat();
        told(&iplw(&args, None), 2, wanted);
        assert!(!out.exists());
    };
    let text = tasks().to_string();
    check(&text.replace("\"body2\":0", "\"body2\":9"), &[], &["bad.json", "00007:000", "goal.body2", "9"]);
    check(&text.replace("\"circle\"", "\"circel\""), &[], &["00007:000", "bodies[4].shapes[0]", "circel"]);
    check(&text, &["--template", "00009"], &["--template", "00009", "00007, 00008"]);
    check("[1]", &[], &["bad.json"]);
    check(&text, &["--sample", "3"], &["--sample", "3"]);
}
