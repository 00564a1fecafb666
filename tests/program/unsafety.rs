//! Unsafe code is restricted to the files that SECURITY.md lists with reasons.

use std::collections::BTreeMap;

use crate::sources::{files, text};

/// Files that allow unsafe code, each with its reason.
fn allowed() -> BTreeMap<String, String> {
    let reason = |text: &str| {
        // The attribute may span several lines.
        let text =
            text.split_whitespace().collect::<Vec<_>>().join(" ").replace("( ", "(").replace("\" )", "\")");
        let told = text.split_once("#![allow(unsafe_code, reason = \"")?.1.split_once("\")]")?.0;
        Some(told.to_string())
    };
    files().iter().filter_map(|file| Some((file.display().to_string(), reason(&text(file))?))).collect()
}

/// Rows of SECURITY.md's table.
fn listed() -> BTreeMap<String, String> {
    let page = text("SECURITY.md".as_ref());
    let table = page.split_once("\n## Unsafe code\n").expect("SECURITY.md has a list of unsafe code").1;
    let table = table.split("\n## ").next().unwrap();
    let rows = table.lines().filter_map(|line| line.strip_prefix("| `src/")?.strip_suffix(" |"));
    let row = |row: &str| {
        let (file, reason) = row.split_once("` | ").expect("a file and a reason");
        (format!("src/{file}"), reason.to_string())
    };
    rows.map(row).collect()
}

#[test]
fn unsafe_code_is_where_the_list_says_and_for_its_reason() {
    assert_eq!(allowed(), listed());
    assert!(!allowed().is_empty());
}

/// The compiler refuses it everywhere else, and no other words let it in again.
#[test]
fn everywhere_else_it_is_refused() {
    assert!(text("src/lib.rs".as_ref()).contains("\n#![deny(unsafe_code)]\n"));
    assert!(text("src/main.rs".as_ref()).contains("\n#![forbid(unsafe_code)]\n"));
    let allowed = allowed();
    for file in files() {
        let words = text(&file);
        let (all, listed) =
            (words.matches("unsafe_code").count(), allowed.contains_key(&file.display().to_string()));
        let own = ["src/lib.rs", "src/main.rs"].iter().any(|f| file.ends_with(f));
        assert_eq!(all, usize::from(listed || own), "{}", file.display());
        assert!(!words.contains("warn(unsafe") && !words.contains("expect(unsafe"), "{}", file.display());
    }
}

/// A file that has lost its unsafe code loses its leave.
#[test]
fn who_may_needs_it() {
    for file in allowed().keys() {
        assert!(
            text(file.as_ref()).lines().any(|l| l.contains("unsafe ") && !l.contains("allow(")),
            "{file}"
        );
    }
}
