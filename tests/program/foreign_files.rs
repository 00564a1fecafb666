//! Commands never delete or change a file that is not the program's. If they replace an output file, they name it on stderr.

use std::fs;
use std::io::{BufRead, BufReader, Read};
use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};

use iplw::reality::trials_to_csv;
use iplw::store::Store;

use crate::worlds;

/// A directory with files of somebody else.
struct Place {
    directory: tempfile::TempDir,
    files: Vec<(PathBuf, String)>,
}

impl Place {
    fn new() -> Place {
        Place { directory: tempfile::tempdir().unwrap(), files: Vec::new() }
    }

    fn at(&self, name: &str) -> PathBuf {
        self.directory.path().join(name)
    }

    fn text(&self, name: &str) -> String {
        self.at(name).to_str().unwrap().into()
    }

    /// Adds a file of somebody else.
    fn add(&mut self, name: &str) {
        self.add_with(name, &format!("contents of {name}"));
    }

    fn add_with(&mut self, name: &str, contents: &str) {
        let path = self.at(name);
        fs::create_dir_all(path.parent().unwrap()).unwrap();
        fs::write(&path, contents).unwrap();
        self.files.push((path, contents.into()));
    }

    #[cfg(unix)]
    fn link(&self, target: &str, link: &str) {
        std::os::unix::fs::symlink(self.at(target), self.at(link)).unwrap();
    }

    /// Makes a data directory.
    fn data(&self, name: &str) {
        drop(Store::open(&self.at(name)).unwrap());
    }

    /// Runs a command in the directory; every file has its old contents, or stderr says that it was replaced.
    fn check(&mut self, args: &[&str]) -> Output {
        let done = run(self.directory.path(), args);
        let errors = String::from_utf8_lossy(&done.stderr).to_string();
        self.files.retain(|(path, contents)| {
            let name = path.file_name().unwrap().to_str().unwrap();
            let same = fs::read_to_string(path).is_ok_and(|c| c == *contents);
            assert!(same || names(&errors, name), "{args:?}: {} is gone: {errors}", path.display());
            same
        });
        done
    }

    /// The command is refused, and says why.
    fn refuse(&mut self, args: &[&str], expected: &str) {
        let done = self.check(args);
        let error = String::from_utf8_lossy(&done.stderr).to_string();
        assert_eq!(done.status.code(), Some(2), "{args:?}: {error}");
        assert!(error.contains(expected), "{args:?}: {error:?} does not contain {expected:?}");
    }

    fn accept(&mut self, args: &[&str]) -> String {
        let done = self.check(args);
        let error = String::from_utf8_lossy(&done.stderr).to_string();
        assert!(done.status.success(), "{args:?}: {error}");
        error
    }
}

/// Whether standard error says that a file was replaced.
fn names(errors: &str, file: &str) -> bool {
    errors.lines().any(|l| l.starts_with("replaced ") && l.ends_with(file))
}

/// Runs a command; a server is stopped once it listens.
fn run(directory: &Path, args: &[&str]) -> Output {
    let mut command = Command::new(env!("CARGO_BIN_EXE_iplw"));
    command.args(args).current_dir(directory);
    command.stdin(Stdio::piped()).stdout(Stdio::piped()).stderr(Stdio::piped());
    if args[0] == "serve" {
        command.args(["--http", "127.0.0.1:0", "--exit-with-stdin"]);
    }
    let mut child = command.spawn().unwrap();
    let (mut out, mut errors) = (BufReader::new(child.stdout.take().unwrap()), String::new());
    let mut line = String::new();
    out.read_line(&mut line).unwrap();
    drop(child.stdin.take());
    let _ = std::io::copy(&mut out, &mut std::io::sink());
    child.stderr.take().unwrap().read_to_string(&mut errors).unwrap();
    Output { status: child.wait().unwrap(), stdout: line.into(), stderr: errors.into() }
}

#[cfg(unix)]
fn mode(path: &Path) -> u32 {
    std::os::unix::fs::PermissionsExt::mode(&fs::metadata(path).unwrap().permissions()) & 0o777
}

#[test]
fn directories_of_others_are_no_data_directories() {
    for name in ["policies/model.safetensors", "policies/folder/a.1.safetensors", "tokens.json", "lockers"] {
        let mut place = Place::new();
        place.add(&format!("mine/{name}"));
        place.data("data");
        let mine = place.text("mine");
        #[cfg(unix)]
        fs::set_permissions(&mine, std::os::unix::fs::PermissionsExt::from_mode(0o755)).unwrap();
        place.accept(&["backup", "data", "--to", "kept"]);
        for args in [
            vec!["serve", "--data-dir", &mine],
            vec!["token", "new", "ann", "--scope", "act", "--data-dir", &mine],
            vec!["restore", "kept", "--to", &mine, "--replace"],
        ] {
            place.refuse(&args, "other files, such as");
        }
        assert_eq!(fs::read_dir(&mine).unwrap().count(), 1, "nothing was added");
        #[cfg(unix)]
        assert_eq!(mode(Path::new(&mine)), 0o755);
    }
}

