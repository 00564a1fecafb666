//! The sources use the field's terms: one name for one thing, textbook nouns for types and modules, plain English in
//! comments, help and errors. `docs/glossary.md` is the authority on terms.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

use proc_macro2::{TokenStream, TokenTree};
use syn::visit::{self, Visit};

use crate::sources::{files, text};

/// A file with texts of the report, which are part of its format.
const EXEMPT: &str = "src/inference/next_experiment/mod.rs";

/// Type names that may be defined more than once, with the reason; at most ten.
const REPEATED_TYPES: [(&str, &str); 3] = [
    ("Args", "the arguments of each command, in the command's own file"),
    ("Mask", "one comparison mask for each instruction set, chosen by a type parameter"),
    ("Error", "the crate's error type; an associated type of foreign traits has the same name"),
];

/// Words that say something was done to a thing, or point at it, and don't say which thing it is.
const FORBIDDEN_NAMES: [&str; 36] = [
    "told", "asked", "shown", "seen", "kept", "given", "taken", "drawn", "judged", "found", "wanted", "own",
    "thing", "things", "way", "ways", "here", "beside", "said", "met", "tried", "known", "brought", "moved",
    "planned", "thrown", "under", "along", "what", "sent", "left", "held", "every", "followed", "chosen",
    "answered",
];

/// Phrases that help texts, errors and documentation do without.
const FORBIDDEN_PHRASES: [&str; 7] =
    ["is said", "is told", "are told", "are said", "nobody", " as it is", "what is left"];

#[test]
fn type_names_are_defined_once() {
    assert!(REPEATED_TYPES.len() <= 10);
    let repeated: Vec<_> = definitions(|d| &d.types)
        .into_iter()
        .filter(|(name, places)| places.len() > 1 && !REPEATED_TYPES.iter().any(|(n, _)| n == name))
        .map(|(name, places)| format!("{name}: {}", places.join(", ")))
        .collect();
    assert!(repeated.is_empty(), "type names defined more than once:\n{}", repeated.join("\n"));
}

#[test]
fn types_and_modules_are_named_by_nouns() {
    let names = [definitions(|d| &d.types), definitions(|d| &d.modules)].concat();
    let forbidden: Vec<_> = names
        .into_iter()
        .filter(|(name, _)| FORBIDDEN_NAMES.contains(&name.to_lowercase().as_str()))
        .map(|(name, places)| format!("{name}: {}", places.join(", ")))
        .collect();
    assert!(forbidden.is_empty(), "names that don't say what a thing is:\n{}", forbidden.join("\n"));
}

#[test]
fn comments_do_not_begin_with_what() {
    let lines: Vec<_> = checked_files()
        .iter()
        .flat_map(|file| {
            let lines = comments_beginning_with_what(&text(file));
            lines.into_iter().map(move |line| format!("{}:{line}", file.display()))
        })
        .collect();
    assert!(lines.is_empty(), "comments that begin with \"What\":\n{}", lines.join("\n"));
}

#[test]
fn texts_are_plain_english() {
    let offences: Vec<_> = checked_files()
        .iter()
        .flat_map(|file| {
            let found = phrases(&text(file));
            found.into_iter().map(move |(phrase, text)| format!("{}: \"{phrase}\" in {text}", file.display()))
        })
        .collect();
    assert!(offences.is_empty(), "{}", offences.join("\n"));
}

/// Each check detects a violation.
#[test]
fn detects_violations_of_language() {
    let source = "/// What is seen.\nmod told { struct Kept; }\nfn f() { trait Way {} g!(\"that nobody knows\"); }\n// What for";
    let definitions = Definitions::of(source);
    assert_eq!(definitions.types, ["Kept", "Way"]);
    assert_eq!(definitions.modules, ["told"]);
    assert_eq!(comments_beginning_with_what(source), [1, 4]);
    assert_eq!(phrases(source), [("nobody", "that nobody knows".to_string())]);
}

/// The files that the checks apply to.
fn checked_files() -> Vec<PathBuf> {
    files().into_iter().filter(|f| f != Path::new(EXEMPT)).collect()
}

/// Names of one kind, each with the files that define it. Files are modules by their own names.
fn definitions(kind: impl Fn(&Definitions) -> &Vec<String>) -> Vec<(String, Vec<String>)> {
    let mut places: BTreeMap<String, Vec<String>> = BTreeMap::new();
    for file in checked_files() {
        for name in kind(&Definitions::of(&text(&file))) {
            places.entry(name.clone()).or_default().push(file.display().to_string());
        }
    }
    places.into_iter().collect()
}

/// Names of the types and modules that a file defines, those inside of functions and of tests included.
#[derive(Default)]
struct Definitions {
    types: Vec<String>,
    modules: Vec<String>,
}

impl Definitions {
    fn of(source: &str) -> Definitions {
        let mut definitions = Definitions::default();
        definitions.visit_file(&syn::parse_file(source).unwrap());
        definitions
    }
}

impl<'a> Visit<'a> for Definitions {
    fn visit_item(&mut self, item: &'a syn::Item) {
        match item {
            syn::Item::Struct(i) => self.types.push(i.ident.to_string()),
            syn::Item::Enum(i) => self.types.push(i.ident.to_string()),
            syn::Item::Trait(i) => self.types.push(i.ident.to_string()),
            syn::Item::Type(i) => self.types.push(i.ident.to_string()),
            syn::Item::Union(i) => self.types.push(i.ident.to_string()),
            syn::Item::Mod(i) => self.modules.push(i.ident.to_string()),
            _ => {}
        }
        visit::visit_item(self, item);
    }
}

/// Numbers of the lines whose comment begins with "What".
fn comments_beginning_with_what(source: &str) -> Vec<usize> {
    let begins = |line: &str| {
        let comment = line.trim_start().strip_prefix("//")?;
        comment
            .trim_start_matches(['/', '!'])
            .trim_start()
            .strip_prefix("What")?
            .chars()
            .next()
            .map(|c| !c.is_alphabetic())
    };
    let lines = source.lines().enumerate();
    lines.filter(|(_, line)| begins(line) == Some(true)).map(|(number, _)| number + 1).collect()
}

/// Forbidden phrases in a file's string literals and doc comments, each with the text around it.
fn phrases(source: &str) -> Vec<(&'static str, String)> {
    let mut literals = BTreeSet::new();
    strings(source.parse().unwrap(), &mut literals);
    let hits = |literal: &String| {
        let folded = literal.split_whitespace().collect::<Vec<_>>().join(" ");
        FORBIDDEN_PHRASES.iter().find(|p| folded.contains(*p)).map(|p| (*p, folded.clone()))
    };
    literals.iter().filter_map(hits).collect()
}

/// String literals of a token stream; doc comments are literals, too.
fn strings(tokens: TokenStream, literals: &mut BTreeSet<String>) {
    for token in tokens {
        match token {
            TokenTree::Group(group) => strings(group.stream(), literals),
            TokenTree::Literal(literal) => {
                if let Ok(string) = syn::parse_str::<syn::LitStr>(&literal.to_string()) {
                    literals.insert(string.value());
                }
            }
            _ => {}
        }
    }
}
