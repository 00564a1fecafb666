//! The rooms of the crate use only rooms before them, and heavy crates stay where they belong.

use std::path::{Path, PathBuf};

use crate::sources::{arrows, circles, files, library, long_functions, text};

/// A page: the most lines of a function.
const MOST_LINES: usize = 70;
/// Files in which a loop or a long function is still let be.
const EXEMPT: [&str; 1] = ["src/discover/launch.rs"];

/// Rooms in order: each may use itself and those before it.
const ROOMS: [&str; 24] = [
    "error",
    "json",
    "rng",
    "progress",
    "budget",
    "trajectory",
    "distribution",
    "neural",
    "task",
    "world",
    "residual",
    "reality",
    "explore",
    "estimate",
    "discover",
    "policy",
    "plan",
    "design",
    "picture",
    "experiment",
    "store",
    "access",
    "job",
    "session",
];
/// Uses anything; nothing uses it.
const LAST: &str = "serve";

/// A crate and the only places that may name it.
const HOMES: [(&str, &[&str]); 21] = [
    ("rapier2d", &["world"]),
    ("dfdx", &["neural", "policy"]),
    ("safetensors", &["policy"]),
    ("axum", &["serve"]),
    ("utoipa", &["serve"]),
    ("tower_http", &["serve"]),
    ("rmp", &["serve"]),
    ("rmpv", &["serve"]),
    ("rmp_serde", &["serve"]),
    ("serde_transcode", &["serve"]),
    ("rusqlite", &["store"]),
    ("ring", &["access", "serve", "store"]),
    ("rustls", &["serve"]),
    ("hyper", &["serve"]),
    ("libc", &["serve"]),
    ("hyper_util", &["serve"]),
    ("rmcp", &["serve"]),
    ("plotters", &["picture"]),
    ("png", &["picture"]),
    ("resvg", &["picture"]),
    ("toml", &["task"]),
];

#[test]
fn rooms_use_only_rooms_before_them() {
    let mut offences = Vec::new();
    for (room, file, text) in sources() {
        let own = ROOMS.iter().position(|r| *r == room).unwrap_or(ROOMS.len());
        for used in uses(&text) {
            let at = match ROOMS.iter().position(|r| *r == used) {
                Some(at) => at,
                None if used == LAST => ROOMS.len(),
                None => continue,
            };
            if at > own {
                offences.push(format!("{} uses crate::{used}", file.display()));
            }
        }
    }
    assert!(offences.is_empty(), "{}", offences.join("\n"));
}

#[test]
fn heavy_crates_stay_at_home() {
    let mut offences = Vec::new();
    for (room, file, text) in sources() {
        for (name, homes) in HOMES {
            let named = code(&text).any(|line| {
                line.split(|c: char| !c.is_alphanumeric() && c != '_').any(|word| word == name)
                    && line.contains(&format!("{name}::"))
            });
            if named && !homes.contains(&room.as_str()) {
                offences.push(format!("{} names {name}", file.display()));
            }
        }
    }
    assert!(offences.is_empty(), "{}", offences.join("\n"));
}

/// The truth about the built-in real worlds is read where hidden worlds are made, and nowhere else.
#[test]
fn hidden_physics_is_read_only_in_reality() {
    for (room, file, text) in sources() {
        let allowed = room == "reality" || room == "task";
        assert!(allowed || !code(&text).any(|l| l.contains("real_physics")), "{} reads it", file.display());
    }
}

/// A reader can follow one file after the other.
#[test]
fn no_files_name_each_other_in_a_loop() {
    let found = circles(&arrows(&library()));
    let elsewhere: Vec<_> = found.iter().filter(|c| !c.iter().all(|f| exempt(f))).collect();
    assert!(elsewhere.is_empty(), "{elsewhere:#?}");
}

#[test]
fn no_function_is_longer_than_a_page() {
    let mut offences = Vec::new();
    for file in files().into_iter().filter(|f| !exempt(f)) {
        for (name, lines) in long_functions(&text(&file), MOST_LINES) {
            offences.push(format!("{}: {name} has {lines} lines", file.display()));
        }
    }
    assert!(offences.is_empty(), "{}", offences.join("\n"));
}

fn exempt(file: &Path) -> bool {
    EXEMPT.iter().any(|e| file == Path::new(e))
}

/// Both checks can fail: through `super`, aliases, `pub use`, whole modules and macros, but not for what tests name.
#[test]
fn loops_and_long_functions_are_found() {
    let source = |path: &[&str], text: &str| {
        let module: Vec<String> = path.iter().map(|s| s.to_string()).collect();
        (module.clone(), (PathBuf::from(module.join("/") + ".rs"), text.to_string()))
    };
    let sources = [
        source(&[], "pub mod a; pub mod d;"),
        source(&["a"], "pub mod b; pub mod c; pub use c::Thing; pub fn top() { b::leaf() }"),
        source(&["a", "b"], "use super::Thing as Other; pub fn leaf() {} pub fn f(_: Other) {}"),
        source(
            &["a", "c"],
            "use crate::a::b; pub struct Thing; pub fn g() { println!(\"{:?}\", b::leaf()) }",
        ),
        source(&["d"], "#[cfg(test)] mod tests { use crate::e::E; } pub struct D;"),
        source(&["e"], "pub struct E(crate::d::D);"),
    ];
    let found = circles(&arrows(&sources.into_iter().collect()));
    assert_eq!(found, [[PathBuf::from("a/b.rs"), PathBuf::from("a/c.rs")]]);

    let long = "struct S; impl S { fn long() {\n1;\n2;\n} }\nfn short() {\n}";
    assert_eq!(long_functions(long, 3), [("long".to_string(), 4)]);
}

/// The check itself can fail.
#[test]
fn uses_are_found() {
    let found = uses(
        "use crate::task::Scene;\nlet x = crate::{world::Engine, serve};\n// crate::policy in a comment\n",
    );
    assert_eq!(found, ["task", "world", "serve"]);
}

/// Every source file of the library with its room.
fn sources() -> Vec<(String, PathBuf, String)> {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("src");
    let mut files = Vec::new();
    let mut pending = vec![root.clone()];
    while let Some(folder) = pending.pop() {
        for entry in std::fs::read_dir(folder).unwrap() {
            let path = entry.unwrap().path();
            if path.is_dir() {
                pending.push(path);
            } else if path.extension().is_some_and(|e| e == "rs") {
                files.push(path);
            }
        }
    }
    files
        .into_iter()
        .filter_map(|path| {
            let below = path.strip_prefix(&root).unwrap();
            let room = below.iter().next().unwrap().to_string_lossy().trim_end_matches(".rs").to_string();
            let text = std::fs::read_to_string(&path).unwrap();
            (!["lib", "main", "cli"].contains(&room.as_str())).then_some((room, path, text))
        })
        .collect()
}

/// Lines that are not comments.
fn code(text: &str) -> impl Iterator<Item = &str> {
    text.lines().filter(|l| !l.trim_start().starts_with("//"))
}

/// First segments of every `crate::...` path.
fn uses(text: &str) -> Vec<String> {
    let mut found = Vec::new();
    for line in code(text) {
        for part in line.split("crate::").skip(1) {
            let word = |s: &str| {
                s.trim().chars().take_while(|c| c.is_alphanumeric() || *c == '_').collect::<String>()
            };
            if let Some(group) = part.strip_prefix('{') {
                let group = group.split('}').next().unwrap_or_default();
                found.extend(group.split(',').map(word));
            } else {
                found.push(word(part));
            }
        }
    }
    found.retain(|w| !w.is_empty());
    found
}