#[test]
fn only_weights_of_the_store_are_swept() {
    let mut place = Place::new();
    place.data("data");
    fs::write(place.at("data/policies/a.1.safetensors"), "stale").unwrap();
    for name in ["notes.txt", "model.safetensors", "a.b.safetensors", "folder/a.1.safetensors"] {
        place.add(&format!("data/policies/{name}"));
    }
    place.add("elsewhere.safetensors");
    #[cfg(unix)]
    place.link("elsewhere.safetensors", "data/policies/a.2.safetensors");
    place.accept(&["serve", "--data-dir", "data"]);
    assert!(!place.at("data/policies/a.1.safetensors").exists());
    #[cfg(unix)]
    assert!(place.at("data/policies/a.2.safetensors").is_symlink());
    place.accept(&["backup", "data", "--to", "kept"]);
    place.accept(&["restore", "kept", "--to", "data", "--replace"]);
    place.accept(&["check", "data", "--drop"]);
}

#[test]
fn backup_makes_a_new_directory() {
    let mut place = Place::new();
    place.data("data");
    place.add("folder/notes.txt");
    place.add("file");
    for target in ["folder", "file", "folder/notes.txt"] {
        place.refuse(&["backup", "data", "--to", target], "already exists");
    }
    assert!(!place.check(&["restore", "folder", "--to", "new"]).status.success());
}

#[cfg(unix)]
#[test]
fn links_in_a_data_directory_are_not_followed() {
    let mut place = Place::new();
    place.data("data");
    place.add("target");
    fs::remove_file(place.at("data/lock")).unwrap();
    for link in ["lock", "tokens.lock"] {
        place.link("target", &format!("data/{link}"));
    }
    place.accept(&["serve", "--data-dir", "data"]);
    let token = ["token", "new", "ann", "--scope", "act", "--data-dir", "data"];
    place.refuse(&token, "symbolic link");
    fs::remove_file(place.at("data/tokens.lock")).unwrap();
    place.link("nothing", "data/tokens.lock");
    place.refuse(&token, "symbolic link");
    assert!(!place.at("nothing").exists());
}

#[test]
fn other_json_files_are_no_token_files() {
    let mut place = Place::new();
    place.data("data");
    place.add_with("data/tokens.json", "{\"format\": \"mine/1\", \"tokens\": []}");
    place.add_with("package.json", "{\"name\": \"mine\"}");
    for args in [["--data-dir", "data"], ["--token-file", "package.json"]] {
        place.refuse(&[&["token", "new", "ann", "--scope", "act"], &args[..]].concat(), "format");
        place.refuse(&[&["serve"], &args[..]].concat(), "format");
    }
}

#[cfg(unix)]
#[test]
fn sockets_replace_no_files() {
    let mut place = Place::new();
    place.add("file");
    place.link("file", "link");
    for path in ["file", "link"] {
        let address = format!("ipc://{}", place.text(path));
        place.refuse(&["serve", "--zmq", &address], "another file has this path");
    }
    assert!(place.at("link").is_symlink());
}

const FALL: &str = r#"{"format":"iplw.scene/1","bodies":[{"name":"ball","shape":{"type":"disc","radius":0.5},"position":[0,100]}],"gravity":[0,-9.8],"time_step":0.001,"steps":100,"observe_every":50}"#;

#[test]
fn replaced_output_files_are_named() {
    let mut place = Place::new();
    let trials = worlds::trials(&worlds::single(2, 1), worlds::Noise::White, 8, 30, 8.0, 1);
    fs::write(place.at("scene.json"), worlds::scene().to_json()).unwrap();
    fs::write(place.at("fall.jsonl"), FALL).unwrap();
    fs::write(place.at("trials.csv"), trials_to_csv(&trials)).unwrap();
    for name in
        ["results.jsonl", "policy.safetensors", "out/report.html", "out/notes.txt", "man/iplw.1", "target"]
    {
        place.add(name);
    }
    let named = |errors: &str, name: &str| assert!(names(errors, name), "{name}: {errors}");
    let rollout = ["rollout", "--in", "fall.jsonl", "--out"];
    named(&place.accept(&[&rollout[..], &["results.jsonl"]].concat()), "results.jsonl");
    let train = ["train", "--task", "basketball", "--per-task", "20", "--batches", "5"];
    named(
        &place.accept(&[&train[..], &["--latents", "friction=0.2,restitution=0.7"]].concat()),
        "policy.safetensors",
    );
    named(&place.accept(&["man", "--out", "man"]), "iplw.1");
    let diagnose = ["diagnose", "--scene", "scene.json", "--trials", "trials.csv", "--out", "out"];
    let errors = place.accept(&diagnose);
    named(&errors, "report.html");
    assert!(!errors.contains("report.json"), "new files are not named: {errors}");
    #[cfg(unix)]
    {
        place.link("target", "link.jsonl");
        named(&place.accept(&[&rollout[..], &["link.jsonl"]].concat()), "link.jsonl");
        assert_eq!(fs::read_to_string(place.at("target")).unwrap(), "contents of target");
    }
}
