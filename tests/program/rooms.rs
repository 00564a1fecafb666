//! The rooms of the crate use only rooms before them, and heavy crates stay where they belong.

use std::path::{Path, PathBuf};

/// Rooms in order: each may use itself and those before it.
const ROOMS: [&str; 18] = [
    "error",
    "json",
    "rng",
    "progress",
    "trajectory",
    "task",
    "world",
    "residual",
    "reality",
    "explore",
    "estimate",
    "discover",
    "policy",
    "picture",
    "experiment",
    "store",
    "job",
    "session",
];
/// Uses anything; nothing uses it.
const LAST: &str = "serve";

/// A crate and the only places that may name it.
const HOMES: [(&str, &[&str]); 11] = [
    ("rapier2d", &["world"]),
    ("dfdx", &["policy"]),
    ("safetensors", &["policy"]),
    ("axum", &["serve"]),
    ("utoipa", &["serve"]),
    ("tower_http", &["serve"]),
    ("rmp", &["serve"]),
    ("rmpv", &["serve"]),
    ("rusqlite", &["store"]),
    ("plotters", &["picture"]),
    ("resvg", &["picture"]),
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
