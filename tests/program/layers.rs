//! Modules depend only on the layers below them, and heavy crates are named in their own module only.

use std::path::{Path, PathBuf};

use crate::sources::{files, import_cycles, imports, library, long_functions, text};

/// Longest function, in lines.
const MAX_FUNCTION_LINES: usize = 70;
/// Files in which an import cycle or a long function is allowed.
const EXEMPT: [&str; 1] = ["src/inference/mixed_model/groups.rs"];

/// Layers, lowest first: each may use itself and those before it.
const LAYERS: [&str; 32] = [
    "error",
    "names",
    "number",
    "sync",
    "thread_priority",
    "json",
    "rng",
    "budget",
    "progress",
    "trajectory",
    "distribution",
    "line_fit",
    "neural",
    "task",
    "world",
    "residual",
    "reality",
    "explore",
    "estimate",
    "inference",
    "policy",
    "plan",
    "design",
    "picture",
    "experiment",
    "commands",
    "report",
    "store",
    "access",
    "job",
    "session",
    "control",
];
/// The top layer: may use all others; no other may use it.
const TOP: &str = "serve";

/// A crate and the only layers that may name it.
const CRATE_LAYERS: [(&str, &[&str]); 24] = [
    ("rapier2d", &["world"]),
    ("dfdx", &["neural", "policy"]),
    ("safetensors", &["policy"]),
    ("axum", &["serve"]),
    (
        "utoipa",
        &[
            "commands",
            "control",
            "inference",
            "estimate",
            "explore",
            "job",
            "reality",
            "serve",
            "session",
            "store",
            "task",
        ],
    ),
    ("tower_http", &["serve"]),
    ("rmp", &["serve"]),
    ("rmpv", &["serve"]),
    ("rmp_serde", &["serve"]),
    ("serde_transcode", &["serve"]),
    ("rusqlite", &["store"]),
    ("ring", &["access", "serve", "store"]),
    ("rustls", &["serve"]),
    ("hyper", &["serve"]),
    ("libc", &["serve", "store"]),
    ("rustix", &["thread_priority"]),
    ("hyper_util", &["serve"]),
    ("rmcp", &["serve"]),
    ("prometheus_client", &["serve"]),
    ("plotters", &["picture"]),
    ("png", &["picture"]),
    ("resvg", &["picture"]),
    ("toml", &["task"]),
    ("clap", &["commands", "reality", "task"]),
];

#[test]
fn layers_use_only_lower_layers() {
    let mut violations = Vec::new();
    for (layer, file, text) in sources() {
        let level = LAYERS.iter().position(|r| *r == layer).unwrap_or(LAYERS.len());
        for used in uses(&text) {
            let at = match LAYERS.iter().position(|r| *r == used) {
                Some(at) => at,
                None if used == TOP => LAYERS.len(),
                None => continue,
            };
            if at > level {
                violations.push(format!("{} uses crate::{used}", file.display()));
            }
        }
    }
    assert!(violations.is_empty(), "{}", violations.join("\n"));
}

#[test]
fn heavy_crates_are_named_in_their_layer_only() {
    let mut violations = Vec::new();
    for (layer, file, text) in sources() {
        for (name, layers) in CRATE_LAYERS {
            let named = code(&text).any(|line| {
                line.split(|c: char| !c.is_alphanumeric() && c != '_').any(|word| word == name)
                    && line.contains(&format!("{name}::"))
            });
            if named && !layers.contains(&layer.as_str()) {
                violations.push(format!("{} names {name}", file.display()));
            }
        }
    }
    assert!(violations.is_empty(), "{}", violations.join("\n"));
}

/// Only the module that makes hidden worlds reads the physics of the built-in real worlds.
#[test]
fn hidden_physics_is_read_only_in_reality() {
    for (layer, file, text) in sources() {
        let allowed = layer == "reality" || layer == "task";
        assert!(allowed || !code(&text).any(|l| l.contains("real_physics")), "{} reads it", file.display());
    }
}

/// Files can be read one after the other.
#[test]
fn files_have_no_import_cycles() {
    let cycles = import_cycles(&imports(&library()));
    let elsewhere: Vec<_> = cycles.iter().filter(|c| !c.iter().all(|f| exempt(f))).collect();
    assert!(elsewhere.is_empty(), "{elsewhere:#?}");
}

#[test]
fn functions_have_at_most_70_lines() {
    let mut violations = Vec::new();
    for file in files().into_iter().filter(|f| !exempt(f)) {
        for (name, lines) in long_functions(&text(&file), MAX_FUNCTION_LINES) {
            violations.push(format!("{}: {name} has {lines} lines", file.display()));
        }
    }
    assert!(violations.is_empty(), "{}", violations.join("\n"));
}

fn exempt(file: &Path) -> bool {
    EXEMPT.iter().any(|e| file == Path::new(e))
}

/// Both checks detect violations through `super`, aliases, `pub use`, whole modules and macros, and ignore test modules.
#[test]
fn detects_import_cycles_and_long_functions() {
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
    let cycles = import_cycles(&imports(&sources.into_iter().collect()));
    assert_eq!(cycles, [[PathBuf::from("a/b.rs"), PathBuf::from("a/c.rs")]]);

    let long = "struct S; impl S { fn long() {\n1;\n2;\n} }\nfn short() {\n}";
    assert_eq!(long_functions(long, 3), [("long".to_string(), 4)]);
}

/// The check detects a violation.
#[test]
fn detects_crate_paths() {
    let found = uses(
        "use crate::task::Scene;\nlet x = crate::{world::Engine, serve};\n// crate::policy in a comment\n",
    );
    assert_eq!(found, ["task", "world", "serve"]);
}

/// Every source file of the library with its layer.
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
            let layer = below.iter().next().unwrap().to_string_lossy().trim_end_matches(".rs").to_string();
            let text = std::fs::read_to_string(&path).unwrap();
            (!["lib", "main", "cli"].contains(&layer.as_str())).then_some((layer, path, text))
        })
        .collect()
}

/// Lines that aren't comments.
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
